"""Print one screen about any file that mpmgis reads or writes."""

import argparse
import json
import sys
from typing import Any

from ...laws.quantities import BAND
from ..info import VERB
from ..info import terms as terms_of
from . import answers, terminal
from .parser import values_of

_TAKERS = (  # what energy is lost to, as in the names of the facts
    "ground",
    "eroded_mass",
    "barriers",
    "speed_limit",
    "mixing",
    "bends",
    "yielding",
    "affine_limit",
    "layers",
    "forest",
)
UNITS = {
    **dict.fromkeys(("time", "first_time", "times", "end_time", "frame_interval", "wall_seconds"), "s"),
    **dict.fromkeys(("mass", "mass_at_start", "mass_start", "mass_now", "mass_out"), "kg"),
    **dict.fromkeys(("mass_detrained", "mass_at_rest", "mass_flowing"), "kg"),
    **dict.fromkeys(("reference_mass", "lightest_column", "heaviest_column"), "kg"),
    **dict.fromkeys(("volume", "reference_volume"), "m3"),
    **dict.fromkeys(("elevation", "thickness", "thickness_so_far", "thickness_max", "thickness_max_now", "drop"), "m"),
    **dict.fromkeys(("max_speed", "speed_so_far", "speed_max_now", "speed", "velocity"), "m s-1"),
    **dict.fromkeys(("speed_p999", "speed_p999_now"), "m s-1"),
    **dict.fromkeys(("area", "column_area", "release_area", "footprint_area"), "m2"),
    **dict.fromkeys(("forest_area", "forest_broken_area"), "m2"),
    **dict.fromkeys(("kinetic_energy", "kinetic_energy_peak", "potential_energy", "energy_lost"), "J"),
    **dict.fromkeys(("energy_start", "energy_released_later", "energy_entrained", "energy_lifted"), "J"),
    **dict.fromkeys(("energy_returned", "energy_of_volume_corrections", "energy_out"), "J"),
    **{f"energy_lost_to_{name}": "J" for name in _TAKERS},
    "ground_friction_work": "J",
    **dict.fromkeys(("friction_angle", "bed_friction_angle"), "degrees"),
    **dict.fromkeys(("bbox", "cell_size"), "m"),
    "density": "kg m-3",
    "particle_volume": "m3",
    "xi": "m s-2",
    "slope_median": "(tangent)",
}
RANGES = ("elevation", "thickness", "column_area", "times")  # whose list of two is minimum and maximum
LABELS = {
    "n": "particles",
    "bbox": "W, S, E, N",
    "wall_seconds": "computing time",
    "crs": "CRS",
    "qgis": "QGIS",
    "max_speed": "largest speed now",
    "own_axes": "its own axes",
    "speed_so_far": "largest speed so far",
    "thickness_so_far": "largest thickness so far, vertical",
    "thickness": "column thickness, vertical",
    "digest": "digest of the scene",
    "result_digest": "digest of the result",
    "frames_are": "its frames are",
    "contents": "its arrays are",
    "beside": "files beside it",
}
BAND_UNITS = {name: band.unit for name, band in BAND.items() if band.unit != "1"}
WIDEST_VALUE = 110  # [characters] a longer text is cut
MOST_ITEMS = 12  # of a list or table that are shown; the rest is counted


def run(arguments: argparse.Namespace) -> int:
    """Describe each file.

    A file that cannot be read gives an error line and exit code 2, and the others are described. With -o nothing is
    written after an error.

    Parameters
    ----------
    arguments : argparse.Namespace

    Returns
    -------
    int
        Exit code.
    """
    from ...results.reports.file_facts import inspect
    from ...system.errors import MpmgisError, one_line

    answers.require_writable(arguments, arguments.files)
    terms = terms_of(values_of(arguments, VERB))
    code, described = 0, []
    for path in arguments.files:
        try:
            facts = inspect(path, terms)
        except MpmgisError as error:
            terminal.print_error(f"mpmgis info: {one_line(error)}")
            code = error.exit_code
            continue
        described.append(_as_json(facts, arguments.output) if arguments.json else "\n".join(screen_lines(facts)))
        if arguments.output in (None, answers.STDOUT):  # as soon as it is known
            print(*[""] * (len(described) > 1 and not arguments.json), described[-1], sep="\n")
    if arguments.output not in (None, answers.STDOUT) and code == 0:
        answers.print_or_write(("\n" if arguments.json else "\n\n").join(described), arguments)
    return code


def _as_json(facts, output):
    """The facts as JSON; in ASCII where stdout is not UTF-8, as on Windows."""
    whole = output is not None or "utf" in (sys.stdout.encoding or "").lower()
    return json.dumps(facts, ensure_ascii=not whole, allow_nan=False)


