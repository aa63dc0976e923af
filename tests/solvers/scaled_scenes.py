"""One scene in any size at any place: a slab on a strip of a slope that is as wide as itself."""

from typing import NamedTuple

import numpy as np
import shapely
from affine import Affine

from mpmgis.conversion.initial_points import point_options, points_from
from mpmgis.conversion.initial_stress import kirchhoff_stress
from mpmgis.laws.effect_slots import ColumnEffects, PointEffects
from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import drucker_prager
from mpmgis.seeding.column_seeding import seed_columns
from mpmgis.solvers.columns.column_solver import ColumnNumerics, ColumnSolver
from mpmgis.solvers.points.point_numerics import PointNumerics
from mpmgis.solvers.points.point_solver import PointSolver
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.release_parts import ReleaseArea, ReleasePart

LONG, WIDE, FALL = 24, 4, 0.5  # cells along and across the strip; tangent of its slope
SLAB = (4, 14)  # cells along the strip
DENSITY = 1500.0


class Scene(NamedTuple):
    """Cells of `cell` [m]; the strip's south-west corner at `east`, `north` [m], its foot `foot` [cells] high."""

    cell: float
    east: float = 0.0
    north: float = 0.0
    foot: int = 3

    def terrain(self):
        """The strip, in pixels of one cell."""
        cell = self.cell
        grid = Grid(None, Affine(cell, 0, self.east, 0, -cell, self.north + WIDE * cell), (WIDE, LONG))
        along = np.tile(LONG - 0.5 - np.arange(LONG), (WIDE, 1))
        return Terrain(grid, (self.foot + FALL * along) * cell)

    def release(self):
        """The slab's plan, four cells thick normal to the ground."""
        first, last = (self.east + cells * self.cell for cells in SLAB)
        plan = shapely.box(first, self.north, last, self.north + WIDE * self.cell)
        return ReleaseArea((ReleasePart("slab", plan, 4.0 * self.cell),))

    def seed(self, points="staggered", per_cell=4, **more):
        """Columns as a run seeds them, on the solver's own lattice."""
        terrain = self.terrain()
        west, _, _, upper = terrain.grid.bounds
        return seed_columns(
            terrain,
            self.release(),
            cell_size=self.cell,
            anchor=(west, upper),
            per_cell=per_cell,
            points=points,
            density=DENSITY,
            **more,
        )

    def points(self):
        """The slab's points, eight a cell, with the stress of their weight in the state."""
        return points_from(self.seed(), self.terrain(), point_options(self.cell, 2)).frame

    def column_solver(self):
        effects = ColumnEffects(friction=friction_law("Coulomb", 0.3))
        numerics = ColumnNumerics(self.cell, density=DENSITY, stop_at_rest=False)
        return ColumnSolver(self.seed(), self.terrain(), effects, numerics)

    def point_solver(self):
        """Sand whose pressure waves run at 30 sqrt(g cell)."""
        frame, bulk = self.points(), 900.0 * DENSITY * 9.81 * self.cell
        effects = PointEffects(drucker_prager(bulk, 0.6 * bulk, 35.0, 0.0), contact=friction_law("Coulomb", 0.3))
        stress = kirchhoff_stress(frame.state["vertical_stress"], bulk, 0.6 * bulk)
        return PointSolver(frame, self.terrain(), effects, PointNumerics(self.cell, density=DENSITY), stress)

    def in_cells(self, frame):
        """float64[n, 3]: places of the particles of `frame` from the strip's corner, in cells, by their ids."""
        corner = self.east, self.terrain().grid.transform.f
        x, y = frame.xy_from(*corner)
        up = frame.particles.position[:, 2] + (frame.origin[2] - self.foot * self.cell)
        place = np.column_stack([x, y + WIDE * self.cell, up])
        return place[np.argsort(frame.particles.id)] / self.cell

    def moved_by(self, seconds):
        """Time [s] in which this scene does what one with cells of 1 m does in `seconds` [s]."""
        return seconds * float(np.sqrt(self.cell))
