"""Raster styles for QGIS: classes, colours and renderers, and a .qml file for every raster.

Class limits are the same for all steps of a run, so that frames can be compared. Colours are hex values, because the
direction of a colour map differs between its releases (Crameri 2018, doi:10.5281/zenodo.1243862, MIT licence). Limits
and colour maps are those of AvaFrame, for comparison of results.
"""

import math
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from ..fields import Quantity
from ..io.exported import ExportedRun
from .clock import Clock, stamp
from .markup import node, options, qgis_document

LAJOLLA = ("#fffecb", "#f3ca5f", "#e79452", "#d85f4d", "#8f403d", "#442817", "#191900")
BATLOW = ("#011959", "#144d62", "#3c6d56", "#818232", "#d29343", "#fdac9e", "#faccfa")
BATLOW_REVERSED = BATLOW[::-1]
HAWAII_REVERSED = ("#b3f2fd", "#5fe2bd", "#80c55f", "#9c951c", "#996330", "#94384d", "#8c0273")
VIK = ("#001261", "#06548b", "#71a8c4", "#ece5e0", "#d39774", "#a94512", "#590008")

DEPTH_LIMITS = (0.5, 1, 2, 3, 4, 5)  # [m]
SPEED_LIMITS = (1, 5, 10, 15, 20, 25, 30)  # [m/s]
PRESSURE_LIMITS = (1, 10, 25, 50, 100)  # [kPa]
PROBABILITY_LIMITS = (0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9)
OPACITY = 0.8  # of a flow over the hillshade


class Look(NamedTuple):
    """Display style of one band.

    `words`: name in the layer list; `unit`: displayed unit, with values `factor` times the band's; `ramp`: colours from
    low to high; `limits`: hazard classes in `unit` (empty: classes of the run); `shown`: "depth" (hidden below the
    smallest depth), "size" (hidden at zero), "rate" (shown from zero) or "signed" (symmetric about zero).
    """

    words: str
    unit: str
    ramp: tuple
    shown: str
    limits: tuple = ()
    factor: float = 1.0

    def title(self, name: str) -> str:
        """Layer name: words, symbol and unit."""
        return f"{self.words} {name}" + (f" ({self.unit})" if self.unit else "")


NORMAL_SIGN = "+ away from it, - into it"
LOOKS = {
    "h": Look("flow depth (normal)", "m", LAJOLLA, "depth", DEPTH_LIMITS),
    "t": Look("flow thickness (normal)", "m", LAJOLLA, "depth", DEPTH_LIMITS),
    "Un": Look("velocity normal to the slope", f"m/s; {NORMAL_SIGN}", VIK, "signed"),
    "Ut": Look("speed along the slope", "m/s", BATLOW_REVERSED, "rate", SPEED_LIMITS),
    "Ut_E": Look("velocity along the slope, to the east", "m/s", VIK, "signed"),
    "Ut_N": Look("velocity along the slope, to the north", "m/s", VIK, "signed"),
    "t_vol": Look("thickness by volume (normal)", "m", LAJOLLA, "depth", DEPTH_LIMITS),
    "n": Look("number of particles", "", LAJOLLA, "size"),
    "mass": Look("mass per plan area", "kg/m2", LAJOLLA, "size"),
    "p": Look("impact pressure", "kPa", HAWAII_REVERSED, "rate", PRESSURE_LIMITS, 1e-3),
    "detached": Look("clear of the bed", "1: yes", HAWAII_REVERSED, "size", (1,)),
    "h_max": Look("largest flow depth (normal)", "m", LAJOLLA, "depth", DEPTH_LIMITS),
    "t_max": Look("largest flow thickness (normal)", "m", LAJOLLA, "depth", DEPTH_LIMITS),
    "Un_max": Look("largest velocity away from the slope", "m/s", VIK, "signed"),
    "Un_min": Look("largest velocity into the slope", "m/s; negative", VIK, "signed"),
    "Ut_max": Look("largest speed along the slope", "m/s", BATLOW_REVERSED, "rate", SPEED_LIMITS),
    "p_max": Look("largest impact pressure", "kPa", HAWAII_REVERSED, "rate", PRESSURE_LIMITS, 1e-3),
    "t_arrival": Look("time of arrival", "s", BATLOW, "rate"),
}


