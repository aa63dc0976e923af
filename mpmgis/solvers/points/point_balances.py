"""Mass, energy, speeds and places of the points of a 3D run, and its balances."""

from typing import Any

import numpy as np

from ...compiled.particle_slices import in_slices
from ...frames.flow_end import END_TIME, FLOWING_SHARE, NEARLY_AT_REST, NOTHING_LEFT, REST_ENERGY, moving_share
from ...frames.outflow_places import left_places
from ...frames.particle_store import EDGE_NAMES, EnergyLook, Flow, ParticleStore, least_kinetic, named_sums
from ...laws.material_choice import follows_density
from ...terrain.elevation import bilinear
from . import point_rows as row
from . import point_sums as sums
from . import point_time_step as entry
from .point_arrays import KINETIC_MOST, LOW_SINCE
from .point_barriers import IMPULSE_X, IMPULSE_Z
from .point_blocks import places_of

LEDGER = (  # outflow over an edge
    "mass",  # [kg]
    "momentum_east",  # [kg m s-1]
    "momentum_north",  # [kg m s-1]
    "momentum_up",  # [kg m s-1]
    "kinetic_energy",  # [J]
    "potential_energy",  # [J] relative to the lowest level
    "particles",  # number of points
)
BARRIER_SUMS = (  # sums of the loads on a barrier
    "normal_impulse",  # [N s] into its faces
    "impulse_east",  # [N s]
    "impulse_north",  # [N s]
    "impulse_up",  # [N s]
    "moment_impulse_east",  # [N m s] about its foot
    "moment_impulse_north",  # [N m s]
    "moment_impulse_up",  # [N m s]
    "overtopped_mass",  # [kg] that passed above its crest
    "peak_normal_force",  # [N] largest force into its faces in a single step
)
REST_SECONDS = 2.0  # [s] for which it must be at rest before the run ends
STOPPED_AT_REST = 100  # reason to end, in addition to those of the kernel
END_REASONS = {entry.REACHED_TIME: END_TIME, STOPPED_AT_REST: NEARLY_AT_REST, entry.ALL_LEFT: NOTHING_LEFT}
LOSSES = {  # energy losses of a flow, and their clock entries
    "ground": entry.GROUND_LOSS,
    "barriers": entry.BARRIER_LOSS,
    "yielding": entry.PLASTIC_LOSS,
    "affine_limit": entry.LIMIT_LOSS,
    "layers": entry.LAYER_LOSS,
}
CLIPS = {  # limits on the state of points, and the clock entries that count the point-steps in which they acted
    "lifted_onto_ground": entry.LIFTED_TOTAL,
    "stretch_held": entry.STRETCH_TOTAL,
    "held_at_walls": entry.WALL_TOTAL,
    "affine_velocity": entry.LIMITED_TOTAL,
}
FASTEST_SHARE = 1e-3  # [1] share of the mass that is faster than the 99.9th percentile of the speed
ROUNDING = 1e-9  # [1] relative rounding error of a sum of masses


def exceeded_by(share: float, values: np.ndarray, mass: np.ndarray) -> float:
    """Find the smallest of `values` that at most a share of the mass exceeds; 0 without values.

    Parameters
    ----------
    share : float [1]
    values : float64[n]
    mass : float64[n] [kg]
    """
    n, count = len(values), int(2.0 * share * len(values)) + 1
    if n == 0:
        return 0.0
    allowed = share * float(mass.sum()) * (1.0 + ROUNDING)
    while True:
        largest = np.argpartition(values, n - count)[n - count :]
        if count == n or float(mass[largest].sum()) > allowed:
            break
        count = min(2 * count, n)
    falling = largest[np.argsort(-values[largest], kind="stable")]
    return float(values[falling[int(np.searchsorted(np.cumsum(mass[falling]), allowed, side="right"))]])


