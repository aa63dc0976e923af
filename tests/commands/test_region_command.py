"""`mpmgis region`: areas in windows against single runs, maps against NumPy, larger windows, second starts."""

import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import geopandas
import numpy as np
import pandas as pd
import pytest
import rasterio
import shapely
from affine import Affine

import mpmgis
from mpmgis.commands.shell.main import main
from mpmgis.frames.headline_numbers import error_words
from mpmgis.studies import area_run
from mpmgis.studies.region_areas import read_areas
from mpmgis.system.errors import InputError, SceneError
from mpmgis.system.messages import collected
from mpmgis.terrain.dtm import TerrainFile
from mpmgis.terrain.release_window import ReleaseWindow, reach_window

WEST, NORTH, PIXEL, ROWS, COLUMNS = 400_000.0, 5_120_000.0, 10.0, 700, 1200
VALLEYS = 3  # slopes of 27 degrees, 4 km apart, each with level ground at its foot
SCENE = """
[terrain]
dem = "dtm.tif"
[release]
thickness = "d0"
density = 1000
[friction]
law = "Coulomb"
mu = 0.3
[numerics]
cell_size = 10.0
particles_per_cell = 4
[output]
end_time = 12
frame_interval = 6
"""


def write_dtm(path):
    x = (np.arange(COLUMNS) + 0.5) * PIXEL % (COLUMNS / VALLEYS * PIXEL)
    heights = np.broadcast_to(np.maximum(0.5 * (1400.0 - x), 0.0) + 100.0, (ROWS, COLUMNS))
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        dtype="float32",
        count=1,
        height=ROWS,
        width=COLUMNS,
        crs="EPSG:32632",
        tiled=True,
        transform=Affine(PIXEL, 0, WEST, 0, -PIXEL, NORTH),
        compress="deflate",
    ) as target:
        target.write(heights.astype(np.float32), 1)


def box(east, south, side=80.0):
    """A square release [m] from the corner of the DTM in the south-west."""
    south += NORTH - ROWS * PIXEL
    return shapely.box(WEST + east, south, WEST + east + side, south + side)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Four areas: one apart in each of two valleys, two that overlap on their way in the third."""
    folder = tmp_path_factory.mktemp("region")
    write_dtm(folder / "dtm.tif")
    shapes = [box(1000, 5000), box(5000, 3000), box(9000, 1000), box(9100, 1000)]
    columns = {"d0": [1.0, 1.5, 2.0, 1.0], "T": [30, 100, 30, 100], "f": [1 / 30, 0.01, 1 / 30, 0.01]}
    geopandas.GeoDataFrame(columns, geometry=shapes, crs="EPSG:32632").to_file(folder / "areas.gpkg")
    (folder / "scene.toml").write_text(SCENE)
    return folder


def region(site, output, **options):
    """The region of the site in `output`, in this process."""
    return mpmgis.region(site / "scene.toml", site / "areas.gpkg", output, **({"workers": 1} | options))


@pytest.fixture(scope="module")
def done(site):
    return region(site, site / "region", scenario="T", frequency="f")


def read(path):
    """float64[bands, rows, columns], NaN where there is no data."""
    with rasterio.open(path) as source:
        return source.read(masked=True).astype(float).filled(np.nan)


def digests(folder):
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted((folder / "maps").glob("*.tif"))
    }


def on_dtm(site, row):
    """float64[3, rows, columns]: h_max, Ut_max, p_max of an area's own raster, on the DTM."""
    with rasterio.open(site / "region" / "runs" / f"{row['digest']}_max.tif") as source:
        names = [name.split(" [")[0] for name in source.descriptions]
        values = source.read(masked=True).astype(float).filled(np.nan)
        top, left = round((NORTH - source.transform.f) / PIXEL), round((source.transform.c - WEST) / PIXEL)
    whole = np.full((3, ROWS, COLUMNS), np.nan)
    part = whole[:, top : top + values.shape[1], left : left + values.shape[2]]
    part[...] = values[[names.index(name) for name in ("h_max", "Ut_max", "p_max")]]
    return whole


