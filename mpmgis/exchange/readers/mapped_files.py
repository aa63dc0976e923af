"""Bytes of a file: memory-mapped, decompressed from a .gz, or of a text in UTF-16 as UTF-8."""

import mmap
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

from ...system.errors import FormatError, one_line
from ...system.text_tables import UTF16, decoded, decoded_start
from .reader_interface import require_memory, require_readable

GZIP = b"\x1f\x8b\x08"
AT_ONCE = 4_000_000  # [bytes] of a .gz decompressed at a time


@contextmanager
def mapped(path: str | Path) -> Iterator[mmap.mmap | bytes]:
    """Open the bytes of a file: a read-only mmap, from which data must be copied; bytes of a .gz or of UTF-16.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        Missing, empty or not readable; a .gz that is damaged, or too large when decompressed; UTF-16 that is no text.
    """
    require_readable(path)
    with open(path, "rb") as file:
        first, about = file.read(len(GZIP)), Path(path).stat()
        if first.startswith(UTF16):
            yield _as_utf8(str(path), about.st_size, about.st_mtime_ns)
            return
        if first == GZIP:
            yield _unpacked(str(path), about.st_size, about.st_mtime_ns)
            return
        try:
            content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except (OSError, ValueError) as error:
            raise FormatError(f"{path}: {one_line(error)}") from error
        with content:
            yield content


@lru_cache(maxsize=1)  # as below
def _as_utf8(path: str, size: int, changed: int) -> bytes:
    """Return the text of a file in UTF-16 as UTF-8; `size` and `changed` identify the version of the file."""
    require_memory(path, 4 * size, 1)
    try:
        return decoded(Path(path).read_bytes()).encode("utf-8")
    except (OSError, UnicodeError) as error:
        raise FormatError(f"{path} is no readable text in UTF-16 ({one_line(error)[:60]}); save it as UTF-8") from error


@lru_cache(maxsize=1)  # the frames of a file are read one after the other
def _unpacked(path: str, size: int, changed: int) -> bytes:
    """Return all bytes in a .gz; `size` and `changed` identify the version of the file."""
    parts, total = [], 0
    for part in _parts(path):
        total += len(part)
        require_memory(path, 2 * total, 1)
        parts.append(part)
    if total == 0:
        raise FormatError(f"{path} is empty when decompressed")
    return b"".join(parts)


def _parts(path: str) -> Iterator[bytes]:
    """Yield the bytes in a .gz, in parts; it may contain several streams, as by programs that append."""
    stream = zlib.decompressobj(wbits=31)
    with open(path, "rb") as file:
        packed = file.read(AT_ONCE)
        while packed:
            try:
                yield stream.decompress(packed, AT_ONCE)
            except zlib.error as error:
                raise FormatError(f"{path} cannot be decompressed ({one_line(error)[:60]}); it is damaged") from error
            packed = stream.unused_data if stream.eof else stream.unconsumed_tail
            packed = packed or file.read(AT_ONCE)
            if stream.eof and packed:
                stream = zlib.decompressobj(wbits=31)
    if not stream.eof:
        raise FormatError(f"{path} ends within its compressed data; it is truncated")


def unpacked_head(head: bytes, size: int) -> bytes:
    """Return the first bytes of a file; a .gz is decompressed as far as possible, UTF-16 becomes UTF-8.

    Parameters
    ----------
    head : bytes
        First bytes as stored.
    size : int [bytes]
    """
    if head.startswith(UTF16):
        return decoded_start(head)
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
