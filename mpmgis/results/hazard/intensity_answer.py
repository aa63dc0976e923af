"""Answer `mpmgis intensity`: classes of a named guideline on a map."""

import textwrap
import warnings
from dataclasses import dataclass
from pathlib import Path

import geopandas
import numpy as np

from ... import __version__
from ...frames.run_terrain import terrain_of_rasters
from ...laws.quantities import SQUARE_METRES_PER_HECTARE
from ...maps.averaging.result_bands import Result
from ...maps.export.run_picture import (
    INK,
    OPACITY,
    draw_image,
    draw_scale_and_north,
    draw_terrain,
    draw_title,
    map_axes,
    map_view,
)
from ...maps.qgis.outlines import POLYGONS, mask_outline
from ...maps.qgis.raster_styles import class_pipe, style_document
from ...maps.qgis.vector_styles import class_renderer, vector_style_document, write_layer_styles
from ...system.csv_rows import write_records
from ...system.errors import InputError
from ...system.messages import Progress, log, unwatched
from ...system.option import PathLike
from ...system.optional_libraries import GEOPACKAGE
from ...system.whole_files import whole_file
from ...terrain.class_rasters import write_class_raster
from ...terrain.elevation import Terrain
from ...terrain.grid import Grid
from ..answer_files import answer_output, write_answer
from ..building_layer import write_buildings
from ..building_loads import building_loads
from ..opened_results import peaks_of, read_peaks
from ..question_options import Question
from .guideline_classes import Guideline, class_areas, classify, without_value
from .guideline_files import choose_guideline

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
HEADINGS = ("class", "name", "when", "area_m2", "guideline", "source", "read_in")
DOTS_PER_INCH = 120  # small files that are sharp on a screen
LEFT_OF_SOURCE = 0.85  # [inch] left margin of the line below the map
RIGHT_OF_SOURCE = 0.1  # [inch] right margin of the line below the map
LETTER = 0.052  # [inch] mean width of a letter of that line
WIDTH_OF_WORDS = 36  # [characters] of a line of the legend


@dataclass(frozen=True)
class IntensityFound:
    """The result's `name`, the `guideline`, plan `areas` float64[classes] [m2], and the `files`."""

    name: str
    guideline: Guideline
    areas: np.ndarray
    files: tuple

    def lines(self) -> list[str]:
        """Return lines of text for a terminal."""
        guideline = self.guideline
        lines = [f"{self.name}: {guideline.title or guideline.name}", f"by {guideline.source}"]
        if guideline.note:
            lines.append(f"({guideline.note})")
        width = max(len(entry.name) for entry in guideline.classes) + 2
        for entry, area in zip(guideline.classes, self.areas, strict=True):
            lines.append(f"{entry.name:<{width}}{area / SQUARE_METRES_PER_HECTARE:>10.2f} ha   {entry.words()}")
        return lines + [f"{entry.name}: {entry.origin()}" for entry in guideline.classes if entry.read_in]


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
        RASTER_FILE: lambda path: write_classes(path, grid, numbers, chosen, tags),
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


def write_classes(path: Path, grid: Grid, numbers: np.ndarray, guideline: Guideline, tags: dict) -> None:
    """Write class numbers as GeoTIFF with the guideline's colours; 0 is nodata.

    Parameters
    ----------
    path : Path
    grid : Grid
    numbers : uint8[rows, columns]
    guideline : Guideline
    tags : dict of str to str
        Of the file.
    """
    source = {"guideline": guideline.name, "title": guideline.title, "source": guideline.source}
    write_class_raster(path, grid, numbers, _entries(guideline), "intensity [1]", source, tags)


def write_class_style(path: Path, guideline: Guideline) -> None:
    """Write the .qml of the raster for QGIS: colour and name of each class.

    Parameters
    ----------
    path : Path
    guideline : Guideline
    """
    with whole_file(path) as part:
        part.write_text(style_document(class_pipe(_entries(guideline))), encoding="utf-8", newline="\n")


def _entries(guideline):
    """(number, label, colour) of each class."""
    return [(k, f"{entry.name}: {entry.words()}", entry.colour) for k, entry in enumerate(guideline.classes, start=1)]


