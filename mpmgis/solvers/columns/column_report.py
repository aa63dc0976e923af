"""Entries of the report that each chunk of the grid-to-particle loop fills, and the limits of one step."""

# report of each chunk of the grid-to-particle loop
(
    SIGNAL_MAX,  # max of |u| + sqrt(g h) [m s-1]; squares during the step, as SPEED_MAX
    SPEED_MAX,  # max of |u| [m s-1]
    KINETIC,  # sum of m |U|^2 / 2 [J]
    MOVING,  # mass with |U| above MOVING_SPEED [kg]
    FLOWING,  # mass with |U| above FLOWING_SPEED [kg]
    BOUND_RATIO,  # max of |U|^2 over its physical bound
    BOUND_X,  # where that is
    BOUND_Y,
    LIMITED,  # mass whose speed was limited to that bound [kg]
    WILD,  # mass at more than twice the speed of that bound [kg]
    NOT_FINITE,  # columns with a NaN or infinite state
    CLAMPED,  # areas reset because the column's thickness left the range about the grid's
    BLOCK_WEST,  # window of blocks with columns
    BLOCK_SOUTH,
    BLOCK_EAST,
    BLOCK_NORTH,
    STIFF,  # columns whose apparent viscosity was limited by the time step
    ENTRAINED,  # mass taken up from the bed [kg]
    ENTRAINED_POTENTIAL,  # potential energy of that mass where it joins the flow, from elevation 0 [J]
    WORK,  # work of weight and pressure on the columns [J]
    BENT,  # potential energy that columns gain as the bed under them changes its slope [J]
    LIMITED_LOSS,  # kinetic energy taken by the speed bound [J]
    FASTEST2,  # max of |U|^2 [m2 s-2]
    HELD_STRETCH,  # columns whose area would have grown or shrunk more in one step than AREA_FACTOR_MIN and _MAX allow
    HELD_THIN,  # columns that would have been thinner than 1 / THINNEST of the grid
    HELD_SPEED,  # columns whose speed was limited to its bound
    HELD_WALL,  # columns that would have passed a wall at the edge
    OUT,  # then for each edge the OUT_ENTRIES of the outflow: mass, momentum, energies, number
) = range(28)
EDGES = 5  # west, south, east, north, nodata
OUT_ENTRIES = 6  # mass [kg], momentum east and north [kg m s-1], kinetic and potential energy [J], number of columns
REPORT = OUT + EDGES * OUT_ENTRIES
MOVING_SPEED = 0.05  # [m s-1] slower counts as at rest
THINNEST = 1000.0  # [1] a column keeps at least a thousandth of the thickness of the grid: negligible push, finite area
AREA_FACTOR_MIN = 0.1  # [1] by which an area shrinks in one step, at least
AREA_FACTOR_MAX = 10.0  # [1] by which an area grows in one step, at most
