"""Convert points to columns: the inverse of Algorithm 2 of MOX report 15/2025."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..frames.particles import Frame, Particles
from ..laws.quantities import GRAVITY
from ..system.errors import InputError
from .conserved_sums import NOTHING, Sums, sums_of
from .conversion_options import LAY, REFUSE, ColumnOptions
from .ground_below import GroundBelow, slope_cosine
from .point_groups import Groups, PointsOverGround, cells_of, grouped

if TYPE_CHECKING:
    from ..terrain.elevation import Terrain

GAP_CELLS = 2.0  # [cells] of the 3D code that a column may be clear of the bed
WIDEST_SLICE = 1.5  # [spacings] most that a single point can represent
NORMAL_SHARE = 0.2  # [1] largest speed across the slope over the speed along it
LIFT_CELLS = 0.1  # [cells] a speed across the slope that cannot lift the flow so high is ignored: the flow is at rest
_FLAT = 1e-9  # [1] determinant of the points' spread, over its squared trace, below which no gradient can be computed


@dataclass(frozen=True)
class ColumnsReport:
    """Figures of a conversion to columns.

    The masses and momenta of `after`, `bed`, `outside` and `detached` add up to those of `before`.

    Parameters
    ----------
    before : Sums
        Of all points.
    after : Sums
        Of the columns.
    outside : Sums
        Of points with no ground under them.
    detached : Sums
        Of points that leave the bed or are clear of it.
    by : str
        "parent" or "cell".
    cell_area : float or None [m2]
        Of the cells that points were gathered in.
    apart : float
        Share of the mass of columns whose points have moved apart, for points with parents, else 0.
    bed : Sums
        Momentum and kinetic energy of the motion across the bed, which the bed takes; without mass.
    kinetic_lost : float [J]
        Of the points' motion about their columns'.
    laid : float [kg]
        Mass above the bed or leaving it that was moved onto it.
    """

    before: Sums
    after: Sums
    outside: Sums
    detached: Sums
    by: str
    cell_area: float | None
    apart: float
    bed: Sums
    kinetic_lost: float
    laid: float = 0.0


@dataclass(frozen=True)
class Columns:
    """Result of a conversion to columns.

    Parameters
    ----------
    frame : Frame
        Of columns.
    rest : Frame or None
        Of the points that stay points; None without any.
    report : ColumnsReport
    """

    frame: Frame
    rest: Frame | None
    report: ColumnsReport


def points_to_columns(
    frame: Frame,
    terrain: "Terrain",
    options: ColumnOptions | None = None,
    gravity: float = GRAVITY,
    slopes: Callable | None = None,
) -> Columns:
    """Gather the points of a frame into columns on a terrain.

    A column has the mass, the centre and the momentum of its points tangential to the bed: v - (v . n) n with the
    normal n of the bed under its centre. It is never faster than the fastest of them. By parent its thickness is
    twice their mean height over the bed (exact for points of `columns_to_points`) and its area their volume over it;
    by cell its area is that of the cell and its thickness that of the mass at the density of the release.
    `state` of the result has `velocity_gradient` float64[n, 2, 2] [s-1].

    Parameters
    ----------
    frame : Frame
        Dimension 3, in the terrain's CRS.
    terrain : Terrain
    options : ColumnOptions, optional
    gravity : float [m s-2]
        Of the energies in the report.
    slopes : callable, optional
        Frame of columns -> float64[m, 2] [1], gradient of the bed of the solver that continues with them, NaN where it
        has none; default: that of the terrain.

    Returns
    -------
    Columns
        Points off the terrain, and detached ones if these are to be kept, are its `rest`.

    Raises
    ------
    InputError
        No points, values that are not finite, no mass on the terrain, mass that has left the bed, points by parent
        without parents or below their bed.
    """
    options = options or ColumnOptions()
    _require_points(frame)
    x, y, near = *frame.particles.position[:, :2].T, terrain.moved(-frame.origin[0], -frame.origin[1])
    ground = GroundBelow.under(near, x, y)
    bed = ground.height(x, y)
    on_ground = np.isfinite(bed)
    if not on_ground.any():
        raise InputError(
            f"none of the {len(x)} points is over {terrain.path or 'the terrain'}; use the terrain of this frame"
        )
    here = np.flatnonzero(on_ground)
    over = PointsOverGround(frame, here, bed[here], *(slope[here] for slope in ground.gradient(x, y)))
    groups, by, cell_area, apart = grouped(over, x[here], y[here], near, options)
    detached, laid = _detached(over, groups, _point_cell(frame, options)), 0.0
    if options.detached == LAY:
        laid, detached = float(over.mass[groups.spread(detached)].sum()), np.zeros(len(groups), bool)
    if detached.any() and options.detached == REFUSE:
        raise InputError(_detachment(over, groups, detached))
    if detached.all():
        raise InputError("all of the flow is clear of the bed or leaves it; no columns can be made")
    staying = groups.spread(detached)
    stays = np.ones(len(x), bool)
    stays[here[~staying]] = False
    rest = _rest(frame, stays)
    over, groups = over.take(~staying), groups.without(detached)
    columns, bed, lost = _frame_of(frame, over, groups, by, cell_area, near, slopes)
    report = _report(frame, columns, here[staying], ~on_ground, by, cell_area, apart, gravity)
    return Columns(columns, rest, replace(report, bed=bed, kinetic_lost=lost, laid=laid))


def unsettled_share(frame: Frame, terrain: "Terrain", cell: float, normal_share: float) -> float:
    """Compute the share of the mass [1] that columns cannot represent: clear of the bed, or moving across it.

    Parameters
    ----------
    frame : Frame
        Points, in the terrain's CRS.
    terrain : Terrain
    cell : float [m]
        Side of the columns' cells.
    normal_share : float [1]
        Of the speed along the slope that the speed across it may be.
    """
    x, y, near = *frame.particles.position[:, :2].T, terrain.moved(-frame.origin[0], -frame.origin[1])
    ground = GroundBelow.under(near, x, y)
    bed = ground.height(x, y)
    here = np.flatnonzero(np.isfinite(bed))
    if not len(here):
        return 0.0
    over = PointsOverGround(frame, here, bed[here], *(slope[here] for slope in ground.gradient(x, y)))
    groups = Groups(cells_of(x[here], y[here], near.grid, cell)[0])
    unsettled = _detached(over, groups, _point_cell(frame, ColumnOptions()), normal_share)
    return float(over.mass[groups.spread(unsettled)].sum() / frame.particles.mass.sum())


def _require_points(frame):
    particles = frame.particles
    if frame.dimension != 3:
        raise InputError("expected points (dimension 3), got columns; to points is the inverse (--to points)")
    if len(particles) == 0:
        raise InputError("the frame has no point")
    for name in ("position", "velocity", "mass", "volume"):
        values = getattr(particles, name).reshape(len(particles), -1)
        bad = ~np.isfinite(values).all(axis=1)
        if name in ("mass", "volume"):
            bad |= values[:, 0] <= 0
        if bad.any():
            row = int(np.argmax(bad))
            wanted = "above 0" if name in ("mass", "volume") else "finite"
            raise InputError(f"{name} of point {row} is {values[row].tolist()}, expected {wanted}")


def _point_cell(frame, options):
    """Grid spacing of the 3D code [m]: as given, from the frame, or with the usual 8 points a cell."""
    if options.point_cell is not None:
        return options.point_cell
    declared = frame.header.get("cell_size")
    return float(declared) if declared is not None else 2.0 * float(np.cbrt(frame.particles.volume.mean()))


def _flight(over, groups):
    """Return gap [m], Un and Ut [m s-1] of each column: distance of its lowest slice from the bed, mean velocity."""
    mass = groups.sum(over.mass)
    slopes = [groups.sum(over.mass * slope) / mass for slope in (over.slope_east, over.slope_north)]
    cosine = slope_cosine(*slopes)
    u, v, w = (groups.sum(over.mass * over.velocity[:, axis]) / mass for axis in range(3))
    across = (w - u * slopes[0] - v * slopes[1]) * cosine
    along = np.sqrt(np.maximum(u * u + v * v + w * w - across**2, 0.0))
    clear = np.maximum(groups.least(over.height) - _half_slice(over.frame), 0.0)
    return clear * cosine, across, along


def _half_slice(frame):
    """Height [m] of the lowest point of a column above the bed because it is in the middle of its slice.

    Points directly after a conversion are in slices of up to 1.5 times its spacing (`PointOptions.points_in`): a
    thinner column is one point, half its thickness above the bed. For other points it is unknown.
    """
    spacing = frame.header.get("converted_spacing")
    return 0.0 if spacing is None else 0.5 * WIDEST_SLICE * float(spacing)


def _detached(over, groups, point_cell, normal_share=NORMAL_SHARE):
    """bool[m]: columns that are clear of the bed, or leave it or land fast enough to matter."""
    gap, across, along = _flight(over, groups)
    lifts = across**2 > 2.0 * GRAVITY * LIFT_CELLS * point_cell
    return (gap > GAP_CELLS * point_cell) | ((np.abs(across) > normal_share * along) & lifts)


def _detachment(over, groups, detached):
    """The error for mass that has left the bed, with its worst column."""
    gap, across, along = _flight(over, groups)
    mass = groups.sum(over.mass)
    share = 100.0 * mass[detached].sum() / mass.sum()
    worst = np.flatnonzero(detached)[np.argmax(mass[detached])]
    point = over.position[np.flatnonzero(groups.of == worst)].mean(axis=0)
    east, north = point[0] + over.frame.origin[0], point[1] + over.frame.origin[1]
    return (
        f"{int(detached.sum())} of {len(groups)} columns with {share:.2g} % of the mass would be clear of the bed or "
        f"moving across it, the heaviest at E {east:.1f} N {north:.1f} ({gap[worst]:.2g} m clear, "
        f"{across[worst]:.2g} m/s across, {along[worst]:.2g} m/s along); convert later, "
        "or keep these points in 3D (--detached keep)"
    )


def _rest(frame, stays):
    """The points that stay points with their state, None where there are none."""
    if not stays.any():
        return None
    n = len(stays)
    state = {name: value[stays] for name, value in frame.state.items() if np.shape(value)[:1] == (n,)}
    return replace(frame, particles=frame.particles.take(stays), state=state, maxima={})


def _frame_of(frame, over, groups, by, cell_area, terrain, slopes):
    """(the columns as a Frame, Sums that the bed takes, kinetic energy [J] of the motion within columns)."""
    mass = groups.sum(over.mass)
    centre = np.column_stack([groups.sum(over.mass * over.position[:, axis]) / mass for axis in (0, 1)])
    density = _density(frame)
    if by == "parent":
        volume, thickness = groups.sum(over.volume), 2.0 * groups.sum(over.mass * over.height) / mass
        _require_thickness(thickness, groups)
        area = volume / thickness
    else:
        volume, area = mass / density, np.full(len(groups), cell_area)
        thickness = volume / area
    bed, *slope = _bed_at(over, groups, mass, centre, terrain)
    particles = Particles(
        np.column_stack([centre, bed - frame.origin[2]]),
        np.zeros((len(groups), 3)),
        mass,
        volume,
        thickness,
        area,
        groups.key.astype(np.uint64) if by == "parent" else np.arange(len(groups), dtype=np.uint64),
    )
    header = {k: v for k, v in frame.header.items() if k != "cell_size" and not k.startswith("converted_")}
    header |= {"density": density, "converted_by": by}
    columns = replace(frame, particles=particles, dimension=2, solver="convert", header=header, maxima={}, state={})
    slope = np.column_stack(slope)
    if slopes is not None:
        own = slopes(columns)
        slope = np.where(np.isfinite(own), own, slope)
    normal = np.column_stack([-slope, np.ones(len(groups))]) * slope_cosine(*slope.T)[:, None]
    mean = np.column_stack([groups.sum(over.mass * over.velocity[:, axis]) / mass for axis in range(3)])
    across = (mean * normal).sum(axis=1)[:, None] * normal
    particles.velocity[:, :2] = (mean - across)[:, :2]
    particles.velocity[:, 2] = (particles.velocity[:, :2] * slope).sum(axis=1)
    taken = sums_of(mass, mean - particles.velocity, np.zeros(len(groups)), 0.0)._replace(count=0, mass=0.0)
    within = 0.5 * float((over.mass * (over.velocity**2).sum(axis=1)).sum() - (mass * (mean**2).sum(axis=1)).sum())
    gradient = _gradients(over, groups, mass, centre, normal)
    return replace(columns, state={"velocity_gradient": gradient}), taken, within


def _density(frame):
    declared = frame.header.get("density")
    return float(declared) if declared is not None else float(frame.particles.mass.sum() / frame.particles.volume.sum())


def _require_thickness(thickness, groups):
    low = thickness <= 0
    if low.any():
        raise InputError(
            f"the points of {int(low.sum())} of {len(groups)} columns are below the bed, the first of parent "
            f"{int(groups.key[np.argmax(low)])}; bin them on cells (by cell)"
        )


def _bed_at(over, groups, mass, centre, terrain):
    """Bed [m] and its gradient under the centres; the mean under the points where a centre has no ground."""
    x, y = centre[:, :2].T
    ground = GroundBelow.under(terrain, x, y)
    found = (ground.height(x, y), *ground.gradient(x, y))
    means = (groups.sum(over.mass * values) / mass for values in (over.bed, over.slope_east, over.slope_north))
    return [np.where(np.isfinite(a), a, b) for a, b in zip(found, means, strict=True)]


def _gradients(over, groups, mass, centre, normal):
    """float64[m, 2, 2] [s-1]: velocity gradient of each column, the least-squares fit of its points' velocities.

    Of their tangential part, as the column's velocity. Where they are above each other, so that no fit is possible,
    the mean of the points, else 0.
    """
    dx, dy = (over.position[:, axis] - groups.spread(centre[:, axis]) for axis in (0, 1))
    xx, xy, yy = (groups.sum(over.mass * a) / mass for a in (dx * dx, dx * dy, dy * dy))
    determinant = xx * yy - xy * xy
    fits = determinant > _FLAT * (xx + yy) ** 2
    inverse = np.divide(1.0, determinant, out=np.zeros(len(groups)), where=fits)
    gradient = np.empty((len(groups), 2, 2))
    of_points = groups.spread(normal)
    across = (over.velocity * of_points).sum(axis=1)
    for i in (0, 1):
        speed = over.velocity[:, i] - across * of_points[:, i]
        off = over.mass * (speed - groups.spread(groups.sum(over.mass * speed) / mass))
        ax, ay = groups.sum(off * dx) / mass, groups.sum(off * dy) / mass
        gradient[:, i, 0], gradient[:, i, 1] = (ax * yy - ay * xy) * inverse, (ay * xx - ax * xy) * inverse
    own = over.frame.particle_state("affine", 3, 3)
    if own is not None:
        for j in (0, 1):
            mean = np.column_stack([groups.sum(over.mass * own[over.index, i, j]) / mass for i in range(3)])
            mean -= (mean * normal).sum(axis=1)[:, None] * normal
            gradient[:, :, j] = np.where(fits[:, None], gradient[:, :, j], mean[:, :2])
    return gradient


def _report(frame, columns, detached, outside, by, cell_area, apart, gravity):
    particles = frame.particles

    def points(index):
        if not len(particles.mass[index]):
            return NOTHING
        return sums_of(
            particles.mass[index], particles.velocity[index], particles.position[index, 2] + frame.origin[2], gravity
        )

    after = columns.particles
    return ColumnsReport(
        before=points(slice(None)),
        after=sums_of(
            after.mass, after.velocity, after.position[:, 2] + frame.origin[2] + 0.5 * after.thickness, gravity
        ),
        outside=points(outside),
        detached=points(detached),
        by=by,
        cell_area=cell_area,
        apart=apart,
        bed=NOTHING,
        kinetic_lost=0.0,
    )
