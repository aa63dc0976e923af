"""The 3D solver: its state, one call to advance it, its frames and its balances (design notes 4)."""

from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from ..errors import FormatError, SceneError
from ..fields import GRAVITY
from ..kernels import points as kernel
from ..kernels.jit import ready_threads
from ..kernels.point_blocks import EAST
from ..particles import Particles
from ..peaks import maxima_of, no_peaks, peaks_state, restore_peaks
from ..spatial.barriers import WIDENED_IN_3D, margin_in_3d, wall_nodes
from ..spatial.node_grid import ColumnGrid, bed_at_nodes
from ..spatial.outflow import left_places
from ..terrain.elevation import bilinear
from .ground_folds import folded_ground
from .particle_store import EnergyLook, Flow, ParticleStore, least_kinetic, named_sums
from .restart import LEFT_STATE, YIELD_STATE, require_point_state

EDGE_NAMES = ("west", "south", "east", "north", "nodata")
# of what left over an edge [kg, kg m s-1, J]; potential energy counts from elevation 0
LEDGER = ("mass", "momentum_east", "momentum_north", "momentum_up", "kinetic_energy", "potential_energy", "particles")
# of what a barrier took up: impulse into its faces and by axis [N s], moment about its foot [N m s], mass that passed
# above its crest [kg], and the largest force into its faces in a single step [N]
BARRIER_SUMS = (
    "normal_impulse", "impulse_east", "impulse_north", "impulse_up", "moment_impulse_east", "moment_impulse_north",
    "moment_impulse_up", "overtopped_mass", "peak_normal_force",
)  # fmt: skip
LOSSES = {  # what takes energy of a flow, and the clock's entry for it
    "ground": kernel.GROUND_LOSS,
    "barriers": kernel.BARRIER_LOSS,
    "yielding": kernel.PLASTIC_LOSS,
    "affine_limit": kernel.LIMIT_LOSS,
    "layers": kernel.LAYER_LOSS,
}
CLIPS = {  # what holds a point's state within bounds, and the clock's count of the point-steps that it acted on
    "lifted_onto_ground": kernel.LIFTED_TOTAL,
    "stretch_held": kernel.STRETCH_TOTAL,
    "held_at_walls": kernel.WALL_TOTAL,
    "affine_velocity": kernel.LIMITED_TOTAL,
}
LEAK_STOP = 1e-3  # share of the mass found more than a cell under the ground in one step, at which a run stops itself
LEAK_POINTS = 1.5  # times the heaviest point's mass: a single point is no leak, however few there are
STENCIL_CELLS = 27.0  # that a point weighs on: how far apart it is pulled is not known beyond them
LONE_SHARE = 0.85  # of the step at which a point on its own swings higher and higher; 0.95 bears no changes of the step
LEVEL_ROUNDING = 1e-12  # of an elevation in cells, by which it may miss a level of nodes
FASTEST_SHARE = 1e-3  # of the mass, left out of the speed that is reported beside the largest
_TIME = 1e-9  # share of a time by which it may be missed for rounding
PRECISIONS = {"float64": np.float64, "float32": np.float32}
NO_PLACES = np.zeros((1, 1, 1))  # for what is known by place where nothing is


@dataclass(frozen=True)
class PointNumerics:
    """How the points are marched; what is marched is in `PointEffects`.

    `cfl` counts up to what a point on its own bears, see `courant_number`.
    `clearance` [cells] is the height above the ground up to which a node on a fold of it (a cliff, a kink) touches it.
    `time_step` fixes the step [s] (None: by the Courant number). `stop_at_rest` is for a march to obey. `precision`
    is that of points and grid; sums, time and what is booked are float64 in any case. `maxima`: running peaks are kept,
    of flow at least `arrival_thickness` [m] thick.
    """

    cell_size: float
    cfl: float = 0.4
    edges: str = "open"
    gravity: float = GRAVITY
    density: float = 1000.0
    clearance: float = 0.5
    time_step: float | None = None
    stop_at_rest: bool = False
    precision: str = "float64"
    maxima: bool = False
    arrival_thickness: float = 0.05


def courant_number(material, numerics):
    """The Courant number [1] that is marched with: that of `numerics`, or what a point on its own bears.

    A point alone strains with the nodes round it, C' = -(4 / dx^2) tau / rho, and so swings at 2 / dx
    sqrt(max(3 K, 2 G) / rho), faster than a wave crosses cells; explicit steps are stable up to 2 over that, dx /
    sqrt(max(3 K, 2 G) / rho). Fluids bear 0.58, solids with G = 0.6 K 0.77: at 0.9 one such point on the ground had
    three times its energy after a second. Closer than LONE_SHARE, a change of the step's length sets off the swing: at
    0.95 of the limit a point on rough ground gained 1 % of its energy by two of them, at 0.85 nothing.
    """
    stiffest = max(3.0 * material.bulk_modulus, 2.0 * getattr(material, "shear_modulus", 0.0))
    lone = material.wave_speed(numerics.density) / np.sqrt(stiffest / numerics.density)
    return float(min(numerics.cfl, LONE_SHARE * lone))


def _level_under(bed, dx):
    """Elevation [m] of the highest level of nodes, multiples of `dx` [m], not above `bed`, or `bed` where it is one."""
    levels = bed / dx
    if abs(levels - np.rint(levels)) <= LEVEL_ROUNDING * max(1.0, abs(levels)):
        return bed
    return float(np.floor(levels) * dx)


