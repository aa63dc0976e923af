"""A stage of a run: one solver with all its data, decided before the run starts, and its end conditions."""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import shapely

from ..conversion.columns_to_points import columns_to_points
from ..conversion.initial_points import point_options
from ..conversion.points_to_columns import unsettled_share
from ..conversion.solver_switch import switch_to_columns, switch_to_points
from ..conversion.start_stress import stress_of_weight
from ..frames.watched_features import Watch
from ..scene import resolve
from ..scene.tables import CLIFF, CPU, WALLS, StageTable
from ..scene.terrain_effects import with_effects_on
from ..solvers.columns.column_solver import ColumnSolver
from ..solvers.columns.feature_arrays import Places
from ..solvers.columns.node_grid import ColumnGrid
from ..solvers.features.features_by_place import KnownByPlace
from ..solvers.points.point_solver import PointSolver
from ..solvers.points.point_volume import point_volume
from ..system.errors import SceneError
from ..terrain.nodata_groups import NodataInReach
from ..terrain.spatial_inputs import read_area
from .coupled_solver import CoupledSolver
from .resolution import resolution_of
from .run_cost import require_memory_for_points
from .stage_end import CALM_NORMAL, Cliff, Near, StageEnd

WET_SHARE = 0.01  # of the release's thickness, below which there is no flow


