"""The 3D solver: initial state, time integration, frames and restart."""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...compiled.jit import ready_threads
from ...compiled.particle_slices import in_slices
from ...frames.particles import Particles
from ...frames.peaks import maxima_of, peaks_state
from ...frames.state_arrays import PARTICLES
from ...frames.state_check import YIELD_STATE
from ...laws.effect_slots import in_precision, with_fixed_types
from ...laws.material_choice import SHORT_STATE, follows_density, state_at_stress, state_count
from ...system.errors import SceneError
from ..columns.node_grid import ColumnGrid
from . import point_loop as kernel
from . import point_rows as row
from . import point_time_step as entry
from .face_arrays import NO_FACES
from .ground_contact import YIELD, YIELD_ENTRIES, YIELD_STEP
from .ground_folds import folded_ground, padded
from .ground_nodes import barrier_nodes, ground_nodes, press_faces, press_ground
from .point_arrays import LOW_SINCE, PointArrays
from .point_balances import PointBalances
from .point_blocks import EAST, lowest_blocks, set_places, window_of
from .point_numerics import PRECISIONS, kernel_settings, mass_limits
from .point_records import PointPlaces
from .point_restart import require_point_state
from .point_rows import volume_ratios
from .point_sums import MOMENTUM_X, MOMENTUM_Z
from .point_time_step import set_next_step

if TYPE_CHECKING:
    from ...frames.particles import Frame
    from ...laws.effect_slots import PointEffects
    from ...terrain.elevation import Terrain
    from ..features.walls import Wall
    from .point_numerics import PointNumerics

STENCIL_CELLS = 27.0  # [cells] volume of the stencil of a point: a larger volume of a point is not resolved
TIME_ROUNDING = 1e-9  # [1] relative rounding error of a time
OF_POINTS = (PARTICLES, "numbers")  # lengths of the arrays of points alone
NO_PLACES = np.zeros((1, 1, 1))  # for spatially varying values where there are none


