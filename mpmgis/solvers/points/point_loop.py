"""Time loop of the 3D MPM.

Points are rows of numbers in blocks of 4 x 4 x 4 nodes (`point_blocks`). A step sums them to the nodes
(`points_to_grid`), updates the nodes (`point_nodes`, `point_layers`, `ground_contact`) and moves the points
(`grid_to_points`). A point carries its momentum and its contribution to the nodes of the next step: its affine momentum
less the impulse of its stress. The time step is therefore chosen before the points move, from the velocities of the
nodes, which no point exceeds.
"""

import numpy as np

from ...compiled import law_functions as _laws  # noqa: F401  (registers the methods of laws)
from ...compiled.block_order import CHUNKS, REORDER_STEPS, STRIP, reorder, split_evenly
from ...compiled.jit import jit
from ...laws.contact_friction import has_traction
from ...laws.effect_slots import PointEffects
from ...laws.material import FLUID
from .bed_drag import BLOCK_COLUMNS, COLUMN_MASSES, clear_contact, spread_contact, weigh_contact
from .grid_to_points import grid_to_points
from .ground_contact import press_on_ground
from .point_arrays import PointArrays
from .point_barriers import BLOCK_FLOW, COLUMN_FLOW, POINT_BARRIER_SUMS, SHARE, collect_point_barriers, weigh_flow
from .point_blocks import EAST, NORTH, SORT_PIECES, SOUTH, TALL, WEST, link_blocks, rows_and_columns, sort_by_block
from .point_crests import press_on_crests
from .point_density import EVERY, correct_density
from .point_faces import COLUMNS, LINE_ENTRIES, keep_before_faces, press_on_faces
from .point_ground import Ground
from .point_layers import couple_layers
from .point_nodes import NODE_REPORT, gather_nodes, hold_nodes, move_nodes
from .point_peaks import COLUMN_SUMS, accumulate_point_peaks
from .point_records import ColumnSums, FaceArrays, NodeReports, PointPlaces, Site
from .point_report import REPORT
from .point_rows import (
    BLOCK,
    BLOCK_SIZE,
    TILE_SIZE,
    ActiveBlocks,
    BlockWindow,
    NodeBlocks,
    Settings,
    SortedPoints,
    Surface,
)
from .point_time_step import (
    ALIVE,
    ALL_LEFT,
    BAD,
    HITS,
    IMPULSE_GRAVITY,
    LEAKED,
    MASS_NOW,
    NOT_FINITE_STATE,
    REACHED_TIME,
    ROWS,
    RUNNING,
    SCATTERED,
    SINCE_REORDER,
    STEP,
    STEP_NOW,
    TIME,
    TOTAL_MASS,
    WINDOW_FIRST,
    book_points_left,
    collect,
    collect_nodes,
    note_fastest,
    set_next_step,
)
from .points_to_grid import points_to_grid

__all__ = [  # used by the solver through this module, as those of `column_loop`
    "BLOCK",
    "Settings",
    "advance",
    "rows_and_columns",
]

MOST_PLACES = 1 << 25  # blocks in the window of all points; a gigabyte of counters
FIRST_PLACES, FIRST_ACTIVE, FIRST_TOUCHED = 16, 64, 256  # blocks that there is room for at first; arrays grow


@jit
def has_openings(barriers: np.ndarray) -> bool:
    """Return whether any node column of barriers is partly open.

    Parameters
    ----------
    barriers : float64[rows, columns, POINT_BARRIER_ENTRIES]
    """
    for j in range(barriers.shape[0]):
        for i in range(barriers.shape[1]):
            if barriers[j, i, SHARE] > 0.0:
                return True
    return False


@jit
def _sort_arrays(size):
    """Return (histogram, slot, touched slot, block, start) for sorting into a window of `size` places."""
    slot, touched_slot, block = np.zeros(size, np.int32), np.zeros(size, np.int32), np.zeros(size, np.int32)
    return np.zeros((SORT_PIECES, size), np.int32), slot, touched_slot, block, np.zeros(size + 1, np.int64)


@jit
def _block_arrays(rows, size):
    """Return the ActiveBlocks for up to `size` blocks of `rows`."""
    tiles = np.zeros((size, TILE_SIZE), rows.dtype)
    return ActiveBlocks(np.zeros((size, 3), np.int32), np.zeros((size, 8), np.int32), tiles)


