"""Plan of the samples of an ensemble: its varied keys, and the values and scene of each member."""

import copy
import itertools
import math
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..scene import scene_from_tables
from ..scene.key_checks import is_number, meant
from ..scene.tables import LISTED, TABLES
from ..system.errors import InputError, SceneError
from .varied_keys import Choice

if TYPE_CHECKING:
    from ..laws.own_law import OwnLaws

JOINT = "joint"  # member k has value k of every list; only of a plan in a file
SAMPLINGS = ("lhs", "sobol", "grid", "random", JOINT)
SAMPLES = 32  # default number of members
LEVELS = 5  # default number of values per range on a grid
MOST_MEMBERS = 100_000  # more are refused


class Member(NamedTuple):
    """One run of an ensemble.

    Parameters
    ----------
    number : int
        From 1.
    values : tuple
        Of the varied keys, in their order.
    tables : dict
        The whole scene.
    """

    number: int
    values: tuple
    tables: dict


def _are_lists(varied):
    return all(isinstance(one, Choice) for one in varied.values())


@dataclass(frozen=True)
class SamplingPlan:
    """The varied keys, their distributions, and the number of runs.

    Parameters
    ----------
    varied : dict of str to Choice or Spread
        By key: `friction.mu`, or `zones.1.mu` for tables that can occur several times.
    sampling : str
        One of SAMPLINGS.
    samples : int
        Members; on a grid: values per range.
    seed : int
    """

    varied: dict
    sampling: str
    samples: int
    seed: int

    @classmethod
    def of(cls, varied: dict, sampling: str | None = None, samples: int | None = None, seed: int = 0) -> "SamplingPlan":
        """Return a plan with defaults: lists alone are combined on a grid, otherwise a Latin hypercube is used.

        Parameters
        ----------
        varied : dict of str to Choice or Spread
            By key.
        sampling : str, optional
            One of SAMPLINGS.
        samples : int, optional
            Members; on a grid: values per range.
        seed : int

        Raises
        ------
        InputError
            Nothing varies, an unknown sampling, too many members, or lists of different length for JOINT.
        """
        if not varied:
            raise InputError("nothing varies; use for example --vary friction.mu=0.1:0.3, or --plan plan.toml")
        if sampling is None:
            sampling = "grid" if _are_lists(varied) else "lhs"
        if sampling not in SAMPLINGS:
            raise InputError(f"--sampling {sampling}: expected one of {', '.join(SAMPLINGS)}")
        if sampling == JOINT and not _equally_long(varied):
            raise InputError(f"sampling {JOINT}: expected a list of values for each key, all of the same length")
        plan = cls(dict(varied), sampling, samples or (LEVELS if sampling == "grid" else SAMPLES), seed)
        if plan.count > MOST_MEMBERS:
            raise InputError(f"{plan.count} members, expected at most {MOST_MEMBERS}; use fewer keys or --samples")
        return plan

    @property
    def has_only_lists(self) -> bool:
        """Whether every key has a list of values, and none a range or distribution."""
        return _are_lists(self.varied)

    @property
    def count(self) -> int:
        """Number of members."""
        if self.sampling == JOINT:
            return min((len(one.values) for one in self.varied.values()), default=0)
        if self.sampling != "grid":
            return self.samples
        levels = (len(one.values) if isinstance(one, Choice) else self.samples for one in self.varied.values())
        return math.prod(levels)

    def values(self) -> list[tuple]:
        """Return the values of the varied keys of each member; bitwise reproducible for the same plan."""
        varied = list(self.varied.values())
        if self.sampling == JOINT:
            return list(zip(*(one.values for one in varied), strict=True))
        if self.sampling == "grid":
            return list(itertools.product(*(one.levels(self.samples) for one in varied)))
        return [tuple(one.at(share) for one, share in zip(varied, row, strict=True)) for row in self._shares()]

    def _shares(self):
        """Return points in the unit cube from SciPy's qmc, float64[samples, keys]."""
        from scipy.stats import qmc

        source, keys = np.random.default_rng(self.seed), len(self.varied)
        if self.sampling == "random":
            return source.random((self.samples, keys))
        if self.sampling == "lhs":
            return qmc.LatinHypercube(keys, seed=source).random(self.samples)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # not a power of two: reported by `remark`
            return qmc.Sobol(keys, seed=source).random(self.samples)

    def remark(self) -> str:
        """Return a warning about the sampling, or ''."""
        if self.sampling == "sobol" and self.samples & (self.samples - 1):
            more = 1 << self.samples.bit_length()
            return f"Sobol points are uniform if their number is a power of two: {self.samples} is not; use {more}"
        return ""

    def members(self, base: dict, folder: str | Path, name: str, own_laws: "OwnLaws") -> list[Member]:
        """Return all members, each with a checked scene.

        Parameters
        ----------
        base : dict
            The tables of the scene, from `Scene.as_tables`.
        folder : path
            To which paths of the scene are relative.
        name : str
            Of the scene, for messages.
        own_laws : OwnLaws

        Raises
        ------
        SceneError
            A key that the scene does not have, or a value that is not allowed; the message names the member.
        """
        for key in self.varied:
            require_place(base, key)
        made = []
        for number, values in enumerate(self.values(), 1):
            tables = with_values(base, dict(zip(self.varied, values, strict=True)))
            scene_from_tables(tables, folder, f"{name}, member {number}", own_laws)
            made.append(Member(number, values, tables))
        return made

    def as_tables(self) -> dict:
        """Return the plan as a dictionary for TOML."""
        return {
            "sampling": self.sampling,
            "samples": self.samples,
            "seed": self.seed,
            "vary": {
                key: list(one.values) if isinstance(one, Choice) else one.text for key, one in self.varied.items()
            },
        }


