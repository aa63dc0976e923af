"""Compute the digest of all input that a run reads, which a restart compares."""

import hashlib
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import shapely

    from ..frames.particles import Frame
    from ..solvers.columns.feature_arrays import Places
    from ..terrain.elevation import Terrain
    from .release_events import Events


def start_digest(
    terrain: "Terrain", frame: "Frame", events: "Events", *places: "Places", shapes: "Sequence[shapely.Geometry]" = ()
) -> str:
    """Return the hex digest of all input that a run reads from the files of its scene.

    It is computed from the data read, not from files: a comment in a table or statistics of a raster have no effect;
    a height in the second file of a virtual raster, or a layer of a database in a folder, has.

    Parameters
    ----------
    terrain : Terrain
    frame : Frame
        The columns at the start.
    events : Events
    places : Places
        Of each stage.
    shapes : sequence of shapely.Geometry
        Further input of stages: windows and end conditions.
    """
    digest = hashlib.sha256()
    crs = terrain.grid.crs
    _add(digest, terrain=terrain.elevation, transform=terrain.grid.transform[:6])
    _add(digest, crs=np.frombuffer(("" if crs is None else crs.to_wkt()).encode(), np.uint8))
    _add_frame(digest, frame)
    for inlet in events.inlets:
        first = np.zeros(1, int)  # the other columns have the same speed, each along its ground
        entry = [inlet.velocity(time, first) for time in inlet.times[:, 0]]
        _add_frame(digest, inlet.frame)
        _add(digest, times=inlet.times, volumes=inlet.volumes, entry=entry, slabs=inlet.slabs)
    for area in events.secondary:
        _add_frame(digest, area.frame)
        _add(digest, trigger=area.trigger_thickness or 0.0)
    for known in places:
        given = {name: values for name, values in vars(known).items() if isinstance(values, np.ndarray)}
        _add(digest, **given)
    for shape in shapes:
        _add(digest, shape=np.frombuffer(shape.wkb, np.uint8))
    return digest.hexdigest()


def _add_frame(digest, frame):
    _add(digest, origin=frame.origin, density=frame.header["density"], **frame.particles.arrays())


def _add(digest, **arrays):
    for name, values in arrays.items():
        values = np.ascontiguousarray(values)
        digest.update(f"{name} {values.dtype.str} {values.shape} ".encode())
        digest.update(values.view(np.uint8).reshape(-1) if values.size else b"")
