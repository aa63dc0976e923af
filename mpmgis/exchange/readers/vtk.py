"""General VTK files of points: .vtp, .vtu, legacy .vtk; with the .pvd or .pvtu that lists them.

Columns are the arrays of points, those of three components with .x, .y, .z. The time is in a `.pvd` that lists the
file, or in the field TimeValue. Pieces, in one file or in several, form one frame.
"""

import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...system.errors import FormatError
from ..declarations import Declarations
from .array_columns import column_names, columns_of, picked, plainly_named
from .mapped_files import mapped
from .reader_interface import Reader, ThirdPartyFrame, joined, number_of
from .vtk_legacy import MAGIC, legacy_frame
from .vtk_legacy import read_layout as read_legacy_layout
from .vtk_xml import FILES, POINTS, Layout, parse_outline, read_array, read_layout

PLACES = dict(zip("xyz", column_names(POINTS, 3), strict=True))
LISTS = (".pvtu", ".pvtp")
MOST_LISTED = 1_000_000  # files in a list
_ROOT = re.compile(rb"<VTKFile\b[^>]{0,400}\btype\s*=\s*[\"'](\w{1,40})[\"']")


class Listed(NamedTuple):
    """A file listed in a .pvd or .pvtu, and its time [s] there (None: no time)."""

    path: Path
    time: float | None


def kind_of(head: bytes) -> str:
    """Return the type of a VTK XML file by its first bytes.

    Parameters
    ----------
    head : bytes

    Returns
    -------
    str
        PolyData, UnstructuredGrid, Collection, ..; '' for other files.
    """
    found = _ROOT.search(head)
    return found[1].decode() if found else ""


def read_list(path: str | Path, all_there: bool = False) -> list[Listed]:
    """Read the files that a .pvd, .pvtu or .pvtp lists, with names relative to its folder.

    Parameters
    ----------
    path : str or Path
    all_there : bool
        Refuse a list with missing files.

    Raises
    ------
    FormatError
        No VTK XML, no or missing files, an invalid time.
    """
    path, listing = Path(path), _List(path)
    with mapped(path) as content:
        parse_outline(path, content, len(content), listing)
    if not listing.found:
        raise FormatError(f"{path} lists no file")
    if all_there and listing.missing:
        missing = len(listing.missing)
        raise FormatError(
            f"{path} lists {missing} missing files, the first {listing.missing[0][:80]}; give the existing files"
        )
    return listing.found


class _List:
    """The files in the elements of a list."""

    def __init__(self, path):
        self.path, self.found, self.missing = path, [], []

    def start(self, tag: str, attributes: dict[str, str], at: int) -> None:
        """Receive the start of an element."""
        name = {"DataSet": attributes.get("file"), "Piece": attributes.get("Source")}.get(tag)
        if name is None:
            return
        time = attributes.get("timestep")
        try:
            time = None if time is None else float(time)
        except ValueError:
            time = np.nan
        if time is not None and not np.isfinite(time):
            raise FormatError(f"{self.path}: timestep {attributes['timestep'][:20]!r} is not a time")
        if len(self.found) >= MOST_LISTED or "\0" in name:
            raise FormatError(f"{self.path} lists more than {MOST_LISTED} files, or an invalid name; it is damaged")
        file = self.path.parent / name
        if not file.is_file():
            self.missing.append(name)
        self.found.append(Listed(file, time))

    def end(self, tag: str, at: int) -> None:
        """Receive the end of an element."""


def listed_times(paths: Iterable[str | Path]) -> dict[Path, float]:
    """Return the times of files in the .pvd lists in the folders of `paths` or their parents.

    Parameters
    ----------
    paths : iterable of str or Path

    Returns
    -------
    dict of Path to float [s]
        Resolved path -> time.

    Raises
    ------
    FormatError
    """
    folders = dict.fromkeys(
        place for path in paths for place in (Path(path).parent, Path(path).resolve().parent.parent)
    )
    times = {}
    for folder in folders:
        for pvd in sorted(folder.glob("*.pvd")):
            times |= {listed.path.resolve(): listed.time for listed in read_list(pvd) if listed.time is not None}
    return times


