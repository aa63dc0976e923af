"""Cost and resolution of a run before it starts: steps, time, memory, and cells over the flow's depth.

Computing cost of effects: the time of a step with and without each of them.

Both steps are timed from the same state in turns, a flow under way, so that neither the machine's load nor the flow's
own change is taken for the effect. The remaining error is reported: the whole scene against itself.
"""

from dataclasses import dataclass
from time import perf_counter
from typing import NamedTuple

import numpy as np

from ..laws import friction
from ..laws.quantities import GRAVITY
from ..laws.slots import ColumnEffects
from ..scene.point_effects import FEWEST_CELLS
from ..solvers.columns.column_rows import ROW
from ..solvers.points.point_ground import GROUND_ENTRIES
from ..solvers.points.point_numerics import courant_number
from ..solvers.points.point_rows import ROW_LONG, ROW_SHORT
from ..system.errors import SceneError
from ..system.messages import log
from ..system.operating_system import memory_lack


@dataclass(frozen=True)
class Resolution:
    """Resolution of the flow by the points of a stage at its start.

    Parameters
    ----------
    cell_size : float [m]
        Of the 3D grid.
    thickness : float [m]
        Vertical, mean over the mass.
    thin_share : float [1]
        Of the mass, in columns thinner than FEWEST_CELLS cells.
    wall_height : float or None [m]
        Of the lowest crest above the ground, of the walls that are on.
    """

    cell_size: float
    thickness: float
    thin_share: float
    wall_height: float | None = None

    @property
    def cells_over_depth(self):
        """Thickness over cell size [1]."""
        return self.thickness / self.cell_size

    @property
    def cells_over_wall(self):
        """Height of the lowest wall over cell size [1]; None without a wall."""
        return None if self.wall_height is None else self.wall_height / self.cell_size

    @property
    def coarse(self):
        """Whether a 3D run requires smaller cells."""
        over_wall = self.cells_over_wall
        return self.cells_over_depth < FEWEST_CELLS or (over_wall is not None and over_wall < FEWEST_CELLS)

    def as_numbers(self):
        """All of it as plain numbers for a record."""
        return {
            "cell_size": self.cell_size, "thickness": self.thickness, "cells_over_depth": self.cells_over_depth,
            "thin_share": self.thin_share, "wall_height": self.wall_height, "cells_over_wall": self.cells_over_wall,
            "coarse": self.coarse,
        }  # fmt: skip


def resolution_of(columns, cell_size, wall_height=None):
    """The Resolution of the Particles `columns` on a 3D grid with cells of `cell_size` [m]."""
    mass, thickness = np.asarray(columns.mass, float), np.asarray(columns.thickness, float)
    whole = float(mass.sum())
    if not whole > 0.0:
        return Resolution(float(cell_size), 0.0, 0.0, wall_height)
    thin = float(mass[thickness < FEWEST_CELLS * cell_size].sum()) / whole
    return Resolution(float(cell_size), float((mass * thickness).sum()) / whole, thin, wall_height)


BYTES_PER_COLUMN = 3 * ROW * 8 + 3 * 8 + 2 * 4 + 4 + 160  # rows, ids, keys, order; a frame on its way out, the last one
BYTES_PER_NODE = 8 * (1 + 2 + 4) + 2  # bed, gradient, node entries; wet and inside
BYTES_PER_POINT_BESIDE = 190  # of its two rows and those of two frames: ids, keys, order; a frame on its way out
BYTES_PER_POINT_NODE = 8 * (3 + 2 * GROUND_ENTRIES)  # bed, gradient, ground and its properties
BYTES_PER_GRID_NODE = 110  # of a grid on the map while it is made (measured 105 with 1.1e8 nodes, 2026-11-22)
BYTES_PER_START = 320  # of a point while columns become points
BYTES_PER_SWITCHED = 640  # of a point during a conversion within a run (measured 2026-11-22)
MEMORY_SHARE = 0.8  # share of the free memory or disk above which a run requires confirmation
NANOSECONDS_PER_STEP = 50.0  # of one column on one thread: a rough estimate, for the confirmation of long runs
NANOSECONDS_PER_POINT_STEP = {"float64": 85.0, "float32": 55.0}  # of one point on one thread, sort and grid included
SECONDS_PER_STEP = 2e-5  # of any step, however few particles it moves
# Beside the steps, in processor time (measured 2026-11-22 with 1e3 to 6e5 particles, frames 2026-11-27 by
# tests/bench/run.py frames; disks and other programs add to it)
SECONDS_PER_RUN, SECONDS_PER_PIXEL = 0.05, 1e-7  # scene, record; terrain of the frames
SECONDS_PER_FRAME = 0.02  # of a file that is whole or not there
NANOSECONDS_PER_WRITTEN = {"columns": 600.0, "points": 600.0}  # of one particle in a frame that is written
NANOSECONDS_PER_SHOWN = 200.0  # of one particle in a frame that is displayed
SECONDS_PER_SWITCH = 0.02
NANOSECONDS_TO_POINTS, NANOSECONDS_TO_COLUMNS = 1700.0, 900.0  # of a point that is made or taken back, sums included
NANOSECONDS_PER_NODE = 300.0  # of a grid's table of the ground
NANOSECONDS_PER_LOOK = {"reach": 100.0, "calm": 700.0}  # of a particle, at a check of the end of a stage


