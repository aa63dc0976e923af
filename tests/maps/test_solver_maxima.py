"""Solver peaks of every step in the maxima of an export: exact fields, thresholds, commands."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import rasterio
from affine import Affine
from exporting import AFFINES, NORTH, WEST, terrain, write_run

from mpmgis.commands.demo_site import sample_folder
from mpmgis.commands.export_raster import export_raster
from mpmgis.commands.shell.main import main
from mpmgis.exchange.frame_list import list_frames
from mpmgis.maps.averaging import maxima as solver_maxima
from mpmgis.maps.averaging.export_resolution import export_grid
from mpmgis.maps.averaging.frame_values import Averaging, average_frame
from mpmgis.maps.averaging.maxima import MAXIMA_BANDS, PRODUCTS_NEEDED, RunningMaxima, SolverPeaks
from mpmgis.maps.averaging.placement import Bed
from mpmgis.scene import read_scene
from mpmgis.system.errors import SceneError
from mpmgis.system.messages import collected
from mpmgis.terrain.dtm import read_terrain
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid

SOLVER_BANDS = ("h_max", "t_max", "Ut_max", "p_max", "t_arrival")
DENSITY = 1200.0


def peaks_of(thickness, speed=8.0, arrival=3.0, west=0.0, south=0.0, spacing=5.0, **more):
    """Peaks at nodes [rows, columns] from the south-west one; dry nodes have no speed and no arrival."""
    thickness = np.asarray(thickness, np.float32)
    wet = thickness >= more.get("arrival_thickness", 0.05)
    speed = np.where(wet, speed, 0.0).astype(np.float32)
    arrival = np.where(wet, arrival, -1.0).astype(np.float32)
    return SolverPeaks(
        9.0, thickness, speed, (DENSITY * speed**2).astype(np.float32), arrival, west, south, spacing, **more
    )


def plane(slope=(0.0, 0.0), transform=None, shape=(20, 20)):
    """A terrain with the gradient `slope` (east, north)."""
    grid = Grid(None, transform or Affine(5, 0, 0, 0, -5, 100), shape)
    x, y = grid.xy(*np.mgrid[: shape[0], : shape[1]])
    return Terrain(grid, slope[0] * x + slope[1] * y)


def resampled(peaks, ground, cell_size=None, min_depth=0.05):
    """Name -> float64[rows, columns] on the terrain's grid or cells of `cell_size` [m]; NaN without flow."""
    grid = export_grid(ground.grid, cell_size)
    bands = {}
    for index, values in peaks.on(grid, Bed.of(ground), min_depth):
        for name, value in values.items():
            bands.setdefault(name, np.full(grid.shape, np.nan)).ravel()[index] = value
    return bands


def lattice(rows=21, columns=21, spacing=5.0):
    """Map places of the nodes on the corners of `plane`'s pixels."""
    return np.meshgrid(np.arange(columns) * spacing, np.arange(rows) * spacing)


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.75, 0.0), (-0.3, 0.6)])
@pytest.mark.parametrize("cell_size", [5.0, 2.0, 1.25])
def test_linear_fields_come_out_exactly_with_thickness_normal_to_the_bed(slope, cell_size):
    """Cells not larger than the node spacing take the mean of the field; |U| is along the ground in both."""
    x, y = lattice()
    peaks = peaks_of(1.0 + 0.01 * x + 0.02 * y, speed=4.0, arrival=2.0 + 0.1 * x)
    found = resampled(peaks, plane(slope), cell_size)
    grid = export_grid(plane().grid, cell_size)
    east, north = grid.xy(*np.mgrid[: grid.shape[0], : grid.shape[1]])
    cosine = 1 / np.sqrt(1 + slope[0] ** 2 + slope[1] ** 2)
    for name in ("h", "t", "t_vol"):
        np.testing.assert_allclose(found[name], (1.0 + 0.01 * east + 0.02 * north) * cosine, rtol=1e-6)
    np.testing.assert_allclose(found["Ut"], 4.0, rtol=1e-6)
    np.testing.assert_allclose(found["p"], DENSITY * found["Ut"] ** 2, rtol=1e-5)
    np.testing.assert_allclose(found["t_arrival"], 2.0 + 0.1 * east, rtol=1e-6)


