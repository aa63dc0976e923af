"""Arrays of several components as columns by name, as VTK and NumPy files hold them."""

from ...errors import FormatError
from .terms import COMPONENTS, VECTORS

SYNONYMS = {  # names that say what they are, in small letters, for files that no one code wrote
    "position": ("position", "positions", "pos", "coordinates", "coords", "points", "x"),
    "velocity": ("velocity", "velocities", "vel", "v", "u"),
    "id": ("id", "ids", "particle_id", "particleid", "particleids"),
    "mass": ("mass", "masses"),
    "volume": ("volume", "volumes"),
    **{name: (name,) for name in ("radius", "diameter", "active", "time")},
}


def column_names(name, components):
    """Columns of an array: its own name, or with .x, .y, .z of three components, .0, .1, .. of another number."""
    if components == 1:
        return (name,)
    return tuple(f"{name}.{word}" for word in (COMPONENTS if components == 3 else range(components)))


def columns_of(arrays):
    """Dict of column and (array, component), of a dict of array and number of components."""
    return {
        column: (name, k)
        for name, components in arrays.items()
        for k, column in enumerate(column_names(name, components))
    }


def picked(read_array, arrays, names):
    """float64[n] of some columns by name, each array read once by `read_array(name)`: float64[n, components]."""
    places, whole, found = columns_of(arrays), {}, {}
    for column in names:
        name, component = places[column]
        if name not in whole:
            whole[name] = read_array(name)
        found[column] = whole[name][:, component]
    return found


def plainly_named(arrays):
    """Our names and columns for arrays (name -> components) whose names say what they are, in any case of letters."""
    found = candidates_named(arrays)
    return {name: column for places in found.values() for name, column in places[0].items()}


def candidates_named(arrays):
    """Our quantities and all that may be them, each as our names and columns, the likeliest first.

    `arrays` (name -> components) whose names say what they are, in any case of letters. A place or a velocity is a
    vector, or as many of its components as there are by their own names.
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


def require_whole(path, what, got, wanted):
    """Refuse an array that has other than the wanted number of values."""
    if got != wanted:
        raise FormatError(f"{path}: {what} holds {got} numbers, wanted {wanted}; it is truncated or damaged")
