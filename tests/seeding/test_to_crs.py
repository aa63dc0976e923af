"""`--to-crs`: a DTM in degrees or feet, and rasters in another CRS, brought to metres."""

import json

import numpy as np
import pyproj
import pytest
import rasterio
from affine import Affine
from hypothesis import example, given, settings
from hypothesis import strategies as st
from seed_sites import write_raster

from mpmgis.frames.frame_files import read_frame
from mpmgis.seeding.seeded_file import seed_file
from mpmgis.system.errors import GeoreferenceError, InputError
from mpmgis.system.messages import collected
from mpmgis.terrain.dtm import TerrainFile, read_terrain

EAST_SLOPE, NORTH_SLOPE, SIDE, PIXELS = 0.3, -0.2, 10.0, 100


def site(longitude, latitude, code):
    """(east, north) of a place in the CRS `code`, to 10 m."""
    point = pyproj.Transformer.from_crs(4326, code, always_xy=True).transform(longitude, latitude)
    return tuple(round(value, -1) for value in point)


def heights(x, y, place):
    """A plane in the projection [m]."""
    return 1500.0 + EAST_SLOPE * (x - place[0]) + NORTH_SLOPE * (y - place[1])


def in_degrees(path, longitude, latitude, code, place, **options):
    """The plane as a raster in EPSG:4326 around a place, with pixels of about 10 m."""
    step = SIDE / 111_320.0 / np.cos(np.radians(latitude)), SIDE / 111_320.0
    half = 0.5 * PIXELS
    transform = Affine(step[0], 0, longitude - half * step[0], 0, -step[1], latitude + half * step[1])
    columns, rows = np.meshgrid(np.arange(PIXELS) + 0.5, np.arange(PIXELS) + 0.5)
    there = pyproj.Transformer.from_crs(4326, code, always_xy=True).transform(*(transform * (columns, rows)))
    return write_raster(path, heights(*there, place), transform, "EPSG:4326", **options)


def release(path, place, code):
    """A square of 200 m as GeoJSON in the projection."""
    (x, y), r = place, 100.0
    ring = [[x - r, y - r], [x + r, y - r], [x + r, y + r], [x - r, y + r], [x - r, y - r]]
    crs = {"type": "name", "properties": {"name": f"urn:ogc:def:crs:EPSG::{code}"}}
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": [feature]}))
    return path


def volume(tmp_path, dem, area, **options):
    """Volume [m3] of a seed."""
    path = tmp_path / "s.h5"
    seed_file(dem, area, path, thickness=2.0, overwrite=True, density=1000.0, per_cell=4, **options)
    return float(read_frame(path).particles.volume.sum())


places = st.tuples(st.integers(-1800, 1799).map(lambda n: 0.1 * n + 0.03), st.integers(-79, 83).map(lambda n: n + 0.3))


