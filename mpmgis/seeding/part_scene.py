"""Rasters that kernels read for one part of a release."""

from dataclasses import dataclass

import numpy as np

from ..terrain.grid import Grid
from . import cell_fill
from .lattice import Lattice, LatticeWindow


@dataclass(frozen=True, eq=False)
class PartScene:
    """Rasters of one part of a release that kernels read: bed and thickness.

    Parameters
    ----------
    origin : (float, float) [m]
        x, y.
    bed : float64[rows, columns] [m]
    bed_grid : Grid
    thickness : float64[rows, columns] [m]
        Vertical.
    thickness_grid : Grid
    """

    origin: tuple
    bed: np.ndarray
    bed_grid: Grid
    thickness: np.ndarray
    thickness_grid: Grid

    def ground(self, lattice: Lattice, window: LatticeWindow, law: np.ndarray) -> cell_fill.Ground:
        """Return the Ground of kernels for the cells of a window.

        Parameters
        ----------
        lattice : Lattice
        window : LatticeWindow
        law : float64[3]
            As in Ground.
        """
        return cell_fill.Ground(
            lattice.map_affine(window, self.origin),
            self.bed,
            lattice.raster_affine(window, self.bed_grid),
            self.thickness,
            lattice.raster_affine(window, self.thickness_grid),
            law,
        )
