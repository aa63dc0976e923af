"""Lines of the scratch arrays of a batch of points (`point_rows`).

A transfer works on BATCH points at a time: in loops over short arrays ("lines" of one scratch array), which the
compiler vectorises without a remainder because they always run over the whole BATCH. Where a block has fewer points
left, the last one is computed repeatedly. Only nodes and rows are read and written point by point.
"""

BATCH = 32  # points of a batch
# first index of each line of numbers; the first 24 are those of a row
(
    X,  # [cells] place from the first node of the block, east
    Y,  # [cells] place from the first node of the block, north
    Z,  # [cells] place from the first node of the block, up
    S0,  # state, as in a row
    PX,  # [kg m s-1] momentum, east
    PY,  # [kg m s-1] momentum, north
    PZ,  # [kg m s-1] momentum, up
    MASS,  # [kg]
    AXX,  # [kg m s-1] affine momentum: component x, along x
    AYX,  # [kg m s-1] affine momentum: component y, along x
    AZX,  # [kg m s-1] affine momentum: component z, along x
    S1,  # state
    AXY,  # [kg m s-1] affine momentum: component x, along y
    AYY,  # [kg m s-1] affine momentum: component y, along y
    AZY,  # [kg m s-1] affine momentum: component z, along y
    S2,  # state
    AXZ,  # [kg m s-1] affine momentum: component x, along z
    AYZ,  # [kg m s-1] affine momentum: component y, along z
    AZZ,  # [kg m s-1] affine momentum: component z, along z
    S3,  # state
    S4,  # state
    S5,  # state
    S6,  # state
    S7,  # state
    FX,  # [cells] offset from the first node along x; later the place before the step
    FY,  # [cells] offset from the first node along y; later the place before the step
    FZ,  # [cells] offset from the first node along z; later the place before the step
    WX0,  # [1] weight of the first node along x
    WX1,  # [1] weight of the second node along x
    WX2,  # [1] weight of the third node along x
    WY0,  # [1] weight of the first node along y
    WY1,  # [1] weight of the second node along y
    WY2,  # [1] weight of the third node along y
    WZ0,  # [1] weight of the first node along z
    WZ1,  # [1] weight of the second node along z
    WZ2,  # [1] weight of the third node along z
    MX0,  # [cells] that weight times the offset of the first node from the point along x
    MX1,  # [cells] that weight times the offset of the second node from the point along x
    MX2,  # [cells] that weight times the offset of the third node from the point along x
    MY0,  # [cells] that weight times the offset of the first node from the point along y
    MY1,  # [cells] that weight times the offset of the second node from the point along y
    MY2,  # [cells] that weight times the offset of the third node from the point along y
    MZ0,  # [cells] that weight times the offset of the first node from the point along z
    MZ1,  # [cells] that weight times the offset of the second node from the point along z
    MZ2,  # [cells] that weight times the offset of the third node from the point along z
    U,  # [m s-1] velocity interpolated from the nodes, east
    V,  # [m s-1] velocity interpolated from the nodes, north
    W,  # [m s-1] velocity interpolated from the nodes, up
    NEAR,  # [kg] mass interpolated from the nodes
    XX,  # [m s-1] first moment of the velocity: component x, along x
    YX,  # [m s-1] first moment of the velocity: component y, along x
    ZX,  # [m s-1] first moment of the velocity: component z, along x
    XY,  # [m s-1] first moment of the velocity: component x, along y
    YY,  # [m s-1] first moment of the velocity: component y, along y
    ZY,  # [m s-1] first moment of the velocity: component z, along y
    XZ,  # [m s-1] first moment of the velocity: component x, along z
    YZ,  # [m s-1] first moment of the velocity: component y, along z
    ZZ,  # [m s-1] first moment of the velocity: component z, along z
    N0,  # state after the step
    N1,  # state after the step
    N2,  # state after the step
    N3,  # state after the step
    N4,  # state after the step
    N5,  # state after the step
    N6,  # state after the step
    N7,  # state after the step
    TXX,  # [Pa] Kirchhoff stress xx
    TYY,  # [Pa] Kirchhoff stress yy
    TZZ,  # [Pa] Kirchhoff stress zz
    TXY,  # [Pa] Kirchhoff stress xy
    TXZ,  # [Pa] Kirchhoff stress xz
    TYZ,  # [Pa] Kirchhoff stress yz
    CODE,  # how the material was strained, a code of `laws.material`
    TRACE,  # [1] trace of the Hencky strain
    NORM,  # [1] norm of its deviator
    KEPT,  # [1] share of the deviator that is elastic
    YIELDS,  # 1 if the material yields
    SLOPE,  # [1] slope of the cone
    STRENGTH,  # [Pa] strength of the cone without pressure
    SPEED2,  # [m2 s-2] squared speed
    AFFINE2,  # [m2 s-2] squared affine velocity at half a cell, summed over the axes
    SHEAR_MOST,  # [s-2] largest |C|^2, over the batches of a chunk
    SPEED_MOST,  # [m2 s-2] largest squared speed, over the batches of a chunk
    TORN,  # points at the tip of the yield surface, summed over the batches of a chunk
    YIELDED,  # [J kg m-3] plastic work times density, summed over the batches of a chunk
) = range(0, 85 * BATCH, BATCH)
LINES = 85 * BATCH  # numbers of the scratch array
QUAD = 4 * BATCH  # numbers of a group of four for each point
QUADS = 4 * QUAD  # numbers of the array of these groups
# first index of each group: three components of a vector and a fourth number
(
    Q_MEAN,  # [m s-1] interpolated velocity; interpolated mass [kg]
    Q_MOMENT_X,  # [m s-1] first moment of the velocity along x
    Q_MOMENT_Y,  # [m s-1] along y
    Q_MOMENT_Z,  # [m s-1] along z
) = range(0, 4 * QUAD, QUAD)
# first index of each line of integers
(
    I_PLACE,  # index of the first node in the tile
    I_COLUMN,  # [nodes] nearest node from the first of the block, east
    I_ROW,  # [nodes] north
    I_BLOCK_X,  # [blocks] by which the point moves, east
    I_BLOCK_Y,  # [blocks] north
    I_BLOCK_Z,  # [blocks] up
    I_STAYS,  # 1 if the point stays in the domain
) = range(0, 7 * BATCH, BATCH)
INTEGERS = 7 * BATCH  # numbers of the array of integers
