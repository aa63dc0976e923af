"""The two transfers of the depth-averaged MPM: columns to grid and grid to columns (design notes 3.4, 3.7).

A block sums its columns into a private tile, and the grid gathers the tiles that overlap a node in a fixed order.
Nothing is shared between loops and every sum has a fixed order, so that results are bitwise the same for any number of
threads.
"""

from math import sqrt

import numpy as np

from ..effects.metric import cosine_squared
from . import laws as _laws  # noqa: F401  (registers the methods of laws)
from .block_order import CHUNKS, GONE
from .column_blocks import block_key
from .column_rows import BLOCK, INDEX_MASK, NODE_GAIN, NODE_MASS, NODE_X, NODE_Y, ROW, TILE, bed_at, weights
from .jit import jit, jit_inline, jit_parallel, prange
from .lanes import get, get_of_four, lanes, load, multiply_add, prefetch, put, put_four, store, transposed

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
    ENTRAINED_POTENTIAL,  # potential energy of that mass where it joins the flow, from elevation 0 [J]
    WORK,  # work of weight and pressure on the columns [J]
    BENT,  # potential energy that columns gain as the bed under them changes its slope [J]
    LIMITED_LOSS,  # kinetic energy taken by the speed bound [J]
    FASTEST2,  # max of |U|^2 [m2 s-2]
    HELD_STRETCH,  # columns whose area would have grown or shrunk more in one step than AREA_FACTOR_MIN and _MAX allow
    HELD_THIN,  # columns that would have been thinner than 1 / THINNEST of the grid
    HELD_SPEED,  # columns whose speed was cut to its bound
    HELD_WALL,  # columns that would have passed a wall at the edge
    OUT,  # then the outflow ledger: per edge mass, momentum east and north, kinetic and potential energy, number
) = range(28)
EDGES = 5  # west, south, east, north, nodata
OUT_ENTRIES = 6
REPORT = OUT + EDGES * OUT_ENTRIES

MOVING_SPEED = 0.05  # [m s-1] (design notes 3.9)
FLOWING_SPEED = 1.0  # [m s-1] slower is creep, which changes no deposit
THINNEST = 1000.0  # a column keeps a thousandth of the grid's thickness: no push worth naming, and no endless area
AREA_FACTOR_MIN, AREA_FACTOR_MAX = 0.1, 10.0  # of one step (design notes 3.3)

_cosine_squared = jit_inline(cosine_squared)


# Columns go through a transfer BATCH at a time: in loops over short arrays ("lines" of one scratch array), which the
# compiler turns into vector instructions; only reading and writing nodes and rows goes column by column.
BATCH = 32
(
    L_X, L_Y, L_U, L_V, L_CXX, L_CXY, L_CYX, L_CYY, L_MASS, L_AREA, L_GX, L_GY,  # as in a row
    L_WX0, L_WX1, L_WX2, L_WY0, L_WY1, L_WY2,  # weights
    L_SX, L_MX, L_SY, L_MY,  # offset from the middle node, and what it makes of second differences in a moment
    L_GX0, L_GX1, L_GX2, L_GY0, L_GY1, L_GY2,  # slopes of weights
    L_SPEED2, L_HORIZONTAL2, L_SIGNAL2, L_BOUND, L_GAINED, L_WORK, L_TAKEN, L_BENT,
) = range(0, 36 * BATCH, BATCH)  # fmt: skip
LINES = 36 * BATCH
QUAD = 4 * BATCH  # groups of four numbers, one group a column
QUADS = 6 * QUAD


@jit
def _take_rows(rows, order, first, count, end, scratch, moved):
    """Copy the rows of columns order[first : first + count] into the lines of `scratch`, four columns at a time.

    Without the affine velocity if `moved` is False. The rows of the next batch, up to place `end` in the order, are
    asked for from memory while this one is worked on.
    """
    for q in range(first + BATCH, min(first + 2 * BATCH, end)):
        p = (order[q] & INDEX_MASK) * ROW
        prefetch(rows, p)
        prefetch(rows, p + ROW - 1)
    for k in range(0, count, 4):  # beyond `count` the last column once more, which nobody reads
        last = count - 1
        p0 = (order[first + k] & INDEX_MASK) * ROW
        p1 = (order[first + min(k + 1, last)] & INDEX_MASK) * ROW
        p2 = (order[first + min(k + 2, last)] & INDEX_MASK) * ROW
        p3 = (order[first + min(k + 3, last)] & INDEX_MASK) * ROW
        for e in range(0, ROW, 4 if moved else 8):
            a, b, c, d = transposed(load(rows, p0 + e), load(rows, p1 + e), load(rows, p2 + e), load(rows, p3 + e))
            line = e * BATCH + k
            store(scratch, line, a)
            store(scratch, line + BATCH, b)
            store(scratch, line + 2 * BATCH, c)
            store(scratch, line + 3 * BATCH, d)