def _equally_long(varied):
    lists = all(isinstance(one, Choice) for one in varied.values())
    return lists and len({len(one.values) for one in varied.values()}) == 1


def with_values(tables: dict, values: dict) -> dict:
    """Return a copy of the tables of a scene with other values.

    Parameters
    ----------
    tables : dict
    values : dict
        By key, as in `SamplingPlan`.
    """
    made = copy.deepcopy(tables)
    for key, value in values.items():
        holder, last = _place(made, key)
        holder[last] = value
    return made


def value_at(tables: dict, key: str) -> object:
    """Return the value of a key in the tables of a scene; None where they do not give it.

    Parameters
    ----------
    tables : dict
    key : str
        As in `SamplingPlan`.
    """
    holder, last = _place(tables, key)
    return holder.get(last)


def nearest_member(own: tuple, members: Sequence[tuple]) -> int:
    """Return the place of the member whose values are nearest to those of the scene; of equal ones the first.

    Numbers are apart by their difference over the range of the members, other values by 1. A key that the scene does
    not give has no part.

    Parameters
    ----------
    own : tuple
        Values of the scene; None where it gives none.
    members : sequence of tuple
        Values of each member.
    """
    apart = np.zeros(len(members))
    for value, given in zip(own, zip(*members, strict=True), strict=True):
        if is_number(value) and all(is_number(one) for one in given):
            numbers = np.array([*given, value], float)
            apart += ((numbers[:-1] - value) / (np.ptp(numbers) or 1.0)) ** 2
        elif value is not None:
            apart += [float(one != value) for one in given]
    return int(np.argmin(apart))


def require_place(tables: dict, key: str) -> None:
    """Raise SceneError for a key that is not in the tables of a scene.

    Parameters
    ----------
    tables : dict
    key : str

    Raises
    ------
    SceneError
    """
    _place(tables, key)


def _place(tables, key):
    """Return (dictionary, its key) of `key` in a scene's tables."""
    name, *path = re.split(r"\.", key)
    if name not in TABLES:
        known = ", ".join(tables)
        raise SceneError(f"--vary {key}: unknown table [{name}]{meant(name, TABLES)}; the scene has {known}")
    if name not in tables:
        raise SceneError(f"--vary {key}: the scene has no [{name}]; add the table with all its values")
    holder = tables[name]
    if name in LISTED:
        number, *path = path or [""]
        if not (number.isdigit() and 1 <= int(number) <= len(holder)):
            raise SceneError(
                f"--vary {key}: the scene has {len(holder)} [[{name}]]; expected a number, {name}.1.KEY for the first"
            )
        holder = holder[int(number) - 1]
    if len(path) == 2 and isinstance(holder.get(path[0]), dict):  # until.time of a stage
        holder, path = holder[path[0]], path[1:]
    if len(path) != 1 or not path[0]:
        example = f"{name}.1.KEY" if name in LISTED else f"{name}.KEY"
        raise SceneError(f"--vary {key}: expected TABLE.KEY, for example {example}")
    return holder, path[0]
