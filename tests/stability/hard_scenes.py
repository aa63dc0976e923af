"""Difficult scenes for the solvers, and the conditions that each run must satisfy.

There are few kinds of laws, so that few variants of the solvers are compiled: columns with Voellmy friction on curved
ground, points of a Drucker-Prager material and of a fluid, each on ground with Coulomb friction.
"""

from dataclasses import replace

import numpy as np
from column_scenes import columns_of, solver_on, terrain_of
from point_scenes import points_on

from mpmgis.conversion.initial_points import point_options, points_from
from mpmgis.conversion.initial_stress import stress_of_weight
from mpmgis.laws.curvature import CURVATURE
from mpmgis.laws.friction import friction_law
from mpmgis.laws.ground_metric import SLOPE
from mpmgis.laws.quantities import GRAVITY as G
from mpmgis.solvers.columns import column_loop as column_kernel
from mpmgis.solvers.columns import column_rows
from mpmgis.solvers.columns.node_grid import ColumnGrid
from mpmgis.solvers.points import point_loop as point_kernel
from mpmgis.solvers.points.point_numerics import LONE_SHARE, courant_number
from mpmgis.solvers.points.point_solver import PointSolver

NO_DRAG = 1e12  # xi [m s-2] with which Voellmy's law is Coulomb's: one compiled solver for both
ROUNDING = 1e-9
STEPPING = 1e-3  # share of the energy that velocities and places half a step apart may show; measured 8e-4
RINGING = 4e-3  # the same for points close to the time step at which their oscillation grows; measured 2.8e-3
CLOSE = 0.8  # share of that limit from which on steps are close to it
EDGES = 0.06  # the same for columns that are turned over edges of tens of metres: H2's bound on U^2 has a margin of 5 %
SPEED_SLACK = 1.05  # of H2's bound on U^2
# Share of the momentum that may be missing, and its growth per step: the momentum of a point is rounded once per step,
# by up to 6e-8 of it in single precision; measured 1.2e-8 per step, if each step has the same increment
ROUND_OFF = {"float64": (1e-10, 0.0), "float32": (1e-5, 6e-8)}
SPLASH = 6.0  # times H2's bound that U^2 of a point may reach where jets meet; measured 4.6 in 3600 random scenes
JETS, JET_SHARE = 2.0, 0.05  # times H2's bound, which at most this share of the mass exceeds; measured 0.024


def along_the_bed(frame, terrain, dx):
    """`frame` with its velocities turned up or down so that they are along the bed, as in a seed."""
    grid, p = ColumnGrid.on(terrain, dx), frame.particles
    x, y = p.position[:, 0] - grid.x0, p.position[:, 1] - grid.y0
    _, slope_x, slope_y = column_kernel.beds_at(grid.bed, x, y, dx)
    p.velocity[:, 2] = p.velocity[:, 0] * slope_x + p.velocity[:, 1] * slope_y
    return frame


def columns_on(height, frame, dx=5.0, length=200.0, width=100.0, mu=0.2, xi=NO_DRAG, **numerics):
    """Columns of `frame` over `height(x, y)` with Voellmy's friction, on a terrain of `length` x `width` [m]."""
    terrain = terrain_of(height, length, width, dx)
    frame = along_the_bed(frame, terrain, dx)
    return solver_on(terrain, frame, dx, friction_law("Voellmy", mu, xi), curvature=CURVATURE, **numerics)


def points_of_columns(height, columns, material, cell=1.0, length=40.0, width=20.0, mu=0.3, softening=None, **numerics):
    """The points that a run makes of `columns` over `height(x, y)`, two per side of a cell, with stress by weight."""
    terrain = terrain_of(height, length, width, cell)
    columns = along_the_bed(columns, terrain, cell)
    made = points_from(columns, terrain, point_options(cell, 2)).frame
    contact, weight = friction_law("Coulomb", mu), made.state["vertical_stress"]
    stress = stress_of_weight(made, terrain, weight, material, contact, cell, G)
    made.state.clear()
    return points_on(terrain, made, cell, material, contact, softening, stress, **numerics)


def stiff_for(drop):
    """Bulk modulus [Pa] for flows of 1000 kg/m3 that fall by `drop` [m]: rho (10 U)^2 with U of free fall."""
    return 1000.0 * 100.0 * 2.0 * G * drop


def close_to_limit(solver):
    """Whether the time step is close to the limit at which the oscillation of a single point grows."""
    numerics = solver.numerics
    asked = courant_number(solver.effects.material, numerics)
    return asked > CLOSE / LONE_SHARE * courant_number(solver.effects.material, replace(numerics, cfl=np.inf))


