"""Answer `mpmgis report`: one HTML file about a run."""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ... import __version__
from ...frames.headline_numbers import ERROR_TAG
from ...frames.run_folder import SCENE_FILE, read_record, versions
from ...frames.run_maps import run_of_maps
from ...frames.run_terrain import dtm_name
from ...laws.quantities import SQUARE_METRES_PER_HECTARE
from ...maps.export.band_map import write_band_map
from ...maps.export.export_inputs import release_outlines
from ...simulation.companion_run import companion_lines
from ...simulation.run_summary import account, extreme_lines, peak_lines, resolution_words, volume_words
from ...system.errors import MpmgisError, one_line
from ...system.messages import Progress, collected, log, unwatched
from ...system.option import PathLike
from ..answer_files import answer_output, write_answer
from ..comparison import footprint, high_percentile, peak
from ..opened_results import ExportFlow, open_flow, peaks_of, read_peaks
from ..question_options import Question
from ..runout_answer import found_runout, write_runout_plot
from .flow_player import INSTALL, can_play, encoded_flow, flow_player
from .html_page import Lines, Picture, Source, Table, figure_rows, section, write_report
from .printed_numbers import printed, printed_line, printed_place
from .report_pages import Gathered, barrier_sections, places_section

REPORT_FILE = "report.html"
WORD = "report"  # end of the name of the default output folder
MAPS = (  # band of the result, style of the map, title
    ("h_max", "h_max", "Largest flow depth"),
    ("Ut_max", "Ut_max", "Largest speed along the slope"),
    ("p_max", "p_max", "Largest impact pressure"),
    ("h_deposit", "h", "Depth of the deposit"),
    ("h_last", "h", "Depth in the last step"),
)
USED_OF_RASTERS = ("density", "min_depth")  # options of frames, for the pressure and the maps
DEPOSIT = "deposit_"  # before the name of a figure of the runout
PASCAL_PER_KILOPASCAL = 1000.0
_EFFECT_COLUMNS = {  # key of a decision: heading
    "effect": "effect",
    "state": "state",
    "decided_by": "decided by",
    "indicator": "number",
    "threshold": "threshold",
    "reason": "reason",
}
_CHECKS = {"resolution": resolution_words, "volume": volume_words}  # key of a stage's record: its words


def report(
    asked: Question,
    title: str | None,
    line: PathLike | None,
    threshold: float,
    about: Mapping[str, str | None],
    player: bool = True,
    progress: Progress = unwatched,
) -> tuple[Path, ...]:
    """Write the report: warnings, player, maps, runout, balances, parameters, effects and why, versions, digests.

    Parameters
    ----------
    asked : Question
    title : str or None
        None: the name of the results.
    line : path or None
        Of the profile; None: the centre line of the flow.
    threshold : float [m]
        Of the depth of the footprint.
    about : dict of str to str or None
        What stands below the heading, such as date and author, by its word; what has no text is omitted.
    player : bool
        With the flow over time, if the library is installed.
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    tuple of Path

    Raises
    ------
    MpmgisError
    """
    output = answer_output(asked, WORD, (REPORT_FILE,))
    gathered = _gather(asked, output, line, threshold, progress)
    title = title or f"{gathered.flow.name}: report of a simulated flow"
    with tempfile.TemporaryDirectory(prefix="mpmgis-report-") as folder:
        sections = (
            section("Warnings", _warnings(gathered)),
            section("Result", _key_figures(gathered, threshold)),
            section("The flow over time", _played(gathered) if player else None),
            section("Maps", *_maps(gathered, Path(folder))),
            places_section(gathered, Path(folder)),
            section("Runout", *_runout(gathered, Path(folder))),
            *barrier_sections(gathered, Path(folder)),
            section("Numerical error", _numerical_error(gathered)),
            section("Balances", _balances(gathered.record, gathered.flow), Lines(_checks(gathered.record))),
            section("Effects, and why", *_effects(gathered.record)),
            section("Parameters", Source(gathered.scene) if gathered.scene else None),
            section("Origin", _origin(gathered)),
        )
    head = "; ".join(f"{what}: {text}" for what, text in about.items() if text)
    under = (head, f"made by mpmgis {__version__} from {_made_from(gathered.flow)}")
    writers = {REPORT_FILE: lambda path: write_report(path, title, under, filter(None, sections))}
    return write_answer(output, asked["overwrite"], writers)


