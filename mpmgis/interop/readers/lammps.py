"""Text dumps of LAMMPS, LIGGGHTS and, in the same form, of the MPM code Karamelo.

`ITEM: TIMESTEP`, `NUMBER OF ATOMS`, `BOX BOUNDS`, `ATOMS id type x y z ..`, one or many times in a file. The time step
is a number, and a time where `ITEM: TIME` says so. Karamelo writes 0 there and the step into the file's name,
`proc-<rank>.` before it in a parallel run; how the others name pieces and repeat steps: `lammps_series`. Places are
`x`, unwrapped `xu`, or shares of the box `xs`, `xsu`, which the box makes metres. `radius` gives the volume of a grain.
"""

import re
from functools import partial
from pathlib import Path

import numpy as np

from ...errors import FormatError
from .base import MOST_DIGITS, ForeignFrame, ForeignReader, joined
from .lammps_series import numbered_by_name, one_a_step, pieces_by_name, with_pieces_beside
from .parsing import BLANK, Form, mapped, read_rows

BEGIN = b"ITEM: TIMESTEP"
BINARY = re.compile(rb".{7}[\x00\xff]DUMP(CUSTOM|ATOM)", re.DOTALL)  # behind the length of the word, negative
COLUMNS = {  # ours, and the columns that may be it
    **{axis: (axis, f"{axis}u") for axis in "xyz"}, **{f"v{axis}": (f"v{axis}",) for axis in "xyz"},
    "mass": ("mass",), "radius": ("radius",), "diameter": ("diameter",), "id": ("id",),
}  # fmt: skip
SHARES = ("xs", "ys", "zs"), ("xsu", "ysu", "zsu")  # of the box's edges
OTHER_ROWS = ("ENTRIES", "CELLS", "FACETS")  # of `dump local`, of grids and meshes
METRES = ("si",)
LONGEST_LINE = 10_000
MOST_ITEMS = 20
_WHOLE = re.compile(rf"[0-9]{{1,{MOST_DIGITS}}}")


class _CutShortError(FormatError):
    """The file ends within a time step."""


def recognises(path, head):
    """True for a dump with its first time step at the beginning."""
    return head.startswith((BEGIN, b"ITEM: UNITS", b"ITEM: TIME\n")) or BINARY.match(head) is not None


def frames(paths, terms):
    """The ForeignFrames in some files; the pieces of a parallel run make one, a step that is repeated too."""
    groups = {}
    for path in with_pieces_beside(list(map(Path, paths)), first_step, open_file):
        pieces = pieces_by_name(path)
        groups.setdefault(pieces[0], pieces)
    found = []
    for pieces in groups.values():
        opened = [open_file(piece) for piece in pieces]
        if len({len(series) for series in opened}) != 1:
            raise FormatError(f"{pieces[0]} and the pieces of its other ranks hold different numbers of time steps")
        found += [joined(list(same)) for same in zip(*opened, strict=True)]
    if all(frame.number == 0 for frame in found):
        found = numbered_by_name(found)
    return one_a_step(found)


def first_step(path):
    """Number of a dump's first time step; None of what is no dump, or not to be read."""
    try:
        with mapped(path) as content:
            begin = content.find(BEGIN, 0, LONGEST_LINE)
            words = content[begin : begin + 100].split() if begin >= 0 and content[:5] == b"ITEM:" else []
    except FormatError:
        return None
    return int(words[2]) if len(words) > 2 and _WHOLE.fullmatch(words[2].decode("ascii", "replace")) else None


def open_file(path):
    """The ForeignFrames in one file.

    Raises
    ------
    FormatError
        No dump, damaged, truncated, in units that are not metres.
    """
    path, found = Path(path), []
    with mapped(path) as content:
        if BINARY.match(content[:20]):
            raise FormatError(f"{path} is a binary dump; make it text with LAMMPS' own binary2txt, and name that")
        at = 0
        while at < len(content):
            if content[at : at + 5] != b"ITEM:":
                if content[at : at + LONGEST_LINE].strip():
                    raise FormatError(f"{path}: wanted 'ITEM:' at byte {at}; it is no dump of LAMMPS, or damaged")
                break
            try:
                frame, at = _step(path, content, at)
            except _CutShortError as error:
                raise FormatError(f"{error}{_whole_part(path, len(found), at)}") from None
            found.append(frame)
    if not found:
        raise FormatError(f"{path} holds no time step; it is no dump of LAMMPS, or damaged")
    return found


