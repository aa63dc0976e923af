"""Grid on the device between the two transfers: sums, gravity, ground, walls, layers, peaks.

What happens to a node, a node column or a block of nodes is the code of the CPU's kernels, compiled for the device;
this module has the loops over them. Each thread has a report of its own, that of `point_nodes`.
"""

import numpy as np
from numba import cuda, int32

from ...laws.contact_friction import equal_roughness
from ..points.bed_drag import COLUMN_MASSES, TOUCHING, WHOLE, column_contact
from ..points.ground_contact import press_column
from ..points.point_barriers import BARRIER
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
from ..points.point_records import ColumnSums, ContactLaws, Site
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
    Settings,
)
from ..points.point_time_step import STEP
from .device_functions import Kernel, Part, capped, real
from .device_records import TouchedBlocks
from .launch import DEPTH, DT, END, HEIGHT, SOUTH_NOW, STATUS, TOUCHED, WEST_NOW, WIDTH

NODES = BLOCK * BLOCK * BLOCK
COLUMNS = BLOCK * BLOCK


@Part
def nodes_now(run: np.ndarray, blocks: TouchedBlocks) -> NodeBlocks:
    """Return the touched blocks of nodes of this step.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    blocks : TouchedBlocks
    """
    return NodeBlocks(blocks.nodes, blocks.touched, run[TOUCHED])


@Part
def window_now(run: np.ndarray, blocks: TouchedBlocks) -> BlockWindow:
    """Return the window of blocks of this step.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    blocks : TouchedBlocks
    """
    return BlockWindow(blocks.slots, run[WEST_NOW], run[SOUTH_NOW], run[WIDTH], run[HEIGHT], run[DEPTH], blocks.lowest)


