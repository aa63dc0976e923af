"""Releases in: every vector format, rasters, repair, overlap, CRS, thickness."""

import geopandas
import numpy as np
import pyproj
import pytest
import rasterio
import shapely
from affine import Affine
from seed_sites import CENTRE, EAST, NORTH, PIXELS, ring, two_islands, write_dtm, write_raster

from mpmgis.seeding.column_seeding import seed_columns
from mpmgis.seeding.release_areas import read_release
from mpmgis.system.errors import FormatError, GeoreferenceError, InputError
from mpmgis.system.messages import collected
from mpmgis.terrain.dtm import read_terrain
from mpmgis.terrain.release_parts import ThicknessRaster

X, Y = CENTRE


@pytest.fixture(scope="module")
def terrain(tmp_path_factory):
    return read_terrain(write_dtm(tmp_path_factory.mktemp("dtm") / "dtm.tif"))


def features(*polygons, crs="EPSG:32632", **columns):
    return geopandas.GeoDataFrame(columns, geometry=list(polygons), crs=crs)


@pytest.mark.parametrize(
    "name", ["a.shp", "a.gpkg", "a.geojson", "a.fgb", "a.parquet", "a.shp.zip", "a.kml", "a.gml", "a.sqlite"]
)
def test_vector_formats(tmp_path, terrain, name):
    """Holes and islands come through; KML is in degrees by nature and comes back by reprojection."""
    table = features(two_islands(), thickness=[2.5], name=["slab"])
    if name.endswith(".parquet"):
        table.to_parquet(tmp_path / name)
    elif name.endswith(".zip"):
        table.to_file(tmp_path / name, driver="ESRI Shapefile")
    elif name.endswith(".kml"):
        table.to_crs(4326).to_file(tmp_path / name, driver="KML")
    else:
        table.to_file(tmp_path / name, driver="SQLite" if name.endswith(".sqlite") else None)
    thickness = 2.5 if name.endswith(".kml") else None
    with collected() as said:
        release = read_release(tmp_path / name, terrain, thickness)
    (part,) = release.parts
    assert part.polygon.area == pytest.approx(two_islands().area, rel=1e-5 if name.endswith(".kml") else 1e-9)
    assert len(shapely.get_rings(shapely.get_parts(part.polygon))) == 3
    assert part.thickness == 2.5
    assert len(release.sha256) == 64
    assert any("thickness" in line for line in said) or thickness


def test_another_crs_is_reprojected_and_reported(tmp_path, terrain):
    features(ring(), thickness=[2.0]).to_crs(2056).to_file(tmp_path / "a.gpkg")
    with collected() as said:
        release = read_release(tmp_path / "a.gpkg", terrain)
    assert release.area == pytest.approx(ring().area, rel=1e-6)
    assert any("EPSG:2056" in line and "EPSG:32632" in line for line in said)


def test_no_crs_is_assumed_where_the_coordinates_lie(tmp_path, terrain):
    features(ring(), crs=None, thickness=[2.0]).to_file(tmp_path / "a.shp")
    with collected() as said:
        assert read_release(tmp_path / "a.shp", terrain).area == pytest.approx(ring().area)
    assert any("no CRS" in line and "EPSG:32632" in line for line in said)
    far = shapely.affinity.translate(ring(), -EAST + 9.0, -NORTH + 46.0)
    features(far, crs=None, thickness=[2.0]).to_file(tmp_path / "b.shp")
    with pytest.raises(GeoreferenceError, match="no CRS"):
        read_release(tmp_path / "b.shp", terrain)


def test_columns_of_thickness(tmp_path, terrain):
    west, east = shapely.box(X - 40, Y, X, Y + 30), shapely.box(X, Y, X + 40, Y + 30)
    features(west, east, D0=[1.0, 2.0], other=[5.0, 6.0], note=["a", "b"]).to_file(tmp_path / "a.gpkg")
    with collected() as said:
        release = read_release(tmp_path / "a.gpkg", terrain)
    assert [part.thickness for part in release.parts] == [1.0, 2.0]
    assert any("'D0'" in line for line in said)
    assert [p.thickness for p in read_release(tmp_path / "a.gpkg", terrain, "other").parts] == [5.0, 6.0]
    assert [p.thickness for p in read_release(tmp_path / "a.gpkg", terrain, "3.5").parts] == [3.5]
    with pytest.raises(InputError, match=r"othr.*did you mean 'other'"):
        read_release(tmp_path / "a.gpkg", terrain, "othr")
    with pytest.raises(InputError, match=r"text.*expected numbers"):
        read_release(tmp_path / "a.gpkg", terrain, "note")