def _played(gathered):
    """The Player; None, with a message, where there is none."""
    flow, depth = gathered.flow, gathered.peaks.get("h_max")
    if depth is None or len(flow.times) < 2:
        return None
    if not can_play():
        log.info(f"the report does not play the flow, because Bokeh is not installed: {INSTALL}")
        return None
    played = encoded_flow(flow, depth, gathered.grid)
    if isinstance(played, str):
        log.info(f"the report does not play the flow: {played}")
        return None
    if len(played.times) < len(flow.times):
        log.info(f"the report plays {len(played.times)} of {len(flow.times)} steps, to be small enough for mail")
    return flow_player(played, flow.terrain, gathered.peaks, gathered.grid, flow.min_depth, gathered.release or ())


def _gather(asked: Question, output: Path, line: PathLike | None, threshold: float, progress: Progress) -> Gathered:
    with collected() as notes:
        flow = open_flow(asked, output, peaks_do=True, used=USED_OF_RASTERS)
        result = peaks_of(asked, progress, used_of_rasters=USED_OF_RASTERS)
        values, grid = read_peaks(result, tuple(band for band, *_ in MAPS), asked["density"])
        try:
            runout = found_runout(flow, values, grid, result.end, line, threshold)
        except MpmgisError as error:  # a report without runout
            if line is not None:
                raise
            log.info(f"no runout: {error}")
            runout = None
    release = release_outlines(flow.entries, flow.terrain) if flow.entries else None
    record, scene = _of_the_run(flow)
    return Gathered(flow, values, grid, record, scene, runout, tuple(dict.fromkeys(notes)), release, result.end)


def _of_the_run(flow):
    """(run.json, text of the scene) of the frames, or of rasters that a run wrote; else ({}, "")."""
    folder = flow.entries[0].path.parent if flow.entries else None
    if isinstance(flow, ExportFlow):
        folder = run_of_maps(flow.steps.terrain.parent)
    if folder is None:
        return {}, ""
    scene = folder / SCENE_FILE
    return read_record(folder), scene.read_text(encoding="utf-8", errors="replace") if scene.is_file() else ""


def _made_from(flow):
    """Source of a flow in words."""
    if flow.entries:
        return f"{len(flow.entries)} frames"
    return f"an export of {len(flow.times)} steps" if len(flow.times) else "rasters of its largest values"


def _key_figures(gathered, threshold):
    flow, peaks, record = gathered.flow, gathered.peaks, gathered.record
    first = gathered.runout.states[0].mass if gathered.runout and gathered.runout.states else np.nan
    facts = [
        ("solver", _solver(flow, record), ""),
        ("mass of the first frame", first, "kg"),
        ("volume of the first frame at the density of the release", first / (flow.density or np.nan), "m3"),
        ("density of the release", flow.density, "kg m-3"),
        ("last frame at", float(flow.times[-1]) if len(flow.times) else None, "s"),
        ("last step", None if gathered.end is None else gathered.end.words(), ""),
    ]
    if "h_max" in peaks:
        reached = np.count_nonzero(footprint(peaks["h_max"], threshold)) * gathered.grid.cell_area
        facts.append((f"area deeper than {threshold:g} m", float(reached) / SQUARE_METRES_PER_HECTARE, "ha"))
    for band, unit, factor, words in (
        ("h_max", "m", 1.0, "flow depth"),
        ("Ut_max", "m/s", 1.0, "speed along the slope"),
        ("p_max", "kPa", 1 / PASCAL_PER_KILOPASCAL, "impact pressure"),
        ("h_deposit", "m", 1.0, "depth of the deposit"),
        ("h_last", "m", 1.0, "depth in the last step"),
    ):
        words += _direction(band, flow)
        if band in peaks:
            facts.append((f"largest {words}", peak(peaks[band]) * factor, unit))
            facts.append((f"largest {words}, at", _place_of_peak(peaks[band], gathered.grid), ""))
            facts.append((f"99th percentile of {words}", high_percentile(peaks[band]) * factor, unit))
    ended = [("ended", f"{record['state']}: {record['reason']}", "")] if record.get("reason") else []
    return Table(("figure", "value"), figure_rows([*facts, *ended]))


