"""What moves in a 3D scene: the points at its start, with the stress of their weight."""

from dataclasses import dataclass, replace

import numpy as np

from ..conversion.account import account_of_points
from ..conversion.starting import lying_in, point_options, points_from, standing
from ..errors import InputError
from ..io.by_place import read_area
from ..io.frames import read_frame
from ..scene.tables import DENSITY
from ..solvers.cost import require_memory_for_points
from .sources import columns_of, placed_on, read_sources


@dataclass(frozen=True)
class PointStart:
    """The points of one scene.

    Parameters
    ----------
    frame : Frame
        Dimension 3, at time 0.
    vertical_stress : float64[n] [Pa] or None
        Of their weight; None where nothing tells it.
    affine : float64[n, 3, 3] [s-1] or None
        Velocity gradient; None where nothing tells it, or all move alike.
    seen : Frame
        The same mass as columns, to decide effects from.
    """

    frame: object
    vertical_stress: np.ndarray | None
    affine: np.ndarray | None
    seen: object


def read_point_start(scene, terrain, grid, say):
    """The PointStart of `scene` on `terrain`; `grid` is the solver's, seen from above.

    Raises
    ------
    InputError
        What a file holds cannot be used; points under the ground; too many for this machine.
    """
    table, cell_size = scene.release, scene.numerics.cell_size
    path = None if table.particles is None else scene.path(table.particles)
    if path is not None and read_frame(path, with_state=False, with_particles=False).dimension == 3:
        return _points_of(path, terrain, cell_size, DENSITY, _window(scene, terrain, say), say)
    return _converted(_columns_of(scene, path, terrain, grid, say), scene, terrain, say)


def _columns_of(scene, path, terrain, grid, say):
    """Columns out of the file at `path`, or seeded in the release."""
    if path is not None:
        return columns_of(path, terrain, DENSITY, say, with_state=True, window=_window(scene, terrain, say))
    return read_sources(scene, terrain, grid, say).frame


def _converted(columns, scene, terrain, say):
    """Points out of a frame of columns; what a conversion of somebody's columns keeps is told."""
    options = point_options(scene.numerics.cell_size, scene.numerics.points_per_side)
    window = _window(scene, terrain, say)
    seen = columns if window is None else lying_in(columns, window)
    require_memory_for_points(options.predicted_points(seen.particles), options.cell)
    points = points_from(columns, terrain, options, window)
    _tell_of_outside(points.report.outside.mass, points.report.before.mass, say)
    if scene.release.particles is not None:
        for line in account_of_points(points.report, options)[:2]:
            say(line)
    state, frame = points.frame.state, replace(points.frame, state={}, time=0.0, step=0)
    return PointStart(frame, state["vertical_stress"], state.get("affine"), replace(seen, state={}))


def _window(scene, terrain, say):
    """The polygons of [release] window as one; None without it."""
    name = scene.release.window
    return None if name is None else read_area(scene.path(name), terrain, say)


def _tell_of_outside(outside, mass, say):
    """What a window leaves out."""
    if outside > 0.0:
        say(f"[release] window leaves out {outside:.6g} of {mass:.6g} kg ({100 * outside / mass:.2g} %)")


def _points_of(path, terrain, cell_size, density, window, say):
    """Points out of the frame at `path`, those in `window`."""
    frame = placed_on(read_frame(path), path, terrain, density, say, window)
    if window is not None:
        mass = float(frame.particles.mass.sum())
        frame = lying_in(frame, window)
        _tell_of_outside(mass - float(frame.particles.mass.sum()), mass, say)
    stress, affine = frame.told("vertical_stress"), frame.told("affine", 3, 3)
    if stress is None:
        say(f"{path} tells no stress of its points' weight: they start without, and settle on their own elasticity")
    x, y = frame.map_xy()
    above = frame.particles.position[:, 2] + frame.origin[2] - terrain.sample(x, y)
    under = above < -cell_size
    if under.any():
        raise InputError(
            f"{path}: {int(under.sum())} of {len(under)} points start more than a cell of {cell_size:g} m under the "
            f"ground, the worst by {-above[under].min():.3g} m; use the DTM that they were made on"
        )
    return PointStart(replace(frame, state={}), stress, affine, standing(frame, terrain, cell_size))
