"""Which keys of a scene vary, their distributions, and the sampled scene of each ensemble member."""

import copy
import difflib
import itertools
import math
import re
import warnings
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..errors import InputError, SceneError
from ..scene import scene_from_tables
from ..scene.table_values import meant
from ..scene.tables import LISTED, TABLES

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


SAMPLINGS = ("lhs", "sobol", "grid", "random")
SAMPLES, LEVELS = 32, 5  # members; on a grid values of each range
MOST_MEMBERS = 100_000


class Member(NamedTuple):
    """One run: its `number` from 1, the `values` of the varied keys in their order, and the whole scene as `tables`."""

    number: int
    values: tuple
    tables: dict


@dataclass(frozen=True)
class Plan:
    """Which keys vary how, and how many runs that makes.

    Parameters
    ----------
    varied : dict of str to Choice or Spread
        By key: `friction.mu`, or `zones.1.mu` where a scene may have several of a table.
    sampling : str
        One of SAMPLINGS.
    samples : int
        Members; on a grid values of each range.
    seed : int
    """

    varied: dict
    sampling: str
    samples: int
    seed: int

    @classmethod
    def of(cls, varied, sampling=None, samples=None, seed=0):
        """A Plan with what is not said filled in: lists alone are crossed, all else is a Latin hypercube.

        Raises
        ------
        InputError
        """
        if not varied:
            raise InputError("nothing varies; give for example --vary friction.mu=0.1:0.3, or --plan plan.toml")
        if sampling is None:
            sampling = "grid" if all(isinstance(one, Choice) for one in varied.values()) else "lhs"
        if sampling not in SAMPLINGS:
            raise InputError(f"--sampling {sampling}: wanted one of {', '.join(SAMPLINGS)}")
        plan = cls(dict(varied), sampling, samples or (LEVELS if sampling == "grid" else SAMPLES), seed)
        if plan.count > MOST_MEMBERS:
            raise InputError(f"{plan.count} members, wanted at most {MOST_MEMBERS}; vary less, or give fewer --samples")
        return plan

    @property
    def count(self):
        """Number of members."""
        if self.sampling != "grid":
            return self.samples
        return math.prod(len(one.levels(1)) if isinstance(one, Choice) else self.samples for one in
                         self.varied.values())  # fmt: skip

    def values(self):
        """List of tuples: the values of the varied keys, a member each; the same for the same plan, to the last bit."""
        varied = list(self.varied.values())
        if self.sampling == "grid":
            return list(itertools.product(*(one.levels(self.samples) for one in varied)))
        return [tuple(one.at(share) for one, share in zip(varied, row, strict=True)) for row in self._shares()]

    def _shares(self):
        """float64[samples, keys]: places in the unit cube, by SciPy's qmc."""
        from scipy.stats import qmc

        source, keys = np.random.default_rng(self.seed), len(self.varied)
        if self.sampling == "random":
            return source.random((self.samples, keys))
        if self.sampling == "lhs":
            return qmc.LatinHypercube(keys, seed=source).random(self.samples)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # no power of two: told by `remark`
            return qmc.Sobol(keys, seed=source).random(self.samples)

    def remark(self):
        """What should be known about the sampling, '' where nothing."""
        if self.sampling == "sobol" and self.samples & (self.samples - 1):
            more = 1 << self.samples.bit_length()
            return f"Sobol's points are even where their number is a power of two: {self.samples} are not, {more} are"
        return ""

    def members(self, base, folder, name, own_laws):
        """List of Member, each with a scene that has been checked.

        Parameters
        ----------
        base : dict
            The scene's own tables, as `Scene.as_tables` gives them.
        folder, name : str
            Of the scene.
        own_laws : OwnLaws

        Raises
        ------
        SceneError
            A key that the scene has no place for, or a value that its tables do not allow; names the member.
        """
        for key in self.varied:
            require_place(base, key)
        made = []
        for number, values in enumerate(self.values(), 1):
            tables = with_values(base, dict(zip(self.varied, values, strict=True)))
            scene_from_tables(tables, folder, f"{name}, member {number}", own_laws)
            made.append(Member(number, values, tables))
        return made

    def as_tables(self):
        """The plan as the plain dictionary that TOML holds."""
        return {
            "sampling": self.sampling,
            "samples": self.samples,
            "seed": self.seed,
            "vary": {
                key: list(one.values) if isinstance(one, Choice) else one.text for key, one in self.varied.items()
            },
        }


def with_values(tables, values):
    """A copy of a scene's `tables` with the `values` by key in their places."""
    made = copy.deepcopy(tables)
    for key, value in values.items():
        holder, last = _place(made, key)
        holder[last] = value
    return made


def require_place(tables, key):
    """Refuse a `key` that is no place in the scene's `tables`.

    Raises
    ------
    SceneError
    """
    _place(tables, key)


def _place(tables, key):
    """(dictionary, its key) that `key` means in a scene's tables."""
    name, *path = re.split(r"\.", key)
    if name not in TABLES:
        known = ", ".join(tables)
        raise SceneError(f"--vary {key}: there is no table [{name}]{meant(name, TABLES)}; the scene has {known}")
    if name not in tables:
        raise SceneError(f"--vary {key}: the scene has no [{name}]; write the table there, with all its values")
    holder = tables[name]
    if name in LISTED:
        number, *path = path or [""]
        if not (number.isdigit() and 1 <= int(number) <= len(holder)):
            raise SceneError(
                f"--vary {key}: which [[{name}]]? The scene has {len(holder)}; wanted {name}.1.KEY for the first"
            )
        holder = holder[int(number) - 1]
    if len(path) == 2 and isinstance(holder.get(path[0]), dict):  # until.time of a stage
        holder, path = holder[path[0]], path[1:]
    if len(path) != 1 or not path[0]:
        example = f"{name}.1.KEY" if name in LISTED else f"{name}.KEY"
        raise SceneError(f"--vary {key}: wanted TABLE.KEY, for example {example}")
    return holder, path[0]
