"""Stage of a run: one solver with all its data, decided before the run starts, and its end conditions."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import shapely

from ..conversion.columns_to_points import columns_to_points
from ..conversion.initial_points import point_options
from ..conversion.initial_stress import stress_of_weight
from ..conversion.points_to_columns import unsettled_share
from ..conversion.solver_switch import switch_to_columns, switch_to_points
from ..scene.tables import CLIFF, CPU, WALLS, StageTable
from ..solvers.columns.column_solver import ColumnSolver
from ..solvers.columns.feature_arrays import Places
from ..solvers.columns.node_grid import ColumnGrid
from ..solvers.points.point_solver import PointSolver
from ..solvers.points.point_volume import point_volume
from ..system.errors import SceneError
from ..terrain.nodata_groups import NodataInReach
from ..terrain.spatial_inputs import read_area
from .coupled_solver import CoupledSolver
from .memory_need import require_memory_for_points
from .resolution import resolution_of
from .stage_end import CALM_NORMAL, Cliff, Near, StageEnd

if TYPE_CHECKING:
    from ..conversion.conversion_options import PointOptions
    from ..conversion.solver_switch import Switched
    from ..frames.particles import Frame
    from ..laws.effect_slots import ColumnEffects, PointEffects
    from ..scene import Scene, TerrainFacts
    from ..solvers.columns.column_solver import ColumnNumerics
    from ..solvers.features.walls import Wall
    from ..solvers.points.point_numerics import PointNumerics
    from ..solvers.points.point_volume import PointVolume
    from ..terrain.elevation import Terrain
    from .release_events import Events
    from .resolution import Resolution

WET_SHARE = 0.01  # of the release's thickness, below which there is no flow


@dataclass(frozen=True)
class Stage:
    """One part of a run.

    Parameters
    ----------
    scene : Scene
        Of this stage alone.
    grid : ColumnGrid
        Of the solver, in plan view.
    effects : ColumnEffects or PointEffects
    decisions : tuple of Decision
        On the effects.
    facts : TerrainFacts
        Numbers that decided the effects.
    numerics : ColumnNumerics or PointNumerics
    places : Places
        Spatial features that are on, on the grid.
    known_walls : tuple of Wall
        All barriers of the scene.
    table : StageTable or None
        Its [[stage]]; None: the scene has none.
    window : shapely.Geometry or None
        Area of the points.
    area : shapely.Geometry or None
        Area whose reach ends the stage.
    nodata : NodataInReach
        Cells without elevation in reach of the flow.
    device : str
        Computes its steps.
    """

    scene: "Scene"
    grid: ColumnGrid
    effects: "ColumnEffects | PointEffects"
    decisions: tuple
    facts: "TerrainFacts"
    numerics: "ColumnNumerics | PointNumerics"
    places: Places
    known_walls: tuple = ()
    table: StageTable | None = None
    window: shapely.Geometry | None = None
    area: shapely.Geometry | None = None
    nodata: NodataInReach = field(default_factory=NodataInReach)
    device: str = CPU

    @property
    def walls(self) -> "tuple[Wall, ...]":
        """The barriers that are on in 3D."""
        return self.known_walls if self.scene.solver == "points" and self.places.barrier_names else ()

    def words(self) -> str:
        """Return its solver, cell size and end conditions, in words."""
        ends = {"time": "t = {:g} s", "reach": "within reach of {}", "calm": "calm for {:g} s"}
        until = " or ".join(ends[key].format(value) for key, value in (self.table.until or {}).items())
        where = "" if self.window is None else f" in {self.table.window}"
        return f"{self.scene.solver}{where}, cells of {self.grid.cell_size:g} m, until {until or 'the end'}"

    def shapes(self) -> list[shapely.Geometry]:
        """Return its geometries other than `places`."""
        walls = [wall.footprint for wall in self.known_walls] if self.table is not None else []
        return [shape for shape in (self.window, self.area, *walls) if shape is not None]

    def solver(
        self,
        terrain: "Terrain",
        frame: "Frame",
        vertical_stress: np.ndarray | None = None,
        gradient: np.ndarray | None = None,
    ) -> ColumnSolver | PointSolver:
        """Return its solver at its start.

        Parameters
        ----------
        terrain : Terrain
        frame : Frame
        vertical_stress : float64[n], optional [Pa]
            Of points, from their weight.
        gradient : float64[n, k, k], optional [s-1]
            Velocity gradient; k is 3 for points.
        """
        if self.scene.solver == "points":
            stress = self.stress(terrain, frame, vertical_stress)
            return self._solver_class()(
                frame, terrain, self.effects, self.numerics, stress, self.places.zone_values, self.walls, gradient
            )
        return self._solver_class()(frame, terrain, self.effects, self.numerics, self.places, self.grid, gradient)

    def _solver_class(self):
        """Return the class of its solver, on its device."""
        if self.device == CPU:
            return PointSolver if self.scene.solver == "points" else ColumnSolver
        if self.scene.solver == "points":
            from ..solvers.gpu.device_point_solver import DevicePointSolver

            return DevicePointSolver
        from ..solvers.gpu.device_column_solver import DeviceColumnSolver

        return DeviceColumnSolver

    def stress(self, terrain: "Terrain", frame: "Frame", vertical_stress: np.ndarray | None) -> np.ndarray | None:
        """Return the Kirchhoff stress of points under their weight.

        Parameters
        ----------
        terrain : Terrain
        frame : Frame
            Of points.
        vertical_stress : float64[n] or None [Pa]

        Returns
        -------
        float64[n, 6] [Pa] or None
            None if `vertical_stress` is unknown.
        """
        if vertical_stress is None:
            return None
        return stress_of_weight(
            frame,
            terrain,
            vertical_stress,
            self.effects.material,
            self.effects.contact,
            self.grid.cell_size,
            self.numerics.gravity,
        )

    def end(self, terrain: "Terrain", following: "Stage | None") -> StageEnd:
        """Return the StageEnd with its end conditions.

        Parameters
        ----------
        terrain : Terrain
        following : Stage or None
            Next stage; None after the last.
        """
        if following is None:
            return StageEnd()
        until, least = self.table.until, WET_SHARE * self.facts.release_thickness
        walls = self._near_walls(least)
        reached = {WALLS: walls, CLIFF: Cliff(terrain)}.get(self.table.reach)
        if self.area is not None:
            reached = Near(f"the area of {self.table.reach}", self.area, least)
        calm = until.get("calm")
        if calm is None:
            return StageEnd(until.get("time"), reached)
        disturbing = [thing for thing in (walls, Cliff(terrain)) if thing is not None]
        cell = following.cell_of_columns(self.grid.cell_size)
        return StageEnd(
            until.get("time"),
            reached,
            calm,
            disturbing,
            lambda frame: unsettled_share(frame, terrain, cell, CALM_NORMAL),
        )

    def _near_walls(self, least):
        if not self.known_walls:
            return None
        names = ", ".join(f"'{wall.name}'" for wall in self.known_walls)
        return Near(f"barrier {names}", shapely.union_all([wall.footprint for wall in self.known_walls]), least)

    def cell_of_columns(self, point_cell: float) -> float:
        """Return the cell size for the conversion of points to columns of this stage.

        It gives as many columns per cell as the seeding, but is not smaller than a cell of the points' grid.

        Parameters
        ----------
        point_cell : float [m]
            Cell size of the points' grid.

        Returns
        -------
        float [m]
        """
        along = min(round(np.sqrt(self.scene.columns_per_cell)), int(self.grid.cell_size / point_cell + 1e-9))
        return self.grid.cell_size / max(along, 1)

    def switched_from(
        self, before: "Stage", frame: "Frame", terrain: "Terrain", beside: "Frame | None" = None
    ) -> "Switched":
        """Convert the flow of the stage before for this stage.

        Parameters
        ----------
        before : Stage
        frame : Frame
            Its flow.
        terrain : Terrain
        beside : Frame, optional
            Columns outside the window of `before`.

        Raises
        ------
        SceneError
            Too many points for the memory of this machine.
        """
        if self.scene.solver == "columns":
            cell = self.cell_of_columns(before.grid.cell_size)
            return switch_to_columns(frame, terrain, cell, self.grid.holds, beside, self.numerics.gravity, self._slopes)
        options = self.point_options()
        require_memory_for_points(options.predicted_points(frame.particles), options.cell)
        return switch_to_points(frame, terrain, options, self.grid.holds, self.window)

    def _slopes(self, columns):
        """float64[n, 2] [1]: gradient of its bed under a frame of columns; NaN off its grid."""
        slopes, held = np.full((len(columns.particles), 2), np.nan), self.grid.holds(columns)
        slopes[held] = self.grid.gradients_at(replace(columns, particles=columns.particles.take(held)))
        return slopes

    def resolution(self, columns: "Frame") -> "Resolution | None":
        """Return the Resolution on its grid of points; None if no column becomes a point.

        Parameters
        ----------
        columns : Frame
            Of columns that become points.
        """
        particles = columns.particles
        if self.window is not None:
            particles = particles.take(shapely.contains_xy(self.window, *columns.map_xy()))
        height = self.facts.barrier_height if self.walls else None
        return resolution_of(particles, self.grid.cell_size, height) if len(particles) else None

    def volume(self, points: "Frame", terrain: "Terrain") -> "PointVolume":
        """Return the PointVolume of its points.

        Parameters
        ----------
        points : Frame
        terrain : Terrain
        """
        x, y = points.map_xy()
        if not len(x):
            return point_volume(points, np.zeros(0), np.zeros(0), self.grid.cell_size, self.numerics.density)
        near = terrain.cropped((x.min(), y.min(), x.max(), y.max()), 2)
        height = points.particles.position[:, 2] + points.origin[2] - near.sample(x, y)
        at = (np.rint(place).astype(int) for place in near.grid.rowcol(x, y))
        row, column = (np.clip(k, 0, n - 1) for k, n in zip(at, near.elevation.shape, strict=True))
        slope = np.hypot(*near.limited_gradient[row, column].T)
        return point_volume(points, height, slope, self.grid.cell_size, self.numerics.density)

    @property
    def has_columns_outside(self) -> bool:
        """Whether the flow outside its window continues as columns."""
        return self.table is not None and self.table.outside == "columns"

    def coupled(self, points: PointSolver, columns: ColumnSolver, terrain: "Terrain") -> CoupledSolver:
        """Return the solver that couples its points with the flow outside its window.

        Parameters
        ----------
        points : PointSolver
        columns : ColumnSolver
            Of the flow outside the window.
        terrain : Terrain
        """
        shapely.prepare(self.window)
        margin = 0.5 * columns.grid.cell_size  # points of a column at the edge of the terrain remain on it

        def inside(x, y):
            east, north = x - self.grid.x0, y - self.grid.y0
            corners = [self.grid.covers(east + a, north + b) for a in (-margin, margin) for b in (-margin, margin)]
            return np.logical_and.reduce([shapely.contains_xy(self.window, x, y), *corners])

        options = replace(self.point_options(), stretched=False)

        def as_points(frame):
            return columns_to_points(frame, terrain, options).frame

        def stress_of(frame):
            return self.stress(terrain, frame, frame.state["vertical_stress"])

        return CoupledSolver(points, columns, inside, as_points, stress_of)

    def columns_outside(self, frame: "Frame", terrain: "Terrain", gradient: np.ndarray | None = None) -> ColumnSolver:
        """Return the solver of this stage for the columns outside the window of the next stage.

        Parameters
        ----------
        frame : Frame
            Of these columns.
        terrain : Terrain
        gradient : float64[n, 2, 2], optional [s-1]
            Velocity gradient.
        """
        thickness = self.numerics.reference_thickness or self.facts.release_thickness
        numerics = replace(self.numerics, reference_thickness=thickness, stop_at_rest=False)
        return ColumnSolver(frame, terrain, self.effects, numerics, self.places, self.grid, gradient)

    def point_options(self) -> "PointOptions":
        """Return the options for converting columns to its points; overlapping columns are raised."""
        options = point_options(self.grid.cell_size, self.scene.numerics.points_per_side)
        return replace(options, relevel=True)


def read_areas(scene: "Scene", number: int, terrain: "Terrain") -> dict:
    """Read the areas of a stage.

    Parameters
    ----------
    scene : Scene
    number : int
        Of the stage, from 0.
    terrain : Terrain

    Returns
    -------
    dict
        `table`, `window` and `area` of a Stage; empty without [[stage]].
    """
    if not scene.stage:
        return {}
    table = scene.stage[number]
    named = {"window": table.window, "area": table.reached_file}
    read = {key: read_area(scene.path(name), terrain) for key, name in named.items() if name is not None}
    return {"table": table} | read


def require_inflow_over(stages: Sequence[StageTable], events: "Events") -> None:
    """Raise SceneError for inflow during a stage of points: inflow requires columns.

    Parameters
    ----------
    stages : sequence of StageTable
    events : Events

    Raises
    ------
    SceneError
    """
    over = events.ends()
    for number, (before, stage) in enumerate(pairwise(stages), 1):
        if not events.inlets or stage.solver == "columns" or stage.outside == "columns":
            continue
        if set(before.until) != {"time"} or before.until["time"] < over:
            raise SceneError(
                f"[hydrograph] flows in until t = {over:g} s, and [[stage]] number {number + 1}, of points, may begin "
                f"before that; end the one before with until = {{time = ...}} of {over:g} s or more and nothing else, "
                "or let the flow outside a window continue as columns"
            )
