"""Stacks of points from pieces of columns: positions, velocities, stress and affine velocity.

Footprints of columns, and columns cut sideways so that their points leave no gaps (E8 on the theory page).

A flow that stretches carries its columns apart along one direction and together across it; squares would then leave
gaps in rows, which a 3D code treats as fractures. The stretch of a column is known only from its neighbours.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import shapely

from ..frames.particles import Particles
from ..system.errors import InputError
from . import point_groups as geostatic
from . import stack_filling as stack_kernel
from .point_groups import slope_cosine

MOST_STRETCHED = 6.0  # length over width; more is the rim of a flow, not its inside
SQUARE = 1.15  # length over width below which a footprint is a square, along the axes of the map
_FAR = 4.0  # sides of a column to the middle of a triangle of neighbours, beyond which they are none


class Footprints(NamedTuple):
    """Rectangles float64[n]: `length` along the unit vector (`east`, `north`), `width` across [m]."""

    length: np.ndarray
    width: np.ndarray
    east: np.ndarray
    north: np.ndarray


def squares(area):
    """Footprints of columns of `area` [m2] without stretch."""
    side = np.sqrt(area)
    return Footprints(side, side, np.ones(len(side)), np.zeros(len(side)))


def stretched(x, y, area):
    """Footprints of columns at map points `x`, `y` [m], stretched as their Voronoi cells are.

    On a lattice with the steps a and b the sum of l d d^T over a point's neighbours at d, across an edge of length l of
    its cell, has the eigenvalues 2 a^2 b and 2 a b^2: their ratio is the stretch.
    """
    moments = _moments(x - x.mean(), y - y.mean(), np.sqrt(area))
    if moments is None:
        return squares(area)
    xx, xy, yy = moments
    half, middle = np.hypot(0.5 * (xx - yy), xy), 0.5 * (xx + yy)
    low = np.maximum(middle - half, 0.0)
    known = middle > 0
    stretch = np.where(known, (middle + half) / np.maximum(low, 1e-9 * np.where(known, middle, 1.0)), 1.0)
    stretch = np.minimum(stretch, MOST_STRETCHED)
    angle = np.where(stretch > SQUARE, 0.5 * np.arctan2(2.0 * xy, xx - yy), 0.0)
    stretch = np.where(stretch > SQUARE, stretch, 1.0)
    return Footprints(np.sqrt(area * stretch), np.sqrt(area / stretch), np.cos(angle), np.sin(angle))


def _moments(x, y, side):
    """(xx, xy, yy) of the sum of l d d^T for each column; None where there are too few to have neighbours."""
    from scipy.spatial import Delaunay, QhullError  # a tenth of a second that a run of columns alone does not need

    points = np.column_stack([x, y])
    try:
        corners = Delaunay(points).simplices
    except (QhullError, ValueError):
        return None
    corners = corners[_radius(points, corners) < _FAR * side[corners].max(axis=1)]
    total = np.zeros((3, len(x)))
    for k in range(3):
        apex, first, second = points[corners[:, k]], corners[:, (k + 1) % 3], corners[:, (k + 2) % 3]
        a, b = points[first] - apex, points[second] - apex
        twice_area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        d = points[second] - points[first]
        # the part of the cells' common edge within this triangle: half of |d| times the cotangent at the apex
        edge = 0.5 * (a * b).sum(axis=1) / np.maximum(twice_area, 1e-300) * np.hypot(d[:, 0], d[:, 1])
        for row, product in enumerate((d[:, 0] ** 2, d[:, 0] * d[:, 1], d[:, 1] ** 2)):
            for corner in (first, second):
                total[row] += np.bincount(corner, edge * product, len(x))
    return total


def _radius(points, corners):
    """Radius [m] of each triangle's circumscribed circle; infinite for a flat one."""
    a, b, c = (points[corners[:, k]] for k in range(3))
    sides = [np.hypot(*(p - q).T) for p, q in ((a, b), (b, c), (c, a))]
    twice_area = np.abs((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))
    with np.errstate(divide="ignore", over="ignore"):
        return sides[0] * sides[1] * sides[2] / (2.0 * twice_area)


_WELL = 1e-12
_LONGER = 1e-6  # share by which a piece may be longer than requested, or cells by which a place may miss one: rounding
_DENSE = 16  # times as many cells as points, up to which points are counted in a table of all cells


