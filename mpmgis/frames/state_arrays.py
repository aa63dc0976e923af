"""Arrays of a solver that its steps change: how they are made, grow, and enter the state of a restart.

They are the fields of a record, which compiled loops take. The annotation of a field is the table of its array: type,
shape, and its name in the state of a frame.
"""

from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, NamedTuple, TypeVar, get_origin, get_type_hints

import numpy as np

PARTICLES = "particles"  # size of a shape: rows of particles, for which there is room
REAL = "real"  # type of an array: the precision of the particles

Arrays = TypeVar("Arrays", bound=NamedTuple)


class StateArray(NamedTuple):
    """One array of the state of a solver.

    Parameters
    ----------
    dtype : NumPy type
        REAL: the precision of the particles.
    shape : tuple of int and str
        Lengths; a str is the name of a length that the run decides.
    kept : str
        Its name in the state of a frame, which holds all of it; "": particles, or an array of which it has parts.
    on_device : bool
        Steps on a device change it.
    """

    dtype: Any
    shape: tuple[int | str, ...]
    kept: str = ""
    on_device: bool = True


@cache
def array_table(record: type) -> dict[str, StateArray]:
    """Return the StateArray of each field of a record, in their order.

    Parameters
    ----------
    record : class
        NamedTuple whose fields are annotated with a StateArray.
    """
    hints = get_type_hints(record, include_extras=True)
    return {name: hint.__metadata__[0] for name, hint in hints.items() if get_origin(hint) is Annotated}


def made_arrays(record: type[Arrays], real: Any, sizes: Mapping[str, int]) -> Arrays:
    """Make the arrays of a record, all zero.

    Parameters
    ----------
    record : class
    real : NumPy type
        Precision of the particles.
    sizes : Mapping
        Lengths that the run decides, by name.
    """
    arrays = []
    for array in array_table(record).values():
        shape = [sizes[length] if isinstance(length, str) else length for length in array.shape]
        arrays.append(np.zeros(shape, real if array.dtype is REAL else array.dtype))
    return record(*arrays)


def grown_arrays(arrays: Arrays, rows: int) -> Arrays:
    """Return a record whose arrays of particles have more rows; new rows are zero.

    Parameters
    ----------
    arrays : NamedTuple
    rows : int
        Number of rows.
    """
    grown = {}
    for name, array in array_table(type(arrays)).items():
        if array.shape[0] == PARTICLES:
            values = getattr(arrays, name)
            more = np.zeros((rows - len(values), *values.shape[1:]), values.dtype)
            grown[name] = np.concatenate([values, more])
    return arrays._replace(**grown)
