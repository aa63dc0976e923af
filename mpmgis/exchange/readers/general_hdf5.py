"""General HDF5, also of MATLAB v7.3: particles as datasets by name, in groups at any depth.

A dataset has one time or all times of a recording, with any order of its axes (`array_shapes`); a table of records is a
group of its fields. Names are those in the group of the particles and in the groups around it, or ends of paths
(`particles/position`). Groups whose paths differ in one number are the frames of a series, if they have a time or are
named as steps. Ambiguous names are an error with the candidates.

Files are untrusted. Only values in the file itself are read: no soft or external links, no external storage, no
virtual datasets. Declared shapes and chunks are compared with the free memory before reading.
"""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from ...system.errors import FormatError, InputError, one_line
from ...system.hdf5_reading import MOST_OBJECTS, opened, reason_elsewhere, reason_not_followed, require_memory
from ..declarations import COMPONENTS, POSSIBLE, VECTORS, Declarations, terms_in
from .array_columns import SYNONYMS
from .array_shapes import View, as_rows, fitting_view, length_of_vector, selection
from .particle_arrays import (
    Part,
    columns_in,
    is_time,
    last_part,
    parts_of,
    positions_in,
    quantities_in,
    view_of_position,
    views_of,
)
from .reader_interface import Reader, ThirdPartyFrame, number_of, require_readable
from .time_tables import require_few_times

MAGIC = b"\x89HDF\r\n\x1a\n"
OFFSETS = (0, 512, 1024, 2048)  # start of HDF5: after a user block, for example of MATLAB
OWN_FORMATS = "mpmgis-"
MATLAB = b"MATLAB 7.3"  # in the user block
MATLAB_TEXT = ("char", "cell", "function_handle", "string")  # classes of datasets that are no numbers
MATLAB_INNER = "#"  # first letter of groups with the contents of cells and structures
MOST_DEPTH = 100  # of groups in groups
MOST_NAMED = 12  # groups in a message
MOST_LISTED = 300  # datasets in a message
MOST_OFFERED = 1000  # arrays outside the group of the particles that --columns may name
STEP_WORDS = ("step", "steps", "timestep", "time_step", "time", "t", "frame", "iteration", "iter", "output", "snapshot")
DECLARED = ("crs", "origin", "axes")  # attributes of the root, as in a sidecar
ATTRIBUTES_OF_TIME = ("time", "Time", "TIME", "TimeValue")
OFFSET = "positionOffset"  # group of openPMD beside `position`
GADGET_HEADER = "Header"  # group with the time of the file
_NUMBERED = re.compile(r"(.*?)[-_.#]?(\d{1,15})", re.DOTALL)


class Array(NamedTuple):
    """A dataset of numbers, or a field of a table of records.

    Attributes
    ----------
    dataset : str
    field : str
        "" for none.
    shape : tuple of int
        Of the dataset, then of the field.
    """

    dataset: str
    field: str
    shape: tuple


