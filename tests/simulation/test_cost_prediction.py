"""Predicted time and memory of a scene: stages that may end early, work besides the steps, a trial of the machine."""

from types import SimpleNamespace

import pytest
import shapely
from slope_site import SCENE, slide, write_block_site, write_shapes

from mpmgis.simulation import cost_prediction
from mpmgis.simulation.cost_prediction import (
    TYPICAL,
    Machine,
    OwnPace,
    expected_times,
    predicted,
    predicted_cost,
    predicted_memory,
    tried_machine,
)
from mpmgis.simulation.measured_cost import BYTES_PER_SWITCHED, NANOSECONDS_PER_STEP, SECONDS_PER_STEP
from mpmgis.simulation.preparation import prepare
from mpmgis.system.messages import collected

STAGE = '[[stage]]\nsolver = "{}"\n'


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = write_block_site(tmp_path_factory.mktemp("foresight"))
    write_shapes(folder / "dam.geojson", [shapely.box(220, 120, 240, 280)])
    return folder


def prepared(site, *untils, end_time=12):
    """A run of 12 s in stages of columns and points by turns, each but the last with what is in `untils`."""
    text = slide(8.0, end_time, 0.5, head="", more="particles_per_cell = 4")
    if any("reach" in until for until in untils):
        text += '[[barrier]]\nsource = "dam.geojson"\nheight = 6\n'
    for number, until in enumerate([*untils, None]):
        text += STAGE.format("points" if number % 2 else "columns") + (
            "" if until is None else f"until = {{{until}}}\n"
        )
    (site / "scene.toml").write_text(text)
    return prepare(site / "scene.toml")


@pytest.mark.parametrize(
    ("untils", "expected", "longest"),
    [
        (["time = 2", "time = 5"], [2, 3, 7], [2, 3, 7]),
        (['reach = "barrier"', "calm = 1"], [4, 4, 4], [12, 12, 12]),
        (['reach = "barrier"', "time = 6"], [3, 3, 6], [6, 6, 6]),
        (["time = 2", "calm = 1, time = 6"], [2, 2, 8], [2, 4, 6]),
    ],
)
def test_unknown_times_are_divided_evenly(site, untils, expected, longest):
    run = prepared(site, *untils)
    assert expected_times(run) == pytest.approx(expected)
    assert [run.longest(number) for number in range(3)] == pytest.approx(longest)
    assert sum(expected) == pytest.approx(12)


def test_a_run_that_may_last_longer_than_expected_reports_how_long(site):
    known, open_ended = (prepared(site, *untils) for untils in (["time = 2", "time = 5"], ["time = 2", "calm = 1"]))
    assert predicted_cost(known, 2, longest=True) == predicted_cost(known, 2)
    assert predicted_cost(open_ended, 2, longest=True) > predicted_cost(open_ended, 2)


def test_steps_and_what_is_beside_them_take_longer_on_a_slower_machine(site):
    run = prepared(site, "time = 2", "time = 5")
    typical, slow_steps = predicted_cost(run, 1), predicted_cost(run, 1, Machine({"columns": 3.0, "points": 3.0}))
    slow_beside = predicted_cost(run, 1, Machine({}, other=3.0))
    assert slow_steps + slow_beside == pytest.approx(4 * typical)
    assert predicted_cost(run, 1, Machine({"points": 3.0})) == pytest.approx(slow_steps)  # the other's, where untried
    assert predicted_cost(run, 1, interval=0.5) < typical  # without files


def test_a_trial_measures_the_pace_of_each_solver_and_changes_nothing(site):
    run = prepared(site, "time = 2", "time = 5")
    machine = tried_machine(run, 1, 1.0)
    assert set(machine.steps) == {"columns", "points"} and all(times > 0.0 for times in machine.steps.values())
    assert machine.other > 0.0
    assert "ns a column and" in machine.words and machine.words.endswith("ns a point and step as measured")
    assert run.solver().step == 0 and len(run.frame.particles) == run.particles


def test_only_what_takes_more_than_a_moment_is_tried(site, monkeypatch):
    run, asked = prepared(site, "time = 2", "time = 5"), []
    monkeypatch.setattr(
        cost_prediction, "tried_machine", lambda *given: asked.append(given) or TYPICAL._replace(other=2.0)
    )
    monkeypatch.setattr(cost_prediction, "TRIAL_FROM", 1e6)
    short = predicted(run, 1)
    assert not asked and short.source == ""
    monkeypatch.setattr(cost_prediction, "TRIAL_FROM", 0.0)
    assert predicted(run, 1).seconds > short.seconds and len(asked) == 1


def test_a_run_is_predicted_again_from_its_own_steps_once_for_each_solver(site, monkeypatch):
    """Two seconds of steps are waited for; a machine of a tenth of the typical speed takes ten times as long."""
    run = prepared(site, "time = 2", "time = 5")
    ahead = predicted(run, 1, trial_from=1e9)
    monkeypatch.setattr(cost_prediction, "LOG_FROM", 0.0)
    pace = OwnPace(run, 1, ahead)
    nominal = 1e-9 * NANOSECONDS_PER_STEP + SECONDS_PER_STEP / 1000.0

    def look(solver, seconds, each):
        stage = SimpleNamespace(scene=SimpleNamespace(solver=solver, numerics=run.scene.numerics))
        steps = int(seconds / each / 1000.0)
        pace.update(SimpleNamespace(stage=stage, stepped=(seconds, 1000 * steps, steps)))

    with collected() as said:
        look("columns", 1.9, 10 * nominal)
        assert pace.seconds == ahead.seconds and not said
        look("columns", 2.1, 10 * nominal)
        slow = predicted_cost(run, 1, Machine({"columns": 10.0}))
        assert pace.seconds == pytest.approx(slow, rel=0.02) and pace.seconds > ahead.seconds
        assert [f"at {1e10 * nominal:.0f} ns a column and step as measured" in line for line in said] == [True]
        look("columns", 9.0, 99 * nominal)
        assert pace.seconds == pytest.approx(slow, rel=0.02)
        look("points", 2.1, 10 * nominal)
        assert len(said) == 2 and "ns a column and" in said[1] and "ns a point and step" in said[1]


def test_a_scene_without_stages_lasts_until_end_time(site):
    (site / "scene.toml").write_text(SCENE)
    assert expected_times(prepare(site / "scene.toml")) == [30.0]


def test_stages_need_memory_for_what_is_converted(site):
    run, alone = prepared(site, "time = 2", "time = 5"), slide(8.0, 12, 0.5)
    (site / "alone.toml").write_text(alone)
    points = prepare(site / "alone.toml")
    more = predicted_memory(run) - predicted_memory(points)
    assert more == pytest.approx(BYTES_PER_SWITCHED * run.particles_of(1), rel=0.5)
