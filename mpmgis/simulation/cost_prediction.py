"""Predict the wall time of a run: before it from a trial, from its first second on from its own pace too."""

import math
from collections.abc import Callable
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

from ..compiled.jit import set_threads, threads_in_use
from ..laws.material_choice import wave_speed
from ..laws.quantities import GRAVITY
from ..solvers.points.point_numerics import courant_number
from ..system.memory import available_memory
from ..system.messages import log
from .memory_need import MEMORY_SHARE
from .required_memory import predicted_memory
from .trial_run import StageWork, first_pace, tried
from .warmup import warm_up

if TYPE_CHECKING:
    from .preparation import Prepared
    from .stage_sequence import StageSequence

PACE_SECONDS = 1.0  # [s] wall time of a stage from which on its pace is known


class Prediction(NamedTuple):
    """Predicted cost of a run.

    Parameters
    ----------
    seconds : float [s]
        Wall time of the steps; NaN where it is unknown.
    memory : float [bytes]
    trial : tuple of StageWork
        Empty without a trial.
    """

    seconds: float
    memory: float
    trial: tuple[StageWork, ...] = ()


def predicted(prepared: "Prepared", threads: int) -> Prediction:
    """Predict the cost of a run from a trial, for which its kernels are compiled.

    A scene that cannot run on larger cells is tried on its own, for a second.

    Parameters
    ----------
    prepared : Prepared
    threads : int
        Of the run.

    Returns
    -------
    Prediction
    """
    memory, before = predicted_memory(prepared), threads_in_use()
    if memory >= MEMORY_SHARE * available_memory():
        return Prediction(math.nan, memory)
    warm_up(prepared)
    set_threads(threads)
    try:
        trial = tried(prepared) or tried(prepared, 1.0)
        if trial:
            trial = (trial[0]._replace(pace=first_pace(prepared)), *trial[1:])
    finally:
        set_threads(before)
    return Prediction(sum((stage.seconds for stage in trial), 0.0 if trial else math.nan), memory, trial)


def most_particle_steps(prepared: "Prepared") -> float:
    """Return an upper bound of the number of steps of a run, each times its particles.

    The flow is as fast as the energy line until `end_time`.

    Parameters
    ----------
    prepared : Prepared
    """
    rates = (_steps_a_second(stage) * prepared.particles_of(n) for n, stage in enumerate(prepared.stages))
    return prepared.scene.output.end_time * max(rates)


def _steps_a_second(stage):
    """Return the largest number of steps in a simulated second of a Stage [s-1]."""
    numerics, facts, dx = stage.numerics, stage.facts, stage.grid.cell_size
    if stage.scene.solver == "columns":
        return (facts.speed + math.sqrt(GRAVITY * facts.release_thickness)) / (numerics.cfl * dx)
    material = stage.effects.material
    rates = (
        (wave_speed(material, numerics.density) + facts.speed) / dx,
        math.sqrt(numerics.gravity / dx),
        6.0 * material.dynamic_viscosity / (numerics.density * dx * dx),
    )
    return max(rates) / courant_number(material, numerics)


class _Moment(NamedTuple):
    """A moment of a run: its stage, simulated time [s], wall time [s], wall time of the steps of the stage [s]."""

    stage: int
    time: float
    now: float
    stepped: float


class TimeLeft:
    """The wall time that is left of a run, from its own pace and a trial.

    Steps go on at their pace since the start of the stage, with the work that the trial had from here on. Those of
    later stages have the pace that the trial measured. All else, above all frames, takes as long as until now in each
    simulated second.

    Parameters
    ----------
    prepared : Prepared
    trial : tuple of StageWork, optional
        Without it the run is tried after its first second.
    clock : callable
        Returns the wall time [s].

    Attributes
    ----------
    seconds : float or None [s]
        First prediction of the whole run; None in its first second.
    """

    def __init__(
        self, prepared: "Prepared", trial: tuple[StageWork, ...] = (), clock: Callable[[], float] = perf_counter
    ) -> None:
        self.seconds, self._prepared, self._clock, self._began = None, prepared, clock, clock()
        self._trial, self._is_tried, self._pause, self._first = trial, bool(trial), 0.0, None

    def words(self, sequence: "StageSequence") -> str:
        """Return the time left in words; '' in the first second of a stage.

        Parameters
        ----------
        sequence : StageSequence
        """
        now = _Moment(sequence.number, sequence.solver.time, self._clock() - self._pause, sequence.stepped[0])
        if self._first is None or self._first.stage != now.stage:
            self._first = now
        if now.now - self._first.now < PACE_SECONDS or now.time <= self._first.time:
            return ""
        if not self._is_tried:
            self._trial, self._is_tried = tried(self._prepared), True
            self._pause = self._clock() - now.now  # of the run
        begin = sequence.past[-1]["time"] if now.stage else 0.0
        left, about = self._left(now, begin)
        if self.seconds is None:
            self.seconds = self._clock() - self._began + left
            log.info(f"predicted: {about} {duration_words(self.seconds)}")
        return f"{about} {duration_words(left)} left"

    def _left(self, now, begin):
        """Return the wall time left [s] at a _Moment of the stage that began at `begin` [s], and how sure it is."""
        first, spent, passed = self._first, now.now - self._first.now, now.time - self._first.time
        if self._trial and now.time - begin < self._trial[now.stage].time[-1]:
            stage, later = self._trial[now.stage], self._trial[now.stage + 1 :]
            done, steps = stage.done(now.time - begin), now.stepped - first.stepped
            since, ahead = done - stage.done(first.time - begin), sum(one.seconds for one in later)
            if since > 0.0 and not math.isnan(ahead):
                lasting = stage.time[-1] - (now.time - begin) + sum(one.time[-1] for one in later)
                ahead += steps * (stage.work[-1] - done) / since
                return ahead + (spent - steps) * lasting / passed, "about"
        return spent * (self._prepared.scene.output.end_time - now.time) / passed, "at most"


def need_words(ahead: Prediction) -> str:
    """Return time and memory of a Prediction in words.

    Parameters
    ----------
    ahead : Prediction
    """
    return f"{duration_words(ahead.seconds)} and {ahead.memory / 1e9:.2g} GB"


def duration_words(seconds: float) -> str:
    """Return a wall time in words.

    Parameters
    ----------
    seconds : float [s]
        NaN where it is unknown.
    """
    if math.isnan(seconds):
        return "an unknown time"
    if seconds < 100.0:
        return f"{seconds:.2g} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000.0 else f"{seconds / 3600:.1f} h"