class Content(NamedTuple):
    """Content of a file.

    Attributes
    ----------
    groups : dict of str to dict of str to Array
        Arrays by name of the root (""), of every group and of every table of records, by path.
    children : dict of str to list of str
        Names of the groups in each group.
    times, densities : dict of str to float [s], [kg m-3]
        Single numbers, by the path of their group.
    elsewhere, cells : tuple of str
        Paths of values in other files, and in cells of MATLAB.
    is_matlab : bool
    declared : Declarations or None
        Georeference in the root.
    """

    groups: dict
    children: dict
    times: dict
    densities: dict
    elsewhere: tuple
    cells: tuple
    is_matlab: bool
    declared: object

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shape of each array by its path."""
        return {_joined(group, name): a.shape for group, arrays in self.groups.items() for name, a in arrays.items()}

    def array(self, path: str) -> Array:
        """Return an array by its path.

        Parameters
        ----------
        path : str
        """
        group, _, name = path.rpartition("/")
        return self.groups[group][name]

    def inner(self, group: str) -> list[str]:
        """Return the names of the groups in a group.

        Parameters
        ----------
        group : str
        """
        return self.children.get(group, [])

    def enclosing(self, group: str) -> Iterator[str]:
        """Yield a group and the groups around it, up to the root.

        Parameters
        ----------
        group : str
        """
        while True:
            if group in self.groups:
                yield group
            if not group:
                return
            group = group.rpartition("/")[0]


class Place(NamedTuple):
    """A column: component of an array.

    Attributes
    ----------
    array : Array
    view : View
    component : int
    """

    array: Array
    view: View
    component: int


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
            content = _content_of(path, file, None)
            homes = (_Home(path, file, content, home, None) for home in _named_homes(content))
            return any(_has_velocity(home) for home in homes)
    except FormatError:
        return False


def _has_velocity(home):
    try:
        return "velocity" in home.quantities(home.view())
    except InputError:
        return False


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


def _joined(group, name):
    return f"{group}/{name}" if group else name


def _shapes(arrays: dict[str, Array]) -> dict[str, tuple[int, ...]]:
    """Return the shape of each array by its name."""
    return {name: array.shape for name, array in arrays.items()}


# ------------------------------------------------------------------------------------------------------ what is there


def _content_of(path: Path, file: h5py.File, terms: Declarations | None) -> Content:
    """Return the content of the file; declarations in `terms` have priority."""
    walk = _Walk(path, file)
    density = _number(file.attrs.get("density", ""))
    if density is not None:
        walk.densities.setdefault("", density)
    low, high, _ = POSSIBLE["density"]
    densities = {group: value for group, value in walk.densities.items() if low <= value <= high}
    if "" not in walk.times and GADGET_HEADER in walk.times:
        walk.times[""] = walk.times[GADGET_HEADER]
    declared = None if terms is None else _declared_attributes(path, file.attrs, terms)
    apart, cells, children = tuple(walk.elsewhere), tuple(walk.cells), {}
    for group in filter(None, walk.groups):
        around, _, name = group.rpartition("/")
        children.setdefault(around, []).append(name)
    return Content(walk.groups, children, walk.times, densities, apart, cells, walk.is_matlab, declared)


class _Walk:
    """One visit of all groups of a file, without recursion; a group with several names is visited once."""

    def __init__(self, path: Path, file: h5py.File):
        self.path, self.file, self.left = path, file, MOST_OBJECTS
        self.groups, self.times, self.densities, self.elsewhere, self.cells = {}, {}, {}, [], []
        self.is_matlab = file.userblock_size > 0 and _first_bytes(path).startswith(MATLAB)
        seen, waiting = set(), [("", file)]
        while waiting:
            name, group = waiting.pop()
            about = h5py.h5o.get_info(group.id)
            if (about.fileno, about.addr) in seen:
                continue
            seen.add((about.fileno, about.addr))
            if name.count("/") >= MOST_DEPTH:
                raise FormatError(f"{path} has groups in groups, {MOST_DEPTH} deep; it is not a particle file")
            waiting += reversed([(inner, file[inner]) for inner in self._visit(name, group)])

    def _visit(self, name, group):
        """Note the arrays of a group; return the names of the groups in it."""
        inner, self.groups[name] = [], {}
        time = next((_number(group.attrs[word]) for word in ATTRIBUTES_OF_TIME if word in group.attrs), None)
        if time is not None:
            self.times[name] = time
        for key in group:
            self.left -= 1
            if self.left < 0:
                raise FormatError(f"{self.path} contains more than {MOST_OBJECTS} objects; it is not a particle file")
            full = _joined(name, key)
            if reason_not_followed(group.get(key, getlink=True), self.path):
                self.elsewhere.append(full)
                continue
            kind = group.get(key, getclass=True)
            if kind is h5py.Group and not (self.is_matlab and key.startswith(MATLAB_INNER)):
                inner.append(full)
            elif kind is h5py.Dataset:
                self._note(name, key, full, group[key])
        return inner

    def _note(self, name, key, full, dataset):
        """Note the numbers of a dataset."""
        if reason_elsewhere(dataset.id, self.path):
            self.elsewhere.append(full)
            return
        if dataset.shape is None or not self._has_numbers(full, dataset):
            return
        if dataset.dtype.names is not None:
            kinds = {field: dataset.dtype[field] for field in dataset.dtype.names}
            fields = {
                field: Array(full, field, dataset.shape + kind.shape)
                for field, kind in kinds.items()
                if kind.base.kind in "fiub"
            }
            if fields:
                self.groups[full] = fields
            return
        self.groups[name][key] = Array(full, "", dataset.shape)
        if dataset.size == 1:
            goal = self.times if is_time(key) else self.densities if key.lower() in SYNONYMS["density"] else None
            if goal is not None:
                require_memory(f"{self.path}: {full}", 1, 8, dataset)
                number = _number(dataset[()])
                if number is not None:
                    goal[name] = number

    def _has_numbers(self, full, dataset):
        if self.is_matlab:
            about = dataset.attrs
            kind = _text(about.get("MATLAB_class"))
            if kind == "cell" or dataset.dtype.kind == "O":
                self.cells.append(full)
            if kind in MATLAB_TEXT or "MATLAB_empty" in about:
                return False
        return dataset.dtype.names is not None or dataset.dtype.kind in "fiub"


def _first_bytes(path):
    with open(path, "rb") as file:
        return file.read(len(MATLAB))


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


# ------------------------------------------------------------------------------------------- where the particles are


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
    with _opened(path) as file:
        if _text(file.attrs.get("format")).startswith(OWN_FORMATS):
            raise FormatError(f"{path} is a file of mpmgis; omit --reader hdf5")
        content = _content_of(path, file, terms)
        homes = _homes(path, content, terms)
        series = _series(homes, content)
        if len(homes) > 1 and series is None:
            _refuse_several(path, content, homes, "has particles in several groups")
        if series is None:
            return _Home(path, file, content, homes[0], terms).frames(number_of(path))
        found = [
            frame
            for number, (home, top) in sorted(series.items())
            for frame in _Home(path, file, content, home, terms, top).frames(number)
        ]
        if len(found) > len(series) > 1:
            _refuse_several(path, content, homes, "has several times in each of several groups")
        return found


def _refuse_several(path, content, homes, what):
    raise InputError(
        f"{path} {what} ({_listed(homes)}); choose one, for example --columns {_example(content, homes[0])}"
    )


def _listed(names: list[str], most: int = MOST_NAMED) -> str:
    """Return names for a message; the root is /."""
    more = f", .. ({len(names)} in all)" if len(names) > most else ""
    return ", ".join(one_line(name or "/")[:120] for name in names[:most]) + more


def _example(content, home):
    choice = next(iter(positions_in(_shapes(content.groups[home]))), None)
    if choice is None or not home:
        return "position=GROUP/NAME"
    first = choice["x"]
    return f"position={home}/{first[:-2]}" if first.endswith(".x") else f"x={home}/{first},.."


def _named_homes(content: Content) -> list[str]:
    """Return the groups with a position by the names of their arrays.

    Components x, y, z in a group `position` are the position; those in groups next to it are not.
    """
    homes = [group for group, arrays in content.groups.items() if positions_in(_shapes(arrays))]
    by_word = {home for home in homes if last_part(home).lower() in SYNONYMS["position"]}
    parents = {home.rpartition("/")[0] for home in by_word}
    return [home for home in homes if home in by_word or home.rpartition("/")[0] not in parents]


def _matches(content: Content, column: str) -> list[tuple[str, Part]]:
    """Return the group and the Part of every array that a column may mean, by its name or the end of its path."""
    head, groups = column.lstrip("/").rpartition("/")[0], content.groups
    if column.startswith("/"):  # a whole path means one group
        groups = {head: groups[head]} if head in groups else {}
    found = [(group, part) for group, arrays in groups.items() if (part := _part_in(group, arrays, column))]
    whole = [entry for entry in found if entry[0] == head]
    return whole if head and whole else found


def _part_in(group: str, arrays: dict[str, Array], column: str) -> Part | None:
    """Return the Part of an array of a group that a column may mean; None where it means none."""
    head, _, tail = column.lstrip("/").rpartition("/")
    if group != head and (column.startswith("/") or (head and not group.endswith(f"/{head}"))):
        return None
    return next(iter(parts_of(tail, arrays)), None)


def _homes(path: Path, content: Content, terms: Declarations) -> list[str]:
    """Return the groups with positions: as declared by the user, else by the names of their arrays."""
    asked = dict.fromkeys(column for name, column in terms.column_pairs() if name in VECTORS["position"])
    if not asked:
        homes = _named_homes(content)
    else:
        places = [{group for group, _ in _matches(content, column)} for column in asked]
        homes = [group for group in content.groups if all(group in place for place in places)]
        if not homes and all(len(place) == 1 for place in places):
            homes = [next(iter(places[0]))]
    if homes:
        return homes
    what = f"no group has all of {', '.join(sorted(asked))}"
    if not asked:
        what = "no array has the name and the shape of a position"
    raise InputError(f"{path}: {what}: {_held(content)}")


def _held(content: Content) -> str:
    """Return all arrays of numbers with their shapes, and what is not read, for a message."""
    arrays = [f"{name} {_words(shape)}" for name, shape in content.shapes().items()]
    held = f"it contains {_listed(arrays, MOST_LISTED)}" if arrays else "it contains no rows of numbers"
    if content.elsewhere:
        apart = _listed(list(content.elsewhere))
        held += f"; {apart} are in other files or behind links and are not read without --trust"
    if content.cells:
        held += f"; {_listed(list(content.cells))} are cells of MATLAB and are not read: save arrays of numbers"
    return held + ("; name the datasets with --columns x=..,y=..,z=.. or position=.." if arrays else "")


def _words(shape):
    return f"({', '.join(map(str, shape))})"


def _series(homes: list[str], content: Content) -> dict[int, tuple[str, str]] | None:
    """Return number -> (group, the numbered group around it) where several groups are the frames of a series.

    None where they are not. A single group with the name of a step has its number, and times of the whole file.
    """
    split = [home.split("/") for home in homes]
    if len(homes) == 1:
        steps = [found for part in split[0] if (found := _NUMBERED.fullmatch(part)) and found[1].lower() in STEP_WORDS]
        return {int(steps[-1][2]): (homes[0], "")} if steps else None
    levels = [k for k, names in enumerate(zip(*split, strict=False)) if len(set(names)) > 1]
    if len({len(parts) for parts in split}) != 1 or len(levels) != 1:
        return None
    found = [_NUMBERED.fullmatch(parts[levels[0]]) for parts in split]
    if not all(found) or len({part[1] for part in found}) != 1:
        return None
    tops = ["/".join(parts[: levels[0] + 1]) for parts in split]
    timed = all(_time_within(content, home, top) is not None for home, top in zip(homes, tops, strict=True))
    if found[0][1].lower() not in STEP_WORDS and not timed:
        return None
    series = {int(part[2]): place for part, place in zip(found, zip(homes, tops, strict=True), strict=True)}
    return series if len(series) == len(homes) else None


def _time_within(content: Content, home: str, top: str) -> float | None:
    """Return the time [s] of a group, or of the nearest group around it up to `top`; None without one."""
    groups = (group for group in content.enclosing(home) if len(group) >= len(top))
    return next((content.times[group] for group in groups if group in content.times), None)


# --------------------------------------------------------------------------------------------------------- one group


class _Home:
    """The group with the positions of the particles.

    Parameters
    ----------
    path : Path
    file : h5py.File
    content : Content
    home : str
        Its path.
    terms : Declarations or None
    top : str
        Times of groups around this one are of other frames.
    """

    def __init__(self, path: Path, file: h5py.File, content: Content, home: str, terms: Any, top: str = ""):
        self.path, self.file, self.content, self.home, self.terms, self.top = path, file, content, home, terms, top
        self.asked = {} if terms is None else dict(terms.column_pairs())
        self.choices = positions_in(_shapes(content.groups[home]))
        named = self.choices[0] if self.choices else {}
        self.position = {name: self.asked.get(name, named.get(name)) for name in VECTORS["position"]}

    def view(self) -> View:
        """Return the meaning of the axes of the positions; refuse arrays that cannot be positions."""
        if not all(name in self.asked for name in VECTORS["position"]):
            self._require_one("position", self.choices)
        columns = [column for column in self.position.values() if column is not None]
        parts = [self._part_of_position(column) for column in columns]
        shapes = {}
        for group in reversed(list(self.content.enclosing(self.home))):
            shapes |= _shapes(self.content.groups[group])
        whole = [part._replace(array=_joined(group, part.array)) for group, part in parts]
        shapes |= {path: self.content.array(path).shape for path, *_ in whole}
        given = () if self.terms is None or self.terms.times is None else (len(self.terms.times),)
        self._refuse_offset()
        first = view_of_position(shapes, whole, given, self.content.is_matlab)
        if first is None:
            named = ", ".join(dict.fromkeys(f"{path} {_words(shapes[path])}" for path, *_ in whole))
            raise InputError(f"{self.path}: {named}: not positions, (n, 3) or x, y, z: {_held(self.content)}")
        return first

    def _part_of_position(self, column):
        """Group and Part of a column of the position."""
        arrays = self.content.groups[self.home]
        here = _part_in(self.home, arrays, column) or next(iter(parts_of(column, arrays)), None)
        return (self.home, here) if here else _matches(self.content, column)[0]

    def _refuse_offset(self):
        """Refuse positions with an offset beside them (openPMD) that is not 0: they are not the positions."""
        for group in self.content.enclosing(self.home):
            offset = _joined(group, OFFSET)
            if OFFSET not in self.content.inner(group):
                continue
            inner = [_joined(offset, name) for name in self.content.inner(offset)]
            constant = [_number(self.file[part].attrs.get("value", np.nan)) for part in inner]
            if self.content.groups[offset] or any(constant):
                raise InputError(f"{self.path}: {offset} has to be added to the positions, which is not done; add it")

    def _require_one(self, quantity, choices):
        """Refuse several arrays that a quantity may be."""
        if len(choices) > 1:
            choice = " or ".join(", ".join(place.values()) for place in choices)
            raise InputError(f"{self.path}: {quantity} may be {one_line(choice)[:200]}; choose with --columns")

    def quantities(self, first: View) -> dict[str, list[dict[str, str]]]:
        """Return the quantities of mpmgis and their candidate columns, of the nearest group that has any."""
        found = {}
        for group in self.content.enclosing(self.home):
            here = quantities_in(views_of(_shapes(self.content.groups[group]), first))
            if vectors := self._velocity_groups(group, first):
                here.setdefault("velocity", []).extend(vectors)
            found = here | found
        found.pop("position", None)
        return found | ({"position": self.choices} if self.choices else {})

    def _velocity_groups(self, group, first):
        """Components x, y, z in a group `velocity` in `group`, as candidates of `quantities`."""
        found = []
        for name in self.content.inner(group):
            if name.lower() not in SYNONYMS["velocity"]:
                continue
            arrays = self.content.groups[_joined(group, name)]
            if not set(COMPONENTS) <= set(arrays):
                continue
            if all(fitting_view(arrays[letter].shape, first, 1) for letter in COMPONENTS):
                letters = zip(VECTORS["velocity"], COMPONENTS, strict=True)
                found.append({ours: f"/{_joined(group, name)}/{letter}" for ours, letter in letters})
        return found

    def frames(self, number: int | None) -> list[ThirdPartyFrame]:
        """Describe the frames: one, or one for each time of a recording.

        Parameters
        ----------
        number : int or None
            Of the only frame.
        """
        first, asked = self.view(), self.asked
        candidates = self.quantities(first)
        for quantity, choices in candidates.items():
            if quantity != "id" and not all(name in asked for name in VECTORS.get(quantity, (quantity,))):
                self._require_one(quantity, choices)
        column_map = {name: column for choices in candidates.values() for name, column in choices[0].items()}
        wanted = dict.fromkeys((*column_map.values(), *(column for name, column in asked.items() if name != "time")))
        columns = self._columns(first, wanted)
        densities, around = self.content.densities, self.content.enclosing(self.home)
        describe = partial(
            ThirdPartyFrame,
            self.path,
            first.rows,
            tuple(columns),
            column_map={name: column for name, column in column_map.items() if column in columns},
            density=next((densities[group] for group in around if group in densities), None),
            declared=self.content.declared,
        )
        if first.times is None:
            return [describe(partial(_read, self.path, columns, 0), number=number, time=self._time())]
        times = self._times(first.times)
        return [
            describe(partial(_read, self.path, columns, k), number=k, time=None if times is None else times[k])
            for k in range(first.times)
        ]

    def _columns(self, first, wanted):
        """Column -> Place of all arrays with a row per particle: by name, by path, and as they are wanted."""
        found = {}
        for group in self.content.enclosing(self.home):
            for column, place in self._of_group(group, first).items():
                found.setdefault(column, place)
        if not self.top:  # in a series these are the other frames
            around = set(self.content.enclosing(self.home))
            others = (group for group in self.content.groups if group not in around)
            for group in others:
                if len(found) > MOST_OFFERED:
                    break
                found |= {_joined(group, column): place for column, place in self._of_group(group, first).items()}
        for column in wanted:
            if column not in found and (place := self._place(column, first)) is not None:
                found[column] = place
        return found

    def _of_group(self, group, first):
        arrays = self.content.groups[group]
        views = views_of(_shapes(arrays), first)
        return {column: Place(arrays[name], views[name], k) for column, (name, k) in columns_in(views).items()}

    def _place(self, column, first):
        """Place of a column by a path, or by a name that only one group has; None without one that fits."""
        for around in self.content.enclosing(self.home):
            head, _, tail = _joined(around, column).rpartition("/")
            found = self._of_group(head, first).get(tail) if head in self.content.groups else None
            if found is not None and not column.startswith("/"):
                return found
        places = {}
        for group, part in _matches(self.content, column):
            tail = column.rpartition("/")[2]
            place = self._of_group(group, first).get(tail)
            if place is not None:
                places[_joined(group, part.array)] = place
        if len(places) > 1:
            raise InputError(
                f"{self.path}: {column} is in several groups ({_listed(list(places))}); choose with --columns"
            )
        return next(iter(places.values()), None)

    def _time(self):
        """Time [s] of the only frame; None where it is unknown."""
        if "time" not in self.asked:
            return _time_within(self.content, self.home, self.top)
        array = self._array_of_time()
        if length_of_vector(array.shape) != 1 or array.field:
            raise InputError(
                f"{self.path}: {self.asked['time']} has shape {_words(array.shape)}, expected one time, or one for "
                "each time of a recording; give --times"
            )
        return _number(self.file[array.dataset][()])

    def _array_of_time(self):
        found = _matches(self.content, self.asked["time"])
        if not found:
            raise InputError(f"{self.path}: --columns time={self.asked['time']}: no such array: {_held(self.content)}")
        return self.content.groups[found[0][0]][found[0][1].array]

    def _times(self, count):
        """Times [s] of a recording; None without an array of them."""
        if "time" in self.asked:
            arrays = [self._array_of_time()]
        else:
            around = [self.content.groups[group] for group in self.content.enclosing(self.home)]
            arrays = [array for group in around for name, array in group.items() if is_time(name)]
        array = next((some for some in arrays if length_of_vector(some.shape) == count and not some.field), None)
        if array is None:
            return None
        dataset = self.file[array.dataset]
        require_memory(f"{self.path}: {array.dataset}", count, 8 + dataset.dtype.itemsize, dataset)
        times = np.asarray(dataset[()], np.float64).reshape(count)
        require_few_times(self.path, times)
        if not np.isfinite(times).all():
            raise FormatError(f"{self.path}: {array.dataset} has NaN or infinite times")
        return times.tolist()


def _read(path: Path, columns: dict[str, Place], frame: int, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    found, whole = {}, {}
    with _opened(path) as file:
        for name in names:
            array, view, component = columns[name]
            if array not in whole:
                whole[array] = _rows(path, file, array, view, frame)
            found[name] = whole[array][:, component]
    return found


def _rows(path: Path, file: h5py.File, array: Array, view: View, frame: int) -> np.ndarray:
    """Return float64[rows, components] of an array at one time."""
    dataset = file[array.dataset]
    where = f"{path}: {array.dataset}"
    if not isinstance(dataset, h5py.Dataset) or reason_elsewhere(dataset.id, path):
        raise FormatError(f"{where} has changed since it was opened; repeat when its code has finished writing")
    own = dataset.dtype[array.field].shape if array.field and array.field in (dataset.dtype.names or ()) else ()
    if dataset.shape + own != array.shape:
        raise FormatError(f"{where} has shape {dataset.shape}, expected {array.shape}; the file has changed")
    require_memory(where, view.rows, (8 + dataset.dtype.itemsize) * view.components, dataset)
    index, axes = selection(view, frame), dataset.ndim
    values = (dataset.fields(array.field) if array.field else dataset)[index[:axes]]
    return as_rows(values[(..., *index[axes:])] if index[axes:] else values, view)


READER = Reader("hdf5", recognises, frames, fits)
