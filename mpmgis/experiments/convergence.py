"""Errors against the cell size, the Pareto front of settings, and the best next refinement.

A time is given as the spread of its repeats, (least, most) [s]. Two settings whose spreads overlap are a tie: neither
is quicker. Errors are the same in every repeat.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

LEAST_ORDER, MOST_ORDER = 0.2, 4.0
FOLLOWED = 0.25  # spread of the logarithms above which errors follow no law
PAYING = 0.75  # an error that halving the cells leaves this share of, or more, hardly falls


class Law(NamedTuple):
    """error = factor * cell size ** order.

    Parameters
    ----------
    factor : float
        [unit of the error, m-order]
    order : float
    spread : float
        Of the logarithms of the errors about the law.
    independent : bool
        The reference's own error is independent of the others' (grains of noise), so that squares add up; else it is
        the same error, only smaller, which an error against the reference lacks (Richardson).
    """

    factor: float
    order: float
    spread: float
    independent: bool = False

    def error(self, cell_size):
        """Error at `cell_size` [m]."""
        return self.factor * cell_size**self.order

    def cell_size(self, error):
        """Cell size [m] at which the error is `error`."""
        return (error / self.factor) ** (1.0 / self.order)


def fitted(cell_sizes, errors, finest=0.0):
    """The Law behind `errors` on `cell_sizes` [m], which were taken against a run on cells of `finest` [m].

    Such an error is factor * (dx^p - finest^p) where reference and run err alike, factor * sqrt(dx^2p + finest^2p)
    where they err independently; the form that fits better is taken. `finest` = 0 is an exact answer. None from fewer
    than two errors above 0, or if they follow no law.
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
    """The Law whose `shape(order)` comes nearest to `errors`."""

    def off(order):
        return np.log(errors) - np.log(shape(order))

    found = minimize_scalar(lambda order: np.var(off(order)), bounds=(LEAST_ORDER, MOST_ORDER), method="bounded")
    return Law(float(np.exp(off(found.x).mean())), float(found.x), float(np.sqrt(found.fun)), independent)


def stops_paying(cell_sizes, errors):
    """The cell size [m] below which smaller cells hardly help: half the size takes less than a quarter off.

    None where it falls as far as was looked.
    """
    order = np.argsort(cell_sizes)[::-1]
    dx, e = np.asarray(cell_sizes, float)[order], np.asarray(errors, float)[order]
    for k in range(len(dx) - 1):
        if e[k] > 0.0 and dx[k + 1] < dx[k]:
            per_halving = (e[k + 1] / e[k]) ** (np.log(2.0) / np.log(dx[k] / dx[k + 1]))
            if per_halving > PAYING:
                return float(dx[k])
    return None


NEAR_FRONT = 1.5  # a setting whose time is within this factor of the front's at its error is as good as on it
LEAST_FALL = 0.05  # of the error, below which a setting counts as no more right than the scene's


def quicker(spreads):
    """bool[n, n]: setting i takes less time than setting j, beyond the spread of both."""
    least, most = np.asarray(spreads, float).reshape(-1, 2).T
    return most[:, None] < least[None, :]


def ties(spreads):
    """bool[n, n]: neither of the two settings is quicker; the diagonal is False."""
    first = quicker(spreads)
    return ~(first | first.T | np.eye(len(first), dtype=bool))


def on_front(spreads, errors):
    """bool[n]: no other setting is as right and quicker, or more right and as quick."""
    e, first = np.asarray(errors, float), quicker(spreads)
    beaten = (first & (e[:, None] <= e[None, :])) | (~first.T & (e[:, None] < e[None, :]))
    return np.isfinite(e) & ~beaten.any(axis=0)


def time_over_front(seconds, spreads, errors):
    """float64[n]: time of each setting over that of the quickest one which is at least as right.

    1 on the front, and where that one is a tie.
    """
    t, e, first = np.asarray(seconds, float), np.asarray(errors, float), quicker(spreads)
    over = np.full(len(t), np.nan)
    for k in np.flatnonzero(np.isfinite(e)):
        better = first[:, k] & (e <= e[k])
        over[k] = t[k] / t[better].min() if better.any() else 1.0
    return over


class Gain(NamedTuple):
    """What turning one knob from the scene's value brings.

    setting: what is set to what, in words; time, error: those of the new setting over the scene's [1], `time` 1 where
    they are a tie; pays: logarithm of the error's fall over that of the time's growth, infinite where the time does not
    grow; least, most: of `pays`, by the spread of both times.
    """

    knob: str
    setting: str
    time: float
    error: float
    pays: float
    least: float
    most: float


def gains(base, others):
    """Gains of the `others`, (knob, setting, seconds, spread, error) each, over `base`, (seconds, spread, error).

    Only of those whose error is smaller by LEAST_FALL and more; best first.
    """
    found, (whole, (base_least, base_most), base_error) = [], base
    for knob, setting, seconds, (least, most), error in others:
        ratio = error / base_error if base_error > 0.0 else math.inf
        if not ratio <= 1.0 - LEAST_FALL:
            continue
        tie = least <= base_most and base_least <= most
        time = 1.0 if tie else seconds / whole
        ends = (1.0, 1.0) if tie else (most / base_least, least / base_most)
        found.append(Gain(knob, setting, time, ratio, _pays(time, ratio), *(_pays(end, ratio) for end in ends)))
    return sorted(found, key=lambda gain: (-gain.pays, gain.error))


def alike(found):
    """The first of the sorted Gains `found` and all whose `pays` its own does not exceed beyond the spread."""
    return [gain for gain in found if gain is found[0] or gain.most >= found[0].least]


def _pays(time, ratio):
    if time <= 1.0:
        return math.inf
    return -math.log(max(ratio, 1e-300)) / math.log(time)
