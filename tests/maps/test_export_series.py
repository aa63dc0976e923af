"""Export of a series of frames: gaps, and the final deposit."""

import json
import zipfile

import numpy as np
import pytest
import rasterio
from affine import Affine

import mpmgis
from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import write_frame
from mpmgis.frames.particles import Frame, Particles


def series(folder, times, speeds=None):
    """A column of 1 m that grows by 1 m a second, on a level DTM, at `times`, with `speeds` [m/s]."""
    profile = {
        "driver": "GTiff",
        "height": 20,
        "width": 20,
        "count": 1,
        "dtype": "float32",
        "crs": "EPSG:32632",
        "transform": Affine(5, 0, 500000, 0, -5, 5000100),
    }
    folder.mkdir()
    with rasterio.open(folder / "dtm.tif", "w", **profile) as target:
        target.write(np.zeros((20, 20), "float32"), 1)
    import pyproj

    for number, time in enumerate(times):
        volume = np.array([25.0 * (1 + time)])
        velocity = np.array([[0.0 if speeds is None else speeds[number], 0.0, 0.0]])
        particles = Particles(
            np.array([[52.5, 52.5, 0.0]]), velocity, 1000 * volume, volume, volume / 25, np.array([25.0])
        )
        frame = Frame(particles, time=time, crs=pyproj.CRS(32632), origin=(500000.0, 5000000.0, 0.0), dem="dtm.tif")
        write_frame(folder / f"frame_{number:06d}.h5", frame)


def deposit(folder):
    with rasterio.open(folder / "rasters" / "run_deposit.tif") as source:
        return source.read(1).max()


def test_the_deposit_is_that_of_the_last_frame_whatever_the_steps(tmp_path, capsys):
    series(tmp_path / "run", [0.0, 1.0, 2.0, 3.0])
    out = tmp_path / "out"
    assert main(["export-raster", str(tmp_path / "run"), "-o", str(out), "--dt-e", "1000", "--no-qgis"]) == 0
    assert "the last frame at 3 s" in capsys.readouterr().err
    assert abs(deposit(out) - 4.0) < 1e-5


@pytest.mark.parametrize(
    ("speeds", "record", "name", "words"),
    [
        ((9.0, 20.0, 0.8), None, "deposit", "deposit"),
        ((9.0, 20.0, 1.2), None, "last", "last step, t = 3 s, 100 % still moving"),
        ((0.1, 0.5, 0.9), None, "last", "last step, t = 3 s, 0 % still moving"),
        ((9.0, 20.0, 1.2), True, "deposit", "deposit"),
        ((9.0, 20.0, 0.8), False, "last", "last step, t = 3 s, 0 % still moving"),
    ],
    ids=["rests", "moves", "accelerates", "its run rests", "its run moves"],
)
def test_a_last_step_is_a_deposit_only_at_rest(tmp_path, speeds, record, name, words):
    """File, tags, layer group and dataset; the record of the run decides where there is one."""
    series(tmp_path / "run", [0.0, 1.0, 3.0], speeds)
    if record is not None:
        end = {"time": 3.0, "moving": 0.5, "came_to_rest": record}
        found = {"format": "mpmgis-run", "format_version": 1, "state": "finished", "digest": "", "end": end}
        (tmp_path / "run" / "run.json").write_text(json.dumps(found))
    assert main(["export-raster", str(tmp_path / "run"), "-o", str(tmp_path / "out"), "-q"]) == 0
    summaries = {path.name for path in (tmp_path / "out" / "rasters").glob("run_[dl]*.tif")}
    assert summaries == {f"run_{name}.tif"}
    for file in (f"run_{name}.tif", "run_max.tif"):
        with rasterio.open(tmp_path / "out" / "rasters" / file) as source:
            assert source.tags(ns="mpmgis")["came_to_rest"] == ("true" if name == "deposit" else "false")
    with zipfile.ZipFile(tmp_path / "out" / "run.qgz") as project:
        assert f"run: {words}" in project.read("run.qgs").decode()
    results = mpmgis.open_results(tmp_path / "out")
    assert f"h_{name}" in results and results.attrs["came_to_rest"] == ("true" if name == "deposit" else "false")


def test_a_gap_in_the_series_is_reported(tmp_path, capsys):
    series(tmp_path / "run", [0.0, 1.0, 2.0, 3.0])
    (tmp_path / "run" / "frame_000002.h5").unlink()
    assert main(["export-raster", str(tmp_path / "run"), "-o", str(tmp_path / "out"), "--no-qgis"]) == 0
    assert "frame_000002.h5" in capsys.readouterr().err


def test_a_seed_never_overwrites_its_inputs(tmp_path, capsys):
    import geopandas
    import shapely

    series(tmp_path / "run", [0.0])
    release = tmp_path / "release.gpkg"
    square = shapely.box(500030, 5000030, 500060, 5000060)
    geopandas.GeoDataFrame({"thickness": [1.0]}, geometry=[square], crs=32632).to_file(release)
    before = release.read_bytes()
    dem = str(tmp_path / "run" / "dtm.tif")
    capsys.readouterr()
    code = main(["seed", "--dem", dem, "--release", str(release), "-o", str(release), "--overwrite", "-q"])
    assert code == 2 and "is an input" in capsys.readouterr().err
    assert release.read_bytes() == before
