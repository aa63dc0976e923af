"""A look over the frames before they are exported: where the flow is, and what Eqs 15 and 17 need to know."""

import numpy as np

from ..kernels import binning
from .bed import place
from .cells import bin_frame, column_reach, grid_spacing
from .depth_average import map_speed, volume_thickness
from .sampling import FrameFacts, export_axes, export_grid

RESTING_BELOW = 0.01  # share of the mass below the bed from which a code's own offset is assumed


def reached(frame, bed, axes):
    """(First column, first row, last column, last row) [m] of what lies on the DTM; None where nothing does.

    Parameters
    ----------
    frame : Frame
        Of its particles only `position` is used, and `area` of columns, which count with the ground they stand for.
    bed : Bed
    axes : Grid
        `export_axes`, along which the answer is.
    """
    particles, bounds = frame.particles, np.empty(4)
    half = column_reach(frame) if frame.dimension == 2 else np.zeros(1)
    origin = np.asarray(frame.origin, float)
    count = binning.reach(
        particles.position, half, origin, bed.grid.corner, bed.grid.axes, bed.elevation,
        bed.clamped and frame.dimension == 3, axes.corner, axes.axes, bounds,
    )  # fmt: skip
    return tuple(bounds.tolist()) if count else None


def survey_frame(frame, bed, density, axes=None):
    """What `frame` contributes to the choice of cells and of the standoff.

    Parameters
    ----------
    frame : Frame
    bed : Bed
    density : float [kg m-3]
        Of the release.
    axes : Grid, optional
        `export_axes` that the bounds are along (default: north-up).

    Returns
    -------
    FrameFacts
    """
    placed, particles = place(frame, bed), frame.particles
    inside = placed.inside
    if not inside.any():
        return FrameFacts(None, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    released = particles.mass / density
    volume = float(released.mean())
    below, offset = 0.0, 0.0
    if frame.dimension == 3:
        below, offset = resting_offset(placed.distance[inside], particles.mass[inside])
    return FrameFacts(
        bounds=reached(frame, bed, export_axes(bed.grid) if axes is None else axes),
        particle_volume=volume,
        dilation=min(1.0, float(np.quantile(released / particles.volume, 0.1))),
        thickness=_median_thickness(frame, placed, bed, density),
        spacing=grid_spacing(frame),
        below=below,
        offset=offset,
        column_side=float(np.sqrt(particles.area.mean())) if frame.dimension == 2 else 0.0,
    )


def _median_thickness(frame, placed, bed, density):
    cells = bin_frame(frame, placed, bed, export_grid(bed.grid), density)
    thickness = volume_thickness(cells)
    thickness = thickness[thickness > 0]
    return float(np.median(thickness)) if len(thickness) else 0.0


def resting_offset(distance, mass):
    """How far below the DTM a grid-based code lets its particles rest.

    Parameters
    ----------
    distance : float[n] [m]
        From the bed, NaN where unknown.
    mass : float[n] [kg]

    Returns
    -------
    (float, float)
        Share of the mass below the bed, and the distance [m] that only 1 % of the mass lies under.
    """
    known = np.isfinite(distance)
    distance, mass = distance[known], mass[known]
    below = distance < 0
    share = float(mass[below].sum() / mass.sum()) if len(mass) else 0.0
    if share < RESTING_BELOW:
        return share, 0.0
    order = np.flatnonzero(below)[np.argsort(distance[below], kind="stable")]
    rank = np.searchsorted(np.cumsum(mass[order]), RESTING_BELOW * mass.sum())
    return share, float(distance[order[min(rank, len(order) - 1)]])


def automatic_standoff(facts):
    """The standoff [m] of the frame with the largest share of its mass below the bed; 0 where that is under 1 %.

    It is the distance that only 1 % of that frame's mass lies under: grid-based codes hold particles off nodes and
    not off the DTM, so that they come to rest up to a cell below it, and all distances are short by that much.
    """
    deepest = max(facts, key=lambda fact: fact.below)
    return deepest.offset if deepest.below >= RESTING_BELOW else 0.0


def fastest_mean(frame, bed, grid, density):
    """Largest depth-averaged speed [m s-1] in the map plane over the cells of `grid` (for Eq 17)."""
    speed = map_speed(bin_frame(frame, place(frame, bed), bed, grid, density))
    return float(np.nanmax(speed)) if np.isfinite(speed).any() else 0.0
