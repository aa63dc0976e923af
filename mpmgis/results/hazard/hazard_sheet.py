"""Print a hazard map at an exact scale: map at the left, all explanations in a column at its right.

Scale bar, north arrow and legend stand in the column, where they never cover the flow.
"""

import math
import textwrap
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely

from ...maps.export.run_picture import INK, draw_terrain
from ...maps.qgis.print_layout import METRES_PER_MM, usual_scale
from ...system.errors import InputError
from ...system.messages import log
from ...system.whole_files import whole_file
from ...terrain.elevation import Terrain
from .hazard_files import LEAST, MOST, NOT_ASSESSED_COLOUR, NOT_ASSESSED_WORDS, HazardMap
from .hazard_legend import MM, OPACITY, Column, draw_matrix
from .zone_outlines import polygons

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPERS = {"A4": (297.0, 210.0), "A3": (420.0, 297.0)}  # [mm] width and height, landscape
EDGE = 8.0  # [mm] margin of the paper
TITLE = 11.0  # [mm] height of the title line
TICKS = 7.0  # [mm] width of the labels of coordinates
GAP = 4.0  # [mm] between map and column
COLUMN = {"A4": 72.0, "A3": 84.0}  # [mm] width of the column of explanations
AIR = 8.0  # [mm] on paper around the zones
HEADINGS = 5.0  # [mm] height of a heading of the column
FOOT = EDGE + 24.0  # [mm] under the explanations, for scale and north
TITLES = (13.0, 11.0, 9.0, 7.5)  # [points] of the title: the largest with which it fits
DOTS_PER_INCH = 200  # of the picture, and of the hillshade in the PDF
WARNING_COLOUR = "#c00000"  # red, of scenarios that are not finished
BAND_COLOUR = "#202020"  # of the bands in which an outline is uncertain


@dataclass(frozen=True)
class Sheet:
    """A sheet: `width`, `height` [mm], `column` [mm] of explanations, denominator of the `scale`, `view` [m]."""

    width: float
    height: float
    column: float
    scale: float
    view: tuple

    @property
    def frame(self) -> tuple[float, float, float, float]:
        """(left, bottom, width, height) [mm] of the map."""
        return _frame(self.width, self.height, self.column)


def _frame(width: float, height: float, column: float) -> tuple[float, float, float, float]:
    left, bottom = EDGE + TICKS, EDGE + TICKS
    return left, bottom, width - left - GAP - column - EDGE, height - bottom - TITLE - EDGE


def sheet_for(bounds: tuple, paper: str, scale: float | None) -> Sheet:
    """Return the sheet whose orientation shows an area at the largest scale, or at the given one.

    Parameters
    ----------
    bounds : (float, float, float, float) [m]
        West, south, east, north.
    paper : str
        A key of PAPERS.
    scale : float or None
        Denominator; None: the largest usual one that fits.

    Returns
    -------
    Sheet

    Raises
    ------
    InputError
        The area does not fit on the paper at this scale.
    """
    needed, width, height, frame = _largest_scale(bounds, paper)
    chosen = scale or usual_scale(needed)
    if chosen < needed:
        least = usual_scale(needed)
        raise InputError(
            f"`scale=1:{scale:g}`: the zones do not fit on {paper} at this scale; give `scale=1:{least:g}`"
            + (", or `sheet=A3`" if _largest_scale(bounds, "A3")[0] <= chosen else "")
        )
    middle = [0.5 * (bounds[k] + bounds[k + 2]) for k in (0, 1)]
    half = [0.5 * frame[k + 2] * METRES_PER_MM * chosen for k in (0, 1)]
    view = (middle[0] - half[0], middle[1] - half[1], middle[0] + half[0], middle[1] + half[1])
    return Sheet(width, height, COLUMN[paper], chosen, view)


def _largest_scale(bounds, paper):
    """(smallest denominator of the scale, width, height, frame) of the orientation that shows `bounds` largest."""
    fitting, landscape = [], PAPERS[paper]
    for width, height in (landscape, landscape[::-1]):
        frame = _frame(width, height, COLUMN[paper])
        needed = max((bounds[k + 2] - bounds[k]) / ((frame[k + 2] - 2 * AIR) * METRES_PER_MM) for k in (0, 1))
        fitting.append((needed, width, height, frame))
    return min(fitting, key=lambda entry: entry[0])


