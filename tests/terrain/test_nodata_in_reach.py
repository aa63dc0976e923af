"""Cells without elevation: what is a hole, what the collar, what a flow can reach of them, and how holes are filled."""

import numpy as np
import pytest
from affine import Affine
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.flow_reach import reach_of
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.nodata_fill import filled
from mpmgis.terrain.nodata_groups import nodata_groups, nodata_in_reach


def plane(shape=(40, 60), pixel=5.0, slope=0.4, level=1500.0):
    grid = Grid(None, Affine(pixel, 0, 1000.0, 0, -pixel, 2000.0), shape)
    x, _ = grid.xy(*np.mgrid[0 : shape[0], 0 : shape[1]])
    return Terrain(grid, level - slope * (x - 1000.0))


def without(terrain, *windows):
    for window in windows:
        terrain.elevation[window] = np.nan
    return terrain


def test_a_group_that_touches_the_edge_by_a_corner_is_no_hole():
    nodata = np.zeros((6, 8), bool)
    nodata[0, 0] = nodata[1, 1] = nodata[2, 2] = True
    nodata[3:5, 5] = True
    labels, at_edge = nodata_groups(nodata)
    assert labels.max() == 2 and at_edge == {labels[0, 0]}
    assert np.argwhere(holes_of(nodata)).tolist() == [[3, 5], [4, 5]]


def holes_of(nodata):
    labels, at_edge = nodata_groups(nodata)
    return nodata & ~np.isin(labels, list(at_edge))


@settings(max_examples=60, deadline=None)
@given(
    nodata=hnp.arrays(bool, (14, 17), elements=st.booleans(), fill=st.just(False)),
    level=st.floats(-400.0, 8000.0),
    slope=st.floats(-1.0, 1.0),
    pixel=st.floats(0.25, 90.0),
)
def test_only_holes_are_filled_and_on_a_plane_exactly(nodata, level, slope, pixel):
    terrain = plane((14, 17), pixel, slope, level)
    before = without(terrain, nodata).elevation.copy()
    if not np.isfinite(before).any():
        return
    after, fill = filled(terrain)
    holes = holes_of(nodata)
    assert np.array_equal(np.isfinite(after.elevation), ~nodata | holes)
    assert after.elevation[~nodata].tobytes() == before[~nodata].tobytes()
    assert (fill.cells, fill.left) == (holes.sum(), nodata.sum() - holes.sum())
    if fill.cells:
        known = before[np.isfinite(before)]
        assert known.min() - 1e-6 <= after.elevation[holes].min()
        assert after.elevation[holes].max() <= known.max() + 1e-6
        exact = plane((14, 17), pixel, slope, level).elevation
        assert np.abs(after.elevation - exact)[holes].max() <= 1e-6 * (1.0 + known.max() - known.min())
        assert pixel * 0.999 <= fill.distance <= pixel * np.hypot(14, 17)


def test_a_small_hole_in_a_plane_becomes_that_plane():
    whole, holed = plane(), without(plane(), np.s_[18:21, 30:33], np.s_[5, 5], np.s_[:, :2])
    after, fill = filled(holed)
    inside = np.isfinite(after.elevation)
    assert np.abs(after.elevation - whole.elevation)[inside].max() < 1e-6
    assert (fill.holes, fill.cells, fill.left) == (2, 10, 80) and fill.distance == pytest.approx(10.0)
    assert (fill.east, fill.north) == holed.grid.xy(19, 31)
    assert len(fill.lines(5.0)) == 1 and "2 holes" in fill.lines(5.0)[0] and "80 nodata cells" in fill.lines(5.0)[0]
    assert "uncertain" in fill.lines(0.5)[1]
    assert filled(plane())[1].lines(5.0) == ["[terrain] fill_nodata: the DTM has no hole"]


def test_a_hole_on_curved_ground_is_filled_between_the_heights_around_it():
    terrain = plane((60, 60), 1.0, 0.5, 100.0)
    row, column = np.mgrid[0:60, 0:60]
    terrain.elevation[:] += 4.0 * np.sin(row / 6.0) * np.cos(column / 7.0)
    exact = terrain.elevation.copy()
    hole = (row - 30) ** 2 + (column - 28) ** 2 <= 16
    after, _ = filled(without(terrain, hole))
    assert np.abs(after.elevation - exact)[hole].max() < 2.0  # half the amplitude of what is hidden
    around = after.elevation[25:36, 23:34]
    assert np.abs(np.diff(around, axis=0)).max() < 2.0 and np.abs(np.diff(around, axis=1)).max() < 2.5


def reach_on(terrain, mu=0.1):
    x, y = terrain.grid.xy(20, 5)
    xy = np.array([[x, y], [x + 5.0, y], [x, y + 5.0]])
    return reach_of(terrain, xy, terrain.sample(*xy.T), mu)


@pytest.mark.parametrize("share", [0.5, 1.0, 2.0, 3.0])
def test_what_a_flow_can_reach_of_nodata(share):
    """Holes below the release are in reach, whatever the solver's cells; those above it and out of reach are not."""
    below, uphill = np.s_[19:22, 30:33], np.s_[20, 1]
    found = nodata_in_reach(without(plane(), below, uphill), reach_on(plane()), 5.0 * share)
    assert [hole.cells for hole in found.holes if hole.east > 1050.0] == [9] and found.collar is None
    assert (found.holes[0].east, found.holes[0].north) == plane().grid.xy(20, 31)
    assert "around E 1157.5 N 1897.5" in found.lines()[0] and "fill_nodata" in found.lines()[0]
    collar = nodata_in_reach(without(plane(), np.s_[:, 55:]), reach_on(without(plane(), np.s_[:, 55:])), 5.0 * share)
    assert collar.holes == () and 0 < collar.collar.cells <= 200 and "larger DTM" in collar.lines()[0]
    if share > 2.0:  # a solver's cell reaches from the release to the hole
        return
    nothing = nodata_in_reach(without(plane(), uphill), reach_on(plane()), 5.0 * share)
    assert nothing.holes == () and nothing.lines() == [] and nothing.as_numbers() == {"holes": [], "collar": None}
