"""Table of a study, with results of other codes for comparison, and its conclusions as text."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..simulation.numerical_parameters import cells_times, cost_power
from .convergence import (
    LEAST_FALL,
    NEAR_FRONT,
    Gain,
    Law,
    best_gains,
    fitted,
    gains,
    on_front,
    stops_paying,
    ties,
    time_over_front,
)
from .run_measures import NAMES, UNITS, Errors

if TYPE_CHECKING:
    from .run_measures import Outcome

FARTHEST = 4.0  # [1] largest extrapolation of the law: smallest cells of the study over those of the law
PERCENT = ("thickness", "momentum", "area")  # errors that are shown in per cent
BESIDE = "beside"  # entry in column "knob" for results of other codes
ERROR_COLUMNS = {name: f"error_{name}" + ("_m" if UNITS[name] == "m" else "") for name in NAMES}
RECORD_NAMES = (
    "knob",
    "setting",
    "solver",
    "cell_size_m",
    "particles_per_cell",
    "cfl",
    "precision",
    "stiffness",
    "particles",
    "steps",
    "particle_steps",
    "seconds",
    "seconds_min",
    "seconds_max",
    "compile_seconds",
    "predicted_seconds",
    *ERROR_COLUMNS.values(),
    "error_with_reference",
    "mass_error",
    "on_front",
    "time_over_front",
    "ties",
)


class OtherResult(NamedTuple):
    """A result of another code.

    Parameters
    ----------
    code, setting : str
        Name of the code, and its settings as text.
    seconds : (float, float, float) [s]
        Wall time of the time integration: typical, min, max.
    errors : Errors
        NaN if unknown.
    """

    code: str
    setting: str
    seconds: tuple
    errors: Errors

    @property
    def name(self) -> str:
        """Text for a table."""
        return f"{self.code}: {self.setting}"


def fastest_as_accurate(seconds: np.ndarray, errors: np.ndarray, error: float) -> int | None:
    """Return the number of the fastest setting with an error of at most `error`; None if there is none.

    Parameters
    ----------
    seconds : float64[n] [s]
    errors : float64[n]
    error : float
    """
    accurate = np.flatnonzero(np.asarray(errors) <= error)
    return int(accurate[np.argmin(np.asarray(seconds)[accurate])]) if accurate.size else None


class Row(NamedTuple):
    """One setting of a study.

    Parameters
    ----------
    outcome : Outcome
    errors : Errors
        Against the reference.
    """

    outcome: "Outcome"
    errors: Errors


class SettingChoice(NamedTuple):
    """Settings for a requested error.

    Parameters
    ----------
    changes : dict
        Values of keys that differ from the scene.
    seconds : float [s]
    error : float
    estimated : bool
        No run was as accurate: extrapolated with the law.
    """

    changes: dict
    seconds: float
    error: float
    estimated: bool


@dataclass(frozen=True)
class Study:
    """Results of all settings of a study.

    Parameters
    ----------
    rows : tuple of Row
        The unchanged scene first.
    measure : str
        The error that ranks the settings: one of `run_measures.NAMES`.
    reference_cell : float [m]
        Cell size of the reference run; 0 for an exact solution.
    exports : tuple of ExportSetting
    beside : tuple of OtherResult
        Results of other codes: shown, but not used in the conclusions.
    """

    rows: tuple
    measure: str
    reference_cell: float
    exports: tuple = ()
    beside: tuple = ()

    @cached_property
    def seconds(self) -> np.ndarray:
        """Typical wall time of each row, float64[n] [s]."""
        return np.array([row.outcome.typical_seconds for row in self.rows])

    @cached_property
    def spreads(self) -> np.ndarray:
        """Smallest and largest wall time of each row, float64[n, 2] [s]."""
        return np.array([(min(row.outcome.seconds), max(row.outcome.seconds)) for row in self.rows])

    def ties(self, k: int) -> np.ndarray:
        """Return the numbers of the rows whose times are a tie with that of a row.

        Parameters
        ----------
        k : int
            Number of the row.
        """
        return np.flatnonzero(ties(self.spreads)[k])

    @cached_property
    def raw_errors(self) -> np.ndarray:
        """Ranking error against the reference, float64[n]."""
        return np.array([getattr(row.errors, self.measure) for row in self.rows])

    @cached_property
    def law(self) -> Law | None:
        """Law of the error over the cell size, for the scene's other parameters; None for fewer than two sizes."""
        pairs = [(size, self.raw_errors[k]) for k, size in self.by_cell_size()]
        return fitted(*zip(*pairs, strict=True), self.reference_cell) if len(pairs) > 1 else None

    def by_cell_size(self) -> list[tuple[int, float]]:
        """Return the rows that differ from the scene only in the cell size.

        Returns
        -------
        list of (int, float [m])
            Number of the row, and cell size.
        """
        return [
            (k, row.outcome.setting.cell_size)
            for k, row in enumerate(self.rows)
            if row.outcome.setting.parameter in ("scene", "cell_size")
        ]

    @cached_property
    def reference_error(self) -> float | None:
        """Error of the reference itself, from the law (Richardson); 0 if it is exact, None (unknown) without a law."""
        if self.reference_cell <= 0.0:
            return 0.0
        return None if self.law is None else self.law.error(self.reference_cell)

    @cached_property
    def errors(self) -> np.ndarray:
        """Ranking error, including the error of the reference where it is known, float64[n].

        An independent error of the reference is already included in the raw errors.
        """
        lacking = 0.0 if self.law is None or self.law.independent else self.reference_error
        return self.raw_errors + lacking

    @cached_property
    def front(self) -> np.ndarray:
        """Whether each row is on the Pareto front, bool[n]."""
        return on_front(self.spreads, self.errors)

    @cached_property
    def over_front(self) -> np.ndarray:
        """Time over that of the fastest row that is at least as accurate, float64[n] [1]; 1 for a tie."""
        return time_over_front(self.seconds, self.spreads, self.errors)

    @cached_property
    def gains(self) -> list[Gain]:
        """Gains of the other values of each parameter over the scene, best first."""
        others = [
            (setting.parameter, setting.name, self.seconds[k], self.spreads[k], self.errors[k])
            for k, setting in enumerate(row.outcome.setting for row in self.rows)
            if setting.parameter not in ("scene", "several")
        ]
        return gains((self.seconds[0], self.spreads[0], self.errors[0]), others)

    @cached_property
    def stops_paying(self) -> float | None:
        """Cell size [m] below which refinement is not worthwhile; None if it is over the whole range."""
        sizes = self.by_cell_size()
        return stops_paying([size for _, size in sizes], [self.errors[k] for k, _ in sizes])

    def choice(self, error: float) -> SettingChoice | None:
        """Return the settings for a requested error: the fastest row that reaches it, else from the law.

        Of rows that are a tie with the fastest, the one with the smallest error is used.

        Parameters
        ----------
        error : float
            Largest accepted error.

        Returns
        -------
        SettingChoice or None
            None if the law does not reach so far.
        """
        reached = np.flatnonzero(self.errors <= error)
        if reached.size:
            fastest = reached[np.argmin(self.seconds[reached])]
            tied = np.intersect1d(reached, [fastest, *self.ties(fastest)])
            k = tied[np.argmin(self.errors[tied])]
            changes = dict(self.rows[k].outcome.setting.changes)
            return SettingChoice(changes, float(self.seconds[k]), float(self.errors[k]), False)
        if self.law is None or self.law.cell_size(error) * FARTHEST < self._finest():
            return None
        base = self.rows[0].outcome.setting
        factor = float(f"{self.law.cell_size(error) / base.cell_size:.3g}")
        seconds = self.seconds[0] / factor ** cost_power(base.scene)
        return SettingChoice(dict(cells_times(base.scene, factor)), float(seconds), error, True)

    def _finest(self):
        """Return the smallest cell size of the study [m]."""
        return min(size for _, size in self.by_cell_size())

    def lines(self) -> list[str]:
        """Return the conclusions, one sentence each."""
        return [
            *self._law_lines(),
            *self._front_lines(),
            *self._tie_lines(),
            *self._gain_lines(),
            *self._cost_lines(),
            *self._lines_of_others(),
        ]

    def _law_lines(self):
        size, lines = self.stops_paying, []
        if self.law is None:
            lines.append(f"the error of {self.measure} follows no power law of the cell size")
        else:
            lines.append(f"the error of {self.measure} is of order {self.law.order:.2f} in the cell size")
        if self.law is not None and self.reference_cell > 0.0:
            own = value_words(self.measure, self.reference_error)
            how = "independent of the other errors, included in them" if self.law.independent else "added to all errors"
            lines.append(f"the reference (cells of {self.reference_cell:g} m) has itself an error of {own}: {how}")
        elif self.reference_error is None:
            lines.append(
                f"the error of the reference (cells of {self.reference_cell:g} m) is unknown: all errors are "
                "differences from it, and can be too small; refine the cells further"
            )
        if size is not None:
            lines.append(f"cells below {size:g} m are not worthwhile: halving reduces the error by < 25 %")
        return lines

    def _front_lines(self):
        over = self.over_front[0]
        if not np.isfinite(over):
            return []
        best = self.rows[int(np.argmin(np.where(self.errors <= self.errors[0], self.seconds, np.inf)))]
        if over <= NEAR_FRONT:
            return [f"the settings of the scene are on the Pareto front, or within {over:.2f} times its time"]
        return [
            f"the settings of the scene take {over:.2f} times as long as the fastest ones that are as accurate: "
            f"{best.outcome.setting.name}"
        ]

    def _tie_lines(self):
        if min(len(row.outcome.seconds) for row in self.rows) < 2:
            return ["each setting was run once: the range of its time is unknown, and ties are not detected"]
        names = [self._name(k) for k in self.ties(0)]
        return [f"ties in time with the settings of the scene: {', '.join(names)}"] if names else []

    def _gain_lines(self):
        if not self.gains:
            return [f"no single parameter reduces the error of the scene by {100 * LEAST_FALL:g} % or more"]
        best = best_gains(self.gains)
        if len(best) == 1:
            return [f"best next refinement: {_gain_words(best[0])}"]
        words = "; ".join(map(_gain_words, best))
        return [f"best next refinements, a tie within the range of their times: {words}"]

    def _name(self, k):
        return self.rows[k].outcome.setting.name

    def _cost_lines(self):
        ratios = [row.outcome.predicted / row.outcome.typical_seconds for row in self.rows]
        return [f"predicted over measured time: {min(ratios):.2f} to {max(ratios):.2f}"]

    def errors_of_others(self) -> np.ndarray:
        """Return the ranking error of each result of other codes.

        Returns
        -------
        float64[n]
        """
        return np.array([getattr(other.errors, self.measure) for other in self.beside])

    def as_accurate_as(self, error: float) -> int | None:
        """Return the number of the fastest row with at most this error; None if there is none.

        Parameters
        ----------
        error : float
        """
        return fastest_as_accurate(self.seconds, self.errors, error)

    def _lines_of_others(self):
        lines = []
        for other, error in zip(self.beside, self.errors_of_others(), strict=True):
            k = self.as_accurate_as(error)
            if k is None:
                lines.append(f"{other.name}: no setting of this study is as accurate")
            else:
                share, name = other.seconds[0] / self.seconds[k], self.rows[k].outcome.setting.name
                times = f"{share:.2g}" if share < 10.0 else f"{share:.0f}"
                lines.append(f"{other.name}: {times} times the time of the fastest setting as accurate ({name})")
        return lines

    def summary(self) -> list[tuple[str, str]]:
        """Return the conclusions as (name, value as text)."""
        best = best_gains(self.gains) if self.gains else []
        size = self.stops_paying
        return [
            ("measure", self.measure),
            ("order", "-" if self.law is None else f"{self.law.order:.2f}"),
            ("error of the reference", self._reference_words()),
            ("refinement worthwhile down to", "-" if size is None else f"{size:g} m"),
            ("time over the front", f"{self.over_front[0]:.2f}"),
            (
                "best next refinement",
                " or ".join(f"{g.setting}: {g.error:.2f} x error, {g.time:.2f} x time" for g in best) or "-",
            ),
        ]

    def _reference_words(self):
        own = self.reference_error
        return "unknown" if own is None else value_words(self.measure, own)

    def records(self) -> tuple[tuple, list]:
        """Return the full table for a CSV; results of other codes come last.

        Returns
        -------
        names : tuple of str
        rows : list of tuple
        """
        others = zip(self.beside, self.errors_of_others(), strict=True)
        own = [self._record(k) for k in range(len(self.rows))]
        return RECORD_NAMES, own + [self._record_beside(other, error) for other, error in others]

    def _record(self, k):
        outcome, errors = self.rows[k].outcome, self.rows[k].errors
        setting, numerics = outcome.setting, outcome.setting.scene.numerics
        return (
            setting.parameter,
            setting.name,
            *_by_stage(setting.scene),
            numerics.cfl or "",
            numerics.precision,
            numerics.stiffness,
            outcome.particles,
            outcome.steps,
            outcome.particle_steps,
            self.seconds[k],
            min(outcome.seconds),
            max(outcome.seconds),
            outcome.compile_seconds,
            outcome.predicted,
            *errors,
            self._with_reference(self.errors[k]),
            outcome.mass_error,
            int(self.front[k]),
            self.over_front[k],
            "; ".join(self._name(other) for other in self.ties(k)),
        )

    def _with_reference(self, error):
        """Return an error that contains that of the reference; NaN where that is unknown."""
        return math.nan if self.reference_error is None else error

    def _record_beside(self, other, error):
        known = {
            "knob": BESIDE,
            "setting": other.name,
            "error_with_reference": self._with_reference(error),
            **dict(zip(("seconds", "seconds_min", "seconds_max"), other.seconds, strict=True)),
            **dict(zip(ERROR_COLUMNS.values(), other.errors, strict=True)),
        }
        k = self.as_accurate_as(error)
        if k is not None:
            known["time_over_front"] = other.seconds[0] / self.seconds[k]
        return tuple(known.get(name, "") for name in RECORD_NAMES)


def _by_stage(scene):
    """Return solver, cell size and particles per cell; for a scene in stages those of all stages, joined with +."""
    each = [
        (
            one.solver,
            one.numerics.cell_size,
            one.numerics.points_per_cell if one.solver == "points" else one.numerics.particles_per_cell,
        )
        for one in scene.alone()
    ]
    if len(each) == 1:
        return each[0]
    return tuple("+".join(v if isinstance(v, str) else f"{v:g}" for v in of_all) for of_all in zip(*each, strict=True))


def _gain_words(gain):
    same = "the same time" if gain.time == 1.0 else f"{gain.time:.2f} times the time"
    return f"{gain.setting}: {gain.error:.2f} times the error for {same}"


def value_words(measure: str, value: float) -> str:
    """Return an error as text: per cent, or metres.

    Parameters
    ----------
    measure : str
        One of `run_measures.NAMES`.
    value : float
    """
    return f"{100 * value:.2g} %" if measure in PERCENT else f"{value:.3g} m"
