"""`mpmgis intensity`: results in, classes of a named guideline on a map out."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .. import __version__
from ..analysis.comparison import upright
from ..analysis.guidelines import Guideline, class_areas, classify
from ..errors import InputError
from ..reports.intensity import (
    choose_guideline,
    write_class_polygons,
    write_class_raster,
    write_class_style,
    write_class_table,
)
from .answer_files import AnswerRequest, answer_output, write_answer
from .opened_results import exported_peaks, read_peaks

RASTER_FILE, STYLE_FILE = "intensity.tif", "intensity.qml"
POLYGON_FILE, TABLE_FILE = "intensity.gpkg", "intensity.csv"
FILES = (RASTER_FILE, STYLE_FILE, POLYGON_FILE, TABLE_FILE)
WORD = "intensity"


@dataclass(frozen=True, kw_only=True)
class IntensityRequest(AnswerRequest):
    """The command's options by name; its help tells more."""

    guideline: str
    guidelines: Path | None = None


@dataclass(frozen=True)
class IntensityFound:
    """What was found: the result's `name`, the `guideline`, plan `areas` float64[classes] [m2], and the `files`."""

    name: str
    guideline: Guideline
    areas: np.ndarray
    files: tuple


def intensity(request, progress=lambda done, total: None):
    """Classes of the largest values that each cell saw, as raster, polygons and areas.

    Returns
    -------
    IntensityFound

    Raises
    ------
    MpmgisError
        An unknown guideline, what cannot be read, a flow that came nowhere; nothing is written then.
    """
    guideline = choose_guideline(request.guideline, request.guidelines)
    output = answer_output(request, WORD, FILES)
    with ExitStack() as stack:
        of_rasters = ("density",) if "p_max" in guideline.bands else ()
        result = exported_peaks(request.results, stack, progress, ("min_depth",), of_rasters)
        bands, grid = _bands(result, guideline, request.results.density)
    reached = np.nan_to_num(bands["h_max"]) >= request.results.min_depth
    if not reached.any():
        least = request.results.min_depth
        raise InputError(f"{result.name}: no cell was ever {least:g} m deep; give a smaller --min-depth")
    numbers = classify(guideline, bands, reached)
    areas = class_areas(guideline, numbers, grid.cell_area)
    tags = {"version": __version__, "result": result.name, "min_depth": f"{request.results.min_depth:g}"}
    writers = {
        RASTER_FILE: lambda path: write_class_raster(path, grid, numbers, guideline, tags),
        STYLE_FILE: lambda path: write_class_style(path, guideline),
        POLYGON_FILE: lambda path: write_class_polygons(path, grid, numbers, guideline, areas),
        TABLE_FILE: lambda path: write_class_table(path, guideline, areas),
    }
    return IntensityFound(result.name, guideline, areas, write_answer(request, output, writers))


def _bands(result, guideline, density):
    """(band -> float[rows, columns], their Grid) of depth and of all that the guideline asks for."""
    names = tuple(dict.fromkeys(("h_max", *guideline.bands)))
    bands, grid = read_peaks(result, names, density)
    missing = [name for name in names if name not in bands]
    if missing:
        raise InputError(
            f"{result.name} has no {', '.join(missing)}, which {guideline.name} asks for; {_CURES[missing[0]]}"
        )
    return bands, upright(grid)


_CURES = {  # band that is missing: what to do
    "h_max": "wanted an export, or rasters called <name>_pft",
    "Ut_max": "wanted an export, or rasters called <name>_pft and <name>_pfv, given by the beginning of their names",
    "p_max": "wanted an export, rasters called <name>_ppr [kPa], or --density and <name>_pfv",
    "h_deposit": "wanted an export with its last step",
}
