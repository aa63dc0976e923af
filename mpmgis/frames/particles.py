"""Particles and frames: the data structures that all parts of the program exchange."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass
class Particles:
    """Named arrays, one row per particle.

    Parameters
    ----------
    position : float[n, 3] [m]
        Relative to the frame's origin; a column's z is its bed.
    velocity : float[n, 3] [m s-1]
        A column's is tangent to the bed (z = u . grad b).
    mass : float[n] [kg]
    volume : float[n] [m3]
    thickness : float[n] [m] or None
        Vertical; columns only.
    area : float[n] [m2] or None
        Plan; columns only.
    id : uint64[n] or None
    parent : uint64[n] or None
    """

    position: np.ndarray
    velocity: np.ndarray
    mass: np.ndarray
    volume: np.ndarray
    thickness: np.ndarray | None = None
    area: np.ndarray | None = None
    id: np.ndarray | None = None
    parent: np.ndarray | None = None

    def __len__(self):
        return len(self.position)

    def arrays(self):
        """Name -> array of everything that is present, in the table's order."""
        return {name: value for name, value in vars(self).items() if value is not None}

    def take(self, index):
        """The particles at `index` (bool or int)."""
        return Particles(**{name: value[index] for name, value in self.arrays().items()})


@dataclass(frozen=True)
class Frame:
    """All particles at one time, with their georeference. The file format is in docs/formats.md.

    `origin` (E, N, H) [m] is added to positions; `dem` is the terrain's path relative to the frame's file, '' if
    unknown; `state` contains further data for a restart; `maxima` running maxima of the solver, `bed_change` the eroded
    mass; `header` records of the program that made it (plain numbers and strings).
    """

    particles: Particles
    time: float = 0.0
    step: int = 0
    dimension: int = 2
    solver: str = ""
    crs: Any = None
    origin: tuple = (0.0, 0.0, 0.0)
    dem: str = ""
    dem_sha256: str = ""
    digest: str = ""
    state: dict = field(default_factory=dict)
    maxima: dict = field(default_factory=dict)
    bed_change: dict = field(default_factory=dict)
    header: dict = field(default_factory=dict)

    def particle_state(self, name, *shape):
        """float64[n, *shape]: the array `name` of `state`; None if it does not exist or has another shape or type."""
        values = np.asarray(self.state.get(name))
        if values.shape != (len(self.particles), *shape) or values.dtype.kind != "f":
            return None
        return values.astype(float, copy=False)

    def map_xy(self):
        """(x, y) [m] in the CRS."""
        position = self.particles.position
        return position[:, 0] + self.origin[0], position[:, 1] + self.origin[1]

    def xy_from(self, east, north):
        """(x, y) [m] relative to the map point `east`, `north`, computed without loss of digits."""
        position = self.particles.position
        return position[:, 0] + (self.origin[0] - east), position[:, 1] + (self.origin[1] - north)
