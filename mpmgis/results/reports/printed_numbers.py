"""Print numbers, units and places for readers of a report."""

import math
import re

DIGITS = 3  # of a number; more would claim an accuracy that no model has
THIN = "\u202f"  # between groups of three digits; a line is not broken there
WRITTEN_OUT = 1e-6, 1e10  # smallest and largest number without a power of ten in a line
_POWERS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_EXPONENT = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?e[+-]\d+\b")
_AREA = re.compile(r"(?<=\d m)([23])\b")
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


def printed_line(text: str) -> str:
    """Return a line of text without exponents: "2.489e+08 kg" as "249 000 000 kg", "1.5e+12 J" as "1.50 × 10¹² J".

    Parameters
    ----------
    text : str
    """
    return _AREA.sub(lambda found: found[1].translate(_POWERS), _EXPONENT.sub(_without_exponent, text))


def _without_exponent(found):
    value = float(found[0])
    if value == 0 or WRITTEN_OUT[0] <= abs(value) < WRITTEN_OUT[1]:
        return printed(value)
    digits, _, power = f"{value:.{DIGITS - 1}e}".partition("e")
    return f"{digits} × 10{str(int(power)).translate(_POWERS)}"


def printed_place(x: float, y: float) -> str:
    """Return map coordinates [m] in words: "E 312 900.0 N 4 008 450.5".

    Parameters
    ----------
    x, y : float [m]
    """
    return f"E {grouped(x, 1)} N {grouped(y, 1)}"
