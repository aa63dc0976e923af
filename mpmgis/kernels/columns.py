"""Compiled loops of the depth-averaged MPM (design notes 3; blocks as in design notes on kernels).

Particles are rows of consecutive floats. Each step sorts their indices by blocks of 8 x 8 nodes; a block sums its
particles into a private tile (particles to grid), the grid gathers the tiles that overlap a node in a fixed order, is
updated, and the block's particles read it back (grid to particles). Nothing is shared between loops and every sum has
a fixed order, so that results are bitwise the same for any number of threads. Only blocks that hold particles cost.

Nodes lie on cell corners: array index k + 1 is the node at k * dx from the domain's south-west corner, so that there
is one ghost node outside each edge. Weights are quadratic B-splines (Steffen et al. 2008).
"""

import numpy as np

from ..effects.friction import slowed_speed
from ..effects.metric import cosine_squared
from . import laws as _laws  # noqa: F401  (registers the methods of laws)
from .jit import jit, jit_inline, jit_parallel, prange
from .lanes import add_to, lane, lanes, load, multiply_add

# columns of a particle's row; KAPPA only where curvature is in the scene
X, Y, U, V, CXX, CXY, CYX, CYY, MASS, AREA, GX, GY, KAPPA = range(13)
# entries of a node: mass [kg]; momentum, then velocity, east and north; mass times centrifugal acceleration
NODE_MASS, NODE_X, NODE_Y, NODE_KAPPA = range(4)

BLOCK = 8  # nodes along a block's side
TILE = BLOCK + 2  # a particle of the block reaches two nodes further
CHUNKS = 32  # pieces of work per loop; fixed, so that sums do not depend on the number of threads
SORT_ROWS = 8192  # rows per piece of the sort, at most CHUNKS pieces
REORDER_STEPS = 20  # rows are put into block order in memory this often
GONE = -1  # key of a particle that has left
INDEX_MASK = 0x3FFFFFFF  # tells the compiler that an index is not negative, which spares a test for each access

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
    OUT,  # then the outflow ledger: per edge mass, momentum east and north, kinetic and potential energy, number
) = range(17)
EDGES = 5  # west, south, east, north, nodata
OUT_ENTRIES = 6
REPORT = OUT + EDGES * OUT_ENTRIES
# what each chunk of the node loop reports
WET_NEW, AIRBORNE_MASS, DEEPEST, NODE_REPORT = range(4)

MOVING_SPEED = 0.05  # [m s-1] (design notes 3.9)
FLOWING_SPEED = 1.0  # [m s-1] slower is creep, which changes no deposit
THINNEST = 1000.0  # a column keeps a thousandth of the grid's thickness: no push worth naming, and no endless area
AREA_FACTOR_MIN, AREA_FACTOR_MAX = 0.1, 10.0  # of one step (design notes 3.3)

_slowed_speed = jit_inline(slowed_speed)
_cosine_squared = jit_inline(cosine_squared)


@jit_inline
def weights(position, inverse_dx):
    """Base index in the node array, offset in it, and the three quadratic B-spline weights of one axis."""
    s = position * inverse_dx
    base = int(s + 0.5) & INDEX_MASK  # to the letter as in the block keys, so that both round alike
    f = s + 1.0 - base
    return base, f, 0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2


