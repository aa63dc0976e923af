"""`mpmgis report --map`: hand-made scenarios of known levels, gaps, grids and CRSs, and the printed sheet."""

import datetime
import json
import zipfile
from xml.etree import ElementTree

import geopandas
import numpy as np
import pyproj
import pytest
import rasterio
import shapely
from affine import Affine
from block_frames import SIDE, table, write_block_run

import mpmgis
from mpmgis.commands.shell.main import main
from mpmgis.laws.quantities import BAND
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.raster_output import write_geotiff

FILES = {f"hazard.{suffix}" for suffix in ("tif", "qml", "gpkg", "csv", "pdf", "png", "qgz")} | {"hazard_dtm.tif"}
NORTH_UP = Affine(10, 0, 600000, 0, -10, 5200000)
ROTATED = Affine.translation(600000, 5200000) * Affine.rotation(30) * Affine(10, 3, 0, 0, -8, 0)
CRS = "EPSG:32632"
NODATA = -9999.0


def write_raster(path, values, transform=NORTH_UP, crs=CRS):
    path.parent.mkdir(exist_ok=True)
    values = np.where(np.isnan(values), NODATA, np.asarray(values, float)).astype("float32")
    rows, columns = values.shape
    profile = {"driver": "GTiff", "width": columns, "height": rows, "count": 1, "dtype": "float32", "nodata": NODATA}
    with rasterio.open(path, "w", crs=crs, transform=transform, **profile) as target:
        target.write(values, 1)


def write_peaks(folder, depth, speed=None, **place):
    """Rasters of another code: <folder>/flow_pft.tif and flow_pfv.tif; dry cells are 0."""
    write_raster(folder / "flow_pft.tif", depth, **place)
    if speed is not None:
        write_raster(folder / "flow_pfv.tif", speed, **place)
    return folder


def write_dtm(path, bounds=(599000, 5199000, 602000, 5201000), step=20.0, hole=None, crs=CRS):
    west, south, east, north = bounds
    x, y = np.meshgrid(np.arange(west, east, step), np.arange(north, south, -step))
    heights = 1500.0 - 0.2 * (x - west) + 10 * np.sin(y / 300.0)
    if hole is not None:
        heights[(x >= hole[0]) & (x < hole[2]) & (y > hole[1]) & (y <= hole[3])] = np.nan
    write_raster(path, heights, Affine(step, 0, west, 0, -step, north), crs)
    return path


def levels(path):
    with rasterio.open(path / "hazard.tif" if path.is_dir() else path) as source:
        return source.read(1), source.transform


def run(*arguments):
    return main(["report", "--map", *map(str, arguments)])


@pytest.fixture
def site(tmp_path):
    return write_dtm(tmp_path / "dtm.tif")


# intensity of swiss-flood by depth at 0 m/s; blocks of 4 x 4 cells, rows: 30 years, columns: 100 years
DEPTHS = (0.0, 0.4, 0.6, 2.5)
LEVELS = {30: (0, 3, 4, 4), 100: (0, 3, 3, 4), 300: (0, 2, 3, 4), 1000: (0, 1, 1, 1)}


@pytest.mark.parametrize("transform", [NORTH_UP, ROTATED], ids=["north-up", "rotated and sheared"])
@pytest.mark.parametrize("years", [(30, 100), (100, 300), (300, 1000)])
def test_every_pair_of_intensities_has_the_higher_level_of_the_matrix(tmp_path, site, capsys, years, transform):
    blocks = np.kron(np.arange(4), np.ones(4, int))
    depths = (
        np.array(DEPTHS)[np.meshgrid(blocks, blocks, indexing="ij")[0]],
        np.array(DEPTHS)[np.meshgrid(blocks, blocks, indexing="ij")[1]],
    )
    scenarios = []
    for time, depth in zip(years, depths, strict=True):
        write_peaks(tmp_path / f"s{time}", depth, np.zeros_like(depth), transform=transform)
        scenarios += ["--scenario", f"{time}={tmp_path / f's{time}'}"]
    assert run("swiss-flood", *scenarios, "--dem", site, "-o", tmp_path / "map.tif") == 0
    found, place = levels(tmp_path / "map.tif")
    wanted = np.maximum.outer(LEVELS[years[0]], LEVELS[years[1]])
    assert np.array_equal(found, np.kron(wanted, np.ones((4, 4), int))) and place == transform
    said = capsys.readouterr()
    missing = {30: "high", 100: "medium", 300: "low", 1000: "very low"}
    for time, name in missing.items():
        assert (f"no scenario of {name} probability" in said.err) == (time not in years)


