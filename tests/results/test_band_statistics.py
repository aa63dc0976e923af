"""Statistics of bands for `mpmgis info`: scaled, of large and of sparse rasters; nested virtual rasters."""

import numpy as np
import pytest
import rasterio
from affine import Affine
from rasterio.windows import Window

from mpmgis.results.reports import band_statistics
from mpmgis.results.reports.file_facts import inspect
from mpmgis.system.errors import InputError

PLACE = {"crs": "EPSG:32632", "transform": Affine(1, 0, 4e5, 0, -1, 5.1e6)}


def sparse(path, side, block, nodata=None, values=None):
    profile = {"driver": "GTiff", "width": side, "height": side, "count": 1, "dtype": "float32", "nodata": nodata}
    blocks = {"tiled": True, "blockxsize": block, "blockysize": block, "sparse_ok": True, "compress": "deflate"}
    with rasterio.open(path, "w", **profile, **blocks, **PLACE, bigtiff="YES") as file:
        if values is not None:
            file.write(values.astype("float32"), 1, window=Window(side // 2, side // 2, *values.shape[::-1]))
    return path


@pytest.mark.parametrize("side", [100_000, 400_000])
@pytest.mark.parametrize("nodata", [None, -9999.0])
def test_blocks_that_are_not_there_are_not_read(tmp_path, side, nodata):
    """A file of some KB with 1e10 and more cells; GDAL reads 0 in blocks that are not there, or nodata."""
    values = np.array([[700.0, 750.0], [800.0, 650.0]])
    path = sparse(tmp_path / "a.tif", side, 4096, nodata, values)
    (band,) = inspect(path)["bands"]
    assert (band["min"], band["max"]) == ((0.0 if nodata is None else 650.0), 800.0)
    assert band["valid_share"] == (1.0 if nodata is None else pytest.approx(4 / side**2))
    assert "sampled_share" not in band


def test_a_large_raster_is_sampled_and_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(band_statistics, "MOST_READ", 100_000)
    values = np.indices((1024, 1024))[0]
    profile = {"driver": "GTiff", "width": 1024, "height": 1024, "count": 1, "dtype": "float32"}
    with rasterio.open(tmp_path / "a.tif", "w", **profile, **PLACE, tiled=True, blockxsize=64, blockysize=64) as file:
        file.write(values.astype("float32"), 1)
    (band,) = inspect(tmp_path / "a.tif")["bands"]
    assert 0.05 < band["sampled_share"] < 0.11 and band["valid_share"] == 1.0
    assert band["min"] < 100 and band["max"] > 900


def test_scaled_values_and_the_file_that_scales_them(tmp_path):
    profile = {"driver": "GTiff", "width": 4, "height": 3, "count": 1, "dtype": "float32"}
    with rasterio.open(tmp_path / "a.tif", "w", **profile, **PLACE) as file:
        file.write(np.arange(12.0, dtype="float32").reshape(3, 4), 1)
    (tmp_path / "a.tif.aux.xml").write_text(
        '<PAMDataset><PAMRasterBand band="1"><Scale>-0.5</Scale><Offset>1300</Offset></PAMRasterBand></PAMDataset>'
    )
    facts = inspect(tmp_path / "a.tif")
    (band,) = facts["bands"]
    assert (band["scale"], band["offset"], band["scaled_by"]) == (-0.5, 1300.0, "a.tif.aux.xml")
    assert (band["min"], band["max"]) == (1294.5, 1300.0)
    assert facts["beside"] == ["a.tif.aux.xml"]
    assert "its numbers are scaled: x -0.5 + 1300 (a.tif.aux.xml)" in facts["terrain_notes"]


def test_scale_of_the_file_itself(tmp_path):
    profile = {"driver": "GTiff", "width": 4, "height": 3, "count": 1, "dtype": "int16"}
    with rasterio.open(tmp_path / "a.tif", "w", **profile, **PLACE) as file:
        file.write(np.arange(12, dtype="int16").reshape(3, 4), 1)
        file.scales, file.offsets = (0.1,), (1000.0,)
    facts = inspect(tmp_path / "a.tif")
    assert facts["bands"][0]["scaled_by"] == "" and "beside" not in facts
    assert facts["bands"][0]["max"] == pytest.approx(1001.1)


def test_a_terrain_with_a_pit_and_a_picture_have_notes(tmp_path):
    heights = 1500.0 - 4.66 * np.indices((100, 80))[0]
    heights[50:58, 36:44] = 0.0
    place = PLACE | {"transform": Affine(10, 0, 6e5, 0, -10, 5.2e6)}
    profile = {"driver": "GTiff", "width": 80, "height": 100, "count": 1}
    with rasterio.open(tmp_path / "pit.tif", "w", **profile, **place, dtype="float32") as file:
        file.write(heights.astype("float32"), 1)
    (note,) = inspect(tmp_path / "pit.tif")["terrain_notes"]
    assert "64 cells have the constant elevation 0 behind walls" in note and "--nodata 0" in note
    with rasterio.open(tmp_path / "picture.tif", "w", **profile, **place, dtype="uint8") as file:
        file.write((heights / 10).astype("uint8"), 1)
    assert "8-bit numbers" in inspect(tmp_path / "picture.tif")["terrain_notes"][0]


def nested(folder, levels, sources):
    profile = {"driver": "GTiff", "width": 60, "height": 80, "count": 1, "dtype": "float64"}
    with rasterio.open(folder / "dtm.tif", "w", **profile, **PLACE) as file:
        file.write(np.indices((80, 60))[0].astype(float), 1)
    inner = "dtm.tif"
    for level in range(levels):
        one = (
            f'<ComplexSource><SourceFilename relativeToVRT="1">{inner}</SourceFilename><SourceBand>1</SourceBand>'
            "</ComplexSource>"
        )
        inner = f"nest{level}.vrt"
        (folder / inner).write_text(
            '<VRTDataset rasterXSize="60" rasterYSize="80"><SRS>EPSG:32632</SRS>'
            '<GeoTransform>400000,1,0,5100000,0,-1</GeoTransform><VRTRasterBand dataType="Float64" band="1">'
            f"{one * sources}</VRTRasterBand></VRTDataset>"
        )
    return folder / inner


def test_nested_virtual_rasters_are_counted_before_they_are_read(tmp_path):
    """12^6 reads of one small file would take hours; 12^2 are done."""
    with pytest.raises(InputError, match=r"read files 2\.99e\+06 times"):
        inspect(nested(tmp_path, 6, 12))
    (band,) = inspect(nested(tmp_path, 2, 12))["bands"]
    assert (band["min"], band["max"]) == (0.0, 79.0)
    inspect(nested(tmp_path, 1, 1000))
