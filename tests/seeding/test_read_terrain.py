"""DTMs in: georeference, units, nodata, bands."""

import shlex

import numpy as np
import pyproj
import pytest
import rasterio
import shapely
from affine import Affine
from rasterio.rio.main import main_group as rio
from seed_sites import CENTRE, EAST, NORTH, PIXELS, area_of, ring, write_dtm, write_raster

from mpmgis.seeding.column_seeding import seed_columns
from mpmgis.system.errors import FormatError, GeoreferenceError, InputError
from mpmgis.system.messages import collected
from mpmgis.terrain.dtm import read_terrain
from mpmgis.terrain.georeference import metric_equivalent, name_of
from mpmgis.terrain.raster_input import read_raster
from mpmgis.terrain.undeclared_nodata import HEIGHTS


@pytest.mark.parametrize("pixels", PIXELS.values(), ids=PIXELS)
def test_slope_of_a_30_degree_plane_from_any_pixels(tmp_path, pixels):
    """0.5774, whatever the pixel's size and direction."""
    terrain = read_terrain(write_dtm(tmp_path / "d.tif", pixels))
    assert terrain.grid.crs.to_epsg() == 32632
    slope = np.hypot(*np.moveaxis(terrain.gradient, -1, 0))
    np.testing.assert_allclose(slope, np.tan(np.radians(30.0)), rtol=1e-7)
    assert len(terrain.sha256) == 64


def test_area_or_point_shifts_by_half_a_pixel(tmp_path):
    """GDAL applies the tag; the same array tagged Point lies half a pixel to the north-west."""
    heights = np.arange(12.0).reshape(3, 4)
    transform = Affine(10, 0, EAST, 0, -10, NORTH)
    with rasterio.Env(GTIFF_POINT_GEO_IGNORE="TRUE"):  # write the tie point as it stands
        write_raster(tmp_path / "point.tif", heights, transform, AREA_OR_POINT="Point")
        write_raster(tmp_path / "area.tif", heights, transform, AREA_OR_POINT="Area")
    area, point = (read_terrain(tmp_path / f"{kind}.tif") for kind in ("area", "point"))
    assert area.grid.xy(0, 0) == (EAST + 5, NORTH - 5)
    assert point.grid.xy(0, 0) == (EAST, NORTH)
    assert float(point.sample(EAST + 10, NORTH - 10)) == 5.0


def test_nodata_scale_and_integers(tmp_path):
    heights = np.arange(20, dtype=np.int16).reshape(4, 5) + 100
    heights[1, 2] = -32000
    path = write_raster(tmp_path / "d.tif", heights, PIXELS["north_up"], nodata=-32000)
    with rasterio.open(path, "r+") as file:
        file.scales, file.offsets = (0.1,), (5.0,)
    terrain = read_terrain(path)
    assert terrain.elevation.dtype == np.float64
    assert np.isnan(terrain.elevation[1, 2]) and np.isnan(terrain.elevation).sum() == 1
    assert terrain.elevation[0, 1] == pytest.approx(15.1)


def test_undeclared_nodata_is_reported_and_masked(tmp_path):
    heights = np.full((6, 6), 500.0)
    heights[2, 3] = -9999
    heights[4, 4] = np.inf
    with collected() as said:
        terrain = read_terrain(write_raster(tmp_path / "d.tif", heights, PIXELS["north_up"]))
    assert np.isnan(terrain.elevation).sum() == 2
    assert len(said) == 1 and "-9999" in said[0]


def test_given_crs_and_local(tmp_path):
    path = write_dtm(tmp_path / "d.tif", crs=None)
    assert read_terrain(path, crs="EPSG:32632").grid.crs == pyproj.CRS.from_epsg(32632)
    assert read_terrain(path, crs="local").grid.crs is None
    with pytest.raises(GeoreferenceError, match=r"--crs EPSG:n, or --crs local"):
        read_terrain(path)
    tagged = write_dtm(tmp_path / "t.tif")
    assert read_terrain(tagged, crs="epsg:32632").grid.crs.to_epsg() == 32632
    with pytest.raises(GeoreferenceError, match="is already in EPSG:32632"):
        read_terrain(tagged, crs="EPSG:32633")


