"""Find the grid nodes inside walls, and the normal of the nearest side of the wall at each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, radians

import numpy as np
import shapely
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from .wall_openings import MOST_SHARE, SPLINE, openings_at, spline

PARTS = 4  # parts along each axis into which a cell at a wall is divided, to measure how much of it the wall fills
NEAR_RIM = 3  # [cells] distance from the rim of a wall within which the wall can fill a part of a cell
FACE_CELLS = 0.5  # [cells] depth of the nodes that only stop flow into the wall
CORE_CELLS = 1.0  # [cells] depth of those behind, without flow; both sides of a wall have one
WIDENED_IN_3D = 0.75  # [cells] length by which nodes are open beyond each side of an opening in 3D
TOUCHING = 1e-6  # [m] gap between two walls up to which they are one
SMALLEST_PART = 0.05  # [1] share of a wall's area; smaller parts that others do not cover do not set its thickness
CRACK = 1e3  # [1] times TOUCHING: a union with cracks has a rim that is longer by more than this
AT_RIM = 1e-9  # [1] share of a wall's length; a node nearer to its rim is on it
SAME_SIDES = 1e-6  # [1] length of the sum of the normals around a place, up to which they cancel
SAME = 1.0 - 1e-6  # [1] cosine between two normals of one side
CORNER = cos(radians(30.0))  # [1] cosine between the normals of neighbours below which they form a corner


@dataclass(frozen=True)
class Wall:
    """One barrier in the terrain's CRS.

    Parameters
    ----------
    name : str
    footprint : Polygon or MultiPolygon
        Map metres.
    height : float or None [m]
        Of the crest above the terrain, or
    crest : float or None [m]
        its elevation.
    mu : float [1]
        Coulomb friction of the flow along the wall.
    """

    name: str
    footprint: shapely.Geometry
    height: float | None = None
    crest: float | None = None
    mu: float = 0.0


@dataclass(frozen=True)
class WallNodes:
    """Walls at the nodes of a grid, arrays [rows, columns] (zeros without a wall).

    Parameters
    ----------
    number : int[rows, columns]
        1 + index of the wall; 0 where there is none.
    normal : float64[rows, columns, 2] [1]
        Outward unit normal (east, north) of the wall's nearest side.
    crest : float64[rows, columns] [m]
        Elevation of the crest.
    mu : float64[rows, columns] [1]
        Coulomb friction along the wall.
    core : bool[rows, columns]
        Nodes without flow below the crest.
    corner : bool[rows, columns]
        Nodes of the core where the wall has a corner.
    weight : float64[rows, columns] [m-1]
        Weight of the flux at the node in the flux over the wall: half a hat behind each of its two faces.
    depth : float64[rows, columns] [m]
        Behind the wall's nearest side, as the solver places it.
    share : float64[rows, columns] [1]
        Of the node's spline that is open: beyond a wall's end and in narrow openings (`wall_openings`). The normal
        there is the way through the opening.
    limit : float64[rows, columns] [1]
        Largest discharge that passes there, over the critical discharge of a metre of opening.
    side : float64[rows, columns]
        -1, 0 or 1: direction of the opening from the node along (normal north, -normal east).
    """

    number: np.ndarray
    normal: np.ndarray
    crest: np.ndarray
    mu: np.ndarray
    core: np.ndarray
    corner: np.ndarray
    weight: np.ndarray
    depth: np.ndarray
    share: np.ndarray
    limit: np.ndarray
    side: np.ndarray


def half_thickness(footprint: shapely.Geometry) -> float:
    """Compute half the thickness [m] of a long shape: its area over its perimeter.

    Parameters
    ----------
    footprint : Polygon or MultiPolygon
    """
    return footprint.area / footprint.length


def margin_in_3d(half: float, cell_size: float) -> float:
    """Compute how far beyond its footprint nodes belong to a wall in 3D [m].

    Nodes are added up to a thickness of three cells only (compare `margin_of`): in 3D the flow rests on nodes in front
    of the wall.

    Parameters
    ----------
    half : float [m]
        The `half_thickness` of the wall.
    cell_size : float [m]
    """
    return max((FACE_CELLS + CORE_CELLS) * cell_size - half, 0.0)


def margin_of(half: float, cell_size: float) -> float:
    """Compute how far beyond its footprint nodes belong to a wall on the depth-averaged grid [m].

    A cell at least, so that the flow comes to rest near the footprint's edge and not a cell behind it; more where the
    wall is thinner than three cells in all, the least that stops a flow on this grid whatever way the wall runs.

    Parameters
    ----------
    half : float [m]
        The `half_thickness` of the wall.
    cell_size : float [m]
    """
    return max((FACE_CELLS + CORE_CELLS) * cell_size - half, cell_size)


def wall_nodes(
    walls: Sequence[Wall],
    x: np.ndarray,
    y: np.ndarray,
    bed: np.ndarray,
    cell_size: float,
    margin_of: Callable[[float, float], float] = margin_of,
    widened: float = 0.0,
) -> WallNodes:
    """Find the nodes inside walls, with the values of the walls there.

    Parameters
    ----------
    walls : sequence of Wall
    x : float64[columns] [m]
        East of the nodes.
    y : float64[rows] [m]
        North of the nodes.
    bed : float64[rows, columns] [m]
    cell_size : float [m]
    margin_of : callable, optional
        Function of half the thickness of a wall [m] and `cell_size` that returns how far the wall reaches beyond its
        footprint [m].
    widened : float, optional [cells]
        Length by which openings are wider on each side, see `wall_openings.openings_at`.
    """
    number, depth = np.zeros(bed.shape, int), np.full(bed.shape, -np.inf)
    nearest, behind = np.zeros(bed.shape, int), np.full(bed.shape, -np.inf)
    owned = np.full(bed.shape, -np.inf)  # [m] depth in the wall that has the node
    normal, crest, mu, weight = np.zeros((*bed.shape, 2)), np.zeros(bed.shape), np.zeros(bed.shape), np.zeros(bed.shape)
    shapes, halves = zip(*joined_footprints(walls), strict=True) if walls else ((), ())
    for k, (wall, joined, half) in enumerate(zip(walls, shapes, halves, strict=True), 1):
        margin = margin_of(half, cell_size)
        around = max(margin, SPLINE * cell_size)
        window = _window(wall.footprint.buffer(around).bounds, x, y)
        at, deepest = (x[window[1]], y[window[0]]), (FACE_CELLS + CORE_CELLS + 1.0) * cell_size
        here, away = _depth(joined, *at, -around, deepest)
        own = here if joined is wall.footprint else _depth(wall.footprint, *at)[0]
        near = (own >= -around) & (own > behind[window])
        nearest[window][near], behind[window][near] = k, own[near]
        mine = own + margin >= np.maximum(owned[window], 0.0)
        mine &= own + margin > owned[window]  # where walls overlap a node belongs to the one it is deepest in
        here, owned[window][mine] = here + margin, (own + margin)[mine]
        number[window][mine], depth[window][mine] = k, here[mine]
        normal[window][mine], mu[window][mine] = away[mine], wall.mu
        crest[window][mine] = _crest(wall, bed[window][mine])
        places = np.stack(np.meshgrid(*at), axis=-1)[mine]
        enough = 2.0 * (FACE_CELLS + CORE_CELLS + 1.0) * cell_size - 2.0 * margin
        thick = _thickness(joined, places, here[mine] - margin, away[mine], enough) + 2.0 * margin
        weight[window][mine] = _weight(here[mine], thick, cell_size)
    turns, core = _turns(normal, number), depth >= FACE_CELLS * cell_size
    depth = np.where(number > 0, depth, 0.0)
    share, limit, side = np.zeros((3, *bed.shape))
    nodes = WallNodes(number, normal, crest, mu, core, core & turns, weight, depth, share, limit, side)
    _open(nodes, walls, halves, nearest, x, y, bed, cell_size, widened)
    return nodes


def filled_at(
    walls: Sequence[Wall],
    nodes: WallNodes,
    x: np.ndarray,
    y: np.ndarray,
    cell_size: float,
    margin_of: Callable[[float, float], float],
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the part of each node's spline in the plane that walls fill, and the crest of these walls.

    A cell around a node is divided into PARTS x PARTS. Each part counts by how far its centre lies behind a side, which
    is exact for sides along the grid.

    Parameters
    ----------
    walls : sequence of Wall
    nodes : WallNodes
        The result of `wall_nodes` for these walls.
    x : float64[columns] [m]
    y : float64[rows] [m]
    cell_size : float [m]
    margin_of : callable
        That of `wall_nodes`.

    Returns
    -------
    (float64[rows, columns] [1], float64[rows, columns] [m])
        The crest counts where the part is not 0.
    """
    inside = nodes.number > 0
    rim = ndimage.binary_dilation(inside, iterations=NEAR_RIM)
    rim &= ~ndimage.binary_erosion(inside, iterations=NEAR_RIM, border_value=True)
    rows, columns = np.nonzero(rim)
    offsets = ((np.arange(PARTS) + 0.5) / PARTS - 0.5) * cell_size
    places = np.empty((len(rows), PARTS, PARTS, 2))
    places[..., 0] = (x[columns, None] + offsets)[:, None, :]
    places[..., 1] = (y[rows, None] + offsets)[:, :, None]
    behind, margins = np.full(places.shape[:3], -np.inf), {}
    for joined, half in joined_footprints(walls):  # pieces of one wall have one shape
        margins[joined] = max(margin_of(half, cell_size), margins.get(joined, 0.0))
    for joined, margin in margins.items():
        west, south, east, north = joined.buffer(margin + cell_size).bounds
        near = ((places >= (west, south)) & (places <= (east, north))).all(axis=-1)
        points = shapely.points(places[near])
        away = shapely.distance(joined.boundary, points)
        depth = np.where(shapely.contains(joined, points), away, -away) + margin
        behind[near] = np.maximum(behind[near], depth)
    cells = np.zeros((*inside.shape, PARTS, PARTS))
    cells[inside] = 1.0
    cells[rows, columns] = np.clip(0.5 + behind * PARTS / cell_size, 0.0, 1.0)
    cells, weights = np.pad(cells, ((1, 1), (1, 1), (0, 0), (0, 0)), mode="edge"), _spline_weights()
    filled = np.zeros(inside.shape)
    for j in range(3):
        for i in range(3):
            beside = cells[j : j + inside.shape[0], i : i + inside.shape[1]]
            filled += np.einsum("jiab,a,b->ji", beside, weights[j], weights[i])
    row, column = ndimage.distance_transform_edt(~inside, return_distances=False, return_indices=True)
    return filled, nodes.crest[row, column]


