"""Scenes with [[stage]] through the command line: columns, points, columns in one run; killed, exported, refused."""

import csv
import json
import signal
import subprocess
import sys

import numpy as np
import pytest
import rasterio
import shapely
from slope_site import (
    CHILD,
    WEST,
    contents,
    distances,
    record,
    refused,
    run,
    slide,
    write_block_site,
    write_raster,
    write_shapes,
)

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame
from mpmgis.simulation.preparation import prepare
from mpmgis.simulation.stage_sequence import StageSequence

SCENE = slide(5.0, 5, 1, head="", more="particles_per_cell = 4") + "maxima = true\n"
DAM = '[[barrier]]\nsource = "dam.geojson"\nheight = 6\nname = "dam"\n'
AREAS = '[[secondary_release]]\nsource = "{}.geojson"\nthickness = 1.0\nthickness_mode = "vertical"\n'
BEFORE = '[[stage]]\nsolver = "columns"\nuntil = {reach = "barrier"}\n'
AMID = '[[stage]]\nsolver = "points"\nwindow = "box.geojson"\nuntil = {time = 4.7}\n'
BESIDE = AMID.replace("until", 'outside = "columns"\nuntil')
AFTER = '[[stage]]\nsolver = "columns"\ncell_size = 4\n'
ALL = SCENE + DAM + AREAS.format("near") + AREAS.format("foot") + BEFORE + AMID + AFTER
INFLOW = '[hydrograph]\nsource = "inlet.geojson"\nfile = "inflow.csv"\n'
COUPLED = SCENE + DAM + AREAS.format("near") + BEFORE + BESIDE + AFTER + INFLOW


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The slope with a block, a dam, two areas at rest, a window."""
    folder = write_block_site(tmp_path_factory.mktemp("stages"))
    write_shapes(folder / "near.geojson", [shapely.box(150, 190, 160, 210)])
    write_shapes(folder / "foot.geojson", [shapely.box(195, 190, 205, 210)])
    write_shapes(folder / "dam.geojson", [shapely.box(220, 120, 240, 280)])
    write_shapes(folder / "box.geojson", [shapely.box(145, 100, 390, 300)])
    write_shapes(folder / "inlet.geojson", [shapely.box(70, 190, 90, 210)])
    (folder / "inflow.csv").write_text("time,discharge\n0,0\n1,100\n4.5,100\n")
    (folder / "all.toml").write_text(ALL)
    return folder


@pytest.fixture(scope="module")
def site(files):
    """The same with one run of all of it, never stopped."""
    assert main(["run", str(files / "all.toml"), "-q", "-o", str(files / "whole")]) == 0
    return files


def frames(site, folder="whole"):
    return [read_frame(path) for path in sorted((site / folder).glob("frame_*.h5"))]


def momentum(frame):
    """Of its particles (east, north, up) [kg m s-1], about as float32 keeps it."""
    return (frame.particles.mass[:, None] * frame.particles.velocity).sum(axis=0)


@pytest.mark.thorough
def test_frames_continue_through_the_stages(site):
    """One frame at each switch, the first of the stage that begins, whenever it begins."""
    shown, told = frames(site), record(site, "whole")
    first, second = (stage["time"] for stage in told["stages"][:2])
    assert second == 4.7 and 2.0 < first < 4.0 and first % 0.25 == 0.0
    times = sorted({0.0, 1.0, 2.0, 3.0, 4.0, 5.0, first, second})
    assert [frame.time for frame in shown] == times
    assert [frame.dimension for frame in shown] == [3 if first <= t < second else 2 for t in times]
    assert {frame.digest for frame in shown} == {told["digest"]}
    steps = [frame.step for frame in shown]
    assert steps == sorted(steps) and steps[-1] == told["steps"]
    assert steps[times.index(first)] == told["stages"][0]["steps"]
    assert [bool(frame.state) for frame in shown] == [False] * (len(shown) - 2) + [True] * 2


@pytest.mark.thorough
def test_mass_and_momentum_are_kept_across_each_switch(site):
    """What was before is what continues and what is booked, to rounding; vertical momentum and energy are reported."""
    told = record(site, "whole")
    for stage, after in zip(told["stages"][:2], told["stages"][1:], strict=True):
        kept = stage["switch"]
        assert abs(kept["mass_error_relative"]) <= 1e-12 and kept["momentum_error_relative"] <= 1e-12
        parts = [kept[name] for name in ("after", "outside", "off", "bed")]
        assert sum(part["mass"] for part in parts) == pytest.approx(kept["before"]["mass"], rel=1e-12)
        scale = np.hypot(*kept["before"]["momentum"][:2])
        for axis in (0, 1):
            gap = sum(part["momentum"][axis] for part in parts) - kept["before"]["momentum"][axis]
            assert abs(gap) <= 1e-12 * scale
        assert kept["before"]["mass"] == pytest.approx(stage["balances"]["mass_now"], rel=1e-12)
        begun = after["balances"]["mass_start"] if "balances" in after else told["balances"]["mass_start"]
        assert begun == pytest.approx(kept["after"]["mass"], rel=1e-12)
        assert kept["after"]["kinetic_horizontal"] > 0.0 and kept["before"]["momentum"][2] < 0.0
        flies = kept["laid_mass"] > 0.01 * kept["before"]["mass"]
        assert flies == any("in flight" in line for line in told["troubles"]) or stage is told["stages"][0]
    assert told["stages"][0]["switch"]["outside"]["mass"] > 0.02 * told["mass"]["released"]
    assert told["stages"][1]["switch"]["outside"]["count"] == 0


@pytest.mark.thorough
def test_the_ledger_of_all_stages_closes(site):
    told = record(site, "whole")
    mass = told["mass"]
    assert abs(mass["error_relative"]) <= 1e-12
    areas = 2 * 1500.0 * 10 * 20
    assert mass["released"] == pytest.approx(1500 * 40 * 40 * 12 * np.sqrt(1.25) + areas, rel=1e-9)
    assert mass["outside_windows"] == told["stages"][0]["switch"]["outside"]["mass"]
    assert mass["on_terrain"] == pytest.approx(frames(site)[-1].particles.mass.sum(), rel=1e-12)
    assert told["events"]["secondary_releases"] == ["near", "foot"]  # the second by the columns after the points
    assert told["stages"][0]["balances"]["mass_released"] == pytest.approx(mass["released"] - 0.5 * areas, rel=1e-9)


@pytest.mark.thorough
def test_the_first_frame_of_a_stage_is_what_the_switch_reports(site):
    """A frame of points is rounded to float32; one of columns is not."""
    shown, told = frames(site), record(site, "whole")
    for stage, tolerance in ((told["stages"][0], 1e-5), (told["stages"][1], 1e-12)):
        frame = next(frame for frame in shown if frame.time == stage["time"])
        after = stage["switch"]["after"]
        assert len(frame.particles) == after["count"]
        assert frame.particles.mass.sum() == pytest.approx(after["mass"], rel=tolerance)
        assert momentum(frame)[0] == pytest.approx(after["momentum"][0], rel=tolerance)
    first = next(frame for frame in shown if frame.dimension == 3)
    assert (first.map_xy()[0] - WEST).min() > 145.0
    assert told["stages"][0]["reason"] == "the flow is within reach of barrier 'dam'"


@pytest.mark.thorough
def test_the_flow_came_within_two_seconds_of_the_dam(site):
    """At the switch and not a look before: 3 depths or what it covers in 2 s."""
    told = record(site, "whole")
    points = next(frame for frame in frames(site) if frame.dimension == 3)
    speed = np.linalg.norm(points.particles.velocity, axis=1)
    ahead = WEST + 220.0 - points.map_xy()[0]
    assert (ahead - 2.0 * speed).min() < 3.0  # points are spread over their columns
    before = [frame for frame in frames(site) if frame.time < told["stages"][0]["time"] - 0.25][-1]
    speed, thickness = np.linalg.norm(before.particles.velocity, axis=1), before.particles.thickness
    assert (WEST + 220.0 - before.map_xy()[0] > np.maximum(2.0 * speed, 3.0 * thickness)).all()


@pytest.mark.thorough
def test_each_stage_has_its_own_table_of_barriers(site):
    """Their columns are the solver's; the last row of a stage is that of its end."""
    told, rows = record(site, "whole"), {}
    for number in (1, 2, 3):
        with open(site / "whole" / f"barriers_{number}.csv", newline="") as file:
            rows[number] = list(csv.reader(file))
    assert not (site / "whole" / "barriers.csv").exists()
    first, second = told["stages"][0]["time"], told["stages"][1]["time"]
    assert (
        float(rows[1][-1][0]) == float(rows[2][1][0]) == first
        and float(rows[2][-1][0]) == float(rows[3][1][0]) == second
    )
    assert "mean moment up [N m]" in rows[2][0] and "mean moment up [N m]" not in rows[1][0]
    assert float(rows[2][1][9]) == 0.0
    taken = told["stages"][1]["balances"]["barriers"]["dam"]["normal_impulse"]
    assert float(rows[2][-1][rows[2][0].index("normal impulse [N s]")]) == taken > 0.0


