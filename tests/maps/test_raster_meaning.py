"""Rasters in other programs: time, program, symbol, unit and meaning in gdalinfo, rioxarray and QGIS' panel."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pyproj
import pytest
import qgis_run
import rasterio
import rioxarray
from qgis_python import clean_environment, report_of

from mpmgis import __version__
from mpmgis.laws.quantities import BAND
from mpmgis.results.comparison_files import write_classes, write_classes_style
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.raster_output import write_geotiff
from mpmgis.terrain.raster_series import BandStack, StepStacks

GRID = Grid.north_up(pyproj.CRS.from_epsg(32632), 600000.0, 5170000.0, 5.0, (30, 40))
SPEED = "Ũt [m s-1]: slope-parallel speed"
QUANTITIES = [BAND["h"], BAND["Ut"]]


@pytest.fixture
def raster(tmp_path):
    return written(tmp_path / "a.tif")


def written(path, cog=False):
    values = np.random.default_rng(0).random((2, *GRID.shape))
    write_geotiff(path, GRID, list(zip(QUANTITIES, values, strict=True)), {"time": 12.5}, cog)
    return path


def test_default_metadata(raster):
    with rasterio.open(raster) as source:
        told = source.tags()
        assert told["TIFFTAG_SOFTWARE"] == f"mpmgis {__version__}" and told["time"] == "12.5 s"
        assert "h [m]: flow depth" in told["TIFFTAG_IMAGEDESCRIPTION"] and SPEED in told["TIFFTAG_IMAGEDESCRIPTION"]
        assert source.tags(2)["meaning"].startswith(SPEED)
        assert source.descriptions == ("h [m]", "Ut [m s-1]")
        assert source.tags(ns="mpmgis") == {"time": "12.5"}


def test_a_cog_describes_all_bands_in_one_text(tmp_path):
    """GDAL's COG driver leaves out the bands' default metadata where it copies those of a namespace."""
    with rasterio.open(written(tmp_path / "a.tif", cog=True)) as source:
        told = source.tags()
    assert told["time"] == "12.5 s" and told["TIFFTAG_SOFTWARE"] == f"mpmgis {__version__}"
    assert "h [m]: flow depth" in told["TIFFTAG_IMAGEDESCRIPTION"] and SPEED in told["TIFFTAG_IMAGEDESCRIPTION"]


def test_gdalinfo_shows_it(raster):
    program = shutil.which("gdalinfo")
    if program is None:
        pytest.skip("no gdalinfo on this machine (Debian: apt-get install gdal-bin)")
    done = subprocess.run(
        [program, "-json", raster], capture_output=True, text=True, check=True, env=clean_environment(program)
    )
    found = json.loads(done.stdout)
    assert found["metadata"][""]["time"] == "12.5 s"
    assert found["bands"][1]["metadata"][""]["meaning"].startswith(SPEED)


def test_rioxarray_attributes(raster):
    with rioxarray.open_rasterio(raster, band_as_variable=True) as dataset:
        assert dataset.attrs["time"] == "12.5 s"
        speed = dataset["band_2"].attrs
    assert (speed["long_name"], speed["units"]) == ("Ut [m s-1]", "m s-1") and speed["meaning"].startswith(SPEED)


def test_bands_that_are_steps(tmp_path):
    with BandStack({"Ut": tmp_path / "Ut.tif"}, GRID, [BAND["Ut"]], [0.0, 2.5], {}) as stack:
        for step in range(2):
            stack.write(step, lambda band, first, last: np.ones((last - first, 40)))
    with rasterio.open(tmp_path / "Ut.tif") as source:
        assert source.tags()["TIFFTAG_IMAGEDESCRIPTION"].count("Ũt") == 1
        assert source.tags(2)["time"] == "2.5 s" and source.tags(2)["meaning"].startswith(SPEED)


def test_steps_that_are_vrts(tmp_path):
    writer = StepStacks(tmp_path, "run", GRID, QUANTITIES, [0.0, 2.5], {}, False)
    for step, time in enumerate((0.0, 2.5)):
        writer.write(step, {"time": time}, lambda band, first, last: np.ones((last - first, 40)))
    writer.finish()
    with rasterio.open(tmp_path / "run_0001.vrt") as source:
        assert source.tags()["time"] == "2.5 s" and source.tags(2)["meaning"].startswith(SPEED)
        assert source.tags(ns="mpmgis") == {"time": "2.5"}


@pytest.mark.qgis
def test_a_single_file_in_qgis(tmp_path):
    run = qgis_run.write_all(qgis_run.make_run(tmp_path, GRID.crs, times=[0.0, 0.5, 1.0]))
    script = Path(__file__).with_name("qgis_panel.py")
    files = (run.step_files[1], run.maxima_file, run.last_file, run.stack_file("Ut"))
    for file in files[:3]:
        with rasterio.open(run.folder / file) as source:
            bands = list(zip(run.bands_of(file), source.read().astype(float), strict=True))
        write_geotiff(run.folder / file, run.grid, [(q, np.where(v == -9999, np.nan, v)) for q, v in bands], {})
    found = report_of(script, *(run.folder / file for file in files))
    assert len(found) == 4
    for name, layer in found.items():
        assert layer["renderer"] == "singlebandpseudocolor" and layer["band"] == [1], name
        assert layer["crs"] == "EPSG:32632" and np.allclose(layer["extent"], np.array(run.grid.bounds)), name
        assert f"mpmgis {__version__}" in layer["panel"], name
    assert SPEED in found["slide_Ut.vrt"]["panel"] and "0.5 s" in found["slide_Ut.vrt"]["panel"]
    assert "h [m]: flow depth" in found[Path(run.step_files[1]).name]["panel"]


@pytest.mark.qgis
def test_classes_of_a_comparison_in_qgis(tmp_path):
    first, second = (np.zeros(GRID.shape, bool) for _ in range(2))
    first[5:15, 5:15], second[10:20, 10:20] = True, True
    write_classes(tmp_path / "classes.tif", GRID, first, second, (first * 1.0, second * 2.0), BAND["h_max"])
    write_classes_style(tmp_path / "classes.qml")
    (layer,) = report_of(Path(__file__).with_name("qgis_panel.py"), tmp_path / "classes.tif").values()
    assert layer["renderer"] == "paletted" and layer["band"] == [1]
    assert layer["legend"] == ["only A", "only B", "both"]
    assert "h_max_A_minus_B [m]" in "".join(layer["bands"])
