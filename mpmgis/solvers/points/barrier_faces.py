"""Faces of barriers in 3D: where a wall's smooth side crosses the rows of nodes that lead into it."""

from itertools import groupby, pairwise
from math import cos, floor, radians
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .contact_shares import part_before

if TYPE_CHECKING:
    from ..features.walls import WallNodes

HELD_CELLS = 1.5  # [cells] least depth under the crest of the rows of a face; nodes above are held one by one
EDGE_CELLS = 2.6  # [cells] largest depth under the crest in which flow over it moves freely into the side
LOW = 2.0  # [cells] height up to which barriers hold the flow up to their crest
LOWEST_FACE = 3.5  # [cells] least height of barriers with faces
SAME_SIDE = cos(radians(30.0))  # [1] cosine between the normals of nodes, below which they lie behind different sides
DIAGONAL = 0.999  # [1] ratio of the two parts of a normal from which a row may run along either axis
STRAIGHT = cos(radians(1.0))  # [1] cosine between the normals of faces beside each other on one plane
ALIGNED = 1e-6  # [1] difference of the normals of faces on one plane that rounding can cause
MOST_ASKEW = 4  # largest number of faces whose normal a corner turns
MOST_TO_CORNER = 8  # largest number of rows from the last whole one to the end in a corner
SUPPORT = 1.5  # [cells] half width of the spline
OFF_SIDE = 0.05  # [cells] largest distance of the rim of a wall from the sides of a corner
LEAST_SLOPE = 0.1  # [1] least slope between two sides that form a corner
ROUND_OFF = 1e-9  # [cells] rounding error of a place
AT_RIM = 1e-6  # [cells] distance from the side within which rounding decides on which side of it a node lies


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
    normal : (float, float) [1]
        Outward unit normal, east and north.
    number : int
        1 + index of the wall.
    mu : float [1]
        Coulomb friction along the side.
    top : float [m]
        Elevation up to which the rows hold the flow.
    along, shift : float [cells]
        In a corner, how far the centre of the row's part of the side lies beside the row, and how far `foot` along it.
    spread : float [1]
        Variance of that part over that of the whole spline.
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
    along: float = 0.0
    shift: float = 0.0
    spread: float = 1.0

    def columns(self) -> list[tuple[int, int]]:
        """Return (j, i) of the three node columns of the row."""
        return [(self.j + o * self.axis, self.i + o * (1 - self.axis)) for o in (-1, 0, 1)]


def faces_of(nodes: "WallNodes", bed: np.ndarray, smooth: np.ndarray, cell_size: float) -> list[Face | None]:
    """Find the faces of all walls: those beside each other along a side in their order, None between others.

    Left out are rows at outer corners, ends and openings, on ground that is not smooth, at walls lower than the cells
    can resolve, and rows that would share a node column with another face of their side. In an inner corner the rows of
    both sides reach as far as splines of points before it, and share node columns. A node without a normal, in the
    middle between opposite sides or where parts of a wall touch in a point, has no side.

    Parameters
    ----------
    nodes : WallNodes
    bed : float64[rows, columns] [m]
    smooth : bool[rows, columns]
        Where the ground under a node column is smooth.
    cell_size : float [m]
    """
    taken, sides = np.zeros(bed.shape, bool), []
    for axis in (0, 1):
        along, other = np.abs(nodes.normal[..., axis]), np.abs(nodes.normal[..., 1 - axis])
        better = (along >= DIAGONAL * other) & (along > 0.0) if axis == 0 else along * DIAGONAL > other
        found = []
        for j, i in np.argwhere((nodes.number > 0) & (nodes.share == 0.0) & better):
            face = _face_behind(nodes, bed, int(j), int(i), axis, cell_size)
            if face is not None and _is_smooth(face, nodes, bed, smooth, cell_size):
                found.append(face)
        begun = {}  # sides of each direction that are not yet at their ends; walls that touch can share one
        for face in sorted(found, key=_order):
            columns = tuple(np.transpose(face.columns()))
            if taken[columns].any():
                continue
            taken[columns] = True
            open_sides = begun.setdefault(face.out, [])
            side = next((side for side in open_sides if _are_adjacent(side[-1], face)), None)
            if side is None:
                side = []
                open_sides.append(side)
                sides.append(side)
            side.append(face)
    turned = [side for side in sides if not _has_plane(side)]
    sides = [side for side in sides if _has_plane(side)]
    for _ in range(2):  # at their ends, then turned round at their beginnings
        sides = [_into_corner(side, nodes, bed, smooth, cell_size)[::-1] for side in sides]
    reached = {at for side in sides for face in side for at in face.columns()}
    faces, rest, known = [], [part for side in turned for part in _parts_beside(side, reached)], set()
    for side in rest + sides:
        groups = groupby(side, key=lambda face: _row_and_plane(face) in known)  # runs of one side can share a corner
        for part in [list(group) for again, group in groups if not again]:
            faces += [None, *part] if faces else part
            known |= {_row_and_plane(face) for face in part}
    return faces


