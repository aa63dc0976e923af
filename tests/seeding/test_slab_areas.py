"""Potential release areas of snow slabs: known areas, no area across a ridge, the same areas in every orientation."""

import logging
import math

import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine
from slab_sites import CELL, cone, mountains, pyramid, ribs, tan, terrain

from mpmgis.seeding.release_areas import read_release
from mpmgis.seeding.seeded_file import seed_file
from mpmgis.seeding.snow_slabs import potential_areas
from mpmgis.seeding.snow_slabs.potential_areas import SlabSearch, find_slab_areas, write_slab_areas
from mpmgis.seeding.snow_slabs.slab_criteria import SCENARIOS, SlabCriteria
from mpmgis.seeding.snow_slabs.slab_thickness import NewSnow, slope_factor
from mpmgis.studies.region_areas import read_areas
from mpmgis.system.errors import GeoreferenceError, InputError, OutputError
from mpmgis.terrain import dtm
from mpmgis.terrain.dtm import read_terrain
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid

SMOOTH = SlabCriteria(ruggedness=1.0)  # the window of ruggedness takes a strip along ridges
UTM = "EPSG:32632"


def found(ground, criteria=SMOOTH, **search):
    return find_slab_areas(ground, SlabSearch(criteria, **search))


def area_of(areas):
    return float(areas.columns["area"].sum())


def written(path, ground, crs=UTM, **more):
    """The DTM as a GeoTIFF."""
    rows, columns = ground.grid.shape
    with rasterio.open(
        path, "w", "GTiff", columns, rows, 1, crs, ground.grid.transform, "float64", nodata=-9999, **more
    ) as file:
        file.write(np.where(ground.valid, ground.elevation, -9999), 1)
    return path


# ---- known areas ---------------------------------------------------------------------------------------------------


def test_a_cone_gives_eight_sectors_with_its_area():
    areas = found(terrain(cone))
    radius, top = 300.0, 100.0 / SMOOTH.curvature
    assert len(areas.polygons) == 8
    exact = math.pi * (radius**2 - top**2)
    assert area_of(areas) == pytest.approx(exact, abs=2 * math.pi * (radius + top) * CELL)
    np.testing.assert_allclose(areas.columns["area"], exact / 8, rtol=0.25)
    np.testing.assert_allclose(np.sort(areas.columns["aspect"]), np.arange(8) * 45.0, atol=1.0)
    np.testing.assert_allclose(areas.columns["slope"], 35.0, atol=0.7)  # half slopes at the foot


@pytest.mark.parametrize("turned", [0.0, 30.0, 45.0, 71.0])
@pytest.mark.parametrize("sides", [3, 4, 6, 8])
def test_no_area_crosses_an_edge_of_a_pyramid(sides, turned):
    radius = 300.0
    ground = terrain(pyramid(sides, turned, radius=radius), size=260)
    areas = found(ground)
    half = math.pi / sides
    corner = radius / math.cos(half)
    middle = np.radians(turned) + 2 * half * np.arange(sides)
    faces = [
        shapely.Polygon([(0, 0), *((corner * math.sin(a + s), corner * math.cos(a + s)) for s in (-half, half))])
        for a in middle
    ]
    assert len(areas.polygons) == sides
    edges = corner * math.sqrt(2.0) * CELL  # the diagonal of a cell along an edge
    for polygon in areas.polygons:
        shares = sorted(polygon.intersection(face).area for face in faces)
        assert shares[-2] <= edges
        assert shares[-1] <= faces[0].area + 2 * radius * math.tan(half) * CELL
        assert shares[-1] >= faces[0].area - 2 * edges - 2 * radius * math.tan(half) * CELL


def test_a_cylinder_has_two_bands_of_known_width():
    radius = 350.0
    ground = terrain(lambda x, y: np.sqrt(np.maximum(radius**2 - x**2, 0.0)) + 0.0 * y)
    areas = found(ground)
    length = (ground.grid.shape[0] - 2) * CELL
    band = radius * (math.sin(math.radians(60)) - math.sin(math.radians(30)))
    assert len(areas.polygons) == 2
    assert area_of(areas) == pytest.approx(2 * band * length, abs=4 * length * CELL)
    np.testing.assert_allclose(np.sort(areas.columns["aspect"]), [90.0, 270.0], atol=0.1)
    assert not any(polygon.intersects(shapely.LineString([(0, -1e3), (0, 1e3)])) for polygon in areas.polygons)


