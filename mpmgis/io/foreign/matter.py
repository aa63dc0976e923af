"""Files of the code Matter (larsblatny/matter): `particles_f<N>.ply` and `info.txt` beside them.

Binary PLY, one row a particle: x y z vx vy vz p q Je and more of plasticity; no mass, volume, density, time or id.
`info.txt` has five lines: last frame, frames per second, grid spacing [m], particles, volume of each [m3].
"""

import re
from pathlib import Path

import numpy as np

from ...errors import FormatError
from .file import ForeignFile, ForeignReader
from .ply import read_ply_columns, read_ply_header

SIGNATURE = {"x", "y", "vx", "vy", "p", "q", "Je"}  # of its particles; its grid has a mass and none of the last three
MEANT = {name: name for name in ("x", "y", "z", "vx", "vy", "vz")}
_NUMBERED = re.compile(r".*?(\d+)")
_INFO = ("end_frame", "frames_per_second", "cell_size", "particles", "particle_volume")


def recognises(path):
    """True for a PLY that has the columns of Matter's particles."""
    try:
        return set(read_ply_header(path).columns) >= SIGNATURE
    except (FormatError, OSError):
        return False


def open_file(path):
    """The ForeignFile at `path`.

    Raises
    ------
    FormatError
        No PLY, damaged, in two dimensions, not Matter's columns, or an info.txt of something else.
    """
    path = Path(path)
    header = read_ply_header(path)
    lacking = sorted(SIGNATURE - set(header.columns))
    if lacking:
        raise FormatError(f"{path} has no {', '.join(lacking)} for its particles; it is no particle file of Matter")
    if "z" not in header.columns:
        raise FormatError(f"{path} is a run of Matter in two dimensions (no z); only three can be put on a map")
    info = _read_info(path.parent / "info.txt", header.count)
    number = _NUMBERED.fullmatch(path.stem)
    return ForeignFile(
        count=header.count,
        columns=header.columns,
        read=lambda names: read_ply_columns(path, header, names),
        meant=MEANT,
        number=int(number[1]) if number else None,
        axes_word=" e,u,-n in Matter's own scenes, whose y is up",
        **info,
    )


def _read_info(path, count):
    """What `info.txt` says that the particles do not; empty where there is none."""
    if not path.exists():
        return {}
    try:
        values = dict(zip(_INFO, map(float, path.read_text(encoding="utf-8").split()), strict=True))
    except ValueError as error:
        raise FormatError(f"{path}: wanted five numbers, one a line ({', '.join(_INFO)})") from error
    if not all(np.isfinite(value) and value > 0 for name, value in values.items() if name != "end_frame"):
        raise FormatError(f"{path}: {', '.join(_INFO[1:])} must be above 0")
    if int(values["particles"]) != count:
        raise FormatError(
            f"{path} is of {int(values['particles'])} particles, the frame beside it holds {count}: particles were "
            "lost or the file is of another run; move it away and give --fps and --particle-volume"
        )
    return {name: values[name] for name in ("frames_per_second", "cell_size", "particle_volume")}


READER = ForeignReader("matter", "*.ply", recognises, open_file)