def rows_of(found):
    table = geopandas.read_file(found.folder / "areas.gpkg")
    return [row for _, row in table.iterrows()]


def test_every_map_is_the_maximum_and_the_count_of_the_areas(site, done):
    rows = rows_of(done)
    assert done.statuses == {"finished": 4}
    for name, chosen in (("all", rows), ("scenario_30", rows[0::2]), ("scenario_100", rows[1::2])):
        single = np.stack([on_dtm(site, row) for row in chosen])
        depths = np.nan_to_num(single[:, 0])
        for k, key in enumerate(("h_max", "Ut_max", "p_max")):
            expected = np.where(np.isnan(single[:, k]).all(axis=0), np.nan, np.nanmax(single[:, k], axis=0, initial=-1))
            np.testing.assert_array_equal(read(done.folder / "maps" / f"{name}_{key}.tif")[0], expected)
        reached = depths >= np.float32(0.05)
        count, deepest = np.nan_to_num(read(done.folder / "maps" / f"{name}_areas.tif"))
        np.testing.assert_array_equal(count, reached.sum(axis=0))
        numbers = np.array([row["number"] for row in chosen])
        np.testing.assert_array_equal(deepest, np.where(count > 0, numbers[depths.argmax(axis=0)], 0))
        often, chance = np.nan_to_num(read(done.folder / "maps" / f"{name}_probability.tif"))
        expected = np.tensordot([row["f"] for row in chosen], reached, 1)
        np.testing.assert_allclose(often, expected, rtol=1e-6)
        np.testing.assert_allclose(chance, 1 - np.exp(-expected), rtol=1e-6)
    assert count.max() >= 1 and np.nan_to_num(read(done.folder / "maps" / "all_areas.tif"))[0].max() == 2


def test_maps_say_which_flows_moved_at_the_end_and_the_numerical_error_of_the_first(site, done):
    rows = rows_of(done)
    assert done.companion["of"] == "area 1"
    for name, chosen in (("all", rows), ("scenario_30", rows[0::2]), ("scenario_100", rows[1::2])):
        moving = sum(not row["came_to_rest"] for row in chosen)
        with rasterio.open(done.folder / "maps" / f"{name}_h_max.tif") as source:
            tags = source.tags(ns="mpmgis")
        assert (tags["not_at_rest"], tags["came_to_rest"]) == (str(moving), str(not moving).lower())
        assert tags["numerical_error"] == error_words(done.companion)


def test_footprints_have_every_area_that_reaches_a_cell(site, done):
    """As many polygons over a cell as its count says, with the same total area; outlines are smoothed."""
    rows, table = rows_of(done), geopandas.read_file(done.folder / "maps" / "all_footprints.gpkg")
    assert list(table["number"]) == [1, 2, 3, 4] and table.crs.to_epsg() == 32632
    assert list(table["scenario"].astype(int)) == [30, 100, 30, 100] and list(table["frequency"]) == [
        r["f"] for r in rows
    ]
    for row, polygon, footprint in zip(rows, table.geometry, table.to_dict("records"), strict=True):
        depth = np.nan_to_num(on_dtm(site, row)[0])
        reached = depth >= np.float32(0.05)
        assert polygon.area == pytest.approx(reached.sum() * PIXEL**2, rel=0.005)
        assert footprint["h_max_m"] == pytest.approx(depth.max()) and footprint["area_m2"] == pytest.approx(
            polygon.area
        )
    count = np.nan_to_num(read(done.folder / "maps" / "all_areas.tif")[0])
    row, column = (axis[::7] for axis in np.nonzero(count))
    points = shapely.points(WEST + (column + 0.5) * PIXEL, NORTH - (row + 0.5) * PIXEL)
    over = sum(shapely.contains_xy(polygon, shapely.get_coordinates(points)) for polygon in table.geometry)
    assert np.mean(over == count[row, column]) > 0.95 and over.max() == 2


def test_maps_lie_on_the_grid_of_the_dtm(done):
    for path in (path for path in done.files if path.suffix == ".tif"):
        with rasterio.open(path) as source:
            assert source.shape == (ROWS, COLUMNS) and source.crs.to_epsg() == 32632
            assert source.transform == Affine(PIXEL, 0, WEST, 0, -PIXEL, NORTH)
            assert source.block_shapes[0] == (256, 256)


