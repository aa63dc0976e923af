"""Masks, ids of areas and thickness in rasters of a release: value x type x size, with the right area and volume."""

import numpy as np
import pytest
from seed_sites import PIXELS, write_dtm, write_raster

from mpmgis.seeding.release_areas import read_outlines, read_release
from mpmgis.system.errors import InputError
from mpmgis.system.messages import collected
from mpmgis.terrain.dtm import read_terrain
from mpmgis.terrain.mask_values import FEW, is_mask

NORTH_UP = PIXELS["north_up"]
CELL_AREA = 25.0
OUTSIDE = {
    "float32": (0.0, -9999.0, -3.4028235e38, 3.4028235e38, 1e20, -1.0, -999.0, -9999.9, 9999.0, 1e-30, np.nan),
    "int16": (0, -9999, -32768, 32767, -1, -999, 9999),
    "uint8": (0,),
    "uint16": (0, 65535, 9999),
}


@pytest.fixture(scope="module")
def terrain(tmp_path_factory):
    return read_terrain(write_dtm(tmp_path_factory.mktemp("dtm") / "dtm.tif", angle=0.0))


def raster(tmp_path, outside, inside, kind, **options):
    values = np.full((60, 60), outside, kind)
    values[20:28, 25:35] = inside
    return write_raster(tmp_path / "m.tif", values, NORTH_UP, **options)


@pytest.mark.parametrize("inside", [1, 2, 100, 255, 0.5])
@pytest.mark.parametrize("kind", OUTSIDE)
def test_a_mask_is_what_is_inside(tmp_path, terrain, kind, inside):
    """80 cells, whatever stands outside; 1.5 m on 2000 m2."""
    if kind != "float32" and (inside != int(inside) or (kind == "int16" and inside > 32767)):
        pytest.skip("not a number of this type")
    for outside in OUTSIDE[kind]:
        path = raster(tmp_path, outside, inside, kind)
        with collected() as said:
            release = read_release(path, terrain, 1.5)
        assert release.area == pytest.approx(80 * CELL_AREA), outside
        assert [part.thickness for part in release.parts] == [1.5]
        assert any(f"a mask with the value {inside:g} in 80 of 3600 cells" in line for line in said)
        assert outside in (0, 1e-30) or np.isnan(outside) or any("not declared as nodata" in line for line in said)
        (outline,) = read_outlines(path, terrain)
        assert outline.area == pytest.approx(80 * CELL_AREA)


@pytest.mark.parametrize("inside", [1, 255, 2, 7])
@pytest.mark.parametrize("kind", OUTSIDE)
def test_a_mask_without_a_thickness_is_refused(tmp_path, terrain, kind, inside):
    for outside in OUTSIDE[kind]:
        if outside in (-1, -999, -9999.9):  # negative thicknesses have an error of their own
            continue
        with pytest.raises(InputError, match=rf"only 0 and {inside}, i.e. a mask or ids.*give --thickness"):
            read_release(raster(tmp_path, outside, inside, kind), terrain)


@pytest.mark.parametrize("kind", ["uint8", "int32", "float64"])
def test_each_id_is_one_area(tmp_path, terrain, kind):
    ids = np.zeros((60, 60), kind)
    ids[10:14, 10:20], ids[30:36, 20:30], ids[50:52, 40:44] = 1, 2, 7
    path = write_raster(tmp_path / "ids.tif", ids, NORTH_UP)
    with pytest.raises(InputError, match=r"only 0 and 1, 2, 7, i\.e\. a mask or ids"):
        read_release(path, terrain)
    release = read_release(path, terrain, 2.0)
    assert release.area == pytest.approx((40 + 60 + 8) * CELL_AREA)
    assert "ids 1, ids 2, ids 7" in release.parts[0].name
    thickness = write_raster(tmp_path / "t.tif", np.where(ids > 1, 1.25, 0.0), NORTH_UP)
    with pytest.raises(InputError, match="release 'ids 1' has zero thickness everywhere"):
        read_release(path, terrain, thickness)


def test_metres_are_declared_by_giving_the_raster_twice(tmp_path, terrain):
    path = raster(tmp_path, 0, 3, "int16")
    (part,) = read_release(path, terrain, path).parts
    assert np.nanmax(part.thickness.values) == 3.0 and part.polygon.area == pytest.approx(80 * CELL_AREA)
    with pytest.raises(InputError, match=r"only 0 and 255, i\.e\. a mask"):
        read_release(path, terrain, raster(tmp_path, 0, 255, "uint8"))


