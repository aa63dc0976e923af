"""The table of a study with results of other codes as references, and its conclusions in words."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .convergence import LEAST_FALL, NEAR_FRONT, alike, fitted, gains, on_front, stops_paying, ties, time_over_front
from .measures import NAMES, UNITS, Errors
from .numerical_parameters import cells_times, cost_power


class Beside(NamedTuple):
    """One result that this study did not run.

    code, setting : str
        Whose it is, and with which settings.
    seconds : (float, float, float) [s]
        Wall time of its loop over steps: typical, least, most.
    errors : Errors
        NaN where nothing tells.
    """

    code: str
    setting: str
    seconds: tuple
    errors: Errors

    @property
    def name(self):
        """Words for a table."""
        return f"{self.code}: {self.setting}"


def quickest_as_right(seconds, errors, error):
    """Number of the quickest setting whose error is at most `error`, None where no setting is as right."""
    right = np.flatnonzero(np.asarray(errors) <= error)
    return int(right[np.argmin(np.asarray(seconds)[right])]) if right.size else None


FARTHEST = 4.0  # times the finest cells that were run: so far a law is continued
PERCENT = ("thickness", "momentum", "area")


class Row(NamedTuple):
    """One setting: what it took and what it is off by; `errors` against the reference, by name."""

    outcome: object
    errors: object


class Choice(NamedTuple):
    """Settings for an error that is asked for; `estimated` where no run was that right and the law was continued."""

    changes: dict
    seconds: float
    error: float
    estimated: bool


@dataclass(frozen=True)
class Study:
    """Parameters
    ----------
    rows : tuple of Row
        The scene as it is first.
    measure : str
        The error that decides: one of `errors.NAMES`.
    reference_cell : float [m]
        Cell size of the run that errors are taken against; 0 for an exact answer.
    exports : tuple of ExportSetting
    beside : tuple of Beside
        Results of others: told and drawn, they decide nothing.
    """

    rows: tuple
    measure: str
    reference_cell: float
    exports: tuple = ()
    beside: tuple = ()

    @cached_property
    def seconds(self):
        """float64[n] [s]: typical wall time of each row."""
        return np.array([row.outcome.typical_seconds for row in self.rows])

    @cached_property
    def spreads(self):
        """float64[n, 2] [s]: least and most wall time of each row."""
        return np.array([(min(row.outcome.seconds), max(row.outcome.seconds)) for row in self.rows])

    def ties(self, k):
        """Numbers of the rows whose times do not differ from that of row `k` beyond their spread."""
        return np.flatnonzero(ties(self.spreads)[k])

    @cached_property
    def raw_errors(self):
        """float64[n]: the error that decides, as it was taken."""
        return np.array([getattr(row.errors, self.measure) for row in self.rows])

    @cached_property
    def law(self):
        """Law of the error over the cell size, all else as the scene has it; None from fewer than two sizes."""
        pairs = [(size, self.raw_errors[k]) for k, size in self.by_cell_size()]
        return fitted(*zip(*pairs, strict=True), self.reference_cell) if len(pairs) > 1 else None

    def by_cell_size(self):
        """(row, cell size [m]) of the rows in which only the cell size differs from the scene."""
        return [
            (k, row.outcome.setting.cell_size)
            for k, row in enumerate(self.rows)
            if row.outcome.setting.knob in ("scene", "cell_size")
        ]

    @cached_property
    def reference_error(self):
        """What the reference itself is off by, after the law (Richardson); 0 where it is exact or no law was found."""
        return self.law.error(self.reference_cell) if self.law and self.reference_cell > 0.0 else 0.0

    @cached_property
    def errors(self):
        """float64[n]: the error that decides, with what it lacks of the reference's own.

        An independent error of the reference is in each of them already.
        """
        lacking = 0.0 if self.law is None or self.law.independent else self.reference_error
        return self.raw_errors + lacking

    @cached_property
    def front(self):
        """bool[n]: rows that no other beats."""
        return on_front(self.spreads, self.errors)

    @cached_property
    def over_front(self):
        """float64[n]: time over that of the quickest row which is at least as right; 1 where that is a tie."""
        return time_over_front(self.seconds, self.spreads, self.errors)

    @cached_property
    def gains(self):
        """Gains of each knob's other values over the scene's, best first."""
        others = [
            (setting.knob, setting.name, self.seconds[k], self.spreads[k], self.errors[k])
            for k, setting in enumerate(row.outcome.setting for row in self.rows)
            if setting.knob not in ("scene", "several")
        ]
        return gains((self.seconds[0], self.spreads[0], self.errors[0]), others)

    @cached_property
    def stops_paying(self):
        """Cell size [m] below which smaller cells hardly help, None where they do as far as was looked."""
        sizes = self.by_cell_size()
        return stops_paying([size for _, size in sizes], [self.errors[k] for k, _ in sizes])

    def choice(self, error):
        """The Choice for an `error` of at most so much: the quickest row that reaches it, else from the law.

        Of rows that tie with the quickest it is the one with the smallest error.
        """
        reached = np.flatnonzero(self.errors <= error)
        if reached.size:
            quickest = reached[np.argmin(self.seconds[reached])]
            tied = np.intersect1d(reached, [quickest, *self.ties(quickest)])
            k = tied[np.argmin(self.errors[tied])]
            changes = dict(self.rows[k].outcome.setting.changes)
            return Choice(changes, float(self.seconds[k]), float(self.errors[k]), False)
        if self.law is None or self.law.cell_size(error) * FARTHEST < self._finest():
            return None
        base = self.rows[0].outcome.setting
        factor = float(f"{self.law.cell_size(error) / base.cell_size:.3g}")
        seconds = self.seconds[0] / factor ** cost_power(base.scene)
        return Choice(dict(cells_times(base.scene, factor)), float(seconds), error, True)

    def _finest(self):
        """The smallest cells that were run [m]."""
        return min(size for _, size in self.by_cell_size())

    def lines(self):
        """What follows, a sentence each."""
        return [
            *self._law_lines(), *self._front_lines(), *self._tie_lines(), *self._gain_lines(), *self._cost_lines(),
            *self._beside_lines(),
        ]  # fmt: skip

    def _law_lines(self):
        size, lines = self.stops_paying, []
        if self.law is None:
            lines.append(f"the error of {self.measure} follows no power of the cell size: no order, no law to continue")
        else:
            lines.append(f"the error of {self.measure} goes with the cell size to the power {self.law.order:.2f}")
        if self.law is not None and self.reference_cell > 0.0:
            own = value_words(self.measure, self.reference_error)
            how = "independent of theirs, and in each of them" if self.law.independent else "added to all of them"
            lines.append(f"the reference, cells of {self.reference_cell:g} m, is itself off by {own}: {how}")
        if size is not None:
            lines.append(f"smaller cells stop paying at {size:g} m: half the size takes off less than a quarter")
        return lines

    def _front_lines(self):
        over = self.over_front[0]
        if not np.isfinite(over):
            return []
        best = self.rows[int(np.argmin(np.where(self.errors <= self.errors[0], self.seconds, np.inf)))]
        if over <= NEAR_FRONT:
            return [f"the scene's own settings are on the front, or within {over:.2f} times of its time"]
        return [
            f"the scene's own settings take {over:.2f} times as long as the quickest that are as right: "
            f"{best.outcome.setting.name}"
        ]

    def _tie_lines(self):
        if min(len(row.outcome.seconds) for row in self.rows) < 2:
            return ["each setting was run once: how far its time spreads is not known, and ties are not seen"]
        names = [self._name(k) for k in self.ties(0)]
        return [f"ties in time with the scene's own settings, within the spread: {', '.join(names)}"] if names else []

    def _gain_lines(self):
        if not self.gains:
            return [f"no knob alone takes {100 * LEAST_FALL:g} % or more off the scene's error"]
        best = alike(self.gains)
        if len(best) == 1:
            return [f"the knob that pays most next: {_gain_words(best[0])}"]
        words = "; ".join(map(_gain_words, best))
        return [f"the knobs that pay most next, a tie within the spread of their times: {words}"]

    def _name(self, k):
        return self.rows[k].outcome.setting.name

    def _cost_lines(self):
        ratios = [row.outcome.predicted / row.outcome.typical_seconds for row in self.rows]
        return [f"predicted over measured time: {min(ratios):.2f} to {max(ratios):.2f}"]

    def beside_errors(self):
        """float64[n]: the error that decides, of each result of others."""
        return np.array([getattr(other.errors, self.measure) for other in self.beside])

    def as_right_as(self, error):
        """Number of the quickest row with at most this error, None where there is none."""
        return quickest_as_right(self.seconds, self.errors, error)

    def _beside_lines(self):
        lines = []
        for other, error in zip(self.beside, self.beside_errors(), strict=True):
            k = self.as_right_as(error)
            if k is None:
                lines.append(f"{other.name}: no setting here is as right")
            else:
                share, name = other.seconds[0] / self.seconds[k], self.rows[k].outcome.setting.name
                times = f"{share:.2g}" if share < 10.0 else f"{share:.0f}"
                lines.append(f"{other.name}: {times} times the time of the quickest here that is as right ({name})")
        return lines

    def summary(self):
        """(what, value in words) of what `lines` tell."""
        best = alike(self.gains) if self.gains else []
        size = self.stops_paying
        return [
            ("measure", self.measure),
            ("order", "-" if self.law is None else f"{self.law.order:.2f}"),
            ("error of the reference", value_words(self.measure, self.reference_error)),
            ("smaller cells stop paying at", "-" if size is None else f"{size:g} m"),
            ("time over the front", f"{self.over_front[0]:.2f}"),
            (
                "pays most next",
                " or ".join(f"{g.setting}: {g.error:.2f} x error, {g.time:.2f} x time" for g in best) or "-",
            ),
        ]

    def records(self):
        """(names, rows of values): the table in full, for a CSV; results of others last."""
        others = zip(self.beside, self.beside_errors(), strict=True)
        own = [self._record(k) for k in range(len(self.rows))]
        return RECORD_NAMES, own + [self._record_beside(other, error) for other, error in others]

    def _record(self, k):
        outcome, errors = self.rows[k].outcome, self.rows[k].errors
        setting, numerics = outcome.setting, outcome.setting.scene.numerics
        return (
            setting.knob, setting.name, *_by_stage(setting.scene), numerics.cfl or "", numerics.precision,
            numerics.stiffness, outcome.particles, outcome.steps, outcome.particle_steps, self.seconds[k],
            min(outcome.seconds), max(outcome.seconds), outcome.compile_seconds, outcome.predicted, *errors,
            self.errors[k], outcome.mass_error, int(self.front[k]), self.over_front[k],
            "; ".join(self._name(other) for other in self.ties(k)),
        )  # fmt: skip

    def _record_beside(self, other, error):
        known = {
            "knob": BESIDE, "setting": other.name, "error_with_reference": error,
            **dict(zip(("seconds", "seconds_min", "seconds_max"), other.seconds, strict=True)),
            **dict(zip(ERROR_COLUMNS.values(), other.errors, strict=True)),
        }  # fmt: skip
        k = self.as_right_as(error)
        if k is not None:
            known["time_over_front"] = other.seconds[0] / self.seconds[k]
        return tuple(known.get(name, "") for name in RECORD_NAMES)


def _by_stage(scene):
    """Solver, cell size and particles a cell, of a scene in stages those of each with + between them."""
    told = [
        (one.solver, one.numerics.cell_size,
         one.numerics.points_per_cell if one.solver == "points" else one.numerics.particles_per_cell)
        for one in scene.alone()
    ]  # fmt: skip
    if len(told) == 1:
        return told[0]
    return tuple("+".join(v if isinstance(v, str) else f"{v:g}" for v in of_all) for of_all in zip(*told, strict=True))


BESIDE = "beside"  # knob of what others found
ERROR_COLUMNS = {name: f"error_{name}" + ("_m" if UNITS[name] == "m" else "") for name in NAMES}
RECORD_NAMES = (
    "knob", "setting", "solver", "cell_size_m", "particles_per_cell", "cfl", "precision", "stiffness", "particles",
    "steps", "particle_steps", "seconds", "seconds_min", "seconds_max", "compile_seconds", "predicted_seconds",
    *ERROR_COLUMNS.values(), "error_with_reference", "mass_error", "on_front", "time_over_front",
    "ties",
)  # fmt: skip


def _gain_words(gain):
    same = "the same time" if gain.time == 1.0 else f"{gain.time:.2f} times the time"
    return f"{gain.setting}: {gain.error:.2f} times the error for {same}"


def value_words(measure, value):
    """An error in words: per cent, or metres."""
    return f"{100 * value:.2g} %" if measure in PERCENT else f"{value:.3g} m"
