"""Answer `mpmgis report --map`: scenarios to hazard levels of a guideline, as raster, zones and printed map."""

import datetime
from dataclasses import dataclass, replace

import numpy as np
import shapely

from ... import __version__
from ...frames.run_terrain import dtm_name, terrain_of_rasters
from ...laws.quantities import SQUARE_METRES_PER_HECTARE
from ...maps.qgis.print_layout import METRES_PER_MM
from ...system.errors import InputError
from ...system.messages import Progress, log, unwatched
from ...terrain.elevation import Terrain
from ...terrain.georeference import name_of
from ...terrain.grid import Grid
from ...terrain.raster_input import open_raster
from ..answer_files import checked_output, write_answer
from .guideline_classes import UNREAD
from .hazard_files import (
    LEAST,
    MOST,
    HazardMap,
    choose_matrix,
    write_hazard_raster,
    write_hazard_style,
    write_hazard_table,
    write_shares,
    write_zones,
)
from .hazard_levels import HazardMatrix, combined_hazard
from .hazard_options import HazardQuestion
from .hazard_project import HazardProject, write_ground, write_hazard_project
from .hazard_scenarios import read_scenarios, scenario_of
from .hazard_sheet import Print, Sheet, sheet_for
from .scenario_release import release_of
from .zone_outlines import default_area, generalized_zones

RASTER_FILE, STYLE_FILE, ZONES_FILE, TABLE_FILE = "hazard.tif", "hazard.qml", "hazard.gpkg", "hazard.csv"
PRINT_FILE, PICTURE_FILE, SHARES_FILE = "hazard.pdf", "hazard.png", "hazard_probability.tif"
FILES = (RASTER_FILE, STYLE_FILE, ZONES_FILE, TABLE_FILE, PRINT_FILE, PICTURE_FILE)
PROJECT_FILE, TERRAIN_FILE = "hazard.qgz", "hazard_dtm.tif"  # which need the other files of the folder
FOLDER = "hazard_map"  # of the output, if none is given
MARGIN = 0.08  # [1] around the zones in the project, over the longer side
LARGEST_ON_PAPER = 2.0  # [mm] of a cell in print; outlines of larger ones show more than was computed
ROWS = 512  # of the terrain that are read at a time, to limit the memory


@dataclass(frozen=True)
class HazardFound:
    """The `matrix`, the plan `areas` float64[levels] [m2], the area `not_assessed` [m2], and the `files`."""

    matrix: HazardMatrix
    areas: np.ndarray
    not_assessed: float
    files: tuple

    def lines(self) -> list[str]:
        """Return lines of text for a terminal."""
        matrix = self.matrix
        lines = [
            f"{matrix.title or matrix.name}",
            f"by {matrix.source}",
            *([f"({matrix.note})"] if matrix.note else []),
        ]
        width = max(len(level.name) for level in matrix.levels) + 2
        for level, area in zip(matrix.levels, self.areas, strict=True):
            lines.append(f"{level.name:<{width}}{area / SQUARE_METRES_PER_HECTARE:>10.2f} ha   {level.meaning}")
        if self.not_assessed:
            lines.append(f"not assessed, no data: {self.not_assessed / SQUARE_METRES_PER_HECTARE:.2f} ha")
        if matrix.is_unread:
            lines.append("numbers of this matrix are not verified in the document in part; check them there")
        return lines


def hazard_map(asked: HazardQuestion, progress: Progress = unwatched) -> HazardFound:
    """Combine several scenarios to a map of hazard levels; write its files.

    Parameters
    ----------
    asked : HazardQuestion
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    HazardFound

    Raises
    ------
    MpmgisError
        Unknown matrix, unreadable scenario, or no cell with a level; nothing is written then.
    """
    matrix = choose_matrix(asked["map"], asked["matrices"], asked["guidelines"])
    scale = scale_of(asked["scale"])
    output = _output(asked)
    scenarios = [
        replace(one, release=release_of(one.path, one.terrain, one.grid.crs))
        for one in read_scenarios(asked, matrix, progress)
    ]
    terrain = _terrain(asked, scenarios)
    grid = scenarios[0].grid
    hazard = combined_hazard(
        [scenario.level for scenario in scenarios],
        [scenario.known for scenario in scenarios],
        _terrain_known(terrain, grid),
        len(matrix.levels),
    )
    if not hazard.level.any():
        raise InputError(f"no cell has a hazard level of {matrix.name}; check the scenarios, or the `min_depth`")
    shares = shares_of(scenarios, len(matrix.levels))
    sheet = sheet_for(_bounds(hazard.level > 0, grid), asked["sheet"], scale)
    least = default_area(sheet.scale) if asked["min_area"] is None else asked["min_area"]
    zones = generalized_zones(hazard.level, len(matrix.levels), grid.transform, sheet.scale, least)
    title = asked["title"] or matrix.title or f"Hazard map: {matrix.name}"
    facts = _facts(asked, matrix, scenarios, terrain, sheet, least)
    made = HazardMap(matrix, grid, hazard, scenarios, zones, shares, sheet.scale, least, title, facts)
    _log(made, sheet)
    files = write_answer(output, asked["overwrite"], _writers(made, terrain, sheet, asked["author"] or ""))
    return HazardFound(matrix, made.areas(), float(np.count_nonzero(hazard.unknown) * grid.cell_area), files)