def test_the_project_has_zones_terrain_release_and_a_page(tmp_path, site):
    depth = np.zeros((40, 40))
    depth[10:30, 10:30] = 2.0
    folder = write_peaks(tmp_path / "a", depth)
    release = geopandas.GeoDataFrame(geometry=[shapely.box(600110, 5199750, 600150, 5199790)], crs=CRS)
    release.to_file(folder / "a.gpkg", layer="release")
    options = ["--scenario", f"100={folder}", "--dem", site, "-o", tmp_path / "m"]
    assert run("swiss-hillslope-debris-flow", *options, "--author", "A. Muster") == 0
    with zipfile.ZipFile(tmp_path / "m" / "hazard.qgz") as archive:
        root = ElementTree.fromstring(archive.read("hazard.qgs"))
    names = [layer.findtext("layername") for layer in root.iter("maplayer")]
    assert names[:3] == ["release areas", "hazard zones", "hazard level of each cell"]
    assert names[3].startswith("contours every") and names[4:] == ["hillshade"]
    for layer in root.iter("maplayer"):
        assert (tmp_path / "m" / layer.findtext("datasource").partition("|")[0]).is_file()
    notes, signed = (
        next(item for item in root.iter("LayoutItem") if item.get("id") == name).get("labelText")
        for name in ("notes", "author")
    )
    assert "CRS: WGS 84 / UTM zone 32N" in signed and f"Date of the map: {datetime.date.today()}" in signed
    assert "Author: A. Muster" in signed
    assert "guideline: " in notes and "terrain: contours every" in notes
    shapes = geopandas.read_file(tmp_path / "m" / "hazard.gpkg", layer="release")
    assert list(shapes["years"]) == [100.0] and shapes.geometry.area.sum() == pytest.approx(1600)
    with rasterio.open(tmp_path / "m" / "hazard_dtm.tif") as source:
        west, south, east, north = source.bounds
    assert (east - west) / (north - south) == pytest.approx(196 / 150, rel=0.1) and west < 600100 and east > 600300


def test_files_of_frames_and_an_export(tmp_path, capsys):
    frames = write_block_run(tmp_path, (150.0, 450.0, 600.0), speeds=(0.0, 10.0, 0.0))
    assert main(["export-raster", str(frames), "--no-qgis"]) == 0
    options = ["--scenario", f"300={frames}", "--scenario", f"30={tmp_path / 'run_gis'}", "--scale", "1:5000"]
    assert run("swiss-debris-flow", *options) == 0
    folder = tmp_path / "hazard_map"
    assert {file.name for file in folder.iterdir() if file.suffix} == FILES
    shown = capsys.readouterr().out.splitlines()
    assert any("BUWAL (1997)" in line for line in shown) and str(folder / "hazard.pdf") in shown
    areas = {row["name"]: float(row["area_m2"]) for row in table(folder / "hazard.csv")}
    assert areas["high"] == 3 * SIDE**2  # the frequent scenario alone makes all intensities of debris flows high
    with rasterio.open(folder / "hazard.tif") as source:
        tags = source.tags(ns="mpmgis")
        assert (source.dtypes, source.nodata) == (("uint8",), 0) and source.colormap(1)[4] == (0xD7, 0x19, 0x1C, 255)
        assert tags["class_4"] == "red: high hazard" and tags["scale"] == "1:5000" and "30 years" in tags["scenarios"]
    zones = geopandas.read_file(folder / "hazard.gpkg", layer="zones")
    assert set(zones["name"]) == {"high"} and zones["scenarios"].str.contains("30").all()
    assert zones.geometry.area.sum() == pytest.approx(3 * SIDE**2, rel=5e-3)
    assert zones["guideline"].str.contains("BUWAL").all() and zones["program"].str.startswith("mpmgis").all()
    assert (folder / "hazard.pdf").read_bytes().startswith(b"%PDF")
    assert "paletteEntry" in (folder / "hazard.qml").read_text()


