"""Estimate time and memory of a run from measured constants."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from ..laws.material_choice import SHORT_STATE, state_count, wave_speed
from ..laws.quantities import GRAVITY
from ..solvers.columns.column_rows import ROW
from ..solvers.points.point_ground import GROUND_ENTRIES
from ..solvers.points.point_numerics import courant_number
from ..solvers.points.point_rows import ROW_LONG, ROW_SHORT
from ..system.errors import SceneError
from ..system.memory import memory_lack

if TYPE_CHECKING:
    from ..solvers.points.point_numerics import PointNumerics

BYTES_PER_COLUMN = 3 * ROW * 8 + 3 * 8 + 2 * 4 + 4 + 160  # rows, ids, keys, order; two frames
BYTES_PER_NODE = 8 * (1 + 2 + 4) + 2  # bed, gradient, node entries; wet and inside
BYTES_PER_POINT_BESIDE = 190  # without its rows: ids, keys, order, and the point in two frames
BYTES_PER_POINT_NODE = 8 * (3 + 2 * GROUND_ENTRIES)  # bed, gradient, ground and its properties
BYTES_PER_GRID_NODE = 110  # of a grid in plan view while it is built (measured 105 with 1.1e8 nodes, 2026-11-22)
BYTES_PER_START = 320  # of a point while columns become points
BYTES_PER_SWITCHED = 640  # of a point during a conversion within a run (measured 2026-11-22)
MEMORY_SHARE = 0.8  # share of the free memory or disk above which a run requires confirmation
NANOSECONDS_PER_STEP = 50.0  # of one column on one thread: a rough estimate, for the confirmation of long runs
NANOSECONDS_PER_POINT_STEP = {"float64": 85.0, "float32": 55.0}  # of one point on one thread, sort and grid included
SECONDS_PER_STEP = 2e-5  # of any step, however few particles it moves
# Apart from the steps, in processor time (measured 2026-11-22 with 1e3 to 6e5 particles, frames 2026-11-27 by
# tests/bench/run.py frames; disks and other programs add to this time)
SECONDS_PER_RUN = 0.05  # scene and record
SECONDS_PER_PIXEL = 1e-7  # of the terrain of the frames
SECONDS_PER_FRAME = 0.02  # of a file that is written atomically
NANOSECONDS_PER_WRITTEN = {"columns": 600.0, "points": 600.0}  # of one particle in a frame that is written
NANOSECONDS_PER_SHOWN = 200.0  # of one particle in a frame that is displayed
SECONDS_PER_SWITCH = 0.02  # of any conversion, however few particles it has
NANOSECONDS_TO_POINTS = 1700.0  # of a point that is made from columns, with the sums of the account
NANOSECONDS_TO_COLUMNS = 900.0  # of a point that becomes part of a column, with the sums of the account
NANOSECONDS_PER_NODE = 300.0  # of the ground of a grid
NANOSECONDS_PER_CHECK = {"reach": 100.0, "calm": 700.0}  # of a particle, at a check of the end of a stage


def predicted_in_2d(
    columns: int,
    thickness: float,
    nodes: float,
    elevation_bytes: int,
    cell_size: float,
    cfl: float,
    end_time: float,
    line_speed: float,
    threads: int,
) -> tuple[float, float]:
    """Estimate time and memory of a depth-averaged run.

    The number of steps follows from half the speed of the energy line and the wave speed of the mean thickness.

    Parameters
    ----------
    columns : int
    thickness : float [m]
        Mean, of the release.
    nodes : float
        Number of nodes of the grid.
    elevation_bytes : int [bytes]
        Of the elevation of the terrain.
    cell_size : float [m]
    cfl : float [1]
        Courant number.
    end_time : float [s]
        Simulated time.
    line_speed : float [m s-1]
        Speed of the energy line.
    threads : int

    Returns
    -------
    seconds : float [s]
    memory : float [bytes]
    """
    signal = 0.5 * line_speed + np.sqrt(GRAVITY * thickness)
    steps = end_time * signal / (cfl * cell_size)
    memory = columns * BYTES_PER_COLUMN + nodes * BYTES_PER_NODE + 3 * elevation_bytes
    return steps * (columns * NANOSECONDS_PER_STEP * 1e-9 / threads + SECONDS_PER_STEP), memory


def predicted_in_3d(
    points: int,
    material: object,
    numerics: "PointNumerics",
    nodes: float,
    elevation_bytes: int,
    end_time: float,
    line_speed: float,
    threads: int,
) -> tuple[float, float]:
    """Estimate time and memory of a 3D run.

    The number of steps follows from the waves of the material and half the speed of the energy line.

    Parameters
    ----------
    points : int
    material : NamedTuple
        Law of the material.
    numerics : PointNumerics
    nodes : float
        Number of nodes of the grid in plan view.
    elevation_bytes : int [bytes]
        Of the elevation of the terrain.
    end_time : float [s]
        Simulated time.
    line_speed : float [m s-1]
        Speed of the energy line.
    threads : int

    Returns
    -------
    seconds : float [s]
    memory : float [bytes]
    """
    dx, viscosity = numerics.cell_size, material.dynamic_viscosity
    limits = [dx / (wave_speed(material, numerics.density) + 0.5 * line_speed), np.sqrt(dx / numerics.gravity)]
    if viscosity > 0.0:
        limits.append(numerics.density * dx * dx / (6.0 * viscosity))
    steps = end_time / (courant_number(material, numerics) * min(limits))
    row = ROW_SHORT if state_count(material) == SHORT_STATE else ROW_LONG
    number = 4 if numerics.precision == "float32" else 8  # bytes
    memory = points * (4 * number * row + BYTES_PER_POINT_BESIDE) + nodes * BYTES_PER_POINT_NODE + 3 * elevation_bytes
    seconds = NANOSECONDS_PER_POINT_STEP[numerics.precision] * 1e-9
    return steps * (points * seconds / threads + SECONDS_PER_STEP), memory


def slower_than_nominal(
    solver_name: str, pace: float, particles: float, threads: int, precision: str = "float64"
) -> float:
    """Return the time of a step on this machine over the time that the constants of this module give.

    Parameters
    ----------
    solver_name : {"columns", "points"}
    pace : float [s]
        Measured time of a step for each particle.
    particles : float
        Number of particles in the step.
    threads : int
    precision : {"float64", "float32"}
        Of points.
    """
    nominal = NANOSECONDS_PER_POINT_STEP[precision] if solver_name == "points" else NANOSECONDS_PER_STEP
    return pace * particles / (particles * nominal * 1e-9 / threads + SECONDS_PER_STEP)


def seconds_of_frames(solver_name: str, particles: float, frames: float, written: bool = True) -> float:
    """Return the wall time of frames.

    Parameters
    ----------
    solver_name : {"columns", "points"}
    particles : float
        Number of particles in each frame.
    frames : float
        Number of frames.
    written : bool
        False: they are only displayed.

    Returns
    -------
    float [s]
    """
    if not written:
        return frames * particles * NANOSECONDS_PER_SHOWN * 1e-9
    return frames * (SECONDS_PER_FRAME + particles * NANOSECONDS_PER_WRITTEN[solver_name] * 1e-9)


def seconds_to_points(points: float, nodes: float) -> float:
    """Return the wall time in which columns become points.

    Parameters
    ----------
    points : float
        Number of points that are made.
    nodes : float
        Number of nodes of the grid in plan view.

    Returns
    -------
    float [s]
    """
    return SECONDS_PER_SWITCH + 1e-9 * (points * NANOSECONDS_TO_POINTS + nodes * NANOSECONDS_PER_NODE)


def seconds_to_columns(points: float, nodes: float) -> float:
    """Return the wall time in which points become columns.

    Parameters
    ----------
    points : float
        Number of points.
    nodes : float
        Number of nodes of the grid.

    Returns
    -------
    float [s]
    """
    return SECONDS_PER_SWITCH + 1e-9 * (points * NANOSECONDS_TO_COLUMNS + nodes * NANOSECONDS_PER_NODE)


def seconds_of_checks(particles: float, checks: float, conditions: Iterable[str]) -> float:
    """Return the wall time of checks of the end of a stage.

    Parameters
    ----------
    particles : float
        Number of particles.
    checks : float
    conditions : iterable of str
        Keys of the `until` of the stage.

    Returns
    -------
    float [s]
    """
    return checks * particles * 1e-9 * sum(NANOSECONDS_PER_CHECK.get(name, 0.0) for name in conditions)


def require_memory_for_points(count: float, cell_size: float) -> None:
    """Raise SceneError for points that exceed the memory of this machine, before they are created.

    Parameters
    ----------
    count : float
        Number of points.
    cell_size : float [m]

    Raises
    ------
    SceneError
    """
    if lack := memory_lack(count * BYTES_PER_START, MEMORY_SHARE):
        raise SceneError(
            f"[numerics] cell_size = {cell_size:g} m makes {count:.3g} points, which need {lack}; take larger cells"
        )
