"""Time loop of the 3D MPM on a CUDA device; what `point_loop.advance` is on the CPU.

Interface (used by the solver):

    device = DevicePoints(state, places, settings, effects)   # copies everything to the device
    reason = device.advance(until, after, max_steps)          # as `point_loop.advance`; rows stay on the device
    device.download()                                         # all of `state` on the host is current again

`state` holds the solver's own host arrays: `advance` keeps `clock` and `counts` current in them, `download` all others.
After any change of the host arrays (insertion, restart, other laws) make a new DevicePoints.

Arrays whose size depends on the flow grow when a step does not fit: nothing of the step is done before that is known.
"""

import numpy as np
from numba import cuda

from ...compiled.block_order import LEFT_MASS
from ...laws.contact_friction import has_traction
from ...laws.effect_slots import PointEffects, in_precision
from ...laws.material_choice import follows_density
from ...system.errors import SceneError
from ..points import point_time_step as entry
from ..points.bed_drag import BLOCK_COLUMNS, COLUMN_MASSES
from ..points.grid_to_points import NO_WINDOW
from ..points.point_arrays import PointArrays
from ..points.point_barriers import BLOCK_FLOW
from ..points.point_ground import Ground
from ..points.point_layers import LAYER_ENTRIES
from ..points.point_nodes import NODE_REPORT
from ..points.point_records import ColumnSums, ContactLaws, PointPlaces, Site
from ..points.point_report import BLOCK_EAST, BLOCK_NORTH, BLOCK_SOUTH, BLOCK_TALL, BLOCK_WEST
from ..points.point_rows import BLOCK, BLOCK_SIZE, TILE_SIZE, Settings, Surface
from . import (
    device_barriers,
    device_grid_to_points,
    device_point_density,
    device_point_nodes,
    device_point_reports,
    device_point_sort,
    device_point_steps,
    device_points_to_grid,
    rare_points,
)
from .device_records import MotionLaws, PointMap, PointsInBlocks, RarePoints, TouchedBlocks
from .device_run import DeviceRun
from .launch import (
    ACTIVE,
    AFTER,
    DEPTH,
    NOW_ENTRIES,
    ROOM_ACTIVE,
    ROOM_DEPTH,
    ROOM_PLACES,
    ROOM_TOUCHED,
    RUN_ENTRIES,
    SIZE,
    STAGE_ENTRIES,
    STATUS,
    TOUCHED,
    UNTIL,
    Launch,
)

LAST_STEP = 1 << 24  # numbers of steps, kept with the yield of the ground, are exact in float32 up to here
EXACT = 2.0**52  # whole numbers below it are exact in float64: sums of outflow pass between host and device unchanged
LEAST_MASS = 1e-300  # [kg] keeps units of outflow off 0


