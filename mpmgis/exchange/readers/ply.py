"""PLY files of vertices, binary or text: columns by name; and the reader of general ones."""

import re
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...system.errors import FormatError
from .array_columns import plainly_named
from .reader_interface import MOST_DIGITS, Reader, ThirdPartyFrame, frame_of_each, number_of, require_readable
from .record_parsing import text_numbers

LONGEST_HEADER = 65536  # [bytes]
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
TEXT = "ascii"
TYPES = {
    **dict.fromkeys(("double", "float64"), "f8"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
}
_END = re.compile(rb"\nend_header[ \t]*\r?\n")


class PlyHeader(NamedTuple):
    """Layout of the vertices.

    Attributes
    ----------
    count : int
    columns : tuple of str
    dtype : np.dtype or None
        Of a row; None for text.
    start : int [bytes]
        Of the rows.
    """

    count: int
    columns: tuple
    dtype: np.dtype | None
    start: int


def read_ply_header(path: str | Path) -> PlyHeader:
    """Read the header of a file whose first element is `vertex`.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        No PLY, lists of values, or shorter than declared.
    """
    size = require_readable(path)
    with open(path, "rb") as file:
        head = file.read(LONGEST_HEADER)
    end = _END.search(head)
    if not head.startswith(b"ply") or not end:
        raise FormatError(f"{path} is not a PLY file (no header from 'ply' to 'end_header')")
    try:
        count, order, row = _rows_of(path, head[: end.start()].decode("ascii", "replace").splitlines())
    except IndexError:
        raise FormatError(f"{path}: a line of the PLY header is incomplete") from None
    dtype = None if order == TEXT else np.dtype([(name, ORDERS[order] + kind) for name, kind in row])
    header = PlyHeader(count, tuple(name for name, _ in row), dtype, end.end())
    if count == 0:
        raise FormatError(f"{path}: contains no particle")
    wanted = header.start + count * (2 * len(row) if dtype is None else dtype.itemsize) - (dtype is None)
    if size < wanted:
        least = "at least " if dtype is None else ""
        raise FormatError(f"{path} has {size} bytes, expected {least}{wanted} for {count} rows; it is truncated")
    return header


def _rows_of(path: str | Path, lines: list[str]) -> tuple[int, str, list[tuple[str, str]]]:
    """Return (number of vertices, format, list of (name, NumPy type)) of the lines of a header."""
    count, order, row, element = None, None, [], None
    for words in map(str.split, lines):
        if words[:1] == ["format"]:
            order = words[1]
            if order not in ORDERS and order != TEXT:
                raise FormatError(f"{path} is a PLY of format {order}, expected {', '.join((*ORDERS, TEXT))}")
        elif words[:1] == ["element"]:
            element = words[1]
            if count is None and element != "vertex":
                raise FormatError(f"{path}: its first element is {element}, expected vertex")
            if element == "vertex":
                count = int(words[2]) if re.fullmatch(rf"[0-9]{{1,{MOST_DIGITS}}}", words[2]) else None
        elif words[:1] == ["property"] and element == "vertex":
            if len(words) != 3 or words[1] not in TYPES:
                raise FormatError(f"{path}: property {' '.join(words[1:])} is not a number of a vertex")
            row.append((words[2], TYPES[words[1]]))
    names = [name for name, _ in row]
    if count is None or order is None or not row or len(set(names)) != len(names):
        raise FormatError(f"{path}: the PLY header lacks format or number of vertices, or has a property twice")
    return count, order, row


def read_ply_columns(path: str | Path, header: PlyHeader, names: Iterable[str]) -> dict[str, np.ndarray]:
    """Read some columns.

    Parameters
    ----------
    path : str or Path
    header : PlyHeader
    names : iterable of str

    Returns
    -------
    dict of str to float64[n]

    Raises
    ------
    FormatError
        Truncated, or other content than numbers.
    """
    with open(path, "rb") as file:
        file.seek(header.start)
        if header.dtype is None:
            return _text_columns(path, header, file.read(), names)
        rows = np.fromfile(file, header.dtype, header.count)
    if len(rows) < header.count:
        raise FormatError(f"{path} has {len(rows)} rows, expected {header.count}; it is truncated")
    return {name: rows[name].astype(np.float64) for name in names}


def _text_columns(path: str | Path, header: PlyHeader, text: bytes, names: Iterable[str]) -> dict[str, np.ndarray]:
    """Return columns of a text file; other elements may follow the vertices."""
    count = header.count * len(header.columns)
    rows = text_numbers(text, count, path, "its list of vertices", more=True).reshape(header.count, -1)
    return {name: rows[:, header.columns.index(name)].copy() for name in names}


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file is a PLY with columns of position and velocity.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    if not fits(path, head):
        return False
    try:
        return set(read_ply_header(path).columns) >= {"x", "y", "z", "vx", "vy", "vz"}
    except FormatError:
        return False


def fits(path: Path, head: bytes) -> bool:
    """Return whether a file is a PLY.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    return head.startswith((b"ply\n", b"ply\r"))


def open_file(path: str | Path) -> ThirdPartyFrame:
    """Describe the frame in a file.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
    """
    path, header = Path(path), read_ply_header(path)
    return ThirdPartyFrame(
        path=path,
        count=header.count,
        columns=header.columns,
        read=partial(read_ply_columns, path, header),
        column_map=plainly_named(dict.fromkeys(header.columns, 1)),
        number=number_of(path),
    )


READER = Reader("ply", recognises, frame_of_each(open_file), fits)
