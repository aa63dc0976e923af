"""GiD files of Kratos' MPMApplication: `<name>.post.msh` and `<name>.post.res` with all times.

Text. The mesh contains the initial positions of material points, lines of `id x y z`; the results contain blocks
`Result "MP_DISPLACEMENT" "Kratos" <time> Vector OnNodes` of lines `id values`. A position is the initial position plus
the displacement. Points that are missing in later blocks were lost by the code.
"""

import re
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...system.errors import FormatError
from ..declarations import Declarations
from .array_columns import column_names, columns_of
from .kratos import DENSITY_HINT, materials_density, project_settings
from .mapped_files import mapped
from .reader_interface import Reader, ThirdPartyFrame
from .record_parsing import text_numbers

DISPLACEMENT = "MP_DISPLACEMENT"
COLUMN_MAP = {
    **{axis: axis for axis in "xyz"},
    **dict(zip(("vx", "vy", "vz"), column_names("MP_VELOCITY", 3), strict=True)),
    "mass": "MP_MASS",
    "id": "id",
}
MOST_BLOCKS = 1_000_000  # of results in a file
_RESULT = re.compile(
    rb'^[ \t]*Result[ \t]+"([^"\n]{1,80})"[ \t]+"[^"\n]{0,80}"[ \t]+(\S{1,40})[ \t]+(\w+)[ \t]+OnNodes[^\n]{0,80}\n',
    re.MULTILINE | re.IGNORECASE,
)
_VALUES = re.compile(rb"[ \t]*Values[ \t]*\r?\n", re.IGNORECASE)
_END_VALUES = re.compile(rb"^[ \t]*End[ \t]+Values", re.MULTILINE | re.IGNORECASE)
_MESH = re.compile(rb"MESH[^\n]*ElemType[ \t]+Point[^\n]*\n[ \t]*Coordinates[ \t]*\r?\n", re.IGNORECASE)
_END_MESH = re.compile(rb"^[ \t]*End[ \t]+Coordinates", re.MULTILINE | re.IGNORECASE)


class _Block(NamedTuple):
    """Lines `id values` from `start` to `stop` [bytes]: `rows` lines with `components` values."""

    start: int
    stop: int
    rows: int
    components: int


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file is a mesh of points, or results with such a mesh.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    path = Path(path)
    if path.name.endswith(".post.res"):
        return head.lstrip().lower().startswith(b"gid post results file") and _mesh_path(path).is_file()
    return path.name.endswith(".post.msh") and _MESH.search(head) is not None


def _stem(path):
    return path.name.removesuffix(".post.res").removesuffix(".post.msh")


def _mesh_path(path):
    return path.with_name(f"{_stem(path)}.post.msh")


def frames(paths: Iterable[Path], terms: Declarations) -> list[ThirdPartyFrame]:
    """Describe the frames in pairs of files; a pair is given by one of its files or both.

    Parameters
    ----------
    paths : iterable of Path
    terms : Declarations

    Raises
    ------
    FormatError
    """
    pairs = dict.fromkeys((path.parent, _stem(path)) for path in map(Path, paths))
    return [frame for folder, stem in pairs for frame in open_pair(folder / f"{stem}.post.res")]


def open_pair(path: Path) -> list[ThirdPartyFrame]:
    """Describe the frames in one file of results.

    Parameters
    ----------
    path : Path

    Raises
    ------
    FormatError
        No results of points, no mesh in the same folder, no displacements, damaged.
    """
    mesh = _mesh_block(_mesh_path(path))
    times = _result_blocks(path)
    settings, folder = project_settings(path)
    density = materials_density(settings, folder)
    frames = []
    for time, blocks in times.items():
        moved = blocks.get(DISPLACEMENT)
        if moved is None or moved.components != 3:
            raise FormatError(
                f"{path}: no {DISPLACEMENT} at {time:g} s, which gives the positions of the points; add it to the "
                "gauss_point_results of Kratos"
            )
        shapes = {name: block.components for name, block in blocks.items()}
        frames.append(
            ThirdPartyFrame(
                path=path,
                count=moved.rows,
                columns=("x", "y", "z", "id", *columns_of(shapes)),
                read=partial(_read, path, mesh, blocks, time),
                column_map=COLUMN_MAP,
                time=time,
                density=density,
                density_hint=DENSITY_HINT,
            )
        )
    return frames


