"""Lines of the scratch arrays of a batch of points (`point_rows`)."""

# A transfer works on BATCH points at a time: in loops over short arrays ("lines" of one scratch array), which the
# compiler vectorises without a remainder because they always run over the whole BATCH. Where a block has fewer points
# left, the last one is computed repeatedly. Only nodes and rows are read and written point by point.
BATCH = 32
(
    X,
    Y,
    Z,
    S0,
    PX,
    PY,
    PZ,
    MASS,
    AXX,
    AYX,
    AZX,
    S1,
    AXY,
    AYY,
    AZY,
    S2,
    AXZ,
    AYZ,
    AZZ,
    S3,
    S4,
    S5,
    S6,
    S7,  # as in a row
    FX,
    FY,
    FZ,  # offset from the first node; later the place before the step
    WX0,
    WX1,
    WX2,
    WY0,
    WY1,
    WY2,
    WZ0,
    WZ1,
    WZ2,  # weights
    MX0,
    MX1,
    MX2,
    MY0,
    MY1,
    MY2,
    MZ0,
    MZ1,
    MZ2,  # weights times the offset from the point
    U,
    V,
    W,
    NEAR,  # velocity interpolated from the nodes, and their mass
    XX,
    YX,
    ZX,
    XY,
    YY,
    ZY,
    XZ,
    YZ,
    ZZ,  # first moments of the velocity: component, then axis
    N0,
    N1,
    N2,
    N3,
    N4,
    N5,
    N6,
    N7,  # state after the step
    TXX,
    TYY,
    TZZ,
    TXY,
    TXZ,
    TYZ,
    CODE,
    SPEED2,
    AFFINE2,
    SHEAR_MOST,
    SPEED_MOST,
    TORN,
    YIELDED,  # the last four are reduced over the batches of a chunk
) = range(0, 79 * BATCH, BATCH)
LINES = 79 * BATCH
QUAD = 4 * BATCH  # groups of four numbers, one group per point
QUADS = 4 * QUAD
Q_MEAN, Q_MOMENT_X, Q_MOMENT_Y, Q_MOMENT_Z = range(0, 4 * QUAD, QUAD)
# lines of integers: index of the first node in the tile; nearest node, from the first of the block; number of blocks by
# which the point moves; 1 if the point stays in the domain
I_PLACE, I_COLUMN, I_ROW, I_BLOCK_X, I_BLOCK_Y, I_BLOCK_Z, I_STAYS = range(0, 7 * BATCH, BATCH)
INTEGERS = 7 * BATCH
