"""Series of LAMMPS dumps: pieces of a parallel run and steps that are written twice.

A `%` in the name of a dump becomes the rank, which is not stored in the file: files of the same step are pieces if no
grain occurs in two of them. A restarted run repeats its first step, at the end of the same file (`append yes`) or in
another file. Karamelo names its pieces `proc-<rank>.` and always writes step 0.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...system.errors import FormatError
from .reader_interface import ThirdPartyFrame, joined

_PIECE = re.compile(r"(.*)proc-(\d{1,9})\.(\d{1,15})(.*)")
_LAST_NUMBER = re.compile(r".*?(\d{1,15})\D*")
_NUMBER = re.compile(r"\d{1,15}")


def pieces_by_name(path: Path) -> list[Path]:
    """Return the files of all ranks with the step of a file, named `proc-<rank>.` as by Karamelo.

    Parameters
    ----------
    path : Path

    Returns
    -------
    list of Path
        In the order of the ranks; `path` only where it has another name.

    Raises
    ------
    FormatError
        The piece of a rank is missing.
    """
    match = _PIECE.fullmatch(path.name)
    if match is None:
        return [path]
    found = {
        int(piece[2]): other
        for other in path.parent.iterdir()
        if (piece := _PIECE.fullmatch(other.name)) and (piece[1], piece[3], piece[4]) == (match[1], match[3], match[4])
    }
    lacking = [rank for rank in range(len(found)) if rank not in found]
    if lacking:
        raise FormatError(f"{path}: the piece of rank {lacking[0]} is missing; put them into one folder")
    return [found[rank] for rank in sorted(found)]


def numbered_by_name(frames: list[ThirdPartyFrame]) -> list[ThirdPartyFrame]:
    """Return frames that all have step 0, as Karamelo writes them, with the steps of their file names.

    Parameters
    ----------
    frames : list of ThirdPartyFrame
    """
    names = [_PIECE.fullmatch(frame.path.name) or _LAST_NUMBER.fullmatch(frame.path.name) for frame in frames]
    numbers = [None if match is None else int(match[3] if match.re is _PIECE else match[1]) for match in names]
    if len(frames) == 1 and numbers[0] is not None and numbers[0] != 0:
        numbers = [None]  # for a single file it is unknown whether the number is a step
    elif None in numbers or len(set(numbers)) < len(numbers):
        return frames
    return [
        replace(frame, number=number, time=None if number else frame.time)
        for frame, number in zip(frames, numbers, strict=True)
    ]


def with_all_pieces(paths: list[Path], first_step: Callable, open_file: Callable) -> list[Path]:
    """Return the files, and further pieces of the same parallel run in their folders.

    Names of pieces differ in one number; the first step is the same and the grains are different.

    Parameters
    ----------
    paths : list of Path
    first_step : callable
        `first_step(path)` returns the number of the first step; None for other files.
    open_file : callable
        `open_file(path)` returns the ThirdPartyFrames.
    """
    named = {path.resolve() for path in paths}
    likes = {(path.parent, _likeness(path)) for path in paths}
    beside = [
        other
        for folder in dict.fromkeys(path.parent for path in paths)
        for other in sorted(folder.iterdir() if folder.is_dir() else ())
        if (folder, _likeness(other)) in likes and other.resolve() not in named and other.is_file()
    ]
    if not beside:
        return paths
    begun = {}
    for path in paths:
        begun.setdefault((path.parent, _likeness(path), first_step(path)), path)
    found = list(paths)
    for other in beside:
        like = begun.get((other.parent, _likeness(other), first_step(other)))
        if like is not None and len(_varying([like, other])) == 1 and _are_pieces(open_file(like), other, open_file):
            found.append(other)
    return found


def _likeness(path):
    return _NUMBER.sub("#", Path(path).name)


def _are_pieces(series: list[ThirdPartyFrame], path: Path, open_file: Callable) -> bool:
    """Return whether the dump at `path` has other grains than a series, in the first step where both have grains."""
    try:
        other = open_file(path)
    except FormatError:  # of another run, incomplete
        return False
    if [frame.number for frame in series] != [frame.number for frame in other]:
        return False
    both = next((pair for pair in zip(series, other, strict=True) if pair[0].count and pair[1].count), None)
    return both is None or _disjoint(both)


def _disjoint(frames: Sequence[ThirdPartyFrame]) -> bool:
    """Return whether no grain (id) is in two of the frames; False without ids."""
    if not all("id" in frame.columns for frame in frames):
        return False
    ids = np.concatenate([frame.read(("id",))["id"] for frame in frames])
    return len(np.unique(ids)) == len(ids)


def one_per_step(frames: list[ThirdPartyFrame]) -> list[ThirdPartyFrame]:
    """Return one frame per step: pieces are joined, steps repeated by a restart are omitted; others are unchanged.

    Parameters
    ----------
    frames : list of ThirdPartyFrame

    Raises
    ------
    FormatError
        The piece of a rank is missing.
    """
    steps = {}
    for frame in frames:
        steps.setdefault(frame.number, []).append(frame)
    return [one for same in steps.values() for one in _of_one_step(same)]


def _of_one_step(frames):
    if len(frames) == 1:
        return frames
    filled = [frame for frame in frames if frame.count]
    in_own_files = len({frame.path for frame in frames}) == len(frames)
    if in_own_files and (not filled or _disjoint(filled)):
        _require_all_ranks([frame.path for frame in frames])
        return [joined([*filled, *(frame for frame in frames if not frame.count)])]
    if len(filled) in (0, len(frames)) and all(_are_same(frames[0], frame) for frame in frames[1:]):
        return frames[:1]
    return frames


def _are_same(frame: ThirdPartyFrame, other: ThirdPartyFrame) -> bool:
    """Return whether two frames have the same grains with the same values, in any order."""
    names = tuple(dict.fromkeys(frame.column_map.values()))
    if frame.column_map != other.column_map or frame.count != other.count or "id" not in frame.column_map:
        return False
    tables = []
    for values in (frame.read(names), other.read(names)):
        order = np.argsort(values[frame.column_map["id"]], kind="stable")
        tables.append(np.stack([values[name][order] for name in names]))
    return np.array_equal(*tables)


def _varying(paths: list[Path]) -> list[set[int]]:
    """Return sets of the numbers that differ between the names; [] for names that differ in other parts."""
    if len({_likeness(path) for path in paths}) > 1:
        return []
    columns = zip(*(_NUMBER.findall(path.name) for path in paths), strict=True)
    return [{int(word) for word in words} for words in columns if len(set(words)) > 1]


def _require_all_ranks(paths: list[Path]) -> None:
    """Refuse pieces with a missing rank between 0 and the last."""
    varying = _varying(paths)
    if len(varying) == 1:
        lacking = sorted(set(range(max(varying[0]))) - varying[0])
        if lacking:
            raise FormatError(
                f"{paths[0]} is one of {len(paths)} pieces of a step, the piece of rank {lacking[0]} is missing; put "
                "them into one folder"
            )
