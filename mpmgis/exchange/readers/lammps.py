"""Text dumps of LAMMPS, LIGGGHTS and, in the same format, of the MPM code Karamelo.

`ITEM: TIMESTEP`, `NUMBER OF ATOMS`, `BOX BOUNDS`, `ATOMS id type x y z ..`, one or many times per file. The time
step is a number; `ITEM: TIME` gives a time. Karamelo writes 0 there and has the step in the file name, after
`proc-<rank>.` in a parallel run; `lammps_series` describes the pieces and repeated steps of the others. Positions are
`x`, unwrapped `xu`, or fractions of the box `xs`, `xsu`, which are scaled to metres. `radius` gives the volume of a
grain.
"""

import re
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...system.errors import FormatError
from ..declarations import Declarations
from .lammps_series import numbered_by_name, one_per_step, pieces_by_name, with_all_pieces
from .mapped_files import mapped
from .reader_interface import MOST_DIGITS, Reader, ThirdPartyFrame, joined
from .record_parsing import BLANK, Form, read_rows

BEGIN = b"ITEM: TIMESTEP"
BINARY = re.compile(rb".{7}[\x00\xff]DUMP(CUSTOM|ATOM)", re.DOTALL)  # behind the length of the word, negative
COLUMNS = {  # name of mpmgis -> possible columns
    **{axis: (axis, f"{axis}u") for axis in "xyz"},
    **{f"v{axis}": (f"v{axis}",) for axis in "xyz"},
    "mass": ("mass",),
    "radius": ("radius",),
    "diameter": ("diameter",),
    "id": ("id",),
}
SHARES = ("xs", "ys", "zs"), ("xsu", "ysu", "zsu")  # fractions of the box edges
OTHER_ROWS = ("ENTRIES", "CELLS", "FACETS")  # of `dump local`, of grids and meshes
METRES = ("si",)
LONGEST_LINE = 10_000  # [bytes] of the header of a time step
MOST_ITEMS = 20  # of the header of a time step
_WHOLE = re.compile(rf"[0-9]{{1,{MOST_DIGITS}}}")


class _TruncatedError(FormatError):
    """The file ends within a time step."""


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file is a dump that begins with a time step.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    return head.startswith((BEGIN, b"ITEM: UNITS", b"ITEM: TIME\n")) or BINARY.match(head) is not None


def frames(paths: Iterable[Path], terms: Declarations) -> list[ThirdPartyFrame]:
    """Describe the frames in files; pieces of a parallel run and repeated steps form one frame.

    Parameters
    ----------
    paths : iterable of Path
    terms : Declarations

    Raises
    ------
    FormatError
    """
    groups = {}
    for path in with_all_pieces(list(map(Path, paths)), first_step, open_file):
        pieces = pieces_by_name(path)
        groups.setdefault(pieces[0], pieces)
    found = []
    for pieces in groups.values():
        opened = [open_file(piece) for piece in pieces]
        if len({len(series) for series in opened}) != 1:
            raise FormatError(f"{pieces[0]} and the pieces of its other ranks have different numbers of time steps")
        found += [joined(list(same)) for same in zip(*opened, strict=True)]
    if all(frame.number == 0 for frame in found):
        found = numbered_by_name(found)
    return one_per_step(found)


def first_step(path: Path) -> int | None:
    """Return the number of the first time step of a dump.

    Parameters
    ----------
    path : Path

    Returns
    -------
    int or None
        None for other and unreadable files.
    """
    try:
        with mapped(path) as content:
            begin = content.find(BEGIN, 0, LONGEST_LINE)
            words = content[begin : begin + 100].split() if begin >= 0 and content[:5] == b"ITEM:" else []
    except FormatError:
        return None
    return int(words[2]) if len(words) > 2 and _WHOLE.fullmatch(words[2].decode("ascii", "replace")) else None


