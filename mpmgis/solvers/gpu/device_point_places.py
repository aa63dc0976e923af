"""Find where a point goes on the device: over an edge of the domain, or up to the ground it is under."""

from math import sqrt

import numpy as np
from numba import float64, int64

from ..points import point_report as entry
from ..points.point_ground import GROUND_HEIGHT, GROUND_SLOPE_X, GROUND_SLOPE_Y
from ..points.point_rows import GHOSTS, Settings
from .device_functions import Part, real


@Part
def way_out(x: float, y: float, edges: tuple[float, float, float, float], inside: np.ndarray) -> int:
    """Return the edge over which a point leaves, as in `point_edges.book_out`; EDGES if it stays.

    Parameters
    ----------
    x, y : float [cells]
        Place of the point.
    edges : (west, south, east, north) [cells]
        Of the domain.
    inside : uint8[cells_y, cells_x]
        1 where the terrain has an elevation.
    """
    west, south, east, north = edges
    if x < west:
        return 0
    if y < south:
        return 1
    if x >= east:
        return 2
    if y >= north:
        return 3
    # just before the eastern or northern edge the difference rounds to the edge in single precision
    j, i = min(int64(y - south), inside.shape[0] - 1), min(int64(x - west), inside.shape[1] - 1)
    if inside[j, i] == 0:
        return entry.EDGES - 1
    return entry.EDGES


@Part
def lifted(
    place: tuple[float, float],
    height: float,
    i: int,
    j: int,
    mass: float,
    px: float,
    py: float,
    pz: float,
    ground: np.ndarray,
    settings: Settings,
    mine: np.ndarray,
) -> tuple[float, float, float, float, float]:
    """Move a point onto the ground if it is more than a cell below it, as in `point_edges`.

    It then loses its momentum into the ground.

    Parameters
    ----------
    place : (float, float) [cells]
        Of the point in the nodes' array.
    height : float [m]
        Of the point.
    i, j : int
        Column and row of the node nearest to it.
    mass : float [kg]
    px, py, pz : float [kg m s-1]
        Its momentum.
    ground : float64[rows, columns, GROUND_ENTRIES]
    settings : Settings
    mine : float64[REPORT]
        Report of the thread.

    Returns
    -------
    (float [J], float, float, float [kg m s-1], float [cells])
        Energy added, momentum and height; energy 0 and unchanged values, the height in metres, where the point stays.
    """
    dx = settings.dx
    x, y = place
    west, south = min(int64(x), ground.shape[1] - 2), min(int64(y), ground.shape[0] - 2)
    x, y = x - float64(west), y - float64(south)
    one = float64(1.0)
    surface = (one - y) * ((one - x) * ground[south, west, GROUND_HEIGHT] + x * ground[south, west + 1, GROUND_HEIGHT])
    surface += y * ((one - x) * ground[south + 1, west, GROUND_HEIGHT] + x * ground[south + 1, west + 1, GROUND_HEIGHT])
    if not height < surface - dx:
        return float64(0.0), px, py, pz, height
    slope_x, slope_y = ground[j, i, GROUND_SLOPE_X], ground[j, i, GROUND_SLOPE_Y]
    energy = float64(mass) * settings.gravity * (surface - height)
    mine[entry.UNDER] += mass
    mine[entry.UNDER_POINTS] += 1.0
    mine[entry.UNDER_ENERGY] += energy
    steep = sqrt(one + slope_x * slope_x + slope_y * slope_y)
    nx, ny, nz = -slope_x / steep, -slope_y / steep, one / steep
    into = min(px * nx + py * ny + pz * nz, float64(0.0))
    mine[entry.UNDER_X] -= into * nx
    mine[entry.UNDER_Y] -= into * ny
    mine[entry.UNDER_Z] -= into * nz
    return energy, real(px - into * nx), real(py - into * ny), real(pz - into * nz), surface / dx + GHOSTS