def _row_and_plane(face):
    """Return what two faces of one side in the same row have in common."""
    return face.j, face.i, face.axis, face.out, *(round(part, 6) for part in face.normal)


def _has_plane(side):
    """Return whether two faces beside each other have the same normal.

    Nodes behind a corner can make short sides whose faces do not.
    """
    return any(np.dot(one.normal, other.normal) > STRAIGHT for one, other in pairwise(side))


def _is_askew(faces):
    """Return whether the last of three `faces` has another normal than the two before it, which have the same one."""
    if len(faces) < 3:
        return False
    first, second, last = np.array([face.normal for face in faces])
    return abs(second - first).max() <= ALIGNED < abs(last - second).max()


def _parts_beside(side, columns):
    """Return the runs of the faces of `side` that have none of the node `columns`."""
    groups = groupby(side, key=lambda face: any(at in columns for at in face.columns()))
    return [list(group) for meets, group in groups if not meets]


def _into_corner(side, nodes, bed, smooth, cell_size):
    """Return `side` with faces at its end in the corner with another side, if it ends in one.

    Nodes behind a corner are nearest to the corner itself, so that the last faces may have a normal between those of
    both sides: they are replaced.
    """
    whole = len(side)
    while whole > max(len(side) - MOST_ASKEW, 1):
        straight = whole > 1 and np.dot(side[whole - 1].normal, side[whole - 2].normal) > STRAIGHT
        if straight and not _is_askew(side[max(whole - 3, 0) : whole]):
            break
        whole -= 1
    way = (side[-1].j - side[0].j, side[-1].i - side[0].i)[side[0].axis]
    for step in (1, -1) if way == 0 else (int(np.sign(way)),):
        added, corner = _to_corner(side[whole - 1], step, nodes, bed, smooth, cell_size)
        if added:
            faces = [_before_corner(face, corner, step) for face in side[:whole] + added]
            return [face for face in faces if face.spread > 0.0]  # of the others no part is before the corner
    return side


