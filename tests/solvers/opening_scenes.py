"""Basins of water that run out through an opening in their wall, and what theory says that passes.

The reference is critical flow in the opening, Q = b sqrt(g) (2 E / 3)^1.5. A shallow water scheme (finite volumes, HLL,
second order, cells of 1/16 of the opening) gives 0.865 of it for a sharp-edged opening.
"""

from dataclasses import replace

import numpy as np
import shapely
import shapely.affinity
from column_scenes import G, columns_of, node_thickness, solver_on, terrain_of
from point_scenes import block_of, points_on

from mpmgis.laws.material import fluid
from mpmgis.solvers.columns.feature_arrays import Places, barrier_entries
from mpmgis.solvers.columns.node_grid import ColumnGrid
from mpmgis.solvers.features.walls import Wall, wall_nodes


def basin(side, thickness, gap, degrees, centre):
    """(wall, outline of wall and basin, a function that places shapes) of a square basin with one opening."""
    outer, inner = (shapely.box(-a, -a, a, a) for a in (0.5 * (side + thickness), 0.5 * (side - thickness)))
    ring = outer.difference(inner)
    if gap:
        ring = ring.difference(shapely.box(0.0, -0.5 * gap, side, 0.5 * gap))

    def placed(shape):
        return shapely.affinity.translate(shapely.affinity.rotate(shape, degrees, (0, 0)), *centre)

    return placed(ring), placed(outer), placed


def walled_columns(walls, terrain, frame, cell_size, friction=None, **more):
    """A ColumnSolver with `walls` on a terrain with walled edges."""
    grid = ColumnGrid.on(terrain, cell_size)
    nodes = wall_nodes(walls, *grid.node_axes(), grid.bed, cell_size)
    places = Places(barriers=barrier_entries(nodes), barrier_names=tuple(wall.name for wall in walls))
    laws = {"barrier": True}
    return solver_on(terrain, frame, cell_size, friction, edges="wall", places=places, laws=laws, **more)


def discharge_of_columns(cell_size, gap, degrees=0.0, offset=(0.0, 0.0), thickness=1.0, metric=None, depth=4.0):
    """Discharge through the opening over that of critical flow, between 5 and 9 s; basin of 44 m, water 4 m deep."""
    wall, outer, placed = basin(44.0, thickness, gap, degrees, (40.0 + offset[0], 40.0 + offset[1]))
    pool = placed(shapely.box(-22, -22, 22, 22)).buffer(-0.5 * thickness - 1.05 * cell_size)
    frame = columns_of(lambda x, y: np.where(shapely.contains_xy(pool, x, y), depth, 0.0), 0, 80, 0, 80, cell_size / 2)
    terrain = terrain_of(lambda x, y: 0 * x, 80.0, 80.0, cell_size)
    solver = walled_columns([Wall("basin", wall, 99.0)], terrain, frame, cell_size, metric=metric)
    core, out = placed(shapely.box(-18, -18, 0, 18)), []
    for time in (5.0, 7.0, 9.0):
        solver.advance(time)
        p = solver.frame().particles
        x, y, h = node_thickness(solver)
        head = h[shapely.contains_xy(core, *np.meshgrid(x, y))].mean()
        out.append((p.volume[~shapely.contains_xy(outer, *p.position[:, :2].T)].sum(), head))
    return _over_critical(out, 4.0, gap)


def discharge_of_points(cell_size, gap, degrees=0.0, offset=(0.0, 0.0), thickness=1.0, depth=4.0, **numerics):
    """As of columns, between 2 and 5 s; basin of 16 m."""
    wall, outer, placed = basin(16.0, thickness, gap, degrees, (18.0 + offset[0], 18.0 + offset[1]))
    pool = placed(shapely.box(-8, -8, 8, 8)).buffer(-max(0.5 * thickness, 1.5 * cell_size) - 0.25 * cell_size)
    frame = block_of((36.0, 36.0, depth), cell_size / 2)
    p = frame.particles
    frame = replace(frame, particles=p.take(shapely.contains_xy(pool, *p.position[:, :2].T)))
    stress = np.zeros((len(frame.particles), 6))
    stress[:, :3] = -1000.0 * G * (depth - frame.particles.position[:, 2])[:, None]
    terrain = terrain_of(lambda x, y: 0 * x, 36.0, 36.0, 2.0)
    water, walls = fluid(1000.0 * 90.0**2, 0.0, 0.0), (Wall("basin", wall, height=99.0),)
    solver = points_on(terrain, frame, cell_size, water, stress=stress, walls=walls, edges="wall", **numerics)
    core, out, times = placed(shapely.box(-5, -5, 4, 5)), [], (2.0, 3.5, 5.0)
    for time, after in zip(times, (*times[1:], np.inf), strict=True):
        solver.advance(time, after)
        p = solver.frame().particles
        head = p.mass[shapely.contains_xy(core, *p.position[:, :2].T)].sum() / 1000.0 / core.area
        out.append((p.mass[~shapely.contains_xy(outer, *p.position[:, :2].T)].sum() / 1000.0, head))
    return _over_critical(out, 3.0, gap)


def _over_critical(out, seconds, gap):
    """Discharge between the first and the last of (volume outside, head) over that of critical flow."""
    return (out[-1][0] - out[0][0]) / seconds / (gap * np.sqrt(G) * (2.0 * out[1][1] / 3.0) ** 1.5)