def _spline_weights():
    """Compute the share of the parts of the cells before, at and after a node in its spline, float64[3, PARTS]."""
    parts = (np.arange(PARTS) + 0.5) / PARTS - 0.5
    weights = np.array([[spline(node + part) for part in parts] for node in (-1.0, 0.0, 1.0)])
    return weights / weights.sum()


def _open(nodes, walls, halves, nearest, x, y, bed, cell_size, widened):
    """Set openings of `nodes` (WallNodes) in place; `nearest` is 1 + the number of the wall in the spline's support.

    `halves` are half the thicknesses of `walls` [m].
    """
    rows, columns = np.nonzero(nearest)
    thickness = 2.0 * np.array(halves)[nearest[rows, columns] - 1]
    places, domain = np.column_stack([x[columns], y[rows]]), (x[1], y[1], x[-2], y[-2])
    opening = openings_at(places, thickness, [wall.footprint for wall in walls], domain, cell_size, widened)
    opened = opening.share > 0.0
    free = opening.share > MOST_SHARE
    nodes.number[rows[free], columns[free]] = 0
    partly = opened & ~free
    at = rows[partly], columns[partly]
    for entry, values in (
        (nodes.share, opening.share),
        (nodes.limit, opening.limit),
        (nodes.side, opening.side),
        (nodes.normal, opening.normal),
    ):
        entry[at] = values[partly]
    for j, i in zip(*at, strict=True):
        wall = walls[nearest[j, i] - 1]
        nodes.number[j, i], nodes.mu[j, i] = nearest[j, i], wall.mu
        nodes.crest[j, i] = _crest(wall, bed[j, i])
    beside = np.zeros(nodes.number.shape, bool)
    beside[rows[opened], columns[opened]] = True
    slips = ndimage.binary_dilation(beside, np.ones((3, 3)))  # flow that turns into an opening
    nodes.corner[slips] = False
    nodes.core[nodes.number == 0] = False


