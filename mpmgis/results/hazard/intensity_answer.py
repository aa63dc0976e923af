"""Answer `mpmgis intensity`: classes of a named guideline on a map."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ... import __version__
from ...frames.run_terrain import terrain_of_rasters
from ...maps.averaging.result_bands import Result
from ...system.errors import InputError
from ...system.messages import Progress, log, unwatched
from ...system.option import PathLike
from ...terrain.elevation import Terrain
from ...terrain.grid import Grid
from ..answer_files import answer_output, write_answer
from ..building_layer import write_buildings
from ..building_loads import building_loads
from ..opened_results import peaks_of, read_peaks
from ..question_options import Question
from .guideline_classes import Guideline, class_areas, classify, without_value
from .guideline_files import choose_guideline
from .intensity_files import write_class_polygons, write_class_raster, write_class_style, write_class_table
from .intensity_map import write_class_map

RASTER_FILE, STYLE_FILE = "intensity.tif", "intensity.qml"
POLYGON_FILE, TABLE_FILE = "intensity.gpkg", "intensity.csv"
MAP_FILE, BUILDING_FILE = "intensity.png", "buildings.gpkg"
FILES = (RASTER_FILE, STYLE_FILE, POLYGON_FILE, TABLE_FILE, MAP_FILE)
WORD = "intensity"  # end of the name of the default output folder
_FIXES = {  # by missing band
    "h_max": "expected an export, or rasters named <name>_pft",
    "Ut_max": "expected an export, or rasters named <name>_pft and <name>_pfv, given by the beginning of their names",
    "p_max": "expected an export, rasters named <name>_ppr [kPa], or `density` and <name>_pfv",
    "h_deposit": "expected an export of a flow that came to rest; another one has no deposit",
}


@dataclass(frozen=True)
class IntensityFound:
    """The result's `name`, the `guideline`, plan `areas` float64[classes] [m2], and the `files`."""

    name: str
    guideline: Guideline
    areas: np.ndarray
    files: tuple


def intensity(
    asked: Question,
    guideline: str,
    guidelines: PathLike | None = None,
    buildings: PathLike | None = None,
    drag: float = 2.0,
    progress: Progress = unwatched,
) -> IntensityFound:
    """Classify the largest values of each cell; write raster, polygons and areas.

    Parameters
    ----------
    asked : Question
    guideline : str
        Its name.
    guidelines, buildings : path, optional
        Files of the user's guidelines, and of polygons of buildings.
    drag : float [1]
        C_d of the dynamic pressure on buildings.
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    IntensityFound

    Raises
    ------
    MpmgisError
        An unknown guideline, unreadable input, or a flow that reached no cell; nothing is written then.
    """
    chosen = choose_guideline(guideline, guidelines)
    output = answer_output(asked, WORD, FILES)
    _require_folder(buildings, output)
    of_rasters = ("density",) if "p_max" in chosen.bands else ()
    result = peaks_of(asked, progress, ("min_depth",), of_rasters)
    bands, grid = bands_of(result, chosen, asked["density"])
    least = asked["min_depth"]
    reached = np.nan_to_num(bands["h_max"]) >= least
    if not reached.any():
        raise InputError(f"{result.name}: no cell was ever {least:g} m deep; give a smaller `min_depth`")
    numbers = classify(chosen, bands, reached)
    _log_gaps(result, chosen, np.count_nonzero(without_value(chosen, bands, reached)))
    areas = class_areas(chosen, numbers, grid.cell_area)
    tags = {"version": __version__, "result": result.name, "min_depth": f"{least:g}"}
    writers = {
        RASTER_FILE: lambda path: write_class_raster(path, grid, numbers, chosen, tags),
        STYLE_FILE: lambda path: write_class_style(path, chosen),
        POLYGON_FILE: lambda path: write_class_polygons(path, grid, numbers, chosen, areas),
        TABLE_FILE: lambda path: write_class_table(path, chosen, areas),
    }
    terrain = _terrain(asked, result, grid, output)
    if terrain is not None:
        writers[MAP_FILE] = lambda path: write_class_map(path, terrain, grid, numbers, chosen, areas, result.name)
    if buildings is not None:
        loaded = building_loads(asked, buildings, drag, output)
        writers[BUILDING_FILE] = lambda path: write_buildings(path, *loaded)
    return IntensityFound(result.name, chosen, areas, write_answer(output, asked["overwrite"], writers))


def _log_gaps(result: Result, guideline: Guideline, cells: int) -> None:
    """Report cells whose class can be too low, because a value is missing."""
    if cells:
        log.info(
            f"{result.name}: {cells} cells with flow have no value of {' or '.join(guideline.bands)}; their class is "
            "that of their other values, which can be too low"
        )


def _require_folder(buildings, output):
    """Refuse buildings where -o is one file, which would not be theirs."""
    if buildings is not None and output.suffix.lower() in {Path(name).suffix for name in FILES}:
        raise InputError(f"`output={output}` is one file, and `buildings` adds {BUILDING_FILE}; give a folder")


def _terrain(asked: Question, result: Result, grid: Grid, output: Path) -> Terrain | None:
    """The Terrain of the map; None where no DTM is known, which leaves the map out."""
    if isinstance(result.terrain, Terrain):
        return result.terrain
    path = asked["dem"] or result.terrain
    if path is not None:
        return terrain_of_rasters(path, grid.crs, asked["dem_band"])
    if output.suffix.lower() == Path(MAP_FILE).suffix:
        raise InputError(f"{result.name}: no DTM is known, which {output.name} needs; give it with `dem`")
    log.info(f"{result.name}: no DTM is known, so there is no {MAP_FILE}; give it with `dem`")
    return None


def bands_of(result: Result, guideline: Guideline, density: float | None) -> tuple[dict, Grid]:
    """Return the bands of depth and of the guideline.

    Parameters
    ----------
    result : Result
    guideline : Guideline
    density : float or None [kg m-3]
        For a pressure computed from the speed.

    Returns
    -------
    (dict of str to float[rows, columns], Grid)

    Raises
    ------
    InputError
        A band is missing.
    """
    names = tuple(dict.fromkeys(("h_max", *guideline.bands)))
    bands, grid = read_peaks(result, names, density)
    missing = [name for name in names if name not in bands]
    if missing:
        raise InputError(
            f"{result.name} has no {', '.join(missing)}, which {guideline.name} requires; {_FIXES[missing[0]]}"
        )
    return bands, grid
