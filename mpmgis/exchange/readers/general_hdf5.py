"""General HDF5: particles as datasets by name, in the root or in groups one level below.

A dataset is a scalar column (n,) or (n, 1), a vector (n, k), or a table of records whose fields are columns. Names are
relative to the group of the particles (`position`), or paths (`particles/position`). Groups that differ only by a
number and have a time, or are named as steps, are the frames of a series. Ambiguous names are an error with the
candidates.

Files are untrusted. Only values in the file itself are read: no soft or external links, no external storage, no
virtual datasets. Declared shapes and chunks are compared with the free memory before reading.
"""

import re
from collections.abc import Iterable
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from ...system.errors import FormatError, InputError, one_line
from ...system.hdf5_reading import MOST_OBJECTS, opened, reason_elsewhere, reason_not_followed, require_memory
from ..declarations import POSSIBLE, VECTORS, Declarations, terms_in
from .array_columns import candidates_named, columns_of, picked
from .reader_interface import Reader, ThirdPartyFrame, number_of, require_readable

MAGIC = b"\x89HDF\r\n\x1a\n"
OFFSETS = (0, 512, 1024, 2048)  # start of HDF5: after a user block, for example of MATLAB
OWN_FORMATS = "mpmgis-"
MOST_COMPONENTS = 100  # of an array with a row per particle
MOST_NAMED = 12  # in a message
STEP_WORDS = ("step", "steps", "timestep", "time_step", "time", "t", "frame", "iteration", "iter", "output", "snapshot")
DECLARED = ("crs", "origin", "axes")  # attributes of the root, as in a sidecar
_NUMBERED = re.compile(r"(.*?)[-_.#]?(\d{1,15})", re.DOTALL)


class Source(NamedTuple):
    """A column or vector in the file.

    Attributes
    ----------
    dataset : str
    field : str
        Of a record; "" for none.
    rows, components : int
    """

    dataset: str
    field: str
    rows: int
    components: int


class Group(NamedTuple):
    """The root or a group in it.

    Attributes
    ----------
    name : str
        "" for the root.
    arrays : dict of str to Source
    time : float or None [s]
    """

    name: str
    arrays: dict
    time: float | None


class Content(NamedTuple):
    """Content of a file.

    Attributes
    ----------
    groups : dict of str to Group
    elsewhere : tuple of str
        Names of values in other files.
    density : float or None [kg m-3]
        Of the root.
    declared : Declarations or None
        Georeference in the root.
    """

    groups: dict
    elsewhere: tuple
    density: float | None
    declared: object


def fits(path: Path, head: bytes) -> bool:
    """Return whether a file is readable HDF5 that is not of mpmgis.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    found = _format_of(path, head)
    return found is not None and not found.startswith(OWN_FORMATS)


def is_own(path: Path, head: bytes) -> bool:
    """Return whether a file is HDF5 of mpmgis.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    found = _format_of(path, head)
    return found is not None and found.startswith(OWN_FORMATS)


def _format_of(path, head):
    """Format that the root of an HDF5 file names, "" without one; None for other and unreadable files."""
    if not any(head[offset:].startswith(MAGIC) for offset in OFFSETS):
        return None
    try:
        with _opened(path) as file:
            return _text(file.attrs.get("format"))
    except FormatError:
        return None


def recognises(path: Path, head: bytes) -> bool:
    """Return whether one group of a file has a position and a velocity by name.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    if not fits(path, head):
        return False
    try:
        with _opened(path) as file:
            groups = _groups(path, file)[0]
    except FormatError:
        return False
    return any({"position", "velocity"} <= set(_candidates(group)) for group in groups.values())


@contextmanager
def _opened(path):
    require_readable(path)
    try:
        with opened(path) as file:
            yield file
    except FormatError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError, OverflowError) as error:
        raise FormatError(f"{path} is not a readable HDF5 file ({one_line(error)[:100]}); it is damaged") from error


def _text(value: Any) -> str:
    """Return the text of an attribute or a dataset; "" for other types."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.item()
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    return str(value) if isinstance(value, str) else ""