class DevicePoints(DeviceRun):
    """The points of a run on the device.

    Parameters
    ----------
    state : PointArrays
    places : PointPlaces
    settings : Settings
    effects : PointEffects
        Material and softening in the precision of the rows.
    launch : Launch, optional
        Sizes of launches; by default those for a GPU, in the simulator small ones.
    """

    def __init__(
        self,
        state: PointArrays,
        places: PointPlaces,
        settings: Settings,
        effects: PointEffects,
        launch: Launch | None = None,
    ) -> None:
        self._barred = effects.barrier and len(state.barrier_sums) > 0
        if not self._barred:
            effects = effects._replace(barrier=False)
        self._real = state.rows.dtype.type
        super().__init__(state, entry, self._real, launch, STAGE_ENTRIES)
        contact = in_precision(effects.contact, self._real)
        self._settings, self._effects = settings, effects._replace(contact=contact)
        self._node_settings = in_precision(settings, self._real)
        self._drags = has_traction(contact)
        self._upload(places)
        self._make_reports()
        self._run = np.zeros(RUN_ENTRIES, np.int64)
        self._d_run = cuda.to_device(self._run)
        self._now = self._to_device(np.zeros(NOW_ENTRIES))
        self._grow()

    def _to_device(self, values):
        """Return an array of floats on the device, in the precision of the points."""
        return cuda.to_device(np.ascontiguousarray(values, self._real))

    def _upload(self, places):
        """Copy state and map to the device."""
        state = self.state
        for name in ("rows", "ids", "keys", "clock", "counts", "ledger"):
            setattr(self, f"_{name}", cuda.to_device(np.ascontiguousarray(getattr(state, name))))
        self._peaks, self._yields = self._to_device(state.peaks), self._to_device(state.yields)
        n = len(state.rows)
        self._order, self._loose, self._mixed = (cuda.device_array(n, np.int32) for _ in range(3))
        self._cells = cuda.device_array(n, np.uint8)
        self._strip = cuda.device_array((n, device_point_sort.STRIP), self._real)
        self._names = cuda.device_array((n, 2), np.int64)
        ground = places.ground
        folds = cuda.to_device(np.ascontiguousarray(ground.folds))
        self._ground = Ground(self._to_device(ground.nodes), folds, self._to_device(ground.exact))
        settings, nodes = self._settings, ground.nodes
        self._planes = cuda.to_device(device_point_steps.planes_of(nodes, settings.dx, self._real))
        self._domain = device_point_steps.Domain(settings.cells_x, settings.cells_y, settings.wall)
        self._rare, self._scales = (
            cuda.device_array(n, np.uint8),
            cuda.device_array(device_point_steps.SCALES, self._real),
        )
        self._lowest, self._inside = cuda.to_device(places.lowest), cuda.to_device(places.inside.astype(np.uint8))
        self._zone_values = self._to_device(places.zone_values)
        arrays = places.barriers, places.faces, state.barrier_sums, state.face_yields
        self._barriers = device_barriers.DeviceBarriers(*arrays, self._real)
        self._site = Site(*self._ground, self._zone_values, self._barriers.values)
        rows, columns = ground.nodes.shape[:2] if self._drags else (1, 1)
        mass = self._to_device(np.zeros((rows, columns, COLUMN_MASSES)))
        self._column_sums = ColumnSums(mass, self._barriers.flow)
        self._units = left_units(
            state.left_cells, state.clock[entry.TOTAL_MASS], places.inside.shape, self._settings.dx
        )
        self._left = cuda.to_device(np.rint(state.left_cells / self._units).astype(np.int64))
        self._d_units = cuda.to_device(self._units)

    def _make_reports(self):
        """Make the reports of all threads, and the arrays in which they are summed."""
        threads, *fewer = self._launches.report_counts()
        self._node_sums = [self._to_device(np.zeros((threads, NODE_REPORT)))]
        self._node_sums += [cuda.to_device(np.zeros((n, NODE_REPORT))) for n in fewer]
        self._marks = cuda.device_array((threads, device_point_steps.RARE_MARKS), self._real)
        self._mark_counts = cuda.device_array((threads, device_point_steps.RARE_COUNTS), np.int32)
        nothing = np.zeros(device_point_steps.POINT_REPORT)
        nothing[[BLOCK_WEST, BLOCK_SOUTH]] = NO_WINDOW
        nothing[[BLOCK_EAST, BLOCK_NORTH, BLOCK_TALL, device_point_steps.STAY2_OF_ALL]] = -1.0
        self._point_sums = [cuda.to_device(np.tile(nothing, (n, 1))) for n in (threads, *fewer)]

    def _grow(self):
        """Make arrays in which the present step fits, with half as much in addition."""
        run, old, sizes = self._run, self._run.copy(), self._launches.sizes
        few = sizes.room
        for room, needed, least in (
            (ROOM_PLACES, SIZE, 16 * few),
            (ROOM_ACTIVE, ACTIVE, few),
            (ROOM_TOUCHED, TOUCHED, 4 * few),
            (ROOM_DEPTH, DEPTH, min(few, 8)),
        ):
            if run[needed] > run[room] or not old[room]:
                run[room] = max(int(run[needed]) * 3 // 2, least)
        if self._drags and self._real is np.float32 and run[ROOM_TOUCHED] > LAST_STEP:
            raise SceneError(
                f"device = 'cuda' with precision = 'float32' takes at most {LAST_STEP} blocks of nodes where the law "
                "of friction is not Coulomb; take larger cells, or precision = 'float64'"
            )
        if run[ROOM_PLACES] != old[ROOM_PLACES]:
            size = int(run[ROOM_PLACES])
            self._histogram, self._flags, self._slots = (cuda.device_array(size, np.int32) for _ in range(3))
        if run[ROOM_ACTIVE] != old[ROOM_ACTIVE]:
            size = int(run[ROOM_ACTIVE])
            self._block, self._start = cuda.device_array(size, np.int32), cuda.device_array(size + 1, np.int64)
            self._targets, self._blocks = (cuda.device_array((size, k), np.int32) for k in (8, 3))
            self._rare_blocks = cuda.device_array(size, np.uint8)
            self._tiles = cuda.device_array((size, TILE_SIZE), self._real)
        if run[ROOM_TOUCHED] != old[ROOM_TOUCHED]:
            size = int(run[ROOM_TOUCHED])
            self._nodes, self._free = (
                cuda.device_array((size, BLOCK_SIZE), self._real),
                cuda.device_array(size, np.uint8),
            )
            self._touched, self._sources = (cuda.device_array((size, k), np.int32) for k in (3, 8))
            self._masses = cuda.device_array((size if self._drags else 1, BLOCK_COLUMNS), self._real)
            self._flows = cuda.device_array((size if self._barriers.opens else 1, BLOCK_FLOW), self._real)
        if run[ROOM_DEPTH] != old[ROOM_DEPTH]:
            threads = min(sizes.couplers, sizes.workers * sizes.width) if self._drags else 1
            levels = int(run[ROOM_DEPTH]) * BLOCK if self._drags else 1
            self._layers = cuda.device_array((threads, levels, LAYER_ENTRIES), self._real)
        run[STATUS] = 0
        self._d_run.copy_to_device(run)

    def _touched_blocks(self):
        """Return the record of the present arrays that kernels of nodes take."""
        return TouchedBlocks(self._nodes, self._touched, self._slots, self._lowest)

    def _points_in_blocks(self):
        """Return the record of the present arrays that kernels of points take."""
        return PointsInBlocks(self._rows, self._keys, self._order, self._start, self._blocks, self._targets)

    def advance(self, until: float, after: float = np.inf, max_steps: int = 1 << 62) -> int:
        """Advance to a time or by a number of steps, as `point_loop.advance`.

        `clock` and `counts` of the host state are current afterwards; the other arrays after `download`.

        Parameters
        ----------
        until : float [s]
            Time at which to stop.
        after : float [s]
            The next time that will be requested.
        max_steps : int
            Largest number of steps.

        Returns
        -------
        reason : int
            Why it stopped: one of the reasons of `point_time_step`.

        Raises
        ------
        SceneError
            More than LAST_STEP steps of float32 points.
        """
        self._stage[UNTIL], self._stage[AFTER] = until, after
        return self._take_batches(until, max_steps, self._run, self._d_run)

    def _before_batch(self):
        """Raise SceneError if the numbers of the next steps are not exact in the precision of the points."""
        if self._real is np.float32 and self.state.counts[entry.STEP] + self._launches.sizes.batch >= LAST_STEP:
            raise SceneError(
                f"device = 'cuda' with precision = 'float32' takes at most {LAST_STEP} steps, which are reached at "
                f"t = {self.state.clock[entry.TIME]:g} s; continue with --resume --device cpu"
            )

    def download(self) -> None:
        """Copy all that changes into the arrays of the host state.

        Not `clock` and `counts`, which `advance` has copied: the host may have changed them since.
        """
        state = self.state
        for name in ("rows", "ids", "keys", "ledger", "peaks", "yields"):
            values = getattr(state, name)
            values[...] = getattr(self, f"_{name}").copy_to_host()
        state.left_cells[...] = self._left.copy_to_host() * self._units
        state.barrier_sums[...] = self._barriers.sums.copy_to_host()
        state.face_yields[...] = self._barriers.faces.yields.copy_to_host()

    def _step(self):
        """Launch the kernels of one step."""
        self._sort()
        self._reorder()
        self._sum_to_nodes()
        self._contact()
        self._move_points()

    def _sort(self):
        run, lowest = self._d_run, self._lowest
        self._launches.one(device_point_sort.begin_step, run, self._d_stage, self._now, self._clock, self._counts)
        self._launches.all(device_point_sort.clear_window, run, self._histogram, self._flags)
        self._launches.all(
            device_point_sort.count_points, run, self._counts, self._rows, self._keys, self._histogram, self._cells
        )
        self._launches.scan(run, self._histogram, True)
        self._launches.pieces(device_point_sort.rank_places, run, self._histogram, self._block, self._start)
        self._launches.all(
            device_point_sort.scatter_points, run, self._counts, self._keys, self._histogram, self._loose
        )
        self._launches.all(
            device_point_sort.rank_points, run, self._start, self._loose, self._cells, self._mixed, self._order
        )
        self._launches.all(device_point_sort.mark_touched, run, self._block, lowest, self._flags)
        self._launches.scan(run, self._flags, False)
        self._launches.pieces(
            device_point_sort.rank_touched, run, self._flags, lowest, self._slots, self._touched, self._sources
        )
        self._launches.all(
            device_point_sort.link_blocks,
            run,
            self._block,
            lowest,
            self._slots,
            self._sources,
            self._targets,
            self._blocks,
        )

    def _reorder(self):
        arrays = self._rows, self._ids, self._keys, self._order, self._strip, self._names
        self._launches.reorder(self._d_run, self._counts, *arrays)

    def _sum_to_nodes(self):
        run, settings, sizes = self._d_run, self._node_settings, self._launches.sizes
        self._launches.blocks(
            device_points_to_grid.points_to_grid,
            8 * sizes.workers,
            sizes.groups * device_points_to_grid.GROUP,
            run,
            self._rows,
            self._order,
            self._start,
            self._tiles,
        )
        self._launches.all(device_point_nodes.gather_nodes, run, self._tiles, self._sources, self._nodes)
        if self._drags:
            self._launches.all(
                device_point_nodes.weigh_contact, run, self._nodes, self._touched, self._ground, self._masses, settings
            )
            self._spread(self._masses, self._column_sums.mass)
        if self._barriers.opens:
            self._launches.all(device_barriers.weigh_flow, run, self._nodes, self._flows)
            self._spread(self._flows, self._column_sums.flow)
        self._launches.all(device_point_nodes.move_nodes, run, self._now, self._nodes, settings)

    def _spread(self, masses, columns):
        """Sum `masses` of blocks' node columns into `columns` of the ground."""
        self._launches.all(device_point_nodes.spread_contact, self._d_run, masses, self._touched_blocks(), columns)

    def _contact(self):
        """Apply ground, barriers, walls and layers; then update peaks, and choose the length of the next step."""
        run, now, counts, settings, ground = self._d_run, self._now, self._counts, self._node_settings, self._ground
        effects, site, sums, blocks = self._effects, self._site, self._column_sums, self._touched_blocks()
        laws = ContactLaws(effects.contact, effects.zones, effects.barrier)
        nodes, touched, yields = self._nodes, self._touched, self._yields
        reports, free, barred = self._node_sums[0], self._free, self._barriers
        faces, booked = barred.faces, barred.booked
        self._launches.all(
            device_point_nodes.find_contacts,
            run,
            nodes,
            touched,
            free,
            ground,
            barred.values,
            reports,
            settings,
            laws.barrier,
        )
        if self._drags:
            kernel = device_point_nodes.couple_layers
            self._launches.all(kernel, run, now, blocks, site, sums.mass, self._layers, reports, settings, laws)
        kernel = device_point_nodes.press_on_ground
        self._launches.all(kernel, run, now, counts, blocks, free, site, yields, reports, settings, laws)
        if self._barred and len(faces.values):
            self._launches.all(device_barriers.share_face_rows, run, blocks, faces, settings)
            self._launches.all(device_barriers.weigh_face_rows, run, now, counts, blocks, site, faces, settings)
            self._launches.all(
                device_barriers.weigh_face_columns, run, now, counts, blocks, site, faces, yields, settings
            )
            self._launches.all(device_barriers.settle_faces, run, now, blocks, site, faces, settings, laws)
            self._launches.all(
                device_barriers.book_faces, run, counts, blocks, site, faces, yields, booked, reports, settings
            )
        if self._barred:
            kernel = device_barriers.press_on_crests
            self._launches.all(kernel, run, barred.columns, blocks, barred.values, booked, reports, settings)
        self._launches.all(
            device_point_nodes.hold_nodes, run, now, blocks, free, site, sums, booked, reports, settings, laws
        )
        if self._barred:
            kernel = device_barriers.hold_at_barriers
            self._launches.all(kernel, run, now, barred.columns, blocks, site, sums, booked, reports, settings, laws)
        self._launches.all(device_point_nodes.finish_nodes, run, nodes, touched, free, ground, reports, settings)
        if follows_density(effects.material):
            self._launches.all(
                device_point_density.correct_density,
                run,
                counts,
                self._points_in_blocks(),
                nodes,
                free,
                ground,
                yields,
                barred.values,
                reports,
                settings,
                laws.barrier,
            )
        if self._drags:
            self._launches.all(device_point_nodes.clear_contact, run, touched, sums.mass)
        if barred.opens:
            self._launches.all(device_point_nodes.clear_contact, run, touched, sums.flow)
        if settings.keep_peaks:
            self._launches.all(device_point_nodes.note_peaks, run, now, blocks, ground.nodes, self._peaks, settings)
        self._launches.add_up(device_point_reports.sum_node_reports, run, self._node_sums)
        if self._barred:
            self._launches.all(device_barriers.sum_booked, run, barred.booked, barred.start, barred.report)
            self._launches.all(device_barriers.collect_barriers, run, self._d_stage, barred.report, barred.sums)
        self._launches.one(
            device_point_reports.choose_step,
            run,
            self._d_stage,
            self._clock,
            self._counts,
            self._node_sums[-1],
            self._scales,
            self._settings,
        )

    def _move_points(self):
        run, stage, settings, effects = self._d_run, self._d_stage, self._settings, self._effects
        laws = MotionLaws(effects.material, effects.softening, effects.transfer)
        points, ground, nodes, domain = self._points_in_blocks(), self._ground.nodes, self._nodes, self._domain
        below = PointMap(self._planes, self._lowest, self._inside)
        surface = Surface(ground, self._lowest, self._inside)
        rare, reports = RarePoints(self._rare, self._rare_blocks, self._marks, self._mark_counts), self._point_sums[0]
        self._launches.all(
            device_grid_to_points.grid_to_points, run, self._scales, points, nodes, below, rare, domain, laws
        )
        self._launches.all(
            rare_points.move_rare_points,
            run,
            self._scales,
            points,
            nodes,
            ground,
            rare,
            domain,
            self._node_settings,
            laws,
        )
        self._launches.all(rare_points.begin_reports, run, rare.marks, rare.counts, reports, settings)
        self._launches.all(
            rare_points.settle_rare_points,
            run,
            points,
            surface,
            self._left,
            self._d_units,
            rare,
            reports,
            domain,
            settings,
        )
        if self._barred and len(self._barriers.faces.values):
            self._launches.all(
                device_barriers.keep_before_faces,
                run,
                self._counts,
                self._rows,
                self._keys,
                self._lowest,
                self._inside,
                self._barriers.faces.values,
                self._barriers.values,
                reports,
                self._node_settings,
            )
        self._launches.add_up(device_point_reports.sum_point_reports, run, self._point_sums)
        self._launches.one(
            device_point_reports.finish_step,
            run,
            stage,
            self._clock,
            self._counts,
            self._ledger,
            self._point_sums[-1],
            self._rows,
            self._keys,
            self._lowest,
            settings,
        )


def left_units(left_cells: np.ndarray, mass: float, cells: tuple[int, int], dx: float) -> np.ndarray:
    """Compute the units in which outflow is summed in whole numbers: sums of twice the mass stay exact in float64.

    Parameters
    ----------
    left_cells : float64[WAYS, blocks, blocks, LEFT_ENTRIES]
        What has left so far.
    mass : float [kg]
        Of the run.
    cells : (ny, nx)
        Of the domain.
    dx : float [m]

    Returns
    -------
    units : float64[LEFT_ENTRIES] [kg, kg m, kg m]
        Powers of two.
    """
    ny, nx = cells
    most = 2.0 * max(float(mass), float(left_cells[..., LEFT_MASS].sum()), LEAST_MASS)
    return np.array([2.0 ** np.ceil(np.log2(most * length / EXACT)) for length in (1.0, nx * dx, ny * dx)])