@dataclass(frozen=True)
class Stage:
    """One part of a run; `scene` is that of this stage alone, `table` its [[stage]] (None: the scene has none).

    `deciding` is the scene by which its effects are decided, `known` all spatial features, on or off. `known_walls`
    are all barriers of the scene; `window` (shapely) is the area of the points, `area` (shapely) the one whose reach
    ends the stage; `nodata` are cells without elevation in reach of the flow. `device` computes its steps.
    """

    scene: object
    grid: ColumnGrid
    effects: object
    decisions: tuple
    facts: object
    numerics: object  # ColumnNumerics or PointNumerics
    places: Places
    known_walls: tuple = ()
    known: KnownByPlace | None = None
    deciding: object = None
    table: StageTable | None = None
    window: shapely.Geometry | None = None
    area: shapely.Geometry | None = None
    nodata: NodataInReach = field(default_factory=NodataInReach)
    device: str = CPU

    @property
    def walls(self):
        """The barriers that are on in 3D."""
        return self.known_walls if self.scene.solver == "points" and self.places.barrier_names else ()

    def features(self):
        """tuple of Feature: spatial features that are off only because of their number."""
        effects = self.effects
        law = effects.contact if self.scene.solver == "points" else effects.friction
        return () if self.known is None else self.known.watched(law, self.decisions)

    def watch(self, solver):
        """`solver`, which turns on the effects of features that its flow reaches."""
        features = self.features()
        if features:

            def with_effects(names):
                stage = self.with_effects(names)
                return stage.effects, stage.places, stage.walls

            solver.watch(Watch(features, with_effects))
        return solver

    def with_effects(self, names, decided_by="flow"):
        """The stage with the spatial effects `names` on."""
        if not names:
            return self
        effects, decisions = resolve(with_effects_on(self.deciding, names), self.facts)
        decisions = tuple(one._replace(decided_by=decided_by) if one.effect in names else one for one in decisions)
        places = self.known.in_3d(effects) if self.scene.solver == "points" else self.known.on_grid(effects)
        return replace(self, effects=effects, decisions=decisions, places=places)

    def all_places(self):
        """Places with every feature on."""
        return self.with_effects(tuple(feature.effect for feature in self.features())).places

    def words(self):
        """Its solver, cell size and end conditions, in words."""
        ends = {"time": "t = {:g} s", "reach": "within reach of {}", "calm": "calm for {:g} s"}
        until = " or ".join(ends[key].format(value) for key, value in (self.table.until or {}).items())
        where = "" if self.window is None else f" in {self.table.window}"
        return f"{self.scene.solver}{where}, cells of {self.grid.cell_size:g} m, until {until or 'the end'}"

    def shapes(self):
        """Its geometries other than `places`."""
        walls = [wall.footprint for wall in self.known_walls] if self.table is not None else []
        return [shape for shape in (self.window, self.area, *walls) if shape is not None]

    def solver(self, terrain, frame, vertical_stress=None, gradient=None):
        """Its solver, starting with `frame`; `vertical_stress` [n] [Pa] is for points, `gradient` for both solvers."""
        if self.scene.solver == "points":
            stress = self.stress(terrain, frame, vertical_stress)
            return self._solver_class()(
                frame, terrain, self.effects, self.numerics, stress, self.places.zone_values, self.walls, gradient
            )
        return self._solver_class()(frame, terrain, self.effects, self.numerics, self.places, self.grid, gradient)

    def _solver_class(self):
        """The class of its solver, on its device."""
        if self.device == CPU:
            return PointSolver if self.scene.solver == "points" else ColumnSolver
        if self.scene.solver == "points":
            from ..solvers.gpu.device_point_solver import DevicePointSolver

            return DevicePointSolver
        from ..solvers.gpu.device_column_solver import DeviceColumnSolver

        return DeviceColumnSolver

    def stress(self, terrain, frame, vertical_stress):
        """float64[n, 6] [Pa], Kirchhoff stress of the points of `frame` under their weight; None if unknown."""
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

    def end(self, terrain, following):
        """The StageEnd with its end conditions; `following` is the next Stage, None after the last."""
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

    def cell_of_columns(self, point_cell):
        """Cell size [m] for the conversion of points on a grid of `point_cell` [m] to columns of this stage.

        It gives as many columns per cell as the seeding, but is not smaller than a cell of the points' grid.
        """
        along = min(round(np.sqrt(self.scene.columns_per_cell)), int(self.grid.cell_size / point_cell + 1e-9))
        return self.grid.cell_size / max(along, 1)

    def switched_from(self, before, frame, terrain, beside=None):
        """The flow `frame` of the Stage `before`, converted for this stage: a Switched.

        `beside` is a Frame of columns outside that stage's window.
        """
        if self.scene.solver == "columns":
            cell = self.cell_of_columns(before.grid.cell_size)
            return switch_to_columns(frame, terrain, cell, self.grid.holds, beside)
        options = self.point_options()
        require_memory_for_points(options.predicted_points(frame.particles), options.cell)
        return switch_to_points(frame, terrain, options, self.grid.holds, self.window)

    def resolution(self, columns):
        """The Resolution, on its grid of points, of a Frame of columns that becomes points; None if empty."""
        particles = columns.particles
        if self.window is not None:
            particles = particles.take(shapely.contains_xy(self.window, *columns.map_xy()))
        height = self.facts.barrier_height if self.walls else None
        return resolution_of(particles, self.grid.cell_size, height) if len(particles) else None

    def volume(self, points, terrain):
        """The PointVolume of a Frame of its points on `terrain`."""
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
    def has_columns_outside(self):
        """Whether the flow outside its window continues as columns."""
        return self.table is not None and self.table.outside == "columns"

    def coupled(self, points, columns, terrain):
        """The CoupledSolver of its PointSolver and the ColumnSolver of the flow outside its window."""
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

    def columns_outside(self, frame, terrain, gradient=None):
        """The ColumnSolver of this stage for the columns of `frame` outside the window of the next stage."""
        thickness = self.numerics.reference_thickness or self.facts.release_thickness
        numerics = replace(self.numerics, reference_thickness=thickness, stop_at_rest=False)
        return ColumnSolver(frame, terrain, self.effects, numerics, self.places, self.grid, gradient)

    def point_options(self):
        """Options for converting columns to its points; overlapping columns are raised."""
        options = point_options(self.grid.cell_size, self.scene.numerics.points_per_side)
        return replace(options, relevel=True)


def read_areas(scene, number, terrain):
    """`table`, `window` and `area` of stage `number`, from 0, of `scene`, for a Stage."""
    if not scene.stage:
        return {}
    table = scene.stage[number]
    named = {"window": table.window, "area": table.reached_file}
    read = {key: read_area(scene.path(name), terrain) for key, name in named.items() if name is not None}
    return {"table": table} | read


def require_inflow_over(stages, events):
    """Refuse inflow during a stage of points: inflow requires columns.

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
