"""Running peaks of a 3D flow, over the node columns of its grid, in every step (see `accumulate_point_peaks`).

The sum of the masses of a node column over its levels is the mass of the points below the horizontal part of the
spline, as at a node of the depth-averaged solver: both solvers store the same peaks at the same places.
"""

from math import sqrt

import numpy as np

from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit_borrowing, jit_inline, jit_parallel, prange
from ...frames.peaks import ARRIVAL, PRESSURE, SPEED, THICKNESS
from .point_ground import plane_at
from .point_rows import BLOCK, BLOCK_SIZE, GHOSTS, NODE_MASS, NODE_X, NODE_Y, NODE_Z, BlockWindow, NodeBlocks, Settings

COLUMN_SUMS = 4 * BLOCK * BLOCK  # numbers of a block's node columns: momentum [kg m s-1] and mass [kg] of each
LONE_SHARE = 0.75 * 0.75  # [1] largest share of the mass of a point at one node column: the spline at its middle
LONE_ROUNDING = 1e-5  # [1] relative rounding error of that share in single precision


@jit_inline
def is_lowest(slots: np.ndarray, place: int, up: int) -> bool:
    """Return whether no block is touched below one in a block column.

    Parameters
    ----------
    slots : int32[places]
        Touched block at each place of the window, or -1.
    place : int
        Of the lowest block of the column.
    up : int
        Levels of the block above that one.
    """
    below = up - 1
    while below >= 0 and slots[place + below] < 0:
        below -= 1
    return below < 0


@jit_borrowing
def _sum_columns(sums, nodes, slots, place, depth):
    """Sum momentum and mass of a block column's node columns into `sums`, from the lowest block upwards."""
    sums[:] = 0.0
    for up in range(depth):
        t = slots[place + up]
        if t < 0:
            continue
        for n in range(0, BLOCK_SIZE, COLUMN_SUMS):
            for s in range(0, COLUMN_SUMS, 4):
                mass = float(nodes[t, n + s + NODE_MASS])
                sums[s + NODE_X] += mass * nodes[t, n + s + NODE_X]
                sums[s + NODE_Y] += mass * nodes[t, n + s + NODE_Y]
                sums[s + NODE_Z] += mass * nodes[t, n + s + NODE_Z]
                sums[s + NODE_MASS] += mass


@jit_inline
def _mirror_image(index, cells):
    """Return (multiplicity of a node, node beyond the wall that is mirrored into it or -1) along an axis with walls.

    Reflection doubles a node on the wall; the first node inside receives that beyond the wall.
    """
    west, east = GHOSTS, GHOSTS + cells
    times, image = 1.0, -1
    if index in (west, east):
        times = 2.0
    elif index == west + 1:
        image = west - 1
    elif index == east - 1:
        image = east + 1
    return times, image


@jit_inline
def _column_mass(nodes, window, row, column):
    """Compute the mass [kg] of the node column [row, column]; 0 outside the window of blocks."""
    j, i = row // BLOCK - window.south, column // BLOCK - window.west
    mass = 0.0
    if 0 <= j < window.height and 0 <= i < window.width:
        first = ((row % BLOCK) * BLOCK + column % BLOCK) * 4 + NODE_MASS
        for up in range(window.depth):
            t = window.slots[(j * window.width + i) * window.depth + up]
            if t >= 0:
                for k in range(BLOCK):
                    mass += nodes[t, k * COLUMN_SUMS + first]
    return mass


@jit_borrowing
def _folded_mass(own, nodes, window, row, column, nx, ny):
    """Compute the mass [kg] of a node column of `own` mass [kg], with that which walls on the edges mirror into it."""
    times_y, image_y = _mirror_image(row, ny)
    times_x, image_x = _mirror_image(column, nx)
    mass = times_y * times_x * own
    if image_y >= 0:
        mass += times_x * _column_mass(nodes, window, image_y, column)
    if image_x >= 0:
        mass += times_y * _column_mass(nodes, window, row, image_x)
    if image_y >= 0 and image_x >= 0:
        mass += _column_mass(nodes, window, image_y, image_x)
    return mass


