"""Types of the arguments of every kernel of the depth-averaged solver on a device, to compile them without one."""

import numba
import numpy as np
from numba import types

from mpmgis.laws.effect_slots import ColumnEffects
from mpmgis.solvers.columns.column_motion import MotionLaws
from mpmgis.solvers.columns.column_nodes import NodeLaws
from mpmgis.solvers.columns.column_records import NodeFields, Settings
from mpmgis.solvers.columns.columns_to_grid import StressLaws
from mpmgis.solvers.columns.grid_to_columns import FlatGrid
from mpmgis.solvers.gpu import (
    device_column_detrainment,
    device_column_nodes,
    device_column_reports,
    device_column_sort,
    device_column_transfer,
)
from mpmgis.solvers.gpu.device_column_reports import RunSums

SETTINGS = Settings(
    dx=1.0,
    density=1000.0,
    gravity=9.81,
    cfl=0.3,
    fixed_dt=0.0,
    move_limit=0.5,
    fall_limit=1.0,
    clamp=0.0,
    thickness_floor=1e-3,
    wet_thickness=0.01,
    arrival_thickness=0.05,
    wild_stop=0.05,
    wall=True,
    holes=True,
    stop_at_rest=True,
    keep_peaks=True,
)
EFFECTS = ColumnEffects()  # numbers of the same types, whatever the laws
FIELDS = NodeFields(
    *(np.zeros((1,) * dimensions) for dimensions in (2, 3)),
    np.zeros((1, 1), np.uint8),
    *(np.zeros((1,) * dimensions) for dimensions in (3, 2, 2, 3, 2, 3, 3, 2, 1, 1)),
)

LINE = np.zeros(1)
GRID = FlatGrid(LINE, LINE, FIELDS.bed, FIELDS.inside)
RUN_SUMS = RunSums(LINE, np.zeros(1, np.int64), FIELDS.bed, LINE)


def chosen(record):
    """Type of the `record` of some of the effects."""
    return numba.typeof(record(*(getattr(EFFECTS, name) for name in record._fields)))


def array(kind, dimensions):
    """Type of a contiguous array."""
    return types.Array(kind, dimensions, "C")


def signatures():
    """(name, kernel, types of its arguments) of all kernels."""
    i4, i8, f8, byte, flag = types.int32, types.int64, types.float64, types.uint8, types.boolean
    run, stage, clock, counts, sums = array(i8, 1), array(f8, 1), array(f8, 1), array(i8, 1), array(f8, 1)
    rows, keys, order, start = array(f8, 2), array(i4, 1), array(i4, 1), array(i8, 1)
    window, pieces, nodes, tiles = array(i4, 1), array(i8, 2), array(f8, 3), array(f8, 2)
    reports, held, bed, peaks, wet = array(f8, 2), array(f8, 3), array(f8, 2), array(f8, 3), array(byte, 2)
    settings, fields, grid, run_sums = (numba.typeof(record) for record in (SETTINGS, FIELDS, GRID, RUN_SUMS))
    for name, *arguments in (
        ("begin_step", run, stage, clock, counts),
        ("begin_again", run, run, counts),
        ("end_again", run, run),
        ("clear_window", run, window, window),
        ("count_columns", run, counts, rows, keys, window, array(byte, 1), settings),
        ("scatter_columns", run, counts, keys, window, order),
        ("fill_slots", run, window, window),
        ("mark_touched", run, window, window),
        ("rank_touched", run, window, pieces, window),
        ("choose_step", run, stage, clock, counts, settings),
    ):
        yield name, getattr(device_column_sort, name), arguments
    yield "gather_nodes", device_column_transfer.gather_nodes, (run, tiles, window, window, nodes)
    leaving = run, stage, clock, rows, window, wet, array(i8, 4)
    yield "book_left", device_column_transfer.book_left, (*leaving, settings)
    yield "note_left", device_column_transfer.note_left, (*leaving, array(f8, 4), settings)
    for name, *arguments in (
        ("clear_ghosts", run, nodes),
        ("fold_walls", run, nodes, flag),
        ("mirror_walls", run, nodes, flag),
        ("sum_held", run, rows, start, held),
        ("collect_held", run, stage, held, rows, sums),
        ("regrade", run, window, bed, nodes, settings),
    ):
        yield name, getattr(device_column_nodes, name), arguments
    for name in ("sum_node_reports", "sum_column_reports", "sum_plain_reports"):
        yield name, getattr(device_column_reports, name), (run, reports, reports)
    yield "end_step", device_column_reports.end_step, (run, clock, counts, settings)
    for name, *arguments in (
        ("find_losses", run, rows, order, fields, rows, settings),
        ("losses_to_grid", run, rows, order, start, window, rows, tiles, fields, settings),
        ("add_losses", run, tiles, window, window, fields, settings),
        ("collect_losses", run, run, clock, counts, sums, reports),
        ("clear_shares", run, window, bed),
    ):
        yield name, getattr(device_column_detrainment, name), arguments
    law = EFFECTS._replace(**{name: numba.typeof(value) for name, value in EFFECTS._asdict().items()})
    stress, motion, moving = (chosen(laws) for laws in (StressLaws, MotionLaws, NodeLaws))
    for module, name, *arguments in (
        (
            device_column_transfer,
            "columns_to_grid",
            run,
            stage,
            rows,
            order,
            start,
            window,
            tiles,
            fields,
            settings,
            stress,
        ),
        (
            device_column_transfer,
            "grid_to_columns",
            run,
            stage,
            clock,
            rows,
            keys,
            order,
            grid,
            window,
            reports,
            settings,
            motion,
            f8,
        ),
        (
            device_column_nodes,
            "hold_at_barriers",
            run,
            stage,
            nodes,
            window,
            fields,
            array(i4, 2),
            rows,
            settings,
            law.metric,
        ),
        (device_column_nodes, "update_nodes", run, stage, nodes, window, fields, wet, bed, reports, settings, moving),
        (device_column_nodes, "lower_bed", run, window, bed, bed, f8),
        (
            device_column_nodes,
            "note_peaks",
            run,
            stage,
            clock,
            nodes,
            window,
            nodes,
            peaks,
            settings,
            law.metric,
            law.entrainment,
        ),
        (
            device_column_reports,
            "collect_reports",
            run,
            stage,
            run_sums,
            reports,
            reports,
            rows,
            order,
            window,
            sums,
            settings,
            law.barrier,
            law.forest,
        ),
        (
            device_column_detrainment,
            "take_losses",
            run,
            clock,
            rows,
            keys,
            order,
            fields,
            rows,
            reports,
            settings,
            law.metric,
        ),
    ):
        yield name, getattr(module, name), arguments
