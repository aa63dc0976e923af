"""Make stacks of points from pieces of columns: positions, velocities, stress and affine velocity."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..frames.particles import Particles
from ..system.errors import InputError
from .column_pieces import Pieces
from .ground_below import slope_cosine, vertical_stress
from .stack_filling import PointRows, StackRows, fill_stacks

if TYPE_CHECKING:
    from ..frames.particles import Frame
    from .conversion_options import PointOptions

SMALLEST_STEP = 1e-6  # [m] smallest unit to which the origin of the points is rounded


@dataclass(frozen=True, eq=False)
class Stacks:
    """Stacks of points, one on each piece of a column.

    Parameters
    ----------
    pieces : Pieces
    thickness : float64[k] [m]
    count : int64[k]
        Points in each stack.
    u, v : float64[k] [m s-1]
        Horizontal velocity.
    """

    pieces: Pieces
    thickness: np.ndarray
    count: np.ndarray
    u: np.ndarray
    v: np.ndarray

    def take(self, index: np.ndarray) -> "Stacks":
        """Return some of the stacks.

        Parameters
        ----------
        index : bool[k] or int64[m]
        """
        return Stacks(self.pieces.take(index), self.thickness[index], self.count[index], self.u[index], self.v[index])


def frame_of(
    frame: "Frame", stacks: Stacks, gradient: np.ndarray | None, spacing: float, options: "PointOptions"
) -> "Frame":
    """Return the points of stacks as a frame.

    Parameters
    ----------
    frame : Frame
        Of the columns.
    stacks : Stacks
    gradient : float64[n, 2, 2] or None [s-1]
        Velocity gradient of each column; None: not known.
    spacing : float [m]
        Vertical distance of points.
    options : PointOptions

    Raises
    ------
    InputError
        Vertical velocity "linear" without velocity gradients.
    """
    particles, pieces = frame.particles, stacks.pieces
    east, north = (
        particles.position[pieces.column, axis] + shift for axis, shift in ((0, pieces.east), (1, pieces.north))
    )
    origin, shift = _origin(frame, east, north, pieces.bed)
    each = pieces.share / stacks.count
    ids = particles.id if particles.id is not None else np.arange(len(particles), dtype=np.uint64)
    rows = StackRows(
        stacks.count,
        np.column_stack([east + shift[0], north + shift[1], pieces.bed - origin[2]]),
        stacks.thickness,
        np.column_stack([stacks.u, stacks.v, _climb(stacks, options)]),
        _divergence(pieces, gradient, options),
        np.column_stack([particles.mass[pieces.column] * each, particles.volume[pieces.column] * each]),
        _load(particles, pieces, options),
        ids[pieces.column],
    )
    points, depth, stress = _filled(rows, options.placement == "paper")
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


def _filled(stacks, printed):
    """Return Particles, depth and vertical stress of stacks; the last two are empty where Eq (2) is as printed."""
    n = int(stacks.count.sum())
    points = Particles(
        np.empty((n, 3)),
        np.empty((n, 3)),
        np.empty(n),
        np.empty(n),
        id=np.arange(n, dtype=np.uint64),
        parent=np.empty(n, np.uint64),
    )
    depth, stress = np.empty((2, 0 if printed else n))
    rows = PointRows(points.position, points.velocity, points.mass, points.volume, points.parent, depth, stress)
    fill_stacks(stacks, printed, rows)
    return points, depth, stress


def _origin(frame, east, north, bed):
    """Return an origin in the middle of the points, so that float32 files are exact, and the shift of x and y to it.

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
    return vertical_stress(density, options.gravity, 1.0, cosine)


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
