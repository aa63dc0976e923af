"""Apply events between steps: inflow over time, and secondary releases that the flow triggers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..frames.particles import Frame, Particles
from ..frames.state_check import StateCheck
from ..solvers.columns.feature_arrays import MAX_AREAS
from ..system.errors import FormatError, SceneError
from ..terrain.inflow import BATCH_SHARE, batch_times, clearing_time

if TYPE_CHECKING:
    from ..solvers.columns.column_solver import ColumnSolver
    from ..solvers.columns.node_grid import ColumnGrid
    from ..terrain.inflow import Hydrograph
    from .coupled_solver import CoupledSolver

LARGEST_REASON = 100  # for the end of a time integration (`point_balances.STOPPED_AT_REST`)

# Number of the layer, 0 to 7, of a column of an inlet by its place on the lattice: half of the matrix of ordered dither
# (Bayer 1973). The columns of a layer are evenly distributed, and eight layers fill the lattice once.
_TURNS = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]]) // 2


@dataclass(frozen=True, eq=False)
class Inlet:
    """Columns that flow in through one area in batches, each at a fixed time.

    Parameters
    ----------
    frame : Frame
        The inlet's columns, 1 m thick.
    layers : tuple of int arrays
        Indices of the columns that enter together; the batches use the layers in turn.
    times : float64[k, 2] [s]
        Time at which a batch enters, and end of the interval whose inflow it is.
    volumes : float64[k] [m3]
    velocity : callable
        (time [s], int[n] columns) -> float64[n, 3] [m s-1], velocity of inflow.
    reference_thickness : float [m]
        Approximate thickness in the inlet.
    slabs : bool
        Each batch is a separate slab, not part of a steady flow.
    """

    frame: Frame
    layers: tuple
    times: np.ndarray
    volumes: np.ndarray
    velocity: Callable
    reference_thickness: float
    slabs: bool

    def batch(self, k: int) -> Frame:
        """Return the columns of batch `k`; their volumes add up to the volume of the batch.

        Parameters
        ----------
        k : int
            Number of the batch, from 0.
        """
        index = self.layers[k % len(self.layers)]
        particles, density = self.frame.particles, self.frame.header["density"]
        share = particles.volume[index] / particles.volume[index].sum()
        area = particles.area[index] * (particles.area.sum() / particles.area[index].sum())
        volume = share * self.volumes[k]
        batch = Particles(
            particles.position[index],
            self.velocity(self.times[k, 0], index),
            density * volume,
            volume,
            thickness=volume / area,
            area=area,
        )
        return replace(self.frame, particles=batch, time=float(self.times[k, 0]))

    def fastest_velocity(self) -> np.ndarray:
        """Return the velocity of all its columns in the fastest batch.

        Returns
        -------
        float64[n, 3] [m s-1]
        """
        first = np.zeros(1, int)  # the other columns have the same speed, each along its ground
        speeds = [float(np.linalg.norm(self.velocity(time, first))) for time in self.times[:, 0]]
        return self.velocity(self.times[int(np.argmax(speeds)), 0], np.arange(len(self.frame.particles)))

    @property
    def columns(self) -> int:
        """Number of columns of all batches together."""
        return sum(len(self.layers[k % len(self.layers)]) for k in range(len(self.times)))


def inlet_of(frame: Frame, hydrograph: "Hydrograph", grid: "ColumnGrid", end_time: float) -> Inlet:
    """Return the Inlet through which `hydrograph` flows in.

    A discharge enters in batches of an eighth (BATCH_SHARE) of the content of the inlet, estimated by
    `inflow.clearing_time`, each at the start of the interval whose exact inflow it is; slabs enter as a whole.

    Parameters
    ----------
    frame : Frame
        The columns of the inlet, 1 m thick in the thickness mode of the scene.
    hydrograph : Hydrograph
    grid : ColumnGrid
        Of the solver.
    end_time : float [s]

    Raises
    ------
    SceneError
        Nothing flows in before `end_time`; a speed down the steepest descent on level ground.
    """
    velocity = _entry_velocity(hydrograph, grid, frame)
    if hydrograph.thickness is not None:
        now = (hydrograph.time < end_time) & (hydrograph.thickness > 0)
        times, layers = np.column_stack([hydrograph.time, hydrograph.time])[now], (np.arange(len(frame.particles)),)
        volumes = hydrograph.thickness[now] * frame.particles.volume.sum()
        reference = float(hydrograph.thickness.max())
    else:
        interval, reference = _batch_interval(hydrograph, grid, frame)
        times, layers = batch_times(hydrograph, end_time, interval), _layers(frame, grid)
        volumes = np.array([hydrograph.volume(*pair) for pair in times])
        times, volumes = times[volumes > 0], volumes[volumes > 0]
    if not len(times):
        raise SceneError(
            f"[hydrograph] nothing flows in before end_time = {end_time:g} s; take a later end_time or earlier times"
        )
    return Inlet(frame, layers, times, volumes, velocity, reference, hydrograph.thickness is not None)


def _entry_velocity(hydrograph: "Hydrograph", grid: "ColumnGrid", frame: Frame) -> Callable:
    """Return a function (time, columns) -> velocities along the ground."""
    if hydrograph.speed is not None and hydrograph.speed.any():
        down = grid.downslope(frame)
        return lambda time, index: hydrograph.speed_at(time) * down[index]
    gradient = grid.gradients_at(frame)

    def velocity(time, index):
        east, north = hydrograph.velocity_at(time)
        up = gradient[index] @ np.array((east, north))
        return np.column_stack([np.full(len(index), east), np.full(len(index), north), up])

    return velocity


def _batch_interval(hydrograph: "Hydrograph", grid: "ColumnGrid", frame: Frame) -> tuple[float, float]:
    """Return the time between batches [s] and the thickness [m] in the inlet, both at the largest discharge."""
    peak = int(np.argmax(hydrograph.discharge))
    discharge, time = float(hydrograph.discharge[peak]), hydrograph.time[peak]
    gradient = grid.gradients_at(frame).mean(axis=0)
    entry = np.array(hydrograph.velocity_at(time))
    speed = max(hydrograph.speed_at(time), float(np.hypot(*entry)))
    way = entry if entry.any() else -gradient
    area = float(frame.particles.area.sum())
    if np.hypot(*way) > 1e-3:
        across = np.array((-way[1], way[0])) / np.hypot(*way)
        place = frame.particles.position[:, :2] @ across
        width = np.ptp(place) + np.sqrt(frame.particles.area.mean())
    else:
        width = np.sqrt(area)
    width = min(width, area / grid.cell_size)  # no inlet is shorter than a cell
    clearing = clearing_time(discharge, area / width, width, float(np.hypot(*gradient)), speed)
    return BATCH_SHARE * clearing, discharge * clearing / area


def _layers(frame, grid):
    """Return the columns in layers, by their place on the lattice; all in one layer if some would be empty."""
    spacing = np.sqrt(np.median(frame.particles.area))
    i, j = (np.floor(place / spacing).astype(int) % 4 for place in grid.from_corner(frame))
    layers = tuple(np.flatnonzero(_TURNS[j, i] == turn) for turn in range(_TURNS.max() + 1))
    return layers if all(map(len, layers)) else (np.arange(len(i)),)


@dataclass(frozen=True, eq=False)
class SecondaryRelease:
    """Columns at rest that are released when the flow reaches them.

    Parameters
    ----------
    name : str
    frame : Frame
        The columns.
    nodes : (int[k], int[k])
        Corners of the cells of the area, as rows and columns of the node arrays of the solver.
    trigger_thickness : float or None [m]
        Flow thicker than this releases them; None: any flow.
    """

    name: str
    frame: Frame
    nodes: tuple
    trigger_thickness: float | None = None


def secondary_releases(named_frames: Sequence, grid: "ColumnGrid") -> tuple[SecondaryRelease, ...]:
    """Return a SecondaryRelease for each area; no node belongs to two of them.

    Parameters
    ----------
    named_frames : sequence of (str, Frame, float or None)
        Name, columns and trigger thickness [m] of each area.
    grid : ColumnGrid
        Of the solver.

    Raises
    ------
    SceneError
        Too many areas, or one within the cells of others.
    """
    if len(named_frames) > MAX_AREAS:
        raise SceneError(f"{len(named_frames)} [[secondary_release]], expected at most {MAX_AREAS}; unite some of them")
    taken = np.zeros(grid.bed.shape, bool)
    releases = []
    for name, frame, thickness in named_frames:
        rows, columns = grid.corners_of(grid.cells_of(frame))
        free = ~taken[rows, columns]
        if not free.any():
            raise SceneError(
                f"[[secondary_release]] '{name}' is within cells of others; unite them or use a smaller cell_size"
            )
        nodes = rows[free], columns[free]
        taken[nodes] = True
        releases.append(SecondaryRelease(name, frame, nodes, thickness))
    return tuple(releases)


class Events:
    """All events between the steps of a run, and their state.

    There are no events while it is not `awake`, in a stage of points.

    Parameters
    ----------
    inlets : sequence of Inlet
    secondary : sequence of SecondaryRelease

    Attributes
    ----------
    ended : int
        Reason for the end of the time integration, 0 before it.
    awake : bool
    """

    def __init__(self, inlets: Sequence = (), secondary: Sequence = ()) -> None:
        self.inlets, self.secondary = tuple(inlets), tuple(secondary)
        self.ended = 0  # reason of the kernel for the end of the run
        self.awake = True
        self._batches = np.zeros(len(self.inlets), np.int64)
        self._released = np.zeros(len(self.secondary), np.int64)
        self._window = {}

    def columns_to_come(self) -> int:
        """Return the number of columns that can enter over the whole run."""
        inflow = sum(inlet.columns for inlet in self.inlets)
        return inflow + sum(len(release.frame.particles) for release in self.secondary)

    def next_time(self, time: float) -> float:
        """Return the time of the next event after `time`; infinity if there is none.

        An event is a batch, or the end of the inflow, from which on the run can come to rest.

        Parameters
        ----------
        time : float [s]

        Returns
        -------
        float [s]
        """
        if not self.awake:
            return float("inf")
        due = [inlet.times[inlet.times[:, 0] > time, 0].min(initial=np.inf) for inlet, _ in self._unfinished()]
        due += [inlet.times[-1, 1] for inlet in self.inlets if inlet.times[-1, 1] > time]
        return float(min(due, default=np.inf))

    def over(self, time: float) -> bool:
        """Return whether the inflow is complete.

        Parameters
        ----------
        time : float [s]
        """
        return self.next_time(time) == np.inf

    def _unfinished(self):
        return [(inlet, k) for inlet, k in zip(self.inlets, self._batches, strict=True) if k < len(inlet.times)]

    def ends(self) -> float:
        """Return the time [s] at which the last inflow is complete; 0 without inflow."""
        return max((float(inlet.times[-1, 1]) for inlet in self.inlets), default=0.0)

    def move_to(self, grid: "ColumnGrid") -> None:
        """Continue with a solver on another grid, whose nodes determine when areas are reached.

        Parameters
        ----------
        grid : ColumnGrid
        """
        named = [(area.name, area.frame, area.trigger_thickness) for area in self.secondary]
        self.secondary, self._window = secondary_releases(named, grid), {}

    def let_in(self, solver: "ColumnSolver | CoupledSolver") -> None:
        """Insert the batches that are due at the time of the solver.

        Parameters
        ----------
        solver : ColumnSolver or CoupledSolver
        """
        if not self.awake:
            return
        for number, inlet in enumerate(self.inlets):
            while self._batches[number] < len(inlet.times) and inlet.times[self._batches[number], 0] <= solver.time:
                solver.insert(inlet.batch(int(self._batches[number])), self._window_of(solver, inlet), inlet.slabs)
                self._batches[number] += 1

    def release(self, solver: "ColumnSolver | CoupledSolver") -> None:
        """Release the areas that the flow has reached.

        Parameters
        ----------
        solver : ColumnSolver or CoupledSolver
        """
        for number, area in enumerate(self.secondary):
            if not self._released[number] and solver.fired(number + 1, area.nodes):
                solver.insert(area.frame, self._window_of(solver, area))
                self._released[number] = 1

    def _window_of(self, solver, source):
        """Return the cells in which the columns of `source` and others can overlap: its cells and their neighbours."""
        if id(source) not in self._window:
            self._window[id(source)] = solver.grid.cells_of(source.frame, grown=1)
        return self._window[id(source)]

    def arm(self, solver: "ColumnSolver | CoupledSolver") -> None:
        """Let the solver stop when the flow reaches an area that is not released yet.

        Parameters
        ----------
        solver : ColumnSolver or CoupledSolver
        """
        if not self.awake:
            return
        for number, area in enumerate(self.secondary):
            if not self._released[number]:
                solver.arm(number + 1, area.nodes, area.trigger_thickness)

    def record(self) -> dict:
        """Return numbers for the record of a run: batches that entered, areas that were released."""
        released = [area.name for area, gone in zip(self.secondary, self._released, strict=True) if gone]
        return {"batches": int(self._batches.sum()), "secondary_releases": released}

    def state(self) -> dict[str, np.ndarray]:
        """Return the state for a restart, in addition to that of the solver."""
        return {"events": np.concatenate([[self.ended], self._batches, self._released]).astype(np.int64)}

    def batches_in(self, frame: Frame) -> np.ndarray:
        """Return the number of batches of each inlet that had entered when `frame` was written.

        Parameters
        ----------
        frame : Frame
            Of the same run.

        Returns
        -------
        int64[inlets]

        Raises
        ------
        FormatError
            The frame is of a run with other events.
        """
        return self._state_of(frame)[1 : 1 + len(self.inlets)]

    def _state_of(self, frame):
        state = np.asarray(frame.state.get("events", ()))
        if state.shape != (1 + len(self.inlets) + len(self.secondary),):
            raise FormatError(f"the frame at t = {frame.time:g} s is of another scene; start with --overwrite")
        check, inlets = StateCheck(frame.time, frame.state), len(self.inlets)
        check.array("events", np.int64, state.shape)
        check.within("the reason to end", state[0], 0, LARGEST_REASON)
        for inlet, count in zip(self.inlets, state[1 : 1 + inlets], strict=True):
            check.within("the number of batches that have entered", count, 0, len(inlet.times))
        check.within("whether an area is released", state[1 + inlets :], 0, 1)
        return state

    def restore(self, frame: Frame) -> None:
        """Continue from a frame of the same run.

        Parameters
        ----------
        frame : Frame

        Raises
        ------
        FormatError
            The frame is of a run with other events.
        """
        state = self._state_of(frame)
        self.ended = int(state[0])
        self._batches[:] = state[1 : 1 + len(self.inlets)]
        self._released[:] = state[1 + len(self.inlets) :]
