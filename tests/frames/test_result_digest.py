"""The digest of a result: printed, stored, the same for any number of threads and after a restart, checked by info."""

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from slope_site import SCENE, record, run, write_site

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_digest import AS_WRITTEN
from mpmgis.frames.run_folder import RunFolder


@pytest.fixture(scope="module")
def run_site(tmp_path_factory):
    """The slope and a run on it, with running maxima."""
    folder = write_site(tmp_path_factory.mktemp("digest"))
    assert run(folder, SCENE + "maxima = true\n", "-q", "--threads", "1") == 0
    return folder


@pytest.fixture
def results(run_site, tmp_path):
    """A copy of the run's folder."""
    return Path(shutil.copytree(run_site / "results", tmp_path / "results"))


def facts(path, capsys):
    """Output of `mpmgis info --json`."""
    capsys.readouterr()
    assert main(["info", "--json", str(path)]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_run_prints_its_digest_and_stores_it(run_site, tmp_path, capsys):
    assert main(["run", str(run_site / "scene.toml"), "-o", str(tmp_path / "again"), "--threads", "2"]) == 0
    told = capsys.readouterr().err
    digest = record(tmp_path, "again")["result_digest"]
    assert f"digest of the result: {digest}\n" in told and len(digest) == 64
    assert digest == record(run_site)["result_digest"]
    assert facts(tmp_path / "again", capsys)["frames_are"] == AS_WRITTEN


def test_a_run_that_was_stopped_has_the_same_digest(run_site, tmp_path, monkeypatch, capsys):
    write = RunFolder.write_frame

    def stop(folder, frame):
        if folder.frames == 3:
            raise KeyboardInterrupt
        write(folder, frame)

    words = ["run", str(run_site / "scene.toml"), "-q", "-o", str(tmp_path / "cut")]
    monkeypatch.setattr(RunFolder, "write_frame", stop)
    assert main(words) == 130
    monkeypatch.undo()
    midway = facts(tmp_path / "cut", capsys)
    assert midway["frames_are"] == AS_WRITTEN and midway["result_digest"] == record(tmp_path, "cut")["result_digest"]
    assert main([*words, "--resume"]) == 0
    assert record(tmp_path, "cut")["result_digest"] == record(run_site)["result_digest"] != midway["result_digest"]


def test_another_scene_has_another_digest(run_site, tmp_path):
    (run_site / "other.toml").write_text((SCENE + "maxima = true\n").replace("mu = 0.2", "mu = 0.200000000001"))
    assert main(["run", str(run_site / "other.toml"), "-q", "-o", str(tmp_path / "other")]) == 0
    assert record(tmp_path, "other")["result_digest"] != record(run_site)["result_digest"]


@pytest.mark.parametrize("array", ["particles/velocity", "particles/id", "maxima/speed"])
def test_info_reports_a_frame_that_was_changed(results, array, capsys):
    with h5py.File(results / "frame_000002.h5", "r+") as file:
        values = file[array][()]
        values.flat[-1] += 1
        file[array][...] = values
    assert facts(results, capsys)["frames_are"] == "frame_000002.h5 was changed, or belongs to another run"
    assert facts(results / "frame_000002.h5", capsys)["contents"] == "changed since it was written"
    assert facts(results / "frame_000001.h5", capsys)["contents"] == AS_WRITTEN


def test_info_reports_a_time_that_was_changed(results, capsys):
    with h5py.File(results / "frame_000002.h5", "r+") as file:
        file.attrs["time"] = np.nextafter(file.attrs["time"], 100.0)
    assert "frame_000002.h5 was changed" in facts(results, capsys)["frames_are"]


def test_info_reports_frames_that_are_missing_or_swapped(results, capsys):
    (results / "frame_000006.h5").rename(results / "kept")
    assert facts(results, capsys)["frames_are"] == "frames after frame_000005.h5 are missing"
    (results / "kept").rename(results / "frame_000006.h5")
    (results / "frame_000001.h5").rename(results / "kept")
    assert facts(results, capsys)["frames_are"] == "frame 1 is missing"
    shutil.copy(results / "frame_000003.h5", results / "frame_000001.h5")
    assert facts(results, capsys)["frames_are"] == "frame_000001.h5 was changed, or belongs to another run"


def test_frames_of_a_version_without_digests_are_read_and_not_continued(run_site, results, capsys):
    for path in results.glob("frame_*.h5"):
        with h5py.File(path, "r+") as file:
            del file.attrs["content_sha256"], file.attrs["result_sha256"]
    assert not {"frames_are", "result_digest"} & facts(results, capsys).keys()
    for number in (5, 6):
        (results / f"frame_00000{number}.h5").unlink()
    shutil.copy(run_site / "results" / "frame_000005.h5", results / "frame_000005.h5")
    with h5py.File(results / "frame_000005.h5", "r+") as file:
        del file.attrs["content_sha256"], file.attrs["result_sha256"]
    told = json.loads((results / "run.json").read_text()) | {"state": "interrupted"}
    (results / "run.json").write_text(json.dumps(told))
    before = {path.name: path.read_bytes() for path in results.iterdir()}
    assert main(["run", str(run_site / "scene.toml"), "-q", "-o", str(results), "--resume"]) == 2
    assert "has no digest of the restart state" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in results.iterdir()} == before