@pytest.mark.thorough
def test_all_stages_export_as_one_flow(site, tmp_path):
    paths = map(str, sorted((site / "whole").glob("*.h5")))
    given = ["-o", str(tmp_path / "gis"), "--cs-e", "5", "--products", "t_vol", "-q"]
    assert main(["export-raster", *paths, *given]) == 0
    steps = sorted((tmp_path / "gis" / "rasters").glob("whole_000?.tif"))
    assert len(steps) == len(frames(site))
    for path, frame in zip(steps, frames(site), strict=True):
        with rasterio.open(path) as file:
            band = [name.split()[0] for name in file.descriptions].index("t_vol") + 1
            volume = file.read(band, masked=True).sum() * 25 * np.sqrt(1.25)  # t_vol is normal to the slope
        assert volume == pytest.approx(frame.particles.mass.sum() / 1500, rel=1e-5)


@pytest.mark.thorough
def test_the_resolved_scene_runs_again_to_the_same_bytes(site, tmp_path):
    again = ["run", str(site / "whole" / "scene.toml"), "-q", "-o", str(tmp_path / "again"), "--threads", "2"]
    assert main(again) == 0
    one, two = contents(tmp_path / "again"), contents(site / "whole")
    assert one.keys() == two.keys()
    assert all(one[key] == two[key] for key in one if key[1] not in ("time", "state/stages"))  # which tell the digest