def test_a_bare_picture_needs_local(tmp_path):
    path = write_raster(tmp_path / "d.tif", np.ones((4, 4)) * 7, Affine.identity(), crs=None)
    with pytest.raises(GeoreferenceError, match="no CRS"):
        read_terrain(path)
    with pytest.raises(GeoreferenceError, match="no georeference"):
        read_terrain(path, crs="EPSG:32632")
    assert read_terrain(path, crs="local").grid.cell_size == 1.0


def test_bands(tmp_path):
    stack = np.stack([np.full((4, 4), 3.0), np.full((4, 4), 800.0)])
    path = write_raster(tmp_path / "d.tif", stack, PIXELS["north_up"])
    with pytest.raises(InputError, match=r"2 bands.*--dem-band"):
        read_terrain(path)
    assert read_terrain(path, band=2).elevation.max() == 800.0
    with pytest.raises(InputError, match="band 3"):
        read_terrain(path, band=3)


@pytest.mark.parametrize(
    ("longitude", "latitude", "cure"),
    [(10.5, 46.2, "EPSG:32632"), (-70.3, -33.1, "EPSG:32719"), (179.9, 1.0, "EPSG:32660"), (0.0, 88.0, "EPSG:32661")],
)
def test_geographic_is_refused_with_the_zone_to_use(tmp_path, longitude, latitude, cure):
    assert metric_equivalent(longitude, latitude) == cure
    transform = Affine(1e-4, 0, longitude, 0, -1e-4, latitude)
    path = write_raster(tmp_path / "d.tif", np.full((20, 20), 100.0), transform, "EPSG:4326")
    with pytest.raises(GeoreferenceError, match=f"degrees.* {path} d_warped.tif --dst-crs {cure}"):
        read_terrain(path)


def test_the_suggested_command_can_be_pasted_for_any_file_name(tmp_path, monkeypatch):
    path = write_raster(
        tmp_path / "my dtm.tif", np.full((20, 20), 100.0), Affine(1e-4, 0, 9, 0, -1e-4, 46), "EPSG:4326"
    )
    with pytest.raises(GeoreferenceError) as caught:
        read_terrain(path)
    _, _, command = str(caught.value).partition("rio ")
    words = shlex.split(command)
    assert words == ["warp", str(path), "my dtm_warped.tif", "--dst-crs", "EPSG:32632", "--resampling", "bilinear"]
    monkeypatch.chdir(tmp_path)
    rio(words, standalone_mode=False)
    warped = read_terrain(tmp_path / "my dtm_warped.tif")
    assert name_of(warped.grid.crs) == "EPSG:32632" and np.nanmax(warped.elevation) == pytest.approx(100.0)


def test_another_crs_than_the_files_own_is_refused_with_both_fixes(tmp_path):
    path = write_dtm(tmp_path / "d.tif")
    with pytest.raises(
        GeoreferenceError, match=r"rio edit-info FILE --crs EPSG:32633.*rio warp .*--dst-crs EPSG:32633"
    ):
        read_terrain(path, crs="EPSG:32633")
    with pytest.raises(GeoreferenceError, match="a wrong tag") as caught:
        read_terrain(path, crs="local")
    assert "--unset-crs" in str(caught.value) and "rio warp" not in str(caught.value)


