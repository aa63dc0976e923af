"""Files of the code Matter (larsblatny/matter): `particles_f<N>.ply` and `info.txt` in the same folder.

Binary PLY, one row per particle: x y z vx vy vz p q Je and plastic variables; no mass, volume, density, time or id.
`info.txt` has five lines: last frame, frames per second, grid spacing [m], particles, volume of each [m3].
"""

from functools import partial
from pathlib import Path

import numpy as np

from ...system.errors import FormatError
from ...system.trusted_files import require_file
from .ply import fits, read_ply_columns, read_ply_header
from .reader_interface import Reader, ThirdPartyFrame, frame_of_each, number_of

SIGNATURE = {"x", "y", "vx", "vy", "p", "q", "Je"}  # of its particles; its grid has a mass, but none of the last three
COLUMN_MAP = {name: name for name in ("x", "y", "z", "vx", "vy", "vz")}
_INFO = ("end_frame", "frames_per_second", "cell_size", "particles", "particle_volume")


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file is a PLY with the columns of Matter's particles.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    try:
        return fits(path, head) and set(read_ply_header(path).columns) >= SIGNATURE
    except FormatError:
        return False


def open_file(path: str | Path) -> ThirdPartyFrame:
    """Describe the frame in a file.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        No PLY, damaged, two-dimensional, columns of another code, or an invalid info.txt.
    """
    path = Path(path)
    header = read_ply_header(path)
    lacking = sorted(SIGNATURE - set(header.columns))
    if lacking:
        raise FormatError(f"{path} lacks {', '.join(lacking)}; it is not a particle file of Matter")
    if "z" not in header.columns:
        raise FormatError(f"{path} is two-dimensional (no z), expected a run of Matter in three dimensions")
    info, number = _read_info(path.parent / "info.txt", header.count), number_of(path)
    timed = bool(info) and number is not None
    return ThirdPartyFrame(
        path=path,
        count=header.count,
        columns=header.columns,
        read=partial(read_ply_columns, path, header),
        column_map=COLUMN_MAP,
        number=number,
        time=number / info["frames_per_second"] if timed else None,
        particle_volume=info.get("particle_volume"),
        cell_size=info.get("cell_size"),
        axes_hint=" e,u,-n in scenes of Matter, with y up",
    )


def _read_info(path: Path, count: int) -> dict[str, float]:
    """Return the values of `info.txt`; {} where it does not exist."""
    if not path.exists():
        return {}
    require_file(path)
    try:
        values = dict(zip(_INFO, map(float, path.read_text(encoding="utf-8").split()), strict=True))
    except (ValueError, OSError) as error:
        raise FormatError(f"{path}: expected five numbers, one per line ({', '.join(_INFO)})") from error
    if not all(np.isfinite(value) and value > 0 for name, value in values.items() if name != "end_frame"):
        raise FormatError(f"{path}: {', '.join(_INFO[1:])} must be above 0")
    if int(values["particles"]) != count:
        raise FormatError(
            f"{path} has {int(values['particles'])} particles, the frame {count}: particles were lost or the file is "
            "of another run; move it and give --fps and --particle-volume"
        )
    return values


READER = Reader("matter", recognises, frame_of_each(open_file))