class Print:
    """A sheet as a figure, drawn once and saved in several formats.

    Parameters
    ----------
    made : HazardMap
    terrain : Terrain or None
        For the hillshade.
    sheet : Sheet
    """

    def __init__(self, made: HazardMap, terrain: Terrain | None, sheet: Sheet):
        self._contents = made, terrain, sheet

    @cached_property
    def figure(self) -> "Figure":
        """Figure of the size of the paper."""
        return _drawn(*self._contents)

    def save(self, path: Path, kind: str) -> None:
        """Write the sheet to a file.

        Parameters
        ----------
        path : Path
        kind : str
            "pdf" or "png".
        """
        from matplotlib import rc_context

        with rc_context({"hatch.linewidth": 0.5, "pdf.fonttype": 42}), whole_file(path) as part:
            self.figure.savefig(part, dpi=DOTS_PER_INCH, format=kind)


def _drawn(made: HazardMap, terrain: Terrain | None, sheet: Sheet) -> "Figure":
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(sheet.width * MM, sheet.height * MM), dpi=DOTS_PER_INCH, facecolor="white")
    FigureCanvasAgg(figure)
    left, bottom, width, height = sheet.frame
    axes = figure.add_axes(
        [left / sheet.width, bottom / sheet.height, width / sheet.width, height / sheet.height], aspect="auto"
    )
    axes.set(xlim=sheet.view[::2], ylim=sheet.view[1::2])
    axes.set_gid("map")
    interval = 0.0 if terrain is None else draw_terrain(axes, terrain, sheet.view)
    if terrain is not None:
        _hide_beyond(axes, sheet.view, shapely.Polygon(terrain.grid.corners()))
    axes.set_aspect("auto")
    axes.set(xlim=sheet.view[::2], ylim=sheet.view[1::2])
    _draw_zones(axes, made)
    _draw_coordinates(axes)
    _draw_column(figure, made, sheet, interval, terrain is None)
    _draw_title(figure, made.title, sheet)
    return figure


def _draw_title(figure: "Figure", words: str, sheet: Sheet) -> None:
    """The title in one line, in the largest of TITLES that fits; what is too long even so is shortened."""
    left, room = sheet.frame[0], sheet.width - EDGE - sheet.frame[0]
    title = figure.text(left / sheet.width, 1 - (EDGE + 5) / sheet.height, words, fontweight="bold", va="center")
    for size in TITLES:
        title.set_fontsize(size)
        width = title.get_window_extent().width / figure.dpi / MM
        if width <= room:
            return
    title.set_text(textwrap.shorten(words, int(0.95 * len(words) * room / width), placeholder=" ..."))


def _hide_beyond(axes: "Axes", view: tuple, terrain: shapely.Geometry) -> None:
    """Cover the part of the view outside the `terrain` polygon, where draw_terrain repeats the outermost heights."""
    beyond = shapely.difference(shapely.box(*view), terrain)
    _draw_polygon(axes, polygons(beyond), facecolor="white", edgecolor="none", zorder=3.5)
    for label in axes.texts:
        label.set_visible(terrain.contains(shapely.Point(label.get_position())))


def _draw_zones(axes: "Axes", made: HazardMap) -> None:
    for level, zone in zip(made.matrix.levels, made.zones.zones, strict=True):
        _draw_polygon(axes, zone, facecolor=(level.colour, OPACITY), edgecolor=INK, linewidth=0.5, zorder=4)
    _draw_polygon(
        axes,
        made.not_assessed(),
        facecolor="none",
        edgecolor=NOT_ASSESSED_COLOUR,
        hatch="xx",
        linewidth=0.3,
        zorder=3.7,
    )
    bands = made.bands()
    if bands:
        _draw_polygon(axes, bands[0], facecolor="none", edgecolor=BAND_COLOUR, hatch="////", linewidth=0.4, zorder=5)


def _draw_polygon(axes, shape, **look):
    """Draw a MultiPolygon with its holes."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Line

    if shape is None or shape.is_empty:
        return
    rings = [ring for part in shapely.get_parts(shape) for ring in (part.exterior, *part.interiors)]
    points = [np.asarray(ring.coords)[:, :2] for ring in rings]
    codes = [[Line.MOVETO, *[Line.LINETO] * (len(ring) - 2), Line.CLOSEPOLY] for ring in points]
    axes.add_patch(PathPatch(Line(np.concatenate(points), np.concatenate(codes)), **look))


def _draw_coordinates(axes):
    """Full coordinates [m] at a few round places."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}".replace(",", " ")))
    axes.tick_params(labelsize=6, colors=INK, length=2, pad=1.5)
    for label in axes.get_yticklabels():
        label.set(rotation=90, va="center")
    for spine in axes.spines.values():
        spine.set(color=INK, linewidth=0.8)