@jit_inline
def note_column_peaks(
    peaks: np.ndarray,
    j: int,
    i: int,
    px: float,
    py: float,
    pz: float,
    mass: float,
    nodes: np.ndarray,
    window: BlockWindow,
    ground_nodes: np.ndarray,
    time: float,
    settings: Settings,
) -> None:
    """Update the peaks of a node column, see `accumulate_point_peaks`.

    Parameters
    ----------
    peaks : float64[rows, columns, PEAK_ENTRIES]
    j, i : int
        Row and column.
    px, py, pz : float [kg m s-1]
        Momentum of the column.
    mass : float [kg]
        Of the column.
    nodes : float[touched, BLOCK_SIZE]
    window : BlockWindow
    ground_nodes : float64[rows, columns, GROUND_ENTRIES]
    time : float [s]
    settings : Settings
    """
    density = settings.density
    per_mass = 1.0 / (density * settings.dx * settings.dx)
    lone = settings.lone_thickness * (1.0 + LONE_ROUNDING)
    if mass <= 0.0:
        return
    folded = mass
    if settings.wall:
        folded = _folded_mass(mass, nodes, window, j, i, settings.cells_x, settings.cells_y)
    thickness = folded * per_mass
    peaks[j, i, THICKNESS] = max(peaks[j, i, THICKNESS], thickness)
    if thickness < settings.arrival_thickness or mass * per_mass <= lone:
        return
    u, v, w = px / mass, py / mass, pz / mass
    _, gx, gy, gz = plane_at(ground_nodes, j, i)
    away = u * gx + v * gy + w * gz
    speed2 = u * u + v * v + w * w
    peaks[j, i, SPEED] = max(peaks[j, i, SPEED], sqrt(max(speed2 - away * away, 0.0)))
    peaks[j, i, PRESSURE] = max(peaks[j, i, PRESSURE], density * speed2)
    if peaks[j, i, ARRIVAL] < 0.0:
        peaks[j, i, ARRIVAL] = time


@jit_borrowing
def note_block_peaks(
    peaks: np.ndarray,
    part: np.ndarray,
    t: int,
    grid: NodeBlocks,
    window: BlockWindow,
    ground_nodes: np.ndarray,
    time: float,
    settings: Settings,
) -> None:
    """Update the peaks of the node columns of a block column, see `accumulate_point_peaks`.

    Parameters
    ----------
    peaks : float64[rows, columns, PEAK_ENTRIES]
    part : float64[COLUMN_SUMS]
        Work array.
    t : int
        Lowest touched block of the column; for others nothing is done.
    grid : NodeBlocks
    window : BlockWindow
    ground_nodes : float64[rows, columns, GROUND_ENTRIES]
    time : float [s]
    settings : Settings
    """
    nodes, touched = grid.nodes, grid.touched
    depth, nx, ny = window.depth, settings.cells_x, settings.cells_y
    row, column = touched[t, 0], touched[t, 1]
    place = ((row - window.south) * window.width + column - window.west) * depth
    if not is_lowest(window.slots, place, touched[t, 2] - window.lowest[row, column, 0]):
        return
    _sum_columns(part, nodes, window.slots, place, depth)
    for j in range(max(row * BLOCK, GHOSTS), min((row + 1) * BLOCK, GHOSTS + ny + 1)):
        for i in range(max(column * BLOCK, GHOSTS), min((column + 1) * BLOCK, GHOSTS + nx + 1)):
            s = ((j - row * BLOCK) * BLOCK + i - column * BLOCK) * 4
            note_column_peaks(
                peaks,
                j,
                i,
                part[s + NODE_X],
                part[s + NODE_Y],
                part[s + NODE_Z],
                part[s + NODE_MASS],
                nodes,
                window,
                ground_nodes,
                time,
                settings,
            )


@jit_parallel
def accumulate_point_peaks(
    peaks: np.ndarray,
    sums: np.ndarray,
    grid: NodeBlocks,
    window: BlockWindow,
    ground_nodes: np.ndarray,
    time: float,
    settings: Settings,
) -> None:
    """Update the running peaks at all node columns: thickness, speed, pressure and first arrival.

    Thickness [m] is vertical: mass over density and the area of a cell. The velocity v is the mean over the mass of the
    column, after the forces of the step; speed [m s-1] is the length of its part along the ground (`Ut`, Eq 14),
    pressure rho |v|^2 [Pa] uses all of it, as the bands do. Both, and the arrival [s], require a thickness of at least
    `settings.arrival_thickness` [m] and of more than a single point has, `settings.lone_thickness` [m].

    Parameters
    ----------
    peaks : float64[rows, columns, PEAK_ENTRIES]
        Of all node columns.
    sums : float64[CHUNKS, COLUMN_SUMS]
        Work array.
    grid : NodeBlocks
    window : BlockWindow
    ground_nodes : float64[rows, columns, GROUND_ENTRIES]
    time : float [s]
    settings : Settings
    """
    n_touched = grid.count
    for c in prange(CHUNKS):
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            note_block_peaks(peaks, sums[c], t, grid, window, ground_nodes, time, settings)
