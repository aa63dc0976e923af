"""Print numbers, units and places for readers of a report."""

import math
import re

DIGITS = 3  # of a number; more would claim an accuracy that no model has
THIN = "\u202f"  # between groups of three digits; a line is not broken there
_POWERS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
_FACTOR = re.compile(r"([^\d\s-]+)(-?)(\d*)")


def printed(value: float) -> str:
    """Return a number in three digits without an exponent, in groups of three: "249 000 000", "0.00512".

    Parameters
    ----------
    value : float
    """
    if not math.isfinite(value):
        return str(value)
    rounded = float(f"{value:.{DIGITS - 1}e}")
    decimals = 0 if rounded == 0 else DIGITS - 1 - math.floor(math.log10(abs(rounded)))
    return grouped(rounded, max(decimals, 0))


def grouped(value: float, decimals: int = 0) -> str:
    """Return a number with `decimals` and its digits before the point in groups of three, from 10 000 on.

    Parameters
    ----------
    value : float
    decimals : int
    """
    text = f"{value:.{decimals}f}"
    return f"{value:,.{decimals}f}".replace(",", THIN) if abs(value) >= 10_000 else text


def printed_unit(unit: str) -> str:
    """Return a unit as books print it: "kg m-3" as "kg/m³".

    Parameters
    ----------
    unit : str
    """
    factors = [_FACTOR.fullmatch(part) for part in unit.split()]
    if not all(factors) or not re.search(r"\d", unit):
        return unit
    above, below = [], []
    for name, minus, power in (factor.groups() for factor in factors if factor):
        (below if minus else above).append(name + ("" if power in ("", "1") else power.translate(_POWERS)))
    return " ".join(above) + ("/" + "/".join(below) if below else "")


def printed_place(x: float, y: float) -> str:
    """Return map coordinates [m] in words: "E 312 900.0 N 4 008 450.5".

    Parameters
    ----------
    x, y : float [m]
    """
    return f"E {grouped(x, 1)} N {grouped(y, 1)}"