def test_first_of_the_usual_columns_wins(tmp_path, terrain):
    features(ring(), relth=[3.0], d0=[2.0], thickness=[1.0]).to_file(tmp_path / "a.gpkg")
    assert read_release(tmp_path / "a.gpkg", terrain).parts[0].thickness == 1.0
    features(ring(), relth=[3.0], d0=[2.0]).to_file(tmp_path / "b.gpkg")
    assert read_release(tmp_path / "b.gpkg", terrain).parts[0].thickness == 2.0


def test_overlap_of_different_thickness_is_refused_by_name(tmp_path, terrain):
    first, second = shapely.box(X - 40, Y, X + 5, Y + 30), shapely.box(X, Y, X + 40, Y + 30)
    features(first, second, name=["upper", "lower"], d0=[1.0, 2.0]).to_file(tmp_path / "a.gpkg")
    with pytest.raises(InputError, match=r"'upper' and 'lower' overlap by 150 m2"):
        read_release(tmp_path / "a.gpkg", terrain)


def test_overlap_of_one_thickness_is_counted_once(tmp_path, terrain):
    first, second = shapely.box(X - 40, Y, X + 5, Y + 30), shapely.box(X, Y, X + 40, Y + 30)
    features(first, second, d0=[2.0, 2.0]).to_file(tmp_path / "a.gpkg")
    with collected() as said:
        release = read_release(tmp_path / "a.gpkg", terrain, thickness_mode="vertical")
    assert release.area == pytest.approx(80 * 30)
    assert any("overlap" in line for line in said)
    assert seed_columns(terrain, release).particles.volume.sum() == pytest.approx(2 * 80 * 30)


def test_neighbours_share_a_border_without_overlap(tmp_path, terrain):
    """Borders digitised twice along a slanted line: rounding is no overlap."""
    a = shapely.Polygon([(X - 30, Y - 20), (X + 10, Y - 20), (X + 13.37, Y + 21.13), (X - 30, Y + 20)])
    b = shapely.Polygon([(X + 10, Y - 20), (X + 40, Y - 20), (X + 40, Y + 20), (X + 13.37, Y + 21.13)])
    features(a, b, d0=[1.0, 2.0]).to_file(tmp_path / "a.gpkg")
    release = read_release(tmp_path / "a.gpkg", terrain, thickness_mode="vertical")
    volume = seed_columns(terrain, release).particles.volume.sum()
    assert volume == pytest.approx(a.area + 2 * b.area, rel=1e-9)


def test_invalid_polygons_are_repaired_and_reported(tmp_path, terrain):
    """H18: a bow-tie keeps both its wings, overlapping islands are united."""
    bow = shapely.Polygon([(X, Y), (X + 20, Y + 20), (X + 20, Y), (X, Y + 20)])
    islands = shapely.MultiPolygon(
        [shapely.box(X - 50, Y, X - 30, Y + 20), shapely.box(X - 40, Y + 10, X - 20, Y + 30)]
    )
    features(bow, islands, d0=[1.0, 1.0]).to_file(tmp_path / "a.gpkg")
    with collected() as said:
        release = read_release(tmp_path / "a.gpkg", terrain)
    assert release.area == pytest.approx(200.0 + 700.0)
    assert sum("repaired" in line for line in said) == 2


def test_layers_are_named(tmp_path, terrain):
    for layer, polygon in (("one", ring()), ("two", ring(20, 5))):
        features(polygon, d0=[1.0]).to_file(tmp_path / "a.gpkg", layer=layer)
    with pytest.raises(InputError, match=r"2 layers.*one, two.*layername=one"):
        read_release(tmp_path / "a.gpkg", terrain)
    release = read_release(f"{tmp_path / 'a.gpkg'}|layername=two", terrain)
    assert release.area == pytest.approx(ring(20, 5).area)


def test_points_and_lines_are_refused(tmp_path, terrain):
    features(shapely.LineString(ring().exterior.coords), d0=[1.0]).to_file(tmp_path / "l.gpkg")
    features(shapely.Point(X, Y), d0=[1.0]).to_file(tmp_path / "p.gpkg")
    for name, kind in (("l", "LineString"), ("p", "Point")):
        with pytest.raises(InputError, match=f"contains {kind}, expected polygons"):
            read_release(tmp_path / f"{name}.gpkg", terrain)


def test_a_release_outside_the_terrain_reports_distance_and_place(tmp_path, terrain):
    features(shapely.box(EAST + 250, NORTH + 100, EAST + 640, NORTH + 140), name=["A2"], d0=[1.0]).to_file(
        tmp_path / "a.gpkg"
    )
    with pytest.raises(InputError, match=r"release 'A2' leaves the terrain by 340 m to the east"):
        read_release(tmp_path / "a.gpkg", terrain)
    features(shapely.affinity.translate(ring(), 0, -20_000), d0=[1.0]).to_file(tmp_path / "b.gpkg")
    with pytest.raises(InputError, match=r"outside the terrain.*km to the south"):
        read_release(tmp_path / "b.gpkg", terrain)