def _number(value: Any) -> float | None:
    """Return a finite number; None for other values."""
    value = np.asarray(value)
    if value.size != 1 or value.dtype.kind not in "fiu":
        return None
    return float(value.item()) if np.isfinite(value.item()) else None


def _content(path: Path, terms: Declarations) -> Content:
    """Return the content of the file; declarations in `terms` have priority."""
    with _opened(path) as file:
        if _text(file.attrs.get("format")).startswith(OWN_FORMATS):
            raise FormatError(f"{path} is a file of mpmgis; omit --reader hdf5")
        groups, apart = _groups(path, file)
        density = _number(file.attrs.get("density", ""))
        low, high, _ = POSSIBLE["density"]
        density = density if density is not None and low <= density <= high else None
        return Content(groups, apart, density, _declared_attributes(path, file.attrs, terms))


def _declared_attributes(path: Path, attrs: Any, terms: Declarations) -> Declarations | None:
    """Return the georeference in the root; coordinates in a CRS are east, north and up."""
    content = {}
    for key in DECLARED:
        if key in attrs and getattr(terms, key) is None and not (key == "crs" and terms.local):
            value = attrs[key]
            if key == "origin":
                content[key] = np.asarray(value).tolist()
            elif text := _text(value):
                content[key] = text.split(",") if key == "axes" else text
            elif key == "axes":
                content[key] = [_text(word) for word in np.ravel(value)]
    if "crs" in content:
        content = {"origin": [0.0, 0.0, 0.0], "axes": ["e", "n", "u"]} | content
    return terms_in(path, content) if content else None


def _groups(path: Path, file: h5py.File) -> tuple[dict[str, Group], tuple[str, ...]]:
    """Return (name -> Group of the root and of every group in it, names of values in other files)."""
    groups, apart, left = {}, [], [MOST_OBJECTS]
    inner = []
    of_file = _time(file.attrs)
    groups[""] = _group(path, "", file, apart, inner, left)
    for name in inner:
        groups[name] = _group(path, name, file[name], apart, [], left)
    if of_file is None and groups[""].time is None and "Header" in inner:  # as in Gadget files
        of_file = _time(file["Header"].attrs)
    if groups[""].time is None:
        groups[""] = groups[""]._replace(time=of_file)
    return groups, tuple(apart)


def _group(path: Path, name: str, group: h5py.Group, apart: list[str], inner: list[str], left: list[int]) -> Group:
    """Return the Group of an HDF5 group; names of groups in it are added to `inner`."""
    arrays, time = {}, _time(group.attrs)
    for key in group:
        left[0] -= 1
        if left[0] < 0:
            raise FormatError(f"{path} contains more than {MOST_OBJECTS} objects; it is not a particle file")
        full = f"{name}/{key}" if name else key
        if reason_not_followed(group.get(key, getlink=True), path):
            apart.append(full)
            continue
        kind = group.get(key, getclass=True)
        if kind is h5py.Group:
            inner.append(full)
        elif kind is h5py.Dataset:
            dataset = group[key]
            if reason_elsewhere(dataset.id, path):
                apart.append(full)
            elif dataset.size == 1 and key.lower() == "time":
                require_memory(f"{path}: {full}", 1, 8, dataset)
                time = _number(dataset[()])
            else:
                arrays |= _sources(key, full, dataset)
    return Group(name, arrays, time)


def _time(attrs):
    for name in ("time", "Time", "TIME"):
        if name in attrs:
            return _number(attrs[name])
    return None


def _sources(key: str, full: str, dataset: h5py.Dataset) -> dict[str, Source]:
    """Return name -> Source of the columns and vectors of numbers in a dataset."""
    if dataset.shape is None or dataset.ndim not in (1, 2) or dataset.shape[0] == 0:
        return {}
    rows, width = dataset.shape[0], dataset.shape[1] if dataset.ndim == 2 else 1
    if dataset.dtype.names is None:
        numbers = dataset.dtype.kind in "fiub" and 0 < width <= MOST_COMPONENTS
        return {key: Source(full, "", rows, width)} if numbers else {}
    found = {}
    for field in dataset.dtype.names if dataset.ndim == 1 else ():
        kind = dataset.dtype[field]
        if kind.base.kind in "fiub" and len(kind.shape) <= 1 and 0 < int(np.prod(kind.shape)) <= MOST_COMPONENTS:
            found[field] = Source(full, field, rows, int(np.prod(kind.shape)))
    return found