def test_an_area_is_exactly_a_single_run_in_the_same_window(site, done, tmp_path):
    row = rows_of(done)[1]
    window = [float(row[f"window_{side}"]) for side in ("west", "south", "east", "north")]
    one = geopandas.read_file(site / "areas.gpkg").iloc[[1]]
    one.to_file(tmp_path / "one.gpkg")
    text = SCENE.replace('dem = "dtm.tif"', f'dem = "{site / "dtm.tif"}"\nwindow = {window}')
    text = text.replace("[release]", '[release]\nsource = "one.gpkg"').replace("[output]", "[output]\nmaxima = true")
    (tmp_path / "scene.toml").write_text(text)
    assert main(["run", str(tmp_path / "scene.toml"), "-q"]) == 0
    command = ["export-raster", str(tmp_path / "results"), "-o", str(tmp_path / "maps"), "--extent", "dtm", "-q"]
    assert main([*command, "--products", "p,maxima", "--no-qgis"]) == 0
    found = next((tmp_path / "maps").rglob("*_max.tif"))
    with rasterio.open(found) as source:
        names = [name.split(" [")[0] for name in source.descriptions]
        single = source.read(names.index("h_max") + 1, masked=True).astype(float).filled(np.nan)
    top, left = round((NORTH - window[3]) / PIXEL), round((window[0] - WEST) / PIXEL)
    own = on_dtm(site, row)[0, top : top + single.shape[0], left : left + single.shape[1]]
    assert np.isfinite(single).sum() > 100
    np.testing.assert_array_equal(own, single)


def test_affected_area_is_that_of_the_map(site, done):
    for row in rows_of(done):
        reached = np.nan_to_num(on_dtm(site, row)[0]) >= np.float32(0.05)
        assert row["area_m2"] == reached.sum() * PIXEL**2 > 80**2


def test_of_equal_areas_the_first_states_the_numerical_error_of_their_run(site, tmp_path):
    twice = geopandas.GeoDataFrame({"d0": [1.0, 1.0]}, geometry=[box(1000, 5000)] * 2, crs="EPSG:32632")
    twice.to_file(tmp_path / "twice.gpkg")
    for before in (0, 2):
        found = mpmgis.region(site / "scene.toml", tmp_path / "twice.gpkg", tmp_path / "region", workers=1)
        assert found.before == before and found.companion["of"] == "area 1"


def test_workers_and_a_killed_start_give_the_same_bytes(site, done, tmp_path):
    two = region(site, tmp_path / "two", scenario="T", frequency="f", workers=2)
    assert digests(two.folder) == digests(done.folder)
    child = (
        "import os, signal, sys\n"
        "from mpmgis.frames.many_runs_folder import RunFiles\n"
        "write, seen = RunFiles.write, []\n"
        "def end(*given):\n"
        "    write(*given)\n"
        "    seen.append(1)\n"
        "    if len(seen) == 2: os.kill(os.getpid(), int(sys.argv[1]))\n"
        "RunFiles.write = end\n"
        "from mpmgis.commands.shell.main import main\n"
        "main(sys.argv[2:])\n"
    )
    words = ["region", str(site / "scene.toml"), "--releases", str(site / "areas.gpkg"), "-o", str(tmp_path / "killed")]
    words += ["--scenario", "T", "--frequency", "f", "--workers", "1", "-q"]
    code = subprocess.run([sys.executable, "-c", child, str(int(signal.SIGKILL)), *words], env=os.environ).returncode
    assert code == -signal.SIGKILL and not (tmp_path / "killed" / "maps").exists()
    again = region(site, tmp_path / "killed", scenario="T", frequency="f")
    assert again.before == 2
    assert digests(again.folder) == digests(done.folder)


