"""The part of the terrain under a release, and the vertical thickness of the release on it."""

from dataclasses import dataclass

import numpy as np
import shapely

from ..system.errors import InputError
from ..terrain.elevation import bilinear
from ..terrain.release_parts import NORMAL, ThicknessRaster
from . import polygon_cover
from .lattice import Lattice, Outline

_MARGIN = 3  # [cells] beyond the release, so that gradients under it are central
_SAME_CELL = 1 + 1e-9


def bed_under(parts, terrain):
    """The Terrain around release `parts`, with a margin of three cells where there is one.

    `terrain` is a Terrain, or a TerrainFile of which no more than this is read.

    Raises
    ------
    InputError
        A part lies over cells without an elevation; they are named.
    """
    rows, columns = terrain.grid.window(shapely.total_bounds([part.polygon for part in parts]), _MARGIN)
    near = terrain.part(rows, columns)
    if not near.valid.all():
        for part in parts:
            _require_bed(part, near, terrain.grid, np.array([rows.start, columns.start]))
    return near


def _require_bed(part, terrain, grid, first):
    """Refuse a part over cells without an elevation; `terrain` begins at the cell `first` of the whole `grid`."""
    outline = Outline.of(part.polygon, Lattice.of_grid(grid))
    cells = outline.cover().cells() + np.array([outline.window.row, outline.window.column])
    here = cells - first
    inside = np.all((here >= 0) & (here < terrain.grid.shape), axis=1)
    cells, here = cells[inside], here[inside]
    bad = cells[~terrain.valid[here[:, 0], here[:, 1]]]
    if len(bad):
        named = ", ".join(f"({row}, {column})" for row, column in sorted(map(tuple, bad.tolist()))[:3])
        more = f" and {len(bad) - 3} more" if len(bad) > 3 else ""
        raise InputError(
            f"{terrain.path or 'terrain'}: no elevation under release '{part.name}' in cell (row, column) "
            f"{named}{more}; fill the DTM (QGIS: Raster, Analysis, Fill nodata) or clip the release, or fill its holes "
            "here: [terrain] fill_nodata = 'interpolate' in a scene, --fill-nodata interpolate"
        )


def extended_elevation(terrain):
    """Elevation float64[rows, columns] [m] with the gaps that border on valid pixels filled along the bed's plane.

    Interpolation beside a gap then never meets NaN; what lies further in a gap is the nearest of these values.
    """
    elevation = terrain.elevation
    if terrain.valid.all():
        return elevation
    gradient = np.nan_to_num(_pixel_gradient(terrain))
    rows, columns = elevation.shape
    total, count = np.zeros_like(elevation), np.zeros_like(elevation)
    for di in (-1, 0, 1):
        for dj in (-1, 0, 1):
            to = slice(max(di, 0), rows + min(di, 0)), slice(max(dj, 0), columns + min(dj, 0))
            of = slice(max(-di, 0), rows + min(-di, 0)), slice(max(-dj, 0), columns + min(-dj, 0))
            valid = terrain.valid[of]
            guess = elevation[of] + di * gradient[..., 1][of] + dj * gradient[..., 0][of]
            total[to] += np.where(valid, guess, 0.0)
            count[to] += valid
    filled = np.divide(total, count, out=np.full_like(elevation, np.nanmean(elevation)), where=count > 0)
    return np.where(terrain.valid, elevation, filled)


def _pixel_gradient(terrain):
    """Elevation per step in (column, row) [m]."""
    return terrain.gradient @ terrain.grid.matrix


def steepness(terrain):
    """float64[rows, columns]: |grad b| = tan(slope) at pixel centres; NaN where there is no bed."""
    return np.hypot(terrain.gradient[..., 0], terrain.gradient[..., 1])


@dataclass(frozen=True, eq=False)
class Deposit:
    """Vertical thickness [m] of one release part on the raster `raster`, with its exact integral.

    `volume` [m3] is the reference of the conservation of mass: every pixel with its value, times its area, times the exact share of it that the
    polygon covers; `square` [m4] the same of the squared thickness; `area` [m2] the covered area.
    """

    raster: ThicknessRaster
    volume: float
    square: float
    area: float


def deposit_of(part, mode, terrain):
    """The Deposit of a ReleasePart on `terrain` (cropped to it or larger).

    Thickness normal to the bed is divided by the cosine of the slope of the DTM cell (vertical = normal / cos).
    """
    raster = _vertical_raster(part, mode, terrain)
    return Deposit(raster, *integral(part.polygon, raster))


def integral(polygon, raster):
    """(sum of values [m3], of squared values [m4], area [m2]) of a ThicknessRaster over a polygon."""
    lattice = Lattice.of_grid(raster.grid)
    outline = Outline.of(polygon, lattice)
    cover = outline.cover()
    inside = _spans_within(cover.spans, outline.window, raster.values.shape)
    total, square, area = polygon_cover.integrate_cover(
        raster.values, cover.rim_key, cover.rim, inside, cover.columns, outline.window.row, outline.window.column
    )
    return total * lattice.cell_area, square * lattice.cell_area, area * lattice.cell_area


def _spans_within(spans, window, shape):
    """`spans` clipped to a raster of `shape`: rounding may put an outline's last cell beyond the raster's edge."""
    spans = spans.copy()
    spans[:, 1] = np.maximum(spans[:, 1], -window.column)
    spans[:, 2] = np.minimum(spans[:, 2], shape[1] - window.column)
    rows = spans[:, 0] + window.row
    return spans[(rows >= 0) & (rows < shape[0]) & (spans[:, 1] < spans[:, 2])]


def _vertical_raster(part, mode, terrain):
    """The part's vertical thickness as a raster: on its own grid, or on the terrain's."""
    metric = np.sqrt(1.0 + steepness(terrain) ** 2) if mode == NORMAL else np.ones(terrain.grid.shape)
    if not isinstance(part.thickness, ThicknessRaster):
        return ThicknessRaster(part.thickness * metric, terrain.grid)
    own = _cropped_raster(part.thickness, part.polygon.bounds)
    if mode != NORMAL:
        return own
    if own.grid.cell_size <= terrain.grid.cell_size * _SAME_CELL:
        row, column = terrain.grid.rowcol(*own.grid.xy(*np.indices(own.grid.shape)))
        return ThicknessRaster(own.values * _valid_bilinear(metric, row, column), own.grid)
    row, column = own.grid.rowcol(*terrain.grid.xy(*np.indices(terrain.grid.shape)))
    return ThicknessRaster(_valid_bilinear(own.values, row, column) * metric, terrain.grid)


def _cropped_raster(raster, bounds):
    (i0, j0), (i1, j1) = raster.grid.pixel_range(bounds, 1)
    i0, j0 = max(min(i0, i1 - 1), 0), max(min(j0, j1 - 1), 0)
    values = np.ascontiguousarray(raster.values[i0:i1, j0:j1])
    return ThicknessRaster(values, raster.grid.part(i0, j0, values.shape))


def _valid_bilinear(values, row, column):
    """Bilinear over valid neighbours with renormalised weights; NaN where the pixel under the point is not
    valid."""
    row = np.clip(row, 0, values.shape[0] - 1)
    column = np.clip(column, 0, values.shape[1] - 1)
    valid = np.isfinite(values)
    weight = bilinear(valid.astype(float), row, column)
    total = bilinear(np.where(valid, values, 0.0), row, column)
    here = valid[np.round(row).astype(int), np.round(column).astype(int)]
    return np.divide(total, weight, out=np.full(row.shape, np.nan), where=here & (weight > 0))
