"""Compute the distance of nodes from the ground by its nearest triangle.

A cell of four nodes is a fan of four triangles around its middle, which is where the bilinear surface has its middle,
too. On cells that are not twisted, straight cliffs among them, the two are the same.
"""

from math import sqrt

import numpy as np

from ...compiled.jit import jit, jit_parallel, prange
from .point_ground import AWAY, EXACT_X, EXACT_Y, EXACT_Z
from .point_rows import GHOSTS

TOUCHING = 1e-6  # [cells] distance from the ground within which a node is on it
SAME = 1e-3  # [1] difference of the upward parts of normals, below which they belong to one side of a fold


@jit
def nearest_on_triangle(
    px: float,
    py: float,
    pz: float,
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
    cx: float,
    cy: float,
    cz: float,
) -> tuple[float, float, float]:
    """Find the point of triangle a, b, c that is nearest to p (Ericson 2005, Real-Time Collision Detection, 5.1.5).

    Parameters
    ----------
    px, py, pz : float [m]
        The point p.
    ax, ay, az, bx, by, bz, cx, cy, cz : float [m]
        Corners of the triangle.
    """
    ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    d1 = ux * (px - ax) + uy * (py - ay) + uz * (pz - az)
    d2 = vx * (px - ax) + vy * (py - ay) + vz * (pz - az)
    d3 = ux * (px - bx) + uy * (py - by) + uz * (pz - bz)
    d4 = vx * (px - bx) + vy * (py - by) + vz * (pz - bz)
    d5 = ux * (px - cx) + uy * (py - cy) + uz * (pz - cz)
    d6 = vx * (px - cx) + vy * (py - cy) + vz * (pz - cz)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        s, t = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        s, t = 1.0, 0.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        s, t = d1 / (d1 - d3), 0.0
    elif d6 >= 0.0 and d5 <= d6:
        s, t = 0.0, 1.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        s, t = 0.0, d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        s = 1.0 - t
    else:
        s, t = vb / (va + vb + vc), vc / (va + vb + vc)
    return ax + s * ux + t * vx, ay + s * uy + t * vy, az + s * uz + t * vz


@jit
def _nearest_ground(x, y, z, j, i, height, dx, reach):
    """Find the nearest ground to (x, y, z) around node column [j, i].

    Returns (squared distance [m2], its point, normal of the ground if (x, y, z) lies on it). On a fold that is the
    normal of one side: of the flattest at an edge, where a flow rests, of the steepest at a foot, where it is stopped.
    A normal between the two would throw the flow up, or away from the ground.
    """
    best, qx, qy, qz = 1e300, x, y, z
    sx, sy, sz = 0.0, 0.0, 0.0
    close = (TOUCHING * dx) ** 2
    around = height[max(j - 1, 0), i] + height[min(j + 1, height.shape[0] - 1), i]
    around += height[j, max(i - 1, 0)] + height[j, min(i + 1, height.shape[1] - 1)]
    flattest = 1.0 if 4.0 * height[j, i] > around else -1.0
    chosen = -1e300
    for row in range(max(j - reach, 0), min(j + reach, height.shape[0] - 1)):
        for column in range(max(i - reach, 0), min(i + reach, height.shape[1] - 1)):
            mx, my = (column - i + 0.5) * dx, (row - j + 0.5) * dx
            mz = 0.25 * (height[row, column] + height[row, column + 1])
            mz += 0.25 * (height[row + 1, column] + height[row + 1, column + 1])
            for side in range(4):  # south, east, north, west
                if side == 0:
                    ja, ia, jb, ib = row, column, row, column + 1
                elif side == 1:
                    ja, ia, jb, ib = row, column + 1, row + 1, column + 1
                elif side == 2:
                    ja, ia, jb, ib = row + 1, column + 1, row + 1, column
                else:
                    ja, ia, jb, ib = row + 1, column, row, column
                ax, ay, az = (ia - i) * dx, (ja - j) * dx, height[ja, ia]
                bx, by, bz = (ib - i) * dx, (jb - j) * dx, height[jb, ib]
                tx, ty, tz = nearest_on_triangle(x, y, z, mx, my, mz, ax, ay, az, bx, by, bz)
                squared = (tx - x) ** 2 + (ty - y) ** 2 + (tz - z) ** 2
                if squared < best:
                    best, qx, qy, qz = squared, tx, ty, tz
                if squared <= close:
                    nx = (ay - my) * (bz - mz) - (az - mz) * (by - my)
                    ny = (az - mz) * (bx - mx) - (ax - mx) * (bz - mz)
                    nz = (ax - mx) * (by - my) - (ay - my) * (bx - mx)
                    size = sqrt(nx * nx + ny * ny + nz * nz)
                    wanted = flattest * nz / size
                    if wanted > chosen + SAME:
                        sx, sy, sz, chosen = 0.0, 0.0, 0.0, wanted
                    if wanted > chosen - SAME:
                        sx, sy, sz = sx + nx / size, sy + ny / size, sz + nz / size
    return best, qx, qy, qz, sx, sy, sz


@jit_parallel
def distances_to_ground(
    height: np.ndarray,
    dx: float,
    rows: np.ndarray,
    columns: np.ndarray,
    firsts: np.ndarray,
    lowest: np.ndarray,
    levels: np.ndarray,
    reach: int,
    exact: np.ndarray,
) -> None:
    """Compute the distance and the direction of the nearest ground for the nodes of some node columns, into `exact`.

    Parameters
    ----------
    height : float64[all rows, all columns] [m]
        Of the ground at all nodes, above the domain's lowest level.
    dx : float [m]
    rows, columns : int64[k]
        Place of each node column.
    firsts : int64[k]
        Index in `exact` of the first node of each column.
    lowest : int64[k]
        Level of that node.
    levels : int64[k]
        Number of nodes of each column.
    reach : int [cells]
        Distance to each side within which the nearest ground is searched.
    exact : float32[n, EXACT_ENTRIES]
        Set by this function.
    """
    for c in prange(rows.shape[0]):
        j, i = rows[c], columns[c]
        for level in range(levels[c]):
            z = (lowest[c] + level - GHOSTS) * dx
            squared, qx, qy, qz, sx, sy, sz = _nearest_ground(0.0, 0.0, z, j, i, height, dx, reach)
            away, outwards = sqrt(squared), 1.0 if z >= height[j, i] else -1.0
            if away > TOUCHING * dx:
                sx, sy, sz = -outwards * qx, -outwards * qy, outwards * (z - qz)
            size = sqrt(sx * sx + sy * sy + sz * sz)
            part = exact[firsts[c] + level]
            part[AWAY] = outwards * away
            part[EXACT_X], part[EXACT_Y], part[EXACT_Z] = sx / size, sy / size, sz / size
