"""Find hazard levels of a guideline: a matrix of return period and intensity class, over several scenarios."""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from ...system.errors import InputError
from .guideline_classes import COLOUR, PRODUCTS, QUANTITIES, UNREAD, Guideline, classify

NO_ZONE = "none"  # cell of a matrix without a level
SPLIT = "|"  # between the levels of a cell that the guideline divides; the higher one counts
NOT_ASSESSED = 255  # in rasters of levels: a cell without data
MOST_LEVELS = 250  # level numbers fit into a byte, beside NOT_ASSESSED


@dataclass(frozen=True)
class Level:
    """A hazard level: `name`, `colour` (#rrggbb), `meaning`."""

    name: str
    colour: str
    meaning: str = ""


@dataclass(frozen=True)
class Period:
    """A column of a matrix: return periods up to `up_to` [years] and longer than those of the column before.

    `guideline` has the intensity classes. `cells` are tuples of level numbers (0: no zone) for each of them, more than
    one where the guideline divides the cell. `read_in` is the source of the cells; UNREAD if the document was not read.
    """

    name: str
    up_to: float
    guideline: Guideline
    cells: tuple
    read_in: str = ""

    @cached_property
    def levels(self) -> np.ndarray:
        """Level of each intensity class, uint8[classes + 1]; 0 for class 0. Of a divided cell the higher one."""
        return np.array([0, *(max(cell) for cell in self.cells)], np.uint8)

    def words(self) -> str:
        """Return its return periods as text."""
        return "longer" if math.isinf(self.up_to) else f"up to {self.up_to:g} years"


@dataclass(frozen=True)
class HazardMatrix:
    """A matrix: `name`, `title`, `source` (document), `note`, `levels` from the lowest, `periods` from the shortest."""

    name: str
    title: str
    source: str
    note: str
    levels: tuple
    periods: tuple

    @property
    def bands(self) -> tuple[str, ...]:
        """Names of the bands that its intensity classes use."""
        named = {band for period in self.periods for band in period.guideline.bands}
        return tuple(band for _, band, _ in QUANTITIES.values() if band in named)

    def period(self, years: float) -> Period:
        """Return the Period of a scenario with this return period.

        Parameters
        ----------
        years : float [years]

        Returns
        -------
        Period

        Raises
        ------
        InputError
            It is longer than those of the guideline.
        """
        for period in self.periods:
            if years <= period.up_to:
                return period
        raise InputError(
            f"scenario of {years:g} years: the matrix {self.name} ends at {self.periods[-1].up_to:g} years; leave the "
            "scenario out, or choose another `map`"
        )

    def missing(self, years: list) -> list[Period]:
        """Return the periods without a scenario of these return periods.

        Parameters
        ----------
        years : list of float [years]
        """
        given = {self.period(value).name for value in years}
        return [period for period in self.periods if period.name not in given]

    @property
    def is_unread(self) -> bool:
        """Whether some of its cells or limits are not verified in a document."""
        classes = [entry for period in self.periods for entry in period.guideline.classes]
        return any(part.read_in == UNREAD for part in (*self.periods, *classes))


def parse_matrices(tables: dict, guidelines: dict, where: object) -> dict[str, HazardMatrix]:
    """Return matrices by name from the tables of a TOML file.

    Parameters
    ----------
    tables : dict
        Name -> table.
    guidelines : dict of str to Guideline
        Guidelines that the matrices can use.
    where : str or Path
        Name of the file in error messages.

    Returns
    -------
    dict of str to HazardMatrix

    Raises
    ------
    InputError
        A key is missing or unknown, a level or guideline is unknown, or a higher intensity or a shorter return period
        has a lower level.
    """
    return {name: _matrix(name, table, guidelines, f"{where} [{name}]") for name, table in tables.items()}


def _matrix(name: str, table: dict, guidelines: dict, where: str) -> HazardMatrix:
    _require(
        table,
        where,
        {"title": str, "source": str, "note": str, "level": list, "period": list},
        ("source", "level", "period"),
    )
    if not 0 < len(table["level"]) <= MOST_LEVELS or not table["period"]:
        raise InputError(f"{where}: expected one or more [[{name}.level]] and [[{name}.period]] tables")
    levels = tuple(_level(entry, f"{where} level {k}") for k, entry in enumerate(table["level"], 1))
    _require_names([level.name for level in levels], f"{where} level")
    numbers = {NO_ZONE: 0} | {level.name: k for k, level in enumerate(levels, 1)}
    periods = tuple(
        _period(entry, numbers, guidelines, f"{where} period {k}") for k, entry in enumerate(table["period"], 1)
    )
    _require_monotone(periods, where)
    _require_names([period.name for period in periods], f"{where} period")
    return HazardMatrix(name, *(table.get(key, "") for key in ("title", "source", "note")), levels, periods)


def _require_names(names, where):
    """Refuse a name that is given twice, or that has a meaning of its own in `levels`."""
    for k, name in enumerate(names):
        if name in names[:k]:
            raise InputError(f"{where} {k + 1}: the name {name!r} is given twice; give each its own")
        if name == NO_ZONE or SPLIT in name or not name.strip():
            raise InputError(
                f"{where} {k + 1}: name is {name!r}, expected a text other than {NO_ZONE!r}, without {SPLIT!r}"
            )