def _to_corner(last, step, nodes, bed, smooth, cell_size):
    """Return (faces beyond the `last` of a side in direction `step`, place of the corner); no faces if there is none.

    Faces reach as far as the splines of points before the corner. The corner's place counts along the axis across the
    rows. It is where the side meets the plane of the rim next to the first node before it that lies in the wall.
    """
    added, corner = [], None
    axis, normal = last.axis, last.normal
    lean = -normal[1 - axis] / normal[axis]
    for n in range(1, MOST_TO_CORNER + 1):
        across = (last.j, last.i)[axis] + n * step
        place = (last.j, last.i)[1 - axis] + last.foot - last.shift + n * step * lean
        face = _at_place(last, across, place)
        columns = face.columns()
        if not all(0 <= k < size for at in columns for k, size in zip(at, bed.shape, strict=True)):
            return [], None
        if any(nodes.number[at] == 0 for o, at in zip((-1, 0, 1), columns, strict=True) if _away(face, o) < -AT_RIM):
            return [], None
        face = face._replace(top=_top_of(face, nodes, bed, cell_size))
        crest = _lowest_crest(face, nodes)
        if any(not smooth[at] or nodes.share[at] > 0.0 or crest - bed[at] < LOWEST_FACE * cell_size for at in columns):
            return [], None
        ahead = columns[1 + face.out]
        if corner is None and nodes.number[ahead] > 0 and np.dot(nodes.normal[ahead], normal) < SAME_SIDE:
            other = nodes.normal[ahead]
            rim = _rim_of(nodes, ahead, cell_size)
            reach = (ahead[axis] - across) * other[1 - axis] + (ahead[1 - axis] - place) * other[axis]
            reach += nodes.depth[ahead] / cell_size
            slope = other[1 - axis] + lean * other[axis]
            if slope * step > -LEAST_SLOPE:
                return [], None
            corner = across + reach / slope
        if corner is not None and (across - corner) * step >= SUPPORT - AT_RIM:
            sides = (_place_of(last), np.array(normal)), (rim, np.array(other))
            return (added, corner) if _lie_on(sides, added, nodes, cell_size) else ([], None)
        added.append(face)
    return [], None


def _place_of(face):
    """Return (east, north) [nodes] of a point of a face's side."""
    at = np.array([face.i, face.j], float)
    at[face.axis] += face.foot - face.shift
    return at


def _rim_of(nodes, at, cell_size):
    """Return (east, north) [nodes] of the rim of a wall nearest to the node `at` in it."""
    return np.array([at[1], at[0]]) + nodes.depth[at] / cell_size * nodes.normal[at]


def _lie_on(sides, faces, nodes, cell_size):
    """Return whether the rim of the wall nearest to each node behind `faces` is on one of both sides of a corner.

    Each of the `sides` is (point, normal). The rim is not on them where the wall is curved or has a kink before the
    corner. The rim behind a thin wall does not count.
    """
    meeting = np.linalg.solve([facing for _, facing in sides], [np.dot(*side) for side in sides])
    for face in faces:
        for o, (j, i) in zip((-1, 0, 1), face.columns(), strict=True):
            if _away(face, o) < -AT_RIM:
                rim, normal = _rim_of(nodes, (j, i), cell_size), nodes.normal[j, i]
                nearer = nodes.depth[j, i] / cell_size < np.hypot(*(meeting - [i, j]))
                is_back = nearer and all(np.dot(normal, facing) < SAME_SIDE for _, facing in sides)
                if not is_back and min(abs(np.dot(rim - point, facing)) for point, facing in sides) > OFF_SIDE:
                    return False
    return True


def _away(face, o):
    """Return the distance [cells] along a face's row of its node `o` (-1, 0 or 1) before it."""
    return (o - face.foot) * face.out


def _at_place(face, across, place):
    """Return `face` with its row at `across` and its foot at `place` along it, both in nodes."""
    nearest = floor(place + 0.5 + ROUND_OFF)
    at = (across, nearest) if face.axis == 0 else (nearest, across)
    return face._replace(j=at[0], i=at[1], foot=place - nearest)


def _before_corner(face, corner, step):
    """Move a face to the centre of the part of its spline before a corner.

    The face's side ends at `corner` in direction `step`.
    """
    across = (face.j, face.i)[face.axis]
    centre, spread = part_before((corner - across) * step)
    if centre == 0.0 or face.spread <= spread:  # the nearer of two corners counts
        return face
    along = -step * centre
    shift = -face.normal[1 - face.axis] / face.normal[face.axis] * along
    place = (face.j, face.i)[1 - face.axis] + face.foot - face.shift + shift
    return _at_place(face, across, place)._replace(along=along, shift=shift, spread=spread)


def _order(face):
    """Return the key by which faces are sorted along each side."""
    return face.out, (face.j, face.i) if face.axis == 0 else (face.i, face.j)


