"""One interface for the time integration of each solver, and the speed of its first seconds."""

from time import perf_counter

import numpy as np

from ..frames.particle_store import GAIN_STOP
from ..solvers.columns import column_clock
from ..solvers.points import point_loop as point_kernel
from ..solvers.points.point_solver import PointSolver
from .coupled_solver import OF_COLUMNS, CoupledSolver

REST_SECONDS, REST_SHARE = 2.0, 0.01  # a 3D flow is at rest below this share of its peak kinetic energy
STOPPED_AT_REST = 100  # in addition to the reasons of the kernel
STILL_FLOWS, FLOWING_SHARE = 1.0, 0.05  # [m s-1] and share of the mass, from which the reason to end mentions it
END_TIME, ALL_LEFT = "end_time reached", "all mass has left the terrain"
NEARLY_AT_REST = "nearly at rest: kinetic energy below 1 % of its peak for 2 s"
COLUMN_REASONS = {
    column_clock.REACHED_TIME: END_TIME,
    column_clock.STOPPED_MOVING: "at rest: less than 1 % of the peak moving mass is faster than 0.05 m/s",
    column_clock.STOPPED_ENERGY: NEARLY_AT_REST,
    column_clock.STOPPED_FOOTPRINT: (
        "nearly at rest: the footprint grew by less than 0.1 % in 10 s, and under 5 % of the mass is faster than 1 m/s"
    ),
    column_clock.ALL_LEFT: ALL_LEFT,
}
POINT_REASONS = {point_kernel.REACHED_TIME: END_TIME, STOPPED_AT_REST: NEARLY_AT_REST, point_kernel.ALL_LEFT: ALL_LEFT}
PACE_SECONDS = 2.0
COMPILING_STEPS, FIRST_STEPS = 2, 4


def end_reason(stepper, code):
    """The reason to end `code` in words; material that still flows when the flow is nearly at rest is mentioned."""
    reason = stepper.END_REASONS[code]
    if reason != NEARLY_AT_REST:
        return reason
    particles = stepper.moving()
    fast = np.einsum("ij,ij->i", particles.velocity, particles.velocity) > STILL_FLOWS**2
    share = particles.mass[fast].sum() / max(particles.mass.sum(), 1e-300)
    return f"{reason}; {100 * share:.0f} % of the mass is still faster than 1 m/s" if share > FLOWING_SHARE else reason


def stepper_of(solver):
    """The interface of `solver` for the time integration."""
    if isinstance(solver, CoupledSolver):
        return IntegratedCoupled(solver)
    return IntegratedPoints(solver) if isinstance(solver, PointSolver) else IntegratedColumns(solver)


class IntegratedColumns:
    """Interface of the depth-averaged solver."""

    RUNNING, REACHED_TIME = column_clock.RUNNING, column_clock.REACHED_TIME
    ALL_LEFT, TRIGGER_REACHED = column_clock.ALL_LEFT, column_clock.TRIGGER_REACHED
    WATCHED_REACHED = column_clock.WATCHED_REACHED
    END_REASONS = COLUMN_REASONS

    def __init__(self, solver):
        self.solver = solver

    @property
    def particles(self):
        """Number of columns on the terrain now."""
        return self.solver.columns

    def moving(self):
        """The Particles on the terrain now."""
        return self.solver.frame().particles

    def advance(self, until, after, max_steps, may_stop):
        """Advance to `until` [s] or by `max_steps`; returns the kernel's reason to stop."""
        return self.solver.advance(until, max_steps, may_stop)

    def take_in(self, code):
        """Features switched on because the flow reached them, for the reason `code` of the kernel."""
        return self.solver.take_in() if code == self.WATCHED_REACHED else ()

    def at_frame(self, code):
        """The reason to end at the time of a frame, else `code`; columns check for rest in every step."""
        return code

    def trouble(self, code):
        """Message with E and N for an error of reason `code`; '' for none."""
        if code not in (column_clock.NOT_FINITE_STATE, column_clock.TOO_FAST):
            return ""
        east, north, bad, ratio, share = self.solver.trouble()
        if code == column_clock.NOT_FINITE_STATE:
            what = f"{bad} columns have a position or area that is not finite; take a smaller cfl or larger cells"
        else:
            what = (
                f"{100 * share:.0f} % of the mass is over twice, at worst {ratio:.1f} times, as fast as its drop in "
                "height allows; a cliff there is beyond a depth-averaged model, elsewhere take a smaller cfl"
            )
        return f"E {east:.1f} N {north:.1f}: {what}"

    def look(self):
        """Present energies, for comparison with later ones."""
        return self.solver.energy_look()

    def energy_trouble(self, last):
        """Message with E and N for energy gained since the look `last`; '' for none."""
        return _energy_trouble(self.solver, last, "columns")


