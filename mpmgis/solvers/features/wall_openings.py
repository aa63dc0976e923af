"""Openings in barriers: the open share of a node's spline, and the direction of flow through the opening.

A wall that is thinner than three cells is held by nodes up to a cell and a half from its middle. Beyond its end, and in
an opening narrower than that, the same nodes also serve the flow that passes. The share of such a node is the part of
its quadratic B-spline along the wall that is not in front of a wall. Summed over the nodes of a row, the shares times
the cell size are the width of the opening within 3 %, whatever its place and its direction on the grid.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
import shapely.affinity

SPLINE = 1.5  # [cells] half width of the quadratic B-spline
REGION = 3.0  # [cells] radius for the direction of the walls; twice the thickness of the wall if that is more
WIDER = (1.0, 1.7, 2.7, 4.0)  # [1] factors of that radius, tried in turn until the walls there have a direction
LONG = 0.4  # [1] least over largest second moment of the walls in a region, below which they have a direction
SIGHT = 3.5  # [cells] radius within which both sides of a wall must be connected to form an opening, plus DEEPER
DEEPER = 1.5  # [1] times the thickness of the wall
LEAST_SHARE = 1e-6  # [1] a node with a smaller open share is closed
MOST_SHARE = 0.995  # [1] a node with a larger open share is free
BEFORE = 1.08  # [1] limit over share of a node before an opening in a thin wall
WITHIN = 2.5  # [1] limit over share of a node in an opening
LONGER = 0.04  # [cells-1] increase of BEFORE for each cell of the wall's thickness
LONGEST = 5.0  # [cells] thickness of the wall up to which BEFORE increases
DEEP = 0.3  # [cells] depth behind the wall's faces from which a node counts as in the opening


class Opening(NamedTuple):
    """Openings at the nodes near them, arrays [n].

    Parameters
    ----------
    share : float64[n] [1]
        Of the node's spline that is open; 0 where the wall is closed.
    limit : float64[n] [1]
        Largest discharge that passes, over the critical discharge of a metre of opening. Before the opening it is a
        tenth more than the share, which the held nodes beside it take from the flow, and up to a quarter more where the
        way through is long. In the opening, which holds only what has passed there, it is WITHIN times the share.
    normal : float64[n, 2] [1]
        Unit vector (east, north) along which the flow passes.
    side : float64[n]
        -1, 0 or 1: direction of the opening from the node along (normal north, -normal east).
    """

    share: np.ndarray
    limit: np.ndarray
    normal: np.ndarray
    side: np.ndarray


def openings_at(
    places: np.ndarray,
    thickness: np.ndarray,
    footprints: Sequence[shapely.Geometry],
    domain: tuple[float, float, float, float],
    cell_size: float,
    widened: float = 0.0,
) -> Opening:
    """Compute the Opening of nodes near walls.

    Parameters
    ----------
    places : float64[n, 2] [m]
    thickness : float64[n] [m]
        Of the wall near each.
    footprints : sequence of Polygon or MultiPolygon
        Of all walls, map metres.
    domain : (west, south, east, north) [m]
        Walls are mirrored at its edges, as the flow is.
    cell_size : float [m]
    widened : float, optional [cells]
        Length by which an opening is taken to be wider on each side. The largest discharge stays that of its own width.
    """
    n = len(places)
    answer = Opening(np.zeros(n), np.zeros(n), np.zeros((n, 2)), np.zeros(n))
    if n == 0:
        return answer
    thick = float(thickness.max())
    reach = max(SIGHT * cell_size + DEEPER * thick, REGION * cell_size, 2.0 * thick)
    walls = _with_mirror_images(shapely.union_all(footprints), domain, reach)
    if walls.is_empty:
        return answer
    shapely.prepare(walls)
    ground = shapely.box(*domain).buffer(SPLINE * cell_size, join_style="mitre")
    points = shapely.points(places)
    vertices = shapely.STRtree(shapely.points(shapely.get_coordinates(walls)))
    near = np.unique(vertices.query(points, "dwithin", 2.0 * SPLINE * cell_size)[0])
    normal = wall_normals(walls, points[near], np.maximum(REGION * cell_size, 2.0 * thickness[near]))
    near, normal = near[~np.isnan(normal[:, 0])], normal[~np.isnan(normal[:, 0])]
    before = BEFORE + LONGER * np.minimum(thickness / cell_size, LONGEST)
    for k, across in zip(near, normal, strict=True):
        share, limit, change, within = _open_share(walls, ground, points[k], across, thickness[k], cell_size, widened)
        if share > LEAST_SHARE:
            answer.share[k], answer.limit[k] = share, limit * (WITHIN if within else before[k])
            answer.normal[k], answer.side[k] = across, np.sign(round(change, 9))
    return answer


def narrow_openings(footprints: Sequence[shapely.Geometry], narrower: float) -> list[tuple[float, float, float]]:
    """Find the openings between walls that are narrower than a limit.

    Parameters
    ----------
    footprints : sequence of Polygon or MultiPolygon
        Of the walls, map metres.
    narrower : float [m]
        The limit of the width.

    Returns
    -------
    list of (float, float, float)
        East and north [m] of the middle, width [m]; the narrowest first.
    """
    walls = shapely.union_all(footprints)
    radius = 0.5 * narrower
    closed = walls.buffer(radius).buffer(-radius * (1.0 - 1e-6))
    found = []
    for part in shapely.get_parts(closed.difference(walls.buffer(1e-6 * narrower))):
        sides = shapely.get_parts(shapely.line_merge(part.boundary.intersection(walls.buffer(1e-4 * narrower))))
        sides = [side for side in sides if side.length > 1e-2 * narrower]
        if len(sides) < 2:
            continue  # the fillet of a corner
        apart = min(
            (shapely.shortest_line(one, other) for k, one in enumerate(sides) for other in sides[k + 1 :]),
            key=shapely.length,
        )
        if 1e-3 * narrower < apart.length < narrower * (1.0 - 1e-6):
            middle = apart.centroid
            found.append((middle.x, middle.y, apart.length))
    return sorted(found, key=lambda opening: opening[2])


def _with_mirror_images(walls, domain, reach):
    """`walls` within `domain`, with their mirror images at its edges up to `reach` [m] beyond them.

    Images are mirrored again where the domain is narrower than `reach`: a wall across a narrow channel goes on.
    """
    walls = _areas(shapely.intersection(walls, shapely.box(*domain)))
    for axis in (0, 1):
        low, high = domain[axis], domain[axis + 2]
        first, last = low, high
        while first > low - reach or last < high + reach:
            images = [_image(walls, axis, edge, reach) for edge in (first, last)]
            walls = shapely.union_all([walls, *images])
            first, last = 2.0 * first - last, 2.0 * last - first
    return walls


def _image(walls, axis, edge, reach):
    """Mirror image at `edge` [m] (west or east for `axis` 0, else south or north) of shapes within `reach` of it."""
    if walls.is_empty:
        return walls
    strip = list(walls.bounds)
    strip[axis], strip[axis + 2] = edge - reach, edge + reach
    beside = _areas(shapely.intersection(walls, shapely.box(*strip)))
    factors, origin = ((-1.0, 1.0), (edge, 0.0)) if axis == 0 else ((1.0, -1.0), (0.0, edge))
    return shapely.affinity.scale(beside, *factors, origin=origin)


def _areas(shape):
    """Return the polygons of `shape`, without the lines and points where shapes touch."""
    parts = shapely.get_parts(shape)
    return shapely.union_all(parts[shapely.get_dimensions(parts) == 2])


def wall_normals(walls: shapely.Geometry, points: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Compute the unit normals of the direction in which walls run about each point.

    The direction is the axis of the largest second moment of the walls' area around the point. It is taken in the
    smallest region in which the walls have a clear direction (LONG); the radii of the regions are WIDER times `radius`.

    Parameters
    ----------
    walls : MultiPolygon
    points : shapely.Point[n]
    radius : float64[n] [m]
        Of the first region.

    Returns
    -------
    float64[n, 2]
        East and north; NaN where the walls have no direction.
    """
    normal = np.full((len(points), 2), np.nan)
    for wider in WIDER:
        open_yet = np.flatnonzero(np.isnan(normal[:, 0]))
        if open_yet.size == 0:
            break
        pieces = shapely.intersection(walls, shapely.buffer(points[open_yet], wider * radius[open_yet], quad_segs=8))
        xx, xy, yy = _second_moments(pieces, shapely.get_coordinates(points[open_yet]))
        mean, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
        long = mean - half < LONG * (mean + half)
        angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
        normal[open_yet[long]] = np.column_stack([-np.sin(angle), np.cos(angle)])[long]
    return normal


