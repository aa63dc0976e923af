"""Gaussian process emulator: summaries of runs as functions of their parameters, with the error of the interpolation.

Each output has its own process with a constant mean, a Matern 5/2 correlation with one length per parameter, and a
nugget (Rasmussen & Williams 2006, chapters 2, 4.2 and 5.4). Lengths and nugget maximise the likelihood; the mean is
that of the runs and the variance is profiled out.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

LENGTHS = (0.05, 20.0)  # [1] allowed correlation lengths, of parameters scaled to 0..1
NUGGETS = (1e-6, 1.0)  # [1] allowed nuggets, relative to the variance of the process
STARTS = ((0.5, 1e-3), (2.0, 1e-2))  # of the optimisation: (length, nugget)
FLAT = 1e-12  # [1] relative spread below which an output counts as constant
FEWEST = 8  # number of runs that an emulator needs at least


def matern(first: np.ndarray, second: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Return Matern 5/2 correlations between two sets of points.

    Parameters
    ----------
    first : float64[n, d]
    second : float64[m, d]
    lengths : float64[d]

    Returns
    -------
    float64[n, m]
    """
    gap = (first[:, None, :] - second[None, :, :]) / lengths
    distance = np.sqrt(5.0 * np.einsum("ijk,ijk->ij", gap, gap))
    return (1.0 + distance + distance**2 / 3.0) * np.exp(-distance)


@dataclass(frozen=True)
class Process:
    """A fitted process of one output.

    Parameters
    ----------
    points : float64[n, d]
        Parameters of the runs, scaled to 0..1.
    values : float64[n]
    lengths : float64[d]
    nugget : float
        Relative to the variance of the process.
    """

    points: np.ndarray
    values: np.ndarray
    lengths: np.ndarray
    nugget: float

    @classmethod
    def fitted(cls, points: np.ndarray, values: np.ndarray) -> "Process":
        """Fit the lengths and the nugget by the largest likelihood.

        Parameters
        ----------
        points : float64[n, d]
            Parameters of the runs, scaled to 0..1.
        values : float64[n]
        """
        from scipy import optimize

        count = points.shape[1]
        if _flat(values):
            return cls(points, values, np.ones(count), NUGGETS[0])
        bounds = [tuple(np.log(LENGTHS))] * count + [tuple(np.log(NUGGETS))]
        found = [
            optimize.minimize(
                lambda logs: cls(points, values, np.exp(logs[:-1]), float(np.exp(logs[-1])))._cost(),
                [np.log(length)] * count + [np.log(nugget)],
                jac=True,
                method="L-BFGS-B",
                bounds=bounds,
                options={"maxiter": 40},
            )
            for length, nugget in STARTS
        ]
        best = min(found, key=lambda one: one.fun).x
        return cls(points, values, np.exp(best[:-1]), float(np.exp(best[-1])))

    def without(self, k: int) -> "Process":
        """Return the same process without one run; lengths and nugget remain.

        Parameters
        ----------
        k : int
            Index of the run.
        """
        return Process(np.delete(self.points, k, 0), np.delete(self.values, k), self.lengths, self.nugget)

    def at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Predict runs with other parameters; the variance includes the nugget.

        Parameters
        ----------
        points : float64[m, d]
            Scaled to 0..1.

        Returns
        -------
        mean, variance : float64[m]
        """
        if _flat(self.values):
            return np.full(len(points), self.values[0]), np.zeros(len(points))
        _, weights, variance = self._solved
        cross = matern(points, self.points, self.lengths)
        mean = self.values.mean() + cross @ weights
        taken = cross @ self._inverse_factor.T
        share = 1.0 + self.nugget - np.einsum("ij,ij->i", taken, taken)
        return mean, variance * np.maximum(share, self.nugget)

    def left_out(self) -> tuple[np.ndarray, np.ndarray]:
        """Predict each run from all others, in closed form (Rasmussen & Williams 2006, 5.12).

        Returns
        -------
        mean, variance : float64[n]
        """
        if _flat(self.values):
            return self.values.copy(), np.zeros(len(self.values))
        _, weights, variance = self._solved
        inverse = np.sum(self._inverse_factor**2, axis=0)
        return self.values - weights / inverse, variance / inverse

    @cached_property
    def _inverse_factor(self):
        from scipy.linalg import solve_triangular

        return solve_triangular(self._solved[0], np.eye(len(self.values)), lower=True)

    @cached_property
    def _solved(self):
        """Cholesky factor of the correlations, their inverse times the values, and variance of the process."""
        from scipy.linalg import cho_solve

        correlation = matern(self.points, self.points, self.lengths)
        correlation[np.diag_indices_from(correlation)] += self.nugget
        factor = np.linalg.cholesky(correlation)
        centred = self.values - self.values.mean()
        weights = cho_solve((factor, True), centred)
        return factor, weights, float(centred @ weights) / len(centred)

    def _cost(self):
        """Return (cost, its gradient by the logarithms of lengths and nugget).

        The cost is the negative logarithm of the likelihood without constants (Rasmussen & Williams 2006, equation
        5.9), with the variance at its best value.
        """
        factor, weights, variance = self._solved
        cost = 0.5 * len(self.values) * np.log(variance) + np.log(np.diag(factor)).sum()
        inner = 0.5 * (self._inverse_factor.T @ self._inverse_factor - np.outer(weights, weights) / variance)
        gap = ((self.points[:, None, :] - self.points[None, :, :]) / self.lengths) ** 2
        distance = np.sqrt(5.0 * gap.sum(axis=2))
        slope = inner * (5.0 / 3.0) * (1.0 + distance) * np.exp(-distance)
        return cost, np.r_[np.tensordot(slope, gap, axes=2), self.nugget * np.trace(inner)]


def _flat(values):
    return bool(np.ptp(values) <= FLAT * max(1.0, float(np.abs(values).max(initial=0.0))))


@dataclass(frozen=True)
class Emulator:
    """Emulator of all summaries.

    Parameters
    ----------
    processes : tuple of Process
        One for each summary.
    """

    processes: tuple

    @classmethod
    def fitted(cls, points: np.ndarray, summaries: np.ndarray) -> "Emulator":
        """Fit a process to each summary.

        Parameters
        ----------
        points : float64[n, d]
            Parameters of the runs, scaled to 0..1.
        summaries : float64[n, k]
        """
        return cls(tuple(Process.fitted(points, column) for column in summaries.T))

    def without(self, k: int) -> "Emulator":
        """Return the same emulator without one run.

        Parameters
        ----------
        k : int
            Index of the run.
        """
        return Emulator(tuple(process.without(k) for process in self.processes))

    def at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Predict runs with other parameters.

        Parameters
        ----------
        points : float64[m, d]
            Scaled to 0..1.

        Returns
        -------
        means, variances : float64[m, k]
        """
        means, variances = zip(*(process.at(points) for process in self.processes), strict=True)
        return np.column_stack(means), np.column_stack(variances)

    def left_out(self) -> tuple[np.ndarray, np.ndarray]:
        """Predict each run from all others.

        Returns
        -------
        means, variances : float64[n, k]
        """
        means, variances = zip(*(process.left_out() for process in self.processes), strict=True)
        return np.column_stack(means), np.column_stack(variances)
