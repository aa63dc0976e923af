"""Print one screen about any file that mpmgis reads or writes."""

import argparse
import json
import sys
from typing import Any

from ...laws.quantities import BAND
from ...results.reports.fact_table import BANDS, EXISTS, HIDDEN, LINES, MAP, NAMED, RANGE, WHOLE, Words
from ..info import VERB
from ..info import terms as terms_of
from . import answers, terminal
from .parser import values_of

TITLE = ("file", "kind", "bytes")  # facts in the first line
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
    code, texts = 0, []
    for path in arguments.files:
        try:
            facts = inspect(path, terms)
        except MpmgisError as error:
            terminal.print_error(f"mpmgis info: {one_line(error)}")
            code = error.exit_code
            continue
        texts.append(_as_json(facts, arguments.output) if arguments.json else "\n".join(screen_lines(facts)))
        if arguments.output in (None, answers.STDOUT):  # as soon as it is known
            print(*[""] * (len(texts) > 1 and not arguments.json), texts[-1], sep="\n")
    if arguments.output not in (None, answers.STDOUT) and code == 0:
        answers.print_or_write(("\n" if arguments.json else "\n\n").join(texts), arguments)
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
    size = f" ({_bytes(facts['bytes'])})" if "bytes" in facts else ""
    rows = list(_rows(facts))
    title = f"{facts['file']}: {facts['kind']}{size}"
    width = max((len(label) for label, _ in rows), default=0)
    lines = [title, *(f"  {label:{width}}  {value}".rstrip() for label, value in rows)]
    return [terminal.escaped(line) for line in lines]


def _map_unit(values):
    """The unit of coordinates on the map, in a table of facts by key."""
    unit = values.get("map_unit")
    return {"metre": "m", "degree": "degrees", None: "m"}.get(unit, unit)


def _rows(facts):
    """(label, value) of each fact; tables and lists of tables become indented rows."""
    map_unit = _map_unit(facts)
    for key, value in facts.items():
        if key in TITLE:
            continue
        words, unit = NAMED.get(key, Words()), _unit(key, map_unit)
        label = words.text or key.replace("_", " ")
        if words.form == EXISTS and isinstance(value, dict):
            yield label, ", ".join(f"{name} ({'there' if there else 'missing'})" for name, there in value.items())
        elif words.form == BANDS and _are_ranges(value):
            yield label, ""
            for band, (low, high) in value.items():
                yield f"  {band}", _range(low, high, BAND_UNITS.get(band, ""))
        elif words.form == LINES and value:
            yield from zip([label] + [""] * (len(value) - 1), value, strict=True)
        elif words.form == WHOLE:
            yield label, value
        elif words.form == RANGE and isinstance(value, list) and len(value) == 2:
            yield label, _range(*value, unit)
        elif words.form != HIDDEN:
            yield from _entry(label, value, unit, map_unit, 0)


def _are_ranges(value):
    """Whether `value` is a table of (smallest, largest) by band, as of an export; that of a run record is another."""
    return isinstance(value, dict) and all(
        isinstance(pair, (list, tuple)) and len(pair) == 2 for pair in value.values()
    )


def _entry(label, value, unit, map_unit, depth):
    """A value, a table or a list of tables of any fact."""
    if isinstance(value, dict):
        yield from _table(label, value, map_unit, depth)
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        yield from _tables(label, value, depth)
    else:
        yield label, _with_unit(value, unit)


def _within(items, map_unit, depth):
    """Rows of a table in a fact; its names (bands, keys, columns of a file) are printed unchanged."""
    for key, value in items:
        if key != "map_unit":
            yield from _entry("  " * depth + key, value, _unit(key, map_unit), map_unit, depth)


def _unit(key, map_unit):
    unit = NAMED[key].unit if key in NAMED else ""
    return map_unit if unit == MAP else unit


def _table(label, table, map_unit, depth):
    """A short table as one line, a longer one as rows."""
    nested = any(isinstance(value, (dict, list)) for value in table.values())
    if not nested and len(table) <= 4:
        yield label, _short(_on_one_line(table, map_unit)) or "none"
        return
    yield label, ""
    shown = list(table.items())[: 2 * MOST_ITEMS]
    yield from _within(shown, map_unit, depth + 1)
    if len(table) > len(shown):
        yield "  " * (depth + 1) + "...", f"and {len(table) - len(shown)} more (--json shows all)"


def _tables(label, tables, depth):
    """A list of tables: a line for each, or rows where it contains lists."""
    for table in tables[:MOST_ITEMS]:
        unit = _map_unit(table)
        if any(isinstance(value, list) for value in table.values()):
            yield label, str(table.get("name", ""))
            yield from _within([item for item in table.items() if item[0] != "name"], unit, depth + 1)
        else:
            yield label, _short(_on_one_line(table, unit))
        label = ""
    if len(tables) > MOST_ITEMS:
        yield "", f"... and {len(tables) - MOST_ITEMS} more (--json shows all)"


def _on_one_line(table, map_unit):
    filled = [(key, value) for key, value in table.items() if value not in (None, "", [])]
    words = (value if key == "name" else f"{key} {_with_unit(value, _unit(key, map_unit))}" for key, value in filled)
    return ", ".join(words)


def _with_unit(value: Any, unit: str) -> str:
    numbers = value if isinstance(value, list) and value else [value]
    is_number = all(isinstance(number, (int, float)) and not isinstance(number, bool) for number in numbers)
    return f"{_value(value)} {unit}" if is_number and unit else _value(value)


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
