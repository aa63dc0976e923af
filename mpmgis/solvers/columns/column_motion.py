"""Motion of a batch of columns over one step: positions, areas, edges, the bed's slope, speed bound and report."""

from math import sqrt
from typing import NamedTuple

import numpy as np

from ...compiled import law_functions as _laws  # noqa: F401  (registers the functions of laws)
from ...compiled.jit import jit, jit_borrowing, jit_inline
from ...compiled.simd_lanes import get, get_of_four, get_of_three, put
from ...laws.curvature import TURN, turned_velocity
from ...laws.entrainment import NO_EROSION, Entrainment
from ...laws.ground_metric import SLOPE, WATER, cosine_squared, metric_gradient
from .column_records import Settings
from .column_report import (
    AREA_FACTOR_MAX,
    AREA_FACTOR_MIN,
    BENT,
    BOUND_RATIO,
    BOUND_X,
    BOUND_Y,
    EDGES,
    ENTRAINED,
    ENTRAINED_POTENTIAL,
    FASTEST2,
    FLOWING,
    FLOWING_SPEED,
    HELD_SPEED,
    KINETIC,
    LIMITED,
    LIMITED_LOSS,
    MOVING,
    MOVING_SPEED,
    NOT_FINITE,
    OUT,
    OUT_ENTRIES,
    SIGNAL_MAX,
    SPEED_MAX,
    THINNEST,
    WILD,
    WORK,
)
from .column_rows import (
    L_AREA,
    L_BENT,
    L_BOUND,
    L_CXX,
    L_CXY,
    L_CYX,
    L_CYY,
    L_GAINED,
    L_GX,
    L_GX0,
    L_GX1,
    L_GX2,
    L_GY,
    L_HORIZONTAL2,
    L_MASS,
    L_SIGNAL2,
    L_SPEED2,
    L_TAKEN,
    L_U,
    L_V,
    L_WORK,
    L_WX0,
    L_WX1,
    L_WX2,
    L_X,
    L_Y,
    NODE_GAIN,
    NODE_MASS,
    NODE_X,
    NODE_Y,
    Q_ALONG_X,
    Q_ALONG_Y,
    Q_BED,
    Q_BED_SLOPE,
    Q_MEAN,
    Q_MOMENT_X,
    Q_MOMENT_Y,
)
from .spline_bed import bed_at
from .spline_weights import INDEX_MASK

BOUND_SLACK = 1.05  # [1] factor on the largest |U|^2 that energy allows: 5 % to spare
WILD_FACTOR2 = 4.0  # [1] of that bound: more than twice the speed is an error of the state
WALL_GAP = 1e-9  # [cells] distance from a wall at which columns are stopped: they stay within the domain


class StepTimes(NamedTuple):
    """Times of a step [s]; forces change velocities at other times than places (leapfrog)."""

    dt: float  # length of the step
    behind: float  # from the time of the velocities before its forces to the beginning of the step
    ahead: float  # from the time of the velocities after its forces to the end of the step


class SpeedBound(NamedTuple):
    """What bounds the speed of columns by their drop in height, and the speed of waves."""

    bed: float  # [m] highest bed of any release
    energy: float  # [m2 s-2] to spare for the pressure and for the speed at the start
    wave_factor: float  # largest factor of earth pressure, by which the square of the speed of waves grows


class MotionLaws(NamedTuple):
    """Laws that change columns while they move; those of the same names in `ColumnEffects`."""

    metric: int
    curvature: int
    entrainment: Entrainment


