"""Posterior of the parameters of a model, given observed summaries, their errors, and an emulator of the summaries.

Parameters are normal scores z: the standard normal quantile of the share that the prior has below a value. The prior
of z is standard normal for every prior of the parameters. The likelihood is normal, with the variance of the
observation plus that of the emulator (Kennedy & O'Hagan 2001). If even the best parameters leave larger residuals than
these, all variances are multiplied by the ratio (Birge 1932), so that a model that does not fit does not give narrow
intervals. The posterior is sampled by adaptive importance sampling (Cornuet et al. 2012).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .gaussian_process import Emulator

DRAWS = 4096  # in each round
ROUNDS = 4  # after the first one, which draws from the prior
DEFENSIVE = 0.2  # [1] share of later rounds that is drawn from the prior
WIDER = 1.5  # [1] variance of the proposal over that of the draws so far
INTERVAL = 0.90  # [1] share of the posterior within an interval
SMALLEST_VARIANCE = 1e-6  # [1] added to that of a proposal, so that it is not singular


@dataclass(frozen=True)
class Posterior:
    """A weighted sample of the posterior.

    Parameters
    ----------
    scores : float64[n, d]
        Normal scores z.
    weights : float64[n]
        Their sum is 1.
    inflation : float
        Factor of all variances, 1 where the model fits within the errors.
    """

    scores: np.ndarray
    weights: np.ndarray
    inflation: float

    @property
    def effective_size(self) -> float:
        """Effective number of draws (Kish 1965)."""
        return float(1.0 / np.sum(self.weights**2))

    def quantiles(self, shares: tuple) -> np.ndarray:
        """Return quantiles of the normal scores.

        Parameters
        ----------
        shares : tuple of float
            In 0..1.

        Returns
        -------
        float64[len(shares), d]
        """
        return np.column_stack([weighted_quantiles(column, self.weights, shares) for column in self.scores.T])

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the normal scores, float64[d, d]; that of the prior is the unit matrix."""
        return np.atleast_2d(np.cov(self.scores.T, aweights=self.weights, ddof=0))

    def drawn(self, count: int, seed: int) -> np.ndarray:
        """Draw normal scores by systematic resampling of the posterior, in random order.

        Parameters
        ----------
        count : int
        seed : int

        Returns
        -------
        float64[count, d]
        """
        source = np.random.default_rng(seed)
        places = (np.arange(count) + source.random()) / count
        order = np.argsort(self.scores[:, 0], kind="stable")
        chosen = order[np.minimum(np.searchsorted(np.cumsum(self.weights[order]), places), len(order) - 1)]
        return self.scores[source.permutation(chosen)]


def weighted_quantiles(values: np.ndarray, weights: np.ndarray, shares: tuple) -> np.ndarray:
    """Return quantiles of weighted values, linear between the middles of their weights.

    Parameters
    ----------
    values, weights : float64[n]
    shares : tuple of float
        In 0..1.

    Returns
    -------
    float64[len(shares)]
    """
    order = np.argsort(values)
    upto = np.cumsum(weights[order])
    return np.interp(shares, (upto - 0.5 * weights[order]) / upto[-1], values[order])


def shares_of_scores(scores: np.ndarray) -> np.ndarray:
    """Return the shares of the prior below normal scores.

    Parameters
    ----------
    scores : float64[...]

    Returns
    -------
    float64[...]
    """
    from scipy.special import ndtr

    return ndtr(scores)


def scores_of_shares(shares: np.ndarray) -> np.ndarray:
    """Return the normal scores of shares of the prior, which are kept away from 0 and 1.

    Parameters
    ----------
    shares : float64[...]

    Returns
    -------
    float64[...]
    """
    from scipy.special import ndtri

    return ndtri(np.clip(shares, 1e-12, 1 - 1e-12))


def posterior(
    predicted: Callable, observed: np.ndarray, variances: np.ndarray, count: int, seed: int = 0, draws: int = DRAWS
) -> Posterior:
    """Sample the posterior of the parameters.

    Parameters
    ----------
    predicted : callable
        (shares of the prior float64[n, count]) -> (means, variances) float64[n, k] of the summaries.
    observed, variances : float64[k]
        The summaries and the variances of their errors.
    count : int
        Number of parameters.
    seed : int
    draws : int
        In each round.
    """
    source = np.random.default_rng(seed)
    scores = source.standard_normal((draws, count))
    squares, logs = _misfit(predicted, observed, variances, scores)
    proposals = [_normal_density(scores, np.zeros(count), np.eye(count))]
    centres = [(np.zeros(count), np.eye(count))]
    inflation, weights = 1.0, None
    for number in range(ROUNDS + 1):
        inflation = _inflation(squares, len(observed) - count)
        weights = _weights(scores, squares, logs, inflation, proposals, centres)
        if number == ROUNDS:
            break
        middle = weights @ scores
        spread = np.atleast_2d(np.cov(scores.T, aweights=weights, ddof=0)) * WIDER
        spread += SMALLEST_VARIANCE * np.eye(count)
        more = source.multivariate_normal(middle, spread, draws)
        more[: int(DEFENSIVE * draws)] = source.standard_normal((int(DEFENSIVE * draws), count))
        new_squares, new_logs = _misfit(predicted, observed, variances, more)
        scores, squares, logs = np.vstack([scores, more]), np.r_[squares, new_squares], np.r_[logs, new_logs]
        centres.append((middle, spread))
        proposals = [_normal_density(scores, *centre) for centre in centres]
    return Posterior(scores, weights, inflation)


