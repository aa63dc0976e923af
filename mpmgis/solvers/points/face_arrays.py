"""Arrays of the smooth faces of barriers for the kernels (see `barrier_faces` and `point_faces`)."""

from itertools import groupby, pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from .barrier_faces import SAME_SIDE, faces_of
from .point_faces import FACE_ENTRIES, FACE_FOLLOWS, FACE_NEXT, FACE_TAKEN, FACE_TOP, FACE_X, FACE_Y
from .point_rows import GHOSTS

if TYPE_CHECKING:
    from ..features.walls import WallNodes

UNDER_GROUND = 2  # [cells] depth of the lowest rows below the ground
NO_FACES = np.zeros((0, FACE_ENTRIES))  # faces of a terrain without barriers


def face_arrays(
    nodes: "WallNodes",
    bed: np.ndarray,
    smooth: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    middle: np.ndarray,
    floor: float,
    cell_size: float,
) -> tuple[np.ndarray, int, np.ndarray]:
    """Convert the smooth faces of barriers to arrays.

    Parameters
    ----------
    nodes : WallNodes
    bed : float64[rows, columns] [m]
        Above `floor`.
    smooth : bool[rows, columns]
        Where the ground under a node column is smooth.
    x : float64[columns] [m]
        East of the nodes.
    y : float64[rows] [m]
        North of the nodes.
    middle : float64[walls + 1, 3] [m]
        Foot of each barrier's middle, from 1.
    floor : float [m]
        Elevation of the lowest level.
    cell_size : float [m]

    Returns
    -------
    (float64[n, FACE_ENTRIES], int, float64[rows, columns, 3])
        The faces; their number of levels; ROWED, ROW_TOP and ROWED_TOO of the node columns (see `point_barriers`).
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
                    face.j + shift,
                    face.i + shift,
                    1 - face.axis,
                    face.axis,
                    face.foot,
                    face.out,
                    *face.normal,
                    face.mu,
                    face.number,
                    *(place - middle[face.number, :2]),
                    middle[face.number, 2],
                    top,
                    max(bottom[n - first], 0),
                    base,
                    0.0,
                    0.0,
                    0.0,
                    face.shift,
                    np.sqrt(face.spread),
                )
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
