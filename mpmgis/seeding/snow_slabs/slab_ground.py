"""Find the cells of a DTM on which a snow slab can release, with their slope and aspect.

Buehler et al. 2018 (NHESS 18:3235): a band of slopes without strong curvature and without rugged ground. Derivatives
are those of the quadratic surface through 3 x 3 cells (Evans 1980), ruggedness is that of Sappington et al. 2007.
Ridges and gullies are lines across which the aspect, averaged over the window of ruggedness, turns.

All sums are of whole numbers, or of pairs whose order does not matter: a DTM that is turned by 90 degrees or mirrored
has the same cells, and so has each part of it.
"""

import math
from typing import NamedTuple

import numpy as np

from ...compiled.jit import jit
from .slab_criteria import SlabCriteria, window_cells

NONE, RIDGE, SECTORS = 0, 9, 8  # class of a cell: no release, between units; from 1 to SECTORS: sector of aspect
TURN = 65536  # steps of an aspect in a full turn, clockwise from north
UNIT = 1 << 20  # steps of the components of a unit normal
CREST = 0.85  # [1] of the largest turning across a ridge: cells with more are on its crest
SHARP = 1.5  # [1] least ratio of the turning at a ridge to that beside it; slopes around a cone have no ridge
WIDE = 2  # times the window, and WIDER times the angle: ridges with a wide crest
WIDER = 1.5  # [1]
ROUNDING = 1e-9  # [1] by which a slope may miss the limits of its band
CRITERIA = 4  # entries of the counts: cells in the band of slopes, of these with little curvature, smooth, and open


class SlabGround(NamedTuple):
    """Cells of a part of a DTM.

    Parameters
    ----------
    classes : uint8[rows, columns]
        NONE, RIDGE, or the sector of the aspect from 1.
    aspect : uint16[rows, columns]
        Azimuth downslope, in TURN steps.
    slope : float32[rows, columns] [degrees]
    elevation : float32[rows, columns] [m]
    counts : int64[CRITERIA]
        Cells that meet the first, the first two, ... criteria.
    steepest : float [degrees]
        NaN without any slope.
    """

    classes: np.ndarray
    aspect: np.ndarray
    slope: np.ndarray
    elevation: np.ndarray
    counts: np.ndarray
    steepest: float


def halo(sides: tuple[float, float]) -> int:
    """Return the cells around a part on which its classes depend.

    Parameters
    ----------
    sides : (float, float) [m]
        Of a cell.
    """
    half = max(map(window_cells, sides)) // 2
    return 1 + half + 3 * WIDE * half