@jit
def _node_arrays(rows, size, drags, opens):
    """Return (nodes, free, masses, flow) for `size` node blocks; masses where the bed `drags`, flow where `opens`."""
    masses = np.zeros((size if drags else 1, BLOCK_COLUMNS))
    flow = np.zeros((size if opens else 1, BLOCK_FLOW))
    return np.zeros((size, BLOCK_SIZE), rows.dtype), np.zeros(size, np.uint8), masses, flow


@jit
def _column_arrays(ground: Ground, drags: bool, opens: bool) -> ColumnSums:
    """Return the sums of all node columns: masses where the bed `drags`, flow where a barrier `opens`."""
    rows, columns = ground.nodes.shape[0], ground.nodes.shape[1]
    masses = np.zeros((rows if drags else 1, columns if drags else 1, COLUMN_MASSES))
    return ColumnSums(masses, np.zeros((rows if opens else 1, columns if opens else 1, COLUMN_FLOW)))


@jit
def _work_on_faces(places, state):
    """Return the FaceArrays of a run."""
    levels = state.face_yields.shape[2] - 2
    lines = np.zeros((places.faces.shape[0], COLUMNS + levels + 1, LINE_ENTRIES))
    return FaceArrays(places.faces, lines, state.face_yields)


@jit
def advance(
    state: PointArrays,
    places: PointPlaces,
    order: np.ndarray,
    until: float,
    after: float,
    max_steps: int,
    settings: Settings,
    effects: PointEffects,
) -> int:
    """Advance to a time or by a number of steps; the whole loop is compiled, for any number of points.

    Everything that changes is in `state`: a call continues exactly where the last one ended.

    Parameters
    ----------
    state : PointArrays
    places : PointPlaces
    order : int32[n]
        Work array for indices of the points.
    until : float [s]
        Time at which to stop.
    after : float [s]
        The next time that will be requested: the step after `until` is chosen for it.
    max_steps : int
        Largest number of steps.
    settings : Settings
    effects : PointEffects
        Material, softening and transfer in the precision of the rows.

    Returns
    -------
    reason : int
        Why it stopped: one of the reasons of `point_time_step`.
    """
    rows, keys, clock, counts, yields = state.rows, state.keys, state.clock, state.counts, state.yields
    ground, lowest, inside, barriers = places.ground, places.lowest, places.inside, places.barriers
    dx, gravity = settings.dx, settings.gravity
    contact, zones, barrier = effects.contact, effects.zones, effects.barrier
    site = Site(ground.nodes, ground.folds, ground.exact, places.zone_values, barriers)
    extent = counts[WINDOW_FIRST:]
    report = np.zeros((CHUNKS, REPORT))
    node_report = np.zeros((CHUNKS, NODE_REPORT))
    barrier_report = np.zeros((CHUNKS, state.barrier_sums.shape[0], POINT_BARRIER_SUMS))
    reports, faces = NodeReports(node_report, barrier_report), _work_on_faces(places, state)
    bounds = np.zeros(CHUNKS + 1, np.int64)
    column_sums = np.zeros((CHUNKS, COLUMN_SUMS))
    histogram, slot, touched_slot, block, start = _sort_arrays(FIRST_PLACES)
    room = FIRST_ACTIVE
    blocks = _block_arrays(rows, room)
    drags = has_traction(contact)
    opens = barrier and has_openings(barriers)
    nodes, free, block_mass, block_flow = _node_arrays(rows, FIRST_TOUCHED, drags, opens)
    sources, touched = np.zeros((FIRST_TOUCHED, 8), np.int32), np.zeros((FIRST_TOUCHED, 3), np.int32)
    sums = _column_arrays(ground, drags, opens)
    surface = Surface(ground.nodes, lowest, inside)
    strip, names = np.empty((counts[ROWS], STRIP), rows.dtype), np.empty((counts[ROWS], 2), np.int64)
    for _ in range(max_steps):
        if clock[TIME] >= until:
            return REACHED_TIME
        if counts[ALIVE] == 0:
            return ALL_LEFT
        west, south = extent[WEST], extent[SOUTH]
        width, height, depth = extent[EAST] - west + 2, extent[NORTH] - south + 2, extent[TALL] + 2
        size = width * height * depth
        if size > MOST_PLACES:
            return SCATTERED
        if size > slot.size:
            histogram, slot, touched_slot, block, start = _sort_arrays(size + size // 2)
        active, alive = sort_by_block(
            keys, counts[ROWS], extent, width, depth, size, histogram, order, slot, block, start
        )
        if active > room:
            room = active + active // 2
            blocks = _block_arrays(rows, room)
        if 8 * active > touched.shape[0]:
            sources, touched = np.zeros((8 * room, 8), np.int32), np.zeros((8 * room, 3), np.int32)
        split_evenly(start, active, bounds)
        n_touched = link_blocks(
            block, active, extent, width, depth, lowest, touched_slot, size, touched, sources, blocks.targets
        )
        if counts[SINCE_REORDER] >= REORDER_STEPS:
            reorder(rows, state.ids, keys, order, alive, strip, names)
            counts[ROWS], counts[SINCE_REORDER] = alive, 0
            for p in range(alive):
                order[p] = p
        counts[SINCE_REORDER] += 1
        if n_touched > nodes.shape[0]:
            nodes, free, block_mass, block_flow = _node_arrays(rows, n_touched + n_touched // 2, drags, opens)
        for a in range(active):
            own = blocks.targets[a, 0]
            blocks.places[a, 0], blocks.places[a, 1], blocks.places[a, 2] = (
                touched[own, 1],
                touched[own, 0],
                touched[own, 2],
            )
        points = SortedPoints(rows, keys, order, start, bounds)
        window = BlockWindow(touched_slot, west, south, width, height, depth, lowest)
        grid = NodeBlocks(nodes, touched, n_touched)

        dt, hits = clock[STEP_NOW], clock[HITS] > 0.0
        end = until if hits else clock[TIME] + dt
        points_to_grid(points, blocks.tiles)
        if drags or opens:
            gather_nodes(nodes, blocks.tiles, sources, n_touched)
        if drags:
            weigh_contact(nodes, touched, n_touched, ground, dx, settings.clearance, block_mass)
            spread_contact(block_mass, touched, n_touched, sums.mass)
        if opens:
            weigh_flow(nodes, touched, n_touched, block_flow)
            spread_contact(block_flow, touched, n_touched, sums.flow)
        move_nodes(
            grid, blocks.tiles, sources, drags or opens, free, ground, barriers, node_report, dt, settings, barrier
        )
        if drags:
            couple_layers(grid, window, site, sums.mass, node_report, dt, settings, contact, zones, barrier)
        step = counts[STEP] + 1
        press_on_ground(grid, window, free, site, yields, step, node_report, dt, settings, contact, zones, barrier)
        if barrier:
            barrier_report[:] = 0.0
            press_on_faces(grid, window, site, faces, yields, step, reports, dt, settings, contact, zones, barrier)
            press_on_crests(grid, window, free, barriers, reports, settings)
        hold_nodes(grid, free, site, sums, reports, dt, settings, contact, zones, barrier)
        if drags:
            clear_contact(touched, n_touched, sums.mass)
        if opens:
            clear_contact(touched, n_touched, sums.flow)
        if settings.keep_peaks:
            accumulate_point_peaks(state.peaks, column_sums, grid, window, ground.nodes, end, settings)
        if effects.material.kind == FLUID and counts[STEP] % EVERY == 0:
            correct_density(points, blocks, grid, free, ground, yields, step, barriers, node_report, settings, barrier)
        collect_nodes(node_report, clock)
        if barrier:
            collect_point_barriers(barrier_report, state.barrier_sums, dt)
        clock[IMPULSE_GRAVITY] += dt * gravity * clock[MASS_NOW]
        set_next_step(clock, counts, end, until, after, settings)
        grid_to_points(
            points,
            blocks,
            nodes,
            surface,
            report,
            settings,
            dt,
            clock[STEP_NOW],
            effects.material,
            effects.softening,
            effects.transfer,
        )
        if barrier:
            keep_before_faces(rows, keys, counts[ROWS], lowest, inside, places.faces, barriers, dx, report)
        counts[STEP] += 1
        clock[TIME] = end
        before = counts[ALIVE]
        note_fastest(report, clock, points, dx, lowest)
        lifted = collect(report, state.ledger, clock, counts, extent)
        if counts[BAD] > 0:
            return NOT_FINITE_STATE
        if lifted > settings.leak_stop * clock[TOTAL_MASS]:
            return LEAKED
        if counts[ALIVE] < before:
            book_points_left(points, blocks.places, active, dt, dx, inside.shape, state.left_cells)
    return REACHED_TIME if clock[TIME] >= until else RUNNING
