"""Particle files of GeoTaichi: `particles/MPMParticle<k>.npz`.

NumPy archive: t_current, body_num, active, mass, volume, position, velocity, stress and more, in newer versions also
particleID. `state_vars` is pickled and not read. `volume` is the current volume. Particles that are not `active` have
left the domain of the code.
"""

from dataclasses import replace
from pathlib import Path

from ...system.errors import FormatError
from .array_columns import column_names
from .npz import fits, open_file, read_members
from .reader_interface import Reader, ThirdPartyFrame, frame_of_each

COLUMN_MAP = {
    **dict(zip("xyz", column_names("position", 3), strict=True)),
    **dict(zip(("vx", "vy", "vz"), column_names("velocity", 3), strict=True)),
    "mass": "mass",
    "id": "particleID",
    "active": "active",
}
SIGNATURE = {"t_current", "body_num", "position", "velocity"}


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file is an archive with the arrays of GeoTaichi's particles.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    try:
        return fits(path, head) and set(read_members(path)) >= SIGNATURE
    except FormatError:
        return False


def frame_of(path: Path) -> ThirdPartyFrame:
    """Describe the frame in a file.

    Parameters
    ----------
    path : Path

    Raises
    ------
    FormatError
        No archive, damaged, without the arrays of particles.
    """
    members = read_members(path)
    lacking = sorted(SIGNATURE - set(members))
    if lacking or members["position"].shape[1:] != (3,):
        raise FormatError(f"{path} lacks {', '.join(lacking) or 'three coordinates'}; it is not a file of GeoTaichi")
    frame = open_file(path, COLUMN_MAP, members["position"].shape[0])
    return replace(frame, density_hint="; current volumes do not give it")


READER = Reader("geotaichi", recognises, frame_of_each(frame_of))
