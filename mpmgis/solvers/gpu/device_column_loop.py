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

from itertools import pairwise

import numpy as np
from numba import cuda

from ...compiled.block_order import CHUNKS
from ...laws.effect_slots import ColumnEffects
from ...laws.entrainment import NO_EROSION
from ...laws.internal_stress import largest_factor
from ..columns import column_time_step as entry
from ..columns.column_motion import MotionLaws
from ..columns.column_nodes import NodeLaws
from ..columns.column_records import ColumnArrays, NodeFields, Settings
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
from .device_column_reports import GROUP, RunSums
from .device_column_sort import NEEDS_ROOM_LATE, UNTIL
from .device_functions import SIMULATED
from .launch import (
    ACTIVE,
    NEEDS_ROOM,
    ROOM_ACTIVE,
    ROOM_PLACES,
    ROOM_TOUCHED,
    SIZE,
    STATUS,
    TOUCHED,
    Launch,
    checked,
    default_launch,
)
from .launch_graph import Repeated

ROOMS = ((ROOM_PLACES, SIZE, 256), (ROOM_ACTIVE, ACTIVE, 64), (ROOM_TOUCHED, TOUCHED, 128))  # and the least room
OWNERS = 128  # threads of a block that sums columns to the nodes of a tile
CHANGING_FIELDS = ("bed", "gradient", "erodible", "forest_state", "forest_sums")


class Sorted:
    """Columns in the order of blocks, and the blocks of nodes that they touch.

    Parameters
    ----------
    launch : Launch
    columns : int
        Number of columns.
    tile_numbers : int
        Numbers of a node in the tile of a block.
    """

    def __init__(self, launch: Launch, columns: int, tile_numbers: int) -> None:
        self._launch, self._tile_numbers = launch, tile_numbers
        self.host = np.zeros(device_column_sort.RUN_ENTRIES, np.int64)
        self.run = cuda.to_device(self.host)
        self.order, self._loose, self._mixed = (cuda.device_array(columns, np.int32) for _ in range(3))
        self._cells = cuda.device_array(columns, np.uint8)
        self._pieces = cuda.to_device(np.zeros((launch.scanners * launch.width, 2), np.int64))
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
        run, launch = self.run, self._launch
        _all(launch, device_column_sort.clear_window, run, self._histogram, self.slot)
        _all(launch, device_column_sort.count_columns, run, counts, rows, keys, self._histogram, self._cells, settings)
        self._scan(self._histogram, True)
        _pieces_of(launch, device_point_sort.rank_places, run, self._histogram, self._pieces, self.block, self.start)
        _all(launch, device_column_sort.scatter_columns, run, counts, keys, self._histogram, self._loose)
        _all(launch, device_point_sort.rank_points, run, self.start, self._loose, self._cells, self._mixed, self.order)
        _all(launch, device_column_sort.fill_slots, run, self.block, self.slot)
        _all(launch, device_column_sort.mark_touched, run, self.slot, self._flags)
        self._scan(self._flags, False)
        _pieces_of(launch, device_column_sort.rank_touched, run, self._flags, self._pieces, self.touched)

    def _scan(self, values, columns):
        launch = self._launch
        _pieces_of(launch, device_point_sort.sum_pieces, self.run, values, self._pieces)
        scanners = min(device_point_sort.SCANNERS, len(self._pieces))
        device_point_sort.scan_pieces.of(np.float64)[1, scanners, launch.stream](self.run, self._pieces, columns)


