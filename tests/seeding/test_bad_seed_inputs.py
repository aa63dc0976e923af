"""Broken inputs to `mpmgis seed`: exit code 2, exactly one line that names the trouble, nothing left behind.

What `read_terrain` and `read_release` refuse by themselves is tested in test_read_terrain.py, test_read_release.py.
"""

from pathlib import Path

import geopandas
import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine
from seed_sites import CENTRE, EAST, PIXELS, ring, write_dtm, write_raster

from mpmgis.commands.shell.main import main
from mpmgis.seeding import seeded_file

X, Y = CENTRE


class Kitchen:
    """Makes the good files of a scene in a folder; recipes spoil one of them."""

    def __init__(self, folder):
        self.folder = folder
        self.dem = write_dtm(folder / "dtm.tif")
        self.release = self.vector("area.gpkg", ring(), d0=[2.0], name=["A1"])
        self.options = []

    def vector(self, file_name, *polygons, crs="EPSG:32632", **columns):
        path = self.folder / file_name
        geopandas.GeoDataFrame(columns, geometry=list(polygons), crs=crs).to_file(path)
        return path

    def raster(self, name, values, transform=PIXELS["north_up"], crs="EPSG:32632", **options):
        return write_raster(self.folder / name, values, transform, crs, **options)

    def file(self, name, content):
        path = self.folder / name
        path.write_bytes(content)
        return path


RECIPES = {}


def recipe(words):
    """Register a broken input; `words` must stand in its one line."""

    def register(function):
        RECIPES[function.__name__] = (function, words)
        return function

    return register


# ------------------------------------------------------------------------------------------------------------ the DTM


@recipe("no such file")
def dem_missing(k):
    k.dem = k.folder / "nowhere.tif"


@recipe("sub is a folder, expected a raster; give a file in it")
def dem_is_a_folder(k):
    k.dem = k.folder / "sub"
    k.dem.mkdir()


@recipe("/ is a folder, expected a raster")
def dem_is_the_root(k):
    k.dem = Path(k.folder.anchor)


@recipe("--dem: got '', expected a file name")
def dem_is_empty(k):
    k.dem = ""


@recipe("--release: got '', expected a file name")
def release_is_empty(k):
    k.release = ""


@recipe("--thickness: got '', expected a number or a name")
def thickness_is_empty(k):
    k.options = ["--thickness", ""]


@recipe("not a raster that GDAL can read")
def dem_is_a_vector(k):
    k.dem = k.vector("v.geojson", ring())


@recipe("no such EPSG code")
def crs_unknown(k):
    k.options = ["--crs", "EPSG:99999"]


@recipe("expected EPSG:n")
def crs_is_words(k):
    k.options = ["--crs", "utm32"]


@recipe("degrees")
def crs_given_is_geographic(k):
    k.dem = write_dtm(k.folder / "n.tif", crs=None)
    k.options = ["--crs", "EPSG:4326"]


@recipe("complex")
def dem_complex(k):
    k.dem = k.raster("c.tif", np.ones((60, 60), np.complex64))


@recipe("every cell is nodata")
def dem_all_nodata(k):
    k.dem = k.raster("n.tif", np.full((60, 60), -9999.0), nodata=-9999)


@recipe("at least 2 x 2")
def dem_of_one_row(k):
    k.dem = k.raster("r.tif", np.ones((1, 60)) * 9)


@recipe("(row, column) (28, 25)")
def dem_nodata_under_the_release(k):
    heights = np.full((60, 60), 700.0)
    heights[28, 25] = -9999
    k.dem = k.raster("h.tif", heights, nodata=-9999)


@recipe("(row, column) (28, 25)")
def dem_nan_under_the_release(k):
    heights = np.full((60, 60), 700.0)
    heights[28, 25] = np.nan
    k.dem = k.raster("h.tif", heights)


@recipe("elevations are from")
def dem_of_other_numbers(k):
    heights = np.full((60, 60), 700.0)
    heights[3, 3] = -20_000.0
    k.dem = k.raster("h.tif", heights)


