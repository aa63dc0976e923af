"""Cell sums of any particles: conservation, coverage, percentiles, unusual sizes."""

import numpy as np
import pytest
from exporting import AFFINES, CRS, naive_ground, random_frame, terrain
from hypothesis import given, settings
from hypothesis import strategies as st

from mpmgis.frames.particles import Frame, Particles
from mpmgis.maps.averaging import binning
from mpmgis.maps.averaging.band_products import PRODUCTS, cell_values
from mpmgis.maps.averaging.cell_averages import bin_frame
from mpmgis.maps.averaging.export_resolution import export_grid
from mpmgis.maps.averaging.placement import Bed, place
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid

ALL = tuple(PRODUCTS)


def flat(shape=(10, 12), slope=(0.0, 0.0), cell=5.0):
    grid = Grid.north_up(CRS, 600000.0, 5170000.0, cell, shape)
    row, column = np.mgrid[: shape[0], : shape[1]]
    x, y = grid.xy(row, column)
    return Terrain(grid, 100.0 + slope[0] * (x - 600000) + slope[1] * (y - 5170000))


def points(ground, x, y, distance, mass=1.0, velocity=(0.0, 0.0, 0.0)):
    """Points at the vertical height `distance` above the bed, at x, y [m] from the raster's upper left corner."""
    x, y, distance = (np.asarray(v, float) for v in np.broadcast_arrays(x, y, distance))
    east, north = x + 600000.0, 5170000.0 - y
    height = ground.sample(east, north) + distance
    n, origin = len(x), np.array([600000.0, 5169900.0, 0.0])
    particles = Particles(
        np.stack([east, north, height], axis=1) - origin,
        np.broadcast_to(np.asarray(velocity, float), (n, 3)).copy(),
        np.broadcast_to(np.asarray(mass, float), n).copy(),
        np.broadcast_to(np.asarray(mass, float) / 1000, n).copy(),
    )
    return Frame(particles, dimension=3, crs=CRS, origin=tuple(origin), header={"cell_size": 0.5})


def cells_of(ground, frame, grid=None, kind="bilinear", percentile=100.0, standoff=0.0):
    bed = Bed.of(ground, kind, standoff)
    return bin_frame(frame, place(frame, bed), bed, grid or export_grid(ground.grid), 1000.0, percentile)


def values_of(*args, min_depth=0.0, **kwargs):
    return cell_values(cells_of(*args, **kwargs), ALL, min_depth)


@settings(max_examples=40, deadline=None)
@given(
    affine=st.sampled_from(sorted(AFFINES)),
    dimension=st.sampled_from([2, 3]),
    cell_size=st.one_of(st.none(), st.floats(0.5, 400)),
    seed=st.integers(0, 1000),
)
def test_mass_is_conserved(affine, dimension, cell_size, seed):
    """Cells and mass outside sum to the mass of the particles."""
    ground = terrain(AFFINES[affine], holes=[(5, 5), (20, 20)])
    frame = random_frame(ground, 200, dimension, seed)
    grid = export_grid(ground.grid, cell_size)
    cells = cells_of(ground, frame, grid)
    total = frame.particles.mass.sum()
    banded = cell_values(cells, ("mass",), 0.0)["mass"].sum() * grid.cell_area
    assert banded + cells.mass_outside == pytest.approx(total, rel=1e-12)
    assert cells.count.sum() + cells.outside == len(frame.particles)
    outside = [p for p in range(200) if naive_ground(ground, frame, p, "plane") is None]
    if affine in ("north-up", "oblong"):  # elsewhere a particle on the rim of one grid may be just off the other
        assert cells.outside == len(outside)


def test_volume_thickness_sums_to_the_volume():
    """t_vol over n_H, times the cells' area, is the mass over density, exactly (R_tvol = 1)."""
    ground = flat(slope=(0.6, -0.3))
    frame = points(ground, *np.random.default_rng(0).uniform(0, 50, (2, 500)), 1.0, mass=7.0)
    cells = cells_of(ground, frame)
    t_vol = cell_values(cells, ("t_vol",), 0.0)["t_vol"]
    upright = 1 / np.sqrt(1 + 0.6**2 + 0.3**2)
    assert (t_vol / upright).sum() * 25.0 == pytest.approx(500 * 7.0 / 1000.0, rel=1e-12)


