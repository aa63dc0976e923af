"""Errors against the cell size, the Pareto front of settings, and the best next refinement.

A time is given as the range of its repeats, (min, max) [s]. Two settings with overlapping ranges are a tie: neither
is faster. Errors are the same in every repeat.
"""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

LEAST_ORDER, MOST_ORDER = 0.2, 4.0
FOLLOWED = 0.25  # largest spread of the logarithms for which errors follow a power law
PAYING = 0.75  # ratio of errors after halving the cells, above which refinement is not worthwhile
NEAR_FRONT = 1.5  # largest time ratio to the front at which a setting counts as on it
LEAST_FALL = 0.05  # smallest relative reduction of the error that counts as more accurate


class Law(NamedTuple):
    """error = factor * cell size ** order.

    Parameters
    ----------
    factor : float
        [unit of the error, m-order]
    order : float
    spread : float
        Of the logarithms of the errors around the law.
    independent : bool
        True: the error of the reference is independent of the others (noise), so that squares add. False: it is
        the same error, only smaller, and an error against the reference lacks it (Richardson).
    """

    factor: float
    order: float
    spread: float
    independent: bool = False

    def error(self, cell_size: float) -> float:
        """Error at `cell_size` [m]."""
        return self.factor * cell_size**self.order

    def cell_size(self, error: float) -> float:
        """Cell size [m] at which the error is `error`."""
        return (error / self.factor) ** (1.0 / self.order)


def fitted(cell_sizes: np.ndarray, errors: np.ndarray, finest: float = 0.0) -> Law | None:
    """The Law fitted to `errors` on `cell_sizes` [m], measured against a run on cells of `finest` [m].

    Such an error is factor * (dx^p - finest^p) for equal kinds of error in reference and run, and
    factor * sqrt(dx^2p + finest^2p) for independent errors; the better fit is used. `finest` = 0 is an exact solution.
    None for fewer than two errors above 0, or if they follow no power law.
    """
    dx, e = np.asarray(cell_sizes, float), np.asarray(errors, float)
    usable = np.isfinite(e) & (e > 0.0) & (dx > finest * (1.0 + 1e-9))
    dx, e = dx[usable], e[usable]
    if dx.size < 2:
        return None
    alike = _fitted(e, lambda p: dx**p - finest**p, False)
    if finest == 0.0 or dx.size < 3:
        best = alike
    else:
        best = min(alike, _fitted(e, lambda p: np.hypot(dx**p, finest**p), True), key=lambda law: law.spread)
    return best if best.spread < FOLLOWED and best.order > 1.01 * LEAST_ORDER else None


def _fitted(errors, shape, independent):
    """The Law with the best fit of `shape(order)` to `errors`."""

    def residual(order):
        return np.log(errors) - np.log(shape(order))

    found = minimize_scalar(lambda order: np.var(residual(order)), bounds=(LEAST_ORDER, MOST_ORDER), method="bounded")
    return Law(float(np.exp(residual(found.x).mean())), float(found.x), float(np.sqrt(found.fun)), independent)


def stops_paying(cell_sizes: np.ndarray, errors: np.ndarray) -> float | None:
    """The cell size [m] below which refinement is not worthwhile: halving reduces the error by less than a quarter.

    None if the error decreases over the whole range.
    """
    order = np.argsort(cell_sizes)[::-1]
    dx, e = np.asarray(cell_sizes, float)[order], np.asarray(errors, float)[order]
    for k in range(len(dx) - 1):
        if e[k] > 0.0 and dx[k + 1] < dx[k]:
            per_halving = (e[k + 1] / e[k]) ** (np.log(2.0) / np.log(dx[k] / dx[k + 1]))
            if per_halving > PAYING:
                return float(dx[k])
    return None


def faster(spreads: np.ndarray) -> np.ndarray:
    """bool[n, n]: setting i is faster than setting j, beyond the range of both."""
    least, most = np.asarray(spreads, float).reshape(-1, 2).T
    return most[:, None] < least[None, :]


def ties(spreads: np.ndarray) -> np.ndarray:
    """bool[n, n]: neither of the two settings is faster; the diagonal is False."""
    first = faster(spreads)
    return ~(first | first.T | np.eye(len(first), dtype=bool))


def on_front(spreads: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """bool[n]: Pareto front: no other setting is as accurate and faster, or more accurate and as fast."""
    e, first = np.asarray(errors, float), faster(spreads)
    beaten = (first & (e[:, None] <= e[None, :])) | (~first.T & (e[:, None] < e[None, :]))
    return np.isfinite(e) & ~beaten.any(axis=0)


def time_over_front(seconds: np.ndarray, spreads: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """float64[n]: time of each setting over that of the fastest one that is at least as accurate.

    1 on the front, and for a tie.
    """
    t, e, first = np.asarray(seconds, float), np.asarray(errors, float), faster(spreads)
    over = np.full(len(t), np.nan)
    for k in np.flatnonzero(np.isfinite(e)):
        better = first[:, k] & (e <= e[k])
        over[k] = t[k] / t[better].min() if better.any() else 1.0
    return over


class Gain(NamedTuple):
    """Gain from changing one parameter of the scene.

    setting: name and new value as text; time, error: ratios of the new setting to the scene [1], `time` 1 for a tie;
    pays: logarithm of the error reduction over that of the time increase, infinite if the time does not increase;
    least, most: range of `pays` from the ranges of both times.
    """

    parameter: str
    setting: str
    time: float
    error: float
    pays: float
    least: float
    most: float


def gains(base: tuple, others: Iterable[tuple]) -> list[Gain]:
    """Gains of the `others`, each (parameter, setting, seconds, spread, error), over `base` (seconds, spread, error).

    Only those that reduce the error by at least LEAST_FALL; best first.
    """
    found, (whole, (base_least, base_most), base_error) = [], base
    for parameter, setting, seconds, (least, most), error in others:
        ratio = error / base_error if base_error > 0.0 else math.inf
        if not ratio <= 1.0 - LEAST_FALL:
            continue
        tie = least <= base_most and base_least <= most
        time = 1.0 if tie else seconds / whole
        ends = (1.0, 1.0) if tie else (most / base_least, least / base_most)
        found.append(Gain(parameter, setting, time, ratio, _pays(time, ratio), *(_pays(end, ratio) for end in ends)))
    return sorted(found, key=lambda gain: (-gain.pays, gain.error))


def alike(found: list[Gain]) -> list[Gain]:
    """The first of the sorted Gains `found`, and all that are a tie with it within the range of `pays`."""
    return [gain for gain in found if gain is found[0] or gain.most >= found[0].least]


def _pays(time, ratio):
    if time <= 1.0:
        return math.inf
    return -math.log(max(ratio, 1e-300)) / math.log(time)