def _whole_part(path, count, size):
    """How to come by the `count` time steps, `size` bytes, before one that is cut short."""
    if count == 0:
        return ""
    unpacked = "gzip -dc {0} | head -c {1}" if path.suffix == ".gz" else "head -c {1} {0}"
    return f"; the {count} before are whole: {unpacked.format(path.name, size)} > whole.dump"


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
        if words[1:2] and words[1] in OTHER_ROWS:
            raise FormatError(f"{path} holds {words[1]}, wanted ATOMS: a dump atom or custom of the grains themselves")
        lines = 3 if words[1:3] == ["BOX", "BOUNDS"] else 1
        key = " ".join(words[1:3]) if lines == 3 else " ".join(words[1:])
        rows = []
        for _ in range(lines):
            row, at = _line(path, content, at)
            rows.append(row)
        said.setdefault(key, rows)
    if columns is None or len(set(columns)) != len(columns) or not columns:
        raise FormatError(f"{path}: a time step has no 'ITEM: ATOMS' with the names of its columns; it is damaged")
    count, number = (_whole(path, said, key) for key in ("NUMBER OF ATOMS", "TIMESTEP"))
    stop = _end(path, content, at, count, len(columns), number)
    units = (_words(said, "UNITS") or METRES)[0]
    if units not in METRES:
        raise FormatError(f"{path} is in units {units!r}, wanted si: metres, kilograms, seconds")
    frame = ForeignFrame(
        path=path,
        count=count,
        columns=columns,
        read=partial(_read, path, at, stop, count, columns),
        meant={ours: word for ours, words in COLUMNS.items() for word in reversed(words) if word in columns},
        number=number,
        time=_time(path, said),
    )
    return _placed(frame, said.get("BOX BOUNDS")), stop


def _end(path, content, at, count, width, number):
    """Where the rows from byte `at` end; the last of a file must have all of its own."""
    stop = content.find(b"ITEM:", at)
    last = stop < 0
    stop = len(content) if last else stop
    rows = stop - at >= 2 * count * width - 1 and (not last or content[at:stop].count(b"\n") >= count)
    if not rows:
        raise _CutShortError(f"{path} ends within the {count} particles of time step {number}; it is truncated")
    return stop


def _line(path, content, at):
    """(Words of the line at byte `at`, where the next line begins)."""
    stop = content.find(b"\n", at, at + LONGEST_LINE)
    if stop < 0:
        if len(content) - at < LONGEST_LINE:
            raise _CutShortError(f"{path} ends within the head of a time step; it is truncated")
        raise FormatError(f"{path} has a line of {LONGEST_LINE} bytes where a time step begins; it is damaged")
    return content[at:stop].decode("ascii", "replace").split(), stop + 1


def _words(said, key):
    """The words of the first line under an ITEM; [] where it is not there."""
    return said[key][0] if key in said else []


def _whole(path, said, key):
    word = (_words(said, key) or [""])[0]
    if not _WHOLE.fullmatch(word):
        raise FormatError(f"{path}: ITEM: {key} is {word[:20]!r}, wanted a whole number")
    return int(word)


def _time(path, said):
    if "TIME" not in said:
        return None
    try:
        time = float(_words(said, "TIME")[0])
    except (ValueError, IndexError):
        raise FormatError(f"{path}: ITEM: TIME is no number") from None
    return time if abs(time) < float("inf") else None


def _placed(frame, bounds):
    """`frame` with columns x, y, z made of shares of the box, where it has no other place."""
    if all(axis in frame.meant for axis in "xyz"):
        return frame
    shares = next((names for names in SHARES if set(names) <= set(frame.columns)), None)
    if shares is None or set("xyz") & set(frame.columns):
        return frame
    corner, edges = _box(frame.path, bounds)
    return ForeignFrame(
        **{
            **vars(frame),
            "columns": (*frame.columns, *"xyz"),
            "meant": frame.meant | {axis: axis for axis in "xyz"},
            "read": partial(_read_placed, frame.read, shares, corner, edges),
        }
    )


def _box(path, bounds):
    """(float64[3] corner, float64[3, 3] edges, one a row) [m] of three lines of BOX BOUNDS.

    Straight: `lo hi`. Sheared: `lo hi` of what encloses it, and the shears xy, xz, yz. Any edges: `x y z origin`.
    """
    try:
        rows = np.array([[float(word) for word in row] for row in bounds or ()])
    except ValueError:
        rows = np.empty(0)
    if rows.ndim != 2 or rows.shape[0] != 3 or rows.shape[1] not in (2, 3, 4) or not np.isfinite(rows).all():
        raise FormatError(f"{path}: its places are shares of the box, and BOX BOUNDS are no numbers of a box")
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
        raise FormatError(f"{path} holds {rows} rows in a time step of {count} particles; it is damaged")
    return found


def _read_placed(read, shares, corner, edges, names):
    own = tuple(name for name in names if name not in "xyz")
    found = read(tuple(dict.fromkeys((*own, *shares))) if len(own) < len(names) else own)
    place = None
    if len(own) < len(names):
        with np.errstate(invalid="ignore"):  # what is not finite is told with its row, later
            place = np.stack([found[share] for share in shares], axis=1) @ edges + corner
    return {name: found[name] if name in own else place[:, "xyz".index(name)] for name in names}


READER = ForeignReader("lammps", recognises, frames)
