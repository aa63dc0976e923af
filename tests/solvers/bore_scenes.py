"""A stream that a wall stops: a moving bore, whose depth and load are exact in shallow water."""

import numpy as np
import shapely
from column_scenes import terrain_of
from exact_solutions import G
from point_scenes import block_of, points_on

from mpmgis.laws.material import fluid
from mpmgis.solvers.features.walls import Wall

DENSITY = 1000.0


def bore(froude, depth=1.0):
    """(depth behind the bore [m], its speed away from the wall [m s-1]) of a stream `depth` [m] deep that a wall stops.

    Mass h1 (u + s) = h2 s and momentum (h2 - h1) (h2^2 - h1^2) g / 2 = h1 h2 u^2 (Stoker 1957, Water Waves, 10.7).
    """
    speed2 = froude**2 * G * depth
    roots = np.roots([0.5 * G, -0.5 * G * depth, -0.5 * G * depth**2 - speed2 * depth, 0.5 * G * depth**3])
    behind = float(roots.real.max())
    return behind, froude * np.sqrt(G * depth) * depth / (behind - depth)


def stream_at_wall(froude, seconds, cell=0.25, width=0.75, per_cell=2, viscosity=0.0, tait=0.0, place=0.3, **numerics):
    """(PointSolver, exact load [N]) of a stream 1 m deep that reaches a wall, `place` [cells] off the nodes, at once.

    It is so long that its end has no influence on the wall for `seconds`.
    """
    speed, (behind, back) = froude * np.sqrt(G), bore(froude)
    length = (speed + np.sqrt(G) + back) * seconds
    front = (np.ceil((length + 1.0) / cell) + place) * cell
    frame = block_of((length, width, 1.0), cell / per_cell, (front - length, 0.0, 0.0), DENSITY, (speed, 0.0, 0.0))
    terrain = terrain_of(lambda x, y: 0.0 * x, np.ceil(front / cell) * cell + 5.0 * cell, width, cell)
    wall = Wall("dam", shapely.box(front, -5.0, front + 5.0 + 5.0 * cell, width + 5.0), height=4.0 * behind)
    water = fluid(DENSITY * (10.0 * speed) ** 2, viscosity, tait)
    solver = points_on(terrain, frame, cell, water, walls=(wall,), edges="wall", **numerics)
    return solver, 0.5 * DENSITY * G * behind**2 * width
