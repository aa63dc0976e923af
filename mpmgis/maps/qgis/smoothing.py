"""Smooth outlines of cells, without the stairs of the grid, for maps.

The rings of an outline are replaced by the midpoints of its cell edges, smoothed along the ring (binomial weights,
standard deviation about 2.5 cells). No point moves more than half a cell in that, so tips and thin strips stay in their
place. Each ring is then offset until it has the area of its cells again. A part that would cross itself or another one
is smoothed less, at last not at all, so that the result is always valid.
"""

import numpy as np
import shapely

PASSES = (12, 3, 0)  # [passes] of binomial smoothing, from the smoothest to the midpoints; then the cells themselves
FARTHEST = 0.5  # [cells] that smoothing moves a point
TOLERANCE = 0.04  # [cells] of the simplified line
KEPT_AREA = 0.004  # [1] largest relative change of a part's area
OFFSETS = 12  # [iterations] of the offset


def smooth_parts(lines: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """Smooth the rings of cells to polygons.

    Parameters
    ----------
    lines : linear rings[n]
        Rings along cell edges, in units of cells; of each polygon the shell first, then its holes.
    owner : int[n]
        Number of each ring's polygon, from 0, ascending.

    Returns
    -------
    shapely polygons[max(owner) + 1]
        Valid, disjoint up to points of contact, each with the area of its cells (within 0.4 %).
    """
    cells = shapely.polygons(lines, indices=owner)
    versions = [*(_smoothed(lines, owner, cells, passes) for passes in PASSES), cells]
    level = np.zeros(len(cells), dtype=int)
    while True:
        parts = np.array([versions[k][part] for part, k in enumerate(level)], dtype=object)
        rough = _unsound(parts, cells) & (level < len(versions) - 1)
        if not rough.any():
            return parts
        level[rough] += 1


def _smoothed(lines, owner, cells, passes):
    """Polygons after `passes`, simplified where that keeps their area."""
    points, ring = _midpoints(lines)
    before, after = _neighbours(ring)
    area = _ring_areas(*_corners(lines))
    points = _offset(_moved(points, before, after, passes), ring, before, after, area)
    whole = shapely.polygons(shapely.linearrings(points, indices=ring), indices=owner)
    simple = shapely.simplify(whole, TOLERANCE)
    change = np.abs(shapely.area(simple) - shapely.area(cells))
    return np.where(change <= KEPT_AREA * shapely.area(cells), simple, whole)


def _unsound(parts, cells):
    """bool[n]: parts that are invalid, have another area than their cells, or overlap another part."""
    wrong = ~shapely.is_valid(parts)
    wrong |= np.abs(shapely.area(parts) - shapely.area(cells)) > KEPT_AREA * shapely.area(cells)
    if wrong.any() or shapely.is_valid(shapely.multipolygons(parts)):
        return wrong
    first, second = shapely.STRtree(parts).query(parts, predicate="intersects")
    meeting = first != second
    wrong[first[meeting]] = True
    return wrong


def _corners(lines):
    """Corners float64[m, 2] of rings without their repeated end, and the ring of each, int[m]."""
    points, ring = shapely.get_coordinates(lines, return_index=True)
    last = np.append(np.diff(ring) > 0, True)
    return points[~last], ring[~last]


def _neighbours(ring):
    """Index of the point before and after each point, around its ring."""
    count = np.bincount(ring)
    start = np.cumsum(count) - count
    here = np.arange(len(ring))
    place = here - start[ring]
    return start[ring] + (place - 1) % count[ring], start[ring] + (place + 1) % count[ring]


def _midpoints(lines):
    """Midpoints float64[m, 2] of the cell edges along the rings, and the ring of each, int[m]."""
    corners, ring = _corners(lines)
    step = corners[_neighbours(ring)[1]] - corners
    count = np.rint(np.abs(step).sum(axis=1)).astype(int)
    along = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + 0.5
    first, edge = np.repeat(corners, count, axis=0), np.repeat(step / count[:, None], count, axis=0)
    return first + edge * along[:, None], np.repeat(ring, count)


def _moved(points, before, after, passes):
    smooth = points
    for _ in range(passes):
        smooth = 0.5 * smooth + 0.25 * (smooth[before] + smooth[after])
    move = smooth - points
    length = np.linalg.norm(move, axis=1, keepdims=True)
    return points + move * (FARTHEST / np.maximum(length, FARTHEST))


def _offset(points, ring, before, after, area):
    """The rings moved along their normals until each has its `area` [cells, signed]."""
    for _ in range(OFFSETS):
        chord = points[after] - points[before]
        normal = np.stack([chord[:, 1], -chord[:, 0]], axis=1)  # to the right: outwards of a positive ring
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        around = np.bincount(ring, np.linalg.norm(points[after] - points, axis=1))
        gap = (area - _ring_areas(points, ring)) / np.maximum(around, 1e-12)
        points = points + normal * gap[ring, None]
    return points


def _ring_areas(points, ring):
    """float64[rings]: signed area (Gauss)."""
    origin = points[np.searchsorted(ring, np.arange(ring[-1] + 1))][ring]
    x, y = (points - origin).T
    after = _neighbours(ring)[1]
    return 0.5 * np.bincount(ring, x * y[after] - x[after] * y)