def write_class_polygons(path: Path, grid: Grid, numbers: np.ndarray, guideline: Guideline, areas: np.ndarray) -> None:
    """Write a GeoPackage with one multipolygon for each class that occurs, with its plan area.

    Parameters
    ----------
    path : Path
    grid : Grid
    numbers : uint8[rows, columns]
    guideline : Guideline
    areas : float64[classes] [m2]
        In plan.
    """
    rows = []
    for number, (entry, area) in enumerate(zip(guideline.classes, areas, strict=True), start=1):
        outline = mask_outline(numbers == number, grid.transform)
        if outline is not None:
            rows.append((*_record(number, entry, area, guideline), outline))
    columns = {name: [row[k] for row in rows] for k, name in enumerate(HEADINGS)}
    crs = None if grid.crs is None else grid.crs.to_wkt()
    table = geopandas.GeoDataFrame(columns, geometry=[row[-1] for row in rows], crs=crs)
    style = vector_style_document(class_renderer("class", _entries(guideline)), POLYGONS)
    with whole_file(path) as part, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a missing CRS is allowed
        table.to_file(part, layer="intensity", driver="GPKG", engine="pyogrio", dataset_options=GEOPACKAGE)
        write_layer_styles(part, {"intensity": style})


def write_class_table(path: Path, guideline: Guideline, areas: np.ndarray) -> None:
    """Write the areas of all classes as CSV.

    Parameters
    ----------
    path : Path
    guideline : Guideline
    areas : float64[classes] [m2]
        In plan.
    """
    rows = [
        _record(number, entry, area, guideline)
        for number, (entry, area) in enumerate(zip(guideline.classes, areas, strict=True), start=1)
    ]
    write_records(path, HEADINGS, rows)


def _record(number, entry, area, guideline):
    area = float(np.round(area, 6))
    return number, entry.name, entry.words(), area, guideline.name, guideline.source, entry.read_in


def write_class_map(
    path: Path, terrain: Terrain, grid: Grid, numbers: np.ndarray, guideline: Guideline, areas: np.ndarray, name: str
) -> None:
    """Write a PNG map of intensity classes; legend, scale bar and north arrow stand beside the map.

    Parameters
    ----------
    path : Path
    terrain : Terrain
        For the hillshade; its extent limits the map.
    grid : Grid
        North-up, of `numbers`.
    numbers : uint8[rows, columns]
        Class of each cell; 0 without one.
    guideline : Guideline
    areas : float64[classes] [m2]
        In plan.
    name : str
        Of the result.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import to_rgba
    from matplotlib.figure import Figure

    figure = Figure(figsize=(1, 1), dpi=DOTS_PER_INCH, facecolor="white")
    FigureCanvasAgg(figure)
    view = map_view(terrain, grid, numbers > 0)
    axes = map_axes(figure, view)
    interval = draw_terrain(axes, terrain, view)
    colours = [(0.0, 0.0, 0.0, 0.0), *(to_rgba(entry.colour, OPACITY) for entry in guideline.classes)]
    draw_image(axes, grid, np.array(colours)[numbers])
    draw_scale_and_north(axes, view)
    _draw_legend(axes, guideline, areas, interval)
    draw_title(axes, f"Intensity classes: {name}")
    room = figure.get_size_inches()[0] - LEFT_OF_SOURCE - RIGHT_OF_SOURCE
    source = textwrap.shorten(guideline.source, int(room / LETTER), placeholder=" ...")
    figure.text(LEFT_OF_SOURCE / figure.get_size_inches()[0], 0.01, source, fontsize=6.5, color="#555555", va="bottom")
    with whole_file(path) as part:
        figure.savefig(part, dpi=DOTS_PER_INCH, format="png")


def _draw_legend(axes, guideline, areas, interval):
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries = []
    for entry, area in reversed(list(zip(guideline.classes, areas, strict=True))):  # the highest class first
        words = textwrap.fill(f"{entry.name}: {entry.words()}", WIDTH_OF_WORDS)
        label = f"{words}\n{area / SQUARE_METRES_PER_HECTARE:.3g} ha"
        entries.append(Patch(facecolor=entry.colour, edgecolor=INK, linewidth=0.4, label=label))
    if interval:
        line = {"color": "#5a4632", "alpha": 0.6, "linewidth": 0.8}
        entries.append(Line2D([], [], **line, label=f"contours every {interval:g} m"))
    place = {"loc": "upper left", "borderaxespad": 0.0, "frameon": False, "alignment": "left", "fontsize": 7.5}
    title = textwrap.fill(guideline.title or guideline.name, WIDTH_OF_WORDS)
    axes.legend(handles=entries, title=title, bbox_to_anchor=(1.03, 1.0), **place).get_title().set_fontsize(8.5)
