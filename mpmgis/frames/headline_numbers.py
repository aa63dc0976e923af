"""The headline numbers of a run, with their numerical error as `run.json` states it (`companion`), in words."""

import math
from pathlib import Path
from typing import NamedTuple

from ..laws.quantities import SQUARE_METRES_PER_HECTARE
from .run_folder import record_of

ERROR_TAG = "numerical_error"  # of rasters
VALUES = ("value", "larger_cells", "error")  # of a headline number in `companion`


class Headline(NamedTuple):
    """A headline number of a run.

    Parameters
    ----------
    words : str
    unit : str
        Of the text.
    scale : float
        Value in `run.json`, in m, m2, m3 or m s-1, for one `unit`.
    """

    words: str
    unit: str
    scale: float = 1.0


HEADLINES = {
    "runout": Headline("runout from the centre of the release", "m"),
    "footprint_area": Headline("footprint", "ha", SQUARE_METRES_PER_HECTARE),
    "thickness_p99": Headline("99th percentile of the largest thickness", "m"),
    "speed_max": Headline("largest speed", "m/s"),
    "volume_at_end": Headline("volume at the end", "m3"),
}


def error_lines(companion: dict | None) -> list[str]:
    """Return a line of text for each headline number: value, that on larger cells, numerical error.

    Parameters
    ----------
    companion : dict or None
        Entry `companion` of a run.json.

    Returns
    -------
    list of str
        The reason where there are no numbers; empty without an entry.
    """
    if not companion:
        return []
    known = _known(companion)
    if not known:
        return [f"numerical error unknown: {companion.get('failed', 'run.json is of another version of mpmgis')}"]
    cells = f"with cells of {companion['cell_size']:g} m"
    lines = []
    for name, one in known:
        head = HEADLINES[name]
        value, larger, error = (one[key] / head.scale for key in VALUES)
        lines.append(
            f"{head.words} {_text(value, 4)} {head.unit}; {cells} {_text(larger, 4)} {head.unit}; numerical error "
            f"about {_text(error, 2)} {head.unit}"
        )
    return lines


def error_words(companion: dict | None) -> str:
    """Return the numerical errors of a run in one line; '' where they are unknown.

    Parameters
    ----------
    companion : dict or None
        Entry `companion` of a run.json, or of the record of many runs: then it also says of which one it is.
    """
    heads = ((HEADLINES[name], one) for name, one in _known(companion))
    words = ", ".join(
        f"{head.words} {_text(one['value'] / head.scale, 4)} +- {_text(one['error'] / head.scale, 2)} {head.unit}"
        for head, one in heads
    )
    return f"{words} ({companion['of']})" if words and isinstance(companion.get("of"), str) else words


def error_tags(words: str) -> dict[str, str]:
    """Return the tags of a raster about its numerical errors; {} where they are unknown.

    Parameters
    ----------
    words : str
        As of `error_words`.
    """
    return {ERROR_TAG: words} if words else {}


def errors_of_run(folder: Path, digest: str) -> str:
    """Return `error_words` of the run in a folder; '' where there is no such run.

    Parameters
    ----------
    folder : Path
    digest : str
        Of its scene.
    """
    return error_words(record_of(folder, digest).get("companion")) if digest else ""


def _known(companion):
    """Return (name, its VALUES) of the headlines whose numbers are there; [] without a cell size."""
    if not isinstance(companion, dict):
        return []
    numbers = companion.get("numbers")
    if not isinstance(numbers, dict) or not _is_number(companion.get("cell_size")):
        return []
    found = ((name, numbers[name]) for name in HEADLINES if isinstance(numbers.get(name), dict))
    return [(name, one) for name, one in found if all(_is_number(one.get(key)) for key in VALUES)]


def _is_number(value):
    return isinstance(value, int | float) and math.isfinite(value)


def _text(value, digits):
    """Return a number with so many significant digits, never with an exponent below a million million."""
    return f"{float(f'{value:.{digits}g}'):.12g}"
