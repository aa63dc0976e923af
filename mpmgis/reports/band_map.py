"""PNG map of one band of a result over a hillshade."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..gis.styles import LOOKS, Look
from ..io.atomic import whole_file
from ..terrain.elevation import Terrain
from ..terrain.grid import Grid
from .picture import (
    INK,
    RELEASE_COLOUR,
    draw_north_arrow,
    draw_outline,
    draw_scale_bar,
    draw_terrain,
    draw_values,
    map_axes,
    map_view,
)

DOTS_PER_INCH = 100


def write_band_map(
    path: Path,
    terrain: Terrain,
    grid: Grid,
    values: np.ndarray,
    band: str | Look,
    title: str = "",
    release: Sequence | None = None,
    min_depth: float = 0.05,
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
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    look, release = LOOKS[band] if isinstance(band, str) else band, list(release or ())
    floor = min_depth if look.shown == "depth" else 0.0
    figure = Figure(figsize=(1, 1), dpi=DOTS_PER_INCH, facecolor="white")
    FigureCanvasAgg(figure)
    with np.errstate(invalid="ignore"):
        view = map_view(terrain, grid, values > floor, release)
    axes = map_axes(figure, view)
    interval = draw_terrain(axes, terrain, view)
    classes = draw_values(axes, grid, values, look, floor)
    draw_outline(axes, release, RELEASE_COLOUR)
    draw_scale_bar(axes, view)
    draw_north_arrow(axes)
    _draw_legend(axes, look, classes, bool(release), interval)
    axes.set_title(title, loc="left", fontsize=12, fontweight="bold", pad=10)
    with whole_file(path) as part:
        figure.savefig(part, dpi=DOTS_PER_INCH, format="png")


def _draw_legend(axes, look, classes, has_release, interval):
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries = [Patch(facecolor=entry.colour, edgecolor=INK, linewidth=0.4, label=entry.label) for entry in classes]
    if has_release:
        entries.append(Line2D([], [], color=RELEASE_COLOUR, linewidth=1.6, label="release area"))
    if interval:
        label = f"contours every {interval:g} m"
        entries.append(Line2D([], [], color="#5a4632", alpha=0.6, linewidth=0.8, label=label))
    place = {"loc": "upper left", "borderaxespad": 0.0, "frameon": False, "alignment": "left", "fontsize": 8.5}
    title = look.words[0].upper() + look.words[1:]
    axes.legend(handles=entries, title=title, bbox_to_anchor=(1.03, 1.0), **place).get_title().set_fontsize(9.5)
