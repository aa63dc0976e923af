"""Initial state of a 3D run: columns converted to points that fill its grid, and the stress of their weight."""

from dataclasses import replace

import numpy as np
import shapely

from ..errors import InputError
from .options import PointOptions
from .points import columns_to_points


def point_options(cell_size, points_per_side):
    """PointOptions that fill cells of `cell_size` [m] with `points_per_side` points along each side."""
    return PointOptions(spacing=cell_size / points_per_side, cell=cell_size)


def points_from(columns, terrain, options, window=None):
    """The Points of a frame of `columns` on `terrain`, of those in `window` (shapely.Polygon) or of all.

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


def lying_in(frame, window):
    """`frame` with its particles in `window` (shapely.Polygon); InputError if there are none."""
    inside = shapely.contains_xy(window, *frame.map_xy())
    if not inside.any():
        raise InputError(f"none of the {len(inside)} particles is in [release] window; move it or remove it")
    return replace(frame, particles=frame.particles.take(inside), state=_rows_of(frame.state, inside))


def _rows_of(state, inside):
    """The arrays of `state` that have a row for each particle, of those `inside`."""
    return {name: values[inside] for name, values in state.items() if np.shape(values)[:1] == inside.shape}


def kirchhoff_stress(vertical_stress, bulk_modulus, shear_modulus):
    """float64[n, 6] [Pa]: xx, yy, zz, xy, xz, yz of points confined sideways under `vertical_stress` [Pa].

    sigma_xx = sigma_yy = nu / (1 - nu) sigma_zz; a `shear_modulus` of 0 is a fluid, in which all three are the same.
    The first step of a material returns stress beyond its yield surface.
    """
    lame = bulk_modulus - 2.0 / 3.0 * shear_modulus
    sideways = lame / (lame + 2.0 * shear_modulus) * vertical_stress
    nothing = np.zeros_like(vertical_stress)
    return np.column_stack([sideways, sideways, vertical_stress, nothing, nothing, nothing])


def standing(frame, terrain, cell_size):
    """`frame` of points as columns with the thickness of all mass in their cells of `cell_size` [m].

    For decisions on effects: thickness and place of the flow.
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
