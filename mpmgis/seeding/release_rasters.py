"""Release areas and thickness from rasters: masks, thickness per cell, surface minus bed."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rasterio.features
import shapely
from affine import Affine
from rasterio.enums import Resampling

from ..system.errors import GeoreferenceError, InputError
from ..system.messages import log
from ..terrain.datum_shift import transformer_to
from ..terrain.dtm import TerrainFile
from ..terrain.elevation import Terrain, bilinear
from ..terrain.georeference import name_of, same_place, warp_command
from ..terrain.grid import Grid
from ..terrain.mask_values import (
    BYTE_MASK,
    TRACE,
    ids_of,
    inside_of,
    is_mask,
    require_metres,
    require_thin,
    without_traces,
)
from ..terrain.raster_input import read_raster
from ..terrain.release_parts import ReleasePart, ThicknessRaster, polygons_only
from ..terrain.spatial_inputs import require_lies_on
from ..terrain.terrain_reprojection import reprojected_raster
from ..terrain.undeclared_nodata import HEIGHTS, MASK, THICKNESS, Role

# values above the first and closer to the terrain than the second are elevations, given by mistake
_ELEVATION = 10.0  # [m]
_NEAR_GROUND = 50.0  # [m]
_SURFACE_CUT = 8  # parts into which a side of a pixel of a surface is divided
_MOST_PIXELS = 20_000_000  # of a divided surface, 160 MB; with more pixels the division is coarser
_AFFINE_PIXELS = 0.25  # [pixels] largest misfit of the affine transform that approximates a reprojection


def area_of_raster(
    path: str | Path, terrain: Terrain | TerrainFile, wanted: Any
) -> tuple[list[ReleasePart], ThicknessRaster | None]:
    """Read a release area from a raster: a mask, or thickness per cell.

    Parameters
    ----------
    path : str or Path
    terrain : Terrain or TerrainFile
    wanted : object
        The requested thickness: `number` [m], `column` or `raster`, the others None.

    Returns
    -------
    parts : list of ReleasePart
        One for each id of a mask with several values, else a single one.
    thickness : ThicknessRaster or None
        The values of the raster; None where they are a mask.

    Raises
    ------
    InputError
        A column is requested, or the values are no mask and no thickness.
    """
    if wanted.column is not None:
        raise InputError(
            f"--thickness {wanted.column!r}: {path} is a raster and has no columns; give a number of metres or a raster"
        )
    if wanted.number is not None or wanted.raster is not None:
        values, grid = _on_terrain(path, terrain, MASK)
        inside = inside_of(values, path)
        number = math.nan if wanted.number is None else wanted.number
        return _areas_of_mask(values, inside, grid, Path(path).stem, number), None
    values, grid = _on_terrain(path, terrain, THICKNESS)
    inside = without_traces(values, path, TRACE)
    if not inside.any():
        raise InputError(f"{path}: all values are 0 or nodata, expected a mask or a thickness in metres")
    require_metres(
        values[inside & (values > 0)],
        path,
        "give --thickness, or thickness in the table of the scene, as a number of metres or a raster (this one, if its "
        "values are metres)",
    )
    _refuse_elevations(values, inside, grid, terrain, path)
    own = ThicknessRaster(_require_no_negative(np.where(inside, values, np.nan), path), grid)
    require_thin(own.values, path)
    log.info(
        f"{path}: its values are used as thickness in metres, {values[inside].min():.4g} to {values[inside].max():.4g} "
        f"in {np.count_nonzero(inside)} cells"
    )
    return [ReleasePart(Path(path).stem, _outline(inside, grid), math.nan)], own


def _areas_of_mask(values: np.ndarray, inside: np.ndarray, grid: Grid, name: str, number: float) -> list[ReleasePart]:
    """Return a part for each of few whole values of a mask, else one of all that is inside."""
    ids = ids_of(values[inside])
    if len(ids) < 2 or not is_mask(ids):
        return [ReleasePart(name, _outline(inside, grid), number)]
    return [ReleasePart(f"{name} {one:g}", _outline(values == one, grid), number) for one in ids]


def _refuse_elevations(
    values: np.ndarray, inside: np.ndarray, grid: Grid, terrain: Terrain | TerrainFile, path: str | Path
) -> None:
    """Refuse a release raster whose values are the elevations of the terrain under it: a DTM given by mistake."""
    x, y = grid.xy(*np.nonzero(inside))
    ground = terrain.sample(x, y)
    apart = np.abs(values[inside] - ground)
    least, most = values[inside].min(), values[inside].max()
    if np.isfinite(apart).any() and least > _ELEVATION and np.nanmedian(apart) < _NEAR_GROUND:
        raise InputError(
            f"{path} contains elevations like the DTM ({least:.6g} to {most:.6g}), expected a mask or a thickness in "
            "metres; for the surface of the material give --surface and a release area"
        )


def _outline(inside: np.ndarray, grid: Grid) -> shapely.Geometry:
    """Return the union of the pixel squares that are `inside` (not a contour through the centres)."""
    shapes = rasterio.features.shapes(inside.astype(np.uint8), mask=inside, connectivity=4)
    pieces = [shapely.geometry.shape(shape) for shape, _ in shapes]
    whole = shapely.union_all(pieces)
    t = grid.transform
    return shapely.transform(
        whole, lambda p: np.column_stack((t.a * p[:, 0] + t.b * p[:, 1] + t.c, t.d * p[:, 0] + t.e * p[:, 1] + t.f))
    )


def _require_no_negative(values, path):
    with np.errstate(invalid="ignore"):
        bad = values < 0
    if bad.any():
        row, column = np.argwhere(bad)[0].tolist()
        raise InputError(
            f"{path}: thickness is {values[row, column]:g} in {int(bad.sum())} cells, the first in row {row}, column "
            f"{column}; expected metres above 0; declare the nodata value (rio edit-info FILE --nodata N), or use "
            "--surface"
        )
    return values


def thickness_raster(path: str | Path, terrain: Terrain | TerrainFile) -> ThicknessRaster:
    """Read a thickness raster on its own grid, in the terrain's CRS; 0 and nodata mean no material.

    Parameters
    ----------
    path : str or Path
    terrain : Terrain or TerrainFile
    """
    values, grid = _on_terrain(path, terrain, THICKNESS)
    _require_no_negative(values, path)
    require_thin(values, path)
    if set(ids_of(values[values > 0]).tolist()) == {BYTE_MASK}:
        raise InputError(f"{path} contains only 0 and {BYTE_MASK:g}, i.e. a mask, expected a thickness in metres")
    with np.errstate(invalid="ignore"):
        return ThicknessRaster(np.where(values >= TRACE, values, np.nan), grid)


def surface_thickness(
    path: str | Path, terrain: Terrain | TerrainFile, features: Sequence[ReleasePart], record: dict
) -> ThicknessRaster:
    """Compute surface minus bed on the finer of the two grids, clipped at 0.

    Clipped volumes in the release are reported. Pixels are subdivided before clipping, so that the material ends where
    surface and bed intersect, not at the border of a pixel.

    Parameters
    ----------
    path : str or Path
        Raster of the surface [m].
    terrain : Terrain or TerrainFile
    features : sequence of ReleasePart
    record : dict
        Gets the number of clipped cells and the clipped volume [m3].
    """
    values, grid = _on_terrain(path, terrain, HEIGHTS, Resampling.bilinear)
    polygons = [part.polygon for part in features]
    finer = grid.cell_size <= terrain.grid.cell_size * (1 + 1e-9)
    rows, columns = around = _pixels_around(grid if finer else terrain.grid, shapely.total_bounds(polygons))
    if finer:
        thickness = values[around] - _bed_at(terrain, *grid.xy(*np.mgrid[around]))
    else:
        points = terrain.grid.xy(*np.mgrid[around])
        thickness, grid = bilinear(values, *grid.rowcol(*points)) - terrain.part(*around).elevation, terrain.grid
    whole = ThicknessRaster(thickness, grid.part(rows.start, columns.start, thickness.shape))
    under = rasterio.features.geometry_mask(polygons, whole.grid.shape, whole.grid.transform, invert=True)
    require_thin(whole.values[under], path)
    with np.errstate(invalid="ignore"):
        clipped = under & (whole.values < 0)
    count, volume = int(clipped.sum()), float(-whole.values[clipped].sum() * grid.cell_area)
    record.update(clipped_cells=count, clipped_volume=volume)
    if count:
        log.info(
            f"{path}: the surface is below the bed in {count} cells of the release; {volume:.4g} m3 clipped to "
            "thickness 0"
        )
    fine = _finer(whole)
    with np.errstate(invalid="ignore"):
        return ThicknessRaster(np.where(fine.values > 0, fine.values, np.nan), fine.grid)


def _bed_at(terrain: Terrain | TerrainFile, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the elevation [m] at map points [m]; a TerrainFile reads only the pixels around them."""
    rows, columns = terrain.grid.window((x.min(), y.min(), x.max(), y.max()), 2)
    row, column = terrain.grid.rowcol(x, y)
    return bilinear(terrain.part(rows, columns).elevation, row - rows.start, column - columns.start)


