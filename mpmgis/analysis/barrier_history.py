"""What a barrier took over a run, as figures: force, moment, overtopping, run-up, and whether its loads are usable."""

from dataclasses import dataclass

import numpy as np

from ..scene.points import FEWEST_CELLS

FORCE, PEAK = "mean normal force [N]", "largest normal force of a step so far [N]"
IMPULSE, OVERTOPPED = "normal impulse [N s]", "overtopped mass [kg]"
MOMENTS = ("mean moment east [N m]", "mean moment north [N m]", "mean moment up [N m]")
LEVEL_SHARE = 0.5  # of the height of a wall that the ground of its run-up may be above or below the wall's
EAST, NORTH = "impulse east [N s]", "impulse north [N s]"


@dataclass(frozen=True)
class BarrierHistory:
    """A barrier over one stage of a run: its `name`, `solver`, and `columns` (heading -> float64[frames]).

    `cell_size` [m] of the solver; `kept` is False where the points of the stage have lost their volume.
    """

    name: str
    solver: str
    columns: dict
    cell_size: float
    kept: bool = True

    @property
    def times(self) -> np.ndarray:
        """float64[frames] [s]."""
        return self.columns["time [s]"]

    @property
    def moment(self) -> np.ndarray | None:
        """float64[frames] [N m]: length of the mean moment about the foot since the frame before; None of columns."""
        if not all(heading in self.columns for heading in MOMENTS):
            return None
        return np.sqrt(sum(self.columns[heading] ** 2 for heading in MOMENTS))

    @property
    def direction(self) -> np.ndarray | None:
        """float64[2]: unit vector (east, north) of the total horizontal force; None without any."""
        impulse = np.array([self.columns[EAST][-1], self.columns[NORTH][-1]])
        length = float(np.hypot(*impulse))
        return impulse / length if length > 0 else None

    def overtopping(self) -> tuple[float, float]:
        """(mass that passed over the barrier [kg], time of the first frame with some [s]; NaN without any)."""
        mass = self.columns[OVERTOPPED]
        over = mass > 0
        return float(mass[-1]), float(self.times[np.argmax(over)]) if over.any() else np.nan


@dataclass(frozen=True)
class RunUp:
    """The flow at a barrier: largest depth in the cells near it.

    `depth` [m] normal to the bed, at `x`, `y` [m] and `time` [s] (frame number `step`); `surface` and `crest` [m]:
    elevations of the free surface there and of the nearest point of the crest; `typical` [m]: median over the frames
    with flow of the mean depth in the wet cells; `rise` [m]: ground there above the ground at the wall; `wall` [m]:
    height of the crest above the ground at the wall.
    """

    depth: float
    x: float
    y: float
    time: float
    step: int
    surface: float
    crest: float
    typical: float
    rise: float = 0.0
    wall: float = np.inf

    @property
    def is_level(self) -> bool:
        """Whether the ground there is level enough with the wall to compare the surface with the crest."""
        return abs(self.rise) <= LEVEL_SHARE * self.wall


def history_rows(history: BarrierHistory, run_up: RunUp | None, density: float | None) -> list[tuple]:
    """(figure, value, unit) rows of one barrier."""
    force, moment = history.columns[FORCE], history.moment
    k = int(np.argmax(force))
    rows = [
        ("largest mean force between two frames, normal to the wall", force[k] / 1e3, "kN"),
        ("in the frame at", history.times[k] if force[k] > 0 else None, "s"),
        ("largest force of a single step", history.columns[PEAK][-1] / 1e3, "kN"),
        ("impulse, normal to the wall", history.columns[IMPULSE][-1] / 1e3, "kN s"),
    ]
    if moment is not None:
        k = int(np.argmax(moment))
        rows += [("largest mean moment about the foot", moment[k] / 1e3, "kN m"), ("in the frame at",
                 history.times[k] if moment[k] > 0 else None, "s")]  # fmt: skip
    mass, since = history.overtopping()
    rows += [("mass that overtopped it", mass, "kg"), ("volume of that at the density of the release",
             mass / density if density else None, "m3"), ("overtopped since the frame at", since, "s")]  # fmt: skip
    if run_up is not None:
        rows += [
            ("largest flow depth at the wall, normal to the bed", run_up.depth, "m"),
            ("at", f"E {run_up.x:.1f} N {run_up.y:.1f}, t = {run_up.time:.1f} s", ""),
            ("elevation of the surface there (run-up)", f"{run_up.surface:.2f}", "m"),
            ("elevation of the crest there", f"{run_up.crest:.2f}", "m"),
            ("crest above the surface (freeboard)", _freeboard(run_up), "m" if run_up.is_level else ""),
        ]
    return rows


def _freeboard(run_up):
    """Freeboard [m]; words where the cell of the largest depth is too far above or below the wall."""
    if run_up.is_level:
        return run_up.crest - run_up.surface
    side = "above" if run_up.rise > 0 else "below"
    return f"not known: the ground of this cell is {abs(run_up.rise):.1f} m {side} that at the wall; use smaller cells"


def load_verdict(history: BarrierHistory, run_up: RunUp | None) -> str:
    """One sentence: cells over the flow depth at the barrier, and whether its loads are usable."""
    if run_up is None and not history.columns[IMPULSE][-1] > 0:
        return "the flow did not come to it: no load"
    if run_up is None:
        return (
            "loads are not usable: no frame has flow at the barrier, which was loaded between frames; use a smaller "
            "frame_interval"
        )
    cells = run_up.typical / history.cell_size
    found = (
        f"{cells:.2g} cells of {history.cell_size:g} m over the flow depth at the barrier ({run_up.typical:.3g} m, "
        "median of the frames with flow)"
    )
    if history.solver != "points":
        return f"loads are estimates of a depth-averaged run, not for design: {found}; loads need a 3D run"
    if not history.kept:
        return f"loads are not usable: {found}, and the points have lost their volume; use smaller cells"
    if cells < FEWEST_CELLS:
        return f"loads are not usable: {found}, wanted at least {FEWEST_CELLS:g}; use a smaller cell_size"
    return f"loads are usable: {found}, wanted at least {FEWEST_CELLS:g}; single peaks depend on the cell size"


def missed_crest(history: BarrierHistory, run_up: RunUp | None) -> str:
    """One sentence where mass passed over a barrier, but in no frame the flow is as high as its crest; '' otherwise."""
    if run_up is None or not run_up.is_level or run_up.surface >= run_up.crest or not history.overtopping()[0] > 0:
        return ""
    return (
        "its run-up and freeboard are too favourable: mass passed over it, but no frame has a surface above its crest; "
        "use a smaller frame_interval, or smaller cells"
    )