def _level(table, where):
    _require(table, where, {"name": str, "colour": str, "meaning": str}, ("name", "colour"))
    if not COLOUR.fullmatch(table["colour"]):
        raise InputError(f"{where}: colour is {table['colour']!r}, expected #rrggbb, for example #c1272d")
    return Level(table["name"], table["colour"], table.get("meaning", ""))


def _period(table: dict, numbers: dict, guidelines: dict, where: str) -> Period:
    kinds = {"name": str, "up_to": (int, float), "intensity": str, "levels": list, "read_in": str}
    _require(table, where, kinds, ("name", "intensity", "levels"))
    guideline = guidelines.get(table["intensity"])
    if guideline is None:
        raise InputError(f"{where}: intensity {table['intensity']!r} is unknown; choose from {', '.join(guidelines)}")
    up_to = float(table.get("up_to", math.inf))
    if not up_to > 0:
        raise InputError(f"{where}: up_to is {up_to:g}, expected a number of years above 0")
    if len(table["levels"]) != len(guideline.classes):
        raise InputError(
            f"{where}: levels has {len(table['levels'])} entries, expected one for each class of {guideline.name}: "
            f"{', '.join(entry.name for entry in guideline.classes)}"
        )
    cells = tuple(_cell(text, numbers, where) for text in table["levels"])
    return Period(table["name"], up_to, guideline, cells, table.get("read_in", ""))


def _cell(text, numbers, where):
    names = str(text).split(SPLIT)
    for name in names:
        if name not in numbers:
            raise InputError(f"{where}: unknown level {name!r}; choose from {', '.join(numbers)}")
    return tuple(sorted(numbers[name] for name in names))


def _require_monotone(periods, where):
    """Refuse a matrix in which a higher intensity or a shorter return period has a lower level."""
    ends = [period.up_to for period in periods]
    if sorted(set(ends)) != ends:
        words = ", ".join(f"{end:g}" for end in ends)
        raise InputError(f"{where}: up_to of the periods is {words}, expected ascending")
    for period in periods:
        if (np.diff(period.levels.astype(int)) < 0).any():
            raise InputError(f"{where}, {period.name}: a higher intensity class has a lower level")
    for shorter, longer in pairwise(periods):
        if shorter.guideline is longer.guideline and (shorter.levels < longer.levels).any():
            raise InputError(f"{where}: {longer.name} has a higher level than {shorter.name} at the same intensity")


def _require(table, where, kinds, needed):
    if not isinstance(table, dict):
        raise InputError(f"{where}: expected a table with {', '.join(kinds)}")
    for key, value in table.items():
        if key not in kinds:
            raise InputError(f"{where}: unknown key {key!r}; known keys are {', '.join(kinds)}")
        if not isinstance(value, kinds[key]) or isinstance(value, bool):
            raise InputError(f"{where}: {key} is {value!r}, expected {'text' if kinds[key] is str else 'a number'}")
    for key in needed:
        if key not in table:
            raise InputError(f"{where}: {key} is missing; known keys are {', '.join(kinds)}")


def levels_of(period: Period, bands: dict, reached: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the hazard level of each cell of one scenario.

    Parameters
    ----------
    period : Period
        Of its return period.
    bands : dict of str to float[rows, columns]
        Largest values in their units; NaN without a value.
    reached : bool[rows, columns]
        Cells with flow.

    Returns
    -------
    (uint8[rows, columns], int)
        Levels, 0 without one; number of reached cells without a value of a band, which count as the largest value.
    """
    guideline, filled, lacking = period.guideline, {}, np.zeros(reached.shape, bool)
    products = {name for entry in guideline.classes for condition in entry.when for name in condition} & set(PRODUCTS)
    for name in {*guideline.bands, *(("h_max", "Ut_max") if products else ())}:
        values = bands[name]
        lack = reached & np.isnan(values)
        lacking |= lack
        filled[name] = np.where(lack, np.inf, values)
    return period.levels[classify(guideline, filled, reached)], int(np.count_nonzero(lacking))


@dataclass(frozen=True)
class Hazard:
    """Levels of all scenarios together.

    `level` uint8[rows, columns]; `unknown` bool[rows, columns]: without a level, and at least one scenario or the
    terrain has no data there, so that the cell must not be read as free of hazard; `partly` bool[rows, columns]: with
    a level below the highest, although a scenario has no data there.
    """

    level: np.ndarray
    unknown: np.ndarray
    partly: np.ndarray

    def coded(self) -> np.ndarray:
        """Return the levels, with NOT_ASSESSED where they are unknown.

        Returns
        -------
        uint8[rows, columns]
        """
        return np.where(self.unknown, np.uint8(NOT_ASSESSED), self.level)


def combined_hazard(levels: list, known: list, terrain_known: np.ndarray, highest: int) -> Hazard:
    """Return the largest level of each cell over all scenarios.

    Parameters
    ----------
    levels : list of uint8[rows, columns]
    known : list of bool[rows, columns]
        Cells where the scenario has data.
    terrain_known : bool[rows, columns]
    highest : int
        Number of levels.

    Returns
    -------
    Hazard
    """
    level = np.maximum.reduce(levels)
    complete = np.logical_and.reduce([*known, terrain_known])
    return Hazard(level, (level == 0) & ~complete, (level > 0) & (level < highest) & ~complete)
