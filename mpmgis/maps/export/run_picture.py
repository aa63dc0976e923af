"""Picture of a run for readers without a GIS: map with hillshade, largest speed, release and deposit."""

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import shapely

from ...frames.flow_end import FlowEnd
from ...system.whole_files import whole_file
from ...terrain.elevation import Terrain
from ...terrain.grid import Grid
from ..averaging.exported_folder import TYPICAL_PERCENTILE
from ..qgis.colours import LOOKS, ColourClass, Look, balanced_limits, colour_classes, round_up
from ..qgis.outlines import LEAST_PART, mask_outline
from ..qgis.raster_styles import contour_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


PIXELS = 1100  # [pixels] of the hillshade along the longer side of the map
DOTS_PER_INCH = 150  # [inch-1]
MAP_LONG_SIDE = 7.5  # [inch] longer side of the map
LABEL_WIDTH = 0.7  # [inch] along an axis, room for the number at a tick
LEGEND_WIDTH = 2.6  # [inch]
SCALE_BAR = 1.5  # [inch] longest scale bar in the column of the legend
LENGTH_OFF_MAP = 1.6  # [inch] longest scale bar at the lower end of the figure
MARGIN = 0.12  # [1] around the flow, as a share of its longer side
POINTS_PER_INCH = 72.0
LETTER = 0.66  # [1] mean width of a bold letter over its size
SLIMMEST = 0.62  # [1] smallest ratio of the map sides
LIGHTS = ((315.0, 0.5), (270.0, 0.2), (0.0, 0.2), (225.0, 0.1))  # azimuth [degrees] and share [1] of each source
LIGHT_HEIGHT = 45.0  # [degrees] of the sources over the horizon
GREYS = (0.58, 1.0)  # [1] of the darkest and lightest 2 % of the hillshade; light, so that colours stay readable
LEAST_CONTRAST = 0.02  # [1] of a hillshade between its darkest and lightest 2 %; less is not stretched further
OPACITY = 0.82  # [1] of values over the hillshade
RELEASE_COLOUR = "#0a4fd0"  # blue
CONTOUR_COLOUR = "#5a4632"  # brown
DEPOSIT_COLOUR = "#101010"  # nearly black
INK = "#333333"  # dark grey, of axes and frames


