"""Print answers on stdout, or write them to a file with -o; run the verbs that are an option table and a function.

`-o -` prints the table alone, as CSV or with --json as JSON, and leaves no file.
"""

import argparse
import csv
import json
import math
import tempfile
from collections.abc import Iterable
from functools import partial
from pathlib import Path

from ...system.errors import InputError, OutputError
from ...system.links import input_at
from ...system.whole_files import refuse_existing, whole_file
from ..verb import Verb, module_of, verb_of
from ..verb_calls import complete
from . import terminal
from .parser import values_of
from .progress import show_count

STDOUT = Path("-")  # value of -o
OWN_FACTS = ("compare", "runout")  # verbs whose answers have more than a table


def run(arguments: argparse.Namespace) -> int:
    """Call the function of the verb; its messages are printed after success, or at once with -v.

    Parameters
    ----------
    arguments : argparse.Namespace

    Returns
    -------
    int
        Exit code.

    Raises
    ------
    InputError
        --json with an output that is no table.
    """
    verb = verb_of(arguments.verb)
    values = values_of(arguments, verb)
    if values.get("output") == STDOUT:
        return _run_to_stdout(verb, values)
    if values.get("json") and verb.name not in OWN_FACTS and (values["output"] or Path()).suffix not in ("", ".csv"):
        raise InputError("--json prints the rows of the table; give -o -, a folder, or a .csv")
    _call_and_print(verb, values, arguments)
    return 0


def _run_to_stdout(verb, values):
    """Print the table of an answer."""
    if "json" not in values:
        raise InputError(f"-o - is for answers that are tables; {verb.name} writes other files, give a folder")
    with tempfile.TemporaryDirectory(prefix="mpmgis") as folder:
        file = Path(folder) / f"{verb.name}.csv"
        with terminal.notes_after_success():
            found = _worked(verb, values | {"output": file})
        text = _as_json(found, [file]) if values["json"] else file.read_text(encoding="utf-8")
    print(text, end="" if text.endswith("\n") else "\n")
    return 0


def _worked(verb, values):
    """What the work of a verb returns for options by name."""
    return module_of(verb.name).work(complete(verb, values), partial(show_count, verb.counted))


def _as_json(found, files):
    """Facts of an answer as JSON: its own, else the rows of its table, null where there is no number."""
    if hasattr(found, "facts"):
        return json.dumps(found.facts(), indent=1, allow_nan=False)
    table = next(file for file in map(Path, files) if file.suffix.lower() == ".csv")
    with open(table, encoding="utf-8", newline="") as file:
        lines = (line for line in file if not line.startswith("#"))
        rows = [{name: _value(text) for name, text in row.items()} for row in csv.DictReader(lines)]
    return json.dumps({"rows": rows}, indent=1, allow_nan=False)


def _value(text):
    """A number of the text of a cell, None where it is empty or no number of a table, else the text."""
    try:
        number = float(text)
    except (TypeError, ValueError):
        return text or None
    return (int(text) if text.lstrip("-").isdigit() else number) if math.isfinite(number) else None


def _call_and_print(verb: Verb, values: dict, arguments: argparse.Namespace) -> None:
    with terminal.notes_after_success():
        found = _worked(verb, values)
    if verb.name == "compare":
        for file in found.files:
            terminal.note(f"wrote {file}")
    if values.get("json"):
        print(_as_json(found, found.files))
    elif isinstance(found, (list, tuple)):
        terminal.list_files(found, arguments)
    else:
        lines = found.lines() if hasattr(found, "lines") else []
        print("\n".join([*lines, *([] if verb.name == "compare" else map(str, found.files))]))
    if verb.name == "export-raster" and values["qgis"]:
        terminal.note(f"open {found[0]} in QGIS (double-click), then press play in the Temporal Controller")


def require_writable(arguments: argparse.Namespace, inputs: Iterable[str | Path]) -> None:
    """Raise an error, before the work, unless the output file can be written.

    Parameters
    ----------
    arguments : argparse.Namespace
    inputs : iterable of path

    Raises
    ------
    OutputError
        The file exists and --overwrite is not given, or it is one of `inputs`.
    """
    if arguments.output in (None, STDOUT):
        return
    refuse_existing(arguments.output, arguments.overwrite)
    if input_at(arguments.output, inputs) is not None:
        raise OutputError(f"{arguments.output} is also an input; give another -o")


def print_or_write(text: str, arguments: argparse.Namespace) -> None:
    """Print a text, or write it to the file of -o and print the path of that file.

    Parameters
    ----------
    text : str
    arguments : argparse.Namespace
    """
    if arguments.output in (None, STDOUT):
        print(text)
        return
    with whole_file(arguments.output) as part:
        part.write_text(text + "\n", encoding="utf-8", newline="\n")
    print(arguments.output)
