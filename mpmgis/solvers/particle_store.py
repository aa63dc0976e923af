"""What both solvers keep of their particles, and what is read of it in the same way."""

import numpy as np

LEFT_STATE = ("left_blocks", "left_sums")  # of a frame's state: where mass left the terrain


class ParticleStore:
    """Rows, ids and keys of particles, twice, because a step reads the one and writes the other; clock and counts.

    Attributes
    ----------
    kernel : module
        Of the compiled loop, whose constants say where in rows, clock and counts what stands.
    """

    kernel = None

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

    def _alive(self):
        """Rows, ids and keys of the particles that are on the terrain."""
        now, n = self._counts[self.kernel.CURRENT], self._counts[self.kernel.ROWS]
        keep = self._keys[now, :n] != self.kernel.GONE
        return self._rows[now, :n][keep], self._ids[now, :n][keep], self._keys[now, :n][keep]

    def _no_mass_left(self, grid):
        """Sums of what leaves the terrain by blocks of the cells of `grid`, see `kernels.left_cells`."""
        rows, columns = (n // self.kernel.LEFT_BLOCK + 1 for n in grid.inside.shape)
        return np.zeros((self.kernel.WAYS, rows, columns, self.kernel.LEFT_ENTRIES))

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
        there = self._rows.shape[1]
        if count <= there:
            return
        more = max(count, int(1.5 * there)) - there
        self._rows, self._ids, self._keys = (
            np.concatenate([array, np.zeros((2, more, *array.shape[2:]), array.dtype)], axis=1)
            for array in (self._rows, self._ids, self._keys)
        )
        self._order = np.zeros(self._rows.shape[1], np.int32)


def named_sums(names, rows, sums):
    """Name -> (name of a sum -> number): `rows` float[n, m] hold for each of the n `names` the m `sums`."""
    return {name: dict(zip(sums, map(float, row), strict=True)) for name, row in zip(names, rows, strict=True)}