@dataclass(frozen=True, eq=False)
class Pieces:
    """What stacks of points are set on: a whole column each, or one of the rectangles that it is cut into.

    Parameters
    ----------
    column : int64[k]
        Row of the column in its frame.
    east, north : float64[k] [m]
        Middle of the piece, from the column's.
    side : float64[k] [m]
        Of the square of its area.
    share : float64[k]
        Of the column's mass, volume and area.
    bed : float64[k] [m]
        Elevation of the ground under the middle.
    gradient_east, gradient_north : float64[k]
    """

    column: np.ndarray
    east: np.ndarray
    north: np.ndarray
    side: np.ndarray
    share: np.ndarray
    bed: np.ndarray
    gradient_east: np.ndarray
    gradient_north: np.ndarray

    def __len__(self):
        return len(self.column)

    def take(self, index):
        """The pieces that `index` (bool or int) picks."""
        return Pieces(**{name: values[index] for name, values in vars(self).items()})


def cut(x, y, footprints, size, ground):
    """Cut columns at map points `x`, `y` [m] on `ground` into adjacent rectangles.

    A piece without ground below its middle is put in the middle of its column, so that no mass is lost at the
    rim of the terrain; columns that have none there themselves make no piece.

    Parameters
    ----------
    x, y : float64[n] [m]
    footprints : Footprints
        Of the columns.
    size : float or None [m]
        No piece is longer than that (None: columns stay whole).
    ground : Ground

    Returns
    -------
    Pieces
    """
    bed, on_ground = _bed(ground, x, y)
    columns = np.flatnonzero(on_ground)
    length, width, along_east, along_north = (values[columns] for values in footprints)
    lengthwise, across = pieces_along(length, size), pieces_along(width, size)
    if (lengthwise * across == 1).all():
        zero = np.zeros(len(columns))
        slopes = ground.gradient(x[columns], y[columns])
        side = np.sqrt(length * width)
        return Pieces(columns, zero, zero.copy(), side, np.ones(len(columns)), bed[columns], *slopes)
    of, number = runs(lengthwise * across)
    m, n = lengthwise[of], across[of]
    s = ((number % m + 0.5) / m - 0.5) * length[of]
    t = ((number // m + 0.5) / n - 0.5) * width[of]
    east, north = s * along_east[of] - t * along_north[of], s * along_north[of] + t * along_east[of]
    column = columns[of]
    height, there = _bed(ground, x[column] + east, y[column] + north)
    east, north = np.where(there, east, 0.0), np.where(there, north, 0.0)
    height = np.where(there, height, bed[column])
    slopes = ground.gradient(x[column] + east, y[column] + north)
    side = np.sqrt((length * width)[of] / (m * n))
    return Pieces(column, east, north, side, 1.0 / (m * n), height, *slopes)


def pieces_along(side, size):
    """int64[n]: pieces that `side` [m] is cut into, none longer than `size` [m] but for rounding (None: one)."""
    if size is None:
        return np.ones(len(side), np.int64)
    return np.maximum(np.ceil(side / size * (1.0 - _LONGER)), 1.0).astype(np.int64)


def _bed(ground, x, y):
    height = ground.height(x, y)
    return height, np.isfinite(height)


def runs(counts):
    """(int64[k], int64[k]) for k = sum of `counts`: the run that each of the k belongs to, and its number in it."""
    of = np.repeat(np.arange(len(counts)), counts)
    starts = np.cumsum(counts) - counts
    return of, np.arange(len(of)) - starts[of]


def within(pieces, x, y, window):
    """bool[k]: pieces whose middle is in the polygon `window` (None: everywhere)."""
    if window is None:
        return np.ones(len(pieces), bool)
    shapely.prepare(window)
    return shapely.contains_xy(window, x[pieces.column] + pieces.east, y[pieces.column] + pieces.north)


def piece_velocity(pieces, velocity, gradient):
    """(u, v) float64[k] each: horizontal velocity of the pieces, of columns that move at `velocity` [n, 3] [m s-1].

    Where a column has a velocity `gradient` [n, 2, 2] [s-1] (None: unknown) its pieces move by it, about a mean
    that stays the column's.
    """
    u, v = velocity[pieces.column, 0], velocity[pieces.column, 1]
    if gradient is None or not (pieces.east.any() or pieces.north.any()):
        return u, v
    size = len(velocity)
    count = np.maximum(np.bincount(pieces.column, minlength=size), 1)
    east = pieces.east - (np.bincount(pieces.column, pieces.east, size) / count)[pieces.column]
    north = pieces.north - (np.bincount(pieces.column, pieces.north, size) / count)[pieces.column]
    c = gradient[pieces.column]
    return u + c[:, 0, 0] * east + c[:, 0, 1] * north, v + c[:, 1, 0] * east + c[:, 1, 1] * north


@dataclass(frozen=True)
class Cover:
    """How pieces cover the cells of a square lattice.

    `covered` float64[k] [1] is the area of all pieces in a piece's cell over the cell's area, and `thickness`
    float64[k] [m] thickness of their mass there, over the whole cell.
    """

    covered: np.ndarray
    thickness: np.ndarray


def cover(pieces, x, y, volume, cell):
    """The Cover of `pieces` with `volume` float64[k] [m3] on a lattice of `cell` [m]: exact shares of their squares.

    Pieces must be narrower than a cell.
    """
    west, south = (at - 0.5 * pieces.side for at in (x[pieces.column] + pieces.east, y[pieces.column] + pieces.north))
    column, right = _first_cell(west - west.min(), pieces.side, cell)
    row, upper = _first_cell(south - south.min(), pieces.side, cell)
    width = int(column.max()) + 2
    keys, shares = [], []
    for j, by_row in ((0, 1.0 - upper), (1, upper)):
        for i, by_column in ((0, 1.0 - right), (1, right)):
            keys.append((row + j) * width + column + i)
            shares.append(by_row * by_column)
    cells, cell_of = np.unique(np.concatenate(keys), return_inverse=True)
    share = np.concatenate(shares)
    area = np.bincount(cell_of, share * np.tile(pieces.side**2, 4), len(cells)) / cell**2
    thickness = np.bincount(cell_of, share * np.tile(volume, 4), len(cells)) / cell**2
    own = cell_of.reshape(4, -1)[2 * (upper > 0.5) + (right > 0.5), np.arange(len(pieces))]
    return Cover(area[own], thickness[own])


def _first_cell(start, side, cell):
    """Cell in which a piece starts, and its share in the next one."""
    first = np.floor(start / cell)
    beyond = np.clip((start + side - (first + 1.0) * cell) / side, 0.0, 1.0)
    return first.astype(np.int64), np.where(beyond < _WELL, 0.0, beyond)


def count_by_cell(x, y, z, cell):
    """int64[m]: points in each non-empty cube of `cell` [m]."""
    rank = [np.floor((at - at.min()) / cell + _LONGER).astype(np.int64) for at in (x, y, z)]
    size = [int(r.max()) + 1 for r in rank]
    key = (rank[2] * size[1] + rank[1]) * size[0] + rank[0]
    if size[0] * size[1] * size[2] > _DENSE * len(x):
        return np.unique(key, return_counts=True)[1]
    counts = np.bincount(key)  # a table instead of a sort
    return counts[counts > 0]


SMALLEST_STEP = 1e-6  # [m] that the points' origin is rounded to


@dataclass(frozen=True, eq=False)
class Stacks:
    """`pieces` with their `thickness` [m], their number of points `count`, and their horizontal velocity `u`, `v`."""

    pieces: Pieces
    thickness: np.ndarray
    count: np.ndarray
    u: np.ndarray
    v: np.ndarray

    def take(self, index):
        return Stacks(self.pieces.take(index), self.thickness[index], self.count[index], self.u[index], self.v[index])


def _frame_of(frame, stacks, gradient, spacing, options):
    """The points of `stacks` as a Frame."""
    particles, pieces = frame.particles, stacks.pieces
    east, north = (
        particles.position[pieces.column, axis] + shift for axis, shift in ((0, pieces.east), (1, pieces.north))
    )
    origin, shift = _origin(frame, east, north, pieces.bed)
    each = pieces.share / stacks.count
    ids = particles.id if particles.id is not None else np.arange(len(particles), dtype=np.uint64)
    points, depth, stress = _filled(
        stacks.count,
        options.placement == "paper",
        np.column_stack([east + shift[0], north + shift[1], pieces.bed - origin[2]]),
        stacks.thickness,
        np.column_stack([stacks.u, stacks.v, _climb(stacks, options)]),
        _divergence(pieces, gradient, options),
        np.column_stack([particles.mass[pieces.column] * each, particles.volume[pieces.column] * each]),
        _load(particles, pieces, options),
        ids[pieces.column],
    )
    state = {}
    if options.placement != "paper":
        state = {"depth": depth, "vertical_stress": stress}
        if gradient is not None and gradient.any():
            state["affine"] = np.repeat(_affine(gradient[pieces.column], pieces, options), stacks.count, axis=0)
    header = {name: value for name, value in frame.header.items() if name != "cell_size"}
    header |= {"converted_spacing": spacing, "converted_vertical_velocity": options.vertical_velocity}
    header |= {"cell_size": options.cell} if options.cell is not None else {}
    header.setdefault("density", float(particles.mass.sum() / particles.volume.sum()))
    return replace(
        frame, particles=points, dimension=3, solver="convert", origin=origin, header=header, maxima={}, state=state
    )


def _filled(count, printed, place, thickness, motion, divergence, shares, load, parent):
    """(Particles, depth, vertical stress) of stacks; the last two are empty as printed, without initial stress."""
    n = int(count.sum())
    points = Particles(
        np.empty((n, 3)), np.empty((n, 3)), np.empty(n), np.empty(n), id=np.arange(n, dtype=np.uint64),
        parent=np.empty(n, np.uint64),
    )  # fmt: skip
    depth, stress = np.empty((2, 0 if printed else n))
    stack_kernel.fill_stacks(
        count, printed, place, thickness, motion, divergence, shares, load, parent,
        points.position, points.velocity, points.mass, points.volume, points.parent, depth, stress,
    )  # fmt: skip
    return points, depth, stress


def _origin(frame, east, north, bed):
    """(origin in the middle of the points, so that float32 files are exact; shift of x and y to it).

    In whole metres, or below 1 m of extent in a power of ten of a metre that is no longer than that.
    """
    old = np.asarray(frame.origin, float)
    extent = max(np.ptp(east), np.ptp(north), np.ptp(bed), SMALLEST_STEP)
    step = min(1.0, 10.0 ** np.floor(np.log10(extent)))
    middle = [0.5 * (at.min() + at.max()) for at in (east + old[0], north + old[1], bed)]
    origin = tuple(float(np.rint(value / step) * step) for value in middle)
    return origin, (old[0] - origin[0], old[1] - origin[1])


def _climb(stacks, options):
    """float64[k] [m s-1]: vertical velocity at the foot of the stacks."""
    if options.vertical_velocity == "paper":
        return np.zeros(len(stacks.pieces))
    return stacks.u * stacks.pieces.gradient_east + stacks.v * stacks.pieces.gradient_north


def _divergence(pieces, gradient, options):
    """float64[k] [s-1]: div u, by which the vertical velocity falls with height if requested."""
    if options.vertical_velocity != "linear":
        return np.zeros(len(pieces))
    if gradient is None:
        raise InputError(
            "vertical velocity 'linear' requires the velocity gradient of columns, which only the newest two frames of "
            "a run contain; use 'tangent'"
        )
    return (gradient[:, 0, 0] + gradient[:, 1, 1])[pieces.column]


def _load(particles, pieces, options):
    """float64[k] [Pa m-1]: vertical stress per metre below the surface."""
    density = (particles.mass / particles.volume)[pieces.column]
    cosine = slope_cosine(pieces.gradient_east, pieces.gradient_north)
    return geostatic.vertical_stress(density, options.gravity, 1.0, cosine)


def _affine(gradient, pieces, options):
    """float64[k, 3, 3] [s-1]: initial velocity gradient of the points of a piece."""
    affine = np.zeros((len(pieces), 3, 3))
    affine[:, :2, :2] = gradient
    if options.vertical_velocity != "paper":
        slope = np.stack([pieces.gradient_east, pieces.gradient_north], axis=1)
        affine[:, 2, :2] = np.einsum("kij,ki->kj", gradient, slope)
    if options.vertical_velocity == "linear":
        affine[:, 2, 2] = -(gradient[:, 0, 0] + gradient[:, 1, 1])
    return affine
