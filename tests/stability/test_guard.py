"""The guard: after an invalid state a run goes back to the last frame with half the step, and reports it."""

import re

import numpy as np
import pytest
from column_scenes import columns_of, terrain_of
from hard_scenes import Watch, columns_on, stiff_for
from point_scenes import block_of, points_on
from slope_site import SCENE, record, run, write_site

from mpmgis.compiled.jit import set_threads
from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import drucker_prager
from mpmgis.laws.material_choice import wave_speed
from mpmgis.simulation import time_integration as marching
from mpmgis.simulation.step_retry import Guard
from mpmgis.simulation.time_integration import TimeIntegration
from mpmgis.solvers.columns.column_solver import ColumnSolver
from mpmgis.system.errors import UnphysicalError

SOIL = drucker_prager(stiff_for(6.0), 0.6 * stiff_for(6.0), 30.0, 1e4)


def block(steps=3.5):
    """A block that falls by a metre, with time steps in which a wave crosses `steps` cells: 1 is stable."""
    terrain = terrain_of(lambda x, y: 0.0 * x, 40.0, 20.0, 1.0)
    frame = block_of((4.0, 4.0, 4.0), 0.5, (18.0, 8.0, 1.0), velocity=(2.0, 0.0, 0.0))
    step = steps / wave_speed(SOIL, 1000.0)
    return points_on(terrain, frame, 1.0, SOIL, friction_law("Coulomb", 0.3), time_step=step)


def pool():
    """Water 10 m deep that is released, with time steps in which it crosses three cells."""
    columns = columns_of(10.0, 60, 90, 30, 60, 2.5)
    return columns_on(lambda x, y: 0.0 * x, columns, mu=0.0, time_step=1.5, edges="wall")


SCENES = {"points": (block, 1.0, 0.25), "columns": (pool, 12.0, 6.0)}


@pytest.mark.parametrize("name", SCENES)
def test_a_run_gets_over_steps_that_are_too_long(name):
    """H14, H32: it ends, reports where and why it went back, and satisfies the conditions of every run."""
    scene, end, interval = SCENES[name]
    solver = scene()
    watch, march = Watch(solver), TimeIntegration(solver, end, interval)
    for _ in march:
        if name == "columns":
            watch.look()  # points in steps of this length show their energy half a step apart
    watch.look_at_sums()
    assert solver.time == end and 1 <= len(march.troubles) <= round(end / interval)
    assert "continued from t = " in march.troubles[0] and "steps of 1/" in march.troubles[0]


@pytest.mark.parametrize("name", SCENES)
def test_going_back_is_the_same_for_any_slices_threads_and_restarts(name, monkeypatch):
    """Bitwise; a run resumed at any of its frames has the same invalid state, although no frame stores it."""
    scene, end, interval = SCENES[name]
    whole = list(TimeIntegration(scene(), end, interval))
    monkeypatch.setattr(marching, "SLICE_SECONDS", 1e-4)
    set_threads(2)
    sliced = list(TimeIntegration(scene(), end, interval))
    set_threads(None)
    runs = [sliced]
    for number, frame in enumerate(whole[:-1]):
        again = scene()
        again.restore(frame)
        runs.append([*whole[: number + 1], *TimeIntegration(again, end, interval, resumed=True)])
    for frames in runs:
        assert [frame.step for frame in frames] == [frame.step for frame in whole]
        for one, other in zip(frames, whole, strict=True):
            for key in ("rows", "clock", "ledger"):
                np.testing.assert_array_equal(one.state[key], other.state[key], err_msg=f"{key} at {one.time}")


def test_what_no_step_helps_ends_the_run_with_place_and_cause():
    """Exit code 3 after steps of 1/32; no problem is reported as solved."""
    solver = block(0.3)
    solver.arrays.rows[5, 4] = np.nan
    march = TimeIntegration(solver, 1.0, 0.5)
    with pytest.raises(UnphysicalError) as error:
        list(march)
    words = str(error.value)
    assert re.search(r"step 1, t = 0\.\d+ s, E \d+\.\d N \d+\.\d: .*not finite", words)
    assert "steps of down to 1/32 from t = 0.000 s on did not help" in words
    assert error.value.exit_code == 3 and march.troubles == []


def test_without_a_frame_to_go_back_to_the_run_ends_with_place_and_cause():
    """The terrain was empty at the start; the inflow became invalid before its first frame."""
    solver = Recorder()
    guard = Guard(solver, Recorder(), solver)
    with pytest.raises(UnphysicalError, match=r"step 7, t = 0\.500 s, E 1\.0 N 2\.0: too fast, before the first frame"):
        guard.go_back("E 1.0 N 2.0: too fast")
    assert solver.asked == []


def test_solved_problems_are_in_the_messages_and_the_record(tmp_path, monkeypatch, capsys):
    """One artificial problem at the first frame after the start: exit code 0, a line, and the same line in run.json."""
    site, troubles = write_site(tmp_path), ["E 400100.0 N 5100200.0: made up"]
    monkeypatch.setattr(ColumnSolver, "energy_trouble", lambda side, last: troubles.pop(0) if troubles else "")
    assert run(site, SCENE.replace("end_time = 30", "end_time = 20")) == 0
    words = "E 400100.0 N 5100200.0: made up: continued from t = 0.000 s on with steps of 1/2"
    assert words in capsys.readouterr().err
    told = record(site)["troubles"]
    assert len(told) == 1 and told[0].endswith(words) and told[0].startswith("step ")


class Recorder:
    """A solver, its events and the end of its stage, which only record their calls."""

    def __init__(self):
        self.step, self.time, self.calm_since, self.asked = 7, 0.5, 0.25, []

    def share_step(self, share):
        self.asked.append(share)

    def restore(self, frame, known=False):
        self.asked.append(("back to", frame.time))

    def arm(self, solver):
        pass

    def energy_look(self):
        return None


def test_steps_are_whole_again_from_the_next_frame_on():
    solver, frame = Recorder(), block().frame()
    guard = Guard(solver, Recorder(), solver)
    guard.keep(frame)
    solver.calm_since = 0.4
    guard.go_back("E 1.0 N 2.0: too fast")
    guard.go_back("E 1.0 N 2.0: still too fast")
    assert solver.asked == [("back to", 0.0), 0.5, ("back to", 0.0), 0.25] and solver.calm_since == 0.25
    guard.keep(frame)
    assert solver.asked[-1] == 1.0
    line = "step 7, t = 0.500 s, E 1.0 N 2.0: too fast: continued from t = 0.000 s on with steps of 1/4"
    assert guard.resolved == [line]
