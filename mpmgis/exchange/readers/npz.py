"""NumPy archives (.npz): arrays one by one, never unpickled; and the reader of general ones."""

from collections.abc import Iterable
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import NamedTuple
from zipfile import ZipFile, ZipInfo

import numpy as np

from ...system.errors import FormatError, InputError, one_line
from ...system.zip_archives import MAGIC, opened_zip, require_unpacked_fits
from ..declarations import VECTORS, Declarations
from .array_columns import columns_of, picked, plainly_named
from .array_shapes import MOST_COMPONENTS, as_rows, length_of_vector, selection
from .particle_arrays import columns_in, is_time, parts_of, positions_in, quantities_in, view_of_position, views_of
from .reader_interface import Reader, ThirdPartyFrame, number_of, require_readable

TIMES = ("t_current", "time", "times", "Time", "TimeValue", "t")  # arrays with the time of a file
LONGEST_HEADER = 10_000  # [bytes] as the limit of NumPy; a header can declare 4 GB


class Member(NamedTuple):
    """An array of numbers in the archive.

    Attributes
    ----------
    name : str
    start : int [bytes]
        Of its values.
    shape : tuple of int
    dtype : str
    fortran : bool
        Values are in the order of Fortran.
    """

    name: str
    start: int
    shape: tuple
    dtype: str
    fortran: bool


def read_members(path: str | Path) -> dict[str, Member]:
    """Read name -> Member of all arrays of numbers; arrays of (pickled) objects are omitted.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        No archive of arrays, damaged.
    """
    found = {}
    require_readable(path)
    with opened_zip(path, ".npz") as archive:
        for info in archive.infolist():
            if info.filename.endswith(".npy") and not info.flag_bits & 1:
                member = _member(path, archive, info)
                if member is not None:
                    found[info.filename.removesuffix(".npy")] = member
    if not found:
        raise FormatError(f"{path} contains no arrays of numbers (.npy)")
    return found


def _member(path: str | Path, archive: ZipFile, info: ZipInfo) -> Member | None:
    """Return the Member of an entry; None where it has other types than numbers."""
    with archive.open(info) as file:
        stream = BytesIO(file.read(LONGEST_HEADER + 12))
        try:
            version = np.lib.format.read_magic(stream)
            read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}[version]
            shape, fortran, dtype = read(stream, max_header_size=LONGEST_HEADER)
        except (ValueError, KeyError, TypeError, SyntaxError, RecursionError, MemoryError, OverflowError) as error:
            raise FormatError(f"{path}: {info.filename} is not an array of NumPy ({one_line(error)[:60]})") from error
        start = stream.tell()
    if dtype.kind not in "fiub" or dtype.hasobject:
        return None
    if min(shape, default=0) < 0 or start + _size(shape) * dtype.itemsize != info.file_size:
        raise FormatError(f"{path}: {info.filename} of {info.file_size} bytes cannot hold {shape} of {dtype}; damaged")
    return Member(info.filename, start, shape, dtype.str, fortran)


def _size(shape):
    size = 1
    for length in shape:
        size *= int(length)
    return size


def read_array(path: str | Path, member: Member) -> np.ndarray:
    """Read one array.

    Parameters
    ----------
    path : str or Path
    member : Member

    Returns
    -------
    float64 of the shape of the member

    Raises
    ------
    FormatError
        Damaged: truncated, or another checksum.
    """
    size = _size(member.shape)
    bytes_each = 2 * np.dtype(member.dtype).itemsize + 8  # compressed, ordered, as float64
    require_unpacked_fits(f"{path}: {member.name}", size * bytes_each)
    with opened_zip(path, ".npz") as archive, archive.open(member.name) as stream:
        stream.read(member.start)
        raw = stream.read(size * np.dtype(member.dtype).itemsize)
        stream.read(1)  # zipfile checks the checksum at the end
    values = np.frombuffer(raw, member.dtype, size)
    return values.reshape(member.shape, order="F" if member.fortran else "C").astype(np.float64)


def read_columns(path: str | Path, members: dict[str, Member], names: Iterable[str]) -> dict[str, np.ndarray]:
    """Read some columns of the arrays.

    Parameters
    ----------
    path : str or Path
    members : dict of str to Member
    names : iterable of str

    Returns
    -------
    dict of str to float64[n]

    Raises
    ------
    FormatError
    """

    def rows(name: str) -> np.ndarray:
        return read_array(path, members[name]).reshape(members[name].shape[0], -1)

    return picked(rows, component_counts(members), names)


def component_counts(members: dict[str, Member]) -> dict[str, int]:
    """Return the number of components of each array.

    Parameters
    ----------
    members : dict of str to Member
    """
    return {name: _size(member.shape[1:]) for name, member in members.items()}


