"""The depth-averaged solver: initial state, time integration, frames."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...compiled.block_order import REORDER_STEPS
from ...compiled.jit import ready_threads
from ...compiled.particle_slices import in_slices
from ...frames.particles import Particles
from ...frames.peaks import PEAK_ENTRIES, peaks_state
from ...frames.state_arrays import PARTICLES
from ...laws.effect_slots import with_fixed_types
from ...laws.ground_metric import SLOPE, WATER
from ...laws.internal_stress import largest_factor
from ...laws.quantities import GRAVITY
from ...system.errors import SceneError
from . import column_loop as kernel
from . import column_time_step
from .column_arrays import INSERTED_COLUMNS, KEPT_FIELDS, ColumnArrays, changing_fields
from .column_balances import ColumnBalances
from .column_records import Settings
from .column_restart import require_column_state
from .column_rows import CXX
from .feature_arrays import Places
from .node_grid import ColumnGrid

if TYPE_CHECKING:
    from ...frames.particles import Frame
    from ...laws.effect_slots import ColumnEffects
    from ...terrain.elevation import Terrain
    from .column_records import NodeFields
    from .node_grid import CellWindow

NO_WINDOW = (1 << 16, 1 << 16, -1, -1)  # west, south, east, north of the blocks with columns if there are none
LAID_OVER = 1.05  # [1] a column overlaps others where the grid is thicker than the column by this factor
NO_WALLS = (-9, -9, -9, -9)  # indices of nodes behind walls at the four edges: far outside, there is no wall
SHOWN_RANGE = 2.0  # [1] factor by which the area of a column in a frame differs at most from that of the grid
THIN_SHARE = 1e-3  # [1] of the reference thickness, below which friction takes a column for that thick
THIN_WITHOUT = 1e-3  # [m] the same where there is no reference thickness
WET_SHARE = 0.01  # [1] of the reference thickness, above which a node counts as reached by the flow
LEAST_FALL = 1e-3  # [1] tangent of the slope that level ground is taken for, so that steps have a limit
WILD_STOP = 0.05  # [1] share of the mass with over twice the speed that energy allows, at which a run stops
CFL_ALONE = 0.6  # [1] Courant number of a flow without walls, entrainment and inflow
SHORTENED = ("cfl", "move_limit", "fixed_dt", "fall_limit")  # settings that all go with the length of a step


@dataclass(frozen=True)
class ColumnNumerics:
    """Numerical settings of the columns; the effects are in `ColumnEffects`.

    Parameters
    ----------
    cell_size : float [m]
    cfl : float [1]
        Courant number.
    move_limit : float [1]
        Largest share of a cell that a column moves in a step.
    edges : {"open", "wall"}
    clamp : float [1]
        Keeps a column's thickness within [1/clamp, clamp] times the grid's; 0: no limit.
    gravity : float [m s-2]
    density : float [kg m-3]
    stop_at_rest : bool
        Stop when the flow has come to rest.
    time_step : float or None [s]
        Length of all steps; None: by the Courant number.
    maxima : bool
        Record running peaks of speed and pressure and the arrival too; that of thickness is always there.
    arrival_thickness : float [m]
        Speed, pressure and arrival time are recorded where the flow is at least so thick.
    reference_thickness : float or None [m]
        Reference for thin flow; None: the mean over the columns at the start.
    """

    cell_size: float
    cfl: float = 0.3
    move_limit: float = 0.5
    edges: str = "open"
    clamp: float = 0.0
    gravity: float = GRAVITY
    density: float = 1000.0
    stop_at_rest: bool = True
    time_step: float | None = None
    maxima: bool = False
    arrival_thickness: float = 0.05
    reference_thickness: float | None = None


class ColumnSolver(ColumnBalances):
    """Solver that advances the columns of a frame over a terrain.

    Parameters
    ----------
    frame : Frame
        Dimension 2, in the terrain's CRS.
    terrain : Terrain
    effects : ColumnEffects
    numerics : ColumnNumerics
    places : Places
        Spatial features of the effects on the grid of this solver.
    grid : ColumnGrid, optional
        That of `terrain` and the cell size, where it is known already.
    gradient : float64[n, 2, 2], optional [s-1]
        Velocity gradient du_i/dx_j that the columns start with; default none.

    Raises
    ------
    SceneError
        The frame has points, effects do not go together, or a column starts where there is no whole cell of terrain.
    """

    kernel, record, name = kernel, ColumnArrays, "columns"

    def __init__(
        self,
        frame: "Frame",
        terrain: "Terrain",
        effects: "ColumnEffects",
        numerics: ColumnNumerics,
        places: Places | None = None,
        grid: ColumnGrid | None = None,
        gradient: np.ndarray | None = None,
    ) -> None:
        if frame.dimension != 2 or frame.particles.area is None:
            raise SceneError("the depth-averaged solver requires columns (dimension 2), got points")
        self.effects, self.numerics, self._start = with_fixed_types(effects), numerics, frame
        self.grid = ColumnGrid.on(terrain, numerics.cell_size) if grid is None else grid
        self.places = places or Places()
        self._fields = self.places.fields(self.grid, effects.entrainment.lowering > 0.0)
        if effects.metric == WATER and effects.curvature:
            raise SceneError("[curvature] requires form = 'slope'; remove it, or set use = 'off'")
        self._load(frame, gradient)

    def _load(self, frame, gradient):
        """Set the state of a run that starts with the columns of `frame`; there may be none yet."""
        grid, numerics, (rows, columns) = self.grid, self.numerics, self.grid.bed.shape
        sizes = {PARTICLES: 0, "node_rows": rows, "node_columns": columns, "barriers": len(self.places.barrier_names)}
        sizes["peaks"] = PEAK_ENTRIES if numerics.maxima else 1
        self._make_arrays(sizes | self._block_sizes())
        self._nodes = np.zeros((rows, columns, 4))
        self._clock[column_time_step.TIME] = frame.time
        self._clock[column_time_step.BOUND_BED] = grid.bed.min()
        self._counts[column_time_step.WEST : column_time_step.NORTH + 1] = NO_WINDOW
        ids = frame.particles.id if frame.particles.id is not None else np.arange(len(frame.particles))
        self._first_new_id = int(ids.max()) + 1 if len(ids) else 0
        self.bed_start = self._add(frame, ids)
        if gradient is not None:
            self._arrays.rows[: len(ids), CXX : CXX + 4] = np.reshape(gradient, (-1, 4))
        self.mass_start = float(self._clock[column_time_step.TOTAL_MASS])
        self._settings = self._made_settings(frame.particles)
        self._whole_step = {name: getattr(self._settings, name) for name in SHORTENED}
        self.energy_start = self.energy()

    def _made_settings(self, particles):
        """Return the settings, which are constant during the time integration."""
        grid, numerics = self.grid, self.numerics
        reference = numerics.reference_thickness
        if reference is None:
            thickness = particles.mass / (numerics.density * particles.area)
            reference = float((particles.mass * thickness).sum() / self.mass_start)
        slope = np.hypot(grid.gradient[..., 0], grid.gradient[..., 1])
        if self.effects.metric == SLOPE:
            slope = slope / (1.0 + slope * slope)  # g sin cos along the ground, seen from above
        fall = np.sqrt(2.0 * grid.cell_size / (numerics.gravity * max(float(slope.max()), LEAST_FALL)))
        return Settings(
            dx=grid.cell_size,
            density=float(numerics.density),
            gravity=float(numerics.gravity),
            cfl=float(numerics.cfl),
            fixed_dt=float(numerics.time_step or 0.0),
            move_limit=float(numerics.move_limit),
            fall_limit=float(numerics.cfl * fall),
            clamp=float(numerics.clamp),
            thickness_floor=THIN_SHARE * reference if reference > 0.0 else THIN_WITHOUT,
            wet_thickness=WET_SHARE * reference,
            arrival_thickness=float(numerics.arrival_thickness),
            wild_stop=WILD_STOP,
            wall=numerics.edges == "wall",
            holes=not grid.inside.all(),
            stop_at_rest=bool(numerics.stop_at_rest),
            keep_peaks=bool(numerics.maxima),
        )

    def _from_corner(self, frame):
        """Return x, y [m] from the domain's corner of columns that start; all must be on whole cells of terrain."""
        grid = self.grid
        x, y = grid.from_corner(frame)
        off = ~grid.covers(x, y)
        if off.any():
            at = int(np.argmax(off))
            raise SceneError(
                f"{int(off.sum())} of {len(x)} columns start outside the terrain's whole cells, the first at "
                f"E {x[at] + grid.x0:.1f} N {y[at] + grid.y0:.1f}; move the release inwards or use a larger DTM"
            )
        return x, y

    def insert(self, frame: "Frame", window: "CellWindow", slab: bool = True) -> None:
        """Insert columns at the present time.

        Columns that overlap others would each be too thin: their areas are set to those that the grid gives for all of
        them together. Ids go on after those that are there.

        Parameters
        ----------
        frame : Frame
            Its columns are inserted.
        window : CellWindow
            Cells in which areas are set.
        slab : bool
            Only areas of columns that overlap others are set, so that the own rim of the slab stays as steep as it is.

        Raises
        ------
        SceneError
            A column starts where there is no whole cell of terrain.
        """
        self._before_change()
        inserted = self._arrays.inserted
        first, n = int(self._first_new_id + inserted[INSERTED_COLUMNS]), len(frame.particles)
        bed = self._add(frame, np.arange(first, first + n))
        count = int(self._counts[column_time_step.ROWS])
        kinetic, potential = self._energy_of(self._arrays.rows[count - n : count], bed)
        inserted += n, kinetic, potential + self._settle(window, LAID_OVER if slab else 0.0)

    def _add(self, frame, ids):
        """Append the columns of `frame` and update the clock; return the bed under them [m]."""
        particles, counts, clock = frame.particles, self._counts, self._clock
        x, y = self._from_corner(frame)
        bed, gradient_x, gradient_y = kernel.beds_at(self.fields.bed, x, y, self.grid.cell_size)
        n, first = len(particles), int(counts[column_time_step.ROWS])
        if n == 0:
            return bed
        self._require_room(first + n)
        new = slice(first, first + n)
        rows, keys = self._arrays.rows[new], self._arrays.keys[new]
        rows[:] = 0.0
        rows[:, kernel.X], rows[:, kernel.Y] = x, y
        rows[:, kernel.U], rows[:, kernel.V] = particles.velocity[:, 0], particles.velocity[:, 1]
        rows[:, kernel.MASS], rows[:, kernel.AREA] = particles.mass, particles.area
        rows[:, kernel.GX], rows[:, kernel.GY] = gradient_x, gradient_y
        self._arrays.ids[new] = ids
        west, south, east, north = kernel.initial_keys(rows, keys, self.grid.cell_size)
        seen = counts[column_time_step.WEST : column_time_step.NORTH + 1]
        seen[:] = min(seen[0], west), min(seen[1], south), max(seen[2], east), max(seen[3], north)
        counts[column_time_step.ROWS] += n
        counts[column_time_step.ALIVE] += n
        clock[column_time_step.TOTAL_MASS] += float(particles.mass.sum())
        clock[column_time_step.BOUND_BED] = max(clock[column_time_step.BOUND_BED], bed.max())
        thickness = particles.mass / (self.numerics.density * particles.area)
        speed2 = (particles.velocity**2).sum(axis=1)
        self._note_start(x, y, thickness, speed2)
        self._expect(thickness, np.hypot(*particles.velocity[:, :2].T), speed2.max())
        self._forget_peaks()
        return bed

    def _note_start(self, x, y, thickness, speed2):
        """Record a new largest thickness or speed of columns that are inserted at `x`, `y` [m]."""
        clock = self._clock
        for values, at, largest in (
            (thickness, column_time_step.DEEPEST_X, clock[column_time_step.DEPTH_WORST]),
            (np.sqrt(speed2), column_time_step.FASTEST_X, clock[column_time_step.FASTEST]),
        ):
            k = int(np.argmax(values))
            if values[k] > largest or not self.step:
                clock[at : at + 3] = x[k], y[k], self.time
        clock[column_time_step.FASTEST] = max(clock[column_time_step.FASTEST], np.sqrt(speed2.max()))

    def take_out(self, chosen: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> "Frame | None":
        """Take columns out of the flow, now.

        Mass and energy at the start are reduced by those of the removed columns.

        Parameters
        ----------
        chosen : callable
            Picks columns by their place: (x, y) float64[n] [m] on the map -> bool[n].

        Returns
        -------
        Frame or None
            The columns, with `velocity_gradient` in its state; None where there are none.
        """
        rows, _, _ = self._seen()
        out = chosen(rows[:, kernel.X] + self.grid.x0, rows[:, kernel.Y] + self.grid.y0)
        if not out.any():
            return None
        gradient = rows[out, CXX : CXX + 4].reshape(-1, 2, 2)
        frame = self.frame()
        taken = replace(frame, particles=frame.particles.take(out), state={"velocity_gradient": gradient}, maxima={})
        bed = kernel.beds_at(
            self.fields.bed, rows[out, kernel.X].copy(), rows[out, kernel.Y].copy(), self.grid.cell_size
        )[0]
        lost = float(rows[out, kernel.MASS].sum()), self._energy_of(rows[out], bed)
        n, counts = self._counts[column_time_step.ROWS], self._counts
        self._before_change()
        keys = self._arrays.keys
        gone = np.flatnonzero(keys[:n] != kernel.GONE)[out]
        keys[gone] = kernel.GONE
        counts[column_time_step.ALIVE] -= len(gone)
        counts[column_time_step.SINCE_REORDER] = REORDER_STEPS  # drop them from memory at the next step
        self._clock[column_time_step.TOTAL_MASS] -= lost[0]
        self.mass_start -= lost[0]
        self.energy_start = tuple(a - b for a, b in zip(self.energy_start, lost[1], strict=True))
        return taken

    def _expect(self, thickness, speed, speed2):
        """Prepare the clock for columns of `thickness` [m] with |u| = `speed` and at most |U|^2 = `speed2`."""
        clock, gravity = self._clock, self.numerics.gravity
        wave = np.sqrt(largest_factor(self.effects.earth_pressure) * gravity * thickness)
        deepest = np.max(thickness)
        for entry, value in (
            (column_time_step.SPEED, np.max(speed)),
            (column_time_step.SIGNAL, np.max(speed + wave)),
            (column_time_step.BOUND_ENERGY, 4 * gravity * deepest + speed2),
            (column_time_step.DEPTH_NOW, deepest),
            (column_time_step.DEPTH_WORST, deepest),
        ):
            clock[entry] = max(clock[entry], value)

    def _forget_peaks(self):
        """Reset the stop rules, which compare with past peaks: inserted columns have none yet."""
        clock = self._clock
        clock[column_time_step.KINETIC_PEAK] = clock[column_time_step.MOVING_PEAK] = 0.0
        clock[column_time_step.KINETIC_LOW_SINCE] = -1.0
        clock[column_time_step.FOOTPRINT_MARK_TIME], clock[column_time_step.FOOTPRINT_MARK] = (
            self.time,
            float(self._counts[column_time_step.WET]),
        )

    def _settle(self, window, least):
        """Set areas in the cells of `window` to those that the grid gives; return the added potential energy [J].

        Only of columns that become at least `least` times as thick.
        """
        n = self._counts[column_time_step.ROWS]
        ny, nx = self.grid.inside.shape
        walls = np.array((0, 0, nx + 2, ny + 2) if self._settings.wall else NO_WALLS)
        thickest, fastest, lifted = kernel.settle_areas(
            self._arrays.rows[:n],
            self._arrays.keys[:n],
            kernel.GONE,
            window.marked,
            window.row,
            window.column,
            walls,
            self.grid.cell_size,
            self._settings.density,
            least,
            self.effects.metric == SLOPE,
        )
        if thickest > self._clock[column_time_step.DEPTH_WORST]:
            rows, keys = self._arrays.rows[:n], self._arrays.keys[:n]
            thickness = np.where(keys != kernel.GONE, rows[:, kernel.MASS] / rows[:, kernel.AREA], 0.0)
            k = int(np.argmax(thickness))
            self._clock[column_time_step.DEEPEST_X : column_time_step.DEEPEST_TIME + 1] = (
                rows[k, kernel.X],
                rows[k, kernel.Y],
                self.time,
            )
        self._expect(thickest, fastest, 0.0)
        return 0.5 * self.numerics.gravity * lifted

    def arm(self, number: int, nodes: tuple[np.ndarray, np.ndarray], thickness: float | None) -> None:
        """Let `advance` stop with TRIGGER_REACHED when the flow reaches one of some nodes.

        Parameters
        ----------
        number : int
            Of the area that is released, from 1.
        nodes : (int[n], int[n])
            Rows and columns in the node arrays.
        thickness : float or None [m]
            Only thicker flow counts; None, or less than what counts as flow: any flow.
        """
        self._before_change()
        self._arrays.wet[nodes] |= np.uint8(kernel.ARMED * number)
        self._fields.trigger_thickness[number - 1] = max(thickness or 0.0, self._settings.wet_thickness)

    def fired(self, number: int, nodes: tuple[np.ndarray, np.ndarray]) -> bool:
        """Return whether the flow has reached an armed area; if so, it is armed no more.

        Parameters
        ----------
        number : int
            Of the area.
        nodes : (int[n], int[n])
            As for `arm`.
        """
        if (self.arrays.wet[nodes] // kernel.ARMED == number).all():
            return False
        self._before_change()
        self._arrays.wet[nodes] &= np.uint8(kernel.REACHED)
        return True

    @property
    def fields(self) -> "NodeFields":
        """Fields at the nodes and in the cells, as they are now."""
        self._fetch()
        return self._fields

    @property
    def speed_max(self) -> float:
        """Largest horizontal speed now [m s-1]."""
        return float(self._clock[column_time_step.SPEED])

    def advance(self, until: float, after: float = np.inf, max_steps: int = 1 << 62, may_stop: bool = True) -> int:
        """Advance to a time or by a number of steps.

        Parameters
        ----------
        until : float [s]
        after : float [s]
            Not used: the length of a step is chosen when it begins.
        max_steps : int
        may_stop : bool
            Without it the stop rules are off (more inflow follows).

        Returns
        -------
        int
            Reason to stop (`column_time_step`).
        """
        if not self.particles:
            return column_time_step.ALL_LEFT
        self._forget_computed()
        settings = self._settings if may_stop else self._settings._replace(stop_at_rest=False)
        return self._take_steps(float(until), int(max_steps), settings)

    def step_arguments(self) -> tuple:
        """Return the arguments with which `kernel.advance` takes one step; for its compilation."""
        return self._arguments(np.inf, 1, self._settings)

    def _arguments(self, until, max_steps, settings):
        arrays, order, nodes = self.arrays, self._order, self._nodes
        return arrays, order, nodes, until, max_steps, settings, self.fields, self.effects

    def _take_steps(self, until, max_steps, settings):
        ready_threads()
        return kernel.advance(*self._arguments(until, max_steps, settings))

    def _particles(self):
        """Return the present Particles: z is the bed, velocities are tangent to it.

        After the first step areas are limited to a factor of SHOWN_RANGE of those of the grid: a column that was
        stretched to a hundred cells is a thin line on the ground, not a square of that area. Masses are exact.
        """
        rows, ids, _ = self._seen()
        grid, origin, n = self.grid, self._start.origin, len(rows)
        corner = grid.corner_from(origin)
        position, velocity, mass, area = np.empty((n, 3)), np.empty((n, 3)), np.empty(n), np.empty(n)

        def fill(some):
            position[some, :2] = rows[some][:, [kernel.X, kernel.Y]] + corner
            position[some, 2] = self._beds_under(rows[some]) - origin[2]
            u, v = rows[some, kernel.U], rows[some, kernel.V]
            velocity[some, 0], velocity[some, 1] = u, v
            velocity[some, 2] = u * rows[some, kernel.GX] + v * rows[some, kernel.GY]
            mass[some], area[some] = rows[some, kernel.MASS], rows[some, kernel.AREA]

        in_slices(fill, n)
        if self.step:
            seen = kernel.grid_areas(rows, grid.bed.shape, grid.cell_size)
            area = np.clip(area, seen / SHOWN_RANGE, seen * SHOWN_RANGE)
        volume = mass / self.numerics.density
        return Particles(position, velocity, mass, volume, volume / area, area, ids.copy())

    def state(self) -> dict[str, np.ndarray]:
        """Return the state for a restart in addition to the frame's particles: the arrays that change, unmodified."""
        rows, _, _ = self._alive()
        reached = np.packbits(self.arrays.wet & kernel.REACHED, axis=1)
        state = self._whole_state() | self._left_state() | peaks_state(self.arrays.peaks)
        return state | {"rows": rows, "reached": reached}

    def _changing(self):
        fields = {KEPT_FIELDS.get(name, name): getattr(self.fields, name) for name in changing_fields(self.effects)}
        return super()._changing() | fields

    def _keeps(self, name):
        return name != "barriers" or self.effects.barrier

    def _shapes_of_parts(self, count):
        arrays = self._arrays
        reached = (len(arrays.wet), -(-arrays.wet.shape[1] // 8))
        return {"rows": (float, (count, kernel.ROW)), "reached": (np.uint8, reached)}

    def _require_state(self, frame, changing):
        require_column_state(frame, self, changing)

    def _restore_own(self, state):
        count, (rows, keys, wet) = len(state["rows"]), (self._arrays.rows, self._arrays.keys, self._arrays.wet)
        wet &= np.uint8(255 - kernel.REACHED)
        wet[np.unpackbits(state["reached"], axis=1, count=wet.shape[1]) == 1] = kernel.REACHED
        kernel.initial_keys(rows[:count], keys, self.grid.cell_size)

    def started(self) -> dict[str, Any]:
        """Return the numbers of the start that the solver counts from, as plain numbers (see `start_from`)."""
        return super().started() | {"first_new_id": self._first_new_id}

    def start_from(self, started: dict[str, Any]) -> None:
        """Count from the start of another solver: this one was made of a later frame of the same run.

        Parameters
        ----------
        started : dict
            Result of its `started`.
        """
        super().start_from(started)
        self._first_new_id = started["first_new_id"]
