"""Faces of barriers as the 3D kernels know them (see `spatial.faces` and `kernels.point_faces`)."""

from itertools import groupby

import numpy as np

from ..kernels.point_faces import FACE_ENTRIES
from ..kernels.point_rows import GHOSTS
from ..spatial.faces import faces_of

UNDER_GROUND = 2  # [cells] how far rows reach down
NO_FACES = np.zeros((0, FACE_ENTRIES))


def face_arrays(nodes, bed, smooth, x, y, middle, floor, cell_size):
    """(float64[n, FACE_ENTRIES], number of levels, float64[rows, columns, 2] for ROWED and ROW_TOP).

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
    owned = np.zeros((*bed.shape, 2))
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
                top = (np.floor((face.top - floor) / cell_size + 1e-9) + 0.25) * cell_size  # between two levels
                entries[n] = (
                    face.j + shift, face.i + shift, 1 - face.axis, face.axis, face.foot, face.out, *face.normal,
                    face.mu, face.number, *(place - middle[face.number, :2]), middle[face.number, 2], top,
                    max(bottom[n - first], 0), base,
                )  # fmt: skip
                levels = max(levels, int(top / cell_size) + GHOSTS + 1 - base)
                for at in face.columns():
                    owned[at] = n + 1, top
        first += len(side)
    return entries, levels, owned