def test_a_coarse_cell_has_the_largest_thickness_and_the_means_of_the_bands():
    """10 m cells over nodes 5 m apart: four samples a cell."""
    x, _ = lattice()
    peaks = peaks_of(1.0 + 0.1 * x, speed=2.0 + 0.2 * x, arrival=x)
    found = resampled(peaks, plane(), 10.0)
    samples = (np.arange(20) * 5.0 + 2.5).reshape(10, 2)
    h = 1.0 + 0.1 * samples
    np.testing.assert_allclose(found["h"][4], h.max(axis=1), rtol=1e-6)
    np.testing.assert_allclose(found["t_vol"][4], h.mean(axis=1), rtol=1e-6)
    np.testing.assert_allclose(found["t_arrival"][4], samples.mean(axis=1), rtol=1e-6)
    nodes = np.stack([samples - 2.5, samples + 2.5], axis=-1)  # a sample lies halfway between two of them
    mass, speed = 1.0 + 0.1 * nodes, 2.0 + 0.2 * nodes
    np.testing.assert_allclose(found["Ut"][4], (mass * speed).sum(axis=(1, 2)) / mass.sum(axis=(1, 2)), rtol=1e-6)
    np.testing.assert_allclose(found["p"][4], DENSITY * found["Ut"][4] ** 2, rtol=1e-5)


@pytest.mark.parametrize("cell_size", [700.0, 1e6])
def test_a_cell_far_larger_than_the_flow_is_sampled_where_the_flow_was(cell_size):
    """Sampling a whole 1000 km cell at node spacing would need 4e10 samples."""
    thickness = np.zeros((21, 21))
    thickness[4:8, 5:11] = 2.0
    thickness[9, 12] = 3.0
    peaks = peaks_of(thickness, arrival=4.0)
    found = resampled(peaks, plane(), cell_size)
    finest = resampled(peaks, plane(), 5.0)
    assert found["h"].shape == (1, 1) and found["h"][0, 0] == pytest.approx(np.nanmax(finest["h"]), rel=0.1)
    volume = np.nansum(finest["t_vol"]) * 5.0**2
    assert found["t_vol"][0, 0] * cell_size**2 == pytest.approx(volume, rel=1e-3)
    assert found["Ut"][0, 0] == pytest.approx(8.0, rel=1e-6) and found["t_arrival"][0, 0] == pytest.approx(4.0)


def test_speed_and_arrival_do_not_fade_towards_the_rim():
    """Half the cells next to the last wet node are dry at three corners: thickness decreases, speed does not."""
    thickness = np.zeros((21, 21))
    thickness[8:13, 8:13] = 2.0
    found = resampled(peaks_of(thickness), plane())
    reached = np.isfinite(found["h"])
    assert reached.sum() == 6 * 6
    assert sorted(set(np.round(found["h"][reached], 6))) == [0.5, 1.0, 2.0]
    np.testing.assert_allclose(found["Ut"][reached], 8.0, rtol=1e-6)
    np.testing.assert_allclose(found["t_arrival"][reached], 3.0, rtol=1e-6)


@pytest.mark.parametrize("transform", list(AFFINES))
def test_the_slope_is_that_of_the_dtm_pixel_for_any_orientation(transform):
    ground = terrain(AFFINES[transform], shape=(40, 36))
    west, south, east, north = ground.grid.bounds
    shape = int((north - south) / 5) + 1, int((east - west) / 5) + 1
    found = resampled(peaks_of(np.full(shape, 3.0), west=west, south=south), ground)
    grid = export_grid(ground.grid)
    x, y = grid.xy(*np.mgrid[: grid.shape[0], : grid.shape[1]])
    row, column = (np.floor(place + 0.5).astype(int) for place in ground.grid.rowcol(x, y))
    on = (row >= 0) & (row < 40) & (column >= 0) & (column < 36) & np.isfinite(found.get("h"))
    slope = ground.limited_gradient[row[on], column[on]]
    inner = (x[on] < east - 6) & (y[on] < north - 6)  # beyond them the nodes end
    expected = 3.0 / np.sqrt(1 + (slope**2).sum(axis=-1))
    assert inner.sum() > 500
    np.testing.assert_allclose(found["h"][on][inner], expected[inner], rtol=1e-6)


