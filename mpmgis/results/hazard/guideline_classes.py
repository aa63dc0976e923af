"""Classify the largest values of a cell by the intensity classes of a guideline."""

import math
import re
from dataclasses import dataclass

import numpy as np

from ...system.errors import InputError

# quantity of a condition -> unit, band, factor
QUANTITIES = {
    "h": ("m", "h_max", 1.0),
    "v": ("m/s", "Ut_max", 1.0),
    "p": ("kPa", "p_max", 1e-3),
    "vh": ("m2/s", None, 1.0),  # h times v
    "vvh": ("m3/s2", None, 1.0),  # h times the square of v
    "deposit": ("m", "h_deposit", 1.0),
}
UNREAD = "not read"  # source of a number that was not verified in the document
PRODUCTS = {"vh": 1, "vvh": 2}  # product of h and v: the power of v
ROUNDING = 1e-6  # [1] of values near a limit: rasters have single precision, so 0.7 m may be 0.69999999 m
COLOUR = re.compile(r"#[0-9a-fA-F]{6}")  # #rrggbb
MOST_CLASSES = 250  # class numbers fit into a byte


@dataclass(frozen=True)
class IntensityClass:
    """A class: `name`, `colour` (#rrggbb) and alternative conditions `when`: dicts quantity -> smallest value.

    `read_in` is the source of its numbers; "" if not given, UNREAD if the document was not read.
    """

    name: str
    colour: str
    when: tuple
    read_in: str = ""

    def words(self) -> str:
        """Return the conditions as text."""
        if any(not condition for condition in self.when):
            return "all cells with flow"
        parts = (
            " and ".join(f"{name} >= {least:g} {QUANTITIES[name][0]}" for name, least in condition.items())
            for condition in self.when
        )
        return " or ".join(parts)

    def origin(self) -> str:
        """Return the source of the numbers of the class, as text."""
        if self.read_in == UNREAD:
            return "number as commonly cited, not verified in the document; check it there"
        return f"number read in {self.read_in}"


@dataclass(frozen=True)
class Guideline:
    """A guideline: `name`, `title`, `source` (document), `note`, `classes` from the lowest."""

    name: str
    title: str
    source: str
    note: str
    classes: tuple

    @property
    def bands(self) -> tuple[str, ...]:
        """Names of the bands that its conditions use."""
        named = {name for entry in self.classes for condition in entry.when for name in condition}
        named |= {"h", "v"} if named & set(PRODUCTS) else set()
        return tuple(band for name, (_, band, _) in QUANTITIES.items() if name in named and band is not None)


def parse_guidelines(tables: dict, where: object) -> dict[str, Guideline]:
    """Return guidelines by name from the tables of a TOML file.

    Parameters
    ----------
    tables : dict
        Name -> table.
    where : str or Path
        Name of the file in error messages.

    Returns
    -------
    dict of str to Guideline

    Raises
    ------
    InputError
        A key is missing or unknown, or a value is not a number.
    """
    return {name: _guideline(name, table, f"{where} [{name}]") for name, table in tables.items()}


def _guideline(name: str, table: dict, where: str) -> Guideline:
    _require_table(table, where, ("title", "source", "note", "class"), ("source", "class"))
    entries = table["class"]
    if not (isinstance(entries, list) and 0 < len(entries) <= MOST_CLASSES):
        raise InputError(f"{where}: class must be one or more [[{name}.class]] tables")
    classes = tuple(_class(entry, f"{where} class {k}") for k, entry in enumerate(entries, start=1))
    texts = (_text(table.get(key, ""), where, key) for key in ("title", "source", "note"))
    return Guideline(name, *texts, classes)


def _class(table, where):
    _require_table(table, where, ("name", "colour", "when", "read_in"), ("name", "colour", "when"))
    colour = _text(table["colour"], where, "colour")
    if not COLOUR.fullmatch(colour):
        raise InputError(f"{where}: colour is {colour!r}, expected #rrggbb, for example #c1272d")
    conditions = table["when"]
    if not (isinstance(conditions, list) and conditions and all(isinstance(entry, dict) for entry in conditions)):
        raise InputError(f"{where}: when must be a list of conditions, for example [{{ h = 1, v = 1 }}, {{ p = 30 }}]")
    for condition in conditions:
        for name, least in condition.items():
            if name not in QUANTITIES:
                raise InputError(f"{where}: unknown quantity {name!r}; choose from {', '.join(QUANTITIES)}")
            if isinstance(least, bool) or not isinstance(least, int | float) or not math.isfinite(least) or least <= 0:
                raise InputError(f"{where}: {name} is {least!r}, expected a number above 0")
    read_in = _text(table.get("read_in", ""), where, "read_in")
    return IntensityClass(_text(table["name"], where, "name"), colour, tuple(map(dict, conditions)), read_in)


def _require_table(table, where, known, needed):
    if not isinstance(table, dict):
        raise InputError(f"{where}: expected a table with {', '.join(known)}")
    for key in table:
        if key not in known:
            raise InputError(f"{where}: unknown key {key!r}; known keys are {', '.join(known)}")
    for key in needed:
        if key not in table:
            raise InputError(f"{where}: {key} is missing; known keys are {', '.join(known)}")


def _text(value, where, key):
    if not isinstance(value, str):
        raise InputError(f"{where}: {key} is {value!r}, expected text")
    return value


def classify(guideline: Guideline, bands: dict, reached: np.ndarray) -> np.ndarray:
    """Return the class number of each cell.

    Parameters
    ----------
    guideline : Guideline
    bands : dict of str to float[rows, columns]
        Its `bands` in their units; NaN without a value.
    reached : bool[rows, columns]
        Cells with flow.

    Returns
    -------
    uint8[rows, columns]
        From 1, the lowest class; 0 without flow or without a fulfilled condition.
    """
    numbers = np.zeros(reached.shape, np.uint8)
    for number, entry in enumerate(guideline.classes, start=1):
        met = np.zeros(reached.shape, bool)
        for condition in entry.when:
            met |= np.logical_and.reduce([reached, *(_at_least(bands, *item) for item in condition.items())])
        numbers[met] = number
    return numbers


def without_value(guideline: Guideline, bands: dict, reached: np.ndarray) -> np.ndarray:
    """Return which cells with flow have no value of a band of the guideline.

    Parameters
    ----------
    guideline : Guideline
    bands : dict of str to float[rows, columns]
        NaN without a value.
    reached : bool[rows, columns]
        Cells with flow.

    Returns
    -------
    bool[rows, columns]
    """
    gaps = [np.isnan(bands[name]) for name in guideline.bands]
    return reached & np.logical_or.reduce(gaps) if gaps else np.zeros(reached.shape, bool)


def _at_least(bands: dict, name: str, least: float) -> np.ndarray:
    if name in PRODUCTS:
        values = bands["h_max"] * bands["Ut_max"] ** PRODUCTS[name]
    else:
        _, band, factor = QUANTITIES[name]
        values = bands[band] * factor
    with np.errstate(invalid="ignore"):
        return values * (1.0 + ROUNDING) >= least


def class_areas(guideline: Guideline, numbers: np.ndarray, cell_area: float) -> np.ndarray:
    """Return the plan area of each class.

    Parameters
    ----------
    guideline : Guideline
    numbers : uint8[rows, columns]
        From `classify`.
    cell_area : float [m2]

    Returns
    -------
    float64[classes] [m2]
    """
    return np.bincount(numbers.ravel(), minlength=len(guideline.classes) + 1)[1:] * cell_area
