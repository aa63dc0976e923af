"""Raster styles for QGIS: renderers, and a .qml file for every raster.

Class limits are the same for all steps of a run, so that frames can be compared.
"""

import math
from collections.abc import Iterator
from xml.etree.ElementTree import Element

import numpy as np

from ...laws.quantities import Quantity
from ..averaging.exported_folder import ExportedRun
from .colours import OPACITY, Look, colour_classes, look_of, round_up
from .map_clock import Clock, stamp
from .xml_markup import node, options, qgis_document


def value_renderer(look: Look, typical: float, min_depth: float, band: int) -> Element:
    """Return the element `rasterrenderer` of one band: classes, or a symmetric ramp for signed values.

    Parameters
    ----------
    look : Look
    typical : float
        Typical largest value, in the band's unit.
    min_depth : float [m]
    band : int
        From 1.
    """
    shader = value_shader(look, typical, min_depth)
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


def value_shader(look: Look, typical: float, min_depth: float) -> Element:
    """Return the element `colorrampshader` of a band: classes, or a symmetric ramp for signed values.

    Parameters
    ----------
    look : Look
    typical : float
    min_depth : float [m]
        These three as in `value_renderer`.
    """
    return _signed_shader(look, typical) if look.shown == "signed" else _class_shader(look, typical, min_depth)


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
    """Return the element `colorramp` with which the user can edit the colours.

    Parameters
    ----------
    ramp : tuple of str
        Colours, #rrggbb.
    """
    rgb = [",".join(str(int(c[i : i + 2], 16)) for i in (1, 3, 5)) + ",255" for c in ramp]
    stops = ":".join(f"{k / (len(ramp) - 1):.6g};{rgb[k]}" for k in range(1, len(ramp) - 1))
    values = {"color1": rgb[0], "color2": rgb[-1], "discrete": "0", "rampType": "gradient", "stops": stops}
    return node("colorramp", {"name": "[source]", "type": "gradient"}, *options(values))


def value_pipe(quantity: Quantity, run: ExportedRun, band: int) -> Element:
    """Return the element `pipe` that draws a band with the colours of the whole run.

    Parameters
    ----------
    quantity : Quantity
    run : ExportedRun
    band : int
        Number of the band in its file, from 1.
    """
    typical = run.typical.get(quantity.name, 0.0)
    return node("pipe", None, value_renderer(look_of(quantity), typical, run.min_depth, band))


def hillshade_pipe() -> Element:
    """Return the element `pipe` of a terrain as a multidirectional hillshade, light under other colours."""
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
        node("brightnesscontrast", {"brightness": 70, "contrast": -20, "gamma": 1}),
        node("resamplingStage", text="provider"),
    )


def contour_interval(relief: float) -> float:
    """Return the contour interval [m] (1, 2 or 5 times a power of ten) that gives 15 to 40 lines.

    Parameters
    ----------
    relief : float [m]
        Highest minus lowest elevation.
    """
    return round_up(relief / 40.0)


def contour_pipe(interval: float) -> Element:
    """Return the element `pipe` of a terrain as contour lines, every fifth one thicker.

    Parameters
    ----------
    interval : float [m]
    """
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
    """Return the element `temporal` of a stack: band k + 1 is visible from step k to the next (QGIS 3.38 and later).

    Parameters
    ----------
    clock : Clock
    """
    ranges = [
        node("range", {"band": k, "begin": stamp(begin), "end": stamp(end), "includeBeginning": 1, "includeEnd": 0})
        for k, (begin, end) in enumerate(zip(clock.begins, clock.ends, strict=True), start=1)
    ]
    return node("temporal", {"enabled": 1, "mode": 3, "fetchMode": 0, "bandNumber": 1}, node("ranges", None, *ranges))


def one_step(clock: Clock, k: int) -> Element:
    """Return the element `temporal` of a layer that is visible during one step only, 1 s apart from other steps.

    Every QGIS version shows it.

    Parameters
    ----------
    clock : Clock
    k : int
        Number of the step.
    """
    start, end = clock.begins[k], clock.ends[k]
    fixed = node("fixedRange", None, node("start", text=stamp(start + 1)), node("end", text=stamp(end - 1)))
    return node("temporal", {"enabled": 1, "mode": 0, "fetchMode": 0}, fixed)


def style_document(pipe: Element, temporal: Element | None = None) -> str:
    """Return the text of a .qml file for a raster.

    Parameters
    ----------
    pipe : Element
    temporal : Element, optional
    """
    root = node("qgis", {"version": "3.22.0", "styleCategories": "AllStyleCategories"}, temporal, pipe)
    root.append(node("blendMode", text=0))
    return qgis_document(root)


def write_styles(run: ExportedRun) -> None:
    """Write a .qml next to each raster of a run: steps, maxima, last step, stacks and terrain.

    Each raster shows its first band, layers of height the pressure of the lowest; all bands of a kind have the limits
    of the run. QGIS ignores times in a style that it loads automatically; they are for Load Style.

    Parameters
    ----------
    run : ExportedRun
    """
    clock = Clock.of(run.times)
    for file, text in raster_styles(run):
        write_sidecar(run, file, text)
    for quantity in (*run.step_bands, *run.layer_bands):
        pipe = value_pipe(quantity, run, 1)
        write_sidecar(run, run.stack_file(quantity), style_document(pipe, bands_over_time(clock)))


def raster_styles(run: ExportedRun) -> Iterator[tuple[str, str]]:
    """Yield the style of each raster of a run except stacks.

    Parameters
    ----------
    run : ExportedRun

    Yields
    ------
    (str, str)
        Name of the raster, text of its .qml.
    """
    step = style_document(value_pipe(run.step_bands[0], run, 1))
    yield from ((file, step) for file in run.step_files)
    yield run.maxima_file, style_document(value_pipe(run.maxima_bands[0], run, 1))
    yield run.last_file, style_document(value_pipe(run.last_bands[0], run, 1))
    yield from (
        (file, style_document(hillshade_pipe())) for file in dict.fromkeys((run.terrain_file, run.shown_terrain_file))
    )
    yield from ((file, style_document(value_pipe(run.layer_bands[1], run, 2))) for file in run.layer_files)
    if run.bed_bands:
        yield run.bed_file, style_document(value_pipe(run.bed_bands[0], run, 1))
        yield run.ground_file, style_document(hillshade_pipe())


def write_sidecar(run: ExportedRun, file: str, text: str) -> None:
    """Write a style next to one of the run's files.

    Parameters
    ----------
    run : ExportedRun
        Or another object with a folder.
    file : str
    text : str
    """
    (run.folder / file).with_suffix(".qml").write_text(text, encoding="utf-8", newline="\n")