def test_no_values_on_nodata_and_outside_the_dtm():
    ground = plane()
    ground.elevation[5:9, 5:9] = np.nan
    peaks = peaks_of(np.full((41, 41), 3.0), west=-50.0, south=-50.0)
    found = resampled(peaks, ground)
    assert np.isnan(found["h"][5:9, 5:9]).all() and np.isfinite(found["h"]).sum() == 400 - 16
    coarse = resampled(peaks, ground, 10.0)  # a cell half on nodata has what its other half has
    assert np.isnan(coarse["h"][3, 3]) and coarse["h"][2, 2] == 3.0 and coarse["t_vol"][2, 2] == 0.75 * 3.0


def test_a_distant_grid_has_no_values():
    assert resampled(peaks_of(np.ones((5, 5)), west=5000.0), plane()) == {}


def test_the_tail_of_the_splines_is_not_flow():
    thickness = np.zeros((21, 21))
    thickness[5:10, 5:10] = 0.03
    assert not np.isfinite(resampled(peaks_of(thickness), plane()).get("h")).any()
    low = resampled(peaks_of(thickness), plane(), min_depth=0.01)
    assert np.nanmax(low["h"]) == np.float32(0.03)
    assert np.nanmin(low["h"]) >= 0.01
    # a --min-depth above the solver's threshold hides no thickness
    assert np.isfinite(resampled(peaks_of(thickness * 10), plane(), min_depth=1.0)["h"]).sum() == 36
    assert peaks_of(thickness).bounds(0.05) is None and peaks_of(thickness).bounds(0.01) == (20.0, 20.0, 50.0, 50.0)


@pytest.mark.parametrize(
    "min_depth, solver, bands",
    [
        (0.05, 0.05, SOLVER_BANDS),
        (0.2, 0.05, ("h_max", "t_max")),
        (0.2, 0.2, SOLVER_BANDS),
        (0.01, 0.05, ("h_max", "t_max")),
    ],
)
def test_bands_with_a_threshold_are_taken_only_where_it_is_the_same(min_depth, solver, bands):
    peaks = peaks_of(np.full((21, 21), 1.0), arrival_thickness=solver)
    assert peaks.bands(min_depth) == bands
    found = resampled(peaks, plane(), min_depth=min_depth)
    assert set(found) == {"h", "t", "t_vol"} | ({"Ut", "p", "t_arrival"} if len(bands) > 2 else set())


@pytest.mark.parametrize("cell_size", [3.0, 10.0])
def test_the_size_of_the_strips_changes_nothing(cell_size, monkeypatch):
    random = np.random.default_rng(1)
    peaks, ground = peaks_of(random.uniform(0, 2, (21, 21)), arrival=random.uniform(0, 9, (21, 21))), plane((0.2, 0.4))
    whole = resampled(peaks, ground, cell_size)
    monkeypatch.setattr(solver_maxima, "STRIP_CELLS", 100)
    strips = resampled(peaks, ground, cell_size)
    assert all(np.array_equal(whole[name], strips[name], equal_nan=True) for name in whole)


# ------------------------------------------------------------------------------------------------ in an export


def kept(thickness=6.0, speed=60.0, arrival=0.25, columns=(14, 30)):
    """Group `maxima` as the solver writes it: a band of flow across the terrain of `exporting`."""
    shape = 30, columns[1] - columns[0]
    return {
        "thickness": np.full(shape, thickness, np.float32),
        "speed": np.full(shape, speed, np.float32),
        "pressure": np.full(shape, DENSITY * speed**2, np.float32),
        "arrival_time": np.full(shape, arrival, np.float32),
        "transform": np.array([5.0, 0, WEST + 5 * columns[0] - 2.5, 0, 5.0, NORTH - 200 + 20 - 2.5]),
    }


