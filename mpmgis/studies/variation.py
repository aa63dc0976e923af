"""What a key of a scene may be in many runs: one of some values, or a number of a distribution."""

import difflib
import math
from functools import lru_cache
from typing import NamedTuple

from ..errors import InputError

FORMS = "LOW:HIGH, A,B,C, normal:MEAN:SD, lognormal:MEAN:SD (each also :LOW:HIGH to cut it), triangular:LOW:MODE:HIGH"
COUNTS = {"uniform": (2,), "normal": (2, 4), "lognormal": (2, 4), "triangular": (3,)}  # of numbers after the name
LEAST_SHARE = 2.0**-53  # nearer to 0 and 1 a normal distribution has no finite value
DIGITS = 10  # of a drawn number: what the table of members shows is what ran


class Choice(NamedTuple):
    """One of `values`, all equally likely; `text` is how it was asked for."""

    values: tuple
    text: str

    def at(self, share):
        """The value below which `share` (0 to 1) of the probability lies."""
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]

    def levels(self, count):
        """All values, whatever the `count`."""
        return self.values


class Spread(NamedTuple):
    """A number of the distribution `name` with its `parameters`, cut to `low` and `high` where they are given.

    Mean and standard deviation are those of the number itself, also of a lognormal one, before it is cut.
    """

    name: str
    parameters: tuple
    low: float | None
    high: float | None
    text: str

    def at(self, share):
        """The value below which `share` (0 to 1) of the probability lies, rounded to 10 digits."""
        law = _law(self)
        share = min(max(float(share), LEAST_SHARE), 1.0 - LEAST_SHARE)
        if self.low is not None:
            below, upto = law.cdf(self.low), law.cdf(self.high)
            return _rounded(min(max(float(law.ppf(below + (upto - below) * share)), self.low), self.high))
        return _rounded(float(law.ppf(share)))

    def levels(self, count):
        """The middles of `count` parts that are equally likely: on a grid each level stands for as much."""
        return tuple(self.at((k + 0.5) / count) for k in range(count))


@lru_cache(maxsize=64)
def _law(spread):
    """SciPy's distribution of a Spread, before it is cut."""
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


def variation(asked, where):
    """The Choice or Spread that `asked` says, a text as FORMS or a list of values; `where` is for messages.

    Raises
    ------
    InputError
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
        meant = f"; did you mean {close[0]}?" if close else ""
        raise InputError(f"{where}: there is no distribution {head!r}{meant}; wanted {FORMS}")
    return _choice(tuple(_value(part.strip()) for part in text.split(",")), text, where)


def _choice(values, text, where):
    if not values or "" in values:
        raise InputError(f"{where}: got {text!r}, wanted {FORMS}")
    return Choice(values, text)


def _spread(name, parts, text, where):
    numbers = [_number(part) for part in parts]
    if None in numbers or len(numbers) not in COUNTS[name]:
        raise InputError(f"{where}: got {text!r}, wanted {FORMS}")
    cut = numbers[2:] if name in ("normal", "lognormal") else []
    parameters = tuple(numbers[: len(numbers) - len(cut)])
    _require_possible(name, parameters, cut, f"{where}: {text}")
    made = Spread(name, parameters, *(cut or (None, None)), text)
    if cut and not _law(made).cdf(cut[1]) - _law(made).cdf(cut[0]) > 1e-12:
        raise InputError(f"{where}: {text} has no probability between {cut[0]:g} and {cut[1]:g}; widen them")
    return made


def _require_possible(name, parameters, cut, where):
    """Refuse numbers that make no distribution."""
    if name in ("normal", "lognormal"):
        mean, deviation = parameters
        if deviation <= 0 or (name == "lognormal" and mean <= 0):
            raise InputError(f"{where}: wanted a standard deviation above 0" + (
                " and a mean above 0" if name == "lognormal" else ""))  # fmt: skip
    ordered = cut or (parameters if name in ("uniform", "triangular") else ())
    if ordered and not (ordered[0] < ordered[-1] and list(ordered) == sorted(ordered)):
        raise InputError(f"{where}: wanted {'LOW below MODE below HIGH' if len(ordered) == 3 else 'LOW below HIGH'}")


def _number(text):
    """A finite float, or None."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _value(text):
    """What a value of a list means: true or false, a whole number, a number, else text."""
    if text in ("true", "false"):
        return text == "true"
    try:
        return int(text)
    except ValueError:
        number = _number(text)
        return text if number is None else number


def _rounded(value):
    return float(f"{value:.{DIGITS}g}")
