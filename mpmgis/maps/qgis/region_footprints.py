"""Write the footprints of the release areas of a region as polygons.

They show which areas reach a place, by a click in QGIS or an overlay.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...frames.region_layers import FOOTPRINTS, write_layer
from ...frames.region_maps import AreaRaster
from ...laws.quantities import MEMBER_BANDS
from ...terrain.grid import Grid
from ...terrain.raster_input import open_raster
from .outlines import mask_outline


def write_footprints(
    path: Path, areas: Sequence[AreaRaster], scenarios: Sequence, grid: Grid, min_depth: float
) -> None:
    """Write a GeoPackage with a polygon of the affected ground of each area, where its largest depth is `min_depth`.

    Columns: `number`, `scenario`, `frequency` [a-1], `area_m2` [m2], `h_max_m` [m]. Polygons of areas that reach the
    same place overlap there. Outlines are smoothed with their area kept, as those of exports.

    Parameters
    ----------
    path : Path
    areas : sequence of AreaRaster
    scenarios : sequence
        Of each area; None for all where no scenarios were requested.
    grid : Grid
        Of the DTM.
    min_depth : float [m]

    Raises
    ------
    OutputError
    """
    names = ("number", "scenario", "frequency", "area_m2", "h_max_m")
    rows, shapes = [], []
    for area, scenario in zip(areas, scenarios, strict=True):
        depth = _largest_depth(area)
        reached = depth >= np.float32(min_depth)
        top, _, left, _ = area.place
        outline = mask_outline(reached, grid.part(top, left, reached.shape).transform, smooth=True)
        if outline is not None:
            shapes.append(outline)
            rows.append((area.number, scenario, area.frequency, outline.area, float(depth[reached].max())))
    columns = dict(zip(names, zip(*rows, strict=True) if rows else [()] * len(names), strict=True))
    if all(scenario is None for scenario in scenarios):
        del columns["scenario"]
    write_layer(path, FOOTPRINTS, shapes, columns, grid.crs)


def _largest_depth(area):
    """float32[rows, columns] [m] of the largest depth in the extent of an area; -1 without flow."""
    top, bottom, left, right = area.extent
    with open_raster(area.path) as source:
        depth = source.read(MEMBER_BANDS.index("h_max") + 1, window=((top, bottom), (left, right)))
        return np.where(depth == np.float32(source.nodata), np.float32(-1.0), np.nan_to_num(depth, nan=-1.0))
