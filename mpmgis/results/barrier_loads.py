"""Compute loads on barriers and buildings: force, moment, overtopping, run-up, and whether they are usable.

A piece of outline that faces the flow bears, per width, the drag C_d rho v^2 h / 2 of a pressure that is uniform over
the depth h, with its resultant at h / 2, and the hydrostatic force rho g h^2 / 2, with its resultant at h / 3. C_d = 2
is the momentum flux rho h v^2 of a flow that the wall stops (balance of momentum).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from ..laws.quantities import GRAVITY
from ..scene.point_effects import FEWEST_CELLS

# headings of the columns of a barrier's table
FORCE, PEAK = "mean normal force [N]", "largest normal force of a step so far [N]"
IMPULSE, OVERTOPPED = "normal impulse [N s]", "overtopped mass [kg]"
EAST, NORTH = "impulse east [N s]", "impulse north [N s]"
MOMENTS = ("mean moment east [N m]", "mean moment north [N m]", "mean moment up [N m]")
LEVEL_SHARE = 0.5  # [heights of the wall] by which the ground at a run-up may be above or below that at the wall
BANDS = ("h", "Ut_E", "Ut_N", "Ut")  # of the flow at a building
FIELDS = {  # attribute: unit, meaning; each has its time in <attribute>_t, but the height
    "flow_depth": ("m", "largest flow depth at the outline"),
    "flow_speed": ("m s-1", "largest speed along the slope at the outline"),
    "flow_press": ("Pa", "largest pressure at the foot: C_d rho v^2 / 2 + rho g h"),
    "flow_fwidth": ("N m-1", "largest force per width of a piece of outline"),
    "flow_force": ("N", "largest force on the outline that faces the flow"),
    "flow_moment": ("N m", "largest moment of that force about the foot"),
    "flow_height": ("m", "height of the resultant over the foot at the time of the largest force"),
}
TIMED = tuple(name for name in FIELDS if name != "flow_height")
DIRECTIONS = 72  # every 5 degrees, tried for a flow at rest, which presses on all sides
STILL = 1e-9  # [m s-1] a smaller mean velocity of the flow at the outline has no direction


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
        """Times of the frames, float64[frames] [s]."""
        return self.columns["time [s]"]

    @property
    def moment(self) -> np.ndarray | None:
        """Length of the mean moment about the foot since the frame before, float64[frames] [N m]; None of columns."""
        if not all(heading in self.columns for heading in MOMENTS):
            return None
        return np.sqrt(sum(self.columns[heading] ** 2 for heading in MOMENTS))

    @property
    def direction(self) -> np.ndarray | None:
        """Unit vector (east, north) of the total horizontal force, float64[2]; None without any."""
        impulse = np.array([self.columns[EAST][-1], self.columns[NORTH][-1]])
        length = float(np.hypot(*impulse))
        return impulse / length if length > 0 else None

    def overtopping(self) -> tuple[float, float]:
        """Return the mass that passed over the barrier [kg], and the time of the first frame with some [s].

        Returns
        -------
        (float, float)
            The time is NaN without overtopping.
        """
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
    """Return the rows of one barrier for the table of a report.

    Parameters
    ----------
    history : BarrierHistory
    run_up : RunUp or None
        None where no frame has flow at the barrier.
    density : float or None [kg m-3]

    Returns
    -------
    list of (str, float or str, str)
        Figure, value, unit.
    """
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
        rows += [
            ("largest mean moment about the foot", moment[k] / 1e3, "kN m"),
            ("in the frame at", history.times[k] if moment[k] > 0 else None, "s"),
        ]
    mass, since = history.overtopping()
    rows += [
        ("mass that overtopped it", mass, "kg"),
        ("volume of that at the density of the release", mass / density if density else None, "m3"),
        ("overtopped since the frame at", since, "s"),
    ]
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
    """Return one sentence: cells over the flow depth at the barrier, and whether its loads are usable.

    Parameters
    ----------
    history : BarrierHistory
    run_up : RunUp or None

    Returns
    -------
    str
    """
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
    """Return one sentence where mass passed over a barrier, but in no frame the flow is as high as its crest.

    Parameters
    ----------
    history : BarrierHistory
    run_up : RunUp or None

    Returns
    -------
    str
        '' otherwise.
    """
    if run_up is None or not run_up.is_level or run_up.surface >= run_up.crest or not history.overtopping()[0] > 0:
        return ""
    return (
        "its run-up and freeboard are too favourable: mass passed over it, but no frame has a surface above its crest; "
        "use a smaller frame_interval, or smaller cells"
    )


@dataclass(frozen=True)
class Outline:
    """Pieces of a building's outer outline.

    `x`, `y` float64[n] [m]: where the flow is taken, in front of the middle of each piece; `normal` float64[n, 2]:
    outward unit normal; `length` float64[n] [m].
    """

    x: np.ndarray
    y: np.ndarray
    normal: np.ndarray
    length: np.ndarray


def outline_of(shape: shapely.Geometry, cell_size: float) -> Outline:
    """Return the Outline of a polygon or multipolygon, in pieces of at most half a cell.

    The flow of a piece is that half a cell in front of it, so that a building that stands in the terrain has the flow
    at its walls and not that on its roof. Courtyards are not loaded.

    Parameters
    ----------
    shape : shapely geometry [m]
    cell_size : float [m]

    Returns
    -------
    Outline
    """
    places, normals, lengths = [], [], []
    for polygon in shapely.get_parts(shape):
        ring = np.asarray(orient(polygon).exterior.coords)[:, :2]  # counter-clockwise
        for start, end in pairwise(ring):
            side = float(np.hypot(*(end - start)))
            if side == 0.0:
                continue
            count = max(1, int(np.ceil(2.0 * side / cell_size)))
            along = (end - start) / side
            outward = np.array([along[1], -along[0]])
            middles = (np.arange(count) + 0.5)[:, None] * side / count
            places.append(start + middles * along + 0.5 * cell_size * outward)
            normals.append(np.tile(outward, (count, 1)))
            lengths.append(np.full(count, side / count))
    x, y = np.concatenate(places).T
    return Outline(x, y, np.concatenate(normals), np.concatenate(lengths))


def line_loads(
    depth: np.ndarray, speed: np.ndarray, density: float, drag: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the loads per width of a flow against a wall.

    Parameters
    ----------
    depth : float64[...] [m]
    speed : float64[...] [m s-1]
    density : float [kg m-3]
    drag : float [1]
        C_d.

    Returns
    -------
    (float64[...] [N m-1], float64[...] [N], float64[...] [Pa])
        Force, moment about the foot, pressure at the foot.
    """
    dynamic = 0.5 * drag * density * speed**2
    static = density * GRAVITY * depth
    force = dynamic * depth + 0.5 * static * depth
    moment = dynamic * depth**2 / 2.0 + static * depth**2 / 6.0
    return force, moment, np.where(depth > 0, dynamic + static, 0.0)


