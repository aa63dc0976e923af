"""What moves in a 3D scene: the points at its start, with the stress of their weight."""

from dataclasses import dataclass, replace

import numpy as np

from ..conversion.starting import point_options, points_from, standing
from ..errors import InputError
from ..io.frames import read_frame
from ..solvers.cost import require_memory_for_points
from .sources import columns_of, placed_on, read_sources

FEWEST_CELLS = 3.0  # that a flow should be thick for a 3D grid to see its shear


@dataclass(frozen=True)
class PointStart:
    """The points of one scene.

    Parameters
    ----------
    frame : Frame
        Dimension 3, at time 0.
    vertical_stress : float64[n] [Pa] or None
        Of their weight; None where nothing tells it.
    seen : Frame
        The same mass as columns, to decide effects from.
    """

    frame: object
    vertical_stress: np.ndarray | None
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
        start = _points_of(path, terrain, cell_size, table.density, say)
    else:
        columns = _columns_of(scene, path, terrain, grid, say)
        start = _converted(columns, terrain, point_options(cell_size, scene.numerics.points_per_side))
    thickness = float(np.average(start.seen.particles.thickness, weights=start.seen.particles.mass))
    if thickness < FEWEST_CELLS * cell_size:
        say(
            f"the release is {thickness:.3g} m thick, {thickness / cell_size:.2g} cells of {cell_size:g} m: a 3D run "
            f"wants {FEWEST_CELLS:g}; take a smaller [numerics] cell_size, or solver = 'columns'"
        )
    return start


def _columns_of(scene, path, terrain, grid, say):
    """Columns out of the file at `path`, or seeded in the release."""
    if path is not None:
        return columns_of(path, terrain, scene.release.density, say)
    return read_sources(scene, terrain, grid, say).frame


def _converted(columns, terrain, options):
    """Points out of a frame of columns."""
    require_memory_for_points(options.predicted_points(columns.particles), options.cell)
    points = points_from(columns, terrain, options).frame
    stress = points.state["vertical_stress"]
    return PointStart(replace(points, state={}, time=0.0, step=0), stress, columns)


def _points_of(path, terrain, cell_size, density, say):
    """Points out of the frame at `path`."""
    frame = placed_on(read_frame(path), path, terrain, density, say)
    stress = frame.state.get("vertical_stress")
    if stress is None or len(stress) != len(frame.particles):
        say(f"{path} tells no stress of its points' weight: they start without, and settle on their own elasticity")
        stress = None
    x, y = frame.map_xy()
    above = frame.particles.position[:, 2] + frame.origin[2] - terrain.sample(x, y)
    under = above < -cell_size
    if under.any():
        raise InputError(
            f"{path}: {int(under.sum())} of {len(under)} points start more than a cell of {cell_size:g} m under the "
            f"ground, the worst by {-above[under].min():.3g} m; use the DTM that they were made on"
        )
    return PointStart(replace(frame, state={}), stress, standing(frame, terrain, cell_size))