@pytest.mark.parametrize("affine", AFFINES)
@pytest.mark.parametrize("kind", ["plane", "bilinear"])
def test_depth_on_a_plane_is_exact_at_any_affine(affine, kind):
    grid = Grid(CRS, AFFINES[affine], (20, 25))
    row, column = np.mgrid[:20, :25]
    x, y = grid.xy(row, column)
    ground = Terrain(grid, 700 - 0.5 * (x - 600000) + 0.25 * (y - 5170000))
    random = np.random.default_rng(1)
    x, y = grid.xy(random.uniform(-0.5, 19.5, 300), random.uniform(-0.5, 24.5, 300))
    bed = 700 - 0.5 * (x - 600000) + 0.25 * (y - 5170000)
    upright = 1 / np.sqrt(1 + 0.5**2 + 0.25**2)
    position = np.stack([x, y, bed + 2.0], axis=1)
    frame = Frame(Particles(position, np.zeros((300, 3)), np.ones(300), np.ones(300)), dimension=3, crs=CRS)
    placed = place(frame, Bed.of(ground, kind))
    assert placed.distance[placed.inside] == pytest.approx(2.0 * upright, rel=1e-9)
    assert placed.inside.mean() > 0.99


def tiling(ground, side, rows, columns, west=0.0, north=0.0, thickness=2.0):
    """A lattice of columns without gaps, its upper left corner `west`, `north` [m] from the raster's."""
    i, j = (index.ravel() for index in np.mgrid[:rows, :columns])
    x, y = 600000.0 + west + (j + 0.5) * side, 5170000.0 - north - (i + 0.5) * side
    n = len(x)
    position = np.stack([x, y, ground.sample(x, y)], axis=1)
    area, tall = np.full(n, side**2), np.full(n, thickness)
    velocity = np.tile([3.0, 0.0, 0.0], (n, 1))
    particles = Particles(position, velocity, 1000.0 * area * tall, area * tall, thickness=tall, area=area)
    return Frame(particles, dimension=2, crs=CRS)


@pytest.mark.parametrize("side", [0.3, 1.25, 2.0, 5.0, 7.7, 20.0])
@pytest.mark.parametrize("shift", [0.0, 1.7])
def test_columns_fill_their_cells_without_holes(side, shift):
    """A lattice without gaps covers every cell inside it evenly, for any sizes."""
    ground = flat((30, 30))
    count = int(np.ceil(60 / side))
    frame = tiling(ground, side, count, count, 20 + shift, 15 + shift)
    cells = cells_of(ground, frame)
    values = cell_values(cells, ALL, 0.0)
    assert values["h"] == pytest.approx(2.0, rel=1e-9)
    assert np.array_equal(values["h"], values["t"])
    row, column = np.divmod(cells.index, 30)
    inside = (row >= 5) & (row < 14) & (column >= 6) & (column < 15)
    assert np.count_nonzero(inside) == 81, "a hole in the sheet"
    assert values["t_vol"][inside] == pytest.approx(2.0, rel=1e-9)
    assert values["mass"][inside] == pytest.approx(2000.0, rel=1e-9)
    assert values["Ut"] == pytest.approx(3.0, rel=1e-12)


def test_lattice_aligned_with_the_cells_has_no_slivers():
    """Rounding at shared borders must not wet the neighbours."""
    ground = flat((30, 30), cell=0.1)
    frame = tiling(ground, 0.1 / 4, 24, 24, 0.3, 0.7)
    cells = cells_of(ground, frame)
    assert len(cells.index) == 36


def test_column_thickness_is_normal_to_the_bed_also_at_its_edge():
    ground = flat((20, 20), slope=(0.75, 0.0))
    frame = tiling(ground, 3.0, 1, 1, 21.0, 21.0, thickness=1.0)
    values = values_of(ground, frame)
    assert values["h"] == pytest.approx(0.8)  # cos of the slope
    assert values["t_vol"].sum() == pytest.approx(0.8 * 9 / 25)
    assert values["n"].sum() == 1


def test_columns_at_the_edge_of_the_raster_keep_their_mass():
    ground = flat((4, 4))
    frame = tiling(ground, 8.0, 3, 3, -2.0, -2.0)
    cells = cells_of(ground, frame)
    assert cells.outside == 0
    assert cell_values(cells, ("mass",), 0)["mass"].sum() * 25 == pytest.approx(frame.particles.mass.sum(), rel=1e-12)


def test_percentile_is_a_rank_and_never_between_two_particles():
    ground = flat()
    heights = np.array([5.0, 1.0, 4.0, 2.0, 3.0])
    frame = points(ground, np.full(5, 12.0), np.full(5, 12.0), heights)
    for percentile, expected in ((100, 5), (81, 5), (80, 4), (79, 4), (60, 3), (20, 1), (19, 1), (0.01, 1)):
        values = values_of(ground, frame, percentile=percentile)
        assert values["h"].item() == pytest.approx(expected)
        assert values["t"].item() == pytest.approx(expected - 1)  # only the top is trimmed


