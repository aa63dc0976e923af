"""Spatial features of a scene on the solver's grid, and the numbers by which effects are decided."""

import itertools
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import ndimage

from ...laws.entrainment import NO_EROSION
from ...laws.forest import SHARE
from ...laws.friction import parameters_of
from ...scene import mu_least
from ...system.errors import SceneError
from ..columns.feature_arrays import Places, barrier_entries
from .area_shares import square_areas
from .feature_notes import acting_lines

if TYPE_CHECKING:
    import shapely

    from ...frames.particles import Frame
    from ...laws.effect_slots import ColumnEffects, PointEffects
    from ...scene.scene import Scene
    from ...terrain.elevation import Terrain
    from ...terrain.flow_reach import Reach
    from ..columns.node_grid import ColumnGrid
    from .feature_notes import Note
    from .feature_placement import Erodible
    from .walls import Wall, WallNodes

LEAST_OF = ("xi",)  # parameters whose smallest value represents the zones, because it has the largest effect


@dataclass(frozen=True)
class KnownByPlace:
    """Spatial features of a scene before its effects are decided; None or empty without them.

    Parameters
    ----------
    grid : ColumnGrid
    scene : Scene
    zones : dict
        Parameter of friction -> float64 at the nodes, NaN where it is not given.
    erodible : Erodible
        Ground that the flow can take up at the nodes.
    walls : tuple of Wall
    wall_nodes : WallNodes
    lake_level : float64[ny, nx] [m]
        Still level in the cells, NO_LAKE elsewhere.
    forest : float64[ny + 3, nx + 3, FOREST_ENTRIES]
        Values of the trees at the nodes.
    notes : list of Note
        Lines about how they are computed.
    """

    grid: "ColumnGrid"
    scene: "Scene"
    zones: dict
    erodible: "Erodible | None"
    walls: "tuple[Wall, ...]"
    wall_nodes: "WallNodes | None"
    lake_level: np.ndarray | None
    forest: np.ndarray | None = None
    notes: "list[Note]" = field(default_factory=list)

    def mu_least(self) -> float:
        """Return the least that friction can be anywhere [1]."""
        if not self.zones:
            return mu_least(self.scene)
        ends = {name: {np.nanmin(values), np.nanmax(values)} for name, values in self.zones.items()}
        corners = itertools.product(*([(name, value) for value in sorted(found)] for name, found in ends.items()))
        return min(mu_least(with_friction(self.scene, dict(corner))) for corner in corners)

    def facts(self, terrain: "Terrain", reach: "Reach", frame: "Frame", depth: float) -> dict[str, Any]:
        """Return the entries of `TerrainFacts` on spatial features.

        Parameters
        ----------
        terrain : Terrain
        reach : Reach
        frame : Frame
            The columns of the release.
        depth : float [m]
            Of the release.

        Raises
        ------
        SceneError
            Ground in reach of the flow has no friction.
        """
        x, y = self.grid.node_points()
        inside, near = reach.at(terrain.grid, x, y)
        facts = {}
        if self.zones:
            within_domain = self.grid.domain_nodes()
            self._require_no_gap(reach.below_line(terrain.grid, x, y) & within_domain, x, y)
            facts["zone_spread"] = max(_spread(values, inside & within_domain) for values in self.zones.values())
        if self.erodible is not None:
            mass = self.erodible.mass[inside].sum() * self.grid.cell_size**2
            facts["erodible_ratio"] = float(mass / frame.particles.mass.sum())
        if self.forest is not None:
            areas = self.forest[1:-1, 1:-1, SHARE] * square_areas(self.grid)
            facts["forest_areas"] = float(areas.sum()), float(areas[inside[1:-1, 1:-1]].sum())
        if self.walls:
            facts |= self._wall_facts(terrain, reach, inside | near, x, y, depth)
        if self.lake_level is not None:
            facts["lake_ratio"] = self._lake_volume() / float(frame.particles.volume.sum())
        return facts

    def lines(
        self,
        effects: "ColumnEffects | PointEffects",
        terrain: "Terrain",
        reach: "Reach",
        window: "shapely.Geometry | None",
    ) -> list[str]:
        """Return the lines about how the features are computed that act.

        Parameters
        ----------
        effects : ColumnEffects or PointEffects
            Of the stage.
        terrain : Terrain
        reach : Reach
        window : shapely.Geometry or None
            Of its points.
        """
        if not self.notes:
            return []
        inside, near = reach.at(terrain.grid, *self.grid.node_points())
        return acting_lines(self.notes, effects, self.grid, inside | near, window)

    def completed(self, reach: "Reach", terrain: "Terrain") -> "Scene":
        """Return the scene with a friction that represents its zones, for decisions on effects.

        Parameters
        ----------
        reach : Reach
        terrain : Terrain
        """
        if not self.zones:
            return self.scene
        x, y = self.grid.node_points()
        inside = reach.below_line(terrain.grid, x, y) & self.grid.domain_nodes()
        if not inside.any():  # a line that is shorter than a cell
            i, j = np.nonzero(reach.line)
            east, north = terrain.grid.xy(i * reach.step, j * reach.step)
            row, column = (
                np.rint((v - v0) / self.grid.cell_size).astype(int) + 1
                for v, v0 in ((north, self.grid.y0), (east, self.grid.x0))
            )
            inside[np.clip(row, 1, inside.shape[0] - 2), np.clip(column, 1, inside.shape[1] - 2)] = True
        representative = {}
        for name, values in self.zones.items():
            chosen = values[inside] if np.isfinite(values[inside]).any() else values
            representative[name] = float(np.nanmin(chosen) if name in LEAST_OF else np.nanmean(chosen))
        return with_friction(self.scene, representative)

    def on_grid(self, effects: "ColumnEffects") -> Places:
        """Return the spatial features of a depth-averaged run in which `effects` are on.

        Parameters
        ----------
        effects : ColumnEffects
        """
        barriers, names = None, ()
        if effects.barrier:
            barriers, names = barrier_entries(self.wall_nodes), tuple(wall.name for wall in self.walls)
        erodes = effects.entrainment.kind != NO_EROSION
        return Places(
            zone_values=self._zone_values(parameters_of(effects.friction)) if effects.zones else None,
            erodible=self.erodible.mass if erodes else None,
            erodible_share=self.erodible.share if erodes else None,
            barriers=barriers,
            barrier_names=names,
            lake_level=self.lake_level if effects.still_water else None,
            forest=self.forest if effects.forest else None,
        )

    def in_3d(self, effects: "PointEffects") -> Places:
        """Return the spatial features of a 3D run in which `effects` are on.

        The 3D solver makes the nodes of the walls itself.

        Parameters
        ----------
        effects : PointEffects
        """
        walls = self.walls if effects.barrier else ()
        return Places(
            zone_values=self._zone_values(parameters_of(effects.contact)) if effects.zones else None,
            barriers=barrier_entries(self.wall_nodes) if walls else None,
            barrier_names=tuple(wall.name for wall in walls),
        )

    def _zone_values(self, names):
        """Return the parameters `names` of friction at the nodes."""
        return np.stack([_filled(self.zones[name]) for name in names], axis=-1)

    def _require_no_gap(self, inside, x, y):
        for name, values in self.zones.items():
            gap = inside & ~np.isfinite(values)
            if gap.any():
                at = tuple(np.argwhere(gap)[0])
                area = gap.sum() * self.grid.cell_size**2
                raise SceneError(
                    f"[[zones]]: {name} has no value on {area:.4g} m2 that the flow can reach, for example at "
                    f"E {x[at]:.1f} N {y[at]:.1f}; extend the zones or fill the raster there, or give [friction] {name}"
                )

    def _wall_facts(self, terrain, reach, reached, x, y, depth):
        """Return the distance of walls from reachable ground, and the height of the lowest over that of the flow."""
        stands = self.wall_nodes.number > 0
        touched = stands & reached
        if not touched.any():
            apart = ndimage.distance_transform_edt(~reached) if reached.any() else np.full(x.shape, max(x.shape))
            return {"barrier_distance": float(apart[stands].min() * self.grid.cell_size)}
        row, column = terrain.grid.rowcol(x[touched], y[touched])
        i, j = (
            np.clip(np.rint(v / reach.step).astype(int), 0, n - 1)
            for v, n in zip((row, column), reach.height.shape, strict=True)
        )
        head = depth + np.maximum(np.nan_to_num(reach.height[i, j]), 0.0)
        above = self.wall_nodes.crest[touched] - self.grid.bed[touched]
        ratio = float((above / np.maximum(head, 1e-6)).min())
        return {"barrier_distance": 0.0, "barrier_height_ratio": ratio, "barrier_height": float(above.min())}

    def _lake_volume(self):
        bed = self.grid.bed[1:-1, 1:-1]
        mean = 0.25 * (bed[:-1, :-1] + bed[:-1, 1:] + bed[1:, :-1] + bed[1:, 1:])
        return float(np.maximum(self.lake_level - mean, 0.0).sum() * self.grid.cell_size**2)


def with_friction(scene: "Scene", values: dict) -> "Scene":
    """Return a scene with these parameters of friction, in the order of its law.

    Parameters
    ----------
    scene : Scene
    values : dict of str to float
        By name of the parameter.
    """
    table = scene.friction
    known = {**table.parameters, **values}
    ordered = {name: known[name] for name in scene.laws[table.law][1] if name in known}
    return replace(scene, friction=replace(table, parameters=ordered))


def _spread(values, where):
    """Return (largest - smallest) / mean of values that are not negative; 0 where there is none, or none above 0."""
    chosen = values[where]
    if chosen.size == 0 or not np.isfinite(chosen).any():
        return 0.0
    low, high, mean = np.nanmin(chosen), np.nanmax(chosen), np.nanmean(chosen)
    return float((high - low) / mean) if mean > 0.0 else 0.0


def _filled(values):
    """Return `values` with missing values taken from the nearest node that has one."""
    known = np.isfinite(values)
    return (
        values
        if known.all()
        else values[tuple(ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True))]
    )