def shares_of(scenarios: list, highest: int) -> np.ndarray | None:
    """Return the share of runs with at least each level; None without an ensemble.

    It is the largest of all scenarios; a scenario of one run counts as certain.

    Parameters
    ----------
    scenarios : list of Scenario
        On one grid.
    highest : int
        Number of levels.

    Returns
    -------
    float32[levels, rows, columns] or None
    """
    if all(scenario.shares is None for scenario in scenarios):
        return None
    numbers = np.arange(1, highest + 1, dtype=np.uint8)[:, None, None]
    return np.maximum.reduce(
        [
            (scenario.level >= numbers).astype(np.float32) if scenario.shares is None else scenario.shares
            for scenario in scenarios
        ]
    )


def scale_of(text: str | None) -> float | None:
    """Return the denominator of a scale "1:5000"; None without one.

    Parameters
    ----------
    text : str or None

    Returns
    -------
    float or None

    Raises
    ------
    InputError
        Not a scale.
    """
    if text is None:
        return None
    one, colon, number = str(text).partition(":")
    try:
        scale = float(number)
    except ValueError:
        scale = 0.0
    if not (one.strip() == "1" and colon and np.isfinite(scale) and scale >= 1):
        raise InputError(f"`scale={text}`: expected a map scale, for example 1:5000")
    return scale


def _output(asked):
    """The checked output; by default a folder beside the results of the first scenario."""
    if not asked["scenario"]:
        raise InputError("`map` needs at least one `scenario=T=RESULTS`, for example 100=results_100")
    paths = [scenario_of(text)[1] for text in asked["scenario"]]
    output = asked["output"] or paths[0].resolve().parent / FOLDER
    own = [asked[name] for name in ("matrices", "guidelines", "dem", "sidecar") if asked[name] is not None]
    return checked_output(output, FILES, asked["overwrite"], (*paths, *own))


def _terrain(asked, scenarios) -> Terrain | None:
    """The Terrain of the map: of --dem, else the largest one of the scenarios; None where none is known."""
    of_scenarios = [entry.terrain for entry in scenarios if entry.terrain is not None]
    known = asked["dem"] or max(of_scenarios, key=_extent, default=None)
    if known is None:
        log.info(
            "no DTM is known: the map has no hillshade, and gaps of the DTM cannot be distinguished from cells "
            "without hazard; give it with `dem`"
        )
        return None
    if isinstance(known, Terrain):
        return known
    crs = next((entry.grid.crs for entry in scenarios if entry.grid.crs is not None), None)
    return terrain_of_rasters(known, crs, asked["dem_band"], asked["to_crs"])


def _extent(terrain):
    """Area [m2] of the bounds of a Terrain, or of the raster at a path; that of an export can be a part of the DTM."""
    if isinstance(terrain, Terrain):
        west, south, east, north = terrain.grid.bounds
    else:
        with open_raster(terrain) as source:
            west, south, east, north = source.bounds
    return abs((east - west) * (north - south))


def _terrain_known(terrain, grid: Grid) -> np.ndarray:
    """bool[rows, columns]: cells with an elevation; all where there is no terrain."""
    if terrain is None:
        return np.ones(grid.shape, bool)
    rows = range(0, grid.shape[0], ROWS)
    parts = [np.isfinite(terrain.rows_on(grid, first, min(first + ROWS, grid.shape[0]))) for first in rows]
    return np.concatenate(parts)


def _bounds(mask, grid):
    """(west, south, east, north) [m] of the True cells."""
    row, column = np.nonzero(mask)
    corners = [grid.xy(row + down, column + right) for down in (-0.5, 0.5) for right in (-0.5, 0.5)]
    x, y = (np.concatenate([corner[k] for corner in corners]) for k in (0, 1))
    return float(x.min()), float(y.min()), float(x.max()), float(y.max())


