"""A loop and the kernels that it calls, which take a moment to compile."""

from typing import NamedTuple

import numpy as np

from mpmgis.compiled.jit import jit


class Limits(NamedTuple):
    """A record, as the loops of the solvers have them."""

    least: float
    most: float


@jit
def clipped(value: float, limits: Limits) -> float:
    """Called by `clip` alone."""
    return min(max(value, limits.least), limits.most)


@jit
def clip(values: np.ndarray, limits: Limits) -> None:
    for k in range(values.shape[0]):
        values[k] = clipped(values[k], limits)


@jit
def ends(values: np.ndarray) -> tuple[float, int]:
    return values[0], values.shape[0]


@jit
def halves(values):
    """Without annotations, and its type follows from its argument."""
    return values[: values.shape[0] // 2], values.dtype.type(0.5)


@jit
def scale(values: np.ndarray, factor: float) -> None:
    for k in range(values.shape[0]):
        values[k] *= factor


@jit
def loop(values: np.ndarray, limits: Limits, steps: int) -> float:
    first, count = ends(values)
    for _ in range(steps):
        clip(values, limits)
        half, factor = halves(values)
        scale(half, factor)
        scale(values, first + count)
    return values[0]