# -------------------------------------------------------------------------------------------------------- the release


@recipe("no such file")
def release_missing(k):
    k.release = k.folder / "nowhere.shp"


@recipe("empty (0 bytes)")
def release_empty_file(k):
    k.release = k.file("empty.gpkg", b"")


@recipe("neither a vector file nor a raster")
def release_junk(k):
    k.release = k.file("junk.gpkg", b"\x07" * 500)


@recipe("or damaged")
def release_truncated(k):
    k.release = k.file("cut.fgb", k.vector("whole.fgb", ring(), d0=[1.0]).read_bytes()[:300])


@recipe("neither a vector file nor a raster")
def release_broken_json(k):
    k.release = k.file("cut.geojson", k.vector("whole.geojson", ring(), d0=[1.0]).read_bytes()[:-40])


@recipe("neither a vector file nor a raster")
def release_broken_parquet(k):
    k.release = k.file("cut.parquet", b"PAR1" + b"junk" * 30)


@recipe("contains no feature")
def release_without_features(k):
    k.release = k.folder / "none.gpkg"
    geopandas.GeoDataFrame({"d0": []}, geometry=[], crs="EPSG:32632").to_file(k.release, geometry_type="Polygon")


@recipe("empty geometry")
def release_with_empty_geometry(k):
    k.release = k.vector("e.gpkg", shapely.Polygon(), d0=[1.0])


@recipe("no layer with geometry")
def release_is_a_table(k):
    k.release = k.file("t.csv", b"name,d0\na,1.0\n")


@recipe("no area")
def release_of_zero_area(k):
    k.release = k.vector("z.gpkg", shapely.Polygon([(X, Y), (X + 9, Y), (X + 5, Y)]), d0=[1.0])


@recipe("has no layer 'nothing' with polygons; it has area")
def release_layer_unknown(k):
    k.release = f"{k.release}|layername=nothing"


@recipe("look like degrees")
def release_without_crs_in_degrees(k):
    k.release = k.vector("d.gpkg", shapely.box(9.0, 46.0, 9.01, 46.01), crs=None, d0=[1.0])


# ------------------------------------------------------------------------------------------------------ the thickness


@recipe("its mean thickness is")
def thickness_of_next_to_nothing(k):
    k.options = ["--thickness", "1e-300"]


@recipe("has none of the columns thickness, d0, relth")
def thickness_not_given(k):
    k.release = k.vector("n.gpkg", ring(), depth=[1.0])


@recipe("nor a column of")
def thickness_raster_or_column_missing(k):
    k.options = ["--thickness", "depth_of_snow"]


@recipe("no such file")
def thickness_raster_missing(k):
    k.options = ["--thickness", "thick.tif"]


@recipe("the thickness of all 1 areas is 0")
def thickness_column_of_zeros(k):
    k.release = k.vector("t.gpkg", ring(), d0=[0.0])


@recipe("thickness is nan")
def thickness_column_with_a_gap(k):
    two = shapely.affinity.translate(ring(), 0, 100)
    k.release = k.vector("t.gpkg", ring(), two, d0=[1.0, np.nan])


@recipe("thickness is 0")
def thickness_zero(k):
    k.options = ["--thickness", "0"]


@recipe("thickness is -2")
def thickness_negative(k):
    k.options = ["--thickness=-2"]


@recipe("thickness is nan")
def thickness_nan(k):
    k.options = ["--thickness", "nan"]


@recipe("thickness is inf")
def thickness_infinite(k):
    k.options = ["--thickness", "inf"]


@recipe("'A1', column 'd0': thickness is -1")
def thickness_column_negative(k):
    k.release = k.vector("t.gpkg", ring(), d0=[-1.0], name=["A1"])


@recipe("all values are 0 or nodata")
def mask_of_zeros(k):
    k.release = k.raster("m.tif", np.zeros((60, 60)))


@recipe("has no columns")
def mask_with_a_column(k):
    k.release = k.raster("m.tif", np.eye(60))
    k.options = ["--thickness", "d0"]


