"""Files of MPM-Geomechanics: `particles/particles_<k>.vtu` and `particleTimeSerie.pvd` with their times.

VTK XML as text with five significant digits, without mass and volume. Particles that are not `Particle Active` have
left the domain.
"""

from dataclasses import replace
from pathlib import Path

from ...system.errors import FormatError
from .array_columns import column_names
from .reader_interface import Reader
from .vtk import PLACES, frames, kind_of, read_list
from .vtk_xml import read_layout

SIGNATURE = "Particle Id"
COLUMN_MAP = PLACES | {
    **dict(zip(("vx", "vy", "vz"), column_names("Velocity", 3), strict=True)),
    "id": SIGNATURE,
    "active": "Particle Active",
}


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file is .vtu with "Particle Id", or a .pvd that lists such files.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    kind = kind_of(head)
    try:
        if kind == "Collection":
            path = next((listed.path for listed in read_list(path) if listed.path.is_file()), None)
            kind = "UnstructuredGrid" if path is not None else ""
        return kind == "UnstructuredGrid" and any(SIGNATURE in piece for piece in read_layout(path).pieces)
    except FormatError:
        return False


def _known(frame):
    if SIGNATURE not in frame.columns:
        raise FormatError(f"{frame.path} has no {SIGNATURE!r}; it is not a file of MPM-Geomechanics")
    return replace(frame, column_map=COLUMN_MAP)


READER = Reader("mpm-geomechanics", recognises, lambda paths, terms: frames(paths, terms, _known))
