"""Rasters out: the layout that the contract fixes, byte for byte where others rely on it."""

import numpy as np
import pyproj
import pytest
import rasterio
from rasterio.enums import ColorInterp

from mpmgis.laws.quantities import BAND
from mpmgis.system.errors import OutputError
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.raster_output import write_geotiff
from mpmgis.terrain.raster_series import BandStack

GRID = Grid.north_up(pyproj.CRS.from_epsg(32632), 600000.0, 5170000.0, 2.5, (600, 700))


def bands():
    depth = np.zeros(GRID.shape)
    depth[100:300, 50:400] = np.random.default_rng(0).random((200, 350))
    return [(BAND["h"], depth), (BAND["Ut"], np.where(depth > 0, 10 * depth, np.nan))]


@pytest.fixture(params=[False, True], ids=["plain", "cog"])
def written(request, tmp_path):
    write_geotiff(tmp_path / "a.tif", GRID, bands(), {"time": 0.30000000000000004, "bed": "plane"}, cog=request.param)
    return tmp_path / "a.tif", request.param


def test_layout(written):
    path, cog = written
    with rasterio.open(path) as source:
        profile, structure = source.profile, source.tags(ns="IMAGE_STRUCTURE")
        assert (source.descriptions, source.units) == (("h [m]", "Ut [m s-1]"), ("m", "m s-1"))
        assert source.colorinterp == (ColorInterp.gray, ColorInterp.undefined)  # GDAL writes no other first one
        assert source.tags(ns="mpmgis") == {"time": "0.30000000000000004", "bed": "plane"}
        assert source.crs.to_epsg() == 32632 and source.transform == GRID.transform
    assert profile["dtype"] == "float32" and profile["nodata"] == -9999
    assert (profile["blockxsize"], profile["blockysize"], profile["compress"]) == (256, 256, "deflate")
    assert structure["PREDICTOR"] == "3"
    if cog:
        assert structure["LAYOUT"] == "COG"
    else:
        assert profile["interleave"] == "band" and profile["driver"] == "GTiff"


def test_values_zeros_and_nodata(written):
    path, _ = written
    with rasterio.open(path) as source:
        depth, speed = source.read()
    (_, expected), (_, fast) = bands()
    assert np.array_equal(depth, expected.astype("f4"))
    assert np.array_equal(speed, np.where(np.isnan(fast), -9999, fast).astype("f4"))


def test_only_nodata_is_sparse(tmp_path):
    """Tiles of zeros are stored, tiles of nodata are not."""
    for name, value in (("zeros", 0.0), ("gaps", np.nan)):
        write_geotiff(tmp_path / f"{name}.tif", GRID, [(BAND["h"], np.full(GRID.shape, value))], {})
        with rasterio.open(tmp_path / f"{name}.tif") as source:
            offset = source.get_tag_item("BLOCK_OFFSET_0_0", "TIFF", bidx=1)
        assert (offset is None) == (name == "gaps")


def test_nothing_lies_beside_it(written):
    path, _ = written
    assert [file.name for file in path.parent.iterdir()] == ["a.tif"]


def test_local_grid_has_no_crs(tmp_path):
    grid = Grid.north_up(None, 0.0, 100.0, 1.0, (5, 5))
    write_geotiff(tmp_path / "a.tif", grid, [(BAND["h"], np.ones((5, 5)))], {})
    with rasterio.open(tmp_path / "a.tif") as source:
        assert source.crs is None and source.transform == grid.transform


@pytest.mark.parametrize("cog", [False, True])
def test_stack_holds_its_steps_as_bands(tmp_path, cog):
    arrays = [array for _, array in bands()]
    paths = {"h": tmp_path / "h.tif", "Ut": tmp_path / "Ut.tif"}
    with BandStack(paths, GRID, [BAND["h"], BAND["Ut"]], [0.0, 0.5, 2.0], {"cs_e": 2.5}, cog) as stack:
        for step in range(3):
            stack.write(step, lambda band, first, last, step=step: arrays[band][first:last] * (step + 1))
    with rasterio.open(paths["h"]) as source:
        assert source.descriptions == ("h [m]",) * 3 and source.colorinterp[1:] == (ColorInterp.undefined,) * 2
        assert source.tags(3, ns="mpmgis") == {"time": "2.0"} and source.tags(ns="mpmgis") == {"cs_e": "2.5"}
        assert np.array_equal(source.read(3), (arrays[0] * 3).astype("f4"))
    assert sorted(file.name for file in tmp_path.iterdir()) == ["Ut.tif", "h.tif"]


def test_failure_leaves_nothing(tmp_path):
    with pytest.raises(OutputError):
        write_geotiff(tmp_path / "file" / "a.tif", GRID, bands(), {}) if (tmp_path / "file").write_text("x") else None
    with pytest.raises(ZeroDivisionError):
        write_geotiff(tmp_path / "b.tif", GRID, [(BAND["h"], Broken())], {})
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


class Broken:
    """An array whose second strip cannot be computed."""

    def __getitem__(self, rows):
        return np.ones((rows.stop - rows.start, 700)) / (1 if rows.start == 0 else 1 // 0)
