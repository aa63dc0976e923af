"""Time loop of the depth-averaged MPM on a CUDA device; what `column_loop.advance` is on the CPU.

Interface (used by the solver):

    device = DeviceColumns(state, settings, fields, effects)  # copies everything to the device
    reason = device.advance(until, max_steps)  # as `column_loop.advance`; rows stay on the device
    device.download()  # all of `state` and `fields` on the host is current again

`state` and `fields` hold the solver's own host arrays: `advance` keeps `clock` and `counts` current in them, `download`
all others. After any change of the host arrays (insertion, restart, other laws) make a new DeviceColumns.
Everything is in double precision. The same launch gives the same bits, whatever the order of threads and however often
a run is stopped and resumed: no sum depends on the order of threads.

Arrays whose size depends on the flow grow when a step does not fit: nothing of the step is done before that is known.
"""

import numpy as np
from numba import cuda

from ...compiled.block_order import CHUNKS
from ...frames.state_arrays import array_table
from ...laws.effect_slots import ColumnEffects
from ...laws.internal_stress import largest_factor
from ..columns import column_time_step as entry
from ..columns.column_arrays import ColumnArrays, changing_fields
from ..columns.column_motion import MotionLaws
from ..columns.column_nodes import NodeLaws
from ..columns.column_records import NodeFields, Settings
from ..columns.column_report import BLOCK_EAST, BLOCK_NORTH, BLOCK_SOUTH, BLOCK_WEST
from ..columns.columns_to_grid import StressLaws
from ..columns.grid_to_columns import FlatGrid
from . import (
    device_column_detrainment,
    device_column_nodes,
    device_column_reports,
    device_column_sort,
    device_column_transfer,
    device_point_sort,
)
from .device_column_reports import RunSums
from .device_column_sort import NEEDS_ROOM_LATE, UNTIL
from .device_functions import SIMULATED
from .device_run import DeviceRun, Launches
from .launch import ACTIVE, ROOM_ACTIVE, ROOM_PLACES, ROOM_TOUCHED, SIZE, STATUS, TOUCHED, Launch

ROOMS = ((ROOM_PLACES, SIZE, 256), (ROOM_ACTIVE, ACTIVE, 64), (ROOM_TOUCHED, TOUCHED, 128))  # and the least room
CHANGED = [name for name, array in array_table(ColumnArrays).items() if array.on_device]  # arrays that steps change
OWNERS = 128  # threads of a block that sums columns to the nodes of a tile


