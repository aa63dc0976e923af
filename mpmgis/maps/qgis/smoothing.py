"""Smooth outlines of cells, without the stairs of the grid, for maps.

The rings of an outline are replaced by the midpoints of its cell edges, smoothed along the ring (binomial weights,
standard deviation about 2.5 cells). No point moves more than half a cell in that, so tips and thin strips stay in their
place. Each ring is then offset until it has the area of its cells again. A part that would cross itself or another one
is smoothed less, at last not at all, so that the result is always valid.
"""

import numpy as np
import shapely

from ...compiled.jit import jit

PASSES = (12, 3, 0)  # [passes] of binomial smoothing, from the smoothest to the midpoints; then the cells themselves
FARTHEST = 0.5  # [cells] that smoothing moves a point
TOLERANCE = 0.04  # [cells] of the simplified line
KEPT_AREA = 0.004  # [1] largest relative change of a part's area
OFFSETS = 12  # [iterations] of the offset
SHORTEST = 1e-12  # [cells] a shorter length counts as this in a quotient


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
    parts, level, rough = cells.copy(), np.zeros(len(cells), int), np.ones(len(cells), bool)
    while rough.any():
        for k, passes in enumerate(PASSES):
            chosen = rough & (level == k)
            if chosen.any():
                parts[chosen] = _smoothed(lines[chosen[owner]], owner[chosen[owner]], cells[chosen], passes)
        chosen = rough & (level == len(PASSES))
        parts[chosen] = cells[chosen]
        rough = _unsound(parts, cells) & (level < len(PASSES))
        level[rough] += 1
    return parts


def _smoothed(lines, owner, cells, passes):
    """Polygons after `passes`, simplified where that keeps their area; `owner` numbers the polygons, ascending."""
    points, start = _smooth_points(lines, passes)
    rings = shapely.linearrings(points, indices=np.repeat(np.arange(len(lines)), np.diff(start)))
    whole = shapely.polygons(rings, indices=np.unique(owner, return_inverse=True)[1])
    simple = shapely.simplify(whole, TOLERANCE)
    change = np.abs(shapely.area(simple) - shapely.area(cells))
    return np.where(change <= KEPT_AREA * shapely.area(cells), simple, whole)


def _unsound(parts, cells):
    """bool[n]: parts that are invalid, have another area than their cells, or overlap another part."""
    wrong = np.abs(shapely.area(parts) - shapely.area(cells)) > KEPT_AREA * shapely.area(cells)
    if shapely.is_valid(shapely.multipolygons(parts)):
        return wrong  # then each part is valid too
    wrong |= ~shapely.is_valid(parts) if len(parts) > 1 else True
    if wrong.any():
        return wrong
    first, second = shapely.STRtree(parts).query(parts, predicate="intersects")
    meeting = first != second
    wrong[first[meeting]] = True
    return wrong


def _smooth_points(lines, passes):
    """Points float64[m, 2] of the smoothed rings, one on each side of a cell; first of each ring, int64[n + 1]."""
    corners, ring = shapely.get_coordinates(lines, return_index=True)
    first = np.searchsorted(ring, np.arange(len(lines) + 1))
    start = np.empty(len(lines) + 1, np.int64)
    points, before = np.empty((2, count_sides(corners, first, start), 2))
    smooth_rings(corners, first, start, passes, points, before)
    return points, start


@jit
def count_sides(corners: np.ndarray, first: np.ndarray, start: np.ndarray) -> int:
    """Count the sides of cells along each ring.

    Parameters
    ----------
    corners : float64[corners, 2] [cells]
        Of all rings along sides of cells; the last corner of a ring is its first again.
    first : int64[rings + 1]
        Number of the first corner of each ring.
    start : int64[rings + 1], out
        Sides in the rings before each ring.

    Returns
    -------
    int
        Sides in all rings.
    """
    start[0] = 0
    for r in range(first.shape[0] - 1):
        sides = 0.0
        for c in range(first[r], first[r + 1] - 1):
            sides += abs(corners[c + 1, 0] - corners[c, 0]) + abs(corners[c + 1, 1] - corners[c, 1])
        start[r + 1] = start[r] + int(sides + 0.5)
    return start[start.shape[0] - 1]