@jit_borrowing
def move(
    scratch: np.ndarray,
    moved: np.ndarray,
    quads: np.ndarray,
    count: int,
    dx: float,
    dt: float,
    entrainment: Entrainment,
) -> tuple[int, int]:
    """Compute the new velocity, affine velocity, position and area of each column, into the lines of `moved`.

    A_p *= det(I + dt grad u_p), and no column gets thinner than a thousandth of the grid's thickness. A column takes up
    m_p sum N_i gain_i at rest and keeps its momentum m_p sum N_i v_i, so that all of them together keep the nodes'.

    Parameters
    ----------
    scratch : float64[LINES]
        Columns before the step.
    moved : float64[LINES]
        Columns after the step.
    quads : float64[QUADS]
        What they read from the nodes.
    count : int
        Number of columns.
    dx : float [m]
    dt : float [s]
    entrainment : Entrainment

    Returns
    -------
    (int, int)
        Number of limited factors of area, and of limited areas.
    """
    if entrainment.kind != NO_EROSION:
        return _move(scratch, moved, quads, count, dx, dt, True)
    return _move(scratch, moved, quads, count, dx, dt, False)


@jit_inline
def _move(scratch, moved, quads, count, dx, dt, erodes):
    """The loop of `move`, compiled apart for flows that erode; it is vectorised."""
    factors, thin = 0, 0
    inverse_dx = 1.0 / dx
    four = 4.0 * inverse_dx
    for k in range(count):
        mass, grid_mass = get(scratch, L_MASS, k), get_of_four(quads, Q_MEAN, k, NODE_MASS)
        u, v = get_of_four(quads, Q_MEAN, k, NODE_X), get_of_four(quads, Q_MEAN, k, NODE_Y)
        ux, vx = get_of_four(quads, Q_ALONG_X, k, NODE_X), get_of_four(quads, Q_ALONG_X, k, NODE_Y)
        uy, vy = get_of_four(quads, Q_ALONG_Y, k, NODE_X), get_of_four(quads, Q_ALONG_Y, k, NODE_Y)
        kept = 1.0  # share of the mass, and with it of the velocity, that is not new
        if erodes:
            gain = get_of_four(quads, Q_MEAN, k, NODE_GAIN)
            gain_x, gain_y = get_of_four(quads, Q_ALONG_X, k, NODE_GAIN), get_of_four(quads, Q_ALONG_Y, k, NODE_GAIN)
            kept = 1.0 / (1.0 + gain)
            put(moved, L_GAINED, k, mass * gain)
            mass += mass * gain
            u, v = kept * u, kept * v
            ux, vx = kept * (ux - u * gain_x), kept * (vx - v * gain_x)
            uy, vy = kept * (uy - u * gain_y), kept * (vy - v * gain_y)
        stretch = (1.0 + dt * ux * inverse_dx) * (1.0 + dt * vy * inverse_dx) - dt * dt * uy * vx * (
            inverse_dx * inverse_dx
        )
        area = get(scratch, L_AREA, k) * min(max(stretch, AREA_FACTOR_MIN), AREA_FACTOR_MAX)
        widest = THINNEST * mass * dx * dx / grid_mass
        factors += (stretch < AREA_FACTOR_MIN) | (stretch > AREA_FACTOR_MAX)
        thin += area > widest
        put(moved, L_AREA, k, min(area, widest))
        put(moved, L_MASS, k, mass)
        put(moved, L_U, k, u)
        put(moved, L_V, k, v)
        put(moved, L_X, k, get(scratch, L_X, k) + dt * u)
        put(moved, L_Y, k, get(scratch, L_Y, k) + dt * v)
        put(moved, L_CXX, k, four * kept * get_of_four(quads, Q_MOMENT_X, k, NODE_X))
        put(moved, L_CYX, k, four * kept * get_of_four(quads, Q_MOMENT_X, k, NODE_Y))
        put(moved, L_CXY, k, four * kept * get_of_four(quads, Q_MOMENT_Y, k, NODE_X))
        put(moved, L_CYY, k, four * kept * get_of_four(quads, Q_MOMENT_Y, k, NODE_Y))
    return factors, thin