def open_file(path: str | Path) -> list[ThirdPartyFrame]:
    """Describe the frames in one file.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        No dump, damaged, truncated, units other than metres.
    """
    path, found = Path(path), []
    with mapped(path) as content:
        if BINARY.match(content[:20]):
            raise FormatError(f"{path} is a binary dump; convert it with binary2txt of LAMMPS and give the text")
        at = 0
        while at < len(content):
            if content[at : at + 5] != b"ITEM:":
                if content[at : at + LONGEST_LINE].strip():
                    raise FormatError(f"{path}: expected 'ITEM:' at byte {at}; it is not a dump of LAMMPS, or damaged")
                break
            try:
                frame, at = _step(path, content, at)
            except _TruncatedError as error:
                raise FormatError(f"{error}{_salvage_command(path, len(found), at)}") from None
            found.append(frame)
    if not found:
        raise FormatError(f"{path} contains no time step; it is not a dump of LAMMPS, or damaged")
    return found


def _salvage_command(path: Path, count: int, size: int) -> str:
    """Return the command that extracts the `count` complete time steps, `size` bytes, before a truncated one."""
    if count == 0:
        return ""
    unpacked = "gzip -dc {0} | head -c {1}" if path.suffix == ".gz" else "head -c {1} {0}"
    return f"; the {count} before are complete: {unpacked.format(path.name, size)} > whole.dump"


def _step(path: Path, content: Any, at: int) -> tuple[ThirdPartyFrame, int]:
    """Return (the frame that begins at byte `at`, where the next one begins)."""
    header, columns = {}, None
    for _ in range(MOST_ITEMS):
        words, at = _line(path, content, at)
        if words[:1] != ["ITEM:"]:
            raise FormatError(f"{path}: {' '.join(words)[:40]!r} at byte {at}, expected 'ITEM: ..'; it is damaged")
        if words[1:2] == ["ATOMS"]:
            columns = tuple(words[2:])
            break
        if words[1:2] and words[1] in OTHER_ROWS:
            raise FormatError(f"{path} contains {words[1]}, expected ATOMS: a dump atom or custom of the grains")
        lines = 3 if words[1:3] == ["BOX", "BOUNDS"] else 1
        key = " ".join(words[1:3]) if lines == 3 else " ".join(words[1:])
        rows = []
        for _ in range(lines):
            row, at = _line(path, content, at)
            rows.append(row)
        header.setdefault(key, rows)
    if columns is None or len(set(columns)) != len(columns) or not columns:
        raise FormatError(f"{path}: a time step has no 'ITEM: ATOMS' with the names of its columns; it is damaged")
    count, number = (_whole(path, header, key) for key in ("NUMBER OF ATOMS", "TIMESTEP"))
    stop = _end(path, content, at, count, len(columns), number)
    units = (_words(header, "UNITS") or METRES)[0]
    if units not in METRES:
        raise FormatError(f"{path} is in units {units!r}, expected si: metres, kilograms, seconds")
    frame = ThirdPartyFrame(
        path=path,
        count=count,
        columns=columns,
        read=partial(_read, path, at, stop, count, columns),
        column_map={ours: word for ours, words in COLUMNS.items() for word in reversed(words) if word in columns},
        number=number,
        time=_time(path, header),
    )
    return _in_box(frame, header.get("BOX BOUNDS")), stop


def _end(path: Path, content: Any, at: int, count: int, width: int, number: int) -> int:
    """Return the end of the rows from byte `at`; the last time step of a file must be complete."""
    stop = content.find(b"ITEM:", at)
    last = stop < 0
    stop = len(content) if last else stop
    rows = stop - at >= 2 * count * width - 1 and (not last or content[at:stop].count(b"\n") >= count)
    if not rows:
        raise _TruncatedError(f"{path} ends within the {count} particles of time step {number}; it is truncated")
    return stop


def _line(path: Path, content: Any, at: int) -> tuple[list[str], int]:
    """Return (words of the line at byte `at`, where the next line begins)."""
    stop = content.find(b"\n", at, at + LONGEST_LINE)
    if stop < 0:
        if len(content) - at < LONGEST_LINE:
            raise _TruncatedError(f"{path} ends within the header of a time step; it is truncated")
        raise FormatError(f"{path} has a line of {LONGEST_LINE} bytes where a time step begins; it is damaged")
    return content[at:stop].decode("ascii", "replace").split(), stop + 1


