"""Ground and barriers at the nodes of the 3D solver, and the yield of the ground below the points.

Folds of the ground within a cell, and the distance of the nodes there from the ground.

At the edge of a cliff the plane below a node column deviates from the ground by up to the height of the cliff. Such
columns and their neighbours store the exact distance and direction of the nearest ground for each node that the flow
can reach.

Faces of barriers as the 3D kernels know them (see `barrier_faces` and `point_faces`).
"""

from itertools import groupby, pairwise

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ...system.errors import SceneError
from ..columns.node_grid import bed_at_nodes
from .barrier_faces import SAME_SIDE, edge_height, faces_of
from .point_barriers import ROWED
from .point_contact import LAYER, MOST_YIELD, YIELD, YIELD_STEP
from .point_faces import (
    FACE_EAST,
    FACE_ENTRIES,
    FACE_FIRST,
    FACE_FOLLOWS,
    FACE_FOOT,
    FACE_I,
    FACE_J,
    FACE_LAYER,
    FACE_MU,
    FACE_NEXT,
    FACE_NORTH,
    FACE_SHIFT,
    FACE_TAKEN,
    FACE_TOP,
    FACE_X,
    FACE_Y,
)
from .point_ground import EXACT_ENTRIES, FOLD_ENTRIES, FOLD_LEVELS, Ground, distances_to_ground
from .point_rows import GHOSTS

FOLD_CELLS = 0.5  # [cells] deviation of the ground from the plane of a node at its neighbours that makes a fold
REACH = 3  # [cells] to each side in which the nearest ground is searched; nodes with mass are nearer
MOST_NODES = 1 << 27  # on folds, 2 GiB
PRESSING = 1.0  # [cells] before a face, up to which points that start with stress press on it
AT_NODE = 1e-4  # [cells] below a node, up to which the crest counts as at that node (rounding of single precision)
SUNK = 3  # [cells] depth of the lowest node that can have mass, below the lowest ground near it


def folded_ground(nodes, height, dx, clearance):
    """The `Ground` of node columns `nodes`, with its folds.

    Parameters
    ----------
    nodes : float[rows, columns, GROUND_ENTRIES]
        Height [m] and slopes first.
    height : float[rows, columns] [m]
        Of the terrain at the nodes: a cliff is one cell wide there and has no ramp, unlike that of the spline.
    dx : float [m]
    clearance : float [cells]
        Height above the ground at which a node is in contact with it.

    Raises
    ------
    SceneError
        Ground so rough that its folds do not fit into memory.
    """
    folded = ndimage.maximum_filter(departure(nodes, height, dx) > FOLD_CELLS * dx, 3)
    if not folded.any():
        return Ground(nodes, np.zeros((1, 1, FOLD_ENTRIES), np.int32), np.zeros((1, EXACT_ENTRIES), np.float32))
    beside = 1 + int(np.ceil(clearance))
    rows, columns = np.nonzero(folded)
    least = ndimage.minimum_filter(height, 5)[folded]
    most = ndimage.maximum_filter(height, 2 * beside + 1)[folded]
    lowest = np.floor(least / dx).astype(np.int64) - SUNK + GHOSTS
    levels = np.ceil(most / dx).astype(np.int64) + beside + GHOSTS + 1 - lowest
    if levels.sum() > MOST_NODES:
        share = 100.0 * len(rows) / folded.size
        raise SceneError(
            f"the DTM folds within a cell of {dx:g} m on {share:.0f} % of the terrain, {levels.sum():.3g} nodes "
            f"with a nearest ground, expected at most {MOST_NODES:.3g}; clip it by [terrain] window, smooth it or "
            "take larger cells"
        )
    firsts = np.cumsum(levels) - levels
    exact = np.zeros((int(levels.sum()), EXACT_ENTRIES), np.float32)
    distances_to_ground(np.asarray(height, float), dx, rows, columns, firsts, lowest, levels, REACH, exact)
    folds = np.zeros((*folded.shape, FOLD_ENTRIES), np.int32)
    folds[folded] = np.column_stack([firsts, lowest, levels])
    return Ground(nodes, folds, exact)


def departure(nodes, height, dx):
    """float[rows, columns] [m]: deviation of the ground from the plane of a node, normal to it, at its neighbours."""
    foot, slope_x, slope_y = (nodes[..., k] for k in range(3))
    padded, worst = np.pad(height, 1, mode="edge"), np.zeros(height.shape)
    rows, columns = height.shape
    for j in (-1, 0, 1):
        for i in (-1, 0, 1):
            there = padded[1 + j : 1 + j + rows, 1 + i : 1 + i + columns]
            apart = np.abs(there - foot - dx * (i * slope_x + j * slope_y))
            worst = np.maximum(worst, apart)
    worst /= np.sqrt(1.0 + slope_x**2 + slope_y**2)
    rim = np.zeros(height.shape, bool)  # the ground is only extended beyond, without folds
    rim[GHOSTS : -GHOSTS - 2, GHOSTS : -GHOSTS - 2] = True
    return np.where(rim, worst, 0.0)


UNDER_GROUND = 2  # [cells] how far rows reach down
NO_FACES = np.zeros((0, FACE_ENTRIES))