def test_a_sine_ridge_has_two_flanks_of_known_width():
    high, wave = 100.0, 2 * math.pi / 600.0
    ground = terrain(lambda x, y: high * np.cos(wave * x) + 0.0 * y, size=118)
    areas = found(ground)
    edge = math.asin(tan(30) / (high * wave)) / wave
    width, length = 300.0 - 2 * edge, (118 - 2) * CELL
    seen = min(300.0 - edge, 0.5 * length) - edge
    assert seen <= width + 1e-9
    assert len(areas.polygons) == 2
    assert area_of(areas) == pytest.approx(2 * seen * length, abs=4 * length * CELL)
    assert all(abs(polygon.centroid.x) > 100 for polygon in areas.polygons)


def test_ruggedness_takes_a_strip_along_a_sharp_ridge():
    ground = terrain(lambda x, y: -tan(40) * np.abs(x) + 0.0 * y)
    areas = found(ground, SCENARIOS["frequent"])
    s, c = math.sin(math.radians(40)), math.cos(math.radians(40))
    share = 0.5 * (1 - math.sqrt(((1 - 0.06) ** 2 - c**2) / s**2))  # of the window on the other side
    strip = 45.0 * (0.5 - share)  # Sappington et al. 2007
    length = (ground.grid.shape[0] - 2) * CELL
    width = 0.5 * length - strip
    assert area_of(areas) == pytest.approx(2 * width * length, abs=2 * length * CELL)


@pytest.mark.parametrize("angle", [15.0, 22.5, 35.0])
@pytest.mark.parametrize("tilt", [0.0, 0.3, -0.5])
def test_ribs_and_gullies_divide_a_slope(angle, tilt):
    wide = 200.0
    areas = found(terrain(ribs(angle, wide, tilt=tilt)))
    left, right = (0.5 * wide * np.arange(-20, 20) + side for side in (0.0, 0.5 * wide))
    flanks = [
        shapely.Polygon([(a - tilt * y, y) for y in (-999, 999)] + [(b - tilt * y, y) for y in (999, -999)])
        for a, b in zip(left, right, strict=True)
    ]
    for polygon in areas.polygons:
        shares = sorted(polygon.intersection(flank).area for flank in flanks)
        assert shares[-2] <= CELL * 0.5 * polygon.length
    crests = sum(flank.intersection(shapely.box(-400, -400, 400, 400)).length for flank in flanks) / 2
    assert area_of(areas) >= (158 * CELL) ** 2 - 3 * CELL * crests


def test_a_plane_of_the_limit_belongs_to_the_band():
    for slope in (30.0, 60.0):
        areas = found(terrain(lambda x, y, slope=slope: 3000 + tan(slope) * (0.6 * x + 0.8 * y)))
        assert area_of(areas) == pytest.approx(158**2 * CELL**2)
        np.testing.assert_allclose(areas.columns["slope"], slope, atol=1e-4)
        np.testing.assert_allclose(areas.columns["aspect"], 180 + math.degrees(math.atan2(0.6, 0.8)), atol=0.01)
    with pytest.raises(InputError, match=r"slope_min"):
        found(terrain(lambda x, y: tan(29.99) * x))


@pytest.mark.parametrize(
    "transform",
    [
        Affine(5, 0, 0, 0, 5, 0),
        Affine(8, 0, 0, 0, -3, 0),
        Affine.rotation(20) * Affine.scale(5, -5),
        Affine.rotation(-65) * Affine.scale(4, 7),
        Affine(5, 1.5, 0, 0.5, -4, 0),
    ],
    ids=["south_up", "non_square", "rotated", "rotated_non_square", "sheared"],
)
def test_cells_of_any_form_give_the_cone_too(transform):
    middle = transform * (100, 100)
    grid = Grid(None, Affine.translation(-middle[0], -middle[1]) * transform, (200, 200))
    x, y = grid.xy(*np.mgrid[:200, :200])
    areas = found(Terrain(grid, cone(x, y, radius=220.0)))
    top = 100.0 / SMOOTH.curvature
    assert area_of(areas) == pytest.approx(math.pi * (220**2 - top**2), abs=2 * math.pi * (220 + top) * grid.cell_size)
    assert sum(polygon.area for polygon in areas.polygons) == pytest.approx(area_of(areas), rel=1e-12)
    assert len(areas.polygons) == 8


