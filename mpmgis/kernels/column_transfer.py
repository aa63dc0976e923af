"""The two transfers of the depth-averaged MPM: columns to grid and grid to columns (design notes 3.4, 3.7).

A block sums its columns into a private tile, and the grid gathers the tiles that overlap a node in a fixed order.
Nothing is shared between loops and every sum has a fixed order, so that results are bitwise the same for any number of
threads.
"""

import numpy as np

from ..effects.metric import cosine_squared
from . import laws as _laws  # noqa: F401  (registers the methods of laws)
from .column_blocks import GONE, block_key
from .column_rows import (
    AREA,
    BLOCK,
    CHUNKS,
    CXX,
    CXY,
    CYX,
    CYY,
    GX,
    GY,
    INDEX_MASK,
    KAPPA,
    MASS,
    NODE_GAIN,
    TILE,
    U,
    V,
    X,
    Y,
    bed_at,
    weights,
)
from .jit import jit_inline, jit_parallel, prange
from .lanes import add_to, lane, lanes, load, multiply_add

# what each chunk of the grid-to-particle loop reports
(
    SIGNAL_MAX,  # max of |u| + sqrt(g h) [m s-1]
    SPEED_MAX,  # max of |u| [m s-1]
    KINETIC,  # sum of m |U|^2 / 2 [J]
    MOVING,  # mass with |U| above MOVING_SPEED [kg]
    FLOWING,  # mass with |U| above FLOWING_SPEED [kg]
    BOUND_RATIO,  # max of |U|^2 over its physical bound
    BOUND_X,  # where that is
    BOUND_Y,
    LIMITED,  # mass whose speed was cut to that bound [kg]
    WILD,  # mass at more than twice the speed of that bound [kg]
    NOT_FINITE,  # particles with a NaN or infinite state
    CLAMPED,  # areas reset because the column's thickness left the range about the grid's
    BLOCK_WEST,  # window of blocks that hold particles
    BLOCK_SOUTH,
    BLOCK_EAST,
    BLOCK_NORTH,
    STIFF,  # columns whose apparent viscosity was cut to what the time step allows
    ENTRAINED,  # mass taken up from the bed [kg]
    OUT,  # then the outflow ledger: per edge mass, momentum east and north, kinetic and potential energy, number
) = range(19)
EDGES = 5  # west, south, east, north, nodata
OUT_ENTRIES = 6
REPORT = OUT + EDGES * OUT_ENTRIES

MOVING_SPEED = 0.05  # [m s-1] (design notes 3.9)
FLOWING_SPEED = 1.0  # [m s-1] slower is creep, which changes no deposit
THINNEST = 1000.0  # a column keeps a thousandth of the grid's thickness: no push worth naming, and no endless area
AREA_FACTOR_MIN, AREA_FACTOR_MAX = 0.1, 10.0  # of one step (design notes 3.3)

_cosine_squared = jit_inline(cosine_squared)


