"""Results of a calibration: best run, intervals, identifiability and checks, with significant digits only."""

import math
from dataclasses import dataclass

import numpy as np

from .calibration_posterior import INTERVAL, Posterior, SelfTest, identified_directions, shares_of_scores

IDENTIFIED = 0.5  # [1] standard deviation of the posterior over that of the prior, up to which a key is identified
BARELY = 0.9  # [1] the same, up to which it is partly identified
TRADE_OFF = 0.6  # [1] absolute correlation from which a trade-off is reported
SMALL_SAMPLE = 200  # effective draws below which the intervals are reported as rough
DIGITS = 2  # significant digits of the width of an interval
HUNDREDTHS = 0.1  # width with which `rounded` gives two decimals
AT_END = 1.64  # [1] normal score beyond which a median is at an end of the prior (outer 5 %)
FITS = 2.0  # [1] inflation above which the model is reported not to fit


@dataclass(frozen=True)
class Calibration:
    """A calibration.

    Parameters
    ----------
    priors : dict of str to Spread
    names : list of str
        Of the summaries.
    observed, variances : float64[k]
    values : float64[n, d]
        Parameters of the runs.
    simulated : float64[n, k]
    misfits : float64[n]
        Mean squared residual of each run in units of the errors.
    posterior : Posterior
    left_out : (float64[n, k], float64[n, k])
        Mean and variance of each run by the emulator without it.
    test : SelfTest or None
    """

    priors: dict
    names: list
    observed: np.ndarray
    variances: np.ndarray
    values: np.ndarray
    simulated: np.ndarray
    misfits: np.ndarray
    posterior: Posterior
    left_out: tuple
    test: SelfTest | None = None

    @property
    def best(self) -> int:
        """Index of the run with the smallest misfit."""
        return int(np.argmin(self.misfits))

    def values_of(self, scores: np.ndarray) -> np.ndarray:
        """Return the parameters of normal scores.

        Parameters
        ----------
        scores : float64[m, d]

        Returns
        -------
        float64[m, d]
        """
        shares = shares_of_scores(np.asarray(scores))
        columns = [[one.at(s) for s in column] for one, column in zip(self.priors.values(), shares.T, strict=True)]
        return np.array(columns).T

    def intervals(self) -> np.ndarray:
        """Return the 90 % interval and the median of each parameter.

        Returns
        -------
        float64[3, d]
            Lower end of the interval, median, upper end.
        """
        return self.values_of(self.posterior.quantiles((0.5 - INTERVAL / 2, 0.5, 0.5 + INTERVAL / 2)))

    def parameters(self) -> dict[str, dict]:
        """Return the figures of each key, rounded to two digits of the width of its interval."""
        low, middle, high = self.intervals()
        ratios = np.sqrt(np.diag(self.posterior.covariance))
        found = {}
        for k, (key, prior) in enumerate(self.priors.items()):
            width = high[k] - low[k]
            found[key] = {
                "best_fit": rounded(self.values[self.best, k], width),
                "median": rounded(middle[k], width),
                "interval_90": [rounded(low[k], width), rounded(high[k], width)],
                "prior": prior.text,
                "deviation_over_prior": rounded(ratios[k], HUNDREDTHS),
                "identified": identified_word(ratios[k]),
            }
        return found

    def trade_offs(self) -> list[dict]:
        """Return the pairs of keys whose posterior correlation is large."""
        covariance, keys = self.posterior.covariance, [*self.priors]
        deviations = np.sqrt(np.diag(covariance))
        correlation = covariance / np.outer(deviations, deviations)
        return [
            {"keys": [keys[i], keys[j]], "correlation": rounded(correlation[i, j], HUNDREDTHS)}
            for i in range(len(keys))
            for j in range(i + 1, len(keys))
            if abs(correlation[i, j]) >= TRADE_OFF
        ]

    def directions(self) -> list[dict]:
        """Return the combinations of the keys (weights of their normal scores), the best identified first."""
        return [
            {
                "weights": {key: rounded(w, HUNDREDTHS) for key, w in zip(self.priors, one.weights, strict=True)},
                "deviation_over_prior": rounded(one.ratio, HUNDREDTHS),
                "identified": identified_word(one.ratio),
            }
            for one in identified_directions(self.posterior)
        ]

    def emulator_covered(self) -> float:
        """Return the share of summaries of runs within the 90 % interval of the emulator without the run."""
        from scipy.special import ndtri

        mean, variance = self.left_out
        varies = variance > 0
        inside = np.abs(self.simulated - mean) <= ndtri(0.5 + INTERVAL / 2) * np.sqrt(variance)
        return float(inside[varies].mean()) if varies.any() else 1.0

    def record(self) -> dict:
        """Return the content of the JSON file."""
        test = None
        if self.test is not None:
            test = {
                "runs": len(self.test.ranks),
                "within_90": dict(zip(self.priors, np.round(self.test.covered, 2).tolist(), strict=True)),
                "p_uniform": dict(zip(self.priors, np.round(self.test.uniform, 3).tolist(), strict=True)),
            }
        return {
            "parameters": self.parameters(),
            "trade_offs": self.trade_offs(),
            "directions": self.directions(),
            "runs": len(self.values),
            "best_run_misfit": float(f"{self.misfits[self.best]:.2g}"),
            "effective_draws": round(self.posterior.effective_size),
            "inflation": float(f"{self.posterior.inflation:.2g}"),
            "emulator_within_90": round(self.emulator_covered(), 2),
            "self_test": test,
            "remarks": self.remarks(),
        }

    def remarks(self) -> list[str]:
        """Return what limits the result, one sentence each."""
        made = [
            f"{key}: the observations hardly constrain it; the interval is that of the prior"
            for key, one in self.parameters().items()
            if one["deviation_over_prior"] > BARELY
        ]
        made += [
            f"{' and '.join(one['keys'])} trade off (correlation {one['correlation']:g}): use pairs of samples.csv, "
            "not one value of each"
            for one in self.trade_offs()
        ]
        if len(self.observed) <= len(self.priors):
            made.append(
                f"{len(self.observed)} compared quantities for {len(self.priors)} parameters: whether the model fits "
                "cannot be checked; the intervals rely on the errors of the observations"
            )
        if self.posterior.inflation > FITS:
            made.append(
                "the model does not fit within the errors: even the best parameters leave "
                f"{self.posterior.inflation:.2g} times the variance; the intervals are widened by it"
            )
        if self.posterior.effective_size < SMALL_SAMPLE:
            made.append(f"only {self.posterior.effective_size:.0f} effective draws: the intervals are rough")
        made += [f"{key}: {text}" for key, text in self._at_ends()]
        return made

    def _at_ends(self):
        for key, middle in zip(self.priors, self.posterior.quantiles((0.5,))[0], strict=True):
            if abs(middle) > AT_END:
                end = "lower" if middle < 0 else "upper"
                yield key, f"the posterior lies at the {end} end of the prior; widen the prior"


def identified_word(ratio: float) -> str:
    """Return in a word how well a parameter is known.

    Parameters
    ----------
    ratio : float [1]
        Standard deviation of the posterior over that of the prior.
    """
    return "yes" if ratio <= IDENTIFIED else "partly" if ratio <= BARELY else "no"


def rounded(value: float, width: float) -> float:
    """Round a value to two digits of a width.

    Parameters
    ----------
    value, width : float
    """
    if not (math.isfinite(value) and width > 0):
        return float(value)
    return float(f"{round(float(value), DIGITS - 1 - math.floor(math.log10(width))):.10g}")
