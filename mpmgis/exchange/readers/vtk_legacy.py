"""Legacy VTK files of points, binary (big-endian) or text: layout and arrays.

Versions 1.0 to 5.1 of the format, datasets UNSTRUCTURED_GRID and POLYDATA. Attributes of cells belong to the points
where the k-th cell is the k-th point, as particle codes write them.
"""

import re
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...system.errors import FormatError
from .array_columns import columns_of, picked
from .mapped_files import mapped
from .reader_interface import MOST_DIGITS, ThirdPartyFrame, number_of
from .record_parsing import text_numbers

MAGIC = b"# vtk DataFile Version"
POINTS = "points"
TYPES = {
    "double": "f8",
    "float": "f4",
    "long": "i8",
    "unsigned_long": "u8",
    "int": "i4",
    "unsigned_int": "u4",
    "short": "i2",
    "unsigned_short": "u2",
    "char": "i1",
    "unsigned_char": "u1",
    "vtkidtype": "i8",
    "vtktypeint64": "i8",
    "vtktypeuint64": "u8",
    "vtktypeint32": "i4",
}
COMPONENTS = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1}
CELLS = ("CELLS", "VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS")
LONGEST_LINE = 1000  # [bytes] with a keyword
MOST_ARRAYS = 1000  # of a FIELD
_KEYWORD = re.compile(rb"\n[ \t]*(?!(?i:nan|inf|infinity)\b)[A-Za-z_]")
_NUMBER = re.compile(rf"[0-9]{{1,{MOST_DIGITS}}}")


class Block(NamedTuple):
    """An array in the file.

    Attributes
    ----------
    start, stop : int [bytes]
    dtype : str or None
        None for text.
    components : int
    count : int
        Number of rows.
    """

    start: int
    stop: int
    dtype: str | None
    components: int
    count: int


class Layout(NamedTuple):
    """Layout of a file.

    Attributes
    ----------
    points : int
        Number of points.
    arrays : dict of str to Block
        Of the points; positions are POINTS.
    fields : dict of str to Block
        Of the file.
    """

    points: int
    arrays: dict
    fields: dict


class _Reader:
    """Sequential reader of lines of words and blocks of numbers."""

    def __init__(self, path, content):
        self.path, self.content, self.at, self.binary = path, content, 0, False

    def line(self) -> list[str] | None:
        """Return the words of the next line that is not blank; None at the end."""
        while self.at < len(self.content):
            stop = self.content.find(b"\n", self.at, self.at + LONGEST_LINE)
            if stop < 0:
                if len(self.content) - self.at >= LONGEST_LINE:
                    raise FormatError(
                        f"{self.path}: a line of {LONGEST_LINE} bytes at byte {self.at}, expected a keyword"
                    )
                stop = len(self.content)
            words = self.content[self.at : stop].decode("ascii", "replace").split()
            self.at = stop + 1
            if words:
                return words
        return None

    def words(self, count: int, what: str) -> list[str]:
        """Return the words of the next line, which has at least `count` words."""
        words = self.line()
        if words is None or len(words) < count:
            raise FormatError(f"{self.path}: {what}: got {' '.join(words or ['the end'])[:60]!r}; it is damaged")
        return words

    def number(self, words: list[str], k: int) -> int:
        """Return the k-th word as a whole number."""
        if k >= len(words) or not _NUMBER.fullmatch(words[k]):
            raise FormatError(f"{self.path}: {' '.join(words)[:60]!r}: expected an integer as word {k + 1}")
        return int(words[k])

    def block(self, name: str, count: int, components: int, kind: str) -> Block:
        """Return the Block at the present position, which moves behind it."""
        dtype = TYPES.get(kind.lower())
        if dtype is None:
            raise FormatError(f"{self.path}: {name} has type {kind[:20]!r}, expected {', '.join(TYPES)}")
        start = self.at
        if self.binary:
            stop = start + count * components * np.dtype(dtype).itemsize
        else:
            found = _KEYWORD.search(self.content, max(start - 1, 0))
            stop = found.start() + 1 if found else len(self.content)
        if stop > len(self.content) or (not self.binary and stop - start < 2 * count * components - 1):
            raise FormatError(f"{self.path} ends within {name} of {count} x {components} numbers; it is truncated")
        self.at = stop
        return Block(start, stop, ">" + dtype if self.binary else None, components, count)


