"""The frames of one run, listed by time without their particles, and read one at a time.

A reader is two functions, `read_header(path)` and `read(path, density, memory)`, that answer `Frame`; other codes'
files come in by a row in `READERS`.
"""

import re
import threading
from collections.abc import Callable
from dataclasses import dataclass
from glob import glob
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from ..errors import FormatError, GeoreferenceError, InputError
from ..geo.georeference import name_of, same_place
from ..particles import Frame
from .frames import read_frame, read_maxima

_memory = threading.local()
_NUMBERED = re.compile(r"(.*?)(\d+)(\.\w+)")


class Reader(NamedTuple):
    """How one code's frames are read: `suffix`, `read_header(path)`, `read(path, density [kg m-3], memory)`, and
    `read_maxima(path)`, the running peaks of the solver.

    `memory` is a dict that a reader may keep arrays in, to fill them anew; see `FrameEntry.read`.
    """

    suffix: str
    read_header: Callable
    read: Callable
    read_maxima: Callable = lambda path: {}


READERS = {
    "mpmgis": Reader(
        ".h5",
        lambda path: read_frame(path, with_state=False, with_particles=False),
        lambda path, density, memory: read_frame(path, with_state=False, density=density, memory=memory),
        read_maxima,
    )
}


@dataclass(frozen=True)
class FrameEntry:
    """One frame on disk: its `path`, its `header` (a Frame without particles), and the name of its `reader`."""

    path: Path
    header: Frame
    reader: str = "mpmgis"

    @property
    def time(self):
        """Time [s]."""
        return self.header.time

    @property
    def count(self):
        """Number of particles."""
        return self.header.header["count"]

    def read(self, density=1000.0):
        """The whole frame; `density` [kg m-3] makes mass of volume, or the reverse, where only one is stored.

        Its arrays are good until the same thread reads the next frame.
        """
        return READERS[self.reader].read(self.path, density, vars(_memory))

    def read_maxima(self):
        """Running peaks of the solver by name (`mpmgis.io.frames.MAXIMA`); empty where it kept none."""
        return READERS[self.reader].read_maxima(self.path)


def list_frames(paths, reader="mpmgis"):
    """List the frames in `paths` (files, patterns, folders) by time.

    Returns
    -------
    tuple of FrameEntry

    Raises
    ------
    FormatError, InputError
        A file that is no frame, none at all, two frames of the same time, several folders, CRSs or runs.
    """
    entries = [FrameEntry(path, READERS[reader].read_header(path), reader) for path in _files(paths, reader)]
    entries.sort(key=lambda entry: (entry.time, entry.path.name))
    _require_one_run(entries)
    return tuple(entries)


def missing_frames(entries, most=5):
    """Names that a series of numbered files leaves out between its first and its last; at most `most` of them."""
    numbered = {int(match[2]): match for entry in entries if (match := _NUMBERED.fullmatch(entry.path.name))}
    if len(numbered) < len(entries):
        return []
    gaps = [n for n in range(min(numbered), max(numbered)) if n not in numbered]
    start, width, end = (lambda m: (m[1], len(m[2]), m[3]))(numbered[min(numbered)])
    return [f"{start}{n:0{width}d}{end}" for n in gaps[:most]] + (["..."] if len(gaps) > most else [])


def _files(paths, reader):
    suffix, files = READERS[reader].suffix, {}
    for given in paths:
        path = Path(given)
        if path.is_dir():
            found = sorted(path.glob(f"*{suffix}"))
            if not found:
                raise FormatError(f"{path}: no frame (*{suffix}) in this folder")
        elif not path.exists() and any(sign in str(given) for sign in "*?["):
            found = sorted(Path(name) for name in glob(str(given)))
            if not found:
                raise FormatError(f"{given}: no file matches this pattern")
        else:
            found = [path]
        for file in found:
            if file == path or not file.name.startswith("."):  # hidden ones are in the making
                files.setdefault(file.resolve(), file)
    if not files:
        raise InputError(f"no frame is named; give files, for example results/*{suffix}")
    return list(files.values())


def _require_one_run(entries):
    first = entries[0]
    for before, entry in pairwise(entries):
        if entry.path.resolve().parent != first.path.resolve().parent:
            raise InputError(f"{first.path} and {entry.path} lie in different folders; export one run at a time")
        if entry.time == before.time:
            raise InputError(
                f"{before.path} and {entry.path} have the same time, {entry.time:g} s; name the frames of one run only"
            )
        if entry.header.digest and first.header.digest and entry.header.digest != first.header.digest:
            raise InputError(
                f"{first.path} and {entry.path} come from different scenes (digests {first.header.digest[:8]} and "
                f"{entry.header.digest[:8]}); export one run at a time"
            )
        if not same_place(entry.header.crs, first.header.crs):
            raise GeoreferenceError(
                f"{entry.path} is in {name_of(entry.header.crs)}, {first.path} in {name_of(first.header.crs)}; "
                "export one run at a time"
            )