# ---- orientation and blocks ----------------------------------------------------------------------------------------


def outlines(areas):
    return sorted(shapely.normalize(polygon).wkb for polygon in areas.polygons)


def moved_back(areas, function):
    back = [shapely.transform(polygon, lambda points: function(points) + 0.0) for polygon in areas.polygons]  # no -0.0
    return sorted(shapely.normalize(polygon).wkb for polygon in back)


HEIGHTS = mountains()
GRID = Grid.north_up(None, -500.0, 500.0, CELL, HEIGHTS.shape)


@pytest.mark.parametrize("criteria", [SCENARIOS["extreme"], SMOOTH], ids=["extreme", "smooth"])
@pytest.mark.parametrize(
    ("turn", "back"),
    [
        (lambda z: np.rot90(z), lambda p: np.stack([p[:, 1], -p[:, 0]], 1)),
        (lambda z: np.rot90(z, 2), lambda p: -p),
        (lambda z: z[:, ::-1], lambda p: p * [-1, 1]),
        (lambda z: z[::-1], lambda p: p * [1, -1]),
        (lambda z: z.T, lambda p: -p[:, ::-1]),
    ],
    ids=["quarter turn", "half turn", "east to west", "north to south", "diagonal"],
)
def test_turned_and_mirrored_terrain_has_the_same_areas(criteria, turn, back):
    areas = found(Terrain(GRID, HEIGHTS), criteria)
    assert len(areas.polygons) > 20
    other = found(Terrain(GRID, np.ascontiguousarray(turn(HEIGHTS))), criteria)
    assert moved_back(other, back) == outlines(areas)


def test_moved_terrain_has_the_same_areas():
    areas = found(Terrain(GRID, HEIGHTS))
    other = found(Terrain(GRID.moved(512.0, 4096.0), HEIGHTS + 64.0))
    assert moved_back(other, lambda p: p - [512.0, 4096.0]) == outlines(areas)
    wide = np.full((260, 260), np.nan)
    wide[17:217, 31:231] = HEIGHTS
    framed = found(Terrain(GRID.moved(-31 * CELL, 17 * CELL).part(0, 0, (260, 260)), wide))
    assert outlines(framed) == outlines(areas)


@pytest.mark.parametrize("block", [37, 64, 113])
def test_blocks_leave_no_trace(block):
    whole, parts = found(Terrain(GRID, HEIGHTS)), found(Terrain(GRID, HEIGHTS), block=block, workers=2)
    assert [polygon.wkb for polygon in parts.polygons] == [polygon.wkb for polygon in whole.polygons]
    for name, values in whole.columns.items():
        np.testing.assert_array_equal(parts.columns[name], values)


def test_a_dtm_read_by_block_gives_the_same_file_contents(tmp_path, monkeypatch):
    dem = written(tmp_path / "dtm.tif", Terrain(GRID, HEIGHTS), tiled=True, blockxsize=64, blockysize=64)
    search = SlabSearch(SMOOTH, NewSnow({0: 1.0}), block=64)
    whole = write_slab_areas(dem, tmp_path / "whole.gpkg", search)
    monkeypatch.setattr(dtm, "READ_WHOLE", 100)
    parts = write_slab_areas(dem, tmp_path / "parts.gpkg", search)
    assert [polygon.wkb for polygon in parts.polygons] == [polygon.wkb for polygon in whole.polygons]
    for name, values in whole.columns.items():
        np.testing.assert_array_equal(parts.columns[name], values)


def test_blocks_without_any_elevation_are_passed_over(tmp_path, monkeypatch):
    heights = np.full((300, 300), np.nan)
    heights[150:, 150:] = HEIGHTS[:150, :150]
    dem = written(tmp_path / "dtm.tif", Terrain(Grid.north_up(None, 0, 1500, CELL, heights.shape), heights))
    search = SlabSearch(SMOOTH, block=64)
    whole = write_slab_areas(dem, tmp_path / "whole.gpkg", search)
    monkeypatch.setattr(dtm, "READ_WHOLE", 100)
    assert outlines(write_slab_areas(dem, tmp_path / "parts.gpkg", search)) == outlines(whole)


