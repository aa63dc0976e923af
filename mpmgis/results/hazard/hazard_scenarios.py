"""Compute hazard levels of each scenario, from frames, exports, rasters of other codes or ensembles."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from affine import Affine

from ...frames.many_runs_folder import ENSEMBLE, read_folder_record
from ...maps.averaging.result_bands import open_result
from ...system.errors import FormatError, GeoreferenceError, InputError
from ...system.messages import Progress, log, unwatched
from ...terrain.georeference import name_of, same_place, warp_command
from ...terrain.grid import Grid
from ..comparison import joint_grid, nearest
from ..opened_results import options_of_frames, peaks_of
from .hazard_levels import HazardMatrix, Period, levels_of
from .hazard_options import HazardQuestion
from .intensity_answer import bands_of
from .scenario_facts import facts_of, unfinished_words

INSET = 0.49  # [cells] from the centre of a cell to the outermost places where other rasters are read
WHOLE = ("export", "run")  # kinds of results in which nodata is a cell without flow


@dataclass(frozen=True)
class Scenario:
    """One scenario on its own grid.

    Parameters
    ----------
    years : float
        Return period.
    path : Path
    period : Period
    grid : Grid
    level : uint8[rows, columns]
        The largest of all members.
    known : bool[rows, columns]
        False where the results have no data.
    shares : float32[levels, rows, columns] or None
        Of an ensemble: share of its members with at least a level, from the lowest.
    terrain : Terrain, Path or None
    facts : str
        Release and parameters, as far as the results name them.
    members : int
    whole : bool
        Whether the rasters hold all of the flow, so that cells beyond them are dry.
    unfinished : str
        Why its levels can be too low: the run was stopped, or its flow still moves; "" for a flow at rest.
    release : tuple of shapely.MultiPolygon
        As far as the results have it.
    ground : Grid or None
        Where cells beyond the rasters are dry in any case: the DTM of a region.
    """

    years: float
    path: Path
    period: Period
    grid: Grid
    level: np.ndarray
    known: np.ndarray
    shares: np.ndarray | None
    terrain: object
    facts: str = ""
    members: int = 1
    whole: bool = False
    unfinished: str = ""
    release: tuple = ()
    ground: Grid | None = None

    def words(self) -> str:
        """Return return period and name as text."""
        more = f", largest of {self.members} runs" if self.shares is not None else ""
        return f"{self.years:g} years: {self.path.name}{more}"

    def on(self, grid: Grid) -> "Scenario":
        """Return the scenario on another grid, each cell with the highest level that it meets.

        Parameters
        ----------
        grid : Grid
            With cells that are not larger.

        Returns
        -------
        Scenario
        """
        if same_cells(grid, self.grid):
            return self
        known = np.logical_and.reduce(list(_around(self.known, self.grid, grid, True)))
        if not self.whole:
            known &= np.logical_and.reduce(list(_around(np.ones((1, 1), bool), _one_cell(self), grid, False)))
        level = np.maximum.reduce(list(_around(self.level, self.grid, grid, 0)))
        shares = None
        if self.shares is not None:
            shares = np.stack([np.maximum.reduce(list(_around(share, self.grid, grid, 0))) for share in self.shares])
        return replace(self, grid=grid, level=level, known=known, shares=shares)


def same_cells(first: Grid, second: Grid) -> bool:
    """Return whether two grids have the same cells.

    Parameters
    ----------
    first, second : Grid
    """
    return first.shape == second.shape and first.transform == second.transform


def _in_cells_of(part: Grid, whole: Grid) -> bool:
    """Whether the cells of one grid are cells of the lattice of another one, to a thousandth of a cell."""
    place = np.array(whole.rowcol(*part.xy([0, part.shape[0]], [0, part.shape[1]])))
    same_sides = np.allclose(part.matrix, whole.matrix, rtol=1e-9)
    return bool(same_sides and np.allclose(place, np.rint(place), atol=1e-3, rtol=0))


def _one_cell(scenario: Scenario) -> Grid:
    """The ground of a scenario, without one its grid, as one cell."""
    grid = scenario.ground or scenario.grid
    rows, columns = grid.shape
    return Grid(grid.crs, grid.transform * Affine.scale(columns, rows), (1, 1))


def _around(values: np.ndarray, grid: Grid, onto: Grid, outside: float) -> Iterator[np.ndarray]:
    """`values` of `grid` at the centres, sides and corners of the cells of `onto`."""
    for right in (-INSET, 0.0, INSET):
        for down in (-INSET, 0.0, INSET):
            moved = Grid(onto.crs, onto.transform * Affine.translation(right, down), onto.shape)
            yield nearest(values, grid, moved, outside)


def scenario_of(text: str, option: str = "scenario") -> tuple[float, Path]:
    """Return return period and path of "T=RESULTS".

    Parameters
    ----------
    text : str
    option : str
        Name of the option, for the error.

    Returns
    -------
    (float [years], Path)

    Raises
    ------
    InputError
        Not of this form.
    """
    years, equals, path = str(text).partition("=")
    try:
        number = float(years)
    except ValueError:
        number = math.nan
    if not (equals and path.strip() and math.isfinite(number) and number > 0):
        raise InputError(f"`{option}={text}`: expected a return period in years and results, for example 100=results")
    return number, Path(path.strip())


def read_scenarios(asked: HazardQuestion, matrix: HazardMatrix, progress: Progress = unwatched) -> list[Scenario]:
    """Read the scenarios of a question, all on one grid.

    Parameters
    ----------
    asked : HazardQuestion
    matrix : HazardMatrix
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    list of Scenario

    Raises
    ------
    MpmgisError
        Unreadable results, bands that the guideline needs are missing, different CRSs, or a return period that the
        matrix does not have.
    """
    given = sorted((scenario_of(text) for text in asked["scenario"]), key=lambda entry: entry[0])
    periods = [matrix.period(years) for years, _ in given]
    found = [
        _scenario(asked, years, path, period, len(matrix.levels), progress)
        for (years, path), period in zip(given, periods, strict=True)
    ]
    found = _in_one_crs(found)
    grids = [scenario.grid for scenario in found]
    if all(same_cells(grid, grids[0]) for grid in grids):
        return found
    grid = joint_grid(grids, np.concatenate([grid.corners() for grid in grids]))
    if not all(_in_cells_of(own, grid) for own in grids):
        log.info(
            f"the scenarios have different cells; the map has cells of {grid.cell_size:.6g} m, each with the highest "
            "level of the cells that meet it"
        )
    return [scenario.on(grid) for scenario in found]


def _in_one_crs(found):
    """The scenarios, all with the CRS of the first one that has one; GeoreferenceError where they have several."""
    first = next((scenario for scenario in found if scenario.grid.crs is not None), found[0])
    for other in found:
        if None not in (first.grid.crs, other.grid.crs) and not same_place(first.grid.crs, other.grid.crs):
            code = first.grid.crs.to_epsg() or "n"
            raise GeoreferenceError(
                f"{other.path} is in {name_of(other.grid.crs)}, {first.path} in {name_of(first.grid.crs)}; reproject "
                f"its rasters: {warp_command(other.path, f'EPSG:{code}', 'nearest')}"
            )
        if (first.grid.crs is None) != (other.grid.crs is None):
            log.info(f"{other.path} has no CRS; that of {first.path}, {name_of(first.grid.crs)}, is assumed")
    return [replace(entry, grid=replace(entry.grid, crs=first.grid.crs)) for entry in found]


def _scenario(
    asked: HazardQuestion, years: float, path: Path, period: Period, highest: int, progress: Progress
) -> Scenario:
    if path.is_dir() and read_folder_record(ENSEMBLE, path) is not None:
        return _of_ensemble(asked, years, path, period, highest, progress)
    results = {**asked, "frames": (path,)}
    of_rasters = ("density",) if "p_max" in period.guideline.bands else ()
    result = peaks_of(results, progress, ("min_depth",), of_rasters)
    end = unfinished_words(path, result.end)
    if end:
        log.info(f"{path}: {end}; levels that its flow would give later are not in the map")
    level, known, grid, whole = _levels(result, period, asked)
    facts = facts_of(path, result)
    rest = {"whole": whole, "ground": result.ground, "unfinished": end}
    return Scenario(years, path, period, grid, level, known, None, result.terrain, facts, **rest)


def _levels(result, period, results):
    """Of one Result: (uint8[rows, columns] levels, bool[rows, columns] cells with data, Grid, whether it is whole)."""
    bands, grid = bands_of(result, period.guideline, results["density"])
    depth = bands["h_max"]
    known = _known(result, depth)
    reached = np.nan_to_num(depth) >= results["min_depth"]
    level, lacking = levels_of(period, bands, reached)
    if lacking:
        log.info(
            f"{result.name}: {lacking} cells with flow have no value of {' or '.join(period.guideline.bands)}; they "
            "have the highest level that their other values allow"
        )
    return level, known, grid, result.kind in WHOLE and not _meets_edge(depth)


def _meets_edge(depth):
    """Whether flow reaches the outermost cells of a raster, so that it may continue beyond."""
    return any((np.nan_to_num(side) > 0).any() for side in (depth[0], depth[-1], depth[:, 0], depth[:, -1]))


def _known(result, depth):
    """Cells with data: in exports nodata is dry; in other rasters it is unknown where dry cells are written as 0."""
    missing = np.isnan(depth)
    if result.kind in WHOLE or not missing.any():
        return np.ones(depth.shape, bool)
    if missing.all():
        log.info(f"{result.name}: all cells are nodata; cells that no other result covers are not assessed")
        return ~missing
    if (depth == 0).any():
        log.info(f"{result.name}: {np.count_nonzero(missing)} cells are nodata, dry ones are 0; nodata is not assessed")
        return ~missing
    log.info(f"{result.name}: no cell is 0, so its {np.count_nonzero(missing)} cells of nodata are taken as dry")
    return np.ones(depth.shape, bool)


def _of_ensemble(
    asked: HazardQuestion, years: float, path: Path, period: Period, highest: int, progress: Progress
) -> Scenario:
    """The largest level of all members of an ensemble, and the share of members with each level."""
    record = read_folder_record(ENSEMBLE, path)
    _refuse_options_of_frames(asked, path)
    rasters = sorted((path / ENSEMBLE.runs).glob("*_max.tif"))
    end = unfinished_members(path, record, len(rasters))
    level = known = counts = grid = None
    whole = True
    for done, raster in enumerate(rasters, 1):
        member, seen, its_grid, inside = _levels(replace(open_result(raster), kind="run"), period, asked)
        if grid is not None and not same_cells(grid, its_grid):
            raise FormatError(f"{raster} has other cells than {rasters[0].name}; run the ensemble again")
        above = member[None] >= np.arange(1, highest + 1, dtype=np.uint8)[:, None, None]
        if grid is None:
            level, known, counts, grid = member, seen, above.astype(np.uint32), its_grid
        else:
            level, known, counts = np.maximum(level, member), known & seen, counts + above
        whole = whole and inside
        progress(done, len(rasters))
    shares = (counts / len(rasters)).astype(np.float32)
    terrain = next(iter(sorted(path.glob("maps/dtm.tif"))), None)
    return Scenario(years, path, period, grid, level, known, shares, terrain, facts_of(path), len(rasters), whole, end)


def _refuse_options_of_frames(results, path):
    given = [name for name in options_of_frames(results) if name not in ("min_depth", "density")]
    if given:
        words = ", ".join(f"`{name}`" for name in given)
        raise InputError(f"{path} is an ensemble, whose rasters are already averaged; {words} requires frames")


def unfinished_members(path: Path, record: dict, count: int) -> str:
    """Refuse an ensemble that has not finished; return how many members gave no result or did not come to rest.

    Parameters
    ----------
    path : Path
        Folder of the ensemble.
    record : dict
        Its record.
    count : int
        Number of members with rasters.
    """
    if not count:
        raise FormatError(f"{path} is an ensemble without members ({ENSEMBLE.runs}/*_max.tif); run it again")
    if record.get("state") != "finished":
        raise InputError(f"{path} is an ensemble that has not finished; run it again, finished members are kept")
    members = record.get("members")
    lost = sum(members.values()) - members.get("finished", 0) if isinstance(members, dict) else 0
    if lost:
        log.info(f"{path}: {lost} members of the ensemble gave no result and are not in the map")
    moving = record.get("not_at_rest") or 0
    words = [
        f"{lost} members gave no result" if lost else "",
        f"{moving} of {count} members did not come to rest" if moving else "",
    ]
    return "; ".join(filter(None, words))
