"""Interface of the readers of other codes: ThirdPartyFrame, Reader, and functions for several of them.

A reader is one module with `READER`, a Reader, and an entry in `reader_list`. It parses files and returns their own
data; `frame_georeferencing` puts them on the map in the same way for all codes. Reading has two passes: first the
layout, then the numbers, frame by frame and possibly in another process. Therefore `ThirdPartyFrame.read` is a
`functools.partial` of a module's function, which can be pickled.
"""

import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...system.errors import FormatError, one_line
from ...system.memory import memory_lack
from ...system.text_tables import decoded
from ...system.trusted_files import require_file
from ..declarations import Declarations

MOST_DIGITS = 15  # of a number in a file name
_NUMBERED = re.compile(rf".*?(\d{{1,{MOST_DIGITS}}})", re.DOTALL)


@dataclass(frozen=True)
class ThirdPartyFrame:
    """One frame in files of another code.

    Parameters
    ----------
    path : Path
        The file, or the first of the files of the frame.
    count : int
        Number of particles, inactive ones included.
    columns : tuple of str
        Names of the columns.
    read : callable
        `read(names)` returns float64[count] of columns, by name.
    column_map : dict of str to str
        Names (`declarations.NAMES`) and the columns of this code.
    number : int or None
        Number in the series.
    time : float or None
        [s], where the files have it.
    particle_volume, density, cell_size : float or None
        [m3] of every particle, [kg m-3] of the release, [m] of the code's grid, where the files have them.
    declared : Declarations or None
        Georeference in the files themselves.
    axes_hint, density_hint : str
        Added to the error messages for missing axes and density.
    """

    path: Path
    count: int
    columns: tuple
    read: Callable
    column_map: dict = field(default_factory=dict)
    number: int | None = None
    time: float | None = None
    particle_volume: float | None = None
    density: float | None = None
    cell_size: float | None = None
    declared: Declarations | None = None
    axes_hint: str = ""
    density_hint: str = ""


class Reader(NamedTuple):
    """The reader of a code.

    Attributes
    ----------
    name : str
    recognises : callable
        `recognises(path, head)`: whether the file with the first bytes `head` is of this code.
    frames : callable
        `frames(paths, terms)`: list of the ThirdPartyFrames in files.
    fits : callable or None
        `fits(path, head)`: whether a file has the format, for common formats; None where this is the same as
        `recognises`.
    """

    name: str
    recognises: Callable
    frames: Callable
    fits: Callable | None = None


def frame_of_each(open_file: Callable[[Path], ThirdPartyFrame]) -> Callable:
    """Make `frames` of a Reader with one frame per file.

    Parameters
    ----------
    open_file : callable
        `open_file(path)` returns the ThirdPartyFrame.
    """
    return partial(_each_opened, open_file)


def _each_opened(open_file: Callable, paths: Iterable[Path], terms: Declarations) -> list[ThirdPartyFrame]:
    return [open_file(path) for path in paths]


def frames_of_pieces(
    paths: Iterable[str | Path], pieces_of: Callable[[Path], list[Path]], open_file: Callable[[Path], ThirdPartyFrame]
) -> list[ThirdPartyFrame]:
    """Describe the frames in files of parallel runs.

    Parameters
    ----------
    paths : iterable of str or Path
    pieces_of : callable
        `pieces_of(path)` returns all files of one frame.
    open_file : callable
        `open_file(path)` returns the ThirdPartyFrame of one piece.
    """
    groups = {}
    for path in map(Path, paths):
        pieces = pieces_of(path)
        groups.setdefault(pieces[0], pieces)
    return [joined([open_file(piece) for piece in pieces]) for pieces in groups.values()]


def joined(frames: list[ThirdPartyFrame]) -> ThirdPartyFrame:
    """Join the pieces of a parallel run to one frame: all rows, common columns.

    Parameters
    ----------
    frames : list of ThirdPartyFrame
    """
    if len(frames) == 1:
        return frames[0]
    first = frames[0]
    columns = tuple(name for name in first.columns if all(name in frame.columns for frame in frames))
    pieces = [frame for frame in frames if frame.count] or frames[:1]
    return replace(
        first,
        count=sum(frame.count for frame in frames),
        columns=columns,
        read=partial(_read_joined, [frame.read for frame in pieces]),
    )