@jit
def _impulses(scratch, quads, place, count, i_block, j_block, bed, lake_level, dx, dt, density, gravity,
              metric, lake, earth_pressure, viscosity):  # fmt: skip
    """What each column of the batch gives to its nodes, as weights and four-number groups; answers capped viscosities.

    Node (i, j) gets wy_j * column_i + wx_i * line_j of (mass, momentum east, north, kinetic energy before the step).
    """
    inverse_dx = 1.0 / dx
    stiff = 0
    for k in range(count):
        mass, area = get(scratch, L_MASS, k), get(scratch, L_AREA, k)
        slope_x, slope_y = get(scratch, L_GX, k), get(scratch, L_GY, k)
        x, y = get(scratch, L_X, k), get(scratch, L_Y, k)
        u, v = get(scratch, L_U, k), get(scratch, L_V, k)
        i0, fx, wx0, wx1, wx2 = weights(x, inverse_dx)
        j0, fy, wy0, wy1, wy2 = weights(y, inverse_dx)
        put(place, 0, k, ((j0 - j_block) * TILE + i0 - i_block) * 4)
        metric_x, metric_y = metric.metric_gradient(slope_x, slope_y)
        c2 = _cosine_squared(metric_x, metric_y)
        pressed, driven = mass * mass / (density * area), mass  # A rho h^2, and m
        if lake.still_water_active():
            level = lake_level[int(y * inverse_dx), int(x * inverse_dx)]
            bed_here = bed_at(bed, x, y, inverse_dx)[0]
            still = density * area * lake.reference_depth(bed_here, level)
            pressed -= still * still / (density * area)
            driven -= still
        cxx, cxy, cyx, cyy = (
            get(scratch, L_CXX, k), get(scratch, L_CXY, k), get(scratch, L_CYX, k), get(scratch, L_CYY, k),
        )  # fmt: skip
        if earth_pressure.earth_pressure_active():
            pressed *= earth_pressure.pressure_factor(_stretching_rate(u, v, cxx, cxy + cyx, cyy), dt)
        push = dt * 0.5 * gravity * c2 * pressed * inverse_dx
        along_xx, along_xy = 1.0 - c2 * metric_x * metric_x, -c2 * metric_x * metric_y
        along_yy = 1.0 - c2 * metric_y * metric_y
        push_xx, push_xy, push_yx, push_yy = push * along_xx, push * along_xy, push * along_xy, push * along_yy
        if viscosity.viscosity_active():
            dxy = 0.5 * (cxy + cyx)
            apparent = viscosity.apparent_viscosity(mass / (density * area), u, v, cxx, dxy, cyy)
            largest = 0.125 * density * dx * dx / dt  # explicit diffusion is stable below four times that
            stiff += apparent > largest
            drawn = 2.0 * min(apparent, largest) * dt * inverse_dx * mass / density
            push_xx -= drawn * (cxx * along_xx + dxy * along_xy)
            push_xy -= drawn * (cxx * along_xy + dxy * along_yy)
            push_yx -= drawn * (dxy * along_xx + cyy * along_xy)
            push_yy -= drawn * (dxy * along_xy + cyy * along_yy)
        pull = dt * driven * gravity * c2
        w = u * metric_x + v * metric_y
        kinetic = 0.5 * mass * (u * u + v * v + w * w)
        mdx = mass * dx
        cxx, cxy, cyx, cyy = mdx * cxx, mdx * cxy, mdx * cyx, mdx * cyy
        # momentum at the column's own place, carried to the first node: -f cells away in each axis
        qx = mass * u - pull * slope_x - fx * cxx - fy * cxy
        qy = mass * v - pull * slope_y - fx * cyx - fy * cyy
        put(scratch, L_WX0, k, wx0)
        put(scratch, L_WX1, k, wx1)
        put(scratch, L_WX2, k, wx2)
        put(scratch, L_WY0, k, wy0)
        put(scratch, L_WY1, k, wy1)
        put(scratch, L_WY2, k, wy2)
        put_four(
            quads, 0 * QUAD, k, wx0 * mass, wx0 * qx + push_xx * (fx - 1.5),
            wx0 * qy + push_yx * (fx - 1.5), wx0 * kinetic,
        )  # fmt: skip
        put_four(
            quads, 1 * QUAD, k, wx1 * mass, wx1 * (qx + cxx) + push_xx * (2.0 - 2.0 * fx),
            wx1 * (qy + cyx) + push_yx * (2.0 - 2.0 * fx), wx1 * kinetic,
        )  # fmt: skip
        put_four(
            quads, 2 * QUAD, k, wx2 * mass, wx2 * (qx + 2.0 * cxx) + push_xx * (fx - 0.5),
            wx2 * (qy + 2.0 * cyx) + push_yx * (fx - 0.5), wx2 * kinetic,
        )  # fmt: skip
        put_four(quads, 3 * QUAD, k, 0.0, push_xy * (fy - 1.5), push_yy * (fy - 1.5), 0.0)
        line = 2.0 - 2.0 * fy
        put_four(quads, 4 * QUAD, k, 0.0, wy1 * cxy + push_xy * line, wy1 * cyy + push_yy * line, 0.0)
        line = fy - 0.5
        put_four(quads, 5 * QUAD, k, 0.0, 2.0 * wy2 * cxy + push_xy * line, 2.0 * wy2 * cyy + push_yy * line, 0.0)
    return stiff


