"""Checks of a restart state that both solvers need."""

import numpy as np

from ..system.errors import FormatError
from .peaks import PEAK_STATE

LARGEST_COUNT = 2**53
YIELD_STATE = ("yield_columns", "yields")  # of points: node columns where the ground yields, and the yield [m]
LEFT_STATE = ("left_blocks", "left_sums")  # of a frame: blocks with outflow and their sums


class StateCheck:
    """Checks of the state of the frame at `time` [s].

    Parameters
    ----------
    time : float [s]
    state : dict of str to array
    """

    def __init__(self, time, state):
        self._time, self._state = time, state

    def require(self, holds, what):
        """Raise FormatError with the message `what` unless `holds`."""
        if not holds:
            raise FormatError(
                f"the frame at t = {self._time:g} s has no valid state for a restart: {what}; start with --overwrite"
            )

    def array(self, name, dtype, shape, finite=True):
        """The array `name`, which must have that type and shape, and finite values by default."""
        values = self._state.get(name)
        self.require(isinstance(values, np.ndarray), f"{name} is missing")
        got = f"{name} is {values.dtype}{list(values.shape)}, expected {np.dtype(dtype)}{list(shape)}"
        self.require(values.dtype == dtype and values.shape == tuple(shape), got)
        if finite and values.dtype.kind == "f":
            self.require(np.isfinite(values).all(), f"{name} has values that are NaN or infinite")
        return values

    def within(self, name, values, low, high):
        """Require `values`, called `name` in the message, from `low` to `high`."""
        values = np.asarray(values)
        if values.size:
            least, most = values.min(), values.max()
            self.require(low <= least and most <= high, f"{name} is {least} to {most}, expected {low} to {high}")

    def arrays_like(self, arrays):
        """Require each of `arrays` (name -> array) with the same type and shape, finite where `arrays` are."""
        for name, now in arrays.items():
            values = self.array(name, now.dtype, now.shape, finite=False)
            if now.dtype.kind == "f":
                known = np.isfinite(values) | ~np.isfinite(now)
                self.require(known.all(), f"{name} has values that are NaN or infinite")

    def indices(self, name, size):
        """The array `name` of flat indices into `size` entries, which ascend."""
        values = self._state.get(name)
        self.require(isinstance(values, np.ndarray) and values.ndim == 1, f"{name} is not a list of indices")
        self.require(values.dtype.kind in "iu", f"{name} is {values.dtype}, expected whole numbers")
        self.within(name, values, 0, size - 1)
        self.require((np.diff(values.astype(np.int64)) > 0).all(), f"{name} is not in order")
        return values

    def counts(self, kernel, alive):
        """Counts of a solver with the module `kernel` that has `alive` particles."""
        counts = self._state["counts"]
        names = {kernel.ROWS: "the number of rows", kernel.ALIVE: "of particles"}
        for place, name in names.items():
            self.require(counts[place] == alive, f"{name} in counts is {counts[place]}, expected {alive}")
        self.within("the number of particles that are not finite", counts[kernel.BAD], 0, 0)
        self.within("the number of steps", counts[kernel.STEP], 0, LARGEST_COUNT)
        self.within("the number of steps since the last sort", counts[kernel.SINCE_REORDER], 0, LARGEST_COUNT)
        self.require(self._state["clock"][kernel.TIME] == self._time, "the time in its clock differs")

    def peaks(self, peaks):
        """Check running peaks at some of the nodes of `peaks` [rows, columns, entries]."""
        values, where = PEAK_STATE
        nodes = self.indices(where, peaks[..., 0].size)
        self.array(values, peaks.dtype, (len(nodes), peaks.shape[-1]))

    def left(self, sums):
        """Check sums of the outflow at some of the entries of `sums` [ways, blocks, blocks, entries]."""
        blocks = self.indices(LEFT_STATE[0], sums[..., 0].size)
        self.array(LEFT_STATE[1], sums.dtype, (len(blocks), sums.shape[-1]))