def _mesh_block(path):
    with mapped(path) as content:
        begin = _MESH.search(content, 0, 4096)
        end = _END_MESH.search(content, begin.end()) if begin else None
        if end is None:
            raise FormatError(
                f"{path} is not a GiD mesh of points (MESH .. ElemType Point, Coordinates, End Coordinates)"
            )
        rows = content[begin.end() : end.start()].count(b"\n")
        if rows == 0:
            raise FormatError(f"{path}: contains no point")
        return _Block(begin.end(), end.start(), rows, 3)


def _result_blocks(path: Path) -> dict[float, dict[str, _Block]]:
    """Return a dict of time [s] and dict of name and _Block."""
    times, at = {}, 0
    with mapped(path) as content:
        if not content[:200].lstrip().lower().startswith(b"gid post results file"):
            raise FormatError(f"{path} is not a GiD file of results (it does not begin with 'GiD Post Results File')")
        for _ in range(MOST_BLOCKS):
            found = _RESULT.search(content, at)
            if found is None:
                break
            name, time = found[1].decode("ascii", "replace"), _time(path, found[2])
            begin = _VALUES.match(content, found.end())
            end = _END_VALUES.search(content, found.end())
            if begin is None or end is None:
                raise FormatError(f"{path}: {name} at {time:g} s has no Values .. End Values; it is truncated")
            text = content[begin.end() : end.start()]
            width = len(text[:500].split(b"\n")[0].split())
            block = _Block(begin.end(), end.start(), text.count(b"\n"), max(width - 1, 0))
            if name in times.setdefault(time, {}):
                raise FormatError(f"{path}: {name} occurs twice for {time:g} s")
            if block.rows and block.components:
                times[time][name] = block
            at = end.end()
    if not times:
        raise FormatError(f"{path} contains no results of points (Result .. OnNodes)")
    return times


def _time(path, word):
    try:
        time = float(word)
    except ValueError:
        time = np.nan
    if not np.isfinite(time):
        raise FormatError(f"{path}: {word.decode('ascii', 'replace')[:20]!r} is not a time of a Result")
    return time


def _rows(path: Path, block: _Block, what: str) -> tuple[np.ndarray, np.ndarray]:
    """Return (int64[rows] of ids, float64[rows, components])."""
    with mapped(path) as content:
        text = content[block.start : block.stop]
    width = 1 + block.components
    values = text_numbers(text, block.rows * width, path, what).reshape(block.rows, width)
    if not (np.isfinite(values[:, 0]) & (np.abs(values[:, 0]) < 2**53)).all():
        raise FormatError(f"{path}: {what}: the first number of a line is not an id; it is damaged")
    return values[:, 0].astype(np.int64), values[:, 1:]


def _read(path, mesh, blocks, time, names):
    ids, moved = _rows(path, blocks[DISPLACEMENT], f"{DISPLACEMENT} at {time:g} s")
    order = np.argsort(ids, kind="stable")
    if (np.diff(ids[order]) == 0).any():
        raise FormatError(f"{path}: {DISPLACEMENT} at {time:g} s has a point twice")
    arrays = {DISPLACEMENT: moved}
    found = {"id": ids.astype(np.float64)} if "id" in names else {}
    if {"x", "y", "z"} & set(names):
        first = _ordered(_mesh_path(path), *_rows(_mesh_path(path), mesh, "its coordinates"), ids)
        found |= {axis: first[:, k] + moved[:, k] for k, axis in enumerate("xyz") if axis in names}
    places = columns_of({name: block.components for name, block in blocks.items()})
    for column in names:
        if column in places:
            name, component = places[column]
            if name not in arrays:
                what = f"{name} at {time:g} s"
                arrays[name] = _ordered(path, *_rows(path, blocks[name], what), ids, what)
            found[column] = arrays[name][:, component]
    return found


def _ordered(
    path: Path, ids: np.ndarray, values: np.ndarray, wanted: np.ndarray, what: str = "its coordinates"
) -> np.ndarray:
    """Return the rows of `values` for the point ids `wanted`."""
    order = np.argsort(ids, kind="stable")
    place = np.minimum(np.searchsorted(ids[order], wanted), len(ids) - 1)
    rows = order[place]
    lost = np.flatnonzero(ids[rows] != wanted)
    if lost.size:
        raise FormatError(f"{path}: {what} lack {lost.size} of {len(wanted)} points, the first {wanted[lost[0]]}")
    return values[rows]


READER = Reader("kratos-gid", recognises, frames)