def _finer(raster: ThicknessRaster) -> ThicknessRaster:
    """Return the raster with every pixel divided into up to 8 x 8, bilinear."""
    cut = int(np.clip(np.sqrt(_MOST_PIXELS / raster.values.size), 1, _SURFACE_CUT))
    rows, columns = (n * cut for n in raster.grid.shape)
    row, column = np.ogrid[:rows, :columns]
    values = bilinear(raster.values, (row + 0.5) / cut - 0.5, (column + 0.5) / cut - 0.5)
    transform = raster.grid.transform * Affine.scale(1 / cut)
    return ThicknessRaster(values, Grid(raster.grid.crs, transform, (rows, columns)))


def within_thickness(part: ReleasePart, thickness: ThicknessRaster) -> ReleasePart:
    """Clip a part to the pixels with a thickness; the lost area is reported.

    Parameters
    ----------
    part : ReleasePart
    thickness : ThicknessRaster

    Raises
    ------
    InputError
        No pixel in the part has a thickness.
    """
    near = _cropped(thickness, part.polygon.bounds)
    valid = np.isfinite(near.values)
    polygon = part.polygon
    if not valid.all():
        polygon = polygons_only(polygon.intersection(_outline(valid, near.grid)))
    elif not (corners := shapely.Polygon(near.grid.corners())).covers(polygon):
        polygon = polygons_only(polygon.intersection(corners))
    if polygon.is_empty or polygon.area <= 0:
        raise InputError(
            f"release '{part.name}' has zero thickness everywhere: the thickness raster, or the surface minus the DTM, "
            "has no value above 0 there"
        )
    lost = part.polygon.area - polygon.area
    if lost > 1e-9 * part.polygon.area:
        log.info(
            f"release '{part.name}': {lost:.4g} m2 ({100 * lost / part.polygon.area:.1f} %) without thickness are "
            "ignored"
        )
    return ReleasePart(part.name, polygon, thickness)


