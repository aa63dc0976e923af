"""Where a point goes on the device: over an edge of the domain, or up to the ground it is under."""

from math import sqrt

from numba import float64, int64

from ..points import point_report as entry
from ..points.point_ground import GROUND_HEIGHT, GROUND_SLOPE_X, GROUND_SLOPE_Y
from ..points.point_rows import GHOSTS
from .device_functions import Part, real


@Part
def way_out(x, y, edges, inside):
    """Edge over which a point at (x, y) [cells] leaves, as in `point_edges.book_out`; EDGES if it stays."""
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
def lifted(place, height, i, j, mass, px, py, pz, ground, settings, mine):
    """What becomes of a point at `place` [cells] and `height` [m] that may be a cell below the ground.

    As `point_edges`: it is moved onto it and loses its momentum into the ground. Returns the energy added [J],
    0 where it stays, the momentum and the height [cells].
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
