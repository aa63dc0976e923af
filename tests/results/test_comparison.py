"""Footprints, runout and peaks of two results against exact values."""

import math

import numpy as np
import pytest
import shapely
from affine import Affine

from mpmgis.results.comparison import (
    difference,
    footprint,
    footprint_bands,
    high_percentile,
    joint_grid,
    mask_corners,
    matched_bands,
    nearest,
    north_up_grid,
    overlap,
    peak,
)
from mpmgis.results.flow_line import centre_line, distance_to_line, line_up_to, positions_along, runout
from mpmgis.system.errors import InputError
from mpmgis.terrain.grid import Grid

GRIDS = {
    "north-up": Affine(2, 0, 0, 0, -2, 200),
    "south-up": Affine(2, 0, 0, 0, 2, 0),
    "rotated": Affine(1.8, -0.9, 60, -0.9, -1.8, 230),
}


def grid_of(cell, width=200.0, west=0.0, south=0.0):
    count = round(width / cell)
    return Grid.north_up(None, west, south + width, cell, (count, count))


def disc(grid, x, y, radius):
    easting, northing = grid.xy(*np.indices(grid.shape))
    return np.hypot(easting - x, northing - y) < radius


def lens(radius, apart):
    """Area that two discs of equal radius share."""
    return 2 * radius**2 * math.acos(apart / (2 * radius)) - apart / 2 * math.sqrt(4 * radius**2 - apart**2)


# ---------------------------------------------------------------------------------------------------------- footprints


@pytest.mark.parametrize("cell, tolerance", [(4.0, 0.02), (1.0, 0.005), (0.25, 0.001)])
def test_two_discs_overlap_as_in_geometry(cell, tolerance):
    grid, radius, apart = grid_of(cell), 50.0, 40.0
    found = overlap(disc(grid, 80, 100, radius), disc(grid, 80 + apart, 100, radius), grid.cell_area)
    both = lens(radius, apart)
    alone = math.pi * radius**2 - both
    assert found.both == pytest.approx(both, rel=tolerance)
    assert found.only_first == pytest.approx(alone, rel=2 * tolerance)
    assert found.only_second == pytest.approx(alone, rel=2 * tolerance)
    assert found.iou == pytest.approx(both / (both + 2 * alone), rel=2 * tolerance)


def test_discs_on_different_grids_overlap_as_on_one():
    """5 m cells and 2 m cells that are not aligned: nearest resampling to the finer cells."""
    coarse, fine = grid_of(5.0, west=-13.0, south=-7.5), grid_of(2.0, west=1.3, south=2.1)
    first, second = disc(coarse, 80, 100, 50), disc(fine, 120, 100, 50)
    joint = joint_grid([coarse, fine], np.concatenate([mask_corners(first, coarse), mask_corners(second, fine)]))
    assert joint.cell_size == 2.0
    offset = np.array(fine.rowcol(joint.transform.c, joint.transform.f)) + 0.5
    assert offset == pytest.approx(np.round(offset), abs=1e-9)
    found = overlap(nearest(first, coarse, joint, False), nearest(second, fine, joint, False), joint.cell_area)
    assert found.iou == pytest.approx(lens(50, 40) / (2 * math.pi * 2500 - lens(50, 40)), rel=0.02)
    assert found.both + found.only_second == pytest.approx(np.count_nonzero(second) * 4.0, rel=1e-12)
    assert found.both + found.only_first == pytest.approx(np.count_nonzero(first) * 25.0, rel=0.01)


@pytest.mark.parametrize("shift", [0, 1, 7, 60])
def test_a_square_shifted_by_whole_cells(shift):
    """IoU of w cells shifted by s: (w - s) / (w + s), 0 beyond; the shift is in the grid origins."""
    values = np.zeros((80, 80))
    values[20:60, 20:60] = 1.0
    here, there = grid_of(2.0, 160.0), grid_of(2.0, 160.0, west=2.0 * shift)
    mask = footprint(values, 0.1)
    joint = joint_grid([here, there], np.concatenate([mask_corners(mask, here), mask_corners(mask, there)]))
    found = overlap(nearest(mask, here, joint, False), nearest(mask, there, joint, False), joint.cell_area)
    assert found.iou == pytest.approx(max(40 - shift, 0) / min(40 + shift, 80), rel=1e-12)
    assert found.both + found.only_first == found.both + found.only_second == 40 * 40 * 4.0