def _crest(wall, bed):
    """Return the elevation [m] of the crest of `wall` over ground at `bed` [m]."""
    return wall.crest if wall.crest is not None else bed + wall.height


def _weight(depth, thickness, cell_size):
    """Weight [m-1] of nodes `depth` [m] behind the face of a wall that is `thickness` [m] thick there.

    Half a hat behind each of the two faces, a cell wide to either side of its core. Over the nodes across a wall the
    weights sum to 1 over the cell size, wherever the nodes lie and however thick the wall is.
    """
    middle = (FACE_CELLS + CORE_CELLS) * cell_size
    hats = [np.maximum(1.0 - np.abs(behind - middle) / cell_size, 0.0) for behind in (depth, thickness - depth)]
    return (hats[0] + hats[1]) / (2.0 * cell_size)


def _thickness(footprint, places, depth, normal, most):
    """Thickness [m] of a wall across its nearest side at `places` [n, 2]; infinite where it is more than `most` [m].

    `depth` [n] [m] is that of the places in the footprint, `normal` [n, 2] of the nearest side.
    """
    if most <= 0.0 or len(places) == 0:
        return np.full(len(places), np.inf)
    face, near = places + depth[:, None] * normal, AT_RIM * (1.0 + footprint.length)
    ways = shapely.linestrings(np.stack([face - near * normal, face - most * normal], axis=1))
    far = shapely.distance(shapely.points(face), shapely.intersection(ways, footprint.boundary))
    return np.where(np.isnan(far), np.inf, far)


