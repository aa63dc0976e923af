"""`mpmgis run --resume` with a larger end_time: the result equals a run with that end_time."""

import json

import pytest
import shapely
from slope_site import SCENE, contents, record, slide, write_block_site, write_shapes

from mpmgis.commands.shell.main import main

POINTS = slide(5.0, 4, 1)
STAGED = slide(5.0, 4, 1, head="", more="particles_per_cell = 4") + (
    '[[stage]]\nsolver = "columns"\nuntil = {time = 2}\n'
    '[[stage]]\nsolver = "points"\nuntil = {time = 3}\n'
    '[[stage]]\nsolver = "columns"\n'
)
INFLOW = '[hydrograph]\nsource = "inlet.geojson"\nfile = "inflow.csv"\n'
MAXIMA = SCENE + "maxima = true\n"


def lasting(scene, end, interval):
    """`scene` with another end and frame interval."""
    lines = [line for line in scene.splitlines() if not line.startswith(("end_time", "frame_interval"))]
    return "\n".join(lines).replace("[output]", f"[output]\nend_time = {end}\nframe_interval = {interval}") + "\n"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = write_block_site(tmp_path_factory.mktemp("later"))
    write_shapes(folder / "inlet.geojson", [shapely.box(60, 150, 100, 250)])
    (folder / "inflow.csv").write_text("time,discharge\n0,0\n2,300\n30,80\n")
    return folder


def ran(folder, scene, name, *options):
    """Exit code of a run of `scene` into the folder `name`."""
    (folder / f"{name}.toml").write_text(scene)
    return main(["run", str(folder / f"{name}.toml"), "-q", "-o", str(folder / name), *options])


def particles(folder):
    """What the frames hold, but for the state of a restart, which at the earlier end is that of a run that ended."""
    return {key: value for key, value in contents(folder).items() if not key[1].startswith("state/")}


RUNS = {
    "columns, at a frame's time": (MAXIMA, 4, 7, 2),
    "columns, between two frames": (SCENE, 3.3, 6, 1),
    "columns, end and interval that no float holds": (SCENE, 0.7, 1.3, 0.1),
    "points, at a frame's time": (POINTS, 1, 2, 0.5),
    "points, between two frames": (POINTS, 0.9, 2, 0.5),
    "points, a step a frame": (POINTS, 0.06, 0.1, 0.02),
    "inflow": (SCENE + INFLOW, 6, 9, 3),
    "stages, in the last": (STAGED, 3.5, 5, 0.5),
}


@pytest.mark.parametrize("kind", RUNS)
def test_a_finished_run_continues_to_the_bytes_of_a_longer_one(site, tmp_path, kind):
    scene, early, late, interval = RUNS[kind]
    name = f"short_{list(RUNS).index(kind)}"
    assert ran(site, lasting(scene, late, interval), f"{name}_whole") == 0
    assert ran(site, lasting(scene, early, interval), name) == 0
    assert record(site, name)["time"] == early
    assert ran(site, lasting(scene, late, interval), name, "--resume") == 0
    assert particles(site / name) == particles(site / f"{name}_whole")
    again, whole = record(site, name), record(site, f"{name}_whole")
    assert again["result_digest"] == whole["result_digest"] and again["extremes"] == whole["extremes"]
    for part in ("state", "reason", "time", "steps", "frames", "digest", "balances", "events", "scene"):
        assert again[part] == whole[part], part
    assert (site / name / "scene.toml").read_bytes() == (site / f"{name}_whole" / "scene.toml").read_bytes()
    assert ran(site, lasting(scene, late, interval), name, "--resume") == 0  # it is finished now
    assert record(site, name) == again


def test_only_the_end_may_be_another_and_only_a_later_one(site, capsys):
    whole = lasting(SCENE, 3, 1)
    assert ran(site, whole, "only") == 0
    before = contents(site / "only")
    for other in (
        lasting(SCENE, 2, 1),
        lasting(SCENE, 4, 0.5),
        lasting(SCENE.replace("mu = 0.2", "mu = 0.21"), 4, 1),
        lasting(SCENE + "maxima = true\n", 4, 1),
    ):
        assert ran(site, other, "only", "--resume") == 2
        assert "another scene" in capsys.readouterr().err
        assert contents(site / "only") == before


def test_lost_frames_are_reported(site, capsys):
    assert ran(site, lasting(SCENE, 3, 1), "lost") == 0
    (site / "lost" / "frame_000001.h5").unlink()
    (site / "lost.toml").write_text(lasting(SCENE, 4, 1))
    command = ["run", str(site / "lost.toml"), "-o", str(site / "lost"), "--resume"]
    for _ in range(2):  # it continues; then it is finished
        assert main(command) == 0
        said = capsys.readouterr().err
        assert f"{site / 'lost'}: frame 1 is missing; maps and results of this run lack this time, --overwrite" in said
    (site / "lost" / "frame_000007.h5").mkdir()
    assert main(command) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.endswith(
        "frame_000007.h5 is a folder, not a frame; remove it, and --resume continues from the frame before it"
    )
    (site / "lost" / "frame_000007.h5").rmdir()
    for path in (site / "lost").glob("frame_*.h5"):
        path.unlink()
    assert ran(site, lasting(SCENE, 5, 1), "lost", "--resume") == 2
    assert f"{site / 'lost'} contains no frame (frame_*.h5); start again with --overwrite" in capsys.readouterr().err


def test_a_run_that_came_to_rest_stays_as_it_is(site, capsys):
    held = SCENE.replace("mu = 0.2", "mu = 1.2").replace("density = 1000", "density = 1000\nvelocity = [5, 0]")
    assert ran(site, lasting(held, 8, 2), "rest") == 0
    assert record(site, "rest")["reason"] != "end_time reached" and record(site, "rest")["time"] < 8
    before = contents(site / "rest")
    (site / "rest.toml").write_text(lasting(held, 20, 2))
    assert main(["run", str(site / "rest.toml"), "-o", str(site / "rest"), "--resume"]) == 0
    said = capsys.readouterr().err
    assert "is finished: " in said and "the later end_time = 20 s has no effect" in said
    assert contents(site / "rest") == before


def test_a_run_that_stopped_on_its_way_continues_to_a_later_end(site):
    """Stopped during the way, and again right after the first frames of the longer run: the same bytes in the end."""
    assert ran(site, lasting(SCENE, 7, 1), "way_whole") == 0
    assert ran(site, lasting(SCENE, 3, 1), "way") == 0
    (site / "way" / "frame_000003.h5").unlink()  # as a kill before the last frame leaves it
    stopped = record(site, "way") | {"state": "running", "reason": ""}
    (site / "way" / "run.json").write_text(json.dumps(stopped))
    assert ran(site, lasting(SCENE, 5, 1), "way", "--resume") == 0
    assert ran(site, lasting(SCENE, 7, 1), "way", "--resume") == 0
    assert particles(site / "way") == particles(site / "way_whole")
