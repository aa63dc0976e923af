"""Depths at the nodes of a solver on raster cells at any angle: the mass of the frame, cell by cell that of shapely."""

import numpy as np
import pytest
import shapely
from affine import Affine
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mpmgis.maps.averaging.bed_change import on_cells, share_beyond
from mpmgis.maps.averaging.cell_places import ROUNDING
from mpmgis.terrain.grid import Grid

WEST, SOUTH, SIDE = 733_124.3, 5_100_007.9, 5.0


def bed(seed, rows=9, columns=12):
    """A change of the bed with nodes where nothing changed."""
    rng = np.random.default_rng(seed)
    mass = np.where(rng.random((rows, columns)) < 0.6, rng.uniform(0.0, 900.0, (rows, columns)), 0.0)
    return {"eroded_mass": mass, "bed_density": 1500.0, "transform": np.array([SIDE, 0, WEST, 0, SIDE, SOUTH])}


def turned_grid(angle, cell, offset, shape, shear=0.0, down=-1):
    """Cells of `cell` = (width, height) [m] turned about the middle of the nodes."""
    middle = Affine.translation(WEST + 30.0 + offset[0], SOUTH + 22.5 + offset[1])
    turn = middle * Affine.rotation(angle) * Affine.shear(shear) * Affine.scale(cell[0], down * cell[1])
    return Grid(None, turn * Affine.translation(-shape[1] / 2, -shape[0] / 2), shape)


def squares(change):
    """The square of every node, by row."""
    rows, columns = change["eroded_mass"].shape
    i, j = np.indices((rows, columns)).reshape(2, -1)
    return shapely.box(WEST + SIDE * j, SOUTH + SIDE * i, WEST + SIDE * (j + 1), SOUTH + SIDE * (i + 1))


@given(
    angle=st.floats(-180, 180),
    width=st.floats(0.9, 40.0),
    ratio=st.sampled_from((1.0, 1.7)),
    offset=st.tuples(st.floats(-5, 5), st.floats(-5, 5)),
    shear=st.sampled_from((0.0, 20.0)),
    down=st.sampled_from((-1, 1)),
)
@example(angle=0.0, width=5.0, ratio=1.0, offset=(0.0, 0.0), shear=0.0, down=-1)
@example(angle=45.0, width=5.0, ratio=1.0, offset=(2.5, 0.0), shear=0.0, down=-1)
@example(angle=1e-7, width=5.0, ratio=1.0, offset=(0.0, 2.5), shear=0.0, down=1)
@settings(max_examples=60, deadline=None)
def test_cells_that_cover_all_nodes_have_their_mass(angle, width, ratio, offset, shear, down):
    change = bed(3)
    cell = (width, width * ratio)
    shape = tuple(int(np.ceil(150.0 / side)) + 1 for side in reversed(cell))
    grid = turned_grid(angle, cell, offset, shape, shear, down)
    cells = on_cells(change, change["eroded_mass"], grid)
    assert cells.sum() * grid.cell_area == pytest.approx(change["eroded_mass"].sum() * SIDE**2, rel=1e-12)
    assert share_beyond(change, change["eroded_mass"], grid) < 1e-12
    assert cells.min() == 0.0 and cells.max() <= change["eroded_mass"].max() * (1 + 4 * ROUNDING)


@pytest.mark.parametrize(("angle", "shear"), [(0.0, 0.0), (30.0, 0.0), (90.0, 0.0), (-137.0, 15.0)])
@pytest.mark.parametrize("cell", [(1.3, 1.3), (5.0, 5.0), (17.0, 11.0)])
def test_each_cell_has_the_overlap_of_polygons(angle, shear, cell):
    """A grid that covers only part of the nodes."""
    change, shape = bed(5), tuple(int(45 / side) for side in reversed(cell))
    grid = turned_grid(angle, cell, (3.1, -7.7), shape, shear)
    cells = on_cells(change, change["eroded_mass"], grid)
    nodes, mass = squares(change), change["eroded_mass"].ravel()
    expected = np.empty(grid.shape)
    for i, j in np.ndindex(*grid.shape):
        corners = grid.xy(i + np.array([-0.5, -0.5, 0.5, 0.5]), j + np.array([-0.5, 0.5, 0.5, -0.5]))
        shared = shapely.area(shapely.intersection(nodes, shapely.Polygon(np.transpose(corners))))
        expected[i, j] = (shared * mass).sum() / grid.cell_area
    np.testing.assert_allclose(cells, expected, rtol=1e-6, atol=1e-4)  # coordinates of 5e6 m have 1e-9 m
    inside = shapely.area(shapely.intersection(nodes, shapely.Polygon(grid.corners())))
    beyond = 1.0 - (inside * mass).sum() / (SIDE**2 * mass.sum())
    assert beyond > 0.05 and share_beyond(change, change["eroded_mass"], grid) == pytest.approx(beyond, rel=1e-6)


def test_cells_equal_to_the_nodes_take_their_values_and_nothing_of_their_neighbours():
    change = bed(7)
    rows, columns = change["eroded_mass"].shape
    grid = Grid.north_up(None, WEST, SOUTH + SIDE * rows, SIDE, (rows, columns))
    cells = on_cells(change, change["eroded_mass"], grid)
    np.testing.assert_allclose(cells, change["eroded_mass"][::-1], rtol=1e-12)
    assert np.array_equal(cells == 0.0, change["eroded_mass"][::-1] == 0.0)