@pytest.mark.parametrize("crs", ["EPSG:2226", "EPSG:2272", "EPSG:6576"])
def test_feet_are_refused(tmp_path, crs):
    """US survey feet, and a state plane of the west and of the east."""
    x, y = pyproj.CRS(crs).area_of_use.west + 0.5, pyproj.CRS(crs).area_of_use.south + 0.5
    x, y = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(x, y)
    path = write_raster(tmp_path / "d.tif", np.full((8, 8), 100.0), Affine(10, 0, x, 0, -10, y), crs)
    with pytest.raises(GeoreferenceError, match=r"foot.*rio warp .* --dst-crs EPSG:326"):
        read_terrain(path)


@pytest.mark.parametrize("unit", ["ft", "US survey foot", "feet", "us-ft", "km"])
def test_heights_in_feet_are_refused(tmp_path, unit):
    with pytest.raises(GeoreferenceError, match=r"elevations are in .*rio calc '\(\* 0?"):
        read_terrain(write_dtm(tmp_path / "d.tif", unit=unit))


def test_heights_in_feet_by_vertical_crs_are_refused(tmp_path):
    path = write_dtm(tmp_path / "d.tif", crs="EPSG:26910+6360")  # NAVD88 height (ftUS)
    with pytest.raises(GeoreferenceError, match="elevations are in US survey foot"):
        read_terrain(path)
    metres = read_terrain(write_dtm(tmp_path / "m.tif", crs="EPSG:26910+5703"))  # NAVD88 height, metres
    assert metres.grid.crs.to_epsg() == 26910


def test_unknown_unit_is_reported(tmp_path):
    with collected() as said:
        read_terrain(write_dtm(tmp_path / "d.tif", unit="masl"))
    assert any("masl" in line for line in said)


def test_degrees_under_a_projected_tag_are_refused(tmp_path):
    path = write_raster(tmp_path / "d.tif", np.full((9, 9), 1.0), Affine(1e-4, 0, 10.1, 0, -1e-4, 46.2), "EPSG:32632")
    with pytest.raises(GeoreferenceError, match=r"look like degrees.*EPSG:32632"):
        read_terrain(path)


@pytest.mark.parametrize(("x", "y"), [(2_600_000, 1_200_000), (4_321_000, 3_210_000), (500_000, 20_000_000)])
def test_coordinates_of_another_crs_are_refused(tmp_path, x, y):
    """LV95, LAEA and nowhere, all tagged UTM 32."""
    path = write_raster(tmp_path / "d.tif", np.full((9, 9), 1.0), Affine(10, 0, x, 0, -10, y), "EPSG:32632")
    with pytest.raises(GeoreferenceError, match="tag is false"):
        read_terrain(path)


def test_a_neighbour_zone_is_no_false_tag_but_its_scale_is_reported(tmp_path):
    """A whole country in one zone is usual; a message warns of the area bias beyond 1e-3."""
    path = write_raster(tmp_path / "d.tif", np.full((9, 9), 1.0), Affine(10, 0, 80_000, 0, -10, 5.2e6), "EPSG:32633")
    with collected() as said:
        read_terrain(path)
    assert any("stretches lengths" in line and "EPSG:32632" in line for line in said)
    said.clear()
    with collected() as said:
        read_terrain(write_dtm(tmp_path / "q.tif"))
    assert not said


def test_cliffs_everywhere_are_reported(tmp_path):
    """More than 1 % of the cells above 85 degrees is a mix-up of units."""
    rng = np.random.default_rng(1)
    with collected() as said:
        read_terrain(write_raster(tmp_path / "d.tif", rng.uniform(0, 4000, (30, 30)), PIXELS["north_up"]))
    assert any("85 degrees" in line for line in said)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", r"empty \(0 bytes\)"),
        (b"junk" * 50, "not a raster that GDAL can read"),
        (bytes(range(256)) * 20, "not a raster that GDAL can read"),
        (b"this is no raster\n" * 10, "not a raster that GDAL can read"),
        (b"II*\0\x08\0\0\0", r"d\.tif"),
    ],
)
def test_unreadable_files(tmp_path, content, words):
    path = tmp_path / "d.tif"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=words):
        read_terrain(path)


