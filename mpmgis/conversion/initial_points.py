"""Make the initial state of a 3D run: columns converted to points that fill its grid."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import shapely

from ..system.errors import InputError
from .columns_to_points import columns_to_points
from .conversion_options import PointOptions

if TYPE_CHECKING:
    from ..frames.particles import Frame
    from ..terrain.elevation import Terrain
    from .columns_to_points import Points


def point_options(cell_size: float, points_per_side: int) -> PointOptions:
    """Return the options of a conversion to points that fill the cells of a grid.

    Parameters
    ----------
    cell_size : float [m]
    points_per_side : int
        Along each side of a cell.
    """
    return PointOptions(spacing=cell_size / points_per_side, cell=cell_size)


def points_from(
    columns: "Frame", terrain: "Terrain", options: PointOptions, window: shapely.Polygon | None = None
) -> "Points":
    """Convert columns with ground below them to points.

    Parameters
    ----------
    columns : Frame
    terrain : Terrain
    options : PointOptions
    window : shapely.Polygon, optional
        Only columns inside; default: all.

    Raises
    ------
    InputError
        As `columns_to_points`; columns to convert without ground below them.
    """
    points = columns_to_points(columns, terrain, options, window)
    lost = 0 if points.rest is None else int(_bare(points.rest, terrain, window).sum())
    if lost:
        raise InputError(
            f"{lost} of {len(columns.particles)} columns have no ground below them; use a larger DTM, or a [terrain] "
            "window that contains them"
        )
    return points


def _bare(rest, terrain, window):
    """bool[n]: columns off the terrain, or in the window."""
    x, y = rest.map_xy()
    bare = ~np.isfinite(terrain.sample(x, y))
    return bare if window is None else bare & shapely.contains_xy(window, x, y)


def particles_in_window(frame: "Frame", window: shapely.Polygon) -> "Frame":
    """Return a frame with those of its particles that are in a window.

    Parameters
    ----------
    frame : Frame
    window : shapely.Polygon

    Raises
    ------
    InputError
        None is inside.
    """
    inside = shapely.contains_xy(window, *frame.map_xy())
    if not inside.any():
        raise InputError(f"none of the {len(inside)} particles is in [release] window; move it or remove it")
    return replace(frame, particles=frame.particles.take(inside), state=_rows_of(frame.state, inside))


def _rows_of(state, inside):
    """The arrays of `state` that have a row for each particle, of those `inside`."""
    return {name: values[inside] for name, values in state.items() if np.shape(values)[:1] == inside.shape}


def as_columns(frame: "Frame", terrain: "Terrain", cell_size: float) -> "Frame":
    """Return points as columns with the thickness of all mass in their cells.

    For decisions on effects: thickness and place of the flow.

    Parameters
    ----------
    frame : Frame
        Of points.
    terrain : Terrain
    cell_size : float [m]
    """
    particles = frame.particles
    west, _, _, north = terrain.grid.bounds
    x, y = frame.map_xy()
    cell = np.column_stack([np.floor((x - west) / cell_size), np.floor((north - y) / cell_size)]).astype(np.int64)
    _, number = np.unique(cell, axis=0, return_inverse=True)
    number = number.reshape(-1)
    thickness = (np.bincount(number, particles.volume) / cell_size**2)[number]
    seen = replace(particles, thickness=thickness, area=particles.volume / thickness)
    return replace(frame, particles=seen, dimension=2, state={})
