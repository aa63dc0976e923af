"""Reports of all threads over columns and nodes, summed in a fixed order, and the clock of the run on the device."""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numba import cuda

from ..columns import column_report as entry
from ..columns.column_forest import BROKEN_CELLS, RESISTED
from ..columns.column_nodes import DEEPEST, FOREST_LOSS
from ..columns.column_records import Settings
from ..columns.column_rows import X, Y
from ..columns.column_time_step import (
    ALIVE,
    ALL_LEFT,
    BAD,
    BARRIER_TOTAL,
    DEEPEST_TIME,
    DEEPEST_X,
    DEEPEST_Y,
    DEPTH_WORST,
    FASTEST,
    FASTEST_TIME,
    FASTEST_X,
    FASTEST_Y,
    NOT_FINITE_STATE,
    RUNNING,
    STEP,
    TIME,
    TOO_FAST,
    TRIGGER_REACHED,
    WILD_NOW,
    collect,
    stop_rule,
)
from .device_column_nodes import BROKEN_NOW, DEEPEST_AT
from .device_column_sort import END, FIRED, STIFF, node_at
from .device_column_transfer import FASTEST_AT
from .device_functions import Kernel, Part
from .launch import STATUS


class RunSums(NamedTuple):
    """Clock, counts and sums of a run, on the device."""

    clock: np.ndarray  # float64[CLOCK]
    counts: np.ndarray  # int64[COUNTS]
    ledger: np.ndarray  # float64[EDGES, OUT_ENTRIES]
    forest_sums: np.ndarray  # float64[FOREST_SUMS]


@Part
def place_of_most(reports: np.ndarray, first: int, end: int, value: int, place: int) -> float:
    """Return the place of the row with the largest value, of several the smallest; -1 where no row has one.

    Parameters
    ----------
    reports : float64[rows, entries]
    first : int
        First of the rows.
    end : int
    value : int
        Entry with the value.
    place : int
        Entry with the place.
    """
    most, at = -1.0, -1.0
    for r in range(first, end):
        here = reports[r, place]
        if here >= 0.0 and (reports[r, value] > most or (reports[r, value] == most and here < at)):
            most, at = reports[r, value], here
    return at


@Part
def worst_of(reports: np.ndarray, first: int, end: int, k: int) -> float:
    """Return entry `k` of the first row with a column that is not finite, else of the row with the largest BOUND_RATIO.

    Parameters
    ----------
    reports : float64[rows, COLUMN_REPORT]
    first : int
        First of the rows.
    end, k : int
    """
    worst = first
    for r in range(first, end):
        if reports[r, entry.NOT_FINITE] > 0.0:
            return reports[r, k]
        if reports[r, entry.BOUND_RATIO] > reports[worst, entry.BOUND_RATIO]:
            worst = r
    return reports[worst, k]


@Kernel
def sum_node_reports(run: np.ndarray, reports: np.ndarray, sums: np.ndarray) -> None:
    """Sum the node reports of groups of threads; one thread block per row of `sums`, one thread per entry.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    reports : float64[many, THREAD_REPORT]
    sums : float64[few, THREAD_REPORT]
    """
    if run[STATUS] != 0:
        return
    c, k, n, count = cuda.blockIdx.x, cuda.threadIdx.x, reports.shape[0], sums.shape[0]
    first, end = c * n // count, (c + 1) * n // count
    if k == DEEPEST_AT:
        sums[c, k] = place_of_most(reports, first, end, DEEPEST, DEEPEST_AT)
        return
    total = 0.0
    for r in range(first, end):
        total = max(total, reports[r, k]) if k == DEEPEST else total + reports[r, k]
    sums[c, k] = total


@Kernel
def sum_column_reports(run: np.ndarray, reports: np.ndarray, sums: np.ndarray) -> None:
    """Sum the column reports of groups of threads; threads as in `sum_node_reports`.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    reports : float64[many, COLUMN_REPORT]
    sums : float64[few, COLUMN_REPORT]
    """
    if run[STATUS] != 0:
        return
    c, k, n, count = cuda.blockIdx.x, cuda.threadIdx.x, reports.shape[0], sums.shape[0]
    first, end = c * n // count, (c + 1) * n // count
    if k == FASTEST_AT:
        sums[c, k] = place_of_most(reports, first, end, entry.FASTEST2, FASTEST_AT)
        return
    if k == entry.BOUND_RATIO or k == entry.BOUND_X or k == entry.BOUND_Y:
        sums[c, k] = worst_of(reports, first, end, k)
        return
    total = reports[first, k]
    for r in range(first + 1, end):
        value = reports[r, k]
        if k == entry.BLOCK_WEST or k == entry.BLOCK_SOUTH:
            total = min(total, value)
        elif (
            k == entry.SIGNAL_MAX
            or k == entry.SPEED_MAX
            or k == entry.FASTEST2
            or k == entry.BLOCK_EAST
            or k == entry.BLOCK_NORTH
        ):
            total = max(total, value)
        else:
            total += value
    sums[c, k] = total


