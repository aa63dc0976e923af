"""Files of plain numbers that end early: some drivers of GDAL read 0 for what is missing, without a word."""

from pathlib import Path

import numpy as np
from rasterio.io import DatasetReader

from ..system.errors import FormatError

_TEXTS = ("AAIGrid", "GRASSASCIIGrid", "GSAG")  # drivers of grids whose numbers are text
_PLAIN = ("EHdr", "ENVI", "SAGA", "GSBG", "GS7BG")  # and of numbers without compression
_PACKED = (b"\x1f\x8b",)  # beginnings of compressed files
_CLASSIC = {b"CDF\x01": 4, b"CDF\x02": 8}  # NetCDF 3: bytes of a place in the file
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 8}  # [bytes] of NetCDF's types
_DIMENSIONS, _VARIABLES, _ATTRIBUTES = 10, 11, 12  # tags of the lists in a header
_LONGEST_HEADER = 10_000_000  # [bytes]
_STREAMED = 2**32 - 1  # number of records of a file that was not closed


def require_complete(source: DatasetReader, file: Path, path: str | Path) -> None:
    """Refuse a file that is shorter than its header says.

    Parameters
    ----------
    source : rasterio dataset
    file : Path
        With the numbers.
    path : str or Path
        For messages.

    Raises
    ------
    FormatError
    """
    if not file.is_file():
        return
    parts = [part for part in map(Path, source.files) if part.is_file()]  # header and numbers may be two files
    size = max(part.stat().st_size for part in (file, *parts))
    with open(file, "rb") as handle:
        head = handle.read(4)
        needed = _needed(source, head)
        if source.driver == "netCDF" and head in _CLASSIC:
            needed = _end_of_netcdf(head + handle.read(_LONGEST_HEADER))
    if size < needed:
        raise FormatError(
            f"{path} is truncated: it has {size} bytes, expected at least {needed} for its {source.height} x "
            f"{source.width} cells; copy or download it again"
        )


def _needed(source, head):
    """Return the least number of bytes of a file without compression; 0 where it is not known."""
    cells = source.width * source.height * source.count
    if source.driver in _TEXTS:
        return 2 * cells - 1  # a digit and a separator each
    if source.driver not in _PLAIN or head[:2] in _PACKED:
        return 0
    bits = source.tags(1, ns="IMAGE_STRUCTURE").get("NBITS")
    each = int(bits) if bits else 8 * np.dtype(source.dtypes[0]).itemsize
    return -(-cells * each // 8)


def _end_of_netcdf(head):
    """Return where the last variable of a NetCDF 3 file ends; 0 where its header is longer or damaged."""
    try:
        return _Header(head).end()
    except (KeyError, IndexError, ValueError):
        return 0


class _Header:
    """The header of a NetCDF 3 file, with places of 32 or 64 bits."""

    def __init__(self, head):
        self._head, self._at, self._place = head, 4, _CLASSIC[head[:4]]

    def end(self):
        """Return the end [bytes] of the last variable."""
        records = self._number()
        lengths = [self._dimension() for _ in self._list(_DIMENSIONS)]
        self._attributes()
        variables = [self._variable(lengths) for _ in self._list(_VARIABLES)]
        fixed = [begin + size for begin, size, each in variables if not each]
        recorded = [(begin, size) for begin, size, each in variables if each]
        step = recorded[0][1] if len(recorded) == 1 else sum(-(-size // 4) * 4 for _, size in recorded)
        if records and records != _STREAMED:
            fixed += [begin + (records - 1) * step + size for begin, size in recorded]
        return max(fixed, default=0)

    def _number(self, size=4):
        value = int.from_bytes(self._head[self._at : self._at + size], "big")
        self._at += size
        if self._at > len(self._head):
            raise ValueError
        return value

    def _list(self, tag):
        found, count = self._number(), self._number()
        if count and found != tag:
            raise ValueError
        return range(count)

    def _text(self):
        length = self._number()
        self._skip(length)

    def _skip(self, length):
        self._at += -(-length // 4) * 4
        if self._at > len(self._head):
            raise ValueError

    def _dimension(self):
        self._text()
        return self._number()

    def _attributes(self):
        for _ in self._list(_ATTRIBUTES):
            self._text()
            kind = self._number()
            self._skip(self._number() * _SIZES[kind])

    def _variable(self, lengths):
        """Return (begin, bytes of the variable or of one record of it, whether it has records)."""
        self._text()
        of = [lengths[self._number()] for _ in range(self._number())]
        self._attributes()
        size = _SIZES[self._number()]
        self._number()  # the size as the file says it: wrong above 4 GB
        begin = self._number(self._place)
        each = bool(of) and of[0] == 0
        for length in of[1:] if each else of:
            size *= length
        return begin, size, each
