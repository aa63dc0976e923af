"""Common interface of all solvers for the time integration."""

from typing import TYPE_CHECKING

from ..frames.flow_end import FLOWING_SHARE, REST_ENERGY, FlowEnd, moving_share, rests
from ..frames.particle_store import GAIN_STOP
from ..solvers.columns import column_time_step
from ..solvers.points import point_loop as point_kernel
from ..solvers.points.point_solver import PointSolver
from .coupled_solver import OF_COLUMNS, CoupledSolver

if TYPE_CHECKING:
    from ..frames.particle_store import EnergyLook
    from ..solvers.columns.column_solver import ColumnSolver

REST_SECONDS = 2.0  # [s] for which it must be at rest before the run ends
STOPPED_AT_REST = 100  # reason to end, in addition to those of the kernel
END_TIME, ALL_LEFT = "end_time reached", "all mass has left the terrain"
NEARLY_AT_REST = (
    "nearly at rest: kinetic energy below 1 % of its peak for 2 s, and under 5 % of the mass is faster than 1 m/s"
)
COLUMN_REASONS = {
    column_time_step.REACHED_TIME: END_TIME,
    column_time_step.STOPPED_MOVING: "at rest: less than 1 % of the peak moving mass is faster than 0.05 m/s",
    column_time_step.STOPPED_ENERGY: NEARLY_AT_REST,
    column_time_step.STOPPED_FOOTPRINT: (
        "nearly at rest: the footprint grew by less than 0.1 % in 10 s, and under 5 % of the mass is faster than 1 m/s"
    ),
    column_time_step.ALL_LEFT: ALL_LEFT,
}
POINT_REASONS = {point_kernel.REACHED_TIME: END_TIME, STOPPED_AT_REST: NEARLY_AT_REST, point_kernel.ALL_LEFT: ALL_LEFT}


def end_of(stepper: "IntegratedColumns | IntegratedPoints | IntegratedCoupled", code: int) -> FlowEnd:
    """Return the state of a flow at its end.

    A flow that reaches end_time has come to rest if it is at rest then. One that left the terrain has not.

    Parameters
    ----------
    stepper : IntegratedColumns, IntegratedPoints or IntegratedCoupled
    code : int
        Key of its END_REASONS.
    """
    solver = stepper.solver
    moving = _moving(solver)
    if code == stepper.REACHED_TIME and stepper.particles:
        found = solver.balances()
        at_rest = rests(moving, found["kinetic_energy"], found["kinetic_energy_peak"])
    else:
        at_rest = code in stepper.AT_REST
    return FlowEnd(float(solver.time), moving, bool(at_rest))


def _moving(solver):
    """Return the share of the mass of a solver that is faster than FLOWING_SPEED [1]."""
    flow = solver.flow()
    return moving_share(flow.mass, flow.speed)


def stepper_of(
    solver: "ColumnSolver | PointSolver | CoupledSolver",
) -> "IntegratedColumns | IntegratedPoints | IntegratedCoupled":
    """Return the interface of a solver for the time integration.

    Parameters
    ----------
    solver : ColumnSolver, PointSolver or CoupledSolver
    """
    if isinstance(solver, CoupledSolver):
        return IntegratedCoupled(solver)
    return IntegratedPoints(solver) if isinstance(solver, PointSolver) else IntegratedColumns(solver)


class IntegratedColumns:
    """Interface of the depth-averaged solver.

    Parameters
    ----------
    solver : ColumnSolver
    """

    RUNNING, REACHED_TIME = column_time_step.RUNNING, column_time_step.REACHED_TIME
    ALL_LEFT, TRIGGER_REACHED = column_time_step.ALL_LEFT, column_time_step.TRIGGER_REACHED
    END_REASONS = COLUMN_REASONS
    AT_REST = (column_time_step.STOPPED_MOVING, column_time_step.STOPPED_ENERGY, column_time_step.STOPPED_FOOTPRINT)

    def __init__(self, solver: "ColumnSolver") -> None:
        self.solver = solver

    @property
    def particles(self) -> int:
        """Number of columns on the terrain now."""
        return self.solver.columns

    def advance(self, until: float, after: float, max_steps: int, may_stop: bool) -> int:
        """Advance the solver and return the reason of its kernel to stop.

        Parameters
        ----------
        until : float [s]
        after : float [s]
            Not used.
        max_steps : int
        may_stop : bool
            The flow can come to rest: no inflow follows.
        """
        return self.solver.advance(until, max_steps, may_stop)

    def at_frame(self, code: int) -> int:
        """Return the reason to stop at the time of a frame: `code`, as columns check for rest in every step.

        Parameters
        ----------
        code : int
            Reason of the kernel to stop.
        """
        return code

    def trouble(self, code: int) -> str:
        """Return a message with E and N about an error; '' for none.

        Parameters
        ----------
        code : int
            Reason of the kernel to stop.
        """
        if code not in (column_time_step.NOT_FINITE_STATE, column_time_step.TOO_FAST):
            return ""
        east, north, bad, ratio, share = self.solver.trouble()
        if code == column_time_step.NOT_FINITE_STATE:
            what = f"{bad} columns have a position or area that is not finite; take a smaller cfl or larger cells"
        else:
            what = (
                f"{100 * share:.0f} % of the mass is over twice, at worst {ratio:.1f} times, as fast as its drop in "
                "height allows; a cliff there is beyond a depth-averaged model, elsewhere take a smaller cfl"
            )
        return f"E {east:.1f} N {north:.1f}: {what}"

    def energy_look(self) -> "EnergyLook":
        """Return the present energies, for comparison with later ones."""
        return self.solver.energy_look()

    def energy_trouble(self, last: "EnergyLook") -> str:
        """Return a message with E and N about energy gained since `last`; '' for none.

        Parameters
        ----------
        last : EnergyLook
            Earlier result of `energy_look`.
        """
        return _energy_trouble(self.solver, last, "columns")


