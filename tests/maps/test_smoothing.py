"""Smooth outlines: valid, of the area of their cells, near them, and without stairs."""

import numpy as np
import pytest
import shapely
from affine import Affine
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mpmgis.maps.qgis.outlines import mask_outline

UNIT = Affine(1.0, 0, 0, 0, -1.0, 0)


def disc(radius, hole=0.0, size=60):
    row, column = np.indices((size, size)) - (size - 1) / 2
    distance = np.hypot(row, column)
    return (distance <= radius) & (distance >= hole)


def strip(slope, width=1.0, length=50):
    row, column = np.indices((length + 4, length + 4))
    across = np.abs(row - 2 - slope * (column - 2)) / np.hypot(1, slope)
    return (across <= width / 2 + 1e-9) & (column >= 2) & (column < length)


SHAPES = {
    "disc": disc(25.3),
    "small disc": disc(3.2),
    "ring": disc(24, 15),
    "thin ring": disc(20, 18.9),
    "level strip": strip(0.0),
    "shallow strip": strip(0.12),
    "diagonal strip": strip(1.0, 1.2),
    "single cell": np.ones((1, 1), bool),
    "two cells that meet at a corner": np.eye(2, dtype=bool),
    "chessboard": np.indices((7, 7)).sum(axis=0) % 2 == 0,
    "cell in a hole": np.pad(np.pad(np.ones((1, 1)), 1), 2, constant_values=1) > 0,
    "comb": np.tile([[True, False]], (1, 9)) | (np.arange(8)[:, None] == 0),
}


def require_sound(mask, transform=UNIT):
    """The smooth outline, after the checks that hold for every mask."""
    smooth, cells = mask_outline(mask, transform, smooth=True), mask_outline(mask, transform)
    assert smooth.is_valid
    assert smooth.area == pytest.approx(cells.area, rel=5e-3)
    assert len(smooth.geoms) == len(cells.geoms)
    holes = [[len(part.interiors) for part in outline.geoms] for outline in (smooth, cells)]
    assert holes[0] == holes[1]
    cell = abs(transform.a)
    assert smooth.boundary.hausdorff_distance(cells.boundary) < 1.3 * cell
    return smooth


@pytest.mark.parametrize("name", SHAPES)
def test_shapes(name):
    require_sound(SHAPES[name], Affine(5.0, 0, 686000.0, 0, -5.0, 5212000.0))


@given(arrays(bool, st.tuples(st.integers(1, 14), st.integers(1, 14))))
@settings(max_examples=150, deadline=None)
def test_any_mask(mask):
    if mask.any():
        require_sound(mask)


def test_steps_on_many_parts_at_once():
    require_sound(np.random.default_rng(3).random((60, 60)) < 0.55)


def test_a_disc_has_no_stairs():
    (part,) = require_sound(disc(25.3)).geoms
    distance = np.hypot(*(shapely.get_coordinates(part.segmentize(0.2)) - [30.0, -30.0]).T)
    assert np.ptp(distance) < 0.35  # of cells
    assert part.length == pytest.approx(2 * np.pi * 25.3, rel=0.01)  # that of the cells is 4 / pi times as long


@pytest.mark.parametrize("slope", [0.12, 0.5, 1.0])
def test_a_straight_edge_is_straight(slope):
    row, column = np.indices((80, 80))
    (part,) = require_sound(row - 10 > slope * column).geoms
    line = shapely.get_coordinates(part.segmentize(0.2))
    line = line[(line[:, 0] > 15) & (line[:, 0] < 60) & (line[:, 1] > -75)]
    across = (-line[:, 1] - 10.5 - slope * line[:, 0]) / np.hypot(1, slope)
    assert np.ptp(across[np.abs(across) < 2]) < 0.3


def test_tips_of_a_thin_strip_stay():
    west, _, east, _ = require_sound(strip(0.0)).bounds
    assert (west, east) == pytest.approx((2.0, 50.0), abs=0.7)


def test_a_rotated_grid():
    turned = Affine.translation(100.0, 200.0) * Affine.rotation(30.0) * Affine.scale(3.0, -3.0)
    smooth = mask_outline(disc(12.0), turned, smooth=True)
    assert smooth.is_valid and smooth.area == pytest.approx(9.0 * np.count_nonzero(disc(12.0)), rel=5e-3)
