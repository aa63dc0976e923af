"""Known distances between outlines."""

import math

import pytest
import shapely

from mpmgis.results.outline_distance import outline_distances

SQUARE = shapely.box(0, 0, 100, 100)


def test_equal_outlines_have_zero_distance():
    assert tuple(outline_distances(SQUARE, SQUARE, 1.0)) == pytest.approx((0, 0, 0, 0, 0), abs=1e-12)


def test_a_wider_square_is_its_margin_apart_and_more_at_its_corners():
    found = outline_distances(SQUARE, shapely.box(-10, -10, 110, 110), 1.0)
    assert found.first_mean == pytest.approx(10)
    assert found.largest == pytest.approx(10 * 2**0.5)
    assert found.first_mean < found.mean < found.second_mean
    swapped = outline_distances(shapely.box(-10, -10, 110, 110), SQUARE, 1.0)
    assert (swapped.first_mean, swapped.second_mean) == (found.second_mean, found.first_mean)


@pytest.mark.parametrize("spacing", [2.5, 0.4])
def test_the_mean_is_the_integral_over_the_outline(spacing):
    """100 m of each 120 m side are 10 m from the inner square; on the rest the distance increases to the corner."""
    found = outline_distances(SQUARE, shapely.box(-10, -10, 110, 110), spacing)
    beside_a_corner = 50 * (2**0.5 + math.asinh(1))  # integral of sqrt(10^2 + t^2) from 0 to 10
    second = (100 * 10 + 2 * beside_a_corner) / 120
    assert found.second_mean == pytest.approx(second, abs=2e-3 * spacing**2)
    assert found.mean == pytest.approx((400 * 10 + 480 * second) / 880, abs=2e-3 * spacing**2)


@pytest.mark.parametrize("spacing", [4.0, 1.0, 0.25])
def test_shifted_discs_have_hausdorffs_distance_to_the_order_of_the_spacing(spacing):
    first, second = (shapely.Point(x, 0).buffer(60, 512) for x in (0, 50))
    assert outline_distances(first, second, spacing).largest == pytest.approx(50, abs=spacing**2 / 60 + 1e-3)


def test_a_spur_changes_the_largest_distance_and_not_the_95th_percentile():
    spur = shapely.union(SQUARE, shapely.box(100, 49, 105, 51))
    found = outline_distances(SQUARE, spur, 0.5)
    assert found.largest == pytest.approx(5, abs=0.5) and found.high < 2.1 and found.mean < 0.2


def test_holes_have_outlines_and_nothing_has_none():
    holed = SQUARE.difference(shapely.box(40, 40, 60, 60))
    assert outline_distances(holed, SQUARE, 1.0).largest == pytest.approx(40)
    assert outline_distances(SQUARE, shapely.MultiPolygon(), 1.0) is None
