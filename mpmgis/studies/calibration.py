"""Calibrate parameters (`mpmgis calibrate`): their posterior from observed events, by runs and an emulator.

Runs of three rounds: from the prior; from a first posterior, which refine the emulator where it matters; and from the
posterior, for the maps. Each is an ensemble in the output folder, so a second start continues.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..frames.ensemble_members import Members, read_members
from ..frames.many_runs_folder import MAPS
from ..frames.run_terrain import terrain_of_rasters
from ..system.errors import InputError
from ..system.messages import log, muted
from ..system.whole_files import refuse_other
from .calibration_events import events_of
from .calibration_files import write_files
from .calibration_posterior import posterior, self_test, shares_of_scores
from .calibration_priors import priors
from .calibration_result import Calibration
from .ensemble_plan import PlannedRuns, read_plan
from .ensemble_runs import EnsembleRequest, ensemble
from .event_comparison import EventOnGrid
from .gaussian_process import FEWEST, Emulator
from .sampling_plan import JOINT

TESTED = 40  # number of runs in the self-test


@dataclass(frozen=True)
class CalibrateRequest:
    """Request for a calibration, with the options of `mpmgis calibrate`."""

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
    """Results of a calibration.

    Parameters
    ----------
    folder : Path
    files : tuple of Path
        QGIS projects first.
    result : Calibration
    """

    folder: Path
    files: tuple
    result: Calibration


def calibrate(
    request: CalibrateRequest,
    *,
    confirm: Callable[[str], bool] = lambda question: True,
    look: Callable = lambda *state: None,
) -> CalibrateFound:
    """Compute the posterior of the varied keys, with its plots, tables and maps.

    Parameters
    ----------
    request : CalibrateRequest
    confirm : callable
        Question -> whether to start long runs.
    look : callable
        Called with (done, total, left out) a few times a second.

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
        """Return the observations of `event` on the grid of its runs; wrong ones are refused before the first run."""
        with muted():
            request = self._ensemble_request(event, self.output, self.request.samples, prior)
            study = PlannedRuns.of(request, read_plan(request)[0])
        _, prepared = study.first
        on_grid = EventOnGrid(event, study.grid, prepared.terrain, self.request)
        on_grid.report_outline(prepared.seen)
        return on_grid

    def found(self) -> CalibrateFound:
        """Run all rounds and write the files."""
        request = self.request
        self._run("prior", request.samples, **self.prior)
        result = self._result(tests=0 if request.refine else TESTED)
        if request.refine:
            self._run_drawn("refine", result, request.refine, self.output / "runs")
            result = self._result(tests=TESTED)
        if request.predictive:
            self._run_drawn("predictive", result, request.predictive, self.output)
        files = write_files(
            self.output, result, [self.on_grid[event.name] for event in self.events], self.runs, request
        )
        return CalibrateFound(self.output, (*self.maps.values(), *files), result)

    def _run_drawn(self, name: str, result: Calibration, count: int, folder: Path) -> None:
        """Run every event at `count` draws of the posterior, the same draws for each event."""
        shares = shares_of_scores(result.posterior.drawn(count, self.request.seed))
        vary = {
            key: [one.at(share) for share in column]
            for (key, one), column in zip(self.priors.items(), shares.T, strict=True)
        }
        self._run(name, count, vary=vary, sampling=JOINT, overwrite=True)

    def _run(self, name, count, **plan):
        """Run an ensemble of each event in `runs/<event>/<name>`, or `predictive/<event>`."""
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
            scene=event.scene,
            output=folder,
            samples=count,
            seed=request.seed,
            exceed=request.exceed,
            cell_size=request.cell_size,
            keep="deposit" if event.needs_deposit else "maxima",
            workers=request.workers,
            dask=request.dask,
            tolerate=request.tolerate,
            law=request.law,
            **plan,
        )

    @property
    def runs(self) -> dict[str, list[tuple[Members, int]]]:
        """Event -> the runs (members, index) that finished in all events, in a common order."""
        found = {event.name: [] for event in self.events}
        for members in self.rounds:
            for name, of in members.items():
                found[name] += [(of, int(k)) for k in np.flatnonzero(finished_in_all(members))]
        return found

    def _result(self, tests):
        """Return the Calibration by all runs so far, with a self-test of `tests` runs."""
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
            self.priors,
            [name for part in parts for name in part.names],
            observed,
            variances,
            values,
            simulated,
            misfits,
            found,
            emulator.left_out(),
            test,
        )


def finished_in_all(members: dict[str, Members]) -> np.ndarray:
    """Return which runs of a round finished in every event.

    Parameters
    ----------
    members : dict of str to Members
        By event.

    Returns
    -------
    bool[n]
    """
    return np.all([of.finished for of in members.values()], axis=0)


ROUND_WORDS = {"prior": "from the prior", "refine": "near the posterior", "predictive": "from the posterior"}
