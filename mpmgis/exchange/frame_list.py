"""The frames of one run, listed by time without their particles, and read one at a time.

Frames of mpmgis and of other codes (`exchange.readers`) become the same `Frame`.
"""

import re
import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from glob import glob
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

from ..frames.frame_files import PLACES, read_bed_change, read_frame, read_maxima
from ..frames.particles import Frame
from ..frames.run_folder import read_record
from ..frames.run_maps import MAPS, has_rasters
from ..system.errors import FormatError, GeoreferenceError, InputError
from ..system.messages import log
from ..terrain.georeference import name_of, same_place
from .declarations import Declarations, merged, with_sidecar
from .frame_georeferencing import require_complete, series_position, third_party_header, third_party_particles, times_of
from .map_coordinates import Ground, with_map_coordinates
from .readers.reader_interface import ThirdPartyFrame
from .readers.reader_list import FOREIGN, OWN, head_of, reader_of

PATTERN = "*.h5"
HDF5_MAGIC = b"\x89HDF"
_memory = threading.local()
_NUMBERED = re.compile(r"(.*?)(\d{1,15})(\.\w+)")


@dataclass(frozen=True)
class FrameEntry:
    """One frame on disk.

    Parameters
    ----------
    path : Path
    header : Frame
        Without particles.
    reader : str
        Name of the reader.
    source : ThirdPartyFrame or None
        Description of the file, for frames of other codes.
    terms : Declarations or None
        User declarations, for frames of other codes.
    """

    path: Path
    header: Frame
    reader: str = OWN
    source: ThirdPartyFrame | None = None
    terms: Declarations | None = None

    @property
    def time(self) -> float:
        """Time [s]."""
        return self.header.time

    @property
    def count(self) -> int:
        """Number of particles."""
        return self.header.header["count"]

    def read(self, density: float = 1000.0) -> Frame:
        """Read the whole frame; its arrays are valid until the same thread reads the next frame.

        Parameters
        ----------
        density : float [kg m-3]
            Converts volume to mass, or the reverse, where only one is stored.

        Raises
        ------
        FormatError
        """
        if self.reader == OWN:
            return read_frame(self.path, with_state=False, density=density, memory=vars(_memory))
        return replace(self.header, particles=third_party_particles(self.source, self.terms))

    def read_positions(self) -> Frame:
        """Read the frame with only the positions of its particles (and areas of columns), where this reads less."""
        if self.reader == OWN:
            return read_frame(self.path, with_state=False, memory=vars(_memory), names=PLACES)
        return self.read()

    def read_maxima(self) -> dict[str, Any]:
        """Read the running peaks of the solver by name (`peaks.PEAK_NAMES`); empty where there are none."""
        return read_maxima(self.path) if self.reader == OWN else {}

    def read_bed_change(self) -> dict[str, Any]:
        """Read what the flow took from its bed (`frame_files.read_bed_change`); empty where there is no erosion."""
        return read_bed_change(self.path) if self.reader == OWN else {}


def list_frames(
    paths: Iterable[str | Path], terms: Declarations | None = None, ground: Ground | None = None
) -> tuple[FrameEntry, ...]:
    """List the frames in files and folders by time.

    Parameters
    ----------
    paths : iterable of str or Path
        Files, patterns, folders.
    terms : Declarations, optional
        User declarations about files of other codes.
    ground : Ground, optional
        DTM of the frames: coordinates on it need no axes and origin.

    Raises
    ------
    FormatError, GeoreferenceError, InputError
        A file that is not a frame, no file, two frames of the same time, several folders, CRSs, codes or runs;
        missing declarations.
    """
    terms = terms or Declarations()
    files, reader = files_and_reader(paths, terms.reader)
    if reader == OWN:
        _refuse_unknown(files)
        entries = [FrameEntry(path, read_frame(path, with_state=False, with_particles=False)) for path in files]
        _refuse_terms(files[0], terms)
    else:
        entries = _third_party_entries(files, reader, terms, ground)
    entries.sort(key=lambda entry: (entry.time, entry.path.name))
    _require_one_run(entries)
    if reader == OWN and missing_frames(entries):
        _log_kept(entries)
    return tuple(entries)


def files_and_reader(paths: Iterable[str | Path], asked: str | None = None) -> tuple[list[Path], str]:
    """Return the files of particles in files and folders, and the name of the reader of all of them.

    Parameters
    ----------
    paths : iterable of str or Path
        Files, patterns, folders.
    asked : str, optional
        Name of the reader; detected without it.

    Raises
    ------
    FormatError, InputError
        No file, files of several codes, an unknown reader.
    """
    files = _files(paths, asked)
    return files, _one_reader(files, asked)


def _log_kept(entries):
    """Log that a run with rasters keeps the particles of a few frames only."""
    folder = entries[0].path.parent
    if has_rasters(read_record(folder)):
        log.info(
            f"{folder} keeps the particles of {len(entries)} frames only ([output] rasters = true); results between "
            f"these are in {folder / MAPS}"
        )


def _third_party_entries(
    paths: list[Path], reader: str, terms: Declarations, ground: Ground | None
) -> list[FrameEntry]:
    frames, terms = third_party_frames(paths, reader, terms, ground)
    for frame in frames:
        require_complete(reader, frame, terms)
    return [
        FrameEntry(frame.path, third_party_header(reader, frame, terms, float(time)), reader, frame, terms)
        for frame, time in zip(frames, times_of(frames, terms), strict=True)
    ]