def write_picture(
    path: Path,
    terrain: Terrain,
    grid: Grid,
    speed_max: np.ndarray,
    last_depth: np.ndarray,
    release: Sequence | None = None,
    title: str = "",
    credit: str = "",
    min_depth: float = 0.05,
    end: FlowEnd | None = None,
) -> None:
    """Write a PNG map of a run: largest speed in classes over a hillshade, outlines of release and last step.

    Parameters
    ----------
    path : Path
        The .png file, written atomically.
    terrain : Terrain
        On any grid in the same CRS; sampled at the resolution of the picture.
    grid : Grid
        North-up grid of the two rasters.
    speed_max : float[rows, columns] [m s-1]
        Largest speed over the run, NaN without flow.
    last_depth : float[rows, columns] [m]
        Depth in the last step.
    release : sequence of shapely polygons, optional
    title, credit : str
        Above and below the map.
    min_depth : float [m]
        Smallest depth in the outline of the last step.
    end : FlowEnd, optional
        Names the last step; without it "last step".
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    release = list(release or ())
    view = map_view(terrain, grid, np.isfinite(speed_max) | (last_depth >= min_depth), release)
    figure = Figure(figsize=(1, 1), dpi=DOTS_PER_INCH, facecolor="white")
    FigureCanvasAgg(figure)
    axes = map_axes(figure, view)
    interval = draw_terrain(axes, terrain, view)
    classes = classes_of(speed_max, LOOKS["Ut"])
    draw_values(axes, grid, speed_max, classes)
    last = mask_outline(last_depth >= max(min_depth, np.nextafter(0, 1)), grid.transform, True, LEAST_PART)
    draw_outline(axes, [last] if last is not None else [], DEPOSIT_COLOUR)
    draw_outline(axes, release, RELEASE_COLOUR)
    draw_scale_bar(axes, view)
    draw_north_arrow(axes)
    words = "" if last is None else "last step" if end is None else end.words()
    _draw_legend(axes, classes_up_to(speed_max, classes), bool(release), words, min_depth, interval)
    if title:
        draw_title(axes, title, 13.0)
    if credit:
        figure.text(axes.get_position().x0, 0.012, credit, fontsize=6.5, color="#555555", ha="left", va="bottom")
    with whole_file(path) as part:
        figure.savefig(part, dpi=DOTS_PER_INCH, format="png")


def map_view(terrain: Terrain, grid: Grid, flow: np.ndarray, release: Sequence = ()) -> tuple:
    """Choose the part of a map to show: flow and release with a margin, within the terrain.

    A narrow view is widened within the terrain.

    Parameters
    ----------
    terrain : Terrain
    grid : Grid
        Of `flow`.
    flow : bool[rows, columns]
    release : sequence of shapely polygons

    Returns
    -------
    (float, float, float, float)
        West, south, east, north [m].
    """
    row, column = np.nonzero(flow)
    x, y = grid.xy(np.concatenate([row - 0.5, row + 0.5]), np.concatenate([column - 0.5, column + 0.5]))
    corners = np.array([x, y]).T
    if release:
        corners = np.concatenate([corners, np.reshape(shapely.total_bounds(release), (2, 2))])
    limits = np.reshape(terrain.grid.bounds, (2, 2))
    if corners.size == 0:
        return tuple(float(value) for value in terrain.grid.bounds)
    low, high = corners.min(axis=0), corners.max(axis=0)
    longest = (high - low).max()
    size = np.maximum((high - low) + 2 * MARGIN * longest, SLIMMEST * longest * (1 + 2 * MARGIN))
    size = np.minimum(size, limits[1] - limits[0])
    low = np.clip(0.5 * (low + high) - 0.5 * size, limits[0], limits[1] - size)
    return (*(float(value) for value in low), *(float(value) for value in low + size))


def shaded_relief(elevation: np.ndarray, spacing: float) -> np.ndarray:
    """Compute a hillshade with four light sources.

    Parameters
    ----------
    elevation : float[rows, columns] [m]
        North-up.
    spacing : float [m]

    Returns
    -------
    float[rows, columns]
        From 0 to 1.
    """
    down, right = np.gradient(elevation, spacing)
    east, north = -right, down
    length = np.sqrt(east**2 + north**2 + 1.0)
    height = math.radians(LIGHT_HEIGHT)
    shade = np.zeros(elevation.shape)
    for azimuth, share in LIGHTS:
        angle = math.radians(azimuth)
        lit = math.cos(height) * (math.sin(angle) * east + math.cos(angle) * north) + math.sin(height)
        shade += share * np.clip(lit / length, 0.0, 1.0)
    return shade


def map_axes(figure: "Figure", view: tuple) -> "Axes":
    """Add the axes of a map to a figure, and size the figure for the map and a legend at its right.

    Parameters
    ----------
    figure : Figure
    view : (float, float, float, float) [m]
        West, south, east, north.
    """
    west, south, east, north = view
    inch = MAP_LONG_SIDE / max(east - west, north - south)
    width, height = (east - west) * inch, (north - south) * inch
    left, below, above = 0.85, 0.75, 0.55
    total = (left + width + LEGEND_WIDTH, max(below + height + above, 5.4))
    figure.set_size_inches(total)
    axes = figure.add_axes(
        [left / total[0], (total[1] - above - height) / total[1], width / total[0], height / total[1]]
    )
    fit_axes(axes, view)
    return axes


def fit_axes(axes: "Axes", view: tuple) -> None:
    """Give axes the limits of a map, and coordinates.

    Parameters
    ----------
    axes : Axes
    view : (float, float, float, float) [m]
        West, south, east, north.
    """
    west, south, east, north = view
    axes.set(xlim=(west, east), ylim=(south, north), aspect="equal")
    place, figure = axes.get_position(), axes.figure.get_size_inches()
    _label_axes(axes, (place.width * figure[0], place.height * figure[1]))


def _label_axes(axes, size):
    """Coordinates in metres; number of labels from `size` [inch], decimals from their spacing."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator

    for axis, word, length in zip((axes.xaxis, axes.yaxis), ("Easting", "Northing"), size, strict=True):
        most = int(np.clip(length / LABEL_WIDTH, 1, 5))
        axis.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))
        ticks = axis.get_majorticklocs()
        decimals = max(0, math.ceil(-math.log10(ticks[1] - ticks[0]) - 1e-9)) if len(ticks) > 1 else 0
        if length < LABEL_WIDTH:  # one label in the middle of a slim map, where two would lie on each other
            low, high = axis.get_view_interval()
            axis.set_major_locator(FixedLocator([round(0.5 * (low + high), decimals)]))
        axis.set_major_formatter(FuncFormatter(lambda value, _, n=decimals: f"{value:,.{n}f}".replace(",", " ")))
        axis.set_label_text(f"{word} (m)", fontsize=8.5, color=INK)
    axes.tick_params(labelsize=8, colors=INK, length=3)
    for label in axes.get_yticklabels():
        label.set(rotation=90, va="center")
    for spine in axes.spines.values():
        spine.set(color=INK, linewidth=0.8)


