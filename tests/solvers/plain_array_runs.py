"""Two short runs made of arrays alone; imports nothing but NumPy and mpmgis, and mpmgis nothing but its solvers.

`python plain_array_runs.py FOLDER` writes their frames and states to that folder.
"""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mpmgis.frames.frame_files import read_frame, write_frame
from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.effect_slots import ColumnEffects, PointEffects
from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import drucker_prager
from mpmgis.simulation.time_integration import TimeIntegration
from mpmgis.solvers.columns.column_solver import ColumnNumerics, ColumnSolver
from mpmgis.solvers.points.point_numerics import PointNumerics
from mpmgis.solvers.points.point_solver import PointSolver
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid

DENSITY = 1000.0  # [kg m-3]


class Pixels(NamedTuple):
    """The six numbers of an affine transform, with the names that `affine.Affine` has."""

    a: float
    b: float
    c: float
    d: float
    e: float
    f: float


def slope(length, width, pixel, transform):
    """A rough slope of 20 degrees that falls to the east; `transform` makes its affine transform of six numbers."""
    shape = round(width / pixel), round(length / pixel)
    grid = Grid(None, transform(pixel, 0.0, 0.0, 0.0, -pixel, width), shape)
    x, y = grid.xy(*np.indices(shape))
    return Terrain(grid, 0.36 * (length - x) + 0.2 * np.sin(x / 7.0) * np.cos(y / 5.0))


def lattice(low, high, spacing):
    """float64[n, k]: places between the corners `low` and `high`, `spacing` [m] apart."""
    axes = [np.arange(a + 0.5 * spacing, b, spacing) for a, b in zip(low, high, strict=True)]
    return np.column_stack([part.ravel() for part in np.meshgrid(*axes, indexing="ij")])


def columns(transform):
    """A depth-averaged run: columns of 1.5 m."""
    place = lattice((10.0, 10.0), (20.0, 20.0), 0.5)
    n, area = len(place), np.full(len(place), 0.25)
    volume = 1.5 * area
    position = np.column_stack([place, np.zeros(n)])
    particles = Particles(
        position, np.zeros((n, 3)), DENSITY * volume, volume, volume / area, area, np.arange(n, dtype=np.uint64)
    )
    effects, numerics = ColumnEffects(friction_law("Voellmy", 0.2, 800.0)), ColumnNumerics(2.0, stop_at_rest=False)
    solver = ColumnSolver(Frame(particles), slope(80.0, 40.0, 2.0, transform), effects, numerics)
    return TimeIntegration(solver, 2.0, 1.0)


def points(transform):
    """A 3D run: a cube of sand with a side of 4 m."""
    place = lattice((10.0, 8.0, 11.5), (14.0, 12.0, 15.5), 0.5)
    n = len(place)
    volume = np.full(n, 0.125)
    particles = Particles(place, np.zeros((n, 3)), DENSITY * volume, volume, id=np.arange(n, dtype=np.uint64))
    effects = PointEffects(drucker_prager(2e5, 1.2e5, 35.0, 0.0), contact=friction_law("Coulomb", 0.6))
    solver = PointSolver(Frame(particles, dimension=3), slope(40.0, 20.0, 2.0, transform), effects, PointNumerics(1.0))
    return TimeIntegration(solver, 1.0, 0.5)


RUNS = {"columns": columns, "points": points}


def results(integration, path):
    """Name -> array of the last state of a run; its last frame is written to `path` and read again."""
    *_, last = integration
    write_frame(path, last)
    read = read_frame(path)
    return last.state | {"position": last.particles.position, "as_read": read.particles.position}


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    for name, run in RUNS.items():
        np.savez(folder / f"{name}.npz", **results(run(Pixels), folder / f"{name}.h5"))