def slab_ground(
    elevation: np.ndarray, matrix: np.ndarray, open_ground: np.ndarray, criteria: SlabCriteria
) -> SlabGround:
    """Classify the cells of a part of a DTM.

    Parameters
    ----------
    elevation : float64[rows + 2 halo, columns + 2 halo] [m]
        With the `halo` of cells around the part; NaN for no data and beyond the DTM.
    matrix : float64[2, 2] [m]
        Of one step in column and one in row, as `Grid.matrix`.
    open_ground : bool[rows, columns]
        Cells without forest.
    criteria : SlabCriteria
    """
    sides = np.hypot(*matrix)
    windows = np.array([window_cells(side) for side in sides])
    around = halo(tuple(sides))
    rows, columns = (n - 2 * around for n in elevation.shape)
    inverse = np.linalg.inv(matrix)
    tangents = np.tan(np.radians([criteria.slope_min, criteria.slope_max]))
    square = (tangents * (1.0 + ROUNDING * np.array([-1.0, 1.0]))) ** 2
    fits, normals, tangent, aspect = _surface(elevation, inverse, square, criteria.curvature / 100.0)
    rugged, whole, facing = _windows(normals, windows // 2, criteria.ruggedness)
    core = slice(around, around + rows), slice(around, around + columns)
    counts = np.zeros(CRITERIA, np.int64)
    angles = np.radians(np.minimum(criteria.ridge_angle * np.array([1.0, WIDER]), 180.0))
    least = 2.0 * np.sin(angles / 2.0)
    classes = _classes(fits, rugged, whole, open_ground, aspect, facing, inverse, windows // 2, around, least, counts)
    with np.errstate(invalid="ignore"):
        slope = np.degrees(np.arctan(tangent[core])).astype(np.float32)
    there = slope[np.isfinite(slope)]
    return SlabGround(
        classes,
        np.ascontiguousarray(aspect[core]),
        slope,
        elevation[core].astype(np.float32),
        counts,
        float(there.max()) if there.size else math.nan,
    )


@jit
def _surface(elevation, inverse, square, curvature):
    """Return what the quadratic surface through the 3 x 3 cells around each cell has.

    fits: 0 outside the band of slopes, 1 in it, 2 with little curvature too, int8; normals in UNIT steps,
    int32[..., 3]; tangent of the slope, NaN without a surface; aspect in TURN steps.
    """
    rows, columns = elevation.shape
    fits = np.zeros((rows, columns), np.int8)
    normals = np.zeros((rows, columns, 3), np.int32)
    tangent = np.full((rows, columns), np.nan)
    aspect = np.zeros((rows, columns), np.uint16)
    ec, nc, er, nr = inverse[0, 0], inverse[0, 1], inverse[1, 0], inverse[1, 1]  # steps in column, row per metre E, N
    for i in range(1, rows - 1):
        for j in range(1, columns - 1):
            z = elevation[i, j]
            north, south = elevation[i - 1, j] - z, elevation[i + 1, j] - z
            west, east = elevation[i, j - 1] - z, elevation[i, j + 1] - z
            nw, ne = elevation[i - 1, j - 1] - z, elevation[i - 1, j + 1] - z
            sw, se = elevation[i + 1, j - 1] - z, elevation[i + 1, j + 1] - z
            by_column = (((ne + se) + east) - ((nw + sw) + west)) / 6.0
            by_row = (((sw + se) + south) - ((nw + ne) + north)) / 6.0
            x = ec * by_column + er * by_row
            y = nc * by_column + nr * by_row
            p = x * x + y * y
            if not p < np.inf:  # no data beside it
                continue
            tangent[i, j] = math.sqrt(p)
            up = 1.0 / math.sqrt(1.0 + p)
            normals[i, j, 0] = round(-x * up * UNIT)
            normals[i, j, 1] = round(-y * up * UNIT)
            normals[i, j, 2] = round(up * UNIT)
            if not square[0] <= p <= square[1]:
                continue
            fits[i, j] = 1
            aspect[i, j] = math.floor(math.atan2(-x, -y) * (TURN / (2.0 * math.pi))) & (TURN - 1)
            cc = (((nw + ne) - 2.0 * north) + ((sw + se) - 2.0 * south) + (west + east)) / 3.0
            rr = (((nw + sw) - 2.0 * west) + ((ne + se) - 2.0 * east) + (north + south)) / 3.0
            cr = ((nw + se) - (ne + sw)) / 4.0
            xx = (ec * ec * cc + er * er * rr) + 2.0 * ec * er * cr
            yy = (nc * nc * cc + nr * nr * rr) + 2.0 * nc * nr * cr
            xy = (ec * nc * cc + er * nr * rr) + (ec * nr + er * nc) * cr
            turning = ((xx * (y * y) + yy * (x * x)) - 2.0 * xy * (x * y)) / (p * math.sqrt(p))
            if abs(turning) <= curvature:
                fits[i, j] = 2
    return fits, normals, tangent, aspect


@jit
def _windows(normals, half, limit):
    """Return where the window around a cell is more rugged than `limit`, and its mean direction downslope.

    rugged: bool; whole: whether all cells of the window have a normal; facing: unit vector to east and north, 0 on
    level ground, float32[..., 2].
    """
    rows, columns = normals.shape[:2]
    rugged, whole = np.ones((rows, columns), np.bool_), np.zeros((rows, columns), np.bool_)
    all_cells = (2 * half[0] + 1) * (2 * half[1] + 1)
    facing = np.zeros((rows, columns, 2), np.float32)
    below = np.zeros((columns, 4), np.int64)  # sums along columns: normals, and cells with one
    for i in range(-half[1], rows):
        for edge, sign in ((i + half[1], 1), (i - half[1] - 1, -1)):
            if 0 <= edge < rows:
                for j in range(columns):
                    for k in range(3):
                        below[j, k] += sign * normals[edge, j, k]
                    if normals[edge, j, 2] > 0:
                        below[j, 3] += sign
        if i < 0:
            continue
        x, y, z, n = 0, 0, 0, 0
        for j in range(-half[0], columns):
            last, first = j + half[0], j - half[0] - 1
            if last < columns:
                x, y, z, n = x + below[last, 0], y + below[last, 1], z + below[last, 2], n + below[last, 3]
            if first >= 0:
                x, y, z, n = x - below[first, 0], y - below[first, 1], z - below[first, 2], n - below[first, 3]
            if j < 0 or n == 0:
                continue
            whole[i, j] = n == all_cells
            level = float(x) * x + float(y) * y
            rugged[i, j] = 1.0 - math.sqrt(level + float(z) * z) / (float(n) * UNIT) > limit
            if level > 0.0:
                length = math.sqrt(level)
                facing[i, j, 0] = x / length
                facing[i, j, 1] = y / length
    return rugged, whole, facing


@jit
def _classes(fits, rugged, whole, open_ground, aspect, facing, inverse, half, around, least, counts):
    """Return the classes of the cells of the part without `around` cells; count the cells by criterion.

    At the rim of the DTM no ridge can be seen: its cells count as those of a ridge, and go to the units beside them.
    """
    rows, columns = open_ground.shape
    classes = np.zeros((rows, columns), np.uint8)
    for r in range(rows):
        for c in range(columns):
            i, j = r + around, c + around
            if fits[i, j] == 0:
                continue
            counts[0] += 1
            if fits[i, j] == 1:
                continue
            counts[1] += 1
            if rugged[i, j]:
                continue
            counts[2] += 1
            if not open_ground[r, c]:
                continue
            counts[3] += 1
            if not whole[i, j] or _is_on_ridge(facing, i, j, inverse, half, least):
                classes[r, c] = RIDGE
            else:
                classes[r, c] = 1 + ((int(aspect[i, j]) + TURN // 16) // (TURN // SECTORS)) % SECTORS
    return classes


@jit
def _is_on_ridge(facing, i, j, inverse, half, least):
    """Return whether a cell is on the crest of a ridge, or in the middle of a gully, where the aspect turns.

    Along the contour line the aspect turns most there, by more than the chord `least` of the unit circle, and SHARP
    times as much as beside it.
    """
    east, north = -facing[i, j, 1], facing[i, j, 0]  # along the contour line
    by_column = inverse[0, 0] * east + inverse[0, 1] * north
    by_row = inverse[1, 0] * east + inverse[1, 1] * north
    gentle = 0.41421356  # tan(22.5 degrees): the nearest of four axes
    dj = 0 if abs(by_column) < gentle * abs(by_row) else (1 if by_column > 0 else -1)
    di = 0 if abs(by_row) < gentle * abs(by_column) else (1 if by_row > 0 else -1)
    if di == 0 and dj == 0:
        return False
    narrow = half[0] if di == 0 else half[1]
    if di != 0 and dj != 0:
        narrow = max(1, round(0.70710678 * min(half[0], half[1])))
    for scale in range(2):
        reach = narrow * (WIDE if scale == 1 else 1)
        here = _chord(facing, i, j, di, dj, reach, east, north)
        size, sign = abs(here), 1.0 if here > 0 else -1.0
        known = _steps(facing, i, j, di, dj, reach) + _steps(facing, i, j, -di, -dj, reach)
        if known == 0 or size * 2 * reach < least[scale] * known:
            continue
        found = True
        for k in range(-reach, reach + 1):
            if CREST * sign * _chord(facing, i + k * di, j + k * dj, di, dj, reach, east, north) > size:
                found = False
                break
        for k in (-2 * reach, 2 * reach):
            if found and SHARP * sign * _chord(facing, i + k * di, j + k * dj, di, dj, reach, east, north) > size:
                found = False
        if found:
            return True
    return False


@jit
def _chord(facing, i, j, di, dj, reach, east, north):
    """Return the distance between the mean directions downslope `reach` steps before and behind a cell.

    Positive where they diverge, as at a ridge. Beyond the rim of the DTM the last known direction counts.
    """
    before, behind = _steps(facing, i, j, -di, -dj, reach), _steps(facing, i, j, di, dj, reach)
    x = float(facing[i + behind * di, j + behind * dj, 0]) - float(facing[i - before * di, j - before * dj, 0])
    y = float(facing[i + behind * di, j + behind * dj, 1]) - float(facing[i - before * di, j - before * dj, 1])
    apart = math.sqrt(x * x + y * y)
    return apart if x * east + y * north > 0 else -apart


@jit
def _steps(facing, i, j, di, dj, most):
    """Return the steps, at most `most`, after which a direction downslope is known."""
    steps = most
    while steps > 0:
        a, b = i + steps * di, j + steps * dj
        if facing[a, b, 0] != 0 or facing[a, b, 1] != 0:
            break
        steps -= 1
    return steps