@jit
def clamp_areas(moved: np.ndarray, quads: np.ndarray, count: int, dx: float, clamp: float) -> float:
    """Keep the thickness within [1/clamp, clamp] times the grid's by resetting areas; return their number.

    Parameters
    ----------
    moved : float64[LINES]
        Columns after the step.
    quads : float64[QUADS]
        What they read from the nodes.
    count : int
        Number of columns.
    dx : float [m]
    clamp : float [1]
    """
    clamped = 0.0
    for k in range(count):
        seen = get(moved, L_MASS, k) * dx * dx / get_of_four(quads, Q_MEAN, k, NODE_MASS)  # as thick as the grid
        area = get(moved, L_AREA, k)
        spreads = get_of_four(quads, Q_ALONG_X, k, NODE_X) + get_of_four(quads, Q_ALONG_Y, k, NODE_Y) >= 0.0
        if spreads and area * clamp < seen:
            area = seen / clamp
            clamped += 1.0
        elif not spreads and area > clamp * seen:
            area = clamp * seen
            clamped += 1.0
        put(moved, L_AREA, k, area)
    return clamped


@jit
def keep_in(moved: np.ndarray, count: int, dx: float, length_x: float, length_y: float) -> int:
    """Stop columns at walls; return the number of columns that were stopped.

    Parameters
    ----------
    moved : float64[LINES]
        Columns after the step.
    count : int
        Number of columns.
    dx : float [m]
    length_x, length_y : float [m]
        Of the domain.
    """
    held = 0
    for k in range(count):
        x, y = get(moved, L_X, k), get(moved, L_Y, k)
        gap = WALL_GAP * dx
        held += (x < gap) | (x > length_x - gap) | (y < gap) | (y > length_y - gap)
        put(moved, L_X, k, min(max(x, gap), length_x - gap))
        put(moved, L_Y, k, min(max(y, gap), length_y - gap))
    return held


@jit
def all_stay(moved: np.ndarray, stays: np.ndarray, count: int, length_x: float, length_y: float) -> bool:
    """Set every `stays[k]` to 1; return whether all columns are within the domain (a NaN is not).

    Parameters
    ----------
    moved : float64[LINES]
        Columns after the step.
    stays : int64[BATCH]
        0 for columns that leave.
    count : int
        Number of columns.
    length_x, length_y : float [m]
        Of the domain.
    """
    within = 0
    for k in range(count):
        x, y, area = get(moved, L_X, k), get(moved, L_Y, k), get(moved, L_AREA, k)
        put(stays, 0, k, 1)
        within += (x >= 0.0) & (y >= 0.0) & (x < length_x) & (y < length_y) & (area * 0.0 == 0.0)
    return within == count


