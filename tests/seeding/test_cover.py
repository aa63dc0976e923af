"""The exact cover of cells by polygons, against shapely and against itself."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from seed_sites import CENTRE, ring, two_islands

from mpmgis.seeding.lattice import Lattice, Outline

MATRICES = {
    "squares": np.diag([5.0, 5.0]),
    "north_up": np.diag([5.0, -5.0]),
    "flat": np.diag([7.0, -2.5]),
    "turned": np.array([[4.0, 1.0], [-1.0, 4.0]]),
    "sheared": np.array([[5.0, 1.5], [0.5, -4.0]]),
}


def in_cells(polygon, outline):
    """`polygon` in the lattice coordinates of the outline's window."""
    shift = np.array([outline.window.column, outline.window.row])
    return shapely.transform(polygon, lambda points: outline.lattice.to_cells(points) - shift)


@pytest.mark.parametrize("matrix", MATRICES.values(), ids=MATRICES)
@pytest.mark.parametrize("cut", [(1, 1), (3, 2)])
def test_cover_is_what_shapely_cuts(matrix, cut):
    across, down = cut
    outline = Outline.of(two_islands(), Lattice((CENTRE[0] - 3.3, CENTRE[1] + 1.7), matrix))
    cover = outline.cover(across, down)
    assert cover.area / (across * down) * outline.lattice.cell_area == pytest.approx(two_islands().area, rel=1e-13)
    row, column = np.divmod(cover.rim_key, cover.columns)
    squares = shapely.box(column / across, row / down, (column + 1) / across, (row + 1) / down)
    pieces = shapely.intersection(in_cells(two_islands(), outline), squares)
    share = shapely.area(pieces) * across * down
    np.testing.assert_allclose(cover.rim[:, 0], share, atol=1e-9)
    thick = share > 1e-3
    centroids = shapely.get_coordinates(shapely.centroid(pieces)) * [across, down] - np.column_stack((column, row))
    np.testing.assert_allclose(cover.rim[thick, 1:3], centroids[thick], atol=1e-7)


def test_spans_are_whole_cells():
    outline = Outline.of(ring(), Lattice.squares((0.0, 0.0), 4.0))
    cover = outline.cover()
    assert len(cover.spans)
    for row, first, last in cover.spans.tolist():
        assert in_cells(ring(), outline).covers(shapely.box(first, row, last, row + 1).buffer(-1e-9))


def test_lattice_lines_on_the_border_leave_no_slivers():
    """A rectangle on lattice lines that are no round numbers in binary covers whole cells only."""
    box = shapely.box(0.3, 0.7, 0.3 + 0.1 * 17, 0.7 + 0.1 * 5)
    cover = Outline.of(box, Lattice.squares((0.3, 0.7), 0.1)).cover()
    assert cover.area == pytest.approx(85, rel=1e-12)
    assert set(np.unique(cover.rim[:, 0])) == {1.0}


coordinate = st.floats(-40, 40, allow_nan=False).map(lambda v: round(v, 3))
triangles = st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=12)


@settings(max_examples=60, deadline=None)
@given(triangles, st.floats(0.7, 9.0), st.floats(0, 6.3), coordinate, coordinate)
def test_any_polygon_is_covered_by_its_area(points, side, angle, x, y):
    polygon = shapely.MultiPoint(points).convex_hull
    other = shapely.Polygon(points).buffer(0)
    polygon = shapely.union_all([polygon.buffer(1.0), other]).difference(other.centroid.buffer(0.5))
    outline = Outline.of(polygon, Lattice.squares((x, y), side, (np.cos(angle), np.sin(angle))))
    cover = outline.cover()
    assert cover.area * side**2 == pytest.approx(polygon.area, rel=1e-10)
    centre = cover.rim[:, 0] @ (np.column_stack(np.divmod(cover.rim_key, cover.columns)[::-1]) + cover.rim[:, 1:3])
    for row, first, last in cover.spans.tolist():
        centre += (last - first) * np.array([0.5 * (first + last), row + 0.5])
    exact = shapely.get_coordinates(in_cells(polygon, outline).centroid)[0]
    np.testing.assert_allclose(centre / cover.area, exact, atol=1e-8)
