"""The grid on the device between the two transfers: sums, gravity, ground, walls, layers, peaks.

What happens to a node, a node column or a block of nodes is the code of the CPU's kernels, compiled for the device;
this module has the loops over them. Each thread has a report of its own, that of `point_nodes`.
"""

from numba import cuda, int32

from ..points.bed_drag import COLUMN_MASSES, TOUCHING, WHOLE, column_contact
from ..points.point_barriers import BARRIER
from ..points.point_clock import STEP
from ..points.point_contact import press_column
from ..points.point_ground import Ground
from ..points.point_layers import couple_column
from ..points.point_nodes import (
    FASTEST2,
    NODE_REPORT,
    fastest_squared,
    has_barrier,
    hold_column,
    is_at_wall,
    is_near_ground,
    stop_at_walls,
)
from ..points.point_peaks import COLUMN_SUMS, is_lowest, note_column_peaks
from ..points.point_rows import (
    BLOCK,
    BLOCK_SIZE,
    GHOSTS,
    NODE_MASS,
    NODE_X,
    NODE_Y,
    NODE_Z,
    TILE_LAYER,
    TILE_ROW,
    BlockWindow,
    NodeBlocks,
)
from .device_functions import REGISTERS, Kernel, Part, capped, real
from .launch import DEPTH, DT, END, HEIGHT, SOUTH_NOW, STATUS, TOUCHED, WEST_NOW, WIDTH

NODES = BLOCK * BLOCK * BLOCK
COLUMNS = BLOCK * BLOCK


@Part
def window_now(run, slots, lowest):
    """The window of blocks of this step."""
    return BlockWindow(slots, run[WEST_NOW], run[SOUTH_NOW], run[WIDTH], run[HEIGHT], run[DEPTH], lowest)


