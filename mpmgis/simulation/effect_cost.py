"""Measure the computing cost of effects: the time of a step with and without each of them.

Both steps are timed from the same state in turns, with the flow in motion, so that neither the load of the machine nor
a change of the flow is attributed to the effect. The remaining error is reported: the difference between two
measurements of the whole scene.
"""

from collections.abc import Callable
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

from ..laws import friction
from ..laws.effect_slots import ColumnEffects
from ..system.errors import SceneError

if TYPE_CHECKING:
    from ..frames.particles import Frame
    from ..solvers.columns.column_solver import ColumnSolver
    from .release_events import Events

STEPS = 20  # in a measurement; the quickest of all rounds counts
LEAST_ROUNDS, MOST_ROUNDS = 5, 60  # of measurements
ROUNDS_SECONDS = 6.0  # [s] wall time after which no further round begins
UNTIMED_STEPS = 2  # after each restart: the first one may compile, and it sorts the columns
UNDER_WAY_STEPS = 200  # after which the flow counts as moving
UNDER_WAY_SECONDS = 5.0  # [s] wall time for these steps
FIRST, AGAIN = "whole", "whole again"  # the two measurements of the whole scene; not names of effects
CHOICES = ("metric",)  # effects with two forms, neither of which means that there is no effect


class EffectCosts(NamedTuple):
    """Measured costs of effects, and the measured scene."""

    shares: dict  # effect -> its share of a step [1]
    noise: float  # [1] by which two measurements of the whole scene differ
    step_seconds: float  # [s] of the whole scene
    columns: int
    time: float  # [s] simulated, at which it was measured


def without_each(effects: ColumnEffects) -> dict[str, ColumnEffects]:
    """Return a copy of `effects` without each of them.

    Zones are switched off with friction. The turbulent drag is the difference between Voellmy's law and Coulomb's.

    Parameters
    ----------
    effects : ColumnEffects

    Returns
    -------
    dict
        Name of the effect, as in decisions -> ColumnEffects without it.
    """
    null = ColumnEffects()
    present = [name for name in effects._fields if getattr(effects, name) != getattr(null, name)]
    variants = {name: effects._replace(**{name: getattr(null, name)}) for name in present if name not in CHOICES}
    if "friction" in variants:
        variants["friction"] = variants["friction"]._replace(zones=null.zones)
    law = effects.friction
    if isinstance(law, friction.Friction) and law.kind in (friction.VOELLMY, friction.MODIFIED_VOELLMY):
        coulomb = friction.friction_law("Coulomb", friction.parameters_of(law)["mu"])
        variants["turbulent_drag"] = effects._replace(friction=coulomb)
    return variants


def under_way(
    solver: "ColumnSolver", events: "Events", end_time: float, clock: Callable[[], float] = perf_counter
) -> "Frame":
    """Advance `solver` a little, with inflow, until its effects act.

    Parameters
    ----------
    solver : ColumnSolver
    events : Events
    end_time : float [s]
    clock : callable
        Returns the wall time [s].

    Returns
    -------
    Frame
        The frame there, with its state.

    Raises
    ------
    SceneError
        Nothing is on the terrain before `end_time`.
    """
    events.let_in(solver)
    while not solver.particles:
        if events.next_time(solver.time) >= end_time:
            raise SceneError("nothing moves before [output] end_time, so that no step can be measured")
        solver.wait(events.next_time(solver.time))
        events.let_in(solver)
    start, began = solver.frame(), clock()
    while solver.step < UNDER_WAY_STEPS and clock() - began < UNDER_WAY_SECONDS and solver.time < end_time:
        before = solver.step
        solver.advance(min(end_time, events.next_time(solver.time)), max_steps=10, may_stop=False)
        events.let_in(solver)
        if solver.step == before:  # it has come to rest, or all mass has left
            break
    return solver.frame() if solver.particles else start


def effect_costs(solver: "ColumnSolver", start: "Frame", clock: Callable[[], float] = perf_counter) -> EffectCosts:
    """Measure the cost of the effects of `solver`; its state is `start` before and after each measurement.

    Parameters
    ----------
    solver : ColumnSolver
    start : Frame
        With the state of the solver.
    clock : callable
        Returns the wall time [s].

    Returns
    -------
    EffectCosts

    Raises
    ------
    SceneError
        The flow ends within the steps that are timed.
    """
    whole = solver.effects
    variants = without_each(whole)
    best = _quickest(solver, {FIRST: whole, **variants, AGAIN: whole}, start, clock)
    solver.restore(start)
    with_all = 0.5 * (best[FIRST] + best[AGAIN])
    shares = {name: 1.0 - best[name] / with_all for name in variants}
    noise = abs(best[FIRST] - best[AGAIN]) / with_all
    return EffectCosts(shares, noise, with_all, solver.particles, solver.time)


def _quickest(solver: "ColumnSolver", steps: dict, start: "Frame", clock: Callable) -> dict:
    """Return the wall time [s] of the quickest step of each of `steps`, name -> ColumnEffects, timed in turns."""
    best = dict.fromkeys(steps, float("inf"))
    began = clock()
    for done in range(MOST_ROUNDS):
        if done >= LEAST_ROUNDS and clock() - began > ROUNDS_SECONDS:
            break
        for name, effects in steps.items():
            best[name] = min(best[name], _seconds_per_step(solver, effects, start, clock))
    return best


def _seconds_per_step(solver: "ColumnSolver", effects: ColumnEffects, start: "Frame", clock: Callable) -> float:
    """Return the wall time [s] of a step with `effects` from the Frame `start`."""
    solver.restore(start)
    whole, solver.effects = solver.effects, effects
    try:
        solver.advance(float("inf"), max_steps=UNTIMED_STEPS, may_stop=False)
        began, step = clock(), solver.step
        solver.advance(float("inf"), max_steps=STEPS, may_stop=False)
        spent, taken = clock() - began, solver.step - step
    finally:
        solver.effects = whole
    if taken < STEPS:
        raise SceneError(f"the flow ends within {STEPS} steps at t = {solver.time:.3g} s; there is no cost to measure")
    return spent / taken