def exceeded_by(share, values, mass):
    """The least of `values` [n] that at most a `share` [1] of the `mass` [n] exceeds; 0 without any."""
    n, count = len(values), int(2.0 * share * len(values)) + 1
    if n == 0:
        return 0.0
    allowed = share * float(mass.sum()) * (1.0 + _TIME)
    while True:
        largest = np.argpartition(values, n - count)[n - count :]
        if count == n or float(mass[largest].sum()) > allowed:
            break
        count = min(2 * count, n)
    falling = largest[np.argsort(-values[largest], kind="stable")]
    return float(values[falling[int(np.searchsorted(np.cumsum(mass[falling]), allowed, side="right"))]])


class PointSolver(ParticleStore):
    """Marches the points of `frame` over `terrain`.

    Parameters
    ----------
    frame : Frame
        Dimension 3, in the terrain's CRS.
    terrain : Terrain
    effects : PointEffects
    numerics : PointNumerics
    stress : float64[n, 6], optional [Pa]
        Kirchhoff stress of the points at the start: xx, yy, zz, xy, xz, yz; default none.
    zone_values : float64[rows, columns, k], optional
        Parameters of the contact law at the nodes, for `FrictionZones`.
    walls : sequence of Wall
        Rigid barriers, for `Barrier`; computed three cells thick at least.
    affine : float64[n, 3, 3], optional [s-1]
        Velocity gradient dv_i/dx_j that the points start with; default none.

    Raises
    ------
    SceneError
    """

    kernel = kernel

    def __init__(self, frame, terrain, effects, numerics, stress=None, zone_values=None, walls=(), affine=None):
        if frame.dimension != 3:
            raise SceneError("the 3D solver wants points (dimension 3), got columns; `mpmgis convert` makes points")
        self.effects, self.numerics, self._start = effects, numerics, frame
        self._real = PRECISIONS[numerics.precision]
        self._effects = effects._replace(material=self._in_precision(effects.material),
                                         softening=self._in_precision(effects.softening))  # fmt: skip
        grid = ColumnGrid.on(terrain, numerics.cell_size)
        self.grid = grid
        self._set_ground(frame)
        self._zone_values = NO_PLACES if zone_values is None else self._padded(zone_values)
        self.walls = tuple(walls)
        self._barriers = self._barrier_nodes() if self.walls else NO_PLACES
        self._barrier_sums = np.zeros((len(self.walls), kernel.POINT_BARRIER_SUMS + 1))
        self._peaks = no_peaks(self._ground.shape[:2], numerics.maxima)
        self._affine = None if affine is None else np.asarray(affine, float)
        self._load(frame, stress)
        self._press_ground(frame, stress)

    def _in_precision(self, law):
        """`law` with parameters of the points' precision: the compiler makes of float32 and float64 a float64."""
        return type(law)(*map(self._real, law))

    def _set_ground(self, frame):
        """Elevation above the domain's lowest level and slopes at all nodes that points can come near to."""
        grid, dx = self.grid, self.numerics.cell_size
        bed = bed_at_nodes(grid)
        self.floor = _level_under(float(bed.min()), dx)
        height = bed - self.floor
        deep = ndimage.maximum_filter(height, 3) - dx  # nobody above it is a cell under the ground
        self._ground = self._padded(np.dstack([height, grid.gradient, deep]))
        terrain_height = self._padded(grid.bed[..., None] - self.floor)[..., 0]
        self._known_ground = folded_ground(self._ground, terrain_height, dx, self.numerics.clearance)
        self._yields = np.zeros((2, *self._ground.shape[:2], kernel.YIELD_ENTRIES))
        self._lowest = kernel.lowest_blocks(self._ground[..., 0], dx)
        ny, nx = grid.inside.shape
        self._lengths = nx * dx, ny * dx

    def _barrier_nodes(self):
        """What node columns know of barriers, in the kernel's order; the arm is from the foot of each one's middle."""
        grid, floor = self.grid, self.floor
        x, y = grid.node_axes()
        bed = self._ground[kernel.GHOSTS - 1 : -kernel.GHOSTS - 1, kernel.GHOSTS - 1 : -kernel.GHOSTS - 1, 0]
        nodes = wall_nodes(self.walls, x, y, bed + floor, grid.cell_size, margin_in_3d, WIDENED_IN_3D)
        middle = np.zeros((len(self.walls) + 1, 3))
        for k, wall in enumerate(self.walls, 1):
            centre = wall.footprint.centroid
            foot = bed[np.argmin(np.abs(y - centre.y)), np.argmin(np.abs(x - centre.x))]
            middle[k] = centre.x, centre.y, foot
        at = middle[nodes.number]
        standing = (nodes.number > 0)[..., None]
        entries = np.dstack([
            nodes.normal, nodes.crest - floor, nodes.depth, nodes.mu, nodes.weight,
            x[None, :] - at[..., 0], y[:, None] - at[..., 1], at[..., 2], nodes.number,
            nodes.share, nodes.limit, nodes.side,
        ])  # fmt: skip
        return self._padded(np.where(standing, entries, 0.0))

    def _corner_from(self, origin):
        """float64[3] [m]: the corner that places count from, from the place `origin` (E, N, H) of the map."""
        return np.append(self.grid.corner_from(origin), self.floor - origin[2])

    @staticmethod
    def _padded(values):
        """`values` [ny + 3, nx + 3, k], from one node outside the domain's corner, continued to the kernel's ghosts."""
        before, after = kernel.GHOSTS - 1, kernel.GHOSTS + 1
        return np.ascontiguousarray(np.pad(values, ((before, after), (before, after), (0, 0)), mode="edge"))

    def _load(self, frame, stress):
        """The state of a run that starts with the points of `frame`."""
        particles, material, numerics = frame.particles, self.effects.material, self.numerics
        place = particles.position - self._corner_from(frame.origin)
        off = ~self.grid.covers(*place[:, :2].T)
        if off.any():
            x, y = (values[int(np.argmax(off))] for values in frame.map_xy())
            raise SceneError(
                f"{int(off.sum())} of {len(off)} points start outside the terrain's whole cells, the first at "
                f"E {x:.1f} N {y:.1f}; move them, use a larger DTM or set [terrain] fill_nodata = 'interpolate'"
            )
        n, row = len(particles), kernel.ROW_SHORT if material.state_count() <= 4 else kernel.ROW_LONG
        self._rows = np.zeros((n, row), self._real)
        self._ids = np.zeros(n, np.uint64)
        self._keys = np.zeros(n, np.int64)
        self._order = np.zeros(n, np.int32)
        self._ids[:] = particles.id if particles.id is not None else np.arange(n)
        self._clock, self._counts = np.zeros(kernel.CLOCK), np.zeros(kernel.COUNTS, np.int64)
        self._rest = np.array([0.0, -1.0])  # peak of the kinetic energy [J]; since when it is low [s], -1: it is not
        self._ledger = np.zeros((len(EDGE_NAMES), len(LEDGER)))
        self._left = self._no_mass_left(self.grid)
        self._counts[kernel.ROWS] = self._counts[kernel.ALIVE] = n
        self._clock[kernel.TIME] = frame.time
        self.mass_start = float(particles.mass.astype(self._real).sum(dtype=float))
        self._clock[kernel.TOTAL_MASS] = self._clock[kernel.MASS_NOW] = self.mass_start
        speed = np.sqrt((particles.velocity**2).sum(axis=1))
        self._clock[kernel.FASTEST] = speed.max(initial=0.0)
        if self._affine is not None:
            self._clock[kernel.SHEAR] = np.sqrt((self._affine**2).sum(axis=(1, 2)).max())
        self._heaviest = float(particles.mass.max(initial=0.0))
        self._settings = self._made_settings()
        self._whole_step = {name: getattr(self._settings, name) for name in ("cfl", "fixed_dt")}
        self._lay_on_ground(place, particles.mass)
        self._note_start(place, speed, particles.mass)
        rows = self._rows
        kernel.set_places(rows, self._keys, place, 1.0 / numerics.cell_size, self._lowest)
        rows[:, kernel.PX : kernel.PZ + 1] = particles.velocity * particles.mass[:, None]
        rows[:, kernel.MASS] = particles.mass
        self._stress = np.zeros((n, 6)) if stress is None else np.asarray(stress, float)
        for column, values in zip(kernel.STATE, material.state_at_stress(*self._stress.T), strict=True):
            if column < row:
                rows[:, column] = values
        kernel.window_of(self._keys, self._lowest, self._counts[kernel.WINDOW_FIRST :])
        self.energy_start = self.energy()
        self._energy_whole = sum(self.energy_start) + self._turning_energy(particles.mass)
        self._momentum_start = rows[:, kernel.PX : kernel.PZ + 1].sum(axis=0, dtype=float)

    def _note_start(self, place, speed, mass):
        """Note the fastest point, the highest and the deepest flow of a start with points at `place` [n, 3] [m]."""
        clock = self._clock
        if not len(speed):
            return
        k = int(np.argmax(speed))
        clock[kernel.FASTEST_X : kernel.FASTEST_TIME + 1] = *place[k], self.time
        clock[[kernel.SPEED_WORST, kernel.START_SPEED]] = speed[k]
        clock[kernel.HIGHEST] = place[:, 2].max()
        clock[kernel.DEEPEST] = 0.0
        self._note_thickness(place, mass)
        clock[[kernel.SPEED_P999, kernel.SPEED_P999_TIME]] = exceeded_by(FASTEST_SHARE, speed, mass), self.time

    def note_deepest(self):
        """Note where the flow is thicker now than at any look before, and the largest 99.9th percentile of its speed.

        Part of what a restart needs.
        """
        rows, _, keys = self._alive()
        if len(rows):
            self._note_thickness(self._places(rows, keys), rows[:, kernel.MASS])
            speed = self._speed_p999(rows)
            if speed > self._clock[kernel.SPEED_P999]:
                self._clock[[kernel.SPEED_P999, kernel.SPEED_P999_TIME]] = speed, self.time

    @staticmethod
    def _speed_p999(rows):
        """Speed [m s-1] that 0.1 % of the mass exceeds now."""
        mass = rows[:, kernel.MASS].astype(float)
        speed = np.sqrt((rows[:, kernel.PX : kernel.PZ + 1].astype(float) ** 2).sum(axis=1)) / mass
        return exceeded_by(FASTEST_SHARE, speed, mass)

    def _note_thickness(self, place, mass):
        """As `note_deepest`, of points at `place` [n, 3] [m].

        The thickness [m], vertical, is mass over density and the area of a cell, linear between the cells' centres.
        """
        clock, dx = self._clock, self.numerics.cell_size
        cell = place[:, :2] / dx - 0.5
        first = np.floor(cell).astype(np.int64)
        share = cell - first
        corner = first.min(axis=0)
        columns, rows = first.max(axis=0) - corner + 2
        held = np.zeros(rows * columns)
        for east, wx in ((0, 1.0 - share[:, 0]), (1, share[:, 0])):
            for north, wy in ((0, 1.0 - share[:, 1]), (1, share[:, 1])):
                at = (first[:, 1] - corner[1] + north) * columns + first[:, 0] - corner[0] + east
                held += np.bincount(at, mass * wx * wy, rows * columns)
        k = int(np.argmax(held))
        thickness = held[k] / (self.numerics.density * dx * dx)
        if thickness > clock[kernel.DEEPEST]:
            row, column = divmod(k, int(columns))
            east, north = (corner + np.array([column, row]) + 0.5) * dx
            clock[kernel.DEEPEST : kernel.DEEPEST_TIME + 1] = thickness, east, north, self.time

    def _lay_on_ground(self, place, mass):
        """Raise what lies more than a cell under the ground onto it, in `place` [n, 3], and book its `mass` as lifted.

        Points that stand on the DTM's own pixels may lie under the solver's ground, which is smooth over a cell. They
        are no leak, which would end the run in its first step.
        """
        surface = self._height_under(place[:, :2])
        under = place[:, 2] < surface - self.numerics.cell_size
        place[under, 2] = surface[under]
        self._clock[kernel.LIFTED_MASS] = mass[under].sum()

    def _leak_stop(self):
        """Share of the mass under the ground in one step at which a run stops itself: never that of a single point."""
        return max(LEAK_STOP, LEAK_POINTS * self._heaviest / max(self.mass_start, 1e-300))

    def _lone_thickness(self):
        """Largest thickness [m] that a single point makes at a node."""
        return float(kernel.LONE_SHARE * self._heaviest / (self.numerics.density * self.numerics.cell_size**2))

    def _with_heaviest(self):
        """Settings that depend on the heaviest point, anew."""
        self._settings = self._settings._replace(leak_stop=self._leak_stop(), lone_thickness=self._lone_thickness())

    def _made_settings(self):
        numerics, material, dx = self.numerics, self.effects.material, self.numerics.cell_size
        viscosity = float(material.viscosity())
        ny, nx = self.grid.inside.shape
        return kernel.Settings(
            dx=float(dx),
            density=float(numerics.density),
            gravity=float(numerics.gravity),
            cfl=courant_number(material, numerics),
            signal_speed=float(material.wave_speed(numerics.density)),
            viscous_limit=numerics.density * dx * dx / (6.0 * viscosity) if viscosity > 0.0 else np.inf,
            fixed_dt=float(numerics.time_step or 0.0),
            clearance=float(numerics.clearance * dx),
            cells_x=nx,
            cells_y=ny,
            leak_stop=self._leak_stop(),
            wall=numerics.edges == "wall",
            holes=not self.grid.inside.all(),
            keep_peaks=bool(numerics.maxima),
            arrival_thickness=float(numerics.arrival_thickness),
            lone_thickness=self._lone_thickness(),
            slack=0.0 if getattr(material, "shear_modulus", 0.0) else 1.0,
        )

    def _make_impulses(self, until, after):
        """The first step's length, and what the points' stress and velocity gradient give to the nodes in it."""
        clock = self._clock
        kernel.set_next_step(clock, self._counts, clock[kernel.TIME], until, after, self._settings)
        self._give_impulses()

    def _give_impulses(self):
        """What stress and velocity gradient give to the nodes in the next step, whose length is chosen."""
        clock, rows, dx = self._clock, self._rows, self.numerics.cell_size
        push = clock[kernel.STEP_NOW] * 4.0 / (dx * self.numerics.density) * rows[:, kernel.MASS]
        xx, yy, zz, xy, xz, yz = self._stress.T
        turning = (
            np.zeros((1, 3, 3)) if self._affine is None else self._affine * (dx * rows[:, kernel.MASS, None, None])
        )
        tensor = (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)
        for axis, column in enumerate((kernel.AXX, kernel.AXY, kernel.AXZ)):
            for k, part in enumerate(tensor[axis]):
                rows[:, column + k] = turning[:, k, axis] - push * part
        self._stress = self._affine = None

    @property
    def points(self):
        """Number of points on the terrain now."""
        return int(self._counts[kernel.ALIVE])

    @property
    def speed_max(self):
        """Largest speed now [m s-1]."""
        return float(self._clock[kernel.SPEED_NOW])

    @property
    def mach(self):
        """Largest speed so far over that of pressure waves [1]."""
        return float(self._clock[kernel.SPEED_WORST] / self._settings.signal_speed)

    @property
    def kinetic_peak(self):
        """Largest kinetic energy [J] over the calls of `resting_for`."""
        return float(self._rest[0])

    def resting_for(self, share):
        """For how long [s] the kinetic energy has been below `share` of its peak, over the calls of this."""
        rest, kinetic = self._rest, self._kinetic(self._alive()[0])
        rest[0] = max(rest[0], kinetic)
        if kinetic >= share * rest[0]:
            rest[1] = -1.0
        elif rest[1] < 0.0:
            rest[1] = self.time
        return self.time - rest[1] if rest[1] >= 0.0 else 0.0

    def advance(self, until, after=np.inf, max_steps=1 << 62):
        """March to time `until` [s] or for `max_steps`; answers the kernel's reason to come back.

        `after` [s] is the time that will be asked for next: the length of the step that follows `until` is chosen in
        the step before it.
        """
        if self._stress is not None:
            self._make_impulses(float(until), float(after))
        clock = self._clock
        if abs(clock[kernel.TIME] + clock[kernel.STEP_NOW] - until) > _TIME * max(1.0, abs(until)):
            clock[kernel.HITS] = 0.0  # the step was chosen to end at another time: that of a run's earlier end
        ready_threads()
        return kernel.advance(
            self._rows, self._ids, self._keys, self._order, self._clock, self._counts, self._ledger, self._left,
            self._barrier_sums, self._peaks, self._known_ground, self._lowest, self.grid.inside, self._zone_values,
            self._barriers, self._yields, float(until), float(after), int(max_steps), self._settings, self._effects,
            self._watched,
        )  # fmt: skip

    def _march_with(self, effects, places, walls):
        """Go on with other `effects`, `places` and `walls`; sums of barriers that stay are kept."""
        self.effects = effects
        self._effects = self._effects._replace(contact=effects.contact, zones=effects.zones, barrier=effects.barrier)
        zone_values = places.zone_values
        self._zone_values = NO_PLACES if zone_values is None else self._padded(zone_values)
        if self.walls != tuple(walls):
            self.walls = tuple(walls)
            self._barriers = self._barrier_nodes() if self.walls else NO_PLACES
            self._barrier_sums = np.zeros((len(self.walls), kernel.POINT_BARRIER_SUMS + 1))

    @classmethod
    def _on_kernel_nodes(cls, values):
        """`values` [ny + 3, nx + 3] on the nodes that blocks are made of."""
        return cls._padded(values[..., None])[..., 0]

    def _map_places(self, rows, keys):
        """float64[n, 2] [m]: map E, N of points."""
        return self._places(rows, keys)[:, :2] + (self.grid.x0, self.grid.y0)

    def _places(self, rows, keys):
        """float64[n, 3] [m] from the domain's corner at its lowest level."""
        return kernel.places_of(rows, keys, self.numerics.cell_size, self._lowest)

    @staticmethod
    def _kinetic(rows):
        """Kinetic energy [J]."""
        momentum = rows[:, kernel.PX : kernel.PZ + 1].astype(float)
        return float((0.5 * (momentum**2).sum(axis=1) / rows[:, kernel.MASS]).sum())

    def frame(self):
        """The points now, as a Frame."""
        rows, ids, keys = self._alive()
        start = self._start
        mass = rows[:, kernel.MASS].astype(float)
        velocity = rows[:, kernel.PX : kernel.PZ + 1] / mass[:, None]
        position = self._places(rows, keys) + self._corner_from(start.origin)
        volume = self._volumes(rows, mass)
        header = {"density": self.numerics.density, "cell_size": self.numerics.cell_size}
        return replace(
            start, particles=Particles(position, velocity, mass, volume, id=ids), time=self.time, step=self.step,
            dimension=3, solver="points", header=header, maxima=self.maxima(), state=self.state(),
        )  # fmt: skip

    def maxima(self):
        """Running peaks at the node columns that the flow reached, as a frame has them; empty where not asked for."""
        numerics, grid = self.numerics, self.grid
        if not numerics.maxima:
            return {}
        ny, nx = grid.inside.shape
        first = kernel.GHOSTS
        inner = self._peaks[first : first + ny + 1, first : first + nx + 1]
        return maxima_of(inner, grid.x0, grid.y0, grid.cell_size, numerics.arrival_thickness)

    def _volumes(self, rows, mass):
        """float64[n] [m3]: what each point fills; pulled apart without end, in the air alone, the cells of its stencil.

        The state itself is not held: only with all that a point was pulled apart by is it pushed back to bear load.
        """
        free = mass / self.numerics.density
        largest = np.maximum(free, STENCIL_CELLS * self.numerics.cell_size**3)
        return np.minimum(free * kernel.volume_ratios(rows, self.effects.material), largest)

    def state(self):
        """What a restart needs besides the frame's particles: the arrays that change, as they are."""
        rows, _, keys = self._alive()
        begun = {"stress": self._stress, "affine": self._affine}  # until the first step has made impulses of them
        state = {"rows": rows, "keys": keys} | {name: array for name, array in begun.items() if array is not None}
        state |= self._left_state() | self._watch_state() | self._yield_state()
        state |= peaks_state(self._peaks) if self.numerics.maxima else {}
        state |= {name: array.copy() for name, array in self._changing().items()}
        return state | {"counts": self._counts_of_rows()}

    @property
    def yields(self):
        """float64[2, rows, columns, YIELD_ENTRIES]: yield of the ground under node columns, of two steps."""
        return self._yields

    def _press_ground(self, frame, stress):
        """Ground under points that start with `stress` is in equilibrium too: it yields as under their weight.

        Without stress, both flow and ground take up the weight in the first steps. Ground that the flow touched
        already is left as it is; under points above the ground the next step finds no contact.
        """
        dx, settings = self.numerics.cell_size, self._settings
        place = frame.particles.position - self._corner_from(frame.origin)
        i, j = np.rint(place[:, :2].T / dx).astype(int) + kernel.GHOSTS
        last = self._yields[self.step % 2]
        shape = last.shape[:2]
        mass = np.bincount(np.ravel_multi_index((j, i), shape), frame.particles.mass, shape[0] * shape[1])
        mass = ndimage.maximum_filter(ndimage.uniform_filter(mass.reshape(shape), 3), 3)
        thickness = mass / (settings.density * dx**2)
        steep2 = 1.0 + (self._ground[..., 1:3] ** 2).sum(axis=-1)
        yields = kernel.LAYER * dx * settings.gravity * thickness / (steep2 * settings.signal_speed**2)
        new = (thickness > 0.0) & (last[..., kernel.YIELD_STEP] != self.step + 1)
        yields = np.zeros(shape) if stress is None else yields
        last[new, kernel.YIELD] = np.minimum(yields, kernel.MOST_YIELD * dx)[new]
        last[new, kernel.YIELD_STEP] = self.step + 1

    def _yield_state(self):
        """Where the ground yields after the last step, of the node columns under the flow."""
        last = self._yields[self.step % 2]
        columns = np.flatnonzero(last[..., kernel.YIELD_STEP] == self.step + 1)
        return dict(zip(YIELD_STATE, (columns, last[..., kernel.YIELD].ravel()[columns]), strict=True))

    def _restore_yields(self, state):
        """Go on with what `_yield_state` gave."""
        columns, yields = (state[name] for name in YIELD_STATE)
        self._yields[:] = 0.0
        last = self._yields[self.step % 2].reshape(-1, kernel.YIELD_ENTRIES)
        last[columns, kernel.YIELD], last[columns, kernel.YIELD_STEP] = yields, self.step + 1

    def _changing(self):
        """Name -> array of all that changes besides the rows, and that this scene has."""
        arrays = {"clock": self._clock, "counts": self._counts, "ledger": self._ledger, "rest": self._rest}
        return arrays | ({"barriers": self._barrier_sums} if self.walls else {})

    def restore(self, frame, known=False):
        """Go on from a `frame` of this run that carries its state: bitwise as if there had been no break.

        The state is checked unless it is `known`: one that never left this process.

        Raises
        ------
        FormatError
            No state in it, or the state of another run.
        """
        self._restore_watch(frame)
        state, ids, at = frame.state, frame.particles.id, f"t = {frame.time:g} s"
        if not {"rows", "keys", *LEFT_STATE, *YIELD_STATE, *self._changing()} <= set(state) or ids is None:
            raise FormatError(f"the frame at {at} carries no state to resume from; start with --overwrite")
        rows, n = state["rows"], len(ids)
        if rows.dtype != self._real or rows.shape != (n, self._rows.shape[1]) or n > len(self._rows):
            raise FormatError(f"the frame at {at} is of another scene; start with --overwrite")
        if any(state[name].shape != array.shape for name, array in self._changing().items()):
            raise FormatError(f"the frame at {at} is of another version of mpmgis; start with --overwrite")
        if not known:
            require_point_state(frame, self, self._changing(), self._rows)
        self._rows[:n], self._ids[:n], self._keys[:n] = rows, ids, state["keys"]
        for name, array in self._changing().items():
            array[:] = state[name]
        self._restore_left(state)
        self._restore_yields(state)
        if self.numerics.maxima:
            restore_peaks(self._peaks, state)
        self._counts[kernel.ROWS] = n
        kernel.window_of(self._keys[:n], self._lowest, self._counts[kernel.WINDOW_FIRST :])
        self._stress, self._affine = state.get("stress"), state.get("affine")

    def insert(self, frame, stress=None, affine=None):
        """Let the points of `frame` in, now, with their `stress` and velocity gradient as at a start.

        Mass, momentum and energy at the start count them as if they had been there.

        Raises
        ------
        SceneError
            Points off the terrain.
        """
        new = copy(self)
        new._affine = None if affine is None else np.asarray(affine, float)
        new._load(replace(frame, time=self.time), stress)
        if self.points:
            new._clock[kernel.STEP_NOW] = self._clock[kernel.STEP_NOW]
            new._give_impulses()
            self._append(new)
        else:  # nobody's step is chosen yet
            self._rows, self._ids, self._keys, self._order = new._rows, new._ids, new._keys, new._order
            self._stress, self._affine = new._stress, new._affine
            self._counts[kernel.ROWS] = len(frame.particles)
            self._counts[kernel.WINDOW_FIRST :] = new._counts[kernel.WINDOW_FIRST :]
        self._press_ground(frame, stress)
        clock = self._clock
        self._counts[kernel.ALIVE] += len(frame.particles)
        clock[[kernel.TOTAL_MASS, kernel.MASS_NOW]] += new.mass_start
        clock[kernel.LIFTED_MASS] += new._clock[kernel.LIFTED_MASS]
        for entry in (kernel.FASTEST, kernel.SHEAR, kernel.HIGHEST, kernel.START_SPEED):
            clock[entry] = max(clock[entry], new._clock[entry])
        if new._clock[kernel.SPEED_WORST] > clock[kernel.SPEED_WORST]:
            noted = [kernel.SPEED_WORST, *range(kernel.FASTEST_X, kernel.FASTEST_TIME + 1)]
            clock[noted] = new._clock[noted]
        if new._clock[kernel.SPEED_P999] > clock[kernel.SPEED_P999]:
            noted = [kernel.SPEED_P999, kernel.SPEED_P999_TIME]
            clock[noted] = new._clock[noted]
        if new._clock[kernel.DEEPEST] > clock[kernel.DEEPEST]:
            clock[kernel.DEEPEST : kernel.DEEPEST_TIME + 1] = new._clock[kernel.DEEPEST : kernel.DEEPEST_TIME + 1]
        self.mass_start += new.mass_start
        self._heaviest = max(self._heaviest, new._heaviest)
        self._with_heaviest()
        self.energy_start = tuple(a + b for a, b in zip(self.energy_start, new.energy_start, strict=True))
        self._energy_whole += new._energy_whole
        self._momentum_start = self._momentum_start + new._momentum_start

    def _append(self, new):
        """Rows, ids and keys of the solver `new` behind those of this one."""
        counts, count = self._counts, len(new._order)
        first = int(counts[kernel.ROWS])
        self._require_room(first + count)
        for mine, theirs in ((self._rows, new._rows), (self._ids, new._ids), (self._keys, new._keys)):
            mine[first : first + count] = theirs
        counts[kernel.ROWS] += count
        window, others = (some[kernel.WINDOW_FIRST :] for some in (counts, new._counts))
        window[:] = np.where(np.arange(len(window)) < EAST, np.minimum(window, others), np.maximum(window, others))

    def started(self):
        """Numbers of the start that the solver counts from, as plain numbers (see `start_from`)."""
        return {
            "mass": self.mass_start, "energy": list(self.energy_start), "momentum": self._momentum_start.tolist(),
            "energy_whole": self._energy_whole, "heaviest": self._heaviest,
        }  # fmt: skip

    def start_from(self, started):
        """Count from the start that `started()` told of: this solver was made of a later frame of the same run."""
        self.mass_start, self.energy_start = started["mass"], tuple(started["energy"])
        self._momentum_start, self._energy_whole = np.array(started["momentum"]), started["energy_whole"]
        self._heaviest = started.get("heaviest", self._heaviest)  # of points that may have left since
        self._with_heaviest()

    def flow(self):
        """The Flow now; as deep as what each cell holds would stand in it."""
        frame, grid = self.frame(), self.grid
        (x, y), particles, dx = frame.map_xy(), frame.particles, grid.cell_size
        column, row = ((place / dx).astype(np.int64) for place in grid.from_corner(frame))
        cell = row * (grid.inside.shape[1] + 1) + column
        depth = np.bincount(cell, particles.mass)[cell] / (self.numerics.density * dx * dx)
        speed = np.sqrt((particles.velocity**2).sum(axis=1))
        return Flow(x, y, particles.velocity[:, 0], particles.velocity[:, 1], speed, depth, particles.mass)

    def energy(self):
        """(kinetic, potential, elastic) energy [J] of the points now; potential counts from the lowest ground."""
        stored = kernel.stored_energy(self._alive()[0], self.numerics.density, self.effects.material)
        return *self._energy_of_motion(), float(stored)

    def _energy_of_motion(self):
        """(kinetic, potential) energy [J] of the points now."""
        rows, _, keys = self._alive()
        potential = rows[:, kernel.MASS] * self.numerics.gravity * self._places(rows, keys)[:, 2]
        return self._kinetic(rows), float(potential.sum())

    def balances(self):
        """Mass, momentum, energy and outflow so far, in plain numbers, with the checks a reader wants first."""
        rows, _, _ = self._alive()
        clock, ledger = self._clock, self._ledger
        mass_now, mass_out = float(rows[:, kernel.MASS].sum(dtype=float)), float(ledger[:, 0].sum())
        kinetic, potential, stored = self.energy()
        momentum = rows[:, kernel.PX : kernel.PZ + 1].sum(axis=0, dtype=float) + ledger[:, 1:4].sum(axis=0)
        given = clock[kernel.IMPULSE_GROUND_X : kernel.IMPULSE_GROUND_Z + 1].copy()
        given[:2] += clock[kernel.IMPULSE_WALL_X : kernel.IMPULSE_WALL_Y + 1]
        given[2] -= clock[kernel.IMPULSE_GRAVITY]
        given -= self._barrier_sums[:, kernel.IMPULSE_X : kernel.IMPULSE_Z + 1].sum(axis=0)
        parts = clock[kernel.IMPULSE_GROUND_X : kernel.IMPULSE_GRAVITY + 1]  # sums may cancel, their rounding does not
        held = np.abs(rows[:, kernel.PX : kernel.PZ + 1]).sum()
        put_in, energy_out = sum(self.energy_start) + clock[kernel.LIFTED_ENERGY], float(ledger[:, 4:6].sum())
        lost = float(put_in - kinetic - potential - stored - energy_out)
        lost_to = {name: float(clock[entry]) for name, entry in LOSSES.items()}
        passed = max(np.abs(parts).max(), np.abs(given).max(), np.abs(momentum).max(), held, 1e-300)
        return {
            "mass_start": self.mass_start,
            "mass_now": mass_now,
            "mass_out": mass_out,
            "mass_error_relative": (mass_now + mass_out - self.mass_start) / self.mass_start,
            "momentum_error_relative": float(np.abs(momentum - self._momentum_start - given).max() / passed),
            "ground_impulse": [float(part) for part in clock[kernel.IMPULSE_GROUND_X : kernel.IMPULSE_GROUND_Z + 1]],
            "outflow": {
                edge: sums for edge, sums in named_sums(EDGE_NAMES, ledger, LEDGER).items() if sums["particles"] > 0
            },
            "left_places": left_places(self.grid, self._left),
            "energy_start": sum(self.energy_start),
            "energy_lifted": float(clock[kernel.LIFTED_ENERGY]),
            "energy_out": energy_out,
            "kinetic_energy": kinetic,
            "kinetic_energy_peak": max(kinetic, self.kinetic_peak),
            "potential_energy": potential,
            "elastic_energy": stored,
            "energy_lost": lost,
            **{f"energy_lost_to_{name}": joules for name, joules in lost_to.items()},
            "energy_lost_to_mixing": lost - sum(lost_to.values()),
            "ground_friction_work": float(clock[kernel.FRICTION_LOSS]),
            "speed_max_now": self.speed_max,
            "speed_max": float(clock[kernel.SPEED_WORST]),
            "speed_max_at": self._place_of(kernel.FASTEST_X),
            "speed_max_time": float(clock[kernel.FASTEST_TIME]),
            "speed_p999_now": self._speed_p999(rows),
            "speed_p999": float(clock[kernel.SPEED_P999]),
            "speed_p999_time": float(clock[kernel.SPEED_P999_TIME]),
            "speed_bound_ratio": self._speed_over_fall(),
            "thickness_max": float(clock[kernel.DEEPEST]),
            "thickness_max_at": self._place_of(kernel.DEEPEST_X),
            "thickness_max_time": float(clock[kernel.DEEPEST_TIME]),
            "mach_max": self.mach,
            "particle_steps": int(clock[kernel.POINT_STEPS]),
            "clips": {name: int(clock[entry]) for name, entry in CLIPS.items()},
            "point_steps_without_tension": int(clock[kernel.TIP_TOTAL]),
            "point_steps_strained_far": int(clock[kernel.FAR_TOTAL]),
            "mass_lifted_onto_ground": float(clock[kernel.LIFTED_MASS]),
            "barriers": named_sums([wall.name for wall in self.walls], self._barrier_sums, BARRIER_SUMS),
        }

    def _place_of(self, entry):
        """[E, N] [m] of the place that the clock keeps from `entry` on."""
        return [float(self._clock[entry]) + self.grid.x0, float(self._clock[entry + 1]) + self.grid.y0]

    def _speed_over_fall(self):
        """Largest speed [1] over that of a free fall to its place from the highest point of the start, which also has
        the largest speed of the start."""
        clock = self._clock
        fall = max(clock[kernel.HIGHEST] - clock[kernel.FASTEST_Z], 0.0)
        bound = np.sqrt(2.0 * self.numerics.gravity * fall + clock[kernel.START_SPEED] ** 2)
        return float(clock[kernel.SPEED_WORST] / bound) if bound > 0.0 else 0.0

    def energy_look(self):
        """The EnergyLook now; what lifting onto the ground gave was put in.

        What was booked as lost counts as work alone: nodes lose to the ground also what points hold as their velocity
        gradient, which is not in their kinetic energy.
        """
        kinetic, potential, stored = self.energy()
        out, taken = self._ledger[:, 4:6].sum(axis=0), sum(self._clock[entry] for entry in LOSSES.values())
        lifted = self._clock[kernel.LIFTED_ENERGY]
        kinetic_in, potential_in, stored_in = self.energy_start
        made = kinetic + potential + stored + out.sum() - self._energy_whole - lifted
        fall = potential_in + lifted - potential - out[1]
        least = least_kinetic(self.kinetic_peak, self.mass_start, self.numerics.gravity, self.numerics.cell_size)
        work = float(fall), stored - stored_in, float(taken), kinetic_in
        return EnergyLook(float(made), kinetic, least, work, self.time)

    def _turning_energy(self, mass):
        """Kinetic energy [J] of the start's velocity gradient within the points, m (dx / 2)^2 |C|^2 / 2."""
        if self._affine is None:
            return 0.0
        reach2 = 0.25 * self.numerics.cell_size**2
        return float(0.5 * reach2 * (mass * (self._affine**2).sum(axis=(1, 2))).sum())

    def fastest(self):
        """Map E, N [m] and speed [m s-1] of the fastest point."""
        rows, _, keys = self._alive()
        speed = np.linalg.norm(rows[:, kernel.PX : kernel.PZ + 1], axis=1) / rows[:, kernel.MASS]
        x, y, _ = self._places(rows, keys)[np.argmax(speed)]
        return float(x + self.grid.x0), float(y + self.grid.y0), float(speed.max())

    def highest(self):
        """Map E, N and height above the lowest ground [m] of the highest point."""
        rows, _, keys = self._alive()
        places = self._places(rows, keys)
        x, y, z = places[np.argmax(places[:, 2])]
        return float(x + self.grid.x0), float(y + self.grid.y0), float(z)

    def trouble(self):
        """What stopped a run: map E and N, points that are not finite, share of the mass laid back onto the ground."""
        clock, (rows, _, keys) = self._clock, self._alive()
        bad = int(self._counts[kernel.BAD])
        x, y = clock[kernel.BAD_AT_X], clock[kernel.BAD_AT_Y]
        if not bad:
            places = self._places(rows, keys)
            place = places[:, :2]
            above = places[:, 2] - self._height_under(place)
            x, y = place[int(np.argmin(np.abs(above)))]  # who was just laid back lies on it exactly
        share = float(clock[kernel.LIFTED_MASS] / clock[kernel.TOTAL_MASS])
        return float(x) + self.grid.x0, float(y) + self.grid.y0, bad, share

    def _height_under(self, place):
        """float64[n] [m]: ground under places [n, 2] from the domain's corner, between its nodes."""
        column, row = (place / self.numerics.cell_size + kernel.GHOSTS).T
        return bilinear(self._ground[..., 0], row, column)
