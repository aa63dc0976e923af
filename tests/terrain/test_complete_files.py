"""Files that end early: driver x type x what is left. GDAL reads 0 there, a terrain or a mask of its own."""

import netCDF4
import numpy as np
import pytest
import rasterio
import rasterio.shutil
from rasterio.transform import from_origin

from mpmgis.system.errors import FormatError
from mpmgis.terrain.raster_input import read_raster
from mpmgis.terrain.undeclared_nodata import HEIGHTS

ROWS, COLUMNS = 40, 30
PLACE = {"width": COLUMNS, "height": ROWS, "count": 1, "crs": "EPSG:32632", "transform": from_origin(4e5, 5e6, 10, 10)}
NAMES = {
    "EHdr": "a.bil",
    "ENVI": "a.dat",
    "SAGA": "a.sdat",
    "GSBG": "a.grd",
    "GS7BG": "a.grd",
    "AAIGrid": "a.asc",
    "GSAG": "a.grd",
    "HFA": "a.img",
    "GTiff": "a.tif",
    "XYZ": "a.xyz",
}
TYPES = ("float32", "int16")
VALUES = 1000.0 + np.arange(ROWS * COLUMNS).reshape(ROWS, COLUMNS)


@pytest.mark.parametrize("kind", TYPES)
@pytest.mark.parametrize("driver", NAMES)
def test_a_file_that_ends_early_is_refused(tmp_path, driver, kind):
    """Whole, it has its values; cut anywhere it has an error in one line, or no false value."""
    path = tmp_path / NAMES[driver]
    with rasterio.open(tmp_path / "source.tif", "w", driver="GTiff", dtype=kind, **PLACE) as target:
        target.write(VALUES.astype(kind), 1)
    try:
        rasterio.shutil.copy(str(tmp_path / "source.tif"), str(path), driver=driver)
    except rasterio.errors.RasterioError:
        pytest.skip("the driver does not write this type")
    np.testing.assert_array_equal(read_raster(path, HEIGHTS)[0], VALUES)
    whole = path.read_bytes()
    for share in (0.02, 0.3, 0.5, 0.9, 0.97):
        path.write_bytes(whole[: int(share * len(whole))])
        try:
            values, _ = read_raster(path, HEIGHTS)
        except FormatError as error:
            assert "\n" not in str(error) and "previous exception" not in str(error)
        else:
            if driver == "XYZ":  # has the points before the end, the last perhaps with fewer digits
                assert np.count_nonzero(values[np.isfinite(values)] < 1000) <= 1
            else:
                np.testing.assert_array_equal(values, VALUES)


@pytest.mark.parametrize("form", ["NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF4"])
@pytest.mark.parametrize("kind", ["f4", "f8", "i2"])
@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize("record", [False, True])
def test_netcdf_that_ends_early(tmp_path, form, kind, after, record):
    path = tmp_path / "a.nc"
    with netCDF4.Dataset(path, "w", format=form) as file:
        file.createDimension("y", None if record else ROWS)
        file.createDimension("x", COLUMNS)
        x, y = 4e5 + 10.0 * np.arange(COLUMNS), 5e6 - 10.0 * np.arange(ROWS)
        names = ("dem", "x", "y") if after else ("x", "y", "dem")
        made = {name: ("y", "x") if name == "dem" else (name,) for name in names}
        for name, of in made.items():
            file.createVariable(name, kind if name == "dem" else "f8", of)
            file[name].units = "m"
        for name in "xy":
            file[name].standard_name = f"projection_{name}_coordinate"
        file["x"][:], file["y"][:], file["dem"][:] = x, y, VALUES
    np.testing.assert_array_equal(read_raster(path, HEIGHTS)[0], VALUES)
    whole = path.read_bytes()
    for left in (len(whole) // 3, len(whole) - 1000, len(whole) - 8):
        path.write_bytes(whole[:left])
        with pytest.raises(FormatError, match="truncated"):
            read_raster(path, HEIGHTS)


@pytest.mark.parametrize("driver", ["AAIGrid", "EHdr"])
def test_a_header_alone_that_declares_a_huge_grid(tmp_path, driver):
    """In milliseconds, not after a search for its numbers."""
    path = tmp_path / NAMES[driver]
    if driver == "AAIGrid":
        path.write_text("ncols 100000\nnrows 100000\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 1\n")
    else:
        (tmp_path / "a.hdr").write_text("ncols 100000\nnrows 100000\nnbits 32\npixeltype float\nlayout bil\n")
        path.write_bytes(bytes(100))
    with pytest.raises(FormatError, match="truncated"):
        read_raster(path, HEIGHTS)
