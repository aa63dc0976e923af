"""Export of a series of frames: gaps, and the final deposit."""

import numpy as np
import rasterio
from affine import Affine

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import write_frame
from mpmgis.frames.particles import Frame, Particles


def series(folder, times):
    """A column of 1 m that grows by 1 m a second, on a level DTM, one frame for each of `times`."""
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
        particles = Particles(
            np.array([[52.5, 52.5, 0.0]]), np.zeros((1, 3)), 1000 * volume, volume, volume / 25, np.array([25.0])
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