def _words(header: dict[str, list[list[str]]], key: str) -> list[str]:
    """Return the words of the first line of an ITEM; [] where it is missing."""
    return header[key][0] if key in header else []


def _whole(path: Path, header: dict[str, list[list[str]]], key: str) -> int:
    word = (_words(header, key) or [""])[0]
    if not _WHOLE.fullmatch(word):
        raise FormatError(f"{path}: ITEM: {key} is {word[:20]!r}, expected an integer")
    return int(word)


def _time(path, header):
    if "TIME" not in header:
        return None
    try:
        time = float(_words(header, "TIME")[0])
    except (ValueError, IndexError):
        raise FormatError(f"{path}: ITEM: TIME is not a number") from None
    return time if abs(time) < float("inf") else None


def _in_box(frame: ThirdPartyFrame, bounds: list[list[str]] | None) -> ThirdPartyFrame:
    """Return `frame` with columns x, y, z from fractions of the box, where it has no other position."""
    if all(axis in frame.column_map for axis in "xyz"):
        return frame
    shares = next((names for names in SHARES if set(names) <= set(frame.columns)), None)
    if shares is None or set("xyz") & set(frame.columns):
        return frame
    corner, edges = _box(frame.path, bounds)
    return ThirdPartyFrame(
        **{
            **vars(frame),
            "columns": (*frame.columns, *"xyz"),
            "column_map": frame.column_map | {axis: axis for axis in "xyz"},
            "read": partial(_read_in_box, frame.read, shares, corner, edges),
        }
    )


def _box(path: Path, bounds: list[list[str]] | None) -> tuple[np.ndarray, np.ndarray]:
    """Return (float64[3] corner, float64[3, 3] edges, one per row) [m] of three lines of BOX BOUNDS.

    Orthogonal: `lo hi`. Sheared: `lo hi` of the bounding box, and the shears xy, xz, yz. General: `x y z origin`.
    """
    try:
        rows = np.array([[float(word) for word in row] for row in bounds or ()])
    except ValueError:
        rows = np.empty(0)
    if rows.ndim != 2 or rows.shape[0] != 3 or rows.shape[1] not in (2, 3, 4) or not np.isfinite(rows).all():
        raise FormatError(f"{path}: positions are fractions of the box, but BOX BOUNDS is not a valid box")
    if rows.shape[1] == 4:
        return rows[:, 3], rows[:, :3]
    low, high = rows[:, 0].copy(), rows[:, 1].copy()
    xy, xz, yz = rows[:, 2] if rows.shape[1] == 3 else (0.0, 0.0, 0.0)
    low[:2] -= min(0.0, xy, xz, xy + xz), min(0.0, yz)
    high[:2] -= max(0.0, xy, xz, xy + xz), max(0.0, yz)
    edges = np.diag(high - low)
    edges[1, 0], edges[2, 0], edges[2, 1] = xy, xz, yz
    return low, edges


def _read(path, start, stop, count, columns, names):
    found = read_rows(path, start, stop, Form(columns, BLANK), names)
    rows = len(found[names[0]]) if names else count
    if rows != count:
        raise FormatError(f"{path} contains {rows} rows in a time step of {count} particles; it is damaged")
    return found


def _read_in_box(read, shares, corner, edges, names):
    own = tuple(name for name in names if name not in "xyz")
    found = read(tuple(dict.fromkeys((*own, *shares))) if len(own) < len(names) else own)
    place = None
    if len(own) < len(names):
        with np.errstate(invalid="ignore"):  # non-finite values are reported later, with their row
            place = np.stack([found[share] for share in shares], axis=1) @ edges + corner
    return {name: found[name] if name in own else place[:, "xyz".index(name)] for name in names}


READER = Reader("lammps", recognises, frames)