@jit
def book_out(
    scratch: np.ndarray,
    moved: np.ndarray,
    stays: np.ndarray,
    count: int,
    bed: np.ndarray,
    inside: np.ndarray,
    part: np.ndarray,
    outflow: np.ndarray,
    driven: float,
    settings: Settings,
    metric: int,
) -> None:
    """Find the columns that left through an edge or onto nodata and book them; they wait at their last place.

    A column that is not finite is counted and does not stay either.

    Parameters
    ----------
    scratch : float64[LINES]
        Columns before the step.
    moved : float64[LINES]
        Columns after the step.
    stays : int64[BATCH]
        Becomes 0 for columns that leave.
    count : int
        Number of columns.
    bed : float64[ny + 3, nx + 3] [m]
    inside : uint8[ny, nx]
        1 where there is terrain.
    part : float64[REPORT]
        Report of the chunk.
    outflow : float64[REPORT]
        Report with the ledger of the outflow.
    driven : float [1]
        Potential energy is that of the place after this share of the step, for which the velocities hold, on the plane
        of the bed.
    settings : Settings
    metric : int
        Slot of this name (`ColumnEffects`).
    """
    dx, density, gravity = settings.dx, settings.density, settings.gravity
    inverse_dx = 1.0 / dx
    ny, nx = inside.shape
    length_x, length_y = nx * dx, ny * dx
    for k in range(count):
        x, y, area = get(moved, L_X, k), get(moved, L_Y, k), get(moved, L_AREA, k)
        edge = EDGES
        if (x + y + area) * 0.0 != 0.0:  # NaN or infinite
            part[NOT_FINITE] += 1.0
            part[BOUND_X], part[BOUND_Y] = get(scratch, L_X, k), get(scratch, L_Y, k)
            stays[k] = 0
        elif x < 0.0:
            edge = 0
        elif y < 0.0:
            edge = 1
        elif x >= length_x:
            edge = 2
        elif y >= length_y:
            edge = 3
        elif inside[int(y * inverse_dx) & INDEX_MASK, int(x * inverse_dx) & INDEX_MASK] == 0:
            edge = 4
        if edge < EDGES:
            mass, u, v = get(moved, L_MASS, k), get(moved, L_U, k), get(moved, L_V, k)
            mx, my = metric_gradient(metric, get(scratch, L_GX, k), get(scratch, L_GY, k))
            w = u * mx + v * my
            bed_last = bed_at(bed, get(scratch, L_X, k), get(scratch, L_Y, k), inverse_dx)[0]
            slope_x, slope_y = get(scratch, L_GX, k), get(scratch, L_GY, k)
            fallen = slope_x * (x - get(scratch, L_X, k)) + slope_y * (y - get(scratch, L_Y, k))
            bed_last += driven * fallen
            thickness = mass / (density * area) * cosine_squared(mx, my)
            out = OUT + edge * OUT_ENTRIES
            outflow[out] += mass
            outflow[out + 1] += mass * u
            outflow[out + 2] += mass * v
            outflow[out + 3] += 0.5 * mass * (u * u + v * v + w * w)
            outflow[out + 4] += mass * gravity * (bed_last + 0.5 * thickness)
            outflow[out + 5] += 1.0
            stays[k] = 0
        if stays[k] == 0:
            put(moved, L_X, k, get(scratch, L_X, k))
            put(moved, L_Y, k, get(scratch, L_Y, k))


@jit_borrowing
def turn(
    scratch: np.ndarray,
    moved: np.ndarray,
    quads: np.ndarray,
    count: int,
    times: StepTimes,
    bound: SpeedBound,
    settings: Settings,
    laws: MotionLaws,
) -> None:
    """Read the bed at the new place, turn velocities with it, and compute quantities for the report of the step.

    The work of the weight is computed at the slope at the column's old place: for the last `times.behind` [s] before
    it, with the velocities before the step's forces, and for `times.dt` - `times.ahead` [s] after it, with those after
    them. Over the steps this is the trapezoidal rule for the column's way on the bed, whatever the steps. The work of
    the pressure is the fall of the column's middle, c^2 h / 2 above the bed, as it spreads.
    Changes of c are no work of a force: the model takes the flow as a thin layer. The forces of the next step act from
    `times.ahead` [s] before the end of this one, with velocities that are turned here, on mass that is taken up here.

    Parameters
    ----------
    scratch : float64[LINES]
        Columns before the step.
    moved : float64[LINES]
        Columns after the step.
    quads : float64[QUADS]
        What they read from the nodes.
    count : int
        Number of columns.
    times : StepTimes
    bound : SpeedBound
    settings : Settings
    laws : MotionLaws
    """
    if laws.metric == WATER:
        _turn(scratch, moved, quads, count, times, bound, settings, WATER, False)
    elif laws.curvature & TURN:
        _turn(scratch, moved, quads, count, times, bound, settings, SLOPE, True)
    else:
        _turn(scratch, moved, quads, count, times, bound, settings, SLOPE, False)
    if laws.entrainment.kind != NO_EROSION:
        _take_up(scratch, moved, quads, count, times.ahead, settings, laws.metric)


