"""Particle arrays, energies and sums common to both solvers."""

from collections.abc import Callable, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from ..compiled.particle_slices import copied, taken
from .state_check import LEFT_STATE

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
    """Rows, ids and keys of particles; clock and counts.

    Attributes
    ----------
    kernel : module
        Module of the compiled loop; its constants are the indices in rows, clock and counts.
    """

    kernel = None
    _computed = MappingProxyType({})  # name -> what was computed from the present state

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self._clock[self.kernel.TIME])

    @property
    def step(self) -> int:
        """Number of steps taken."""
        return int(self._counts[self.kernel.STEP])

    def wait(self, until: float) -> None:
        """Set the time to `until` on a terrain without particles.

        Parameters
        ----------
        until : float [s]
        """
        self._clock[self.kernel.TIME] = until

    def share_step(self, share: float) -> None:
        """Use shorter steps, from the next step whose length is not chosen yet.

        Parameters
        ----------
        share : float [1]
            Length of a step over its normal length.
        """
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
        n = self._counts[self.kernel.ROWS]
        arrays = self._rows[:n], self._ids[:n], self._keys[:n]
        return self._once("seen", lambda: self._on_terrain(arrays)) if self._have_left() else arrays

    def _have_left(self) -> bool:
        """Return whether rows are of particles that have left the terrain."""
        return self._counts[self.kernel.ALIVE] != self._counts[self.kernel.ROWS]

    def _on_terrain(self, arrays):
        here = np.flatnonzero(arrays[2] != self.kernel.GONE)
        return tuple(taken(array, here) for array in arrays)

    def _counts_of_rows(self) -> np.ndarray:
        """Return counts for a restart, whose rows are contiguous: independent of the history of the run."""
        counts = self._counts.copy()
        counts[self.kernel.ROWS] = counts[self.kernel.ALIVE]
        return counts

    def _no_mass_left(self, grid: Any) -> np.ndarray:
        """Return empty sums of the outflow by blocks of the cells of `grid`, see `block_order`."""
        rows, columns = (n // self.kernel.LEFT_BLOCK + 1 for n in grid.inside.shape)
        return np.zeros((self.kernel.WAYS, rows, columns, self.kernel.LEFT_ENTRIES))

    @property
    def peaks(self) -> np.ndarray:
        """Running peaks at the nodes, float64[rows, columns, entries]; one entry: the thickness alone."""
        return self._peaks

    @property
    def left_sums(self) -> np.ndarray:
        """Sums of the outflow, float64[ways, block rows, block columns, entries], see `block_order`."""
        return self._left

    def _left_state(self) -> dict[str, np.ndarray]:
        """Return the sums of the blocks with outflow, for a restart."""
        sums = self._left.reshape(-1, self._left.shape[-1])
        blocks = np.flatnonzero(sums[:, 0])
        return dict(zip(LEFT_STATE, (blocks, sums[blocks]), strict=True))

    def _restore_left(self, state):
        """Restore the result of `_left_state`."""
        blocks, sums = (state[name] for name in LEFT_STATE)
        self._left[:] = 0.0
        self._left.reshape(-1, self._left.shape[-1])[blocks] = sums

    def _require_room(self, count):
        """Extend the arrays to at least `count` rows."""
        there = len(self._rows)
        if count <= there:
            return
        more = max(count, int(1.5 * there)) - there
        self._rows, self._ids, self._keys = (
            np.concatenate([array, np.zeros((more, *array.shape[1:]), array.dtype)])
            for array in (self._rows, self._ids, self._keys)
        )
        self._order = np.zeros(len(self._rows), np.int32)


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