@pytest.mark.parametrize("offset", [0.0, 0.3, 0.5, 1.0])
def test_nearest_keeps_every_value_of_a_coarser_raster(offset):
    random = np.random.default_rng(1)
    coarse = Grid.north_up(None, 10.0 + offset, 90.0, 3.0, (20, 22))
    values = random.uniform(0, 9, coarse.shape)
    values[3, 4] = np.nan
    fine = joint_grid([Grid.north_up(None, 0.0, 100.0, 1.0, (10, 10))], coarse.corners())
    onto = nearest(values, coarse, fine)
    assert np.array_equal(np.unique(onto[np.isfinite(onto)]), np.unique(values[np.isfinite(values)]))
    assert peak(onto) == peak(values)
    inside = np.isfinite(onto)
    assert onto[inside].sum() * fine.cell_area == pytest.approx(np.nansum(values) * coarse.cell_area, rel=0.05)


@pytest.mark.parametrize("transform", GRIDS.values(), ids=GRIDS)
def test_any_orientation_gives_the_same_disc(transform):
    grid = Grid(None, transform, (120, 120))
    mask = disc(grid, 100, 110, 40)
    joint = joint_grid([grid], mask_corners(mask, grid))
    moved = nearest(mask, grid, joint, outside=False)
    assert np.count_nonzero(moved) == np.count_nonzero(mask)
    flat = north_up_grid(joint)
    assert flat.is_north_up
    area = np.count_nonzero(nearest(moved, joint, flat, outside=False)) * flat.cell_area
    assert area == pytest.approx(math.pi * 1600, rel=0.02)


def test_values_outside_the_raster_are_the_given_ones():
    grid = grid_of(2.0, 20.0)
    onto = grid_of(2.0, 40.0)
    values = np.full(grid.shape, 3.0)
    assert np.isnan(nearest(values, grid, onto)).sum() == 300
    assert nearest(values, grid, onto, outside=0.0).sum() == 300.0


def test_nodata_is_not_flow():
    assert footprint(np.array([np.nan, 0.1, 0.10001, -1.0]), 0.1).tolist() == [False, False, True, False]


def test_two_empty_footprints_have_no_overlap_number():
    assert math.isnan(overlap(np.zeros((2, 2), bool), np.zeros((2, 2), bool), 1.0).iou)
    assert mask_corners(np.zeros((2, 2), bool), grid_of(1.0)).shape == (0, 2)


def test_rasters_too_far_apart_are_rejected():
    with pytest.raises(InputError, match=r"expected at most 1e\+08 cells"):
        joint_grid([grid_of(1.0)], [[0, 0], [1e6, 1e6]])


# --------------------------------------------------------------------------------------------------------------- bands


def test_identical_names_have_priority_over_equivalent_ones():
    ours, theirs = ("h_max", "Ut_max", "pft", "Un_max"), ("pft", "pfv")
    assert matched_bands(ours, theirs) == [("h_max", None), ("Ut_max", "pfv"), ("pft", "pft"), ("Un_max", None)]
    assert matched_bands(("h_max", "Ut_max"), theirs) == [("h_max", "pft"), ("Ut_max", "pfv")]
    assert matched_bands(("pft",), ("h_max", "p_max")) == [("pft", "h_max"), (None, "p_max")]


def test_the_default_footprint_is_of_peak_thickness():
    pairs = matched_bands(("Ut_max", "h_max", "h_deposit"), ("Ut_max", "h_max", "h_deposit"))
    assert footprint_bands(pairs) == ("h_max", "h_max")
    assert footprint_bands(pairs, "h_deposit") == ("h_deposit", "h_deposit")
    moving = matched_bands(("h_max", "h_deposit"), ("h_max", "h_last", "t_last"))
    assert moving == [("h_max", "h_max"), ("h_deposit", "h_last"), (None, "t_last")]
    assert footprint_bands(moving, "h_deposit") == footprint_bands(moving, "h_last") == ("h_deposit", "h_last")
    assert footprint_bands(matched_bands(("h_max", "Ut_max"), ("pft", "pfv")), "pfv") == ("Ut_max", "pfv")
    assert footprint_bands(matched_bands(("h_max", "Ut_max"), ()), complete=False) == ("h_max", None)
    assert footprint_bands(matched_bands((), ("h_max",)), complete=False) == (None, "h_max")


