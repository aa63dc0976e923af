"""Make the player of a report: the flow over time on a map, for any browser, without a network.

The map is drawn by Bokeh, whose script is embedded. Values are whole numbers of two bytes in units of a `precision`, of
the cells that the flow reaches only; each step is compressed, and the browser decodes it when it is shown.
"""

import base64
import json
import math
import zlib
from collections.abc import Sequence
from html import escape
from importlib import util
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import zoom

from ...maps.averaging.frame_values import NOWHERE, cells_of
from ...maps.export.run_picture import CONTOUR_COLOUR, INK, OPACITY, RELEASE_COLOUR, classes_of, map_view, view_relief
from ...maps.qgis.colours import LOOKS, ColourClass
from ...maps.qgis.raster_styles import contour_interval
from ...system.optional_libraries import needed_for
from ...terrain.elevation import Terrain
from ...terrain.grid import Grid
from ..opened_results import ExportFlow, FrameFlow, RasterFlow

BANDS = (("h", "h_max", "depth"), ("Ut", "Ut_max", "speed"))  # of the steps, of their classes, word on the switch
PRECISIONS = {"h": 0.001, "Ut": 0.01}  # [m], [m s-1] of the embedded values; ten times as coarse where it is needed
NO_VALUE = 65535  # a cell without flow, or without a speed
MOST_BYTES = 8_000_000  # [bytes] of all values in the page; with more, steps are left out
MOST_VALUES = 100_000_000  # cells times steps, which the browser holds in memory after a click
READ_AT_ONCE = 20_000_000  # cells times steps
SHADE_PIXELS = 800  # [pixels] of the hillshade along its longer side
LARGEST = 800, 600  # [pixels] width and height of the map without its axes
CURVE = 800, 130  # [pixels] width and height of the curve
CONTOUR_PIXELS = 200  # [pixels] between which contours are straight
TICKS = "return tick.toLocaleString('en').replaceAll(',', '\u202f')"  # 4 008 500
SCRIPT = Path(__file__).with_name("flow_player.js")
INSTALL = 'pip install "mpmgis[player]"'


class Player(NamedTuple):
    """A part of a page with scripts: its `markup`."""

    markup: str


class PlayedFlow(NamedTuple):
    """Values of a flow over time, encoded.

    Parameters
    ----------
    times : tuple of float [s]
        Of the steps.
    cells : int64[n]
        Flat numbers in `grid` of the cells that have values.
    grid : Grid
    precisions : dict of str to float
        By band: unit of the whole numbers.
    steps : dict of str to tuple of bytes
        By band: uint16[n], little-endian, compressed by zlib; NO_VALUE without a value.
    """

    times: tuple
    cells: np.ndarray
    grid: Grid
    precisions: dict
    steps: dict


def can_play() -> bool:
    """Return whether the library that draws the player is installed."""
    return util.find_spec("bokeh") is not None


def encoded_flow(flow: FrameFlow | ExportFlow | RasterFlow, depth_max: np.ndarray, grid: Grid) -> PlayedFlow | str:
    """Read and encode depth and speed of a flow.

    Parameters
    ----------
    flow : FrameFlow, ExportFlow or RasterFlow
    depth_max : float[rows, columns] [m]
        Largest depth, which says where the flow was.
    grid : Grid
        Of `depth_max`.

    Returns
    -------
    PlayedFlow or str
        Why there is none.
    """
    if len(flow.times) < 2 or isinstance(flow, RasterFlow):
        return "there is no flow over time"
    names = [name for name, *_ in BANDS if flow.entries or name in flow.steps.bands]
    if "h" not in names or flow.grid.is_rotated:
        return "the steps have no depth h" if "h" not in names else "the cells are not aligned with north"
    cells = cells_of(flow.grid, *grid.xy(*np.nonzero(np.nan_to_num(depth_max) > 0)))
    cells = np.unique(cells[cells != NOWHERE])
    stride = max(math.ceil(len(cells) * len(flow.times) / MOST_VALUES), 1)
    chosen = _every(range(len(flow.times)), stride)
    values = _read(flow, cells, names, chosen)
    precisions = {name: _precision(PRECISIONS[name], steps) for name, steps in values.items()}
    coded = {name: [_encoded(step, precisions[name]) for step in steps] for name, steps in values.items()}
    size = sum(4 * len(step) / 3 for steps in coded.values() for step in steps)
    kept = _every(range(len(chosen)), math.ceil(size / MOST_BYTES))
    if not len(cells) or len(kept) < 2:
        return "there is no flow" if not len(cells) else "the flow has too many cells; give a larger `cell_size`"
    times = tuple(float(flow.times[chosen[k]]) for k in kept)
    steps = {name: tuple(coded[name][k] for k in kept) for name in names}
    return PlayedFlow(times, cells, flow.grid, precisions, steps)