def _candidates(group: Group) -> dict[str, list[dict[str, str]]]:
    """Return the quantities of mpmgis and the candidate columns of the group, by name."""
    return candidates_named({name: source.components for name, source in group.arrays.items()})


def frames(paths: Iterable[Path], terms: Declarations) -> list[ThirdPartyFrame]:
    """Describe the frames in some files.

    Parameters
    ----------
    paths : iterable of Path
    terms : Declarations

    Raises
    ------
    FormatError, InputError
        Damaged, no particles, or ambiguous names.
    """
    return [frame for path in paths for frame in _frames(Path(path), terms)]


def _frames(path, terms):
    content = _content(path, terms)
    homes = _particle_groups(path, content, terms)
    series = _series(homes, content)
    if len(homes) > 1 and series is None:
        raise InputError(
            f"{path} has particles in several groups ({_listed(homes)}); choose one, for example --columns "
            f"{_example(content.groups[homes[0]])}"
        )
    if series is None:
        return [_frame(path, content, homes[0], terms, content.groups[""].time, number_of(path))]
    return [_frame(path, content, home, terms, None, number) for number, home in sorted(series.items())]


def _listed(names: list[str]) -> str:
    """Return names for a message; the root is /."""
    more = ", .." if len(names) > MOST_NAMED else ""
    return ", ".join(one_line(name or "/")[:60] for name in names[:MOST_NAMED]) + more


def _example(group):
    columns = next(iter(_candidates(group).get("position", [])), None)
    if columns is None or not group.name:
        return "position=GROUP/NAME"
    first = columns["x"]
    return f"position={group.name}/{first[:-2]}" if first.endswith(".x") else f"x={group.name}/{first},.."


def _particle_groups(path: Path, content: Content, terms: Declarations) -> list[str]:
    """Return the names of the groups with positions: as declared by the user, else by their array names."""
    asked = {column.lstrip("/") for name, column in terms.column_pairs() if name in VECTORS["position"]}
    paths = {full for group in content.groups.values() for full in _columns(group, True)}
    in_paths = sorted(column for column in asked if "/" in column and column in paths)
    if not asked:
        homes = [name for name, group in content.groups.items() if "position" in _candidates(group)]
    elif len(in_paths) == len(asked):
        homes = [in_paths[0].split("/", 1)[0]]
    else:
        homes = [name for name, group in content.groups.items() if asked - set(in_paths) <= set(_columns(group))]
    if homes:
        return homes
    what = f"no group has all of {', '.join(sorted(asked))}" if asked else "no array is named as a position"
    arrays = [f"{full} {_shape(s)}" for g in content.groups.values() for full, s in _by_path(g).items()]
    held = f"it contains {_listed(arrays)}" if arrays else "it contains no rows of numbers"
    if content.elsewhere:
        apart = _listed(list(content.elsewhere))
        held += f"; {apart} are in other files or behind links and are not read without --trust"
    fix = "; name the datasets with --columns x=..,y=..,z=.. or position=.." if arrays else ""
    raise InputError(f"{path}: {what}: {held}{fix}")


def _shape(source):
    return f"({source.rows})" if source.components == 1 else f"({source.rows}, {source.components})"


def _by_path(group: Group) -> dict[str, Source]:
    """Return full path -> Source."""
    return {f"{group.name}/{name}" if group.name else name: source for name, source in group.arrays.items()}


def _columns(group: Group, with_paths: bool = False) -> dict[str, tuple[str, int]]:
    """Return column -> (array, component) of a group, by names, or by full paths."""
    arrays = _by_path(group) if with_paths else group.arrays
    return columns_of({name: source.components for name, source in arrays.items()})