class DeviceColumns:
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
        self.state, self.fields, self._effects = state, fields, effects
        self.settings, self._launch = settings, checked(launch or default_launch())
        self._upload()
        self._make_reports()
        self._steps, self._settings_of_steps = Repeated(self._step), settings
        self._launch = self._launch._replace(stream=self._steps.stream)
        self._now = Sorted(self._launch, len(state.rows), 4)
        self._again = Sorted(self._launch, len(state.rows), 1) if effects.forest else None
        self._stage = np.zeros(device_column_sort.STAGE_ENTRIES)
        self._d_stage = cuda.to_device(self._stage)

    def _upload(self):
        """Copy state and fields to the device."""
        state, fields, effects = self.state, self.fields, self._effects
        for name in ColumnArrays._fields:
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
        counts = [self._launch.workers * self._launch.width]
        while counts[-1] > 1:
            counts.append((counts[-1] + GROUP - 1) // GROUP)
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
        state, first, now = self.state, int(self.state.counts[entry.STEP]), self._now
        if self.settings != self._settings_of_steps:
            self._steps.forget()
            self._settings_of_steps = self.settings
        self._clock.copy_to_device(state.clock)
        self._counts.copy_to_device(state.counts)
        self._stage[UNTIL] = until
        self._d_stage.copy_to_device(self._stage)
        now.host[STATUS] = 0
        now.run.copy_to_device(now.host)
        while state.counts[entry.STEP] - first < max_steps:
            self._steps(min(self._launch.batch, int(max_steps - (state.counts[entry.STEP] - first))))
            now.run.copy_to_host(now.host)
            while now.host[STATUS] == NEEDS_ROOM_LATE:
                self._again.grow()
                self._steps.forget()
                now.host[STATUS] = 0
                now.run.copy_to_device(now.host)
                self._finish()
                now.run.copy_to_host(now.host)
            self._counts.copy_to_host(state.counts)
            if now.host[STATUS] == NEEDS_ROOM:
                now.grow()
                self._steps.forget()
            elif now.host[STATUS] != 0:
                break
        self._clock.copy_to_host(state.clock)
        if now.host[STATUS] != 0:
            return int(now.host[STATUS])
        return entry.REACHED_TIME if state.clock[entry.TIME] >= until else entry.RUNNING

    def download(self) -> None:
        """Copy all that changes into the arrays of the host."""
        for name in ColumnArrays._fields:
            values = getattr(self.state, name)
            if values.size:
                values[...] = getattr(self, f"_{name}").copy_to_host()
        for name in self._changing_fields():
            values = getattr(self.fields, name)
            values[...] = getattr(self._fields, name).copy_to_host()

    def _changing_fields(self):
        """Names of the fields that change in this run."""
        effects, names = self._effects, ()
        if effects.entrainment.kind != NO_EROSION:
            names += ("erodible",)
        if effects.entrainment.lowering > 0.0:
            names += ("bed", "gradient")
        return (*names, "forest_state", "forest_sums") if effects.forest else names

    def _all(self, kernel, *arguments):
        _all(self._launch, kernel, *arguments)

    def _step(self):
        """Launch the kernels of one step."""
        now = self._now
        _one(self._launch, device_column_sort.begin_step, now.run, self._d_stage, self._clock, self._counts)
        now.sort(self._counts, self._rows, self._keys, self.settings)
        self._reorder()
        _one(
            self._launch,
            device_column_sort.choose_step,
            now.run,
            self._d_stage,
            self._clock,
            self._counts,
            self.settings,
        )
        self._sum_to_nodes()
        self._move_nodes()
        self._move_columns()
        self._finish()

    def _reorder(self):
        run, rows, ids, keys, order = self._now.run, self._rows, self._ids, self._keys, self._now.order
        _one(self._launch, device_point_sort.decide_order, run, self._counts)
        for first in range(0, rows.shape[1], device_point_sort.STRIP):
            self._all(device_point_sort.take_strip, run, rows, ids, keys, order, self._strip, self._names, first)
            self._all(device_point_sort.give_strip, run, rows, ids, keys, self._strip, self._names, first)
        self._all(device_point_sort.note_order, run, self._counts, order)

    def _sum_to_nodes(self):
        now, launch = self._now, self._launch
        width = launch.width if SIMULATED else OWNERS
        device_column_transfer.columns_to_grid.of(np.float64)[8 * launch.workers, width, launch.stream](
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
            self._all(device_column_nodes.clear_ghosts, now.run, self._nodes)
        self._all(device_column_transfer.gather_nodes, now.run, now.tiles, now.slot, now.touched, self._nodes)

    def _move_nodes(self):
        """Walls, barriers, friction, erosion, trees and peaks."""
        now, stage, nodes, fields = self._now, self._d_stage, self._nodes, self._fields
        settings, effects, run, touched = self.settings, self._effects, self._now.run, self._now.touched
        if settings.wall:
            for along_columns in (True, False):
                self._all(device_column_nodes.fold_walls, run, nodes, along_columns)
        if self._walled:
            self._all(
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
            self._all(device_column_nodes.sum_held, run, self._held, self._first_of_wall, self._held_report)
            self._all(device_column_nodes.collect_held, run, stage, self._held_report, self._barrier_sums, self._lost)
        self._all(
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
            self._all(device_column_nodes.lower_bed, run, touched, fields.bed, self._lowered, lowering)
            self._all(device_column_nodes.regrade, run, touched, fields.bed, fields.gradient, settings)
        self._all(
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
                self._all(device_column_nodes.mirror_walls, run, nodes, along_columns)

    def _move_columns(self):
        now, effects, clock = self._now, self._effects, self._clock
        self._all(
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
        _add_up(self._launch, device_column_reports.sum_node_reports, now.run, self._node_sums)
        _add_up(self._launch, device_column_reports.sum_column_reports, now.run, self._column_sums)
        _one(
            self._launch,
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
        self._all(device_column_transfer.book_left, *leaving, self.settings)
        self._all(device_column_transfer.note_left, *leaving, self._left_cells, self.settings)

    def _finish(self):
        """Launch what comes after the columns moved: what trees take, and reasons to stop."""
        if self._again is not None:
            self._detrain()
        _one(self._launch, device_column_reports.end_step, self._now.run, self._clock, self._counts, self.settings)

    def _detrain(self):
        now, again, fields, settings = self._now, self._again, self._fields, self.settings
        _one(self._launch, device_column_sort.begin_again, now.run, again.run, self._counts)
        again.sort(self._counts, self._rows, self._keys, self.settings)
        _one(self._launch, device_column_sort.end_again, now.run, again.run)
        self._all(
            device_column_detrainment.find_losses, again.run, self._rows, again.order, fields, self._losses, settings
        )
        self._all(
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
        width = self._launch.width if SIMULATED else OWNERS
        device_column_detrainment.losses_to_grid.of(np.float64)[8 * self._launch.workers, width, self._launch.stream](
            again.run, self._rows, again.order, again.start, again.block, self._losses, again.tiles, fields, settings
        )
        self._all(
            device_column_detrainment.add_losses, again.run, again.tiles, again.slot, again.touched, fields, settings
        )
        _add_up(self._launch, device_column_reports.sum_plain_reports, again.run, self._stop_sums)
        _one(
            self._launch,
            device_column_detrainment.collect_losses,
            now.run,
            again.run,
            self._clock,
            self._counts,
            fields.forest_sums,
            self._stop_sums[-1],
        )
        self._all(device_column_detrainment.clear_shares, now.run, now.touched, fields.forest_share)


def _all(launch, kernel, *arguments):
    """Launch a kernel whose threads share the work."""
    kernel.of(np.float64)[launch.workers, launch.width, launch.stream](*arguments)


def _pieces_of(launch, kernel, *arguments):
    """Launch a kernel each of whose threads has a piece of the window."""
    kernel.of(np.float64)[launch.scanners, launch.width, launch.stream](*arguments)


def _one(launch, kernel, *arguments):
    """Launch a kernel of one thread."""
    kernel.of(np.float64)[1, 1, launch.stream](*arguments)


def _add_up(launch, kernel, run, sums):
    """Sum the reports of all threads, from one array of `sums` to the next."""
    for many, few in pairwise(sums):
        kernel.of(np.float64)[few.shape[0], few.shape[1], launch.stream](run, many, few)


def _chosen(laws, effects):
    """Return the record `laws` of those effects whose names its fields have."""
    return laws(*(getattr(effects, name) for name in laws._fields))


def _some(array):
    """`array` in order, or one row of zeros in place of none: a device has no empty arrays."""
    return np.ascontiguousarray(array) if array.size else np.zeros((1, *array.shape[1:]), array.dtype)
