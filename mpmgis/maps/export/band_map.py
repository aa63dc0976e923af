"""Write one band of a result as a PNG map over a hillshade."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...system.whole_files import whole_file
from ...terrain.elevation import Terrain
from ...terrain.grid import Grid
from ..qgis.colours import LOOKS, ColourClass, Look
from .run_picture import (
    CONTOUR_COLOUR,
    INK,
    RELEASE_COLOUR,
    beside,
    classes_of,
    classes_up_to,
    draw_outline,
    draw_scale_and_north,
    draw_terrain,
    draw_title,
    draw_values,
    map_axes,
    map_view,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DOTS_PER_INCH = 100  # [inch-1] about 1100 pixels across
WALL_COLOUR = "#111111"


def write_band_map(
    path: Path,
    terrain: Terrain,
    grid: Grid,
    values: np.ndarray,
    band: str | Look,
    title: str = "",
    release: Sequence | None = None,
    min_depth: float = 0.05,
    view: tuple | None = None,
    walls: Sequence = (),
    marks: Sequence = (),
) -> None:
    """Write a PNG map of a band, with the same classes as in QGIS.

    Parameters
    ----------
    path : Path
    terrain : Terrain
        For the hillshade; its extent limits the map.
    grid : Grid
        North-up, of `values`.
    values : float[rows, columns]
        NaN without flow.
    band : str or Look
        Key of LOOKS, or a Look.
    title : str
    release : sequence of shapely polygons, optional
    min_depth : float [m]
        Depths up to this are not drawn.
    view : (west, south, east, north) [m], optional
        Instead of the part with flow and release.
    walls : sequence of shapely polygons
        Barriers.
    marks : sequence of (E, N, text)
        Places [m], drawn as labelled dots.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    look, release = LOOKS[band] if isinstance(band, str) else band, list(release or ())
    floor = floor_of(look, min_depth)
    figure = Figure(figsize=(1, 1), dpi=DOTS_PER_INCH, facecolor="white")
    FigureCanvasAgg(figure)
    if view is None:
        with np.errstate(invalid="ignore"):
            view = map_view(terrain, grid, values > floor, release)
    axes = map_axes(figure, view)
    classes = classes_of(values, look, floor)
    draw_scale_and_north(axes, view)
    legend = classes_up_to(values, classes)
    draw_band(axes, view, terrain, grid, values, look, classes, title, release, walls, marks, legend)
    with whole_file(path) as part:
        figure.savefig(part, dpi=DOTS_PER_INCH, format="png")


def floor_of(look: Look, min_depth: float) -> float:
    """Return the value up to which a band is not drawn.

    Parameters
    ----------
    look : Look
    min_depth : float [m]
    """
    return min_depth if look.shown == "depth" else 0.0


def draw_band(
    axes: "Axes",
    view: tuple,
    terrain: Terrain | None,
    grid: Grid,
    values: np.ndarray,
    look: Look,
    classes: list[ColourClass],
    title: str = "",
    release: Sequence = (),
    walls: Sequence = (),
    marks: Sequence = (),
    legend: Sequence[ColourClass] | None = None,
) -> None:
    """Draw a band in axes that have a view.

    Parameters
    ----------
    axes : Axes
    view : (west, south, east, north) [m]
    terrain : Terrain or None
        For hillshade and contours; None: neither.
    grid : Grid
        Of `values`.
    values : float[rows, columns]
        NaN without flow.
    look : Look
    classes : list of ColourClass
    title : str
    release, walls : sequence of shapely polygons
    marks : sequence of (E, N, text)
        Places [m], drawn as labelled dots.
    legend : sequence of ColourClass, optional
        Classes of the legend, right of the map; None: no legend.
    """
    interval = 0.0 if terrain is None else draw_terrain(axes, terrain, view)
    draw_values(axes, grid, values, classes)
    draw_outline(axes, list(release), RELEASE_COLOUR)
    draw_outline(axes, list(walls), WALL_COLOUR)
    _draw_marks(axes, marks)
    if legend is not None:
        _draw_legend(axes, look, legend, (bool(release), bool(walls)), interval)
    draw_title(axes, title)


def _draw_marks(axes, marks):
    from matplotlib.patheffects import withStroke

    for x, y, text in marks:
        dot = {"color": "white", "markeredgecolor": "black", "markersize": 7, "zorder": 8}
        axes.plot([x], [y], "o", scalex=False, scaley=False, **dot)
        axes.annotate(
            text,
            (x, y),
            xytext=(6, 5),
            textcoords="offset points",
            fontsize=9,
            fontweight="bold",
            zorder=9,
            annotation_clip=True,
            path_effects=[withStroke(linewidth=2.5, foreground="white")],
        )


def _draw_legend(axes, look, classes, outlined, interval):
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries = [Patch(facecolor=entry.colour, edgecolor=INK, linewidth=0.4, label=entry.label) for entry in classes]
    has_release, has_walls = outlined
    if has_walls:
        entries.append(Line2D([], [], color=WALL_COLOUR, linewidth=1.6, label="barrier"))
    if has_release:
        entries.append(Line2D([], [], color=RELEASE_COLOUR, linewidth=1.6, label="release area"))
    if interval:
        label = f"contours every {interval:g} m"
        entries.append(Line2D([], [], color=CONTOUR_COLOUR, alpha=0.6, linewidth=0.8, label=label))
    place = {"loc": "upper left", "borderaxespad": 0.0, "frameon": False, "alignment": "left", "fontsize": 8.5}
    title = look.words[0].upper() + look.words[1:]
    axes.legend(handles=entries, title=title, bbox_to_anchor=beside(axes), **place).get_title().set_fontsize(9.5)
