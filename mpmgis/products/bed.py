"""The surface that distances are measured from, and where particles are on it (Vicari et al. 2025, Eqs 2-7)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..geo.grid import Grid
from ..kernels import binning


@dataclass(frozen=True)
class Bed:
    """The DTM as the reference surface of Eqs 3 to 7.

    Parameters
    ----------
    grid : Grid
    elevation : float64[rows, columns] [m], NaN where there is no data
    gradient : float64[rows, columns, 2] [1], (db/dE, db/dN)
    kind : str
        "bilinear": elevation between pixel centres, slopes limited at cliff edges; "plane": tangent plane of the
        pixel, central differences, the paper to the letter (design note X3).
    standoff : float [m]
        Height, along the normal, at which the code that made the particles lets them rest; taken off distances.
    clamped : bool
        Points outside the DTM count in the nearest cell of its rim, as Eq 5 has it; otherwise they are left out.
    """

    grid: Grid
    elevation: np.ndarray
    gradient: np.ndarray
    kind: str = "bilinear"
    standoff: float = 0.0
    clamped: bool = False

    @classmethod
    def of(cls, terrain, kind="bilinear", standoff=0.0, clamped=False):
        """The bed of `terrain`; the rest as of the class."""
        gradient = terrain.gradient if kind == "plane" else terrain.limited_gradient
        return cls(
            terrain.grid,
            np.ascontiguousarray(terrain.elevation),
            np.ascontiguousarray(gradient),
            kind,
            standoff,
            clamped,
        )

    @cached_property
    def gradient_by_pixel(self):
        """float64[pixels, 2]: `gradient` by flat index."""
        return self.gradient.reshape(-1, 2)


@dataclass(frozen=True)
class Placed:
    """Where a frame's particles are: `pixel` int64[n] (flat, -1 outside), `distance` float64[n] [m] (NaN unknown).

    `moved` is the number of those that lie outside and were taken to the rim of a clamped bed.
    """

    pixel: np.ndarray
    distance: np.ndarray
    moved: int = 0

    @cached_property
    def inside(self):
        """bool[n]: particles on the DTM."""
        return self.pixel >= 0


def place(frame, bed):
    """Find the DTM pixel under every particle of `frame` and its distance d_p from the bed (Eqs 2, 5, 6)."""
    n = len(frame.particles)
    pixel, distance = np.empty(n, np.int64), np.empty(n)
    moved = binning.place(
        frame.particles.position,
        np.asarray(frame.origin, float),
        bed.grid.corner,
        bed.grid.axes,
        bed.grid.matrix,
        bed.elevation,
        bed.gradient,
        bed.kind == "plane",
        bed.clamped and frame.dimension == 3,
        bed.standoff,
        pixel,
        distance,
    )
    return Placed(pixel, distance, int(moved))
