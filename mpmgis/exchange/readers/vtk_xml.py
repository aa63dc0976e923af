"""VTK XML files of points (.vtp, .vtu): layout and arrays.

Arrays as text, base64, or appended raw or base64, uncompressed or compressed by zlib. The XML is parsed without storing
its text; document types are refused, so that no entity can be defined. Arrays are read on demand.
"""

import base64
import binascii
import mmap
import re
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple
from xml.parsers import expat

import numpy as np

from ...system.errors import FormatError, one_line
from .mapped_files import mapped
from .reader_interface import MOST_DIGITS
from .record_parsing import text_numbers

TYPES = {
    "Float64": "f8",
    "Float32": "f4",
    "Int64": "i8",
    "UInt64": "u8",
    "Int32": "i4",
    "UInt32": "u4",
    "Int16": "i2",
    "UInt16": "u2",
    "Int8": "i1",
    "UInt8": "u1",
}
HEADERS = {"UInt32": "u4", "UInt64": "u8"}
PACKERS = ("", "vtkZLibDataCompressor")
FILES = ("PolyData", "UnstructuredGrid")
POINTS = "points"
XML_AT_ONCE = 1 << 20  # [bytes] parsed at once
MOST_DEPTH = 50  # elements within each other
_APPENDED = re.compile(rb"<AppendedData([^>]{0,200})>\s*_")
_DIGITS = re.compile(rf"[0-9]{{1,{MOST_DIGITS}}}")


class Array(NamedTuple):
    """An array of a piece.

    Attributes
    ----------
    name : str
    form : {"ascii", "binary", "appended"}
    dtype : str
    count, components : int
    start, stop : int [bytes]
    """

    name: str
    form: str
    dtype: str
    count: int
    components: int
    start: int
    stop: int


class Layout(NamedTuple):
    """Layout of a file.

    Attributes
    ----------
    kind : str
        Type of the file.
    pieces : list of dict of str to Array
        Of points, by name.
    fields : dict of str to Array
        Of the file.
    header : str
        dtype of lengths.
    packed : bool
        Data are compressed.
    base64 : bool
        Appended data are text.
    """

    kind: str
    pieces: list
    fields: dict
    header: str
    packed: bool
    base64: bool


def read_layout(path: str | Path) -> Layout:
    """Read the layout of a file.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        No VTK XML of points, damaged, another compression than zlib.
    """
    with mapped(path) as content:
        found = _APPENDED.search(content)
        stop = found.start() if found else len(content)
        outline = _Outline(path)
        parse_outline(path, content, stop, outline)
        appended = found.end() if found else len(content)
        encoding = found[1] if found else b""
    if outline.kind not in FILES:
        raise FormatError(f"{path}: VTK XML of type {outline.kind!r}, expected {' or '.join(FILES)}")
    size = Path(path).stat().st_size
    pieces = [{array.name: array for array in outline.arrays(k, appended, size)} for k in range(outline.pieces)]
    fields = {array.name: array for array in outline.arrays(None, appended, size)}
    packed = outline.file.get("compressor", "")
    if packed not in PACKERS:
        raise FormatError(f"{path} is compressed by {packed[:40]}; let its code write it uncompressed or with zlib")
    header = outline.file.get("header_type", "UInt32")
    if header not in HEADERS:
        raise FormatError(f"{path}: header_type {header[:20]!r}, expected {' or '.join(HEADERS)}")
    order = {"LittleEndian": "<", "BigEndian": ">"}.get(outline.file.get("byte_order", "LittleEndian"))
    if order is None:
        raise FormatError(f"{path}: byte_order {outline.file['byte_order'][:20]!r}, expected LittleEndian or BigEndian")
    return Layout(outline.kind, pieces, fields, order + HEADERS[header], bool(packed), b"base64" in encoding)