PROBABILITY = "P_"  # prefix of probability bands


def look_of(quantity: Quantity) -> Look:
    """The Look of a band; a band outside the table is shown by size.

    Probabilities have their own classes; an ensemble statistic (`h_mean`, `p_p95`) has the look of its quantity.
    """
    if quantity.name.startswith(PROBABILITY):
        return Look(quantity.long_name, "", HAWAII_REVERSED, "size", PROBABILITY_LIMITS)
    of = LOOKS.get(quantity.name.rpartition("_")[0])
    plain = Look(quantity.long_name, quantity.unit.replace(" s-1", "/s"), LAJOLLA, "size")
    return LOOKS.get(quantity.name, plain if of is None else of._replace(words=quantity.long_name))


def class_limits(look: Look, typical: float) -> tuple:
    """Upper limits of all classes except the last, in the look's unit, for values up to `typical` (the band's unit).

    The hazard classes if the run reaches the third limit and stays below twice the last; else six classes up to the
    next 1, 2 or 5 times a power of ten.
    """
    reached = typical * look.factor
    hazard = look.limits
    if hazard and (len(hazard) < 3 or hazard[2] <= reached <= 2 * hazard[-1]):
        return hazard
    top = round_up(reached)
    return tuple(float(f"{top * share:.6g}") for share in (0.1, 0.2, 0.4, 0.6, 0.8, 1.0))


def round_up(value: float) -> float:
    """The next 1, 2 or 5 times a power of ten at or above `value`; 1 if `value` is not positive or not finite."""
    if not 1e-300 < value < 1e300:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return float(f"{next(m for m in (1, 2, 5, 10) if value <= m * power * (1 + 1e-9)) * power:.6g}")


def ramp_colours(ramp: tuple, count: int) -> list[str]:
    """`count` hex colours spread evenly over a ramp, ends included."""
    stops = np.array([[int(colour[i : i + 2], 16) for i in (1, 3, 5)] for colour in ramp], dtype=float)
    at = np.linspace(0, len(ramp) - 1, count)
    channels = [np.interp(at, np.arange(len(ramp)), stops[:, k]) for k in range(3)]
    return ["#" + "".join(f"{round(c):02x}" for c in colour) for colour in zip(*channels, strict=True)]


class ColourClass(NamedTuple):
    """One legend class: values up to `upper` [the band's unit] in `colour` (None: transparent)."""

    upper: float
    colour: str | None
    label: str


def colour_classes(look: Look, typical: float, min_depth: float = 0.0) -> list[ColourClass]:
    """List of ColourClass for all values of a band, from a transparent class (if any) to "> limit"."""
    limits = class_limits(look, typical)
    floor = min_depth if look.shown == "depth" and min_depth < limits[0] else 0.0
    classes = [] if look.shown == "rate" else [ColourClass(floor, None, f"up to {floor:g} (not drawn)")]
    lowest = f"{floor:g}"
    for limit, colour in zip((*limits, math.inf), ramp_colours(look.ramp, len(limits) + 1), strict=True):
        unit = look.unit.partition(";")[0]
        label = f"> {lowest} {unit}" if math.isinf(limit) else f"{lowest} - {limit:g} {unit}"
        classes.append(ColourClass(limit / look.factor, colour, label.strip()))
        lowest = f"{limit:g}"
    return classes


def value_renderer(look: Look, typical: float, min_depth: float, band: int) -> Element:
    """`rasterrenderer` of one band: classes, or a symmetric ramp for signed values."""
    shader = _signed_shader(look, typical) if look.shown == "signed" else _class_shader(look, typical, min_depth)
    return node(
        "rasterrenderer",
        {
            "type": "singlebandpseudocolor",
            "band": band,
            "opacity": OPACITY,
            "alphaBand": -1,
            "nodataColor": "",
            "classificationMin": shader.get("minimumValue"),
            "classificationMax": shader.get("maximumValue"),
        },
        node(
            "minMaxOrigin",
            None,
            node("limits", text="None"),
            node("extent", text="WholeRaster"),
            node("statAccuracy", text="Exact"),
        ),
        node("rastershader", None, shader),
    )