def test_a_hazard_map_of_the_scenarios_of_a_region(site, done, tmp_path):
    """Levels are those of the maps: medium from 0.05 m of flow, strong where depth and speed are above 1."""
    maps = done.folder / "maps"
    scenarios = {30: maps / "scenario_30", 100: maps / "scenario_100"}
    found = mpmgis.hazard_map("swiss-debris-flow", scenarios, tmp_path / "map", dem=site / "dtm.tif")
    highest = np.zeros((ROWS, COLUMNS))
    for name, medium in (("scenario_30", 4), ("scenario_100", 3)):
        depth, speed = (np.nan_to_num(read(maps / f"{name}_{key}.tif")[0]) for key in ("h_max", "Ut_max"))
        level = np.where((depth >= 1.0) & (speed >= 1.0), 4, medium)
        highest = np.maximum(highest, np.where(depth >= np.float32(0.05), level, 0))
    with rasterio.open(tmp_path / "map" / "hazard.tif") as source:
        levels, top = source.read(1), round((NORTH - source.transform.f) / PIXEL)
        left = round((source.transform.c - WEST) / PIXEL)
    np.testing.assert_array_equal(levels, highest[top : top + levels.shape[0], left : left + levels.shape[1]])
    assert (levels > 0).sum() == (highest > 0).sum() > 100 and found.not_assessed == 0.0


def test_the_project_is_the_first_file_and_names_the_others_relative_to_it(done):
    project, areas, *others = done.files
    assert project == done.folder / "maps" / "region.qgz" and areas == done.folder / "areas.gpkg"
    assert {path.with_suffix(".qml") for path in others if path.suffix == ".tif"} <= set(others)
    with zipfile.ZipFile(project) as archive:
        text = archive.read("region.qgs").decode()
    sources = set(re.findall("<datasource>(.*?)</datasource>", text))
    assert {source.split("|")[0] for source in sources} >= {"./../areas.gpkg", "./all_h_max.tif", "./../../dtm.tif"}
    assert all((project.parent / source.split("|")[0]).is_file() for source in sources)


def test_a_region_is_a_result_of_other_commands(done, tmp_path):
    assert mpmgis.intensity(done.folder, "swiss-debris-flow", tmp_path / "classes").areas.sum() == pytest.approx(
        np.count_nonzero(np.nan_to_num(read(done.folder / "maps" / "all_h_max.tif")[0]) >= np.float32(0.05)) * PIXEL**2
    )


