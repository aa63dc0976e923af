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
from .calibration_options import AskedCalibration
from .calibration_posterior import posterior, self_test, shares_of_scores
from .calibration_priors import priors
from .calibration_result import Calibration
from .ensemble_options import ensemble_with
from .ensemble_plan import PlannedRuns, read_plan
from .ensemble_runs import ensemble
from .event_comparison import EventOnGrid
from .gaussian_process import FEWEST, Emulator
from .sampling_plan import JOINT

TESTED = 40  # number of runs in the self-test


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
    asked: AskedCalibration,
    *,
    confirm: Callable[[str], bool] = lambda question: True,
    look: Callable = lambda *state: None,
) -> CalibrateFound:
    """Compute the posterior of the varied keys, with its plots, tables and maps.

    Parameters
    ----------
    asked : AskedCalibration
    confirm : callable
        Question -> whether to start long runs.
    look : callable
        Called with (done, total, left out) a few times a second.

    Raises
    ------
    InputError, SceneError, OutputError, UnphysicalError
        Runs that are finished are kept.
    """
    return _Study(asked, confirm, look).found()


class _Study:
    """A calibration in progress."""

    def __init__(self, asked, confirm, look):
        self.asked, self.confirm, self.look = asked, confirm, look
        self.priors, self.events = priors(asked["vary"], asked["material"]), events_of(asked)
        self.output = Path(asked["output"] or Path(asked["scene"]).parent / "calibration")
        if self.output.is_dir() and any(self.output.iterdir()) and not (self.output / "runs").is_dir():
            refuse_other(self.output, "a calibration")
        if asked["samples"] < FEWEST:
            raise InputError(f"`samples` is {asked['samples']}, expected at least {FEWEST}")
        self.rounds, self.maps = [], {}
        prior = {"vary": {key: one.text for key, one in self.priors.items()}, "sampling": "lhs"}
        self.on_grid = {event.name: self._placed(event, prior) for event in self.events}
        self.prior = {**prior, "overwrite": asked["overwrite"]}

    def _placed(self, event, prior):
        """Return the observations of `event` on the grid of its runs; wrong ones are refused before the first run."""
        with muted():
            first = self._ensemble(event, self.output, self.asked["samples"], prior)
            study = PlannedRuns.of(first, read_plan(first)[0])
        _, prepared = study.first
        on_grid = EventOnGrid(event, study.grid, prepared.terrain, self.asked)
        on_grid.report_outline(prepared.seen)
        return on_grid

    def found(self) -> CalibrateFound:
        """Run all rounds and write the files."""
        asked = self.asked
        self._run("prior", asked["samples"], **self.prior)
        result = self._result(tests=0 if asked["refine"] else TESTED)
        if asked["refine"]:
            self._run_drawn("refine", result, asked["refine"], self.output / "runs")
            result = self._result(tests=TESTED)
        if asked["predictive"]:
            self._run_drawn("predictive", result, asked["predictive"], self.output)
        files = write_files(self.output, result, [self.on_grid[event.name] for event in self.events], self.runs, asked)
        return CalibrateFound(self.output, (*self.maps.values(), *files), result)

    def _run_drawn(self, name: str, result: Calibration, count: int, folder: Path) -> None:
        """Run every event at `count` draws of the posterior, the same draws for each event."""
        shares = shares_of_scores(result.posterior.drawn(count, self.asked["seed"]))
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
            found = ensemble(self._ensemble(event, folder, count, plan), confirm=self.confirm, look=self.look)
            members[event.name] = read_members(folder)
            if name == "predictive":
                self.maps[event.name] = found.files[0]
            if name == "prior":
                on_grid = self.on_grid[event.name]
                on_grid.terrain = terrain_of_rasters(folder / MAPS / "dtm.tif", on_grid.grid.crs)
        if name != "predictive":
            self.rounds.append(members)

    def _ensemble(self, event, folder, count, plan):
        asked = self.asked
        return ensemble_with(
            scene=event.scene,
            output=folder,
            samples=count,
            seed=asked["seed"],
            exceed=asked["exceed"],
            cell_size=asked["cell_size"],
            keep="deposit" if event.needs_deposit else "maxima",
            workers=asked["workers"],
            dask=asked["dask"],
            tolerate=asked["tolerate"],
            law=asked["law"],
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
        runs, seed = self.runs, self.asked["seed"]
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