def _series(homes: list[str], content: Content) -> dict[int, str] | None:
    """Return number -> group where several groups are the frames of a series; None where they are not."""
    parts = {name: _NUMBERED.fullmatch(name) for name in homes}
    if len(homes) == 1:
        part, group = parts[homes[0]], content.groups[homes[0]]
        return {int(part[2]): homes[0]} if part and part[1].lower() in STEP_WORDS and group.name else None
    if not all(parts.values()) or len({part[1] for part in parts.values()}) != 1:
        return None
    stem = next(iter(parts.values()))[1].lower()
    if stem not in STEP_WORDS and any(content.groups[name].time is None for name in homes):
        return None
    series = {int(part[2]): name for name, part in parts.items()}
    return series if len(series) == len(homes) else None


def _frame(
    path: Path, content: Content, home: str, terms: Declarations, time: float | None, number: int | None
) -> ThirdPartyFrame:
    """Describe the frame of the particles in the group `home`."""
    group = content.groups[home]
    asked = dict(terms.column_pairs())
    if "time" in asked:
        raise InputError(f"{path}: HDF5 has one time per file or group; omit time in --columns, give --times")
    candidates = _candidates(group)
    for quantity, places in candidates.items():
        names = VECTORS.get(quantity, (quantity,))
        if len(places) > 1 and quantity != "id" and not all(name in asked for name in names):
            choice = " or ".join(", ".join(place.values()) for place in places)
            raise InputError(f"{path}: {quantity} may be {one_line(choice)[:200]}; choose with --columns")
    column_map = {name: column for places in candidates.values() for name, column in places[0].items()}
    sources = _row_sources(path, content, group, asked, column_map)
    count = next(iter(sources.values())).rows
    return ThirdPartyFrame(
        path=path,
        count=count,
        columns=tuple(columns_of({name: source.components for name, source in sources.items()})),
        read=partial(_read, path, sources),
        column_map=column_map,
        number=number,
        time=group.time if group.time is not None else time,
        density=content.density,
        declared=content.declared,
    )


def _row_sources(
    path: Path, content: Content, group: Group, asked: dict[str, str], column_map: dict[str, str]
) -> dict[str, Source]:
    """Return name -> Source of all arrays with a row per particle.

    They are those of the group by name, of all groups by path, of other groups by unique names.
    """
    first = asked.get("x") or column_map["x"]
    everything, times_seen = {}, {}
    for other in content.groups.values():
        everything |= _by_path(other)
        for name in other.arrays:
            times_seen[name] = times_seen.get(name, 0) + 1
    single = {name: s for g in content.groups.values() for name, s in g.arrays.items() if times_seen[name] == 1}
    rooted = {f"/{full}": source for full, source in everything.items()}
    named = everything | {name: s for name, s in rooted.items() if any(c.startswith(name) for c in asked.values())}
    named |= single | group.arrays
    array, _ = columns_of({name: source.components for name, source in named.items()})[first]
    count = named[array].rows
    of_rows = {name: source for name, source in named.items() if source.rows == count}
    short = set(asked.values()) - set(columns_of({name: s.components for name, s in of_rows.items()}))
    several = [name for name in short if times_seen.get(name, 0) > 1]
    if several:
        raise InputError(
            f"{path}: {several[0]} is in several groups ({_listed([p for p in everything if p.endswith(several[0])])}"
            "); choose with --columns"
        )
    return of_rows


def _read(path: Path, sources: dict[str, Source], names: tuple[str, ...]) -> dict[str, np.ndarray]:
    with _opened(path) as file:
        components = {name: source.components for name, source in sources.items()}
        return picked(lambda name: _array(path, file, sources[name]), components, names)


def _array(path: Path, file: h5py.File, source: Source) -> np.ndarray:
    """Return float64[rows, components] of a Source."""
    dataset = file[source.dataset]
    where = f"{path}: {source.dataset}"
    if not isinstance(dataset, h5py.Dataset) or reason_elsewhere(dataset.id, path):
        raise FormatError(f"{where} has changed since it was opened; repeat when its code has finished writing")
    if dataset.shape[:1] != (source.rows,):
        raise FormatError(f"{where} has shape {dataset.shape}, expected {source.rows} rows; the file has changed")
    require_memory(where, source.rows, 8 * source.components + dataset.dtype.itemsize, dataset)
    values = dataset.fields(source.field)[()] if source.field else dataset[()]
    return np.asarray(values, np.float64).reshape(source.rows, source.components)


READER = Reader("hdf5", recognises, frames, fits)
