"""Transfer of the depth-averaged MPM from grid to columns, in batches of a block's columns."""

from math import sqrt
from typing import NamedTuple

import numpy as np

from ...compiled import law_functions as _laws  # noqa: F401  (registers the functions of laws)
from ...compiled.block_order import CHUNKS, GONE
from ...compiled.jit import jit, jit_inline, jit_parallel, prange
from ...compiled.simd_lanes import get, lanes, load, multiply_add, put, store, transposed
from ...laws.entrainment import Entrainment
from .column_blocks import SortedColumns, block_key
from .column_motion import (
    MotionLaws,
    SpeedBound,
    StepTimes,
    all_stay,
    book_out,
    clamp_areas,
    keep_in,
    move,
    survey,
    turn,
)
from .column_records import NodeFields, Settings
from .column_report import (
    BLOCK_EAST,
    BLOCK_NORTH,
    BLOCK_SOUTH,
    BLOCK_WEST,
    BOUND_RATIO,
    CLAMPED,
    HELD_STRETCH,
    HELD_THIN,
    HELD_WALL,
    KINETIC,
    NOT_FINITE,
    OUT,
    REPORT,
    SIGNAL_MAX,
    SPEED_MAX,
    STIFF,
)
from .column_rows import (
    BATCH,
    L_GX0,
    L_GX1,
    L_GX2,
    L_GY0,
    L_GY1,
    L_GY2,
    L_MX,
    L_MY,
    L_SX,
    L_SY,
    L_WX0,
    L_WX1,
    L_WX2,
    L_WY0,
    L_WY1,
    L_WY2,
    L_X,
    L_Y,
    LINES,
    Q_ALONG_X,
    Q_ALONG_Y,
    Q_BED,
    Q_BED_SLOPE,
    Q_MEAN,
    Q_MOMENT_X,
    Q_MOMENT_Y,
    QUADS,
    ROW,
    prefetch_row,
    take_rows,
)
from .spline_weights import INDEX_MASK, weights


class Batch(NamedTuple):
    """Arrays of a batch of columns (see `column_rows.BATCH`)."""

    rows: np.ndarray  # float64[columns, ROW]; all columns, to prefetch those of the next batch
    scratch: np.ndarray  # float64[LINES]; columns before the step, and what is computed of them
    moved: np.ndarray  # float64[LINES]; columns after the step
    quads: np.ndarray  # float64[QUADS]; groups of four numbers of each column
    place: np.ndarray  # int64[BATCH]; where the nodes of each column begin in a flat array
    stays: np.ndarray  # int64[BATCH]; 0 for columns that leave


class FlatGrid(NamedTuple):
    """What columns read from the grid."""

    nodes: np.ndarray  # float64[ny + 3, nx + 3, 4]; read by flat index
    flat_bed: np.ndarray  # float64[ny + 3, nx + 3] [m]; read by flat index
    bed: np.ndarray  # float64[ny + 3, nx + 3] [m]; the same
    inside: np.ndarray  # uint8[ny, nx]; 1 where there is terrain


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
def _read_nodes(scratch, quads, place, count, nodes, row_length, rows, order, first):
    """Mean, slopes and first moments of the nodes' four entries around each column; `row_length` numbers a row.

    The rows of columns to come are prefetched.
    """
    nothing = lanes(0.0, 0.0, 0.0, 0.0)
    for k in range(count):
        prefetch_row(rows, order, first + k)
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
def _read_bed(moved, quads, place, count, bed, row_length):
    """For each column its three bed rows summed over y: with the weights, and with their slopes.

    The fourth sum of a column is no use; the first one of the next column takes its place.
    """
    nothing = lanes(0.0, 0.0, 0.0, 0.0)
    for k in range(count):
        t = place[k]
        value = slope = nothing
        for j in range(3):
            line = load(bed, t)
            t += row_length
            value = multiply_add(get(moved, L_WY0 + j * BATCH, k), line, value)
            slope = multiply_add(get(moved, L_GY0 + j * BATCH, k), line, slope)
        store(quads, Q_BED + 3 * k, value)
        store(quads, Q_BED_SLOPE + 3 * k, slope)


