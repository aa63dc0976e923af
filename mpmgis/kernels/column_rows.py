"""Layout of a column's row, its weights on the nodes, and the bed under it.

Columns are rows of consecutive floats. Nodes lie on cell corners: array index k + 1 is the node at k * dx from the
domain's south-west corner, so that there is one ghost node outside each edge. Weights are quadratic B-splines
(Steffen et al. 2008).
"""

import numpy as np

from .jit import jit, jit_inline

# columns of a particle's row
X, Y, U, V, CXX, CXY, CYX, CYY, MASS, AREA, GX, GY, ROW = range(13)
# entries of a node: mass [kg]; momentum, then velocity, east and north; the kinetic energy [J] that the columns bring,
# then the share of mass gained by erosion
NODE_MASS, NODE_X, NODE_Y, NODE_GAIN = range(4)
NODE_KINETIC = NODE_GAIN

BLOCK = 8  # nodes along a block's side
TILE = BLOCK + 2  # a particle of the block reaches two nodes further
INDEX_MASK = 0x3FFFFFFF  # shows the compiler that an index is not negative, which spares a test for each access


@jit_inline
def weights(position, inverse_dx):
    """Base index in the node array, offset in it, and the three quadratic B-spline weights of one axis."""
    s = position * inverse_dx
    base = int(s + 0.5) & INDEX_MASK  # to the letter as in the block keys, so that both round alike
    f = s + 1.0 - base
    return base, f, 0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2


@jit_inline
def bed_at(bed, x, y, inverse_dx):
    """Bed elevation [m] and its gradient at (x, y) [m]: b = sum b_i N_i, grad b = sum b_i grad N_i."""
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
def beds_at(bed, x, y, dx):
    """`bed_at` for arrays of points: elevation, gradient east, gradient north."""
    value, gradient_x, gradient_y = np.empty(x.size), np.empty(x.size), np.empty(x.size)
    for p in range(x.size):
        value[p], gradient_x[p], gradient_y[p] = bed_at(bed, x[p], y[p], 1.0 / dx)
    return value, gradient_x, gradient_y


@jit
def grid_areas(rows, shape, dx):
    """Area [m2] with which each column would have the thickness of the grid at its place: m / (rho h_g)."""
    mass = np.zeros(shape)
    share = np.zeros((2, 3))
    areas = np.empty(rows.shape[0])
    for reading in range(2):
        for p in range(rows.shape[0]):
            i0, _, share[0, 0], share[0, 1], share[0, 2] = weights(rows[p, X], 1.0 / dx)
            j0, _, share[1, 0], share[1, 1], share[1, 2] = weights(rows[p, Y], 1.0 / dx)
            here = 0.0
            for j in range(3):
                for i in range(3):
                    if reading:
                        here += share[0, i] * share[1, j] * mass[j0 + j, i0 + i]
                    else:
                        mass[j0 + j, i0 + i] += share[0, i] * share[1, j] * rows[p, MASS]
            if reading:
                areas[p] = rows[p, MASS] * dx * dx / here
    return areas


@jit
def settle_areas(rows, keys, gone, marked, first_row, first_column, mirrors, dx, density, least, tilted):
    """Set the area of the columns in marked cells to m / (rho h_g): as thick as the grid sees all of them together.

    Overlapping columns are each too thin and push too little (the push is the sum of A h^2).

    Parameters
    ----------
    rows, keys : float64[n, :], int32[n]
        A column with the key `gone` has left.
    marked : uint8[a, b]
        A window of cells from [first_row, first_column] on.
    mirrors : int64[4]
        Indices of the ghost nodes behind walls, west, south, east, north; far outside where the edge is open.
    dx : float [m]
    density : float [kg m-3]
    least : float
        Only columns that become at least so many times as thick; 0 for all.
    tilted : bool
        Thickness is normal to the bed: the middle of a column is c^2 h / 2 above the bed, not h / 2.

    Returns
    -------
    (float, float, float)
        The thickest of these columns [m], its |u| [m s-1] at most, and the sum of m c^2 (h after - h before) [kg m].
    """
    height, width = marked.shape[0] + 8, marked.shape[1] + 8
    south, west = first_row - 2, first_column - 2  # nodes, and base nodes of columns, that affect the window
    mass = np.zeros((height, width))
    share = np.zeros((2, 3))
    thickest, fastest, lifted = 0.0, 0.0, 0.0
    for reading in range(2):
        for p in range(rows.shape[0]):
            if keys[p] == gone:
                continue
            i0, _, share[0, 0], share[0, 1], share[0, 2] = weights(rows[p, X], 1.0 / dx)
            j0, _, share[1, 0], share[1, 1], share[1, 2] = weights(rows[p, Y], 1.0 / dx)
            i0, j0 = i0 - west, j0 - south
            if i0 < 0 or j0 < 0 or i0 + 2 >= width or j0 + 2 >= height:
                continue
            if not reading:
                for j in range(3):
                    for i in range(3):
                        mass[j0 + j, i0 + i] += share[0, i] * share[1, j] * rows[p, MASS]
                continue
            cell_row, cell_column = int(rows[p, Y] / dx) - first_row, int(rows[p, X] / dx) - first_column
            if cell_row < 0 or cell_column < 0 or cell_row >= marked.shape[0] or cell_column >= marked.shape[1]:
                continue
            if marked[cell_row, cell_column]:
                here = 0.0
                for j in range(3):
                    for i in range(3):
                        here += share[0, i] * share[1, j] * mass[j0 + j, i0 + i]
                before, after = rows[p, MASS] / (density * rows[p, AREA]), here / (density * dx * dx)
                if after >= least * before:
                    rows[p, AREA] = rows[p, MASS] / (density * after)
                    steep = rows[p, GX] ** 2 + rows[p, GY] ** 2 if tilted else 0.0
                    lifted += rows[p, MASS] * (after - before) / (1.0 + steep)
                    thickest = max(thickest, after)
                    fastest = max(fastest, np.hypot(rows[p, U], rows[p, V]))
        if not reading:
            _mirror_mass(mass.T, mirrors[0] - west, 1)
            _mirror_mass(mass, mirrors[1] - south, 1)
            _mirror_mass(mass.T, mirrors[2] - west, -1)
            _mirror_mass(mass, mirrors[3] - south, -1)
    return thickest, fastest, lifted


@jit
def _mirror_mass(lines, ghost, inwards):
    """Fold the mass of one wall's ghost nodes inwards and mirror it, as the grid does at walls each step."""
    if min(ghost, ghost + 2 * inwards) >= 0 and max(ghost, ghost + 2 * inwards) < lines.shape[0]:
        for k in range(lines.shape[1]):
            lines[ghost + inwards, k] *= 2.0
            lines[ghost + 2 * inwards, k] += lines[ghost, k]
            lines[ghost, k] = lines[ghost + 2 * inwards, k]


@jit_inline
def bending_at(bed, j, i, inverse_dx):
    """Hessian (xx, xy, yy) [m-1] of the spline bed at node (j, i), as its nine coefficients give it."""
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
def node_gradients(bed, dx):
    """float64[ny, nx, 2]: gradient of the spline bed at the nodes themselves (zero on the outermost ring)."""
    gradient = np.zeros((bed.shape[0], bed.shape[1], 2))
    for j in range(1, bed.shape[0] - 1):
        for i in range(1, bed.shape[1] - 1):
            _, gradient[j, i, 0], gradient[j, i, 1] = bed_at(bed, (i - 1) * dx, (j - 1) * dx, 1.0 / dx)
    return gradient