@pytest.mark.thorough
def test_dask_gives_the_same_areas(tmp_path):
    from distributed import LocalCluster

    dem = written(tmp_path / "dtm.tif", Terrain(GRID, HEIGHTS))
    forest = tmp_path / "forest.gpkg"
    potential_areas.write_layer(forest, "forest", [shapely.box(-200, -200, 100, 300)], {"name": ["one"]}, UTM)
    search = SlabSearch(SMOOTH, forest=forest, block=90)
    here = write_slab_areas(dem, tmp_path / "here.gpkg", search)
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=40) as cluster:
        search = SlabSearch(SMOOTH, forest=forest, block=90, dask=cluster.scheduler_address)
        there = write_slab_areas(dem, tmp_path / "there.gpkg", search)
    assert [polygon.wkb for polygon in there.polygons] == [polygon.wkb for polygon in here.polygons]
    for name, values in here.columns.items():
        np.testing.assert_array_equal(there.columns[name], values)


# ---- what the areas are for ----------------------------------------------------------------------------------------


def plane(slope=35.0, size=60):
    return terrain(lambda x, y: 2000.0 + tan(slope) * y, size=size)


def test_areas_are_a_release_of_seed_and_region_as_they_are(tmp_path):
    dem = written(tmp_path / "dtm.tif", terrain(cone, size=140))
    areas = write_slab_areas(dem, tmp_path / "areas.gpkg", SlabSearch(SMOOTH, NewSnow({30: 0.9, 100: 1.2})))
    ground = read_terrain(dem)
    release = read_release(tmp_path / "areas.gpkg", ground)
    assert release.area == pytest.approx(area_of(areas), rel=1e-9)
    region = read_areas(tmp_path / "areas.gpkg", ground)
    assert [part.thickness for part in region.parts] == pytest.approx(areas.columns["thickness_100"])
    assert {"slope", "aspect", "elevation", "area", "thickness", "volume", "volume_30"} <= set(region.columns)
    assert read_areas(tmp_path / "areas.gpkg", ground, "thickness_30").parts[0].thickness == pytest.approx(
        areas.columns["thickness_30"][0]
    )
    seeded = seed_file(dem, tmp_path / "areas.gpkg", tmp_path / "seed.h5", density=300.0)
    assert seeded.count > 0


def test_the_volume_is_that_of_a_seeded_slab(tmp_path):
    dem = written(tmp_path / "dtm.tif", plane())
    areas = write_slab_areas(dem, tmp_path / "areas.gpkg", SlabSearch(snow=NewSnow({0: 1.0})))
    thickness = slope_factor(np.array([35.0]))[0]
    assert areas.columns["thickness"][0] == pytest.approx(thickness, rel=1e-6)
    assert areas.columns["volume"][0] == pytest.approx(
        58**2 * CELL**2 * thickness / math.cos(math.radians(35)), rel=1e-6
    )
    seeded = seed_file(dem, tmp_path / "areas.gpkg", tmp_path / "seed.h5")
    assert seeded.record["reference_volume"] == pytest.approx(areas.columns["volume"][0], rel=1e-5)


def test_without_snow_there_is_no_thickness(tmp_path):
    dem = written(tmp_path / "dtm.tif", plane())
    areas = write_slab_areas(dem, tmp_path / "areas.gpkg")
    assert set(areas.columns) == {"name", "slope", "aspect", "elevation", "area"}
    with pytest.raises(InputError, match="--thickness"):
        read_release(tmp_path / "areas.gpkg", read_terrain(dem))


def test_low_areas_without_snow_are_reported(caplog):
    caplog.set_level(logging.INFO, "mpmgis")
    areas = found(plane(), snow=NewSnow({0: 0.1}, altitude=3000.0))
    assert areas.columns["thickness"].tolist() == [0.0]
    assert "1 release areas are too low for any new snow" in caplog.text


# ---- forest --------------------------------------------------------------------------------------------------------


