"""Predicted time and memory: a trial on larger cells, the time left by an artificial clock, bounds."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from slope_site import SCENE, slide, write_block_site, write_shapes

from mpmgis.compiled.jit import threads_in_use
from mpmgis.frames.frame_files import write_frame
from mpmgis.simulation import trial_run
from mpmgis.simulation.cost_prediction import PACE_SECONDS, TimeLeft, most_particle_steps, predicted
from mpmgis.simulation.memory_need import BYTES_PER_SWITCHED
from mpmgis.simulation.preparation import on_larger_cells, prepare
from mpmgis.simulation.required_memory import predicted_memory
from mpmgis.simulation.stage_sequence import StageSequence
from mpmgis.simulation.trial_run import StageWork, first_pace, tried
from mpmgis.system.messages import collected

STAGE = '[[stage]]\nsolver = "{}"\n'


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = write_block_site(tmp_path_factory.mktemp("foresight"))
    write_shapes(folder / "dam.geojson", [shapely.box(220, 120, 240, 280)])
    return folder


def prepared(site, text):
    (site / "scene.toml").write_text(text)
    return prepare(site / "scene.toml")


def staged(site, *untils, end_time=12):
    """A run of 12 s in stages of columns and points by turns, each but the last with what is in `untils`."""
    text = slide(8.0, end_time, 0.5, head="", more="particles_per_cell = 4")
    if any("reach" in until for until in untils):
        text += '[[barrier]]\nsource = "dam.geojson"\nheight = 6\n'
    for number, until in enumerate([*untils, None]):
        text += STAGE.format("points" if number % 2 else "columns") + (
            "" if until is None else f"until = {{{until}}}\n"
        )
    return prepared(site, text)


def test_larger_cells_have_the_same_mass_effects_and_ends(site):
    run = staged(site, 'reach = "barrier"')
    larger = on_larger_cells(run, 2.0)
    assert [stage.grid.cell_size for stage in larger.stages] == [2.0 * stage.grid.cell_size for stage in run.stages]
    assert [stage.effects for stage in larger.stages] == [stage.effects for stage in run.stages]
    assert larger.frame.particles.mass.sum() == pytest.approx(run.frame.particles.mass.sum(), rel=1e-6)
    assert larger.particles_of(0) < 0.5 * run.particles_of(0) and larger.particles_of(1) < 0.3 * run.particles_of(1)
    assert [stage.table for stage in larger.stages] == [stage.table for stage in run.stages]


@pytest.mark.parametrize("solver", ["points", "columns"])
def test_of_particles_from_a_file_a_part_has_the_mass_of_all(site, solver):
    scene = slide(4.0, 1, 0.5, head=f'solver = "{solver}"')
    if solver == "columns":
        scene = re.sub(r"\[material\][^\[]*", "", scene)
    write_frame(site / "start.h5", prepared(site, scene).frame)
    run = prepared(site, re.sub(r"source = .*\nthickness = .*\ndensity = .*", 'particles = "start.h5"', scene))
    few, whole = on_larger_cells(run, 2.0).frame.particles, run.frame.particles
    assert len(few) == pytest.approx(len(whole) / 2**run.frame.dimension, abs=1)
    for name in ("mass", "volume", "area"):
        if getattr(whole, name) is not None:
            assert getattr(few, name).sum() == pytest.approx(getattr(whole, name).sum(), rel=0.05)
    assert tried(run)[0].work[-1] > 0.0


def test_a_trial_ends_its_stages_when_the_run_does_and_changes_nothing(site):
    run = staged(site, "time = 2", "time = 5")
    threads = threads_in_use()
    before = {name: values.copy() for name, values in run.frame.particles.arrays().items()}
    trial = tried(run)
    assert [stage.time[-1] for stage in trial] == pytest.approx([2.0, 3.0, 7.0])
    for stage in trial:
        assert stage.time[0] == stage.work[0] == 0.0
        assert (np.diff(stage.time) >= 0.0).all() and (np.diff(stage.work) >= 0.0).all() and stage.work[-1] > 0.0
    assert np.isnan(trial[0].pace) and all(stage.pace > 0.0 for stage in trial[1:])
    assert all(np.array_equal(values, before[name]) for name, values in run.frame.particles.arrays().items())
    assert run.solver().step == 0 and threads_in_use() == threads


def test_a_flow_comes_to_rest_in_the_trial_when_it_does_in_the_run(site):
    scene = SCENE.replace("end_time = 30", "end_time = 900").replace("mu = 0.2", "mu = 0.35")
    run = prepared(site, scene)
    sequence = StageSequence(prepare(site / "scene.toml"))
    rested = [frame.time for frame in sequence][-1]
    assert rested < 300.0 and tried(run)[0].time[-1] == pytest.approx(rested, rel=0.3)


def test_a_trial_that_is_broken_off_goes_on_evenly_to_the_end(site):
    run = prepared(site, slide(8.0, 12, 0.5))
    late = iter([0.0, *[2.0 * trial_run.SECONDS] * 99])
    (stage,) = tried(run, clock=lambda: next(late))
    assert len(stage.time) == 3 and stage.time[-1] == 12.0
    assert stage.work[1] / stage.time[1] == pytest.approx(stage.work[2] / stage.time[2])


def test_cells_that_do_not_fit_between_walls_are_not_tried(site):
    assert tried(prepared(site, slide(8.0, 12, 0.5, more='edges = "wall"')), factor=1024.0) == ()


def test_a_prediction_has_the_work_of_the_trial_at_its_pace(site):
    run = staged(site, "time = 2", "time = 5")
    threads, ahead = threads_in_use(), predicted(run, 1)
    assert (
        ahead.seconds == pytest.approx(sum(stage.pace * stage.work[-1] for stage in ahead.trial)) and ahead.seconds > 0
    )
    assert ahead.memory == predicted_memory(run) and threads_in_use() == threads


def test_the_pace_is_wall_time_over_steps_and_particles(site):
    """A clock that advances by 1 s at each reading is read twice, with 8 steps between."""
    run, ticks = prepared(site, slide(8.0, 3, 0.5)), iter(range(99))
    assert first_pace(run, lambda: float(next(ticks))) == pytest.approx(1.0 / (8 * run.particles))


@pytest.mark.parametrize("text", [SCENE.replace("cell_size = 10.0", "cell_size = 4.0"), slide(4.0, 3, 0.5)])
def test_the_work_of_a_trial_is_that_of_the_run_and_below_the_bound(site, text):
    run = prepared(site, text)
    sequence = StageSequence(prepare(site / "scene.toml"))
    for _ in sequence:
        pass
    assert sequence.particle_steps < most_particle_steps(run) < 100 * sequence.particle_steps
    assert tried(run)[0].work[-1] == pytest.approx(sequence.particle_steps, rel=0.4)


class Course:
    """A run by an artificial clock: steps have the work of a trial, at a pace; frames take as long in every second."""

    work = (
        StageWork(np.array([0.0, 4.0, 10.0]), np.array([0.0, 9e6, 12e6])),
        StageWork(np.array([0.0, 30.0]), np.array([0.0, 60e6]), 3e-6),
    )

    def __init__(self, pace, frames, stages=2, end_time=40.0):
        self.trial, self.pace, self.frames = self.work[:stages], (1e-6 * pace, 3e-6), frames
        self.time, self.number, self.paused = 0.0, 0, 0.0
        self.solver, self.past = self, []
        self.prepared = SimpleNamespace(scene=SimpleNamespace(output=SimpleNamespace(end_time=end_time)))

    @property
    def stepped(self):
        return self.pace[self.number] * self.trial[self.number].done(self.time - 10.0 * self.number), 0, 0

    def clock(self):
        before = self.number * self.pace[0] * self.trial[0].work[-1]
        return before + self.stepped[0] + self.frames * self.time + self.paused

    @property
    def total(self):
        steps = sum(pace * stage.work[-1] for pace, stage in zip(self.pace, self.trial, strict=False))
        return steps + self.frames * sum(stage.time[-1] for stage in self.trial)

    def at(self, time):
        self.time, self.number = time, int(time >= 10.0 and len(self.trial) > 1)
        self.past = [{"time": 10.0}][: self.number]
        return self


@pytest.mark.parametrize(("pace", "frames"), [(0.5, 0.0), (1.0, 0.3), (20.0, 0.0), (0.5, 5.0)])
def test_a_run_with_the_work_of_its_trial_is_predicted_exactly_at_any_pace(pace, frames):
    course = Course(pace, frames)
    left = TimeLeft(course.prepared, course.trial, course.clock)
    assert left.words(course.at(0.0)) == "" and left.seconds is None
    with collected() as said:
        for time in (3.0, 9.0, 10.0, 20.0, 39.0):
            words = left.words(course.at(time))
            assert words == "" if time == 10.0 else words.startswith("about ") and words.endswith(" left")
            if words and "min" not in words:
                assert float(words.split()[1]) == pytest.approx(course.total - course.clock(), rel=0.06)
    assert left.seconds == pytest.approx(course.total) and len(said) == 1 and said[0].startswith("predicted: about ")


def test_the_first_second_is_not_predicted():
    course = Course(0.1, 0.0)
    left = TimeLeft(course.prepared, course.trial, course.clock)
    left.words(course.at(0.0))
    assert left.words(course.at(4.0)) == "" and course.clock() < PACE_SECONDS
    assert left.words(course.at(9.999)) != "" and left.seconds is not None


def test_the_trial_in_a_run_is_no_work_of_the_run(monkeypatch):
    course = Course(1.0, 0.5)

    def tried_slowly(prepared):
        course.paused += 7.0
        return course.trial

    monkeypatch.setattr("mpmgis.simulation.cost_prediction.tried", tried_slowly)
    left = TimeLeft(course.prepared, clock=course.clock)
    left.words(course.at(0.0))
    left.words(course.at(5.0))
    assert left.seconds == pytest.approx(course.total + 7.0)
    left.words(course.at(10.0))
    assert float(left.words(course.at(30.0)).split()[1]) == pytest.approx(10 * 6.5, rel=0.05)


def test_without_a_trial_and_after_its_end_a_run_lasts_at_most_until_end_time(monkeypatch):
    monkeypatch.setattr("mpmgis.simulation.cost_prediction.tried", lambda prepared: ())
    course = Course(1.0, 0.0, stages=1)
    left = TimeLeft(course.prepared, clock=course.clock)
    left.words(course.at(0.0))
    assert left.words(course.at(4.0)) == f"at most {9.0 / 4.0 * 36.0:.2g} s left"
    left = TimeLeft(course.prepared, course.trial, course.clock)
    left.words(course.at(0.0))
    assert left.words(course.at(9.0)).startswith("about")
    assert left.words(course.at(20.0)) == f"at most {12.0 / 20.0 * 20.0:.2g} s left"


def test_stages_need_memory_for_what_is_converted(site):
    run = staged(site, "time = 2", "time = 5")
    more = predicted_memory(run) - predicted_memory(prepared(site, slide(8.0, 12, 0.5)))
    assert more == pytest.approx(BYTES_PER_SWITCHED * run.particles_of(1), rel=0.5)