def parse_outline(path: str | Path, content: mmap.mmap | bytes, stop: int, outline: Any) -> None:
    """Pass the elements of an XML file to a receiver.

    Parameters
    ----------
    path : str or Path
    content : mmap or bytes
    stop : int [bytes]
        End of the XML in `content`.
    outline : receiver
        With methods `start(tag, attributes, at)` and `end(tag, at)`, where `at` is the position of the tag [bytes].

    Raises
    ------
    FormatError
        No XML, a document type, too deep.
    """
    parser = expat.ParserCreate()
    parser.buffer_text = False

    def refuse(*_):
        raise FormatError(f"{path} declares a document type, which particle files do not have; it is not read")

    depth = 0

    def started(tag, attributes):
        nonlocal depth
        depth += 1
        if depth > MOST_DEPTH:
            raise FormatError(f"{path}: more than {MOST_DEPTH} elements within each other; it is damaged")
        outline.start(tag, attributes, parser.CurrentByteIndex)

    def ended(tag):
        nonlocal depth
        depth -= 1
        outline.end(tag, parser.CurrentByteIndex)

    parser.StartElementHandler, parser.EndElementHandler = started, ended
    parser.StartDoctypeDeclHandler = refuse
    try:
        for at in range(0, stop, XML_AT_ONCE):
            parser.Parse(content[at : min(at + XML_AT_ONCE, stop)], False)
        if stop == len(content):
            parser.Parse(b"", True)
    except expat.ExpatError as error:
        raise FormatError(f"{path} is not readable XML ({one_line(error)[:80]}); it is damaged") from error


class _Outline:
    """The elements of a VTK file that describe arrays of points."""

    def __init__(self, path):
        self.path, self.file, self.kind = path, {}, ""
        self.pieces, self.counts, self.open, self.inside, self.found = 0, [], None, [], []

    def start(self, tag: str, attributes: dict[str, str], at: int) -> None:
        """Receive the start of an element."""
        attributes = {key.lower(): value for key, value in attributes.items()}
        if tag == "VTKFile":
            self.file, self.kind = attributes, attributes.get("type", "")
        elif tag == "Piece":
            self.pieces += 1
            self.counts.append(self.number(attributes.get("numberofpoints", "0"), "NumberOfPoints"))
        elif tag == "DataArray":
            self.open = [attributes, at, None]
        elif self.open is not None and self.open[2] is None:
            self.open[2] = at  # VTK writes information elements after the numbers
        self.inside.append(tag)

    def end(self, tag: str, at: int) -> None:
        """Receive the end of an element."""
        self.inside.pop()
        section = self.inside[-1] if self.inside else ""
        if tag == "DataArray" and self.open is not None and section in ("Points", "PointData", "FieldData"):
            attributes, begin, stop = self.open
            piece = None if section == "FieldData" else self.pieces - 1
            self.found.append((piece, section, attributes, begin, at if stop is None else stop))
        self.open = None if tag == "DataArray" else self.open

    def number(self, word: str, what: str) -> int:
        """Return `word` as an integer."""
        if not _DIGITS.fullmatch(word.strip()):
            raise FormatError(f"{self.path}: {what} is {word[:20]!r}, expected an integer")
        return int(word)

    def arrays(self, piece: int | None, appended: int, size: int) -> Iterator[Array]:
        """Yield the Arrays of a piece, or of the fields (None); appended data begin at byte `appended`."""
        for owner, section, attributes, begin, end in self.found:
            if owner != piece:
                continue
            name = POINTS if section == "Points" else attributes.get("name", "")
            if attributes.get("type") not in TYPES:
                continue  # strings, and bits
            components = self.number(attributes.get("numberofcomponents") or "1", f"components of {name}")
            count = self.number(attributes.get("numberoftuples") or "1", name) if piece is None else self.counts[piece]
            form = attributes.get("format", "ascii")
            start, stop = begin, end
            if form == "appended":
                start, stop = appended + self.number(attributes.get("offset", ""), f"offset of {name}"), size
            yield Array(name, form, TYPES[attributes["type"]], count, components, start, stop)


def read_array(path: str | Path, layout: Layout, array: Array) -> np.ndarray:
    """Read one array.

    Parameters
    ----------
    path : str or Path
    layout : Layout
    array : Array

    Returns
    -------
    float64[count, components]

    Raises
    ------
    FormatError
        Truncated, of another length, no numbers.
    """
    wanted = array.count * array.components
    with mapped(path) as content:
        if array.form != "appended":
            start = content.find(b">", array.start, array.stop) + 1
            raw = content[start : array.stop] if start else b""
            if array.form == "ascii":
                return text_numbers(raw, wanted, path, array.name).reshape(array.count, array.components)
            raw = b"".join(raw.split())
        if array.form == "appended":
            data = _unwrapped(
                path, layout, array, lambda start, stop: content[array.start + start : array.start + stop]
            )
        elif array.form == "binary":
            data = _unwrapped(path, layout, array, lambda start, stop: raw[start:stop])
        else:
            raise FormatError(
                f"{path}: {array.name} has the format {array.form[:20]!r}, expected ascii, binary, appended"
            )
    values = np.frombuffer(data, layout.header[0] + array.dtype)
    return values.astype(np.float64).reshape(array.count, array.components)


