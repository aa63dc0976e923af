"""Compilation that begins before a scene is prepared: most of what the first run after an installation waits for.

The loops of the solvers take arguments of the same types whatever a scene contains, so that a solver of a few particles
has them. While this process reads and seeds the scene, child processes compile the kernels that these loops call.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial

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

CELLS = 16  # of the terrain of a sample along each side, of 1 m
ANGLE = 20.0  # [deg] of its slope
PLACES = np.array([[8.2, 8.2], [8.7, 8.2], [8.2, 8.7], [8.7, 8.7]])  # [m] of its particles
DENSITY = 1000.0  # [kg m-3]


@contextmanager
def kernels_ahead(tables: Mapping, device: str | None = None) -> Iterator[None]:
    """Compile kernels of a scene's solvers during this block, if this processor has never compiled them.

    Parameters
    ----------
    tables : Mapping
        Of the scene, not yet checked.
    device : str, optional
        Replaces [numerics] device.
    """
    calls = []
    with muted():
        for sample in _samples(tables, device):
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


def _samples(tables: Mapping, device: str | None) -> list[Callable]:
    """Return what makes a sample of each solver whose loop this processor has never compiled."""
    found = []
    with suppress(AttributeError, TypeError):  # tables that are none are refused where the scene is read
        numerics = tables.get("numerics", {})
        if (device or numerics.get("device")) == CUDA:
            return []
        solvers = {stage.get("solver") for stage in tables.get("stage", ())} or {tables.get("solver", "columns")}
        if "columns" in solvers and is_first(ColumnSolver.kernel.advance):
            found.append(sample_columns)
        if "points" in solvers and is_first(PointSolver.kernel.advance):
            found.append(partial(sample_points, str(numerics.get("precision", "float64"))))
    return found