def test_cells_without_data_are_not_free_of_hazard(tmp_path, capsys):
    dtm = write_dtm(tmp_path / "dtm.tif", hole=(600300, 5199800, 600400, 5199900))
    depth = np.zeros((60, 60))
    depth[5:20, 5:20] = 3.0
    gap = depth.copy()
    gap[30:35, 30:40] = np.nan  # within other cells of 0: unknown
    gap[5:7, 5:7] = np.nan
    write_peaks(tmp_path / "a", depth)
    write_peaks(tmp_path / "b", gap)
    options = ["--scenario", f"30={tmp_path / 'a'}", "--scenario", f"100={tmp_path / 'b'}", "--dem", dtm]
    assert run("swiss-hillslope-debris-flow", *options, "-o", tmp_path / "map") == 0
    found, _ = levels(tmp_path / "map")
    assert (found[5:20, 5:20] == 4).all() and (found[30:35, 30:40] == 255).all()
    rows, columns = np.mgrid[:60, :60]
    x, y = NORTH_UP * (columns + 0.5, rows + 0.5)
    hole = (x > 600300) & (x < 600400) & (y > 5199800) & (y < 5199900) & (depth == 0)
    assert hole.any() and (found[hole] == 255).all() and found[50, 5] == 0
    said = capsys.readouterr()
    assert "cells" in said.err and "are not assessed" in said.err and "not assessed, no data" in said.out
    lost = geopandas.read_file(tmp_path / "map" / "hazard.gpkg", layer="not_assessed")
    assert lost["area_m2"].sum() == pytest.approx(np.count_nonzero(found == 255) * 100.0)


def test_without_a_dtm_the_map_reports_it(tmp_path, capsys):
    write_peaks(tmp_path / "a", np.full((20, 20), 2.0))
    assert run("swiss-hillslope-debris-flow", "--scenario", f"30={tmp_path / 'a'}", "-o", tmp_path / "map") == 0
    assert "no DTM is known" in capsys.readouterr().err and (tmp_path / "map" / "hazard.png").is_file()


def test_mixed_grids_have_the_highest_level_of_all_cells_that_meet(tmp_path, site, capsys):
    coarse, fine = np.zeros((10, 10)), np.zeros((40, 40))
    coarse[4, 4] = 2.0  # 20 m cells
    fine[30:32, 3:5] = 2.0  # 10 m cells from 20 m further east and south
    write_peaks(tmp_path / "coarse", coarse, transform=Affine(20, 0, 600000, 0, -20, 5200000))
    shifted = Affine(10, 0, 600025, 0, -10, 5199985)
    write_peaks(tmp_path / "fine", fine, transform=shifted)
    options = ["--scenario", f"30={tmp_path / 'coarse'}", "--scenario", f"300={tmp_path / 'fine'}", "--dem", site]
    assert run("swiss-hillslope-debris-flow", *options, "-o", tmp_path / "map.tif") == 0
    found, place = levels(tmp_path / "map.tif")
    row, column = np.nonzero(found == 4)
    x, y = place * (column + 0.5, row + 0.5)
    assert x.min() <= 600085 and x.max() >= 600095 and y.min() <= 5199905 and y.max() >= 5199915
    assert np.count_nonzero(found == 4) * 100.0 >= 400 + 400  # the coarse cell is covered, not cut
    assert (found == 255).any()  # parts that only one scenario covers
    assert "different cells" in capsys.readouterr().err


def test_other_crs_is_refused_and_the_dtm_is_reprojected_on_request(tmp_path, site, capsys):
    depth = np.zeros((40, 40))
    depth[10:30, 10:30] = 2.0
    write_peaks(tmp_path / "a", depth)
    write_peaks(tmp_path / "b", depth, crs="EPSG:32633")
    a, b = f"30={tmp_path / 'a'}", f"100={tmp_path / 'b'}"
    name = "swiss-hillslope-debris-flow"
    assert run(name, "--scenario", a, "--scenario", b, "--dem", site, "-o", tmp_path / "map") == 2
    assert "EPSG:32633" in capsys.readouterr().err and not (tmp_path / "map").exists()
    to_other = pyproj.Transformer.from_crs(CRS, "EPSG:32633", always_xy=True)
    x, y = to_other.transform([599500, 601500], [5199000, 5200500])
    bounds = min(x) - 500, min(y) - 500, max(x) + 500, max(y) + 500
    other = write_dtm(tmp_path / "other.tif", bounds, crs="EPSG:32633")
    assert run(name, "--scenario", a, "--dem", other, "-o", tmp_path / "map") == 2
    assert "--to-crs auto" in capsys.readouterr().err
    assert run(name, "--scenario", a, "--dem", other, "--to-crs", "auto", "-o", tmp_path / "map.tif") == 0
    assert np.array_equal(levels(tmp_path / "map.tif")[0] == 4, depth > 0)


MEMBERS = 10


