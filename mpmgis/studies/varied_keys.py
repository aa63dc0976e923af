"""Values of a varied key of a scene: a choice or a distribution, and the text that gives it."""

import difflib
import math
from functools import lru_cache
from typing import NamedTuple

from ..system.errors import InputError

FORMS = "LOW:HIGH, A,B,C, normal:MEAN:SD, lognormal:MEAN:SD (each also :LOW:HIGH to cut it), triangular:LOW:MODE:HIGH"
COUNTS = {"uniform": (2,), "normal": (2, 4), "lognormal": (2, 4), "triangular": (3,)}  # numbers after the name
LEAST_SHARE = 2.0**-53  # [1] smallest share with a finite value of a normal distribution
DIGITS = 10  # significant digits of a sampled number, so that the table of members has its exact value


class Choice(NamedTuple):
    """A choice among equally likely values.

    Parameters
    ----------
    values : tuple
    text : str
        The user's input.
    """

    values: tuple
    text: str

    def at(self, share: float) -> object:
        """Return a quantile.

        Parameters
        ----------
        share : float [1]
            In 0..1.
        """
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]

    def levels(self, count: int) -> tuple:
        """Return all values.

        Parameters
        ----------
        count : int
            Not used.
        """
        return self.values


class Spread(NamedTuple):
    """A distribution, truncated if limits are given.

    Mean and standard deviation are those of the variable itself before truncation, also for a lognormal one.

    Parameters
    ----------
    name : str
        Key of COUNTS.
    parameters : tuple of float
    low, high : float or None
        Limits.
    text : str
        The user's input.
    """

    name: str
    parameters: tuple
    low: float | None
    high: float | None
    text: str

    def at(self, share: float) -> float:
        """Return a quantile, rounded to 10 digits.

        Parameters
        ----------
        share : float [1]
            In 0..1.
        """
        law = _law(self)
        share = min(max(float(share), LEAST_SHARE), 1.0 - LEAST_SHARE)
        if self.low is not None:
            below, upto = law.cdf(self.low), law.cdf(self.high)
            return _rounded(min(max(float(law.ppf(below + (upto - below) * share)), self.low), self.high))
        return _rounded(float(law.ppf(share)))

    def share_of(self, value: float) -> float:
        """Return the share (0 to 1) of the distribution below a value: the inverse of `at`.

        Parameters
        ----------
        value : float
        """
        law, share = _law(self), float(_law(self).cdf(value))
        if self.low is not None:
            below, upto = law.cdf(self.low), law.cdf(self.high)
            share = (share - below) / (upto - below)
        return min(max(float(share), 0.0), 1.0)

    def levels(self, count: int) -> tuple:
        """Return the medians of equally likely intervals, for a grid.

        Parameters
        ----------
        count : int
            Number of intervals.
        """
        return tuple(self.at((k + 0.5) / count) for k in range(count))


@lru_cache(maxsize=64)
def _law(spread):
    """Return the SciPy distribution of a Spread, before truncation."""
    from scipy import stats

    if spread.name == "uniform":
        low, high = spread.parameters
        return stats.uniform(low, high - low)
    if spread.name == "triangular":
        low, mode, high = spread.parameters
        return stats.triang((mode - low) / (high - low), low, high - low)
    mean, deviation = spread.parameters
    if spread.name == "normal":
        return stats.norm(mean, deviation)
    variance = math.log1p((deviation / mean) ** 2)  # of the logarithm
    return stats.lognorm(math.sqrt(variance), scale=mean * math.exp(-0.5 * variance))


def variation(asked: object, where: str) -> Choice | Spread:
    """Read the values of a varied key.

    Parameters
    ----------
    asked : str, sequence or value
        Text as in FORMS, a list of values, or one value.
    where : str
        Origin, for messages.

    Raises
    ------
    InputError
        Other text, or numbers that make no distribution.
    """
    if isinstance(asked, (list, tuple)):
        return _choice(tuple(asked), ",".join(map(str, asked)), where)
    if not isinstance(asked, str):
        return _choice((asked,), str(asked), where)
    text = asked.strip()
    head, colon, rest = text.partition(":")
    if colon and head in COUNTS:
        return _spread(head, rest.split(":"), text, where)
    if colon and _number(head) is not None:
        return _spread("uniform", text.split(":"), text, where)
    if rest and len(head) > 1 and all(_number(part) is not None for part in rest.split(":")):
        close = difflib.get_close_matches(head, COUNTS, 1)
        meant = f" (did you mean {close[0]}?)" if close else ""
        raise InputError(f"{where}: unknown distribution {head!r}{meant}; expected {FORMS}")
    return _choice(tuple(_value(part.strip()) for part in text.split(",")), text, where)


def _choice(values, text, where):
    if not values or "" in values:
        raise InputError(f"{where}: got {text!r}, expected {FORMS}")
    return Choice(values, text)


def _spread(name, parts, text, where):
    numbers = [_number(part) for part in parts]
    if None in numbers or len(numbers) not in COUNTS[name]:
        raise InputError(f"{where}: got {text!r}, expected {FORMS}")
    cut = numbers[2:] if name in ("normal", "lognormal") else []
    parameters = tuple(numbers[: len(numbers) - len(cut)])
    _require_possible(name, parameters, cut, f"{where}: {text}")
    made = Spread(name, parameters, *(cut or (None, None)), text)
    if cut and not _law(made).cdf(cut[1]) - _law(made).cdf(cut[0]) > 1e-12:
        raise InputError(f"{where}: {text} has no probability between {cut[0]:g} and {cut[1]:g}; widen them")
    return made


def _require_possible(name, parameters, cut, where):
    """Raise InputError for invalid parameters of a distribution."""
    if name in ("normal", "lognormal"):
        mean, deviation = parameters
        if deviation <= 0 or (name == "lognormal" and mean <= 0):
            also = " and a mean above 0" if name == "lognormal" else ""
            raise InputError(f"{where}: expected a standard deviation above 0{also}")
    ordered = cut or (parameters if name in ("uniform", "triangular") else ())
    if ordered and not (ordered[0] < ordered[-1] and list(ordered) == sorted(ordered)):
        raise InputError(f"{where}: expected {'LOW below MODE below HIGH' if len(ordered) == 3 else 'LOW below HIGH'}")


def _number(text):
    """Return a finite float, or None."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _value(text):
    """Return the value of a list item: boolean, integer, float, else text."""
    if text in ("true", "false"):
        return text == "true"
    try:
        return int(text)
    except ValueError:
        number = _number(text)
        return text if number is None else number


def _rounded(value):
    return float(f"{value:.{DIGITS}g}")
