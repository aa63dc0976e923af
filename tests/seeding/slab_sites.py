"""Terrains with known slopes, ridges and gullies for the tests of potential release areas."""

import numpy as np

from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid

CELL = 5.0  # [m]


def terrain(height, size=160, cell=CELL, corner=(0.0, 0.0)):
    """A north-up DTM of size x size cells around (0, 0) with the heights [m] of `height(x, y)`, moved to `corner`."""
    steps = (np.arange(size) - 0.5 * (size - 1)) * cell
    x, y = np.meshgrid(steps, -steps)
    grid = Grid.north_up(None, corner[0] - 0.5 * size * cell, corner[1] + 0.5 * size * cell, cell, (size, size))
    return Terrain(grid, height(x, y))


def tan(degrees):
    """The tangent of an angle in degrees."""
    return np.tan(np.radians(degrees))


def cone(x, y, slope=35.0, radius=300.0):
    """A cone on level ground."""
    return 2000.0 + tan(slope) * np.maximum(radius - np.hypot(x, y), 0.0)


def pyramid(sides, turned=0.0, slope=35.0, radius=300.0):
    """The heights of a pyramid with that many faces, the first to the azimuth `turned`, on level ground."""

    def height(x, y):
        azimuths = np.radians(turned + 360.0 / sides * np.arange(sides))
        out = np.max([x * np.sin(a) + y * np.cos(a) for a in azimuths], axis=0)
        return 2000.0 + tan(slope) * np.maximum(radius - out, 0.0)

    return height


def ribs(angle, wide=200.0, slope=42.0, tilt=0.3):
    """The heights of a slope to the south with sharp ridges and gullies, `wide` [m] from ridge to ridge.

    The fall lines of their flanks turn by `angle` to both sides.
    """

    def height(x, y):
        across = (x + tilt * y) / wide
        return 2000.0 + tan(slope) * (y - tan(angle) * wide * np.abs(across - np.round(across)))

    return height


def mountains(size=200, seed=4):
    """Heights [m] of mountains with sharp ridges and without symmetry, float64[size, size]."""
    steps = np.arange(size) * CELL
    x, y = np.meshgrid(steps, steps)
    waves = np.random.default_rng(seed).uniform((0.004, 0.0, 20.0), (0.012, 2 * np.pi, 60.0), (6, 3))
    height = np.full((size, size), 2000.0)
    for number, (k, phase, high) in enumerate(waves):
        azimuth = 1.1 * number + 0.3
        height -= high * np.abs(np.sin(k * (x * np.cos(azimuth) + y * np.sin(azimuth)) + phase))
    return height * 1.0 + 0.55 * (x - 0.3 * y)