def predicted(columns, thickness, nodes, elevation_bytes, cell_size, cfl, end_time, line_speed, threads):
    """(seconds, bytes) that a run will need.

    The number of steps follows from half the energy line's speed `line_speed` [m s-1] and the wave speed of the mean
    `thickness` [m] over `end_time` [s].
    """
    signal = 0.5 * line_speed + np.sqrt(GRAVITY * thickness)
    steps = end_time * signal / (cfl * cell_size)
    memory = columns * BYTES_PER_COLUMN + nodes * BYTES_PER_NODE + 3 * elevation_bytes
    return steps * (columns * NANOSECONDS_PER_STEP * 1e-9 / threads + SECONDS_PER_STEP), memory


def predicted_in_3d(points, material, numerics, nodes, elevation_bytes, end_time, line_speed, threads):
    """(seconds, bytes) that a 3D run will need: its steps go with the waves and half the energy line's speed [m s-1].

    `material` is a law, `numerics` PointNumerics, `nodes` the number of the grid's nodes on the map.
    """
    dx, viscosity = numerics.cell_size, material.viscosity()
    limits = [dx / (material.wave_speed(numerics.density) + 0.5 * line_speed), np.sqrt(dx / numerics.gravity)]
    if viscosity > 0.0:
        limits.append(numerics.density * dx * dx / (6.0 * viscosity))
    steps = end_time / (courant_number(material, numerics) * min(limits))
    row = ROW_SHORT if material.state_count() <= 4 else ROW_LONG
    number = 4 if numerics.precision == "float32" else 8  # bytes
    memory = points * (4 * number * row + BYTES_PER_POINT_BESIDE) + nodes * BYTES_PER_POINT_NODE + 3 * elevation_bytes
    seconds = NANOSECONDS_PER_POINT_STEP[numerics.precision] * 1e-9
    return steps * (points * seconds / threads + SECONDS_PER_STEP), memory


def slower_than_nominal(solver_name, pace, particles, threads, precision="float64"):
    """Times [1] by which a step of `particles` takes longer here, `pace` [s] for each, than is taken above."""
    nominal = NANOSECONDS_PER_POINT_STEP[precision] if solver_name == "points" else NANOSECONDS_PER_STEP
    return pace * particles / (particles * nominal * 1e-9 / threads + SECONDS_PER_STEP)


def seconds_of_frames(solver_name, particles, frames, written=True):
    """Wall time [s] of `frames` of as many particles each, written or only displayed."""
    if not written:
        return frames * particles * NANOSECONDS_PER_SHOWN * 1e-9
    return frames * (SECONDS_PER_FRAME + particles * NANOSECONDS_PER_WRITTEN[solver_name] * 1e-9)


def seconds_to_points(points, nodes):
    """Wall time [s] in which columns become as many `points` on a grid of `nodes` seen from above."""
    return SECONDS_PER_SWITCH + 1e-9 * (points * NANOSECONDS_TO_POINTS + nodes * NANOSECONDS_PER_NODE)


def seconds_to_columns(points, nodes):
    """Wall time [s] in which as many `points` become columns on a grid of `nodes`."""
    return SECONDS_PER_SWITCH + 1e-9 * (points * NANOSECONDS_TO_COLUMNS + nodes * NANOSECONDS_PER_NODE)


def seconds_of_looks(particles, looks, conditions):
    """Wall time [s] of `looks` checks of the end of a stage with `conditions` (keys of its `until`)."""
    return looks * particles * 1e-9 * sum(NANOSECONDS_PER_LOOK.get(name, 0.0) for name in conditions)


def require_memory_for_points(count, cell_size):
    """Refuse points that exceed the memory of this machine, before they are created.

    Raises
    ------
    SceneError
    """
    if lack := memory_lack(count * BYTES_PER_START, MEMORY_SHARE):
        raise SceneError(
            f"[numerics] cell_size = {cell_size:g} m makes {count:.3g} points, which need {lack}; take larger cells"
        )


