"""Write table, GeoTIFF and map of a comparison."""

import math
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import shapely

from ..laws.quantities import SQUARE_METRES_PER_HECTARE, Quantity
from ..maps.export.run_picture import (
    DOTS_PER_INCH,
    INK,
    draw_image,
    draw_north_arrow,
    draw_scale_bar,
    draw_terrain,
    map_axes,
    map_view,
)
from ..maps.qgis.raster_styles import style_document
from ..maps.qgis.xml_markup import node
from ..system.whole_files import whole_file
from ..terrain.elevation import Terrain
from ..terrain.grid import Grid
from ..terrain.raster_output import write_geotiff
from .comparison import nearest, north_up_grid
from .flow_line import Runout, line_up_to

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CLASSES = {1: "only A", 2: "only B", 3: "both"}  # number in classes.tif: words
ONLY_FIRST, ONLY_SECOND, BOTH = "#d95f02", "#1b6fc2", "#7f5aa5"  # distinct for colour-blind readers and in grey
OPACITY = 0.8  # [1] of the classes over the hillshade
LINE_COLOUR = "#101010"
LEGEND_LETTERS = 30  # in a line of the legend


def class_numbers(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the class of each cell: 1 first mask only, 2 second only, 3 both, 0 none.

    Parameters
    ----------
    first, second : bool[rows, columns]

    Returns
    -------
    uint8[rows, columns]
    """
    return first.astype(np.uint8) + 2 * second.astype(np.uint8)


def write_classes(path: Path, grid: Grid, first: np.ndarray, second: np.ndarray, values: tuple, band: Quantity) -> None:
    """Write a GeoTIFF of footprint classes, values of both sides and their difference where both are known.

    Parameters
    ----------
    path : Path
    grid : Grid
        Grid of all arrays; if not north-up it is resampled (nearest cell) to a north-up grid.
    first, second : bool[rows, columns]
    values : (float[rows, columns], float[rows, columns])
        Values of each side, NaN if missing; None for an outline.
    band : Quantity
        Quantity of the values.
    """
    flat = north_up_grid(grid)
    numbers = class_numbers(first, second).astype(float)
    numbers[numbers == 0] = np.nan
    meaning = ", ".join(f"{number} {word}" for number, word in CLASSES.items())
    bands = [(Quantity("class", "1", meaning), numbers)]
    known = {side: value for side, value in zip("AB", values, strict=True) if value is not None}
    bands += [(Quantity(f"{band.name}_{side}", band.unit, ""), value) for side, value in known.items()]
    if len(known) == 2:
        bands.append((Quantity(f"{band.name}_A_minus_B", band.unit, ""), values[0] - values[1]))
    on_flat = [(quantity, nearest(value, grid, flat)) for quantity, value in bands]
    write_geotiff(path, flat, on_flat, {"class": meaning})


def write_classes_style(path: Path) -> None:
    """Write the .qml with which QGIS shows the GeoTIFF of `write_classes`: its classes in the colours of the map.

    Parameters
    ----------
    path : Path
    """
    colours = dict(zip(CLASSES, (ONLY_FIRST, ONLY_SECOND, BOTH), strict=True))
    entries = [
        node("paletteEntry", {"value": number, "color": colours[number], "alpha": 255, "label": word})
        for number, word in CLASSES.items()
    ]
    shown = {"type": "paletted", "band": 1, "opacity": OPACITY, "alphaBand": -1, "nodataColor": ""}
    renderer = node("rasterrenderer", shown, node("colorPalette", None, *entries))
    with whole_file(path) as part:
        part.write_text(style_document(node("pipe", None, renderer)), encoding="utf-8", newline="\n")


class MapSide(NamedTuple):
    """One side of the map: `name`, `mask` bool[rows, columns], area [m2] that it covers `alone`, runout.

    `farthest` is the farthest point along the line, `runout` [m] its distance from the highest point of the flow
    (NaN: unknown).
    """

    name: str
    mask: np.ndarray
    alone: float
    farthest: Runout | None = None
    runout: float = math.nan


def write_comparison_map(
    path: Path,
    terrain: Terrain | None,
    grid: Grid,
    sides: tuple,
    both_area: float,
    line: np.ndarray | None = None,
    title: str = "",
) -> None:
    """Write the map of a comparison as PNG (atomically).

    Parameters
    ----------
    path : Path
    terrain : Terrain or None
        Hillshade below the footprints, in their CRS; None: no hillshade.
    grid : Grid
        Grid of the masks.
    sides : (MapSide, MapSide)
    both_area : float [m2]
    line : float[n, 2] [m], optional
        Line along which the runout is measured.
    title : str
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    flat = north_up_grid(grid)
    masks = [nearest(side.mask, grid, flat, outside=False) for side in sides]
    if terrain is None:
        terrain = Terrain(flat, np.zeros(flat.shape))
    figure = Figure(figsize=(1, 1), dpi=DOTS_PER_INCH, facecolor="white")
    FigureCanvasAgg(figure)
    shown = _as_far_as_reached(line, sides)
    view = map_view(terrain, flat, masks[0] | masks[1], [] if shown is None else [shapely.LineString(shown)])
    axes = map_axes(figure, view)
    interval = draw_terrain(axes, terrain, view)
    _draw_classes(axes, flat, masks)
    _draw_line(axes, shown, sides)
    draw_scale_bar(axes, view)
    draw_north_arrow(axes)
    _draw_legend(axes, sides, both_area, shown is not None, interval)
    if title:
        axes.set_title(title, loc="left", fontsize=12, fontweight="bold", pad=10)
    with whole_file(path) as part:
        figure.savefig(part, dpi=DOTS_PER_INCH, format="png")


def _as_far_as_reached(line, sides):
    """The line up to the larger runout of both sides, cut or extended straight; None without a runout."""
    reached = [side.farthest.distance for side in sides if side.farthest is not None]
    return None if line is None or max(reached, default=0.0) <= 0 else line_up_to(line, max(reached))


def _draw_classes(axes: "Axes", grid: Grid, masks: tuple) -> None:
    from matplotlib.colors import to_rgba

    first, second = masks
    image = np.zeros((*grid.shape, 4))
    for where, colour in ((first & ~second, ONLY_FIRST), (second & ~first, ONLY_SECOND), (first & second, BOTH)):
        image[where] = to_rgba(colour, OPACITY)
    draw_image(axes, grid, image)


def _draw_line(axes: "Axes", line: np.ndarray, sides: tuple) -> None:
    """The line, and the farthest cell of each side in its colour."""
    if line is None:
        return
    from matplotlib.patheffects import withStroke

    rim = [withStroke(linewidth=3.0, foreground="white", alpha=0.85)]
    still = {"scalex": False, "scaley": False}
    axes.plot(*line.T, color=LINE_COLOUR, linewidth=1.2, linestyle=(0, (5, 2)), zorder=6, path_effects=rim, **still)
    axes.plot(*line[0], "o", color=LINE_COLOUR, markersize=4.5, markeredgecolor="white", zorder=7, **still)
    for side, colour, marker in zip(sides, (ONLY_FIRST, ONLY_SECOND), ("^", "v"), strict=True):
        if side.farthest is not None:
            place = (side.farthest.x, side.farthest.y)
            axes.plot(*place, marker, color=colour, markersize=8, markeredgecolor="white", zorder=8, **still)


def _draw_legend(axes: "Axes", sides: tuple, both_area: float, has_line: bool, interval: float | None) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries = [
        Patch(facecolor=colour, alpha=OPACITY, edgecolor=INK, linewidth=0.4, label=f"{_wrapped(text)}\n{_area(area)}")
        for text, area, colour in (
            ("both", both_area, BOTH),
            (f"only A, {sides[0].name}", sides[0].alone, ONLY_FIRST),
            (f"only B, {sides[1].name}", sides[1].alone, ONLY_SECOND),
        )
    ]
    if has_line:
        entries.append(Line2D([], [], color=LINE_COLOUR, linestyle=(0, (5, 2)), linewidth=1.2, label="runout line"))
    for side, colour, marker in zip(sides, (ONLY_FIRST, ONLY_SECOND), ("^", "v"), strict=True):
        if side.farthest is not None:
            known = math.isfinite(side.runout)
            label = f"runout of {side.name}" if known else f"farthest point of {side.name} along the line"
            text = f"{_wrapped(label)}\n{side.runout if known else side.farthest.distance:.0f} m"
            entries.append(Line2D([], [], color=colour, marker=marker, linestyle="", markersize=7, label=text))
    if interval:
        label = f"contours every {interval:g} m"
        entries.append(Line2D([], [], color="#5a4632", alpha=0.6, linewidth=0.8, label=label))
    place = {"loc": "upper left", "borderaxespad": 0.0, "frameon": False, "alignment": "left", "fontsize": 8.5}
    axes.legend(handles=entries, bbox_to_anchor=(1.03, 1.0), labelspacing=0.9, **place)


def _wrapped(text):
    return "\n".join(textwrap.wrap(text, LEGEND_LETTERS))


def _area(area):
    hectares = area / SQUARE_METRES_PER_HECTARE
    return f"{hectares:.3g} ha" if hectares >= 0.1 else f"{area:.0f} m2"
