"""Columns of a run on cells of any size: volume, peak, coverage and smoothness against the solver's own field."""

from functools import cache

import numpy as np
import pytest
from exporting import AFFINES, CRS, NORTH, WEST, surface, terrain
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from mpmgis.frames.particles import Frame, Particles
from mpmgis.maps.averaging.band_products import cell_values
from mpmgis.maps.averaging.cell_averages import bin_frame, column_reach
from mpmgis.maps.averaging.export_resolution import export_axes, export_grid
from mpmgis.maps.averaging.frame_values import reached
from mpmgis.maps.averaging.maxima import THINNEST
from mpmgis.maps.averaging.placement import Bed, place
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid

DENSITY = 1000.0
SPACING = 5.0


def sheared_flow(per_cell=4, seed=0):
    """Columns of a stretched and sheared flow: a lattice `per_cell` x `per_cell`, moved by a smooth map."""
    side = SPACING / per_cell
    u, v = (values.ravel() for values in np.meshgrid(*(np.arange(0.0, 60.0, side) + 0.5 * side,) * 2))
    depth = 2.0 + np.sin(u / 9.0) + np.cos(v / 7.0)
    x = WEST + 30.0 + 1.6 * u + 4.0 * np.sin(v / 11.0)
    y = NORTH - 50.0 - 0.7 * v - 6.0 * np.sin(u / 13.0)
    random = np.random.default_rng(seed)
    volume = depth * side**2 * random.uniform(0.9, 1.1, len(x))
    origin = np.array([WEST, NORTH - 200.0, 500.0])
    position = np.stack([x, y, surface(x, y)], axis=1) - origin
    velocity = np.stack([10.0 + 0 * x, 2.0 * np.cos(v / 9.0), -5.0 + 0 * x], axis=1)
    area = np.full(len(x), side**2)
    particles = Particles(position, velocity, DENSITY * volume, volume, thickness=volume / area, area=area)
    return Frame(particles, dimension=2, crs=CRS, origin=tuple(origin), header={"cell_size": SPACING})


def bands_of(frame, ground, grid, names=("h", "t", "t_vol", "mass", "Ut", "n")):
    """(Cells, product -> float64[rows, columns], 0 where the frame has nothing)."""
    bed = Bed.of(ground)
    cells = bin_frame(frame, place(frame, bed), bed, grid, DENSITY)
    bands = {}
    for name, values in cell_values(cells, names, 0.0).items():
        bands[name] = np.zeros(grid.shape)
        bands[name].ravel()[cells.index] = values
    return cells, bands


def node_depths(frame, ground, upright):
    """Depth [m] on the solver's nodes by definition: sum of w V n_H over the node's square, one column at a time."""
    x, y = frame.map_xy()
    west, north = ground.grid.bounds[0], ground.grid.bounds[3]
    depth = np.zeros((60, 60))
    for across, down, volume, n_h in zip(
        (x - west) / SPACING, (north - y) / SPACING, frame.particles.volume, upright, strict=True
    ):
        for i in range(int(down) - 1, int(down) + 3):
            for j in range(int(across) - 1, int(across) + 3):
                depth[i + 5, j + 5] += _spline(down - i) * _spline(across - j) * volume * n_h / SPACING**2
    return depth


def _spline(distance):
    distance = abs(distance)
    if distance < 0.5:
        return 0.75 - distance**2
    return 0.5 * (1.5 - distance) ** 2 if distance < 1.5 else 0.0


def uprights(frame, ground):
    """float64[n]: vertical part of the bed's normal under each column."""
    bed = Bed.of(ground)
    slope = bed.gradient_by_pixel[place(frame, bed).pixel]
    return 1.0 / np.sqrt(1.0 + (slope**2).sum(axis=1))


@cache
def reference():
    """(frame, terrain, largest depth on the nodes [m], volume times n_H [m3])."""
    frame, ground = sheared_flow(), terrain()
    upright = uprights(frame, ground)
    return frame, ground, node_depths(frame, ground, upright).max(), float((frame.particles.volume * upright).sum())


@settings(max_examples=25, deadline=None)
@given(
    cell_size=st.one_of(st.floats(0.125, 12.0), st.sampled_from([0.125, 0.5, 1.0, 1.25, 2.0, 2.5, 5.0, 10.0])),
    window=st.booleans(),
)
def test_peak_and_volume_do_not_depend_on_the_cell(cell_size, window):
    """From a tenth of the column spacing to more than twice the solver's cell, on the whole DTM or on a part of it."""
    frame, ground, peak, volume = reference()
    bounds = None
    if window or cell_size < 0.5:
        bounds = reached(frame, Bed.of(ground), export_axes(ground.grid))
    grid = export_grid(ground.grid, cell_size, bounds)
    cells, bands = bands_of(frame, ground, grid)
    assert cells.outside == 0
    assert bands["h"].max() == pytest.approx(peak, rel=1e-9)
    assert (bands["t_vol"] * grid.cell_area).sum() == pytest.approx(volume, rel=1e-9)
    assert (bands["mass"] * grid.cell_area).sum() == pytest.approx(frame.particles.mass.sum(), rel=1e-12)
    assert bands["n"].sum() == len(frame.particles)
    assert (bands["h"] >= bands["t_vol"] * (1 - 1e-12)).all() and np.array_equal(bands["h"], bands["t"])


