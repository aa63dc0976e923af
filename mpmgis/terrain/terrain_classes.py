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
from .dtm_blocks import Block
from .elevation import Terrain
from .grid import Grid

OUTSIDE, OPEN_SLOPE, CHANNEL, GULLY, FLAT = range(5)  # values of a raster of classes; 0 has no elevation
CLASSES = {"open": OPEN_SLOPE, "channel": CHANNEL, "gully": GULLY, "flat": FLAT}  # by their names in tables
PAIRS = 16  # pairs of opposite directions; the circle is symmetric under quarter turns and mirrors
LEAST_RADIUS = 1.5  # [cells] of a circle that the cells can resolve
RIM = 2  # [cells] around a block on which its slopes depend: at the rim of the DTM they are one-sided, of three cells


def class_halo(grid: Grid, limits: ClassLimits) -> int:
    """Return the cells around a block on which its classes depend.

    Parameters
    ----------
    grid : Grid
        Of the DTM.
    limits : ClassLimits

    Raises
    ------
    InputError
        A radius that the cells cannot resolve.
    """
    for radius in (limits.gully_radius, limits.channel_radius):
        if not radius >= LEAST_RADIUS * max(grid.sides):
            raise InputError(
                f"radius of {radius:g} m around cells of {max(grid.sides):g} m: expected at least "
                f"{LEAST_RADIUS:g} cells; give a larger radius or a finer DTM"
            )
    largest = max(limits.gully_radius, limits.channel_radius)
    return max(RIM, int(np.ceil(np.abs(_steps(grid, largest)).max())) + 1)


def block_classes(ground: np.ndarray, block: Block, grid: Grid, limits: ClassLimits) -> np.ndarray:
    """Return the class of every cell of a block: a gully before a channel before flat ground before open slope.

    Parameters
    ----------
    ground : float64[rows + 2 halo, columns + 2 halo] [m]
        Elevation of the block and of its `class_halo`, as of `block_heights`.
    block : Block
    grid : Grid
        Of the DTM.
    limits : ClassLimits

    Returns
    -------
    uint8[rows, columns]
        Of CLASSES; OUTSIDE without an elevation.
    """
    halo = class_halo(grid, limits)
    gully, channel = (_mean_rise(ground, halo, grid, radius) for radius in (limits.gully_radius, limits.channel_radius))
    classes = np.full(block.shape, OPEN_SLOPE, np.uint8)
    classes[_slope(ground, halo, block, grid) < np.tan(np.radians(limits.flat_slope))] = FLAT
    classes[channel >= limits.channel_rise] = CHANNEL
    classes[gully >= limits.gully_rise] = GULLY
    classes[~np.isfinite(ground[halo:-halo, halo:-halo])] = OUTSIDE
    return classes


def _slope(ground: np.ndarray, halo: int, block: Block, grid: Grid) -> np.ndarray:
    """Return the slope [1] of the cells of a block; beyond the rim of the DTM there are no cells, not cells of NaN."""
    near, whole = block.around(RIM, grid.shape), Block((block.first[0] - halo, block.first[1] - halo), block.last)
    there = ground[near.inside(whole)]
    gradient = Terrain(grid.part(*near.first, near.shape), there).gradient
    return np.hypot(*np.moveaxis(gradient[block.inside(near)], -1, 0))


def _mean_rise(ground: np.ndarray, halo: int, grid: Grid, radius: float) -> np.ndarray:
    """Compute the mean rise [1] from each cell inside the halo to the circle around it, over its radius.

    Points of the circle count in opposite pairs, and only where both have an elevation, so that a plane has 0 at its
    edges too. 0 where no pair is on the terrain; NaN without an elevation.
    """
    centre = ground[halo:-halo, halo:-halo]
    total, count = np.zeros(centre.shape), np.zeros(centre.shape, np.int32)
    for step in _steps(grid, radius):
        pair = _shifted(ground, step, halo) + _shifted(ground, -step, halo)
        known = np.isfinite(pair)
        total += np.where(known, 0.5 * pair - centre, 0.0)
        count += known
    rise = total / (np.maximum(count, 1) * radius)
    return np.where(np.isfinite(centre), rise, np.nan)


def _steps(grid: Grid, radius: float) -> np.ndarray:
    """Return the steps in (row, column) from a cell to half of the circle; the others are opposite."""
    angles = (np.arange(PAIRS) + 0.5) * np.pi / PAIRS
    steps = np.linalg.inv(grid.matrix) @ (radius * np.array([np.cos(angles), np.sin(angles)]))
    return steps[::-1].T  # the matrix maps (column, row) to (east, north)


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
