"""Whether the cells that a scene asks for fit into memory, estimated before grids and particles are made."""

import numpy as np

from ..errors import MpmgisError, SceneError
from ..machine import memory_lack
from ..solvers.cost import BYTES_PER_COLUMN, BYTES_PER_GRID_NODE, MEMORY_SHARE, require_memory_for_points
from ..solvers.grid import ColumnGrid
from .sources import read_sources

FEW_NODES = 4_000_000  # of a grid on the map, up to which it is made without an estimate: 0.4 GB, a second
COARSE_NODES = 250_000  # of the grid on which the release is seeded for the estimate


def require_room(stages, windowed, terrain):
    """Refuse cells whose grid or particles this machine cannot hold.

    Parameters
    ----------
    stages : list of Scene
        Each of one solver, with its cell size.
    windowed : list of bool
        Of each, whether it takes only a part of the flow: how many particles that makes is not estimated.
    terrain : Terrain

    Raises
    ------
    SceneError
        It names the key, the number of cells or particles and the memory.
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
                f"[numerics] cell_size = {size:g} m makes {across:.0f} x {along:.0f} cells on the terrain, which need "
                f"{lack}; take larger cells, or a [terrain] window"
            )
    if not fine or (stages[0].release is not None and stages[0].release.particles is not None):
        return
    coarse = np.sqrt((east - west) * (north - south) / COARSE_NODES)
    try:
        moving = read_sources(stages[0], terrain, ColumnGrid.on(terrain, coarse), lambda text: None).everything
    except MpmgisError:  # on such cells alone, or said in full where they are the scene's own
        return
    volume, area = float(moving.particles.volume.sum()), float(moving.particles.area.sum())
    for scene in fine:
        _require_particles(scene, volume, area)


def _require_particles(scene, volume, area):
    """Refuse the particles that `volume` [m3] on `area` [m2] becomes in a `scene` of one solver."""
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