@jit
def _give_rows(rows: np.ndarray, order: np.ndarray, first: int, count: int, moved: np.ndarray):
    """Copy the lines of `moved` into the rows of columns order[first : first + count]."""
    for k in range(0, count, 4):
        for e in range(0, ROW, 4):
            line = e * BATCH + k
            quads = transposed(
                load(moved, line),
                load(moved, line + BATCH),
                load(moved, line + 2 * BATCH),
                load(moved, line + 3 * BATCH),
            )
            store(rows, (order[first + k] & INDEX_MASK) * ROW + e, quads[0])
            if k + 1 < count:
                store(rows, (order[first + k + 1] & INDEX_MASK) * ROW + e, quads[1])
            if k + 2 < count:
                store(rows, (order[first + k + 2] & INDEX_MASK) * ROW + e, quads[2])
            if k + 3 < count:
                store(rows, (order[first + k + 3] & INDEX_MASK) * ROW + e, quads[3])


@jit
def _give_keys(keys, order, first, count, moved, place, stays, inverse_dx, part):
    """Blocks of the next step, and the window of blocks with columns."""
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
            part[BLOCK_WEST], part[BLOCK_EAST] = min(part[BLOCK_WEST], column), max(part[BLOCK_EAST], column)
            part[BLOCK_SOUTH], part[BLOCK_NORTH] = min(part[BLOCK_SOUTH], line), max(part[BLOCK_NORTH], line)


@jit_parallel
def grid_to_particles(
    rows: np.ndarray,
    keys: np.ndarray,
    sorted_columns: SortedColumns,
    nodes: np.ndarray,
    fields: NodeFields,
    report: np.ndarray,
    times: StepTimes,
    bound: SpeedBound,
    settings: Settings,
    metric: int,
    curvature: int,
    entrainment: Entrainment,
) -> None:
    """Read the new velocity field back, move the columns, stretch their areas, turn velocities with the bed.

    APIC: u_p = sum N_i v_i, C_p = 4/dx^2 sum N_i v_i (x_i - x_p)^T; A_p *= det(I + dt grad u_p). With `settings.clamp`
    a column stays below `clamp` times the grid's thickness where the flow spreads, and above 1/clamp of it where it
    converges. No column is faster than its drop in height allows. Velocities are those of `times.ahead` [s] before the
    end of the step (leapfrog). Columns that leave through an open edge or onto nodata (looked for only if the terrain
    has `settings.holes`) go to the ledger and get the key GONE.

    Parameters
    ----------
    rows : float64[columns, ROW]
    keys : int32[columns]
        Block of each column; GONE for one that has left.
    sorted_columns : SortedColumns
    nodes : float64[ny + 3, nx + 3, 4]
    fields : NodeFields
    report : float64[CHUNKS, REPORT]
    times : StepTimes
    bound : SpeedBound
    settings : Settings
    metric, curvature, entrainment
        Slots of these names (`ColumnEffects`).
    """
    order, start, bounds = sorted_columns.order, sorted_columns.start, sorted_columns.bounds
    grid = FlatGrid(nodes, fields.bed, fields.bed, fields.inside)
    for c in prange(CHUNKS):
        part = report[c]
        clear_report(part, part)
        laws = MotionLaws(metric, curvature, entrainment)
        scratch, moved, quads = np.empty(LINES), np.empty(LINES), np.empty(QUADS)
        batch = Batch(rows, scratch, moved, quads, np.empty(BATCH, np.int64), np.empty(BATCH, np.int64))
        end = start[bounds[c + 1]]
        first = start[bounds[c]]
        while first < end:
            count = min(BATCH, end - first)
            take_rows(rows, order, first, count, scratch, False)
            move_batch(keys, order, first, count, batch, grid, part, part, times, bound, settings, laws)
            _give_rows(rows, order, first, count, moved)
            first += count
        finish_report(part)