def _every(numbers, stride):
    """Every `stride`-th of the numbers, and the last."""
    return sorted({*numbers[:: max(stride, 1)], *numbers[-1:]})


def _read(flow, cells, names, steps):
    """Values by band: a float32[n] for each step."""
    found: dict[str, list] = {name: [] for name in names}
    count = max(READ_AT_ONCE // max(len(cells), 1), 1)
    for first in range(0, len(steps), count):
        values = flow.at_cells(cells, names, steps[first : first + count])
        for name in names:
            found[name] += list(values[name].astype(np.float32))
    return found


def _precision(usual, steps):
    """The precision, or the smallest multiple of it by a power of ten with which the largest value fits."""
    largest = max((float(np.nanmax(step, initial=0.0)) for step in steps), default=0.0)
    power = max(math.ceil(math.log10(max(largest / usual / (NO_VALUE - 1), 1e-300))), 0)
    return usual * 10.0**power


def _encoded(values, precision):
    known = np.isfinite(values) & (values >= 0)
    whole = np.where(known, np.rint(np.where(known, values, 0.0) / precision), NO_VALUE)
    return zlib.compress(whole.astype("<u2").tobytes(), 9)


def flow_player(
    played: PlayedFlow, terrain: Terrain, peaks: dict, grid: Grid, min_depth: float, release: Sequence = ()
) -> Player:
    """Make the player of an encoded flow.

    Parameters
    ----------
    played : PlayedFlow
    terrain : Terrain
        For the hillshade.
    peaks : dict of str to float[rows, columns]
        Largest values by band, which choose the classes of the colours.
    grid : Grid
        Of the peaks.
    min_depth : float [m]
        Depths up to this are not drawn.
    release : sequence of shapely polygons

    Returns
    -------
    Player
    """
    with needed_for("the player of the flow", "player"):
        from bokeh.resources import Resources

    with np.errstate(invalid="ignore"):
        view = map_view(terrain, grid, peaks["h_max"] > min_depth, release)
    row, column = np.divmod(played.cells, played.grid.shape[1])
    window = row.min(), row.max(), column.min(), column.max()
    (west, east), (north, south) = played.grid.xy(
        np.array([window[0] - 0.5, window[1] + 0.5]), np.array([window[2] - 0.5, window[3] + 0.5])
    )
    rows, columns = int(window[1] - window[0] + 1), int(window[3] - window[2] + 1)
    places = (window[1] - row) * columns + column - window[2]  # rows from the south, as the browser draws them
    apart = min((step for step in np.diff(played.times) if step > 0), default=1.0)
    decimals = 0 if all(time == round(time) for time in played.times) else max(1, math.ceil(-math.log10(apart)))
    content = {
        "times": [f"{time:.{decimals}f}" for time in played.times],
        "shape": [rows, columns],
        "bounds": list(map(float, (west, south, east, north))),
        "cells": _text(zlib.compress(places.astype("<i4").tobytes(), 9)),
        "none": NO_VALUE,
        "bands": [_band(played, peaks, min_depth, *band) for band in BANDS if band[0] in played.steps],
    }
    drawing = _drawing(terrain, view, release, content["bounds"], played.times)
    switches = "".join(
        f'<label><input type="radio" name="player-band" value="{k}"{"" if k else " checked"}> {band["word"]}</label> '
        for k, band in enumerate(content["bands"])
    )
    last = len(played.times) - 1
    markup = f"""<div class="player">
<noscript>The player needs JavaScript; the maps below do not.</noscript>
<p><button type="button" id="player-play">Play</button>
<input type="range" id="player-step" min="0" max="{last}" value="0" aria-label="time">
<output id="player-time"></output> {switches}</p>
<p id="player-legend"></p>
<p id="player-value">Click on the flow for its depth and speed at a place.</p>
<div id="player-map"></div>
<p class="under">{escape(_rounding(content["bands"]))}</p>
{Resources(mode="inline", components=["bokeh"]).render_js()}
<script type="application/json" id="player-content">{_json(content)}</script>
<script type="application/json" id="player-drawing">{_json(drawing)}</script>
<script>
{SCRIPT.read_text(encoding="utf-8")}</script>
</div>"""
    return Player(markup)


def _band(played, peaks, min_depth, name, peak, word):
    """What the browser needs to know of a band."""
    look, precision = LOOKS[name], played.precisions[name]
    largest = peaks.get(peak, np.zeros((1, 1)))
    classes = classes_of(largest, LOOKS[peak], min_depth if look.shown == "depth" else 0.0)
    return {
        "word": word,
        "words": look.words,
        "unit": look.unit,
        "precision": precision,
        "decimals": max(0, round(-math.log10(precision))),
        "classes": [_class(entry) for entry in classes],
        "steps": [_text(step) for step in played.steps[name]],
    }


def _class(entry: ColourClass) -> dict[str, Any]:
    upper = None if math.isinf(entry.upper) else entry.upper
    return {"upper": upper, "colour": entry.colour, "label": entry.label, "opacity": OPACITY}


def _rounding(bands):
    steps = " and ".join(f"{band['word']} to {band['precision']:g} {band['unit']}" for band in bands)
    return f"Values are those of the maps' cells, {steps}."


def _drawing(terrain, view, release, bounds, times):
    """The map and the curve as an item that Bokeh embeds."""
    from bokeh.embed import json_item
    from bokeh.layouts import column
    from bokeh.models import ColumnDataSource, CustomJS, CustomJSTickFormatter, LinearColorMapper, Range1d, Span
    from bokeh.palettes import Greys256
    from bokeh.plotting import figure

    west, south, east, north = view
    per_metre = min(LARGEST[0] / (east - west), LARGEST[1] / (north - south))
    where = figure(
        frame_width=round(per_metre * (east - west)),
        frame_height=round(per_metre * (north - south)),
        x_range=Range1d(west, east),
        y_range=Range1d(south, north),
        tools="pan,wheel_zoom,box_zoom,reset",
        x_axis_label="Easting (m)",
        y_axis_label="Northing (m)",
        name="map",
    )
    relief = view_relief(terrain, view, SHADE_PIXELS)
    finer = max(SHADE_PIXELS / max(relief.shade.shape), 1.0)
    shade = np.clip(zoom(np.nan_to_num(relief.shade, nan=1.0), finer, grid_mode=True, mode="nearest"), 0.0, 1.0)
    shade = np.rint(255 * shade).astype(np.uint8)[::-1]
    left, right, low, high = relief.extent
    greys = LinearColorMapper(palette=Greys256, low=0, high=255)
    where.image([shade], left, low, right - left, high - low, color_mapper=greys)
    _draw_contours(where, view_relief(terrain, view, CONTOUR_PIXELS))
    flow = ColumnDataSource({"image": [np.zeros((1, 1), np.uint32)]}, name="flow")
    where.image_rgba("image", bounds[0], bounds[1], bounds[2] - bounds[0], bounds[3] - bounds[1], source=flow)
    parts = [part for polygon in release for part in getattr(polygon, "geoms", [polygon])]
    x, y = ([np.asarray(part.exterior.coords)[:, axis].tolist() for part in parts] for axis in (0, 1))
    where.multi_line(x, y, color=RELEASE_COLOUR, line_width=2)
    place = ColumnDataSource({"x": [], "y": []}, name="place")
    where.scatter("x", "y", source=place, size=9, fill_color="white", line_color="black", line_width=2)
    where.js_on_event(
        "tap", CustomJS(code="document.dispatchEvent(new CustomEvent('player-tap', {detail: [cb_obj.x, cb_obj.y]}))")
    )
    where.axis.formatter = CustomJSTickFormatter(code=TICKS)
    where.xgrid.visible = where.ygrid.visible = False
    size = {"frame_width": CURVE[0], "frame_height": CURVE[1]}
    over_time = figure(title=" ", x_axis_label="time (s)", tools="", toolbar_location=None, name="curve", **size)
    curve = ColumnDataSource({"time": list(times), "value": [math.nan] * len(times)}, name="values")
    over_time.line("time", "value", source=curve, color=INK, line_width=2)
    over_time.add_layout(Span(location=times[0], dimension="height", line_color=RELEASE_COLOUR, name="now"))
    over_time.x_range, over_time.y_range = Range1d(times[0], times[-1]), Range1d(0.0, 1.0)
    where.toolbar.logo = None
    return json_item(column(where, over_time))


def _draw_contours(where, relief):
    known = np.isfinite(relief.heights)
    span = float(np.ptp(relief.heights[known])) if known.any() else 0.0
    if span > 0:
        interval = contour_interval(span)
        levels = interval * np.arange(
            math.floor(relief.heights[known].min() / interval), math.ceil(relief.heights[known].max() / interval) + 1
        )
        heights = np.ma.masked_invalid(relief.heights[::-1])
        look = {"line_color": CONTOUR_COLOUR, "line_alpha": 0.5, "line_width": 0.5}
        where.contour(relief.x, relief.y[::-1], heights, levels, **look)


def _text(data):
    return base64.b64encode(data).decode("ascii")


def _json(content):
    return json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")