class PointSolver(PointBalances):
    """Time integration of the points of `frame` on `terrain`.

    Parameters
    ----------
    frame : Frame
        Dimension 3, in the CRS of the terrain.
    terrain : Terrain
    effects : PointEffects
    numerics : PointNumerics
    stress : float64[n, 6], optional [Pa]
        Initial Kirchhoff stress of the points: xx, yy, zz, xy, xz, yz; default none.
    zone_values : float64[rows, columns, k], optional
        Parameters of the contact law at the nodes, where there are zones.
    walls : sequence of Wall
        Rigid barriers; computed with a thickness of at least three cells.
    affine : float64[n, 3, 3], optional [s-1]
        Initial velocity gradient dv_i/dx_j of the points; default none.

    Raises
    ------
    SceneError
        The frame has columns, or points start outside the terrain's whole cells; the ground is too rough.
    """

    kernel, record, name = kernel, PointArrays, "points"
    own_state = YIELD_STATE

    def __init__(
        self,
        frame: "Frame",
        terrain: "Terrain",
        effects: "PointEffects",
        numerics: "PointNumerics",
        stress: np.ndarray | None = None,
        zone_values: np.ndarray | None = None,
        walls: "Sequence[Wall]" = (),
        affine: np.ndarray | None = None,
    ) -> None:
        if frame.dimension != 3:
            raise SceneError("the 3D solver requires points (dimension 3), got columns; `mpmgis convert` makes points")
        self.effects, self.numerics, self._start = with_fixed_types(effects), numerics, frame
        self._real = PRECISIONS[numerics.precision]
        laws = {name: in_precision(getattr(self.effects, name), self._real) for name in ("material", "softening")}
        self._effects = self.effects._replace(**laws)
        grid = ColumnGrid.on(terrain, numerics.cell_size)
        self.grid = grid
        self._set_ground()
        self._zone_values = NO_PLACES if zone_values is None else padded(zone_values)
        self.walls = tuple(walls)
        self._set_barriers()
        self._affine = None if affine is None else np.asarray(affine, float)
        self._make_arrays(self._sizes(len(frame.particles)), self._real)
        self._load(frame, stress)
        self._press_contacts(frame, stress)

    def _set_ground(self):
        """Set elevation above the lowest level, slopes and folds at all nodes that points can reach."""
        grid, dx = self.grid, self.numerics.cell_size
        self.floor, self._ground = ground_nodes(grid, dx)
        terrain_height = padded(grid.bed[..., None] - self.floor)[..., 0]
        self._known_ground = folded_ground(self._ground, terrain_height, dx, self.numerics.clearance)
        self._lowest = lowest_blocks(self._ground[..., 0], dx)

    def _set_barriers(self):
        """Set the barriers at node columns and their faces, and the number of levels of these."""
        self._barriers, self._faces, self._levels = NO_PLACES, NO_FACES, 0
        if self.walls:
            self._barriers, self._faces, self._levels = barrier_nodes(
                self.walls,
                self.grid,
                self.floor,
                self._ground,
                self._known_ground.folds,
                follows_density(self.effects.material),
            )

    def _sizes(self, count):
        """Return the lengths of the arrays of a run of `count` points, by name."""
        rows, columns = self._ground.shape[:2]
        peaks = (rows, columns) if self.numerics.maxima else (1, 1)
        short = state_count(self.effects.material) == SHORT_STATE
        return self._block_sizes() | {
            PARTICLES: count,
            "numbers": row.ROW_SHORT if short else row.ROW_LONG,
            "node_rows": rows,
            "node_columns": columns,
            "peak_rows": peaks[0],
            "peak_columns": peaks[1],
            "barriers": len(self.walls),
            "face_rows": len(self._faces) + 2,
            "face_levels": self._levels + 2,
        }

    def _corner_from(self, origin):
        """Return the origin of places, relative to the map place `origin` (E, N, H), float64[3] [m]."""
        return np.append(self.grid.corner_from(origin), self.floor - origin[2])

    def _load(self, frame, stress):
        """Set the initial state of a run that starts with the points of `frame`."""
        particles, material, numerics = frame.particles, self.effects.material, self.numerics
        place = particles.position - self._corner_from(frame.origin)
        off = ~self.grid.covers(*place[:, :2].T)
        if off.any():
            x, y = (values[int(np.argmax(off))] for values in frame.map_xy())
            raise SceneError(
                f"{int(off.sum())} of {len(off)} points start outside the terrain's whole cells, the first at "
                f"E {x:.1f} N {y:.1f}; move them, use a larger DTM or set [terrain] fill_nodata = 'interpolate'"
            )
        n, rows, keys = len(particles), self._arrays.rows, self._arrays.keys
        self._arrays.ids[:] = particles.id if particles.id is not None else np.arange(n)
        self._arrays.rest[LOW_SINCE] = -1.0
        self._counts[entry.ROWS] = self._counts[entry.ALIVE] = n
        self._clock[entry.TIME] = frame.time
        self.mass_start = float(particles.mass.astype(self._real).sum(dtype=float))
        self._clock[entry.TOTAL_MASS] = self._clock[entry.MASS_NOW] = self.mass_start
        speed = np.sqrt((particles.velocity**2).sum(axis=1))
        self._clock[entry.FASTEST] = speed.max(initial=0.0)
        if self._affine is not None:
            self._clock[entry.SHEAR] = np.sqrt((self._affine**2).sum(axis=(1, 2)).max())
        self._heaviest = float(particles.mass.max(initial=0.0))
        inside = self.grid.inside
        self._settings = kernel_settings(numerics, material, inside, self._heaviest, self.mass_start)
        self._whole_step = {name: getattr(self._settings, name) for name in ("cfl", "fixed_dt")}
        self._lay_on_ground(place, particles.mass)
        set_places(rows, keys, place, 1.0 / numerics.cell_size, self._lowest)
        rows[:, row.PX : row.PZ + 1] = particles.velocity * particles.mass[:, None]
        rows[:, row.MASS] = particles.mass
        known = np.zeros((1, 6)) if stress is None else np.asarray(stress, float)
        self._stress = np.broadcast_to(known, (n, 6))
        for column, values in zip(row.STATE, state_at_stress(material, tuple(known.T)), strict=True):
            if column < rows.shape[1]:
                rows[:, column] = values
        window_of(keys, self._lowest, self._counts[entry.WINDOW_FIRST :])
        self._note_start(place, speed, particles.mass)
        self.energy_start = self.energy()
        self._energy_whole = sum(self.energy_start) + self._turning_energy(particles.mass)
        self._momentum_start = self._sums()[MOMENTUM_X : MOMENTUM_Z + 1].copy()

    def _lay_on_ground(self, place, mass):
        """Move points more than a cell below the ground onto it, in `place` [n, 3], and record their `mass`.

        Points placed on the pixels of the DTM can be below the ground of the solver, which is smooth over a cell. This
        is no leak, which would stop the run in its first step.
        """
        surface = self._height_under(place[:, :2])
        under = place[:, 2] < surface - self.numerics.cell_size
        place[under, 2] = surface[under]
        self._clock[entry.LIFTED_MASS] = mass[under].sum()

    def _update_mass_limits(self):
        """Update the settings that depend on the heaviest point and on the mass."""
        self._before_change()
        self._settings = self._settings._replace(**mass_limits(self.numerics, self._heaviest, self.mass_start))

    def _give_impulses(self):
        """Compute what stress and velocity gradient add to the nodes in the next step, whose length is known."""
        self._before_change()
        clock, rows, dx = self._clock, self._arrays.rows, self.numerics.cell_size
        push = clock[entry.STEP_NOW] * 4.0 / (dx * self.numerics.density) * rows[:, row.MASS]
        xx, yy, zz, xy, xz, yz = self._stress.T
        turning = np.zeros((1, 3, 3)) if self._affine is None else self._affine * (dx * rows[:, row.MASS, None, None])
        tensor = (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)
        for axis, column in enumerate((row.AXX, row.AXY, row.AXZ)):
            for k, part in enumerate(tensor[axis]):
                rows[:, column + k] = turning[:, k, axis] - push * part
        self._stress = self._affine = None

    def advance(self, until: float, after: float = np.inf, max_steps: int = 1 << 62, may_stop: bool = True) -> int:
        """Advance to a time or by a number of steps; return the reason to stop (see `point_time_step`).

        Parameters
        ----------
        until : float [s]
            The time.
        after : float [s]
            The next time that will be requested: the length of the step after `until` is chosen in the step before it.
        max_steps : int
        may_stop : bool
            Not used: points check for rest at the times of frames.
        """
        self._forget_computed()
        clock = self._clock
        if self._stress is not None:
            set_next_step(clock, self._counts, clock[entry.TIME], float(until), float(after), self._settings)
            self._give_impulses()
        if abs(clock[entry.TIME] + clock[entry.STEP_NOW] - until) > TIME_ROUNDING * max(1.0, abs(until)):
            clock[entry.HITS] = 0.0  # the step was chosen for another end, that of the previous run
        return self._take_steps(float(until), float(after), int(max_steps))

    def _take_steps(self, until, after, max_steps):
        """Take the steps of `advance`, once the points push on the nodes."""
        ready_threads()
        return kernel.advance(*self._arguments(until, after, max_steps))

    def step_arguments(self) -> tuple:
        """Return the arguments with which `kernel.advance` takes one step; for its compilation."""
        return self._arguments(np.inf, np.inf, 1)

    def _arguments(self, until, after, max_steps):
        places, order = self._kernel_places(), self._order
        return self.arrays, places, order, until, after, max_steps, self._settings, self._effects

    def _kernel_places(self):
        """Return ground and map, as PointPlaces."""
        return PointPlaces(
            self._known_ground, self._lowest, self.grid.inside, self._zone_values, self._barriers, self._faces
        )

    def _particles(self):
        rows, ids, keys = self._seen()
        n, corner = len(rows), self._corner_from(self._start.origin)
        position, velocity, mass, volume = np.empty((n, 3)), np.empty((n, 3)), np.empty(n), np.empty(n)

        def fill(some):
            mass[some] = rows[some, row.MASS]
            velocity[some] = rows[some, row.PX : row.PZ + 1] / mass[some, None]
            position[some] = self._places(rows[some], keys[some]) + corner
            volume[some] = self._volumes(rows[some], mass[some])

        in_slices(fill, n)
        return Particles(position, velocity, mass, volume, id=ids.copy())

    def thickest(self) -> dict[str, np.ndarray]:
        """Return the largest `thickness` [m] at the nodes, as `maxima` does; empty without `numerics.maxima`."""
        numerics, grid = self.numerics, self.grid
        if not numerics.maxima:
            return {}
        ny, nx = grid.inside.shape
        first = row.GHOSTS
        inner = self.arrays.peaks[first : first + ny + 1, first : first + nx + 1]
        return maxima_of(inner, grid.x0, grid.y0, grid.cell_size, numerics.arrival_thickness)

    def _volumes(self, rows, mass):
        """Compute the volume of each point, float64[n] [m3].

        It is limited to that of the cells of its stencil, for a single point in the air.

        The state itself is not limited: a point that was pulled apart bears load only when it is compressed as much.
        """
        free = mass / self.numerics.density
        largest = np.maximum(free, STENCIL_CELLS * self.numerics.cell_size**3)
        return np.minimum(free * volume_ratios(rows, self.effects.material), largest)

    def state(self) -> dict[str, np.ndarray]:
        """Return the state of a restart in addition to the particles of the frame: the arrays that change."""
        rows, _, keys = self._alive()
        begun = {"stress": self._stress, "affine": self._affine}  # before the first step converts them to impulses
        state = {"rows": rows, "keys": keys} | {name: array for name, array in begun.items() if array is not None}
        state |= self._left_state() | self._yield_state()
        state |= peaks_state(self.arrays.peaks) if self.numerics.maxima else {}
        return state | self._whole_state()

    def _press_contacts(self, frame, stress):
        """Set ground below points that start with `stress`, and faces beside them, to equilibrium with it."""
        place, step = frame.particles.position - self._corner_from(frame.origin), self.step
        last, stressed = self._arrays.yields[step % 2], stress is not None
        press_ground(last, step, place, frame.particles.mass, stressed, self._ground, self._settings)
        if stressed and len(self._faces):
            last = self._arrays.face_yields[step % 2]
            press_faces(last, step, place, np.asarray(stress), self._barriers, self._faces, self._settings)

    def _yield_state(self):
        """Return the yield of the ground after the last step, at the node columns below the flow."""
        last = self.arrays.yields[self.step % 2]
        columns = np.flatnonzero(last[..., YIELD_STEP] == self.step + 1)
        return dict(zip(YIELD_STATE, (columns, last[..., YIELD].ravel()[columns]), strict=True))

    def _keeps(self, name):
        return {"barriers": bool(self.walls), "face_yields": len(self._faces) > 0}.get(name, True)

    @property
    def _keeps_peaks(self):
        return self.numerics.maxima

    def _shapes_of_parts(self, count):
        return {"rows": (self._real, (count, self._arrays.rows.shape[1])), "keys": (np.int64, (count,))}

    def _require_state(self, frame, changing):
        require_point_state(frame, self, changing)

    def _restore_own(self, state):
        count, (columns, yields) = len(state["rows"]), (state[name] for name in YIELD_STATE)
        keys, all_yields = self._arrays.keys[:count], self._arrays.yields
        keys[:] = state["keys"]
        all_yields[:] = 0.0
        last = all_yields[self.step % 2].reshape(-1, YIELD_ENTRIES)
        last[columns, YIELD], last[columns, YIELD_STEP] = yields, self.step + 1
        window_of(keys, self._lowest, self._counts[entry.WINDOW_FIRST :])
        self._stress, self._affine = state.get("stress"), state.get("affine")

    def insert(self, frame: "Frame", stress: np.ndarray | None = None, affine: np.ndarray | None = None) -> None:
        """Insert the points of a frame with their stress and velocity gradient, as at a start.

        They count in the mass, momentum and energy of the start.

        Parameters
        ----------
        frame : Frame
        stress : float64[n, 6], optional [Pa]
        affine : float64[n, 3, 3], optional [s-1]

        Raises
        ------
        SceneError
            Points outside the terrain.
        """
        self._before_change()
        new = copy(self)
        new._affine = None if affine is None else np.asarray(affine, float)
        sizes = self._sizes(len(frame.particles))
        new._make_arrays({**dict.fromkeys(sizes, 1), **{name: sizes[name] for name in OF_POINTS}}, self._real)
        new._load(replace(frame, time=self.time), stress)
        if self.particles:
            if self._stress is None:
                new._clock[entry.STEP_NOW] = self._clock[entry.STEP_NOW]
                new._give_impulses()
            else:  # no step is chosen yet
                gradients = [
                    np.zeros((len(some._stress), 3, 3)) if some._affine is None else some._affine
                    for some in (self, new)
                ]
                self._affine = np.concatenate(gradients)
                self._stress = np.concatenate([self._stress, new._stress])
            self._append(new)
        else:
            points, self._order = new._arrays, new._order
            self._arrays = self._arrays._replace(rows=points.rows, ids=points.ids, keys=points.keys)
            self._stress, self._affine = new._stress, new._affine
            self._counts[entry.ROWS] = len(frame.particles)
            self._counts[entry.WINDOW_FIRST :] = new._counts[entry.WINDOW_FIRST :]
        self._press_contacts(frame, stress)
        clock = self._clock
        self._counts[entry.ALIVE] += len(frame.particles)
        clock[[entry.TOTAL_MASS, entry.MASS_NOW]] += new.mass_start
        clock[entry.LIFTED_MASS] += new._clock[entry.LIFTED_MASS]
        for largest in (entry.FASTEST, entry.SHEAR, entry.HIGHEST, entry.START_SPEED):
            clock[largest] = max(clock[largest], new._clock[largest])
        for largest, place in (
            (entry.SPEED_WORST, range(entry.FASTEST_X, entry.FASTEST_TIME + 1)),
            (entry.SPEED_P999, [entry.SPEED_P999_TIME]),
            (entry.DEEPEST, range(entry.DEEPEST_X, entry.DEEPEST_TIME + 1)),
        ):
            if new._clock[largest] > clock[largest]:
                noted = [largest, *place]
                clock[noted] = new._clock[noted]
        self.mass_start += new.mass_start
        self._heaviest = max(self._heaviest, new._heaviest)
        self._update_mass_limits()
        self.energy_start = tuple(a + b for a, b in zip(self.energy_start, new.energy_start, strict=True))
        self._energy_whole += new._energy_whole
        self._momentum_start = self._momentum_start + new._momentum_start

    def _append(self, new):
        """Append rows, ids and keys of the solver `new` to those of this one."""
        counts, count = self._counts, len(new._order)
        first = int(counts[entry.ROWS])
        self._require_room(first + count)
        for name in ("rows", "ids", "keys"):
            getattr(self._arrays, name)[first : first + count] = getattr(new._arrays, name)
        counts[entry.ROWS] += count
        window, others = (some[entry.WINDOW_FIRST :] for some in (counts, new._counts))
        window[:] = np.where(np.arange(len(window)) < EAST, np.minimum(window, others), np.maximum(window, others))

    def started(self) -> dict[str, Any]:
        """Return the numbers of the start that the solver counts from, as plain numbers (see `start_from`)."""
        momentum = {"momentum": self._momentum_start.tolist()}
        return super().started() | momentum | {"energy_whole": self._energy_whole, "heaviest": self._heaviest}

    def start_from(self, started: dict[str, Any]) -> None:
        """Count from the start of another solver: this one was made of a later frame of the same run.

        Parameters
        ----------
        started : dict
            Result of its `started`.
        """
        super().start_from(started)
        self._momentum_start, self._energy_whole = np.array(started["momentum"]), started["energy_whole"]
        self._heaviest = started.get("heaviest", self._heaviest)  # such points may have left since
        self._update_mass_limits()
