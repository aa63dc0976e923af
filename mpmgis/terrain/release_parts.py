"""Release areas: location and thickness of the initial mass."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import shapely

from ..system.errors import InputError
from ..system.messages import log
from .grid import Grid

NORMAL, VERTICAL = "normal", "vertical"
_TOUCHING = 1e-6  # [1] share of the smaller area up to which an overlap is rounding of a common border
CLIFF_DEGREES = 80.0  # [deg] a release on steeper ground is an error
STEEP_DEGREES = 60.0  # [deg] a release on steeper ground is reported: rock avalanches do start on 60 to 68 degrees
CLIFF_SHARE = 0.01  # [1] of the mass; less on such ground is accepted
_COMPASS = ("east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east")


@dataclass(frozen=True, eq=False)
class ThicknessRaster:
    """Thickness of a release, given as a raster.

    Parameters
    ----------
    values : float64[rows, columns] [m]
        NaN where there is no material; the value of a pixel is that at its centre.
    grid : Grid
        In the terrain's CRS.
    """

    values: np.ndarray
    grid: Grid


@dataclass(frozen=True)
class ReleasePart:
    """One feature of a release area.

    Parameters
    ----------
    name : str
    polygon : shapely.Geometry [m]
        Polygon or MultiPolygon, holes allowed.
    thickness : float [m] or ThicknessRaster
    """

    name: str
    polygon: shapely.Geometry
    thickness: float | ThicknessRaster


@dataclass(frozen=True)
class ReleaseArea:
    """All features of a release, which do not overlap, in the terrain's CRS.

    Parameters
    ----------
    parts : tuple of ReleasePart
    thickness_mode : {"normal", "vertical"}
        Direction of every thickness: normal to the bed, or vertical.
    name : str
    path, sha256 : str
        Of the source.
    record : dict
        Notes of reading (numbers and strings).

    Raises
    ------
    InputError
        Another thickness mode, or no part.
    """

    parts: tuple
    thickness_mode: str = NORMAL
    name: str = "release"
    path: str = ""
    sha256: str = ""
    record: dict = field(default_factory=dict)

    def __post_init__(self):
        if self.thickness_mode not in (NORMAL, VERTICAL):
            raise InputError(f"thickness mode {self.thickness_mode!r}, expected {NORMAL!r} or {VERTICAL!r}")
        if not self.parts:
            raise InputError(f"release {self.name!r} has no area")

    @property
    def area(self) -> float:
        """Plan area of all parts [m2]."""
        return float(sum(part.polygon.area for part in self.parts))

    @property
    def polygons(self) -> list[shapely.Geometry]:
        """Outlines [m], one for each part."""
        return [part.polygon for part in self.parts]


def without_overlaps(parts: Sequence[ReleasePart]) -> tuple[ReleasePart, ...]:
    """Unite the parts of equal thickness, so that no ground is counted twice.

    Parameters
    ----------
    parts : sequence of ReleasePart

    Raises
    ------
    InputError
        Two features of different thickness overlap; both are named.
    """
    groups = {}
    for part in parts:
        key = id(part.thickness) if isinstance(part.thickness, ThicknessRaster) else float(part.thickness)
        groups.setdefault(key, []).append(part)
    united = [_unite(group) for group in groups.values()]
    tree = shapely.STRtree([part.polygon for part in united])
    pairs = tree.query([part.polygon for part in united], predicate="intersects")
    for i, j in sorted({(int(i), int(j)) for i, j in pairs.T if i < j}):
        united[j] = _cut_common_border(united[i], united[j])
    return tuple(united)


def _unite(group: list[ReleasePart]) -> ReleasePart:
    """Return one part of the features of one thickness; report a true overlap."""
    if len(group) == 1:
        return group[0]
    names = [part.name for part in group]
    joined = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
    whole = shapely.union_all([part.polygon for part in group])
    twice = sum(part.polygon.area for part in group) - whole.area
    if twice > _TOUCHING * min(part.polygon.area for part in group):
        log.info(f"release: {joined} overlap by {twice:.4g} m2 and have one thickness; that ground is counted once")
    return replace(group[0], name=joined, polygon=whole)


def _cut_common_border(first: ReleasePart, second: ReleasePart) -> ReleasePart:
    """Return `second` without its overlap with `first`: only rounding, a larger one is refused."""
    shared = first.polygon.intersection(second.polygon).area
    if shared <= 0:
        return second
    if shared > _TOUCHING * min(first.polygon.area, second.polygon.area):
        raise InputError(
            f"release features '{first.name}' and '{second.name}' overlap by {shared:.4g} m2 and differ in thickness; "
            f"cut one of them (QGIS: Difference), or give both the same thickness to unite them"
        )
    return replace(second, polygon=polygons_only(second.polygon.difference(first.polygon)))


def polygons_only(geometry: shapely.Geometry) -> shapely.Geometry:
    """Return the areas in a geometry, without the lines and points that a repair left.

    Parameters
    ----------
    geometry : shapely.Geometry

    Returns
    -------
    shapely.Polygon or shapely.MultiPolygon
        Maybe empty.
    """
    if geometry.geom_type in ("Polygon", "MultiPolygon"):
        return geometry
    pieces = [g for g in getattr(geometry, "geoms", []) if g.geom_type in ("Polygon", "MultiPolygon")]
    return shapely.union_all(pieces) if pieces else shapely.MultiPolygon()


def require_on_terrain(part: ReleasePart, grid: Grid) -> None:
    """Refuse a part that leaves the raster of a grid, saying by how much and where.

    Parameters
    ----------
    part : ReleasePart
    grid : Grid

    Raises
    ------
    InputError
    """
    frame = shapely.Polygon(grid.corners())
    beyond = part.polygon.difference(frame)
    if beyond.area <= 1e-9 * part.polygon.area + grid.rounding * part.polygon.length:
        return
    points = shapely.points(shapely.get_coordinates(beyond))
    distances = shapely.distance(points, frame)
    farthest = points[int(np.argmax(distances))]
    start, end = shapely.get_coordinates(shapely.shortest_line(frame, farthest))
    sector = round(np.degrees(np.arctan2(*(end - start)[::-1])) / 45) % 8
    far = _metres(distances.max())
    if beyond.area >= (1 - 1e-9) * part.polygon.area:
        raise InputError(
            f"release '{part.name}' lies outside the terrain, up to {far} to the {_COMPASS[sector]}; use the DTM that "
            f"covers it, or check the CRS of both"
        )
    raise InputError(
        f"release '{part.name}' leaves the terrain by {far} to the {_COMPASS[sector]}; clip the polygon or use a "
        "larger DTM"
    )


def report_cliffs(gradient: np.ndarray, frame: Any) -> None:
    """Refuse a release that starts on a cliff, and report the share on very steep ground.

    Parameters
    ----------
    gradient : float64[n, 2] [1]
        Of the bed under the columns of `frame`.
    frame : Frame
        Columns at the start.

    Raises
    ------
    InputError
        More than 1 % of the mass on ground steeper than CLIFF_DEGREES, where no thickness means anything.
    """
    slope, mass = np.degrees(np.arctan(np.hypot(*gradient.T))), frame.particles.mass
    share = {limit: mass[slope > limit].sum() / max(mass.sum(), 1e-300) for limit in (CLIFF_DEGREES, STEEP_DEGREES)}
    if share[CLIFF_DEGREES] > CLIFF_SHARE:
        x, y = (values[int(np.argmax(slope))] for values in frame.map_xy())
        raise InputError(
            f"the release starts on a cliff: {100 * share[CLIFF_DEGREES]:.0f} % of its mass on ground steeper than "
            f"{CLIFF_DEGREES:g} degrees, the steepest {slope.max():.0f} at E {x:.1f} N {y:.1f}; move it off, or check "
            "the DTM's units and nodata there"
        )
    if share[STEEP_DEGREES] > CLIFF_SHARE:
        log.info(
            f"{100 * share[STEEP_DEGREES]:.0f} % of the release starts on ground steeper than {STEEP_DEGREES:g} "
            "degrees, where a depth-averaged flow is a rough approximation"
        )


def _metres(length):
    return f"{length / 1000:.1f} km" if length >= 10_000 else f"{length:.3g} m" if length < 100 else f"{length:.0f} m"