def _are_adjacent(face, other):
    """Return whether two faces follow each other along one side."""
    if face is None or (face.axis, face.out) != (other.axis, other.out):
        return False
    along, across = (other.j - face.j, other.i - face.i) if face.axis == 0 else (other.i - face.i, other.j - face.j)
    return along == 1 and abs(across) <= 1 and np.dot(face.normal, other.normal) > SAME_SIDE


def _face_behind(nodes, bed, j, i, axis, cell_size):
    """Return the face in front of node [j, i] of a wall, or None if the next node of the row is not in front of it."""
    normal = nodes.normal[j, i]
    out = 1 if normal[axis] > 0.0 else -1
    ahead = nodes.depth[j, i] / (abs(normal[axis]) * cell_size)
    ahead_j, ahead_i = j + out * axis, i + out * (1 - axis)
    if ahead > 1.0 + ROUND_OFF or not (0 <= ahead_j < nodes.number.shape[0] and 0 <= ahead_i < nodes.number.shape[1]):
        return None
    if nodes.number[ahead_j, ahead_i] > 0:
        return None
    place = (i if axis == 0 else j) + out * ahead
    number, mu = int(nodes.number[j, i]), float(nodes.mu[j, i])
    face = Face(j, i, axis, 0.0, out, (float(normal[0]), float(normal[1])), number, mu, 0.0)
    face = _at_place(face, (j, i)[axis], place)
    return face._replace(top=_top_of(face, nodes, bed, cell_size))


def edge_height(crest: float | np.ndarray, bed: float | np.ndarray, cell_size: float) -> float | np.ndarray:
    """Compute the height of the edge of a barrier under its crest [m].

    Flow passes a crest some cells above the nodes that hold its side. With EDGE_CELLS the discharge of water over a
    wall is that of measured weirs. A barrier up to LOW cells high has no edge, and that of a higher one ends LOW cells
    above the ground or higher.

    Parameters
    ----------
    crest : float or float64[...] [m]
        Elevation.
    bed : float or float64[...] [m]
        Elevation of the ground there.
    cell_size : float [m]
    """
    return np.clip(crest - bed - LOW * cell_size, 0.0, EDGE_CELLS * cell_size)


def _in_walls(face, nodes):
    """Return (row, column) of the nodes of a face's row that are in walls."""
    rows, columns = nodes.number.shape
    return [at for at in face.columns() if 0 <= at[0] < rows and 0 <= at[1] < columns and nodes.number[at] > 0]


def _lowest_crest(face, nodes):
    """Return the elevation [m] of the lowest crest at the nodes of a face's row that are in walls."""
    return min((float(nodes.crest[at]) for at in _in_walls(face, nodes)), default=-np.inf)


def _top_of(face, nodes, bed, cell_size):
    """Return the elevation [m] up to which the row of a face is held: below its barrier's edge, HELD_CELLS at least."""
    inside = _in_walls(face, nodes)
    edges = [max(edge_height(nodes.crest[at], bed[at], cell_size), HELD_CELLS * cell_size) for at in inside]
    return min((float(nodes.crest[at] - edge) for at, edge in zip(inside, edges, strict=True)), default=-np.inf)


def _is_smooth(face, nodes, bed, smooth, cell_size):
    """Return whether a row suits its face: nodes of one side behind it, free nodes before it, and enough height."""
    crest = _lowest_crest(face, nodes)
    for o, at in zip((-1, 0, 1), face.columns(), strict=True):
        if not all(0 <= k < n for k, n in zip(at, bed.shape, strict=True)) or not smooth[at]:
            return False
        if crest - bed[at] < LOWEST_FACE * cell_size:
            return False
        if nodes.share[at] > 0.0:
            return False
        before = _away(face, o)
        if abs(before) <= AT_RIM:
            continue
        inside = before < 0.0
        if not inside and nodes.number[at] > 0:
            return False
        if inside and nodes.number[at] == 0:
            return False
        if inside and np.dot(nodes.normal[at], face.normal) < SAME_SIDE:
            return False
    return True