def rowed(members: dict[str, Member], count: int) -> dict[str, Member]:
    """Return the arrays with a row for each particle.

    Parameters
    ----------
    members : dict of str to Member
    count : int
        Number of particles.
    """
    rows = {name: member for name, member in members.items() if member.shape[:1] == (count,)}
    counts = component_counts(rows)
    return {name: member for name, member in rows.items() if 0 < counts[name] <= MOST_COMPONENTS}


def single(path: str | Path, members: dict[str, Member], *names: str) -> float | None:
    """Read the number in the first array that exists with one value.

    Parameters
    ----------
    path : str or Path
    members : dict of str to Member
    *names : str
        Of the arrays, in order.

    Returns
    -------
    float or None
        None without a finite one.

    Raises
    ------
    FormatError
    """
    for name in names:
        if name in members and _size(members[name].shape) == 1:
            value = float(read_array(path, members[name]).item())
            return value if np.isfinite(value) else None
    return None


def fits(path: Path, head: bytes) -> bool:
    """Return whether a file is an archive of arrays.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    return head.startswith(MAGIC) and head[30:200].split(b".npy")[0] != head[30:200]


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file is an archive with position and velocity.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    if not fits(path, head):
        return False
    try:
        found = _frames(path, Declarations())
    except (FormatError, InputError):
        return False
    return {"x", "vx"} <= set(found[0].column_map)


def open_file(path: str | Path, column_map: dict[str, str] | None = None, count: int | None = None) -> ThirdPartyFrame:
    """Describe the frame in an archive.

    Parameters
    ----------
    path : str or Path
    column_map : dict of str to str, optional
        Columns of the code; without it by their names.
    count : int, optional
        Number of particles; without it the longest first axis.

    Raises
    ------
    FormatError
    """
    path, members = Path(path), read_members(path)
    if count is None:
        count = max((member.shape[0] for member in members.values() if member.shape), default=0)
    members_of_rows = rowed(members, count)
    if count == 0 or not members_of_rows:
        raise FormatError(f"{path}: contains no particle")
    components = component_counts(members_of_rows)
    return ThirdPartyFrame(
        path=path,
        count=count,
        columns=tuple(columns_of(components)),
        read=partial(read_columns, path, members_of_rows),
        column_map=plainly_named(components) if column_map is None else column_map,
        number=number_of(path),
        time=single(path, members, *TIMES),
    )


def frames(paths: Iterable[Path], terms: Declarations) -> list[ThirdPartyFrame]:
    """Describe the frames in some archives: one of each, or one for each time of a recording.

    Parameters
    ----------
    paths : iterable of Path
    terms : Declarations

    Raises
    ------
    FormatError
        Damaged, no particles.
    InputError
        A column of times that is none.
    """
    return [frame for path in paths for frame in _frames(Path(path), terms)]


def _frames(path, terms):
    members, asked = read_members(path), dict(terms.column_pairs())
    shapes = {name: member.shape for name, member in members.items()}
    choice = next(iter(positions_in(shapes)), {}) | {name: asked[name] for name in VECTORS["position"] if name in asked}
    parts = [part for column in choice.values() for part in parts_of(column, shapes)[:1]]
    if len(parts) < len(VECTORS["position"]):
        return [open_file(path)]
    first = view_of_position(shapes, parts, () if terms.times is None else (len(terms.times),))
    if first is None:
        return [open_file(path)]
    views = views_of(shapes, first)
    quantities = quantities_in(views)
    column_map = {name: column for choices in quantities.values() for name, column in choices[0].items()}
    describe = partial(ThirdPartyFrame, path, first.rows, tuple(columns_in(views)), column_map=column_map)
    if first.times is None:
        time = single(path, members, *([asked["time"]] if "time" in asked else TIMES))
        return [describe(partial(_read_views, path, members, views, 0), number=number_of(path), time=time)]
    named = [asked["time"]] if "time" in asked else [name for name in members if is_time(name)]
    lengths = {name: length_of_vector(shapes[name]) for name in named if name in members}
    of_times = next((name for name, length in lengths.items() if length == first.times), None)
    times = [None] * first.times
    if of_times is not None:
        times = read_array(path, members[of_times]).ravel().tolist()
        if not np.isfinite(times).all():
            raise FormatError(f"{path}: {of_times} has NaN or infinite times")
    reads = [partial(_read_views, path, members, views, k) for k in range(first.times)]
    return [describe(read, number=k, time=times[k]) for k, read in enumerate(reads)]


def _read_views(path, members, views, frame, names):
    found, whole, places = {}, {}, columns_in(views)
    for column in names:
        name, component = places[column]
        if name not in whole:
            view = views[name]
            whole[name] = as_rows(read_array(path, members[name])[selection(view, frame)], view)
        found[column] = whole[name][:, component]
    return found


READER = Reader("npz", recognises, frames, fits)
