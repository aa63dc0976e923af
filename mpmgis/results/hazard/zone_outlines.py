"""Outline hazard zones for a map scale: smoothed, simplified, minimum mapping area, no gaps or overlaps.

Where generalization must choose, the higher level wins: gaps that are too small to be mapped take the level around
them, and parts that are too small are enlarged, not removed.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from affine import Affine

from ...maps.qgis.outlines import mask_outline

LINE = 0.3e-3  # [m] on paper: lines closer than this cannot be told apart in print
SMALLEST = 2e-3  # [m] on paper: side of the smallest area that is mapped
KEPT_AREA = 0.001  # [1] largest change of an area by simplification; with 0.4 % of smoothing: 0.5 %
HALVINGS = 8  # of the tolerance of simplification, until the area is kept
SLIVER = 0.5  # [cells] smaller parts of a zone are slivers at any minimum mapping area
GRID = 1e-3  # [m] lattice to which borders of zones are rounded, so that zones with a common border share its points
OFFSETS = 3  # iterations of the distance that restores the area
BISECTIONS = 24  # iterations of the distance by which a small part is enlarged


@dataclass(frozen=True)
class Generalized:
    """Zones from the lowest level (shapely MultiPolygon or None), and the numbers of filled gaps and enlarged parts."""

    zones: tuple
    filled: int
    enlarged: int


def default_area(scale: float) -> float:
    """Return the minimum mapping area [m2] of a map at 1:`scale`.

    Parameters
    ----------
    scale : float
        Denominator of the map scale.
    """
    return (SMALLEST * scale) ** 2


def generalized_zones(level: np.ndarray, highest: int, transform: Affine, scale: float, least: float) -> Generalized:
    """Return the zones of a raster of levels, generalized for a map scale.

    Parameters
    ----------
    level : uint8[rows, columns]
        0 without a level, up to `highest`.
    highest : int
    transform : Affine
        Of the raster; may be rotated or sheared.
    scale : float
        Denominator of the map scale.
    least : float [m2]
        Minimum mapping area.

    Returns
    -------
    Generalized
        The zones are disjoint, and the union of those from a level upwards covers its generalized cells.
    """
    regions, filled, enlarged = [], 0, 0
    for number in range(1, highest + 1):
        outline = mask_outline(level >= number, transform, smooth=True) if (level == number).any() else None
        if outline is not None:
            outline, gaps, small = _mapped(outline, LINE * scale, least)
            filled, enlarged = filled + gaps, enlarged + small
        regions.append(outline)
    sliver = max(least, SLIVER * abs(transform.determinant))
    return Generalized(tuple(_nested(regions, sliver)), filled, enlarged)


def _mapped(outline: shapely.Geometry, tolerance: float, least: float) -> tuple[shapely.MultiPolygon, int, int]:
    """(the outline with large enough gaps and parts, simplified; number of filled gaps, number of enlarged parts)."""
    parts, gaps, small = [], 0, 0
    for part in shapely.get_parts(outline):
        holes = [ring for ring in part.interiors if shapely.Polygon(ring).area >= least]
        gaps += len(part.interiors) - len(holes)
        part = shapely.Polygon(part.exterior, holes)
        is_small = part.area < least
        small += is_small
        parts.append(_enlarged(part, least) if is_small else part)
    whole = shapely.union_all(parts) if small or gaps else shapely.MultiPolygon(parts)
    simple = [_simplified(part, tolerance) for part in shapely.get_parts(polygons(whole))]
    return polygons(shapely.union_all(simple)), gaps, small


def _enlarged(part, least):
    """`part` with a margin that gives it the area `least` [m2]."""
    low, high = 0.0, float(np.sqrt(least))
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if part.buffer(middle).area < least else (low, middle)
    return part.buffer(high)


def _simplified(part, tolerance):
    """A polygon with fewer points, about `tolerance` [m] away at most, valid and with its area (within KEPT_AREA)."""
    for _ in range(HALVINGS):
        simple = _offset(shapely.simplify(part, tolerance), part.area)
        if simple.geom_type == "Polygon" and simple.is_valid and abs(simple.area - part.area) <= KEPT_AREA * part.area:
            return simple
        tolerance *= 0.5
    return part


def _offset(simple, area):
    """`simple` moved outwards, or inwards, until it has the `area`: straight lines cut off the curves of a flow."""
    moved, distance = simple, 0.0
    for _ in range(OFFSETS):
        distance += (area - moved.area) / max(moved.length, 1e-9)
        moved = simple.buffer(distance, join_style="mitre")
    return moved


def _nested(regions, sliver):
    """Zones of nested regions: each region, united with all higher ones, without these.

    Parts smaller than `sliver` [m2] beside a higher zone, mostly between two outlines of the same cells, are given to
    that zone.
    """
    zones, above = [None] * len(regions), None
    for number in reversed(range(len(regions))):
        region = regions[number]
        if region is None:
            continue
        zone = region if above is None else polygons(shapely.difference(region, above, grid_size=GRID))
        above = region if above is None else polygons(shapely.union(region, above, grid_size=GRID))
        parts = shapely.get_parts(zone)
        small = shapely.area(parts) < sliver
        kept = [*parts[~small], *(part for part in parts[small] if not _given(part, zones, number + 1))]
        zones[number] = shapely.MultiPolygon(kept) if kept else None
    return zones


def _given(part: shapely.Geometry, zones: list, first: int) -> bool:
    """Whether a higher zone, from number `first` upwards, touches `part`, which is added to it."""
    for number in range(first, len(zones)):
        if zones[number] is not None and shapely.dwithin(zones[number], part, 2 * GRID):
            zones[number] = polygons(shapely.union(zones[number], part, grid_size=GRID))
            return True
    return False


def polygons(shape: shapely.Geometry) -> shapely.MultiPolygon:
    """Return the polygons of any geometry as a MultiPolygon; lines and points are left out.

    Parameters
    ----------
    shape : shapely geometry
    """
    pieces = shapely.get_parts(shapely.get_parts(shape if shapely.is_valid(shape) else shapely.make_valid(shape)))
    return shapely.MultiPolygon([piece for piece in pieces if piece.geom_type == "Polygon" and piece.area > 0])