def test_percentile_is_weighted_by_mass():
    ground = flat()
    frame = points(ground, np.full(3, 12.0), np.full(3, 12.0), [1.0, 2.0, 3.0], mass=[1.0, 1.0, 8.0])
    assert values_of(ground, frame, percentile=20)["h"].item() == pytest.approx(2.0)
    assert values_of(ground, frame, percentile=21)["h"].item() == pytest.approx(3.0)


def test_one_particle_has_depth_and_no_thickness():
    ground = flat()
    for percentile in (1, 50, 100):
        values = values_of(ground, points(ground, [12.0], [12.0], [0.7]), percentile=percentile)
        assert values["h"].item() == pytest.approx(0.7)
        assert values["t"].item() == 0.0


def test_all_particles_in_one_cell():
    ground = flat()
    random = np.random.default_rng(0)
    frame = points(ground, random.uniform(10, 15, 5000), random.uniform(10, 15, 5000), random.uniform(0, 3, 5000))
    cells = cells_of(ground, frame)
    assert len(cells.index) == 1 and cells.count.item() == 5000


def test_velocity_is_weighted_by_mass_and_split_along_the_slope():
    ground = flat(slope=(0.75, 0.0))  # rises eastwards; normal (-0.6, 0, 0.8)
    frame = points(ground, [12.0, 12.5], [12.0, 12.0], [1.0, 1.0], mass=[3.0, 1.0])
    frame.particles.velocity[:] = [[8.0, 3.0, 6.0], [-6.0, 0.0, 8.0]]  # along the slope and north; leaving it at 10
    values = values_of(ground, frame)
    assert values["Un"].item() == pytest.approx(10.0 / 4)
    assert values["Ut"].item() == pytest.approx(np.hypot(10.0, 3.0) * 3 / 4)
    assert values["Ut_E"].item() == pytest.approx(8.0 * 3 / 4)
    assert values["Ut_N"].item() == pytest.approx(3.0 * 3 / 4)
    mean = np.average([[8, 3, 6], [-6, 0, 8]], axis=0, weights=[3, 1])
    assert values["p"].item() == pytest.approx(1000 * mean @ mean)


def test_depth_is_never_negative():
    ground = flat()
    values = values_of(ground, points(ground, [12.0, 12.0], [12.0, 12.0], [-1.5, -0.5]))
    assert values["h"].item() == 0.0
    assert values["t"].item() == pytest.approx(1.0)


def test_standoff_moves_the_surface():
    ground = flat(slope=(0.75, 0.0))
    frame = points(ground, [12.0, 12.0], [12.0, 12.0], [0.0, 2.0])
    values = values_of(ground, frame, standoff=-0.5)
    assert values["h"].item() == pytest.approx(2.0 * 0.8 + 0.5)
    assert values["t"].item() == pytest.approx(2.0 * 0.8)


def test_detached_marks_cells_with_a_gap_above_the_bed():
    ground = flat()  # the code's cell is 0.5 m
    frame = points(ground, [2, 7, 12, 12, 17, 17], [2] * 6, [0.45, 0.55, 1.0, 6.0, 3.0, 6.0])
    assert values_of(ground, frame)["detached"].tolist() == [0, 1, 0, 1]


def test_shallow_flow_has_no_velocity():
    ground = flat()
    frame = points(ground, [2.0, 7.0], [2.0, 2.0], [0.04, 0.06], velocity=(5.0, 0.0, 0.0))
    values = values_of(ground, frame, min_depth=0.05)
    for name in ("Un", "Ut", "Ut_E", "Ut_N", "p"):
        assert np.isnan(values[name]).tolist() == [True, False], name
    assert values["h"] == pytest.approx([0.04, 0.06])


def test_pixel_without_slope_keeps_mass_only():
    """An island of one valid pixel."""
    ground = flat((9, 9))
    ground.elevation[3:6, 3:6] = np.nan
    ground = Terrain(ground.grid, ground.elevation)
    ground.elevation[4, 4] = 100.0
    position = np.array([[600022.5, 5169977.5, 101.0], [600002.5, 5169997.5, 101.0]])
    frame = Frame(Particles(position, np.ones((2, 3)), np.ones(2), np.ones(2)), dimension=3, crs=CRS)
    cells = cells_of(ground, frame)
    values = cell_values(cells, ALL, 0.0)
    assert cells.without_slope == 1 and cells.outside == 0
    assert np.isnan(values["h"]).tolist() == [False, True]
    assert np.isnan(values["Ut"]).tolist() == [False, True]
    assert np.isnan(values["t_vol"]).tolist() == [False, True]
    assert values["mass"] == pytest.approx(1 / 25)