@Kernel
def sum_plain_reports(run: np.ndarray, reports: np.ndarray, sums: np.ndarray) -> None:
    """Sum reports that have sums only, of groups of threads; threads as in `sum_node_reports`.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    reports : float64[many, entries]
    sums : float64[few, entries]
    """
    if run[STATUS] != 0:
        return
    c, k, n, count = cuda.blockIdx.x, cuda.threadIdx.x, reports.shape[0], sums.shape[0]
    total = 0.0
    for r in range(c * n // count, (c + 1) * n // count):
        total += reports[r, k]
    sums[c, k] = total


@Kernel
def collect_reports(
    run: np.ndarray,
    stage: np.ndarray,
    sums: RunSums,
    report: np.ndarray,
    node_report: np.ndarray,
    rows: np.ndarray,
    order: np.ndarray,
    touched: np.ndarray,
    lost: np.ndarray,
    settings: Settings,
    barrier: bool,
    forest: bool,
) -> None:
    """Update clock, counts and ledger after the columns moved; one thread.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    stage : float64[STAGE_ENTRIES]
        Times of the step.
    sums : RunSums
    report : float64[1, COLUMN_REPORT]
    node_report : float64[1, THREAD_REPORT]
    rows : float64[columns, ROW]
    order : int32[columns]
        Indices of columns in the order of blocks.
    touched : int32[touched blocks]
        Their places in the window.
    lost : float64[barriers] [J]
        Energy that each barrier took in this step.
    settings : Settings
    barrier, forest : bool
        Slots of these names (`ColumnEffects`).
    """
    if run[STATUS] != 0:
        return
    clock, counts, forest_sums = sums.clock, sums.counts, sums.forest_sums
    counts[STEP] += 1
    clock[TIME] = stage[END]
    report[0, entry.STIFF] = run[STIFF]
    note_deepest(run, clock, node_report, touched, settings.dx)
    note_fastest(clock, report, rows, order)
    if forest:
        forest_sums[RESISTED] += node_report[0, FOREST_LOSS]
        forest_sums[BROKEN_CELLS] += node_report[0, BROKEN_NOW]
    _, fired = collect(report, node_report, sums.ledger, clock, counts)
    if barrier:
        for b in range(lost.shape[0]):
            clock[BARRIER_TOTAL] += lost[b]
    if counts[BAD] > 0:
        run[STATUS] = NOT_FINITE_STATE
    run[FIRED] = 1 if fired else 0


@Part
def note_deepest(run: np.ndarray, clock: np.ndarray, node_report: np.ndarray, touched: np.ndarray, dx: float) -> None:
    """Record place and time of a new largest thickness at a node.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    clock : float64[CLOCK]
    node_report : float64[1, THREAD_REPORT]
    touched : int32[touched blocks]
        Their places in the window.
    dx : float [m]
    """
    if node_report[0, DEEPEST] > clock[DEPTH_WORST]:
        j, i = node_at(run, touched, int(node_report[0, DEEPEST_AT]))
        clock[DEEPEST_X], clock[DEEPEST_Y], clock[DEEPEST_TIME] = (i - 1) * dx, (j - 1) * dx, clock[TIME]


@Part
def note_fastest(clock: np.ndarray, report: np.ndarray, rows: np.ndarray, order: np.ndarray) -> None:
    """Record a new largest speed, its place and time.

    Parameters
    ----------
    clock : float64[CLOCK]
    report : float64[1, COLUMN_REPORT]
    rows : float64[columns, ROW]
    order : int32[columns]
        Indices of columns in the order of blocks.
    """
    most = report[0, entry.FASTEST2]
    if most > clock[FASTEST] ** 2:
        p = order[int(report[0, FASTEST_AT])]
        clock[FASTEST_X], clock[FASTEST_Y] = rows[p, X], rows[p, Y]
        clock[FASTEST], clock[FASTEST_TIME] = sqrt(most), clock[TIME]


@Kernel
def end_step(run: np.ndarray, clock: np.ndarray, counts: np.ndarray, settings: Settings) -> None:
    """Find reasons to stop after a step; one thread.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    clock : float64[CLOCK]
    counts : int64[COUNTS]
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    if clock[WILD_NOW] > settings.wild_stop:
        run[STATUS] = TOO_FAST
    elif counts[ALIVE] == 0:
        run[STATUS] = ALL_LEFT
    elif run[FIRED] != 0:
        run[STATUS] = TRIGGER_REACHED
    elif settings.stop_at_rest:
        reason = stop_rule(clock, counts)
        if reason != RUNNING:
            run[STATUS] = reason
