"""`mpmgis intensity` for a block of known depth and speed."""

import sqlite3
from contextlib import closing
from xml.etree import ElementTree

import geopandas
import numpy as np
import pytest
import rasterio
from affine import Affine
from block_frames import CRS, SIDE, table, write_block_run

from mpmgis.commands.shell.main import main

FILES = ["intensity.csv", "intensity.gpkg", "intensity.png", "intensity.qml", "intensity.tif"]
PLACES = (150.0, 450.0, 600.0)  # on the slope at rest, on the flat fast, on the flat at rest: apart from each other


@pytest.fixture
def run(tmp_path):
    return write_block_run(tmp_path, PLACES, speeds=(0.0, 10.0, 0.0))


def areas(folder):
    return {row["name"]: float(row["area_m2"]) for row in table(folder / "intensity.csv")}


def test_fast_and_deep_is_strong_and_all_files_are_consistent(tmp_path, run, capsys):
    assert main(["intensity", str(run), "--guideline", "swiss-debris-flow"]) == 0
    shown = capsys.readouterr().out.splitlines()
    folder = tmp_path / "run_intensity"
    assert sorted(file.name for file in folder.iterdir() if file.suffix) == FILES
    assert "BUWAL (1997)" in shown[1] and "1.00 ha" in shown[4]
    assert shown[5].startswith("strong: number read in FLO-2D")
    assert areas(folder) == {"medium": 2 * SIDE**2, "strong": SIDE**2}
    with rasterio.open(folder / "intensity.tif") as source:
        numbers = source.read(1)
        assert (source.dtypes, source.nodata, source.crs.to_epsg()) == (("uint8",), 0, CRS.to_epsg())
        assert source.colormap(1)[2] == (0xC1, 0x27, 0x2D, 255)
        assert source.tags(ns="mpmgis")["class_2"] == "strong: h >= 1 m and v >= 1 m/s"
        cells = np.bincount(numbers.ravel()) * 100.0
    assert cells[1:].tolist() == [2 * SIDE**2, SIDE**2]
    shapes = geopandas.read_file(folder / "intensity.gpkg")
    assert shapes.crs == CRS and shapes["name"].tolist() == ["medium", "strong"]
    for found in (shapes.geometry.area, shapes["area_m2"]):
        assert found.tolist() == pytest.approx(cells[1:].tolist())
    with closing(sqlite3.connect(folder / "intensity.gpkg")) as database:
        assert database.execute("PRAGMA user_version").fetchone() == (10200,)  # GeoPackage 1.2, as in all other files
        ((style,),) = database.execute("SELECT styleQML FROM layer_styles WHERE f_table_name = 'intensity'")
    rules = ElementTree.fromstring(style.partition(">")[2]).findall(".//rule")
    assert [rule.get("filter") for rule in rules] == ['"class" = 1', '"class" = 2']
    entries = ElementTree.parse(folder / "intensity.qml").findall(".//paletteEntry")
    assert [(entry.get("value"), entry.get("color")) for entry in entries] == [("1", "#ffb000"), ("2", "#c1272d")]


def test_an_export_and_its_frames_have_the_same_classes(tmp_path, run):
    assert main(["export-raster", str(run), "--no-qgis"]) == 0
    for guideline in ("swiss-avalanche", "austrian-torrent-deposit"):
        found = []
        for source in (run, tmp_path / "run_gis"):
            folder = tmp_path / "classes"
            assert main(["intensity", str(source), "--guideline", guideline, "-o", str(folder), "--overwrite"]) == 0
            found.append(areas(folder))
        assert found[0] == found[1] and sum(found[0].values()) == 3 * SIDE**2


