"""Binary PLY files of vertices: their columns by name."""

import os
from typing import NamedTuple

import numpy as np

from ...errors import FormatError, one_line

LONGEST_HEADER = 65536  # bytes
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {
    **dict.fromkeys(("double", "float64"), "f8"), **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("char", "int8"), "i1"), **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"), **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"), **dict.fromkeys(("uint", "uint32"), "u4"),
}  # fmt: skip


class PlyHeader(NamedTuple):
    """Where the vertices are: `count` of them, `columns` by name, `dtype` of a row, `start` of the first [bytes]."""

    count: int
    columns: tuple
    dtype: np.dtype
    start: int


def read_ply_header(path):
    """The PlyHeader of a file whose first element is `vertex`.

    Raises
    ------
    FormatError
        No PLY, text, lists of values, or shorter than its header says.
    """
    try:
        with open(path, "rb") as file:
            head = file.read(LONGEST_HEADER)
            size = os.fstat(file.fileno()).st_size
    except OSError as error:
        raise FormatError(f"{path}: {one_line(error.strerror or error)}") from error
    text, end, _ = head.partition(b"end_header\n")
    if not head.startswith(b"ply") or not end:
        raise FormatError(f"{path} is no PLY file (it has no header from 'ply' to 'end_header')")
    try:
        count, order, row = _rows_of(path, text.decode("ascii", "replace").splitlines())
    except IndexError:
        raise FormatError(f"{path}: a line of its PLY header lacks a word") from None
    header = PlyHeader(
        count, tuple(name for name, _ in row), np.dtype([(n, order + t) for n, t in row]), len(text + end)
    )
    wanted = header.start + count * header.dtype.itemsize
    if count == 0:
        raise FormatError(f"{path}: no particle in it")
    if size < wanted:
        raise FormatError(f"{path} has {size} bytes, wanted {wanted} for {count} rows; it is truncated")
    return header


def _rows_of(path, lines):
    """(Number of vertices, byte order, list of (name, NumPy type)) of a header's lines."""
    count, order, row, element = None, None, [], None
    for words in map(str.split, lines):
        if words[:1] == ["format"]:
            order = ORDERS.get(words[1])
            if order is None:
                raise FormatError(f"{path} is a PLY of format {words[1]}, wanted {' or '.join(ORDERS)}")
        elif words[:1] == ["element"]:
            element = words[1]
            if count is None and element != "vertex":
                raise FormatError(f"{path}: its first element is {element}, wanted vertex")
            count = int(words[2]) if element == "vertex" and words[2].isdigit() else count
        elif words[:1] == ["property"] and element == "vertex":
            if len(words) != 3 or words[1] not in TYPES:
                raise FormatError(f"{path}: property {' '.join(words[1:])} is no number of a vertex")
            row.append((words[2], TYPES[words[1]]))
    names = [name for name, _ in row]
    if count is None or order is None or not row or len(set(names)) != len(names):
        raise FormatError(f"{path}: its PLY header names no format, no vertices, or a property twice")
    return count, order, row


def read_ply_columns(path, header, names):
    """Name -> float64[n] of some columns."""
    with open(path, "rb") as file:
        file.seek(header.start)
        rows = np.fromfile(file, header.dtype, header.count)
    return {name: rows[name].astype(np.float64) for name in names}
