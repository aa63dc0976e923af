"""The frames of one run, listed by time without their particles, and read one at a time.

mpmgis' own frames and those of other codes (`mpmgis.io.foreign`) come as the same `Frame`.
"""

import re
import threading
from dataclasses import dataclass, replace
from glob import glob
from itertools import islice, pairwise
from pathlib import Path

from ..errors import FormatError, GeoreferenceError, InputError
from ..io.frames import PLACES, read_frame, read_maxima
from ..particles import Frame
from ..terrain.georeference import name_of, same_place
from .declarations import ForeignTerms, merged, with_sidecar
from .georeferencing import foreign_header, foreign_particles, require_told, series_place, times_of
from .readers.base import ForeignFrame
from .readers.registry import FOREIGN, OWN, head_of, reader_of

PATTERN = "*.h5"
HDF5_MAGIC = b"\x89HDF"
_memory = threading.local()
_NUMBERED = re.compile(r"(.*?)(\d{1,15})(\.\w+)")


@dataclass(frozen=True)
class FrameEntry:
    """One frame on disk: its `path`, its `header` (a Frame without particles), and the name of its `reader`.

    Of another code's frame `source` knows where its numbers lie, and `terms` is what the user said about it.
    """

    path: Path
    header: Frame
    reader: str = OWN
    source: ForeignFrame | None = None
    terms: ForeignTerms | None = None

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
        if self.reader == OWN:
            return read_frame(self.path, with_state=False, density=density, memory=vars(_memory))
        return replace(self.header, particles=foreign_particles(self.source, self.terms))

    def read_places(self):
        """The frame with the places of its particles alone, of columns their areas too, where that is less to read."""
        if self.reader == OWN:
            return read_frame(self.path, with_state=False, memory=vars(_memory), names=PLACES)
        return self.read()

    def read_maxima(self):
        """Running peaks of the solver by name (`mpmgis.peaks.PEAK_NAMES`); empty where it kept none."""
        return read_maxima(self.path) if self.reader == OWN else {}


def list_frames(paths, terms=None):
    """List the frames in `paths` (files, patterns, folders) by time.

    `terms` (ForeignTerms) is what the user says about another code's files.

    Returns
    -------
    tuple of FrameEntry

    Raises
    ------
    FormatError, InputError
        A file that is no frame, none at all, two frames of the same time, several folders, CRSs, codes or runs; what
        another code's files do not say.
    """
    terms = terms or ForeignTerms()
    files = _files(paths, terms.reader)
    reader = _one_reader(files, terms.reader)
    if reader == OWN:
        _refuse_unknown(files)
        entries = [FrameEntry(path, read_frame(path, with_state=False, with_particles=False)) for path in files]
        _refuse_terms(files[0], terms)  # now it is known that they are frames of mpmgis
    else:
        entries = _foreign_entries(files, reader, terms)
    entries.sort(key=lambda entry: (entry.time, entry.path.name))
    _require_one_run(entries)
    return tuple(entries)


def _foreign_entries(paths, reader, terms):
    frames, terms = foreign_frames(paths, reader, terms)
    for frame in frames:
        require_told(reader, frame, terms)
    return [
        FrameEntry(frame.path, foreign_header(reader, frame, terms, float(time)), reader, frame, terms)
        for frame, time in zip(frames, times_of(frames, terms), strict=True)
    ]


def foreign_frames(paths, reader, terms):
    """(The ForeignFrames in another code's files, `terms` with what a sidecar says besides).

    Raises
    ------
    FormatError, InputError
        Damaged files, or such without any particle; a damaged sidecar, or several.
    """
    terms = with_sidecar(paths, terms)
    frames = _begun(FOREIGN[reader].frames(paths, terms))
    return frames, _with_own_words(frames, terms)


def _with_own_words(frames, terms):
    """`terms`, and where these leave a thing open what the files themselves say in a sidecar's words."""
    for frame in frames:
        if frame.said != frames[0].said:
            raise InputError(
                f"{frames[0].path} and {frame.path} say different things of the map (crs, origin, axes); export those "
                "of one place at a time"
            )
    return terms if frames[0].said is None else merged(terms, frames[0].said)