@pytest.mark.parametrize("cell_size", [0.25, 1.0, 2.5, 5.0])
def test_flow_has_no_holes_and_is_smooth(cell_size):
    frame, ground, peak, _ = reference()
    grid = export_grid(ground.grid, cell_size)
    _, bands = bands_of(frame, ground, grid)
    wet = bands["h"] > 0
    assert np.array_equal(ndimage.binary_fill_holes(wet), wet)
    if cell_size < SPACING:  # depth changes by at most the field's own gradient from cell to cell
        steepest = 1.5 * peak / SPACING * cell_size
        assert np.abs(np.diff(bands["t_vol"], axis=0)).max() < steepest
        assert np.abs(np.diff(bands["t_vol"], axis=1)).max() < steepest


def test_cells_are_the_integral_of_the_field_between_nodes():
    """Against a fine quadrature of the bilinear field of `node_depths`, for any offset of the cells."""
    frame, ground, _, _ = reference()
    depth = node_depths(frame, ground, uprights(frame, ground))
    grid = export_grid(ground.grid, 3.3)
    _, bands = bands_of(frame, ground, grid)
    samples = 40
    offsets = (np.arange(samples) + 0.5) / samples
    for row, column in ((20, 14), (25, 20), (30, 30), (18, 25)):
        down = (row + offsets) * 3.3 / SPACING + 5
        across = (column + offsets) * 3.3 / SPACING + 5
        found = ndimage.map_coordinates(depth, np.meshgrid(down, across, indexing="ij"), order=1).mean()
        assert bands["t_vol"][row, column] == pytest.approx(found, rel=2e-3)


@pytest.mark.parametrize("affine", sorted(AFFINES))
@pytest.mark.parametrize("holes", [False, True])
def test_volume_stays_on_the_ground(affine, holes):
    """Next to nodata and at the DTM's edge every column gives all of its volume to cells with ground."""
    transform = AFFINES[affine]
    ground = terrain(transform, holes=[(i, j) for i in range(14, 18) for j in range(10, 15)] if holes else ())
    random = np.random.default_rng(5)
    x, y = ground.grid.xy(random.uniform(-0.5, 39.5, 900), random.uniform(-0.5, 35.5, 900))
    volume = random.uniform(1.0, 3.0, 900)
    position = np.stack([x, y, surface(x, y)], axis=1)
    particles = Particles(
        position, np.zeros((900, 3)), DENSITY * volume, volume, thickness=np.ones(900), area=volume.copy()
    )
    frame = Frame(particles, dimension=2, crs=CRS, header={"cell_size": SPACING})
    for cell_size in (None, 0.9, 2.0, 7.0, 300.0):
        grid = export_grid(ground.grid, cell_size)
        cells, bands = bands_of(frame, ground, grid)
        banded = (bands["mass"] * grid.cell_area).sum()
        assert banded + cells.mass_outside == pytest.approx(particles.mass.sum(), rel=1e-12)
    if holes and affine == "north-up":
        _, bands = bands_of(frame, ground, export_grid(ground.grid))
        hole = np.isnan(ground.elevation)
        assert not bands["mass"][hole].any() and bands["mass"][~hole].min() > 0


def test_a_uniform_sheet_up_to_the_edge_of_the_terrain():
    """Uniform inside, exact in volume; the edge is blurred within the width of a spline, as in the solver."""
    grid = Grid.north_up(CRS, WEST, NORTH, 5.0, (20, 20))
    ground = Terrain(grid, np.zeros((20, 20)))
    x, y = (values.ravel() for values in np.meshgrid(WEST + np.arange(0.5, 100), NORTH - np.arange(0.5, 100)))
    n = len(x)
    particles = Particles(
        np.stack([x, y, 0 * x], axis=1),
        np.zeros((n, 3)),
        np.full(n, 2000.0),
        np.full(n, 2.0),
        thickness=np.full(n, 2.0),
        area=np.ones(n),
    )
    frame = Frame(particles, dimension=2, crs=CRS, header={"cell_size": 5.0})
    for cell_size in (0.5, 2.0, 5.0, 10.0):
        _, bands = bands_of(frame, ground, export_grid(grid, cell_size))
        np.testing.assert_allclose(bands["t_vol"].mean(), 2.0, rtol=1e-12)
        edge = int(np.ceil(20.0 / cell_size))
        inner = slice(edge, -edge)
        np.testing.assert_allclose(bands["t_vol"][inner, inner], 2.0, rtol=1e-12)
        assert bands["h"].min() > 1.7 and bands["h"].max() < 2.3


def test_columns_of_a_seed_keep_their_squares():
    frame, ground, _, volume = reference()
    seed = Frame(**{**vars(frame), "header": {}})
    _, bands = bands_of(seed, ground, export_grid(ground.grid, 1.0))
    assert (bands["t_vol"]).sum() == pytest.approx(volume, rel=1e-9)
    assert column_reach(seed)[0] == pytest.approx(0.5 * SPACING / 4)


def test_tails_of_splines_are_not_maxima():
    """The last centimetres beyond a front are not flow: maxima ignore them, as in the solver."""
    from mpmgis.maps.averaging.frame_values import Averaging, average_frame
    from mpmgis.maps.averaging.maxima import PRODUCTS_NEEDED, RunningMaxima

    frame, ground, _, _ = reference()
    grid = export_grid(ground.grid, 1.0)
    for min_depth, least in ((0.05, 0.05), (0.0, THINNEST), (0.01, 0.01), (0.5, 0.05)):
        averaging = Averaging(Bed.of(ground), grid, DENSITY, PRODUCTS_NEEDED, min_depth=min_depth)
        values = average_frame(frame, averaging)
        maxima = RunningMaxima(grid.shape[0] * grid.shape[1], min_depth)
        maxima.absorb(values.index, values.values, values.time, values.least)
        depth = maxima.rows("h_max", 0, *grid.shape)
        assert values.least == least and values.values["h"].min() < least
        assert np.nanmin(depth) >= np.float32(least)