@jit_parallel
def particles_to_grid(
    rows, order, start, block, bounds, west, south, width, tiles, bed, lake_level, report, dx, dt, density, gravity,
    metric, curvature, lake, earth_pressure, viscosity,
):  # fmt: skip
    """Sum mass, momentum and impulse of each block's particles into its tile (weak form, design notes 3.4).

    f_i = sum_p A_p rho g c^2 K h_p^2 / 2 P grad N_i - A_p h_p sigma_p P grad N_i - m_p g c^2 grad b N_i, with
    P = I - c^2 grad b grad b^T and momentum sum_p N_i m_p (u_p + C_p (x_i - x_p)) (APIC, Jiang et al. 2015).
    """
    inverse_dx = 1.0 / dx
    for c in prange(CHUNKS):
        stiff = 0.0
        for a in range(bounds[c], bounds[c + 1]):
            tile = tiles[a]
            tile[:] = 0.0
            nothing = lanes(0.0, 0.0, 0.0, 0.0)
            i_block = (block[a] % width + west) * BLOCK
            j_block = (block[a] // width + south) * BLOCK
            for q in range(start[a], start[a + 1]):
                p = order[q] & INDEX_MASK
                mass, area = rows[p, MASS], rows[p, AREA]
                i0, fx, wx0, wx1, wx2 = weights(rows[p, X], inverse_dx)
                j0, fy, wy0, wy1, wy2 = weights(rows[p, Y], inverse_dx)
                metric_x, metric_y = metric.metric_gradient(rows[p, GX], rows[p, GY])
                c2 = _cosine_squared(metric_x, metric_y)
                pressed, driven = mass * mass / (density * area), mass  # A rho h^2, and m
                if lake.still_water_active():
                    level = lake_level[int(rows[p, Y] * inverse_dx), int(rows[p, X] * inverse_dx)]
                    bed_here = bed_at(bed, rows[p, X], rows[p, Y], inverse_dx)[0]
                    still = density * area * lake.reference_depth(bed_here, level)
                    pressed -= still * still / (density * area)
                    driven -= still
                if earth_pressure.earth_pressure_active():
                    pressed *= earth_pressure.pressure_factor(_stretching_rate(rows[p]), dt)
                push = dt * 0.5 * gravity * c2 * pressed * inverse_dx
                along_xx, along_xy = 1.0 - c2 * metric_x * metric_x, -c2 * metric_x * metric_y
                along_yy = 1.0 - c2 * metric_y * metric_y
                push_xx, push_xy, push_yx, push_yy = push * along_xx, push * along_xy, push * along_xy, push * along_yy
                if viscosity.viscosity_active():
                    dxx, dxy, dyy = rows[p, CXX], 0.5 * (rows[p, CXY] + rows[p, CYX]), rows[p, CYY]
                    apparent = viscosity.apparent_viscosity(
                        mass / (density * area), rows[p, U], rows[p, V], dxx, dxy, dyy
                    )
                    largest = 0.125 * density * dx * dx / dt  # explicit diffusion is stable below four times that
                    stiff += apparent > largest
                    drawn = 2.0 * min(apparent, largest) * dt * inverse_dx * mass / density
                    push_xx -= drawn * (dxx * along_xx + dxy * along_xy)
                    push_xy -= drawn * (dxx * along_xy + dxy * along_yy)
                    push_yx -= drawn * (dxy * along_xx + dyy * along_xy)
                    push_yy -= drawn * (dxy * along_xy + dyy * along_yy)
                pull = dt * driven * gravity * c2
                qx, qy = mass * rows[p, U] - pull * rows[p, GX], mass * rows[p, V] - pull * rows[p, GY]
                mdx = mass * dx
                cxx, cxy, cyx, cyy = mdx * rows[p, CXX], mdx * rows[p, CXY], mdx * rows[p, CYX], mdx * rows[p, CYY]
                weighted_kappa = 0.0
                if curvature.curvature_active():
                    weighted_kappa = mass * rows[p, KAPPA]
                rx0, rx1, rx2 = -fx, 1.0 - fx, 2.0 - fx
                gx0, gx1, gx2 = fx - 1.5, 2.0 - 2.0 * fx, fx - 0.5
                ax0, ay0 = wx0 * (qx + cxx * rx0) + push_xx * gx0, wx0 * (qy + cyx * rx0) + push_yx * gx0
                ax1, ay1 = wx1 * (qx + cxx * rx1) + push_xx * gx1, wx1 * (qy + cyx * rx1) + push_yx * gx1
                ax2, ay2 = wx2 * (qx + cxx * rx2) + push_xx * gx2, wx2 * (qy + cyx * rx2) + push_yx * gx2
                t = ((j0 - j_block) * TILE + i0 - i_block) * 4
                node0 = lanes(wx0 * mass, ax0, ay0, wx0 * weighted_kappa)
                node1 = lanes(wx1 * mass, ax1, ay1, wx1 * weighted_kappa)
                node2 = lanes(wx2 * mass, ax2, ay2, wx2 * weighted_kappa)
                for j in range(3):
                    ry = j - fy
                    if j == 0:
                        wy, gy = wy0, fy - 1.5
                    elif j == 1:
                        wy, gy = wy1, 2.0 - 2.0 * fy
                    else:
                        wy, gy = wy2, fy - 0.5
                    line = lanes(0.0, wy * cxy * ry + gy * push_xy, wy * cyy * ry + gy * push_yy, 0.0)
                    add_to(tile, t, multiply_add(wy, node0, multiply_add(wx0, line, nothing)))
                    add_to(tile, t + 4, multiply_add(wy, node1, multiply_add(wx1, line, nothing)))
                    add_to(tile, t + 8, multiply_add(wy, node2, multiply_add(wx2, line, nothing)))
                    t += TILE * 4
        report[c, STIFF] = stiff


@jit_inline
def _stretching_rate(row):
    """Rate at which the flow stretches along its own direction [s-1]; its divergence while it is at rest."""
    u, v = row[U], row[V]
    speed2 = u * u + v * v
    along = u * u * row[CXX] + u * v * (row[CXY] + row[CYX]) + v * v * row[CYY]
    return along / speed2 if speed2 > 1e-12 else row[CXX] + row[CYY]


@jit_parallel
def gather_tiles(nodes, tiles, slot, west, south, width, height, touched, n_touched):
    """Sum the up to four tiles that overlap each node of the touched blocks, always in the same order."""
    rows, columns = nodes.shape[0], nodes.shape[1]
    for k in prange(n_touched):
        bi, bj = touched[k] % (width + 1), touched[k] // (width + 1)
        j_first, i_first = (bj + south) * BLOCK, (bi + west) * BLOCK
        for j in range(j_first, min(j_first + BLOCK, rows)):
            for i in range(i_first, min(i_first + BLOCK, columns)):
                nodes[j, i, :] = 0.0
        for back_j in range(2):
            for back_i in range(2):
                oi, oj = bi - back_i, bj - back_j
                if oi < 0 or oj < 0 or oi >= width or oj >= height or slot[oj * width + oi] < 0:
                    continue
                tile = tiles[slot[oj * width + oi]]
                for j in range(TILE - BLOCK if back_j else BLOCK):
                    for i in range(TILE - BLOCK if back_i else BLOCK):
                        if j_first + j < rows and i_first + i < columns:
                            t = ((j + BLOCK * back_j) * TILE + i + BLOCK * back_i) * 4
                            for e in range(4):
                                nodes[j_first + j, i_first + i, e] += tile[t + e]


@jit_parallel
def grid_to_particles(
    rows, keys, order, start, block, bounds, west, south, width, nodes, bed, inside, report,
    dx, dt, density, gravity, clamp, wall, bound_bed, bound_energy, pressure_factor, metric, curvature, entrainment,
):  # fmt: skip
    """Read the new velocity field back, move the columns, stretch their areas, turn velocities with the bed.

    APIC: u_p = sum N_i v_i, C_p = 4/dx^2 sum N_i v_i (x_i - x_p)^T; A_p *= det(I + dt grad u_p). With `clamp` a column
    stays below `clamp` times the grid's thickness where the flow spreads, and above 1/clamp of it where it converges.
    No column is faster than its drop in height allows. Columns that leave through an open edge or onto
    nodata go to the ledger and get the key GONE.
    """
    inverse_dx = 1.0 / dx
    ny, nx = inside.shape
    length_x, length_y = nx * dx, ny * dx
    node_columns = nodes.shape[1]
    nothing = lanes(0.0, 0.0, 0.0, 0.0)
    for c in prange(CHUNKS):
        mine = report[c]
        mine[:STIFF] = 0.0
        mine[ENTRAINED:] = 0.0
        signal2_max, speed2_max, kinetic, moving, flowing, clamped = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        limited, wild, entrained = 0.0, 0.0, 0.0
        bound_ratio, bound_x, bound_y = 0.0, 0.0, 0.0
        block_west, block_south, block_east, block_north = 1 << 16, 1 << 16, -1, -1
        for a in range(bounds[c], bounds[c + 1]):
            for q in range(start[a], start[a + 1]):
                p = order[q] & INDEX_MASK
                mass = rows[p, MASS]
                i0, fx, wx0, wx1, wx2 = weights(rows[p, X], inverse_dx)
                j0, fy, wy0, wy1, wy2 = weights(rows[p, Y], inverse_dx)
                gx0, gx1, gx2 = fx - 1.5, 2.0 - 2.0 * fx, fx - 0.5
                rx0, rx1, rx2 = -fx * wx0, (1.0 - fx) * wx1, (2.0 - fx) * wx2
                mean = along_x = along_y = moment_x = moment_y = nothing  # of a node's mass and velocity
                t = (j0 * node_columns + i0) * 4
                for j in range(3):
                    ry = j - fy
                    if j == 0:
                        wy, gy = wy0, fy - 1.5
                    elif j == 1:
                        wy, gy = wy1, 2.0 - 2.0 * fy
                    else:
                        wy, gy = wy2, fy - 0.5
                    node0, node1, node2 = load(nodes, t), load(nodes, t + 4), load(nodes, t + 8)
                    t += node_columns * 4
                    line = multiply_add(wx0, node0, multiply_add(wx1, node1, multiply_add(wx2, node2, nothing)))
                    slope = multiply_add(gx0, node0, multiply_add(gx1, node1, multiply_add(gx2, node2, nothing)))
                    moment = multiply_add(rx0, node0, multiply_add(rx1, node1, multiply_add(rx2, node2, nothing)))
                    mean = multiply_add(wy, line, mean)
                    along_x = multiply_add(wy, slope, along_x)
                    along_y = multiply_add(gy, line, along_y)
                    moment_x = multiply_add(wy, moment, moment_x)
                    moment_y = multiply_add(wy * ry, line, moment_y)
                grid_mass, u, v = lane(mean, 0), lane(mean, 1), lane(mean, 2)
                if entrainment.entrainment_active():
                    gained = mass * lane(mean, NODE_GAIN)
                    entrained += gained
                    mass += gained
                    rows[p, MASS] = mass
                ux, vx, uy, vy = lane(along_x, 1), lane(along_x, 2), lane(along_y, 1), lane(along_y, 2)
                cxx, cyx, cxy, cyy = lane(moment_x, 1), lane(moment_x, 2), lane(moment_y, 1), lane(moment_y, 2)
                stretch = (1.0 + dt * ux * inverse_dx) * (1.0 + dt * vy * inverse_dx) - dt * dt * uy * vx * (
                    inverse_dx * inverse_dx
                )
                area = rows[p, AREA] * min(max(stretch, AREA_FACTOR_MIN), AREA_FACTOR_MAX)
                grid_area = mass * dx * dx  # times grid_mass: the area with which the column is as thick as the grid
                area = min(area, THINNEST * grid_area / grid_mass)
                if clamp > 0.0:
                    if ux + vy >= 0.0:
                        if area * grid_mass * clamp < grid_area:
                            area = grid_area / (grid_mass * clamp)
                            clamped += 1.0
                    elif area * grid_mass > clamp * grid_area:
                        area = clamp * grid_area / grid_mass
                        clamped += 1.0
                x, y = rows[p, X] + dt * u, rows[p, Y] + dt * v
                if (x + y + area) * 0.0 != 0.0:  # NaN or infinite
                    mine[NOT_FINITE] += 1.0
                    mine[BOUND_X], mine[BOUND_Y] = rows[p, X], rows[p, Y]
                    continue
                if wall:
                    x = min(max(x, 1e-9 * dx), length_x - 1e-9 * dx)
                    y = min(max(y, 1e-9 * dx), length_y - 1e-9 * dx)
                edge = -1
                if x < 0.0:
                    edge = 0
                elif y < 0.0:
                    edge = 1
                elif x >= length_x:
                    edge = 2
                elif y >= length_y:
                    edge = 3
                elif inside[int(y * inverse_dx), int(x * inverse_dx)] == 0:
                    edge = 4
                if edge >= 0:
                    mx, my = metric.metric_gradient(rows[p, GX], rows[p, GY])
                    w = u * mx + v * my
                    out = OUT + edge * OUT_ENTRIES
                    mine[out] += mass
                    mine[out + 1] += mass * u
                    mine[out + 2] += mass * v
                    mine[out + 3] += 0.5 * mass * (u * u + v * v + w * w)
                    bed_last = bed_at(bed, rows[p, X], rows[p, Y], inverse_dx)[0]
                    mine[out + 4] += mass * gravity * (bed_last + 0.5 * mass / (density * area))
                    mine[out + 5] += 1.0
                    keys[p] = GONE
                    continue
                old_x, old_y = rows[p, GX], rows[p, GY]
                bed_here, gradient_x, gradient_y = bed_at(bed, x, y, inverse_dx)
                if curvature.curvature_active():
                    rows[p, KAPPA] = curvature.centrifugal_acceleration(u, v, old_x, old_y, gradient_x, gradient_y, dt)
                u, v = curvature.turned_velocity(u, v, old_x, old_y, gradient_x, gradient_y)
                four = 4.0 * inverse_dx
                rows[p, X], rows[p, Y], rows[p, U], rows[p, V], rows[p, AREA] = x, y, u, v, area
                rows[p, CXX], rows[p, CXY], rows[p, CYX], rows[p, CYY] = four * cxx, four * cxy, four * cyx, four * cyy
                rows[p, GX], rows[p, GY] = gradient_x, gradient_y
                mx, my = metric.metric_gradient(gradient_x, gradient_y)
                w = u * mx + v * my
                horizontal2 = u * u + v * v
                speed2 = horizontal2 + w * w
                bound = 1.05 * (2.0 * gravity * max(bound_bed - bed_here, 0.0) + bound_energy)
                if speed2 > bound_ratio * bound:
                    bound_ratio, bound_x, bound_y = speed2 / bound, x, y
                if speed2 > bound:  # a speed from level ground that the grid lays on a wall
                    slower = np.sqrt(bound / speed2)
                    rows[p, U], rows[p, V] = u * slower, v * slower
                    limited += mass
                    if speed2 > 4.0 * bound:
                        wild += mass
                    horizontal2, speed2 = horizontal2 * bound / speed2, bound
                thickness = mass / (density * area)
                speed2_max = max(speed2_max, horizontal2)
                wave2 = pressure_factor * gravity * thickness
                signal2_max = max(signal2_max, horizontal2 + wave2 + 2.0 * np.sqrt(horizontal2 * wave2))
                kinetic += mass * speed2
                if speed2 > MOVING_SPEED * MOVING_SPEED:
                    moving += mass
                    if speed2 > FLOWING_SPEED * FLOWING_SPEED:
                        flowing += mass
                key = block_key(x, y, inverse_dx)
                keys[p] = key
                column, line = key & 0xFFFF, key >> 16
                block_west, block_east = min(block_west, column), max(block_east, column)
                block_south, block_north = min(block_south, line), max(block_north, line)
        mine[SIGNAL_MAX], mine[SPEED_MAX] = np.sqrt(signal2_max), np.sqrt(speed2_max)
        mine[KINETIC], mine[MOVING], mine[FLOWING], mine[CLAMPED] = 0.5 * kinetic, moving, flowing, clamped
        mine[LIMITED], mine[WILD], mine[ENTRAINED] = limited, wild, entrained
        if mine[NOT_FINITE] == 0.0:
            mine[BOUND_RATIO], mine[BOUND_X], mine[BOUND_Y] = bound_ratio, bound_x, bound_y
        mine[BLOCK_WEST], mine[BLOCK_SOUTH] = block_west, block_south
        mine[BLOCK_EAST], mine[BLOCK_NORTH] = block_east, block_north