@recipe("zero thickness")
def thickness_raster_of_zeros_under_the_release(k):
    values = np.zeros((60, 60))
    values[0, 0] = 1
    k.options = ["--thickness", k.raster("t.tif", values)]


@recipe("or the surface minus the DTM, has no value above 0 there")
def surface_below_the_bed(k):
    k.options = ["--surface", k.raster("s.tif", np.zeros((60, 60)))]


@recipe("exclude each other")
def surface_and_thickness(k):
    k.options = ["--thickness", "2", "--surface", k.raster("s.tif", np.full((60, 60), 2000.0))]


@recipe("contradicts")
def surface_and_normal(k):
    k.options = ["--surface", k.raster("s.tif", np.full((60, 60), 2000.0)), "--thickness-mode", "normal"]


@recipe("are outside the DTM")
def thickness_raster_elsewhere_without_crs(k):
    k.options = ["--thickness", k.raster("t.tif", np.ones((9, 9)), Affine(5, 0, 0, 0, -5, 0), None)]


# -------------------------------------------------------------------------------------------------------- the numbers

NUMBERS = {
    "spacing_wider_than_the_release": ("the side of a square with the area of the release", ["--spacing", "1e9"]),
    "count_zero": ("above 0", ["--count", "0"]),
    "count_negative": ("whole number", ["--count=-5"]),
    "count_a_fraction": ("whole number", ["--count", "10.5"]),
    "count_a_word": ("--count", ["--count", "many"]),
    "count_too_large": ("4000000000", ["--count", "1e12"]),
    "spacing_zero": ("above 0", ["--spacing", "0"]),
    "spacing_nan": ("finite", ["--spacing", "nan"]),
    "spacing_far_too_small": ("at most", ["--spacing", "1e-6"]),
    "per_cell_zero": ("above 0", ["--per-cell", "0"]),
    "per_cell_and_count": ("not allowed with", ["--per-cell", "4", "--count", "9"]),
    "density_negative": ("above 0", ["--density=-1"]),
    "density_infinite": ("finite", ["--density", "inf"]),
    "velocity_one_number": ("expected two numbers", ["--velocity", "3"]),
    "velocity_of_words": ("--velocity", ["--velocity", "a,b"]),
    "velocity_too_fast": ("at least -1000 and up to 1000", ["--velocity", "1e9,0"]),
    "velocity_nan": ("finite", ["--velocity", "nan,0"]),
    "refinement_too_strong": ("0 to 3", ["--refine-slope", "9"]),
    "refinement_negative": ("0 to 3", ["--refine-slope=-1"]),
    "refinement_of_equal_masses": ("refine slope", ["--refine-slope", "1", "--mass", "equal"]),
    "seed_negative": ("at least 0", ["--seed=-1"]),
    "points_unknown": ("invalid choice", ["--points", "sobol"]),
    "mass_unknown": ("invalid choice", ["--mass", "heavy"]),
    "mode_unknown": ("invalid choice", ["--thickness-mode", "sideways"]),
    "option_unknown": ("unrecognized arguments", ["--thicknes-mode", "normal"]),
    "jitter_of_a_prime": ("cut regularly", ["--points", "jittered", "--per-cell", "7"]),
    "output_unknown": ("unknown, expected .h5", ["-o", "out.xyz"]),
    "output_without_suffix": ("unknown, expected .h5", ["-o", "out"]),
    "output_exists": ("exists already", ["-o", "area.gpkg"]),
    "band_zero": ("above 0", ["--dem-band", "0"]),
}


def run(capfd, *arguments):
    """(exit code, lines on stderr, stdout) of `mpmgis seed`; capfd sees what C libraries write, too."""
    capfd.readouterr()
    try:
        code = main(["seed", *map(str, arguments)])
    except SystemExit as stop:  # argparse
        code = stop.code
    out, err = capfd.readouterr()
    return code, err.splitlines(), out