@jit_inline
def bed_at(bed, x, y, inverse_dx):
    """Bed elevation [m] and its gradient at (x, y) [m]: b = sum b_i N_i, grad b = sum b_i grad N_i."""
    i0, fx, wx0, wx1, wx2 = weights(x, inverse_dx)
    j0, fy, wy0, wy1, wy2 = weights(y, inverse_dx)
    dx0, dx1, dx2 = fx - 1.5, 2.0 - 2.0 * fx, fx - 0.5
    dy0, dy1, dy2 = fy - 1.5, 2.0 - 2.0 * fy, fy - 0.5
    b00, b01, b02 = bed[j0, i0], bed[j0, i0 + 1], bed[j0, i0 + 2]
    b10, b11, b12 = bed[j0 + 1, i0], bed[j0 + 1, i0 + 1], bed[j0 + 1, i0 + 2]
    b20, b21, b22 = bed[j0 + 2, i0], bed[j0 + 2, i0 + 1], bed[j0 + 2, i0 + 2]
    r0 = wx0 * b00 + wx1 * b01 + wx2 * b02
    r1 = wx0 * b10 + wx1 * b11 + wx2 * b12
    r2 = wx0 * b20 + wx1 * b21 + wx2 * b22
    g0 = dx0 * b00 + dx1 * b01 + dx2 * b02
    g1 = dx0 * b10 + dx1 * b11 + dx2 * b12
    g2 = dx0 * b20 + dx1 * b21 + dx2 * b22
    value = wy0 * r0 + wy1 * r1 + wy2 * r2
    gradient_x = (wy0 * g0 + wy1 * g1 + wy2 * g2) * inverse_dx
    gradient_y = (dy0 * r0 + dy1 * r1 + dy2 * r2) * inverse_dx
    return value, gradient_x, gradient_y


@jit
def beds_at(bed, x, y, dx):
    """`bed_at` for arrays of points: elevation, gradient east, gradient north."""
    value, gradient_x, gradient_y = np.empty(x.size), np.empty(x.size), np.empty(x.size)
    for p in range(x.size):
        value[p], gradient_x[p], gradient_y[p] = bed_at(bed, x[p], y[p], 1.0 / dx)
    return value, gradient_x, gradient_y


@jit
def grid_areas(rows, shape, dx):
    """Area [m2] with which each column would be as thick as the grid where it stands: m / (rho h_g)."""
    mass = np.zeros(shape)
    share = np.zeros((2, 3))
    areas = np.empty(rows.shape[0])
    for reading in range(2):
        for p in range(rows.shape[0]):
            i0, _, share[0, 0], share[0, 1], share[0, 2] = weights(rows[p, X], 1.0 / dx)
            j0, _, share[1, 0], share[1, 1], share[1, 2] = weights(rows[p, Y], 1.0 / dx)
            here = 0.0
            for j in range(3):
                for i in range(3):
                    if reading:
                        here += share[0, i] * share[1, j] * mass[j0 + j, i0 + i]
                    else:
                        mass[j0 + j, i0 + i] += share[0, i] * share[1, j] * rows[p, MASS]
            if reading:
                areas[p] = rows[p, MASS] * dx * dx / here
    return areas


@jit
def node_gradients(bed, dx):
    """float64[ny, nx, 2]: gradient of the spline bed at the nodes themselves (zero on the outermost ring)."""
    gradient = np.zeros((bed.shape[0], bed.shape[1], 2))
    for j in range(1, bed.shape[0] - 1):
        for i in range(1, bed.shape[1] - 1):
            _, gradient[j, i, 0], gradient[j, i, 1] = bed_at(bed, (i - 1) * dx, (j - 1) * dx, 1.0 / dx)
    return gradient


