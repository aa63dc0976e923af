"""Operations between datums: their words, their refusal, and projections that are not true to scale."""

import numpy as np
import pyproj
import pytest
import rasterio
from affine import Affine

from mpmgis.system.errors import GeoreferenceError
from mpmgis.system.messages import collected
from mpmgis.terrain.datum_shift import transformer_to
from mpmgis.terrain.dtm import read_terrain
from mpmgis.terrain.georeference import is_true_to_scale

UNNAMED = (
    'PROJCS["GK",GEOGCS["GCS_User",DATUM["D_User_Defined",SPHEROID["{name}",{axis},{flattening}]],'
    'PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],'
    'PARAMETER["False_Easting",0.0],PARAMETER["False_Northing",-5000000.0],PARAMETER["Central_Meridian",16.333333],'
    'PARAMETER["Scale_Factor",1.0],PARAMETER["Latitude_Of_Origin",0.0],UNIT["Meter",1.0]]'
)
BESSEL = UNNAMED.format(name="Bessel_1841", axis=6377397.155, flattening=299.1528128)
HAYFORD = UNNAMED.format(name="International_1924", axis=6378388.0, flattening=297.0)
GRS_80 = UNNAMED.format(name="GRS_1980", axis=6378137.0, flattening=298.257222101)


@pytest.mark.parametrize("wkt", [BESSEL, HAYFORD])
@pytest.mark.parametrize("target", [25833, 32633, 31287])
def test_an_unknown_relation_of_datums_is_refused(wkt, target):
    with pytest.raises(GeoreferenceError, match=r"a\.shp is in GK.*D_User_Defined.*true CRS"):
        transformer_to(pyproj.CRS(wkt), pyproj.CRS(target), (-60_000.0, 260_000.0), "a.shp")


def test_an_unnamed_datum_on_the_same_ellipsoid_is_told():
    _, words = transformer_to(pyproj.CRS(GRS_80), pyproj.CRS(25833), (-60_000.0, 260_000.0), "a.shp")
    assert "count as the same" in words


@pytest.mark.parametrize(
    ("crs", "target", "place", "words"),
    [
        (31256, 25833, (-60_000.0, 260_000.0), ""),
        (25832, 32632, (600_000.0, 5_200_000.0), ""),
        (4326, 32632, (9.0, 47.0), ""),
        (2056, 25832, (2_600_000.0, 1_200_000.0), ""),
        (4267, 26911, (-120.0, 40.0), "by 'NAD27 to WGS 84"),
        (21781, 2056, (600_000.0, 200_000.0), "accurate to 1.6 m"),
        (4269, 32612, (-110.0, 40.0), "by 'NAD83 to WGS 84 (1)', accurate to 4 m"),
        (27700, 32630, (400_000.0, 400_000.0), "accurate to 2 m"),
    ],
)
def test_only_operations_worse_than_1_m_are_named(crs, target, place, words):
    """Accuracies of the EPSG registry, without grids."""
    transformer, said = transformer_to(pyproj.CRS(crs), pyproj.CRS(target), place, "a.shp")
    assert words in said and bool(words) == bool(said)
    assert np.isfinite(transformer.transform(*place)).all()


def dtm(path, epsg, longitude, latitude, shape=(9, 9)):
    east, north = pyproj.Transformer.from_crs(4326, epsg, always_xy=True).transform(longitude, latitude)
    profile = {"driver": "GTiff", "width": shape[1], "height": shape[0], "count": 1, "dtype": "float32"}
    with rasterio.open(path, "w", **profile, crs=f"EPSG:{epsg}", transform=Affine(10, 0, east, 0, -10, north)) as file:
        file.write(1000.0 + np.indices(shape)[0].astype("float32"), 1)
    return path


@pytest.mark.parametrize("latitude", [-60.0, -30.0, -9.0, 9.0, 30.0, 47.0, 70.0])
def test_mercator_is_refused_where_it_stretches_and_reprojected_by_auto(tmp_path, latitude):
    """k = 1 / cos(latitude): 1 % at 8.07 degrees."""
    path = dtm(tmp_path / "d.tif", 3857, 10.5, latitude)
    with pytest.raises(GeoreferenceError, match=r"EPSG:3857, which stretches lengths.*--to-crs auto \(EPSG:32"):
        read_terrain(path)
    terrain = read_terrain(path, to_crs="auto")
    assert terrain.grid.crs.to_epsg() == (32632 if latitude > 0 else 32732)
    assert terrain.grid.cell_size == pytest.approx(10.0 * np.cos(np.radians(latitude)), rel=0.02)


def test_mercator_near_the_equator_is_told(tmp_path):
    with collected() as said:
        read_terrain(dtm(tmp_path / "d.tif", 3857, 10.5, 5.0))
    assert any("stretches lengths here by up to" in line for line in said)


@pytest.mark.parametrize(("epsg", "longitude", "latitude"), [(32632, 10.5, 47), (2056, 8, 47), (3035, 10.5, 47)])
def test_usual_projections_stay(tmp_path, epsg, longitude, latitude):
    path = dtm(tmp_path / "d.tif", epsg, longitude, latitude)
    assert read_terrain(path).grid.crs.to_epsg() == epsg
    assert read_terrain(path, to_crs="auto").grid.crs.to_epsg() == epsg


def test_true_to_scale():
    assert is_true_to_scale(pyproj.CRS(32632), (5e5, 5.2e6, 5.1e5, 5.21e6))
    assert not is_true_to_scale(pyproj.CRS(3857), (1.1e6, 5.9e6, 1.11e6, 5.91e6))
