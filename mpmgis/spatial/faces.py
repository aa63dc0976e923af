"""Faces of barriers in 3D: where a wall's smooth side crosses the rows of nodes that lead into it."""

from math import cos, floor, radians
from typing import NamedTuple

import numpy as np

HELD_CELLS = 1.5  # [cells] under the crest, above which nodes are held one by one
LOWEST_FACE = 2.0  # [cells] at least, from the ground to where rows end
SAME_SIDE = cos(radians(30.0))  # nodes whose normals differ by more lie behind different sides
DIAGONAL = 0.999  # of the larger part of a normal, from which both axes are as good
ROUND_OFF = 1e-9  # [cells]
AT_RIM = 1e-6  # [cells] from the side, within which rounding decides to whom a node belongs


class Face(NamedTuple):
    """A row of three nodes around a wall's side.

    Parameters
    ----------
    j, i : int
        Row and column of the node nearest to the side.
    axis : int
        0: the row runs east, 1: north.
    foot : float [cells]
        Place of the side from that node, -0.5 to 0.5.
    out : int
        -1 or 1: in which direction along the row the flow lies.
    normal : (float, float)
        Outward unit normal, east and north.
    number : int
        1 + index of the wall.
    mu : float [1]
    top : float [m]
        Elevation up to which the rows hold.
    """

    j: int
    i: int
    axis: int
    foot: float
    out: int
    normal: tuple[float, float]
    number: int
    mu: float
    top: float

    def columns(self):
        """(j, i) of the three node columns of the row."""
        return [(self.j + o * self.axis, self.i + o * (1 - self.axis)) for o in (-1, 0, 1)]


def faces_of(nodes, bed, smooth, cell_size):
    """List of Face, those beside each other along a side in their order, None between others.

    Left out are rows at corners, ends and openings, on ground that is not smooth, at walls lower than the cells can
    tell, and rows that would share a node column with another face.

    Parameters
    ----------
    nodes : WallNodes
    bed : float[rows, columns] [m]
    smooth : bool[rows, columns]
        Where the ground under a node column is smooth.
    cell_size : float [m]
    """
    taken, faces = np.zeros(bed.shape, bool), []
    for axis in (0, 1):
        along, other = np.abs(nodes.normal[..., axis]), np.abs(nodes.normal[..., 1 - axis])
        better = along >= DIAGONAL * other if axis == 0 else along * DIAGONAL > other
        found = []
        for j, i in np.argwhere((nodes.number > 0) & (nodes.share == 0.0) & better):
            face = _face_behind(nodes, int(j), int(i), axis, cell_size)
            if face is not None and _is_smooth(face, nodes, bed, smooth, cell_size):
                found.append(face)
        for face in sorted(found, key=_order):
            columns = tuple(np.transpose(face.columns()))
            if taken[columns].any():
                continue
            taken[columns] = True
            if faces and not _are_adjacent(faces[-1], face):
                faces.append(None)
            faces.append(face)
    return faces


def _order(face):
    """Along each side of each wall."""
    return face.number, face.out, (face.j, face.i) if face.axis == 0 else (face.i, face.j)


def _are_adjacent(face, other):
    """Do two faces follow each other along one side?"""
    if face is None or (face.axis, face.number, face.out) != (other.axis, other.number, other.out):
        return False
    along, across = (other.j - face.j, other.i - face.i) if face.axis == 0 else (other.i - face.i, other.j - face.j)
    return along == 1 and abs(across) <= 1 and np.dot(face.normal, other.normal) > SAME_SIDE


def _face_behind(nodes, j, i, axis, cell_size):
    """Face in front of node [j, i] of a wall, or None if the next node of the row is not in front of it."""
    normal = nodes.normal[j, i]
    out = 1 if normal[axis] > 0.0 else -1
    ahead = nodes.depth[j, i] / (abs(normal[axis]) * cell_size)
    ahead_j, ahead_i = j + out * axis, i + out * (1 - axis)
    if ahead > 1.0 + ROUND_OFF or not (0 <= ahead_j < nodes.number.shape[0] and 0 <= ahead_i < nodes.number.shape[1]):
        return None
    if nodes.number[ahead_j, ahead_i] > 0:
        return None
    place = (i if axis == 0 else j) + out * ahead
    nearest = floor(place + 0.5 + ROUND_OFF)
    at = (j, nearest) if axis == 0 else (nearest, i)
    number, mu = int(nodes.number[j, i]), float(nodes.mu[j, i])
    face = Face(*at, axis, place - nearest, out, (float(normal[0]), float(normal[1])), number, mu, 0.0)
    return face._replace(top=_lowest_crest(face, nodes) - HELD_CELLS * cell_size)


def _lowest_crest(face, nodes):
    """Elevation [m] of the lowest crest at the nodes of a face's row that are in walls."""
    rows, columns = nodes.number.shape
    inside = [at for at in face.columns() if 0 <= at[0] < rows and 0 <= at[1] < columns and nodes.number[at] > 0]
    return min((float(nodes.crest[at]) for at in inside), default=-np.inf)


def _is_smooth(face, nodes, bed, smooth, cell_size):
    """Are the nodes of the row behind the face of its side, those before it free, and is it high enough?"""
    for o, at in zip((-1, 0, 1), face.columns(), strict=True):
        if not all(0 <= k < n for k, n in zip(at, bed.shape, strict=True)) or not smooth[at]:
            return False
        if face.top - bed[at] < LOWEST_FACE * cell_size:
            return False
        if nodes.share[at] > 0.0:
            return False
        before = (o - face.foot) * face.out
        if abs(before) <= AT_RIM:
            continue
        inside = before < 0.0
        if not inside and nodes.number[at] > 0:
            return False
        if inside and nodes.number[at] != face.number:
            return False
        if inside and np.dot(nodes.normal[at], face.normal) < SAME_SIDE:
            return False
    return True
