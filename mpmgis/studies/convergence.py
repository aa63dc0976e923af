"""Fit errors to the cell size; find the Pareto front of settings and the best next refinement.

A time is given as the range of its repeats, (min, max) [s]. Two settings with overlapping ranges are a tie: neither
is faster. Errors are the same in every repeat.
"""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

LEAST_ORDER, MOST_ORDER = 0.2, 4.0  # [1] range in which the order is searched
FOLLOWED = 0.25  # [1] largest spread of the logarithms for which errors follow a power law
PAYING = 0.75  # [1] ratio of errors after halving the cells, above which refinement is not worthwhile
NEAR_FRONT = 1.5  # [1] largest time ratio to the front at which a setting counts as on it
LEAST_FALL = 0.05  # [1] smallest relative reduction of the error that counts as more accurate


class Law(NamedTuple):
    """Power law of the error: error = factor * cell size ** order.

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
        """Return the error on cells of a size.

        Parameters
        ----------
        cell_size : float [m]
        """
        return self.factor * cell_size**self.order

    def cell_size(self, error: float) -> float:
        """Return the cell size [m] that gives an error.

        Parameters
        ----------
        error : float
        """
        return (error / self.factor) ** (1.0 / self.order)


def fitted(cell_sizes: np.ndarray, errors: np.ndarray, finest: float = 0.0) -> Law | None:
    """Fit the Law to errors that were measured against a run on finer cells, or against an exact solution.

    Such an error is factor * (dx^p - finest^p) for equal kinds of error in reference and run, and
    factor * sqrt(dx^2p + finest^2p) for independent errors; the better fit is used.

    Parameters
    ----------
    cell_sizes : float64[n] [m]
    errors : float64[n]
    finest : float [m]
        Cell size of the reference; 0 for an exact solution.

    Returns
    -------
    Law or None
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
    """Return the Law with the best fit of `shape(order)` to `errors`."""

    def residual(order):
        return np.log(errors) - np.log(shape(order))

    found = minimize_scalar(lambda order: np.var(residual(order)), bounds=(LEAST_ORDER, MOST_ORDER), method="bounded")
    return Law(float(np.exp(residual(found.x).mean())), float(found.x), float(np.sqrt(found.fun)), independent)


def stops_paying(cell_sizes: np.ndarray, errors: np.ndarray) -> float | None:
    """Return the cell size below which refinement is not worthwhile: halving reduces the error by less than a quarter.

    Parameters
    ----------
    cell_sizes : float64[n] [m]
    errors : float64[n]

    Returns
    -------
    float [m] or None
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
    """Return whether setting i is faster than setting j, beyond the range of both.

    Parameters
    ----------
    spreads : float64[n, 2] [s]
        Smallest and largest time of each setting.

    Returns
    -------
    bool[n, n]
    """
    least, most = np.asarray(spreads, float).reshape(-1, 2).T
    return most[:, None] < least[None, :]


def ties(spreads: np.ndarray) -> np.ndarray:
    """Return whether neither of two settings is faster; the diagonal is False.

    Parameters
    ----------
    spreads : float64[n, 2] [s]
        Smallest and largest time of each setting.

    Returns
    -------
    bool[n, n]
    """
    first = faster(spreads)
    return ~(first | first.T | np.eye(len(first), dtype=bool))


def on_front(spreads: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Return which settings are on the Pareto front.

    For these no other setting is as accurate and faster, or more accurate and as fast.

    Parameters
    ----------
    spreads : float64[n, 2] [s]
        Smallest and largest time of each setting.
    errors : float64[n]

    Returns
    -------
    bool[n]
    """
    e, first = np.asarray(errors, float), faster(spreads)
    beaten = (first & (e[:, None] <= e[None, :])) | (~first.T & (e[:, None] < e[None, :]))
    return np.isfinite(e) & ~beaten.any(axis=0)


def time_over_front(seconds: np.ndarray, spreads: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Return the time of each setting over that of the fastest one that is at least as accurate.

    Parameters
    ----------
    seconds : float64[n] [s]
    spreads : float64[n, 2] [s]
        Smallest and largest time of each setting.
    errors : float64[n]

    Returns
    -------
    float64[n] [1]
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

    Parameters
    ----------
    parameter : str
    setting : str
        Name and new value as text.
    time, error : float [1]
        Ratios of the new setting to the scene; `time` is 1 for a tie.
    pays : float
        Logarithm of the error reduction over that of the time increase; infinite if the time does not increase.
    least, most : float
        Range of `pays` from the ranges of both times.
    """

    parameter: str
    setting: str
    time: float
    error: float
    pays: float
    least: float
    most: float


def gains(base: tuple, others: Iterable[tuple]) -> list[Gain]:
    """Return the gains of settings over the scene, best first.

    Only those that reduce the error by at least LEAST_FALL are gains.

    Parameters
    ----------
    base : (float [s], (float, float) [s], float)
        Time, its range, and error of the scene.
    others : iterable of (str, str, float [s], (float, float) [s], float)
        Parameter, setting, time, its range, and error of each setting.
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


def best_gains(found: list[Gain]) -> list[Gain]:
    """Return the best gain, and all that are a tie with it within the range of `pays`.

    Parameters
    ----------
    found : list of Gain
        Sorted, at least one.
    """
    return [gain for gain in found if gain is found[0] or gain.most >= found[0].least]


def _pays(time, ratio):
    if time <= 1.0:
        return math.inf
    return -math.log(max(ratio, 1e-300)) / math.log(time)