def mask(shape=(60, 60)):
    values = np.zeros(shape)
    values[20:30, 15:40] = 1
    values[24:26, 20:22] = 0
    return values


def test_a_mask_raster_is_a_union_of_pixel_squares(tmp_path, terrain):
    """No contour through pixel centres, the hole is kept."""
    path = write_raster(tmp_path / "m.tif", mask().astype(np.uint8), PIXELS["north_up"])
    with pytest.raises(InputError, match=r"only 0 and 1.*--thickness"):
        read_release(path, terrain)
    release = read_release(path, terrain, 2.0, "vertical")
    assert release.area == pytest.approx((250 - 4) * 25, rel=1e-12)
    frame = seed_columns(terrain, release)
    assert frame.particles.volume.sum() == pytest.approx((250 - 4) * 25 * 2.0, rel=1e-12)
    assert len(frame.particles) == (250 - 4) * 16


def test_a_thickness_raster_holds_metres(tmp_path, terrain):
    values = mask() * np.linspace(0.5, 2.5, 60)
    values[values == 0] = -9999
    path = write_raster(tmp_path / "t.tif", values, PIXELS["north_up"], nodata=-9999)
    with collected() as said:
        release = read_release(path, terrain, thickness_mode="vertical")
    assert any("metres" in line for line in said)
    frame = seed_columns(terrain, release)
    assert frame.particles.volume.sum() == pytest.approx(values[values > 0].sum() * 25, rel=1e-12)
    with pytest.raises(InputError, match="no columns"):
        read_release(path, terrain, "d0")


def test_thickness_of_polygons_from_a_raster(tmp_path, terrain):
    """Only ground with thickness holds mass; what is left out is said; the sum is that of the pixels."""
    values = np.zeros((60, 60))
    values[:, :30] = 1.5
    write_raster(tmp_path / "t.tif", values, PIXELS["north_up"])
    features(shapely.box(X - 40, Y - 20, X + 40, Y + 20), name=["a"]).to_file(tmp_path / "a.gpkg")
    with collected() as said:
        release = read_release(tmp_path / "a.gpkg", terrain, tmp_path / "t.tif", "vertical")
    assert release.area == pytest.approx(40 * 40)
    assert any("without thickness" in line for line in said)
    assert isinstance(release.parts[0].thickness, ThicknessRaster)
    assert seed_columns(terrain, release).particles.volume.sum() == pytest.approx(1.5 * 1600, rel=1e-12)


def test_surface_minus_bed(tmp_path, terrain):
    """Vertical, clipped at 0, count and volume of what was clipped are said and recorded."""
    level = float(terrain.sample(X, Y)) + 4.0
    write_raster(tmp_path / "s.tif", np.full((60, 60), level), PIXELS["north_up"])
    features(shapely.box(X - 30, Y - 20, X + 30, Y + 20)).to_file(tmp_path / "a.gpkg")
    with collected() as said:
        release = read_release(tmp_path / "a.gpkg", terrain, surface=tmp_path / "s.tif")
    assert release.thickness_mode == "vertical"
    assert release.record["clipped_cells"] > 0 and release.record["clipped_volume"] > 0
    assert any("clipped" in line for line in said)
    frame = seed_columns(terrain, release, per_cell=64)
    top = frame.particles.position[:, 2] + frame.particles.thickness
    inner = frame.particles.thickness > 4.0
    np.testing.assert_allclose(top[inner], level, atol=0.01)
    fine = np.arange(0.05, 60, 0.1) - 30
    gx, gy = np.meshgrid(X + fine, Y + fine[100:500])
    exact = np.clip(level - terrain.sample(gx, gy), 0, None).sum() * 0.01
    assert frame.particles.volume.sum() == pytest.approx(exact, rel=2e-4)


def test_surface_on_another_grid(tmp_path, terrain):
    """A coarser surface is met on the DTM's grid, a finer one on its own: both give the same slab."""
    for name, transform, shape in (
        ("coarse", Affine(15, 0, EAST, 0, -15, NORTH + 300), (20, 20)),
        ("fine", Affine(2.5, 0, EAST, 0, -2.5, NORTH + 300), (120, 120)),
    ):
        rows, columns = np.indices(shape)
        xs, ys = transform * (columns + 0.5, rows + 0.5)
        write_raster(tmp_path / f"{name}.tif", terrain.sample(xs, ys) + 3.0, transform)
        features(ring()).to_file(tmp_path / "a.gpkg")
        release = read_release(tmp_path / "a.gpkg", terrain, surface=tmp_path / f"{name}.tif")
        assert seed_columns(terrain, release).particles.volume.sum() == pytest.approx(3 * ring().area, rel=1e-9)


