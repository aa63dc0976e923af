"""Running peaks of a 3D flow, over the node columns of its grid, in every step (see `accumulate_point_peaks`).

The sum of a node column's masses over its levels is the mass of the points under the horizontal part of the spline, as
a node of the depth-averaged solver has it. So both solvers keep the same peaks at the same places.
"""

from math import sqrt

from .block_order import CHUNKS
from .jit import jit_borrowing, jit_inline, jit_parallel, prange
from .point_ground import plane_at
from .point_rows import BLOCK, BLOCK_SIZE, GHOSTS, NODE_MASS, NODE_X, NODE_Y, NODE_Z

THICKNESS, SPEED, PRESSURE, ARRIVAL = range(4)  # of a node column's peaks, as in `mpmgis.peaks`
COLUMN_SUMS = 4 * BLOCK * BLOCK  # momentum [kg m s-1] and mass [kg] of a block's node columns
LONE_SHARE = 0.75 * 0.75  # of a point's mass, that a node column has of it at most
LONE_ROUNDING = 1e-5


@jit_inline
def _is_lowest(slots, place, up):
    """Is no block touched under the one `up` levels above the lowest at `place` of the window?"""
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
    """(how often a node counts, node beyond the wall whose mirror image it is or -1) along an axis with walls.

    The mirror image doubles a node on the wall; the one within has that of the one beyond (design notes 3.9).
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
def _column_mass(nodes, slots, row, column, west, south, width, height, depth):
    """Mass [kg] of the node column [row, column]; 0 where the window of blocks does not reach."""
    j, i = row // BLOCK - south, column // BLOCK - west
    mass = 0.0
    if 0 <= j < height and 0 <= i < width:
        first = ((row % BLOCK) * BLOCK + column % BLOCK) * 4 + NODE_MASS
        for up in range(depth):
            t = slots[(j * width + i) * depth + up]
            if t >= 0:
                for k in range(BLOCK):
                    mass += nodes[t, k * COLUMN_SUMS + first]
    return mass


@jit_borrowing
def _folded_mass(own, nodes, slots, row, column, west, south, width, height, depth, nx, ny):
    """Mass [kg] of a node column whose `own` it is, with what walls on the domain's edges mirror into it."""
    times_y, image_y = _mirror_image(row, ny)
    times_x, image_x = _mirror_image(column, nx)
    mass = times_y * times_x * own
    if image_y >= 0:
        mass += times_x * _column_mass(nodes, slots, image_y, column, west, south, width, height, depth)
    if image_x >= 0:
        mass += times_y * _column_mass(nodes, slots, row, image_x, west, south, width, height, depth)
    if image_y >= 0 and image_x >= 0:
        mass += _column_mass(nodes, slots, image_y, image_x, west, south, width, height, depth)
    return mass


@jit_parallel
def accumulate_point_peaks(
    peaks, sums, nodes, touched, n_touched, slots, west, south, width, height, depth, lowest, ground_nodes, dx, density,
    time, arrival_thickness, lone_thickness, wall, nx, ny,
):  # fmt: skip
    """Running peaks over the node columns: thickness [m], speed [m s-1], pressure rho |v|^2 [Pa], first arrival [s].

    Thickness is vertical, mass over density and the area of a cell. The velocity v is the mean over the column's mass,
    after the step's forces; speed is the length of its part along the ground (`Ut`, Eq 14), and the pressure counts all
    of it, as the bands do. Both, and the arrival, are of flow that is at least `arrival_thickness` [m] thick and more
    than a single point makes, `lone_thickness` [m]: a splash is none.

    Parameters
    ----------
    peaks : float64[rows, columns, PEAK_ENTRIES]
        Of all node columns.
    sums : float64[CHUNKS, COLUMN_SUMS]
        Room to work in.
    slots : int32[.]
        Touched block at each place of the window, or -1 (see `point_blocks.link_blocks`).
    """
    per_mass = 1.0 / (density * dx * dx)
    lone = lone_thickness * (1.0 + LONE_ROUNDING)
    for c in prange(CHUNKS):
        mine = sums[c]
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            row, column = touched[t, 0], touched[t, 1]
            place = ((row - south) * width + column - west) * depth
            if not _is_lowest(slots, place, touched[t, 2] - lowest[row, column, 0]):
                continue
            _sum_columns(mine, nodes, slots, place, depth)
            for j in range(max(row * BLOCK, GHOSTS), min((row + 1) * BLOCK, GHOSTS + ny + 1)):
                for i in range(max(column * BLOCK, GHOSTS), min((column + 1) * BLOCK, GHOSTS + nx + 1)):
                    s = ((j - row * BLOCK) * BLOCK + i - column * BLOCK) * 4
                    mass = mine[s + NODE_MASS]
                    if mass <= 0.0:
                        continue
                    folded = mass
                    if wall:
                        folded = _folded_mass(mass, nodes, slots, j, i, west, south, width, height, depth, nx, ny)
                    thickness = folded * per_mass
                    peaks[j, i, THICKNESS] = max(peaks[j, i, THICKNESS], thickness)
                    if thickness < arrival_thickness or mass * per_mass <= lone:
                        continue
                    u, v, w = mine[s + NODE_X] / mass, mine[s + NODE_Y] / mass, mine[s + NODE_Z] / mass
                    _, gx, gy, gz = plane_at(ground_nodes, j, i)
                    away = u * gx + v * gy + w * gz
                    speed2 = u * u + v * v + w * w
                    peaks[j, i, SPEED] = max(peaks[j, i, SPEED], sqrt(max(speed2 - away * away, 0.0)))
                    peaks[j, i, PRESSURE] = max(peaks[j, i, PRESSURE], density * speed2)
                    if peaks[j, i, ARRIVAL] < 0.0:
                        peaks[j, i, ARRIVAL] = time