def read_layout(path: str | Path) -> Layout:
    """Read the layout of a file.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        No legacy VTK of points, damaged, truncated.
    """
    with mapped(path) as content:
        if not content[: len(MAGIC)].startswith(MAGIC):
            raise FormatError(f"{path} is not a legacy VTK file (it does not begin with {MAGIC.decode()!r})")
        reader = _Reader(path, content)
        reader.line()
        reader.at = content.find(b"\n", reader.at) + 1  # the title, which may be blank
        form = reader.words(1, "after its title")[0].upper()
        if form not in ("ASCII", "BINARY"):
            raise FormatError(f"{path}: its third line is {form[:20]!r}, expected ASCII or BINARY")
        reader.binary = form == "BINARY"
        dataset = " ".join(reader.words(2, "its dataset")).upper()
        if dataset not in ("DATASET UNSTRUCTURED_GRID", "DATASET POLYDATA"):
            raise FormatError(
                f"{path}: {dataset[:60]!r}, expected DATASET UNSTRUCTURED_GRID or POLYDATA of points; omit this file"
            )
        return _sections(reader)


def _sections(reader: _Reader) -> Layout:
    """Return the layout of all that follows the header."""
    points, cells, at, arrays, fields = None, 0, None, {"points": {}, "cells": {}}, {}
    while (words := reader.line()) is not None:
        key = words[0].upper()
        if key == "POINTS":
            points = reader.number(words, 1)
            block = reader.block("POINTS", points, 3, words[2] if len(words) > 2 else "")
            arrays["points"][POINTS] = block
        elif key in CELLS:
            cells += _skip_cells(reader, words)
        elif key == "CELL_TYPES":
            reader.block(key, reader.number(words, 1), 1, "int")
        elif key in ("POINT_DATA", "CELL_DATA"):
            at = "points" if key == "POINT_DATA" else "cells"
            count = reader.number(words, 1)
            if count != (points if at == "points" else cells):
                raise FormatError(f"{reader.path}: {key} {count}, but it has {points} points and {cells} cells")
        elif key == "METADATA":
            _skip_metadata(reader)
        elif key == "FIELD":
            target = fields if at is None else arrays[at]
            target |= _field(reader, words)
        elif at is not None:
            count = points if at == "points" else cells
            arrays[at] |= _attribute(reader, words, count)
        else:
            raise FormatError(f"{reader.path}: got {key[:40]!r}, expected a section; it is damaged")
    if points is None:
        raise FormatError(f"{reader.path} contains no POINTS")
    return Layout(points, _of_points(reader.path, points, cells, arrays), fields)


def _of_points(path: str | Path, points: int, cells: int, arrays: dict[str, dict[str, Block]]) -> dict[str, Block]:
    """Return the arrays with one row per point, including those of cells where each cell is a point."""
    found = dict(arrays["points"])
    if cells == points:
        found |= {name: block for name, block in arrays["cells"].items() if name not in found}
    for name, block in found.items():
        if block.count != points:
            raise FormatError(f"{path}: {name} has {block.count} rows, expected one for each of {points} points")
    return found


def _skip_cells(reader: _Reader, words: list[str]) -> int:
    """Skip the cells and return their number."""
    count, size = reader.number(words, 1), reader.number(words, 2)
    before = reader.at
    following = reader.line()
    if following is not None and following[0].upper() == "OFFSETS":  # from version 5.1: one more count, and two arrays
        reader.block("OFFSETS", count, 1, following[1] if len(following) > 1 else "")
        following = reader.words(2, "after OFFSETS")
        reader.block("CONNECTIVITY", size, 1, following[1])
        return max(count - 1, 0)
    reader.at = before
    reader.block(words[0], size, 1, "int")
    return count


def _skip_metadata(reader: _Reader) -> None:
    """Skip METADATA, which ends with a blank line."""
    stop = reader.content.find(b"\n\n", max(reader.at - 1, 0))
    reader.at = len(reader.content) if stop < 0 else stop + 2