@jit
def _spread(scratch, quads, place, count, tile):
    """Add each column's nine products to the block's tile.

    Columns from the two halves of the batch take turns: neighbours add to the same nodes, and would wait for each
    other's sums.
    """
    half = (count + 1) // 2
    for k in range(half):
        _spread_one(scratch, quads, place, k, tile)
        if k + half < count:
            _spread_one(scratch, quads, place, k + half, tile)


@jit_inline
def _spread_one(scratch, quads, place, k, tile):
    t, q = place[k], 4 * k
    wx0, wx1, wx2 = get(scratch, L_WX0, k), get(scratch, L_WX1, k), get(scratch, L_WX2, k)
    node0, node1, node2 = load(quads, q), load(quads, q + QUAD), load(quads, q + 2 * QUAD)
    for j in range(3):
        wy = get(scratch, L_WY0 + j * BATCH, k)
        line = load(quads, q + (3 + j) * QUAD)
        store(tile, t, multiply_add(wy, node0, multiply_add(wx0, line, load(tile, t))))
        store(tile, t + 4, multiply_add(wy, node1, multiply_add(wx1, line, load(tile, t + 4))))
        store(tile, t + 8, multiply_add(wy, node2, multiply_add(wx2, line, load(tile, t + 8))))
        t += TILE * 4


