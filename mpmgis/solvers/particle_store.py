"""Particle arrays, energies and sums that both solvers have in common."""

from typing import NamedTuple

import numpy as np

from ..errors import FormatError
from ..spatial.watch import EAST, NORTH, STATE, TAKEN, TIME, block_marks, marks_reached
from .restart import LEFT_STATE, StateCheck


class Flow(NamedTuple):
    """Arrays float64[n], one entry a column or point."""

    x: np.ndarray  # [m] on the map
    y: np.ndarray
    u: np.ndarray  # [m s-1] to the east
    v: np.ndarray  # to the north
    speed: np.ndarray  # [m s-1] with its vertical part
    depth: np.ndarray  # [m] of the flow there, vertical
    mass: np.ndarray  # [kg]

    def __len__(self):
        return len(self.mass)

    def take(self, index):
        """The entries that `index` (bool, int or slice) picks."""
        return Flow(*(values[index] for values in self))


GAIN_STOP = 0.1  # of kinetic energy and work since the last look, above which energy has been made out of nothing
REST_SHARE = 0.01  # of the largest kinetic energy so far, below which a flow rests: no less counts as kinetic energy
REST_LIFT = 0.01  # [cells] by which all mass is lifted by the energy that counts as kinetic at the least


class EnergyLook(NamedTuple):
    """Energies [J] at one moment.

    Parameters
    ----------
    made : float
        All energy that there is and that has left, less all that was put in since the start: below 0 by what was lost,
        and growing only where energy is made out of nothing.
    kinetic : float
        Of what is on the terrain now.
    least : float
        Kinetic energy that a flow at rest counts as, see `least_kinetic`.
    work : tuple of float
        Done since the start: by the weight, by stress, on what was counted as lost; and kinetic energy put in.
    time : float [s]
    """

    made: float
    kinetic: float
    least: float
    work: tuple
    time: float

    def gained_since(self, last):
        """(share [1] of kinetic energy and work since the EnergyLook `last` that was made out of nothing; J)."""
        made = self.made - last.made
        work = sum(abs(now - before) for now, before in zip(self.work, last.work, strict=True))
        return made / max(max(last.kinetic, last.least) + work, 1e-300), made


def least_kinetic(peak, mass, gravity, cell_size):
    """Kinetic energy [J] that a flow of `mass` [kg] at rest counts as: 1 % of its `peak` [J], or what lifts it by 1 %
    of a cell; rounding of single precision stays below a tenth of that."""
    return max(REST_SHARE * peak, mass * gravity * REST_LIFT * cell_size)


NOTHING_WATCHED = np.zeros((0, 0), np.uint8)


