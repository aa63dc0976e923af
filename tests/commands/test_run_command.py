"""`mpmgis run`, `mpmgis effects` and `mpmgis demo` through the command line, with errors in one line."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from refusals import refusal

from mpmgis.commands.demo_site import sample_folder
from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame
from mpmgis.scene import read_scene, scene_from_tables, scene_text, template

RELEASE = 'source = "lava_falls_release_small.shp"\ndensity = 2000'
SCENE = """
[terrain]
dem = "lava_falls_dem_utm12n_10m.tif"
[release]
source = "lava_falls_release_small.shp"
density = 2000
[friction]
law = "Voellmy"
mu = 0.25
xi = 1000
[output]
end_time = 6
frame_interval = 1
"""


@pytest.fixture
def site(tmp_path):
    """A copy of the sample site with a short scene."""
    folder = tmp_path / "site"
    shutil.copytree(sample_folder(), folder)
    (folder / "scene.toml").write_text(SCENE)
    return folder


def digests(folder):
    """Name -> bytes of all particle arrays of every frame."""
    result = {}
    for path in sorted(Path(folder).glob("frame_*.h5")):
        with h5py.File(path) as file:
            result[path.name] = {name: data[()].tobytes() for name, data in file["particles"].items()}
    return result


def test_a_run_writes_its_folder_and_prints_it(site, capsys):
    assert main(["run", str(site / "scene.toml")]) == 0
    out, err = capsys.readouterr()
    assert out.strip() == str(site / "results")
    assert "mass:" in err and "error" in err
    names = sorted(path.name for path in (site / "results").iterdir())
    assert names == [f"frame_{k:06d}.h5" for k in range(7)] + ["run.json", "scene.toml", "terrain.tif"]
    record = json.loads((site / "results" / "run.json").read_text())
    assert record["state"] == "finished" and record["reason"] == "end_time reached"
    assert abs(record["balances"]["mass_error_relative"]) <= 1e-12
    assert {e["effect"]: e["state"] for e in record["effects"]}["curvature"] == "on"
    frame = read_frame(site / "results" / "frame_000006.h5")
    assert frame.time == 6.0 and frame.dem == "terrain.tif" and frame.digest == record["digest"]
    p = frame.particles
    assert np.linalg.norm(p.velocity, axis=1).max() > 5.0
    np.testing.assert_allclose(p.volume, p.area * p.thickness, rtol=1e-12)
    np.testing.assert_allclose(p.mass, 2000.0 * p.volume, rtol=1e-12)


def test_only_the_newest_two_frames_carry_what_a_restart_needs(site):
    assert main(["run", str(site / "scene.toml"), "-q"]) == 0
    with_state = [p.name for p in sorted((site / "results").glob("*.h5")) if "state" in h5py.File(p)]
    assert with_state == ["frame_000005.h5", "frame_000006.h5"]


def test_the_resolved_scene_runs_again_to_the_same_bytes(site):
    assert main(["run", str(site / "scene.toml"), "-q"]) == 0
    assert main(["run", str(site / "results" / "scene.toml"), "-q", "-o", str(site / "again"), "--threads", "1"]) == 0
    assert digests(site / "results") == digests(site / "again")


def test_a_killed_run_resumes_to_the_same_bytes(site):
    """SIGKILL in the middle: no half frame, a lock that blocks nothing, and bitwise the end of a run without a stop."""
    assert main(["run", str(site / "scene.toml"), "-q", "-o", str(site / "whole")]) == 0
    command = [sys.executable, "-m", "mpmgis", "run", str(site / "scene.toml"), "-q", "-o", str(site / "cut")]
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 600
    while not (site / "cut" / "frame_000002.h5").exists() and time.monotonic() < deadline and child.poll() is None:
        time.sleep(0.001)
    child.send_signal(signal.SIGKILL)
    child.wait()
    for path in (site / "cut").glob("frame_*.h5"):
        assert len(read_frame(path).particles) > 0
    assert (site / "cut" / ".lock").is_file()
    assert main(["run", str(site / "scene.toml"), "-q", "-o", str(site / "cut"), "--resume"]) == 0
    assert digests(site / "whole") == digests(site / "cut") and not (site / "cut" / ".lock").exists()


def test_resume_of_a_finished_run_reports_it_and_changes_nothing(site, capsys):
    assert main(["run", str(site / "scene.toml"), "-q"]) == 0
    before = {p: p.stat().st_mtime_ns for p in (site / "results").iterdir()}
    capsys.readouterr()
    assert main(["run", str(site / "scene.toml"), "--resume"]) == 0
    assert "is finished" in capsys.readouterr().err
    assert before == {p: p.stat().st_mtime_ns for p in (site / "results").iterdir()}


def test_resume_of_a_changed_scene_is_refused(site, capsys):
    assert main(["run", str(site / "scene.toml"), "-q"]) == 0
    (site / "scene.toml").write_text(SCENE.replace("mu = 0.25", "mu = 0.3"))
    assert "another scene" in refusal(capsys, "run", site / "scene.toml", "--resume")


def test_resume_without_anything_there_starts_at_the_beginning(site, capsys):
    assert main(["run", str(site / "scene.toml"), "--resume"]) == 0
    assert (
        f"{site / 'results'} contains no run to continue: this one starts from the beginning" in capsys.readouterr().err
    )
    assert len(list((site / "results").glob("frame_*.h5"))) == 7


def test_overwrite_replaces_a_run_and_nothing_else(site, capsys):
    assert main(["run", str(site / "scene.toml"), "-q"]) == 0
    (site / "results" / "notes.txt").write_text("mine")
    assert "exists already" in refusal(capsys, "run", site / "scene.toml")
    (site / "scene.toml").write_text(SCENE.replace("end_time = 6", "end_time = 2"))
    assert main(["run", str(site / "scene.toml"), "-q", "--overwrite"]) == 0
    assert len(list((site / "results").glob("frame_*.h5"))) == 3
    assert (site / "results" / "notes.txt").read_text() == "mine"


def test_a_run_from_a_seed_continues_from_its_columns(site):
    seed = site / "seed.h5"
    dem, release = str(site / "lava_falls_dem_utm12n_10m.tif"), str(site / "lava_falls_release_small.shp")
    assert main(["seed", "--dem", dem, "--release", release, "--density", "1500", "-o", str(seed), "-q"]) == 0
    text = SCENE.replace('source = "lava_falls_release_small.shp"\ndensity = 2000', 'particles = "seed.h5"')
    (site / "scene.toml").write_text(text)
    assert main(["run", str(site / "scene.toml"), "-q"]) == 0
    first, seeded = read_frame(site / "results" / "frame_000000.h5"), read_frame(seed)
    np.testing.assert_array_equal(first.particles.mass, seeded.particles.mass)
    np.testing.assert_allclose(first.particles.thickness, seeded.particles.thickness, rtol=1e-12)


def test_effects_reports_what_is_on_and_why(site, capsys):
    assert main(["effects"]) == 0
    assert "Voellmy" in capsys.readouterr().out
    assert main(["effects", str(site / "scene.toml"), "--json"]) == 0
    decisions = {d["effect"]: d for d in json.loads(capsys.readouterr().out)}
    assert decisions["curvature"]["state"] == "on" and decisions["curvature"]["indicator"] > 0.05
    (site / "scene.toml").write_text(SCENE + '[curvature]\nuse = "off"\n')
    assert main(["effects", str(site / "scene.toml"), "--json"]) == 0
    decisions = {d["effect"]: d for d in json.loads(capsys.readouterr().out)}
    assert decisions["curvature"]["state"] == "off" and decisions["curvature"]["decided_by"] == "forced"


def test_the_template_is_a_scene_and_names_every_key(capsys):
    import tomllib
    from dataclasses import fields

    from mpmgis.scene.tables import TABLES

    assert main(["run", "--template"]) == 0
    text = capsys.readouterr().out
    assert text == template()
    scene = scene_from_tables(tomllib.loads(text))
    assert scene_from_tables(tomllib.loads(scene_text(scene))) == scene
    for name, table in TABLES.items():
        assert f"[{name}]" in text
        for f in fields(table):
            if "kind" in f.metadata:
                assert f"{f.name} = " in text, f"{name}.{f.name}"


def test_demo_ends_in_a_project_and_a_picture(tmp_path, capsys, monkeypatch):
    """The whole workflow on the shipped site, shortened to its first seconds."""
    short = tmp_path / "short"
    shutil.copytree(sample_folder(), short)
    text = (short / "scene.toml").read_text()
    assert "end_time = 240" in text
    (short / "scene.toml").write_text(text.replace("end_time = 240", "end_time = 8"))
    monkeypatch.setattr("mpmgis.commands.demo_site.sample_folder", lambda: short)
    assert main(["demo", "-o", str(tmp_path / "demo")]) == 0
    project, picture = map(Path, capsys.readouterr().out.split())
    assert project == tmp_path / "demo" / "lava_falls_gis" / "lava_falls.qgz" and project.stat().st_size > 1000
    assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" and picture.stat().st_size > 50_000
    (tmp_path / "demo" / "site" / "mine.txt").write_text("x")
    assert "exists already" in refusal(capsys, "demo", "-o", tmp_path / "demo")
    (tmp_path / "own" / "site").mkdir(parents=True)
    (tmp_path / "own" / "site" / "README.md").write_text("mine")
    assert "not written by mpmgis" in refusal(capsys, "demo", "-o", tmp_path / "own", "--overwrite")
    assert (tmp_path / "own" / "site" / "README.md").read_text() == "mine"


def swap(old, new):
    return lambda text: text.replace(old, new)


BAD_SCENES = {
    "unknown table": (lambda t: t + "[frictoin]\nmu = 1\n", "did you mean 'friction'"),
    "unknown key": (swap("density = 2000", "densty = 2000"), "did you mean 'density'"),
    "unknown parameter": (swap("mu = 0.25", "mue = 0.25"), "did you mean 'mu'"),
    "parameter missing": (swap("xi = 1000", ""), "needs xi"),
    "unknown law": (swap('"Voellmy"', '"Voelmy"'), "did you mean 'Voellmy'"),
    "law missing": (swap('law = "Voellmy"', ""), "law is missing"),
    "negative friction": (swap("mu = 0.25", "mu = -0.25"), "at least 0"),
    "friction not finite": (swap("mu = 0.25", "mu = nan"), "finite"),
    "friction as text": (swap("mu = 0.25", 'mu = "0.25"'), "a number"),
    "xi zero": (swap("xi = 1000", "xi = 0"), "at least 1"),
    "density negative": (swap("density = 2000", "density = -5"), "at least 1"),
    "density as boolean": (swap("density = 2000", "density = true"), "a number"),
    "no release": (lambda t: t.split("[release]")[0] + "[output]" + t.split("[output]")[1], "[release] is missing"),
    "no terrain": (lambda t: "[release]" + t.split("[release]")[1], "[terrain] is missing"),
    "no output": (lambda t: t.split("[output]")[0], "[output] is missing"),
    "end time missing": (swap("end_time = 6", ""), "end_time is missing"),
    "end time zero": (swap("end_time = 6", "end_time = 0"), "above 0"),
    "interval longer than the run": (swap("frame_interval = 1", "frame_interval = 60"), "longer than end_time"),
    "a billion frames": (swap("frame_interval = 1", "frame_interval = 1e-9"), "million frames"),
    "dem missing": (swap("lava_falls_dem_utm12n_10m.tif", "nowhere.tif"), "no such file"),
    "dem is no raster": (swap("lava_falls_dem_utm12n_10m.tif", "README.md"), "is not a raster"),
    "release missing": (swap("lava_falls_release_small.shp", "nowhere.shp"), "no such file"),
    "both releases": (swap("density = 2000", 'density = 2000\nparticles = "a.h5"'), "either source or particles"),
    "no source": (swap('source = "lava_falls_release_small.shp"', ""), "either source or particles"),
    "particles missing": (swap(RELEASE, 'particles = "a.h5"'), "no such file"),
    "particles are no frame": (swap(RELEASE, 'particles = "README.md"'), "HDF5"),
    "particles with a density": (
        swap('source = "lava_falls_release_small.shp"', 'particles = "a.h5"'),
        "particles have a density",
    ),
    "comma for a point": (swap("mu = 0.25", "mu = 0,25"), "a point, not a comma"),
    "backslashes": (swap('"lava', '"C:\\U\\lava'), "single quotes"),
    "thickness column missing": (swap("density = 2000", 'thickness = "height"'), "height"),
    "thickness zero": (swap("density = 2000", "thickness = 0"), "above 0"),
    "velocity of three": (swap("density = 2000", "velocity = [1, 2, 3]"), "two numbers"),
    "velocity of words": (swap("density = 2000", 'velocity = ["a", "b"]'), "two numbers"),
    "unknown point set": (swap("density = 2000", 'points = "hexagon"'), "expected staggered, lattice"),
    "points solver": (lambda t: 'solver = "points"\n' + t, "needs [material]"),
    "unknown solver": (lambda t: 'solver = "dem"\n' + t, "this version has columns, points"),
    "unknown form": (lambda t: t + '[numerics]\nform = "steep"\n', "slope, swe"),
    "float32": (lambda t: t + '[numerics]\nprecision = "float32"\n', "float64"),
    "cfl above the limit": (lambda t: t + "[numerics]\ncfl = 1.5\n", "at most 0.9"),
    "cells larger than the terrain": (lambda t: t + "[numerics]\ncell_size = 5000\n", "smaller cell_size"),
    "cells of nothing": (lambda t: t + "[numerics]\ncell_size = 0\n", "above 0"),
    "half a particle": (lambda t: t + "[numerics]\nparticles_per_cell = 0.5\n", "a whole number"),
    "curvature in water": (lambda t: t + '[numerics]\nform = "swe"\n[curvature]\nuse = "on"\n', "slope"),
    "lake on a slope": (lambda t: t + "[still_water]\nlevel = 600\n", "swe"),
    "use misspelt": (lambda t: t + '[curvature]\nuse = "of"\n', "did you mean"),
    "no TOML": (lambda t: "terrain: dem.tif", "TOML"),
    "table as value": (
        lambda t: "terrain = 3\n" + t.replace("[terrain]\n", "[numerics]\n").replace("dem =", "# dem ="),
        "is not a table",
    ),
    "a number of 400 digits": (swap("end_time = 6", "end_time = 6" + 400 * "0"), "300 digits"),
    "a number of 5000 digits": (swap("end_time = 6", "end_time = 6" + 5000 * "0"), "TOML"),
    "mountains of release": (swap("density = 2000", "thickness = 1e9"), "at most 1000"),
    "faster than a rifle": (swap("density = 2000", "velocity = [0, -1e6]"), "at most 1000 m/s"),
    "speed of light": (swap("density = 2000", "speed = 3e8"), "at most 1000"),
    "clamp below one": (lambda t: t + "[numerics]\nclamp = 0.5\n", "at least 1, or 0"),
    "key twice": (swap("mu = 0.25", "mu = 0.25\nmu = 0.3"), "TOML"),
}


@pytest.mark.parametrize("name", BAD_SCENES)
def test_a_bad_scene_is_refused_before_anything_is_written(name, site, capsys):
    change, words = BAD_SCENES[name]
    text = change(SCENE)
    assert text != SCENE
    (site / "scene.toml").write_text(text)
    before = sorted(site.rglob("*"))
    assert words in refusal(capsys, "run", site / "scene.toml")
    assert sorted(site.rglob("*")) == before


def test_bad_arguments_are_refused(site, capsys, tmp_path):
    scene = str(site / "scene.toml")
    assert "no scene is given" in refusal(capsys, "run")
    assert "no such file" in refusal(capsys, "run", tmp_path / "none.toml")
    assert "is a folder, expected a text file" in refusal(capsys, "run", site)
    assert "contradict" in refusal(capsys, "run", scene, "--resume", "--overwrite")
    assert "is a file" in refusal(capsys, "run", scene, "-o", site / "README.md")
    (site / "binary.toml").write_bytes(bytes(range(256)))
    assert "text" in refusal(capsys, "run", site / "binary.toml")
    for wrong in (["--thread", "x"], ["--threads", "0"]):
        with pytest.raises(SystemExit) as stop:
            main(["run", scene, *wrong])
        assert stop.value.code == 2 and capsys.readouterr().err.count("\n") == 1


@pytest.mark.thorough
def test_ctrl_c_ends_a_run_that_resumes(site):
    """SIGINT in the middle: exit code 130, whole frames, and the run continues to the bytes of one never stopped."""
    assert main(["run", str(site / "scene.toml"), "-q", "-o", str(site / "whole")]) == 0
    command = [sys.executable, "-m", "mpmgis", "run", str(site / "scene.toml"), "-q", "-o", str(site / "cut")]
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 600
    while not (site / "cut" / "frame_000001.h5").exists() and time.monotonic() < deadline and child.poll() is None:
        time.sleep(0.001)
    child.send_signal(signal.SIGINT)
    _, err = child.communicate(timeout=600)
    if child.returncode == 130:  # it may have ended by itself just before
        assert "interrupted" in err
        assert json.loads((site / "cut" / "run.json").read_text())["state"] == "interrupted"
    else:
        assert child.returncode == 0
    assert main(["run", str(site / "scene.toml"), "-q", "-o", str(site / "cut"), "--resume"]) == 0
    assert digests(site / "whole") == digests(site / "cut")


def test_a_changed_thickness_raster_is_another_scene(site, capsys):
    import rasterio

    with rasterio.open(site / "lava_falls_dem_utm12n_10m.tif") as dem:
        profile, values = dem.profile, np.zeros(dem.shape, "float32")
    values[115:125, 88:98] = 2.25
    profile.update(dtype="float32", nodata=None)
    scene = SCENE.replace(RELEASE, 'source = "thick.tif"\ndensity = 2000')
    (site / "scene.toml").write_text(scene)
    for depth in (1.0, 1.5):
        with rasterio.open(site / "thick.tif", "w", **profile) as target:
            target.write(values * depth, 1)
        if depth == 1.0:
            assert main(["run", str(site / "scene.toml"), "-q"]) == 0
    assert "another scene" in refusal(capsys, "run", site / "scene.toml", "--resume")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_scenes_from_any_editor(site, encoding):
    """PowerShell writes UTF-16, Notepad a byte order mark."""
    (site / "scene.toml").write_text(SCENE, encoding=encoding)
    assert read_scene(site / "scene.toml").friction.parameters == {"mu": 0.25, "xi": 1000.0}


@pytest.mark.thorough
def test_a_very_large_run_is_not_started_unasked(site, capsys):
    scene = SCENE.replace("end_time = 6", "end_time = 1e6\nstop_at_rest = false")
    (site / "scene.toml").write_text(scene + "[numerics]\ncell_size = 0.5\n")
    assert "--yes" in refusal(capsys, "run", site / "scene.toml")


@pytest.mark.skipif(os.name != "posix" or os.getuid() == 0, reason="root may write everywhere")
def test_a_read_only_place_is_reported(site, capsys):
    (site / "locked").mkdir()
    (site / "locked").chmod(0o500)
    assert "permission" in refusal(capsys, "run", site / "scene.toml", "-o", site / "locked" / "r")


def test_scenes_compare_and_digest_by_their_contents(site):
    a = read_scene(site / "scene.toml")
    (site / "scene.toml").write_text(SCENE.replace("mu = 0.25", "mu    =    0.25  # the same"))
    b = read_scene(site / "scene.toml")
    assert a == b and a.digest("x") == b.digest("x") != a.digest("y")


def test_a_run_reports_predicted_and_actual_time(site, capsys, monkeypatch):
    """Without waiting for a second; the trial changes no bit of the run."""
    monkeypatch.setattr("mpmgis.simulation.cost_prediction.PACE_SECONDS", 0.0)
    assert main(["run", str(site / "scene.toml")]) == 0
    err = capsys.readouterr().err
    assert re.search(r", [\d.]+ GB\n", err) and re.search(r"predicted: about [\d.]+ s\n", err)
    assert re.search(r"wall time [\d.]+ s \(predicted [\d.]+ s\)", err)
    record = json.loads((site / "results" / "run.json").read_text())
    assert 0 < record["predicted_seconds"] < 60
    measured = digests(site / "results")
    monkeypatch.undo()
    assert main(["run", str(site / "scene.toml"), "--overwrite", "-q"]) == 0
    assert digests(site / "results") == measured


def test_a_run_that_may_be_long_is_tried_before_its_first_step(site, capsys, monkeypatch):
    monkeypatch.setattr("mpmgis.simulation.scene_run.SURELY_SHORT", 0.0)
    monkeypatch.setattr("mpmgis.simulation.scene_run.ASK_SECONDS", 1e-9)
    assert main(["run", str(site / "scene.toml"), "-q"]) == 2
    said = capsys.readouterr().err
    assert re.search(r"this run is predicted to take [\d.e-]+ s and [\d.]+ GB \(", said)
    assert not (site / "results").exists()
    assert main(["run", str(site / "scene.toml"), "--yes"]) == 0
    assert re.search(r"predicted before the first step: [\d.e-]+ s and [\d.]+ GB\n", capsys.readouterr().err)