def third_party_frames(
    paths: Sequence[Path], reader: str, terms: Declarations, ground: Ground | None = None
) -> tuple[list[ThirdPartyFrame], Declarations]:
    """Describe the frames in files of another code.

    Parameters
    ----------
    paths : sequence of Path
    reader : str
        Name of the code.
    terms : Declarations
    ground : Ground, optional
        As for `list_frames`.

    Returns
    -------
    frames : list of ThirdPartyFrame
    terms : Declarations
        Completed by sidecar, files and DTM.

    Raises
    ------
    FormatError, InputError
        Damaged files, no particles; a damaged sidecar, or several.
    """
    terms = with_sidecar(paths, terms)
    frames = _from_first_particles(FOREIGN[reader].frames(paths, terms))
    terms = _with_file_declarations(frames, terms)
    return frames, with_map_coordinates(min(frames, key=series_position), terms, ground)


def _with_file_declarations(frames: list[ThirdPartyFrame], terms: Declarations) -> Declarations:
    """Complete `terms` by the declarations in the files themselves."""
    for frame in frames:
        if frame.declared != frames[0].declared:
            raise InputError(
                f"{frames[0].path} and {frame.path} have different georeferences (crs, origin, axes); export files "
                "with the same georeference"
            )
    return terms if frames[0].declared is None else merged(terms, frames[0].declared)


def _from_first_particles(frames: list[ThirdPartyFrame]) -> list[ThirdPartyFrame]:
    """Return `frames` from the first one with particles: some codes write empty frames before grains are inserted."""
    filled = [series_position(frame) for frame in frames if frame.count]
    if not filled:
        raise FormatError(f"{frames[0].path}: contains no particle")
    kept = [frame for frame in frames if frame.count or series_position(frame) >= min(filled)]
    empty = next((frame for frame in kept if frame.count == 0), None)
    if empty is not None:
        step = "" if empty.number is None else f" at {empty.number}"
        raise FormatError(f"{empty.path}: contains no particle{step}, but earlier frames do; omit it")
    return kept


def _one_reader(files: list[Path], asked: str | None) -> str:
    """Return the name of the reader of all `files`."""
    found = [reader_of(path, asked, lenient=True) for path in files]
    for path, reader in zip(files, found, strict=True):
        if reader != found[0]:
            raise InputError(
                f"{files[0]} is of {found[0]}, {path} of {reader}; export the frames of one code at a time"
            )
    return found[0]


def _refuse_unknown(files):
    for path in files:
        head = head_of(path)
        if head and not head.startswith(HDF5_MAGIC):
            raise FormatError(
                f"{path} is neither a frame of mpmgis (HDF5) nor recognised as particles of another code; give the "
                f"folder of a run, its frame_*.h5, or --reader with one of {', '.join(FOREIGN)}"
            )


def _refuse_terms(path, terms):
    idle = terms.only_for_third_party()
    if idle:
        raise InputError(
            f"{path} is a frame of mpmgis, which contains these values; {', '.join(idle)} is only for files of "
            "other codes"
        )


def missing_frames(entries: Sequence[FrameEntry], most: int = 5) -> list[str]:
    """List the names that are missing between the first and the last of a series of numbered files.

    The numbers of another code may be time steps: the smallest difference is the stride, if all others are multiples.

    Parameters
    ----------
    entries : sequence of FrameEntry
    most : int
        More names become "...".
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
            if file == path or not file.name.startswith("."):  # hidden files are temporary
                files.setdefault(file.resolve(), file)
    if not files:
        raise InputError(f"no frame given; give files, for example results/{PATTERN}")
    return list(files.values())


def _in_folder(folder: Path, reader: str | None) -> list[Path]:
    """Return the frames in a folder: of `reader`, else of mpmgis, else of the first other code with matching files."""
    own = sorted(folder.glob(PATTERN))
    if reader == OWN:
        found = own
    elif reader is not None:
        reader_of(folder, reader)
        found = [path for path in _visible(folder) if _is_of(path, reader)]
    else:
        found = own if any(reader_of(path) == OWN for path in own) else third_party_files(folder)[1]
    if not found:
        expected = PATTERN if reader == OWN else "*.h5, or of another code" if reader is None else f"of {reader}"
        raise FormatError(f"{folder}: no frame ({expected}) in this folder")
    return found


def third_party_files(folder: Path, reader: str | None = None) -> tuple[str, list[Path]]:
    """Find the files of another code in a folder.

    Parameters
    ----------
    folder : Path
    reader : str, optional
        Name of the code; without it the first code that recognises files.

    Returns
    -------
    name : str
        Of the code; OWN where no code recognises files.
    files : list of Path
    """
    found = {}
    for path in _visible(folder):
        name = reader_of(path)
        if name != OWN and reader in (None, name):
            found.setdefault(name, []).append(path)
    return next(((name, found[name]) for name in FOREIGN if name in found), (OWN, []))


def _visible(folder):
    return sorted(path for path in folder.iterdir() if path.is_file() and path.name[0] != ".")


def _is_of(path: Path, name: str) -> bool:
    """Return whether a file is of a code, or, for common formats, of the format."""
    head = head_of(path)
    return FOREIGN[name].recognises(path, head) or bool(FOREIGN[name].fits and FOREIGN[name].fits(path, head))


def _require_one_run(entries):
    first = entries[0]
    for before, entry in pairwise(entries):
        if entry.path.resolve().parent != first.path.resolve().parent:
            raise InputError(f"{first.path} and {entry.path} are in different folders; export one run at a time")
        if entry.time == before.time:
            raise InputError(
                f"{before.path} and {entry.path} have the same time, {entry.time:g} s; give the frames of one run only"
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