def refused(kitchen, capfd, monkeypatch, words, options):
    monkeypatch.chdir(kitchen.folder)
    before = sorted(path.name for path in kitchen.folder.rglob("*"))
    code, lines, out = run(capfd, "--dem", kitchen.dem, "--release", kitchen.release, *options)
    assert code == 2
    assert out == ""
    assert len(lines) == 1, lines
    assert words in lines[0] and lines[0].startswith("mpmgis")
    assert "Traceback" not in lines[0] and len(lines[0].replace(str(kitchen.folder), "")) < 300
    assert sorted(path.name for path in kitchen.folder.rglob("*")) == before


@pytest.mark.parametrize("name", RECIPES)
def test_broken_files(name, tmp_path, capfd, monkeypatch):
    kitchen = Kitchen(tmp_path)
    spoil, words = RECIPES[name]
    spoil(kitchen)
    refused(kitchen, capfd, monkeypatch, words, kitchen.options)


@pytest.mark.parametrize("name", NUMBERS)
def test_broken_options(name, tmp_path, capfd, monkeypatch):
    words, options = NUMBERS[name]
    refused(Kitchen(tmp_path), capfd, monkeypatch, words, options)


def test_what_is_left_out_is_asked_for(capfd):
    for arguments, words in ((["--dem", "x.tif"], "--release"), (["--release", "x.shp"], "--dem")):
        code, lines, _ = run(capfd, *arguments)
        assert code == 2 and len(lines) == 1 and words in lines[0]


def test_a_read_only_folder(tmp_path, capfd, monkeypatch):
    kitchen = Kitchen(tmp_path)
    monkeypatch.setattr("mpmgis.system.whole_files.Path.mkdir", _denied)
    refused(kitchen, capfd, monkeypatch, "no permission", ["-o", "deep/out.h5"])


def _denied(*arguments, **options):
    raise PermissionError(13, "Permission denied")


def test_the_good_scene_is_good(tmp_path, capfd, monkeypatch):
    """What the recipes spoil is whole before: the refusals above are theirs."""
    monkeypatch.chdir(tmp_path)
    kitchen = Kitchen(tmp_path)
    assert run(capfd, "--dem", kitchen.dem, "--release", kitchen.release, "-q") == (0, [], "area_particles.h5\n")
    assert EAST < X


@pytest.mark.parametrize("asked", [None, "--per-cell", "--count", "--spacing"])
def test_a_release_of_too_many_columns_is_refused_at_once(tmp_path, capsys, monkeypatch, asked):
    """A sparse DTM of 4 km with cells of 1 cm: 40 million cells under 4000 m2; a number that is asked for is not."""
    side, pixel = 400_000, 0.01
    profile = {"driver": "GTiff", "width": side, "height": side, "count": 1, "dtype": "float32", "tiled": True}
    place = {"crs": "EPSG:32632", "transform": Affine(pixel, 0, 0, 0, -pixel, side * pixel)}
    sparse = {"blockxsize": 4096, "blockysize": 4096, "sparse_ok": True, "bigtiff": "YES"}
    with rasterio.open(tmp_path / "d.tif", "w", **profile, **place, **sparse):
        pass
    area = shapely.box(1000, 1000, 1000.5, 1000.5) if asked else shapely.box(1000, 1000, 1080, 1050)
    geopandas.GeoDataFrame({"d0": [2.0]}, geometry=[area], crs="EPSG:32632").to_file(tmp_path / "a.gpkg")
    limit = 1000 if asked else 10e9
    monkeypatch.setattr(seeded_file, "memory_lack", lambda needed: "more memory than is free" if needed > limit else "")
    number = {"--per-cell": ["1"], "--count": ["2500"], "--spacing": ["0.01"]}.get(asked, [])
    options = ["--dem", str(tmp_path / "d.tif"), "--release", str(tmp_path / "a.gpkg"), "-o", str(tmp_path / "s.h5")]
    assert main(["seed", *options, *([asked] if asked else []), *number]) == (0 if asked else 2)
    said = capsys.readouterr().err
    if not asked:
        assert "make 6.4e+08 columns on 4000 m2, which need more memory" in said and "give --spacing" in said
        assert len(said.splitlines()) == 1 or "only those around the release are read" in said
        assert not (tmp_path / "s.h5").exists()
