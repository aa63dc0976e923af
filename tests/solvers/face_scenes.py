"""Bodies at rest in basins of any shape: exact in rest, whatever the ground's kinks, cliffs and walls.

Under a hydrostatic stress -rho g (surface - z) I an elastic body is in equilibrium in any frictionless basin: the
divergence balances its weight, and faces only press along their normals.
"""

import numpy as np
import shapely
from column_scenes import terrain_of
from exact_solutions import G
from point_scenes import march_to, points_on
from test_points_catalogue import cauchy_stress

from mpmgis.effects.contact import CoulombContact
from mpmgis.particles import Frame, Particles
from mpmgis.solvers.points import PointNumerics  # noqa: F401
from mpmgis.spatial.barriers import Wall

DENSITY = 1000.0
TIMES = 16  # looks over the swings


def filled(bed, west, east, surface, cell, width, along=2):
    """A Frame of points that fill the basin `bed(x)` [m] from `west` to `east` [m] up to `surface` [m]."""
    spacing = cell / along
    x = west + spacing * (np.arange(round((east - west) / spacing)) + 0.5)
    y = spacing * (np.arange(round(width / spacing)) + 0.5)
    places, volumes = [], []
    for a in x:
        depth = surface - float(bed(np.array(a)))
        count = round(depth / spacing)
        if count <= 0:
            continue
        z = surface - depth + depth / count * (np.arange(count) + 0.5)
        bb, zz = (part.ravel() for part in np.meshgrid(y, z, indexing="ij"))
        places.append(np.column_stack([np.full(len(bb), a), bb, zz]))
        volumes.append(np.full(len(bb), spacing**2 * depth / count))
    position, volume = np.concatenate(places), np.concatenate(volumes)
    ids = np.arange(len(volume), dtype=np.uint64)
    return Frame(Particles(position, np.zeros_like(position), DENSITY * volume, volume, id=ids), dimension=3)


def basin(bed, length, west, east, surface, cell, material, walls=(), mu=0.0, **numerics):
    """A PointSolver of the body at rest that fills `bed(x)` [m] up to `surface` [m], three cells across."""
    width = 3 * cell
    frame = filled(bed, west, east, surface, cell, width)
    stress = np.zeros((len(frame.particles.id), 6))
    stress[:, :3] = -DENSITY * G * (surface - frame.particles.position[:, 2:])
    terrain = terrain_of(lambda x, y: bed(x), length, width, cell)
    return points_on(
        terrain, frame, cell, material, CoulombContact(mu), stress=stress, walls=walls, edges="wall", **numerics
    )


def mean_stress(solver, start, end, times=TIMES):
    """(stress over its exact value [n, 3] (xx, yy, zz), places [n, 3]) as means over `times` from start to end [s]."""
    stress, place = 0.0, 0.0
    march_to(solver, start)
    for until in np.linspace(start, end, times + 1)[1:]:
        march_to(solver, until)
        particles = solver.frame().particles
        place = place + particles.position[np.argsort(particles.id)] / times
        stress = stress + cauchy_stress(solver)[:, :3] / times
    return stress, place


def standing_wall(west, thickness, height, mu=0.0, name="dam"):
    return Wall(name, shapely.box(west, -50.0, west + thickness, 50.0), height=height, mu=mu)
