"""Text dumps of LAMMPS, LIGGGHTS and, in the same form, of the MPM code Karamelo.

`ITEM: TIMESTEP`, `NUMBER OF ATOMS`, `BOX BOUNDS`, `ATOMS id type x y z ..`, one or many times in a file. The time step
is a number, and a time where `ITEM: TIME` says so. Karamelo writes 0 there and the step into the file's name,
`proc-<rank>.` before it in a parallel run. `radius` gives the volume of a grain.
"""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

from ...errors import FormatError
from .file import MOST_DIGITS, ForeignFrame, ForeignReader, joined
from .mapped import mapped
from .rows_of_text import BLANK, Form, read_rows

BEGIN = b"ITEM: TIMESTEP"
COLUMNS = {  # ours, and the columns that may be it
    **{axis: (axis, f"{axis}u") for axis in "xyz"}, **{f"v{axis}": (f"v{axis}",) for axis in "xyz"},
    "mass": ("mass",), "radius": ("radius",), "diameter": ("diameter",), "id": ("id",),
}  # fmt: skip
METRES = ("si",)
LONGEST_LINE = 10_000
MOST_ITEMS = 20
_WHOLE = re.compile(rf"[0-9]{{1,{MOST_DIGITS}}}")
_PIECE = re.compile(r"(.*)proc-(\d{1,9})\.(\d{1,15})(.*)")
_LAST_NUMBER = re.compile(r".*?(\d{1,15})\D*")


def recognises(path, head):
    """True for a dump with its first time step at the beginning."""
    return head.startswith((BEGIN, b"ITEM: UNITS", b"ITEM: TIME\n"))


def frames(paths, terms):
    """The ForeignFrames in some files; the pieces of a parallel run make one."""
    groups = {}
    for path in map(Path, paths):
        pieces = _pieces(path)
        groups.setdefault(pieces[0], pieces)
    found = []
    for pieces in groups.values():
        opened = [open_file(piece) for piece in pieces]
        if len({len(series) for series in opened}) != 1:
            raise FormatError(f"{pieces[0]} and the pieces of its other ranks hold different numbers of time steps")
        found += [joined(list(same)) for same in zip(*opened, strict=True)]
    for frame in found:
        if frame.count == 0:
            raise FormatError(f"{frame.path}: no particle at time step {frame.number}")
    return _numbered_by_name(found) if all(frame.number == 0 for frame in found) else found


def _pieces(path):
    """The files of all ranks of this one's step."""
    match = _PIECE.fullmatch(path.name)
    if match is None:
        return [path]
    found = {
        int(piece[2]): other
        for other in path.parent.iterdir()
        if (piece := _PIECE.fullmatch(other.name)) and (piece[1], piece[3], piece[4]) == (match[1], match[3], match[4])
    }
    lacking = [rank for rank in range(len(found)) if rank not in found]
    if lacking:
        raise FormatError(f"{path}: the piece of rank {lacking[0]} is missing; bring them together in one folder")
    return [found[rank] for rank in sorted(found)]


def _numbered_by_name(frames):
    """Frames that all say step 0, as Karamelo writes them: their steps are in their names."""
    names = [_PIECE.fullmatch(frame.path.name) or _LAST_NUMBER.fullmatch(frame.path.name) for frame in frames]
    numbers = [None if match is None else int(match[3] if match.re is _PIECE else match[1]) for match in names]
    if len(frames) == 1 and numbers[0] is not None and numbers[0] != 0:
        numbers = [None]  # one file alone does not show whether its name's number is a step
    elif None in numbers:
        return frames
    return [
        replace(frame, number=number, time=None if number else frame.time)
        for frame, number in zip(frames, numbers, strict=True)
    ]


def open_file(path):
    """The ForeignFrames in one file.

    Raises
    ------
    FormatError
        No dump, damaged, truncated, in units that are not metres.
    """
    path, found = Path(path), []
    with mapped(path) as content:
        at = 0
        while at < len(content):
            if content[at : at + 5] != b"ITEM:":
                if content[at : at + LONGEST_LINE].strip():
                    raise FormatError(f"{path}: wanted 'ITEM:' at byte {at}; it is no dump of LAMMPS, or damaged")
                break
            frame, at = _step(path, content, at)
            found.append(frame)
    if not found:
        raise FormatError(f"{path} holds no time step; it is no dump of LAMMPS, or damaged")
    return found


def _step(path, content, at):
    """(The ForeignFrame that begins at byte `at`, where the next one begins)."""
    said, columns = {}, None
    for _ in range(MOST_ITEMS):
        words, at = _line(path, content, at)
        if words[:1] != ["ITEM:"]:
            raise FormatError(f"{path}: {' '.join(words)[:40]!r} at byte {at}, wanted 'ITEM: ..'; it is damaged")
        if words[1:2] == ["ATOMS"]:
            columns = tuple(words[2:])
            break
        key = " ".join(words[1:])
        for _ in range(3 if key.startswith("BOX BOUNDS") else 1):
            value, at = _line(path, content, at)
            said.setdefault(key, value)
    if columns is None or len(set(columns)) != len(columns) or not columns:
        raise FormatError(f"{path}: a time step has no 'ITEM: ATOMS' with the names of its columns; it is damaged")
    count, number = (_whole(path, said, key) for key in ("NUMBER OF ATOMS", "TIMESTEP"))
    stop = content.find(b"ITEM:", at)
    stop = len(content) if stop < 0 else stop
    if stop - at < 2 * count * len(columns) - 1:
        raise FormatError(f"{path} ends within the {count} particles of time step {number}; it is truncated")
    units = (said.get("UNITS") or METRES)[0]
    if units not in METRES:
        raise FormatError(f"{path} is in units {units!r}, wanted si: metres, kilograms, seconds")
    return ForeignFrame(
        path=path,
        count=count,
        columns=columns,
        read=partial(_read, path, at, stop, count, columns),
        meant={ours: word for ours, words in COLUMNS.items() for word in reversed(words) if word in columns},
        number=number,
        time=_time(path, said),
    ), stop


def _line(path, content, at):
    """(Words of the line at byte `at`, where the next line begins)."""
    stop = content.find(b"\n", at, at + LONGEST_LINE)
    if stop < 0:
        raise FormatError(f"{path} ends within a time step, or has a line of {LONGEST_LINE} bytes; it is damaged")
    return content[at:stop].decode("ascii", "replace").split(), stop + 1


def _whole(path, said, key):
    words = said.get(key) or [""]
    if not _WHOLE.fullmatch(words[0]):
        raise FormatError(f"{path}: ITEM: {key} is {words[0][:20]!r}, wanted a whole number")
    return int(words[0])


def _time(path, said):
    if "TIME" not in said:
        return None
    try:
        time = float(said["TIME"][0])
    except (ValueError, IndexError):
        raise FormatError(f"{path}: ITEM: TIME is no number") from None
    return time if abs(time) < float("inf") else None


def _read(path, start, stop, count, columns, names):
    found = read_rows(path, start, stop, Form(columns, BLANK), names)
    rows = len(found[names[0]]) if names else count
    if rows != count:
        raise FormatError(f"{path} holds {rows} rows in a time step of {count} particles; it is damaged")
    return found


READER = ForeignReader("lammps", recognises, frames)
