"""Ground and barriers at the nodes of the 3D solver, and the yield of the ground below the points."""

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from ..columns.node_grid import bed_at_nodes
from .barrier_faces import edge_height
from .face_arrays import face_arrays
from .ground_contact import LAYER, MOST_YIELD, YIELD, YIELD_STEP
from .ground_folds import padded
from .point_barriers import ROWED
from .point_faces import (
    FACE_EAST,
    FACE_FIRST,
    FACE_FOOT,
    FACE_I,
    FACE_J,
    FACE_LAYER,
    FACE_MU,
    FACE_NORTH,
    FACE_SHIFT,
    FACE_X,
    FACE_Y,
)
from .point_ground import FOLD_LEVELS
from .point_rows import GHOSTS, Settings

if TYPE_CHECKING:
    from ..columns.node_grid import ColumnGrid
    from ..features.walls import Wall

LEVEL_ROUNDING = 1e-12  # [1] relative rounding error of an elevation in cells
PRESSING = 1.0  # [cells] distance before a face up to which points that start with stress press on it
AT_NODE = 1e-4  # [cells] a crest that is lower than a node by less counts as at that node (rounding of float32)


def level_below(bed: float, dx: float) -> float:
    """Find the highest level of nodes (multiples of `dx`) that is not above the bed [m].

    Parameters
    ----------
    bed : float [m]
        Elevation.
    dx : float [m]
    """
    levels = bed / dx
    if abs(levels - np.rint(levels)) <= LEVEL_ROUNDING * max(1.0, abs(levels)):
        return bed
    return float(np.floor(levels) * dx)


def ground_nodes(grid: "ColumnGrid", dx: float) -> tuple[float, np.ndarray]:
    """Compute the ground at all nodes.

    Parameters
    ----------
    grid : ColumnGrid
    dx : float [m]

    Returns
    -------
    (float [m], float64[rows, columns, GROUND_ENTRIES])
        Elevation of the lowest level; the ground below each node column.
    """
    bed = bed_at_nodes(grid)
    floor = level_below(float(bed.min()), dx)
    height = bed - floor
    deep = ndimage.maximum_filter(height, 3) - dx  # a point above it is less than a cell below the ground
    return floor, padded(np.dstack([height, grid.gradient, deep]))


def barrier_nodes(
    walls: "tuple[Wall, ...]", grid: "ColumnGrid", floor: float, ground: np.ndarray, folds: np.ndarray, filled: bool
) -> tuple[np.ndarray, np.ndarray, int]:
    """Compute the barriers at node columns, and their smooth faces.

    Moments are about the foot of each wall's centroid.

    Parameters
    ----------
    walls : tuple of Wall
    grid : ColumnGrid
    floor : float [m]
        Elevation of the lowest level.
    ground : float64[rows, columns, GROUND_ENTRIES]
    folds : int32[rows, columns, FOLD_ENTRIES]
        Of the `Ground`.
    filled : bool
        Whether the parts of the splines that barriers fill are computed too.

    Returns
    -------
    (float64[rows, columns, POINT_BARRIER_ENTRIES], float64[faces, FACE_ENTRIES], int)
        The last one is the number of levels of the faces.
    """
    from ..features.walls import WIDENED_IN_3D, filled_at, margin_in_3d, wall_nodes  # they import shapely

    x, y = grid.node_axes()
    inner = (slice(GHOSTS - 1, -GHOSTS - 1),) * 2
    bed = ground[inner][..., 0]
    nodes = wall_nodes(walls, x, y, bed + floor, grid.cell_size, margin_in_3d, WIDENED_IN_3D)
    middle = np.zeros((len(walls) + 1, 3))
    for k, wall in enumerate(walls, 1):
        centre = wall.footprint.centroid
        foot = bed[np.argmin(np.abs(y - centre.y)), np.argmin(np.abs(x - centre.x))]
        middle[k] = centre.x, centre.y, foot
    at = middle[nodes.number]
    standing = (nodes.number > 0)[..., None]
    edge = np.where(nodes.share > 0.0, 0.0, edge_height(nodes.crest - floor, bed, grid.cell_size))
    top = nodes.crest - floor + AT_NODE * grid.cell_size
    entries = np.dstack(
        [
            nodes.normal,
            top - edge,
            nodes.depth,
            nodes.mu,
            nodes.weight,
            x[None, :] - at[..., 0],
            y[:, None] - at[..., 1],
            at[..., 2],
            nodes.number,
            nodes.share,
            nodes.limit,
            nodes.side,
            edge,
        ]
    )
    smooth = np.ones(bed.shape, bool) if folds.shape[0] == 1 else folds[inner][..., FOLD_LEVELS] == 0
    faces, levels, owned = face_arrays(nodes, bed, smooth, x, y, middle, floor, grid.cell_size)
    parts = np.zeros((*bed.shape, 2))
    if filled:
        part, crest = filled_at(walls, nodes, x, y, grid.cell_size, margin_in_3d)
        parts = np.dstack([part, np.where(part > 0.0, crest - floor, 0.0)])
    return padded(np.dstack([np.where(standing, entries, 0.0), owned, parts])), faces, levels


