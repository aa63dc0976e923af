"""Inputs that the fuzzer found, a test for each kind: they end in a line, and nothing else is said."""

import struct

import geopandas
import h5py
import numpy as np
import pyproj
import pytest
import rasterio
import shapely
from affine import Affine
from rasterio._err import CPLE_AppDefinedError
from refusals import refusal

from mpmgis.commands.shell.main import main
from mpmgis.results.comparison import difference
from mpmgis.system.errors import FormatError
from mpmgis.terrain.raster_input import open_raster


@pytest.fixture
def site(tmp_path):
    """A sound DTM of 1.2 x 1.2 km with a note of GDAL's in it, and a release on it."""
    write_dtm(tmp_path / "dtm.tif")
    write_shapes(tmp_path / "release.geojson", shapely.box(400_100, 5_099_100, 400_300, 5_099_300))
    return tmp_path


def write_dtm(path, pixel=10.0, **layout):
    profile = {
        "driver": "GTiff",
        "height": 120,
        "width": 120,
        "count": 1,
        "dtype": "float64",
        "crs": "EPSG:32632",
        "transform": Affine(pixel, 0, 4e5, 0, -10, 5.1e6),
        **layout,
    }
    with rasterio.open(path, "w", **profile) as target:
        target.write(np.add.outer(np.arange(120.0), np.arange(120.0)) + 100, 1)
        target.update_tags(note="elevation")


def write_shapes(path, shape):
    geopandas.GeoDataFrame({"d0": [1.0]}, geometry=[shape], crs="EPSG:32632").to_file(path)


def test_a_message_that_is_not_utf8_is_not_printed(site, capfd):
    """GDAL quotes the file's own bytes; rasterio printed a traceback because it could not decode them."""
    path = site / "dtm.tif"
    raw = path.read_bytes()
    start = raw.index(b"<GDALMetadata>")
    path.write_bytes(raw[:start] + b"<GDAL\x94etadata>" + raw[start + 14 :])
    assert main(["info", str(path), "-q"]) == 0
    out, err = capfd.readouterr()
    assert "raster" in out and err == ""


@pytest.mark.parametrize("big", [False, True])
def test_a_directory_beyond_the_end_is_one_line(site, big, capfd):
    """libtiff writes to stderr by itself when it cannot seek there."""
    path = site / "dtm.tif"
    write_dtm(path, BIGTIFF="YES" if big else "NO")
    raw = bytearray(path.read_bytes())
    struct.pack_into("<Q" if big else "<I", raw, 8 if big else 4, 1 << 60 if big else 0xFFFFFFF0)
    path.write_bytes(raw)
    assert "its directory is at byte" in refusal(capfd, "info", path)


@pytest.mark.parametrize("pixel", [1e-300, 1e300])
def test_pixels_of_no_size_are_refused(site, pixel, capfd):
    write_dtm(site / "thick.tif", pixel)
    words = ["--release", site / "release.geojson", "-o", site / "a.h5"]
    assert "invalid georeference" in refusal(capfd, "seed", "--dem", site / "thick.tif", *words)
    assert "invalid georeference" in refusal(
        capfd, "seed", "--dem", site / "dtm.tif", *words, "--thickness", site / "thick.tif"
    )


def test_late_errors_of_gdal_are_one_line(site):
    """A georeference whose text was cut: rasterio raised GDAL's word where it was asked for the band's colours."""
    said = "Key GTCitationGeoKey is of type ASCII but GeoAsciiParams is missing or corrupted."
    with pytest.raises(FormatError, match=r"is damaged.*GeoAsciiParams"), open_raster(site / "dtm.tif"):
        raise CPLE_AppDefinedError(1, 1, said)


@pytest.mark.parametrize("far", [1e300, -1e300, 1e10])
def test_coordinates_beyond_any_map_are_refused(site, far, capfd):
    """They became a lattice of a negative number of rows, and a wall without length."""
    write_shapes(site / "far.gpkg", shapely.Polygon([(4e5, 5.1e6), (far, 5.1e6), (4e5, 5.099e6)]))
    line = refusal(capfd, "seed", "--dem", site / "dtm.tif", "--release", site / "far.gpkg", "-o", site / "a.h5")
    assert "expected below 1e+09" in line


def test_a_crs_of_another_planet_is_refused(site, capfd):
    """PROJ finds no way from there, and pyproj raised its own error."""
    sphere = pyproj.CRS.from_proj4("+proj=utm +zone=32 +a=2147483648 +b=2147483000 +units=m")
    table = geopandas.read_file(site / "release.geojson").set_crs(sphere, allow_override=True)
    table.to_file(site / "moon.gpkg")
    words = ["seed", "--dem", site / "dtm.tif", "--release", site / "moon.gpkg", "-o", site / "a.h5"]
    assert "cannot be reprojected to" in refusal(capfd, *words)
    write_dtm(site / "thick.tif", crs=sphere.to_wkt())
    words = ["seed", "--dem", site / "dtm.tif", "--release", site / "release.geojson", "-o", site / "a.h5"]
    assert "cannot be reprojected to" in refusal(capfd, *words, "--thickness", site / "thick.tif")


def test_columns_beside_the_terrain_are_refused(site, capfd):
    """A frame that has lost its origin: the bed under its columns was read where there is no memory."""
    words = ["seed", "--dem", site / "dtm.tif", "--release", site / "release.geojson", "-q", "-o", site / "seed.h5"]
    assert main([*map(str, words)]) == 0
    with h5py.File(site / "seed.h5", "r+") as file:
        del file.attrs["origin"]
    (site / "scene.toml").write_text(
        '[terrain]\ndem = "dtm.tif"\n[release]\nparticles = "seed.h5"\n[output]\nend_time = 1\nframe_interval = 1\n'
    )
    assert "lie outside the terrain" in refusal(capfd, "effects", site / "scene.toml")


def test_differences_of_any_size_are_reported():
    told = difference(np.full((2, 2), 1e300), np.zeros((2, 2)), np.ones((2, 2), bool))
    assert told.mean == pytest.approx(1e300) and told.rms == np.inf


def test_a_raster_at_infinity_is_refused(site, capfd):
    """Pixels so wide that the corners overflow: NumPy warned, and the extent was infinite."""
    write_dtm(site / "far.tif", pixel=1e308)
    assert "corners are not finite" in refusal(capfd, "info", site / "far.tif")