def test_a_truncated_raster(tmp_path):
    path = write_dtm(tmp_path / "d.tif", shape=(300, 300))
    path.write_bytes(path.read_bytes()[:200_000])
    with pytest.raises(FormatError, match="truncated"):
        read_terrain(path)


def test_ascii_grid_with_lower_left_centre(tmp_path):
    """An ESRI ASCII grid names the centre of its lower left cell; GDAL turns that into the corner."""
    rows = "\n".join(" ".join(str(10 * i + j) for j in range(4)) for i in range(3))
    (tmp_path / "d.asc").write_text(
        f"ncols 4\nnrows 3\nxllcenter {EAST}\nyllcenter {NORTH}\ncellsize 10\nNODATA_value -9999\n{rows}\n"
    )
    terrain = read_terrain(tmp_path / "d.asc", crs="EPSG:32632")
    assert float(terrain.sample(EAST, NORTH)) == 20.0
    values, grid = read_raster(tmp_path / "d.asc", HEIGHTS)
    assert values.shape == grid.shape == (3, 4) and grid.crs is None


def test_one_scene_on_all_pixels_is_one_mass(tmp_path):
    """H20: the same release on north-up, south-up, rotated and non-square DTMs."""
    masses = [
        seed_columns(read_terrain(write_dtm(tmp_path / f"{n}.tif", p, (90, 90))), area_of(ring())).particles.mass.sum()
        for n, p in PIXELS.items()
        if shapely.Polygon([p * c for c in ((0, 0), (90, 0), (90, 90), (0, 90))]).covers(ring())
    ]
    assert len(masses) >= 4
    np.testing.assert_allclose(masses, masses[0], rtol=1e-7)
    assert masses[0] == pytest.approx(ring().area * 2000.0 / np.cos(np.radians(30)), rel=1e-7)
    assert CENTRE == (EAST + 150.0, NORTH + 150.0)


def test_a_vertical_datum_is_reported_and_left_out(tmp_path):
    """Heights relate to what the DTM says; results carry the place on the map alone."""
    heights = np.arange(12.0).reshape(3, 4)
    write_raster(tmp_path / "d.tif", heights, Affine(10, 0, EAST, 0, -10, NORTH), crs="EPSG:25832+5783")
    with collected() as told:
        terrain = read_terrain(tmp_path / "d.tif")
    assert terrain.grid.crs.to_epsg() == 25832
    assert ["DHHN92" in line and "elevations are used unchanged" in line for line in told] == [True]


@pytest.mark.parametrize("shear", [0.0, 0.3])
def test_steep_cells_are_reported_where_the_gradient_has_them(tmp_path, shear):
    """Rough DTMs of any size and pixel with holes: the shortcut for gentle ground never hides a report."""
    draw, reports = np.random.default_rng(5), 0
    for k in range(60):
        rows, columns = draw.integers(2, 12, 2)
        heights = 10.0 ** draw.uniform(0.0, 3.0) * draw.normal(size=(rows, columns))
        heights[draw.random((rows, columns)) < draw.choice([0.0, 0.3])] = np.nan
        if not np.isfinite(heights).any():
            continue
        transform = Affine(draw.uniform(0.5, 20.0), shear, EAST, shear, -draw.uniform(0.5, 20.0), NORTH)
        path = tmp_path / f"{k}.tif"
        write_raster(path, np.nan_to_num(heights, nan=-9999.0), transform, nodata=-9999.0)
        with collected() as lines:
            terrain = read_terrain(path)
        slope = np.hypot(*np.moveaxis(terrain.gradient, -1, 0))
        steep = np.count_nonzero(slope > np.tan(np.radians(85.0)))
        expected = steep > 0.01 * np.isfinite(slope).sum()
        assert any("steeper than 85" in line for line in lines) == expected, (k, steep)
        reports += expected
    assert 5 < reports < 55
