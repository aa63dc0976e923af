"""Terrain with exactly known height and gradient, for tests, benchmarks and examples.

Every function here returns a `Surface`; ``surface.terrain(grid)`` puts it on any grid (north-up, south-up, rotated,
non-square), and ``+`` adds surfaces: ``plane(30) + bumps(1.0, 50.0)``. Angles are in degrees; an azimuth is the
direction in which the surface falls, clockwise from north. Lengths and heights are in metres.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..system.errors import InputError
from .elevation import Terrain
from .grid import Grid


@dataclass(frozen=True)
class Surface:
    """A surface given by formulas; `+` adds two surfaces.

    Parameters
    ----------
    height : callable (x, y) -> float[...] [m]
        Elevation at map points [m] of any shape.
    gradient : callable (x, y) -> (float[...], float[...]) [1]
        (db/dx, db/dy) there; at a kink or cliff the side is given in the docstring of the surface.
    """

    height: Callable
    gradient: Callable

    def terrain(self, grid: Grid) -> Terrain:
        """Return the Terrain with the surface's exact height at every pixel centre of a grid.

        Parameters
        ----------
        grid : Grid
        """
        rows, columns = np.indices(grid.shape)
        return Terrain(grid, self.height(*grid.xy(rows, columns)))

    def __add__(self, other: "Surface") -> "Surface":
        """Return the sum of two surfaces."""

        def gradient(x, y):
            return tuple(a + b for a, b in zip(self.gradient(x, y), other.gradient(x, y), strict=True))

        return Surface(lambda x, y: self.height(x, y) + other.height(x, y), gradient)


def plane(angle: float, azimuth: float = 90.0, point: tuple[float, float] = (0.0, 0.0), height: float = 0.0) -> Surface:
    """Return an inclined plane.

    Parameters
    ----------
    angle, azimuth : float [deg]
        Slope, and direction in which it falls.
    point : (float, float) [m]
        Map point with the height `height`.
    height : float [m]

    Raises
    ------
    InputError
        The angle is not from 0 to below 90.
    """
    tangent = np.tan(np.radians(_within("angle", angle, 0.0, 90.0)))
    along, _ = _directions(azimuth)

    def elevation(x, y):
        return height - tangent * _distance(x, y, point, along)

    def gradient(x, y):
        flat = np.zeros(np.broadcast(x, y).shape)
        return flat - tangent * along[0], flat - tangent * along[1]

    return Surface(elevation, gradient)


def bowl(depth: float, radius: float, centre: tuple[float, float] = (0.0, 0.0)) -> Surface:
    """Return a paraboloid ``-depth (1 - r^2 / radius^2)`` (Thacker 1981).

    Parameters
    ----------
    depth : float [m]
        Below 0, at the centre.
    radius : float [m]
        At which the height is 0.
    centre : (float, float) [m]

    Raises
    ------
    InputError
        Depth or radius is not above 0.
    """
    curvature = _positive("depth", depth) / _positive("radius", radius) ** 2

    def elevation(x, y):
        return curvature * ((np.asarray(x) - centre[0]) ** 2 + (np.asarray(y) - centre[1]) ** 2) - depth

    def gradient(x, y):
        return 2 * curvature * (np.asarray(x) - centre[0]), 2 * curvature * (np.asarray(y) - centre[1])

    return Surface(elevation, gradient)


def ramp_with_cliff(
    angle: float, drop: float, edge: tuple[float, float] = (0.0, 0.0), azimuth: float = 90.0, foot: float = 0.0
) -> Surface:
    """Return a ramp that ends in a vertical cliff above flat ground.

    On the edge the ground is that of the flat. (NHESS supplement S1: angle 30, drop 10.)

    Parameters
    ----------
    angle : float [deg]
        Slope of the ramp.
    drop : float [m]
        Height of the cliff.
    edge : (float, float) [m]
        Map point of the cliff, which is normal to `azimuth`.
    azimuth : float [deg]
        In which the ramp falls.
    foot : float [m]
        Height of the flat ground.

    Raises
    ------
    InputError
        The angle is not from 0 to below 90, or the drop is not above 0.
    """
    tangent = np.tan(np.radians(_within("angle", angle, 0.0, 90.0)))
    _positive("drop", drop)
    along, _ = _directions(azimuth)

    def elevation(x, y):
        distance = _distance(x, y, edge, along)
        return foot + np.where(distance < 0, drop - tangent * distance, 0.0)

    def gradient(x, y):
        slope = np.where(_distance(x, y, edge, along) < 0, -tangent, 0.0)
        return slope * along[0], slope * along[1]

    return Surface(elevation, gradient)


def circular_channel(
    radius: float,
    angle: float = 0.0,
    azimuth: float = 90.0,
    bank_angle: float = 60.0,
    point: tuple[float, float] = (0.0, 0.0),
    height: float = 0.0,
) -> Surface:
    """Return a channel whose cross-section is a circle.

    Where the circle is steeper than `bank_angle` the banks continue straight at that angle, so that the surface and its
    gradient are continuous.

    Parameters
    ----------
    radius : float [m]
    angle, azimuth : float [deg]
        Slope of the bed line, and direction in which it falls.
    bank_angle : float [deg]
    point : (float, float) [m]
        Map point of the bed line with the height `height`.
    height : float [m]

    Raises
    ------
    InputError
        An angle is not from 0 to below 90, or the radius is not above 0.
    """
    _positive("radius", radius)
    bank = np.radians(_within("bank_angle", bank_angle, 0.0, 90.0))
    reach = radius * np.sin(bank)

    def section(offset):
        inside = np.minimum(np.abs(offset), reach)
        return radius - np.sqrt(radius**2 - inside**2) + np.tan(bank) * (np.abs(offset) - inside)

    def section_slope(offset):
        inside = np.clip(offset, -reach, reach)
        return inside / np.sqrt(radius**2 - inside**2)

    return _channel(section, section_slope, angle, azimuth, point, height)


def v_channel(
    bank_angle: float,
    angle: float = 0.0,
    azimuth: float = 90.0,
    point: tuple[float, float] = (0.0, 0.0),
    height: float = 0.0,
) -> Surface:
    """Return a channel of two planes that rise from a bed line; its gradient there is the mean of both banks.

    Parameters
    ----------
    bank_angle : float [deg]
        Slope of the banks across the bed line.
    angle, azimuth : float [deg]
        Slope of the bed line, and direction in which it falls.
    point : (float, float) [m]
        Map point of the bed line with the height `height`.
    height : float [m]

    Raises
    ------
    InputError
        An angle is not from 0 to below 90.
    """
    tangent = np.tan(np.radians(_within("bank_angle", bank_angle, 0.0, 90.0)))
    return _channel(
        lambda offset: tangent * np.abs(offset), lambda offset: tangent * np.sign(offset), angle, azimuth, point, height
    )


def bumps(amplitude: float, wavelength: float, point: tuple[float, float] = (0.0, 0.0)) -> Surface:
    """Return an egg-box ``amplitude sin(k (x - x0)) sin(k (y - y0))``, k = 2 pi / `wavelength`, about height 0.

    Parameters
    ----------
    amplitude, wavelength : float [m]
    point : (float, float) [m]
        (x0, y0).

    Raises
    ------
    InputError
        The wavelength is not above 0.
    """
    k = 2 * np.pi / _positive("wavelength", wavelength)

    def phases(x, y):
        return k * (np.asarray(x, float) - point[0]), k * (np.asarray(y, float) - point[1])

    def elevation(x, y):
        east, north = phases(x, y)
        return amplitude * np.sin(east) * np.sin(north)

    def gradient(x, y):
        east, north = phases(x, y)
        return amplitude * k * np.cos(east) * np.sin(north), amplitude * k * np.sin(east) * np.cos(north)

    return Surface(elevation, gradient)


def _channel(
    section: Callable, section_slope: Callable, angle: float, azimuth: float, point: tuple[float, float], height: float
) -> Surface:
    """Return a cross-section, given over the offset from the bed line, drawn along a bed line that falls at `angle`."""
    bed = plane(angle, azimuth, point, height)
    _, across = _directions(azimuth)

    def elevation(x, y):
        return bed.height(x, y) + section(_distance(x, y, point, across))

    def gradient(x, y):
        slope = section_slope(_distance(x, y, point, across))
        along_x, along_y = bed.gradient(x, y)
        return along_x + slope * across[0], along_y + slope * across[1]

    return Surface(elevation, gradient)


def _directions(azimuth: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the unit vectors (x, y) along `azimuth` [deg] and at right angles to it, to the left."""
    azimuth = np.radians(float(azimuth))
    along = (float(np.sin(azimuth)), float(np.cos(azimuth)))
    return along, (-along[1], along[0])


def _distance(x: np.ndarray, y: np.ndarray, point: tuple[float, float], direction: tuple[float, float]) -> np.ndarray:
    """Return the distance [m] of map points from `point` along a unit `direction`."""
    return (np.asarray(x, float) - point[0]) * direction[0] + (np.asarray(y, float) - point[1]) * direction[1]


def _positive(name, value):
    if not (np.isfinite(value) and value > 0):
        raise InputError(f"synthetic terrain: {name} is {value}, expected a finite number above 0")
    return float(value)


def _within(name, value, low, high):
    if not low <= value < high:
        raise InputError(f"synthetic terrain: {name} is {value} degrees, expected {low:g} to below {high:g}")
    return float(value)