class ParticleStore:
    """Rows, ids and keys of particles; clock and counts.

    Attributes
    ----------
    kernel : module
        Of the compiled loop, whose constants are the indices in rows, clock and counts.
    """

    kernel = None
    _watch, _watched = None, NOTHING_WATCHED

    @property
    def time(self):
        """Simulated time [s]."""
        return float(self._clock[self.kernel.TIME])

    @property
    def step(self):
        """Number of steps taken."""
        return int(self._counts[self.kernel.STEP])

    def wait(self, until):
        """Let time pass to `until` [s] on a terrain with no particles."""
        self._clock[self.kernel.TIME] = until

    def share_step(self, share):
        """From the next step that is not chosen yet on take steps of `share` [1] of what they would be."""
        whole = self._whole_step
        self._settings = self._settings._replace(**{name: share * value for name, value in whole.items()})

    def watch(self, watch):
        """Look out for the features of `watch` (Watch); `advance` comes back before the flow touches one of them."""
        self._watch = watch
        self._mark_watched()

    @property
    def taken_in(self):
        """tuple of TakenIn: features that were off, and that the flow has come to."""
        return () if self._watch is None else self._watch.taken_in

    def take_in(self):
        """Turn on what the flow is about to touch; tuple of TakenIn."""
        rows, _, keys = self._alive()
        reached = marks_reached(self._watched, *self.kernel.rows_and_columns(keys))
        state, before = self._watch.state, self._watch.taken_in
        for k in range(len(state)):
            first = np.flatnonzero(reached & (1 << k))[:1]
            if first.size:
                east, north = self._map_places(rows[first], keys[first])[0]
                state[k, [TAKEN, TIME, EAST, NORTH]] = 1.0, self.time, east, north
        self._march_with_taken_in()
        return tuple(taken for taken in self._watch.taken_in if taken not in before)

    def _march_with_taken_in(self):
        """The effects and places that belong to what is taken in now."""
        self._march_with(*self._watch.with_effects(tuple(taken.effect for taken in self._watch.taken_in)))
        self._mark_watched()

    def _mark_watched(self):
        marks = None if self._watch is None else self._watch.marks()
        if marks is None:
            self._watched = NOTHING_WATCHED
        else:
            self._watched = block_marks(self._on_kernel_nodes(marks), self.kernel.BLOCK)

    def _watch_state(self):
        """What a frame keeps of the watch, by name; nothing where nothing is watched."""
        return {} if self._watch is None else {STATE: self._watch.state.copy()}

    def _restore_watch(self, frame):
        """Continue with the effects that were on at `frame`."""
        if self._watch is None:
            return
        state = np.asarray(frame.state.get(STATE, np.zeros(0)))
        if state.shape != self._watch.state.shape:
            raise FormatError(f"the frame at t = {frame.time:g} s is of another scene; start with --overwrite")
        check = StateCheck(frame.time, frame.state)
        check.array(STATE, np.float64, state.shape)
        check.require(np.isin(state[:, TAKEN], (0.0, 1.0)).all(), f"{STATE} tells more than whether")
        if not np.array_equal(state, self._watch.state):
            self._watch.state[:] = state
            self._march_with_taken_in()

    def _alive(self):
        """Rows, ids and keys of the particles that are on the terrain."""
        n = self._counts[self.kernel.ROWS]
        keep = self._keys[:n] != self.kernel.GONE
        return self._rows[:n][keep], self._ids[:n][keep], self._keys[:n][keep]

    def _counts_of_rows(self):
        """Counts as a restart has them, whose rows lie together: the same however a run got there."""
        counts = self._counts.copy()
        counts[self.kernel.ROWS] = counts[self.kernel.ALIVE]
        return counts

    def _no_mass_left(self, grid):
        """Sums of what leaves the terrain by blocks of the cells of `grid`, see `kernels.left_cells`."""
        rows, columns = (n // self.kernel.LEFT_BLOCK + 1 for n in grid.inside.shape)
        return np.zeros((self.kernel.WAYS, rows, columns, self.kernel.LEFT_ENTRIES))

    @property
    def peaks(self):
        """float64[rows, columns, PEAK_ENTRIES]: running peaks at the nodes."""
        return self._peaks

    @property
    def left_sums(self):
        """float64[ways, block rows, block columns, entries]: what left the terrain, see `kernels.left_cells`."""
        return self._left

    def _left_state(self):
        """Where mass left, of the few blocks where any did."""
        sums = self._left.reshape(-1, self._left.shape[-1])
        blocks = np.flatnonzero(sums[:, 0])
        return dict(zip(LEFT_STATE, (blocks, sums[blocks]), strict=True))

    def _restore_left(self, state):
        """Go on with what `_left_state` gave."""
        blocks, sums = (state[name] for name in LEFT_STATE)
        self._left[:] = 0.0
        self._left.reshape(-1, self._left.shape[-1])[blocks] = sums

    def _require_room(self, count):
        """Make the arrays long enough for `count` rows, and some more."""
        there = len(self._rows)
        if count <= there:
            return
        more = max(count, int(1.5 * there)) - there
        self._rows, self._ids, self._keys = (
            np.concatenate([array, np.zeros((more, *array.shape[1:]), array.dtype)])
            for array in (self._rows, self._ids, self._keys)
        )
        self._order = np.zeros(len(self._rows), np.int32)


def named_sums(names, rows, sums):
    """Name -> (name of a sum -> number): `rows` float[n, m] hold for each of the n `names` the m `sums`."""
    return {name: dict(zip(sums, map(float, row), strict=True)) for name, row in zip(names, rows, strict=True)}