def export(frames, output, **options):
    """(maxima by band, tags, messages) of an export without QGIS files."""
    with collected() as said:
        export_raster(list(frames), **{"output": output, "qgis": False} | options)
    return *read(output / "rasters" / f"{Path(frames[0]).parent.name}_max.tif"), said


def read(path):
    with rasterio.open(path) as source:
        names = [text.split(" ")[0] for text in source.descriptions]
        values = np.where(source.read() == source.nodata, np.nan, source.read())
        return dict(zip(names, values, strict=True)), source.tags(ns="mpmgis")


def written(frames):
    """The terrain beside the frames, as rounded in its file."""
    return read_terrain(Path(frames[0]).parent / "terrain.tif")


@pytest.fixture(scope="module")
def silent(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("silent") / "slide")


@pytest.fixture(scope="module")
def telling(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("telling") / "slide", maxima=kept())


def test_without_peaks_the_maxima_are_those_of_the_frames_with_a_warning_of_eq_17(silent, tmp_path):
    peaks, tags, said = export(silent, tmp_path / "out")
    assert tags["maxima"] == "frames" and "maxima_solver" not in tags
    assert len(said) == 1 and said[0].startswith("warning:") and "Eq 17" in said[0]  # frames of 1 s at 28 m/s
    ground = written(silent)
    averaging = Averaging(Bed.of(ground), export_grid(ground.grid), DENSITY, PRODUCTS_NEEDED)
    expected = RunningMaxima(40 * 36, 0.05)
    for entry in list_frames(silent):
        values = average_frame(entry.read(), averaging)
        expected.absorb(values.index, values.values, values.time)
    for name in MAXIMA_BANDS:
        assert np.array_equal(peaks[name], expected.rows(name, 0, 40, 36), equal_nan=True), name


def test_each_band_has_the_larger_of_peaks_and_frames_and_reports_its_source(silent, telling, tmp_path):
    frames, _, _ = export(silent, tmp_path / "silent")
    both, tags, said = export(telling, tmp_path / "telling")
    assert len(said) == 1 and "the solver's maxima of all steps up to t = 2 s" in said[0]
    assert "Un_max and Un_min are from the frames alone" in said[0] and "Eq 17 requires dt_e" in said[0]
    assert tags["maxima"] == "solver, every step" and tags["maxima_solver"].split(", ") == list(SOLVER_BANDS)
    peaks = resampled(SolverPeaks.of(kept(), 2.0), written(telling))
    products = {"h_max": "h", "t_max": "t", "Ut_max": "Ut", "p_max": "p"}
    for name, product in products.items():
        expected = np.fmax(frames[name], peaks[product].astype(np.float32))
        assert np.array_equal(both[name], expected, equal_nan=True), name
        assert (both[name] > frames[name]).any() and np.isnan(frames[name][np.isfinite(both[name])]).any()
    expected = np.fmin(frames["t_arrival"], peaks["t_arrival"].astype(np.float32))
    assert np.array_equal(both["t_arrival"], expected, equal_nan=True)
    assert (both["t_arrival"] < frames["t_arrival"]).any()
    for name in ("Un_max", "Un_min"):
        assert np.array_equal(both[name], frames[name], equal_nan=True)


def test_no_step_shows_more_than_the_maxima(telling, tmp_path):
    peaks, _, _ = export(telling, tmp_path / "out", cell_size=3.0, extent="dtm")
    for step in range(3):
        values, _ = read(tmp_path / "out" / "rasters" / f"slide_{step:04d}.tif")
        wet = values["h"] > 0
        assert (values["h"][wet] <= peaks["h_max"][wet]).all()
        assert not (values["Ut"] > peaks["Ut_max"]).any()


def test_with_another_min_depth_speed_pressure_and_arrival_are_from_frames(silent, telling, tmp_path):
    frames, _, _ = export(silent, tmp_path / "silent", min_depth=0.2)
    both, tags, said = export(telling, tmp_path / "telling", min_depth=0.2)
    assert tags["maxima_solver"] == "h_max, t_max"
    assert len(said) == 2 and "Ut_max, p_max, t_arrival are of flow deeper than 0.05 m" in said[0]
    assert said[1].startswith("warning:") and "Eq 17 requires dt_e" in said[1]
    assert "`min_depth=0.05`" in said[0]
    for name in ("Ut_max", "p_max", "t_arrival"):
        assert np.array_equal(both[name], frames[name], equal_nan=True)
    assert (both["h_max"] > frames["h_max"]).any()