def screen_lines(facts: dict[str, Any]) -> list[str]:
    """Return lines of text with the facts about one file, keys and values in two columns.

    Parameters
    ----------
    facts : dict

    Returns
    -------
    list of str
    """
    facts = dict(facts)
    size = f" ({_bytes(facts.pop('bytes'))})" if "bytes" in facts else ""
    rows = list(_rows(facts.items(), _units(facts)))
    title = f"{facts['file']}: {facts['kind']}{size}"
    width = max((len(label) for label, _ in rows), default=0)
    lines = [title, *(f"  {label:{width}}  {value}".rstrip() for label, value in rows)]
    return [terminal.escaped(line) for line in lines]


def _units(facts, units=UNITS):
    """Units of facts by name; those of the map where it is not in metres."""
    unit = {"metre": "m", "degree": "degrees", None: "m"}.get(facts.get("map_unit"), facts.get("map_unit"))
    return units | {"bbox": unit, "cell_size": unit}


def _rows(items, units, depth=0):
    """(label, value) of each fact; tables and lists of tables become indented rows.

    Names of facts become words; names inside a table (bands, keys, columns of a file) are printed unchanged.
    """
    for key, value in items:
        if key == "map_unit" or (key in ("file", "kind", "cells") and not depth):  # cells: see size
            continue
        label = "  " * depth + (str(key) if depth else LABELS.get(key, key.replace("_", " ")))
        if key == "files" and isinstance(value, dict):
            yield label, ", ".join(f"{name} ({'there' if there else 'missing'})" for name, there in value.items())
        elif key in ("maxima", "deposit", "last step") and _are_ranges(value):
            yield label, ""
            for band, (low, high) in value.items():
                yield f"  {'  ' * depth}{band}", _range(low, high, BAND_UNITS.get(band, ""))
        elif key in ("to_be_told", "terrain_notes") and value and not depth:
            yield from zip([label] + [""] * (len(value) - 1), value, strict=True)
        elif isinstance(value, dict):
            yield from _table(label, value, units, depth)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            yield from _tables(label, value, units, depth)
        elif key == "as_terrain":  # a command to copy, printed unabridged
            yield label, value
        elif key in RANGES and not depth and isinstance(value, list) and len(value) == 2:
            yield label, _range(*value, units[key])
        else:
            yield label, _with_unit(key, value, units)


def _are_ranges(value):
    """Whether `value` is a table of (smallest, largest) by band, as of an export; that of a run record is another."""
    return isinstance(value, dict) and all(
        isinstance(pair, (list, tuple)) and len(pair) == 2 for pair in value.values()
    )


def _table(label, table, units, depth):
    """A short table as one line, a longer one as rows."""
    nested = any(isinstance(value, (dict, list)) for value in table.values())
    if not nested and len(table) <= 4:
        yield label, _short(_on_one_line(table, units)) or "none"
        return
    yield label, ""
    shown = list(table.items())[: 2 * MOST_ITEMS]
    yield from _rows(shown, units, depth + 1)
    if len(table) > len(shown):
        yield "  " * (depth + 1) + "...", f"and {len(table) - len(shown)} more (--json shows all)"


def _tables(label, tables, units, depth):
    """A list of tables: a line for each, or rows where it contains lists."""
    for table in tables[:MOST_ITEMS]:
        if any(isinstance(value, list) for value in table.values()):
            yield label, str(table.get("name", ""))
            yield from _rows([item for item in table.items() if item[0] != "name"], _units(table, units), depth + 1)
        else:
            yield label, _short(_on_one_line(table, units))
        label = ""
    if len(tables) > MOST_ITEMS:
        yield "", f"... and {len(tables) - MOST_ITEMS} more (--json shows all)"


def _on_one_line(table, units):
    filled = [(key, value) for key, value in table.items() if value not in (None, "", [])]
    return ", ".join(value if key == "name" else f"{key} {_with_unit(key, value, units)}" for key, value in filled)


def _with_unit(key: str, value: Any, units: dict) -> str:
    numbers = value if isinstance(value, list) and value else [value]
    is_number = all(isinstance(number, (int, float)) and not isinstance(number, bool) for number in numbers)
    return f"{_value(value)} {units[key]}" if is_number and key in units else _value(value)


def _range(low, high, unit):
    return f"{_value(low)} to {_value(high)} {unit}".rstrip() if low is not None else "no value"


def _value(value):
    if value in (None, []):
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}".replace(",", " ") if abs(value) >= 10_000 else str(value)
    if isinstance(value, float):
        return f"{value:.1f}" if 1e4 <= abs(value) < 1e8 else f"{value:.5g}"
    if isinstance(value, list):
        more = f", ... ({len(value)} in all)" if len(value) > MOST_ITEMS else ""
        return _short(", ".join(_value(entry) for entry in value[:MOST_ITEMS]) + more)
    return _short(value) or "unknown"


def _short(text):
    return text if len(text) <= WIDEST_VALUE else text[: WIDEST_VALUE - 3] + "..."


def _bytes(count):
    for unit in ("bytes", "kB", "MB", "GB"):
        if count < 1000 or unit == "GB":
            return f"{count:.3g} {unit}" if unit != "bytes" else f"{count} {unit}"
        count /= 1000
