"""Answers on stdout, or in a file with -o; runs the verbs that consist of an option table and a workflow.

`-o -` prints the table alone, as CSV or with --json as JSON, and leaves no file.

Lines of text that the verbs about results print.
"""

import csv
import json
import math
import tempfile
from pathlib import Path

from ...system.errors import InputError, OutputError
from ...system.folder_lock import one_of
from ...system.whole_files import refuse_existing, whole_file
from ..option import verb_of
from ..option_values import request
from ..verb_calls import workflow_of
from . import terminal
from .parser import values_of
from .progress import frame_progress

SQUARE_METRES_PER_HECTARE = 1e4
SERIES_HEADINGS = ("point", "arrival [s]", "largest h [m]", "at [s]", "largest Ut [m/s]", "at [s]")
LOAD_HEADINGS = (
    "time [s]", "h normal [m]", "momentum [kN/m]", "at height [m]", "largest p [kPa]", "overburden [kN/m]",
    "at height [m]",
)  # fmt: skip
COLUMN_WIDTH = 19
HEAD_WIDTH = 46  # of the name of a quantity


def lines_of(verb, found, values):
    """Lines of text about the result of the workflow of `verb`, then the paths of its files.

    Parameters
    ----------
    verb : str
    found : object
        Result of the workflow: paths, or an object with `files`.
    values : dict
        Options of the command by name.
    """
    if isinstance(found, (list, tuple)):
        return [str(path) for path in found]
    own = _LINES.get(verb, lambda found, values: [])(found, values)
    return [*own, *([] if verb == "compare" else map(str, found.files))]


def _runout(found, values):
    """Lines of text about a RunoutFound."""
    lines = [f"{found.name}: cells deeper than {found.threshold:g} m, along {found.line_source}"]
    for quantity, unit, value in found.rows():
        head = f"{quantity.replace('_', ' ')} [{unit}]" if unit != "1" else quantity.replace("_", " ")
        lines.append(f"{head:<40}{_figure(value):>10}")
    return lines


def _figure(value):
    if not math.isfinite(value):
        return "-"
    return f"{value:.1f}" if abs(value) >= 10 else f"{value:.3f}"


def _timeseries(found, values):
    """Lines of text about a SeriesFound."""
    width = max(map(len, (*found.names, SERIES_HEADINGS[0]))) + 2
    lines = [f"{SERIES_HEADINGS[0]:<{width}}" + "".join(f"{word:>18}" for word in SERIES_HEADINGS[1:])]
    for point, name in enumerate(found.names):
        numbers = found.arrival(point, values["min_depth"]), *found.peak("h", point), *found.peak("Ut", point)
        lines.append(f"{name:<{width}}" + "".join(f"{_short(value):>18}" for value in numbers))
    return lines


def _short(value):
    return f"{value:.4g}" if math.isfinite(value) else "-"


def _hydrograph(found, values):
    """Lines of text about a HydrographFound."""
    cells_volume, cells_mass = found.cells_totals()[-1]
    rate, time = found.peak()
    counted = f"{found.by_particles.sum()} of {len(found.by_particles)} intervals counted by particles"
    lines = [
        f"{found.name}: positive towards {found.azimuth:.0f} degrees from north; {counted}",
        f"through the section   {found.volume.sum():.6g} m3, {found.mass.sum():.6g} kg",
        f"by flux of cells      {cells_volume:.6g} m3, {cells_mass:.6g} kg",
        f"largest discharge     {rate:.6g} m3/s, mean of the interval to {time:g} s",
    ]
    balance = found.balance
    if balance is not None:
        parts = f"{balance.crossed:.6g} through it, {balance.round_ends:.6g} around its ends, {balance.began:.6g}"
        lines.append(
            f"mass beyond it        {balance.beyond:+.6g} kg = {parts} new there; error {balance.error:.1e} kg"
        )
    if found.unseen > 0:
        lines.append(f"up to {found.unseen:.6g} kg appeared or disappeared between two frames; counted from then on")
    return lines


def _vertical(found, values):
    """Lines of text about a VerticalFound."""
    width = max(map(len, (*found.names, "point"))) + 2
    lines = [f"{'point':<{width}}" + "".join(f"{word:>{COLUMN_WIDTH}}" for word in LOAD_HEADINGS)]
    for name, _, _, time, depth, momentum, height, largest, weight, height_of_weight in found.load_rows():
        cells = (time, depth, momentum / 1e3, height, largest / 1e3, weight / 1e3, height_of_weight)
        lines.append(f"{name:<{width}}" + "".join(f"{_short(value):>{COLUMN_WIDTH}}" for value in cells))
    return lines


def _intensity(found, values):
    """Lines of text about an IntensityFound."""
    guideline = found.guideline
    lines = [f"{found.name}: {guideline.title or guideline.name}", f"by {guideline.source}"]
    if guideline.note:
        lines.append(f"({guideline.note})")
    width = max(len(entry.name) for entry in guideline.classes) + 2
    for entry, area in zip(guideline.classes, found.areas, strict=True):
        lines.append(f"{entry.name:<{width}}{area / SQUARE_METRES_PER_HECTARE:>10.2f} ha   {entry.words()}")
    return lines + [f"{entry.name}: {entry.origin()}" for entry in guideline.classes if entry.read_in]


