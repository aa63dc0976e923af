"""Compute the bed as a quadratic B-spline of its values at the nodes, with its gradient and curvature."""

import numpy as np

from ...compiled.jit import jit, jit_inline
from .spline_weights import weights


@jit_inline
def bed_at(bed: np.ndarray, x: float, y: float, inverse_dx: float) -> tuple[float, float, float]:
    """Compute the bed's elevation [m] and its gradient [1] at (x, y): b = sum b_i N_i, grad b = sum b_i grad N_i.

    Parameters
    ----------
    bed : float64[ny + 3, nx + 3] [m]
    x, y : float [m]
    inverse_dx : float [m-1]
    """
    i0, fx, wx0, wx1, wx2 = weights(x, inverse_dx)
    j0, fy, wy0, wy1, wy2 = weights(y, inverse_dx)
    dx0, dx1, dx2 = fx - 1.5, 2.0 - 2.0 * fx, fx - 0.5
    dy0, dy1, dy2 = fy - 1.5, 2.0 - 2.0 * fy, fy - 0.5
    b00, b01, b02 = bed[j0, i0], bed[j0, i0 + 1], bed[j0, i0 + 2]
    b10, b11, b12 = bed[j0 + 1, i0], bed[j0 + 1, i0 + 1], bed[j0 + 1, i0 + 2]
    b20, b21, b22 = bed[j0 + 2, i0], bed[j0 + 2, i0 + 1], bed[j0 + 2, i0 + 2]
    r0 = wx0 * b00 + wx1 * b01 + wx2 * b02
    r1 = wx0 * b10 + wx1 * b11 + wx2 * b12
    r2 = wx0 * b20 + wx1 * b21 + wx2 * b22
    g0 = dx0 * b00 + dx1 * b01 + dx2 * b02
    g1 = dx0 * b10 + dx1 * b11 + dx2 * b12
    g2 = dx0 * b20 + dx1 * b21 + dx2 * b22
    value = wy0 * r0 + wy1 * r1 + wy2 * r2
    gradient_x = (wy0 * g0 + wy1 * g1 + wy2 * g2) * inverse_dx
    gradient_y = (dy0 * r0 + dy1 * r1 + dy2 * r2) * inverse_dx
    return value, gradient_x, gradient_y


@jit
def beds_at(bed: np.ndarray, x: np.ndarray, y: np.ndarray, dx: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute elevation [m], gradient east and gradient north [1] of the bed at many places (see `bed_at`).

    Parameters
    ----------
    bed : float64[ny + 3, nx + 3] [m]
    x, y : float64[n] [m]
    dx : float [m]
    """
    value, gradient_x, gradient_y = np.empty(x.size), np.empty(x.size), np.empty(x.size)
    for p in range(x.size):
        value[p], gradient_x[p], gradient_y[p] = bed_at(bed, x[p], y[p], 1.0 / dx)
    return value, gradient_x, gradient_y


@jit_inline
def bending_at(bed: np.ndarray, j: int, i: int, inverse_dx: float) -> tuple[float, float, float]:
    """Compute the Hessian (xx, xy, yy) [m-1] of the spline bed at node (j, i), as its nine coefficients give it.

    Parameters
    ----------
    bed : float64[ny + 3, nx + 3] [m]
    j, i : int
    inverse_dx : float [m-1]
    """
    south, north = max(j - 1, 0), min(j + 1, bed.shape[0] - 1)
    west, east = max(i - 1, 0), min(i + 1, bed.shape[1] - 1)
    square = inverse_dx * inverse_dx
    xx_south = bed[south, west] - 2.0 * bed[south, i] + bed[south, east]
    xx_here = bed[j, west] - 2.0 * bed[j, i] + bed[j, east]
    xx_north = bed[north, west] - 2.0 * bed[north, i] + bed[north, east]
    yy_west = bed[south, west] - 2.0 * bed[j, west] + bed[north, west]
    yy_here = bed[south, i] - 2.0 * bed[j, i] + bed[north, i]
    yy_east = bed[south, east] - 2.0 * bed[j, east] + bed[north, east]
    xy = 0.25 * (bed[north, east] - bed[north, west] - bed[south, east] + bed[south, west])
    xx = 0.125 * (xx_south + xx_north) + 0.75 * xx_here
    yy = 0.125 * (yy_west + yy_east) + 0.75 * yy_here
    return xx * square, xy * square, yy * square


@jit
def node_gradients(bed: np.ndarray, dx: float) -> np.ndarray:
    """Compute the gradient of the spline bed at the nodes themselves.

    Parameters
    ----------
    bed : float64[ny + 3, nx + 3] [m]
    dx : float [m]

    Returns
    -------
    float64[ny, nx, 2] [1]
        Zero on the outermost ring.
    """
    gradient = np.zeros((bed.shape[0], bed.shape[1], 2))
    for j in range(1, bed.shape[0] - 1):
        for i in range(1, bed.shape[1] - 1):
            _, gradient[j, i, 0], gradient[j, i, 1] = bed_at(bed, (i - 1) * dx, (j - 1) * dx, 1.0 / dx)
    return gradient
