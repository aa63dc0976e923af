"""Spatial features as node arrays: friction zones, erodible ground, barriers and lakes on the solver's grid."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...laws.barrier import CORE, CORNER, FACE
from ...laws.forest import FOREST_ENTRIES
from . import column_barriers as entries
from .column_barriers import BARRIER_ENTRIES
from .column_forest import FOREST_STATE, FOREST_SUMS
from .column_records import NodeFields
from .node_grid import ColumnGrid, spared

NO_LAKE = -1e30  # [m] a still level below all ground
MAX_AREAS = 127  # that the flow can release, as many as a node's mark of 8 bits can number


@dataclass(frozen=True)
class Places:
    """Node and cell arrays of one scene; None without such features. Rows go northwards.

    Parameters
    ----------
    zone_values : float64[ny + 3, nx + 3, k], optional
        Parameters of the friction law at the nodes, in the order of the law's fields.
    erodible : float64[ny + 3, nx + 3] [kg m-2], optional
        What the flow can take up from the bed.
    erodible_share : float64[ny + 3, nx + 3] [1], optional
        Of a node's square, in which `erodible` lies; default: 1.
    barriers : float64[ny + 3, nx + 3, BARRIER_ENTRIES], optional
        See `column_barriers`; `barrier_entries` makes them of walls.
    barrier_names : tuple of str
    lake_level : float64[ny, nx] [m], optional
        Still level of the lake in each cell, NO_LAKE elsewhere.
    forest : float64[ny + 3, nx + 3, FOREST_ENTRIES], optional
        Values of the trees (`forest`), 0 without.
    """

    zone_values: np.ndarray | None = None
    erodible: np.ndarray | None = None
    erodible_share: np.ndarray | None = None
    barriers: np.ndarray | None = None
    barrier_names: tuple = ()
    lake_level: np.ndarray | None = None
    forest: np.ndarray | None = None

    def fields(self, grid: ColumnGrid, lowers_bed: bool) -> NodeFields:
        """Return the fields on `grid` for one run: arrays that change are copied, absent ones have one entry.

        Parameters
        ----------
        grid : ColumnGrid
        lowers_bed : bool
            The flow lowers the bed.
        """

        def present(array, *entries):
            return np.zeros((1, 1, *entries)) if array is None else np.ascontiguousarray(array, float)

        shape = (1, 1) if self.forest is None else self.forest.shape[:2]
        state = np.zeros((*shape, FOREST_STATE))
        erodible = present(self.erodible).copy()
        share = np.ones(erodible.shape) if self.erodible_share is None else present(self.erodible_share)
        return NodeFields(
            bed=spared(grid.bed) if lowers_bed else grid.bed,
            gradient=grid.gradient.copy() if lowers_bed else grid.gradient,
            inside=grid.inside,
            zone_values=present(self.zone_values, 1),
            erodible=erodible,
            erodible_share=share,
            barriers=present(self.barriers, BARRIER_ENTRIES),
            lake_level=present(self.lake_level),
            forest=present(self.forest, FOREST_ENTRIES),
            forest_state=state,
            forest_share=np.zeros(state.shape[:2]),
            forest_sums=np.zeros(FOREST_SUMS),
            trigger_thickness=np.full(MAX_AREAS, np.inf),
        )


def barrier_entries(walls: Any) -> np.ndarray:
    """Return the array at the nodes of the walls of a grid, in the order of the kernel.

    At the edge of the domain a wall is a corner, so that no flow passes between edge and wall.

    Parameters
    ----------
    walls : solvers.features.walls.WallNodes

    Returns
    -------
    float64[ny + 3, nx + 3, BARRIER_ENTRIES]
    """
    nodes = np.zeros((*walls.number.shape, BARRIER_ENTRIES))
    at_edge = np.ones(walls.number.shape, bool)
    at_edge[4:-4, 4:-4] = False
    corner = walls.corner | (walls.core & at_edge)
    nodes[..., entries.WALL_X], nodes[..., entries.WALL_Y] = walls.normal[..., 0], walls.normal[..., 1]
    nodes[..., entries.CREST], nodes[..., entries.WALL_MU] = walls.crest, walls.mu
    nodes[..., entries.BARRIER] = walls.number
    nodes[..., entries.HOLD] = np.where(corner, CORNER, np.where(walls.core, CORE, FACE))
    nodes[..., entries.WEIGHT] = walls.weight
    nodes[..., entries.SHARE], nodes[..., entries.LIMIT] = walls.share, walls.limit
    nodes[..., entries.SIDE] = walls.side
    return nodes
