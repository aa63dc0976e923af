"""Columns of arrays: names of the components of vectors, and the quantities of mpmgis by these names."""

from collections.abc import Callable, Iterable

import numpy as np

from ..declarations import COMPONENTS, VECTORS

SYNONYMS = {  # column names in lower case, for general formats
    "position": ("position", "positions", "pos", "coordinates", "coords", "points", "x"),
    "velocity": ("velocity", "velocities", "vel", "v", "u"),
    "id": ("id", "ids", "particle_id", "particleid", "particleids"),
    "mass": ("mass", "masses"),
    "volume": ("volume", "volumes"),
    "density": ("density", "densities", "rho"),
    **{name: (name,) for name in ("radius", "diameter", "active", "time")},
}


def column_names(name: str, components: int) -> tuple[str, ...]:
    """Return the columns of an array.

    A single component has the name of the array, three have .x, .y, .z, another number has .0, .1, ..

    Parameters
    ----------
    name : str
    components : int
    """
    if components == 1:
        return (name,)
    return tuple(f"{name}.{word}" for word in (COMPONENTS if components == 3 else range(components)))


def columns_of(arrays: dict[str, int]) -> dict[str, tuple[str, int]]:
    """Return the columns of arrays.

    Parameters
    ----------
    arrays : dict of str to int
        Name -> number of components.

    Returns
    -------
    dict of str to (str, int)
        Column -> (array, component).
    """
    return {
        column: (name, k)
        for name, components in arrays.items()
        for k, column in enumerate(column_names(name, components))
    }


def picked(
    read_array: Callable[[str], np.ndarray], arrays: dict[str, int], names: Iterable[str]
) -> dict[str, np.ndarray]:
    """Read some columns by name, each array once.

    Parameters
    ----------
    read_array : callable
        `read_array(name)` returns float64[n, components].
    arrays : dict of str to int
        Name -> number of components.
    names : iterable of str
        Of the columns.

    Returns
    -------
    dict of str to float64[n]
    """
    places, whole, found = columns_of(arrays), {}, {}
    for column in names:
        name, component = places[column]
        if name not in whole:
            whole[name] = read_array(name)
        found[column] = whole[name][:, component]
    return found


def plainly_named(arrays: dict[str, int]) -> dict[str, str]:
    """Return the names of mpmgis and columns for arrays with names of SYNONYMS, in any case.

    Parameters
    ----------
    arrays : dict of str to int
        Name -> number of components.

    Returns
    -------
    dict of str to str
    """
    found = candidates_named(arrays)
    return {name: column for places in found.values() for name, column in places[0].items()}


def candidates_named(arrays: dict[str, int]) -> dict[str, list[dict[str, str]]]:
    """Return the quantities of mpmgis and their candidates, each as names and columns, the most likely first.

    Names are matched with SYNONYMS, in any case. A position or a velocity is a vector, or its components by name.

    Parameters
    ----------
    arrays : dict of str to int
        Name -> number of components.

    Returns
    -------
    dict of str to list of dict of str to str
    """
    small = {}
    for name, components in arrays.items():
        small.setdefault((name.lower(), components), []).append(name)
    found = {}
    for ours, words in SYNONYMS.items():
        letters = VECTORS.get(ours, (ours,))
        width = len(letters)
        named = [name for word in words for name in small.get((word, width), ())]
        places = [dict(zip(letters, column_names(name, width), strict=True)) for name in named]
        if width > 1:
            single = {letter: small[letter, 1][0] for letter in letters if (letter, 1) in small}
            places += [single] if single else []
        if places:
            found[ours] = places
    return found