def _facts(asked, matrix, scenarios, terrain, sheet: Sheet, least) -> tuple:
    """(name, text) of the block of sources and parameters."""
    unread = f"; marked '{UNREAD}' in part: check the document" if matrix.is_unread else ""
    missing = matrix.missing([scenario.years for scenario in scenarios])
    depth = asked["min_depth"]
    ensemble = any(scenario.shares is not None for scenario in scenarios)
    facts = [
        ("guideline", f"{matrix.source}{unread}"),
        ("note", matrix.note),
        ("no scenario", ", ".join(f"{period.name} ({period.words()})" for period in missing)),
        ("DTM", "" if terrain is None else dtm_name(terrain.path)),
        ("CRS", name_of(scenarios[0].grid.crs)),
        *((f"{scenario.years:g} years", scenario.facts) for scenario in scenarios),
        ("cells", f"{scenarios[0].grid.cell_size:g} m; reached from a depth of {depth:g} m"),
        ("zones", f"outlines for 1:{sheet.scale:g}, areas from {least:.4g} m2"),
        (
            "uncertainty",
            f"hatched: {LEAST:.0%} to {MOST:.0%} of the runs of the ensemble"
            if ensemble
            else "not shown: no ensemble among the scenarios",
        ),
        ("author", asked["author"] or ""),
        ("made by", f"mpmgis {__version__}, {datetime.date.today().isoformat()}; simulated, not checked in the field"),
    ]
    return tuple((name, words) for name, words in facts if words)


def _log(made: HazardMap, sheet: Sheet) -> None:
    """Report all that could make a level too low, what generalization changed, and cells that are large on paper."""
    cell = made.grid.cell_area
    on_paper = made.grid.cell_size / (sheet.scale * METRES_PER_MM)
    if on_paper > LARGEST_ON_PAPER:
        log.info(
            f"warning: the cells of {made.grid.cell_size:.4g} m are {on_paper:.2g} mm wide at 1:{sheet.scale:g}, more "
            f"than {LARGEST_ON_PAPER:g} mm: outlines show more detail than there is; use smaller cells, or a smaller "
            "scale"
        )
    for cells, words in (
        (made.hazard.unknown, "are not assessed: a scenario or the DTM has no data there"),
        (made.hazard.partly, "have a level that a scenario without data there could raise"),
    ):
        count = np.count_nonzero(cells)
        if count:
            log.info(f"{count} cells ({count * cell / 1e4:.3g} ha) {words}")
    for period in made.matrix.missing([scenario.years for scenario in made.scenarios]):
        log.info(f"no scenario of {period.name} ({period.words()}): levels that it would give are not in the map")
    if made.zones.filled or made.zones.enlarged:
        log.info(
            f"minimum mapping area {made.least:.4g} m2: {made.zones.filled} gaps filled and {made.zones.enlarged} "
            "parts enlarged in the zones, which errs to the higher level; the raster is unchanged"
        )
    if any(zone is not None and not shapely.box(*sheet.view).contains(zone) for zone in made.zones.zones):
        log.info("the sheet cuts off enlarged parts of zones; give a smaller `min_area`, or a smaller scale")


def _writers(made: HazardMap, terrain: Terrain | None, sheet: Sheet, author: str) -> dict:
    printed = Print(made, terrain, sheet)
    unfinished = "; ".join(made.unfinished())
    tags = {
        "version": __version__,
        "unfinished": unfinished or "none",
        "scenarios": "; ".join(scenario.words() for scenario in made.scenarios),
        "date": datetime.date.today().isoformat(),
        "scale": f"1:{made.scale:g}",
    }
    of_zones = {"program": f"mpmgis {__version__}", "date": tags["date"], "unfinished": unfinished}
    writers = {
        RASTER_FILE: lambda path: write_hazard_raster(path, made, tags),
        STYLE_FILE: lambda path: write_hazard_style(path, made.matrix),
        ZONES_FILE: lambda path: write_zones(path, made, of_zones),
        TABLE_FILE: lambda path: write_hazard_table(path, made),
        PRINT_FILE: lambda path: printed.save(path, "pdf"),
        PICTURE_FILE: lambda path: printed.save(path, "png"),
    }
    west, south, east, north = _bounds(made.hazard.level > 0, made.grid)
    rim = MARGIN * max(east - west, north - south)
    view = (west - rim, south - rim, east + rim, north + rim)
    ground = {TERRAIN_FILE: lambda path: write_ground(path, terrain, view, made.grid)}
    writers |= ground if terrain is not None else {}
    writers[PROJECT_FILE] = lambda path: _write_project(path.parent, made, view, author)
    if made.shares is not None:
        writers[SHARES_FILE] = lambda path: write_shares(path, made, tags)
    return writers


def _write_project(folder, made, view, author):
    """Write the project of the other files."""
    terrain = folder / TERRAIN_FILE
    terrain_file = TERRAIN_FILE if terrain.exists() else ""
    project = HazardProject(folder, made.grid, RASTER_FILE, ZONES_FILE, terrain_file, author)
    write_hazard_project(project, made, view)