def _read_joined(reads, names):
    parts = [read(names) for read in reads]
    return {name: np.concatenate([part[name] for part in parts]) for name in names}


def beside(frames: list[ThirdPartyFrame]) -> ThirdPartyFrame:
    """Combine files with different columns of the same particles to one frame.

    Parameters
    ----------
    frames : list of ThirdPartyFrame

    Raises
    ------
    FormatError
        Different numbers of particles.
    """
    first = frames[0]
    for frame in frames[1:]:
        if frame.count != first.count:
            raise FormatError(
                f"{first.path} contains {first.count} particles, {frame.path} of the same step {frame.count}"
            )
    owner = {name: k for k, frame in reversed(list(enumerate(frames))) for name in frame.columns}
    return replace(first, columns=tuple(owner), read=partial(_read_merged, [frame.read for frame in frames], owner))


def _read_merged(reads: list[Callable], owner: dict[str, int], names: tuple[str, ...]) -> dict[str, np.ndarray]:
    found = {}
    for k, read in enumerate(reads):
        wanted = tuple(name for name in names if owner[name] == k)
        if wanted:
            found |= read(wanted)
    return found


def number_of(path: str | Path) -> int | None:
    """Return the number at the end of a file name before its suffix.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    int or None
        None where there is none.
    """
    found = _NUMBERED.fullmatch(Path(path).stem)
    return int(found[1]) if found else None


def require_readable(path: str | Path) -> int:
    """Return the size of a file [bytes]; refuse one that cannot be read.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        Missing, a folder, empty, or not readable.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise FormatError(f"{path} is a {'folder' if path.is_dir() else 'device or pipe'}, expected a file")
    try:
        with open(path, "rb"):
            size = path.stat().st_size
    except OSError as error:
        raise FormatError(f"{path}: {one_line(error.strerror or error)}") from error
    if size == 0:
        raise FormatError(f"{path} is empty (0 bytes)")
    return size


def require_memory(path: str | Path, count: int, bytes_each: int) -> None:
    """Refuse particles that do not fit into memory, before they are read.

    Parameters
    ----------
    path : str or Path
    count : int
    bytes_each : int [bytes]
        Memory of one particle.

    Raises
    ------
    FormatError
    """
    if lack := memory_lack(count * bytes_each):
        raise FormatError(f"{path}: {count:.6g} particles need {lack}; it is damaged, or needs a larger machine")


def read_settings(path: str | Path) -> dict[str, Any]:
    """Read the settings of a code (JSON) next to its files; {} where they do not exist.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        The file is not a JSON object.
    """
    require_file(path)
    try:
        settings = json.loads(decoded(Path(path).read_bytes()))
    except (FileNotFoundError, NotADirectoryError):
        return {}
    except (OSError, ValueError, RecursionError) as error:
        raise FormatError(f"{path} is not readable JSON ({one_line(error)[:80]}); correct or move it") from error
    if not isinstance(settings, dict):
        raise FormatError(f"{path} is not a JSON object; correct or move it")
    return settings


def setting(settings: Any, *keys: str) -> Any:
    """Return the value under nested keys.

    Parameters
    ----------
    settings : dict of str to Any
    *keys : str

    Returns
    -------
    Any
        None where a key is missing.
    """
    for key in keys:
        settings = settings.get(key) if isinstance(settings, dict) else None
    return settings


def setting_above_zero(settings: Any, *keys: str) -> float | None:
    """Return a number above 0 under nested keys.

    Parameters
    ----------
    settings : dict of str to Any
    *keys : str

    Returns
    -------
    float or None
        None where there is none.
    """
    value = setting(settings, *keys)
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return float(value) if is_number and 0 < value < float("inf") else None


def same_density(values: Iterable[float | None]) -> float | None:
    """Return the common density of all materials of a code's settings.

    Parameters
    ----------
    values : iterable of float or None [kg m-3]

    Returns
    -------
    float or None [kg m-3]
        None where they differ or one has none.
    """
    values = list(values)
    return values[0] if values and all(value is not None and value == values[0] for value in values) else None