def frames(
    paths: Iterable[str | Path],
    terms: Declarations,
    convert: Callable[[ThirdPartyFrame], ThirdPartyFrame] | None = None,
) -> list[ThirdPartyFrame]:
    """Describe the frames in files and lists of files.

    A .pvd together with files only gives their times; alone it represents the files that it lists.

    Parameters
    ----------
    paths : iterable of str or Path
    terms : Declarations
    convert : callable, optional
        `convert(frame)` adapts a frame to a code.

    Raises
    ------
    FormatError
    """
    found = []
    for pieces, time in _groups([Path(path) for path in paths]):
        frame = joined([open_file(piece) for piece in pieces])
        frame = frame if time is None else replace(frame, time=time)
        found.append(frame if convert is None else convert(frame))
    return found


def _groups(paths: list[Path]) -> list[tuple[list[Path], float | None]]:
    """Return ([files of a frame], time [s] in a .pvd or None) of every frame."""
    files = [path for path in paths if path.suffix.lower() != ".pvd"]
    if not files:
        groups = {}
        for path in paths:
            for listed in read_list(path, all_there=True):
                groups.setdefault((path, listed.time), []).append(listed.path)
        return [(pieces, time) for (_, time), pieces in groups.items()]
    times = listed_times(files)
    lists = [path for path in files if path.suffix.lower() in LISTS]
    pieces = {listed.path.resolve() for path in lists for listed in read_list(path)}
    return [([path], times.get(path.resolve())) for path in files if path.resolve() not in pieces]


def open_file(path: str | Path) -> ThirdPartyFrame:
    """Describe the frame of one file, or of the pieces that a .pvtu lists.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
    """
    path = Path(path)
    with mapped(path) as content:
        head = content[:4096]
    if head.startswith(MAGIC):
        layout = read_legacy_layout(path)
        return legacy_frame(path, layout, column_map=_meant({name: b.components for name, b in layout.arrays.items()}))
    kind = kind_of(head)
    if kind in [f"P{name}" for name in FILES]:
        pieces = joined([_open_xml(listed.path) for listed in read_list(path, all_there=True)])
        return replace(pieces, path=path, number=number_of(path))
    return _open_xml(path)


def _open_xml(path):
    layout = read_layout(path)
    pieces = [piece for piece in layout.pieces if POINTS in piece]
    if not pieces:
        raise FormatError(f"{path} contains no points")
    names = [name for name in pieces[0] if all(name in piece for piece in pieces)]
    arrays = {name: pieces[0][name].components for name in names if pieces[0][name].components}
    for name in arrays:
        if any(piece[name].components != arrays[name] for piece in pieces):
            raise FormatError(f"{path}: {name} has other components in other pieces; it is damaged")
    if arrays.get(POINTS) != 3:
        raise FormatError(f"{path}: the points have {arrays.get(POINTS, 0)} coordinates, expected 3")
    return ThirdPartyFrame(
        path=path,
        count=sum(piece[POINTS].count for piece in pieces),
        columns=tuple(columns_of(arrays)),
        read=partial(_read, path, layout, arrays),
        column_map=_meant(arrays),
        number=number_of(path),
        time=_time(path, layout),
    )


def _meant(arrays):
    return plainly_named({name: components for name, components in arrays.items() if name != POINTS}) | PLACES


def _read(path: Path, layout: Layout, arrays: dict[str, int], names: tuple[str, ...]) -> dict[str, np.ndarray]:
    pieces = [piece for piece in layout.pieces if POINTS in piece and piece[POINTS].count]

    def read(name):
        return np.concatenate([read_array(path, layout, piece[name]) for piece in pieces])

    return picked(read, arrays, names)


def _time(path, layout):
    array = next((layout.fields[name] for name in ("TimeValue", "TIME", "time") if name in layout.fields), None)
    if array is None or array.count * array.components != 1:
        return None
    time = float(read_array(path, layout, array)[0, 0])
    return time if np.isfinite(time) else None


def fits(path: Path, head: bytes) -> bool:
    """Return whether a file is VTK of points, or a list of such files.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    kinds = (*FILES, *(f"P{name}" for name in FILES), "Collection")
    return not _is_own(head) and (head.startswith(MAGIC) or kind_of(head) in kinds)


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file is VTK of points with a velocity, or a list of files.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    if not fits(path, head):
        return False
    if kind_of(head) == "Collection":
        return True
    try:
        if head.startswith(MAGIC):
            return any(name.lower() in ("velocity", "v", "vel") for name in read_legacy_layout(path).arrays)
        return "vx" in open_file(path).column_map
    except FormatError:
        return False


def _is_own(head: bytes) -> bool:
    """Return whether a file is a seed of columns (not points) that mpmgis wrote as .vtp."""
    return b'<!-- {"format": "mpmgis-columns"' in head


READER = Reader("vtk", recognises, frames, fits)
