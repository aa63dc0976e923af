"""What both solvers keep of their particles, and what is read of it in the same way."""

import numpy as np

from ..errors import FormatError
from .restart_checks import LEFT_STATE, StateCheck
from .watch import EAST, NORTH, STATE, TAKEN, TIME, block_marks, marks_reached

NOTHING_WATCHED = np.zeros((0, 0), np.uint8)


class ParticleStore:
    """Rows, ids and keys of particles; clock and counts.

    Attributes
    ----------
    kernel : module
        Of the compiled loop, whose constants say where in rows, clock and counts what stands.
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
        """March with what was taken in up to `frame`."""
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