@settings(max_examples=8, deadline=None, derandomize=True)
@given(places)
@example((180.0, 52.0))
@example((-179.999, -17.0))
@example((179.999, -17.0))
def test_a_plane_to_degrees_and_back_is_the_same_release_in_any_zone(tmp_path_factory, at):
    """Both hemispheres, all zones, across the antimeridian: elevations to 1 mm, the seeded volume to 0.5 %."""
    longitude, latitude = at
    code = (32600 if latitude >= 0 else 32700) + int((longitude + 180) // 6) % 60 + 1
    place, folder = site(longitude, latitude, code), tmp_path_factory.mktemp("zone")
    degrees = in_degrees(folder / "degrees.tif", longitude, latitude, code, place)
    terrain = read_terrain(degrees, to_crs="auto")
    assert terrain.grid.crs.to_epsg() == code
    x, y = terrain.grid.xy(*np.indices(terrain.grid.shape))
    near = np.hypot(x - place[0], y - place[1]) < 350.0
    np.testing.assert_allclose(terrain.elevation[near], heights(x, y, place)[near], atol=1e-3)
    half = 0.5 * PIXELS * SIDE
    transform = Affine(SIDE, 0, place[0] - half, 0, -SIDE, place[1] + half)
    columns, rows = np.meshgrid(np.arange(PIXELS) + 0.5, np.arange(PIXELS) + 0.5)
    metres = write_raster(folder / "utm.tif", heights(*(transform * (columns, rows)), place), transform, f"EPSG:{code}")
    area = release(folder / "area.json", place, code)
    assert volume(folder, degrees, area, to_crs="auto") == pytest.approx(volume(folder, metres, area), rel=5e-3)


@pytest.mark.parametrize(("latitude", "code"), [(85.0, 32661), (-85.0, 32761)])
def test_beyond_utm_it_is_polar_stereographic(tmp_path, latitude, code):
    place = site(15.0, latitude, code)
    terrain = read_terrain(in_degrees(tmp_path / "d.tif", 15.0, latitude, code, place), to_crs="auto")
    assert terrain.grid.crs.to_epsg() == code
    x, y = terrain.grid.xy(*np.indices(terrain.grid.shape))
    near = np.hypot(x - place[0], y - place[1]) < 300.0
    np.testing.assert_allclose(terrain.elevation[near], heights(x, y, place)[near], atol=1e-3)


@pytest.mark.parametrize("longitude", [9.0, 180.0, -179.999])
def test_a_part_has_the_bits_of_the_whole(tmp_path, longitude):
    code = 32732 if longitude == 9.0 else 32701
    path = in_degrees(tmp_path / "d.tif", longitude, -17.0, code, site(longitude, -17.0, code))
    file = TerrainFile(path, to_crs="auto")
    whole, part = file.whole(), file.part(slice(40, 71), slice(35, 90))
    assert np.array_equal(part.elevation, whole.elevation[40:71, 35:90])
    assert part.grid.crs == whole.grid.crs and part.reprojection == whole.reprojection


def test_a_part_reads_only_the_pixels_under_it(tmp_path, monkeypatch):
    """Damage elsewhere in the file is not even seen."""
    path = in_degrees(tmp_path / "d.tif", 9.0, 46.0, 32632, site(9.0, 46.0, 32632), nodata=-1.0)
    from mpmgis.terrain import terrain_reprojection

    windows, plain = [], terrain_reprojection._pixels_under
    monkeypatch.setattr(terrain_reprojection, "_pixels_under", lambda *a: windows.append(plain(*a)) or windows[-1])
    TerrainFile(path, to_crs="auto").part(slice(40, 50), slice(40, 50))
    assert windows[0].width < 25 and windows[0].height < 25


def test_undeclared_nodata_does_not_leak_into_its_neighbours(tmp_path):
    place = site(9.0, 46.0, 32632)
    path = in_degrees(tmp_path / "d.tif", 9.0, 46.0, 32632, place)
    with rasterio.open(path, "r+") as file:
        values = file.read(1)
        values[30:40, 50:60] = -9999.0
        file.write(values, 1)
    with collected() as told:
        terrain = read_terrain(path, to_crs="auto")
    assert any("100 cells have the value -9999" in str(line) for line in told)
    assert np.nanmin(terrain.elevation) > 1000.0 and 60 < np.isnan(terrain.elevation[25:45, 45:65]).sum() < 140


def test_a_mask_of_the_file_is_kept(tmp_path):
    path = in_degrees(tmp_path / "d.tif", 9.0, 46.0, 32632, site(9.0, 46.0, 32632))
    with rasterio.open(path, "r+") as file:
        mask = np.full(file.shape, 255, np.uint8)
        mask[30:40, 50:60] = 0
        file.write_mask(mask)
    terrain = read_terrain(path, to_crs="auto")
    assert 60 < np.isnan(terrain.elevation[25:45, 45:65]).sum() < 140


FEET = 1200 / 3937


@pytest.mark.parametrize(
    ("crs", "unit", "factor"),
    [
        ("EPSG:2263+6360", "", FEET),
        ("EPSG:2263", "US survey foot", FEET),
        ("EPSG:2263", "ft", 0.3048),
        ("EPSG:2263", "m", 1.0),
    ],
)
def test_feet_become_metres_by_the_unit_that_is_named(tmp_path, crs, unit, factor):
    """State Plane in US feet: pixels and heights to UTM in metres."""
    transform = Affine(10, 0, 980_000, 0, -10, 200_000)  # New York
    path = write_raster(tmp_path / "feet.tif", np.full((60, 60), 300.0), transform, crs, unit=unit)
    terrain = read_terrain(path, to_crs="auto")
    assert terrain.grid.crs.to_epsg() == 32618 and terrain.grid.cell_size == pytest.approx(3.05, rel=1e-2)
    assert np.nanmax(terrain.elevation) == pytest.approx(300.0 * factor, rel=1e-9)
    assert terrain.reprojection.facts()["height_factor"] == pytest.approx(factor, rel=1e-9)


def test_feet_of_height_alone_leave_the_pixels(tmp_path):
    heights_in_feet = 1000.0 + np.arange(400.0).reshape(20, 20)
    path = write_raster(
        tmp_path / "d.tif", heights_in_feet, Affine(5, 0, 500_000, 0, -5, 5_100_000), "EPSG:32632", unit="ft"
    )
    with pytest.raises(GeoreferenceError, match=r"in ft, expected metres; give --to-crs auto"):
        read_terrain(path)
    terrain = read_terrain(path, to_crs="auto")
    assert terrain.grid.transform.c == 500_000 and not terrain.reprojection.resampled
    np.testing.assert_allclose(terrain.elevation, 0.3048 * heights_in_feet, rtol=1e-12)


REFUSED = {
    "unknown unit of heights": (
        "EPSG:2263",
        "",
        Affine(10, 0, 980_000, 0, -10, 200_000),
        "auto",
        "nothing says what its heights are in",
    ),
    "a unit nobody knows": ("EPSG:2263", "cubit", Affine(10, 0, 980_000, 0, -10, 200_000), "auto", "'cubit'"),
    "contradiction": ("EPSG:2263+6360", "m", Affine(10, 0, 980_000, 0, -10, 200_000), "auto", "correct one of them"),
    "too wide for a zone": ("EPSG:4326", "", Affine(1, 0, 0, 0, -0.1, 50), "auto", "too wide for one UTM zone"),
    "degrees asked for": ("EPSG:32632", "", Affine(5, 0, 5e5, 0, -5, 51e5), "EPSG:4326", "CRS in metres"),
    "no code": ("EPSG:32632", "", Affine(5, 0, 5e5, 0, -5, 51e5), "EPSG:999999", "--to-crs got"),
    "false degrees": ("EPSG:4326", "", Affine(5, 0, 5e5, 0, -5, 51e5), "auto", "are not degrees"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_meant_is_refused_in_one_line(tmp_path, case):
    crs, unit, transform, to_crs, words = REFUSED[case]
    path = write_raster(tmp_path / "d.tif", np.full((40, 40), 300.0), transform, crs, unit=unit)
    with pytest.raises((GeoreferenceError, InputError), match=words) as refused:
        read_terrain(path, to_crs=to_crs)
    assert "\n" not in str(refused.value)


def test_the_refusal_is_the_default_and_names_the_option(tmp_path):
    path = in_degrees(tmp_path / "d.tif", 9.0, 46.0, 32632, site(9.0, 46.0, 32632))
    with pytest.raises(GeoreferenceError, match=r"mpmgis needs metres. Give --to-crs auto \(EPSG:32632\), or reproj"):
        read_terrain(path)


def test_metres_stay_as_they_are_with_auto(tmp_path):
    values = 1000.0 + np.arange(400.0).reshape(20, 20)
    path = write_raster(tmp_path / "d.tif", values, Affine(5, 0, 500_000, 0, -5, 5_100_000), "EPSG:32632")
    with collected() as told:
        terrain = read_terrain(path, to_crs="auto")
    assert np.array_equal(terrain.elevation, values) and not told


def test_a_release_raster_in_degrees_far_wider_than_an_affine(tmp_path):
    """60 km of a mask in degrees: no affine maps it to UTM within a quarter of a pixel; its area stays."""
    values = np.full((300, 900), 500.0) + np.arange(900.0)
    transform = Affine(0.001, 0, 8.6, 0, -0.001, 46.2)
    dem = write_raster(tmp_path / "d.tif", values, transform, "EPSG:4326")
    mask = np.zeros(values.shape)
    mask[20:280, 20:880] = 1.0
    area = write_raster(tmp_path / "mask.tif", mask, transform, "EPSG:4326")
    seeded = seed_file(dem, area, tmp_path / "s.h5", thickness=1.0, to_crs="auto", count=2000, density=1000.0)
    geod = pyproj.Geod(ellps="WGS84")
    west, east, south, north = 8.62, 9.48, 45.92, 46.18
    edge = np.linspace(west, east, 200)
    truth, _ = geod.polygon_area_perimeter(np.r_[edge, edge[::-1]], np.r_[np.full(200, south), np.full(200, north)])
    assert seeded.record["release_area"] == pytest.approx(abs(truth), rel=5e-3)
    with rasterio.open(dem) as file:
        assert file.crs.to_epsg() == 4326  # the file is as it was