def _class_shader(look, typical, min_depth):
    """`colorrampshader` of classes: each item is an upper bound, the last one infinite."""
    classes = colour_classes(look, typical, min_depth)
    shader = node(
        "colorrampshader",
        {
            "colorRampType": "DISCRETE",
            "classificationMode": 1,
            "clip": 0,
            "minimumValue": 0,
            "maximumValue": f"{classes[-2].upper:g}",
            "labelPrecision": 2,
        },
        gradient(look.ramp),
    )
    for entry in classes:
        shader.append(
            node(
                "item",
                {
                    "value": "inf" if math.isinf(entry.upper) else f"{entry.upper:g}",
                    "color": entry.colour or "#ffffff",
                    "alpha": 255 if entry.colour else 0,
                    "label": entry.label,
                },
            )
        )
    return shader


def _signed_shader(look, typical):
    """`colorrampshader` of a continuous ramp that is symmetric about zero, with a bar as its legend."""
    bound = round_up(typical * look.factor) / look.factor
    shader = node(
        "colorrampshader",
        {
            "colorRampType": "INTERPOLATED",
            "classificationMode": 1,
            "clip": 0,
            "minimumValue": f"{-bound:g}",
            "maximumValue": f"{bound:g}",
            "labelPrecision": 2,
        },
        gradient(look.ramp),
    )
    for value, colour in zip(np.linspace(-bound, bound, len(look.ramp)), look.ramp, strict=True):
        label = f"{value * look.factor:.3g}"
        shader.append(node("item", {"value": f"{value:.9g}", "color": colour, "alpha": 255, "label": label}))
    legend = {
        "useContinuousLegend": 1,
        "orientation": 2,
        "direction": 0,
        "minimumLabel": "",
        "maximumLabel": "",
        "prefix": "",
        "suffix": f" {look.unit.partition(';')[0]}",
    }
    shader.append(node("rampLegendSettings", legend))
    return shader


def gradient(ramp: tuple) -> Element:
    """`colorramp` with which the user can edit the colours."""
    rgb = [",".join(str(int(c[i : i + 2], 16)) for i in (1, 3, 5)) + ",255" for c in ramp]
    stops = ":".join(f"{k / (len(ramp) - 1):.6g};{rgb[k]}" for k in range(1, len(ramp) - 1))
    values = {"color1": rgb[0], "color2": rgb[-1], "discrete": "0", "rampType": "gradient", "stops": stops}
    return node("colorramp", {"name": "[source]", "type": "gradient"}, *options(values))


def value_pipe(quantity: Quantity, run: ExportedRun, band: int) -> Element:
    """`pipe` that draws `quantity`, band number `band` of its file, with the colours of the whole run."""
    typical = run.typical.get(quantity.name, 0.0)
    return node("pipe", None, value_renderer(look_of(quantity), typical, run.min_depth, band))


def hillshade_pipe() -> Element:
    """`pipe` of a terrain as a light multidirectional hillshade, so that colours on top stay readable."""
    return node(
        "pipe",
        None,
        _smooth_heights(),
        node(
            "rasterrenderer",
            {
                "type": "hillshade",
                "band": 1,
                "azimuth": 315,
                "angle": 45,
                "zfactor": 1,
                "multidirection": 1,
                "opacity": 1,
                "alphaBand": -1,
                "nodataColor": "",
            },
        ),
        node("brightnesscontrast", {"brightness": 40, "contrast": -15, "gamma": 1}),
        node("resamplingStage", text="provider"),
    )


def contour_interval(relief: float) -> float:
    """Contour interval [m] (1, 2 or 5 times a power of ten) with 15 to 40 lines over `relief` [m]."""
    return round_up(relief / 40.0)


