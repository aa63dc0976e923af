"""DTM as the reference surface of an export, and the places of particles on it (NHESS 25:3897, Eqs 2-7)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...frames.particles import Frame
from ...terrain.elevation import Terrain
from ...terrain.grid import Grid
from . import cell_places


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
        pixel, central differences, as in the paper.
    standoff : float [m]
        Distance, normal to the bed, at which the source code lets particles rest; subtracted from all distances.
    clamped : bool
        Points outside the DTM count in the nearest edge cell (Eq 5); otherwise they are ignored.
    """

    grid: Grid
    elevation: np.ndarray
    gradient: np.ndarray
    kind: str = "bilinear"
    standoff: float = 0.0
    clamped: bool = False

    @classmethod
    def of(cls, terrain: Terrain, kind: str = "bilinear", standoff: float = 0.0, clamped: bool = False) -> "Bed":
        """Return the bed of a terrain.

        Parameters
        ----------
        terrain : Terrain
        kind : {"bilinear", "plane"}
        standoff : float [m]
        clamped : bool
            These three as in the class.
        """
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
    def gradient_by_pixel(self) -> np.ndarray:
        """Gradient by flat number of the pixel, float64[pixels, 2] [1]."""
        return self.gradient.reshape(-1, 2)


@dataclass(frozen=True)
class Placed:
    """Places of the particles of a frame on a bed.

    Parameters
    ----------
    pixel : int64[n]
        Flat number of the DTM pixel under each particle; -1 outside.
    distance : float64[n] [m]
        From the bed, along its normal; NaN where it is unknown.
    moved : int
        Number of particles outside that were moved to the edge of a clamped bed.
    """

    pixel: np.ndarray
    distance: np.ndarray
    moved: int = 0

    @cached_property
    def inside(self) -> np.ndarray:
        """Particles on the DTM, bool[n]."""
        return self.pixel >= 0


def place(frame: Frame, bed: Bed) -> Placed:
    """Find the DTM pixel under every particle of a frame and its distance d_p from the bed (Eqs 2, 5, 6).

    Parameters
    ----------
    frame : Frame
    bed : Bed

    Returns
    -------
    Placed
    """
    n = len(frame.particles)
    pixel, distance = np.empty(n, np.int64), np.empty(n)
    moved = cell_places.place(
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
