"""Shapes of arrays with particles: which axis counts the particles, which the components, and which the times.

One rule for all formats with arrays of any shape. Rows or columns of particles: (n,), (n, 1), (1, n), (n, k), (k, n);
and recordings of T times in one array: (T, n), (T, n, k), (T, k, n) and their other orders, which the lengths of other
arrays (times, masses) tell.
"""

import itertools
from collections.abc import Collection
from functools import lru_cache
from typing import NamedTuple

import numpy as np

MOST_AXES = 4  # of an array with particles; one of them may have length 1
MOST_COMPONENTS = 100  # of an array with a row per particle
TIME, ROW, COMPONENT, SINGLE = "trc1"  # roles of an axis; a single one has length 1
MOST_SHAPES = 4096  # whose views are kept


class View(NamedTuple):
    """One meaning of the axes of an array.

    Attributes
    ----------
    roles : str
        One letter of TIME, ROW, COMPONENT, SINGLE for each axis.
    rows, components : int
    times : int or None
        None for an array of one time.
    """

    roles: str
    rows: int
    components: int
    times: int | None


@lru_cache(maxsize=MOST_SHAPES)
def _views(shape: tuple[int, ...]) -> tuple[View, ...]:
    """Return all meanings of the axes; exactly one axis counts particles."""
    if not 0 < len(shape) <= MOST_AXES or 0 in shape:
        return ()
    found = []
    for roles in itertools.product((TIME, ROW, COMPONENT, SINGLE), repeat=len(shape)):
        lengths = {role: length for role, length in zip(roles, shape, strict=True) if role != SINGLE}
        sound = all((role == SINGLE) <= (length == 1) for role, length in zip(roles, shape, strict=True))
        if not sound or len(lengths) + roles.count(SINGLE) != len(shape) or ROW not in lengths:
            continue
        components, times = lengths.get(COMPONENT, 0), lengths.get(TIME)
        if components != 1 and times != 1 and components <= MOST_COMPONENTS:
            found.append(View("".join(roles), lengths[ROW], components or 1, times))
    return tuple(found)


def first_view(
    shape: tuple[int, ...],
    width: int | None,
    row_counts: Collection[int] = (),
    time_counts: Collection[int] = (),
    least: int = 1,
    column_major: bool = False,
) -> View | None:
    """Return the meaning of the axes of the array that gives the number of particles.

    The lengths of other arrays decide. Without them: one time before several, the components on the last axis of their
    number, the times on the first of the others.

    Parameters
    ----------
    shape : tuple of int
    width : int or None
        Number of components; None for any.
    row_counts, time_counts : collection of int
        Lengths of other arrays with particles, and of arrays of times.
    least : int
        Smallest number of components.
    column_major : bool
        The file has the axes in reverse order, as of MATLAB: of several axes the first has the components.

    Returns
    -------
    View or None
        None where the array cannot have that many components.
    """

    def rank(view: View) -> tuple:
        if view.times is None:
            in_time = 1 if time_counts else 0
        else:
            in_time = 0 if view.times in time_counts else 2
        rows = bool(row_counts) and view.rows not in row_counts
        place = view.roles.find(COMPONENT)
        return in_time, rows, place if column_major else -place, view.roles.find(TIME)

    found = [view for view in _views(shape) if view.components == (width or view.components) >= least]
    return min(found, key=rank, default=None)


def fitting_view(shape: tuple[int, ...], first: View, width: int | None = None) -> View | None:
    """Return the meaning of the axes of an array of the same particles as another one.

    Parameters
    ----------
    shape : tuple of int
    first : View
        Of the positions.
    width : int, optional
        Usual number of components of the quantity.

    Returns
    -------
    View or None
        None where the array has no row for each of these particles.
    """

    def rank(view: View) -> tuple:
        unusual = width is not None and view.components != width
        return unusual, first.times is not None and view.times is None, _turned(view.roles, first.roles)

    found = [view for view in _views(shape) if view.rows == first.rows and view.times in (None, first.times)]
    return min(found, key=rank, default=None)


def _turned(roles: str, others: str) -> int:
    """Return how many pairs of axes are in another order in `others`."""
    pairs = ((ROW, COMPONENT), (TIME, ROW), (TIME, COMPONENT))
    both = [(a, b) for a, b in pairs if {a, b} <= set(roles) and {a, b} <= set(others)]
    return sum((roles.find(a) < roles.find(b)) != (others.find(a) < others.find(b)) for a, b in both)


def length_of_vector(shape: tuple[int, ...]) -> int | None:
    """Return the length of an array with at most one axis longer than 1; None for others.

    Parameters
    ----------
    shape : tuple of int
    """
    long = [length for length in shape if length != 1]
    return None if len(long) > 1 or 0 in shape else (long or [1])[0]


def selection(view: View, frame: int) -> tuple[int | slice, ...]:
    """Return the index of the values of one time.

    Parameters
    ----------
    view : View
    frame : int
        Number of the time.
    """
    return tuple(frame if role == TIME else slice(None) for role in view.roles)


def as_rows(values: np.ndarray, view: View) -> np.ndarray:
    """Return the values of one time with a row per particle.

    Parameters
    ----------
    values : array
        As selected by `selection`.
    view : View

    Returns
    -------
    float64[rows, components]
    """
    roles = view.roles.replace(TIME, "")
    turned = COMPONENT in roles and roles.find(COMPONENT) < roles.find(ROW)
    values = np.asarray(values, np.float64)
    if turned:
        return np.ascontiguousarray(values.reshape(view.components, view.rows).T)
    return values.reshape(view.rows, view.components)
