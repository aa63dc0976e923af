"""Convert columns to points: Algorithm 2 of MOX report 15/2025."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from shapely.affinity import translate

from ..frames.particles import Frame
from ..solvers.columns.column_rows import CXX, ROW
from ..system.errors import InputError
from .column_footprints import squares, stretched
from .column_pieces import count_by_cell, cover, cut, piece_velocity, within
from .conserved_sums import NOTHING, Sums, particle_mass_scatter, sums_of
from .conversion_options import MOST, PointOptions
from .ground_below import GroundBelow, slope_cosine
from .point_stacks import Stacks, frame_of

if TYPE_CHECKING:
    import shapely

    from ..terrain.elevation import Terrain

OVERLAP = 1.05  # [1] area of the columns in a cell over its area, above which they overlap
COVER_SIDES = 4  # [sides of the median column] along a cell in which overlap is evaluated: 16 columns tile it


@dataclass(frozen=True)
class PointsReport:
    """Figures of a conversion to points.

    `before` is the sum of `after`, `outside` and `deleted`.

    Parameters
    ----------
    before : Sums
        Of all columns.
    after : Sums
        Of the points.
    outside : Sums
        Of columns left as they are, off the terrain or outside the window.
    deleted : Sums
        Of columns that the printed algorithm deletes.
    spacing : float [m]
        Requested vertical distance of points.
    points_per_column : (int, float, int)
        Least, median and most points in a column, or in a piece of one.
    pieces_per_column : int
        Most pieces that a column was cut into.
    widest : float [m]
        Side of the widest column or piece, which is the widest gap between stacks of points.
    bed_shift : float [m]
        Largest difference of the columns' beds from the terrain's.
    second_moment : float [1]
        Of the columns' mass about their middle, over h^2/12.
    overlap : float [1]
        Largest area of columns over that of their ground, minus 1: the relative error of density there;
        NaN where no cell was given.
    largest_gap : float [m]
        Widest distance of two points above each other.
    launch : float [m s-1]
        Largest speed at which points start off the slope, normal to it.
    mass_scatter : float [kg]
        Eq (4) of the report over the points (`particle_mass_scatter`).
    momentum_scatter : float [kg m s-1]
        The same for momentum to the east.
    raised : int
        Pieces whose thickness was set to that of their mass.
    points_per_cell : (int, float, int) or None
        Least, median and most points in a cell of the 3D grid; None where no cell was given.
    """

    before: Sums
    after: Sums
    outside: Sums
    deleted: Sums
    spacing: float
    points_per_column: tuple
    pieces_per_column: int
    widest: float
    bed_shift: float
    second_moment: float
    overlap: float
    largest_gap: float
    launch: float
    mass_scatter: float
    momentum_scatter: float
    raised: int
    points_per_cell: tuple | None


@dataclass(frozen=True)
class Points:
    """Result of a conversion to points.

    Parameters
    ----------
    frame : Frame
        Of points.
    rest : Frame or None
        Of the columns that were left as they are; None without any.
    report : PointsReport
    """

    frame: Frame
    rest: Frame | None
    report: PointsReport


def columns_to_points(
    frame: Frame, terrain: "Terrain", options: PointOptions | None = None, window: "shapely.Polygon | None" = None
) -> Points:
    """Convert the columns of a frame to points on a terrain.

    Mass, volume and horizontal momentum are the columns', to rounding. Points are in the order of their columns, from
    the bed upwards; `parent` is a column's id. `state` of the result has a row per point: `depth` [m] below the surface
    and `vertical_stress` [Pa] (see `ground_below`), and `affine` [n, 3, 3] [s-1], the velocity gradient, where the
    frame has that of the columns. Places count from the frame's origin throughout, which keeps the digits that cells
    of millimetres need.

    Parameters
    ----------
    frame : Frame
        Dimension 2, in the terrain's CRS.
    terrain : Terrain
        Ground of the 3D solver; thickness is kept, the beds of the columns are not.
    options : PointOptions, optional
    window : shapely.Polygon, optional
        Only the part inside is converted; columns on its edge are cut if they are split at all.

    Returns
    -------
    Points

    Raises
    ------
    InputError
        No columns, values that are not finite, thickness below 0, no column on the terrain, too many points.
    """
    options = options or PointOptions()
    _require_columns(frame)
    particles, (x, y) = frame.particles, frame.particles.position[:, :2].T
    spacing = options.spacing_for(particles)
    _require_few_enough(options.predicted_points(particles), spacing)
    footprints = _footprints(frame, x, y, options)
    ground = GroundBelow.under(terrain.moved(-frame.origin[0], -frame.origin[1]), x, y, float(footprints.length.max()))
    pieces = cut(x, y, footprints, options.piece_size, ground)
    inside = within(pieces, x, y, None if window is None else translate(window, -frame.origin[0], -frame.origin[1]))
    _require_some(inside, len(particles), terrain, window)
    gradient = velocity_gradient(frame)
    u, v = piece_velocity(pieces, particles.velocity, gradient)
    rest = _rest(frame, pieces, inside, u, v, ground, gradient)
    here, u, v = pieces.take(inside), u[inside], v[inside]
    thickness, overlap, raised = _thickness(here, x, y, particles, options)
    count = options.points_in(thickness, spacing)
    _require_few_enough(count.sum(), spacing)
    stacks = Stacks(here, thickness, count.astype(np.int64), u, v)
    kept, deleted = _without_deleted(stacks, particles, options)
    points = frame_of(frame, kept, gradient, spacing, options)
    bed_shift = np.abs(particles.position[here.column, 2] + frame.origin[2] - ground.height(x, y)[here.column])
    numbers = {
        "spacing": spacing,
        "widest": float(here.side.max()),
        "overlap": overlap,
        "raised": raised,
        "bed_shift": float(bed_shift.max()),
    }
    return Points(points, rest, _report(frame, points, rest, kept, deleted, options, ground, numbers))


def _require_columns(frame):
    particles = frame.particles
    if frame.dimension != 2 or particles.area is None or particles.thickness is None:
        raise InputError("expected columns (dimension 2), got points; to columns is the inverse (--to columns)")
    if len(particles) == 0:
        raise InputError("the frame has no column")
    for name, values in particles.arrays().items():
        bad = ~np.isfinite(values).reshape(len(particles), -1).all(axis=1)
        if name in ("mass", "area", "volume"):
            bad |= values <= 0
        elif name == "thickness":
            bad |= values < 0
        if bad.any():
            row = int(np.argmax(bad))
            wanted = {"thickness": "0 or more"}.get(name, "above 0" if name in ("mass", "area", "volume") else "finite")
            raise InputError(f"{name} of column {_id(particles, row)} is {values[row]}, expected {wanted}")


def _id(particles, row):
    return int(particles.id[row]) if particles.id is not None else row


def _require_few_enough(count, spacing):
    if count > MOST:
        raise InputError(f"{count:.3g} points at a spacing of {spacing:g} m, expected at most {MOST}; take a wider one")


def _require_some(inside, columns, terrain, window):
    if not len(inside):
        raise InputError(
            f"none of the {columns} columns is on {terrain.path or 'the terrain'}; use the terrain of this frame"
        )
    if not inside.any():
        west, south, east, north = window.bounds
        raise InputError(
            f"none of the {columns} columns is in the window, E {west:.0f} to {east:.0f}, N {south:.0f} to "
            f"{north:.0f}; move it, or convert later"
        )


def velocity_gradient(frame: Frame) -> np.ndarray | None:
    """Return the velocity gradient du_i/dx_j of every column.

    The newest frames of a run keep it for a restart; columns that all move alike, as a seed's, have none.

    Parameters
    ----------
    frame : Frame
        Of columns.

    Returns
    -------
    float64[n, 2, 2] or None [s-1]
        None where the frame does not have it.
    """
    velocity, gradient, rows = (
        frame.particles.velocity,
        frame.particle_state("velocity_gradient", 2, 2),
        frame.particle_state("rows", ROW),
    )
    if gradient is not None:
        return gradient
    if rows is not None:
        return np.ascontiguousarray(rows[:, CXX : CXX + 4]).reshape(-1, 2, 2)
    if (velocity[:, :2] == velocity[0, :2]).all():
        return np.zeros((len(velocity), 2, 2))
    return None


def _footprints(frame, x, y, options):
    """Footprints of columns: stretched according to their neighbours if columns are cut; a seed has not moved yet."""
    area, size = frame.particles.area, options.piece_size
    if size is None or not options.stretched or frame.solver == "seed" or not (area > size**2).any():
        return squares(area)
    return stretched(x, y, area)


def _rest(frame, pieces, inside, u, v, ground, gradient):
    """The columns, or parts of them, that are not converted; None if there are none.

    What is left of a column has the share, the middle and the momentum of its pieces outside.
    """
    particles, n = frame.particles, len(frame.particles)
    out = pieces.take(~inside)
    share = np.bincount(out.column, out.share, n)
    whole = np.bincount(pieces.column[inside], minlength=n) == 0
    share[whole] = 1.0
    left = np.flatnonzero(share > 0)
    if not len(left):
        return None
    some = particles.take(left)
    for name in ("mass", "volume", "area"):
        setattr(some, name, getattr(some, name) * share[left])
    cut_off = np.flatnonzero(~whole[left])
    if len(cut_off):
        of = left[cut_off]
        east, north, u, v = (
            np.bincount(out.column, out.share * values, n)[of] / share[of]
            for values in (out.east, out.north, u[~inside], v[~inside])
        )
        some.position[cut_off, 0] += east
        some.position[cut_off, 1] += north
        x, y = some.position[cut_off, :2].T
        slope_east, slope_north = ground.gradient(x, y)
        motion = np.column_stack([u, v, u * slope_east + v * slope_north])
        bed = ground.height(x, y) - frame.origin[2]
        known = np.isfinite(bed)
        some.position[cut_off[known], 2], some.velocity[cut_off[known]] = bed[known], motion[known]
        some.velocity[cut_off, :2] = motion[:, :2]
    state = {} if gradient is None else {"velocity_gradient": gradient[left]}
    return replace(frame, particles=some, state=state, maxima={})


def _thickness(pieces, x, y, particles, options):
    """(float64[k] [m] thickness of the pieces, largest overlap, number of pieces raised)."""
    thickness = particles.thickness[pieces.column]
    if options.cell is None:
        return thickness, float("nan"), 0
    volume = particles.volume[pieces.column] * pieces.share
    cell = max(options.cell, COVER_SIDES * float(np.median(np.sqrt(particles.area))), float(pieces.side.max()))
    found = cover(pieces, x, y, volume, cell)
    over = found.covered > OVERLAP
    overlap = max(float(found.covered.max()) - 1.0, 0.0)
    if not options.relevel:
        return thickness, overlap, 0
    return np.where(over, found.thickness, thickness), overlap, int(over.sum())


def _without_deleted(stacks, particles, options):
    """(the stacks that become points, the mask of those that Eq (2) deletes)."""
    if not options.deletes_single_points:
        return stacks, None
    single = stacks.count == 1
    if single.all():
        raise InputError(
            "every column is thinner than two spacings, and the printed algorithm deletes columns of one point (Eq 2 "
            "is 0/0); take a smaller spacing, or leave out paper"
        )
    gone = np.bincount(stacks.pieces.column[single], minlength=len(particles)) > 0
    return stacks.take(~single), gone


def _report(frame, points, rest, stacks, gone, options, ground, numbers):
    particles, after, pieces = frame.particles, points.particles, stacks.pieces
    bed = ground.height(*particles.position[:, :2].T)
    middle = np.where(np.isfinite(bed), bed, particles.position[:, 2] + frame.origin[2]) + 0.5 * particles.thickness
    gravity = options.gravity
    deleted = outside = NOTHING
    if gone is not None and gone.any():
        deleted = sums_of(particles.mass[gone], particles.velocity[gone], middle[gone], gravity)
    if rest is not None:
        left = rest.particles
        surface = left.position[:, 2] + rest.origin[2] + left.thickness
        outside = sums_of(left.mass, left.velocity, surface - 0.5 * left.thickness, gravity)
    return PointsReport(
        before=sums_of(particles.mass, particles.velocity, middle, gravity),
        after=sums_of(after.mass, after.velocity, after.position[:, 2] + points.origin[2], gravity),
        outside=outside,
        deleted=deleted,
        pieces_per_column=int(np.bincount(pieces.column).max()),
        points_per_cell=None if options.cell is None else _spread(count_by_cell(*after.position.T, options.cell)),
        **_stack_facts(particles, stacks, options),
        **numbers,
    )


def _spread(counts):
    """(least, median, most)."""
    return int(counts.min()), float(np.median(counts)), int(counts.max())


def _stack_facts(particles, stacks, options):
    """Numbers of the stacks for the report, by name."""
    pieces, count = stacks.pieces, stacks.count.astype(float)
    mass, volume = (values[pieces.column] * pieces.share for values in (particles.mass, particles.volume))
    printed = options.placement == "paper"
    second_moment = (count + 1) / (count - 1) if printed else 1.0 - 1.0 / count**2
    across = np.zeros(len(pieces))
    if options.vertical_velocity == "paper":
        cosine = slope_cosine(pieces.gradient_east, pieces.gradient_north)
        across = -(stacks.u * pieces.gradient_east + stacks.v * pieces.gradient_north) * cosine
    return {
        "points_per_column": _spread(stacks.count),
        "second_moment": float((mass * second_moment).sum() / mass.sum()),
        "largest_gap": float((stacks.thickness / (count - 1 if printed else count)).max()),
        "launch": max(0.0, float(across.max())),
        "mass_scatter": particle_mass_scatter(count, mass, volume, mass.sum()),
        "momentum_scatter": particle_mass_scatter(count, mass, volume, (mass * stacks.u).sum(), stacks.u),
    }