def largest_loads(
    outline: Outline, times: Sequence, values: dict, density: float, drag: float, min_depth: float
) -> dict[str, float]:
    """Find the largest loads of a building over time.

    Parameters
    ----------
    outline : Outline
    times : sequence of float [s]
    values : dict of str to float64[times, n]
        BANDS at the pieces of the outline; NaN where there is no flow.
    density : float [kg m-3]
    drag : float [1]
        C_d.
    min_depth : float [m]
        Flow shallower than this does not load.

    Returns
    -------
    dict of str to float
        FIELDS, and `<name>_t` [s] for those of TIMED. Without flow: zeros, and NaN for times and height.
    """
    wet = np.nan_to_num(values["h"]) >= min_depth
    depth, speed, east, north = (np.where(wet, np.nan_to_num(values[name]), 0.0) for name in ("h", "Ut", *BANDS[1:3]))
    force, moment, pressure = line_loads(depth, speed, density, drag)
    total = np.array([_facing(outline, *row) for row in zip(east, north, force, moment, strict=True)])
    series = dict(zip(TIMED, (*(v.max(axis=1) for v in (depth, speed, pressure, force)), *total.T), strict=True))
    found = {}
    for name, one in series.items():
        k = int(np.argmax(one))
        found[name] = float(one[k])
        found[f"{name}_t"] = float(times[k]) if one[k] > 0 else np.nan
    k = int(np.argmax(total[:, 0]))
    found["flow_height"] = float(total[k, 1] / total[k, 0]) if total[k, 0] > 0 else np.nan
    return found


def _facing(
    outline: Outline, east: np.ndarray, north: np.ndarray, force: np.ndarray, moment: np.ndarray
) -> tuple[float, float]:
    """(force [N], moment [N m]) on the pieces that face the flow; of one at rest from where they are largest."""
    mean = np.array([outline.length @ east, outline.length @ north])
    size = float(np.hypot(*mean))
    if size > STILL * outline.length.sum():
        directions = mean[None] / size
    else:
        angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
        directions = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    width = np.clip(-directions @ outline.normal.T, 0.0, None) * outline.length
    forces = width @ force
    k = int(np.argmax(forces))
    return forces[k], width[k] @ moment
