"""Undeclared nodata in every role of a raster: value x type x role x size x place."""

import numpy as np
import pytest
import rasterio
from affine import Affine

from mpmgis.system.errors import InputError
from mpmgis.system.messages import collected
from mpmgis.terrain.raster_input import read_raster
from mpmgis.terrain.undeclared_nodata import HEIGHTS, HUGE, MASK, NEGATIVE, PARAMETER, POSITIVE, RESULT, THICKNESS

ROLES = {"heights": HEIGHTS, "mask": MASK, "thickness": THICKNESS, "parameter": PARAMETER, "result": RESULT}
USUAL = {"heights": 1234.5, "mask": 1.0, "thickness": 1.5, "parameter": 0.3, "result": -2.5}
TYPES = ("float32", "float64", "int16", "int32", "uint16")
EXTREMES = (-3.4028235e38, 3.4028235e38, 1e20, -1e30, 9.969209968386869e36)
PLACES = {
    "corner": (slice(0, 1), slice(0, 1)),
    "edge": (slice(0, 3), slice(None)),
    "middle": (slice(4, 7), slice(5, 9)),
    "most": (slice(1, None), slice(1, None)),
}


def written(path, values, nodata=None, scale=None):
    rows, columns = values.shape
    profile = {"driver": "GTiff", "width": columns, "height": rows, "count": 1, "dtype": values.dtype}
    place = {"crs": "EPSG:32632", "transform": Affine(10, 0, 6e5, 0, -10, 5.2e6)}
    with rasterio.open(path, "w", **profile, **place, nodata=nodata) as file:
        file.write(values, 1)
        if scale:
            file.scales, file.offsets = scale[:1], scale[1:]
    return path


def fits(value, kind):
    if kind.startswith("float"):
        return True
    return np.iinfo(kind).min <= value <= np.iinfo(kind).max


@pytest.mark.parametrize("shape", [(8, 12), (120, 90)])
@pytest.mark.parametrize("kind", TYPES)
@pytest.mark.parametrize("role", ROLES)
def test_every_value_of_the_list_is_found_everywhere(tmp_path, role, kind, shape):
    """The cells with the value are NaN, the others keep theirs, and one line says how many and which value."""
    for value in (*NEGATIVE, *POSITIVE, *EXTREMES):
        kept = value in POSITIVE and not ROLES[role].positive
        if not fits(value, kind):
            continue
        for place in PLACES.values():
            values = np.full(shape, USUAL[role]).astype(kind)
            values[place] = value
            with collected() as said:
                read, _ = read_raster(written(tmp_path / "r.tif", values), ROLES[role])
            false = values == values.dtype.type(value)
            np.testing.assert_array_equal(np.isnan(read), false & (not kept))
            np.testing.assert_array_equal(read[~false], values[~false])
            if not kept:
                assert len(said) == 1
                assert f"{false.sum()} cells have the value" in said[0] and "not declared as nodata" in said[0]


@pytest.mark.parametrize("role", ROLES)
def test_usual_values_and_declared_nodata_say_nothing(tmp_path, role):
    values = np.full((9, 9), USUAL[role])
    values[0, 0] = -9999
    with collected() as said:
        read, _ = read_raster(written(tmp_path / "r.tif", values, nodata=-9999), ROLES[role])
    assert np.isnan(read).sum() == 1 and not said


@pytest.mark.parametrize("role", [name for name in ROLES if name != "mask"])
@pytest.mark.parametrize("value", [0.0, -1.0, -99.0, -999.0, 255.0, 998.0, HUGE / 2, -9998.0])
def test_other_values_are_kept(tmp_path, role, value):
    """They may be real: heights below the sea, a change of -99 m."""
    values = np.full((9, 9), USUAL[role])
    values[3:5] = value
    read, _ = read_raster(written(tmp_path / "r.tif", values), ROLES[role])
    np.testing.assert_array_equal(read, values)


def test_every_negative_value_of_a_mask_is_nodata(tmp_path):
    values = np.ones((9, 9))
    values[0], values[1], values[2], values[3], values[4] = -1, -99.5, -9999.9, -128, -7
    with collected() as said:
        read, _ = read_raster(written(tmp_path / "r.tif", values), MASK)
    assert np.isnan(read[:5]).all() and (read[5:] == 1).all()
    assert len(said) == 4 and "18 more cells have values from -7 to -1" in said[3]


def test_stored_value_of_a_scaled_raster(tmp_path):
    """-9999 stored under a scale of 0.1 and an offset of 1000 would be 0.1 m of elevation."""
    values = np.full((9, 9), 2500, np.int16)
    values[4, 4] = -9999
    with collected() as said:
        read, _ = read_raster(written(tmp_path / "r.tif", values, scale=(0.1, 1000.0)), HEIGHTS)
    assert np.isnan(read[4, 4]) and read[0, 0] == pytest.approx(1250.0)
    assert any("its numbers are scaled: x 0.1 + 1000" in line for line in said)
    assert any("1 cells have the value -9999" in line for line in said)


def test_nothing_else_than_undeclared_nodata_is_an_error(tmp_path):
    with pytest.raises(InputError, match="every cell is nodata"):
        read_raster(written(tmp_path / "r.tif", np.full((9, 9), -9999.0)), THICKNESS)
