"""Cells of objects: exact lengths and areas of cells, and the length of a line across a band in any direction."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from mpmgis.results.object_cells import POINT, object_cells, size_of
from mpmgis.terrain.grid import Grid

CELL, COUNT = 5.0, 60
GRID = Grid.north_up("EPSG:32632", -0.5 * COUNT * CELL, 0.5 * COUNT * CELL, CELL, (COUNT, COUNT))
X, Y = GRID.xy(*np.meshgrid(np.arange(COUNT), np.arange(COUNT), indexing="ij"))
EVERYWHERE = np.ones(GRID.shape, bool)
ANGLES = st.floats(0.0, 2.0 * np.pi)
PLACES = st.floats(-100.0, 100.0)


@settings(max_examples=200, deadline=None)
@given(angle=ANGLES, middle=st.floats(-30.0, 30.0), width=st.floats(15.0, 80.0))
def test_a_line_across_a_band_has_its_width_to_half_a_cell_at_each_side(angle, middle, width):
    """Cells are reached by their centres: half the width of a cell across the band, which is 5 m along the axes."""
    across = np.array([np.cos(angle), np.sin(angle)])
    distance = X * across[0] + Y * across[1]
    reached = np.abs(distance - middle) <= 0.5 * width
    line = shapely.LineString([-120.0 * across, 120.0 * across])
    length = object_cells(line, GRID, reached)[1].sum()
    assert abs(length - width) <= 2.0 * 0.5 * CELL * np.abs(across).sum() + 1e-6


@settings(max_examples=100, deadline=None)
@given(points=st.lists(st.tuples(PLACES, PLACES), min_size=2, max_size=6, unique=True), seed=st.integers(0, 1000))
def test_lengths_in_cells_are_exact(points, seed):
    line = shapely.LineString(points)
    reached = np.random.default_rng(seed).random(GRID.shape) < 0.3
    boxes = shapely.box(X - 2.5, Y - 2.5, X + 2.5, Y + 2.5)
    expected = shapely.intersection(line, shapely.union_all(boxes[reached])).length
    if line.is_simple and all(abs(v / CELL - round(v / CELL)) > 1e-6 for point in points for v in point):
        assert object_cells(line, GRID, reached)[1].sum() == pytest.approx(expected, abs=1e-6)
    assert object_cells(line, GRID, EVERYWHERE)[1].sum() == pytest.approx(line.length, abs=1e-9)


@settings(max_examples=50, deadline=None)
@given(x=PLACES, y=PLACES, width=st.floats(1.0, 40.0), turn=ANGLES)
def test_areas_of_polygons_are_exact(x, y, width, turn):
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.5 * width
    cosine, sine = np.cos(turn), np.sin(turn)
    shape = shapely.Polygon(corners @ np.array([[cosine, sine], [-sine, cosine]]) + (x, y))
    assert object_cells(shape, GRID, EVERYWHERE)[1].sum() == pytest.approx(width**2, rel=1e-9)
    half = X < 0.0
    expected = shape.intersection(shapely.box(-150, -150, 0, 150)).area
    assert object_cells(shape, GRID, half)[1].sum() == pytest.approx(expected, abs=1e-6)


def test_points_have_the_cell_that_they_lie_in():
    cells, sizes = object_cells(shapely.MultiPoint([(1.0, 1.0), (500.0, 0.0)]), GRID, EVERYWHERE)
    row, column = np.divmod(cells, COUNT)
    assert sizes.tolist() == [1.0] and abs(X[row, column] - 1.0) <= 2.5 and abs(Y[row, column] - 1.0) <= 2.5
    assert size_of(shapely.MultiPoint([(1, 1), (5, 0)]), POINT) == 2.0


def test_nothing_is_off_the_grid_or_on_dry_cells():
    for shape in (shapely.Point(900, 0), shapely.LineString([(900, 0), (950, 10)]), shapely.box(900, 0, 950, 50)):
        assert object_cells(shape, GRID, EVERYWHERE)[0].size == 0
    for shape in (shapely.Point(0, 0), shapely.LineString([(-90, 0), (90, 10)]), shapely.box(-50, 0, 0, 50)):
        assert object_cells(shape, GRID, ~EVERYWHERE)[0].size == 0


def test_a_line_that_goes_far_beyond_the_grid_is_cut_at_its_edges():
    line = shapely.LineString([(-1e7, 1.0), (1e7, 1.0)])
    assert object_cells(line, GRID, EVERYWHERE)[1].sum() == pytest.approx(COUNT * CELL, rel=1e-6)