# ---------------------------------------------------------------------------------------- columns outside the window


@pytest.fixture(scope="module")
def beside(site):
    """The same run with columns that continue outside the window, and inflow upstream of it."""
    (site / "beside.toml").write_text(COUPLED)
    assert main(["run", str(site / "beside.toml"), "-q", "-o", str(site / "beside")]) == 0
    return site


@pytest.mark.thorough
def test_columns_outside_continue_and_become_points_in_the_window(beside):
    told, shown = record(beside, "beside"), frames(beside, "beside")
    over = told["stages"][1]["balances"]
    outside = over["outside_columns"]
    assert outside["exchanged_columns"] > 20 and outside["exchanged_mass"] > 1e6
    assert abs(over["mass_error_relative"]) <= 1e-12 and over["momentum_error_relative"] <= 1e-12
    released = 1500 * (40 * 40 * 12 * np.sqrt(1.25) + 10 * 20 + 0.5 * 100 * 1.0 + 100 * 3.5)
    assert abs(told["mass"]["error_relative"]) <= 1e-12 and told["mass"]["outside_windows"] == 0.0
    assert told["mass"]["released"] == pytest.approx(released, rel=1e-9)
    assert told["events"]["batches"] > 4
    second = told["stages"][1]["switch"]
    assert abs(second["mass_error_relative"]) <= 1e-12 and second["momentum_error_relative"] <= 1e-12
    assert second["after"]["mass"] == pytest.approx(over["mass_now"], rel=1e-12)
    masses = [frame.particles.mass.sum() for frame in shown]
    assert masses[-1] == pytest.approx(released, rel=1e-9)
    points = [frame for frame in shown if frame.dimension == 3]
    assert len(points) == 2
    for frame in points:  # mass is complete in each of them, upstream of the window too
        x = frame.map_xy()[0] - WEST
        assert x.min() < 130.0 and len(np.unique(frame.particles.id)) == len(x)


def coupled(site):
    """The solver of the second stage, at its start."""
    sequence = StageSequence(prepare(site / "beside.toml"))
    for _ in sequence:
        if sequence.number == 1:
            return sequence.solver


@pytest.mark.thorough
def test_going_back_takes_back_what_was_exchanged(beside):
    """As the guard of a march does, in the same solver; and then it goes the same way again."""
    solver = coupled(beside)
    solver.advance(3.45, 3.75, 10**9)
    kept, told = solver.frame(), []
    for _ in range(2):
        solver.advance(3.75, 4.0, 10**9)
        told.append((solver.balances(), solver.frame().state["rows"], solver.exchanged_columns))
        solver.restore(kept)
        assert solver.time == 3.45 and solver.balances()["mass_now"] == pytest.approx(kept.particles.mass.sum())
    assert told[0][0] == told[1][0] and told[0][2] == told[1][2] > 0
    np.testing.assert_array_equal(told[0][1], told[1][1])