def _second_moments(shapes, origins):
    """Compute the central second moments of area (xx, xy, yy) of polygonal shapes, with coordinates from `origins`."""
    polygons, owner = shapely.get_parts(shapes, return_index=True)
    flat = shapely.get_dimensions(polygons) == 2
    rings, of = shapely.get_rings(polygons[flat], return_index=True)
    owner = owner[flat][of]
    outer = np.r_[True, of[1:] != of[:-1]][: len(rings)]
    places, ring = shapely.get_coordinates(rings, return_index=True)
    places -= origins[owner][ring]
    follows = ring[1:] == ring[:-1]
    (px, py), (nx, ny), ring = places[:-1][follows].T, places[1:][follows].T, ring[1:][follows]
    cross = px * ny - nx * py
    sign = np.sign(np.bincount(ring, cross, len(rings))) * np.where(outer, 1.0, -1.0)
    qx, qy = px + nx, py + ny

    def total(values, divisor):
        return np.bincount(owner, sign * np.bincount(ring, cross * values, len(rings)), len(shapes)) / divisor

    area, x, y = total(1.0, 2.0), total(qx, 6.0), total(qy, 6.0)
    xx, yy = total(qx**2 - px * nx, 12.0), total(qy**2 - py * ny, 12.0)
    xy = total(qx * qy + px * py + nx * ny, 24.0)
    area = np.maximum(area, 1e-300)
    return xx / area - (x / area) ** 2, xy / area - x * y / area**2, yy / area - (y / area) ** 2