def test_a_single_band_of_unknown_name_is_compared_with_peak_thickness():
    assert footprint_bands(matched_bands(("h_max", "Ut_max"), ("value",))) == ("h_max", "value")
    assert footprint_bands(matched_bands(("value",), ("depth",))) == ("value", "depth")


@pytest.mark.parametrize(
    "first, second, asked, words",
    [
        (("h_max", "Ut_max"), ("h_max",), "Ut_max", "'Ut_max' is not in both results; use --band with one of h_max"),
        (("Ut_max", "p_max"), ("h_max", "t_max"), None, "the first has Ut_max, p_max; the second has h_max, t_max"),
        (("h_max",), ("h_max",), "nonsense", "use --band with one of h_max"),
    ],
)
def test_bands_that_do_not_match_are_named(first, second, asked, words):
    with pytest.raises(InputError, match=words):
        footprint_bands(matched_bands(first, second), asked)


def test_peaks_and_differences():
    values = np.array([[np.nan, -3.0, 0.0], [1.0, 2.0, 50.0]])
    assert peak(values) == 50.0 and peak(values, "Un_min") == -3.0
    assert math.isnan(peak(np.full((2, 2), np.nan)))
    assert high_percentile(np.r_[np.zeros(900), np.arange(1.0, 101.0)]) == pytest.approx(99.01)
    assert high_percentile(-np.r_[np.zeros(900), np.arange(1.0, 101.0)], "Un_min") == pytest.approx(-99.01)
    assert math.isnan(high_percentile(np.zeros(3)))
    gap = difference(values, np.zeros((2, 3)), values > 0)
    assert gap.mean == pytest.approx(53 / 3) and gap.rms == pytest.approx(math.sqrt(2505 / 3))
    assert math.isnan(difference(values, values, np.zeros((2, 3), bool)).mean)


# -------------------------------------------------------------------------------------------------------------- runout

BENT = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, -200.0], [160.0, -280.0]])  # 100 + 200 + 100 m


def test_positions_on_and_beyond_a_bent_line():
    x = np.array([0.0, 50.0, 100.0, 100.0, 130.0, 160.0, 166.0, -30.0, 50.0])
    y = np.array([0.0, 7.0, -50.0, -200.0, -240.0, -280.0, -288.0, 4.0, -9.0])
    assert positions_along(BENT, x, y) == pytest.approx([0, 50, 150, 300, 350, 400, 410, -30, 50])


def test_the_extension_of_a_bent_line_is_not_a_short_cut():
    """The straight extension of a line that turns back passes its upper part, which must be ignored there."""
    hook = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, -30.0], [60.0, -30.0], [60.0, -10.0]])
    assert positions_along(hook, [60.0], [0.0]) == pytest.approx([60.0])
    assert positions_along(hook, [60.0], [-8.0]) == pytest.approx([192.0])


@pytest.mark.parametrize("cell", [5.0, 1.0])
def test_runout_of_a_flow_along_a_bent_line(cell):
    """A corridor of 20 m around the line, cut at 250 m from its start: runout to the last centre of a cell."""
    grid = Grid.north_up(None, -50.0, 50.0, cell, (round(350 / cell), round(300 / cell)))
    x, y = grid.xy(*np.indices(grid.shape))
    flow = (np.abs(y) <= 10) & (x >= 0) & (x <= 110) | (np.abs(x - 100) <= 10) & (y <= 10) & (y >= -150)
    found = runout(flow, grid, BENT)
    assert 250 - cell <= found.distance <= 250
    assert found.y == pytest.approx(-150, abs=cell) and abs(found.x - 100) <= 10
    assert runout(np.zeros_like(flow), grid, BENT) is None


def test_distance_from_a_line():
    grid = grid_of(2.0)
    mask = disc(grid, 100, 100, 20)
    assert distance_to_line([[0, 180], [200, 180]], mask, grid) == pytest.approx(60, abs=2)
    assert distance_to_line([[0, 100], [200, 100]], mask, grid) <= 1.0
    assert distance_to_line([[0, 0], [1, 1]], np.zeros(grid.shape, bool), grid) == math.inf


