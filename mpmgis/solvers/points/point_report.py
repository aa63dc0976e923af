"""Entries of the report that each chunk of the grid-to-points loop fills."""

(
    SHEAR_MAX,  # [s-2] largest |C|^2
    SPEED2_MAX,  # [m2 s-2] largest squared speed
    AT_TIP,  # number of points at the tip of the yield surface
    FAR,  # number of points whose strain exceeded the range of the series
    PLASTIC,  # [J] plastic work
    UNDER,  # [kg] mass moved back onto the ground
    UNDER_X,  # [N s] impulse of the ground on that mass, east
    UNDER_Y,  # [N s] north
    UNDER_Z,  # [N s] up
    UNDER_ENERGY,  # [J] potential energy added by moving it
    LIMITED,  # number of points whose affine velocity was limited
    LIMITED_ENERGY,  # [J] kinetic energy that the limit removed
    NOT_FINITE,  # number of points that are not finite
    BAD_X,  # [m] last place of one of them, from the domain's corner
    BAD_Y,  # [m]
    BLOCK_WEST,  # [blocks] window of the blocks with points after the step, as in `point_blocks`
    BLOCK_SOUTH,  # [blocks]
    BLOCK_EAST,  # [blocks]
    BLOCK_NORTH,  # [blocks]
    BLOCK_TALL,  # [blocks]
    UNDER_POINTS,  # number of points moved back onto the ground
    HELD_STRETCH,  # number of points whose stretch was limited, or whose step had a negative determinant
    HELD_WALL,  # number of points stopped at a wall on the edge
    OUT,  # first entry of the outflow over the first edge
) = range(24)
EDGES = 5  # west, south, east, north, nodata
OUT_ENTRIES = (
    7  # of an edge: mass [kg], momentum x, y, z [kg m s-1], kinetic and potential energy [J], number of points
)
REPORT = OUT + EDGES * OUT_ENTRIES  # number of entries
