"""Write the files of a calibration: record, tables, plots, and a map of the misfit of the best run of each event."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .. import __version__
from ..laws.quantities import Quantity
from ..results.comparison import overlap
from ..results.comparison_files import MapSide, write_classes, write_classes_style, write_comparison_map
from ..results.flow_line import runout
from ..system.csv_rows import write_records
from ..system.whole_files import output_error, whole_file
from .calibration_options import AskedCalibration
from .calibration_plots import write_pairs
from .calibration_result import Calibration

if TYPE_CHECKING:
    from .event_comparison import EventOnGrid

RECORD_FILE = "calibrate.json"
SAMPLES_FILE = "samples.csv"
RUNS_FILE = "runs.csv"
PAIRS_FILE = "pairs.png"
MISFIT = "misfit"  # name of the map, without suffix
SAMPLES = 1000  # number of draws in the table
SAMPLE_DIGITS = 4  # significant digits of a draw


def write_files(
    output: Path, result: Calibration, events: "list[EventOnGrid]", runs: dict, asked: AskedCalibration
) -> tuple[Path, ...]:
    """Write all files into a folder, and return their paths, the record first.

    Parameters
    ----------
    output : Path
    result : Calibration
    events : list of EventOnGrid
    runs : dict of str to list of (Members, int)
        By event.
    asked : AskedCalibration

    Raises
    ------
    OutputError
        The folder cannot be created.
    """
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise output_error(output, error) from error
    overlaps, maps = {}, []
    for event in events:
        if event.outline is not None:
            name = MISFIT if len(events) == 1 else f"{MISFIT}_{event.event.name}"
            found, files = _write_misfit(output, name, event, runs[event.event.name][result.best])
            overlaps[event.event.name] = found
            maps += files
    record = _record(result, events, overlaps, asked)
    with whole_file(output / RECORD_FILE) as part:
        part.write_text(json.dumps(record, indent=1, allow_nan=False) + "\n", encoding="utf-8", newline="\n")
    draws = result.values_of(result.posterior.drawn(SAMPLES, asked["seed"]))
    write_records(output / SAMPLES_FILE, [*result.priors], [[_short(v) for v in row] for row in draws])
    rows = [
        [*values, misfit, *simulated]
        for values, misfit, simulated in zip(result.values, result.misfits, result.simulated, strict=True)
    ]
    write_records(output / RUNS_FILE, [*result.priors, "misfit", *result.names], rows)
    write_pairs(output / PAIRS_FILE, result, draws)
    return tuple(output / name for name in (RECORD_FILE, PAIRS_FILE, SAMPLES_FILE, RUNS_FILE)) + tuple(maps)


def _short(value):
    return float(f"{value:.{SAMPLE_DIGITS}g}")


def _record(result, events, overlaps, asked):
    summaries = [
        {"name": name, "observed": _short(observed), "error": _short(np.sqrt(variance)), "best_run": _short(best)}
        for name, observed, variance, best in zip(
            result.names, result.observed, result.variances, result.simulated[result.best], strict=True
        )
    ]
    names = ("scene", "observed", "points", "deposit", "volume", "line")
    given = [
        {name: _plain(getattr(event.event, name)) for name in names if getattr(event.event, name) is not None}
        for event in events
    ]
    return {
        "format": "mpmgis-calibration",
        "format_version": 1,
        "version": __version__,
        "seed": asked["seed"],
        "events": given,
        **result.record(),
        "best_run_outline": overlaps,
        "summaries": summaries,
    }


def _plain(value):
    return list(value) if isinstance(value, tuple) else str(value)


def _write_misfit(output: Path, name: str, event: "EventOnGrid", run: tuple) -> tuple[dict, list]:
    """Return ({"missed_m2", "over_covered_m2", "iou"} of the best run, paths of map, raster and style)."""
    covered, grid = event.covered(run), event.grid
    found = overlap(event.mask, covered, grid.cell_area)
    files = [output / f"{name}.{suffix}" for suffix in ("png", "tif", "qml")]
    sides = (
        MapSide("observed", event.mask, found.only_first, runout(event.mask, grid, event.line)),
        MapSide("best run", covered, found.only_second, runout(covered, grid, event.line)),
    )
    title = f"{event.event.name}: overlap (IoU) {found.iou:.2f} of the best run"
    write_comparison_map(files[0], event.terrain, grid, sides, found.both, event.line, title)
    members, k = run
    depth = members.band(k, "h_max")
    write_classes(files[1], grid, event.mask, covered, (None, depth), Quantity("h_max", "m", ""))
    write_classes_style(files[2])
    facts = {
        "missed_m2": round(found.only_first),
        "over_covered_m2": round(found.only_second),
        "iou": round(found.iou, 2),
    }
    return facts, files
