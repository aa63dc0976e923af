"""Scenes for the 3D solver: blocks of points on terrains that are known exactly."""

import numpy as np
from column_scenes import terrain_of

from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.effect_slots import PointEffects
from mpmgis.laws.friction import friction_law
from mpmgis.solvers.points import point_loop as kernel
from mpmgis.solvers.points.point_numerics import PointNumerics
from mpmgis.solvers.points.point_solver import PointSolver


def block_of(lengths, spacing, corner=(0.0, 0.0, 0.0), density=1000.0, velocity=(0.0, 0.0, 0.0), turned=0.0):
    """A block of points a `spacing` [m] apart, its lower corner at `corner`, turned downwards about it [rad]."""
    axes = [(np.arange(round(length / spacing)) + 0.5) * spacing for length in lengths]
    x, y, z = (part.ravel() for part in np.meshgrid(*axes, indexing="ij"))
    cos, sin = np.cos(turned), np.sin(turned)
    position = np.column_stack([x * cos + z * sin, y, z * cos - x * sin]) + np.asarray(corner)
    n = len(x)
    volume = np.full(n, spacing**3)
    ids = np.arange(n, dtype=np.uint64)
    return Frame(
        Particles(position, np.tile(velocity, (n, 1)).astype(float), density * volume, volume, id=ids), dimension=3
    )


def points_on(terrain, frame, cell_size, material, contact=None, softening=None, stress=None, walls=(), **numerics):
    """A PointSolver with the named laws; density is that of the frame."""
    density = float(frame.particles.mass[0] / frame.particles.volume[0])
    effects = PointEffects(material, contact=contact or friction_law("Coulomb", 0.0))
    if softening is not None:
        effects = effects._replace(softening=softening)
    if walls:
        effects = effects._replace(barrier=True)
    return PointSolver(
        frame, terrain, effects, PointNumerics(cell_size, density=density, **numerics), stress, walls=walls
    )


def integrate_to(solver, *times):
    """Advance through `times`, as frames are; answers the last reason."""
    code = None
    for until, after in zip(times, (*times[1:], np.inf), strict=True):
        code = solver.advance(until, after)
    assert code == kernel.REACHED_TIME
    return code


def load_between(solver, begin, end):
    """Mean normal force [N] on the wall "dam" between two times."""
    impulses = []
    for time in (begin, end):
        integrate_to(solver, time)
        impulses.append(solver.balances()["barriers"]["dam"]["normal_impulse"])
    return (impulses[1] - impulses[0]) / (end - begin)


def along(solver, slope):
    """Mean speed [m s-1] down a plane of `slope` [rad] that falls to the east."""
    east, _, up = np.average(solver.frame().particles.velocity, axis=0, weights=solver.frame().particles.mass)
    return east * np.cos(slope) - up * np.sin(slope)


def sorted_points(solver):
    """The frame's particles in the order of their ids."""
    particles = solver.frame().particles
    return particles.take(np.argsort(particles.id))


def plane(degrees, length=200.0, width=40.0, height=120.0, pixel=5.0):
    """A plane falling to the east."""
    slope = np.tan(np.radians(degrees))
    return terrain_of(lambda x, y: height - slope * x, length, width, pixel)
