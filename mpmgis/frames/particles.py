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

    def arrays(self) -> dict[str, np.ndarray]:
        """Return all arrays that are present by name, in the order of the fields."""
        return {name: value for name, value in vars(self).items() if value is not None}

    def take(self, index: np.ndarray) -> "Particles":
        """Return the particles at `index`.

        Parameters
        ----------
        index : bool[n] or int[m]
        """
        return Particles(**{name: value[index] for name, value in self.arrays().items()})


@dataclass(frozen=True)
class Frame:
    """All particles at one time, with their georeference. The file format is in docs/formats.md.

    Parameters
    ----------
    particles : Particles
    time : float [s]
    step : int
        Number of time steps of the solver.
    dimension : int
        2 (columns) or 3 (points).
    solver : str
        Name of the program part that made it.
    crs : pyproj.CRS or None
    origin : (float, float, float) [m]
        (E, N, H), added to positions.
    dem : str
        Path of the terrain relative to the frame's file, '' if unknown.
    dem_sha256 : str
    digest : str
        Digest of the scene.
    state : dict
        Further data for a restart.
    maxima : dict
        Running maxima of the solver, as `peaks` describes them.
    bed_change : dict
        Eroded mass.
    header : dict
        Records of the program that made it (plain numbers and strings).
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

    def particle_state(self, name: str, *shape: int) -> np.ndarray | None:
        """Return an array of `state` with a row for each particle.

        Parameters
        ----------
        name : str
        *shape : int
            Shape of the entry of one particle.

        Returns
        -------
        float64[n, *shape] or None
            None if it does not exist or has another shape or type.
        """
        values = np.asarray(self.state.get(name))
        if values.shape != (len(self.particles), *shape) or values.dtype.kind != "f":
            return None
        return values.astype(float, copy=False)

    def map_xy(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the positions x, y [m] in the CRS, float64[n] each."""
        position = self.particles.position
        return position[:, 0] + self.origin[0], position[:, 1] + self.origin[1]

    def xy_from(self, east: float, north: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the positions relative to a map point, computed without loss of digits.

        Parameters
        ----------
        east, north : float [m]
            The map point.

        Returns
        -------
        x, y : float64[n] [m]
        """
        position = self.particles.position
        return position[:, 0] + (self.origin[0] - east), position[:, 1] + (self.origin[1] - north)