def _misfit(predicted, observed, variances, scores):
    """Return the sum of squared residuals over their variances, and of the logarithms of the variances, by draw."""
    means, errors = predicted(shares_of_scores(scores))
    total = errors + variances
    return np.sum((means - observed) ** 2 / total, axis=1), np.sum(np.log(total), axis=1)


def _inflation(squares, freedom):
    """Return Birge's factor of the variances: that of the best draw, at least 1."""
    return max(1.0, float(squares.min()) / freedom) if freedom > 0 else 1.0


def _normal_density(points, mean, covariance):
    from scipy import stats

    return np.atleast_1d(stats.multivariate_normal(mean, covariance).pdf(points))


def _weights(
    scores: np.ndarray, squares: np.ndarray, logs: np.ndarray, inflation: float, proposals: list, centres: list
) -> np.ndarray:
    """Return importance weights with the mixture of all proposals as the density of the draws; their sum is 1."""
    prior, later = proposals[0], proposals[1:]
    mixture = prior.copy()
    for density in later:
        mixture += (1.0 - DEFENSIVE) * density + DEFENSIVE * prior
    logs = -0.5 * (squares / inflation + logs) + np.log(np.maximum(prior, 1e-300)) - np.log(mixture / len(centres))
    weights = np.exp(logs - logs.max())
    return weights / weights.sum()


@dataclass(frozen=True)
class Direction:
    """A combination of parameters.

    Parameters
    ----------
    weights : float64[d]
        Of the normal scores.
    ratio : float
        Standard deviation of the posterior over that of the prior.
    """

    weights: np.ndarray
    ratio: float


def identified_directions(found: Posterior) -> list[Direction]:
    """Return the eigenvectors of the posterior covariance relative to the prior's, the best identified first.

    Parameters
    ----------
    found : Posterior
    """
    values, vectors = np.linalg.eigh(found.covariance)
    return [
        Direction(vectors[:, k] * np.sign(vectors[np.argmax(np.abs(vectors[:, k])), k]), float(np.sqrt(max(v, 0.0))))
        for k, v in enumerate(values)
    ]


@dataclass(frozen=True)
class SelfTest:
    """Calibration of runs as if each had been observed.

    For exact intervals the ranks are uniform (Talts et al. 2018).

    Parameters
    ----------
    ranks : float64[n, d]
        Of the own values of each run in its posterior, in 0..1.
    """

    ranks: np.ndarray

    @property
    def covered(self) -> np.ndarray:
        """Share of the runs whose own value is within its 90 % interval, float64[d]."""
        return np.mean(np.abs(self.ranks - 0.5) <= 0.5 * INTERVAL, axis=0)

    @property
    def uniform(self) -> np.ndarray:
        """P values of the test of Kolmogorov and Smirnov of the ranks against the uniform distribution, float64[d]."""
        from scipy import stats

        return np.array([stats.kstest(column, "uniform").pvalue for column in self.ranks.T])


def self_test(
    emulator: "Emulator",
    shares: np.ndarray,
    summaries: np.ndarray,
    variances: np.ndarray,
    chosen: np.ndarray,
    seed: int = 0,
) -> SelfTest:
    """Calibrate runs with an emulator that does not know them, and rank their own values in the posteriors.

    The errors of an observation are added to their summaries.

    Parameters
    ----------
    emulator : Emulator
    shares : float64[n, d]
        Parameters of the runs, as shares of the prior.
    summaries : float64[n, k]
        Of the runs.
    variances : float64[k]
        Of the errors of the observations.
    chosen : int[m]
        Indices of the runs that are tested.
    seed : int
    """
    source = np.random.default_rng(seed)
    ranks = []
    for k in chosen:
        observed = summaries[k] + np.sqrt(variances) * source.standard_normal(len(variances))
        found = posterior(emulator.without(k).at, observed, variances, shares.shape[1], seed, draws=512)
        below = found.scores < scores_of_shares(shares[k])
        ranks.append(found.weights @ below)
    return SelfTest(np.array(ranks))
