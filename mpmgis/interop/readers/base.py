"""Another code's files: what they say of one frame, and what a reader of a code is.

A reader is one module that offers `READER`, a ForeignReader; a row in `foreign/readers` brings it in. It parses, and
tells what the files say of themselves; what that means on the map is decided in `foreign/meaning`, the same for all
codes. Reading happens twice: first only where things lie, then, frame by frame and maybe on another machine, the
numbers. So `ForeignFrame.read` is a `functools.partial` of a module's function, which can be sent there.
"""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...errors import FormatError, one_line
from ...io.input_files import require_file
from ...machine import memory_lack
from ..declarations import ForeignTerms

MOST_DIGITS = 15  # of a number in a file's name that is taken as one
_NUMBERED = re.compile(rf".*?(\d{{1,{MOST_DIGITS}}})", re.DOTALL)


@dataclass(frozen=True)
class ForeignFrame:
    """What files say of one frame.

    Parameters
    ----------
    path : Path
        The file, or the first of those that make up the frame.
    count : int
        Particles in it, those that the code has put out of action included.
    columns : tuple of str
        Its columns.
    read : callable
        `read(names)` gives float64[count] of each of some columns, by name.
    meant : dict of str to str
        Our names (`terms.NAMES`) and the columns that this code has for them.
    number : int or None
        Its number in the series.
    time : float or None
        [s], where the files say it.
    particle_volume, density, cell_size : float or None
        [m3] of every particle, [kg m-3] of the release, [m] of the code's grid, where they are said.
    said : ForeignTerms or None
        What the files themselves say in the words of a sidecar.
    axes_word, density_word : str
        What belongs to the question where its axes point, and which density it has.
    """

    path: Path
    count: int
    columns: tuple
    read: Callable
    meant: dict = field(default_factory=dict)
    number: int | None = None
    time: float | None = None
    particle_volume: float | None = None
    density: float | None = None
    cell_size: float | None = None
    said: ForeignTerms | None = None
    axes_word: str = ""
    density_word: str = ""


class ForeignReader(NamedTuple):
    """A code's reader.

    `recognises(path, head)`: whether the file, whose first bytes are `head`, is this code's. `frames(paths, terms)`:
    the ForeignFrames in some files. `fits(path, head)`: whether it is of the format at all, for formats that anybody
    uses; None where there is no difference.
    """

    name: str
    recognises: Callable
    frames: Callable
    fits: Callable | None = None


def frame_of_each(open_file):
    """`frames` of a ForeignReader whose files hold a frame each, as `open_file(path)` gives it."""
    return partial(_each_opened, open_file)


def _each_opened(open_file, paths, terms):
    return [open_file(path) for path in paths]


def frames_of_pieces(paths, pieces_of, open_file):
    """The ForeignFrames in files of parallel runs: `pieces_of(path)` are all that make one frame, each named or not."""
    groups = {}
    for path in map(Path, paths):
        pieces = pieces_of(path)
        groups.setdefault(pieces[0], pieces)
    return [joined([open_file(piece) for piece in pieces]) for pieces in groups.values()]


def joined(frames):
    """One ForeignFrame of the pieces that the processes of a parallel run wrote: all rows, the columns of all."""
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


def beside(frames):
    """One ForeignFrame of files that hold other columns of the same particles.

    Raises
    ------
    FormatError
        They do not hold as many.
    """
    first = frames[0]
    for frame in frames[1:]:
        if frame.count != first.count:
            raise FormatError(f"{first.path} holds {first.count} particles, {frame.path} beside it {frame.count}")
    owner = {name: k for k, frame in reversed(list(enumerate(frames))) for name in frame.columns}
    return replace(first, columns=tuple(owner), read=partial(_read_beside, [frame.read for frame in frames], owner))


def _read_beside(reads, owner, names):
    found = {}
    for k, read in enumerate(reads):
        wanted = tuple(name for name in names if owner[name] == k)
        if wanted:
            found |= read(wanted)
    return found


def number_of(path):
    """The number at the end of a file's name before its suffix; None where there is none."""
    found = _NUMBERED.fullmatch(Path(path).stem)
    return int(found[1]) if found else None


def require_readable(path):
    """Size of the file at `path` [bytes].

    Raises
    ------
    FormatError
        Missing, a folder, empty, or not to be opened.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise FormatError(f"{path} is no file but a {'folder' if path.is_dir() else 'device or pipe'}; name a file")
    try:
        with open(path, "rb"):
            size = path.stat().st_size
    except OSError as error:
        raise FormatError(f"{path}: {one_line(error.strerror or error)}") from error
    if size == 0:
        raise FormatError(f"{path} is empty (0 bytes)")
    return size


def require_room(path, count, bytes_each):
    """Refuse `count` particles that this machine cannot hold, before they are read.

    Raises
    ------
    FormatError
    """
    if lack := memory_lack(count * bytes_each):
        raise FormatError(f"{path}: {count:.6g} particles need {lack}; it is damaged, or for a larger machine")


def read_settings(path):
    """A code's own settings (JSON) beside its files, to see what they say; {} where they are not there.

    Raises
    ------
    FormatError
        There, and no JSON object.
    """
    require_file(path)
    try:
        settings = json.loads(Path(path).read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        return {}
    except (OSError, ValueError, RecursionError) as error:
        raise FormatError(f"{path} is no readable JSON ({one_line(error)[:80]}); mend it or move it away") from error
    if not isinstance(settings, dict):
        raise FormatError(f"{path} is no JSON object; mend it or move it away")
    return settings


def setting(settings, *keys):
    """What lies under nested keys; None where anything on the way is not there."""
    for key in keys:
        settings = settings.get(key) if isinstance(settings, dict) else None
    return settings


def setting_above_zero(settings, *keys):
    """A number above 0 under nested keys; None where there is none."""
    value = setting(settings, *keys)
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return float(value) if is_number and 0 < value < float("inf") else None


def same_density(values):
    """The density that all materials of a code's settings have; None where they differ or one says none."""
    values = list(values)
    return values[0] if values and all(value is not None and value == values[0] for value in values) else None