def _direction(band, flow):
    """Direction of the depth of a band; "" for rasters of other codes, where it is unknown."""
    depth = band in ("h_max", "h_deposit", "h_last")
    return " (normal to the slope)" if depth and (flow.entries or len(flow.times)) else ""


def _place_of_peak(values, grid):
    """Map coordinates of the cell with the largest of float[rows, columns] `values`; None without values."""
    if not np.isfinite(values).any():
        return None
    x, y = grid.xy(*np.unravel_index(np.nanargmax(values), values.shape))
    return printed_place(float(x), float(y))


def _solver(flow, record):
    """Name of the solver; None if only rasters are known."""
    if not flow.entries:
        return None
    first = flow.entries[0]
    if record.get("stages"):
        return ", then ".join(str(stage.get("solver")) for stage in record["stages"])
    return (record.get("scene") or {}).get("solver", first.header.solver or first.reader)


def _maps(gathered, folder):
    """Pictures of the bands of the flow."""
    flow = gathered.flow
    for band, look, title in MAPS:
        values = gathered.peaks.get(band)
        if values is not None and np.isfinite(values).any():
            path = folder / f"{band}.png"
            write_band_map(path, flow.terrain, gathered.grid, values, look, title, gathered.release, flow.min_depth)
            title += f", {gathered.end.moving_words()}" if band == "h_last" and gathered.end else ""
            title += _direction(band, flow)
            yield Picture(path.read_bytes(), f"{title}, on cells of {gathered.grid.cell_size:g} m")


def _runout(gathered, folder):
    found = gathered.runout
    if found is None:
        return
    path = folder / "runout.png"
    write_runout_plot(path, found)
    yield Picture(path.read_bytes(), f"Longitudinal profile along {found.line_source}")
    rows = [(what, value, "" if unit == "1" else unit) for what, unit, value in found.rows()]
    of_deposit = dict(figure_rows([row for row in rows if row[0].startswith(DEPOSIT)]))
    of_flow = figure_rows([row for row in rows if not row[0].startswith(DEPOSIT)])
    if of_deposit:
        table = tuple((what.replace("_", " "), value, of_deposit.get(DEPOSIT + what, "")) for what, value in of_flow)
        yield Table(("figure", "flow", "deposit"), table)
    else:
        yield Table(("figure", "value"), tuple((what.replace("_", " "), value) for what, value in of_flow))


def _balances(record, flow):
    """Balances that the run stored at its end."""
    balances = record.get("balances")
    if not balances:
        why = "no run.json beside the frames" if flow.entries else "rasters have no balances"
        return Lines((f"{why}: balances are not known",))
    solver = "points" if "momentum_error_relative" in balances else "columns"
    try:
        mass = record.get("mass")
        of_stages = [] if mass is None else extreme_lines(record["extremes"])
        lines = (*account(balances, solver, mass), *of_stages, *peak_lines(record.get("maxima")))
        return Lines(tuple(map(printed_line, lines)))
    except (KeyError, TypeError, ValueError) as error:  # balances of another version
        known = (f"{name}: {value:.6g}" for name, value in balances.items() if isinstance(value, int | float))
        return Lines((f"run.json is of another version of mpmgis and has no {one_line(error)}; it contains:", *known))


def _numerical_error(gathered):
    """Lines about the companion run; that of an export from its tag; None where nothing is known."""
    try:
        lines = companion_lines(gathered.record.get("companion"))
    except (KeyError, TypeError, ValueError):  # a record of another version
        lines = []
    if not lines and len(gathered.flow.times) and not gathered.flow.entries:
        lines = list(filter(None, [gathered.flow.steps.tags.get(ERROR_TAG)]))
    return Lines(tuple(lines)) if lines else None


