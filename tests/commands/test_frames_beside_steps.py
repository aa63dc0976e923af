"""Frames are written while the steps after them are computed: they do not change meanwhile, and no error is lost."""

import json
import threading
from copy import deepcopy

import numpy as np
import pytest
from slope_site import SCENE, slide, write_block_site

from mpmgis.commands.shell.main import main
from mpmgis.frames.run_folder import RunFolder
from mpmgis.simulation.preparation import prepare
from mpmgis.simulation.stage_sequence import StageSequence
from mpmgis.system.errors import OutputError

SHORT = SCENE.replace("end_time = 30", "end_time = 6").replace("frame_interval = 5", "frame_interval = 2")
LOOSE = 'law = "ErosionSpeed"\ncoefficient = 0.005\nsource = "release.geojson"\nthickness = 0.5\ndensity = 1200\n'
SCENES = {
    "columns": SHORT + "maxima = true\n",
    "erosion": SHORT + "[entrainment]\n" + LOOSE,
    "points": slide(10.0, 0.6, 0.2),
}


@pytest.fixture
def site(tmp_path):
    return write_block_site(tmp_path)


def arrays_of(frame):
    """Every array of a frame, by group and name."""
    groups = {"particles": frame.particles.arrays(), "state": frame.state, "maxima": frame.maxima}
    groups["bed_change"] = frame.bed_change
    return {(g, n): a for g, values in groups.items() for n, a in values.items() if isinstance(a, np.ndarray)}


@pytest.mark.parametrize("name", SCENES)
def test_a_frame_does_not_change_while_steps_are_computed(site, name):
    (site / "scene.toml").write_text(SCENES[name])
    before, copy, seen = {}, {}, 0
    for frame in StageSequence(prepare(site / "scene.toml"), lambda solver, end: None):
        assert all(np.array_equal(before[key], copy[key], equal_nan=True) for key in copy)
        before = arrays_of(frame)
        copy, seen = deepcopy(before), seen + 1
    assert seen > 2 and copy


def test_frames_are_written_by_another_thread(site, monkeypatch):
    """One at a time, in their order, and all of them before the record says that the run is finished."""
    (site / "scene.toml").write_text(SCENES["columns"])
    write, threads = RunFolder.write_frame, []

    def written(folder, frame):
        threads.append(threading.current_thread())
        write(folder, frame)

    monkeypatch.setattr(RunFolder, "write_frame", written)
    assert main(["run", str(site / "scene.toml"), "-q", "-o", str(site / "out")]) == 0
    assert len(threads) == 4 and len(set(threads)) == 1 and threads[0] is not threading.main_thread()
    assert json.loads((site / "out" / "run.json").read_text())["frames"] == 4


@pytest.mark.parametrize("number", [1, 3], ids=["amid the run", "the last frame"])
def test_an_error_of_writing_ends_the_run(site, monkeypatch, capsys, number):
    (site / "scene.toml").write_text(SCENES["columns"])
    write = RunFolder.write_frame

    def written(folder, frame):
        if folder.frames == number:
            raise OutputError("the disk is full")
        write(folder, frame)

    monkeypatch.setattr(RunFolder, "write_frame", written)
    assert main(["run", str(site / "scene.toml"), "-q", "-o", str(site / "out")]) != 0
    assert "the disk is full" in capsys.readouterr().err
    record = json.loads((site / "out" / "run.json").read_text())
    assert record["state"] == "running" and len(list((site / "out").glob("frame_*.h5"))) == number
