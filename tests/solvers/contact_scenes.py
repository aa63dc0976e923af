"""Slabs on inclined beds, near the angle of their friction."""

import numpy as np
from column_scenes import terrain_of
from exact_solutions import G
from point_scenes import block_of, integrate_to, points_on, sorted_points

from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import elastic

FRICTION = 25.0  # [deg] of the bed
SOIL = elastic(6.7e6, 4e6)
DENSITY, HEIGHT = 1500.0, 2.0
LATERAL = 0.3 / 0.7  # stress across over stress along the normal of a confined elastic slab


def axes_of(slope, azimuth=0.0):
    """Unit vectors down, across and normal to a bed of `slope` [rad] that falls towards `azimuth` [rad] from east."""
    east, north = np.cos(azimuth), np.sin(azimuth)
    down = np.array([np.cos(slope) * east, np.cos(slope) * north, -np.sin(slope)])
    normal = np.array([np.sin(slope) * east, np.sin(slope) * north, np.cos(slope)])
    return down, np.cross(normal, down), normal


def weight_stress(distance, slope, friction, azimuth=0.0):
    """float64[n, 6] [Pa]: stress of a slab under its weight at `distance` [m] from a bed of `slope` [rad] that bears
    `friction` at most and falls towards `azimuth` [rad] from east."""
    down, across, normal = axes_of(slope, azimuth)
    pressed = -DENSITY * G * np.cos(slope) * (HEIGHT - distance)
    sheared = -min(np.tan(slope), friction) * pressed
    sides = LATERAL * (np.outer(down, down) + np.outer(across, across))
    tensor = pressed[:, None, None] * (np.outer(normal, normal) + sides)
    tensor += sheared[:, None, None] * (np.outer(normal, down) + np.outer(down, normal))
    return np.column_stack([tensor[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))])


def slab(degrees, time, cell=0.5, above=0.0, weighted=False, speed=0.0, material=SOIL, length=16.0, **numerics):
    """(distance moved [m], speed [m s-1], exact distance [m], solver) of a slab of `length` x 2 m after `time` [s].

    It lies on a bed of `degrees` whose friction angle is FRICTION, and starts without stress or `weighted`, under its
    weight, at `speed` [m s-1]. The bed lies `above` [cells] a node.
    """
    slope, friction = np.radians(degrees), np.tan(np.radians(FRICTION))
    base, west = 120.0 + above * cell, 20.0
    down, _, normal = axes_of(slope)
    corner = (west, 0.0, base - west * np.tan(slope))
    frame = block_of((length, 4 * cell, HEIGHT), cell / 2, corner, density=DENSITY, velocity=speed * down, turned=slope)
    start = frame.particles.position
    stress = weight_stress((start - [0.0, 0.0, base]) @ normal, slope, friction) if weighted else None
    terrain = terrain_of(lambda x, y: base - np.tan(slope) * x, west + length + 80.0, 4 * cell, cell)
    solver = points_on(
        terrain, frame, cell, material, friction_law("Coulomb", friction), stress=stress, edges="wall", **numerics
    )
    integrate_to(solver, time)
    now = sorted_points(solver)
    pull = G * (np.sin(slope) - friction * np.cos(slope))
    if pull >= 0.0 and speed == 0.0:
        exact = 0.5 * pull * time**2
    elif speed > 0.0 and pull < 0.0:
        exact = speed**2 / (-2.0 * pull)
    else:
        exact = 0.0
    return ((now.position - start) @ down).mean(), (now.velocity @ down).mean(), exact, solver


def askew_slab(degrees, time, azimuth, cell=0.5, above=0.3):
    """As `slab`, under its weight: 16 x 8 x 2 m on a bed that falls towards `azimuth` [degrees] from east, no walls."""
    slope, friction, heading = np.radians(degrees), np.tan(np.radians(FRICTION)), np.radians(azimuth)
    down, across, normal = axes_of(slope, heading)
    middle, size = 20.0, 60.0

    def bed(x, y):
        return 50.0 + above * cell - np.tan(slope) * ((x - middle) * np.cos(heading) + (y - middle) * np.sin(heading))

    frame = block_of((16.0, 8.0, HEIGHT), cell / 2, (-8.0, -4.0, 0.0), density=DENSITY)
    local = frame.particles.position.copy()
    start = local @ np.array([down, across, normal]) + [middle, middle, bed(middle, middle)]
    frame.particles.position[:] = start
    stress = weight_stress(local[:, 2], slope, friction, heading)
    solver = points_on(
        terrain_of(bed, size, size, cell),
        frame,
        cell,
        SOIL,
        friction_law("Coulomb", friction),
        stress=stress,
        edges="wall",
    )
    integrate_to(solver, time)
    now = sorted_points(solver)
    exact = max(0.5 * G * (np.sin(slope) - friction * np.cos(slope)) * time**2, 0.0)
    return ((now.position - start) @ down).mean(), (now.velocity @ down).mean(), exact, solver