@Kernel
def gather_nodes(run: np.ndarray, tiles: np.ndarray, sources: np.ndarray, nodes: np.ndarray) -> None:
    """Sum the up to eight tiles that overlap a node, always in the same order.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    tiles : real[active, TILE_SIZE]
    sources : int32[touched, 8]
        Active blocks whose tiles overlap each touched block, -1 for none.
    nodes : real[touched, BLOCK_SIZE]
        Is set.
    """
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
def weigh_contact(
    run: np.ndarray, nodes: np.ndarray, touched: np.ndarray, ground: Ground, masses: np.ndarray, settings: Settings
) -> None:
    """Compute the masses in each block's node columns.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    nodes : real[touched, BLOCK_SIZE]
    touched : int32[touched, 3]
    ground : Ground
    masses : real[touched, BLOCK_COLUMNS] [kg]
        Is set.
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    for e in range(cuda.grid(1), COLUMNS * run[TOUCHED], cuda.gridsize(1)):
        t, column = e // COLUMNS, e % COLUMNS
        touching, whole = column_contact(
            nodes[t], touched, t, column // BLOCK, column % BLOCK, ground, settings.dx, settings.clearance
        )
        masses[t, column * COLUMN_MASSES + TOUCHING] = touching
        masses[t, column * COLUMN_MASSES + WHOLE] = whole


@Kernel
def spread_contact(run: np.ndarray, masses: np.ndarray, blocks: TouchedBlocks, columns: np.ndarray) -> None:
    """Sum the blocks' masses, from the lowest block upwards, into those of all node columns.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    masses : real[touched, BLOCK * BLOCK * entries]
    blocks : TouchedBlocks
    columns : real[rows, columns, entries]
        Is set at node columns of touched blocks.
    """
    if run[STATUS] != 0:
        return
    touched, slots, lowest = blocks.touched, blocks.slots, blocks.lowest
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
def clear_contact(run: np.ndarray, touched: np.ndarray, columns: np.ndarray) -> None:
    """Set the sums of node columns to 0 again where `spread_contact` has set them.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    touched : int32[touched, 3]
    columns : real[rows, columns, entries]
    """
    if run[STATUS] != 0:
        return
    for e in range(cuda.grid(1), COLUMNS * run[TOUCHED], cuda.gridsize(1)):
        t, column = e // COLUMNS, e % COLUMNS
        jj, ii = touched[t, 0] * BLOCK + column // BLOCK, touched[t, 1] * BLOCK + column % BLOCK
        if jj < columns.shape[0] and ii < columns.shape[1]:
            for entry in range(columns.shape[2]):
                columns[jj, ii, entry] = 0.0


@Kernel
def move_nodes(run: np.ndarray, now: np.ndarray, nodes: np.ndarray, settings: Settings) -> None:
    """Compute the velocities at all nodes after gravity.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    now : real[NOW_ENTRIES] [s]
    nodes : real[touched, BLOCK_SIZE]
        Is changed from momentum to velocity.
    settings : Settings
    """
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
def find_contacts(
    run: np.ndarray,
    nodes: np.ndarray,
    touched: np.ndarray,
    free: np.ndarray,
    ground: Ground,
    barriers: np.ndarray,
    reports: np.ndarray,
    settings: Settings,
    barrier: bool,
) -> None:
    """Apply the walls that act before the ground, and find the blocks that touch nothing; all reports begin here.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    nodes : real[touched, BLOCK_SIZE]
    touched : int32[touched, 3]
    free : uint8[touched]
        Is set: 1 for blocks that touch nothing.
    ground : Ground
    barriers : real[rows, columns, POINT_BARRIER_ENTRIES]
    reports : real[threads, NODE_REPORT]
        Is set.
    settings : Settings
    barrier : bool
        Whether there are barriers.
    """
    mine = reports[cuda.grid(1)]
    for k in range(NODE_REPORT):
        mine[k] = 0.0
    if run[STATUS] != 0:
        return
    nx, ny = settings.cells_x, settings.cells_y
    for t in range(cuda.grid(1), run[TOUCHED], cuda.gridsize(1)):
        row, column = touched[t, 0], touched[t, 1]
        touches = is_near_ground(touched[t, 2] * BLOCK, row, column, ground, settings.dx)
        if settings.wall and is_at_wall(row, column, nx, ny):
            stop_at_walls(nodes[t], row, column, nx, ny, ground, False, mine)
            touches = True
        if barrier and not touches:
            touches = has_barrier(row, column, barriers)
        free[t] = 0 if touches else 1
        if not touches:
            mine[FASTEST2] = max(mine[FASTEST2], fastest_squared(nodes[t]))


@Kernel
def couple_layers(
    run: np.ndarray,
    now: np.ndarray,
    blocks: TouchedBlocks,
    site: Site,
    column_mass: np.ndarray,
    layers: np.ndarray,
    reports: np.ndarray,
    settings: Settings,
    laws: ContactLaws,
) -> None:
    """Apply the traction of a law of friction and the links between layers.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    now : real[NOW_ENTRIES] [s]
    blocks : TouchedBlocks
    site : Site
    column_mass : real[rows, columns, COLUMN_MASSES] [kg]
    layers : real[threads, levels, LAYER_ENTRIES]
        Work arrays.
    reports : real[threads, NODE_REPORT]
    settings : Settings
    laws : ContactLaws
    """
    if run[STATUS] != 0:
        return
    grid, window = nodes_now(run, blocks), window_now(run, blocks)
    c = cuda.grid(1)
    if c >= layers.shape[0]:
        return
    rough = equal_roughness(laws.contact, laws.zones, settings.gravity)
    for e in range(c, COLUMNS * run[TOUCHED], min(layers.shape[0], cuda.gridsize(1))):
        couple_column(
            e // COLUMNS,
            e % COLUMNS,
            grid,
            window,
            site,
            column_mass,
            layers[c],
            reports[c],
            now[DT],
            settings,
            laws,
            rough,
        )


@capped(single=112, double=152)
def press_on_ground(
    run: np.ndarray,
    now: np.ndarray,
    counts: np.ndarray,
    blocks: TouchedBlocks,
    free: np.ndarray,
    site: Site,
    yields: np.ndarray,
    reports: np.ndarray,
    settings: Settings,
    laws: ContactLaws,
) -> None:
    """Apply the contact with smooth ground, one multiplier for each node column (see `ground_contact`).

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    now : real[NOW_ENTRIES] [s]
    counts : int64[COUNTS]
    blocks : TouchedBlocks
    free : uint8[touched]
        1 for blocks that touch nothing.
    site : Site
    yields : real[2, rows, columns, YIELD_ENTRIES]
    reports : real[threads, NODE_REPORT]
    settings : Settings
    laws : ContactLaws
    """
    if run[STATUS] != 0:
        return
    grid, window = nodes_now(run, blocks), window_now(run, blocks)
    for e in range(int32(cuda.grid(1)), int32(COLUMNS * run[TOUCHED]), int32(cuda.gridsize(1))):
        t = e // COLUMNS
        if free[t] == 0:
            press_column(
                t,
                e % COLUMNS,
                grid,
                window,
                site,
                yields,
                counts[STEP] + 1,
                reports[cuda.grid(1)],
                now[DT],
                settings,
                laws,
            )


@Part
def _stands_on(barriers, touched, t, column):
    """Return whether a barrier stands on node `column` (0 to 15) of touched block `t`."""
    j, i = touched[t, 0] * BLOCK + column // BLOCK, touched[t, 1] * BLOCK + column % BLOCK
    return barriers[min(j, barriers.shape[0] - 1), min(i, barriers.shape[1] - 1), BARRIER] > 0.0


@capped(double=104)
def hold_nodes(
    run: np.ndarray,
    now: np.ndarray,
    blocks: TouchedBlocks,
    free: np.ndarray,
    site: Site,
    sums: ColumnSums,
    booked: np.ndarray,
    reports: np.ndarray,
    settings: Settings,
    laws: ContactLaws,
) -> None:
    """Apply the contact node by node on folds and deep under the ground, in each column of blocks that are not `free`.

    Node columns that barriers stand on are those of `device_barriers.hold_at_barriers`.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    now : real[NOW_ENTRIES] [s]
    blocks : TouchedBlocks
    free : uint8[touched]
        1 for blocks that touch nothing.
    site : Site
    sums : ColumnSums
    booked : real[rows of loads, POINT_BARRIER_SUMS]
        Is not changed here.
    reports : real[threads, NODE_REPORT]
    settings : Settings
    laws : ContactLaws
    """
    if run[STATUS] != 0:
        return
    grid, touched = nodes_now(run, blocks), blocks.touched
    barrier, barriers = laws.barrier, site.barriers
    for e in range(cuda.grid(1), COLUMNS * run[TOUCHED], cuda.gridsize(1)):
        t, column = e // COLUMNS, e % COLUMNS
        if free[t] == 0 and not (barrier and _stands_on(barriers, touched, t, column)):
            hold_column(
                t,
                column // BLOCK,
                column % BLOCK,
                grid,
                site,
                sums,
                reports[cuda.grid(1)],
                booked,
                now[DT],
                settings,
                laws,
            )


@Kernel
def finish_nodes(
    run: np.ndarray,
    nodes: np.ndarray,
    touched: np.ndarray,
    free: np.ndarray,
    ground: Ground,
    reports: np.ndarray,
    settings: Settings,
) -> None:
    """Apply the walls once more, and report the largest speed of blocks that are not `free`.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    nodes : real[touched, BLOCK_SIZE]
    touched : int32[touched, 3]
    free : uint8[touched]
        1 for blocks that touch nothing.
    ground : Ground
    reports : real[threads, NODE_REPORT]
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    nx, ny = settings.cells_x, settings.cells_y
    mine = reports[cuda.grid(1)]
    for t in range(cuda.grid(1), run[TOUCHED], cuda.gridsize(1)):
        if free[t] == 0:
            if settings.wall and is_at_wall(touched[t, 0], touched[t, 1], nx, ny):
                stop_at_walls(nodes[t], touched[t, 0], touched[t, 1], nx, ny, ground, True, mine)
            mine[FASTEST2] = max(mine[FASTEST2], fastest_squared(nodes[t]))


@Kernel
def note_peaks(
    run: np.ndarray,
    now: np.ndarray,
    blocks: TouchedBlocks,
    ground_nodes: np.ndarray,
    peaks: np.ndarray,
    settings: Settings,
) -> None:
    """Update the running peaks over the node columns (see `point_peaks`), a thread for each.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    now : real[NOW_ENTRIES] [s]
    blocks : TouchedBlocks
    ground_nodes : real[rows, columns, GROUND_ENTRIES]
    peaks : real[rows, columns, entries]
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    nodes, touched, slots, lowest = blocks
    depth, nx, ny = run[DEPTH], settings.cells_x, settings.cells_y
    window = window_now(run, blocks)
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