STEPS = 20  # timed at a time; the quickest of all rounds counts
LEAST_ROUNDS, MOST_ROUNDS, ROUNDS_SECONDS = 5, 60, 6.0  # as many rounds as fit into that time [s]
UNTIMED_STEPS = 2  # after each restart: the first ever compiles, the first of each puts the columns in order
UNDER_WAY_STEPS, UNDER_WAY_SECONDS = 200, 5.0  # until the flow counts as under way
FIRST, AGAIN = "whole", "whole again"  # no names of effects
CHOICES = ("metric",)  # slots that hold one of two forms, neither of which is the absence of the other


class EffectCosts(NamedTuple):
    """Measured costs of effects, and the measured scene."""

    shares: dict  # effect -> its share of a step [1]
    noise: float  # [1] by which two measurements of the whole scene differ
    step_seconds: float  # [s] of the whole scene
    columns: int
    time: float  # [s] simulated, at which it was measured


def without_each(effects):
    """Effect, as decisions name it -> `effects` with its null form in its place.

    Zones are switched with friction; turbulent drag is the difference of Voellmy's law to Coulomb's.
    """
    null = ColumnEffects()
    present = [name for name in effects._fields if type(getattr(effects, name)) is not type(getattr(null, name))]
    variants = {name: effects._replace(**{name: getattr(null, name)}) for name in present if name not in CHOICES}
    if "friction" in variants:
        variants["friction"] = variants["friction"]._replace(zones=null.zones)
    if isinstance(effects.friction, (friction.Voellmy, friction.ModifiedVoellmy)):
        variants["turbulent_drag"] = effects._replace(friction=friction.Coulomb(effects.friction.mu))
    return variants


def under_way(solver, events, end_time, clock=perf_counter):
    """Advance `solver` a little, with inflow, to where its effects are at work; the Frame there, with its state.

    Raises
    ------
    SceneError
        Nothing is on the terrain before `end_time` [s].
    """
    events.let_in(solver)
    while not solver.columns:
        if events.next_time(solver.time) >= end_time:
            raise SceneError("nothing moves before [output] end_time, so that no step can be measured")
        solver.wait(events.next_time(solver.time))
        events.let_in(solver)
    start, began = solver.frame(), clock()
    while solver.step < UNDER_WAY_STEPS and clock() - began < UNDER_WAY_SECONDS and solver.time < end_time:
        before = solver.step
        solver.advance(min(end_time, events.next_time(solver.time)), 10, may_stop=False)
        events.let_in(solver)
        if solver.step == before:  # it has stopped itself, or all has left
            break
    return solver.frame() if solver.columns else start


def effect_costs(solver, start, clock=perf_counter):
    """`EffectCosts` of the effects of `solver`, whose state is that of the Frame `start` before and after each look.

    Raises
    ------
    SceneError
        The flow ends within the steps that are timed.
    """
    whole = solver.effects
    variants = without_each(whole)
    for number, (name, effects) in enumerate(variants.items(), 1):
        log.info(f"{number} of {len(variants)}: the step without {name}; where it is new it is compiled, half a minute")
        _seconds_per_step(solver, effects, start, clock)
    best = _quickest(solver, {FIRST: whole, **variants, AGAIN: whole}, start, clock)
    solver.restore(start)
    with_all = 0.5 * (best[FIRST] + best[AGAIN])
    shares = {name: 1.0 - best[name] / with_all for name in variants}
    noise = abs(best[FIRST] - best[AGAIN]) / with_all
    return EffectCosts(shares, noise, with_all, solver.columns, solver.time)


def _quickest(solver, steps, start, clock):
    """Wall time [s] of the quickest step of each of `steps`, name -> ColumnEffects, timed in turns."""
    best = dict.fromkeys(steps, float("inf"))
    began = clock()
    for done in range(MOST_ROUNDS):
        if done >= LEAST_ROUNDS and clock() - began > ROUNDS_SECONDS:
            break
        for name, effects in steps.items():
            best[name] = min(best[name], _seconds_per_step(solver, effects, start, clock))
    return best


def _seconds_per_step(solver, effects, start, clock):
    """Wall time [s] of a step with `effects` from the Frame `start`."""
    solver.restore(start)
    whole, solver.effects = solver.effects, effects
    try:
        solver.advance(float("inf"), UNTIMED_STEPS, may_stop=False)
        began, step = clock(), solver.step
        solver.advance(float("inf"), STEPS, may_stop=False)
        spent, taken = clock() - began, solver.step - step
    finally:
        solver.effects = whole
    if taken < STEPS:
        raise SceneError(f"the flow ends within {STEPS} steps at t = {solver.time:.3g} s; there is no cost to measure")
    return spent / taken
