"""Guideline files, and the map, polygons and table of intensity classes.

PNG map of the classes of a guideline over a hillshade.
"""

import textwrap
import tomllib
import warnings
from pathlib import Path

import geopandas
import numpy as np
import rasterio
from rasterio.enums import ColorInterp

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
from ...maps.qgis.raster_styles import style_document
from ...maps.qgis.vector_styles import class_renderer, vector_style_document, write_layer_styles
from ...maps.qgis.xml_markup import node
from ...system.errors import FormatError, InputError, one_line
from ...system.optional_libraries import GEOPACKAGE
from ...system.whole_files import whole_file
from ...terrain.elevation import Terrain
from ...terrain.grid import Grid
from ...terrain.hydrograph_file import write_records
from ...terrain.raster_output import BLOCK, NAMESPACE
from .guideline_classes import Guideline, parse_guidelines

SHIPPED = Path(__file__).with_name("guidelines.toml")


def read_guidelines(own: Path | None = None) -> dict[str, Guideline]:
    """Guidelines by name: of the shipped table, and of the file `own`, which have priority.

    Raises
    ------
    FormatError, InputError
        The file is missing, not TOML, or not a table of guidelines.
    """
    guidelines = parse_guidelines(read_tables(SHIPPED), SHIPPED.name)
    return guidelines if own is None else guidelines | parse_guidelines(read_tables(own), own)


def read_tables(path: Path) -> dict:
    """Tables of a TOML file.

    Raises
    ------
    FormatError
        It is missing, or not TOML.
    """
    path = Path(path)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise FormatError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise FormatError(f"{path} is not a readable TOML file ({one_line(error)[:100]})") from error


def choose_guideline(name: str, own: Path | None = None) -> Guideline:
    """The Guideline called `name`.

    Raises
    ------
    FormatError, InputError
        Unknown name; the message lists the known ones.
    """
    guidelines = read_guidelines(own)
    if name not in guidelines:
        raise InputError(f"--guideline {name!r} is unknown; choose from {', '.join(guidelines)}")
    return guidelines[name]


HEADINGS = ("class", "name", "when", "area_m2", "guideline", "source", "read_in")


def write_class_raster(path: Path, grid: Grid, numbers: np.ndarray, guideline: Guideline, tags: dict) -> None:
    """Write uint8[rows, columns] class numbers as GeoTIFF with the guideline's colours; 0 is nodata."""
    crs = None if grid.crs is None else rasterio.crs.CRS.from_wkt(grid.crs.to_wkt())
    rows, columns = grid.shape
    profile = {
        "driver": "GTiff", "height": rows, "width": columns, "count": 1, "dtype": "uint8", "nodata": 0, "crs": crs,
        "transform": grid.transform, "compress": "deflate", "tiled": True, "blockxsize": BLOCK, "blockysize": BLOCK,
    }  # fmt: skip
    colours = {0: (0, 0, 0, 0)}
    for number, entry in enumerate(guideline.classes, start=1):
        colours[number] = (*(int(entry.colour[k : k + 2], 16) for k in (1, 3, 5)), 255)
    meaning = {f"class_{k}": f"{entry.name}: {entry.words()}" for k, entry in enumerate(guideline.classes, start=1)}
    with whole_file(path) as part, rasterio.open(part, "w", **profile) as target:
        target.write(numbers, 1)
        target.write_colormap(1, colours)
        target.colorinterp = [ColorInterp.palette]
        target.set_band_description(1, "intensity [1]")
        source = {"guideline": guideline.name, "title": guideline.title, "source": guideline.source}
        target.update_tags(ns=NAMESPACE, **source, **meaning, **tags)


def write_class_style(path: Path, guideline: Guideline) -> None:
    """Write the .qml of the raster for QGIS: colour and name of each class."""
    entries = [
        node(
            "paletteEntry", {"value": k, "color": entry.colour, "alpha": 255, "label": f"{entry.name}: {entry.words()}"}
        )
        for k, entry in enumerate(guideline.classes, start=1)
    ]
    renderer = node(
        "rasterrenderer",
        {"type": "paletted", "band": 1, "opacity": 0.8, "alphaBand": -1, "nodataColor": ""},
        node("colorPalette", None, *entries),
    )
    with whole_file(path) as part:
        part.write_text(style_document(node("pipe", None, renderer)), encoding="utf-8", newline="\n")


def write_class_polygons(path: Path, grid: Grid, numbers: np.ndarray, guideline: Guideline, areas: np.ndarray) -> None:
    """Write a GeoPackage with one multipolygon for each class that occurs, with its plan area [m2]."""
    rows = []
    for number, (entry, area) in enumerate(zip(guideline.classes, areas, strict=True), start=1):
        outline = mask_outline(numbers == number, grid.transform)
        if outline is not None:
            rows.append((*_record(number, entry, area, guideline), outline))
    columns = {name: [row[k] for row in rows] for k, name in enumerate(HEADINGS)}
    crs = None if grid.crs is None else grid.crs.to_wkt()
    table = geopandas.GeoDataFrame(columns, geometry=[row[-1] for row in rows], crs=crs)
    classes = [
        (k, f"{entry.name}: {entry.words()}", entry.colour) for k, entry in enumerate(guideline.classes, start=1)
    ]
    style = vector_style_document(class_renderer("class", classes), POLYGONS)
    with whole_file(path) as part, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a missing CRS is allowed
        table.to_file(part, layer="intensity", driver="GPKG", engine="pyogrio", dataset_options=GEOPACKAGE)
        write_layer_styles(part, {"intensity": style})


def write_class_table(path: Path, guideline: Guideline, areas: np.ndarray) -> None:
    """Write the areas of all classes as CSV."""
    rows = [
        _record(number, entry, area, guideline)
        for number, (entry, area) in enumerate(zip(guideline.classes, areas, strict=True), start=1)
    ]
    write_records(path, HEADINGS, rows)


def _record(number, entry, area, guideline):
    area = float(np.round(area, 6))
    return number, entry.name, entry.words(), area, guideline.name, guideline.source, entry.read_in


DOTS_PER_INCH = 120
SQUARE_METRES_PER_HECTARE = 1e4
LEFT_OF_SOURCE, RIGHT_OF_SOURCE, LETTER = 0.85, 0.1, 0.052  # [inch]: margins and mean letter of the line below the map
WIDTH_OF_WORDS = 36  # [characters] of the legend


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