def test_rasters_of_another_crs_are_placed(tmp_path, terrain):
    """A thickness raster in EPSG:25833 and one in degrees lie where they should, their volume within 0.1 %."""
    for crs, cell in (("EPSG:25833", 5.0), ("EPSG:4326", 5e-5)):
        forward = pyproj.Transformer.from_crs("EPSG:32632", crs, always_xy=True)
        x, y = forward.transform(X, Y)
        transform = Affine(cell, 0, x - 20 * cell, 0, -cell, y + 20 * cell)
        rows, columns = np.indices((40, 40))
        back = pyproj.Transformer.from_crs(crs, "EPSG:32632", always_xy=True)
        px, py = back.transform(*(transform * (columns + 0.5, rows + 0.5)))
        values = np.where((px - X) ** 2 + (py - Y) ** 2 < 50**2, 2.5, 0.0)
        path = write_raster(tmp_path / "t.tif", values, transform, crs)
        with collected() as said:
            release = read_release(path, terrain, thickness_mode="vertical")
        assert any("transformed from" in line for line in said)
        frame = seed_columns(terrain, release)
        assert frame.particles.volume.sum() == pytest.approx(2.5 * np.pi * 50**2, rel=0.03)
        mx, my = frame.map_xy()
        np.testing.assert_allclose([mx.mean() - X, my.mean() - Y], 0.0, atol=0.6)


def test_mask_on_a_rotated_raster(tmp_path, terrain):
    transform = Affine.translation(X - 30, Y + 20) * Affine.rotation(25) * Affine.scale(4, -2)
    path = write_raster(tmp_path / "m.tif", np.ones((10, 8), np.uint8), transform)
    release = read_release(path, terrain, 1.0, "vertical")
    assert release.area == pytest.approx(10 * 8 * 8.0, rel=1e-10)
    assert seed_columns(terrain, release).particles.area.sum() == pytest.approx(640.0, rel=1e-10)


def test_both_files_in_a_local_frame(tmp_path):
    terrain = read_terrain(write_dtm(tmp_path / "d.tif", crs=None), crs="local")
    features(ring(), crs=None, d0=[1.0]).to_file(tmp_path / "a.gpkg")
    assert read_release(tmp_path / "a.gpkg", terrain).area == pytest.approx(ring().area)
    features(ring(), d0=[1.0]).to_file(tmp_path / "b.gpkg")
    with collected() as said:
        read_release(tmp_path / "b.gpkg", terrain)
    assert any("local frame" in line for line in said)


def test_missing_parts_of_a_shapefile(tmp_path, terrain):
    features(ring(), d0=[1.0]).to_file(tmp_path / "a.shp")
    (tmp_path / "a.shx").unlink()
    with pytest.raises(FormatError, match=r"a\.shx"):
        read_release(tmp_path / "a.shp", terrain)


def test_z_coordinates_are_dropped_and_empty_features_reported(tmp_path, terrain):
    solid = shapely.force_3d(ring(), 5.0)
    features(solid, shapely.Polygon(), d0=[1.0, 1.0]).to_file(tmp_path / "a.gpkg")
    with collected() as said:
        release = read_release(tmp_path / "a.gpkg", terrain)
    assert release.area == pytest.approx(ring().area)
    assert not release.parts[0].polygon.has_z
    assert any("no geometry" in line for line in said)


def test_a_negative_thickness_raster_names_its_cell(tmp_path, terrain):
    values = np.ones((60, 60))
    values[7, 9] = -3.0
    write_raster(tmp_path / "t.tif", values, PIXELS["north_up"])
    features(ring()).to_file(tmp_path / "a.gpkg")
    with pytest.raises(InputError, match=r"-3 in 1 cells, the first in row 7, column 9"):
        read_release(tmp_path / "a.gpkg", terrain, tmp_path / "t.tif")


def test_geopackage_with_raster_inside_is_not_mistaken(tmp_path, terrain):
    features(ring(), d0=[2.0]).to_file(tmp_path / "a.gpkg", layer="release")
    with rasterio.open(
        tmp_path / "a.gpkg",
        "w",
        driver="GPKG",
        height=20,
        width=20,
        count=1,
        dtype="uint8",
        crs="EPSG:32632",
        transform=PIXELS["north_up"],
        APPEND_SUBDATASET="YES",
        RASTER_TABLE="picture",
    ) as sink:
        sink.write(np.ones((1, 20, 20), np.uint8))
    assert read_release(tmp_path / "a.gpkg", terrain).area == pytest.approx(ring().area)