def draw_title(axes: "Axes", words: str, size: float = 12.0) -> None:
    """Write a title over map and legend, in at most two lines as long as the figure.

    Parameters
    ----------
    axes : Axes
    words : str
    size : float [points]
    """
    room = axes.figure.get_figwidth() * (1.0 - axes.get_position().x0) * POINTS_PER_INCH
    lines = textwrap.wrap(words, max(int(room / (LETTER * size)), 10), max_lines=2, placeholder=" ...")
    axes.set_title("\n".join(lines), loc="left", fontsize=size, fontweight="bold", pad=10 if len(lines) < 2 else 4)


class Relief(NamedTuple):
    """The terrain of a view, sampled on a grid.

    Parameters
    ----------
    heights, shade : float[rows, columns] [m], [1]
        Elevation, and the hillshade between GREYS.
    x, y : float[columns], float[rows] [m]
        Centres of the samples; y descends.
    extent : (float, float, float, float) [m]
        West, east, south, north edges.
    """

    heights: np.ndarray
    shade: np.ndarray
    x: np.ndarray
    y: np.ndarray
    extent: tuple


def view_relief(terrain: Terrain, view: tuple, pixels: int = PIXELS) -> Relief:
    """Sample the terrain of a view, with its hillshade.

    Parameters
    ----------
    terrain : Terrain
    view : (float, float, float, float) [m]
        West, south, east, north.
    pixels : int
        Samples along the longer side, at most.

    Returns
    -------
    Relief
    """
    west, south, east, north = view
    spacing = max(max(east - west, north - south) / pixels, terrain.grid.cell_size)
    x = np.arange(west - 1.5 * spacing, east + 2 * spacing, spacing)
    y = np.arange(north + 1.5 * spacing, south - 2 * spacing, -spacing)
    limits = terrain.grid.bounds  # outside, the outermost heights are repeated
    heights = terrain.sample(*np.meshgrid(np.clip(x, limits[0], limits[2]), np.clip(y, limits[1], limits[3])))
    shade = _stretched(shaded_relief(heights, spacing))
    half = spacing / 2
    extent = (float(x[0] - half), float(x[-1] + half), float(y[-1] - half), float(y[0] + half))
    return Relief(heights, shade, x, y, extent)


def draw_terrain(axes: "Axes", terrain: Terrain, view: tuple) -> float:
    """Draw hillshade and contour lines.

    Parameters
    ----------
    axes : Axes
    terrain : Terrain
    view : (float, float, float, float) [m]
        West, south, east, north.

    Returns
    -------
    float
        Contour interval [m]; 0 for a level terrain.
    """
    west, south, east, north = view
    relief = view_relief(terrain, view)
    heights, x, y = relief.heights, relief.x, relief.y
    axes.imshow(relief.shade, cmap="gray", vmin=0, vmax=1, extent=relief.extent, zorder=1, interpolation="bicubic")
    axes.set(xlim=(west, east), ylim=(south, north))
    span = float(np.nanmax(heights) - np.nanmin(heights)) if np.isfinite(heights).any() else 0.0
    if span <= 0:
        return 0.0
    interval = contour_interval(span)
    levels = np.arange(math.floor(np.nanmin(heights) / interval), math.ceil(np.nanmax(heights) / interval) + 1)
    widths = np.where(levels % 5 == 0, 0.7, 0.3)
    lines = axes.contour(
        x, y, heights, levels=levels * interval, colors=CONTOUR_COLOUR, linewidths=widths, alpha=0.55, zorder=3
    )
    heavy = [level for level in lines.levels if round(level / interval) % 5 == 0]
    axes.clabel(lines, heavy, fmt="%g", fontsize=5.5, inline=True, inline_spacing=2)
    return interval


def _stretched(shade):
    """A hillshade stretched to GREYS; where it is nearly the same everywhere, as on a plane, to their middle."""
    if not np.isfinite(shade).any():
        return shade
    darkest, lightest = np.nanpercentile(shade, (2, 98))
    lacking = 0.5 * max(LEAST_CONTRAST - (lightest - darkest), 0.0)
    return np.interp(shade, (darkest - lacking, lightest + lacking), GREYS)


