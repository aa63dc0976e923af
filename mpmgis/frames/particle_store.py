"""What both solvers have in common: arrays, frames, restart, energies and sums."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..compiled.block_order import GONE, LEFT_BLOCK, LEFT_ENTRIES, LEFT_MASS
from ..compiled.particle_slices import copied, taken
from ..system.errors import FormatError
from .peaks import PEAK_STATE, is_peaks_state, no_peaks, restore_peaks
from .state_arrays import PARTICLES, array_table, grown_arrays, made_arrays
from .state_check import LEFT_STATE

if TYPE_CHECKING:
    from .particles import Frame

GAIN_STOP = 0.1  # [1] largest accepted gain of energy since the last look, over kinetic energy and work
REST_SHARE = 0.01  # [1] of the largest kinetic energy so far: a flow with less is at rest; least reference for gains
REST_LIFT = 0.01  # [cells] lift of all mass whose energy is the least reference for gains
EDGE_NAMES = ("west", "south", "east", "north", "nodata")


class Flow(NamedTuple):
    """State of the flow, one entry per column or point; all arrays are float64[n]."""

    x: np.ndarray  # [m] on the map
    y: np.ndarray
    u: np.ndarray  # [m s-1] to the east
    v: np.ndarray  # to the north
    speed: np.ndarray  # [m s-1] with its vertical part
    depth: np.ndarray  # [m] of the flow there, vertical
    mass: np.ndarray  # [kg]

    def __len__(self):
        return len(self.mass)

    def take(self, index: np.ndarray | slice) -> "Flow":
        """Return the entries that `index` picks.

        Parameters
        ----------
        index : bool[n], int[m] or slice
        """
        return Flow(*(values[index] for values in self))


class EnergyLook(NamedTuple):
    """Energies [J] at one moment.

    Parameters
    ----------
    made : float [J]
        Present and outflown energy minus all energy input since the start: negative by the losses, and increasing only
        by errors.
    kinetic : float [J]
        Kinetic energy of the particles on the terrain.
    least : float [J]
        Smallest kinetic energy for comparison, see `least_kinetic`.
    work : tuple of float [J]
        Work since the start by weight, by stress, and of the recorded losses; and kinetic energy input.
    time : float [s]
    """

    made: float
    kinetic: float
    least: float
    work: tuple
    time: float

    def gained_since(self, last: "EnergyLook") -> tuple[float, float]:
        """Return the energy gained since an earlier look.

        Parameters
        ----------
        last : EnergyLook

        Returns
        -------
        share : float [1]
            Gain over kinetic energy and work.
        gain : float [J]
        """
        made = self.made - last.made
        work = sum(abs(now - before) for now, before in zip(self.work, last.work, strict=True))
        return made / max(max(last.kinetic, last.least) + work, 1e-300), made


def least_kinetic(peak: float, mass: float, gravity: float, cell_size: float) -> float:
    """Return the smallest kinetic energy [J] for comparison: 1 % of its peak, or lifting all mass by 1 % of a cell.

    Rounding of single precision is below a tenth of that.

    Parameters
    ----------
    peak : float [J]
        Largest kinetic energy so far.
    mass : float [kg]
    gravity : float [m s-2]
    cell_size : float [m]
    """
    return max(REST_SHARE * peak, mass * gravity * REST_LIFT * cell_size)


class ParticleStore:
    """What the solvers of columns and of points have in common: their arrays, steps, frames and restart.

    A solver has `_particles`, `thickest` and `state` of a frame; and for `restore` `_shapes_of_parts`, types and shapes
    of what the state holds of particles and nodes, `_require_state`, which checks values, and `_restore_own`.

    Attributes
    ----------
    kernel : module
        Module of the compiled loop; its constants are the indices in rows, clock and counts.
    record : class
        Of the arrays that steps change, see `state_arrays`.
    name : str
        Of the solver and of its particles, "columns" or "points".
    own_state : tuple of str
        Further names in the state of a frame, whose lengths are those of the flow.
    """

    kernel: Any = None
    record: Any = None
    name = ""
    own_state: tuple[str, ...] = ()
    _keeps_peaks = True  # whether the state of a frame has running peaks
    _computed = MappingProxyType({})  # name -> what was computed from the present state

    def _make_arrays(self, sizes: dict[str, int], real: Any = float) -> None:
        """Make the arrays of a run with `sizes` by name, before its start."""
        arrays = made_arrays(self.record, real, sizes)
        self._arrays = arrays._replace(peaks=no_peaks(arrays.peaks.shape[:2], arrays.peaks.shape[2]))
        self._clock, self._counts = self._arrays.clock, self._arrays.counts
        self._order = np.zeros(sizes[PARTICLES], np.int32)

    @property
    def arrays(self) -> Any:
        """Arrays that steps change, as they are now: a `record`."""
        self._fetch()
        return self._arrays

    def _block_sizes(self):
        """Return the lengths of sums by blocks of cells."""
        rows, columns = self.grid.inside.shape
        return {"block_rows": rows // LEFT_BLOCK + 1, "block_columns": columns // LEFT_BLOCK + 1}

    def _fetch(self):
        """Make the arrays of the host current; those of steps on the processor always are."""

    def _before_change(self):
        """Forget what depends on arrays, settings and effects, because the host is about to change some of them."""
        self._forget_computed()

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self._clock[self.kernel.TIME])

    @property
    def step(self) -> int:
        """Number of steps taken."""
        return int(self._counts[self.kernel.STEP])

    @property
    def particles(self) -> int:
        """Number of particles on the terrain now."""
        return int(self._counts[self.kernel.ALIVE])

    def wait(self, until: float) -> None:
        """Set the time to `until` on a terrain without particles.

        Parameters
        ----------
        until : float [s]
        """
        self._before_change()
        self._clock[self.kernel.TIME] = until

    def share_step(self, share: float) -> None:
        """Use shorter steps, from the next step whose length is not chosen yet.

        Parameters
        ----------
        share : float [1]
            Length of a step over its normal length.
        """
        self._before_change()
        whole = self._whole_step
        self._settings = self._settings._replace(**{name: share * value for name, value in whole.items()})

    def _once(self, name: str, compute: Callable[[], Any]) -> Any:
        """Return `compute()`, computed once for the present state.

        Code that changes the state calls `_forget_computed`.
        """
        if name not in self._computed:
            self._computed = {**self._computed, name: compute()}
        return self._computed[name]

    def _forget_computed(self):
        """Forget what was computed from the state, because the state is about to change."""
        self._computed = {}

    def _alive(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rows, ids and keys of the particles that are on the terrain, which later steps do not change."""
        seen = self._seen()
        return seen if self._have_left() else tuple(copied(array) for array in seen)

    def _seen(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return what `_alive` does, valid until the next step only: without copies where no particle has left."""
        n, now = self._counts[self.kernel.ROWS], self.arrays
        arrays = now.rows[:n], now.ids[:n], now.keys[:n]
        return self._once("seen", lambda: self._on_terrain(arrays)) if self._have_left() else arrays

    def _have_left(self) -> bool:
        """Return whether rows are of particles that have left the terrain."""
        return self._counts[self.kernel.ALIVE] != self._counts[self.kernel.ROWS]

    def _on_terrain(self, arrays):
        here = np.flatnonzero(arrays[2] != GONE)
        return tuple(taken(array, here) for array in arrays)

    def _place_of(self, first):
        """Return [E, N] [m] of the place at clock entries `first` and following."""
        return [float(self._clock[first]) + self.grid.x0, float(self._clock[first + 1]) + self.grid.y0]

    def _require_room(self, count):
        """Extend the arrays to at least `count` rows."""
        there = len(self._arrays.rows)
        if count > there:
            self._arrays = grown_arrays(self._arrays, max(count, int(1.5 * there)))
            self._order = np.zeros(len(self._arrays.rows), np.int32)

    # ----------------------------------------------------------------------------------------------------------- frames

    def frame(self) -> "Frame":
        """Return the present particles as a Frame with the state for a restart.

        Columns lie on the bed and move along it.
        """
        header = {"density": self.numerics.density, "cell_size": self.numerics.cell_size}
        return replace(
            self._start,
            particles=self._particles(),
            time=self.time,
            step=self.step,
            solver=self.name,
            header=header,
            maxima=self.maxima(),
            state=self.state(),
            bed_change=self.bed_change(),
        )

    def parts(self) -> "tuple[Frame, Frame | None]":
        """Return the present frame, and None: there are no columns outside a window."""
        return self.frame(), None

    def maxima(self) -> dict[str, Any]:
        """Return the running peaks at the nodes that the flow reached, as in a frame (`peaks`); empty unless enabled.

        Row 0 is in the south.
        """
        return self.thickest() if self.numerics.maxima else {}

    def bed_change(self) -> dict[str, np.ndarray]:
        """Return how the flow changed its bed so far, as in a frame; empty where it cannot."""
        return {}

    # ----------------------------------------------------------------------------------------------- state of a restart

    def _changing(self):
        """Return the arrays that the state of a frame holds whole, by their names in it."""
        table = array_table(self.record)
        kept = {array.kept: getattr(self.arrays, name) for name, array in table.items() if array.kept}
        return {name: array for name, array in kept.items() if self._keeps(name)}

    def _keeps(self, name):
        """Return whether the state of a frame of this scene has the array `name` of the table."""
        return True

    def _whole_state(self):
        """Return copies of `_changing`.

        The counts are those of contiguous rows: independent of the history of the run.
        """
        state = {name: array.copy() for name, array in self._changing().items()}
        state["counts"][self.kernel.ROWS] = state["counts"][self.kernel.ALIVE]
        return state

    def _left_state(self) -> dict[str, np.ndarray]:
        """Return the sums of the blocks with outflow, for a restart."""
        sums = self.arrays.left_cells.reshape(-1, LEFT_ENTRIES)
        blocks = np.flatnonzero(sums[:, LEFT_MASS])
        return dict(zip(LEFT_STATE, (blocks, sums[blocks]), strict=True))

    def restore(self, frame: "Frame", known: bool = False) -> None:
        """Continue from a frame of this run with its state, bitwise identical to a run without interruption.

        Parameters
        ----------
        frame : Frame
            Of a run on the processor or on a device.
        known : bool
            The state never left this process and is not checked.

        Raises
        ------
        FormatError
            The frame has no state, or that of another run.
        """
        self._before_change()
        state, ids = frame.state, frame.particles.id
        changing, at = self._changing(), f"the frame at t = {frame.time:g} s"
        peaks = PEAK_STATE if self._keeps_peaks else ()
        parts = self._shapes_of_parts(0 if ids is None else len(ids))
        missing = {*LEFT_STATE, *peaks, *self.own_state, *parts, *changing} - set(state)
        if ids is None or missing:
            what = f": {min(missing)} is missing" if state and missing else ""
            raise FormatError(f"{at} has no state for a restart{what}; start with --overwrite")
        expected = {name: (array.dtype, array.shape) for name, array in changing.items()} | parts
        for name, (dtype, shape) in expected.items():
            if state[name].dtype != dtype or state[name].shape != shape:
                raise FormatError(
                    f"{at} is of another scene: its {name} is {state[name].dtype}{list(state[name].shape)}, expected "
                    f"{np.dtype(dtype)}{list(shape)}; start with --overwrite"
                )
        if peaks and not is_peaks_state(self._arrays.peaks, state):
            raise FormatError(f"{at} is of another scene: its peaks are of other nodes; start with --overwrite")
        if not known:
            self._require_state(frame, changing)
        count = len(ids)
        self._require_room(count)
        arrays = self._arrays
        arrays.rows[:count], arrays.ids[:count] = state["rows"], ids
        for name, array in changing.items():
            array[:] = state[name]
        blocks, sums = (state[name] for name in LEFT_STATE)
        arrays.left_cells[:] = 0.0
        arrays.left_cells.reshape(-1, LEFT_ENTRIES)[blocks] = sums
        if peaks:
            restore_peaks(arrays.peaks, state)
        self._counts[self.kernel.ROWS] = count
        self._restore_own(state)

    def started(self) -> dict[str, Any]:
        """Return the numbers of the start that the solver counts from, as plain numbers (see `start_from`)."""
        return {"mass": self.mass_start, "energy": list(self.energy_start)}

    def start_from(self, started: dict[str, Any]) -> None:
        """Count from the start of another solver: this one was made of a later frame of the same run.

        Parameters
        ----------
        started : dict
            Result of its `started`.
        """
        self.mass_start, self.energy_start = started["mass"], tuple(started["energy"])

    # ----------------------------------------------------------------------------------------------------------- errors

    def energy_trouble(self, last: EnergyLook) -> str:
        """Return a message with E and N about energy gained since an earlier look; '' for none.

        Parameters
        ----------
        last : EnergyLook
        """
        share, made = self.energy_look().gained_since(last)
        if share <= GAIN_STOP:
            return ""
        east, north, speed = self.fastest()
        return (
            f"E {east:.1f} N {north:.1f}: the {self.name} gained {made:.3g} J out of nothing since t = {last.time:.3f} "
            f"s, {100 * share:.2g} % of their kinetic energy then and the work since (at most {100 * GAIN_STOP:g} %); "
            f"the fastest has {speed:.3g} m/s; take a smaller cfl"
        )


def named_sums(names: Sequence[str], rows: np.ndarray, sums: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return sums by the names of their owners.

    Parameters
    ----------
    names : sequence of str
        Names of n owners, for example of barriers.
    rows : float[n, m]
        The sums of each owner.
    sums : sequence of str
        Names of the m sums.

    Returns
    -------
    dict
        Name -> (name of a sum -> number).
    """
    return {name: dict(zip(sums, map(float, row), strict=True)) for name, row in zip(names, rows, strict=True)}