@pytest.mark.thorough
def test_an_exchange_keeps_mass_and_momentum(beside):
    """Of what is taken out of the columns and what comes to the points, to rounding."""
    solver, seen = coupled(beside), []
    exchange = solver._exchange

    def sums():
        parts = solver.parts()
        return sum(p.particles.mass.sum() for p in parts), sum(momentum(p)[:2] for p in parts)

    def watched():
        before, count = sums(), solver.exchanged_columns
        exchange()
        after = sums()
        seen.append(solver.exchanged_columns - count)
        assert after[0] == pytest.approx(before[0], rel=1e-13)
        np.testing.assert_allclose(after[1], before[1], atol=1e-12 * np.abs(before[1]).max())

    solver._exchange = watched
    solver.advance(3.75, 4.0, 10**9)
    assert len(seen) == 5 and sum(seen) > 0


# --------------------------------------------------------------------------------------------------- kill and resume

KILLS = {
    "in the first stage": ("columns", 2.2),
    "between the first switch and its frame": ("name", "barriers_2.csv:1"),
    "after the first switch": ("points", 3.3),
    "between the frame of a switch and what older ones lose": ("name", "frame_000003.h5:2"),
    "at the second switch": ("points", 4.7),
    "in the last stage": ("columns", 4.9),
}
KILLS_BESIDE = {"at the start of it": ("points", 3.3), "amid exchanges": ("points", 4.25)}


def kill(scene, output, what, where):
    """A run of `scene` into `output` that is killed once a solver of the kind `what` is at a time, or at a file."""
    command = [sys.executable, "-c", CHILD, str(int(signal.SIGKILL)), what, str(where), "run", str(scene), "-q", "-o"]
    done = subprocess.run([*command, str(output)], capture_output=True, text=True, timeout=300)
    assert done.returncode == -signal.SIGKILL, done.stderr


@pytest.mark.thorough
@pytest.mark.parametrize("when", KILLS)
def test_a_run_that_was_killed_continues_to_the_same_bytes(site, tmp_path, when):
    kill(site / "all.toml", tmp_path / "cut", *KILLS[when])
    assert record(tmp_path, "cut")["state"] == "running"
    before = contents(tmp_path / "cut")
    assert 0 < len(before) < len(contents(site / "whole"))
    assert main(["run", str(site / "all.toml"), "-q", "-o", str(tmp_path / "cut"), "--resume"]) == 0
    assert contents(tmp_path / "cut") == contents(site / "whole")
    again, whole = record(tmp_path, "cut"), record(site, "whole")
    for part in ("state", "reason", "time", "steps", "frames", "digest", "balances", "events", "stages", "mass"):
        assert again[part] == whole[part], part
    names = sorted(path.name for path in (site / "whole").iterdir())
    assert sorted(path.name for path in (tmp_path / "cut").iterdir()) == names
    for number in (1, 2, 3):
        name = f"barriers_{number}.csv"
        assert (tmp_path / "cut" / name).read_bytes() == (site / "whole" / name).read_bytes()


@pytest.mark.thorough
@pytest.mark.parametrize("when", KILLS_BESIDE)
def test_a_run_with_columns_outside_continues_to_the_same_bytes(beside, tmp_path, when):
    kill(beside / "beside.toml", tmp_path / "cut", *KILLS_BESIDE[when])
    assert main(["run", str(beside / "beside.toml"), "-q", "-o", str(tmp_path / "cut"), "--resume"]) == 0
    assert contents(tmp_path / "cut") == contents(beside / "beside")
    again, whole = record(tmp_path, "cut"), record(beside, "beside")
    for part in ("steps", "balances", "events", "stages", "mass"):
        assert again[part] == whole[part], part


@pytest.mark.thorough
def test_a_finished_run_reports_it_and_another_scene_is_refused(site, tmp_path, capsys):
    given = ["-o", str(site / "whole"), "--resume"]
    assert main(["run", str(site / "all.toml"), *given]) == 0
    err = capsys.readouterr().err
    assert "is finished: end_time reached" in err and "mass of all stages" in err
    (site / "other.toml").write_text(ALL.replace("time = 4.7", "time = 4.8"))
    assert main(["run", str(site / "other.toml"), *given, "-q"]) == 2
    assert "another scene" in capsys.readouterr().err
    write_shapes(site / "box.geojson", [shapely.box(146, 100, 390, 300)])
    try:
        assert main(["run", str(site / "all.toml"), *given, "-q"]) == 2
        assert "another scene" in capsys.readouterr().err
    finally:
        write_shapes(site / "box.geojson", [shapely.box(145, 100, 390, 300)])


# ------------------------------------------------------------------------------------------------ what else is reported