@Kernel
def gather_nodes(run, tiles, sources, nodes):
    """Sum the up to eight tiles that overlap a node, always in the same order."""
    if run[STATUS] != 0:
        return
    for e in range(cuda.grid(1), NODES * run[TOUCHED], cuda.gridsize(1)):
        t, n = e // NODES, e % NODES
        i, j, k = n % BLOCK, (n // BLOCK) % BLOCK, n // COLUMNS
        x = y = z = mass = real(0.0)
        for o in range(8):
            a, oi, oj, ok = sources[t, o], o & 1, (o >> 1) & 1, o >> 2
            if a >= 0 and (oi == 0 or i < 2) and (oj == 0 or j < 2) and (ok == 0 or k < 2):
                at = (k + BLOCK * ok) * TILE_LAYER + (j + BLOCK * oj) * TILE_ROW + (i + BLOCK * oi) * 4
                x += tiles[a, at]
                y += tiles[a, at + 1]
                z += tiles[a, at + 2]
                mass += tiles[a, at + 3]
        nodes[t, 4 * n + NODE_X], nodes[t, 4 * n + NODE_Y], nodes[t, 4 * n + NODE_Z] = x, y, z
        nodes[t, 4 * n + NODE_MASS] = mass


@Kernel
def weigh_contact(run, nodes, touched, ground_nodes, folds, exact, masses, settings):
    """Masses [kg] in each block's node columns, into `masses` real[blocks, BLOCK_COLUMNS]."""
    if run[STATUS] != 0:
        return
    ground = Ground(ground_nodes, folds, exact)
    for e in range(cuda.grid(1), COLUMNS * run[TOUCHED], cuda.gridsize(1)):
        t, column = e // COLUMNS, e % COLUMNS
        touching, whole = column_contact(
            nodes[t], touched, t, column // BLOCK, column % BLOCK, ground, settings.dx, settings.clearance
        )
        masses[t, column * COLUMN_MASSES + TOUCHING] = touching
        masses[t, column * COLUMN_MASSES + WHOLE] = whole


@Kernel
def spread_contact(run, masses, touched, slots, lowest, columns):
    """Sum the blocks' `masses` from the lowest upwards into `columns` real[rows, columns, entries] of the ground."""
    if run[STATUS] != 0:
        return
    width, depth, entries = run[WIDTH], run[DEPTH], columns.shape[2]
    for e in range(cuda.grid(1), COLUMNS * run[TOUCHED], cuda.gridsize(1)):
        t, column = e // COLUMNS, e % COLUMNS
        row, block_column = touched[t, 0], touched[t, 1]
        place = ((row - run[SOUTH_NOW]) * width + block_column - run[WEST_NOW]) * depth
        jj, ii = row * BLOCK + column // BLOCK, block_column * BLOCK + column % BLOCK
        if jj >= columns.shape[0] or ii >= columns.shape[1]:
            continue
        if not is_lowest(slots, place, touched[t, 2] - lowest[row, block_column, 0]):
            continue
        for entry in range(entries):
            total = real(0.0)
            for up in range(depth):
                if slots[place + up] >= 0:
                    total += masses[slots[place + up], column * entries + entry]
            columns[jj, ii, entry] = total


@Kernel
def clear_contact(run, touched, columns):
    """Set `columns` to 0 again where `spread_contact` has been."""
    if run[STATUS] != 0:
        return
    for e in range(cuda.grid(1), COLUMNS * run[TOUCHED], cuda.gridsize(1)):
        t, column = e // COLUMNS, e % COLUMNS
        jj, ii = touched[t, 0] * BLOCK + column // BLOCK, touched[t, 1] * BLOCK + column % BLOCK
        if jj < columns.shape[0] and ii < columns.shape[1]:
            for entry in range(columns.shape[2]):
                columns[jj, ii, entry] = 0.0


@Kernel
def move_nodes(run, now, nodes, settings):
    """Velocities at all nodes after gravity."""
    if run[STATUS] != 0:
        return
    fall = now[DT] * settings.gravity
    for e in range(cuda.grid(1), NODES * run[TOUCHED], cuda.gridsize(1)):
        t, n = e // NODES, 4 * (e % NODES)
        mass = nodes[t, n + NODE_MASS]
        if mass > 0.0:
            nodes[t, n + NODE_X] /= mass
            nodes[t, n + NODE_Y] /= mass
            nodes[t, n + NODE_Z] = nodes[t, n + NODE_Z] / mass - fall


@Kernel
def find_contacts(run, nodes, touched, free, ground_nodes, folds, exact, barriers, reports, settings, barrier):
    """Walls before the ground, and which blocks touch nothing (`free`); all reports begin here."""
    mine = reports[cuda.grid(1)]
    for k in range(NODE_REPORT):
        mine[k] = 0.0
    if run[STATUS] != 0:
        return
    ground = Ground(ground_nodes, folds, exact)
    nx, ny = settings.cells_x, settings.cells_y
    for t in range(cuda.grid(1), run[TOUCHED], cuda.gridsize(1)):
        row, column = touched[t, 0], touched[t, 1]
        touches = is_near_ground(touched[t, 2] * BLOCK, row, column, ground, settings.dx)
        if settings.wall and is_at_wall(row, column, nx, ny):
            stop_at_walls(nodes[t], row, column, nx, ny, ground, False, mine)
            touches = True
        if barrier.barrier_active() and not touches:
            touches = has_barrier(row, column, barriers)
        free[t] = 0 if touches else 1
        if not touches:
            mine[FASTEST2] = max(mine[FASTEST2], fastest_squared(nodes[t]))


@Kernel
def couple_layers(
    run,
    now,
    nodes,
    touched,
    slots,
    lowest,
    ground_nodes,
    folds,
    exact,
    zone_values,
    barriers,
    column_mass,
    layers,
    reports,
    settings,
    contact,
    zones,
    barrier,
):
    """Voellmy's drag and links between layers; `layers` real[threads, levels, LAYER_ENTRIES] are work arrays."""
    if run[STATUS] != 0:
        return
    grid = NodeBlocks(nodes, touched, run[TOUCHED])
    ground = Ground(ground_nodes, folds, exact)
    window = window_now(run, slots, lowest)
    c = cuda.grid(1)
    if c >= layers.shape[0]:
        return
    for e in range(c, COLUMNS * run[TOUCHED], min(layers.shape[0], cuda.gridsize(1))):
        couple_column(
            e // COLUMNS,
            e % COLUMNS,
            grid,
            window,
            ground,
            zone_values,
            barriers,
            column_mass,
            layers[c],
            reports[c],
            now[DT],
            settings,
            contact,
            zones,
            barrier,
        )


@capped(double=152)
def press_on_ground(
    run,
    now,
    counts,
    nodes,
    touched,
    slots,
    lowest,
    free,
    ground_nodes,
    folds,
    exact,
    zone_values,
    barriers,
    yields,
    reports,
    settings,
    contact,
    zones,
    barrier,
):
    """Contact with smooth ground, one multiplier for each node column (see `point_contact`)."""
    if run[STATUS] != 0:
        return
    grid = NodeBlocks(nodes, touched, run[TOUCHED])
    ground = Ground(ground_nodes, folds, exact)
    window = window_now(run, slots, lowest)
    for e in range(int32(cuda.grid(1)), int32(COLUMNS * run[TOUCHED]), int32(cuda.gridsize(1))):
        t = e // COLUMNS
        if free[t] == 0:
            press_column(
                t,
                e % COLUMNS,
                grid,
                window,
                ground,
                zone_values,
                barriers,
                yields,
                counts[STEP] + 1,
                reports[cuda.grid(1)],
                now[DT],
                settings,
                contact,
                zones,
                barrier,
            )


@Part
def _stands_on(barriers, touched, t, column):
    """Whether a barrier stands on node `column` (0 to 15) of touched block `t`."""
    j, i = touched[t, 0] * BLOCK + column // BLOCK, touched[t, 1] * BLOCK + column % BLOCK
    return barriers[min(j, barriers.shape[0] - 1), min(i, barriers.shape[1] - 1), BARRIER] > 0.0


@capped(double=REGISTERS)
def hold_nodes(
    run,
    now,
    nodes,
    touched,
    free,
    ground_nodes,
    folds,
    exact,
    zone_values,
    barriers,
    column_mass,
    flow,
    booked,
    reports,
    settings,
    contact,
    zones,
    barrier,
):
    """Contact node by node on folds and deep under the ground, in each column of blocks that are not `free`.

    Node columns that barriers stand on are those of `point_barriers.hold_at_barriers`.
    """
    if run[STATUS] != 0:
        return
    grid = NodeBlocks(nodes, touched, run[TOUCHED])
    ground = Ground(ground_nodes, folds, exact)
    for e in range(cuda.grid(1), COLUMNS * run[TOUCHED], cuda.gridsize(1)):
        t, column = e // COLUMNS, e % COLUMNS
        if free[t] == 0 and not (barrier.barrier_active() and _stands_on(barriers, touched, t, column)):
            hold_column(
                t,
                column // BLOCK,
                column % BLOCK,
                grid,
                ground,
                zone_values,
                barriers,
                column_mass,
                flow,
                reports[cuda.grid(1)],
                booked,
                now[DT],
                settings,
                contact,
                zones,
                barrier,
            )


@Kernel
def finish_nodes(run, nodes, touched, free, ground_nodes, folds, exact, reports, settings):
    """Walls once more, and the largest speed of blocks that are not `free`."""
    if run[STATUS] != 0:
        return
    ground = Ground(ground_nodes, folds, exact)
    nx, ny = settings.cells_x, settings.cells_y
    mine = reports[cuda.grid(1)]
    for t in range(cuda.grid(1), run[TOUCHED], cuda.gridsize(1)):
        if free[t] == 0:
            if settings.wall and is_at_wall(touched[t, 0], touched[t, 1], nx, ny):
                stop_at_walls(nodes[t], touched[t, 0], touched[t, 1], nx, ny, ground, True, mine)
            mine[FASTEST2] = max(mine[FASTEST2], fastest_squared(nodes[t]))


@Kernel
def note_peaks(run, now, nodes, touched, slots, lowest, ground_nodes, peaks, settings):
    """Running peaks over the node columns (see `point_peaks`), a thread for each."""
    if run[STATUS] != 0:
        return
    depth, nx, ny = run[DEPTH], settings.cells_x, settings.cells_y
    window = window_now(run, slots, lowest)
    for e in range(cuda.grid(1), COLUMNS * run[TOUCHED], cuda.gridsize(1)):
        t, own = e // COLUMNS, e % COLUMNS
        row, column = touched[t, 0], touched[t, 1]
        place = ((row - run[SOUTH_NOW]) * run[WIDTH] + column - run[WEST_NOW]) * depth
        j, i = row * BLOCK + own // BLOCK, column * BLOCK + own % BLOCK
        if j < GHOSTS or i < GHOSTS or j > GHOSTS + ny or i > GHOSTS + nx:
            continue
        if not is_lowest(slots, place, touched[t, 2] - lowest[row, column, 0]):
            continue
        px = py = pz = mass = real(0.0)
        for up in range(depth):
            above = slots[place + up]
            if above >= 0:
                for n in range(4 * own, BLOCK_SIZE, COLUMN_SUMS):
                    here = nodes[above, n + NODE_MASS]
                    px += here * nodes[above, n + NODE_X]
                    py += here * nodes[above, n + NODE_Y]
                    pz += here * nodes[above, n + NODE_Z]
                    mass += here
        note_column_peaks(peaks, j, i, px, py, pz, mass, nodes, window, ground_nodes, now[END], settings)