def test_the_solvers_threshold_is_read_from_the_frame(tmp_path):
    frames = write_run(tmp_path / "slide", maxima=kept() | {"arrival_thickness": 0.2})
    _, tags, said = export(frames, tmp_path / "out", min_depth=0.2)
    assert tags["maxima_solver"].endswith("t_arrival") and "are not used with" not in said[0]
    _, tags, said = export(frames, tmp_path / "out", overwrite=True)
    assert tags["maxima_solver"] == "h_max, t_max" and "`min_depth=0.2`" in said[0]


def test_the_flow_extent_includes_flow_between_frames(silent, tmp_path):
    from mpmgis.frames.frame_files import read_frame, write_frame

    run = tmp_path / "slide"
    shutil.copytree(silent[0].parent, run)
    frame = read_frame(run / "frame_000000.h5")
    inside = np.abs(frame.particles.position[:, 0] - 120) < 15
    for step in (0, 1):
        few = replace(
            frame, particles=frame.particles.take(inside), time=float(step), step=step, maxima=kept(columns=(2, 8))
        )
        write_frame(run / f"frame_{step:06d}.h5", few)
    (run / "frame_000002.h5").unlink()
    peaks, _, _ = export([run / "frame_000000.h5", run / "frame_000001.h5"], tmp_path / "out", cell_size=5.0)
    with rasterio.open(tmp_path / "out" / "rasters" / "slide_max.tif") as source:
        assert source.bounds.left <= WEST + 5.0
    assert np.nanmax(peaks["Ut_max"]) == 60.0


def test_maxima_so_far_in_the_steps_are_each_frames_own(silent, tmp_path):
    run = tmp_path / "slide"
    shutil.copytree(silent[0].parent, run)
    files = sorted(run.glob("*.h5"))
    for step, path in enumerate(files):
        with h5py.File(path, "r+") as file:
            group = file.create_group("maxima")
            for name, values in kept(thickness=5.0 + step).items():
                group[name] = values
    peaks, _, _ = export(files, tmp_path / "out", products=("maxima",))
    steps = [read(tmp_path / "out" / "rasters" / f"slide_{k:04d}.tif") for k in range(3)]
    assert all(tags["maxima"] == "solver, every step" for _, tags in steps)
    row, column = 15, 20
    cosine = 1 / np.sqrt(1 + (terrain().limited_gradient[row, column] ** 2).sum())
    assert [float(values["h_max"][row, column] / cosine) for values, _ in steps] == pytest.approx([5.0, 6.0, 7.0])
    assert np.array_equal(steps[2][0]["h_max"], peaks["h_max"], equal_nan=True)


