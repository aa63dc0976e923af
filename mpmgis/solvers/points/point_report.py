"""Entries of the report that each chunk of the grid-to-points loop fills."""

(
    SHEAR_MAX,  # largest |C|^2 [s-2]
    SPEED2_MAX,  # [m2 s-2]
    AT_TIP,  # points at the tip of the yield surface
    FAR,  # points whose strain exceeded the range of the series
    PLASTIC,  # plastic work [J]
    UNDER,  # mass moved back onto the ground [kg]; then the momentum that the ground takes from it [N s]
    UNDER_X,
    UNDER_Y,
    UNDER_Z,
    UNDER_ENERGY,  # potential energy added by moving it [J]
    LIMITED,  # points whose affine velocity was limited; then the kinetic energy removed [J]
    LIMITED_ENERGY,
    NOT_FINITE,  # points
    BAD_X,
    BAD_Y,
    BLOCK_WEST,
    BLOCK_SOUTH,
    BLOCK_EAST,
    BLOCK_NORTH,
    BLOCK_TALL,
    UNDER_POINTS,  # points moved back onto the ground
    HELD_STRETCH,  # points whose stretch was limited, or whose deformation in the step had a negative determinant
    HELD_WALL,  # points stopped at a wall on the edge
    OUT,  # then the outflow per edge: mass, momentum x, y, z, kinetic and potential energy, number of points
) = range(24)
EDGES = 5  # west, south, east, north, nodata
OUT_ENTRIES = 7
REPORT = OUT + EDGES * OUT_ENTRIES