def _checks(record):
    """Lines for each stage of points: number of cells over the depth at its start, volume of points at its end."""
    lines, stages = [], record.get("stages") or [record]
    for number, stage in enumerate(stages, start=1):
        words = ((name, stage.get(name)) for name in _CHECKS)
        found = [_check(name, numbers) for name, numbers in words if numbers]
        lines += [f"stage {number}: {line}" for line in found] if len(stages) > 1 else found
    return tuple(lines)


def _check(name, numbers):
    try:
        return _CHECKS[name](numbers)
    except (KeyError, TypeError, ValueError) as error:  # numbers of another version
        return f"run.json is of another version of mpmgis, its {name} has no {one_line(error)}"


def _warnings(gathered):
    """Problems and assumptions of the run and of reading its frames."""
    record = gathered.record
    lines = [*(record.get("troubles") or ())]
    lines += [_against_its_number(decision) for stage in _stages(record) for decision in stage.get("effects") or ()]
    lines += [line for line in _balances(record, gathered.flow).texts if line.startswith("beyond the model")]
    lines += [line for line in _checks(record) if "too coarse" in line]
    lines += gathered.notes
    return Lines(tuple(dict.fromkeys(filter(None, map(str, lines)))) or ("none",))


def _against_its_number(decision):
    """Text about an effect that is off although its number is beyond the threshold; '' for others."""
    number, threshold = decision.get("indicator"), decision.get("threshold")
    if decision.get("state") != "off" or not all(isinstance(value, int | float) for value in (number, threshold)):
        return ""
    if not number > threshold:
        return ""
    return (
        f"{decision.get('effect')} is off although its number {number:.3g} is beyond {threshold:g}: "
        f"{decision.get('reason')}"
    )


def _stages(record):
    """The records of the stages; one without stages."""
    return record.get("stages") or [{"effects": record.get("effects")}]


def _effects(record):
    """A table of decisions for each stage; those that are on come first."""
    stages = _stages(record)
    for number, stage in enumerate(stages, start=1):
        if len(stages) > 1:
            yield Lines((f"stage {number}: {stage.get('solver', '')}",))
        decisions = sorted(stage.get("effects") or (), key=lambda decision: decision.get("state") == "off")
        rows = tuple(tuple(_word(decision.get(key)) for key in _EFFECT_COLUMNS) for decision in decisions)
        if rows:
            yield Table(tuple(_EFFECT_COLUMNS.values()), rows)


def _word(value):
    return "" if value is None else printed(value) if isinstance(value, float) else str(value)


def _origin(gathered):
    flow, record = gathered.flow, gathered.record
    wall = record.get("wall_seconds")
    rows = [
        *_source_rows(flow),
        ("terrain", dtm_name(flow.terrain.path)),
        ("sha256 of the terrain", flow.terrain.sha256),
        ("CRS", "local" if flow.terrain.grid.crs is None else flow.terrain.grid.crs.name),
        ("digest of the result", record.get("result_digest") or ""),
        *((f"computed with {name}", version) for name, version in (record.get("versions") or {}).items()),
        *((f"reported with {name}", version) for name, version in versions().items()),
        ("wall time", f"{wall:.3g} s" if isinstance(wall, int | float) else ""),
    ]
    return Table(("what", "is"), tuple((what, value) for what, value in rows if value))


def _source_rows(flow):
    """Rows of a table about the inputs."""
    if flow.entries:
        first = flow.entries[0]
        folder = first.path.resolve().parent.name
        return (
            ("frames", f"{len(flow.entries)} in {folder}, read as {first.reader}"),
            ("digest of the scene", first.header.digest),
        )
    if len(flow.times):
        tags = flow.steps.tags
        return (
            ("export", f"{flow.name}, {len(flow.times)} steps; frames: {tags.get('frames', '')}"),
            ("digest of the scene", tags.get("digest", "")),
            ("exported with mpmgis", tags.get("version", "")),
        )
    return (("rasters", flow.name),)