def test_what_counts_as_reached_may_be_given_for_an_export_too(tmp_path, run):
    assert main(["export-raster", str(run), "--no-qgis"]) == 0
    for source in (run, tmp_path / "run_gis"):  # 1.79 m normal to the slope, 2 m on the flat
        options = ["--guideline", "swiss-avalanche", "--min-depth", "1.9", "-o", str(tmp_path / "c"), "--overwrite"]
        assert main(["intensity", str(source), *options]) == 0
        assert sum(areas(tmp_path / "c").values()) == 2 * SIDE**2


def test_a_user_guideline_in_one_file(tmp_path, run):
    own = tmp_path / "own.toml"
    own.write_text('[deep]\nsource = "s"\n[[deep.class]]\nname = "deep"\ncolour = "#0000ff"\nwhen = [{ h = 1.9 }]\n')
    options = ["--guidelines", str(own), "--guideline", "deep", "-o", str(tmp_path / "d.tif")]
    assert main(["intensity", str(run), *options]) == 0
    with rasterio.open(tmp_path / "d.tif") as source:  # 2 m upright are 1.79 m normal to the slope
        assert np.count_nonzero(source.read(1)) * 100 == 2 * SIDE**2


def test_rotated_rasters_keep_their_cells(tmp_path, capsys):
    place = Affine.translation(6e5, 5.2e6) * Affine.rotation(30) * Affine(10, 3, 0, 0, -8, 0)
    depth = np.zeros((20, 30), np.float32)
    depth[4:9, 6:16] = 2.0
    profile = {"driver": "GTiff", "width": 30, "height": 20, "count": 1, "dtype": "float32", "crs": CRS.to_wkt()}
    with rasterio.open(tmp_path / "flow_pft.tif", "w", transform=place, **profile) as target:
        target.write(depth, 1)
    options = ["--guideline", "swiss-hillslope-debris-flow", "-o", str(tmp_path / "c.tif")]
    assert main(["intensity", str(tmp_path / "flow"), *options]) == 0
    with rasterio.open(tmp_path / "c.tif") as source:
        assert source.transform.almost_equals(place)
        assert np.array_equal(source.read(1) == 2, depth > 0)


def test_cells_without_speed_are_counted(tmp_path, capsys):
    profile = {"driver": "GTiff", "width": 9, "height": 9, "count": 1, "dtype": "float32", "crs": CRS.to_wkt()}
    place = Affine(10, 0, 6e5, 0, -10, 5.2e6)
    speed = np.full((9, 9), 5.0, np.float32)
    speed[:3] = -9999.0
    for kind, values in (("pft", np.full((9, 9), 2.0, np.float32)), ("pfv", speed)):
        with rasterio.open(tmp_path / f"flow_{kind}.tif", "w", transform=place, nodata=-9999.0, **profile) as target:
            target.write(values, 1)
    options = ["--guideline", "swiss-debris-flow", "-o", str(tmp_path / "c.csv")]
    assert main(["intensity", str(tmp_path / "flow"), *options]) == 0
    assert "27 cells with flow have no value of h_max or Ut_max" in capsys.readouterr().err
    assert [float(row["area_m2"]) for row in table(tmp_path / "c.csv")] == [2700.0, 5400.0]


def test_refusals_are_one_line(tmp_path, run, capsys):
    broken = tmp_path / "broken.toml"
    broken.write_text("[mine\n")
    for arguments, words in (
        (("--guideline", "swiss"), "choose from swiss-debris-flow"),
        (("--guideline", "mine", "--guidelines", broken), "not a readable TOML"),
        (("--guideline", "mine", "--guidelines", tmp_path / "none.toml"), "no such file"),
        (("--guideline", "swiss-flood", "--min-depth", 9), "smaller --min-depth"),
        (("--guideline", "swiss-flood", "-o", tmp_path / "x.shp"), "expected .tif"),
    ):
        capsys.readouterr()
        assert main(["intensity", str(run), *map(str, arguments)]) == 2
        said = capsys.readouterr().err.splitlines()
        assert len(said) == 1 and words in said[0], said
    assert not (tmp_path / "run_intensity").exists()
