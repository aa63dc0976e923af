"""Part of the terrain under a release."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely

from ..system.errors import InputError
from ..system.messages import log
from ..terrain.dtm import TerrainFile
from ..terrain.elevation import Terrain
from ..terrain.grid import Grid
from ..terrain.release_parts import ReleasePart
from .lattice import Lattice, Outline

_MARGIN = 3  # [cells] beyond the release, so that gradients under it are central


def bed_under(parts: Sequence[ReleasePart], terrain: Terrain | TerrainFile) -> Terrain:
    """Return the terrain around release parts, with a margin of three cells where there is one.

    Parameters
    ----------
    parts : sequence of ReleasePart
    terrain : Terrain or TerrainFile
        Of a TerrainFile no more than this is read.

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


def report_heights(
    parts: Sequence[ReleasePart], near: Terrain, terrain: Terrain | TerrainFile, path: str | Path
) -> None:
    """Report the elevations under release parts and of the terrain: other units, pictures and pits show in them.

    Parameters
    ----------
    parts : sequence of ReleasePart
    near : Terrain
        Around the parts, `bed_under`.
    terrain : Terrain or TerrainFile
        The whole; the range of a TerrainFile is not known.
    path : str or Path
        Of the release, for the message.
    """
    lattice = Lattice.of_grid(near.grid)
    low, high = np.inf, -np.inf
    for part in parts:
        row, column = _cells_of(part, lattice, near.grid.shape).T
        heights = near.elevation[row, column]
        low, high = min(low, heights.min()), max(high, heights.max())
    whole = ""
    if isinstance(terrain, Terrain):
        whole = f", the terrain between {terrain.extremes[0]:.0f} and {terrain.extremes[1]:.0f} m"
    log.info(f"{path}: the ground there is between {low:.0f} and {high:.0f} m{whole}")


def _cells_of(part, lattice, shape, first=0):
    """Return the cells (row, column) of `lattice` that a part touches, of those in the `shape` from cell `first` on."""
    outline = Outline.of(part.polygon, lattice)
    cells = outline.cover().cells() + np.array([outline.window.row, outline.window.column])
    return cells[np.all((cells >= first) & (cells < first + np.array(shape)), axis=1)]


def _require_bed(part: ReleasePart, terrain: Terrain, grid: Grid, first: np.ndarray) -> None:
    """Refuse a part over cells without an elevation; `terrain` begins at the cell `first` of the whole `grid`."""
    cells = _cells_of(part, Lattice.of_grid(grid), terrain.grid.shape, first)
    row, column = (cells - first).T
    bad = cells[~terrain.valid[row, column]]
    if len(bad):
        named = ", ".join(f"({row}, {column})" for row, column in sorted(map(tuple, bad.tolist()))[:3])
        more = f" and {len(bad) - 3} more" if len(bad) > 3 else ""
        raise InputError(
            f"{terrain.path or 'terrain'}: no elevation under release '{part.name}' in cell (row, column) "
            f"{named}{more}; fill the DTM (QGIS: Raster, Analysis, Fill nodata) or clip the release, or fill its holes "
            "here: [terrain] fill_nodata = 'interpolate' in a scene, --fill-nodata interpolate"
        )


def extended_elevation(terrain: Terrain) -> np.ndarray:
    """Return the elevation with the gaps that border on valid pixels filled along the bed's plane.

    Interpolation beside a gap then never meets NaN; what lies further in a gap is the nearest of these values.

    Parameters
    ----------
    terrain : Terrain

    Returns
    -------
    float64[rows, columns] [m]
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


def _pixel_gradient(terrain: Terrain) -> np.ndarray:
    """Return the change of elevation [m] per step in column and row."""
    return terrain.gradient @ terrain.grid.matrix


def steepness(terrain: Terrain) -> np.ndarray:
    """Return |grad b| = tan(slope) at pixel centres; NaN where there is no bed.

    Parameters
    ----------
    terrain : Terrain

    Returns
    -------
    float64[rows, columns]
    """
    return np.hypot(terrain.gradient[..., 0], terrain.gradient[..., 1])
