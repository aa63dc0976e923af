"""Couple points in a window with columns around them: columns that enter the window become points."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..frames.particle_store import Flow
from ..frames.particles import Particles
from ..frames.peaks import combined_peaks
from ..solvers.columns import column_time_step
from ..solvers.points.point_balances import PointBalances, reason_at_rest
from ..system.errors import FormatError

if TYPE_CHECKING:
    from ..frames.particle_store import EnergyLook
    from ..frames.particles import Frame
    from ..solvers.columns.column_solver import ColumnSolver
    from ..solvers.columns.node_grid import CellWindow
    from ..solvers.points.point_solver import PointSolver

EXCHANGE_SECONDS = 0.1  # [s] simulated time between two checks for columns that entered the window
PREFIX = "outside_"  # of the arrays of the columns in the state of a frame
SHOWN_ID = 1 << 60  # first id of points that stand for columns in a frame
SHOWN_BITS = 16  # of the id of such a point: its number in its column
OF_COLUMNS = 1000  # added to the reasons of columns to stop, which differ from those of points
_TIME = 1e-9  # [s] and [exchanges] rounding error of a time


class _Ids(NamedTuple):
    id: np.ndarray


class _Kept(NamedTuple):
    """Part of a frame from which a solver is restored."""

    time: float
    state: dict
    particles: _Ids


class CoupledSolver:
    """A PointSolver `points` with the ColumnSolver `columns` of the flow outside its window.

    Both have the same time after each call. Columns do not interact with points until they enter the window, where they
    are converted to points. Points remain points everywhere. A frame contains points only, so that it is read as one
    flow; the state of the columns is in its `state`.

    Parameters
    ----------
    points : PointSolver
    columns : ColumnSolver
    inside : callable
        (x, y) [m] -> bool[n]: places at which columns become points.
    as_points : callable
        Frame of columns -> Frame of points, with the state that `columns_to_points.columns_to_points` gives.
    stress_of : callable
        That Frame of points -> float64[n, 6] [Pa], their stress.

    Attributes
    ----------
    exchanged_mass : float [kg]
        Of the columns that became points so far.
    exchanged_columns : int
        Their number.
    exchanged_energy : float [J]
        Energy that they lost in the conversion.
    """

    def __init__(
        self, points: "PointSolver", columns: "ColumnSolver", inside: Callable, as_points: Callable, stress_of: Callable
    ) -> None:
        self.points_solver, self.columns_solver = points, columns
        self.inside, self.as_points, self.stress_of = inside, as_points, stress_of
        self.exchanged_mass, self.exchanged_columns, self.exchanged_energy = 0.0, 0, 0.0
        self._next_id = len(points.frame().particles)

    RUNNING, REACHED_TIME, ALL_LEFT = PointBalances.RUNNING, PointBalances.REACHED_TIME, PointBalances.ALL_LEFT
    TRIGGER_REACHED = OF_COLUMNS + column_time_step.TRIGGER_REACHED
    END_REASONS, AT_REST = PointBalances.END_REASONS, PointBalances.AT_REST

    effects = property(lambda self: self.points_solver.effects)
    numerics = property(lambda self: self.points_solver.numerics)
    speed_max = property(lambda self: max(self.points_solver.speed_max, self._column_speed()))
    mach = property(lambda self: self.points_solver.mach)
    step = property(lambda self: self.points_solver.step)
    time = property(lambda self: min(self.points_solver.time, self.columns_solver.time))
    grid = property(lambda self: self.columns_solver.grid)

    def _column_speed(self):
        return self.columns_solver.speed_max if self.columns_solver.particles else 0.0

    @property
    def particles(self) -> int:
        """Number of points and columns on the terrain now."""
        return self.points_solver.particles + self.columns_solver.particles

    # ------------------------------------------------------------------------------------------------- between steps

    def insert(self, frame: "Frame", window: "CellWindow", slab: bool = True) -> None:
        """Insert columns, see `ColumnSolver.insert`.

        Parameters
        ----------
        frame : Frame
            Of columns.
        window : CellWindow
            Cells in which they can overlap with others.
        slab : bool
            They are a separate slab, not part of a steady flow.
        """
        self.columns_solver.insert(frame, window, slab)

    def arm(self, number: int, nodes: tuple, thickness: float | None) -> None:
        """Let the columns stop when the flow reaches an area, see `ColumnSolver.arm`.

        Parameters
        ----------
        number : int
            Of the area, from 1.
        nodes : (int[k], int[k])
            Rows and columns of its nodes.
        thickness : float or None [m]
            Flow thicker than this counts; None: any flow.
        """
        self.columns_solver.arm(number, nodes, thickness)

    def fired(self, number: int, nodes: tuple) -> bool:
        """Return whether the flow reached an area, which is then no longer armed, see `ColumnSolver.fired`.

        Parameters
        ----------
        number : int
            Of the area, from 1.
        nodes : (int[k], int[k])
            Rows and columns of its nodes.
        """
        return self.columns_solver.fired(number, nodes)

    def wait(self, until: float) -> None:
        """Set the time on an empty terrain.

        Parameters
        ----------
        until : float [s]
        """
        self.points_solver.wait(until)
        self.columns_solver.wait(until)

    # -------------------------------------------------------------------------------------------------------- marching

    def advance(self, until: float, after: float = np.inf, max_steps: int = 1 << 62, may_stop: bool = True) -> int:
        """Advance both solvers to `until`.

        Parameters
        ----------
        until : float [s]
        after : float [s]
            Next time that will be requested; the step before `until` is chosen for it.
        max_steps : int
            Largest number of steps of the points.
        may_stop : bool
            Not used: rest is checked at the times of frames.

        Returns
        -------
        int
            RUNNING, REACHED_TIME, ALL_LEFT, the reason of an error of the points, or OF_COLUMNS plus the reason of the
            columns.
        """
        first = self.step
        while self.time < until - _TIME:
            if not self.particles:
                return self.ALL_LEFT
            exchange = _next_exchange(self.time)
            target = exchange if exchange < until - _TIME else until
            then = min(after if target == until else until, _next_exchange(target))
            code = self._integrate_points(target, then, max_steps - (self.step - first))
            if code == self.REACHED_TIME:
                code = self._integrate_columns(target)
            if code != self.REACHED_TIME:
                return code
            if abs(target - exchange) < _TIME:
                self._exchange()
            if self.step - first >= max_steps and target != until:
                return self.RUNNING
        return self.REACHED_TIME

    def _integrate_points(self, target, then, max_steps):
        solver = self.points_solver
        if solver.time >= target - _TIME:
            return self.REACHED_TIME
        code = solver.advance(target, then, max(max_steps, 1)) if solver.particles else self.ALL_LEFT
        if code == self.ALL_LEFT:
            solver.wait(target)
            return self.REACHED_TIME
        return code

    def _integrate_columns(self, target):
        solver = self.columns_solver
        code = solver.advance(target, may_stop=False)
        if code == column_time_step.ALL_LEFT:
            solver.wait(target)
            return self.REACHED_TIME
        return code if code == column_time_step.REACHED_TIME else OF_COLUMNS + code

    def _exchange(self):
        """Convert columns that entered the window to points."""
        taken = self.columns_solver.take_out(self.inside) if self.columns_solver.particles else None
        if taken is None:
            return
        frame = self.as_points(taken)
        stress, gradient = self.stress_of(frame), frame.state.get("affine")
        ids = np.arange(self._next_id, self._next_id + len(frame.particles), dtype=np.uint64)
        self._next_id += len(ids)
        self.points_solver.insert(replace(frame, particles=replace(frame.particles, id=ids)), stress, gradient)
        self.exchanged_mass += float(taken.particles.mass.sum())
        self.exchanged_columns += len(taken.particles)
        self.exchanged_energy += self._energy_of(taken) - self._energy_of(frame)

    def _energy_of(self, frame):
        """Return the kinetic and potential energy [J] of columns or points, from elevation 0."""
        particles = frame.particles
        middle = particles.position[:, 2] + frame.origin[2]
        if particles.thickness is not None:
            middle = middle + 0.5 * particles.thickness
        speed2 = (particles.velocity**2).sum(axis=1)
        return float((particles.mass * (0.5 * speed2 + self.numerics.gravity * middle)).sum())

    # --------------------------------------------------------------------------------------------- frames and balances

    def flow(self) -> Flow:
        """Return the present Flow of both solvers."""
        both = self.points_solver, self.columns_solver
        parts = [solver.flow() for solver in both if solver.particles]
        return Flow(*(np.concatenate(values) for values in zip(*parts, strict=True)))

    def frame(self) -> "Frame":
        """Return the present frame of points, which contains the columns outside the window as points.

        These have the same mass and momentum as the columns. `state` contains the state of both solvers.
        """
        points, columns = self.points_solver.frame(), self.columns_solver.frame()
        state = points.state | {f"{PREFIX}{name}": values for name, values in columns.state.items()}
        state |= {f"{PREFIX}ids": columns.particles.id, f"{PREFIX}origin": np.asarray(columns.origin)}
        state[f"{PREFIX}started"] = np.frombuffer(json.dumps(self.started()).encode(), np.uint8)
        if not len(columns.particles):
            return replace(points, maxima=self.maxima(), state=state)
        shown = self.as_points(columns)
        return replace(points, particles=_together(points, shown), maxima=self.maxima(), state=state)

    def maxima(self) -> dict:
        """Return the running peaks of both, as in a frame."""
        return combined_peaks(self.points_solver.maxima(), self.columns_solver.maxima())

    def parts(self) -> "tuple[Frame, Frame]":
        """Return the present frames of points and of columns.

        Returns
        -------
        points, columns : Frame
        """
        return self.points_solver.frame(), self.columns_solver.frame()

    def started(self) -> dict:
        """Return the initial sums of both solvers, and the mass and energy exchanged so far."""
        return {
            "points": self.points_solver.started(),
            "columns": self.columns_solver.started(),
            "next_id": self._next_id,
            "exchanged_mass": self.exchanged_mass,
            "exchanged_columns": self.exchanged_columns,
            "exchanged_energy": self.exchanged_energy,
        }

    def start_from(self, started: dict) -> None:
        """Set the initial sums of both solvers and the exchanged mass and energy.

        Parameters
        ----------
        started : dict
            Result of `started`.
        """
        self.points_solver.start_from(started["points"])
        self.columns_solver.start_from(started["columns"])
        self._next_id = started["next_id"]
        self.exchanged_mass, self.exchanged_columns = started["exchanged_mass"], started["exchanged_columns"]
        self.exchanged_energy = started["exchanged_energy"]

    def restore(self, frame: "Frame", known: bool = False) -> None:
        """Continue from a frame of this run that contains the state of both solvers.

        Parameters
        ----------
        frame : Frame
        known : bool
            The state comes from this process and is not checked.

        Raises
        ------
        FormatError
            The frame has no state of the columns.
        """
        own, state = _states(frame)
        ids = frame.particles.id[: len(own["rows"])]
        self.points_solver.restore(_Kept(frame.time, own, _Ids(ids)), known)
        self.columns_solver.restore(_Kept(frame.time, state, _Ids(np.asarray(state["ids"]))), known)
        self.start_from(json.loads(bytes(state["started"])))

    def share_step(self, share: float) -> None:
        """Use shorter steps from now on.

        Parameters
        ----------
        share : float [1]
            Length of the steps over their normal length.
        """
        self.points_solver.share_step(share)
        self.columns_solver.share_step(share)

    def resting_for(self, share: float) -> float:
        """Return for how long the points have rested (see `PointSolver`); 0 while the columns move.

        Parameters
        ----------
        share : float [1]
            Of the peak kinetic energy, below which the flow is at rest.

        Returns
        -------
        float [s]
        """
        rests = self.points_solver.resting_for(share)
        return rests if self.columns_solver.energy()[0] <= share * self.points_solver.kinetic_peak else 0.0

    def at_frame(self, code: int) -> int:
        """Return STOPPED_AT_REST if the flow is at rest at the time of a frame, else `code`.

        Parameters
        ----------
        code : int
            Reason to stop.
        """
        self.points_solver.note_deepest()
        return reason_at_rest(self, code)

    def trouble(self, code: int) -> str:
        """Return a message with E and N about an error; '' for none.

        Parameters
        ----------
        code : int
            Reason to stop.
        """
        of_columns = code >= OF_COLUMNS
        return self.columns_solver.trouble(code - OF_COLUMNS) if of_columns else self.points_solver.trouble(code)

    def energy_look(self) -> "tuple[EnergyLook, EnergyLook]":
        """Return the present energies of points and of columns, for comparison with later ones."""
        return self.points_solver.energy_look(), self.columns_solver.energy_look()

    def energy_trouble(self, last: "tuple[EnergyLook, EnergyLook]") -> str:
        """Return a message with E and N about energy that either solver gained since `last`; '' for none.

        Parameters
        ----------
        last : (EnergyLook, EnergyLook)
            Earlier result of `energy_look`.
        """
        return self.points_solver.energy_trouble(last[0]) or self.columns_solver.energy_trouble(last[1])

    def balances(self) -> dict:
        """Return the balances of the points with the masses of both; `outside_columns` has those of the columns."""
        points, columns = self.points_solver.balances(), self.columns_solver.balances()
        both = {name: points[name] + columns[name] for name in ("mass_start", "mass_now", "mass_out")}
        both["mass_released"] = points["mass_start"] + columns["mass_released"]
        both["mass_entrained"] = columns["mass_entrained"]
        places = points["left_places"] + columns["left_places"]
        both["left_places"] = sorted(places, key=lambda place: -place["mass"])
        found, come = both["mass_now"] + both["mass_out"], both["mass_released"] + both["mass_entrained"]
        kept = ("mass_now", "mass_out", "outflow", "left_places", "barriers", "clips", "particle_steps")
        energies = ("kinetic_energy", "kinetic_energy_peak", "potential_energy")
        peaks = (f"{name}_max{what}" for name in ("thickness", "speed") for what in ("", "_at", "_time"))
        kept = {*kept, *energies, *peaks}
        outside = {name: value for name, value in columns.items() if name in kept or name.startswith("energy_")}
        outside |= {"exchanged_mass": self.exchanged_mass, "exchanged_columns": self.exchanged_columns}
        outside["exchanged_energy_lost"] = self.exchanged_energy
        return points | both | {"mass_error_relative": (found - come) / come, "outside_columns": outside}


def parts_of(frame: "Frame") -> "tuple[Frame, Frame]":
    """Separate a coupled `frame` with its state into the frames of its two solvers.

    Of the columns only state and ids are restored.

    Parameters
    ----------
    frame : Frame

    Returns
    -------
    points, columns : Frame

    Raises
    ------
    FormatError
        The frame has no state of the columns.
    """
    own, state = _states(frame)
    particles, n = frame.particles, len(own["rows"])
    points = replace(frame, particles=particles.take(slice(0, n)), state=own)
    ids, origin = np.asarray(state["ids"]), tuple(np.asarray(state["origin"]).tolist())
    first = np.zeros(len(ids), int)  # positions are in rows
    columns = replace(particles.take(first), id=ids, thickness=np.ones(len(ids)), area=np.ones(len(ids)))
    return points, replace(frame, particles=columns, dimension=2, origin=origin, state=state)


def _states(frame):
    """Return (state of the points, state of the columns with `ids`, `origin` and `started`) of a coupled `frame`."""
    names = [name for name in frame.state if name.startswith(PREFIX)]
    if f"{PREFIX}started" not in names or "rows" not in frame.state:
        raise FormatError(
            f"the frame at t = {frame.time:g} s has no state of the columns outside the window; start with --overwrite"
        )
    own = {name: values for name, values in frame.state.items() if name not in names}
    return own, {name.removeprefix(PREFIX): frame.state[name] for name in names}


def _next_exchange(time):
    return (math.floor(time / EXCHANGE_SECONDS + _TIME) + 1) * EXCHANGE_SECONDS


def _together(points, shown):
    """Return the particles of the Frame `points`, followed by those of `shown`, numbered by their columns."""
    own, others = points.particles, shown.particles
    row = np.arange(len(others))
    begins = np.append(True, others.parent[1:] != others.parent[:-1])
    number = row - np.maximum.accumulate(np.where(begins, row, 0))
    ids = np.uint64(SHOWN_ID) + (others.parent << np.uint64(SHOWN_BITS)) + number.astype(np.uint64)
    shift = np.subtract(shown.origin, points.origin)
    return Particles(
        np.concatenate([own.position, others.position + shift]),
        np.concatenate([own.velocity, others.velocity]),
        np.concatenate([own.mass, others.mass]),
        np.concatenate([own.volume, others.volume]),
        id=np.concatenate([own.id, ids]),
    )