class Watch:
    """Compares sums and bounds of a solver with those of its start, at every check.

    Parameters
    ----------
    solver : ColumnSolver or PointSolver
        Before its first step.
    energy_gain : float [1]
        Share by which energy may grow.

    Attributes
    ----------
    speed_ratio, jet_share, gain : float
        Largest U^2 over H2's bound, largest share of the mass beyond JETS of it but for one point, and largest growth
        of the energy over what the flow had above the lowest ground.
    """

    def __init__(self, solver, energy_gain=STEPPING):
        self.solver, self.in_3d = solver, isinstance(solver, PointSolver)
        self.energy_gain = max(energy_gain, RINGING) if self.in_3d and close_to_limit(solver) else energy_gain
        self.round_off = ROUND_OFF[getattr(solver.numerics, "precision", "float64")]
        start = solver._start.particles
        height = solver.frame().particles.position[:, 2] + solver._start.origin[2]
        self.top = float(height.max() if self.in_3d else solver.bed_start.max())
        depth = float(np.ptp(height) + np.cbrt(start.volume.max()) if self.in_3d else start.thickness.max())
        self.bound = 4.0 * G * depth + float((start.velocity**2).sum(axis=1).max())
        self.speed_ratio, self.jet_share, self.gain = 0.0, 0.0, -np.inf

    def march(self, end, looks=8, slices=1 << 40, may_end=()):
        """Advance to `end` [s] with checks at equal times; returns the last reason; `may_end`: other valid reasons."""
        kernel = point_kernel if self.in_3d else column_kernel
        times = self.solver.time + (end - self.solver.time) * np.arange(1, looks + 1) / looks
        for until, after in zip(times, (*times[1:], np.inf), strict=True):
            code = kernel.RUNNING
            while code == kernel.RUNNING:
                more = {"after": after} if self.in_3d else {}
                code = self.solver.advance(until, max_steps=slices, **more)
            assert code in (kernel.REACHED_TIME, kernel.ALL_LEFT, *may_end), f"the solver came back with {code}"
            self.look()
            if code != kernel.REACHED_TIME:
                break
        return code

    def look(self):
        """Check: no NaN, mass and momentum to round-off, energy at most that of the start, speed within H2's bound."""
        particles, balances = self.look_at_sums()
        self._look_at_energy(balances)
        if len(particles):
            self._look_at_speed(particles)

    def look_at_sums(self):
        """Check: no NaN, mass and momentum to round-off; returns (particles, balances)."""
        particles, balances = self.solver.frame().particles, self.solver.balances()
        for name, values in particles.arrays().items():
            assert np.isfinite(values).all(), name
        assert (particles.volume > 0.0).all() and (particles.mass > 0.0).all()
        assert self.in_3d or (particles.area > 0.0).all()
        assert abs(balances["mass_error_relative"]) <= 1e-12
        if self.in_3d and balances["mass_lifted_onto_ground"] == 0.0:
            at_once, a_step = self.round_off
            assert balances["momentum_error_relative"] <= at_once + a_step * self.solver.step
        return particles, balances

    def _look_at_energy(self, balances):
        """Check: the energy of the flow and of the mass that has left is at most that at the start.

        Points that are moved back onto the ground gain height; mass that has left has the height of the previous step.
        """
        lost, dx = balances["energy_lost"], self.solver.numerics.cell_size
        if self.in_3d:
            lost += balances["mass_lifted_onto_ground"] * G * 10.0 * dx
        else:
            steepest = np.hypot(self.solver.grid.gradient[..., 0], self.solver.grid.gradient[..., 1]).max()
            lost += self._not_stored() + balances["mass_out"] * G * 0.5 * dx * steepest
        drop = balances["mass_start"] * G * (self.top - float(self.solver.grid.bed.min()) + self.bound / G)
        self.gain = max(self.gain, -lost / drop)
        assert self.gain <= self.energy_gain

    def _not_stored(self):
        """Energy [J] of the height of columns without work: on a slope, pressure does cos^4 of it along the fall line.

        The solver counts m g h / 2; a column that is squeezed along the slope takes m g c^4 h / 2, which is a fiftieth
        of that at 68 degrees.
        """
        solver = self.solver
        if solver.effects.metric != SLOPE:
            return 0.0
        rows, _, _ = solver._alive()
        mass, density = rows[:, column_rows.MASS], solver.numerics.density
        steep2 = 1.0 + rows[:, column_rows.GX] ** 2 + rows[:, column_rows.GY] ** 2
        height = mass / (density * rows[:, column_rows.AREA])
        return float((0.5 * mass * G * height * (1.0 - steep2**-2.0)).sum())

    def _look_at_speed(self, particles):
        """Check: U^2 <= 1.05 (2 g (highest bed of the release - z) + 4 g h_max + U^2 at the start) (H2) of each column.

        Points exchange energy, so that a small part of them may be faster.
        """
        height = particles.position[:, 2] + self.solver._start.origin[2]
        speed2 = (particles.velocity**2).sum(axis=1)
        allowed = 2.0 * G * np.maximum(self.top - height, 0.0) + self.bound
        ratio = speed2 / np.maximum(allowed, 1e-12)
        self.speed_ratio = max(self.speed_ratio, float(ratio.max()))
        assert self.speed_ratio <= (SPLASH if self.in_3d else SPEED_SLACK) * (1.0 + ROUNDING)
        mass = particles.mass
        self.jet_share = max(self.jet_share, float((mass[ratio > JETS].sum() - mass.max()) / mass.sum()))
        assert self.jet_share <= JET_SHARE


def box_of_columns(thickness, west, east, south, north, spacing, velocity=(0.0, 0.0)):
    """Columns on a rectangle, at least one: if it is narrower than `spacing`, the column is as wide as it."""
    spacing = min(spacing, east - west, north - south)
    east, north = (low + spacing * int((high - low) / spacing + 1e-9) for low, high in ((west, east), (south, north)))
    return columns_of(thickness, west, east, south, north, spacing, velocity=velocity)


def in_the_map(solver):
    """float64[n, 3] [m]: map coordinates and heights of the particles, in the order of their ids."""
    frame = solver.frame()
    return frame.particles.position[np.argsort(frame.particles.id)] + frame.origin