def contour_pipe(interval: float) -> Element:
    """`pipe` of a terrain as contour lines every `interval` [m], every fifth one thicker."""
    return node(
        "pipe",
        None,
        _smooth_heights(),
        node(
            "rasterrenderer",
            {
                "type": "contour",
                "band": 1,
                "contour-interval": f"{interval:g}",
                "contour-index-interval": f"{5 * interval:g}",
                "downscale": 4,
                "opacity": 0.6,
                "alphaBand": -1,
                "nodataColor": "",
            },
            node("symbols", None, _contour_symbol("contour", 0.1), _contour_symbol("index", 0.25)),
        ),
        node("resamplingStage", text="provider"),
    )


def _smooth_heights():
    """`provider` part of a pipe that interpolates heights between cells, for smooth display when zoomed in."""
    methods = {"zoomedInResamplingMethod": "cubic", "zoomedOutResamplingMethod": "bilinear"}
    return node("provider", None, node("resampling", {"enabled": "true", "maxOversampling": 2} | methods))


def _contour_symbol(name, width):
    line = {"line_color": "90,70,50,255", "line_width": width, "line_width_unit": "MM"}
    layer = node("layer", {"class": "SimpleLine", "enabled": 1, "pass": 0, "locked": 0}, *options(line))
    return node("symbol", {"type": "line", "name": name, "alpha": 1}, layer)


def bands_over_time(clock: Clock) -> Element:
    """`temporal` of a stack: band k + 1 is visible from step k to the next (QGIS 3.38 and later)."""
    ranges = [
        node(
            "range",
            {"band": k, "begin": stamp(begin), "end": stamp(end), "includeBeginning": 1, "includeEnd": 0},
        )
        for k, (begin, end) in enumerate(zip(clock.begins, clock.ends, strict=True), start=1)
    ]
    return node("temporal", {"enabled": 1, "mode": 3, "fetchMode": 0, "bandNumber": 1}, node("ranges", None, *ranges))


def one_step(clock: Clock, k: int) -> Element:
    """`temporal` of a layer that is visible during step k only, 1 s apart from other steps (all QGIS versions)."""
    start, end = clock.begins[k], clock.ends[k]
    fixed = node("fixedRange", None, node("start", text=stamp(start + 1)), node("end", text=stamp(end - 1)))
    return node("temporal", {"enabled": 1, "mode": 0, "fetchMode": 0}, fixed)


def style_document(pipe: Element, temporal: Element | None = None) -> str:
    """Text of a .qml file for a raster."""
    root = node("qgis", {"version": "3.22.0", "styleCategories": "AllStyleCategories"}, temporal, pipe)
    root.append(node("blendMode", text=0))
    return qgis_document(root)


def write_styles(run: ExportedRun) -> None:
    """Write a .qml next to each raster of `run`: steps, maxima, deposit, stacks and terrain.

    Each raster shows its first band; all bands of a kind have the limits of the run. QGIS ignores times in a style
    that it loads automatically; they are for Load Style.
    """
    clock = Clock.of(run.times)
    step = style_document(value_pipe(run.step_bands[0], run, 1))
    for file in run.step_files:
        write_sidecar(run, file, step)
    write_sidecar(run, run.maxima_file, style_document(value_pipe(run.maxima_bands[0], run, 1)))
    write_sidecar(run, run.deposit_file, style_document(value_pipe(run.deposit_bands[0], run, 1)))
    write_sidecar(run, run.terrain_file, style_document(hillshade_pipe()))
    for quantity in run.step_bands:
        pipe = value_pipe(quantity, run, 1)
        write_sidecar(run, run.stack_file(quantity), style_document(pipe, bands_over_time(clock)))


def write_sidecar(run: ExportedRun, file: str, text: str) -> None:
    """Write a style next to one of the run's files."""
    (run.folder / file).with_suffix(".qml").write_text(text, encoding="utf-8", newline="\n")