class PointBalances(ParticleStore):
    """Quantities of the points of a run, from their rows and its clock; the base of `point_solver.PointSolver`.

    Rest is checked only at the times of frames, so that a restart gives the same.
    """

    RUNNING, REACHED_TIME = entry.RUNNING, entry.REACHED_TIME
    ALL_LEFT, TRIGGER_REACHED = entry.ALL_LEFT, None
    END_REASONS, AT_REST = END_REASONS, (STOPPED_AT_REST,)

    @property
    def speed_max(self) -> float:
        """Largest speed now [m s-1]."""
        return float(self._clock[entry.SPEED_NOW])

    @property
    def mach(self) -> float:
        """Largest speed so far over that of pressure waves [1]."""
        return float(self._clock[entry.SPEED_WORST] / self._settings.signal_speed)

    @property
    def kinetic_peak(self) -> float:
        """Largest kinetic energy [J] over the calls of `resting_for`."""
        return float(self._arrays.rest[KINETIC_MOST])

    def resting_for(self, share: float) -> float:
        """Return how long the kinetic energy has been below a share of its peak, at the calls of this method [s].

        Parameters
        ----------
        share : float [1]
        """
        rest, kinetic = self._arrays.rest, float(self._sums()[sums.KINETIC])
        rest[KINETIC_MOST] = max(rest[KINETIC_MOST], kinetic)
        if kinetic >= share * rest[KINETIC_MOST]:
            rest[LOW_SINCE] = -1.0
        elif rest[LOW_SINCE] < 0.0:
            rest[LOW_SINCE] = self.time
        return self.time - rest[LOW_SINCE] if rest[LOW_SINCE] >= 0.0 else 0.0

    def _places(self, rows, keys):
        """Compute the places of points, float64[n, 3] [m], from the corner of the domain at its lowest level."""
        return places_of(rows, keys, self.numerics.cell_size, self._lowest)

    def _map_places(self, rows, keys):
        """Compute the places of points on the map, float64[n, 2] [m]."""
        return self._places(rows, keys)[:, :2] + (self.grid.x0, self.grid.y0)

    def _height_under(self, place):
        """Compute the ground height at places [n, 2] from the corner of the domain, between nodes, float64[n] [m]."""
        x, y = (place / self.numerics.cell_size + row.GHOSTS).T
        return bilinear(self._ground[..., 0], y, x)

    def _sums(self):
        """Return the sums over the points now, float64[SUMS], see `point_sums`."""
        return self._once("sums", self._summed)

    def _summed(self):
        rows, _, keys = self._seen()
        numerics, material = self.numerics, self.effects.material

        def of(some):
            return sums.sums_of(
                rows[some], keys[some], self._lowest, numerics.cell_size, numerics.gravity, numerics.density, material
            )

        return sum(in_slices(of, len(rows)), np.zeros(sums.SUMS))

    def _mass_now(self):
        """Return the mass [kg] on the terrain, summed as that at the start."""
        return self._once("mass", lambda: float(self._seen()[0][:, row.MASS].sum(dtype=float)))

    def _speeds(self):
        """Return the speeds of the points now, float64[n] [m s-1]."""
        rows = self._seen()[0]
        return np.concatenate([np.zeros(0), *in_slices(lambda some: sums.speeds_of(rows[some]), len(rows))])

    def _speed_p999(self):
        """Return the speed [m s-1] that 0.1 % of the mass exceeds now."""
        return self._once("p999", self._computed_p999)

    def _computed_p999(self):
        mass = self._seen()[0][:, row.MASS].astype(float)
        return exceeded_by(FASTEST_SHARE, self._speeds(), mass)

    def _note_start(self, place, speed, mass):
        """Record the fastest point, the highest point and the largest thickness at a start; `place` is [n, 3] [m]."""
        clock = self._clock
        if not len(speed):
            return
        k = int(np.argmax(speed))
        clock[entry.FASTEST_X : entry.FASTEST_TIME + 1] = *place[k], self.time
        clock[[entry.SPEED_WORST, entry.START_SPEED]] = speed[k]
        clock[entry.HIGHEST] = place[:, 2].max()
        clock[entry.DEEPEST] = 0.0
        self._note_thickness()
        clock[[entry.SPEED_P999, entry.SPEED_P999_TIME]] = exceeded_by(FASTEST_SHARE, speed, mass), self.time

    def at_frame(self, code: int) -> int:
        """Return STOPPED_AT_REST if the points are at rest at the time of a frame, else `code`.

        Parameters
        ----------
        code : int
            Reason of the kernel to stop.
        """
        self.note_deepest()
        return reason_at_rest(self, code)

    def note_deepest(self) -> None:
        """Record a new largest thickness and a new largest 99.9th percentile of the speed, which a restart needs."""
        if self.particles:
            self._note_thickness()
            speed = self._speed_p999()
            if speed > self._clock[entry.SPEED_P999]:
                self._clock[[entry.SPEED_P999, entry.SPEED_P999_TIME]] = speed, self.time

    def _note_thickness(self):
        """Record a new largest thickness of the points.

        The vertical thickness [m] is mass over density and the area of a cell, linear between the centres of cells.
        """
        clock, dx, (rows, _, keys) = self._clock, self.numerics.cell_size, self._seen()
        ends = np.array(in_slices(lambda some: sums.cells_of(rows[some], keys[some]), len(rows)))
        west, south, east, north = *ends[:, :2].min(axis=0), *ends[:, 2:].max(axis=0)
        held = np.zeros((north - south + 1, east - west + 1))
        sums.spread_masses(rows, keys, west, south, held)
        j, i = np.unravel_index(np.argmax(held), held.shape)
        thickness = held[j, i] / (self.numerics.density * dx * dx)
        if thickness > clock[entry.DEEPEST]:
            place = (west + i + 0.5) * dx, (south + j + 0.5) * dx
            clock[entry.DEEPEST : entry.DEEPEST_TIME + 1] = thickness, *place, self.time

    def flow(self) -> Flow:
        """Return the present `Flow`; its depth is that of the mass in each cell, spread over the cell."""
        frame, grid = self.frame(), self.grid
        (x, y), particles, dx = frame.map_xy(), frame.particles, grid.cell_size
        column, line = ((place / dx).astype(np.int64) for place in grid.from_corner(frame))
        cell = line * (grid.inside.shape[1] + 1) + column
        depth = np.bincount(cell, particles.mass)[cell] / (self.numerics.density * dx * dx)
        speed = np.sqrt((particles.velocity**2).sum(axis=1))
        return Flow(x, y, particles.velocity[:, 0], particles.velocity[:, 1], speed, depth, particles.mass)

    def energy(self) -> tuple[float, float, float]:
        """Return kinetic, potential (from the lowest ground) and elastic energy of the points [J]."""
        return tuple(self._sums()[[sums.KINETIC, sums.POTENTIAL, sums.STORED]].tolist())

    def _energy_of_corrections(self):
        """Return the energy [J] that corrections of volumes have supplied; points keep that of the present one."""
        if not follows_density(self.effects.material):
            return 0.0
        return float(self._clock[entry.CORRECTION_ENERGY] + self._sums()[sums.OF_STATE] / self.numerics.density)

    def _turning_energy(self, mass):
        """Return the kinetic energy [J] of the initial velocity gradient inside the points, m (dx / 2)^2 |C|^2 / 2."""
        if self._affine is None:
            return 0.0
        reach2 = 0.25 * self.numerics.cell_size**2
        return float(0.5 * reach2 * (mass * (self._affine**2).sum(axis=(1, 2))).sum())

    def balances(self) -> dict[str, Any]:
        """Return mass, momentum, energy and outflow so far as plain numbers, with relative errors."""
        clock, ledger = self._clock, self.arrays.ledger
        mass_now, mass_out = self._mass_now(), float(ledger[:, 0].sum())
        kinetic, potential, stored = self.energy()
        momentum = self._sums()[sums.MOMENTUM_X : sums.MOMENTUM_Z + 1] + ledger[:, 1:4].sum(axis=0)
        given = clock[entry.IMPULSE_GROUND_X : entry.IMPULSE_GROUND_Z + 1].copy()
        given[:2] += clock[entry.IMPULSE_WALL_X : entry.IMPULSE_WALL_Y + 1]
        given[2] -= clock[entry.IMPULSE_GRAVITY]
        given -= self.arrays.barrier_sums[:, IMPULSE_X : IMPULSE_Z + 1].sum(axis=0)
        parts = clock[entry.IMPULSE_GROUND_X : entry.IMPULSE_GRAVITY + 1]  # sums may cancel, their rounding does not
        held = self._sums()[sums.MOMENTUM_ABS]
        corrected = self._energy_of_corrections()
        put_in = sum(self.energy_start) + clock[entry.LIFTED_ENERGY] + corrected
        energy_out = float(ledger[:, 4:6].sum())
        lost = float(put_in - kinetic - potential - stored - energy_out)
        lost_to = {name: float(clock[k]) for name, k in LOSSES.items()}
        passed = max(np.abs(parts).max(), np.abs(given).max(), np.abs(momentum).max(), held, 1e-300)
        return {
            "mass_start": self.mass_start,
            "mass_now": mass_now,
            "mass_out": mass_out,
            "mass_error_relative": (mass_now + mass_out - self.mass_start) / self.mass_start,
            "momentum_error_relative": float(np.abs(momentum - self._momentum_start - given).max() / passed),
            "ground_impulse": [float(part) for part in clock[entry.IMPULSE_GROUND_X : entry.IMPULSE_GROUND_Z + 1]],
            "outflow": {
                edge: left for edge, left in named_sums(EDGE_NAMES, ledger, LEDGER).items() if left["particles"] > 0
            },
            "left_places": left_places(self.grid, self.arrays.left_cells),
            "energy_start": sum(self.energy_start),
            "energy_lifted": float(clock[entry.LIFTED_ENERGY]),
            "energy_returned": float(clock[entry.RETURNED]),
            "energy_of_volume_corrections": corrected,
            "energy_out": energy_out,
            "kinetic_energy": kinetic,
            "kinetic_energy_peak": max(kinetic, self.kinetic_peak),
            "potential_energy": potential,
            "elastic_energy": stored,
            "energy_lost": lost,
            **{f"energy_lost_to_{name}": joules for name, joules in lost_to.items()},
            "energy_lost_to_mixing": lost - sum(lost_to.values()),
            "ground_friction_work": float(clock[entry.FRICTION_LOSS]),
            "speed_max_now": self.speed_max,
            "speed_max": float(clock[entry.SPEED_WORST]),
            "speed_max_at": self._place_of(entry.FASTEST_X),
            "speed_max_time": float(clock[entry.FASTEST_TIME]),
            "speed_p999_now": self._speed_p999(),
            "speed_p999": float(clock[entry.SPEED_P999]),
            "speed_p999_time": float(clock[entry.SPEED_P999_TIME]),
            "speed_bound_ratio": self._speed_over_fall(),
            "thickness_max": float(clock[entry.DEEPEST]),
            "thickness_max_at": self._place_of(entry.DEEPEST_X),
            "thickness_max_time": float(clock[entry.DEEPEST_TIME]),
            "mach_max": self.mach,
            "particle_steps": int(clock[entry.POINT_STEPS]),
            "clips": {name: int(clock[k]) for name, k in CLIPS.items()},
            "volume_corrections": int(clock[entry.CORRECTED_TOTAL]),
            "point_steps_without_tension": int(clock[entry.TIP_TOTAL]),
            "point_steps_strained_far": int(clock[entry.FAR_TOTAL]),
            "mass_lifted_onto_ground": float(clock[entry.LIFTED_MASS]),
            "barriers": named_sums([wall.name for wall in self.walls], self.arrays.barrier_sums, BARRIER_SUMS),
        }

    def _speed_over_fall(self):
        """Return the ratio [1] of the largest speed to its bound.

        The bound is the speed of a free fall from the highest initial point with the largest initial speed.
        """
        clock = self._clock
        fall = max(clock[entry.HIGHEST] - clock[entry.FASTEST_Z], 0.0)
        bound = np.sqrt(2.0 * self.numerics.gravity * fall + clock[entry.START_SPEED] ** 2)
        return float(clock[entry.SPEED_WORST] / bound) if bound > 0.0 else 0.0

    def energy_look(self) -> EnergyLook:
        """Return the present `EnergyLook`.

        Energy added by moving points onto the ground is input, and so is what yielding ground and barriers give back:
        they took it from the flow before. Recorded losses count only as work: nodes also lose energy of the velocity
        gradients of points to the ground, which is not part of their kinetic energy.
        """
        kinetic, potential, stored = self.energy()
        out, taken = self.arrays.ledger[:, 4:6].sum(axis=0), sum(self._clock[k] for k in LOSSES.values())
        lifted, returned = self._clock[entry.LIFTED_ENERGY], self._clock[entry.RETURNED]
        corrected = self._energy_of_corrections()
        kinetic_in, potential_in, stored_in = self.energy_start
        made = kinetic + potential + stored + out.sum() - self._energy_whole - lifted - returned - corrected
        fall = potential_in + lifted - potential - out[1]
        least = least_kinetic(self.kinetic_peak, self.mass_start, self.numerics.gravity, self.numerics.cell_size)
        work = float(fall), stored - stored_in, float(taken), kinetic_in
        return EnergyLook(float(made), kinetic, least, work, self.time)

    def fastest(self) -> tuple[float, float, float]:
        """Return place E, N on the map [m] and speed [m s-1] of the fastest point."""
        rows, _, keys = self._seen()
        speeds = self._speeds()
        k = int(np.argmax(speeds))
        x, y = self._map_places(rows[k : k + 1], keys[k : k + 1])[0]
        return float(x), float(y), float(speeds[k])

    def highest(self) -> tuple[float, float, float]:
        """Return place E, N on the map [m] and height above the lowest ground [m] of the highest point."""
        rows, _, keys = self._seen()
        places = self._places(rows, keys)
        x, y, z = places[np.argmax(places[:, 2])]
        return float(x + self.grid.x0), float(y + self.grid.y0), float(z)

    def trouble(self, code: int) -> str:
        """Return a message with E and N about an error; '' for none.

        Parameters
        ----------
        code : int
            Reason of the kernel to stop.
        """
        if code == entry.SCATTERED:
            east, north, height = self.highest()
            what = (
                f"points fly up to {height:.0f} m above the lowest ground, too far apart for the cells; take larger "
                "cells, a smaller cfl or a stiffer material"
            )
        elif code == entry.NOT_FINITE_STATE:
            (east, north), bad = self._place_of(entry.BAD_AT_X), int(self._counts[entry.BAD])
            what = f"{bad} points have a place or speed that is not finite; take a smaller cfl"
        elif code == entry.LEAKED:
            east, north = self._lowest_place()
            share = self._clock[entry.LIFTED_MASS] / self._clock[entry.TOTAL_MASS]
            what = (
                f"points with {100 * share:.2g} % of the mass are more than a cell below the ground; take a smaller "
                "cfl, smaller cells or a stiffer material"
            )
        else:
            return ""
        return f"E {east:.1f} N {north:.1f}: {what}"

    def _lowest_place(self):
        """Return E, N [m] of the point nearest to the ground: one that was just moved onto it."""
        rows, _, keys = self._seen()
        places = self._places(rows, keys)
        place = places[:, :2]
        above = places[:, 2] - self._height_under(place)
        x, y = place[int(np.argmin(np.abs(above)))]
        return x + self.grid.x0, y + self.grid.y0


def reason_at_rest(solver: Any, code: int) -> int:
    """Return STOPPED_AT_REST if the points of a solver are at rest and may stop, else `code`.

    Parameters
    ----------
    solver : PointSolver or CoupledSolver
    code : int
        Reason of the kernel to stop.
    """
    if solver.resting_for(REST_ENERGY) < REST_SECONDS or not solver.numerics.stop_at_rest:
        return code
    flow = solver.flow()
    return STOPPED_AT_REST if moving_share(flow.mass, flow.speed) < FLOWING_SHARE else code
