"""How errors fall with the cell size: the order, what the reference itself is off by, where it stops paying."""

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
