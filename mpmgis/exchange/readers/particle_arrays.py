"""Particles in named arrays of any shape: which arrays are the position, and the columns of all others.

For formats of arrays with free names and shapes (HDF5, NumPy). A column is the name of an array, or the name and a
component (`xyz.x`, `state.4`).
"""

from collections.abc import Collection, Mapping
from typing import NamedTuple

from ..declarations import COMPONENTS, VECTORS
from .array_columns import SYNONYMS, candidates_named, column_names
from .array_shapes import View, first_view, fitting_view, length_of_vector

TIMES = ("time", "times", "timevalue")  # names of arrays with times, in lower case
TIME_LETTER = "t"  # in this case only: T is a temperature
OF_ROWS = ("id", "mass", "volume", "density", "radius", "diameter", "active")  # one number per particle
_WIDTHS = {  # usual number of components; a single letter may be a component
    word: len(VECTORS.get(name, (name,))) for name, words in SYNONYMS.items() for word in words if len(word) > 1
}
_NAMES_OF_ROWS = {word for name in OF_ROWS for word in SYNONYMS[name]}

Shape = tuple[int, ...]


class Part(NamedTuple):
    """A component of an array.

    Attributes
    ----------
    array : str
    component : int or None
        None for an array of one component.
    is_letter : bool
        The component is x, y or z: the array has three.
    """

    array: str
    component: int | None = None
    is_letter: bool = False


def is_time(name: str) -> bool:
    """Return whether an array has times by its name.

    Parameters
    ----------
    name : str
    """
    return name.lower() in TIMES or name == TIME_LETTER


def parts_of(column: str, arrays: Collection[str]) -> list[Part]:
    """Return the arrays and components that a column may mean: a whole array first.

    Parameters
    ----------
    column : str
    arrays : collection of str
        Names; an array whose name is `column`, or begins it, is meant.
    """
    found = [Part(column)] if column in arrays else []
    name, _, word = column.rpartition(".")
    if name in arrays and word in COMPONENTS:
        found.append(Part(name, COMPONENTS.index(word), True))
    elif name in arrays and word.isdigit() and word.isascii():
        found.append(Part(name, int(word[:4])))
    return found


def positions_in(shapes: Mapping[str, Shape]) -> list[dict[str, str]]:
    """Return the arrays that are positions by name, each as x, y, z and their columns.

    Parameters
    ----------
    shapes : mapping of str to tuple of int
        Of all arrays, by name.
    """
    small = {}
    for name, shape in shapes.items():
        if name.lower() in SYNONYMS["position"] or name.lower() in COMPONENTS:
            small.setdefault(name.lower(), []).append((name, shape))
    letters = [small[letter][0][1] for letter in COMPONENTS if letter in small]
    scalars = len(letters) == len(COMPONENTS) and len(set(letters)) == 1 and first_view(letters[0], 1) is not None
    widths = {}
    for word, entries in small.items():
        for name, shape in entries:
            if first_view(shape, 3) is not None and not (scalars and word in COMPONENTS):
                widths[name] = 3
            elif word in COMPONENTS and first_view(shape, 1) is not None:
                widths[name] = 1
    return candidates_named(widths).get("position", [])


def view_of_position(
    shapes: Mapping[str, Shape], parts: Collection[Part], time_counts: Collection[int] = (), column_major: bool = False
) -> View | None:
    """Return the meaning of the axes of the positions, by their shape and the lengths of other arrays.

    Parameters
    ----------
    shapes : mapping of str to tuple of int
        Of all arrays that may belong to the particles.
    parts : collection of Part
        Of the position.
    time_counts : collection of int
        Known numbers of times.
    column_major : bool
        As for `first_view`.

    Returns
    -------
    View or None
        None where the arrays cannot be positions.
    """
    rows = {length_of_vector(shape) for name, shape in shapes.items() if last_part(name).lower() in _NAMES_OF_ROWS}
    times = {length_of_vector(shape) for name, shape in shapes.items() if is_time(last_part(name))} | set(time_counts)
    first = next(iter(parts))
    numbers = [part.component for part in parts if part.array == first.array and part.component is not None]
    width = 1 if first.component is None else 3 if first.is_letter else None
    view = first_view(
        shapes[first.array], width, rows - {None, 1}, times - {None, 1}, 1 + max(numbers, default=0), column_major
    )
    if view is None or any(fitting_view(shapes[part.array], view) is None for part in parts):
        return None
    return view


def last_part(path: str) -> str:
    """Return the last part of a path of an HDF5 file: the name of an array or group.

    Parameters
    ----------
    path : str
    """
    return path.rpartition("/")[2]


def views_of(shapes: Mapping[str, Shape], first: View) -> dict[str, View]:
    """Return the meaning of the axes of all arrays with a row for each particle, by name.

    Parameters
    ----------
    shapes : mapping of str to tuple of int
    first : View
        Of the positions.
    """
    found = {}
    for name, shape in shapes.items():
        view = fitting_view(shape, first, _WIDTHS.get(last_part(name).lower()))
        if view is not None:
            found[name] = view
    return found


def columns_in(views: Mapping[str, View]) -> dict[str, tuple[str, int]]:
    """Return column -> (array, component) of arrays with particles.

    Parameters
    ----------
    views : mapping of str to View
    """
    return {
        column: (name, k)
        for name, view in views.items()
        for k, column in enumerate(column_names(name, view.components))
    }


def quantities_in(views: Mapping[str, View]) -> dict[str, list[dict[str, str]]]:
    """Return the quantities of mpmgis and their candidate columns, by the names of arrays.

    Parameters
    ----------
    views : mapping of str to View
        Of arrays by name.
    """
    return candidates_named({name: view.components for name, view in views.items()})