@pytest.mark.thorough
def test_a_dask_cluster_gives_the_same_maps(site, done, tmp_path, monkeypatch):
    """Its workers have another working directory than the command, which gets relative paths."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        monkeypatch.chdir(site)
        found = region(
            Path(), tmp_path / "dask", dask=cluster.scheduler_address, scenario="T", frequency="f", workers=None
        )
    assert found.statuses == {"finished": 4} and digests(found.folder) == digests(done.folder)


def test_flow_that_reaches_the_edge_of_its_window_is_run_in_a_larger_one(site, done, tmp_path, monkeypatch):
    narrow = lambda grid, part, polygon, mu, head: ReleaseWindow(*_pixels_around(grid, polygon, 12))  # noqa: E731
    monkeypatch.setattr(area_run, "reach_window", narrow)
    with collected() as lines:
        found = region(site, tmp_path / "narrow", scenario="T", frequency="f")
    assert found.repeated == 4 and any("larger" in str(line) for line in lines)
    table = geopandas.read_file(found.folder / "areas.gpkg")
    assert (table["runs"] > 1).all() and not table["edge_reached"].any()
    assert table["mass_out_share"].max() == 0.0
    whole, narrow = read(done.folder / "maps" / "all_h_max.tif"), read(found.folder / "maps" / "all_h_max.tif")
    np.testing.assert_array_equal(whole, narrow)


def _pixels_around(grid, polygon, margin):
    rows, columns = grid.window(polygon.bounds, margin)
    return rows.start, rows.stop, columns.start, columns.stop


def test_the_window_holds_the_energy_line_on_a_plane(site):
    terrain = TerrainFile(site / "dtm.tif")
    window = reach_window(terrain.grid, terrain.part, box(1000, 5000), 0.25)
    top = 0.5 * (1400 - 1000) + 100  # of the release; the level ground at 100 m is reached where the line ends
    end = 1040 + (top - 100) / 0.25
    assert window.right * PIXEL >= end
    assert window.left * PIXEL <= 1000 and window.shape[0] * PIXEL >= 2 * (top - 100) / 0.25 - 200


def test_scenes_and_columns_that_a_region_cannot_use_are_refused(site, tmp_path):
    with pytest.raises(InputError, match="no such column"):
        region(site, tmp_path / "a", scenario="return_period")
    with pytest.raises(InputError, match="window"):
        (tmp_path / "scene.toml").write_text(SCENE.replace("[release]", "window = [0, 0, 1, 1]\n[release]"))
        mpmgis.region(tmp_path / "scene.toml", site / "areas.gpkg", tmp_path / "b")
    assert not (tmp_path / "a").exists() and not (tmp_path / "b").exists()


def test_a_missing_raster_of_the_scene_is_one_line_before_the_runs(site, tmp_path):
    zones = f'[[zones]]\nmu = "friction/mu.tif"\n[terrain]\ndem = "{site / "dtm.tif"}"'
    (tmp_path / "scene.toml").write_text(SCENE.replace('[terrain]\ndem = "dtm.tif"', zones))
    with pytest.raises(InputError, match=r"mu\.tif: no such file"):
        mpmgis.region(tmp_path / "scene.toml", site / "areas.gpkg", tmp_path / "a")
    assert not (tmp_path / "a").exists()


def test_a_region_that_is_not_confirmed_leaves_no_folder(site, done, tmp_path, monkeypatch):
    """And the files of an earlier region stay."""
    monkeypatch.setattr("mpmgis.studies.many_runs.ASK_SECONDS", -1.0)
    (tmp_path / "empty").mkdir()
    for output in ("new", "new", "empty"):
        with pytest.raises(SceneError, match="4 runs are predicted to take"):
            region(site, tmp_path / output, confirm=lambda question: False)
    assert list(tmp_path.rglob("*")) == [tmp_path / "empty"]
    shutil.copytree(done.folder, tmp_path / "new")
    for record in (tmp_path / "new" / "runs").glob("*.json"):
        record.unlink()
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(SceneError, match="4 runs are predicted to take"):
        region(site, tmp_path / "new", scenario="T", frequency="f", confirm=lambda question: False)
    assert sorted(tmp_path.rglob("*")) == before


def test_areas_without_thickness_are_left_out_with_their_columns(site, tmp_path, caplog):
    areas = geopandas.read_file(site / "areas.gpkg")
    areas["d0"] = [0.0, 1.5, 0.0, 1.0]
    areas.to_file(tmp_path / "areas.gpkg")
    caplog.set_level("INFO", "mpmgis")
    found = read_areas(tmp_path / "areas.gpkg", TerrainFile(site / "dtm.tif"))
    assert "2 of 4 areas have a thickness of 0 and are left out" in caplog.text
    assert [part.thickness for part in found.parts] == [1.5, 1.0] == found.columns["d0"].tolist()
    assert found.columns["T"].tolist() == [100, 100]


@pytest.mark.parametrize("east", [1e5, -1040.0], ids=["far away", "over the edge"])
def test_an_area_that_is_not_on_the_dtm_is_refused_and_the_others_are_run(site, tmp_path, east):
    areas = geopandas.read_file(site / "areas.gpkg")
    beyond = areas.iloc[:1].copy()
    beyond["geometry"] = beyond.translate(east)
    beyond.to_file(tmp_path / "beyond.gpkg")
    with pytest.raises(InputError, match="terrain"):
        mpmgis.region(site / "scene.toml", tmp_path / "beyond.gpkg", tmp_path / "none", workers=1)
    assert not (tmp_path / "none").exists()
    geopandas.GeoDataFrame(pd.concat([areas.iloc[:1], beyond]), crs=areas.crs).to_file(tmp_path / "both.gpkg")
    found = mpmgis.region(site / "scene.toml", tmp_path / "both.gpkg", tmp_path / "one", workers=1)
    assert found.statuses == {"finished": 1, "refused": 1}