def _begun(frames):
    """`frames` from the first that holds particles on: codes that pour grains write empty ones before."""
    filled = [series_place(frame) for frame in frames if frame.count]
    if not filled:
        raise FormatError(f"{frames[0].path}: no particle in it")
    kept = [frame for frame in frames if frame.count or series_place(frame) >= min(filled)]
    empty = next((frame for frame in kept if frame.count == 0), None)
    if empty is not None:
        step = "" if empty.number is None else f" at {empty.number}"
        raise FormatError(f"{empty.path}: no particle in it{step}, and there were some before; leave it out")
    return kept


def _one_reader(files, asked):
    """Name of the reader of all `files`."""
    found = [reader_of(path, asked, lenient=True) for path in files]
    for path, reader in zip(files, found, strict=True):
        if reader != found[0]:
            raise InputError(f"{files[0]} is of {found[0]}, {path} of {reader}; export one code's frames at a time")
    return found[0]


def _refuse_unknown(files):
    for path in files:
        head = head_of(path)
        if head and not head.startswith(HDF5_MAGIC):
            raise FormatError(
                f"{path} is neither a frame of mpmgis (HDF5) nor known as particles of another code; name the folder "
                f"of a run, its frame_*.h5, or with --reader one of {', '.join(FOREIGN)}"
            )


def _refuse_terms(path, terms):
    idle = terms.only_for_foreign()
    if idle:
        raise InputError(
            f"{path} is a frame of mpmgis, which says all that itself; {', '.join(idle)} is for other codes' files"
        )


def missing_frames(entries, most=5):
    """Names that a series of numbered files leaves out between its first and its last; at most `most` of them.

    Another code's numbers may be steps: where all lie a multiple of the least distance apart that is one of the series.
    """
    numbered = {int(match[2]): match for entry in entries if (match := _NUMBERED.fullmatch(entry.path.name))}
    numbers = sorted(numbered)
    if len(numbered) < len(entries) or len(numbers) < 2:
        return []
    stride = 1
    if entries[0].reader != OWN:
        if numbers != sorted(entry.source.number for entry in entries if entry.source.number is not None):
            return []
        distances = {after - before for before, after in pairwise(numbers)}
        stride = min(distances)
        if any(distance % stride for distance in distances):
            return []
    gaps = (n for before, after in pairwise(numbers) for n in range(before + stride, after, stride))
    some = list(islice(gaps, most + 1))
    start, width, end = (lambda m: (m[1], len(m[2]), m[3]))(numbered[numbers[0]])
    return [f"{start}{n:0{width}d}{end}" for n in some[:most]] + (["..."] if len(some) > most else [])


def _files(paths, reader):
    files = {}
    for given in paths:
        path = Path(given)
        if path.is_dir():
            found = _in_folder(path, reader)
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
        raise InputError(f"no frame is named; give files, for example results/{PATTERN}")
    return list(files.values())


def _in_folder(folder, reader):
    """The frames in a folder: of `reader`, else mpmgis' own, else those of the first other code that knows any."""
    own = sorted(folder.glob(PATTERN))
    if reader == OWN:
        found = own
    elif reader is not None:
        reader_of(folder, reader)
        found = [path for path in _visible(folder) if _is_of(path, reader)]
    else:
        found = own if any(reader_of(path) == OWN for path in own) else foreign_files(folder)[1]
    if not found:
        wanted = PATTERN if reader == OWN else "*.h5, or another code's" if reader is None else f"of {reader}"
        raise FormatError(f"{folder}: no frame ({wanted}) in this folder")
    return found


def foreign_files(folder, reader=None):
    """(Name of the first other code that knows any of the files in a folder, these files); (our own, []) without."""
    found = {}
    for path in _visible(folder):
        name = reader_of(path)
        if name != OWN and reader in (None, name):
            found.setdefault(name, []).append(path)
    return next(((name, found[name]) for name in FOREIGN if name in found), (OWN, []))


def _visible(folder):
    return sorted(path for path in folder.iterdir() if path.is_file() and path.name[0] != ".")


def _is_of(path, name):
    """Whether a file is of a code, for a format that anybody uses: of the format."""
    head = head_of(path)
    return FOREIGN[name].recognises(path, head) or bool(FOREIGN[name].fits and FOREIGN[name].fits(path, head))


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
