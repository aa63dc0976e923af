"""Facts about particle files: how many, when, where, how heavy, how fast."""

import h5py
import numpy as np

from ..errors import FormatError
from ..geo.georeference import name_of
from .frames import read_frame


def frame_facts(path):
    """Facts about a frame of mpmgis."""
    frame = read_frame(path, with_state=False)
    particles, origin = frame.particles, np.asarray(frame.origin)
    facts = {
        "kind": "particles",
        "reader": "mpmgis",
        "dimension": frame.dimension,
        "time": frame.time,
        "step": frame.step,
        "solver": frame.solver,
        "crs": name_of(frame.crs) if frame.crs is not None else None,
        **particle_facts(particles.position + origin, particles.velocity, particles.mass, particles.volume),
    }
    if frame.dimension == 2:
        facts["thickness"] = [float(particles.thickness.min()), float(particles.thickness.max())]
        facts["column_area"] = [float(particles.area.min()), float(particles.area.max())]
    facts |= {"dem": frame.dem, "digest": frame.digest, "arrays": list(particles.arrays())}
    with h5py.File(path, "r") as file:
        facts["version"] = str(file.attrs.get("version", ""))
        facts["groups"] = sorted(set(file) - {"particles"})
    facts["header"] = {name: _plain(value) for name, value in frame.header.items()}
    return facts


def particle_facts(position, velocity, mass, volume):
    """What any set of particles has: number, mass, volume, density, place and largest speed.

    Parameters
    ----------
    position : float[n, 3] [m]
        In the CRS.
    velocity : float[n, 3] [m s-1]
    mass : float[n] [kg]
    volume : float[n] [m3]
    """
    low, high = position.min(axis=0).tolist(), position.max(axis=0).tolist()
    return {
        "n": len(mass),
        "mass": float(mass.sum()),
        "volume": float(volume.sum()),
        "density": float(mass.sum() / volume.sum()),
        "bbox": [low[0], low[1], high[0], high[1]],
        "elevation": [low[2], high[2]],
        "max_speed": float(np.sqrt((velocity**2).sum(axis=1).max())),
    }


def _plain(value):
    """A header entry as JSON can hold it."""
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    return value if not isinstance(value, float) or np.isfinite(value) else str(value)


def is_particle_layer(table):
    """True where a table of features holds points with a mass."""
    return False


def particle_table_facts(path):
    """Facts about particles in a table."""
    raise FormatError(f"{path} holds no particles that mpmgis knows")