def classes_of(values: np.ndarray, look: Look, min_depth: float = 0.0) -> list[ColourClass]:
    """Choose the classes of a band by its values.

    Parameters
    ----------
    values : float[rows, columns]
        NaN without flow.
    look : Look
    min_depth : float [m]
        Depths up to this are not drawn.
    """
    known = np.isfinite(values)
    sizes = values[known & (values != 0)] if look.shown == "depth" else values[known]
    typical = float(np.percentile(sizes, TYPICAL_PERCENTILE)) if sizes.size else 0.0
    limits = balanced_limits(look, sizes[sizes > min_depth])
    return colour_classes(look._replace(limits=limits, fixed=True) if limits else look, typical, min_depth)


def draw_values(axes: "Axes", grid: Grid, values: np.ndarray, classes: list[ColourClass]) -> None:
    """Draw values in classes over the hillshade.

    Parameters
    ----------
    axes : Axes
    grid : Grid
    values : float[rows, columns]
        NaN without flow.
    classes : list of ColourClass
    """
    from matplotlib.colors import to_rgba

    known = np.isfinite(values)
    number = np.searchsorted([entry.upper for entry in classes], np.where(known, values, 0.0))
    opaque = [to_rgba(entry.colour, OPACITY) if entry.colour else (0.0, 0.0, 0.0, 0.0) for entry in classes]
    image = np.where(known[..., None], np.array(opaque)[number], 0.0)
    draw_image(axes, grid, image)


def classes_up_to(values: np.ndarray, classes: list[ColourClass]) -> list[ColourClass]:
    """Choose the classes of a legend: those with a colour up to the largest value.

    Parameters
    ----------
    values : float[rows, columns]
        NaN without flow.
    classes : list of ColourClass
    """
    last = np.searchsorted([entry.upper for entry in classes], values[np.isfinite(values)]).max(initial=0)
    return [entry for entry in classes[: last + 1] if entry.colour]


def draw_image(axes: "Axes", grid: Grid, image: np.ndarray) -> None:
    """Draw colours on the cells of a grid, which may be rotated; the limits of the axes stay.

    Parameters
    ----------
    axes : Axes
    grid : Grid
    image : float[rows, columns, 4]
    """
    from matplotlib.transforms import Affine2D

    t, (rows, columns) = grid.transform, grid.shape
    view = axes.get_xlim(), axes.get_ylim()
    placed = Affine2D(np.array([[t.a, t.b, t.c], [t.d, t.e, t.f], [0.0, 0.0, 1.0]])) + axes.transData
    axes.imshow(image, extent=(0, columns, rows, 0), transform=placed, zorder=2, interpolation="nearest")
    axes.set(xlim=view[0], ylim=view[1])


def beside(axes: "Axes") -> tuple[float, float]:
    """Return the upper left corner of a legend right of a map, as shares of its sides; farther away from a slim map.

    Parameters
    ----------
    axes : Axes
    """
    width = axes.get_position().width * axes.figure.get_figwidth()
    return 1.0 + max(0.03, (LABEL_WIDTH - width) / width), 1.0


def draw_outline(axes: "Axes", shapes: Sequence, colour: str) -> None:
    """Draw outlines with a white border, visible on any background.

    Parameters
    ----------
    axes : Axes
    shapes : sequence of shapely polygons
    colour : str
    """
    from matplotlib.patheffects import withStroke

    for polygon in shapely.get_parts(shapely.get_parts(np.array(shapes, dtype=object))):
        for ring in (polygon.exterior, *polygon.interiors):
            axes.plot(
                *np.asarray(ring.coords)[:, :2].T,
                color=colour,
                linewidth=1.1,
                zorder=5,
                path_effects=[withStroke(linewidth=2.4, foreground="white", alpha=0.8)],
                scalex=False,
                scaley=False,
            )


def draw_scale_bar(axes: "Axes", view: tuple) -> None:
    """Draw a scale bar of a round length beside the map, below the legend, where it never covers the flow.

    Parameters
    ----------
    axes : Axes
    view : (float, float, float, float) [m]
        West, south, east, north.
    """
    from matplotlib.patches import Rectangle

    figure, (left, bottom) = axes.figure, _lower_left_corner(axes)
    metres = (view[2] - view[0]) / (axes.get_position().width * figure.get_figwidth())  # per inch
    length = _round_down(SCALE_BAR * metres)
    width, height = length / metres, 0.06
    inches = figure.dpi_scale_trans
    for k, colour in enumerate(("black", "white")):
        place = (left + k * width / 2, bottom)
        half = Rectangle(place, width / 2, height, facecolor=colour, edgecolor="black", lw=0.7, transform=inches)
        figure.add_artist(half).set_gid("scale bar")
    text = f"{length / 1000:g} km" if length >= 1000 else f"{length:g} m"
    for at, label in ((0.0, "0"), (width, text)):
        figure.text(left + at, bottom + 0.1, label, fontsize=7.5, ha="center", va="bottom", transform=inches)


