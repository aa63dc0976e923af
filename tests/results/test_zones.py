"""Zones of a hazard map: area, cover, no overlaps, minimum mapping area."""

import numpy as np
import pytest
import shapely
from affine import Affine

from mpmgis.results.hazard.zone_outlines import GRID, default_area, generalized_zones, polygons

TRANSFORMS = {
    "north-up": Affine(5, 0, 6e5, 0, -5, 5.2e6),
    "rotated": Affine.translation(6e5, 5.2e6) * Affine.rotation(33) * Affine.scale(5, -5),
    "sheared": Affine.translation(6e5, 5.2e6) * Affine.rotation(12) * Affine(5, 2, 0, 0, -4, 0),
    "south-up": Affine(5, 0, 6e5, 0, 5, 5.2e6),
}


def tongues():
    """uint8[120, 160]: three nested tongues with the levels 1, 2, 3; 3 shares a border with 1."""
    row, column = np.mgrid[:120, :160]
    level = np.zeros((120, 160), np.uint8)
    for number, width, length in ((1, 40, 140), (2, 25, 110), (3, 14, 90)):
        inside = (np.abs(row - 60) < width * np.sqrt(np.clip(1 - (column - 10) / length, 0, 1))) & (column >= 10)
        level[inside] = number
    return level


@pytest.mark.parametrize("name", TRANSFORMS)
@pytest.mark.parametrize("scale", [1000, 5000])
def test_zones_keep_the_areas_and_cover_them_without_overlap(name, scale):
    level, transform = tongues(), TRANSFORMS[name]
    made = generalized_zones(level, 3, transform, scale, 0.0)
    cell = abs(transform.determinant)
    assert all(zone is not None and zone.is_valid for zone in made.zones)
    for number in (1, 2, 3):
        together = sum(zone.area for zone in made.zones[number - 1 :])
        assert together == pytest.approx(np.count_nonzero(level >= number) * cell, rel=5e-3)
    rounding = GRID * sum(zone.length for zone in made.zones)
    assert abs(shapely.union_all(list(made.zones)).area - sum(zone.area for zone in made.zones)) <= rounding
    row, column = np.nonzero(level)
    x, y = transform * (column + 0.5, row + 0.5)
    cover = shapely.union_all(list(made.zones)).buffer(1.5 * np.sqrt(cell) + 0.3e-3 * scale)
    assert shapely.contains_xy(cover, x, y).all()


def test_outlines_have_fewer_points_at_smaller_scales():
    points = [
        sum(
            shapely.get_num_coordinates(zone)
            for zone in generalized_zones(tongues(), 3, TRANSFORMS["north-up"], scale, 0.0).zones
        )
        for scale in (500, 5000, 25000)
    ]
    assert points[0] > points[1] > points[2]


def test_small_parts_are_enlarged_and_small_gaps_filled_with_the_higher_level():
    level = np.zeros((60, 60), np.uint8)
    level[5:30, 5:30] = 1
    level[15, 15] = 0  # gap of 25 m2
    level[20:28, 6:14] = 2
    level[50, 50] = 2  # part of 25 m2
    made = generalized_zones(level, 2, TRANSFORMS["north-up"], 5000, 100.0)
    low, high = made.zones
    assert (made.filled, made.enlarged) == (1, 2)  # the lone part is small as level 1 and as level 2
    gap = shapely.Point(*(TRANSFORMS["north-up"] * (15.5, 15.5)))
    assert low.contains(gap)
    lone = [part for part in shapely.get_parts(high) if part.distance(low) > 50]
    assert len(lone) == 1 and lone[0].area == pytest.approx(100.0, rel=0.02)
    assert default_area(5000) == 100.0


def test_a_level_that_no_cell_has_is_no_zone():
    level = np.where(tongues() >= 2, 4, 0).astype(np.uint8)
    made = generalized_zones(level, 4, TRANSFORMS["rotated"], 5000, 100.0)
    assert [zone is not None for zone in made.zones] == [False, False, False, True]


def test_polygons_of_anything():
    shapes = [shapely.Point(0, 0), shapely.box(0, 0, 1, 1), shapely.LineString([(0, 0), (1, 1)])]
    mixed = shapely.GeometryCollection(shapes)
    assert polygons(mixed).area == 1.0
    bow = shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])
    assert polygons(bow).is_valid and polygons(bow).area == pytest.approx(0.5)
