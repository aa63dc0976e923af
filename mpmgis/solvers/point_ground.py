"""Ground and barriers at the nodes of the 3D solver, and the yield of the ground below the points."""

import numpy as np
from scipy import ndimage

from ..kernels.point_contact import LAYER, MOST_YIELD, YIELD, YIELD_STEP
from ..kernels.point_ground import FOLD_LEVELS
from ..kernels.point_rows import GHOSTS
from ..spatial.node_grid import bed_at_nodes
from .barrier_faces import face_arrays

LEVEL_ROUNDING = 1e-12  # relative rounding error of an elevation in cells


def level_below(bed, dx):
    """Elevation [m] of the highest level of nodes (multiples of `dx` [m]) that is not above `bed` [m]."""
    levels = bed / dx
    if abs(levels - np.rint(levels)) <= LEVEL_ROUNDING * max(1.0, abs(levels)):
        return bed
    return float(np.floor(levels) * dx)


def padded(values):
    """`values` [ny + 3, nx + 3, k], from one node outside the corner of the domain, extended to the ghost nodes."""
    before, after = GHOSTS - 1, GHOSTS + 1
    return np.ascontiguousarray(np.pad(values, ((before, after), (before, after), (0, 0)), mode="edge"))


def ground_nodes(grid, dx):
    """(elevation [m] of the lowest level, float64[rows, columns, GROUND_ENTRIES] of all nodes)."""
    bed = bed_at_nodes(grid)
    floor = level_below(float(bed.min()), dx)
    height = bed - floor
    deep = ndimage.maximum_filter(height, 3) - dx  # a point above it is less than a cell below the ground
    return floor, padded(np.dstack([height, grid.gradient, deep]))


def barrier_nodes(walls, grid, floor, ground, folds):
    """Barriers `walls` at node columns, and their smooth faces.

    Moments are about the foot of each wall's centroid. `folds` are those of the `Ground`.

    Returns
    -------
    float64[rows, columns, POINT_BARRIER_ENTRIES], float64[faces, FACE_ENTRIES], int
        The last one is the number of levels of the faces.
    """
    from ..spatial.barriers import WIDENED_IN_3D, margin_in_3d, wall_nodes  # with shapely

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
    entries = np.dstack([
        nodes.normal, nodes.crest - floor, nodes.depth, nodes.mu, nodes.weight,
        x[None, :] - at[..., 0], y[:, None] - at[..., 1], at[..., 2], nodes.number,
        nodes.share, nodes.limit, nodes.side,
    ])  # fmt: skip
    smooth = np.ones(bed.shape, bool) if folds.shape[0] == 1 else folds[inner][..., FOLD_LEVELS] == 0
    faces, levels, held = face_arrays(nodes, bed, smooth, x, y, middle, floor, grid.cell_size)
    return padded(np.dstack([np.where(standing, entries, 0.0), held])), faces, levels


def press_ground(last, step, place, mass, stressed, ground, settings):
    """Set the yield of the ground to equilibrium with the weight of points at `place` [n, 3] [m] of `mass` [n] [kg].

    `last` float64[rows, columns, YIELD_ENTRIES] are the yields of `step`. Ground that the flow touched before keeps its
    yield; below points above the ground the next step finds no contact. Points that are not `stressed` press on ground
    without yield: both take up the weight in the first steps.
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