def _hazard_map(found, values):
    """Lines of text about a HazardFound."""
    matrix = found.matrix
    lines = [f"{matrix.title or matrix.name}", f"by {matrix.source}", *([f"({matrix.note})"] if matrix.note else [])]
    width = max(len(level.name) for level in matrix.levels) + 2
    for level, area in zip(matrix.levels, found.areas, strict=True):
        lines.append(f"{level.name:<{width}}{area / SQUARE_METRES_PER_HECTARE:>10.2f} ha   {level.meaning}")
    if found.not_assessed:
        lines.append(f"not assessed, no data: {found.not_assessed / SQUARE_METRES_PER_HECTARE:.2f} ha")
    if matrix.is_unread:
        lines.append("numbers of this matrix are not verified in the document in part; check them there")
    return lines


def _compare(found, values):
    """Lines of text about a Comparison."""
    lines = [_headline(letter, side) for letter, side in zip("AB", found.sides, strict=True)]
    band = next(side.band for side in found.sides if side.band is not None)
    lines.append(
        f"footprint: {band} above {found.threshold:g} {found.unit}".rstrip()
        + f"; overlap on cells of {found.cell_size:g} m; runout along {found.line_source}"
    )
    lines.append("")
    lines.append(_row("", "", "A", "B", "A - B", "%"))
    lines += [_number_row(*row) for row in found.rows()]
    lines.append("")
    overlap = found.overlap
    for text, area in found.area_words():
        share = f"{100 * area / overlap.either:.1f} %"
        lines.append(_row(text, "ha", _text(area / SQUARE_METRES_PER_HECTARE), share))
    lines.append(_row("overlap (IoU)", "", f"{overlap.iou:.3f}"))
    if found.observed is not None:
        lines.append(_row("share of the outline reached", "", f"{100 * found.observed_reached:.1f} %"))
    lines += [_row(quantity, unit, _text(value)) for quantity, unit, value in found.distance_rows()]
    compared = [band for band in found.bands if math.isfinite(band.difference.mean)]
    if compared:
        lines += ["", _row("A - B where both flowed", "", "mean", "rms")]
        lines += [
            _row(band.name, band.unit, _text(band.difference.mean), _text(band.difference.rms)) for band in compared
        ]
    return lines


def _headline(letter, side):
    return f"{letter}  {side.name} ({side.kind}{f', {side.band}' if side.band else ''})"


def _number_row(quantity, unit, first, second, gap):
    scale = SQUARE_METRES_PER_HECTARE if unit == "m2" else 1.0
    share = 100 * gap / abs(second) if second else math.nan
    cells = [_text(value / scale) for value in (first, second, gap)]
    return _row(quantity, "ha" if unit == "m2" else unit, *cells, f"{share:+.1f}" if math.isfinite(share) else "-")


def _row(quantity, unit, *cells):
    head = f"{quantity} [{unit}]" if unit else quantity
    return (f"{head:<{HEAD_WIDTH}}" + "".join(f"{cell:>12}" for cell in cells)).rstrip()


def _text(value):
    """Four digits of a number; a dash where it is not finite."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.4g}"


_LINES = {
    "runout": _runout,
    "timeseries": _timeseries,
    "hydrograph": _hydrograph,
    "vertical": _vertical,
    "intensity": _intensity,
    "report": _hazard_map,
    "compare": _compare,
}


STDOUT = Path("-")  # value of -o
OWN_FACTS = ("compare", "runout")  # verbs whose answers have more than a table


def run(arguments):
    """Call the workflow; its messages are printed after success, or at once with -v."""
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
    workflow, kind = workflow_of(verb)
    with tempfile.TemporaryDirectory(prefix="mpmgis") as folder:
        file = Path(folder) / f"{verb.name}.csv"
        with terminal.notes_after_success():
            found = workflow(request(verb, kind, values | {"output": file}), frame_progress)
        text = _as_json(found, [file]) if values["json"] else file.read_text(encoding="utf-8")
    print(text, end="" if text.endswith("\n") else "\n")
    return 0


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


def _call_and_print(verb, values, arguments):
    workflow, kind = workflow_of(verb)
    with terminal.notes_after_success():
        found = workflow(request(verb, kind, values), frame_progress)
    if verb.name == "compare":
        for file in found.files:
            terminal.note(f"wrote {file}")
    if values.get("json"):
        print(_as_json(found, found.files))
    elif isinstance(found, (list, tuple)):
        terminal.list_files(found, arguments)
    else:
        print("\n".join(lines_of(verb.name, found, values)))
    if verb.name == "export-raster" and values["qgis"]:
        terminal.note(f"open {found[0]} in QGIS (double-click), then press play in the Temporal Controller")
    return 0


def require_writable(arguments, inputs):
    """Refuse, before the work, an output file that exists without --overwrite, or that is one of `inputs`."""
    if arguments.output in (None, STDOUT):
        return
    refuse_existing(arguments.output, arguments.overwrite)
    if one_of(arguments.output, inputs) is not None:
        raise OutputError(f"{arguments.output} is also an input; give another -o")


def give(text, arguments):
    """Print `text`, or write it to the file of -o and print the path of that file."""
    if arguments.output in (None, STDOUT):
        print(text)
        return
    with whole_file(arguments.output) as part:
        part.write_text(text + "\n", encoding="utf-8", newline="\n")
    print(arguments.output)