def _open_share(walls, ground, point, across, thickness, cell_size, widened):
    """Compute the openings as the node at `point` sees them.

    Returns (share of its spline that is open, the same averaged over the widening, change of the share along the wall,
    whether the node is in the opening).
    """
    x, y = point.x, point.y
    along = np.array([across[1], -across[0]])
    here = np.array([x, y])
    nearest = shapely.get_coordinates(shapely.shortest_line(walls.boundary, point))[0] - here
    level, reach = nearest @ across, (SPLINE + 2.0 * widened) * cell_size
    depth = SPLINE * cell_size
    low, high = min(level - depth, -0.1 * cell_size), max(level + depth, 0.1 * cell_size)
    corners = [here + a * along + b * across for a, b in ((-reach, low), (reach, low), (reach, high), (-reach, high))]
    parts = shapely.get_parts(shapely.intersection(walls, shapely.Polygon(corners)))
    shadows, within = [], False
    for part in parts[~shapely.is_empty(parts)]:
        offsets, levels = ((shapely.get_coordinates(part) - here) @ axis for axis in (along, across))
        shadows.append((offsets.min(), offsets.max()))
        within |= levels.min() + DEEP * cell_size <= 0.0 <= levels.max() - DEEP * cell_size
    share = limit = change = 0.0
    sides = None
    for a, b in _gaps(shadows, reach, 1e-9 * cell_size):
        if sides is None:
            radius = SIGHT * cell_size + DEEPER * thickness
            sides = _Sides(walls, ground, here, across, level, radius, 1e-3 * cell_size)
        if sides.connected_by(here + 0.5 * (a + b) * along + level * across):
            own = b - a
            a = a / cell_size - (widened if a > -reach else 0.0)
            b = b / cell_size + (widened if b < reach else 0.0)
            share += _below(b) - _below(a)
            limit += (_below(b) - _below(a)) * own / ((b - a) * cell_size)
            change += spline(a) - spline(b)
    return min(share, 1.0), limit, change, within


def _gaps(shadows, reach, least):
    """Yield the intervals of [-reach, reach] that no shadow covers."""
    end = -reach
    for a, b in sorted(shadows):
        if a - end > least:
            yield end, a
        end = max(end, b)
    if reach - end > least:
        yield end, reach


class _Sides:
    """Parts of the free ground around a node that walls divide, and those in which its own two sides lie."""

    def __init__(self, walls, ground, here, across, level, radius, step):
        window = shapely.Point(here).buffer(radius).intersection(ground)
        self.parts = shapely.get_parts(window.difference(walls))
        self.own = set()
        line = shapely.LineString([here - radius * across, here + radius * across])
        blocked = shapely.get_parts(line.intersection(walls))
        blocked = [part for part in blocked if part.length > 0.0]
        if not blocked:
            self.own.add(self._part_of(here))
            return
        wall = here + level * across
        crossed = min(blocked, key=lambda part: part.distance(shapely.Point(wall)))
        ends = (shapely.get_coordinates(crossed) - here) @ across
        for end, sign in ((ends.min(), -1.0), (ends.max(), 1.0)):
            if abs(end) < 0.99 * radius:
                self.own.add(self._part_of(here + (end + sign * step) * across))

    def _part_of(self, place):
        point = shapely.Point(place)
        return int(np.argmin([part.distance(point) for part in self.parts])) if len(self.parts) else -1

    def connected_by(self, place: np.ndarray) -> bool:
        """Return whether the free ground at `place` [m] is connected with both sides of the wall at the node.

        Parameters
        ----------
        place : float64[2] [m]
        """
        return len(self.own) <= 1 and self._part_of(place) in (self.own or {self._part_of(place)})


def spline(s: float) -> float:
    """Compute the quadratic B-spline [1].

    Parameters
    ----------
    s : float [cells]
        Distance from its middle.
    """
    s = abs(s)
    return max(0.75 - s * s, 0.0) if s < 0.5 else 0.5 * max(1.5 - s, 0.0) ** 2


def _below(s):
    """Compute the integral of the quadratic B-spline up to `s` cells from its middle."""
    s = min(max(s, -SPLINE), SPLINE)
    rest = (SPLINE - abs(s)) ** 3 / 6.0 if abs(s) > 0.5 else 0.5 - (0.75 * abs(s) - abs(s) ** 3 / 3.0)
    return rest if s < 0 else 1.0 - rest
