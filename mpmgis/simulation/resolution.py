"""Resolution of the flow by the cells of a 3D stage."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..scene.point_effects import FEWEST_CELLS

if TYPE_CHECKING:
    from ..frames.particles import Particles


@dataclass(frozen=True)
class Resolution:
    """Resolution of the flow by the cells of a 3D stage at its start.

    Parameters
    ----------
    cell_size : float [m]
        Of the 3D grid.
    thickness : float [m]
        Vertical, mean over the mass.
    thin_share : float [1]
        Of the mass, in columns thinner than FEWEST_CELLS cells.
    wall_height : float or None [m]
        Of the lowest crest above the ground, of the walls that are on.
    """

    cell_size: float
    thickness: float
    thin_share: float
    wall_height: float | None = None

    @property
    def cells_over_depth(self) -> float:
        """Thickness over cell size [1]."""
        return self.thickness / self.cell_size

    @property
    def cells_over_wall(self) -> float | None:
        """Height of the lowest wall over cell size [1]; None without a wall."""
        return None if self.wall_height is None else self.wall_height / self.cell_size

    @property
    def coarse(self) -> bool:
        """Whether a 3D run requires smaller cells."""
        over_wall = self.cells_over_wall
        return self.cells_over_depth < FEWEST_CELLS or (over_wall is not None and over_wall < FEWEST_CELLS)

    def as_numbers(self) -> dict:
        """Return all of it as plain numbers for a record."""
        return {
            "cell_size": self.cell_size,
            "thickness": self.thickness,
            "cells_over_depth": self.cells_over_depth,
            "thin_share": self.thin_share,
            "wall_height": self.wall_height,
            "cells_over_wall": self.cells_over_wall,
            "coarse": self.coarse,
        }


def resolution_of(columns: "Particles", cell_size: float, wall_height: float | None = None) -> Resolution:
    """Return the Resolution of columns on a 3D grid.

    Parameters
    ----------
    columns : Particles
    cell_size : float [m]
        Of the 3D grid.
    wall_height : float, optional [m]
        Of the lowest crest above the ground.
    """
    mass, thickness = np.asarray(columns.mass, float), np.asarray(columns.thickness, float)
    whole = float(mass.sum())
    if not whole > 0.0:
        return Resolution(float(cell_size), 0.0, 0.0, wall_height)
    thin = float(mass[thickness < FEWEST_CELLS * cell_size].sum()) / whole
    return Resolution(float(cell_size), float((mass * thickness).sum()) / whole, thin, wall_height)