@jit_inline
def clear_report(part: np.ndarray, outflow: np.ndarray) -> None:
    """Begin the report of a chunk; the transfer before has written its entry STIFF.

    Parameters
    ----------
    part : float64[REPORT]
    outflow : float64[REPORT]
        Has the ledger of the outflow; the CPU has both in one array.
    """
    for entry in range(OUT):
        if entry != STIFF:
            part[entry] = 0.0
    for entry in range(OUT, REPORT):
        outflow[entry] = 0.0
    part[BLOCK_WEST] = part[BLOCK_SOUTH] = 1 << 16
    part[BLOCK_EAST] = part[BLOCK_NORTH] = -1


@jit_inline
def finish_report(part: np.ndarray) -> None:
    """Take the roots of the squares in the report of a chunk; where a column is not finite, its place is reported.

    Parameters
    ----------
    part : float64[REPORT]
    """
    part[SIGNAL_MAX], part[SPEED_MAX] = sqrt(part[SIGNAL_MAX]), sqrt(part[SPEED_MAX])
    part[KINETIC] *= 0.5
    if part[NOT_FINITE] > 0.0:
        part[BOUND_RATIO] = 0.0


@jit_inline
def move_batch(
    keys: np.ndarray,
    order: np.ndarray,
    first: int,
    count: int,
    batch: Batch,
    grid: FlatGrid,
    part: np.ndarray,
    outflow: np.ndarray,
    times: StepTimes,
    bound: SpeedBound,
    settings: Settings,
    laws: MotionLaws,
) -> None:
    """Move the `count` columns from place `first` of the order (see `grid_to_particles`).

    Parameters
    ----------
    keys : int32[columns]
        Block of each column; GONE for one that has left.
    order : int32[columns]
        Indices of columns in the order of blocks.
    first : int
        Place of the first of them in the order.
    count : int
        Number of columns.
    batch : Batch
        The rows of the columns are in its `scratch`.
    grid : FlatGrid
    part : float64[REPORT]
        As for `clear_report`.
    outflow : float64[REPORT]
    times : StepTimes
    bound : SpeedBound
    settings : Settings
    laws : MotionLaws
    """
    scratch, moved, quads, place, stays = batch.scratch, batch.moved, batch.quads, batch.place, batch.stays
    dx, gravity, clamp, entrainment = settings.dx, settings.gravity, settings.clamp, laws.entrainment
    inverse_dx = 1.0 / dx
    (ny, nx), row_length = grid.inside.shape, grid.bed.shape[1]
    _weigh(scratch, place, count, row_length, inverse_dx)
    _read_nodes(scratch, quads, place, count, grid.nodes, 4 * row_length, batch.rows, order, first)
    factors, thin = move(scratch, moved, quads, count, dx, times.dt, entrainment)
    part[HELD_STRETCH] += factors
    part[HELD_THIN] += thin
    if clamp > 0.0:
        part[CLAMPED] += clamp_areas(moved, quads, count, dx, clamp)
    if settings.wall:
        part[HELD_WALL] += keep_in(moved, count, dx, nx * dx, ny * dx)
    if not all_stay(moved, stays, count, nx * dx, ny * dx) or settings.holes:
        driven = 1.0 - times.ahead / times.dt
        book_out(scratch, moved, stays, count, grid.bed, grid.inside, part, outflow, driven, settings, laws.metric)
    _weigh_bed(moved, place, count, row_length, inverse_dx)
    _read_bed(moved, quads, place, count, grid.flat_bed, row_length)
    turn(scratch, moved, quads, count, times, bound, settings, laws)
    survey(moved, stays, count, part, dx, gravity, entrainment)
    _give_keys(keys, order, first, count, moved, place, stays, inverse_dx, part)
