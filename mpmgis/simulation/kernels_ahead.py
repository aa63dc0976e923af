"""Compilation that begins before a scene is prepared: most of what the first run after an installation waits for.

The loops of the solvers take arguments of the same types whatever a scene contains, so that a solver of a few particles
has them. While this process reads the terrain and seeds, child processes compile the kernels that these loops call.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..compiled.compilation import begun, is_first
from ..frames.particles import Frame, Particles
from ..laws.effect_slots import ColumnEffects, PointEffects
from ..laws.material import Elastic
from ..scene.tables import CUDA
from ..solvers.columns.column_solver import ColumnNumerics, ColumnSolver
from ..solvers.points.point_numerics import PointNumerics
from ..solvers.points.point_solver import PointSolver
from ..system.messages import muted
from ..terrain.elevation import Terrain
from ..terrain.grid import Grid
from ..terrain.synthetic_terrain import plane

if TYPE_CHECKING:
    from ..scene import Scene

CELLS = 16  # of the terrain of a sample along each side, of 1 m
ANGLE = 20.0  # [deg] of its slope
PLACES = np.array([[8.2, 8.2], [8.7, 8.2], [8.2, 8.7], [8.7, 8.7]])  # [m] of its particles
DENSITY = 1000.0  # [kg m-3]


@contextmanager
def kernels_ahead(scene: "Scene") -> Iterator[None]:
    """Compile kernels of a scene's solvers during this block, if this processor has never compiled them.

    Parameters
    ----------
    scene : Scene
    """
    calls = []
    with muted():
        for sample in _samples(scene):
            solver = sample()
            calls.append((solver.kernel.advance, solver.step_arguments()))
    with begun(calls):
        yield


def sample_columns() -> ColumnSolver:
    """Return a solver of a few columns on a slope."""
    terrain, frame = _terrain(), _frame(2)
    return ColumnSolver(frame, terrain, ColumnEffects(), ColumnNumerics(1.0, density=DENSITY))


def sample_points(precision: str = "float64") -> PointSolver:
    """Return a solver of a few points on a slope.

    Parameters
    ----------
    precision : str
        As for `PointNumerics`.
    """
    terrain, frame, numerics = _terrain(), _frame(3), PointNumerics(1.0, density=DENSITY, precision=precision)
    return PointSolver(frame, terrain, PointEffects(Elastic(1e6, 6e5)), numerics)


def _terrain() -> Terrain:
    return plane(ANGLE).terrain(Grid.north_up(None, 0.0, float(CELLS), 1.0, (CELLS, CELLS)))


def _frame(dimension: int) -> Frame:
    """Return a frame of particles at rest, of 1 m3 each, on the terrain or 0.5 m above it."""
    x, y = PLACES.T
    n, height = len(PLACES), plane(ANGLE).height(x, y) + (0.5 if dimension == 3 else 0.0)
    particles = Particles(
        np.column_stack([x, y, height]),
        np.zeros((n, 3)),
        np.full(n, DENSITY),
        np.ones(n),
        area=np.ones(n) if dimension == 2 else None,
    )
    return Frame(particles, dimension=dimension)


def _samples(scene: "Scene") -> list[Callable]:
    """Return what makes a sample of each solver whose loop this processor has never compiled.

    Kernels with a law of the user, and those for a device, are others.
    """
    if scene.own_laws.laws or scene.numerics.device == CUDA:
        return []
    samples = {"columns": sample_columns, "points": partial(sample_points, scene.numerics.precision)}
    loops = {"columns": ColumnSolver.kernel.advance, "points": PointSolver.kernel.advance}
    return [samples[solver] for solver in sorted(scene.solvers) if is_first(loops[solver])]