def face_arrays(nodes, bed, smooth, x, y, middle, floor, cell_size):
    """(float64[n, FACE_ENTRIES], number of levels, float64[rows, columns, 3] for ROWED, ROW_TOP and ROWED_TOO).

    Parameters
    ----------
    nodes : WallNodes
    bed : float[rows, columns] [m]
        Above `floor` [m].
    smooth : bool[rows, columns]
    x, y : float[columns], float[rows] [m]
    middle : float[walls + 1, 3] [m]
        Foot of each barrier's middle, from 1.
    cell_size : float [m]
    """
    faces = faces_of(nodes, bed + floor, smooth, cell_size)
    entries, levels = np.zeros((len(faces), FACE_ENTRIES)), 0
    owned, at_columns = np.zeros((*bed.shape, 3)), {}
    shift, first = GHOSTS - 1, 0
    for alone, group in groupby(faces, key=lambda face: face is None):
        side = list(group)
        if not alone:
            lowest = [min(bed[at] for at in face.columns()) / cell_size for face in side]
            bottom = np.floor(lowest).astype(int) + GHOSTS - UNDER_GROUND
            base = max(bottom.min(), 0)
            for n, face in enumerate(side, first):
                place = np.array([x[face.i], y[face.j]])
                place[face.axis] += face.foot * cell_size
                place[1 - face.axis] += face.along * cell_size
                top = (np.floor((face.top - floor) / cell_size + 1e-9) + 0.25) * cell_size  # between two levels
                entries[n] = (
                    face.j + shift, face.i + shift, 1 - face.axis, face.axis, face.foot, face.out, *face.normal,
                    face.mu, face.number, *(place - middle[face.number, :2]), middle[face.number, 2], top,
                    max(bottom[n - first], 0), base, 0.0, 0.0, 0.0, face.shift,
                    np.sqrt(face.spread),
                )  # fmt: skip
                levels = max(levels, int(top / cell_size) + GHOSTS + 1 - base)
                for at in face.columns():
                    at_columns.setdefault(at, []).append(n)
        first += len(side)
    for at, of in at_columns.items():
        others = [n for n in of if entries[n, FACE_X : FACE_Y + 1] @ entries[of[0], FACE_X : FACE_Y + 1] < SAME_SIDE]
        owned[at] = of[0] + 1, min(entries[n, FACE_TOP] for n in of), others[0] + 1 if others else 0
    _join(faces, entries, at_columns)
    return entries, levels, owned


def _join(faces, entries, at_columns):
    """Chain faces that share node columns, in place; `at_columns` are the numbers of the faces at each node column."""
    shared = [pair for of in at_columns.values() for pair in pairwise(of)]
    if not shared:
        return
    for at, of in at_columns.items():
        for n in of[1:]:
            entries[n, FACE_TAKEN] += 2 ** faces[n].columns().index(at)
    pairs, n = np.transpose(shared), len(entries)
    _, part = connected_components(coo_array((np.ones(len(shared)), tuple(pairs)), (n, n)), directed=False)
    order = np.argsort(part, kind="stable")
    follows = part[order[1:]] == part[order[:-1]]
    entries[order[1:][follows], FACE_FOLLOWS] = 1.0
    entries[order[:-1][follows], FACE_NEXT] = 1 + order[1:][follows]


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


def barrier_nodes(walls, grid, floor, ground, folds, filled):
    """Barriers `walls` at node columns, and their smooth faces.

    Moments are about the foot of each wall's centroid. `folds` are those of the `Ground`. With `filled` the parts of
    the splines that barriers fill are computed too.

    Returns
    -------
    float64[rows, columns, POINT_BARRIER_ENTRIES], float64[faces, FACE_ENTRIES], int
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
    entries = np.dstack([
        nodes.normal, top - edge, nodes.depth, nodes.mu,
        nodes.weight,
        x[None, :] - at[..., 0], y[:, None] - at[..., 1], at[..., 2], nodes.number,
        nodes.share, nodes.limit, nodes.side, edge,
    ])  # fmt: skip
    smooth = np.ones(bed.shape, bool) if folds.shape[0] == 1 else folds[inner][..., FOLD_LEVELS] == 0
    faces, levels, owned = face_arrays(nodes, bed, smooth, x, y, middle, floor, grid.cell_size)
    parts = np.zeros((*bed.shape, 2))
    if filled:
        part, crest = filled_at(walls, nodes, x, y, grid.cell_size, margin_in_3d)
        parts = np.dstack([part, np.where(part > 0.0, crest - floor, 0.0)])
    return padded(np.dstack([np.where(standing, entries, 0.0), owned, parts])), faces, levels


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


def press_faces(last, step, place, stress, barriers, faces, settings):
    """Set the yield of barriers' faces with friction to equilibrium with the stress of points before them.

    A face that bears the pressure p yields by FACE_LAYER dx p / (rho c^2) (c: speed of pressure waves). Rows that the
    flow touched before keep their yield.

    Parameters
    ----------
    last : float64[n + 2, levels + 2, YIELD_ENTRIES]
        Yields of the faces in `step`, with a rim.
    place : float64[n, 3] [m]
        Of the points, from the corner of the grid.
    stress : float64[n, 6] [Pa]
        xx, yy, zz, xy, xz, yz of the points.
    barriers : float64[rows, columns, POINT_BARRIER_ENTRIES]
    faces : float64[n, FACE_ENTRIES]
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