def _unwrapped(path: str | Path, layout: Layout, array: Array, take: Callable[[int, int], bytes]) -> bytes:
    """Return the bytes of an array; `take(start, stop)` returns bytes relative to its start in the file."""
    text = array.form == "binary" or layout.base64
    wanted = array.count * array.components * np.dtype(array.dtype).itemsize
    size = np.dtype(layout.header).itemsize
    if not layout.packed:
        (length,), data = _headed(path, layout, array, take, text, 1, lambda header: int(header[0]))
        if length != wanted or len(data) < wanted:
            raise FormatError(
                f"{path}: {array.name} has {min(length, len(data))} bytes, expected {wanted}; it is damaged"
            )
        return data[:wanted]
    (blocks,), _ = _headed(path, layout, array, take, text, 1, lambda header: 0)
    if blocks > wanted or blocks * size > Path(path).stat().st_size:
        raise FormatError(f"{path}: {array.name} declares {blocks} blocks; it is damaged")
    header, data = _headed(path, layout, array, take, text, 3 + blocks, lambda header: int(header[3:].sum()))
    return _unpacked(path, array, header[1:], data, wanted)


def _headed(
    path: str | Path, layout: Layout, array: Array, take: Callable, text: bool, items: int, length_of: Callable
) -> tuple[np.ndarray, bytes]:
    """Return (lengths before the data, the data): `items` lengths, followed by `length_of(lengths)` bytes."""
    size = np.dtype(layout.header).itemsize * items
    try:
        if not text:
            header = _lengths(path, layout, array, take(0, size), size)
            return header, take(size, size + length_of(header))
        letters = 4 * -(-size // 3)
        first = take(0, letters)
        header = _lengths(path, layout, array, base64.b64decode(first), size)
        length = length_of(header)
        if first.endswith(b"=") or layout.packed:  # the lengths are encoded separately
            return header, base64.b64decode(take(letters, letters + 4 * -(-length // 3)))
        return header, base64.b64decode(take(0, 4 * -(-(size + length) // 3)))[size:]
    except binascii.Error as error:
        raise FormatError(f"{path}: {array.name} is not base64 ({one_line(error)[:60]}); it is damaged") from error


def _lengths(path: str | Path, layout: Layout, array: Array, raw: bytes, size: int) -> np.ndarray:
    if len(raw) < size:
        raise FormatError(f"{path} ends before {array.name}; it is truncated")
    header = np.frombuffer(raw[:size], layout.header)
    if header.max() > 1 << 50:
        raise FormatError(f"{path}: {array.name} declares {header.max()} bytes; it is damaged")
    return header.astype(np.int64)


def _unpacked(path: str | Path, array: Array, header: np.ndarray, data: bytes, wanted: int) -> bytes:
    """Decompress blocks of `header[0]` bytes, the last of `header[1]` (0: full), from `header[2:]` bytes each."""
    block, last, packed = int(header[0]), int(header[1]), header[2:].tolist()
    lengths = [block] * len(packed)
    if last and packed:
        lengths[-1] = last
    if sum(lengths) != wanted:
        raise FormatError(
            f"{path}: {array.name} decompresses to {sum(lengths)} bytes, expected {wanted}; it is damaged"
        )
    parts, at = [], 0
    for length, size in zip(lengths, packed, strict=True):
        try:
            part = zlib.decompressobj().decompress(data[at : at + size], length) if length else b""
        except zlib.error as error:
            raise FormatError(
                f"{path}: {array.name} cannot be decompressed ({one_line(error)}); it is damaged"
            ) from error
        if len(part) != length:
            raise FormatError(f"{path}: {array.name} decompresses to less than declared; it is damaged")
        parts.append(part)
        at += size
    return b"".join(parts)