def test_forest_as_polygons_and_as_a_raster_is_left_out(tmp_path):
    ground = plane()
    dem = written(tmp_path / "dtm.tif", ground)
    trees = shapely.box(-100.0, -150.0, 50.0, 150.0)
    potential_areas.write_layer(tmp_path / "forest.gpkg", "forest", [trees], {"name": ["one"]}, UTM)
    areas = write_slab_areas(dem, tmp_path / "a.gpkg", SlabSearch(forest=tmp_path / "forest.gpkg"))
    assert area_of(areas) == pytest.approx((58 * 58 - 30 * 58) * CELL**2)
    assert len(areas.polygons) == 2
    x, y = ground.grid.xy(*np.mgrid[:60, :60])
    raster = Terrain(ground.grid, shapely.contains_xy(trees, x, y) * 70.0)
    written(tmp_path / "forest.tif", raster)
    same = write_slab_areas(dem, tmp_path / "b.gpkg", SlabSearch(forest=tmp_path / "forest.tif", block=32))
    assert outlines(same) == outlines(areas)


def test_a_forest_that_does_not_fit_is_refused(tmp_path):
    dem = written(tmp_path / "dtm.tif", plane())
    forest = written(tmp_path / "forest.tif", plane(), crs="EPSG:32633")
    with pytest.raises(GeoreferenceError, match=r"the forest is in EPSG:32633.*the DTM in EPSG:32632.*; reproject it"):
        write_slab_areas(dem, tmp_path / "a.gpkg", SlabSearch(forest=forest))
    potential_areas.write_layer(tmp_path / "far.gpkg", "forest", [shapely.box(9e3, 0, 1e4, 1)], {"name": ["one"]}, UTM)
    with pytest.raises(InputError, match="the forest covers no part of the DTM"):
        write_slab_areas(dem, tmp_path / "a.gpkg", SlabSearch(forest=tmp_path / "far.gpkg"))


# ---- refusals ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ground", "criteria", "says"),
    [
        (terrain(lambda x, y: 0.0 * x), SMOOTH, r"no cell has a slope of .* \(the steepest has 0\)"),
        (plane(25.0), SMOOTH, r"the steepest has 25\)"),
        (terrain(lambda x, y: np.nan * x), SMOOTH, "no cell has a slope$|no cell has a slope"),
        (terrain(cone, size=140), SlabCriteria(ruggedness=1e-9), "0 of them are smooth"),
        (plane(size=12), SlabCriteria(min_area=1e5), r"none of their units has 100000 m2 \(`min_area`\)"),
    ],
    ids=["flat", "gentle", "nodata", "rugged", "small"],
)
def test_a_terrain_without_areas_says_why(ground, criteria, says):
    with pytest.raises(InputError, match=says) as refused:
        found(ground, criteria)
    assert "\n" not in str(refused.value)


def test_forest_everywhere_says_so(tmp_path):
    dem = written(tmp_path / "dtm.tif", plane())
    potential_areas.write_layer(tmp_path / "f.gpkg", "f", [shapely.box(-999, -999, 999, 999)], {"name": ["one"]}, UTM)
    with pytest.raises(InputError, match="0 have no forest"):
        write_slab_areas(dem, tmp_path / "a.gpkg", SlabSearch(forest=tmp_path / "f.gpkg"))


@pytest.mark.parametrize(
    "wrong",
    [{"slope_min": 60.0}, {"slope_min": -1.0}, {"slope_max": 90.0}, {"curvature": 0.0}, {"ruggedness": math.nan}],
)
def test_criteria_outside_their_range_are_refused(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        SlabCriteria(**wrong)


def test_coarse_cells_are_reported(caplog):
    caplog.set_level(logging.INFO, "mpmgis")
    found(terrain(cone, cell=25.0, size=40))
    assert "were published for 5 m and are uncertain" in caplog.text


def test_files_are_a_geopackage_that_is_not_replaced(tmp_path):
    dem = written(tmp_path / "dtm.tif", plane())
    with pytest.raises(InputError, match=r"ends with \.gpkg"):
        write_slab_areas(dem, tmp_path / "areas.shp")
    write_slab_areas(dem, tmp_path / "areas.gpkg")
    with pytest.raises(OutputError, match="--overwrite"):
        write_slab_areas(dem, tmp_path / "areas.gpkg")
    write_slab_areas(dem, tmp_path / "areas.gpkg", overwrite=True)