@jit_inline
def _turn(scratch, moved, quads, count, times, bound, settings, metric, turns):
    """The loop of `turn`, compiled apart for each metric and for curvature; it is vectorised."""
    dx, density, gravity = settings.dx, settings.density, settings.gravity
    behind, driven, ahead = times.behind, times.dt - times.ahead, times.ahead
    bound_bed, bound_energy, wave_factor = bound.bed, bound.energy, bound.wave_factor
    inverse_dx = 1.0 / dx
    for k in range(count):
        row0, row1 = get_of_three(quads, Q_BED, k, 0), get_of_three(quads, Q_BED, k, 1)
        row2 = get_of_three(quads, Q_BED, k, 2)
        wx0, wx1, wx2 = get(moved, L_WX0, k), get(moved, L_WX1, k), get(moved, L_WX2, k)
        bed_here = wx0 * row0 + wx1 * row1 + wx2 * row2
        slope_x = get(moved, L_GX0, k) * row0 + get(moved, L_GX1, k) * row1 + get(moved, L_GX2, k) * row2
        slope_y = (
            wx0 * get_of_three(quads, Q_BED_SLOPE, k, 0)
            + wx1 * get_of_three(quads, Q_BED_SLOPE, k, 1)
            + wx2 * get_of_three(quads, Q_BED_SLOPE, k, 2)
        )
        slope_x, slope_y = slope_x * inverse_dx, slope_y * inverse_dx
        u, v = get(moved, L_U, k), get(moved, L_V, k)
        old_x, old_y = get(scratch, L_GX, k), get(scratch, L_GY, k)
        mass, area = get(scratch, L_MASS, k), get(moved, L_AREA, k)
        climbed = behind * (get(scratch, L_U, k) * old_x + get(scratch, L_V, k) * old_y)
        climbed += driven * (u * old_x + v * old_y)
        mx, my = metric_gradient(metric, old_x, old_y)
        per_area = 0.5 * gravity / density
        spread = mass * mass * (1.0 / get(scratch, L_AREA, k) - 1.0 / area)
        c2_before = cosine_squared(mx, my)
        put(moved, L_WORK, k, per_area * c2_before * spread - mass * gravity * climbed)
        climbs = u * slope_x + v * slope_y
        if turns:
            u, v = turned_velocity(u, v, old_x, old_y, slope_x, slope_y)
        turned = mass * gravity * ahead * (u * slope_x + v * slope_y - climbs)
        mx, my = metric_gradient(metric, slope_x, slope_y)
        c2 = cosine_squared(mx, my)
        put(moved, L_BENT, k, per_area * mass * mass / area * (c2 - c2_before) - turned)
        w = u * mx + v * my
        horizontal2 = u * u + v * v
        wave2 = wave_factor * gravity * get(moved, L_MASS, k) / (density * get(moved, L_AREA, k))
        put(moved, L_U, k, u)
        put(moved, L_V, k, v)
        put(moved, L_GX, k, slope_x)
        put(moved, L_GY, k, slope_y)
        put(moved, L_SPEED2, k, horizontal2 + w * w)
        put(moved, L_HORIZONTAL2, k, horizontal2)
        put(moved, L_SIGNAL2, k, horizontal2 + wave2 + 2.0 * sqrt(horizontal2 * wave2))
        put(moved, L_BOUND, k, BOUND_SLACK * (2.0 * gravity * max(bound_bed - bed_here, 0.0) + bound_energy))


@jit_borrowing
def _take_up(scratch, moved, quads, count, ahead, settings, metric):
    """Complete the work of the weight by that on mass that was taken up, and compute the energy of that mass."""
    per_area = 0.5 * settings.gravity / settings.density
    for k in range(count):
        bed_here = get(moved, L_WX0, k) * get_of_three(quads, Q_BED, k, 0)
        bed_here += get(moved, L_WX1, k) * get_of_three(quads, Q_BED, k, 1)
        bed_here += get(moved, L_WX2, k) * get_of_three(quads, Q_BED, k, 2)
        slope_x, slope_y = get(moved, L_GX, k), get(moved, L_GY, k)
        mass, grown, area = get(scratch, L_MASS, k), get(moved, L_MASS, k), get(moved, L_AREA, k)
        taken = (grown - mass) * settings.gravity
        late = taken * ahead * (get(moved, L_U, k) * slope_x + get(moved, L_V, k) * slope_y)
        put(moved, L_WORK, k, get(moved, L_WORK, k) + late)
        mx, my = metric_gradient(metric, slope_x, slope_y)
        thicker = per_area * cosine_squared(mx, my) * (grown * grown - mass * mass) / area
        put(moved, L_TAKEN, k, taken * bed_here + thicker)