def press_ground(
    last: np.ndarray,
    step: int,
    place: np.ndarray,
    mass: np.ndarray,
    stressed: bool,
    ground: np.ndarray,
    settings: Settings,
) -> None:
    """Set the yield of the ground to equilibrium with the weight of points.

    Ground that the flow touched before keeps its yield; below points above the ground the next step finds no contact.

    Parameters
    ----------
    last : float64[rows, columns, YIELD_ENTRIES]
        Yields of `step`; changed.
    step : int
    place : float64[n, 3] [m]
        Of the points.
    mass : float64[n] [kg]
    stressed : bool
        Whether the points start with stress. Others press on ground without yield: both take up the weight in the first
        steps.
    ground : float64[rows, columns, GROUND_ENTRIES]
    settings : Settings
    """
    dx, shape = settings.dx, last.shape[:2]
    i, j = np.rint(place[:, :2].T / dx).astype(int) + GHOSTS
    mass = np.bincount(np.ravel_multi_index((j, i), shape), mass, shape[0] * shape[1])
    mass = ndimage.maximum_filter(ndimage.uniform_filter(mass.reshape(shape), 3), 3)
    thickness = mass / (settings.density * dx**2)
    steep2 = 1.0 + (ground[..., 1:3] ** 2).sum(axis=-1)
    yields = LAYER * dx * settings.gravity * thickness / (steep2 * settings.signal_speed**2)
    new = (thickness > 0.0) & (last[..., YIELD_STEP] != step + 1)
    yields = yields if stressed else np.zeros(shape)
    last[new, YIELD] = np.minimum(yields, MOST_YIELD * dx)[new]
    last[new, YIELD_STEP] = step + 1


def press_faces(
    last: np.ndarray,
    step: int,
    place: np.ndarray,
    stress: np.ndarray,
    barriers: np.ndarray,
    faces: np.ndarray,
    settings: Settings,
) -> None:
    """Set the yield of barriers' faces with friction to equilibrium with the stress of points before them.

    A face that bears the pressure p yields by FACE_LAYER dx p / (rho c^2) (c: speed of pressure waves). Rows that the
    flow touched before keep their yield.

    Parameters
    ----------
    last : float64[n + 2, levels + 2, YIELD_ENTRIES]
        Yields of the faces in `step`, with a rim; changed.
    step : int
    place : float64[n, 3] [m]
        Of the points, from the corner of the grid.
    stress : float64[n, 6] [Pa]
        xx, yy, zz, xy, xz, yz of the points.
    barriers : float64[rows, columns, POINT_BARRIER_ENTRIES]
    faces : float64[n, FACE_ENTRIES]
    settings : Settings
    """
    dx, cells = settings.dx, place / settings.dx + GHOSTS
    i, j, k = np.rint(cells.T).astype(int)
    number = barriers[j, i, ROWED].astype(int)
    chosen = np.flatnonzero(number > 0)
    number, k = number[chosen], k[chosen]
    face, (xx, yy, _, xy, _, _) = faces[number - 1].T, stress[chosen].T
    foot = face[FACE_FOOT] - face[FACE_SHIFT]
    away = (cells[chosen, 0] - face[FACE_I] - foot * face[FACE_EAST]) * face[FACE_X]
    away += (cells[chosen, 1] - face[FACE_J] - foot * face[FACE_NORTH]) * face[FACE_Y]
    pressure = -(xx * face[FACE_X] ** 2 + yy * face[FACE_Y] ** 2 + 2.0 * xy * face[FACE_X] * face[FACE_Y])
    row = k - face[FACE_FIRST].astype(int) + 1
    near = (away <= PRESSING) & (face[FACE_MU] > 0.0) & (row >= 1) & (row < last.shape[1] - 1)
    entry = np.ravel_multi_index((number[near], row[near]), last.shape[:2])
    count = np.bincount(entry, minlength=last.shape[0] * last.shape[1]).reshape(last.shape[:2])
    total = np.bincount(entry, pressure[near], count.size).reshape(last.shape[:2])
    yields = FACE_LAYER * dx * total / np.maximum(count, 1) / (settings.density * settings.signal_speed**2)
    new = (count > 0) & (last[..., YIELD_STEP] != step + 1)
    last[new, YIELD] = np.clip(yields, 0.0, MOST_YIELD * dx)[new]
    last[new, YIELD_STEP] = step + 1