def _cropped(thickness: ThicknessRaster, bounds: tuple[float, float, float, float]) -> ThicknessRaster:
    """Return the part of a ThicknessRaster within `bounds` [m], at least one cell."""
    rows, columns = around = _pixels_around(thickness.grid, bounds)
    values = thickness.values[around]
    return ThicknessRaster(values, thickness.grid.part(rows.start, columns.start, values.shape))


def _pixels_around(grid: Grid, bounds: tuple[float, float, float, float]) -> tuple[slice, slice]:
    """Return the rows and columns of the pixels needed for values in `bounds` [m], at least one pixel."""
    west, south, east, north = bounds
    places = grid.rowcol(np.array([west, east, east, west]), np.array([south, south, north, north]))
    slices = []
    for place, size in zip(places, grid.shape, strict=True):
        first = int(np.clip(np.floor(place.min()) - 1, 0, size - 1))
        slices.append(slice(first, int(np.clip(np.ceil(place.max()) + 2, first + 1, size))))
    return tuple(slices)


def _on_terrain(
    path: str | Path, terrain: Terrain | TerrainFile, role: Role, resampling: Resampling = Resampling.nearest
) -> tuple[np.ndarray, Grid]:
    """Read a raster in the terrain's CRS; another CRS is approximated by an affine over valid pixels.

    Where no affine fits, it is resampled if the terrain was brought to its CRS by `to_crs`, else refused.
    """
    values, grid = read_raster(path, role)
    target = terrain.grid.crs
    if grid.crs is None or target is None:
        require_lies_on(grid.bounds, grid.crs, terrain.grid, path)
        return values, Grid(target, grid.transform, grid.shape)
    if same_place(grid.crs, target):
        return values, Grid(target, grid.transform, grid.shape)
    rows, columns = np.nonzero(np.isfinite(values) & (values != 0))
    if rows.size == 0:
        raise InputError(f"{path}: all values are 0 or nodata")
    i = np.linspace(rows.min() - 0.5, rows.max() + 0.5, 9)
    j = np.linspace(columns.min() - 0.5, columns.max() + 0.5, 9)
    i, j = (a.ravel() for a in np.meshgrid(i, j))
    places = grid.xy(i, j)
    transformer, shift = transformer_to(grid.crs, target, (places[0][0], places[1][0]), path)
    x, y = transformer.transform(*places)
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise GeoreferenceError(
            f"{path} is in {name_of(grid.crs)} and cannot be reprojected to {name_of(target)}; check its CRS"
        )
    design = np.column_stack((j + 0.5, i + 0.5, np.ones_like(i)))
    (a, d), (b, e), (c, f) = np.linalg.lstsq(design - [0, 0, 0], np.column_stack((x, y)), rcond=None)[0]
    placed = Grid(target, Affine(a, b, c, d, e, f), grid.shape)
    row, column = placed.rowcol(x, y)
    misfit = max(np.abs(row - i).max(), np.abs(column - j).max())
    if misfit > _AFFINE_PIXELS and terrain.reprojection is not None:
        return reprojected_raster(path, target, role, resampling)
    if misfit > _AFFINE_PIXELS:
        code = target.to_epsg() or "n"
        raise GeoreferenceError(
            f"{path} is in {name_of(grid.crs)} and too large for {name_of(target)} without resampling; "
            f"give --to-crs auto, or reproject it: {warp_command(path, f'EPSG:{code}')}"
        )
    log.info(
        f"{path}: transformed from {name_of(grid.crs)} to {name_of(target)}, the terrain's CRS{shift} (within "
        f"{misfit:.2g} of a pixel)"
    )
    return values, placed