def _window(bounds, x, y):
    """Return (rows, columns) as slices of the nodes within `bounds` (west, south, east, north)."""
    west, south, east, north = bounds
    columns, rows = np.searchsorted(x, (west, east)), np.searchsorted(y, (south, north))
    return slice(rows[0], rows[1] + 1), slice(columns[0], columns[1] + 1)


def joined_footprints(walls: Sequence[Wall]) -> list[tuple[shapely.Geometry, float]]:
    """Join the footprint of each wall with all that touch or overlap it, directly or through others.

    The edge at which two walls touch is no side of a wall. Pieces of a wall are as thick as the whole, but no thicker
    than they themselves are in the middle of what others do not cover: a thin wall beside or through a thick one stays
    thin.

    Parameters
    ----------
    walls : sequence of Wall

    Returns
    -------
    list of (Polygon or MultiPolygon, float [m])
        Joined footprint and half thickness of each wall.
    """
    shapes = [wall.footprint for wall in walls]
    one, other = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=TOUCHING)
    touch = coo_array((np.ones(len(one)), (one, other)), (len(shapes), len(shapes)))
    groups = connected_components(touch, directed=False)[1] if shapes else np.zeros(0, int)
    joined = [(shape, half_thickness(shape)) for shape in shapes]
    for group in np.flatnonzero(np.bincount(groups) > 1):
        members = np.flatnonzero(groups == group)
        whole = _union([shapes[k] for k in members])
        for k in members:
            others = shapely.union_all([shapes[m] for m in members if m != k])
            parts = shapely.get_parts(shapely.difference(shapes[k], others))
            parts = parts[shapely.area(parts) > SMALLEST_PART * shapes[k].area]
            joined[k] = whole, min([half_thickness(whole), *(_half_of(part, others, whole) for part in parts)])
    return joined