class IntegratedPoints:
    """Interface of the 3D solver; rest is checked only at the times of frames, so that a restart gives the same.

    Parameters
    ----------
    solver : PointSolver
    """

    RUNNING, REACHED_TIME = point_kernel.RUNNING, point_kernel.REACHED_TIME
    ALL_LEFT, TRIGGER_REACHED = point_kernel.ALL_LEFT, None
    END_REASONS = POINT_REASONS
    AT_REST = (STOPPED_AT_REST,)

    def __init__(self, solver: PointSolver) -> None:
        self.solver = solver

    @property
    def particles(self) -> int:
        """Number of points on the terrain now."""
        return self.solver.points

    def advance(self, until: float, after: float, max_steps: int, may_stop: bool) -> int:
        """Advance the solver and return the reason of its kernel to stop.

        Parameters
        ----------
        until : float [s]
        after : float [s]
            Time that will be requested next.
        max_steps : int
        may_stop : bool
            Not used.
        """
        return self.solver.advance(until, after, max_steps)

    def at_frame(self, code: int) -> int:
        """Return STOPPED_AT_REST if the points are at rest at the time of a frame, else `code`.

        Parameters
        ----------
        code : int
            Reason of the kernel to stop.
        """
        self.solver.note_deepest()
        return _rested(self.solver, code)

    def trouble(self, code: int) -> str:
        """Return a message with E and N about an error; '' for none.

        Parameters
        ----------
        code : int
            Reason of the kernel to stop.
        """
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

    def energy_look(self) -> "EnergyLook":
        """Return the present energies, for comparison with later ones."""
        return self.solver.energy_look()

    def energy_trouble(self, last: "EnergyLook") -> str:
        """Return a message with E and N about energy gained since `last`; '' for none.

        Parameters
        ----------
        last : EnergyLook
            Earlier result of `energy_look`.
        """
        return _energy_trouble(self.solver, last, "points")


def _energy_trouble(solver, last, name):
    """Return a message about energy that `solver` (particles `name`) gained since the EnergyLook `last`, or ''."""
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
    """Return STOPPED_AT_REST if the points are at rest and may stop, else `code`."""
    calm = solver.resting_for(REST_ENERGY) >= REST_SECONDS
    return STOPPED_AT_REST if calm and solver.numerics.stop_at_rest and _moving(solver) < FLOWING_SHARE else code


class IntegratedCoupled:
    """Interface of the coupled solver, points with columns around them.

    Parameters
    ----------
    solver : CoupledSolver
    """

    RUNNING, REACHED_TIME = point_kernel.RUNNING, point_kernel.REACHED_TIME
    ALL_LEFT, TRIGGER_REACHED = point_kernel.ALL_LEFT, OF_COLUMNS + column_time_step.TRIGGER_REACHED
    END_REASONS = POINT_REASONS
    AT_REST = (STOPPED_AT_REST,)

    def __init__(self, solver: CoupledSolver) -> None:
        self.solver = solver
        self._points, self._columns = IntegratedPoints(solver.points_solver), IntegratedColumns(solver.columns_solver)

    @property
    def particles(self) -> int:
        """Number of points and columns on the terrain now."""
        return self.solver.particles

    def advance(self, until: float, after: float, max_steps: int, may_stop: bool) -> int:
        """Advance both solvers and return the reason to stop.

        Parameters
        ----------
        until : float [s]
        after : float [s]
            Time that will be requested next.
        max_steps : int
            Of the points.
        may_stop : bool
            Not used.
        """
        return self.solver.advance(until, after, max_steps)

    def at_frame(self, code: int) -> int:
        """Return STOPPED_AT_REST if the points are at rest at the time of a frame, else `code`.

        Parameters
        ----------
        code : int
            Reason to stop.
        """
        self.solver.points_solver.note_deepest()
        return _rested(self.solver, code)

    def trouble(self, code: int) -> str:
        """Return a message with E and N about an error; '' for none.

        Parameters
        ----------
        code : int
            Reason to stop.
        """
        return self._columns.trouble(code - OF_COLUMNS) if code >= OF_COLUMNS else self._points.trouble(code)

    def energy_look(self) -> "tuple[EnergyLook, EnergyLook]":
        """Return the present energies of points and of columns, for comparison with later ones."""
        return self._points.energy_look(), self._columns.energy_look()

    def energy_trouble(self, last: "tuple[EnergyLook, EnergyLook]") -> str:
        """Return a message with E and N about energy that either solver gained since `last`; '' for none.

        Parameters
        ----------
        last : (EnergyLook, EnergyLook)
            Earlier result of `energy_look`.
        """
        return self._points.energy_trouble(last[0]) or self._columns.energy_trouble(last[1])
