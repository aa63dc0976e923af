"""Counter-based random numbers and the Halton sequence of seeding."""

import numpy as np

from ..compiled.jit import jit

_POSITIVE = 1 << 40  # added to cell indices, so that they can be taken as unsigned


@jit
def _mix(word: np.uint64) -> np.uint64:
    """Apply SplitMix64's finaliser: a bijection of 64-bit words that avalanches (Steele, Lea, Flood 2014)."""
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return word ^ (word >> np.uint64(31))


@jit
def uniform(seed: int, i: int, j: int, k: int) -> float:
    """Return a random number in [0, 1) that depends on nothing but its arguments: the same for any number of threads.

    Parameters
    ----------
    seed : int
        0 or more.
    i, j : int
        Indices of a cell, above -2^40.
    k : int
        Number of the draw in the cell, 0 or more.
    """
    word = _mix(np.uint64(seed) ^ np.uint64(0x9E3779B97F4A7C15))
    word = _mix(word ^ (np.uint64(i + _POSITIVE) * np.uint64(0xD1B54A32D192ED03)))
    word = _mix(word ^ (np.uint64(j + _POSITIVE) * np.uint64(0xABC98388FB8FAC03)))
    word = _mix(word ^ (np.uint64(k) * np.uint64(0x8CB92BA72F3D8DD7)))
    return np.float64(word >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@jit
def halton(index: int) -> tuple[float, float]:
    """Return a point of Halton's sequence: van der Corput's sequences in the bases 2 and 3.

    Parameters
    ----------
    index : int
        Number of the point, from 0.
    """
    bits, s, half = np.uint64(index), 0.0, 0.5
    while bits > np.uint64(0):
        if bits & np.uint64(1):
            s += half
        bits >>= np.uint64(1)
        half *= 0.5
    digits, t, third = np.uint64(index), 0.0, 1.0 / 3.0
    while digits > np.uint64(0):
        rest = digits // np.uint64(3)
        t += third * np.float64(digits - np.uint64(3) * rest)
        digits = rest
        third *= 1.0 / 3.0
    return s, t
