"""Add up the reports of all threads in a fixed order, and update the clock of the run on the device."""

import numpy as np
from numba import cuda, float64, int64

from ..points import point_report as entry
from ..points.affine_limit import STILL, THIN
from ..points.point_blocks import key_column, key_level, key_row
from ..points.point_nodes import FASTEST2
from ..points.point_rows import BLOCK, GHOSTS, Settings, X, Y, Z
from ..points.point_time_step import (
    BAD,
    FASTEST_TIME,
    FASTEST_X,
    FASTEST_Y,
    FASTEST_Z,
    IMPULSE_GRAVITY,
    LEAKED,
    MASS_NOW,
    NOT_FINITE_STATE,
    SPEED_WORST,
    STEP_NOW,
    TIME,
    TOTAL_MASS,
    WINDOW_FIRST,
    collect,
    collect_nodes,
    set_next_step,
)
from ..points.point_time_step import STEP as STEPS
from .device_functions import in_double, real
from .device_point_steps import DENSE, GRADIENT, PUSH, SHIFT, STAY_POINT, STEP, STILL2, TURN2
from .device_point_steps import STAY2_OF_ALL as STAY2
from .launch import AFTER, DT, END, STATUS, UNTIL


@in_double
def sum_node_reports(run: np.ndarray, reports: np.ndarray, sums: np.ndarray) -> None:
    """Add up the node reports of a group of threads; one thread block per row of `sums`, one thread per entry.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    reports : float64[threads, NODE_REPORT]
    sums : float64[groups, NODE_REPORT]
        Set by this kernel.
    """
    if run[STATUS] != 0:
        return
    c, k, n, count = cuda.blockIdx.x, cuda.threadIdx.x, reports.shape[0], sums.shape[0]
    total = float64(0.0)
    for r in range(c * n // count, (c + 1) * n // count):
        total = max(total, reports[r, k]) if k == FASTEST2 else total + reports[r, k]
    sums[c, k] = total


@in_double
def sum_point_reports(run: np.ndarray, reports: np.ndarray, sums: np.ndarray) -> None:
    """Reduce the point reports of a group of threads: sums, largest and smallest values, and the point that is fastest.

    One thread block per row of `sums`, one thread per entry, as in `sum_node_reports`.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    reports : float64[threads, entries]
    sums : float64[groups, entries]
        Set by this kernel.
    """
    if run[STATUS] != 0:
        return
    c, k, n, count = cuda.blockIdx.x, cuda.threadIdx.x, reports.shape[0], sums.shape[0]
    first = c * n // count
    if first >= (c + 1) * n // count:
        return
    total, most = reports[first, k], reports[first, STAY2]
    for r in range(first + 1, (c + 1) * n // count):
        value = reports[r, k]
        if k == entry.BAD_X or k == entry.BAD_Y:
            if reports[r, entry.NOT_FINITE] > 0.0:
                total = value
        elif k == STAY_POINT:
            if reports[r, STAY2] > most:
                total, most = value, reports[r, STAY2]
        elif k == entry.BLOCK_WEST or k == entry.BLOCK_SOUTH:
            total = min(total, value)
        elif (
            k == entry.SHEAR_MAX
            or k == entry.SPEED2_MAX
            or k == STAY2
            or k == entry.BLOCK_EAST
            or k == entry.BLOCK_NORTH
            or k == entry.BLOCK_TALL
        ):
            total = max(total, value)
        else:
            total += value
    sums[c, k] = total


@in_double
def choose_step(
    run: np.ndarray,
    stage: np.ndarray,
    clock: np.ndarray,
    counts: np.ndarray,
    report: np.ndarray,
    scales: np.ndarray,
    settings: Settings,
) -> None:
    """Update the clock after the nodes moved, choose the next step and set the factors of this one; one thread.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    stage : float64[STAGE_ENTRIES]
    clock : float64[CLOCK]
    counts : int64[COUNTS]
    report : float64[1, NODE_REPORT]
    scales : float[entries]
        Factors of the step, in the precision of the points; set by this kernel.
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    collect_nodes(report, clock)
    clock[IMPULSE_GRAVITY] += stage[DT] * settings.gravity * clock[MASS_NOW]
    set_next_step(clock, counts, stage[END], stage[UNTIL], stage[AFTER], settings)
    dt, next_dt, dx = stage[DT], clock[STEP_NOW], settings.dx
    turn, still = real(4.0 / dx), float64(STILL) * settings.signal_speed
    scales[SHIFT], scales[GRADIENT], scales[TURN2] = real(dt / dx), real(4.0 / dx) * real(dt), turn * turn
    scales[PUSH], scales[STEP] = real(next_dt * 4.0 / (dx * settings.density)), real(dt)
    scales[DENSE], scales[STILL2] = real(float64(THIN) * settings.density * dx * dx * dx), real(still * still)


@in_double
def finish_step(
    run: np.ndarray,
    stage: np.ndarray,
    clock: np.ndarray,
    counts: np.ndarray,
    ledger: np.ndarray,
    report: np.ndarray,
    rows: np.ndarray,
    keys: np.ndarray,
    lowest: np.ndarray,
    settings: Settings,
) -> None:
    """Update clock, counts and ledger after the points moved, and note reasons to stop; one thread.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    stage : float64[STAGE_ENTRIES]
    clock : float64[CLOCK]
    counts : int64[COUNTS]
    ledger : float64[EDGES, OUT_ENTRIES]
    report : float64[1, entries]
    rows : float[n, ROW_SHORT or ROW_LONG]
    keys : int64[n]
    lowest : int32[block rows, block columns, 2]
        The result of `point_blocks.lowest_blocks`.
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    counts[STEPS] += 1
    clock[TIME] = stage[END]
    dx = settings.dx
    if report[0, entry.SPEED2_MAX] > clock[SPEED_WORST] * clock[SPEED_WORST] and report[0, STAY2] >= 0.0:
        p = int64(report[0, STAY_POINT])
        row, column = key_row(keys[p]), key_column(keys[p])
        level = key_level(keys[p]) + lowest[row, column, 0]
        clock[FASTEST_X] = (float(rows[p, X]) + (BLOCK * column - GHOSTS)) * dx
        clock[FASTEST_Y] = (float(rows[p, Y]) + (BLOCK * row - GHOSTS)) * dx
        clock[FASTEST_Z] = (float(rows[p, Z]) + (BLOCK * level - GHOSTS)) * dx
        clock[FASTEST_TIME] = clock[TIME]
    taken_up = collect(report, ledger, clock, counts, counts[WINDOW_FIRST:])
    if counts[BAD] > 0:
        run[STATUS] = NOT_FINITE_STATE
    elif taken_up > settings.leak_stop * clock[TOTAL_MASS]:
        run[STATUS] = LEAKED
