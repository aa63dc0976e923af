"""Rasters that a run writes itself: those of an export of its frames, also after kills; frames for a restart only."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine
from slope_site import SCENE, record, run, slide, write_block_site, write_shapes

from mpmgis.commands.shell.main import main
from mpmgis.frames.run_maps import tag_summaries
from mpmgis.maps.export import run_rasters
from mpmgis.simulation.scene_run import run as run_into

POINTS = slide(4.0, 2, 0.5)
SINGLE = slide(4.0, 2, 0.5, more='precision = "float32"') + "maxima = true\n"
COLUMNS = SCENE + "maxima = true\narrival_thickness = 0.05\n"
ERODED = SCENE + (
    '[entrainment]\nlaw = "ErosionSpeed"\ncoefficient = 0.005\nsource = "loose.geojson"\nthickness = 0.5\n'
    "density = 1200\n"
)
INFLOW = SCENE.replace('[release]\nsource = "release.geojson"\nthickness = 2.0\ndensity = 1000\n', "") + (
    '[hydrograph]\nsource = "inlet.geojson"\nfile = "inflow.csv"\ndensity = 1000\n'
)
FOREST = SCENE + (
    '[[forest]]\nsource = "forest.geojson"\nstrength = "strength"\ndetrainment = 500\ndrag = 0.01\nfriction = 0.02\n'
)
STAGED = slide(4.0, 3, 0.5, head="", more="particles_per_cell = 4") + (
    '[[stage]]\nsolver = "columns"\nuntil = {time = 1}\n[[stage]]\nsolver = "points"\n'
)
OUTSIDE = slide(5.0, 4, 0.5, head="", more="particles_per_cell = 4") + (
    'maxima = true\n[[stage]]\nsolver = "columns"\nuntil = {time = 1.8}\n'
    '[[stage]]\nsolver = "points"\nwindow = "box.geojson"\noutside = "columns"\nuntil = {time = 3}\n'
    '[[stage]]\nsolver = "columns"\ncell_size = 4\n'
)
SCENES = {
    "columns": COLUMNS,
    "points": POINTS,
    "single": SINGLE,
    "eroded": ERODED,
    "staged": STAGED,
    "inflow": INFLOW,
    "forest": FOREST,
    "outside": OUTSIDE,
}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = write_block_site(tmp_path_factory.mktemp("rasters"))
    write_shapes(folder / "inlet.geojson", [shapely.box(60, 180, 80, 220)])
    write_shapes(folder / "box.geojson", [shapely.box(145, 100, 390, 300)])
    trees = [shapely.box(180, 0, 500, 200), shapely.box(180, 200, 500, 400)]
    write_shapes(folder / "forest.geojson", trees, strength=[1e9, 1000.0])
    write_shapes(folder / "loose.geojson", [shapely.box(60, 150, 300, 250)])
    (folder / "inflow.csv").write_text("time,discharge,speed\n7,0,10\n12,300,10\n22,0,10\n")
    return folder


def with_rasters(scene, cell_size=None):
    """`scene` with rasters = true."""
    size = "" if cell_size is None else f"raster_cell_size = {cell_size}\n"
    return scene.replace("[output]\n", f"[output]\nrasters = true\n{size}")


def rasters_of(folder):
    """name -> (bands, band names, tags, profile) of each raster in `folder`."""
    found = {}
    for path in sorted(Path(folder).rglob("*.tif")):
        with rasterio.open(path) as source:
            tags = source.tags(ns="mpmgis")
            found[path.name] = source.read(masked=False), source.descriptions, tags, (source.transform, source.crs)
    return found


@pytest.mark.parametrize("name", SCENES)
def test_the_rasters_are_those_of_an_export(site, name):
    folder = site / name
    assert run(site, SCENES[name], "-q", "-o", str(folder / "flow")) == 0
    told = record(folder, "flow")
    for cell_size in (None, 7.0):
        options = [] if cell_size is None else ["--cs-e", str(cell_size)]
        export, own = folder / f"export_{cell_size}", folder / f"own_{cell_size}" / "flow"
        whole = ["export-raster", str(folder / "flow"), "-o", str(export), "--no-qgis", "--extent", "dtm", "-q"]
        assert main([*whole, *options]) == 0
        assert run(site, with_rasters(SCENES[name], cell_size), "-q", "-o", str(own)) == 0
        wanted, got = rasters_of(export), rasters_of(own / "maps")
        assert list(got) == list(wanted) and len(got) > 4
        for file, (values, bands, tags, place) in wanted.items():
            assert np.array_equal(got[file][0], values, equal_nan=True), file
            assert got[file][1] == bands and got[file][3] == place
            # the scenes differ in `rasters`; numerical errors are known after the run, when its steps are written
            different = {key for key in {*tags, *got[file][2]} if tags.get(key) != got[file][2].get(key)}
            later = {"numerical_error"} if re.search(r"_\d+\.tif$|^dtm", file) else set()
            assert different <= {"digest", "frames"} | later, file
        again = record(own.parent, "flow")
        assert again["result_digest"] == told["result_digest"] and again["frames"] == told["frames"]
        kept = sorted(path.name for path in own.glob("frame_*.h5"))
        assert kept == ["frame_000000.h5", f"frame_{told['frames'] - 1:06d}.h5"]


KILLED = [("columns", "often"), ("single", "at the ends"), ("eroded", "often")]
ALSO_KILLED = [("columns", "at the ends"), ("single", "often"), ("eroded", "at the ends")]


@pytest.mark.thorough
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.parametrize(
    ("name", "every"), [*KILLED, *(pytest.param(*case, marks=pytest.mark.slow) for case in ALSO_KILLED)]
)
def test_a_killed_run_goes_on_to_the_same_rasters(site, name, every):
    """Kills at any opening, renaming and removal of a file; frames are kept often, or only at the ends."""
    (site / f"{name}.toml").write_text(with_rasters(SCENES[name]))
    script = Path(__file__).with_name("raster_kills.py")
    command = [sys.executable, str(script), str(site), name, every, "3"]
    environment = os.environ | {"NUMBA_THREADING_LAYER": "workqueue"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=900, env=environment)
    assert done.returncode == 0 and done.stdout.endswith("3 kills, all as without\n"), done.stdout + done.stderr


def test_a_later_end_continues_the_rasters(site):
    scene = with_rasters(COLUMNS)
    longer, output = scene.replace("end_time = 30", "end_time = 40"), site / "later" / "flow"
    assert run(site, scene, "-q", "-o", str(output)) == 0
    (site / "longer.toml").write_text(longer)
    assert main(["run", str(site / "longer.toml"), "-q", "--resume", "-o", str(output)]) == 0
    assert run(site, longer, "-q", "-o", str(site / "at_once" / "flow")) == 0
    got, wanted = rasters_of(output), rasters_of(site / "at_once" / "flow")
    assert list(got) == list(wanted)
    for file in wanted:
        assert np.array_equal(got[file][0], wanted[file][0], equal_nan=True), file
        assert got[file][2] == wanted[file][2], file


def test_a_renamed_folder_keeps_the_name_of_its_rasters(site, caplog):
    """One set of rasters, with maxima up to the new end; none of the old end while the run goes on."""
    scene, before, after = with_rasters(COLUMNS), site / "before", site / "after"
    assert run(site, scene, "-q", "-o", str(before)) == 0
    before.rename(after)
    (site / "longer.toml").write_text(scene.replace("end_time = 30", "end_time = 40"))
    again = ["run", str(site / "longer.toml"), "--resume", "-o", str(after)]
    with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemError):
        patch.setattr(run_rasters.RasterWriter, "finish", lambda *_: (_ for _ in ()).throw(SystemError("killed")))
        run_into(site / "longer.toml", after, resume=True)
    rasters = after / "maps" / "rasters"
    assert not list(rasters.glob("*_max.*")) and not list(rasters.glob("*_last.*"))
    with caplog.at_level("INFO", "mpmgis"):
        assert main(again) == 0
    assert "the rasters keep the name that the folder had before: before" in caplog.messages
    names = [*(f"before_{step:04d}.tif" for step in range(9)), "before_last.tif", "before_max.tif"]
    assert sorted(path.name for path in rasters.glob("*.tif")) == names


def test_only_rasters_of_a_run_are_replaced(site, capsys):
    """A folder `maps` of someone else, and other files in it, stay; without `rasters` those of the run are removed."""
    scene, output = with_rasters(COLUMNS), site / "again"
    assert run(site, scene, "-q", "-o", str(output)) == 0
    (output / "maps" / "notes.txt").write_text("mine")
    mine = ("mine.tif", "photo_2023.tif", "wet_snow_max.tif")
    for name in mine:
        (output / "maps" / "rasters" / name).write_text("mine")
    assert run(site, scene, "-q", "-o", str(output)) == 0
    assert len(list((output / "maps" / "rasters").glob("again_*.tif"))) == 9
    assert run(site, COLUMNS, "-q", "-o", str(output)) == 0
    left = sorted(str(path.relative_to(output)) for path in (output / "maps").rglob("*") if path.is_file())
    assert left == ["maps/notes.txt", *(f"maps/rasters/{name}" for name in mine)]
    assert run(site, scene, "-q", "-o", str(output)) == 2
    assert "maps was not written by the run in" in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix", reason="links need rights on Windows")
def test_links_in_the_maps_are_refused(site, tmp_path, capsys):
    output = site / "linked"
    assert run(site, with_rasters(COLUMNS), "-q", "-o", str(output)) == 0
    target = tmp_path / "precious.tif"
    target.write_text("mine")
    step = output / "maps" / "rasters" / "linked_0001.tif"
    step.unlink()
    step.symlink_to(target)
    assert run(site, with_rasters(COLUMNS), "-q", "-o", str(output)) == 2
    assert "linked_0001.tif" in capsys.readouterr().err and target.read_text() == "mine"


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("raster_cell_size = 5\n", "raster_cell_size is used only with rasters = true"),
        ("raster_products = 'p'\n", "raster_products is used only with rasters = true"),
        ("rasters = true\nraster_products = 'p, q'\n", "unknown product 'q'; choose from"),
        ("rasters = true\nraster_cell_size = 0.01\n", "cells, expected at most 4e+08; use a larger raster_cell_size"),
        ("rasters = true\nraster_cell_size = 801\n", "801 m, expected at most the longer side of the DTM, 800 m"),
    ],
)
def test_wrong_settings_are_refused_before_the_run(site, capsys, lines, words):
    assert run(site, COLUMNS + lines, "-o", str(site / "none")) == 2
    assert words in capsys.readouterr().err and not (site / "none").exists()


def test_bands_and_threshold_are_those_of_an_export(site):
    more = "raster_products = 'p, t_vol'\nraster_min_depth = 0.3\n"
    assert run(site, COLUMNS, "-q", "-o", str(site / "chosen" / "flow")) == 0
    words = ["--products", "p,t_vol", "--min-depth", "0.3", "--no-qgis", "--extent", "dtm", "-q"]
    assert main(["export-raster", str(site / "chosen" / "flow"), "-o", str(site / "chosen" / "export"), *words]) == 0
    assert run(site, with_rasters(COLUMNS) + more, "-q", "-o", str(site / "chosen" / "own" / "flow")) == 0
    wanted, got = rasters_of(site / "chosen" / "export"), rasters_of(site / "chosen" / "own" / "flow" / "maps")
    assert list(got) == list(wanted) and len(wanted["flow_0001.tif"][1]) == 6
    for file, (values, bands, _, _) in wanted.items():
        assert np.array_equal(got[file][0], values, equal_nan=True) and got[file][1] == bands, file


@pytest.mark.parametrize("maxima", ["maxima = true\n", ""])
def test_running_maxima_on_a_rotated_dtm(site, maxima):
    """Cells along the axes of the DTM, and maxima in each step, as in an export."""
    place = Affine.translation(400_400, 5_100_200) * Affine.rotation(20) * Affine.translation(-450, 350)
    place *= Affine.scale(10, -10)
    rows, columns = np.mgrid[:70, :90] + 0.5
    heights = 100 + 0.5 * np.maximum(400_400 - (place * (columns, rows))[0], 0)
    profile = {"driver": "GTiff", "height": 70, "width": 90, "count": 1, "dtype": "float64", "crs": "EPSG:32632"}
    with rasterio.open(site / "rotated.tif", "w", transform=place, **profile) as target:
        target.write(heights, 1)
    folder, scene = site / f"rotated_{len(maxima)}", SCENE.replace('"dtm.tif"', '"rotated.tif"') + maxima
    assert run(site, scene, "-q", "-o", str(folder / "flow")) == 0
    for cell_size, options in ((None, []), (7.0, ["--cs-e", "7"])):
        export, own = folder / f"export_{cell_size}", folder / f"own_{cell_size}" / "flow"
        whole = ["export-raster", str(folder / "flow"), "-o", str(export), "--no-qgis", "--extent", "dtm", "-q"]
        assert main([*whole, "--products", "maxima,p", *options]) == 0
        more = with_rasters(scene, cell_size) + 'raster_products = "maxima,p"\n'
        assert run(site, more, "-q", "-o", str(own)) == 0
        wanted, got = rasters_of(export), rasters_of(own / "maps")
        assert list(got) == list(wanted)
        for file, (values, bands, tags, (transform, crs)) in wanted.items():
            assert transform.b != 0 and got[file][1] == bands and got[file][3] == (transform, crs), file
            assert np.array_equal(got[file][0], values, equal_nan=True), file
            assert got[file][2].get("maxima") == tags.get("maxima"), file
        assert [name.split()[0] for name in got["flow_0003.tif"][1]][-4:] == ["h_max", "t_max", "Un_max", "Ut_max"]


def test_the_rasters_are_read_as_an_export(site, capsys):
    """`info` and `intensity` read `maps/` as they read an export."""
    output = site / "read"
    assert run(site, with_rasters(COLUMNS), "-q", "-o", str(output)) == 0
    capsys.readouterr()
    assert main(["info", str(output / "maps"), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["kind"] == "export" and facts["steps"] == 7 and "h_max" in facts["maxima"]
    assert main(["info", str(output), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["frames_are"] == "as written"


def test_a_summary_that_has_its_tags_keeps_its_bytes(site):
    """A run that was killed behind them, before its record, sets them again."""
    output = site / "tagged"
    assert run(site, with_rasters(COLUMNS), "-q", "-o", str(output)) == 0
    path = output / "maps" / "rasters" / "tagged_max.tif"
    before, tags = path.read_bytes(), rasters_of(output)[path.name][2]
    tag_summaries(output, {"numerical_error": tags["numerical_error"]})
    assert path.read_bytes() == before
    tag_summaries(output, {"numerical_error": "1"})
    assert rasters_of(output)[path.name][2] == tags | {"numerical_error": "1"}


def test_the_record_of_a_run_with_maxima_is_shown(site, capsys):
    output = site / "shown"
    assert run(site, COLUMNS, "-q", "-o", str(output)) == 0
    capsys.readouterr()
    assert main(["info", str(output / "run.json")]) == 0
    printed = capsys.readouterr().out
    assert "maxima" in printed and "thickness" in printed and "reached" in printed


def test_commands_on_particles_name_the_rasters(site, caplog):
    output = site / "few"
    assert run(site, with_rasters(COLUMNS), "-q", "-o", str(output)) == 0
    with caplog.at_level("INFO", "mpmgis"):
        assert main(["timeseries", str(output), "--at", "400200,5100200", "-o", str(site / "few.csv")]) == 0
    assert any("keeps the particles of 2 frames only" in line and "maps" in line for line in caplog.messages)
