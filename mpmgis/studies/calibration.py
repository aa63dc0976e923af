"""`mpmgis calibrate`: posterior of parameters from observations of events, by runs and an emulator of their summaries.

Runs of three rounds: from the prior; from a first posterior, which refine the emulator where it matters; and from the
posterior, for the maps. Each is an ensemble in the output folder, so a second start continues.

Files of a calibration: record, tables, plots, and a map of the misfit of the best run of each event.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .. import __version__
from ..frames.ensemble_folder import MAPS, Members, read_members
from ..laws.quantities import Quantity
from ..maps.export.export_inputs import terrain_of_rasters
from ..results.comparison import overlap
from ..results.comparison_files import MapSide, write_classes, write_classes_style, write_comparison_map
from ..results.flow_line import runout
from ..system.errors import InputError
from ..system.messages import log, muted
from ..system.whole_files import output_error, refuse_other, whole_file
from ..terrain.hydrograph_file import write_records
from .calibration_events import EventOnGrid, events_of
from .calibration_result import Calibration, priors
from .ensemble_plan import PlannedRuns, read_plan
from .ensemble_runs import EnsembleRequest, ensemble
from .posterior import FEWEST, Emulator, posterior, self_test, shares_of_scores
from .sampling_plan import JOINT
from .study_plots import write_pairs

RECORD_FILE, SAMPLES_FILE, RUNS_FILE, PAIRS_FILE, MISFIT = (
    "calibrate.json", "samples.csv", "runs.csv", "pairs.png", "misfit",
)  # fmt: skip
SAMPLES = 1000  # draws in the table
SAMPLE_DIGITS = 4


def write_files(output: Path, result: Calibration, events: list, runs: dict, request) -> tuple:
    """Write all files into the folder `output`; their paths, the record first.

    Parameters
    ----------
    output : Path
    result : Calibration
    events : list of EventOnGrid
    runs : dict of str to list of (Members, int)
    request : CalibrateRequest
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
    record = _record(result, events, overlaps, request)
    with whole_file(output / RECORD_FILE) as part:
        part.write_text(json.dumps(record, indent=1, allow_nan=False) + "\n", encoding="utf-8", newline="\n")
    draws = result.values_of(result.posterior.drawn(SAMPLES, request.seed))
    write_records(output / SAMPLES_FILE, [*result.priors], [[_short(v) for v in row] for row in draws])
    rows = [[*values, misfit, *simulated] for values, misfit, simulated in
            zip(result.values, result.misfits, result.simulated, strict=True)]  # fmt: skip
    write_records(output / RUNS_FILE, [*result.priors, "misfit", *result.names], rows)
    write_pairs(output / PAIRS_FILE, result, draws)
    return tuple(output / name for name in (RECORD_FILE, PAIRS_FILE, SAMPLES_FILE, RUNS_FILE)) + tuple(maps)


def _short(value):
    return float(f"{value:.{SAMPLE_DIGITS}g}")


def _record(result, events, overlaps, request):
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
        "format": "mpmgis-calibration", "format_version": 1, "version": __version__, "seed": request.seed,
        "events": given, **result.record(), "best_run_outline": overlaps, "summaries": summaries,
    }  # fmt: skip


def _plain(value):
    return list(value) if isinstance(value, tuple) else str(value)


def _write_misfit(output, name, event, run):
    """({"missed_m2", "over_covered_m2", "iou"} of the best run, paths of map, raster and style)."""
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


TESTED = 40  # runs of the self-test


@dataclass(frozen=True)
class CalibrateRequest:
    """A calibration; `calibrate` describes its options."""

    scene: Path
    output: Path | None = None
    overwrite: bool = False
    vary: tuple | dict = ()
    material: str | None = None
    observed: Path | None = None
    points: Path | None = None
    deposit: Path | None = None
    volume: str | None = None
    line: Path | None = None
    event: tuple = ()
    outline_error: float | None = None  # [m]
    value_error: float = 0.2
    threshold: float = 0.1  # [m]
    samples: int = 100
    refine: int = 50
    predictive: int = 50
    seed: int = 0
    exceed: tuple | dict | None = None
    cell_size: float | None = None  # [m]
    tolerate: float = 0.1
    workers: int | None = None
    dask: str | None = None
    law: Path | None = None


@dataclass(frozen=True)
class CalibrateFound:
    """The `folder`, its `files` (QGIS projects first), and the `result` (a Calibration)."""

    folder: Path
    files: tuple
    result: Calibration


def calibrate(request: CalibrateRequest, *, confirm=lambda question: True, look=lambda *state: None) -> CalibrateFound:
    """Posterior of the varied keys, with its plots, tables and maps.

    Raises
    ------
    InputError, SceneError, OutputError, UnphysicalError
        Runs that are finished are kept.
    """
    return _Study(request, confirm, look).found()


