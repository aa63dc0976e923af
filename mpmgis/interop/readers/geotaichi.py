"""Particle files of GeoTaichi: `particles/MPMParticle<k>.npz`.

NumPy's archive: t_current, body_num, active, mass, volume, position, velocity, stress and more, of newer versions
particleID too. `state_vars` is pickled and left alone. `volume` is the volume now. What is not `active` has left the
code's domain.
"""

from dataclasses import replace

from ...errors import FormatError
from .base import ForeignReader, frame_of_each
from .npz import fits, open_file, read_members
from .parsing import column_names

MEANT = {
    **dict(zip("xyz", column_names("position", 3), strict=True)),
    **dict(zip(("vx", "vy", "vz"), column_names("velocity", 3), strict=True)),
    "mass": "mass", "id": "particleID", "active": "active",
}  # fmt: skip
SIGNATURE = {"t_current", "body_num", "position", "velocity"}


def recognises(path, head):
    """True for an archive with the arrays of GeoTaichi's particles."""
    try:
        return fits(path, head) and set(read_members(path)) >= SIGNATURE
    except FormatError:
        return False


def frame_of(path):
    """The ForeignFrame at `path`.

    Raises
    ------
    FormatError
        No archive, damaged, without what particles have.
    """
    members = read_members(path)
    lacking = sorted(SIGNATURE - set(members))
    if lacking or members["position"].shape[1:] != (3,):
        raise FormatError(f"{path} lacks {', '.join(lacking) or 'three coordinates'}; it is no file of GeoTaichi's")
    frame = open_file(path, MEANT, members["position"].shape[0])
    return replace(frame, density_word="; its volumes are those of now, which do not tell it")


READER = ForeignReader("geotaichi", recognises, frame_of_each(frame_of))