@jit_borrowing
def survey(
    moved: np.ndarray,
    stays: np.ndarray,
    count: int,
    part: np.ndarray,
    dx: float,
    gravity: float,
    entrainment: Entrainment,
) -> None:
    """Find largest and total values over the columns that stay, for the chunk's report; slow down too fast columns.

    Columns are counted as wild if they are also twice too fast for the drop across a cell: at the edge of a cliff the
    grid gives a column on top the speed of falling neighbours.

    Parameters
    ----------
    moved : float64[LINES]
        Columns after the step.
    stays : int64[BATCH]
        0 for columns that leave.
    count : int
        Number of columns.
    part : float64[REPORT]
        Report of the chunk.
    dx : float [m]
    gravity : float [m s-2]
    entrainment : Entrainment
    """
    signal2_max, speed2_max, ratio = part[SIGNAL_MAX], part[SPEED_MAX], part[BOUND_RATIO]
    kinetic, moving, flowing, entrained = part[KINETIC], part[MOVING], part[FLOWING], part[ENTRAINED]
    work, bent, taken, limited = part[WORK], part[BENT], part[ENTRAINED_POTENTIAL], part[LIMITED_LOSS]
    fastest2 = part[FASTEST2]
    if entrainment.kind != NO_EROSION:
        for k in range(count):
            entrained += get(moved, L_GAINED, k)
            taken += get(moved, L_TAKEN, k)
    for k in range(count):
        work += get(moved, L_WORK, k)
        bent += get(moved, L_BENT, k)
        if stays[k] == 0:
            continue
        mass, speed2, bound = get(moved, L_MASS, k), get(moved, L_SPEED2, k), get(moved, L_BOUND, k)
        horizontal2 = get(moved, L_HORIZONTAL2, k)
        signal2_max = max(signal2_max, get(moved, L_SIGNAL2, k))
        if speed2 > ratio * bound:
            ratio = speed2 / bound
            part[BOUND_X], part[BOUND_Y] = get(moved, L_X, k), get(moved, L_Y, k)
        if speed2 > bound:  # a speed from level ground that the grid transfers to a wall
            slower = sqrt(bound / speed2)
            put(moved, L_U, k, get(moved, L_U, k) * slower)
            put(moved, L_V, k, get(moved, L_V, k) * slower)
            part[LIMITED] += mass
            part[HELD_SPEED] += 1.0
            drop = dx * sqrt(get(moved, L_GX, k) ** 2 + get(moved, L_GY, k) ** 2)
            if speed2 > WILD_FACTOR2 * (bound + 2.0 * gravity * drop):
                part[WILD] += mass
            limited += 0.5 * mass * (speed2 - bound)
            horizontal2, speed2 = horizontal2 * bound / speed2, bound
        speed2_max = max(speed2_max, horizontal2)
        fastest2 = max(fastest2, speed2)
        kinetic += mass * speed2
        if speed2 > MOVING_SPEED * MOVING_SPEED:
            moving += mass
            if speed2 > FLOWING_SPEED * FLOWING_SPEED:
                flowing += mass
    part[SIGNAL_MAX], part[SPEED_MAX], part[BOUND_RATIO] = signal2_max, speed2_max, ratio
    part[KINETIC], part[MOVING], part[FLOWING], part[ENTRAINED] = kinetic, moving, flowing, entrained
    part[WORK], part[BENT], part[ENTRAINED_POTENTIAL], part[LIMITED_LOSS] = work, bent, taken, limited
    part[FASTEST2] = fastest2
