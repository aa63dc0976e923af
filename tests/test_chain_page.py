"""The page from a terrain model to a hazard map: its commands are those of the shipped script, and they work."""

import csv
import os
import shlex
import shutil
import subprocess
import tomllib
from pathlib import Path

import geopandas
import numpy as np
import pytest
import rasterio
import shapely
from test_pages import DOCS, ROOT
from test_tutorial import FENCE, alike, machine

from mpmgis.commands.demo_site import sample_folder
from mpmgis.commands.plugin_forms import plugin_forms
from mpmgis.commands.shell.main import main

PAGE = (DOCS / "guide" / "terrain-to-hazard.md").read_text(encoding="utf-8")
PICTURE = ROOT / "sample_data" / "lava_falls_hazard.png"
PERIODS = (30, 100, 300)


def script():
    return (sample_folder() / "hazard.sh").read_text(encoding="utf-8")


def steps(text):
    """The commands that follow the demo, without those of a cluster."""
    return [
        line for line in text.splitlines() if line.startswith("mpmgis ") and "demo" not in line and "--dask" not in line
    ]


def test_the_page_has_the_commands_of_the_script_in_order():
    assert steps(PAGE) == steps(script()) and len(steps(PAGE)) == 7


def test_the_scenes_differ_in_one_line_and_the_page_shows_one():
    scenes = {years: (sample_folder() / f"hazard_{years}.toml").read_text(encoding="utf-8") for years in PERIODS}
    assert f"```toml\n{scenes[300]}```" in PAGE
    tables = [tomllib.loads(text) for text in scenes.values()]
    assert [table["release"].pop("thickness") for table in tables] == [f"thickness_{years}" for years in PERIODS]
    assert tables[0] == tables[1] == tables[2]


def test_the_toolbox_has_the_forms_that_the_page_names():
    titles = {form["title"]: form["verb"] for form in plugin_forms()["forms"]}
    named = PAGE.split("## In QGIS")[1].split("##")[0].replace("\n", " ").split("*")[1::2]
    assert {titles[title] for title in named} == {shlex.split(line)[1] for line in steps(script())} | {"intensity"}


def test_the_picture_is_small():
    assert PICTURE.stat().st_size < 300_000


@pytest.mark.thorough
@pytest.mark.skipif(os.name == "nt", reason="the script is one of a POSIX shell")
def test_the_script_goes_from_the_terrain_to_the_map(tmp_path):
    site = tmp_path / "site"
    shutil.copytree(sample_folder(), site)
    environment = machine(tmp_path / "bin")
    run = {"cwd": site, "env": environment, "capture_output": True, "text": True, "timeout": 1500}
    done = subprocess.run(["sh", "hazard.sh"], **run)
    assert done.returncode == 0, done.stdout + done.stderr
    said = (done.stdout + done.stderr).splitlines()
    for language, text in FENCE.findall(PAGE):
        for line in text.splitlines() if language == "text" else ():
            assert any(alike(line, shown) for shown in said), f"the page says\n{line}\nand the script said\n{said}"
    assert not [line for line in said if "not assessed" in line or "did not come to rest" in line]

    with rasterio.open(site / "map" / "hazard.tif") as source:
        levels = source.read(1)
    assert (levels == 4).sum() > (levels == 3).sum() > 0 and not (levels == 255).any()
    areas = geopandas.read_file(site / "areas.gpkg")
    reached = [geopandas.read_file(site / f"region_{years}" / "areas.gpkg").area_m2.sum() for years in PERIODS]
    assert reached == sorted(reached) and reached[0] > areas.area.sum()
    with open(site / "exposure" / "release_areas.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["scenario"] for row in rows} == {f"region_{years}" for years in PERIODS}
    assert {row["name"] for row in rows} == {"road", "mast"}


@pytest.mark.thorough
def test_bad_input_is_one_line_that_the_page_names(tmp_path, monkeypatch, capsys):
    shutil.copytree(sample_folder(), tmp_path / "site")
    monkeypatch.chdir(tmp_path / "site")
    with (
        rasterio.open("lava_falls_dem_utm12n_10m.tif") as source,
        rasterio.open("flat.tif", "w", **source.profile) as to,
    ):
        place = source.bounds
        to.write(np.full((1, *source.shape), 700.0, np.float32))
    trees = geopandas.GeoDataFrame(geometry=[shapely.box(*place)], crs="EPSG:32612").to_crs("EPSG:4326")
    trees.to_file("forest.gpkg")
    geopandas.GeoDataFrame({"thickness_100": [1.0]}, geometry=[shapely.box(*place)], crs="EPSG:32612").to_file(
        "areas.gpkg"
    )
    Path("gap.csv").write_text("terrain,mu,xi\nopen,0.2,2000\n")
    before, _, after = Path("hazard_30.toml").read_text().partition("[[zones]]")
    Path("column.toml").write_text(f"{before}mu = 0.2\nxi = 2000\n[numerics]{after.partition('[numerics]')[2]}")
    dem = "--dem lava_falls_dem_utm12n_10m.tif"
    bad = (
        "release --dem flat.tif -o a.gpkg",
        f"release {dem} --forest forest.gpkg -o a.gpkg",
        f"release {dem} --snow-depth 120 -o a.gpkg",
        f"friction-map {dem} --table gap.csv -o friction",
        "region column.toml --releases areas.gpkg -o region",
        "region hazard_30.toml --releases areas.gpkg -o region",
    )
    parts = [line.split("`")[1] for line in PAGE.split("## Messages")[1].splitlines() if "`" in line]
    there = sorted(Path().iterdir())
    for words, part in zip(bad, parts, strict=True):
        assert main(words.split()) == 2
        last = capsys.readouterr().err.splitlines()[-1]
        assert last.startswith(f"mpmgis {words.split()[0]}: ") and part in last, last
    assert sorted(Path().iterdir()) == there
