"""Memory that columns, points and nodes of a run need."""

from ..solvers.columns.column_rows import ROW
from ..solvers.points.point_ground import GROUND_ENTRIES
from ..solvers.points.point_rows import ROW_LONG, ROW_SHORT
from ..system.errors import SceneError
from ..system.memory import memory_lack

BYTES_PER_COLUMN = 3 * ROW * 8 + 3 * 8 + 2 * 4 + 4 + 160  # rows, ids, keys, order; two frames
BYTES_PER_NODE = 8 * (1 + 2 + 4 + 1) + 2  # bed, gradient, node entries, largest thickness; wet and inside
BYTES_PER_POINT_BESIDE = 190  # without its rows: ids, keys, order, and the point in two frames
BYTES_PER_POINT_NODE = 8 * (3 + 2 * GROUND_ENTRIES)  # bed, gradient, ground and its properties
BYTES_PER_GRID_NODE = 110  # of a grid in plan view while it is built (measured 105 with 1.1e8 nodes, 2026-11-22)
BYTES_PER_START = 320  # of a point while columns become points
BYTES_PER_SWITCHED = 640  # of a point during a conversion within a run (measured 2026-11-22)
MEMORY_SHARE = 0.8  # share of the free memory or disk above which a run requires confirmation


def memory_of_columns(columns: int, nodes: float, elevation_bytes: int) -> float:
    """Return the memory of a depth-averaged run.

    Parameters
    ----------
    columns : int
    nodes : float
        Number of nodes of the grid.
    elevation_bytes : int [bytes]
        Of the elevation of the terrain.

    Returns
    -------
    float [bytes]
    """
    return columns * BYTES_PER_COLUMN + nodes * BYTES_PER_NODE + 3 * elevation_bytes


def memory_of_points(points: int, nodes: float, elevation_bytes: int, precision: str, state_count: int) -> float:
    """Return the memory of a 3D run.

    Parameters
    ----------
    points : int
    nodes : float
        Number of nodes of the grid in plan view.
    elevation_bytes : int [bytes]
        Of the elevation of the terrain.
    precision : {"float64", "float32"}
    state_count : int
        Number of state variables of the material.

    Returns
    -------
    float [bytes]
    """
    row = (ROW_SHORT if state_count <= 4 else ROW_LONG) * (4 if precision == "float32" else 8)
    return points * (4 * row + BYTES_PER_POINT_BESIDE) + nodes * BYTES_PER_POINT_NODE + 3 * elevation_bytes


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
