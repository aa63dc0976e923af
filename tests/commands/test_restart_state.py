"""The state of a restart: what was changed, or cannot be, is refused in a line before any of it is used."""

import json
import shutil
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from random import Random

import h5py
import numpy as np
import pytest
from slope_site import SCENE, contents, slide, write_block_site

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_digest import CONTENT, RESULT, STATE, content_of, require_restartable, state_digest, state_of
from mpmgis.frames.frame_files import read_frame, write_frame
from mpmgis.frames.run_folder import RunFolder
from mpmgis.simulation.preparation import prepare
from mpmgis.simulation.stage_sequence import StageSequence
from mpmgis.system.errors import FormatError

COLUMNS = SCENE.replace("end_time = 30", "end_time = 6").replace("frame_interval = 5", "frame_interval = 2")
SCENES = {
    "columns": COLUMNS + "maxima = true\n",
    "points": slide(10.0, 0.6, 0.2),
    "inflow": COLUMNS.replace(
        '[release]\nsource = "release.geojson"\nthickness = 2.0\ndensity = 1000\n',
        '[hydrograph]\nsource = "release.geojson"\nfile = "inflow.csv"\n',
    ),
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A site, and of each scene the folder of a run that is said to have been interrupted before its last frame."""
    site = write_block_site(tmp_path_factory.mktemp("state"))
    (site / "inflow.csv").write_text("time,discharge\n0,500\n10,500\n")
    for name, scene in SCENES.items():
        (site / f"{name}.toml").write_text(scene)
        assert main(["run", str(site / f"{name}.toml"), "-q", "-o", str(site / name)]) == 0
    return site


def interrupted(site, name, folder):
    """A copy of a run as a kill during its last interval leaves it; the path of its newest frame."""
    shutil.copytree(site / name, folder)
    newest = sorted(folder.glob("frame_*.h5"))[-1]
    newest.unlink()
    record = json.loads((folder / "run.json").read_text()) | {"state": "running"}
    (folder / "run.json").write_text(json.dumps(record))
    return sorted(folder.glob("frame_*.h5"))[-1]


def resumed(site, name, folder, capsys):
    """(exit code, stderr) of `mpmgis run --resume`."""
    capsys.readouterr()
    code = main(["run", str(site / f"{name}.toml"), "-q", "-o", str(folder), "--resume"])
    return code, capsys.readouterr().err


def arrays_of(path):
    with h5py.File(path) as file:
        return {name: data[()] for name, data in file["state"].items()}


def change(values, random):
    """One value of an array, changed by as little as can be."""
    values = values.copy()
    flat = values.reshape(-1)
    k = random.randrange(flat.size)
    flat[k] = np.nextafter(flat[k], np.inf) if values.dtype.kind == "f" else flat[k] ^ 1
    return values


def rewrite(path, name, values):
    """The array `state/name` in the file at `path` again."""
    with h5py.File(path, "r+") as file:
        del file["state"][name]
        file["state"].create_dataset(name, data=values)


@pytest.mark.parametrize("name", SCENES)
def test_a_run_continues_from_what_was_not_changed(runs, tmp_path, capsys, name):
    newest = interrupted(runs, name, tmp_path / "cut")
    assert require_restartable(newest, Path(newest.parent / "none")) is True
    assert resumed(runs, name, tmp_path / "cut", capsys) == (0, "")
    assert contents(tmp_path / "cut") == contents(runs / name)


@pytest.mark.parametrize("name", SCENES)
def test_one_changed_value_is_refused(runs, tmp_path, capsys, name):
    newest, random = interrupted(runs, name, tmp_path / "cut"), Random(name)
    whole = newest.read_bytes()
    changed = [array for array, values in arrays_of(newest).items() if values.size]
    assert {"rows", "counts", "clock", "events"} <= set(changed)
    for array in changed:
        newest.write_bytes(whole)
        rewrite(newest, array, change(arrays_of(newest)[array], random))
        with pytest.raises(FormatError, match="was changed since it was written"):
            require_restartable(newest, newest.with_name("none"))
    before = {path.name: path.read_bytes() for path in newest.parent.iterdir()}
    code, err = resumed(runs, name, tmp_path / "cut", capsys)
    assert code == 2 and err.count("\n") == 1 and "was changed since it was written" in err
    assert {path.name: path.read_bytes() for path in newest.parent.iterdir()} == before


@pytest.mark.parametrize("what", ["position", "id", "time", "step"])
def test_particles_and_time_belong_to_the_state(runs, tmp_path, what):
    newest = interrupted(runs, "columns", tmp_path / "cut")
    with h5py.File(newest, "r+") as file:
        if what in ("time", "step"):
            file.attrs[what] = file.attrs[what] + 1
        else:
            file["particles"][what][0] = file["particles"][what][0] + 1
    with pytest.raises(FormatError, match="was changed since it was written"):
        require_restartable(newest, newest.with_name("none"))


@pytest.mark.parametrize("attribute", [CONTENT, STATE, RESULT])
def test_a_digest_that_was_changed_or_taken_away_is_refused(runs, tmp_path, attribute):
    newest = interrupted(runs, "columns", tmp_path / "cut")
    before = newest.with_name("frame_000001.h5")
    assert before.exists() and newest.name == "frame_000002.h5"
    with h5py.File(newest, "r+") as file:
        file.attrs[attribute] = "0" * 64
    with pytest.raises(FormatError, match=r"was changed|does not follow"):
        require_restartable(newest, before)
    if attribute != RESULT:  # versions without it are continued, their result has no digest
        with h5py.File(newest, "r+") as file:
            del file.attrs[attribute]
        with pytest.raises(FormatError, match="has no digest"):
            require_restartable(newest, before)


@pytest.mark.thorough
def test_damaged_bytes_are_refused_or_change_nothing(runs, tmp_path):
    """Bits flipped and ends cut off anywhere in the file: a line, or a state that is the same to the bit."""
    newest, random = interrupted(runs, "columns", tmp_path / "cut"), Random(15)
    whole, digest = newest.read_bytes(), prepare(runs / "columns.toml").digest
    sound = state_of(newest)
    refused = 0
    for k in range(150):
        content = bytearray(whole)
        if k % 5:
            content[random.randrange(len(content))] ^= 1 << random.randrange(8)
        else:
            del content[random.randrange(len(content)) :]
        newest.write_bytes(content)
        newest.with_name("frame_000001.h5").unlink(missing_ok=True)
        try:
            frame = RunFolder.resumed(newest.parent).last_frame(digest)
        except FormatError as error:
            assert "\n" not in str(error)
            refused += 1
            continue
        if frame is not None:
            same = frame.state.keys() == sound.keys()
            assert same and all(np.array_equal(frame.state[name], sound[name]) for name in sound)
    assert refused > 50


# --------------------------------------------------------------------------- a state that says it is as it was written


@pytest.fixture(scope="module")
def prepared(runs):
    return {name: prepare(runs / f"{name}.toml") for name in SCENES}


def newest_state(runs, name):
    return read_frame(sorted((runs / name).glob("frame_*.h5"))[-1])


def attacks(values):
    """(what, values that this array cannot have) of one array of a state."""
    if values.dtype.kind == "f":
        for bad in (np.nan, np.inf, -np.inf):
            if values.size:
                broken = values.copy()
                broken.reshape(-1)[values.size // 2] = bad
                yield f"{bad}", broken
    yield "another type", values.astype(np.float32 if values.dtype != np.float32 else np.float64)
    yield "text", "x" * 100
    yield "a number", np.int64(3)
    yield "another shape", np.zeros((*values.shape, 2), values.dtype)
    yield "a row more", np.concatenate([values, values[:1]]) if len(values) else np.zeros((1, *values.shape[1:]))
    if len(values):
        yield "a row less", values[:-1]


@pytest.mark.parametrize("name", SCENES)
def test_arrays_that_cannot_be_are_refused(runs, prepared, name):
    frame = newest_state(runs, name)
    tried = 0
    for array, values in frame.state.items():
        for what, broken in attacks(values):
            with pytest.raises(FormatError) as caught:
                StageSequence(prepared[name]).restore(replace(frame, state=frame.state | {array: broken}))
            assert "\n" not in str(caught.value), (array, what)
            tried += 1
        rest = {other: kept for other, kept in frame.state.items() if other != array}
        with pytest.raises(FormatError):
            StageSequence(prepared[name]).restore(replace(frame, state=rest))
    assert tried > 40


def changed(state, array, place, value):
    values = state[array].copy()
    values[place] = value
    return state | {array: values}


LARGE = 2**62
OUT_OF_RANGE = {
    "columns": [
        ("rows", (0, 0), -1.0),
        ("rows", (0, 1), 1e9),
        ("rows", (5, 0), 1e300),
        ("rows", (0, 8), 0.0),
        ("rows", (0, 9), -1.0),
        *(("counts", k, value) for k in range(10) for value in (-7, LARGE)),
        ("peak_nodes", 0, LARGE),
        ("peak_nodes", 0, -1),
        ("peak_nodes", 1, 0),
        ("clock", 0, 1.0),
        ("events", 0, -1),
        ("events", 0, LARGE),
    ],
    "points": [
        ("keys", 0, -1),
        ("keys", 0, LARGE),
        ("keys", 0, 5 << 42 | 2000 << 21),
        ("keys", 0, 2000 << 42),
        ("rows", (0, 0), 1e6),
        ("rows", (0, 2), -1e6),
        ("rows", (0, 7), 0.0),
        *(("counts", k, value) for k in range(5) for value in (-7, LARGE)),
        ("clock", 0, 1.0),
    ],
    "inflow": [("events", 1, -1), ("events", 1, LARGE), ("events", 0, 101)],
}


@pytest.mark.parametrize("name", OUT_OF_RANGE)
def test_numbers_out_of_range_are_refused(runs, prepared, name):
    frame = newest_state(runs, name)
    for array, place, value in OUT_OF_RANGE[name]:
        with pytest.raises(FormatError, match="start with --overwrite"):
            StageSequence(prepared[name]).restore(replace(frame, state=changed(frame.state, array, place, value)))


def test_places_where_mass_left_are_checked(runs, prepared):
    frame = newest_state(runs, "columns")
    for blocks in ([-1], [LARGE], [3, 3], [4, 2]):
        state = frame.state | {
            "left_blocks": np.array(blocks),
            "left_sums": np.zeros((len(blocks), frame.state["left_sums"].shape[1])),
        }
        with pytest.raises(FormatError, match="left_blocks"):
            StageSequence(prepared["columns"]).restore(replace(frame, state=state))


def test_a_made_up_state_of_the_right_digest_is_refused_in_a_line(runs, tmp_path, capsys):
    """Somebody who knows how digests are made writes a frame with rows out of range: refused, and nothing changes."""
    newest = interrupted(runs, "columns", tmp_path / "cut")
    frame = read_frame(newest)
    with h5py.File(newest) as file:
        result = file.attrs[RESULT]
    write_frame(newest, replace(frame, state=changed(frame.state, "rows", (3, 0), 1e12)), "")
    with h5py.File(newest, "r+") as file:
        file.attrs[RESULT] = result
    assert file_is_sound(newest)
    before = {path.name: path.read_bytes() for path in newest.parent.iterdir()}
    code, err = resumed(runs, "columns", tmp_path / "cut", capsys)
    assert code == 2 and err.count("\n") == 1 and "the place of a column east" in err
    assert {path.name: path.read_bytes() for path in newest.parent.iterdir()} == before


def file_is_sound(path):
    with h5py.File(path) as file:
        content, state = file.attrs[CONTENT], file.attrs[STATE]
    return content_of(path) == content and state_digest(content, state_of(path)) == state


def test_small_changes_of_a_made_up_state_never_crash(runs, prepared):
    """Any bit of any array changed: refused, or a state that is possible, which marches."""
    random = Random(7)
    for name in SCENES:
        frame = newest_state(runs, name)
        arrays = [array for array, values in frame.state.items() if values.size]
        for _ in range(60):
            array = random.choice(arrays)
            values = frame.state[array].copy()
            flat = values.reshape(-1).view(np.uint8)
            flat[random.randrange(flat.size)] ^= 1 << random.randrange(8)
            sequence = StageSequence(prepared[name])
            with suppress(FormatError):
                sequence.restore(replace(frame, state=frame.state | {array: values}))
                solver = sequence.solver
                solver.advance(solver.time + 0.05, solver.time + 0.1, 5)
