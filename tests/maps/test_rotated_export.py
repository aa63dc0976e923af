"""Rotated or sheared DTM: exports on its axes equal those of the same unrotated scene."""

from dataclasses import replace

import netCDF4
import numpy as np
import pyogrio
import pytest
import rasterio
import rioxarray
import xarray
from affine import Affine
from exporting import AFFINES, CRS, NORTH, WEST, random_frame, terrain, write_run
from hypothesis import given, settings
from hypothesis import strategies as st

import mpmgis
from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame, write_frame
from mpmgis.frames.peaks import PEAK_NAMES as MAXIMA
from mpmgis.maps.averaging.export_resolution import export_axes, export_grid
from mpmgis.maps.averaging.frame_values import Averaging, average_frame, reached
from mpmgis.maps.averaging.maxima import SolverPeaks
from mpmgis.maps.averaging.placement import Bed
from mpmgis.maps.qgis.outlines import LEAST_PART, mask_outline
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid

MASS = 6  # number of its band after h, t, Un, Ut and t_vol
PRODUCTS = ("h", "t", "Un", "Ut", "Ut_E", "Ut_N", "t_vol", "n", "mass", "p")


def turned(ground, frame, angle):
    """The same scene, rotated by `angle` [degrees] around the DTM's first corner."""
    t = ground.grid.transform
    grid = Grid(
        CRS, Affine.translation(t.c, t.f) * Affine.rotation(angle) * Affine(t.a, t.b, 0, t.d, t.e, 0), ground.grid.shape
    )
    turn = np.array(Affine.rotation(angle)).reshape(3, 3)[:2, :2]
    particles = frame.particles
    origin, corner = np.array(frame.origin), np.array([t.c, t.f])
    place, velocity = particles.position.copy(), particles.velocity.copy()
    place[:, :2] = (place[:, :2] + (origin[:2] - corner)) @ turn.T + (corner - origin[:2])
    velocity[:, :2] = velocity[:, :2] @ turn.T
    return Terrain(grid, ground.elevation), replace(
        frame, particles=replace(particles, position=place, velocity=velocity)
    )


def values_of(ground, frame, cell_size, kind, with_bounds):
    bed = Bed.of(ground, kind)
    bounds = reached(frame, bed, export_axes(ground.grid, False)) if with_bounds else None
    grid = export_grid(ground.grid, cell_size, bounds, north_up=False)
    return grid, average_frame(frame, Averaging(bed, grid, 1200.0, PRODUCTS))


@given(
    angle=st.floats(-360, 360),
    dimension=st.sampled_from([2, 3]),
    cell_size=st.sampled_from([None, 1.3, 4.0, 11.0]),
    kind=st.sampled_from(["bilinear", "plane"]),
    pixel=st.sampled_from(["north-up", "oblong"]),
    with_bounds=st.booleans(),
    seed=st.integers(0, 5),
)
@settings(max_examples=60, deadline=None)
def test_a_rotated_scene_gives_the_same_arrays(angle, dimension, cell_size, kind, pixel, with_bounds, seed):
    if round(angle, 6) % 180 == 0 and angle != 0:
        angle += 0.1  # axes along east and north are exported north-up
    ground = terrain(AFFINES[pixel], holes=[(7, 9), (20, 20)])
    frame = random_frame(ground, 300, dimension, seed=seed)
    place = frame.particles.position  # away from borders of cells, where rounding decides, and from the grid's rim
    place += np.random.default_rng(seed).uniform(-0.2, 0.2, place.shape)
    grid, straight = values_of(ground, frame, cell_size, kind, with_bounds)
    turned_grid, result = values_of(*turned(ground, frame, angle), cell_size, kind, with_bounds)
    assert turned_grid.shape == grid.shape and turned_grid.cell_area == pytest.approx(grid.cell_area)
    np.testing.assert_array_equal(result.index, straight.index)
    sin, cos = np.sin(np.radians(angle)), np.cos(np.radians(angle))
    expected = dict(straight.values)
    east, north = expected["Ut_E"], expected["Ut_N"]
    expected["Ut_E"], expected["Ut_N"] = cos * east - sin * north, sin * east + cos * north
    for name in PRODUCTS:
        np.testing.assert_allclose(result.values[name], expected[name], rtol=2e-4, atol=2e-4, err_msg=name)
    assert (result.outside, result.without_slope) == (straight.outside, straight.without_slope)