def _draw_column(
    figure: "Figure", made: HazardMap, sheet: Sheet, interval: float | None, without_terrain: bool
) -> None:
    """Legend, matrix, scenarios and sources from the top; scale and north at the foot."""
    column = Column(figure, sheet.width - EDGE - sheet.column, EDGE + TITLE, sheet.column, sheet.height)
    for words in made.unfinished():  # first, so that it never lacks room
        column.text(f"NOT FINISHED, levels can be too low: {words}", color=WARNING_COLOUR, weight="bold")
    _draw_legend(column, made, interval)
    draw_matrix(column, made.matrix, {scenario.period.name for scenario in made.scenarios})
    facts = made.facts + (
        (("relief", "no terrain was given: no hillshade, gaps of the terrain unknown"),) if without_terrain else ()
    )
    scenarios = [scenario.words() for scenario in made.scenarios]
    colours = [WARNING_COLOUR if scenario.unfinished else INK for scenario in made.scenarios]
    sources = [f"{name}: {words}" for name, words in facts]
    room = sheet.height - FOOT - column.y - 2 * HEADINGS
    column.fit((*scenarios, *sources), room)
    column.heading("Scenarios")
    least = FOOT + HEADINGS + min(column.needed(sources), 0.5 * room)
    lost = sum(column.text(words, least, color=colour) for words, colour in zip(scenarios, colours, strict=True))
    column.heading("Sources and parameters")
    lost += sum(column.text(words, FOOT) for words in sources)
    if lost:
        log.info(
            f"the sheet has no room for {lost} lines of scenarios, sources and parameters; give `sheet=A3`, fewer "
            "scenarios, or shorter names"
        )
    _draw_scale(figure, sheet, column.left)


def _draw_legend(column: Column, made: HazardMap, interval: float | None) -> None:
    column.heading(made.matrix.title)
    for level, area in reversed(list(zip(made.matrix.levels, made.areas(), strict=True))):
        column.patch(f"{level.meaning or level.name}, {area / 1e4:.3g} ha", facecolor=(level.colour, OPACITY))
    if made.hazard.unknown.any():
        column.patch(NOT_ASSESSED_WORDS, facecolor="none", edgecolor=NOT_ASSESSED_COLOUR, hatch="xxxx")
    if made.shares is not None:
        words = f"uncertain outline: reached by {LEAST:.0%} to {MOST:.0%} of the runs"
        column.patch(words, facecolor="none", edgecolor=BAND_COLOUR, hatch="//////")
    if interval:
        column.text(f"contours every {interval:g} m")


def _draw_scale(figure: "Figure", sheet: Sheet, left: float) -> None:
    """Scale bar, scale in numbers and north arrow at the foot of the column."""
    from matplotlib.patches import FancyArrowPatch, Rectangle

    metre = 1.0 / (sheet.scale * METRES_PER_MM)  # [mm]
    length = _round_down(0.6 * sheet.column / metre)
    low, half = EDGE + 6.0, 0.5 * length * metre
    unit = figure.dpi_scale_trans
    for k, colour in enumerate(("black", "white")):
        place = ((left + k * half) * MM, low * MM)
        bar = Rectangle(place, half * MM, 1.5 * MM, facecolor=colour, edgecolor="black", lw=0.6, transform=unit)
        figure.add_artist(bar).set_gid("scale bar")
    text = f"{length / 1000:g} km" if length >= 1000 else f"{length:g} m"
    words = {"fontsize": 7, "transform": unit, "va": "bottom"}
    figure.text(left * MM, (low + 2) * MM, "0", **words)
    figure.text((left + 2 * half) * MM, (low + 2) * MM, text, ha="center", **words)
    figure.text(left * MM, (low + 6) * MM, f"1:{sheet.scale:,.0f}".replace(",", " "), fontweight="bold", **words)
    middle = (left + sheet.column - 6.0) * MM
    arrow = FancyArrowPatch(
        (middle, low * MM),
        (middle, (low + 9) * MM),
        arrowstyle="-|>",
        mutation_scale=11,
        color="black",
        lw=1.2,
        shrinkA=0,
        shrinkB=0,
        transform=unit,
    )
    figure.add_artist(arrow).set_gid("north arrow")
    figure.text(middle, (low + 9.5) * MM, "N", fontweight="bold", ha="center", **words)


def _round_down(value):
    power = 10.0 ** math.floor(math.log10(value) + 1e-9)
    return max(m for m in (1, 2, 5) if m * power <= value * (1 + 1e-9)) * power
