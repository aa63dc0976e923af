"""Mass that left the terrain, by blocks of cells: over the domain's edge, or into cells without elevation."""

from .jit import jit

LEFT_BLOCK = 8  # cells along the side of a block
WEST_EDGE, SOUTH_EDGE, EAST_EDGE, NORTH_EDGE, INTO_NODATA, WAYS = range(6)
LEFT_MASS, LEFT_X, LEFT_Y, LEFT_ENTRIES = range(4)  # mass [kg]; mass times place from the domain's corner [kg m]


@jit
def book_left(left, shape, x, y, dx, mass):
    """Add `mass` [kg] that left to (x, y) [m] from the corner of the domain, which has `shape` cells of `dx` [m].

    `left` is float64[WAYS, blocks, blocks, LEFT_ENTRIES]; a place beyond the edge counts on the edge.
    """
    ny, nx = shape
    way = INTO_NODATA
    if x < 0.0:
        way = WEST_EDGE
    elif y < 0.0:
        way = SOUTH_EDGE
    elif x >= nx * dx:
        way = EAST_EDGE
    elif y >= ny * dx:
        way = NORTH_EDGE
    x, y = min(max(x, 0.0), nx * dx), min(max(y, 0.0), ny * dx)
    row, column = min(int(y / dx), ny - 1) // LEFT_BLOCK, min(int(x / dx), nx - 1) // LEFT_BLOCK
    sums = left[way, row, column]
    sums[LEFT_MASS] += mass
    sums[LEFT_X] += mass * x
    sums[LEFT_Y] += mass * y