class Sorted:
    """Columns in the order of blocks, and the blocks of nodes that they touch.

    Parameters
    ----------
    launches : Launches
    columns : int
        Number of columns.
    tile_numbers : int
        Numbers of a node in the tile of a block.
    """

    def __init__(self, launches: Launches, columns: int, tile_numbers: int) -> None:
        self._launches, self._tile_numbers = launches, tile_numbers
        self.host = np.zeros(device_column_sort.RUN_ENTRIES, np.int64)
        self.run = cuda.to_device(self.host)
        self.order, self._loose, self._mixed = (cuda.device_array(columns, np.int32) for _ in range(3))
        self._cells = cuda.device_array(columns, np.uint8)
        self.grow()

    def grow(self) -> None:
        """Make arrays in which the present step fits, with half as much in addition."""
        self.run.copy_to_host(self.host)
        run, old = self.host, self.host.copy()
        for room, needed, least in ROOMS:
            if run[needed] > run[room] or not old[room]:
                run[room] = max(int(run[needed]) * 3 // 2, least)
        if run[ROOM_PLACES] != old[ROOM_PLACES]:
            size = int(run[ROOM_PLACES])
            self._histogram, self._flags, self.slot = (cuda.device_array(size, np.int32) for _ in range(3))
        if run[ROOM_ACTIVE] != old[ROOM_ACTIVE]:
            size = int(run[ROOM_ACTIVE])
            self.block, self.start = cuda.device_array(size, np.int32), cuda.device_array(size + 1, np.int64)
            self.tiles = cuda.device_array((size, device_column_transfer.TILE_NODES * self._tile_numbers), np.float64)
        if run[ROOM_TOUCHED] != old[ROOM_TOUCHED]:
            self.touched = cuda.device_array(int(run[ROOM_TOUCHED]), np.int32)
        run[STATUS] = 0
        self.run.copy_to_device(run)

    def sort(self, counts: np.ndarray, rows: np.ndarray, keys: np.ndarray, settings: Settings) -> None:
        """Sort columns by their blocks and cells; the window of blocks is known.

        Parameters
        ----------
        counts : int64[COUNTS]
        rows : float64[columns, ROW]
        keys : int32[columns]
            Block of each column; GONE for one that has left.
        settings : Settings
        """
        run, launches = self.run, self._launches
        launches.all(device_column_sort.clear_window, run, self._histogram, self.slot)
        launches.all(device_column_sort.count_columns, run, counts, rows, keys, self._histogram, self._cells, settings)
        launches.scan(run, self._histogram, True)
        launches.pieces(device_point_sort.rank_places, run, self._histogram, self.block, self.start)
        launches.all(device_column_sort.scatter_columns, run, counts, keys, self._histogram, self._loose)
        launches.all(device_point_sort.rank_points, run, self.start, self._loose, self._cells, self._mixed, self.order)
        launches.all(device_column_sort.fill_slots, run, self.block, self.slot)
        launches.all(device_column_sort.mark_touched, run, self.slot, self._flags)
        launches.scan(run, self._flags, False)
        launches.pieces(device_column_sort.rank_touched, run, self._flags, self.touched)


class DeviceColumns(DeviceRun):
    """The columns of a run on the device.

    Parameters
    ----------
    state : ColumnArrays
    settings : Settings
        Kept as `settings`, which can be replaced between two calls of `advance`.
    fields : NodeFields
    effects : ColumnEffects
    launch : Launch, optional
        Sizes of launches; by default those for a GPU, in the simulator small ones.
    """

    def __init__(
        self,
        state: ColumnArrays,
        settings: Settings,
        fields: NodeFields,
        effects: ColumnEffects,
        launch: Launch | None = None,
    ) -> None:
        super().__init__(state, entry, np.float64, launch, device_column_sort.STAGE_ENTRIES)
        self.fields, self._effects = fields, effects
        self.settings = self._settings_of_steps = settings
        self._upload()
        self._make_reports()
        self._now = Sorted(self._launches, len(state.rows), 4)
        self._again = Sorted(self._launches, len(state.rows), 1) if effects.forest else None

    def _upload(self):
        """Copy state and fields to the device."""
        state, fields, effects = self.state, self.fields, self._effects
        for name in CHANGED:
            setattr(self, f"_{name}", cuda.to_device(_some(getattr(state, name))))
        shape, n = fields.bed.shape, len(state.rows)
        self._flat_bed = cuda.to_device(np.append(fields.bed.ravel(), np.zeros(4)))  # three nodes are read as four
        self._flat_nodes = cuda.to_device(np.zeros(4 * fields.bed.size))
        self._nodes = self._flat_nodes.reshape(*shape, 4)
        arrays = {"bed": self._flat_bed[: fields.bed.size].reshape(*shape)}
        for name in fields._fields[1:]:
            arrays[name] = cuda.to_device(np.ascontiguousarray(getattr(fields, name)))
        self._fields = fields._replace(**arrays)
        self._strip = cuda.device_array((n, device_point_sort.STRIP), np.float64)
        self._names = cuda.device_array((n, 2), np.int64)
        self._left = cuda.device_array(n, np.int32)
        self._leaving = cuda.to_device(np.zeros(self._left_cells.shape, np.int64))
        lowers = effects.entrainment.lowering > 0.0
        self._lowered = cuda.to_device(np.zeros(shape if lowers else (1, 1)))
        count = state.barrier_sums.shape[0]
        places, first = device_column_nodes.barrier_nodes(fields.barriers, count)
        self._walled = effects.barrier and len(places) > 0
        self._walls, self._first_of_wall = cuda.to_device(_some(places)), cuda.to_device(first)
        self._held = cuda.to_device(np.zeros((max(len(places), 1), device_column_nodes.HELD)))
        self._held_report = cuda.to_device(np.zeros((CHUNKS, max(count, 1), device_column_nodes.HELD)))
        self._lost = cuda.to_device(np.zeros(max(count, 1)))
        if effects.forest:
            self._losses = cuda.device_array((n, device_column_detrainment.LOSSES), np.float64)

    def _make_reports(self):
        """Reports of all threads, and the arrays in which they are summed, down to one row."""
        counts = self._launches.report_counts()
        nothing = np.zeros(device_column_transfer.COLUMN_REPORT)
        nothing[[BLOCK_WEST, BLOCK_SOUTH]] = 1 << 16
        nothing[[BLOCK_EAST, BLOCK_NORTH, device_column_transfer.FASTEST_AT]] = -1.0
        self._column_sums = [cuda.to_device(np.tile(nothing, (n, 1))) for n in counts]
        self._node_sums, self._stop_sums = (
            [cuda.to_device(np.zeros((n, entries))) for n in counts]
            for entries in (device_column_nodes.THREAD_REPORT, device_column_detrainment.STOP_REPORT)
        )

    def advance(self, until: float, max_steps: int = 1 << 62) -> int:
        """Advance to a time or by a number of steps, as `column_loop.advance`.

        `clock` and `counts` of the host state are current afterwards; the other arrays after `download`.

        Parameters
        ----------
        until : float [s]
        max_steps : int

        Returns
        -------
        int
            Reason to stop (`column_time_step`).
        """
        if self.settings != self._settings_of_steps:
            self._steps.forget()
            self._settings_of_steps = self.settings
        self._stage[UNTIL] = until
        return self._take_batches(until, max_steps, self._now.host, self._now.run)

    def _after_batch(self):
        now = self._now
        while now.host[STATUS] == NEEDS_ROOM_LATE:
            self._again.grow()
            self._steps.forget()
            now.host[STATUS] = 0
            now.run.copy_to_device(now.host)
            self._finish()
            now.run.copy_to_host(now.host)

    def _grow(self):
        self._now.grow()

    def download(self) -> None:
        """Copy all that changes into the arrays of the host."""
        for name in CHANGED:
            values = getattr(self.state, name)
            if values.size:
                values[...] = getattr(self, f"_{name}").copy_to_host()
        for name in changing_fields(self._effects):
            values = getattr(self.fields, name)
            values[...] = getattr(self._fields, name).copy_to_host()

    def _step(self):
        """Launch the kernels of one step."""
        now = self._now
        self._launches.one(device_column_sort.begin_step, now.run, self._d_stage, self._clock, self._counts)
        now.sort(self._counts, self._rows, self._keys, self.settings)
        self._reorder()
        self._launches.one(
            device_column_sort.choose_step, now.run, self._d_stage, self._clock, self._counts, self.settings
        )
        self._sum_to_nodes()
        self._move_nodes()
        self._move_columns()
        self._finish()

    def _reorder(self):
        arrays = self._rows, self._ids, self._keys, self._now.order, self._strip, self._names
        self._launches.reorder(self._now.run, self._counts, *arrays)

    def _sum_to_nodes(self):
        now, sizes = self._now, self._launches.sizes
        self._launches.blocks(
            device_column_transfer.columns_to_grid,
            8 * sizes.workers,
            sizes.width if SIMULATED else OWNERS,
            now.run,
            self._d_stage,
            self._rows,
            now.order,
            now.start,
            now.block,
            now.tiles,
            self._fields,
            self.settings,
            _chosen(StressLaws, self._effects),
        )
        if self.settings.wall:
            self._launches.all(device_column_nodes.clear_ghosts, now.run, self._nodes)
        self._launches.all(device_column_transfer.gather_nodes, now.run, now.tiles, now.slot, now.touched, self._nodes)

    def _move_nodes(self):
        """Walls, barriers, friction, erosion, trees and peaks."""
        now, stage, nodes, fields = self._now, self._d_stage, self._nodes, self._fields
        settings, effects, run, touched = self.settings, self._effects, self._now.run, self._now.touched
        if settings.wall:
            for along_columns in (True, False):
                self._launches.all(device_column_nodes.fold_walls, run, nodes, along_columns)
        if self._walled:
            self._launches.all(
                device_column_nodes.hold_at_barriers,
                run,
                stage,
                nodes,
                now.slot,
                fields,
                self._walls,
                self._held,
                settings,
                effects.metric,
            )
            self._launches.all(device_column_nodes.sum_held, run, self._held, self._first_of_wall, self._held_report)
            self._launches.all(
                device_column_nodes.collect_held, run, stage, self._held_report, self._barrier_sums, self._lost
            )
        self._launches.all(
            device_column_nodes.update_nodes,
            run,
            stage,
            nodes,
            touched,
            fields,
            self._wet,
            self._lowered,
            self._node_sums[0],
            settings,
            _chosen(NodeLaws, effects),
        )
        lowering = effects.entrainment.lowering
        if lowering > 0.0:
            self._launches.all(device_column_nodes.lower_bed, run, touched, fields.bed, self._lowered, lowering)
            self._launches.all(device_column_nodes.regrade, run, touched, fields.bed, fields.gradient, settings)
        self._launches.all(
            device_column_nodes.note_peaks,
            run,
            stage,
            self._clock,
            nodes,
            touched,
            fields.gradient,
            self._peaks,
            settings,
            effects.metric,
            effects.entrainment,
        )
        if settings.wall:
            for along_columns in (False, True):
                self._launches.all(device_column_nodes.mirror_walls, run, nodes, along_columns)

    def _move_columns(self):
        now, effects, clock = self._now, self._effects, self._clock
        self._launches.all(
            device_column_transfer.grid_to_columns,
            now.run,
            self._d_stage,
            clock,
            self._rows,
            self._keys,
            now.order,
            FlatGrid(self._flat_nodes, self._flat_bed, self._fields.bed, self._fields.inside),
            self._left,
            self._column_sums[0],
            self.settings,
            _chosen(MotionLaws, effects),
            largest_factor(effects.earth_pressure),
        )
        self._launches.add_up(device_column_reports.sum_node_reports, now.run, self._node_sums)
        self._launches.add_up(device_column_reports.sum_column_reports, now.run, self._column_sums)
        self._launches.one(
            device_column_reports.collect_reports,
            now.run,
            self._d_stage,
            RunSums(clock, self._counts, self._ledger, self._fields.forest_sums),
            self._column_sums[-1],
            self._node_sums[-1],
            self._rows,
            now.order,
            now.touched,
            self._lost,
            self.settings,
            effects.barrier,
            effects.forest,
        )
        leaving = now.run, self._d_stage, clock, self._rows, self._left, self._fields.inside, self._leaving
        self._launches.all(device_column_transfer.book_left, *leaving, self.settings)
        self._launches.all(device_column_transfer.note_left, *leaving, self._left_cells, self.settings)

    def _finish(self):
        """Launch what comes after the columns moved: what trees take, and reasons to stop."""
        if self._again is not None:
            self._detrain()
        self._launches.one(device_column_reports.end_step, self._now.run, self._clock, self._counts, self.settings)

    def _detrain(self):
        now, again, fields, settings = self._now, self._again, self._fields, self.settings
        self._launches.one(device_column_sort.begin_again, now.run, again.run, self._counts)
        again.sort(self._counts, self._rows, self._keys, self.settings)
        self._launches.one(device_column_sort.end_again, now.run, again.run)
        self._launches.all(
            device_column_detrainment.find_losses, again.run, self._rows, again.order, fields, self._losses, settings
        )
        self._launches.all(
            device_column_detrainment.take_losses,
            again.run,
            self._clock,
            self._rows,
            self._keys,
            again.order,
            fields,
            self._losses,
            self._stop_sums[0],
            settings,
            self._effects.metric,
        )
        sizes = self._launches.sizes
        self._launches.blocks(
            device_column_detrainment.losses_to_grid,
            8 * sizes.workers,
            sizes.width if SIMULATED else OWNERS,
            again.run,
            self._rows,
            again.order,
            again.start,
            again.block,
            self._losses,
            again.tiles,
            fields,
            settings,
        )
        self._launches.all(
            device_column_detrainment.add_losses, again.run, again.tiles, again.slot, again.touched, fields, settings
        )
        self._launches.add_up(device_column_reports.sum_plain_reports, again.run, self._stop_sums)
        self._launches.one(
            device_column_detrainment.collect_losses,
            now.run,
            again.run,
            self._clock,
            self._counts,
            fields.forest_sums,
            self._stop_sums[-1],
        )
        self._launches.all(device_column_detrainment.clear_shares, now.run, now.touched, fields.forest_share)


def _chosen(laws, effects):
    """Return the record `laws` of those effects whose names its fields have."""
    return laws(*(getattr(effects, name) for name in laws._fields))


def _some(array):
    """`array` in order, or one row of zeros in place of none: a device has no empty arrays."""
    return np.ascontiguousarray(array) if array.size else np.zeros((1, *array.shape[1:]), array.dtype)
