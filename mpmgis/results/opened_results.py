"""Open results: frames of any code, an exported folder, or rasters; cells averaged as in an export."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..exchange.frame_source import DeclarationOptions, frames_at
from ..frames.frame_options import DensityOptions, FrameTerrainOptions
from ..frames.run_terrain import run_terrain, terrain_of_rasters
from ..maps.averaging.averaging_options import USUAL_DEPTH, SizedCellOptions
from ..maps.averaging.band_products import PRODUCTS
from ..maps.averaging.export_resolution import (
    default_cell_size,
    export_grid,
    report_cells,
    require_cells_within,
    run_cell_size,
)
from ..maps.averaging.exported_steps import ExportedSteps, is_export, open_steps
from ..maps.averaging.frame_values import Averaging, cells_of, frame_at_cells
from ..maps.averaging.placement import Bed
from ..maps.averaging.result_bands import Result, names_rasters, open_result
from ..maps.export.export_inputs import log_unused_options, release_density
from ..maps.export.export_options import ExportOptions, export_with
from ..maps.export.map_export import peaks_of_frames
from ..system.errors import FormatError, InputError
from ..system.messages import Progress, log, unwatched
from ..system.option import PathLike, options_of
from ..system.parallel import frame_pool
from ..terrain.elevation import Terrain
from ..terrain.grid import Grid
from .question_options import FrameQuestion, Question

SAME_CELLS = 0.01  # [cells] by which the corners of rasters of one result may differ


@dataclass(frozen=True)
class FrameFlow:
    """A flow as frames on disk: `entries` by time, their `terrain`, and the averaging of their cells."""

    name: str
    entries: tuple
    terrain: Terrain
    averaging: Averaging

    @property
    def times(self) -> np.ndarray:
        """Times of the frames, float64[frames] [s]."""
        return np.array([entry.time for entry in self.entries])

    @property
    def grid(self) -> Grid:
        """Grid of the cells."""
        return self.averaging.grid

    @property
    def density(self) -> float:
        """Density of the release [kg m-3]."""
        return self.averaging.density

    @property
    def min_depth(self) -> float:
        """Depth [m] from which there are velocities."""
        return self.averaging.min_depth

    def at_cells(
        self, cells: np.ndarray, names: Collection[str], steps: Iterable[int], progress: Progress = unwatched
    ) -> dict[str, np.ndarray]:
        """Return values of products in cells at steps.

        Parameters
        ----------
        cells : int64[cells]
            Flat numbers of cells of the grid.
        names : collection of str
            Products.
        steps : iterable of int
            Numbers of frames.
        progress : callable
            Called with (steps done, steps in all).

        Returns
        -------
        dict of str to float64[steps, cells]
            By product; NaN off the grid, and velocities where the flow is too shallow.
        """
        averaging = replace(self.averaging, names=tuple(name for name in PRODUCTS if name in names or name == "h"))
        found = []
        with frame_pool() as pool:
            entries = [self.entries[step] for step in steps]
            for values in pool.map(_entry_at_cells, entries, averaging, cells):
                found.append(values)
                progress(len(found), len(entries))
        return {name: np.array([values[name] for values in found]) for name in names}


def _entry_at_cells(entry, averaging, cells):
    return frame_at_cells(entry.read(averaging.density), averaging, cells)


@dataclass(frozen=True)
class ExportFlow:
    """A flow as the exported `steps`, with its `terrain`."""

    name: str
    steps: ExportedSteps
    terrain: Terrain
    entries = ()

    @property
    def times(self) -> np.ndarray:
        """Times of the steps, float64[steps] [s]."""
        return np.array(self.steps.times)

    @property
    def grid(self) -> Grid:
        """Grid of the cells."""
        return self.steps.grid

    @property
    def density(self) -> float | None:
        """Density of the release [kg m-3]; None if the export has no such tag."""
        return self._number("density")

    @property
    def min_depth(self) -> float:
        """Depth [m] from which there are velocities."""
        return self._number("min_depth") or 0.0

    def _number(self, tag):
        try:
            return float(self.steps.tags.get(tag))
        except (TypeError, ValueError):
            return None

    def at_cells(
        self, cells: np.ndarray, names: Collection[str], steps: Iterable[int], progress: Progress = unwatched
    ) -> dict[str, np.ndarray]:
        """Return values of products in cells at steps, read from the rasters.

        Parameters
        ----------
        cells : int64[cells]
            Flat numbers of cells of the grid.
        names : collection of str
            Products.
        steps : iterable of int
            Numbers of exported steps.
        progress : callable
            Called with (steps done, steps in all).

        Returns
        -------
        dict of str to float64[steps, cells]
            By product; NaN off the grid, and velocities where the flow is too shallow.

        Raises
        ------
        InputError
            The steps do not have all products.
        """
        missing = [name for name in names if name not in self.steps.bands]
        if missing:
            raise InputError(
                f"{self.name}: the exported steps have no {', '.join(missing)}; give the frames instead, or export "
                f"with `products={','.join(missing)}`"
            )
        found = []
        for step in steps:
            found.append(self.steps.read(step, names, cells))
            progress(len(found), len(steps))
        return {name: np.array([values[name] for values in found]) for name in names}


@dataclass(frozen=True)
class RasterFlow:
    """A flow known only by rasters of its largest values, as other codes write them, on a `terrain`."""

    name: str
    terrain: Terrain
    grid: Grid
    density: float | None
    min_depth: float
    entries = ()
    times = np.empty(0)


def open_flow(
    asked: Question, output: Path | None, peaks_do: bool = False, used: Sequence[str] = ()
) -> "FrameFlow | ExportFlow | RasterFlow":
    """Open the flow of a question: frames, one exported folder, or rasters of its largest values.

    Parameters
    ----------
    asked : Question
    output : Path
        It must not contain the DTM.
    peaks_do : bool
        Whether largest values are sufficient.
    used : sequence of str
        Options of frames that also apply to rasters of largest values.

    Returns
    -------
    FrameFlow, ExportFlow or RasterFlow

    Raises
    ------
    MpmgisError
    """
    if any(is_export(path) for path in asked["frames"]):
        return _open_export(asked)
    if any(names_rasters(path) for path in asked["frames"]):
        return _open_rasters(asked, peaks_do, used)
    return open_frames(asked, output, cell_size=asked["cell_size"], min_depth=asked["min_depth"])


def open_frames(
    asked: FrameQuestion,
    output: Path | None,
    why: str = "",
    cell_size: float | None = None,
    min_depth: float = USUAL_DEPTH,
) -> FrameFlow:
    """Open the flow of a question whose results are frames.

    Parameters
    ----------
    asked : FrameQuestion
    output : Path
        It must not contain the DTM.
    why : str
        Reason why rasters do not suffice, for the error.
    cell_size : float or None [m]
        None: the finer of the cells of DTM and run.
    min_depth : float [m]
        Shallower flow has no velocity.

    Returns
    -------
    FrameFlow

    Raises
    ------
    MpmgisError
        Unreadable input, or rasters instead of frames.
    """
    for path in asked["frames"]:
        if is_export(path):
            raise InputError(f"{path} is an export: {why}; give the folder of its frames")
        if names_rasters(path):
            raise InputError(f"{path} are rasters: {why}; give the code's frames of particles")
    entries = frames_at(asked["frames"], asked)
    terrain = run_terrain(asked, entries, output)
    density = release_density(asked, entries)
    log_unused_options(asked, entries)
    run_cells = run_cell_size(entries)
    require_cells_within(terrain.grid, cell_size, north_up=True)
    grid = export_grid(terrain.grid, default_cell_size(terrain.grid, run_cells) if cell_size is None else cell_size)
    report_cells(grid, terrain.grid, run_cells, cell_size)
    averaging = Averaging(
        bed=Bed.of(terrain, standoff=asked["standoff"]),
        grid=grid,
        density=density,
        names=(),
        percentile=asked["percentile"],
        min_depth=min_depth,
    )
    return FrameFlow(result_name(asked["frames"]), entries, terrain, averaging)


def result_name(frames: Sequence[PathLike]) -> str:
    """Return the name of a result.

    It is the name of the folder of its frames or of the export, or the common beginning of its rasters.

    Parameters
    ----------
    frames : sequence of path
        Of the result.

    Returns
    -------
    str
    """
    path = Path(str(frames[0])).absolute()
    if not path.is_dir() and names_rasters(path):
        return path.stem
    folder = path if path.is_dir() else path.parent
    return folder.resolve().name or "frames"


def distinct_names(paths: Sequence[PathLike]) -> tuple[str, ...]:
    """Return a name for each result: that of its file or folder, or the path where two have the same.

    Parameters
    ----------
    paths : sequence of path
    """
    names = [Path(path).resolve().name for path in paths]
    return tuple(
        name if names.count(name) == 1 else str(path) for name, path in zip(names, map(Path, paths), strict=True)
    )


def _open_export(asked):
    _require_alone(asked)
    _refuse_options_of_frames(asked)
    steps = open_steps(asked["frames"][0])
    path = asked["dem"] or steps.terrain
    return ExportFlow(steps.name, steps, terrain_of_rasters(path, steps.grid.crs, asked["dem_band"], asked["to_crs"]))


def _open_rasters(asked: Question, peaks_do: bool, used: Sequence[str]) -> RasterFlow:
    """The RasterFlow of rasters with standard names."""
    path = asked["frames"][0]
    if not peaks_do:
        raise InputError(f"{path} are rasters of largest values without times; give frames, or an export")
    _require_alone(asked)
    _refuse_options_of_frames(asked, used)
    result = open_result(path)
    dem = asked["dem"] or result.terrain
    if dem is None:
        raise InputError(f"{path}: there is no DTM beside these rasters; give it with `dem`")
    _, grid = next(iter(result.bands.values())).read()
    terrain = terrain_of_rasters(dem, grid.crs, asked["dem_band"], asked["to_crs"])
    return RasterFlow(result_name(asked["frames"]), terrain, grid, asked["density"], asked["min_depth"])


def _require_alone(asked):
    if len(asked["frames"]) > 1:
        first, second, *_ = asked["frames"]
        raise InputError(f"{first} and {second}: give one export or set of rasters at a time, without frames")


def options_of_frames(asked: Question) -> list[str]:
    """Return the names of the given options that apply only to frames.

    Parameters
    ----------
    asked : Question
    """
    tables = (FrameTerrainOptions, DensityOptions, DeclarationOptions, SizedCellOptions)
    options = {name: option for table in tables for name, option in options_of(table).items()}
    values: Mapping[str, Any] = {**asked}
    return [
        name
        for name, option in options.items()
        if name not in ("dem_band", "to_crs") and values[name] != option.default
    ]


def _refuse_options_of_frames(asked, used=()):
    """Refuse options of reading and averaging frames, except those in `used`: they have no effect on rasters."""
    given = [name for name in options_of_frames(asked) if name not in used]
    if given:
        raise InputError(
            f"{asked['frames'][0]} contains rasters, which are already averaged; "
            f"{', '.join(f'`{name}`' for name in given)} requires frames"
        )


def peaks_of(
    asked: Question, progress: Progress = unwatched, used: Sequence[str] = (), used_of_rasters: Sequence[str] = ()
) -> Result:
    """Return the Result (maxima, deposit, terrain) of an export or other rasters, or of frames, in memory.

    Parameters
    ----------
    asked : Question
    progress : callable
        Called with (frames done, frames in all).
    used : sequence of str
        Names of options of frames that also apply to an export.
    used_of_rasters : sequence of str
        Names of those that apply to other rasters, too.

    Returns
    -------
    Result
    """
    frames = asked["frames"]
    exported = any(is_export(path) for path in frames)
    if exported or any(names_rasters(path) for path in frames):
        _require_alone(asked)
        _refuse_options_of_frames(asked, used if exported else (*used, *used_of_rasters))
        return replace(open_result(frames[0]).with_export_names(), name=result_name(frames))
    return replace(peaks_of_frames(export_with(**_shared(asked)), progress), name=result_name(frames))


def _shared(asked: Question) -> dict[str, Any]:
    """Options of a question that an export has too."""
    return {name: value for name, value in asked.items() if name == "frames" or name in options_of(ExportOptions)}


def read_peaks(
    result: Result, names: Collection[str], density: float | None = None, crs_of: Grid | None = None
) -> tuple[dict[str, np.ndarray], Grid | None]:
    """Read bands of a Result that exist.

    Parameters
    ----------
    result : Result
    names : collection of str
        Bands.
    density : float, optional [kg m-3]
        With it a missing pressure is computed from the largest speed.
    crs_of : Grid, optional
        The bands must be in the same CRS, or have none.

    Returns
    -------
    (dict of str to float[rows, columns], Grid)

    Raises
    ------
    MpmgisError
        An unreadable raster, rasters on several grids, or in another CRS.
    """
    bands, grid = {}, None
    for name in names:
        if name in result.bands:
            bands[name], own = result.read(name, grid or crs_of)
            grid = grid or own
            _require_same_cells(result, name, own, grid, next(iter(bands)))
    if density is None or result.kind in ("export", "run") or "p_max" not in names:
        return bands, grid
    if "p_max" in bands:
        log.info(f"{result.name} contains the pressure; `density={density:g}` is not used")
    elif "Ut_max" in result.bands:
        speed, own = result.read("Ut_max", grid or crs_of)
        grid = grid or own
        _require_same_cells(result, "Ut_max", own, grid, next(iter(bands), "Ut_max"))
        bands["p_max"] = density * speed**2
    return bands, grid


def _require_same_cells(result: Result, name: str, grid: Grid, first: Grid, first_name: str) -> None:
    """Refuse a raster whose corners are off those of the first one by more than SAME_CELLS."""
    if grid.shape == first.shape and np.abs(grid.corners() - first.corners()).max() <= SAME_CELLS * first.cell_size:
        return
    words = (
        f"{band} {own.shape[0]} x {own.shape[1]} cells of {own.cell_size:.6g} m from E {own.bounds[0]:.8g} "
        f"N {own.bounds[1]:.8g}"
        for band, own in ((first_name, first), (name, grid))
    )
    raise FormatError(f"{result.name}: its rasters have different grids ({', '.join(words)}); export them on one grid")


def require_on_grid(
    flow: FrameFlow | ExportFlow, x: np.ndarray, y: np.ndarray, names: Sequence[str] | np.ndarray, what: str
) -> np.ndarray:
    """Return the flat cells of map points; raise InputError for the first one outside the raster.

    Parameters
    ----------
    flow : FrameFlow or ExportFlow
    x, y : float64[n] [m]
    names : sequence of str
        Of the points.
    what : str
        What a point is, for the error.

    Returns
    -------
    int64[n]

    Raises
    ------
    InputError
    """
    cells = cells_of(flow.grid, x, y)
    off = np.flatnonzero(cells < 0)
    if off.size:
        west, south, east, north = flow.grid.bounds
        k = int(off[0])
        raise InputError(
            f"{what} {str(names[k])!r} (E {x[k]:.1f}, N {y[k]:.1f}) is outside {flow.terrain.path} (E {west:.0f} to "
            f"{east:.0f}, N {south:.0f} to {north:.0f}); move it, or check its CRS"
        )
    return cells