@jit
def smooth_rings(
    corners: np.ndarray, first: np.ndarray, start: np.ndarray, passes: int, points: np.ndarray, before: np.ndarray
) -> None:
    """Smooth the midpoints of the sides of cells along each ring, and offset the ring to the area of its cells.

    Parameters
    ----------
    corners : float64[corners, 2] [cells]
    first, start : int64[rings + 1]
        These three as in `count_sides`.
    passes : int
        Of binomial smoothing.
    points : float64[sides, 2], out [cells]
        The rings, without a repeated end.
    before : float64[sides, 2], out [cells]
        Work array.
    """
    for r in range(start.shape[0] - 1):
        line, ring = corners[first[r] : first[r + 1]], points[start[r] : start[r + 1]]
        _fill_midpoints(line, ring)
        _move(ring, before[start[r] : start[r + 1]], passes)
        _offset(ring, _signed_area(line[:-1]))


@jit
def _fill_midpoints(line, ring):
    """Fill `ring` with the midpoints of the sides of cells along the closed `line`."""
    p = 0
    for c in range(line.shape[0] - 1):
        x, y = line[c, 0], line[c, 1]
        dx, dy = line[c + 1, 0] - x, line[c + 1, 1] - y
        count = int(abs(dx) + abs(dy) + 0.5)
        for k in range(count):
            ring[p, 0], ring[p, 1] = x + dx / count * (k + 0.5), y + dy / count * (k + 0.5)
            p += 1


@jit
def _move(ring, smooth, passes):
    """Smooth a `ring` with binomial weights; no point moves more than FARTHEST. `smooth` is a work array."""
    last = ring.shape[0] - 1
    smooth[:] = ring
    for _ in range(passes):
        for axis in range(2):
            begin, before = smooth[0, axis], smooth[last, axis]
            for p in range(last + 1):
                here, after = smooth[p, axis], smooth[p + 1, axis] if p < last else begin
                smooth[p, axis] = 0.5 * here + 0.25 * (before + after)
                before = here
    for p in range(last + 1):
        dx, dy = smooth[p, 0] - ring[p, 0], smooth[p, 1] - ring[p, 1]
        share = FARTHEST / max(np.sqrt(dx * dx + dy * dy), FARTHEST)
        ring[p, 0] += dx * share
        ring[p, 1] += dy * share


@jit
def _offset(ring, area):
    """Move a `ring` along its normals until it has its `area` [cells, signed]."""
    last = ring.shape[0] - 1
    for _ in range(OFFSETS):
        gap = (area - _signed_area(ring)) / max(_length(ring), SHORTEST)
        begin_x, begin_y, before_x, before_y = ring[0, 0], ring[0, 1], ring[last, 0], ring[last, 1]
        for p in range(last + 1):
            x, y = ring[p, 0], ring[p, 1]
            after_x, after_y = (ring[p + 1, 0], ring[p + 1, 1]) if p < last else (begin_x, begin_y)
            east, north = after_y - before_y, before_x - after_x  # to the right: outwards of a positive ring
            length = max(np.sqrt(east * east + north * north), SHORTEST)
            ring[p, 0], ring[p, 1] = x + east / length * gap, y + north / length * gap
            before_x, before_y = x, y


@jit
def _signed_area(ring):
    """Area of a `ring` [cells] (Gauss), relative to its first point; positive where it runs counter-clockwise."""
    last, area = ring.shape[0] - 1, 0.0
    for p in range(last + 1):
        after = p + 1 if p < last else 0
        x, y = ring[p, 0] - ring[0, 0], ring[p, 1] - ring[0, 1]
        area += x * (ring[after, 1] - ring[0, 1]) - (ring[after, 0] - ring[0, 0]) * y
    return 0.5 * area


@jit
def _length(ring):
    """Length of a `ring` [cells]."""
    last, length = ring.shape[0] - 1, 0.0
    for p in range(last + 1):
        after = p + 1 if p < last else 0
        dx, dy = ring[after, 0] - ring[p, 0], ring[after, 1] - ring[p, 1]
        length += np.sqrt(dx * dx + dy * dy)
    return length
