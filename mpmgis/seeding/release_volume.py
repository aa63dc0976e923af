"""Vertical thickness of a release part on the terrain, with its exact volume."""

from dataclasses import dataclass

import numpy as np
import shapely

from ..terrain.elevation import Terrain, bilinear
from ..terrain.release_parts import NORMAL, ReleasePart, ThicknessRaster
from . import polygon_cover
from .lattice import Lattice, LatticeWindow, Outline
from .release_bed import steepness

_SAME_CELL = 1 + 1e-9  # [1] ratio up to which two cell sizes are equal: rounding


@dataclass(frozen=True, eq=False)
class PartVolume:
    """Vertical thickness of one release part, with its exact integral.

    The integral is the reference of the conservation of mass: the sum of the value of each pixel, times its area,
    times the exact share of it that the polygon covers.

    Parameters
    ----------
    raster : ThicknessRaster
        Vertical thickness [m].
    volume : float [m3]
    square : float [m4]
        Integral of the squared thickness.
    area : float [m2]
        Covered area.
    """

    raster: ThicknessRaster
    volume: float
    square: float
    area: float


def part_volume(part: ReleasePart, mode: str, terrain: Terrain) -> PartVolume:
    """Compute vertical thickness and volume of a release part.

    Thickness normal to the bed is divided by the cosine of the slope of the DTM cell (vertical = normal / cos).

    Parameters
    ----------
    part : ReleasePart
    mode : {"normal", "vertical"}
        Direction of the part's thickness.
    terrain : Terrain
        The part of the terrain under it, or more.
    """
    raster = _vertical_raster(part, mode, terrain)
    return PartVolume(raster, *integral(part.polygon, raster))


def integral(polygon: shapely.Geometry, raster: ThicknessRaster) -> tuple[float, float, float]:
    """Integrate the values of a ThicknessRaster over a polygon.

    Parameters
    ----------
    polygon : Polygon or MultiPolygon [m]
    raster : ThicknessRaster

    Returns
    -------
    total : float [m3]
    square : float [m4]
        Integral of the squared values.
    area : float [m2]
    """
    lattice = Lattice.of_grid(raster.grid)
    outline = Outline.of(polygon, lattice)
    cover = outline.cover()
    inside = _spans_within(cover.spans, outline.window, raster.values.shape)
    total, square, area = polygon_cover.integrate_cover(
        raster.values, cover.rim_key, cover.rim, inside, cover.columns, outline.window.row, outline.window.column
    )
    return total * lattice.cell_area, square * lattice.cell_area, area * lattice.cell_area


def _spans_within(spans: np.ndarray, window: LatticeWindow, shape: tuple[int, int]) -> np.ndarray:
    """Clip spans to a raster of `shape`: rounding may put an outline's last cell beyond the raster's edge."""
    spans = spans.copy()
    spans[:, 1] = np.maximum(spans[:, 1], -window.column)
    spans[:, 2] = np.minimum(spans[:, 2], shape[1] - window.column)
    rows = spans[:, 0] + window.row
    return spans[(rows >= 0) & (rows < shape[0]) & (spans[:, 1] < spans[:, 2])]


def _vertical_raster(part: ReleasePart, mode: str, terrain: Terrain) -> ThicknessRaster:
    """Return the part's vertical thickness as a raster: on its own grid, or on the terrain's."""
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


def _valid_bilinear(values: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Return bilinear values of valid neighbours, renormalised; NaN where the pixel under a point is not valid."""
    row = np.clip(row, 0, values.shape[0] - 1)
    column = np.clip(column, 0, values.shape[1] - 1)
    valid = np.isfinite(values)
    weight = bilinear(valid.astype(float), row, column)
    total = bilinear(np.where(valid, values, 0.0), row, column)
    here = valid[np.round(row).astype(int), np.round(column).astype(int)]
    return np.divide(total, weight, out=np.full(row.shape, np.nan), where=here & (weight > 0))