def test_iseesnow_files_use_them_on_the_dtms_grid(silent, telling, tmp_path):
    grids = {}
    for frames in (silent, telling):
        out = tmp_path / frames[0].parent.parent.name
        export(frames, out, naming="iseesnow", cell_size=3.0)
        for path in (out / "rasters").glob("*.asc"):
            with rasterio.open(path) as source:
                grids[frames is telling, path.stem[-3:]] = source.read(1)
    peaks = resampled(SolverPeaks.of(kept(), 2.0), written(telling))
    for kind, product, unit in (("pft", "t_vol", 1.0), ("pfv", "Ut", 1.0), ("ppr", "p", 1000.0)):
        expected = np.fmax(grids[False, kind], np.nan_to_num(peaks[product]) / unit)
        assert (grids[True, kind] > grids[False, kind]).any()
        np.testing.assert_allclose(grids[True, kind], expected, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("layout", ["steps", "stacks"])
def test_qgis_files_use_the_peaks(telling, tmp_path, layout):
    out = tmp_path / "out"
    export_raster(list(telling), output=out, layout=layout)
    names = {path.name for path in out.iterdir()}
    assert {"slide.qgz", "slide.nc", "slide.gpkg"} <= names and (out / "rasters" / "slide_max.qml").exists()


BAD_MAXIMA = {
    "no speed": ({"speed": None}, "lack 'speed'"),
    "another shape": ({"pressure": np.zeros((3, 3))}, "maxima/pressure has shape"),
    "words": ({"speed": np.full((30, 16), b"fast")}, "maxima/speed has shape"),
    "NaN": ({"thickness": np.full((30, 16), np.nan)}, "maxima/thickness contains negative, NaN"),
    "negative": ({"speed": np.full((30, 16), -2.0)}, "maxima/speed contains negative, NaN"),
    "rotated": ({"transform": np.array([5.0, 1, 0, 0, 5.0, 0])}, "maxima/transform is"),
    "oblong": ({"transform": np.array([5.0, 0, 0, 0, 6.0, 0])}, "maxima/transform is"),
    "no place": ({"transform": np.zeros(3)}, "maxima/transform is"),
    "threshold": ({"arrival_thickness": "some"}, "maxima/arrival_thickness is"),
}


@pytest.mark.parametrize("case", BAD_MAXIMA)
def test_invalid_peaks_are_rejected_in_one_line(case, tmp_path, capsys):
    changes, words = BAD_MAXIMA[case]
    group = {name: value for name, value in (kept() | changes).items() if value is not None}
    frames = write_run(tmp_path / "slide", maxima=group)
    assert main(["export-raster", str(frames[0].parent), "-o", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert words in err and len(err.splitlines()) == 1 and "frame_000002.h5" in err
    assert not (tmp_path / "out").exists()


# --------------------------------------------------------------------------------- from the solver, by the commands

SCENE = """
[terrain]
dem = "lava_falls_dem_utm12n_10m.tif"
[release]
source = "lava_falls_release_small.shp"
density = 2000
[friction]
law = "Voellmy"
mu = 0.25
xi = 1000
[numerics]
cell_size = 5
[output]
end_time = {end}
frame_interval = {interval}
maxima = {maxima}
"""
END = 12


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Three runs of one scene: 2 frames with peaks, 2 without, and 61 without; and their exports' maxima."""
    folder = tmp_path_factory.mktemp("site")
    for file in sample_folder().iterdir():
        shutil.copy(file, folder)
    for name, interval, maxima in (("few", END, "true"), ("off", END, "false"), ("dense", 0.2, "false")):
        (folder / "scene.toml").write_text(SCENE.format(end=END, interval=interval, maxima=maxima))
        assert main(["run", str(folder / "scene.toml"), "-q", "-o", str(folder / name)]) == 0
    return folder


def commanded(site, name, capsys, *options):
    """(maxima, tags, lines on stderr) of `mpmgis export-raster`."""
    out = site / f"{name}_out"
    assert main(["export-raster", str(site / name), "-o", str(out), "--overwrite", "--no-qgis", *options]) == 0
    return *read(out / "rasters" / f"{name}_max.tif"), capsys.readouterr().err.splitlines()


# differences over the reference's sum: what lies between 61 frames, and speeds that a cell averages over the ground
# around it; two frames alone miss half of each
CLOSE = {"h_max": 0.16, "t_max": 0.16, "Ut_max": 0.05, "p_max": 0.07, "t_arrival": 0.15}


@pytest.mark.thorough
@pytest.mark.parametrize("cell_size", ["10", "5", "20"])
def test_two_frames_with_peaks_equal_sixty_frames(site, capsys, cell_size):
    options = () if cell_size == "10" else ("--cs-e", cell_size, "--extent", "dtm")
    few, tags, said = commanded(site, "few", capsys, *options)
    off, _, nothing_said = commanded(site, "off", capsys, *options)
    dense, _, _ = commanded(site, "dense", capsys, *options)
    assert any("maxima: h_max, t_max, Ut_max, p_max, t_arrival include the solver's" in line for line in said)
    assert tags["maxima"] == "solver, every step" and not any("maxima:" in line for line in nothing_said)
    wet, reached = np.isfinite(dense["h_max"]), np.isfinite(few["h_max"])
    assert reached[wet].mean() > 0.99 and reached.sum() < 1.1 * wet.sum()
    assert np.isfinite(off["h_max"])[wet].mean() < 0.97
    for name, bound in CLOSE.items():
        assert relative(few, dense, name) < bound, name
        assert relative(off, dense, name) > 0.4, name
    assert np.nanmax(few["Ut_max"]) == pytest.approx(np.nanmax(dense["Ut_max"]), rel=0.02)


@pytest.mark.thorough
def test_the_arrival_thickness_of_the_scene_is_the_bands(site, capsys):
    """From [output] through solver, frames and run.json to messages, tags and values of the export."""
    scene = SCENE.format(end=4, interval=2, maxima="true") + "arrival_thickness = 0.5\n"
    (site / "thick.toml").write_text(scene)
    assert main(["run", str(site / "thick.toml"), "-q", "-o", str(site / "thick")]) == 0
    assert json.loads((site / "thick" / "run.json").read_text())["scene"]["output"]["arrival_thickness"] == 0.5
    assert json.loads((site / "few" / "run.json").read_text())["scene"]["output"]["arrival_thickness"] == 0.05
    assert "arrival_thickness" not in json.loads((site / "off" / "run.json").read_text())["scene"]["output"]
    peaks, tags, said = commanded(site, "thick", capsys, "--min-depth", "0.5")
    assert tags["maxima_arrival_thickness"] == "0.5" and tags["maxima_solver"].endswith("t_arrival")
    assert any("Ut_max, p_max, t_arrival are of flow deeper than 0.5 m" in line for line in said)
    thick = peaks["h_max"] >= 0.5
    assert np.isfinite(peaks["t_arrival"])[thick].mean() > 0.95 and np.isnan(peaks["t_arrival"])[~thick].mean() > 0.9
    _, tags, said = commanded(site, "thick", capsys)
    assert tags["maxima_solver"] == "h_max, t_max"
    assert any("give --min-depth 0.5 to use them" in line for line in said)


@pytest.mark.parametrize(
    ("maxima", "value", "words"),
    [
        ("true", "0", "expected above 0"),
        ("true", "-0.1", "expected above 0"),
        ("true", '"thin"', "expected a number"),
        ("true", "2000", "expected at most 1000"),
        ("false", "0.2", "used only with maxima = true"),
    ],
)
def test_an_invalid_arrival_thickness_is_rejected(tmp_path, maxima, value, words):
    (tmp_path / "scene.toml").write_text(
        SCENE.format(end=4, interval=2, maxima=maxima) + f"arrival_thickness = {value}"
    )
    with pytest.raises(SceneError, match=words) as error:
        read_scene(tmp_path / "scene.toml")
    assert "arrival_thickness" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.thorough
def test_peak_flow_thickness_for_the_intercomparison_is_that_of_sixty_frames(site, capsys):
    """`t_vol` is the mean over the cell, as the solver's field, so only sampling errors remain."""
    pft = {}
    for name in ("few", "off", "dense"):
        commanded(site, name, capsys, "--naming", "iseesnow")
        (path,) = (site / f"{name}_out" / "rasters").glob("*_pft.asc")
        with rasterio.open(path) as source:
            pft[name] = {"pft": source.read(1).astype(float)}
    assert relative(pft["few"], pft["dense"], "pft") < 0.08 < 0.4 < relative(pft["off"], pft["dense"], "pft")


def relative(values, reference, name):
    """Sum of differences over sum of the reference, where both have values."""
    both = np.isfinite(values[name]) & np.isfinite(reference[name])
    return np.abs(values[name] - reference[name])[both].sum() / reference[name][both].sum()


def test_the_largest_value_of_a_band_is_that_of_its_cells():
    maxima = RunningMaxima(4, 0.05)
    assert maxima.largest("h_max") == 0.0
    values = {name: np.array([0.125, 0.25]) for name in PRODUCTS_NEEDED} | {"Un": np.array([-0.5, 0.25])}
    maxima.absorb(np.array([1, 3]), values, 2.0)
    assert maxima.largest("h_max") == 0.25 and maxima.largest("Un_min") == 0.5
