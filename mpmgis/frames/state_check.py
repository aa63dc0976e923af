"""Checks of a restart state that both solvers need."""

from typing import Any

import numpy as np

from ..system.errors import FormatError
from .peaks import PEAK_STATE

LARGEST_COUNT = 2**53  # largest range of integers that float64 represents exactly
YIELD_STATE = (
    "yield_columns",
    "yields",
)  # names in the state of points: node columns where the ground yields; yield [m]
LEFT_STATE = ("left_blocks", "left_sums")  # names in the state: blocks with outflow; their sums


class StateCheck:
    """Checks of the restart state of one frame; every method raises FormatError where it finds an error.

    Parameters
    ----------
    time : float [s]
        Time of the frame.
    state : dict of str to array
    """

    def __init__(self, time: float, state: dict):
        self._time, self._state = time, state

    def require(self, holds: bool, what: str) -> None:
        """Raise unless a condition holds.

        Parameters
        ----------
        holds : bool
        what : str
            Message.

        Raises
        ------
        FormatError
            The condition does not hold.
        """
        if not holds:
            raise FormatError(
                f"the frame at t = {self._time:g} s has no valid state for a restart: {what}; start with --overwrite"
            )

    def array(self, name: str, dtype: Any, shape: tuple[int, ...], finite: bool = True) -> np.ndarray:
        """Return an array of the state, checked.

        Parameters
        ----------
        name : str
        dtype : NumPy type
            Type that it must have.
        shape : tuple of int
            Shape that it must have.
        finite : bool
            Its values must be finite.
        """
        values = self._state.get(name)
        self.require(isinstance(values, np.ndarray), f"{name} is missing")
        got = f"{name} is {values.dtype}{list(values.shape)}, expected {np.dtype(dtype)}{list(shape)}"
        self.require(values.dtype == dtype and values.shape == tuple(shape), got)
        if finite and values.dtype.kind == "f":
            self.require(np.isfinite(values).all(), f"{name} has values that are NaN or infinite")
        return values

    def within(self, name: str, values: np.ndarray, low: float, high: float) -> None:
        """Require values from `low` to `high`.

        Parameters
        ----------
        name : str
            What the values are, for the message.
        values : array or number
        low, high : float
        """
        values = np.asarray(values)
        if values.size:
            least, most = values.min(), values.max()
            self.require(low <= least and most <= high, f"{name} is {least} to {most}, expected {low} to {high}")

    def arrays_like(self, arrays: dict[str, np.ndarray]) -> None:
        """Require arrays with the types and shapes of given ones, finite where those are.

        Parameters
        ----------
        arrays : dict of str to array
            The given ones, by the names that they have in the state.
        """
        for name, now in arrays.items():
            values = self.array(name, now.dtype, now.shape, finite=False)
            if now.dtype.kind == "f":
                known = np.isfinite(values) | ~np.isfinite(now)
                self.require(known.all(), f"{name} has values that are NaN or infinite")

    def indices(self, name: str, size: int) -> np.ndarray:
        """Return an array of ascending flat indices, checked.

        Parameters
        ----------
        name : str
        size : int
            Number of entries that the indices point into.

        Returns
        -------
        int[n]
        """
        values = self._state.get(name)
        self.require(isinstance(values, np.ndarray) and values.ndim == 1, f"{name} is not a list of indices")
        self.require(values.dtype.kind in "iu", f"{name} is {values.dtype}, expected whole numbers")
        self.within(name, values, 0, size - 1)
        self.require((np.diff(values.astype(np.int64)) > 0).all(), f"{name} is not in order")
        return values

    def counts(self, kernel: Any, alive: int) -> None:
        """Check the counts and the clock of a solver.

        Parameters
        ----------
        kernel : module
            Module of the compiled loop; its constants are the indices in counts and clock.
        alive : int
            Number of particles.
        """
        counts = self._state["counts"]
        names = {kernel.ROWS: "the number of rows", kernel.ALIVE: "of particles"}
        for place, name in names.items():
            self.require(counts[place] == alive, f"{name} in counts is {counts[place]}, expected {alive}")
        self.within("the number of particles that are not finite", counts[kernel.BAD], 0, 0)
        self.within("the number of steps", counts[kernel.STEP], 0, LARGEST_COUNT)
        self.within("the number of steps since the last sort", counts[kernel.SINCE_REORDER], 0, LARGEST_COUNT)
        self.require(self._state["clock"][kernel.TIME] == self._time, "the time in its clock differs")

    def peaks(self, peaks: np.ndarray) -> None:
        """Check running peaks at some of the nodes of a lattice.

        Parameters
        ----------
        peaks : float64[rows, columns, entries]
            Peaks of the solver, for type and shape.
        """
        values, where = PEAK_STATE
        nodes = self.indices(where, peaks[..., 0].size)
        self.array(values, peaks.dtype, (len(nodes), peaks.shape[-1]))

    def left(self, sums: np.ndarray) -> None:
        """Check sums of the outflow of some of the blocks.

        Parameters
        ----------
        sums : float64[ways, blocks, blocks, entries]
            Sums of the solver, for type and shape.
        """
        blocks = self.indices(LEFT_STATE[0], sums[..., 0].size)
        self.array(LEFT_STATE[1], sums.dtype, (len(blocks), sums.shape[-1]))