class IntegratedPoints:
    """Interface of the 3D solver; rest is checked at the times of frames only, so that a restart gives the same."""

    RUNNING, REACHED_TIME = point_kernel.RUNNING, point_kernel.REACHED_TIME
    ALL_LEFT, TRIGGER_REACHED = point_kernel.ALL_LEFT, None
    WATCHED_REACHED = point_kernel.WATCHED_REACHED
    END_REASONS = POINT_REASONS

    def __init__(self, solver):
        self.solver = solver

    @property
    def particles(self):
        """Number of points on the terrain now."""
        return self.solver.points

    def moving(self):
        """As for columns."""
        return self.solver.frame().particles

    def advance(self, until, after, max_steps, may_stop):
        """Advance to `until` [s] (then `after` [s]) or by `max_steps`; returns the reason of the kernel."""
        return self.solver.advance(until, after, max_steps)

    def take_in(self, code):
        """Features switched on because the flow reached them, for the reason `code` of the kernel."""
        return self.solver.take_in() if code == self.WATCHED_REACHED else ()

    def at_frame(self, code):
        """The reason to end at the time of a frame, else `code`."""
        self.solver.note_deepest()
        return _rested(self.solver, code)

    def trouble(self, code):
        """Message with E and N for an error of reason `code`; '' for none."""
        if code not in (point_kernel.NOT_FINITE_STATE, point_kernel.LEAKED, point_kernel.SCATTERED):
            return ""
        if code == point_kernel.SCATTERED:
            east, north, height = self.solver.highest()
            return (
                f"E {east:.1f} N {north:.1f}: points fly up to {height:.0f} m above the lowest ground, too far apart "
                "for the cells; take larger cells, a smaller cfl or a stiffer material"
            )
        east, north, bad, share = self.solver.trouble()
        if code == point_kernel.NOT_FINITE_STATE:
            what = f"{bad} points have a place or speed that is not finite; take a smaller cfl"
        else:
            what = (
                f"points with {100 * share:.2g} % of the mass are more than a cell below the ground; take a smaller "
                "cfl, smaller cells or a stiffer material"
            )
        return f"E {east:.1f} N {north:.1f}: {what}"

    def look(self):
        """As for columns."""
        return self.solver.energy_look()

    def energy_trouble(self, last):
        """As for columns."""
        return _energy_trouble(self.solver, last, "points")


def _energy_trouble(solver, last, name):
    """Message for energy that `solver` (particles `name`) gained since the EnergyLook `last`, or ''."""
    share, made = solver.energy_look().gained_since(last)
    if share <= GAIN_STOP:
        return ""
    east, north, speed = solver.fastest()
    return (
        f"E {east:.1f} N {north:.1f}: the {name} gained {made:.3g} J out of nothing since t = {last.time:.3f} s, "
        f"{100 * share:.2g} % of their kinetic energy then and the work since (at most {100 * GAIN_STOP:g} %); the "
        f"fastest has {speed:.3g} m/s; take a smaller cfl"
    )


def _rested(solver, code):
    """STOPPED_AT_REST if the points are at rest and may stop, else `code`."""
    rests = solver.resting_for(REST_SHARE) >= REST_SECONDS
    return STOPPED_AT_REST if rests and solver.numerics.stop_at_rest else code


class IntegratedCoupled:
    """Interface of the coupled solver, points with columns around them."""

    RUNNING, REACHED_TIME = point_kernel.RUNNING, point_kernel.REACHED_TIME
    ALL_LEFT, TRIGGER_REACHED = point_kernel.ALL_LEFT, OF_COLUMNS + column_clock.TRIGGER_REACHED
    END_REASONS = POINT_REASONS

    def __init__(self, solver):
        self.solver = solver
        self._points, self._columns = IntegratedPoints(solver.points_solver), IntegratedColumns(solver.columns_solver)

    @property
    def particles(self):
        """Number of points and columns on the terrain now."""
        return self.solver.particles

    def moving(self):
        """As for columns, of the points only, which determine the end."""
        return self._points.moving()

    def advance(self, until, after, max_steps, may_stop):
        """Advance to `until` [s] (then `after` [s]) or by `max_steps` of the points; returns the reason."""
        return self.solver.advance(until, after, max_steps)

    def take_in(self, code):
        """Features switched on because points or columns reached them, for the reason `code` of their kernel."""
        return self._columns.take_in(code - OF_COLUMNS) if code >= OF_COLUMNS else self._points.take_in(code)

    def at_frame(self, code):
        """The reason to end at the time of a frame, else `code`."""
        self.solver.points_solver.note_deepest()
        return _rested(self.solver, code)

    def trouble(self, code):
        """Message with E and N for an error of reason `code`; '' for none."""
        return self._columns.trouble(code - OF_COLUMNS) if code >= OF_COLUMNS else self._points.trouble(code)

    def look(self):
        """As for columns, of both solvers."""
        return self._points.look(), self._columns.look()

    def energy_trouble(self, last):
        """As for columns, of either solver."""
        return self._points.energy_trouble(last[0]) or self._columns.energy_trouble(last[1])


def measured_pace(solver, seconds=PACE_SECONDS, clock=perf_counter):
    """Wall time [s] per step and particle of `solver`, advanced for `seconds`; None if nothing moves.

    Compile time is excluded. The solver cannot be used afterwards.
    """
    side = stepper_of(solver)
    solver.advance(float("inf"), max_steps=COMPILING_STEPS)
    done, steps, began = 0, FIRST_STEPS, clock()
    while clock() - began < seconds:
        before, particles = solver.step, side.particles
        solver.advance(float("inf"), max_steps=steps)
        if solver.step == before:
            break
        done += (solver.step - before) * particles
        steps = min(2 * steps, 1000)
    return (clock() - began) / done if done else None