class _Study:
    """A calibration in progress."""

    def __init__(self, request, confirm, look):
        self.request, self.confirm, self.look = request, confirm, look
        self.priors, self.events = priors(request.vary, request.material), events_of(request)
        self.output = Path(request.output or Path(request.scene).parent / "calibration")
        if self.output.is_dir() and any(self.output.iterdir()) and not (self.output / "runs").is_dir():
            refuse_other(self.output, "a calibration")
        if request.samples < FEWEST:
            raise InputError(f"`samples` is {request.samples}, expected at least {FEWEST}")
        self.rounds, self.maps = [], {}
        prior = {"vary": {key: one.text for key, one in self.priors.items()}, "sampling": "lhs"}
        self.on_grid = {event.name: self._placed(event, prior) for event in self.events}
        self.prior = {**prior, "overwrite": request.overwrite}

    def _placed(self, event, prior):
        """The observations of `event` on the grid of its runs; wrong ones are refused before the first run."""
        with muted():
            request = self._ensemble_request(event, self.output, self.request.samples, prior)
            study = PlannedRuns.of(request, read_plan(request)[0])
        _, prepared = study.first
        on_grid = EventOnGrid(event, study.grid, prepared.terrain, self.request)
        on_grid.report_outline(prepared.seen)
        return on_grid

    def found(self):
        request = self.request
        self._run("prior", request.samples, **self.prior)
        result = self._result(tests=0 if request.refine else TESTED)
        if request.refine:
            self._run_drawn("refine", result, request.refine, self.output / "runs")
            result = self._result(tests=TESTED)
        if request.predictive:
            self._run_drawn("predictive", result, request.predictive, self.output)
        files = write_files(self.output, result, [self.on_grid[event.name] for event in self.events], self.runs,
                            request)  # fmt: skip
        return CalibrateFound(self.output, (*self.maps.values(), *files), result)

    def _run_drawn(self, name, result, count, folder):
        """Run every event at `count` draws of the posterior, the same draws for each event."""
        shares = shares_of_scores(result.posterior.drawn(count, self.request.seed))
        vary = {key: [one.at(share) for share in column]
                for (key, one), column in zip(self.priors.items(), shares.T, strict=True)}  # fmt: skip
        self._run(name, count, vary=vary, sampling=JOINT, overwrite=True)

    def _run(self, name, count, **plan):
        """An ensemble of each event in `runs/<event>/<name>`, or `predictive/<event>`."""
        members = {}
        for event in self.events:
            log.info(f"{event.name}: {count} runs, {ROUND_WORDS[name]}")
            place = self.output / "predictive" / event.name
            folder = place if name == "predictive" else self.output / "runs" / event.name / name
            found = ensemble(self._ensemble_request(event, folder, count, plan), confirm=self.confirm, look=self.look)
            members[event.name] = read_members(folder)
            if name == "predictive":
                self.maps[event.name] = found.files[0]
            if name == "prior":
                on_grid = self.on_grid[event.name]
                on_grid.terrain = terrain_of_rasters(folder / MAPS / "dtm.tif", on_grid.grid.crs)
        if name != "predictive":
            self.rounds.append(members)

    def _ensemble_request(self, event, folder, count, plan):
        request = self.request
        return EnsembleRequest(
            scene=event.scene, output=folder, samples=count, seed=request.seed, exceed=request.exceed,
            cell_size=request.cell_size, keep="deposit" if event.needs_deposit else "maxima", workers=request.workers,
            dask=request.dask, tolerate=request.tolerate, law=request.law, **plan,
        )  # fmt: skip

    @property
    def runs(self) -> dict[str, list[tuple[Members, int]]]:
        """Event -> the runs (members, index) that finished in all events, in a common order."""
        found = {event.name: [] for event in self.events}
        for members in self.rounds:
            for name, of in members.items():
                found[name] += [(of, int(k)) for k in np.flatnonzero(finished_in_all(members))]
        return found

    def _result(self, tests):
        """The Calibration by all runs so far, with a self-test of so many runs."""
        runs, seed = self.runs, self.request.seed
        count = len(runs[self.events[0].name])
        if count < FEWEST:
            raise InputError(f"only {count} runs finished in all events, expected at least {FEWEST}")
        parts = [self.on_grid[event.name].compared(runs[event.name]) for event in self.events]
        simulated = np.hstack([part.simulated for part in parts])
        observed, variances = (np.concatenate([getattr(part, n) for part in parts]) for n in ("observed", "variances"))
        values = np.vstack([of.values([*self.priors])[k] for of, k in runs[self.events[0].name]])
        shares = np.column_stack(
            [
                [one.share_of(value) for value in column]
                for one, column in zip(self.priors.values(), values.T, strict=True)
            ]
        )
        emulator = Emulator.fitted(shares, simulated)
        found = posterior(emulator.at, observed, variances, len(self.priors), seed)
        prior = int(finished_in_all(self.rounds[0]).sum())  # they are first; the test assumes runs of the prior
        chosen = np.random.default_rng(seed).permutation(prior)[:tests]
        test = self_test(emulator, shares, simulated, variances, chosen, seed) if tests else None
        misfits = np.sum((simulated - observed) ** 2 / variances, axis=1) / len(observed)
        return Calibration(
            self.priors, [name for part in parts for name in part.names], observed, variances, values, simulated,
            misfits, found, emulator.left_out(), test,
        )  # fmt: skip


def finished_in_all(members):
    """bool[n]: the runs of a round (event -> Members) that finished in every event."""
    return np.all([of.finished for of in members.values()], axis=0)


ROUND_WORDS = {"prior": "from the prior", "refine": "near the posterior", "predictive": "from the posterior"}