def test_classes_without_an_outside_are_refused(tmp_path, terrain):
    for outside in (2, 255):
        with pytest.raises(InputError, match=rf"values 1, {outside} leave no cell outside"):
            read_release(raster(tmp_path, outside, 1, "uint8"), terrain, 1.5)
    release = read_release(raster(tmp_path, 2, 1, "uint8", nodata=2), terrain, 1.5)
    assert release.area == pytest.approx(80 * CELL_AREA)


def test_a_mask_of_more_than_half_is_told(tmp_path, terrain):
    with collected() as said:
        read_release(raster(tmp_path, 1, 0, "uint8"), terrain, 1.5)
    assert any("in 3520 of 3600 cells; more than half" in line for line in said)


@pytest.mark.parametrize("value", [1.5, 0.3, 80.25])
@pytest.mark.parametrize("outside", OUTSIDE["float32"])
def test_one_thickness_everywhere_is_metres(tmp_path, terrain, value, outside):
    if outside in (-1.0, -999.0, -9999.9):
        with pytest.raises(InputError, match=rf"thickness is {outside:g} in 3520 cells.*declare the nodata value"):
            read_release(raster(tmp_path, outside, value, "float32"), terrain)
        return
    with collected() as said:
        (part,) = read_release(raster(tmp_path, outside, value, "float32"), terrain).parts
    assert part.polygon.area == pytest.approx(80 * CELL_AREA)
    assert np.nanmax(part.thickness.values) == pytest.approx(value)
    assert any(f"thickness in metres, {value:.4g} to {value:.4g} in 80 cells" in line for line in said)


def test_many_whole_numbers_are_metres(tmp_path, terrain):
    values = np.zeros((60, 60), np.int16)
    values[10:40, 10:40] = 3 + np.arange(30)
    (part,) = read_release(write_raster(tmp_path / "t.tif", values, NORTH_UP), terrain).parts
    assert np.nanmax(part.thickness.values) == 32


@pytest.mark.parametrize("count", [1, 2, FEW, FEW + 1, 500])
def test_few_whole_numbers_are_a_mask(count):
    values = np.repeat(np.arange(1.0, count + 1), 40)
    assert is_mask(values) == (count <= FEW)
    assert not is_mask(values + 0.25)


@pytest.mark.parametrize("thick", [1000.5, 4999.75, 8000.25])
def test_more_than_1000_m_is_refused(tmp_path, terrain, thick):
    with pytest.raises(InputError, match="at most 1000 metres"):
        read_release(raster(tmp_path, 0.0, thick, "float64"), terrain)
    with pytest.raises(InputError, match="at most 1000 metres"):
        read_release(raster(tmp_path, 0, 1, "uint8"), terrain, thick)
    mask = raster(tmp_path, 0, 1, "uint8").rename(tmp_path / "mask.tif")
    with pytest.raises(InputError, match="at most 1000 metres"):
        read_release(mask, terrain, raster(tmp_path, 0.0, thick, "float64"))
    with pytest.raises(InputError, match="at most 1000 metres"):
        read_release(mask, terrain, surface=raster(tmp_path, 1500.0, 1500.0 + thick, "float64"))


@pytest.mark.parametrize("outside", OUTSIDE["float32"][1:])
def test_a_surface_is_the_same_whatever_is_outside(tmp_path, terrain, outside):
    """The surface is known in 30 x 40 cells around the release, 2 m above the bed at 1500 m, vertical."""
    if outside in (-1.0, -999.0, -9999.9, 1e-30):
        pytest.skip("may be an elevation; below the bed it is clipped and reported")
    bed = terrain.elevation[0, 0]
    surface = np.full((60, 60), outside, np.float32)
    surface[10:40, 10:50] = bed + 2.0
    mask = raster(tmp_path, 0, 1, "uint8")
    with collected() as said:
        release = read_release(mask, terrain, surface=write_raster(tmp_path / "s.tif", surface, NORTH_UP))
    (part,) = release.parts
    assert part.polygon.area == pytest.approx(80 * CELL_AREA)
    assert np.nanmax(part.thickness.values) == pytest.approx(2.0, rel=1e-5)
    assert np.isnan(outside) or any("not declared as nodata" in line for line in said)