def test_smallest_rasters():
    for shape in ((1, 1), (1, 5), (5, 1), (2, 2)):
        grid = Grid.north_up(CRS, 600000.0, 5170000.0, 5.0, shape)
        ground = Terrain(grid, np.full(shape, 100.0))
        for dimension in (2, 3):
            frame = points(ground, [2.5], [2.5], [1.0])
            if dimension == 2:
                frame = tiling(ground, 2.0, 1, 1, 1.5, 1.5)
            values = values_of(ground, frame)
            assert values["n"].sum() == 1
            assert values["h"] == pytest.approx(2.0 if dimension == 2 else 1.0)


def test_empty_cells_and_frames_off_the_map():
    ground = flat()
    frame = points(ground, [12.0], [12.0], [1.0])
    frame.particles.position[:] += 1e5
    cells = cells_of(ground, frame)
    assert len(cells.index) == 0 and cells.outside == 1 and cells.mass_outside == 1.0
    assert all(len(value) == 0 for value in cell_values(cells, ALL, 0.0).values())


def test_coordinates_beyond_integer_range_are_outside():
    ground = flat()
    frame = points(ground, [12.0] * 4, [12.0] * 4, [1.0] * 4)
    frame.particles.position[:3, 0] = [1e300, -1e300, np.nan]
    assert cells_of(ground, frame).outside == 3


def test_borders_have_one_owner():
    """Points on borders belong to the larger row and column; the last edge of the raster is outside (H24)."""
    ground = flat((4, 4))
    x, y = (v.ravel() for v in np.meshgrid(np.arange(0, 21, 5.0), np.arange(0, 21, 5.0)))
    position = np.stack([600000.0 + x, 5170000.0 - y, np.full(25, 101.0)], axis=1)
    frame = Frame(Particles(position, np.zeros((25, 3)), np.ones(25), np.ones(25)), dimension=3, crs=CRS)
    cells = cells_of(ground, frame)
    assert cells.count.tolist() == [1] * 16 and cells.outside == 9


def test_far_from_the_origin_nothing_changes():
    """V22: a shift of frame and terrain by 5e6 m changes no value."""
    near = flat(slope=(0.5, 0.1))
    moved = Grid.north_up(CRS, 600000.0 + 5e6, 5170000.0 + 5e6, 5.0, (10, 12))
    far = Terrain(moved, near.elevation)
    frame = points(near, *np.random.default_rng(0).uniform(0, 50, (2, 300)), 1.0, velocity=(1.0, 2.0, 3.0))
    shifted = Frame(frame.particles, dimension=3, crs=CRS, origin=tuple(np.add(frame.origin, (5e6, 5e6, 0.0))))
    one, other = values_of(near, frame), values_of(far, shifted)
    for name in ALL:
        if name != "detached":
            assert np.array_equal(one[name], other[name], equal_nan=True), name


def test_the_order_of_the_points_does_not_change_a_bit():
    """Sorted by tile or not: sums keep the order of the points, and so does a frame larger than a slab."""
    random = np.random.default_rng(1)
    n, shape = 3000, (90, 70)
    row, column = random.integers(0, 90, n).astype(np.int32), random.integers(0, 70, n).astype(np.int32)
    row[::50] = -1
    bounds, mark = np.array([0, 90, 0, 70]), np.arange(6300, dtype=np.int32).reshape(shape)
    distance, velocity = random.normal(size=n), random.normal(size=(n, 3))
    distance[::31] = np.nan
    mass, volume, pixel = random.random(n), random.random(n), random.integers(0, 40, n)
    gradient = random.normal(size=(40, 2))
    points = binning.PointsInCells(row, column, pixel, distance, velocity, mass, volume)
    given = points, bounds, mark, gradient
    plain = np.zeros((6300, binning.ROW))
    plain[:, binning.TOP], plain[:, binning.LOWEST] = -np.inf, np.inf
    tiles = np.prod([-(-length // binning.TILE) for length in shape])
    binning._sum_points(*given, plain)
    for slab in (n, 700):
        table = np.empty((6300, binning.ROW))
        binning.bin_points(*given, table, np.empty((slab, binning.RECORD)), np.empty(tiles + 1, np.int64))
        np.testing.assert_array_equal(table, plain)