@pytest.mark.parametrize("distance, end", [(40, (40, 0)), (100, (100, 0)), (130, (100, -30)), (410, (166, -288))])
def test_a_line_up_to_a_distance(distance, end):
    short = line_up_to(BENT, distance)
    assert short[-1] == pytest.approx(end)
    assert shapely.LineString(short).length == pytest.approx(distance)


def bent_valley(cell=5.0):
    """(mask, elevation, grid): a flow 40 m wide down a quarter circle of radius 300 m, then 300 m straight on."""
    grid = Grid.north_up(None, -60.0, 380.0, cell, (round(760 / cell), round(420 / cell)))
    x, y = grid.xy(*np.indices(grid.shape))
    radius, angle = np.hypot(x, y), np.arctan2(x, y)  # from the north (0, 300) to the east (300, 0)
    bend = (np.abs(radius - 300) <= 20) & (angle >= 0) & (angle <= np.pi / 2)
    straight = (np.abs(x - 300) <= 20) & (y < 0) & (y >= -300)
    along = np.where(y >= 0, 300 * angle, 300 * np.pi / 2 - y)
    return bend | straight, 1000 - 0.4 * along, grid


@pytest.mark.parametrize("cell", [5.0, 2.0])
def test_the_centre_line_of_a_bent_flow_is_as_long_as_its_valley(cell):
    mask, elevation, grid = bent_valley(cell)
    line = centre_line([mask], [mask.astype(float)], elevation, grid)
    assert np.hypot(*(line[0] - (0, 300))) < 25  # begins at the top, in the middle
    assert runout(mask, grid, line).distance == pytest.approx(300 * np.pi / 2 + 300, rel=0.03)
    bend = line[(line[:, 1] > 10) & (line[:, 0] > 10)]
    assert np.hypot(*bend.T) == pytest.approx(300, abs=12)


def test_the_centre_line_does_not_depend_on_the_order_nor_on_units():
    mask, elevation, grid = bent_valley()
    short = mask & (elevation > 800)
    thickness = 1.0 + (elevation - elevation.min()) / 100
    first = centre_line([mask, short], [thickness, 1e4 * thickness], elevation, grid)
    second = centre_line([short, mask], [thickness, thickness], elevation, grid)
    assert first == pytest.approx(second, abs=1e-6)


def test_the_centre_line_continues_over_gaps_between_frames():
    grid = Grid(None, Affine(2, 0, 0, 0, -2, 60), (30, 200))
    x, y = grid.xy(*np.indices(grid.shape))
    across = np.abs(y - 30) < 11
    mask = across & (((x > 10) & (x < 50)) | ((x > 120) & (x < 240)) | ((x > 300) & (x < 380)))
    line = centre_line([mask], [mask.astype(float)], 1000 - x, grid)
    assert line[0] == pytest.approx([11, 30], abs=2) and line[-1, 0] > 360
    assert runout(mask, grid, line).distance == pytest.approx(379 - 11, abs=4)


def test_the_centre_line_of_many_cells_uses_coarser_cells():
    """250 000 cells are aggregated to blocks of 3 x 3; the line stays in the middle."""
    grid = Grid.north_up(None, 0.0, 500.0, 1.0, (500, 500))
    x, _ = grid.xy(*np.indices(grid.shape))
    mask = np.ones(grid.shape, bool)
    line = centre_line([mask], [np.ones(grid.shape)], 1000 - x, grid)
    assert line[:, 1] == pytest.approx(250, abs=8)
    assert line[0, 0] < 10 and line[-1, 0] > 450


def test_islands_and_missing_heights():
    mask, elevation, grid = bent_valley()
    island = mask.copy()
    island[0, 0] = True
    heights = np.where(mask, elevation, np.nan)
    heights[0, 0] = 5000.0  # the highest place of all, apart from the flow
    assert centre_line([island], [island.astype(float)], heights, grid) == pytest.approx(
        centre_line([mask], [mask.astype(float)], heights, grid)
    )
    assert centre_line([mask], [mask.astype(float)], np.full(grid.shape, np.nan), grid) is None
    one = np.zeros_like(mask)
    one[5, 5] = True
    assert centre_line([one], [one.astype(float)], elevation, grid) is None
    assert centre_line([np.zeros_like(mask)], [elevation], elevation, grid) is None