@jit_inline
def block_key(x, y, inverse_dx):
    """Block of a particle, its row in the high and its column in the low 16 bits."""
    return ((int(y * inverse_dx + 0.5) // BLOCK) << 16) | (int(x * inverse_dx + 0.5) // BLOCK)


@jit
def initial_keys(rows, keys, dx):
    """Fill `keys` for all `rows`; answers the window of blocks (west, south, east, north)."""
    west, south, east, north = 1 << 16, 1 << 16, -1, -1
    for p in range(rows.shape[0]):
        key = block_key(rows[p, X], rows[p, Y], 1.0 / dx)
        keys[p] = key
        west, east = min(west, key & 0xFFFF), max(east, key & 0xFFFF)
        south, north = min(south, key >> 16), max(north, key >> 16)
    return west, south, east, north


@jit_parallel
def _count(keys, n, pieces, west, south, width, size, histogram):
    for c in prange(pieces):
        for b in range(size):
            histogram[c, b] = 0
        for p in range(c * n // pieces, (c + 1) * n // pieces):
            if keys[p] != GONE:
                histogram[c, ((keys[p] >> 16) - south) * width + (keys[p] & 0xFFFF) - west] += 1


@jit_parallel
def _scatter(keys, n, pieces, west, south, width, histogram, order):
    for c in prange(pieces):
        for p in range(c * n // pieces, (c + 1) * n // pieces):
            if keys[p] != GONE:
                b = ((keys[p] >> 16) - south) * width + (keys[p] & 0xFFFF) - west
                order[histogram[c, b]] = p
                histogram[c, b] += 1


@jit
def sort_by_block(keys, n, west, south, east, north, histogram, order, slot, block, start):
    """Stable counting sort of indices by block.

    Fills `order`; `slot[b]` is the active block at place b of the window or -1, `block[a]` its place,
    `start[a]`..`start[a + 1]` its particles. Answers (active blocks, particles alive).
    """
    width, height = east - west + 1, north - south + 1
    size = width * height
    pieces = min(CHUNKS, n // SORT_ROWS + 1)
    _count(keys, n, pieces, west, south, width, size, histogram)
    total, active = 0, 0
    for b in range(size):
        first = total
        for c in range(pieces):
            count = histogram[c, b]
            histogram[c, b] = total
            total += count
        slot[b] = -1
        if total > first:
            slot[b] = active
            block[active] = b
            start[active] = first
            active += 1
    start[active] = total
    _scatter(keys, n, pieces, west, south, width, histogram, order)
    return active, total


@jit
def split_evenly(start, active, bounds):
    """Cut the active blocks into CHUNKS pieces of nearly equal numbers of particles: `bounds[c]`..`bounds[c + 1]`."""
    total, a = start[active], 0
    for c in range(CHUNKS):
        bounds[c] = a
        while a < active and start[a + 1] * CHUNKS <= total * (c + 1):
            a += 1
    bounds[CHUNKS] = active


@jit_parallel
def reorder(rows, ids, order, alive, rows_out, ids_out, keys, keys_out):
    """Put rows into block order in memory; particles that have left are dropped."""
    for c in prange(CHUNKS):
        for p in range(c * alive // CHUNKS, (c + 1) * alive // CHUNKS):
            q = order[p]
            ids_out[p] = ids[q]
            keys_out[p] = keys[q]
            for k in range(rows.shape[1]):
                rows_out[p, k] = rows[q, k]


@jit_parallel
def particles_to_grid(
    rows, order, start, block, bounds, west, south, width, tiles, bed, dx, dt, density, gravity, metric, curvature, lake
):
    """Sum mass, momentum and impulse of each block's particles into its tile (weak form, design notes 3.4).

    f_i = sum_p A_p rho g c^2 h_p^2 / 2 P grad N_i - m_p g c^2 grad b N_i, with P = I - c^2 grad b grad b^T and
    momentum sum_p N_i m_p (u_p + C_p (x_i - x_p)) (APIC, Jiang et al. 2015).
    """
    inverse_dx = 1.0 / dx
    for c in prange(CHUNKS):
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
                    still = density * area * lake.reference_depth(bed_at(bed, rows[p, X], rows[p, Y], inverse_dx)[0])
                    pressed -= still * still / (density * area)
                    driven -= still
                push = dt * 0.5 * gravity * c2 * pressed * inverse_dx
                push_xx = push * (1.0 - c2 * metric_x * metric_x)
                push_xy = -push * c2 * metric_x * metric_y
                push_yy = push * (1.0 - c2 * metric_y * metric_y)
                pull = dt * driven * gravity * c2
                qx, qy = mass * rows[p, U] - pull * rows[p, GX], mass * rows[p, V] - pull * rows[p, GY]
                mdx = mass * dx
                cxx, cxy, cyx, cyy = mdx * rows[p, CXX], mdx * rows[p, CXY], mdx * rows[p, CYX], mdx * rows[p, CYY]
                weighted_kappa = 0.0
                if curvature.curvature_active():
                    weighted_kappa = mass * rows[p, KAPPA]
                rx0, rx1, rx2 = -fx, 1.0 - fx, 2.0 - fx
                gx0, gx1, gx2 = fx - 1.5, 2.0 - 2.0 * fx, fx - 0.5
                ax0, ay0 = wx0 * (qx + cxx * rx0) + push_xx * gx0, wx0 * (qy + cyx * rx0) + push_xy * gx0
                ax1, ay1 = wx1 * (qx + cxx * rx1) + push_xx * gx1, wx1 * (qy + cyx * rx1) + push_xy * gx1
                ax2, ay2 = wx2 * (qx + cxx * rx2) + push_xx * gx2, wx2 * (qy + cyx * rx2) + push_xy * gx2
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


@jit
def touched_blocks(slot, width, height, touched):
    """List the node blocks that active tiles reach (themselves and their east, north, north-east neighbours)."""
    count = 0
    for bj in range(height + 1):
        for bi in range(width + 1):
            hit = False
            for oj in range(bj - 1, bj + 1):
                for oi in range(bi - 1, bi + 1):
                    if 0 <= oi < width and 0 <= oj < height and slot[oj * width + oi] >= 0:
                        hit = True
            if hit:
                touched[count] = bj * (width + 1) + bi
                count += 1
    return count


@jit
def clear_ghosts(nodes):
    """Zero the ghost ring, which untouched blocks leave as an earlier step had it."""
    nodes[0, :, :] = 0.0
    nodes[-1, :, :] = 0.0
    nodes[:, 0, :] = 0.0
    nodes[:, -1, :] = 0.0


@jit
def fold_walls(nodes):
    """Walls on all four edges: what the ghosts hold is mirrored inwards (design notes 3.9).

    Mass and tangential momentum are added, normal momentum is subtracted; on the wall itself the mirror image doubles
    mass and tangential momentum and takes away the normal one.
    """
    ny, nx = nodes.shape[0], nodes.shape[1]
    for i in range(nx):
        for ghost, wall, inner in ((0, 1, 2), (ny - 1, ny - 2, ny - 3)):
            for e in range(4):
                nodes[wall, i, e] *= 2.0
                nodes[inner, i, e] += -nodes[ghost, i, e] if e == NODE_Y else nodes[ghost, i, e]
            nodes[wall, i, NODE_Y] = 0.0
    for j in range(ny):
        for ghost, wall, inner in ((0, 1, 2), (nx - 1, nx - 2, nx - 3)):
            for e in range(4):
                nodes[j, wall, e] *= 2.0
                nodes[j, inner, e] += -nodes[j, ghost, e] if e == NODE_X else nodes[j, ghost, e]
            nodes[j, wall, NODE_X] = 0.0


@jit
def mirror_walls(nodes):
    """Give the ghosts the mirrored state of the inner nodes, so that particles at a wall see no flow through it."""
    ny, nx = nodes.shape[0], nodes.shape[1]
    for j in range(ny):
        for ghost, wall, inner in ((0, 1, 2), (nx - 1, nx - 2, nx - 3)):
            nodes[j, wall, NODE_X] = 0.0
            nodes[j, ghost, NODE_MASS] = nodes[j, inner, NODE_MASS]
            nodes[j, ghost, NODE_X] = -nodes[j, inner, NODE_X]
            nodes[j, ghost, NODE_Y] = nodes[j, inner, NODE_Y]
    for i in range(nx):
        for ghost, wall, inner in ((0, 1, 2), (ny - 1, ny - 2, ny - 3)):
            nodes[wall, i, NODE_Y] = 0.0
            nodes[ghost, i, NODE_MASS] = nodes[inner, i, NODE_MASS]
            nodes[ghost, i, NODE_X] = nodes[inner, i, NODE_X]
            nodes[ghost, i, NODE_Y] = -nodes[inner, i, NODE_Y]


@jit_parallel
def update_nodes(
    nodes, node_gradient, wet, touched, n_touched, west, south, width, report,
    dx, dt, density, gravity, thickness_floor, wet_thickness, metric, friction, curvature,
):  # fmt: skip
    """Momentum to velocity, and basal friction: semi-implicit, in the metric of the ground (design notes 3.5)."""
    rows, columns = nodes.shape[0], nodes.shape[1]
    per_area = 1.0 / (density * dx * dx)
    for c in prange(CHUNKS):
        report[c, :] = 0.0
        for k in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            j_first = (touched[k] // (width + 1) + south) * BLOCK
            i_first = (touched[k] % (width + 1) + west) * BLOCK
            for j in range(j_first, min(j_first + BLOCK, rows)):
                for i in range(i_first, min(i_first + BLOCK, columns)):
                    mass = nodes[j, i, NODE_MASS]
                    if mass <= 0.0:
                        continue
                    u, v = nodes[j, i, NODE_X] / mass, nodes[j, i, NODE_Y] / mass
                    grid_thickness = mass * per_area
                    report[c, DEEPEST] = max(report[c, DEEPEST], grid_thickness)
                    if grid_thickness > wet_thickness and wet[j, i] == 0:
                        wet[j, i] = 1
                        report[c, WET_NEW] += 1.0
                    mx, my = metric.metric_gradient(node_gradient[j, i, 0], node_gradient[j, i, 1])
                    c2 = _cosine_squared(mx, my)
                    w = u * mx + v * my
                    speed = np.sqrt(u * u + v * v + w * w)
                    centrifugal = 0.0
                    if curvature.curvature_active():
                        centrifugal = nodes[j, i, NODE_KAPPA] / mass
                    effective = curvature.effective_gravity(gravity, centrifugal)
                    if effective == 0.0:
                        report[c, AIRBORNE_MASS] += mass
                    if speed > 0.0:
                        thickness = max(grid_thickness, thickness_floor)
                        normal_thickness = thickness * np.sqrt(c2)
                        normal_stress = density * thickness * effective * c2
                        dry = friction.dry_stress(density, normal_stress, normal_thickness, speed)
                        drag = friction.drag_coefficient(gravity)
                        slowed = _slowed_speed(speed, dt, dry / (density * normal_thickness), drag / normal_thickness)
                        u, v = u * (slowed / speed), v * (slowed / speed)
                    nodes[j, i, NODE_X], nodes[j, i, NODE_Y] = u, v


@jit_parallel
def accumulate_peaks(
    peaks, nodes, node_gradient, touched, n_touched, west, south, width, dx, density, time, arrival_thickness, metric
):
    """Running peaks at the nodes: thickness [m], speed [m s-1], pressure rho U^2 [Pa], and first arrival [s].

    Speed and pressure count where the flow is at least `arrival_thickness` [m] deep, so that empty rims do not.
    """
    rows, columns = nodes.shape[0], nodes.shape[1]
    for k in prange(n_touched):
        j_first = (touched[k] // (width + 1) + south) * BLOCK
        i_first = (touched[k] % (width + 1) + west) * BLOCK
        for j in range(j_first, min(j_first + BLOCK, rows)):
            for i in range(i_first, min(i_first + BLOCK, columns)):
                thickness = nodes[j, i, NODE_MASS] / (density * dx * dx)
                peaks[j, i, 0] = max(peaks[j, i, 0], thickness)
                if thickness >= arrival_thickness:
                    u, v = nodes[j, i, NODE_X], nodes[j, i, NODE_Y]
                    mx, my = metric.metric_gradient(node_gradient[j, i, 0], node_gradient[j, i, 1])
                    w = u * mx + v * my
                    speed2 = u * u + v * v + w * w
                    peaks[j, i, 1] = max(peaks[j, i, 1], np.sqrt(speed2))
                    peaks[j, i, 2] = max(peaks[j, i, 2], density * speed2)
                    if peaks[j, i, 3] < 0.0:
                        peaks[j, i, 3] = time


@jit_parallel
def grid_to_particles(
    rows, keys, order, start, block, bounds, west, south, width, nodes, bed, inside, report,
    dx, dt, density, gravity, clamp, wall, bound_bed, bound_energy, metric, curvature,
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
        mine[:] = 0.0
        signal2_max, speed2_max, kinetic, moving, flowing, clamped = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        limited, wild = 0.0, 0.0
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
                wave2 = gravity * thickness
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
        mine[LIMITED], mine[WILD] = limited, wild
        if mine[NOT_FINITE] == 0.0:
            mine[BOUND_RATIO], mine[BOUND_X], mine[BOUND_Y] = bound_ratio, bound_x, bound_y
        mine[BLOCK_WEST], mine[BLOCK_SOUTH] = block_west, block_south
        mine[BLOCK_EAST], mine[BLOCK_NORTH] = block_east, block_north


# why `advance` came back
(
    RUNNING,
    REACHED_TIME,
    STOPPED_MOVING,
    STOPPED_ENERGY,
    STOPPED_FOOTPRINT,
    ALL_LEFT,
    NOT_FINITE_STATE,
    TOO_FAST,
) = range(8)
# float64 clock: what one step hands to the next, and what a restart needs
(
    TIME,
    LAST_DT,  # last time step not cut by a frame time [s]
    SIGNAL,  # max |u| + sqrt(g h) [m s-1]
    SPEED,  # max |u| [m s-1]
    KINETIC_NOW,
    KINETIC_PEAK,
    KINETIC_LOW_SINCE,  # [s], -1 while the energy is not low
    MOVING_SHARE,
    MOVING_PEAK,
    FLOWING_SHARE,
    FOOTPRINT_MARK_TIME,
    FOOTPRINT_MARK,
    BOUND_WORST,  # over the run
    BOUND_NOW,
    BOUND_NOW_X,
    BOUND_NOW_Y,
    LIMITED_NOW,
    LIMITED_WORST,
    WILD_NOW,
    DEPTH_NOW,
    DEPTH_WORST,
    AIRBORNE_NOW,
    AIRBORNE_WORST,
    CLAMPED_TOTAL,
    CLOCK,
) = range(25)
# int64 counts
CURRENT, ROWS, ALIVE, STEP, SINCE_REORDER, WET, WEST, SOUTH, EAST, NORTH, BAD, COUNTS = range(12)


@jit
def next_time_step(clock, step, dx, cfl, fall_limit):
    """C dx / max(|u| + sqrt(g h)), at most dx / 4 per step, growing by at most 1.5 (design notes 3.7).

    `fall_limit` [s] is C times the time in which the steepest ground moves a resting column by a cell.
    """
    dt = min(cfl * dx / max(clock[SIGNAL], 1e-300), 0.25 * dx / max(clock[SPEED], 1e-300), fall_limit)
    return dt if step == 0 else min(dt, 1.5 * clock[LAST_DT])


@jit
def collect(report, node_report, ledger, clock, counts, total_mass):
    """Reduce the chunks' reports in their order into clock, counts and ledger."""
    clock[SIGNAL] = clock[SPEED] = clock[KINETIC_NOW] = clock[DEPTH_NOW] = clock[BOUND_NOW] = 0.0
    moving, flowing, airborne, limited, wild, alive_before = 0.0, 0.0, 0.0, 0.0, 0.0, counts[ALIVE]
    west, south, east, north = 1 << 16, 1 << 16, -1, -1
    for c in range(CHUNKS):
        mine = report[c]
        clock[SIGNAL] = max(clock[SIGNAL], mine[SIGNAL_MAX])
        clock[SPEED] = max(clock[SPEED], mine[SPEED_MAX])
        clock[KINETIC_NOW] += mine[KINETIC]
        clock[CLAMPED_TOTAL] += mine[CLAMPED]
        moving += mine[MOVING]
        flowing += mine[FLOWING]
        limited += mine[LIMITED]
        wild += mine[WILD]
        if mine[BOUND_RATIO] > clock[BOUND_NOW]:
            clock[BOUND_NOW], clock[BOUND_NOW_X], clock[BOUND_NOW_Y] = mine[BOUND_RATIO], mine[BOUND_X], mine[BOUND_Y]
        if mine[NOT_FINITE] > 0.0:
            counts[BAD] += int(mine[NOT_FINITE])
            clock[BOUND_NOW_X], clock[BOUND_NOW_Y] = mine[BOUND_X], mine[BOUND_Y]
        west, east = min(west, int(mine[BLOCK_WEST])), max(east, int(mine[BLOCK_EAST]))
        south, north = min(south, int(mine[BLOCK_SOUTH])), max(north, int(mine[BLOCK_NORTH]))
        for edge in range(EDGES):
            for entry in range(OUT_ENTRIES):
                ledger[edge, entry] += mine[OUT + edge * OUT_ENTRIES + entry]
            counts[ALIVE] -= int(mine[OUT + edge * OUT_ENTRIES + 5])
        counts[WET] += int(node_report[c, WET_NEW])
        airborne += node_report[c, AIRBORNE_MASS]
        clock[DEPTH_NOW] = max(clock[DEPTH_NOW], node_report[c, DEEPEST])
    counts[WEST], counts[SOUTH], counts[EAST], counts[NORTH] = west, south, east, north
    clock[LIMITED_NOW], clock[WILD_NOW] = limited / total_mass, wild / total_mass
    clock[LIMITED_WORST] = max(clock[LIMITED_WORST], clock[LIMITED_NOW])
    clock[AIRBORNE_NOW] = airborne / total_mass
    clock[AIRBORNE_WORST] = max(clock[AIRBORNE_WORST], clock[AIRBORNE_NOW])
    clock[BOUND_WORST] = max(clock[BOUND_WORST], clock[BOUND_NOW])
    clock[DEPTH_WORST] = max(clock[DEPTH_WORST], clock[DEPTH_NOW])
    clock[KINETIC_PEAK] = max(clock[KINETIC_PEAK], clock[KINETIC_NOW])
    clock[MOVING_SHARE] = moving / total_mass
    clock[FLOWING_SHARE] = flowing / total_mass
    clock[MOVING_PEAK] = max(clock[MOVING_PEAK], clock[MOVING_SHARE])
    return alive_before - counts[ALIVE]


@jit
def stop_rule(clock, counts):
    """Has the flow come to rest? (design notes 3.9) Answers the reason or RUNNING."""
    time = clock[TIME]
    if clock[MOVING_PEAK] > 0.0 and clock[MOVING_SHARE] < 0.01 * clock[MOVING_PEAK]:
        return STOPPED_MOVING
    if clock[KINETIC_PEAK] > 0.0 and clock[KINETIC_NOW] < 0.01 * clock[KINETIC_PEAK]:
        if clock[KINETIC_LOW_SINCE] < 0.0:
            clock[KINETIC_LOW_SINCE] = time
        elif time - clock[KINETIC_LOW_SINCE] >= 2.0:
            return STOPPED_ENERGY
    else:
        clock[KINETIC_LOW_SINCE] = -1.0
    if time - clock[FOOTPRINT_MARK_TIME] >= 10.0:
        grown = counts[WET] - clock[FOOTPRINT_MARK]
        clock[FOOTPRINT_MARK_TIME], clock[FOOTPRINT_MARK] = time, float(counts[WET])
        slowing = clock[KINETIC_NOW] <= 0.5 * clock[KINETIC_PEAK]
        if slowing and grown < 0.001 * counts[WET] and clock[FLOWING_SHARE] < 0.05:
            return STOPPED_FOOTPRINT
    return RUNNING


@jit
def advance(
    rows_pair, ids_pair, keys_pair, order, nodes, bed, node_gradient, inside, wet, clock, counts, ledger,
    until, max_steps, dx, cfl, fixed_dt, fall_limit, density, gravity, clamp, thickness_floor, wet_thickness,
    wall, stop_at_rest, bound_bed, bound_energy, wild_stop, total_mass, keep_peaks, peaks, arrival_thickness,
    metric, friction, curvature, lake,
):  # fmt: skip
    """March until time `until` [s] or for `max_steps`; the whole loop is compiled, whatever the number of particles.

    Everything that changes lives in the arrays (clock, counts, rows...), so that a call goes on exactly where the
    last one ended. Answers why it came back.
    """
    report = np.zeros((CHUNKS, REPORT))
    node_report = np.zeros((CHUNKS, NODE_REPORT))
    bounds = np.zeros(CHUNKS + 1, np.int64)
    histogram = np.zeros((CHUNKS, 16), np.int32)
    slot = np.zeros(16, np.int32)
    block = np.zeros(16, np.int32)
    start = np.zeros(17, np.int64)
    touched = np.zeros(64, np.int32)
    tiles = np.zeros((16, TILE * TILE * 4))
    for _ in range(max_steps):
        if clock[TIME] >= until:
            return REACHED_TIME
        n, now = counts[ROWS], counts[CURRENT]
        rows, ids, keys = rows_pair[now], ids_pair[now], keys_pair[now]
        west, south, east, north = counts[WEST], counts[SOUTH], counts[EAST], counts[NORTH]
        width, height = east - west + 1, north - south + 1
        if width * height > slot.size:
            size = 2 * width * height
            histogram = np.zeros((CHUNKS, size), np.int32)
            slot, block, start = np.zeros(size, np.int32), np.zeros(size, np.int32), np.zeros(size + 1, np.int64)
            touched = np.zeros(2 * size + 2 * (width + height) + 64, np.int32)
        active, alive = sort_by_block(keys, n, west, south, east, north, histogram, order, slot, block, start)
        if alive == 0:
            return ALL_LEFT
        if counts[SINCE_REORDER] >= REORDER_STEPS:
            other = 1 - now
            reorder(rows[:n], ids, order, alive, rows_pair[other], ids_pair[other], keys, keys_pair[other])
            counts[CURRENT], counts[ROWS], counts[SINCE_REORDER] = other, alive, 0
            rows, ids, keys = rows_pair[other], ids_pair[other], keys_pair[other]
            for p in range(alive):
                order[p] = p
        counts[SINCE_REORDER] += 1
        if active > tiles.shape[0]:
            tiles = np.zeros((active + active // 2, TILE * TILE * 4))
        split_evenly(start, active, bounds)
        n_touched = touched_blocks(slot, width, height, touched)

        dt = fixed_dt if fixed_dt > 0.0 else next_time_step(clock, counts[STEP], dx, cfl, fall_limit)
        clock[LAST_DT] = dt
        left = until - clock[TIME]
        last = dt >= left * (1.0 - 1e-12)
        if last:
            dt = left
        elif dt > 0.5 * left:  # two equal steps rather than one whole and one tiny
            dt = 0.5 * left

        particles_to_grid(
            rows, order, start, block, bounds, west, south, width, tiles, bed,
            dx, dt, density, gravity, metric, curvature, lake,
        )  # fmt: skip
        if wall:
            clear_ghosts(nodes)
        gather_tiles(nodes, tiles, slot, west, south, width, height, touched, n_touched)
        if wall:
            fold_walls(nodes)
        update_nodes(
            nodes, node_gradient, wet, touched, n_touched, west, south, width, node_report,
            dx, dt, density, gravity, thickness_floor, wet_thickness, metric, friction, curvature,
        )  # fmt: skip
        if keep_peaks:
            accumulate_peaks(
                peaks, nodes, node_gradient, touched, n_touched, west, south, width, dx, density, clock[TIME] + dt,
                arrival_thickness, metric,
            )  # fmt: skip
        if wall:
            mirror_walls(nodes)
        grid_to_particles(
            rows, keys, order, start, block, bounds, west, south, width, nodes, bed, inside, report,
            dx, dt, density, gravity, clamp, wall, bound_bed, bound_energy, metric, curvature,
        )  # fmt: skip

        counts[STEP] += 1
        clock[TIME] = until if last else clock[TIME] + dt
        gone = collect(report, node_report, ledger, clock, counts, total_mass)
        if counts[BAD] > 0:
            return NOT_FINITE_STATE
        if clock[WILD_NOW] > wild_stop:
            return TOO_FAST
        if counts[ALIVE] == 0:
            return ALL_LEFT
        if gone > 0 and counts[SINCE_REORDER] < REORDER_STEPS:
            counts[SINCE_REORDER] = REORDER_STEPS  # drop them from memory at the next step
        if stop_at_rest:
            reason = stop_rule(clock, counts)
            if reason != RUNNING:
                return reason
    return REACHED_TIME if clock[TIME] >= until else RUNNING
