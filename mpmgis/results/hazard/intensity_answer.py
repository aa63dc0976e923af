"""Answer `mpmgis intensity`: classes of a named guideline on a map."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ... import __version__
from ...frames.run_terrain import terrain_of_rasters
from ...maps.averaging.result_bands import Result
from ...maps.export.export_request import AnswerRequest
from ...system.errors import InputError
from ...system.messages import log
from ...terrain.elevation import Terrain
from ...terrain.grid import Grid
from ..answer_files import answer_output, write_answer
from ..building_layer import write_buildings
from ..building_loads import building_loads
from ..opened_results import peaks_of, read_peaks
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


@dataclass(frozen=True, kw_only=True)
class IntensityRequest(AnswerRequest):
    """A question about results; `mpmgis.commands` describes its options."""

    guideline: str
    guidelines: Path | None = None
    buildings: Path | None = None
    drag: float = 2.0  # [1] C_d


@dataclass(frozen=True)
class IntensityFound:
    """The result's `name`, the `guideline`, plan `areas` float64[classes] [m2], and the `files`."""

    name: str
    guideline: Guideline
    areas: np.ndarray
    files: tuple


def intensity(
    request: IntensityRequest, progress: Callable[[int, int], None] = lambda done, total: None
) -> IntensityFound:
    """Classify the largest values of each cell; write raster, polygons and areas.

    Parameters
    ----------
    request : IntensityRequest
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
    guideline = choose_guideline(request.guideline, request.guidelines)
    output = answer_output(request, WORD, FILES)
    _require_folder(request, output)
    of_rasters = ("density",) if "p_max" in guideline.bands else ()
    result = peaks_of(request.results, progress, ("min_depth",), of_rasters)
    bands, grid = bands_of(result, guideline, request.results.source.density)
    reached = np.nan_to_num(bands["h_max"]) >= request.results.averaging.min_depth
    if not reached.any():
        least = request.results.averaging.min_depth
        raise InputError(f"{result.name}: no cell was ever {least:g} m deep; give a smaller `min_depth`")
    numbers = classify(guideline, bands, reached)
    _log_gaps(result, guideline, np.count_nonzero(without_value(guideline, bands, reached)))
    areas = class_areas(guideline, numbers, grid.cell_area)
    tags = {"version": __version__, "result": result.name, "min_depth": f"{request.results.averaging.min_depth:g}"}
    writers = {
        RASTER_FILE: lambda path: write_class_raster(path, grid, numbers, guideline, tags),
        STYLE_FILE: lambda path: write_class_style(path, guideline),
        POLYGON_FILE: lambda path: write_class_polygons(path, grid, numbers, guideline, areas),
        TABLE_FILE: lambda path: write_class_table(path, guideline, areas),
    }
    terrain = _terrain(request, result, grid, output)
    if terrain is not None:
        writers[MAP_FILE] = lambda path: write_class_map(path, terrain, grid, numbers, guideline, areas, result.name)
    if request.buildings is not None:
        least = request.results.averaging.min_depth
        loaded = building_loads(request.results, request.buildings, request.drag, least, output)
        writers[BUILDING_FILE] = lambda path: write_buildings(path, *loaded)
    return IntensityFound(result.name, guideline, areas, write_answer(request, output, writers))


def _log_gaps(result: Result, guideline: Guideline, cells: int) -> None:
    """Report cells whose class can be too low, because a value is missing."""
    if cells:
        log.info(
            f"{result.name}: {cells} cells with flow have no value of {' or '.join(guideline.bands)}; their class is "
            "that of their other values, which can be too low"
        )


def _require_folder(request, output):
    """Refuse buildings where -o is one file, which would not be theirs."""
    if request.buildings is not None and output.suffix.lower() in {Path(name).suffix for name in FILES}:
        raise InputError(f"`output={output}` is one file, and `buildings` adds {BUILDING_FILE}; give a folder")


def _terrain(request: IntensityRequest, result: Result, grid: Grid, output: Path) -> Terrain | None:
    """The Terrain of the map; None where no DTM is known, which leaves the map out."""
    if isinstance(result.terrain, Terrain):
        return result.terrain
    path = request.results.source.dem or result.terrain
    if path is not None:
        return terrain_of_rasters(path, grid.crs, request.results.source.dem_band)
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
