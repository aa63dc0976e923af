"""What many runs of a scene differ in: keys, how they are sampled, and the tables of each member."""

import copy
import itertools
import math
import re
import warnings
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import InputError, SceneError
from ..scene import scene_from_tables
from ..scene.tables import LISTED, TABLES, meant
from .variation import Choice

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
