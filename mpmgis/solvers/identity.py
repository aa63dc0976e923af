"""What a run starts from, as one digest: frames are gone on from only by the run that they belong to."""

import hashlib

import numpy as np
import shapely


def start_digest(terrain, frame, events, *places, shapes=()):
    """Hex digest of all that the files of a scene tell its run.

    It is made of what was read and not of files: a note in a table or statistics beside a raster change nothing, while
    a height in a virtual raster's second file, or a layer of a database that is a folder, do.

    Parameters
    ----------
    terrain : Terrain
    frame : Frame
        The columns at the start.
    events : Events
    places : Places
        Of each stage.
    shapes : sequence of shapely.Geometry
        What stages know besides: windows, and what ends them.
    """
    digest = hashlib.sha256()
    crs = terrain.grid.crs
    _add(digest, terrain=terrain.elevation, transform=terrain.grid.transform[:6])
    _add(digest, crs=np.frombuffer(("" if crs is None else crs.to_wkt()).encode(), np.uint8))
    _add_frame(digest, frame)
    for inlet in events.inlets:
        first = np.zeros(1, int)  # of the columns: the others enter as fast, each along its own ground
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
        _add(digest, shape=np.frombuffer(shapely.to_wkb(shape), np.uint8))
    return digest.hexdigest()


def _add_frame(digest, frame):
    _add(digest, origin=frame.origin, density=frame.header["density"], **frame.particles.arrays())


def _add(digest, **arrays):
    for name, values in arrays.items():
        values = np.ascontiguousarray(values)
        digest.update(f"{name} {values.dtype.str} {values.shape} ".encode())
        digest.update(values.view(np.uint8).reshape(-1) if values.size else b"")
