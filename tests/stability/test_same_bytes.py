"""The same scene gives the same bytes: whole commands in separate processes, on any number of threads, stopped or not,
and with kernels that are compiled again."""

import json
import os
import subprocess
import sys

import pytest
import shapely
from slope_site import SCENE, slide, write_shapes, write_site
from test_run_stages import ALL

# Prints digests of arrays: of seeds, frames and bands. With `stop` every run is interrupted when its third frame is
# written, and continues after it.
CHILD = """
import hashlib, json, os, sys
from pathlib import Path
import numpy as np
import rasterio
from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_digest import content_of
from mpmgis.frames.run_folder import RunFolder
site, out, threads, stop = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], sys.argv[4] == "stop"
os.chdir(site)
done, write = {}, RunFolder.write_frame

def interrupted(folder, frame):
    if folder.frames == 2:
        raise KeyboardInterrupt
    write(folder, frame)

def command(*words):
    code = main(list(map(str, words)) + ["-q"])
    assert code == 0, words

def run(name):
    words = ["run", site / f"{name}.toml", "-o", out / name, "--threads", threads]
    if stop:
        RunFolder.write_frame = interrupted
        assert main(list(map(str, words)) + ["-q"]) == 130
        RunFolder.write_frame = write
        words.append("--resume")
    command(*words)
    done[name] = json.loads((out / name / "run.json").read_text())["result_digest"]
    for path in sorted((out / name).glob("frame_*.h5")):
        done[f"{name} {path.stem}"] = content_of(path)

def export(name, *options):
    folder = out / f"{name}_gis"
    frames = sorted((out / name).glob("frame_*.h5"))
    command("export-raster", *frames, "-o", folder, "--workers", threads, *options)
    for path in sorted(folder.rglob("*.tif")):
        with rasterio.open(path) as file:
            done[f"{name} {path.name}"] = hashlib.sha256(file.read().tobytes()).hexdigest()

for points in ("lattice", "halton", "random"):
    command("seed", "--dem", "dtm.tif", "--release", "release.geojson", "--thickness", "2", "--points", points,
            "--refine-slope", "0.5" if points == "halton" else "0", "-o", out / f"{points}.h5")
    done[points] = content_of(out / f"{points}.h5")
for name in json.loads(sys.argv[5]):
    run(name)
export("columns", "--products", "maxima,p")
export("single")
command("convert", out / "lattice.h5", "--dem", "dtm.tif", "--spacing", "4", "-o", out / "made.h5")
done["made"] = content_of(out / "made.h5")
print(json.dumps(done))
"""
SCENES = {
    "columns": SCENE.replace("end_time = 30", "end_time = 15") + "maxima = true\n",
    "points": slide(4.0, 2, 0.5),
    "single": slide(4.0, 2, 0.5, more='precision = "float32"'),
    "stages": ALL,
}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The slope with all files of the scenes."""
    folder = write_site(tmp_path_factory.mktemp("same"))
    areas = {
        "block": (100, 180, 140, 220),
        "near": (150, 190, 160, 210),
        "foot": (195, 190, 205, 210),
        "dam": (220, 120, 240, 280),
        "box": (145, 100, 390, 300),
    }
    for name, box in areas.items():
        write_shapes(folder / f"{name}.geojson", [shapely.box(*box)])
    for name, scene in SCENES.items():
        (folder / f"{name}.toml").write_text(scene)
    return folder


def made(site, out, threads, stop=False, cache=None):
    """Name -> digest of the arrays that a separate process makes."""
    out.mkdir()
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_NUM_THREADS"}
    if cache is not None:
        environment["MPMGIS_CACHE_DIR"] = str(cache)
    words = [str(site), str(out), str(threads), "stop" if stop else "whole", json.dumps(list(SCENES))]
    child = [sys.executable, "-c", CHILD, *words]
    done = subprocess.run(child, env=environment, capture_output=True, text=True, timeout=1500)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def reference(site, tmp_path_factory):
    """Made by one thread, without a stop."""
    return made(site, tmp_path_factory.mktemp("reference") / "out", 1)


def require_same(one, other):
    assert one.keys() == other.keys()
    assert [name for name in one if one[name] != other[name]] == []
    assert len(one) > 40


@pytest.mark.thorough
def test_threads_stops_and_processes_change_no_byte(site, reference, tmp_path):
    """Columns with maxima of every step, points in both precisions, stages, exports, kinds of seeds, a conversion."""
    require_same(made(site, tmp_path / "out", 2, stop=True), reference)


@pytest.mark.thorough
def test_digests_differ_between_scenes_and_precisions(reference):
    assert len({reference[name] for name in ("lattice", "halton", "random", *SCENES)}) == 3 + len(SCENES)


@pytest.mark.slow
def test_kernels_compiled_again_change_no_byte(site, reference, tmp_path):
    """Two more compilations than that of the reference, in empty cache folders."""
    for number in (1, 2):
        require_same(made(site, tmp_path / f"out{number}", number, cache=tmp_path / f"cache{number}"), reference)
        assert any((tmp_path / f"cache{number}").rglob("*.nbi"))