@jit_parallel
def particles_to_grid(
    rows, order, start, block, bounds, west, south, width, tiles, bed, lake_level, report, dx, dt, density, gravity,
    metric, lake, earth_pressure, viscosity,
):  # fmt: skip
    """Sum mass, momentum and impulse of each block's particles into its tile (weak form, design notes 3.4).

    f_i = sum_p A_p rho g c^2 K h_p^2 / 2 P grad N_i - A_p h_p sigma_p P grad N_i - m_p g c^2 grad b N_i, with
    P = I - c^2 grad b grad b^T and momentum sum_p N_i m_p (u_p + C_p (x_i - x_p)) (APIC, Jiang et al. 2015).
    """
    for c in prange(CHUNKS):
        scratch = np.empty(LINES)
        quads = np.empty(QUADS)
        place = np.empty(BATCH, np.int64)
        stiff = 0
        for a in range(bounds[c], bounds[c + 1]):
            tile = tiles[a]
            tile[:] = 0.0
            i_block = (block[a] % width + west) * BLOCK
            j_block = (block[a] // width + south) * BLOCK
            for first in range(start[a], start[a + 1], BATCH):
                count = min(BATCH, start[a + 1] - first)
                _take_rows(rows, order, first, count, order.size, scratch, True)
                stiff += _impulses(
                    scratch, quads, place, count, i_block, j_block, bed, lake_level, dx, dt, density, gravity,
                    metric, lake, earth_pressure, viscosity,
                )  # fmt: skip
                _spread(scratch, quads, place, count, tile)
        report[c, STIFF] = stiff


@jit_inline
def _stretching_rate(u, v, dxx, two_dxy, dyy):
    """Rate at which the flow stretches along its own direction [s-1]; its divergence while it is at rest."""
    speed2 = u * u + v * v
    along = u * u * dxx + u * v * two_dxy + v * v * dyy
    return along / speed2 if speed2 > 1e-12 else dxx + dyy


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


# groups of four: mean of the nodes' entries, their slopes and moments; the bed's rows under a column
Q_MEAN, Q_ALONG_X, Q_ALONG_Y, Q_MOMENT_X, Q_MOMENT_Y = range(0, 5 * QUAD, QUAD)
Q_BED, Q_BED_SLOPE = Q_MEAN, Q_ALONG_X


@jit
def _weigh(scratch, place, count, row_length, inverse_dx):
    """Fill the lines of weights and offsets at each column, and where its nodes begin in the array of nodes."""
    for k in range(count):
        i0, fx, wx0, wx1, wx2 = weights(get(scratch, L_X, k), inverse_dx)
        j0, fy, wy0, wy1, wy2 = weights(get(scratch, L_Y, k), inverse_dx)
        put(place, 0, k, (j0 * row_length + i0) * 4)
        put(scratch, L_WX0, k, wx0)
        put(scratch, L_WX1, k, wx1)
        put(scratch, L_WX2, k, wx2)
        put(scratch, L_WY0, k, wy0)
        put(scratch, L_WY1, k, wy1)
        put(scratch, L_WY2, k, wy2)
        sx, sy = fx - 1.0, fy - 1.0
        put(scratch, L_SX, k, sx)
        put(scratch, L_SY, k, sy)
        put(scratch, L_MX, k, sx * (0.375 - 0.5 * sx * sx))
        put(scratch, L_MY, k, sy * (0.375 - 0.5 * sy * sy))


@jit_inline
def _slope_and_moment(first, middle, last, offset, moment):
    """Slope per cell, and moment about the column in cells, of three nodes' entries in a row.

    With D = (n2 - n0) / 2, S = n0 - 2 n1 + n2 and s the offset from the middle node: sum N_i' n_i = D + s S and
    sum N_i n_i (i - s) = D / 4 + s (3/8 - s^2 / 2) S.
    """
    nothing = lanes(0.0, 0.0, 0.0, 0.0)
    half = multiply_add(0.5, last, multiply_add(-0.5, first, nothing))
    bend = multiply_add(-2.0, middle, multiply_add(1.0, first, last))
    return multiply_add(offset, bend, half), multiply_add(moment, bend, multiply_add(0.25, half, nothing))


@jit
def _read_nodes(scratch, quads, place, count, nodes):
    """Mean, slopes and first moments of the nodes' four entries around each column."""
    nothing = lanes(0.0, 0.0, 0.0, 0.0)
    row_length = nodes.shape[1] * 4
    for k in range(count):
        t0 = place[k]
        t1 = t0 + row_length
        t2 = t1 + row_length
        wx0, wx1, wx2 = get(scratch, L_WX0, k), get(scratch, L_WX1, k), get(scratch, L_WX2, k)
        wy0, wy1, wy2 = get(scratch, L_WY0, k), get(scratch, L_WY1, k), get(scratch, L_WY2, k)
        a0, a1, a2 = load(nodes, t0), load(nodes, t0 + 4), load(nodes, t0 + 8)
        b0, b1, b2 = load(nodes, t1), load(nodes, t1 + 4), load(nodes, t1 + 8)
        c0, c1, c2 = load(nodes, t2), load(nodes, t2 + 4), load(nodes, t2 + 8)
        south = multiply_add(wx0, a0, multiply_add(wx1, a1, multiply_add(wx2, a2, nothing)))
        here = multiply_add(wx0, b0, multiply_add(wx1, b1, multiply_add(wx2, b2, nothing)))
        north = multiply_add(wx0, c0, multiply_add(wx1, c1, multiply_add(wx2, c2, nothing)))
        west = multiply_add(wy0, a0, multiply_add(wy1, b0, multiply_add(wy2, c0, nothing)))
        middle = multiply_add(wy0, a1, multiply_add(wy1, b1, multiply_add(wy2, c1, nothing)))
        east = multiply_add(wy0, a2, multiply_add(wy1, b2, multiply_add(wy2, c2, nothing)))
        slope_x, moment_x = _slope_and_moment(west, middle, east, get(scratch, L_SX, k), get(scratch, L_MX, k))
        slope_y, moment_y = _slope_and_moment(south, here, north, get(scratch, L_SY, k), get(scratch, L_MY, k))
        q = 4 * k
        store(quads, Q_MEAN + q, multiply_add(wy0, south, multiply_add(wy1, here, multiply_add(wy2, north, nothing))))
        store(quads, Q_ALONG_X + q, slope_x)
        store(quads, Q_ALONG_Y + q, slope_y)
        store(quads, Q_MOMENT_X + q, moment_x)
        store(quads, Q_MOMENT_Y + q, moment_y)


@jit
def _move(scratch, moved, quads, count, dx, dt, entrainment):
    """New velocity, affine velocity, position and area of each column, into the lines of `moved`.

    A_p *= det(I + dt grad u_p), and no column gets thinner than a thousandth of the grid's thickness. A column takes up
    m_p sum N_i gain_i at rest and keeps its momentum m_p sum N_i v_i, so that all of them together keep the nodes'.
    Answers how many of the factors of area, and how many areas, were held.
    """
    factors, thin = 0, 0
    inverse_dx = 1.0 / dx
    four = 4.0 * inverse_dx
    for k in range(count):
        mass, grid_mass = get(scratch, L_MASS, k), get_of_four(quads, Q_MEAN, k, NODE_MASS)
        u, v = get_of_four(quads, Q_MEAN, k, NODE_X), get_of_four(quads, Q_MEAN, k, NODE_Y)
        ux, vx = get_of_four(quads, Q_ALONG_X, k, NODE_X), get_of_four(quads, Q_ALONG_X, k, NODE_Y)
        uy, vy = get_of_four(quads, Q_ALONG_Y, k, NODE_X), get_of_four(quads, Q_ALONG_Y, k, NODE_Y)
        kept = 1.0  # share of the mass, and with it of the velocity, that is not new
        if entrainment.entrainment_active():
            gain = get_of_four(quads, Q_MEAN, k, NODE_GAIN)
            gain_x, gain_y = get_of_four(quads, Q_ALONG_X, k, NODE_GAIN), get_of_four(quads, Q_ALONG_Y, k, NODE_GAIN)
            kept = 1.0 / (1.0 + gain)
            put(moved, L_GAINED, k, mass * gain)
            mass += mass * gain
            u, v = kept * u, kept * v
            ux, vx = kept * (ux - u * gain_x), kept * (vx - v * gain_x)
            uy, vy = kept * (uy - u * gain_y), kept * (vy - v * gain_y)
        stretch = (1.0 + dt * ux * inverse_dx) * (1.0 + dt * vy * inverse_dx) - dt * dt * uy * vx * (
            inverse_dx * inverse_dx
        )
        area = get(scratch, L_AREA, k) * min(max(stretch, AREA_FACTOR_MIN), AREA_FACTOR_MAX)
        widest = THINNEST * mass * dx * dx / grid_mass
        factors += (stretch < AREA_FACTOR_MIN) | (stretch > AREA_FACTOR_MAX)
        thin += area > widest
        put(moved, L_AREA, k, min(area, widest))
        put(moved, L_MASS, k, mass)
        put(moved, L_U, k, u)
        put(moved, L_V, k, v)
        put(moved, L_X, k, get(scratch, L_X, k) + dt * u)
        put(moved, L_Y, k, get(scratch, L_Y, k) + dt * v)
        put(moved, L_CXX, k, four * kept * get_of_four(quads, Q_MOMENT_X, k, NODE_X))
        put(moved, L_CYX, k, four * kept * get_of_four(quads, Q_MOMENT_X, k, NODE_Y))
        put(moved, L_CXY, k, four * kept * get_of_four(quads, Q_MOMENT_Y, k, NODE_X))
        put(moved, L_CYY, k, four * kept * get_of_four(quads, Q_MOMENT_Y, k, NODE_Y))
    return factors, thin


@jit
def _clamp(moved, quads, count, dx, clamp):
    """Keep the thickness within [1/clamp, clamp] times the grid's by resetting areas; answers how many were reset."""
    clamped = 0.0
    for k in range(count):
        seen = get(moved, L_MASS, k) * dx * dx / get_of_four(quads, Q_MEAN, k, NODE_MASS)  # as thick as the grid
        area = get(moved, L_AREA, k)
        spreads = get_of_four(quads, Q_ALONG_X, k, NODE_X) + get_of_four(quads, Q_ALONG_Y, k, NODE_Y) >= 0.0
        if spreads and area * clamp < seen:
            area = seen / clamp
            clamped += 1.0
        elif not spreads and area > clamp * seen:
            area = clamp * seen
            clamped += 1.0
        put(moved, L_AREA, k, area)
    return clamped


@jit
def _keep_in(moved, count, dx, length_x, length_y):
    """Walls: nobody passes them by more than rounding; answers how many were held."""
    held = 0
    for k in range(count):
        x, y = get(moved, L_X, k), get(moved, L_Y, k)
        held += (x < 1e-9 * dx) | (x > length_x - 1e-9 * dx) | (y < 1e-9 * dx) | (y > length_y - 1e-9 * dx)
        put(moved, L_X, k, min(max(x, 1e-9 * dx), length_x - 1e-9 * dx))
        put(moved, L_Y, k, min(max(y, 1e-9 * dx), length_y - 1e-9 * dx))
    return held


@jit
def _all_stay(moved, stays, count, length_x, length_y):
    """Set every `stays[k]` to 1; True if all columns are within the domain (a NaN is not)."""
    within = 0
    for k in range(count):
        x, y, area = get(moved, L_X, k), get(moved, L_Y, k), get(moved, L_AREA, k)
        put(stays, 0, k, 1)
        within += (x >= 0.0) & (y >= 0.0) & (x < length_x) & (y < length_y) & (area * 0.0 == 0.0)
    return within == count


@jit
def _book_out(scratch, moved, stays, count, bed, inside, mine, dx, driven, density, gravity, metric):
    """Find the columns that left through an edge or onto nodata and book them; they wait at their last place.

    `stays[k]` becomes 0 for them; a column that is not finite is counted and does not stay either. Potential energy is
    that of the place after the share `driven` of the step, for which the velocities hold, on the plane of the bed.
    """
    inverse_dx = 1.0 / dx
    ny, nx = inside.shape
    length_x, length_y = nx * dx, ny * dx
    for k in range(count):
        x, y, area = get(moved, L_X, k), get(moved, L_Y, k), get(moved, L_AREA, k)
        edge = EDGES
        if (x + y + area) * 0.0 != 0.0:  # NaN or infinite
            mine[NOT_FINITE] += 1.0
            mine[BOUND_X], mine[BOUND_Y] = get(scratch, L_X, k), get(scratch, L_Y, k)
            stays[k] = 0
        elif x < 0.0:
            edge = 0
        elif y < 0.0:
            edge = 1
        elif x >= length_x:
            edge = 2
        elif y >= length_y:
            edge = 3
        elif inside[int(y * inverse_dx) & INDEX_MASK, int(x * inverse_dx) & INDEX_MASK] == 0:
            edge = 4
        if edge < EDGES:
            mass, u, v = get(moved, L_MASS, k), get(moved, L_U, k), get(moved, L_V, k)
            mx, my = metric.metric_gradient(get(scratch, L_GX, k), get(scratch, L_GY, k))
            w = u * mx + v * my
            bed_last = bed_at(bed, get(scratch, L_X, k), get(scratch, L_Y, k), inverse_dx)[0]
            slope_x, slope_y = get(scratch, L_GX, k), get(scratch, L_GY, k)
            fallen = slope_x * (x - get(scratch, L_X, k)) + slope_y * (y - get(scratch, L_Y, k))
            bed_last += driven * fallen
            thickness = mass / (density * area) * _cosine_squared(mx, my)
            out = OUT + edge * OUT_ENTRIES
            mine[out] += mass
            mine[out + 1] += mass * u
            mine[out + 2] += mass * v
            mine[out + 3] += 0.5 * mass * (u * u + v * v + w * w)
            mine[out + 4] += mass * gravity * (bed_last + 0.5 * thickness)
            mine[out + 5] += 1.0
            stays[k] = 0
        if stays[k] == 0:
            put(moved, L_X, k, get(scratch, L_X, k))
            put(moved, L_Y, k, get(scratch, L_Y, k))


@jit
def _weigh_bed(moved, place, count, row_length, inverse_dx):
    """As `_weigh`, for the bed's value and slope at the new places."""
    for k in range(count):
        i0, fx, wx0, wx1, wx2 = weights(get(moved, L_X, k), inverse_dx)
        j0, fy, wy0, wy1, wy2 = weights(get(moved, L_Y, k), inverse_dx)
        put(place, 0, k, j0 * row_length + i0)
        put(moved, L_WX0, k, wx0)
        put(moved, L_WX1, k, wx1)
        put(moved, L_WX2, k, wx2)
        put(moved, L_WY0, k, wy0)
        put(moved, L_WY1, k, wy1)
        put(moved, L_WY2, k, wy2)
        put(moved, L_GX0, k, fx - 1.5)
        put(moved, L_GX1, k, 2.0 - 2.0 * fx)
        put(moved, L_GX2, k, fx - 0.5)
        put(moved, L_GY0, k, fy - 1.5)
        put(moved, L_GY1, k, 2.0 - 2.0 * fy)
        put(moved, L_GY2, k, fy - 0.5)


@jit
def _read_bed(moved, quads, place, count, bed):
    """For each column its three bed rows summed over y: with the weights, and with their slopes."""
    nothing = lanes(0.0, 0.0, 0.0, 0.0)
    row_length = bed.shape[1]
    for k in range(count):
        t = place[k]
        value = slope = nothing
        for j in range(3):
            line = load(bed, t)
            t += row_length
            value = multiply_add(get(moved, L_WY0 + j * BATCH, k), line, value)
            slope = multiply_add(get(moved, L_GY0 + j * BATCH, k), line, slope)
        store(quads, Q_BED + 4 * k, value)
        store(quads, Q_BED_SLOPE + 4 * k, slope)


@jit
def _turn(scratch, moved, quads, count, dx, behind, driven, ahead, density, gravity, bound_bed, bound_energy,
          pressure_factor, metric, curvature, entrainment):  # fmt: skip
    """The bed at the new place, velocities turned with it, and what the survey of the step needs.

    The work of the weight is booked at the slope at the column's old place: for the last `behind` [s] before it, with
    the velocities before the step's forces, and for the `driven` [s] after it, with those after them. Over the steps
    this is the trapezoidal rule for the column's way on the bed, whatever the steps. The work of the pressure is the
    fall of the column's middle, c^2 h / 2 above the bed, as it spreads.
    Changes of c are no work of a force: the model takes the flow as a thin layer. The forces of the next step act from
    `ahead` [s] before the end of this one, with velocities that are turned here, on mass that is taken up here.
    """
    inverse_dx = 1.0 / dx
    for k in range(count):
        row0, row1 = get_of_four(quads, Q_BED, k, 0), get_of_four(quads, Q_BED, k, 1)
        row2 = get_of_four(quads, Q_BED, k, 2)
        wx0, wx1, wx2 = get(moved, L_WX0, k), get(moved, L_WX1, k), get(moved, L_WX2, k)
        bed_here = wx0 * row0 + wx1 * row1 + wx2 * row2
        slope_x = get(moved, L_GX0, k) * row0 + get(moved, L_GX1, k) * row1 + get(moved, L_GX2, k) * row2
        slope_y = (
            wx0 * get_of_four(quads, Q_BED_SLOPE, k, 0)
            + wx1 * get_of_four(quads, Q_BED_SLOPE, k, 1)
            + wx2 * get_of_four(quads, Q_BED_SLOPE, k, 2)
        )
        slope_x, slope_y = slope_x * inverse_dx, slope_y * inverse_dx
        u, v = get(moved, L_U, k), get(moved, L_V, k)
        old_x, old_y = get(scratch, L_GX, k), get(scratch, L_GY, k)
        mass, area = get(scratch, L_MASS, k), get(moved, L_AREA, k)
        climbed = behind * (get(scratch, L_U, k) * old_x + get(scratch, L_V, k) * old_y)
        climbed += driven * (u * old_x + v * old_y)
        mx, my = metric.metric_gradient(old_x, old_y)
        per_area = 0.5 * gravity / density
        spread = mass * mass * (1.0 / get(scratch, L_AREA, k) - 1.0 / area)
        c2_before = _cosine_squared(mx, my)
        put(moved, L_WORK, k, per_area * c2_before * spread - mass * gravity * climbed)
        climbs = u * slope_x + v * slope_y
        u, v = curvature.turned_velocity(u, v, old_x, old_y, slope_x, slope_y)
        turned = mass * gravity * ahead * (u * slope_x + v * slope_y - climbs)
        mx, my = metric.metric_gradient(slope_x, slope_y)
        c2 = _cosine_squared(mx, my)
        put(moved, L_BENT, k, per_area * mass * mass / area * (c2 - c2_before) - turned)
        if entrainment.entrainment_active():
            grown = get(moved, L_MASS, k)
            late = (grown - mass) * gravity * ahead * (u * slope_x + v * slope_y)
            put(moved, L_WORK, k, get(moved, L_WORK, k) + late)
            thicker = per_area * c2 * (grown * grown - mass * mass) / area
            put(moved, L_TAKEN, k, (grown - mass) * gravity * bed_here + thicker)
        w = u * mx + v * my
        horizontal2 = u * u + v * v
        wave2 = pressure_factor * gravity * get(moved, L_MASS, k) / (density * get(moved, L_AREA, k))
        put(moved, L_U, k, u)
        put(moved, L_V, k, v)
        put(moved, L_GX, k, slope_x)
        put(moved, L_GY, k, slope_y)
        put(moved, L_SPEED2, k, horizontal2 + w * w)
        put(moved, L_HORIZONTAL2, k, horizontal2)
        put(moved, L_SIGNAL2, k, horizontal2 + wave2 + 2.0 * sqrt(horizontal2 * wave2))
        put(moved, L_BOUND, k, 1.05 * (2.0 * gravity * max(bound_bed - bed_here, 0.0) + bound_energy))


@jit
def _survey(moved, stays, count, mine, dx, gravity, entrainment):
    """Largest and total values over the columns that stay, into the chunk's report; too fast ones are slowed.

    Wild is who is twice too fast also by the drop across a cell: at a cliff's rim the grid gives a column on top the
    speed of those that fall beside it.
    """
    signal2_max, speed2_max, ratio = mine[SIGNAL_MAX], mine[SPEED_MAX], mine[BOUND_RATIO]
    kinetic, moving, flowing, entrained = mine[KINETIC], mine[MOVING], mine[FLOWING], mine[ENTRAINED]
    work, bent, taken, limited = mine[WORK], mine[BENT], mine[ENTRAINED_POTENTIAL], mine[LIMITED_LOSS]
    fastest2 = mine[FASTEST2]
    for k in range(count):
        work += get(moved, L_WORK, k)
        bent += get(moved, L_BENT, k)
        if entrainment.entrainment_active():
            entrained += get(moved, L_GAINED, k)
            taken += get(moved, L_TAKEN, k)
        if stays[k] == 0:
            continue
        mass, speed2, bound = get(moved, L_MASS, k), get(moved, L_SPEED2, k), get(moved, L_BOUND, k)
        horizontal2 = get(moved, L_HORIZONTAL2, k)
        signal2_max = max(signal2_max, get(moved, L_SIGNAL2, k))
        if speed2 > ratio * bound:
            ratio = speed2 / bound
            mine[BOUND_X], mine[BOUND_Y] = get(moved, L_X, k), get(moved, L_Y, k)
        if speed2 > bound:  # a speed from level ground that the grid lays on a wall
            slower = sqrt(bound / speed2)
            put(moved, L_U, k, get(moved, L_U, k) * slower)
            put(moved, L_V, k, get(moved, L_V, k) * slower)
            mine[LIMITED] += mass
            mine[HELD_SPEED] += 1.0
            drop = dx * sqrt(get(moved, L_GX, k) ** 2 + get(moved, L_GY, k) ** 2)
            if speed2 > 4.0 * (bound + 2.0 * gravity * drop):
                mine[WILD] += mass
            limited += 0.5 * mass * (speed2 - bound)
            horizontal2, speed2 = horizontal2 * bound / speed2, bound
        speed2_max = max(speed2_max, horizontal2)
        fastest2 = max(fastest2, speed2)
        kinetic += mass * speed2
        if speed2 > MOVING_SPEED * MOVING_SPEED:
            moving += mass
            if speed2 > FLOWING_SPEED * FLOWING_SPEED:
                flowing += mass
    mine[SIGNAL_MAX], mine[SPEED_MAX], mine[BOUND_RATIO] = signal2_max, speed2_max, ratio
    mine[KINETIC], mine[MOVING], mine[FLOWING], mine[ENTRAINED] = kinetic, moving, flowing, entrained
    mine[WORK], mine[BENT], mine[ENTRAINED_POTENTIAL], mine[LIMITED_LOSS] = work, bent, taken, limited
    mine[FASTEST2] = fastest2


@jit
def _give_rows(rows, order, first, count, moved):
    """Copy the lines of `moved` into the rows of columns order[first : first + count]."""
    for k in range(0, count, 4):
        for e in range(0, ROW, 4):
            line = e * BATCH + k
            quads = transposed(
                load(moved, line), load(moved, line + BATCH), load(moved, line + 2 * BATCH),
                load(moved, line + 3 * BATCH),
            )  # fmt: skip
            store(rows, (order[first + k] & INDEX_MASK) * ROW + e, quads[0])
            if k + 1 < count:
                store(rows, (order[first + k + 1] & INDEX_MASK) * ROW + e, quads[1])
            if k + 2 < count:
                store(rows, (order[first + k + 2] & INDEX_MASK) * ROW + e, quads[2])
            if k + 3 < count:
                store(rows, (order[first + k + 3] & INDEX_MASK) * ROW + e, quads[3])


@jit
def _give_keys(keys, order, first, count, moved, place, stays, inverse_dx, mine):
    """Blocks of the next step, and the window of blocks that hold columns."""
    for k in range(count):
        put(place, 0, k, block_key(get(moved, L_X, k), get(moved, L_Y, k), inverse_dx))
    last = GONE
    for k in range(count):
        key = place[k]
        if stays[k] == 0:
            keys[order[first + k]] = GONE
            continue
        keys[order[first + k] & INDEX_MASK] = key
        if key != last:
            last = key
            column, line = float(key & 0xFFFF), float(key >> 16)
            mine[BLOCK_WEST], mine[BLOCK_EAST] = min(mine[BLOCK_WEST], column), max(mine[BLOCK_EAST], column)
            mine[BLOCK_SOUTH], mine[BLOCK_NORTH] = min(mine[BLOCK_SOUTH], line), max(mine[BLOCK_NORTH], line)


@jit_parallel
def grid_to_particles(
    rows, keys, order, start, block, bounds, west, south, width, nodes, bed, inside, report,
    dx, dt, behind, ahead, density, gravity, clamp, wall, holes, bound_bed, bound_energy, pressure_factor,
    metric, curvature, entrainment,
):  # fmt: skip
    """Read the new velocity field back, move the columns, stretch their areas, turn velocities with the bed.

    APIC: u_p = sum N_i v_i, C_p = 4/dx^2 sum N_i v_i (x_i - x_p)^T; A_p *= det(I + dt grad u_p). With `clamp` a column
    stays below `clamp` times the grid's thickness where the flow spreads, and above 1/clamp of it where it converges.
    No column is faster than its drop in height allows. Velocities are those of `ahead` [s] before the end of the step
    (leapfrog). Columns that leave through an open edge or onto nodata (looked
    for only if the terrain has `holes`) go to the ledger and get the key GONE.
    """
    inverse_dx = 1.0 / dx
    ny, nx = inside.shape
    for c in prange(CHUNKS):
        mine = report[c]
        mine[:STIFF] = 0.0
        mine[ENTRAINED:] = 0.0
        mine[BLOCK_WEST] = mine[BLOCK_SOUTH] = 1 << 16
        mine[BLOCK_EAST] = mine[BLOCK_NORTH] = -1
        scratch = np.empty(LINES)
        moved = np.empty(LINES)
        quads = np.empty(QUADS)
        place = np.empty(BATCH, np.int64)
        stays = np.empty(BATCH, np.int64)
        end = start[bounds[c + 1]]
        first = start[bounds[c]]
        while first < end:
            count = min(BATCH, end - first)
            _take_rows(rows, order, first, count, end, scratch, False)
            _weigh(scratch, place, count, nodes.shape[1], inverse_dx)
            _read_nodes(scratch, quads, place, count, nodes)
            factors, thin = _move(scratch, moved, quads, count, dx, dt, entrainment)
            mine[HELD_STRETCH] += factors
            mine[HELD_THIN] += thin
            if clamp > 0.0:
                mine[CLAMPED] += _clamp(moved, quads, count, dx, clamp)
            if wall:
                mine[HELD_WALL] += _keep_in(moved, count, dx, nx * dx, ny * dx)
            if not _all_stay(moved, stays, count, nx * dx, ny * dx) or holes:
                driven = 1.0 - ahead / dt
                _book_out(scratch, moved, stays, count, bed, inside, mine, dx, driven, density, gravity, metric)
            _weigh_bed(moved, place, count, bed.shape[1], inverse_dx)
            _read_bed(moved, quads, place, count, bed)
            _turn(
                scratch, moved, quads, count, dx, behind, dt - ahead, ahead, density, gravity, bound_bed, bound_energy,
                pressure_factor, metric, curvature, entrainment,
            )  # fmt: skip
            _survey(moved, stays, count, mine, dx, gravity, entrainment)
            _give_rows(rows, order, first, count, moved)
            _give_keys(keys, order, first, count, moved, place, stays, inverse_dx, mine)
            first += count
        mine[SIGNAL_MAX], mine[SPEED_MAX] = sqrt(mine[SIGNAL_MAX]), sqrt(mine[SPEED_MAX])
        mine[KINETIC] *= 0.5
        if mine[NOT_FINITE] > 0.0:
            mine[BOUND_RATIO] = 0.0