def test_effects_are_listed_for_each_stage(files, capsys):
    capsys.readouterr()
    assert main(["effects", str(files / "all.toml")]) == 0
    out = capsys.readouterr().out
    assert "stage 1: columns, cells of 5 m, until within reach of barrier" in out
    assert "stage 2: points in box.geojson, cells of 5 m, until t = 4.7 s" in out
    assert "stage 3: columns, cells of 4 m, until the end" in out
    assert main(["effects", str(files / "all.toml"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    names = {number: {d["effect"] for d in told if d["stage"] == number} for number in (1, 2, 3)}
    assert "plasticity" in names[2] and "curvature" not in names[2]
    assert "curvature" in names[1] and names[1] == names[3]
    assert main(["effects", str(files / "all.toml"), "--measure", "-q"]) == 2
    assert "solver = 'columns' only" in capsys.readouterr().err


def test_a_deposit_becomes_columns_when_it_is_calm(files, tmp_path):
    """A block on level ground slumps in 3D; a second after the last of it moves off the bed it continues as columns."""
    for path in files.glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    write_shapes(tmp_path / "block.geojson", [shapely.box(500, 180, 540, 220)])
    level = SCENE.replace(f"window = [{WEST}", f"window = [{WEST + 410}").replace(f"{WEST + 400}", f"{WEST + 620}")
    text = level.replace("thickness = 12.0", "thickness = 6.0").replace("end_time = 5", "end_time = 12")
    calm = '[[stage]]\nsolver = "points"\nuntil = {calm = 1}\n[[stage]]\nsolver = "columns"\n'
    assert run(tmp_path, text.replace("cell_size = 5.0", "cell_size = 2.5") + calm, "-q") == 0
    told = record(tmp_path)
    over = told["stages"][0]
    assert over["reason"] == "the flow was calm for 1 s" and 1.0 <= over["time"] < 8.0
    assert abs(told["mass"]["error_relative"]) <= 1e-12
    assert (
        over["switch"]["momentum_error_relative"] <= 1e-12
        and over["switch"]["laid_mass"] < 0.02 * told["mass"]["released"]
    )
    assert told["balances"]["thickness_max"] < 6.5


REFUSED = {
    "a window that is nowhere": (ALL.replace("box.geojson", "nowhere.geojson"), "no such file"),
    "an area that is nowhere": (ALL.replace('"barrier"', '"nowhere.geojson"'), "no such file"),
    "inflow until points may begin": (
        ALL + '[hydrograph]\nsource = "foot.geojson"\nfile = "inflow.csv"\n',
        "flows in until t = 3 s",
    ),
    "a law that points have not": (ALL.replace('"Coulomb"', '"my_law.py:Mine"'), "takes no law from a Python file"),
    "cells too large": (ALL.replace("cell_size = 4\n", "cell_size = 100\n"), "3 x 3 at least"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_is_refused_before_anything_is_written(files, tmp_path, capsys, name):
    for path in files.glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "inflow.csv").write_text("time,discharge\n0,5\n3,5\n")
    text, words = REFUSED[name]
    assert words in refused(tmp_path, capsys, text)


def test_a_hole_that_a_later_stage_cannot_have_is_refused_before_the_first(files, tmp_path, capsys):
    for path in files.glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    x, y = distances()
    write_raster(
        tmp_path / "dtm.tif",
        np.where((x > 380) & (x < 390) & (y > 150) & (y < 250), np.nan, 0.5 * np.maximum(400 - x, 0)),
    )
    line = refused(tmp_path, capsys, ALL)
    assert "the 3D solver needs ground without holes where the flow can get" in line and "fill_nodata" in line


def test_inflow_may_come_before_a_stage_of_points(files, tmp_path):
    for path in files.glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "inflow.csv").write_text("time,discharge\n0,5\n2,5\n")
    text = SCENE + DAM + BEFORE.replace('reach = "barrier"', "time = 2") + '[[stage]]\nsolver = "points"\n'
    (tmp_path / "scene.toml").write_text(text + '[hydrograph]\nsource = "foot.geojson"\nfile = "inflow.csv"\n')
    assert prepare(tmp_path / "scene.toml").events.ends() == 2.0


@pytest.mark.thorough
def test_nothing_in_the_window_is_reported_at_the_switch(site, tmp_path, capsys):
    for path in site.glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    write_shapes(tmp_path / "box.geojson", [shapely.box(300, 100, 390, 300)])
    early = BEFORE.replace('reach = "barrier"', "time = 0.5")
    capsys.readouterr()
    assert run(tmp_path, SCENE + DAM + early + AMID + AFTER, "-q") == 2
    line = capsys.readouterr().err
    assert "t = 0.5 s: stage 2, of points, begins, but none of the" in line and line.count("\n") == 1
    told = record(tmp_path)
    assert told["state"] == "refused" and len(frames(tmp_path, "results")) == told["frames"] == 1
