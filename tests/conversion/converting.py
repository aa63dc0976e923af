"""Columns, terrains and checks for the tests of the conversion."""

from dataclasses import replace

import numpy as np
from affine import Affine

from mpmgis.frames.particles import Frame, Particles
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid

DENSITY = 1300.0
ORIGIN = (500_000.0, 5_100_000.0, 0.0)


def terrain_of(height, length=100.0, width=80.0, pixel=2.0, turn=0.0, hole=None):
    """A terrain of `height(x, y)` with x, y from ORIGIN; `turn` rotates its pixels, `hole` is a pixel without data."""
    rows, columns = round(width / pixel), round(length / pixel)
    transform = Affine.translation(ORIGIN[0], ORIGIN[1] + width) * Affine.rotation(turn) * Affine.scale(pixel, -pixel)
    grid = Grid(None, transform, (rows, columns))
    x, y = grid.xy(*np.mgrid[0:rows, 0:columns])
    elevation = np.asarray(height(x - ORIGIN[0], y - ORIGIN[1]), float) + 0 * x
    if hole is not None:
        elevation[hole] = np.nan
    return Terrain(grid, elevation)


def slope(tangent=0.5, side=0.2):
    """A plane that falls eastwards by `tangent` and rises northwards by `side`."""
    return lambda x, y: 900.0 - tangent * x + side * y


def hills(x, y):
    """A slope with bumps."""
    return 900.0 - 0.5 * x + 3.0 * np.sin(x / 9.0) * np.cos(y / 7.0)


def columns_on(terrain, thickness=2.0, velocity=(5.0, 1.0), spacing=1.25, box=(20.0, 60.0, 20.0, 50.0), **more):
    """A lattice of columns on `terrain`; `thickness` and `velocity` are numbers or functions of x, y from ORIGIN."""
    west, east, south, north = box
    j, i = np.mgrid[0 : round((north - south) / spacing), 0 : round((east - west) / spacing)]
    x, y = (west + spacing * (i + 0.5)).ravel(), (south + spacing * (j + 0.5)).ravel()
    h = np.broadcast_to(thickness(x, y) if callable(thickness) else thickness, x.shape).astype(float)
    u, v = velocity(x, y) if callable(velocity) else velocity
    area = np.full(len(x), spacing**2)
    bed = terrain.sample(x + ORIGIN[0], y + ORIGIN[1])
    particles = Particles(
        np.column_stack([x, y, bed]),
        np.column_stack([0 * x + u, 0 * x + v, 0 * x]),
        DENSITY * area * h,
        area * h,
        h,
        area,
        np.arange(1000, 1000 + len(x), dtype=np.uint64),
    )
    return Frame(particles, dimension=2, origin=ORIGIN, **more)


def with_particles(frame, **arrays):
    """`frame` with other `arrays` of its particles."""
    return replace(frame, particles=replace(frame.particles, **arrays))


def doubled(frame):
    """`frame` with twice the mass on the same ground."""
    p = frame.particles
    return with_particles(frame, mass=2 * p.mass, volume=2 * p.volume, area=2 * p.area)


def over_bed(frame, terrain):
    """float64[n] [m]: height of a frame's particles over the bed."""
    return frame.particles.position[:, 2] + frame.origin[2] - terrain.sample(*frame.map_xy())


def rounded(value, digits=12):
    """`value` without its last bits, for comparisons of what only rounding may change."""
    return np.round(value, digits)
