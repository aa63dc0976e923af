"""Find lakes that the release fills to a still level, and fill their columns to it."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from ...system.errors import InputError, SceneError
from ...system.messages import log
from ..columns.feature_arrays import NO_LAKE
from .area_shares import touched_cells

if TYPE_CHECKING:
    from ...frames.particles import Frame
    from ...scene.tables import StillWaterTable
    from ..columns.node_grid import ColumnGrid
    from .feature_placement import PlacedFiles

FILLED = 0.9  # [1] share of the volume of a body below the level that released water must fill for a lake at rest
DRY = 1e-6  # [m] thickness of water at a lake's shore up to which the column is left out
REPORTED_CHANGE = 1e-3  # [1] relative change of the release's volume, above which a message reports it


def lake_levels(table: "StillWaterTable", files: "PlacedFiles", grid: "ColumnGrid", frame: "Frame") -> np.ndarray:
    """Return the still-water level in the cells of every lake, NO_LAKE elsewhere.

    Without files every body of water counts that is below the level of the table and filled by the release.

    Parameters
    ----------
    table : StillWaterTable
    files : PlacedFiles
    grid : ColumnGrid
    frame : Frame
        The columns at the start.

    Returns
    -------
    float64[ny, nx] [m]

    Raises
    ------
    SceneError
        No water body is filled to its level, or one body has two levels.
    InputError
        A polygon that covers no cell of the terrain.
    """
    water = water_depth(*grid.from_corner(frame), frame.particles.volume, grid.inside.shape, grid.cell_size)
    levels = np.full(grid.inside.shape, NO_LAKE)
    for level, touched in _still_levels(table, files, grid):
        cells, others = lake_cells(grid.bed[1:-1, 1:-1], level, water, touched)
        if not cells.any():
            best = f"; the fullest holds {100 * max(others):.0f} % of it" if others else ""
            raise SceneError(
                f"[still_water]: no water body below {level:g} m is filled by the release at the start{best}; a lake "
                "at rest is filled to its level: correct level or release, or take the table out"
            )
        clash = cells & (levels != NO_LAKE) & (levels != level)
        if clash.any():
            raise SceneError(
                f"[still_water]: levels {levels[clash][0]:g} and {level:g} m are given for one water body; keep one"
            )
        levels[cells] = level
    return levels


def _still_levels(table, files, grid):
    """Yield (level [m], bool cells that its lake touches or None for any) for each lake that the scene names."""
    if files.features is None:
        yield table.level, None
        return
    for feature in files.features:
        level = feature.number(table.level) if isinstance(table.level, str) else table.level
        touched = touched_cells(feature.shape, grid)
        if not touched.any():
            raise InputError(f"{feature.path}: '{feature.name}' covers no cell of the terrain; check its CRS")
        yield level, touched


def levelled(frame: "Frame", levels: np.ndarray, grid: "ColumnGrid") -> "Frame":
    """Return a frame with its columns in lakes filled to their still level over the solver's own bed.

    That bed is smoother than the DTM on which the release was measured. Water placed on the DTM but moving on this bed
    would rise and sink by the difference. Columns on ground above the level are left out.

    Parameters
    ----------
    frame : Frame
        The columns at the start.
    levels : float64[ny, nx] [m]
        The result of `lake_levels`.
    grid : ColumnGrid
    """
    p, density = frame.particles, frame.header["density"]
    x, y = grid.from_corner(frame)
    ny, nx = levels.shape
    j = np.clip((y / grid.cell_size).astype(int), 0, ny - 1)
    i = np.clip((x / grid.cell_size).astype(int), 0, nx - 1)
    level = levels[j, i]
    thickness = np.where(level != NO_LAKE, level - grid.beds_at(frame), p.thickness)
    kept = thickness > DRY
    volume = (thickness * p.area)[kept]
    change = volume.sum() / p.volume.sum() - 1.0
    if abs(change) > REPORTED_CHANGE:
        log.info(f"[still_water]: the release is filled to the still level, its volume by {100 * change:+.2g} %")
    particles = replace(p, thickness=thickness, id=None).take(kept)
    return replace(frame, particles=replace(particles, volume=volume, mass=density * volume))


def lake_cells(
    corner_bed: np.ndarray, level: float, water: np.ndarray, touched: np.ndarray | None = None
) -> tuple[np.ndarray, list[float]]:
    """Return the cells of all lakes at one still level.

    A lake is a connected body of cells with ground below `level`, of which the released water fills at least FILLED:
    a dry valley at the same level is neither a lake nor a reference state.

    Parameters
    ----------
    corner_bed : float64[ny + 1, nx + 1] [m]
        Elevation of the corners of cells.
    level : float [m]
    water : float64[ny, nx] [m]
        Mean depth of the released material in each cell.
    touched : bool[ny, nx], optional
        Only bodies with one of these cells are lakes.

    Returns
    -------
    (bool[ny, nx], list of float)
        Cells of lakes; filled share of every other body with released water.
    """
    corners = [corner_bed[:-1, :-1], corner_bed[:-1, 1:], corner_bed[1:, :-1], corner_bed[1:, 1:]]
    depth = np.mean([np.maximum(level - bed, 0.0) for bed in corners], axis=0)
    labels, count = ndimage.label(depth > 0.0)
    index = np.arange(1, count + 1)
    wet = ndimage.maximum((water > 0.0) & (depth > 0.0), labels, index) if count else np.zeros(0)
    filled = ndimage.sum(np.minimum(water, depth), labels, index) / ndimage.sum(depth, labels, index) if count else wet
    if touched is not None and count:
        wet = wet * ndimage.maximum(touched, labels, index)
    lakes = index[(np.asarray(wet) > 0) & (np.asarray(filled) >= FILLED)]
    others = np.asarray(filled)[(np.asarray(wet) > 0) & (np.asarray(filled) < FILLED)]
    return np.isin(labels, lakes), others.tolist()


def water_depth(
    x: np.ndarray, y: np.ndarray, volume: np.ndarray, shape: tuple[int, int], cell_size: float
) -> np.ndarray:
    """Compute the mean depth of the columns in each cell.

    Parameters
    ----------
    x, y : float64[n] [m]
        Places of the columns, from the south-west corner.
    volume : float64[n] [m3]
    shape : (int, int)
        Rows and columns of the cells.
    cell_size : float [m]

    Returns
    -------
    float64[ny, nx] [m]
    """
    rows, columns = shape
    j, i = np.clip((y / cell_size).astype(int), 0, rows - 1), np.clip((x / cell_size).astype(int), 0, columns - 1)
    return np.bincount(j * columns + i, volume, rows * columns).reshape(shape) / cell_size**2
