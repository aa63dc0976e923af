"""Classes of terrain by which guidelines vary friction: open slope, channel, gully, flat ground.

The form of the ground is its topographic position (Weiss 2001): by how much the ground around a cell, at a given
radius, is higher than the cell itself, on average over all directions. It is 0 on a plane of any slope, positive in
channels and bowls, negative on ridges. Rise over radius [1] is compared with two thresholds: at a small radius for
gullies, at a larger one for channels. The programs that the classes come from do not publish theirs; check the map of
classes on the ground that you know.
"""

import numpy as np

from ..system.errors import InputError
from .class_limits import ClassLimits
from .elevation import Terrain
from .grid import Grid

OUTSIDE, OPEN_SLOPE, CHANNEL, GULLY, FLAT = range(5)  # values of a raster of classes; 0 has no elevation
CLASSES = {"open": OPEN_SLOPE, "channel": CHANNEL, "gully": GULLY, "flat": FLAT}  # by their names in tables
PAIRS = 16  # pairs of opposite directions; the circle is symmetric under quarter turns and mirrors
LEAST_RADIUS = 1.5  # [cells] of a circle that the cells can resolve
BLOCK_CELLS = 2_000_000  # cells of the rows that are computed at once


def terrain_classes(terrain: Terrain, limits: ClassLimits | None = None) -> np.ndarray:
    """Return the class of every cell of a terrain: a gully before a channel before flat ground before open slope.

    Parameters
    ----------
    terrain : Terrain
    limits : ClassLimits, optional

    Returns
    -------
    uint8[rows, columns]
        Of CLASSES; OUTSIDE without an elevation.

    Raises
    ------
    InputError
        A radius that the cells cannot resolve.
    """
    limits = ClassLimits() if limits is None else limits
    rises = [mean_rise(terrain, radius) for radius in (limits.gully_radius, limits.channel_radius)]
    slope = np.hypot(*np.moveaxis(terrain.gradient, -1, 0))
    classes = np.full(terrain.grid.shape, OPEN_SLOPE, np.uint8)
    classes[slope < np.tan(np.radians(limits.flat_slope))] = FLAT
    classes[rises[1] >= limits.channel_rise] = CHANNEL
    classes[rises[0] >= limits.gully_rise] = GULLY
    classes[~terrain.valid] = OUTSIDE
    return classes


def mean_rise(terrain: Terrain, radius: float) -> np.ndarray:
    """Compute the mean rise [1] from each cell to the circle around it, over its radius.

    Points of the circle count in opposite pairs, and only where both have an elevation, so that a plane has 0 at its
    edges too.

    Parameters
    ----------
    terrain : Terrain
    radius : float [m]

    Returns
    -------
    float64[rows, columns]
        0 where no pair is on the terrain; NaN without an elevation.

    Raises
    ------
    InputError
        The radius is smaller than LEAST_RADIUS cells.
    """
    if not radius >= LEAST_RADIUS * max(terrain.grid.sides):
        raise InputError(
            f"radius of {radius:g} m around cells of {max(terrain.grid.sides):g} m: expected at least "
            f"{LEAST_RADIUS:g} cells; give a larger radius or a finer DTM"
        )
    steps = _steps(terrain.grid, radius)
    margin = int(np.ceil(np.abs(steps).max())) + 1
    rows, columns = terrain.grid.shape
    found = np.empty((rows, columns))
    block = max(1, BLOCK_CELLS // columns)
    for first in range(0, rows, block):
        last = min(first + block, rows)
        ground = np.full((last - first + 2 * margin, columns + 2 * margin), np.nan)
        low, high = max(first - margin, 0), min(last + margin, rows)
        ground[low - first + margin : high - first + margin, margin:-margin] = terrain.elevation[low:high]
        found[first:last] = _rise_of_block(ground, steps, margin, radius)
    return found


def _steps(grid: Grid, radius: float) -> np.ndarray:
    """Return the steps in (row, column) from a cell to half of the circle; the others are opposite."""
    angles = (np.arange(PAIRS) + 0.5) * np.pi / PAIRS
    steps = np.linalg.inv(grid.matrix) @ (radius * np.array([np.cos(angles), np.sin(angles)]))
    return steps[::-1].T  # the matrix maps (column, row) to (east, north)


def _rise_of_block(ground: np.ndarray, steps: np.ndarray, margin: int, radius: float) -> np.ndarray:
    """Return the mean rise of the cells inside the margin."""
    centre = ground[margin:-margin, margin:-margin]
    total, count = np.zeros(centre.shape), np.zeros(centre.shape, np.int32)
    for step in steps:
        pair = _shifted(ground, step, margin) + _shifted(ground, -step, margin)
        known = np.isfinite(pair)
        total += np.where(known, 0.5 * pair - centre, 0.0)
        count += known
    rise = total / (np.maximum(count, 1) * radius)
    return np.where(np.isfinite(centre), rise, np.nan)


def _shifted(ground: np.ndarray, step: np.ndarray, margin: int) -> np.ndarray:
    """Return the elevation at a step from every cell inside the margin, bilinear between cells."""
    row, column = np.floor(step).astype(int)
    down, right = step - (row, column)
    rows, columns = (size - 2 * margin for size in ground.shape)
    total = np.zeros((rows, columns))
    for i, weight_i in ((row, 1.0 - down), (row + 1, down)):
        for j, weight_j in ((column, 1.0 - right), (column + 1, right)):
            if weight_i * weight_j > 0.0:
                top, left = margin + i, margin + j
                total += weight_i * weight_j * ground[top : top + rows, left : left + columns]
    return total