def draw_north_arrow(axes: "Axes") -> None:
    """Draw an arrow beside the map, right of the scale bar; the map is always north-up.

    Parameters
    ----------
    axes : Axes
    """
    from matplotlib.patches import FancyArrowPatch

    figure, (left, bottom) = axes.figure, _lower_left_corner(axes)
    inches, middle = figure.dpi_scale_trans, left + SCALE_BAR + 0.35
    arrow = FancyArrowPatch(
        (middle, bottom - 0.1),
        (middle, bottom + 0.3),
        arrowstyle="-|>",
        mutation_scale=11,
        color="black",
        lw=1.2,
        shrinkA=0,
        shrinkB=0,
        transform=inches,
    )
    figure.add_artist(arrow).set_gid("north arrow")
    figure.text(middle, bottom + 0.32, "N", fontsize=9.5, fontweight="bold", ha="center", va="bottom", transform=inches)


def _lower_left_corner(axes):
    """Left and lower end [inch] of the place for scale bar and north arrow, at the foot of the legend's column."""
    figure = axes.figure
    return axes.get_position().x1 * figure.get_figwidth() + 0.3, 0.4


def _round_down(value):
    """The largest 1, 2 or 5 times a power of ten up to `value`."""
    power = 10.0 ** math.floor(math.log10(value) + 1e-9)
    return max(m for m in (1, 2, 5) if m * power <= value * (1 + 1e-9)) * power


def draw_scale_and_north(axes: "Axes", view: tuple) -> None:
    """Draw scale bar and north arrow in the column of the legend, off the map, at the lower end of the figure.

    Parameters
    ----------
    axes : Axes
    view : (float, float, float, float) [m]
        West, south, east, north.
    """
    from matplotlib.patches import Rectangle

    figure, box = axes.figure, axes.get_position()
    width, height = figure.get_size_inches()
    metre = box.width * width / (view[2] - view[0])  # [inch]
    length = round_up(0.4 * LENGTH_OFF_MAP / metre)
    left, low, bar = box.x1 + 0.35 / width, 0.45 / height, 0.07 / height
    half = 0.5 * length * metre / width
    for k, colour in enumerate(("black", "white")):
        place = (left + k * half, low)
        figure.add_artist(Rectangle(place, half, bar, facecolor=colour, edgecolor="black", lw=0.7))
    text = f"{length / 1000:g} km" if length >= 1000 else f"{length:g} m"
    for at, label in ((0.0, "0"), (2 * half, text)):
        figure.text(left + at, low + 1.6 * bar, label, fontsize=7.5, ha="center", va="bottom", color=INK)
    axes.annotate(
        "N",
        xy=(left + half, low + 1.0 / height),
        xytext=(left + half, low + 0.5 / height),
        xycoords="figure fraction",
        textcoords="figure fraction",
        ha="center",
        va="center",
        fontsize=10,
        fontweight="bold",
        annotation_clip=False,
        arrowprops={"arrowstyle": "-|>,head_width=0.35,head_length=0.6", "color": "black", "lw": 1.4},
    )


def _draw_legend(axes, classes, has_release, last, min_depth, interval):
    """Draw the legend of colours and lines, to the right of the map."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    colours = [Patch(facecolor=entry.colour, edgecolor=INK, linewidth=0.4, label=entry.label) for entry in classes]
    place = {"loc": "upper left", "borderaxespad": 0.0, "frameon": False, "alignment": "left", "fontsize": 8.5}
    first = axes.legend(handles=colours, title="Largest speed", bbox_to_anchor=(1.03, 1.0), **place)
    first.get_title().set(fontsize=9.5, fontweight="bold")
    axes.add_artist(first)
    lines = []
    if has_release:
        lines.append(Line2D([], [], color=RELEASE_COLOUR, linewidth=1.6, label="release area"))
    if last:
        label = f"{last}\n(at least {min_depth:g} m deep)"
        lines.append(Line2D([], [], color=DEPOSIT_COLOUR, linewidth=1.6, label=label))
    if interval:
        lines.append(Line2D([], [], color="#5a4632", alpha=0.6, linewidth=0.8, label=f"contours every {interval:g} m"))
    end = first.get_window_extent(axes.figure.canvas.get_renderer()).transformed(axes.transAxes.inverted()).y0
    axes.legend(handles=lines, bbox_to_anchor=(1.03, end - 0.03), **place)
