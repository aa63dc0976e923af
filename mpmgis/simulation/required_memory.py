"""Refuse runs that need more memory than there is, and predict what the others need."""

from typing import TYPE_CHECKING

import numpy as np

from ..laws.material_choice import state_count
from ..solvers.columns.node_grid import ColumnGrid
from ..system.errors import MpmgisError, SceneError
from ..system.memory import memory_lack
from ..system.messages import muted
from .mass_sources import read_sources
from .memory_need import (
    BYTES_PER_COLUMN,
    BYTES_PER_GRID_NODE,
    BYTES_PER_SWITCHED,
    MEMORY_SHARE,
    memory_of_columns,
    memory_of_points,
    require_memory_for_points,
)

if TYPE_CHECKING:
    from ..scene import Scene
    from ..terrain.elevation import Terrain
    from .preparation import Prepared

FEW_NODES = 4_000_000  # of a map grid; up to this number no estimate is needed: 0.4 GB, one second
COARSE_NODES = 250_000  # of the grid for seeding the release in the estimate


def require_memory(stages: "list[Scene]", windowed: list[bool], terrain: "Terrain") -> None:
    """Raise SceneError if the cells need more memory for grid or particles than this machine has.

    Parameters
    ----------
    stages : list of Scene
        Each of one solver, with its cell size.
    windowed : list of bool
        Whether the stage contains only a part of the flow: its number of particles is not estimated.
    terrain : Terrain

    Raises
    ------
    SceneError
    """
    west, south, east, north = terrain.grid.bounds
    fine = []
    for scene, part in zip(stages, windowed, strict=True):
        size = scene.numerics.cell_size
        across, along = (east - west) / size, (north - south) / size
        if across * along <= FEW_NODES:
            continue
        fine += [] if part else [scene]
        if lack := memory_lack(across * along * BYTES_PER_GRID_NODE, MEMORY_SHARE):
            raise SceneError(
                f"[numerics] cell_size = {size:g} m makes {across:.6g} x {along:.6g} cells on the terrain, which need "
                f"{lack}; take larger cells, or a [terrain] window"
            )
    if not fine or (stages[0].release is not None and stages[0].release.particles is not None):
        return
    coarse = np.sqrt((east - west) * (north - south) / COARSE_NODES)
    try:
        with muted():
            moving = read_sources(stages[0], terrain, ColumnGrid.on(terrain, coarse)).everything
    except MpmgisError:  # only on coarse cells, or raised again later on the scene's cells
        return
    volume, area = float(moving.particles.volume.sum()), float(moving.particles.area.sum())
    for scene in fine:
        _require_particles(scene, volume, area)


def _require_particles(scene: "Scene", volume: float, area: float) -> None:
    """Raise SceneError for too many particles of `volume` [m3] on `area` [m2] in a `scene` of one solver."""
    numerics = scene.numerics
    if scene.solver == "points":
        spacing = numerics.cell_size / numerics.points_per_side
        require_memory_for_points(volume / spacing**3, numerics.cell_size)
        return
    columns = area / numerics.cell_size**2 * scene.columns_per_cell
    if lack := memory_lack(columns * BYTES_PER_COLUMN, MEMORY_SHARE):
        raise SceneError(
            f"[numerics] cell_size = {numerics.cell_size:g} m and particles_per_cell = {scene.columns_per_cell} make "
            f"{columns:.3g} columns, which need {lack}; take larger cells, or fewer particles_per_cell"
        )


def predicted_memory(prepared: "Prepared") -> float:
    """Return the memory of the largest stage of a run, with the conversion between columns and points.

    Parameters
    ----------
    prepared : Prepared

    Returns
    -------
    float [bytes]
    """
    stages = range(len(prepared.stages))
    switched = BYTES_PER_SWITCHED if len(stages) > 1 else 0
    points = [n for n in stages if prepared.stages[n].scene.solver == "points"]
    turned = max((prepared.particles_of(number) for number in points), default=0)
    return max(_memory_of(prepared, number) for number in stages) + turned * switched


def _memory_of(prepared, number):
    """Return the memory [bytes] of stage `number`."""
    west, south, east, north = prepared.terrain.grid.bounds
    stage, particles = prepared.stages[number], prepared.particles_of(number)
    nodes, elevation = (east - west) * (north - south) / stage.grid.cell_size**2, prepared.terrain.elevation.nbytes
    if stage.scene.solver == "columns":
        return memory_of_columns(particles, nodes, elevation)
    numbers = state_count(stage.effects.material)
    return memory_of_points(particles, nodes, elevation, stage.numerics.precision, numbers)
