"""A file's bytes without reading them all: mapped into memory while they are looked at; those of a .gz unpacked."""

import mmap
import zlib
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

from ...errors import FormatError, one_line
from .file import require_readable, require_room

GZIP = b"\x1f\x8b\x08"
AT_ONCE = 4_000_000  # bytes of a .gz that are unpacked at a time


@contextmanager
def mapped(path):
    """The bytes of the file at `path`: a read-only mmap, what is taken of which must be copied; of a .gz bytes.

    Raises
    ------
    FormatError
        Missing, empty, or not to be opened; a .gz that is damaged, or too large when unpacked.
    """
    require_readable(path)
    with open(path, "rb") as file:
        if file.read(len(GZIP)) == GZIP:
            about = Path(path).stat()
            yield _unpacked(str(path), about.st_size, about.st_mtime_ns)
            return
        try:
            content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except (OSError, ValueError) as error:
            raise FormatError(f"{path}: {one_line(error)}") from error
        with content:
            yield content


@lru_cache(maxsize=1)  # the frames of a file are read one after the other
def _unpacked(path, size, changed):
    """All bytes in a .gz; `size` and `changed` tell it from what was there before."""
    parts, total = [], 0
    for part in _parts(path):
        total += len(part)
        require_room(path, 2 * total, 1)
        parts.append(part)
    if total == 0:
        raise FormatError(f"{path} is empty when unpacked")
    return b"".join(parts)


def _parts(path):
    """The bytes in a .gz, in parts; it may be several in a row, as programs that append make it."""
    stream = zlib.decompressobj(wbits=31)
    with open(path, "rb") as file:
        packed = file.read(AT_ONCE)
        while packed:
            try:
                yield stream.decompress(packed, AT_ONCE)
            except zlib.error as error:
                raise FormatError(f"{path} cannot be unpacked ({one_line(error)[:60]}); it is damaged") from error
            packed = stream.unused_data if stream.eof else stream.unconsumed_tail
            packed = packed or file.read(AT_ONCE)
            if stream.eof and packed:
                stream = zlib.decompressobj(wbits=31)
    if not stream.eof:
        raise FormatError(f"{path} ends before all is unpacked; it is truncated")


def unpacked_head(head, size):
    """The first `size` bytes of a file that begins with `head`; of a .gz unpacked, as far as that goes."""
    if not head.startswith(GZIP):
        return head
    stream, found = zlib.decompressobj(wbits=31), b""
    for at in range(0, len(head), 16):
        try:
            found += stream.decompress(head[at : at + 16])
        except zlib.error:
            break
        if len(found) >= size:
            break
    return found[:size]