@pytest.fixture
def ensemble(tmp_path):
    """An ensemble whose member k reaches 4 + k columns of 20 rows, 1 m deep; half of them fast."""
    folder = tmp_path / "ens"
    (folder / "members").mkdir(parents=True)
    grid = Grid(pyproj.CRS.from_user_input(CRS), NORTH_UP, (40, 40))
    for k in range(MEMBERS):
        depth = np.full((40, 40), np.nan, np.float32)
        depth[10:30, 5 : 9 + k] = 1.0
        speed = np.where(np.isnan(depth), np.nan, 5.0 if k < MEMBERS // 2 else 0.5)
        bands = {"h_max": depth, "Ut_max": speed, "p_max": 1000.0 * speed**2, "t_arrival": speed}
        write_geotiff(folder / "members" / f"{k}_max.tif", grid, [(BAND[name], a) for name, a in bands.items()], {})
    record = {"format": "mpmgis-ensemble", "state": "finished", "members": {"finished": MEMBERS, "unphysical": 1}}
    (folder / "ensemble.json").write_text(json.dumps(record))
    return folder


def test_spread_of_an_ensemble(tmp_path, site, ensemble, capsys):
    assert run("swiss-debris-flow", "--scenario", f"100={ensemble}", "--dem", site, "-o", tmp_path / "map") == 0
    assert "1 members of the ensemble gave no result" in capsys.readouterr().err
    found, _ = levels(tmp_path / "map")
    assert np.count_nonzero(found) == 20 * (4 + MEMBERS - 1)
    with rasterio.open(tmp_path / "map" / "hazard_probability.tif") as source:
        assert source.descriptions[2] == "P_moderate [1]"
        shares = source.read(3)[20], source.read(4)[20]
    reached = np.array([np.mean([column < 9 + k for k in range(MEMBERS)]) for column in range(5, 18)])
    fast = np.array([np.mean([column < 9 + k and k < 5 for k in range(MEMBERS)]) for column in range(5, 18)])
    assert shares[0][5:18] == pytest.approx(reached) and shares[1][5:18] == pytest.approx(fast)
    band = geopandas.read_file(tmp_path / "map" / "hazard.gpkg", layer="uncertainty").set_index("name")
    columns = np.count_nonzero((reached >= 0.1 - 1e-9) & (reached < 0.9 - 1e-9))
    assert band.loc["moderate", "area_m2"] == pytest.approx(columns * 20 * 100.0, rel=0.02)


def test_an_unfinished_or_empty_ensemble_is_refused(tmp_path, site, ensemble, capsys):
    (ensemble / "ensemble.json").write_text(json.dumps({"state": "running"}))
    assert run("swiss-flood", "--scenario", f"100={ensemble}", "--dem", site, "-o", tmp_path / "map") == 2
    assert "has not finished" in capsys.readouterr().err
    for file in (ensemble / "members").iterdir():
        file.unlink()
    assert run("swiss-flood", "--scenario", f"100={ensemble}", "--dem", site, "-o", tmp_path / "map") == 2
    assert "without members" in capsys.readouterr().err


def test_python_gives_the_same(tmp_path, site):
    depth = np.zeros((40, 40))
    depth[10:30, 10:30] = 2.0
    write_peaks(tmp_path / "a", depth)
    found = mpmgis.hazard_map("swiss-hillslope-debris-flow", {30: tmp_path / "a"}, tmp_path / "map", dem=site)
    assert found.areas == pytest.approx([0, 0, 0, 400 * 100.0]) and found.not_assessed == 0
    assert {file.name for file in found.files} == FILES


def test_python_takes_several_results_of_one_return_period(tmp_path, site):
    for name, rows in (("a", slice(5, 10)), ("b", slice(20, 30))):
        depth = np.zeros((40, 40))
        depth[rows, 10:30] = 2.0
        write_peaks(tmp_path / name, depth)
    pairs = [(30, tmp_path / "a"), (30.0, tmp_path / "b")]
    found = mpmgis.hazard_map("swiss-hillslope-debris-flow", pairs, tmp_path / "map.tif", dem=site)
    assert found.areas[3] == pytest.approx(15 * 20 * 100.0)
    with pytest.raises(mpmgis.MpmgisError, match="expected a return period in years"):
        mpmgis.hazard_map("swiss-flood", {"often": tmp_path / "a"}, tmp_path / "other", dem=site)


def test_the_sheet_has_the_scale_and_nothing_covers_the_map(tmp_path):
    from mpmgis.results.hazard.hazard_files import HazardMap, choose_matrix
    from mpmgis.results.hazard.hazard_levels import Hazard
    from mpmgis.results.hazard.hazard_sheet import _drawn, sheet_for
    from mpmgis.results.hazard.zone_outlines import generalized_zones
    from mpmgis.terrain.dtm import read_terrain

    terrain = read_terrain(write_dtm(tmp_path / "dtm.tif"))
    level = np.zeros((40, 100), np.uint8)
    level[5:35, 5:95] = 4
    grid, nothing = Grid(terrain.grid.crs, NORTH_UP, level.shape), np.zeros(level.shape, bool)
    for bounds, wide in (((600050, 5199650, 600950, 5199950), True), ((600050, 5198650, 600150, 5199950), False)):
        sheet = sheet_for(bounds, "A4", None)
        assert (sheet.width > sheet.height) == wide
    with pytest.raises(mpmgis.MpmgisError, match="scale=1:10000"):
        sheet_for((0, 0, 1500, 1400), "A4", 5000.0)
    sheet = sheet_for((600050, 5199650, 600950, 5199950), "A3", 5000.0)
    made = HazardMap(
        choose_matrix("swiss-flood"),
        grid,
        Hazard(level, nothing, nothing),
        [],
        generalized_zones(level, 4, NORTH_UP, 5000, 100.0),
        None,
        5000.0,
        100.0,
        "title",
        tuple((f"fact {k}", "words " * 40) for k in range(30)),
    )
    figure = _drawn(made, terrain, sheet)
    (axes,) = figure.axes
    assert figure.get_size_inches() * 25.4 == pytest.approx([420, 297])
    box = axes.get_position()
    assert box.width * 420e-3 * 5000 == pytest.approx(np.diff(axes.get_xlim())[0])
    assert box.height * 297e-3 * 5000 == pytest.approx(np.diff(axes.get_ylim())[0])
    figure.canvas.draw()
    frame = axes.get_window_extent()
    for artist in (*figure.texts, *figure.artists, *figure.patches[1:]):
        area = artist.get_window_extent()
        over = min(area.x1, frame.x1) - max(area.x0, frame.x0), min(area.y1, frame.y1) - max(area.y0, frame.y0)
        assert min(over) <= 1e-6, artist
        assert area.x1 <= figure.bbox.x1 and area.y0 >= 0, artist
    assert {artist.get_gid() for artist in (*figure.artists, *figure.patches)} >= {"scale bar", "north arrow"}


def test_refusals_are_one_line(tmp_path, site, capsys):
    depth = np.full((20, 20), 2.0)
    a = write_peaks(tmp_path / "a", depth)
    write_peaks(tmp_path / "dry", 0 * depth)
    good = ["--scenario", f"30={a}", "--dem", site]
    for arguments, words in (
        (("--map", "swiss", *good), "choose from swiss-debris-flow"),
        (("--map", "swiss-flood"), "needs at least one --scenario"),
        (("--map", "swiss-flood", "--scenario", a), "expected a return period in years"),
        (("--map", "swiss-flood", "--scenario", f"0={a}"), "expected a return period in years"),
        (("--map", "swiss-flood", "--scenario", f"nan={a}"), "expected a return period in years"),
        (("--map", "swiss-flood", *good), "has no Ut_max"),
        (("--map", "austrian-torrent-deposit", "--scenario", f"300={a}"), "ends at 150 years"),
        (("--map", "swiss-hillslope-debris-flow", *good, "--scale", "5000"), "expected a map scale"),
        (("--map", "swiss-hillslope-debris-flow", *good, "--scale", "1:500"), "do not fit on A4"),
        (("--map", "swiss-hillslope-debris-flow", "--scenario", f"30={tmp_path / 'dry'}"), "no cell has a hazard"),
        (("--map", "swiss-hillslope-debris-flow", "--scenario", f"30={tmp_path / 'no'}"), "no such file"),
        (("--map", "swiss-hillslope-debris-flow", *good, "-o", tmp_path / "x.shp"), "expected .tif"),
        ((a, "--map", "swiss-flood", *good), "takes its results by --scenario"),
        ((a, "--scale", "1:5000"), "is for hazard maps"),
        ((a, "--paper", "A3"), "is for hazard maps"),
        (("--map", "swiss-flood", *good, "--threshold", 0.2), "a hazard map takes --min-depth"),
        ((), "no results were given"),
    ):
        capsys.readouterr()
        assert main(["report", *map(str, arguments)]) == 2, arguments
        said = capsys.readouterr().err.splitlines()
        assert len(said) == 1 and words in said[0], said
    assert not (tmp_path / "hazard_map").exists()


@pytest.mark.parametrize(("rows", "moved"), [(10, 0.0), (20, 30.0)], ids=["other size", "other place"])
def test_rasters_on_different_grids_are_refused(tmp_path, site, capsys, rows, moved):
    write_peaks(tmp_path / "a", np.full((20, 20), 2.0))
    place = NORTH_UP * Affine.translation(moved / 10, 0)
    write_raster(tmp_path / "a" / "flow_pfv.tif", np.full((rows, 20), 2.0), place)
    for words in (
        ["report", "--map", "swiss-flood", "--scenario", f"30={tmp_path / 'a'}"],
        ["intensity", str(tmp_path / "a"), "--guideline", "swiss-flood"],
    ):
        assert main([*words, "--dem", str(site), "-o", str(tmp_path / "map")]) == 2
        said = capsys.readouterr().err.splitlines()
        assert len(said) == 1 and "h_max 20 x 20 cells" in said[0] and "different grids" in said[0]


def test_scenarios_that_decide_are_those_of_the_cells_of_a_level(tmp_path, site):
    """30 years are moderate only where 300 years are high, so that they decide nowhere."""
    rare, often = np.zeros((40, 40)), np.zeros((40, 40))
    rare[10:30, 10:20], rare[10:30, 20:30] = 2.5, 0.6
    often[10:30, 10:20] = 0.2
    write_peaks(tmp_path / "a", often, 0 * often)
    write_peaks(tmp_path / "b", rare, 0 * rare)
    options = ["--scenario", f"30={tmp_path / 'a'}", "--scenario", f"300={tmp_path / 'b'}", "--dem", site]
    assert run("swiss-flood", *options, "-o", tmp_path / "map") == 0
    zones = geopandas.read_file(tmp_path / "map" / "hazard.gpkg", layer="zones").set_index("name")
    assert zones["scenarios"].to_dict() == {"moderate": "300", "high": "300"}
    rows = {row["name"]: row["scenarios"] for row in table(tmp_path / "map" / "hazard.csv")}
    assert rows["moderate"] == rows["high"] == "300"


@pytest.mark.parametrize("moved", [0.0, 5.0], ids=["same cells", "other cells"])
def test_the_map_has_the_crs_that_is_assumed(tmp_path, site, capsys, moved):
    depth = np.zeros((40, 40))
    depth[10:30, 10:30] = 2.0
    write_peaks(tmp_path / "a", depth, crs=None)
    write_peaks(tmp_path / "b", depth, transform=Affine.translation(moved, 0) * NORTH_UP)
    options = ["--scenario", f"30={tmp_path / 'a'}", "--scenario", f"300={tmp_path / 'b'}", "--dem", site]
    assert run("swiss-hillslope-debris-flow", *options, "-o", tmp_path / "map.tif") == 0
    assert "EPSG:32632" in capsys.readouterr().err
    with rasterio.open(tmp_path / "map.tif") as source:
        assert source.crs.to_epsg() == 32632


def test_parts_that_are_enlarged_beyond_the_sheet_are_reported(tmp_path, site, capsys):
    depth = np.zeros((40, 40))
    depth[10:12, 10:12] = 2.0
    write_peaks(tmp_path / "a", depth)
    options = ["--scenario", f"30={tmp_path / 'a'}", "--dem", site, "-o", tmp_path / "one.png", "--overwrite"]
    for more, cut in (([], False), (["--min-area", 1e6], True)):
        assert run("swiss-hillslope-debris-flow", *options, *more) == 0
        assert ("the sheet cuts off" in capsys.readouterr().err) == cut


def test_one_file_by_its_suffix(tmp_path, site):
    depth = np.zeros((40, 40))
    depth[10:30, 10:30] = 2.0
    write_peaks(tmp_path / "a", depth)
    options = ["--scenario", f"30={tmp_path / 'a'}", "--dem", site]
    assert run("swiss-hillslope-debris-flow", *options, "-o", tmp_path / "one.gpkg") == 0
    zones = geopandas.read_file(tmp_path / "one.gpkg", layer="zones")
    square = shapely.box(600100, 5199700, 600300, 5199900)
    off = shapely.symmetric_difference(zones.geometry.iloc[0], square).area  # its corners are rounded
    assert off <= 0.03 * square.area