@pytest.mark.parametrize("affine", ["rotated", "sheared"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_a_rotated_terrain_keeps_its_transform(affine, dimension, tmp_path, capsys):
    ground = terrain(AFFINES[affine])
    frames = write_run(tmp_path / "slide", ground=ground, dimension=dimension)
    mass = read_frame(frames[0]).particles.mass.sum()
    for options, sides in (((), ground.grid.sides), (("--cs-e", "3"), (3.0, 3.0)), (("--layout", "stacks"), None)):
        assert main(["export-raster", *map(str, frames), "--products", "mass", "--overwrite", *options]) == 0
        step = "slide_0000.vrt" if "stacks" in options else "slide_0000.tif"
        with rasterio.open(tmp_path / "slide_gis/rasters" / step) as source:
            t, values = source.transform, source.read(MASS).astype(float)
        if "--cs-e" not in options:
            assert t == ground.grid.transform and values.shape == ground.grid.shape
        else:
            grid = Grid(CRS, t, values.shape)
            np.testing.assert_allclose(grid.sides, sides, rtol=1e-12)
            np.testing.assert_allclose(grid.matrix / 3.0, ground.grid.matrix / ground.grid.sides, atol=1e-9)
            steps = np.linalg.solve(grid.matrix, grid.corner - ground.grid.corner)
            np.testing.assert_allclose(steps, np.rint(steps), atol=1e-5)  # counted from the DTM's own corner
        assert values.sum() * abs(t.determinant) == pytest.approx(mass, rel=1e-6)
    capsys.readouterr()


@pytest.mark.parametrize("affine", ["rotated", "sheared", "mirrored"])
def test_mesh_stack_and_outlines_match_the_rasters(affine, tmp_path, capsys):
    transform = {**AFFINES, "mirrored": Affine(4.5, 2.1, WEST, -2.1, 4.5, NORTH - 150)}[affine]
    frames = write_run(tmp_path / "slide", ground=terrain(transform), dimension=3)
    assert main(["export-raster", *map(str, frames), "--overwrite"]) == 0
    capsys.readouterr()
    folder = tmp_path / "slide_gis"
    with rasterio.open(folder / "rasters/slide_max.tif") as source, rasterio.open(folder / "slide_h.vrt") as stack:
        peak, grid = source.read(1, masked=True), Grid(CRS, source.transform, source.shape)
        assert stack.transform == source.transform
    wet = grid.cell_area * np.count_nonzero(~peak.mask)
    with netCDF4.Dataset(folder / "slide.nc") as mesh:
        x, y, faces = mesh["node_x"][:], mesh["node_y"][:], mesh["face_nodes"][:]
    east, north = x[faces], y[faces]
    area = 0.5 * (east * np.roll(north, -1, 1) - np.roll(east, -1, 1) * north).sum(axis=1)
    np.testing.assert_allclose(area, grid.cell_area, rtol=1e-4)  # positive: counter-clockwise
    assert area.sum() == pytest.approx(wet, rel=1e-6)
    row, column = np.nonzero(~peak.mask)
    centres = np.stack(grid.xy(row, column), axis=1)
    np.testing.assert_allclose(np.stack([east.mean(axis=1), north.mean(axis=1)], axis=1), centres, atol=1e-6)
    envelope = pyogrio.read_dataframe(folder / "slide.gpkg", layer="envelope").geometry[0]
    deep = peak.filled(0) >= 0.05
    assert envelope.area == pytest.approx(mask_outline(deep, grid.transform, least=LEAST_PART).area, rel=5e-3)


@pytest.mark.parametrize("affine", ["rotated", "sheared", "north-up"])
@pytest.mark.parametrize("cell_size", [None, 2.0, 11.0])
def test_solver_peaks_keep_their_position_on_any_axes(affine, cell_size):
    """The solver's nodes run east and north, the cells along a rotated DTM: a linear field is unchanged."""
    ground = terrain(AFFINES[affine])
    flat = Terrain(ground.grid, np.zeros(ground.grid.shape))
    x, y = np.meshgrid(WEST - 100.0 + 5.0 * np.arange(80), NORTH - 300.0 + 5.0 * np.arange(80))
    depth = (2.0 + 0.002 * (x - WEST) - 0.003 * (y - NORTH)).astype("f4")
    peaks = SolverPeaks(9.0, depth, 0 * depth + 4.0, 0 * depth, 0 * depth + 3.0, float(x[0, 0]), float(y[0, 0]), 5.0)
    grid = export_grid(flat.grid, cell_size, north_up=False)
    found = np.full(grid.shape, np.nan)
    speed, volume = found.copy(), found.copy()
    for index, values in peaks.on(grid, Bed.of(flat), 0.05):
        found.ravel()[index], speed.ravel()[index], volume.ravel()[index] = values["h"], values["Ut"], values["t_vol"]
    east, north = grid.xy(*np.mgrid[: grid.shape[0], : grid.shape[1]])
    expected = 2.0 + 0.002 * (east - WEST) - 0.003 * (north - NORTH)
    inner = np.s_[1:-1, 1:-1]
    np.testing.assert_allclose(volume[inner], expected[inner], rtol=1e-5)
    np.testing.assert_allclose(found[inner], expected[inner], rtol=0.02)
    np.testing.assert_allclose(speed[inner], 4.0, rtol=1e-5)


def test_an_export_on_a_rotated_terrain_has_the_solvers_peaks(tmp_path):
    frames = write_run(tmp_path / "slide", ground=terrain(AFFINES["rotated"]))
    frame = read_frame(frames[-1])
    kept = {name: np.full((40, 40), 7.0, "f4") for name in MAXIMA}
    kept |= {"transform": np.array([5.0, 0.0, WEST, 0.0, 5.0, NORTH - 150])}
    write_frame(frames[-1], replace(frame, maxima=kept))
    for option in ((), ("--north-up",)):
        assert main(["export-raster", *map(str, frames), "--overwrite", "--no-qgis", *option]) == 0
        with rasterio.open(tmp_path / "slide_gis/rasters/slide_max.tif") as source:
            assert (source.transform.b != 0) == (not option)
            assert (source.read(1) > 5.0).sum() > 300


def test_paper_mode_moves_outside_particles_to_the_edge(tmp_path, capsys):
    frames = write_run(tmp_path / "slide", times=(0.0, 12.0), dimension=3)
    assert main(["export-raster", *map(str, frames), "--paper", "--products", "mass"]) == 0
    said = capsys.readouterr().err
    with rasterio.open(tmp_path / "slide_gis/rasters/slide_0001.tif") as source:
        tags, total = source.tags(ns="mpmgis"), source.read(MASS).astype(float).sum() * 25.0
        assert source.read(MASS)[:, -1].max() > 0
    assert total == pytest.approx(read_frame(frames[1]).particles.mass.sum(), rel=1e-6)
    assert (tags["bed"], tags["min_depth"], tags["outside"]) == ("plane", "0.0", "in the nearest cell of the rim")
    assert "particles are outside the DTM; --paper moves them to the nearest cell of its edge (Eq 5)" in said
    assert main(["export-raster", *map(str, frames), "--paper", "--min-depth", "0.2", "--overwrite"]) == 2
    assert "--paper requires --min-depth 0" in capsys.readouterr().err


@pytest.mark.parametrize("layout", ["steps", "stacks"])
@pytest.mark.parametrize("affine", ["rotated", "sheared"])
def test_a_rotated_export_opens_as_rioxarray_opens_its_rasters(affine, layout, tmp_path, capsys):
    frames = write_run(tmp_path / "slide", ground=terrain(AFFINES[affine]), dimension=3)
    options = ["--layout", layout, "--no-qgis"]
    assert main(["export-raster", *map(str, frames), "-o", str(tmp_path / "gis"), *options]) == 0
    capsys.readouterr()
    results = mpmgis.open_results(tmp_path / "gis")
    with rioxarray.open_rasterio(tmp_path / "gis/rasters/slide_max.tif", masked=True) as theirs:
        assert results.rio.crs == theirs.rio.crs and results.rio.transform() == theirs.rio.transform()
        for name in ("xc", "yc"):
            assert results[name].dims == theirs[name].dims == ("y", "x")
            np.testing.assert_allclose(results[name], theirs[name], rtol=0, atol=1e-6)
        np.testing.assert_array_equal(results.h_max, theirs.isel(band=theirs.attrs["long_name"].index("h_max [m]")))
    assert results.h.dims == ("time", "y", "x") and {"x", "y"}.isdisjoint(results.coords)
    results.h_max.rio.to_raster(tmp_path / "h.tif")
    results.to_netcdf(tmp_path / "r.nc")
    with rasterio.open(tmp_path / "h.tif") as written:
        assert written.transform == results.rio.transform() and written.crs == results.rio.crs
        np.testing.assert_array_equal(written.read(1), results.h_max)
    with xarray.open_dataset(tmp_path / "r.nc", decode_coords="all") as again:
        assert again.rio.transform() == results.rio.transform() and {"xc", "yc"} <= set(again.coords)
        np.testing.assert_array_equal(again.h, results.h)