def _union(shapes):
    """Union of shapes that touch or overlap, without cracks between them; exact where they fit exactly."""
    exact, closed = shapely.union_all(shapes), shapely.union_all(shapes, grid_size=TOUCHING)
    return closed if exact.length > closed.length + CRACK * TOUCHING else exact


def _half_of(part, others, whole):
    """Half the thickness [m] of `part` of a wall that `others` do not cover, in the `whole`.

    The depth of its centre, or half the longest side at which it meets others, if it is a short end.
    """
    near = 2.0 * TOUCHING
    meets = shapely.line_merge(shapely.intersection(part.boundary, others.buffer(near)))
    sides = shapely.length(shapely.get_parts(meets)) - 2.0 * near
    centre = shapely.get_point(shapely.maximum_inscribed_circle(part), 0)
    return max(float(whole.boundary.distance(centre)), 0.5 * float(sides.max(initial=0.0)))


def _depth(footprint, x, y, least=np.inf, most=-np.inf):
    """Compute the depth in the footprint [m], negative outside, and the outward unit normal of its nearest side.

    Where two sides are equally near, at corners and on their bisectors, the normal is between theirs. It is searched
    for nodes between the depths `least` and `most` [m].
    """
    points = shapely.points(*np.meshgrid(x, y))
    if points.size == 0:
        return np.zeros(points.shape), np.zeros((*points.shape, 2))
    boundary = footprint.boundary
    away = _way_from(boundary, points)
    distance = np.hypot(away[..., 0], away[..., 1])
    outwards = np.where(shapely.contains(footprint, points), -1.0, 1.0)
    at_rim = distance < AT_RIM * (1.0 + footprint.length)
    normal = np.divide(
        outwards[..., None] * away, distance[..., None], out=np.zeros_like(away), where=~at_rim[..., None]
    )
    depth = -outwards * distance
    near = at_rim | ((depth >= least) & (depth <= most))
    if near.any():
        found = _mean_normal(footprint, boundary, shapely.get_coordinates(points[near]))
        turned = ((found * normal[near]).sum(axis=-1) < SAME) & found.any(axis=-1)
        normal[near] = np.where(turned[:, None], found, normal[near])
    return depth, normal


def _way_from(boundary, points):
    """Compute the way from the nearest point of `boundary` to each of `points`, float64[..., 2] [m]."""
    ends = shapely.get_coordinates(shapely.shortest_line(boundary, points)).reshape(*points.shape, 2, 2)
    return ends[..., 1, :] - ends[..., 0, :]


def _mean_normal(footprint, boundary, places):
    """Compute the outward unit normal at `places` [n, 2] [m] as the mean of those at eight points close around each.

    Their directions are symmetric about the axes and the diagonals, and none lies on these, so that two sides that are
    equally near have equal parts. It is 0 in the middle between opposite sides.
    """
    reach, angles = 1e-4 * half_thickness(footprint), np.pi * (np.arange(8) / 4.0 + 0.125)
    around = places[:, None, :] + reach * np.column_stack([np.cos(angles), np.sin(angles)])
    points = shapely.points(around)
    away = _way_from(boundary, points) * np.where(shapely.contains(footprint, points), -1.0, 1.0)[..., None]
    total = (away / np.maximum(np.hypot(away[..., 0], away[..., 1]), 1e-300)[..., None]).sum(axis=1)
    size = np.hypot(total[:, 0], total[:, 1])[:, None]
    return np.where(size > SAME_SIDES, total / np.maximum(size, SAME_SIDES), 0.0)


def _turns(normal, number):
    """Return the nodes whose neighbours have another normal: corners, ends, and junctions of walls."""
    turns = np.zeros(number.shape, bool)
    for axis in (0, 1):
        for step in (1, -1):
            beside, known = np.roll(normal, step, axis), np.roll(number, step, axis) > 0
            edge = [slice(None)] * 2
            edge[axis] = 0 if step == 1 else -1
            known[tuple(edge)] = False
            along = np.abs((normal * beside).sum(axis=-1))
            turns |= (number > 0) & known & (along < CORNER)
    return turns
