"""Draw the classes of a guideline over a hillshade, as PNG."""

import textwrap
from pathlib import Path

import numpy as np

from ...laws.quantities import SQUARE_METRES_PER_HECTARE
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
from ...system.whole_files import whole_file
from ...terrain.elevation import Terrain
from ...terrain.grid import Grid
from .guideline_classes import Guideline

DOTS_PER_INCH = 120  # small files that are sharp on a screen
LEFT_OF_SOURCE = 0.85  # [inch] left margin of the line below the map
RIGHT_OF_SOURCE = 0.1  # [inch] right margin of the line below the map
LETTER = 0.052  # [inch] mean width of a letter of that line
WIDTH_OF_WORDS = 36  # [characters] of a line of the legend


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
