"""Files of MPM-Geomechanics: `particles/particles_<k>.vtu` and `particleTimeSerie.pvd`, which has their times.

VTK's XML as text with five significant digits; neither mass nor volume. What is not `Particle Active` has left.
"""

from dataclasses import replace

from ...errors import FormatError
from .base import ForeignReader
from .parsing import column_names
from .vtk import PLACES, frames, kind_of, read_list
from .vtk_xml import read_layout

SIGNATURE = "Particle Id"
MEANT = PLACES | {
    **dict(zip(("vx", "vy", "vz"), column_names("Velocity", 3), strict=True)),
    "id": SIGNATURE, "active": "Particle Active",
}  # fmt: skip


def recognises(path, head):
    """True for .vtu with "Particle Id", and for a .pvd that lists such."""
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
        raise FormatError(f"{frame.path} has no {SIGNATURE!r}; it is no file of MPM-Geomechanics")
    return replace(frame, meant=MEANT)


READER = ForeignReader("mpm-geomechanics", recognises, lambda paths, terms: frames(paths, terms, _known))