def _field(reader: _Reader, words: list[str]) -> dict[str, Block]:
    """Return the arrays of a FIELD: lines `name components rows type`."""
    count, found = reader.number(words, 2), {}
    if count > MOST_ARRAYS:
        raise FormatError(f"{reader.path}: a FIELD of {count} arrays, expected at most {MOST_ARRAYS}; it is damaged")
    while len(found) < count:
        words = reader.words(1, "an array of a FIELD")
        if words[0].upper() == "METADATA":
            _skip_metadata(reader)
            continue
        components, rows = reader.number(words, 1), reader.number(words, 2)
        name = words[0]
        if name in found:
            raise FormatError(f"{reader.path}: two arrays of a FIELD are named {name[:40]!r}")
        found[name] = reader.block(name, rows, components, words[3] if len(words) > 3 else "")
    return {name: block for name, block in found.items() if block.components > 0}


def _attribute(reader: _Reader, words: list[str], count: int) -> dict[str, Block]:
    """Return {name: Block} of SCALARS, VECTORS etc.; {} for attributes of display only."""
    key = words[0].upper()
    name = words[1] if len(words) > 1 else ""
    if key == "SCALARS":
        components = reader.number(words, 3) if len(words) > 3 else 1
        before = reader.at
        following = reader.line()
        if following is None or following[0].upper() != "LOOKUP_TABLE":
            reader.at = before
        return {name: reader.block(name, count, max(components, 1), words[2] if len(words) > 2 else "")}
    if key in COMPONENTS:
        return {name: reader.block(name, count, COMPONENTS[key], words[2] if len(words) > 2 else "")}
    if key == "TEXTURE_COORDINATES":
        reader.block(name, count, reader.number(words, 2), words[3] if len(words) > 3 else "")
        return {}
    if key == "COLOR_SCALARS":
        reader.block(name, count, reader.number(words, 2), "unsigned_char")
        return {}
    if key == "LOOKUP_TABLE":
        reader.block(name, reader.number(words, 2), 4, "unsigned_char")
        return {}
    raise FormatError(f"{reader.path}: {key[:40]!r} is not an attribute of legacy VTK; it is damaged")


def read_block(path: str | Path, block: Block, name: str) -> np.ndarray:
    """Read one array.

    Parameters
    ----------
    path : str or Path
    block : Block
    name : str
        For messages.

    Returns
    -------
    float64[count, components]

    Raises
    ------
    FormatError
        Other content than numbers in a text file; changed since its layout was read.
    """
    with mapped(path) as content:
        raw = content[block.start : block.stop]
    if block.dtype is None:
        values = text_numbers(raw, block.count * block.components, path, name or "POINTS")
    else:
        if len(raw) != block.stop - block.start:
            raise FormatError(f"{path} has become shorter since it was opened")
        with np.errstate(invalid="ignore"):  # NaN is reported later, with its row
            values = np.frombuffer(raw, block.dtype).astype(np.float64)
    return values.reshape(block.count, block.components)


def read_columns(path: str | Path, arrays: dict[str, Block], names: Iterable[str]) -> dict[str, np.ndarray]:
    """Read some columns of the arrays.

    Parameters
    ----------
    path : str or Path
    arrays : dict of str to Block
    names : iterable of str

    Returns
    -------
    dict of str to float64[n]

    Raises
    ------
    FormatError
    """
    components = {name: block.components for name, block in arrays.items()}
    return picked(lambda name: read_block(path, arrays[name], name), components, names)


def legacy_frame(path: str | Path, layout: Layout | None = None, **attributes: Any) -> ThirdPartyFrame:
    """Describe the frame in a legacy VTK file.

    Parameters
    ----------
    path : str or Path
    layout : Layout, optional
        Without it, it is read.
    **attributes
        Further fields of the ThirdPartyFrame.

    Raises
    ------
    FormatError
    """
    path = Path(path)
    layout = layout or read_layout(path)
    components = {name: block.components for name, block in layout.arrays.items()}
    attributes = {"number": number_of(path), "time": _time(path, layout)} | attributes
    return ThirdPartyFrame(
        path=path,
        count=layout.points,
        columns=tuple(columns_of(components)),
        read=partial(read_columns, path, layout.arrays),
        **attributes,
    )


def _time(path: Path, layout: Layout) -> float | None:
    """Return the value of the field TIME or TimeValue; None where there is none."""
    for name, block in layout.fields.items():
        if name.lower() in ("time", "timevalue") and block.count * block.components == 1:
            time = float(read_block(path, block, name)[0, 0])
            return time if np.isfinite(time) else None
    return None
