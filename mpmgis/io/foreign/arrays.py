"""Arrays of several components as columns by name, as VTK and NumPy files hold them."""

from ...errors import FormatError
from .terms import COMPONENTS, NAMES, VECTORS

SYNONYMS = {  # names that say what they are, in small letters, for files that no one code wrote
    "position": ("position", "positions", "pos", "coordinates", "coords", "points", "x"),
    "velocity": ("velocity", "velocities", "vel", "v", "u"),
    "id": ("id", "ids", "particle_id", "particleid"),
    **{name: (name,) for name in ("mass", "volume", "radius", "diameter", "active", "time")},
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
    small = {name.lower(): name for name in reversed(arrays)}
    meant = {name: small[name] for name in NAMES if name in small and arrays[small[name]] == 1}
    for ours, words in SYNONYMS.items():
        components = 3 if ours in VECTORS else 1
        name = next((small[word] for word in words if word in small and arrays[small[word]] == components), None)
        if name is None:
            continue
        meant |= dict(zip(VECTORS.get(ours, (ours,)), column_names(name, components), strict=True))
    return meant


def require_whole(path, what, got, wanted):
    """Refuse an array that has other than the wanted number of values."""
    if got != wanted:
        raise FormatError(f"{path}: {what} holds {got} numbers, wanted {wanted}; it is truncated or damaged")
