"""Answer `mpmgis path`: many results and an observed outline along and across one path (AIMEC, Fischer 2013)."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely

from ..maps.averaging.exported_steps import is_export
from ..maps.averaging.frame_values import NOWHERE, cells_of
from ..maps.averaging.result_bands import names_rasters
from ..maps.qgis.colours import BATLOW, ramp_colours
from ..system.csv_rows import write_columns
from ..system.errors import InputError
from ..system.messages import Progress, log, unwatched
from ..system.option import PathLike
from ..terrain.grid import Grid
from ..terrain.observations import cells_within, read_outline
from .answer_files import answer_output, short_number, with_files, write_rows
from .comparison import joint_grid, nearest
from .flow_line import heights_under, line_or_centre, vertex_distances
from .opened_results import ExportFlow, FrameFlow, RasterFlow, distinct_names, open_flow, peaks_of, read_peaks
from .path_coordinates import PathBins, path_coordinates
from .plot_style import COLOURS, legend, plot_file, style_axes
from .question_options import Question
from .thalweg_time import ThalwegTime, thalweg_time, write_thalweg_time, write_thalweg_time_plot

PLOT_FILE, TABLE_FILE, ALONG_FILE = "path.png", "path.csv", "along_path.csv"
TIME_PLOT_FILE, TIME_FILE = "thalweg_time.png", "thalweg_time.csv"
FILES = (PLOT_FILE, TABLE_FILE, ALONG_FILE, TIME_PLOT_FILE, TIME_FILE)
WORD = "path"  # end of the name of the default output folder
USUAL_DEPTH_LIMIT = 0.1  # [m] where no limit is given; also of the cells of the centre line and of the first arrival
CELLS_IN_A_BIN = 2  # fewer leave parts of an oblique path without a cell
BANDS = {"depth": ("h_max", "m"), "speed": ("Ut_max", "m s-1"), "pressure": ("p_max", "Pa")}
RESULT, OUTLINE = "result", "outline"  # kinds of a row
MOST_LETTERS = 40  # of a name in the text
MOST_CURVES = 12  # with a name in the legend
OUTLINE_COLOUR = "#111111"
COLUMNS = (
    ("name", ""),
    ("kind", ""),
    ("runout", "m"),
    ("runout_l", "m"),
    ("runout_E", "m"),
    ("runout_N", "m"),
    ("begin", "m"),
    ("area", "m2"),
    *BANDS.values(),
    ("growth_index", "1"),
    ("runout_difference", "m"),
    ("common_area", "m2"),
    ("overestimated_area", "m2"),
    ("underestimated_area", "m2"),
)
SHOWN = (  # column, heading and letters in the text
    ("runout", "runout [m]", 12),
    ("area", "area [m2]", 12),
    ("growth_index", "growth", 9),
    ("runout_difference", "difference [m]", 16),
    ("common_area", "common [m2]", 13),
    ("overestimated_area", "over [m2]", 12),
    ("underestimated_area", "under [m2]", 12),
)
ALONG_COLUMNS = (("name", ""), ("s", "m"), ("area", "m2"), ("l_right", "m"), ("l_left", "m"))


class Limit(NamedTuple):
    """The value from which a cell counts as reached: `value` of a `band` with a `unit`."""

    band: str
    unit: str
    value: float

    def words(self) -> str:
        """Return the limit as text."""
        return f"{self.band} >= {self.value:g} {self.unit}"


@dataclass(frozen=True)
class OnPath:
    """A result or an outline in the coordinates of the path.

    Parameters
    ----------
    name, kind : str
    grid : Grid
    mask : bool[rows, columns]
        Cells that reach the limit.
    x, y, along, across : float64[k] [m]
        Place, s and l of the cells with a value.
    reached : bool[k]
        Which of these reach the limit.
    values : float64[k]
        Largest values of the limit's band in these cells; of an outline NaN.
    largest : dict of str to float
        By band, over all cells.
    growth : float [1]
        Mass in the last step over that in the first; NaN where it is not known.
    """

    name: str
    kind: str
    grid: Grid
    mask: np.ndarray
    x: np.ndarray
    y: np.ndarray
    along: np.ndarray
    across: np.ndarray
    reached: np.ndarray
    values: np.ndarray
    largest: dict[str, float]
    growth: float = math.nan

    @property
    def area(self) -> float:
        """Area of the cells that reach the limit [m2]."""
        return float(np.count_nonzero(self.mask) * self.grid.cell_area)

    @property
    def runout(self) -> float:
        """Largest s of a cell that reaches the limit [m]; NaN without one."""
        return float(self.along[self.reached].max()) if self.reached.any() else math.nan

    def place(self) -> tuple[float, ...]:
        """Return (s, l, x, y, smallest s) [m] of the cells that reach the limit; s, l, x, y of the farthest."""
        if not self.reached.any():
            return (math.nan,) * 5
        at = int(np.argmax(np.where(self.reached, self.along, -np.inf)))
        return (
            *(float(v[at]) for v in (self.along, self.across, self.x, self.y)),
            float(self.along[self.reached].min()),
        )


@dataclass(frozen=True)
class PathFound:
    """Results along a path.

    Parameters
    ----------
    line : float64[n, 2] [m]
        The path.
    line_source : str
    limit : Limit
    bins : PathBins
    sides : list of OnPath
        The results in their order, then the outline, if any.
    time : ThalwegTime or None
        Of a single result with steps.
    files : tuple of Path
    """

    line: np.ndarray
    line_source: str
    limit: Limit
    bins: PathBins
    sides: list[OnPath]
    time: ThalwegTime | None = None
    files: tuple[Path, ...] = ()

    @property
    def reference(self) -> OnPath:
        """What the results are compared with: the outline, or else the first result."""
        return self.sides[-1] if self.sides[-1].kind == OUTLINE else self.sides[0]

    @staticmethod
    def columns() -> tuple[tuple[str, str], ...]:
        """Return (name, unit) of each column of `rows`."""
        return COLUMNS

    def rows(self) -> list[tuple[str | float, ...]]:
        """Return a row for each result, and one for the outline."""
        return [self._row(side) for side in self.sides]

    def _row(self, side):
        runout, across, x, y, begin = side.place()
        largest = (side.largest.get(band, math.nan) for band, _ in BANDS.values())
        own = self.reference
        common = _common_area(side, own)
        areas = (common, side.area - common, max(own.area - common, 0.0))
        difference = runout - own.runout
        return (side.name, side.kind, runout, across, x, y, begin, side.area, *largest, side.growth, difference, *areas)

    def along_rows(self) -> list[tuple[str | float, ...]]:
        """Return a row for each part of the path with flow, of each result and the outline.

        The values are those of ALONG_COLUMNS and the largest of the limit's band.
        """
        rows = []
        for side in self.sides:
            area, right, left, largest = self.over_parts(side)
            for k in np.flatnonzero(np.isfinite(largest) | (area > 0)):
                rows.append((side.name, self.bins.middles[k], area[k], right[k], left[k], largest[k]))
        return rows

    def over_parts(self, side: OnPath) -> tuple[np.ndarray, ...]:
        """Return area, extent to the right and to the left, and the largest value in each part of the path.

        Parameters
        ----------
        side : OnPath

        Returns
        -------
        (float64[n] [m2], float64[n] [m], float64[n] [m], float64[n])
            n parts. The first three are those of the cells that reach the limit.
        """
        part = self.bins.of(side.along)
        there = part[side.reached]
        area = self.bins.areas(there, side.grid.cell_area)
        right = -self.bins.largest(there, -side.across[side.reached])
        return area, right, self.bins.largest(there, side.across[side.reached]), self.bins.largest(part, side.values)

    def lines(self) -> list[str]:
        """Return lines of text for a terminal."""
        width = min(max(len(side.name) for side in self.sides), MOST_LETTERS) + 2
        lines = [
            f"along {self.line_source}, cells with {self.limit.words()}; differences from {self.reference.name}",
            " " * width + "".join(f"{heading:>{letters}}" for _, heading, letters in SHOWN),
        ]
        for row in self.rows():
            own = dict(zip((name for name, _ in COLUMNS), row, strict=True))
            words = (f"{short_number(own[name]):>{letters}}" for name, _, letters in SHOWN)
            lines.append(f"{str(own['name'])[-MOST_LETTERS:]:<{width}}" + "".join(words))
        return lines


def _common_area(side: OnPath, other: OnPath) -> float:
    """Return the area of the cells of one that also the other covers [m2]."""
    if side is other:
        return side.area
    there = nearest(other.mask, other.grid, side.grid, outside=False)
    return float(np.count_nonzero(side.mask & there) * side.grid.cell_area)


def chosen_limit(depth: float | None, speed: float | None, pressure: float | None) -> Limit:
    """Return the limit that is given, or that of the depth where none is.

    Parameters
    ----------
    depth : float or None [m]
    speed : float or None [m s-1]
    pressure : float or None [Pa]

    Returns
    -------
    Limit

    Raises
    ------
    InputError
        Several limits.
    """
    limits = {"depth": depth, "speed": speed, "pressure": pressure}
    given = {name: value for name, value in limits.items() if value is not None}
    if len(given) > 1:
        raise InputError(f"{' and '.join(f'`{name}`' for name in given)} are given; expected one limit of the runout")
    name, value = next(iter(given.items()), ("depth", USUAL_DEPTH_LIMIT))
    return Limit(*BANDS[name], value)


def path(
    asked: Question,
    line: PathLike | None,
    outline: PathLike | None,
    limit: Limit,
    spacing: float | None = None,
    progress: Progress = unwatched,
) -> PathFound:
    """Compare results and an outline along a path; write table, plots and, of a single one, the thalweg-time diagram.

    Parameters
    ----------
    asked : Question
        Each of its paths is a result.
    line : path or None
        File with the path; None: the centre line of the first result.
    outline : path or None
        Polygons that were observed.
    limit : Limit
        From which a cell counts as reached.
    spacing : float, optional [m]
        Length of the parts of the path; default: two cells.
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    PathFound

    Raises
    ------
    MpmgisError
        Unreadable input, results in several CRS, or no cell that reaches the limit; nothing is written then.
    """
    output = answer_output(asked, WORD, FILES)
    names = distinct_names(asked["frames"])
    sides: list[OnPath] = []
    vertices, source, first_flow = np.empty((0, 2)), "", None
    for frames, name in zip(asked["frames"], names, strict=True):
        own: Question = {**asked, "frames": (frames,)}
        flow = _flow(own, output, first=not sides, needed=line is None)
        bands, grid = _bands(own, name, limit, sides[0].grid if sides else None, progress)
        if not sides:
            vertices, source = _line(line, name, flow, bands, grid, limit)
            first_flow = flow
        sides.append(replace(_on_path(name, bands, grid, limit, vertices), growth=_growth(flow)))
    if not any(side.reached.any() for side in sides):
        most = max((side.largest.get(limit.band, math.nan) for side in sides), default=math.nan)
        raise InputError(
            f"no cell of {' or '.join(names)} has {limit.words()}, the largest is {most:.4g} {limit.unit}; give a "
            "lower limit"
        )
    for side in sides:
        if not side.reached.any():
            log.info(f"{side.name}: no cell has {limit.words()}; it has no runout")
    if outline is not None:
        sides.append(_outline(outline, sides[0].grid, vertices))
    bins = _bins(sides, spacing or CELLS_IN_A_BIN * sides[0].grid.cell_size)
    if line is not None:
        _log_line_end(line, vertices, sides)
    time = _time(first_flow, sides[0], bins, limit, progress) if len(names) == 1 else None
    found = PathFound(vertices, source, limit, bins, sides, time)
    return with_files(found, output, asked["overwrite"], _writers(found))


def _flow(asked: Question, output: Path, first: bool, needed: bool) -> FrameFlow | ExportFlow | RasterFlow | None:
    """Open a result for its terrain, steps and masses; None where none of these is used."""
    frames = asked["frames"][0]
    if is_export(frames):
        return open_flow(asked, output) if first else None
    if names_rasters(frames):
        return open_flow(asked, output, peaks_do=True, used=("density",)) if first and needed else None
    return open_flow(asked, output)


def _bands(
    asked: Question, name: str, limit: Limit, first: Grid | None, progress: Progress
) -> tuple[dict[str, np.ndarray], Grid]:
    """Return the bands of BANDS that a result has, and their grid."""
    result = peaks_of(asked, progress, used_of_rasters=("density",))
    bands, grid = read_peaks(result, [band for band, _ in BANDS.values()], asked["density"], first)
    if limit.band not in bands or grid is None:
        raise InputError(
            f"{name} has no {limit.band}, which the limit requires; it has {', '.join(bands) or 'no largest values'}"
            + ("; give `density`" if limit.band == "p_max" and "Ut_max" in bands else "")
        )
    return bands, grid


def _line(line, name, flow, bands, grid, limit):
    """(vertices, words for the source) of the path: of the deep cells of the first result where no line is given."""
    depth = bands.get("h_max")
    if depth is None and line is None:
        raise InputError(f"{name} has no largest depth (h_max, or <name>_pft) for a centre line; give `line`")
    values = bands[limit.band] if depth is None else depth
    flowed = np.nan_to_num(values) > (USUAL_DEPTH_LIMIT if line is None else 0.0)
    if not flowed.any():
        raise InputError(f"{name}: no cell was ever deeper than {USUAL_DEPTH_LIMIT:g} m; give `line`")
    terrain = None if flow is None else flow.terrain
    elevation = np.full(grid.shape, np.nan) if terrain is None else heights_under(flowed, grid, terrain)
    return line_or_centre(line, name, flowed, values, elevation, grid, terrain)


def _on_path(name, bands, grid, limit, line):
    """Return the OnPath of a result."""
    values = np.nan_to_num(bands[limit.band], nan=0.0)
    mask = values >= np.float32(limit.value)
    row, column = np.nonzero(values > 0)
    x, y = grid.xy(row, column)
    largest = {band: float(np.nanmax(own)) for band, own in bands.items() if np.isfinite(own).any()}
    return OnPath(
        name,
        RESULT,
        grid,
        mask,
        x,
        y,
        *path_coordinates(line, x, y),
        mask[row, column],
        values[row, column].astype(float),
        largest,
    )


def _outline(path, grid, line):
    """Return the OnPath of an observed outline, on the cells of a grid, which is extended over it."""
    shape = read_outline(path, grid)
    west, south, east, north = shapely.bounds(shape)
    own = joint_grid([grid], np.array([(west, south), (west, north), (east, south), (east, north)]))
    mask = cells_within(shape, own)
    if not mask.any():
        raise InputError(f"{path}: the outline contains no centre of a cell of {grid.cell_size:g} m; use smaller cells")
    row, column = np.nonzero(mask)
    x, y = own.xy(row, column)
    along, across = path_coordinates(line, x, y)
    there = np.ones(len(x), bool)
    return OnPath(Path(path).stem, OUTLINE, own, mask, x, y, along, across, there, np.full(len(x), np.nan), {})


def _growth(flow: FrameFlow | ExportFlow | RasterFlow | None) -> float:
    """Return the mass of the last frame over that of the first; NaN without two frames or without mass."""
    if not isinstance(flow, FrameFlow) or len(flow.entries) < 2:
        return math.nan
    frames = (flow.entries[place].read(flow.density) for place in (0, -1))
    first, last = (float(np.sum(frame.particles.mass, dtype=float)) for frame in frames)
    return last / first if first > 0 else math.nan


def _bins(sides: list[OnPath], spacing: float) -> PathBins:
    begin = min(float(side.along.min()) for side in sides if side.along.size)
    end = max(float(side.along.max()) for side in sides if side.along.size)
    return PathBins.over(begin, end, spacing)


def _time(flow, side, bins, limit, progress):
    """Return the ThalwegTime of a flow with steps, in the cells of its largest values; None without steps."""
    if flow is None or isinstance(flow, RasterFlow):
        return None
    cells = cells_of(flow.grid, side.x, side.y)
    there = cells != NOWHERE
    depth = limit.value if limit.band == "h_max" else USUAL_DEPTH_LIMIT
    return thalweg_time(flow, cells[there], side.along[there], bins, depth, progress)


def _log_line_end(path: PathLike, line: np.ndarray, sides: list[OnPath]) -> None:
    beyond = max(side.runout for side in sides if side.reached.any()) - float(vertex_distances(line)[-1])
    if beyond > sides[0].grid.cell_size:
        log.info(f"{path} ends {beyond:.0f} m before the flow does; it is extended straight")


def _writers(found: PathFound) -> dict[str, Callable[[Path, PathFound], Any]]:
    """Return the functions that write each file."""
    writers: dict[str, Callable[[Path, PathFound], Any]] = {
        PLOT_FILE: write_path_plot,
        TABLE_FILE: write_rows,
        ALONG_FILE: _write_along,
    }
    time = found.time
    if time is not None:
        writers[TIME_PLOT_FILE] = lambda path, _: write_thalweg_time_plot(path, time)
        writers[TIME_FILE] = lambda path, _: write_thalweg_time(path, time)
    return writers


def _write_along(path, found):
    columns = [*ALONG_COLUMNS, (found.limit.band, found.limit.unit)]
    write_columns(path, columns, found.along_rows())


def write_path_plot(path: Path, found: PathFound) -> None:
    """Draw extent across the path, largest values along it, and runout, area and growth of each result.

    Parameters
    ----------
    path : Path
    found : PathFound
    """
    count = sum(side.kind == RESULT for side in found.sides)
    colours = COLOURS[:count] if count < len(COLOURS) else ramp_colours(BATLOW, count)
    with plot_file(path, (9.0, 7.5), rows=2) as panels:
        across, values = panels[:, 0]
        for side, colour in zip(found.sides, [*colours, OUTLINE_COLOUR], strict=False):
            _draw_side(across, values, found, side, OUTLINE_COLOUR if side.kind == OUTLINE else colour)
        across.axhline(0.0, color="#999999", linewidth=0.8)
        title = f"along {Path(found.line_source).name}: {found.limit.words()}"
        style_axes(across, "l across the path, left above [m]", title=title)
        values.axhline(found.limit.value, color="#999999", linewidth=0.8, linestyle="--", label="limit")
        style_axes(values, f"largest {found.limit.band} [{found.limit.unit}]", "distance s along the path [m]")
        values.set_ylim(bottom=0.0)
        if len(found.sides) <= MOST_CURVES:
            legend(across, loc="best", title="runout, area", title_fontsize=8, alignment="left")
            legend(values, loc="best")


def _draw_side(across, values, found, side, colour):
    _, right, left, largest = found.over_parts(side)
    middles = found.bins.middles
    growth = f", growth {side.growth:.2f}" if math.isfinite(side.growth) else ""
    label = f"{side.name}: {side.runout:.0f} m, {side.area:.0f} m²{growth}"
    filled = side.kind == OUTLINE or len(found.sides) == 1
    if filled:
        across.fill_between(middles, right, left, color=colour, alpha=0.15, linewidth=0)
    across.plot(middles, left, color=colour, linewidth=1.3, label=label)
    across.plot(middles, right, color=colour, linewidth=1.3)
    if side.kind == RESULT:
        values.plot(middles, largest, color=colour, linewidth=1.3)
    if math.isfinite(side.runout):
        for axes in (across, values):
            axes.axvline(side.runout, color=colour, linewidth=0.9, linestyle=":")
