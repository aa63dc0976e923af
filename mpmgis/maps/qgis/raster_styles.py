"""Raster styles for QGIS: renderers, and a .qml file for every raster.

Class limits are the same for all steps of a run, so that frames can be compared.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from xml.etree.ElementTree import Element

import numpy as np

from ...laws.quantities import Quantity
from ..averaging.exported_folder import ExportedRun
from .colours import OPACITY, Look, colour_classes, fitting_classes, look_of, round_up
from .map_clock import Clock, stamp
from .xml_markup import filled, node, qgis_document

CLASS_OPACITY = 0.8  # [1] of whole numbers over the hillshade
WHOLE = 255  # alpha of an opaque colour


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
    rgb = [",".join(str(int(c[i : i + 2], 16)) for i in (1, 3, 5)) + ",255" for c in look.ramp]
    stops = ":".join(f"{k / (len(rgb) - 1):.6g};{rgb[k]}" for k in range(1, len(rgb) - 1))
    given = {"band": band, "opacity": layer_opacity(OPACITY), "first": rgb[0], "last": rgb[-1], "stops": stops}
    if look.shown == "signed":
        bound = round_up(typical * look.factor) / look.factor
        given |= {"lowest": f"{-bound:g}", "highest": f"{bound:g}", "unit": look.unit.partition(";")[0]}
        style = filled("signed.qml", items=_ramp_items(look, bound), **given)
    else:
        classes = colour_classes(look, typical, min_depth)
        style = filled("classes.qml", items=_class_items(classes), highest=f"{classes[-2].upper:g}", **given)
    return next(style.iter("rasterrenderer"))


def value_shader(look: Look, typical: float, min_depth: float) -> Element:
    """Return the element `colorrampshader` of a band: classes, or a symmetric ramp for signed values.

    Parameters
    ----------
    look : Look
    typical : float
    min_depth : float [m]
        These three as in `value_renderer`.
    """
    return next(value_renderer(look, typical, min_depth, 1).iter("colorrampshader"))


def layer_opacity(opacity: float) -> float:
    """Return the part of an opacity that a layer has; its colours have the other part.

    The list of layers shows the opacity of the colours only, a legend in print that of the layer only: with equal parts
    both are as near to the map as they can be.

    Parameters
    ----------
    opacity : float [1]
        On the map.
    """
    return float(f"{math.sqrt(opacity):.3g}")


def _alpha(opacity):
    return round(WHOLE * opacity / layer_opacity(opacity))


def _class_items(classes):
    """Yield the items of classes: each is an upper bound, the last one infinite."""
    for entry in classes:
        upper = "inf" if math.isinf(entry.upper) else f"{entry.upper:g}"
        drawn = {"color": entry.colour or "#ffffff", "alpha": _alpha(OPACITY) if entry.colour else 0}
        yield node("item", {"value": upper} | drawn | {"label": entry.label})


def _ramp_items(look, bound):
    """Yield the items of a continuous ramp that is symmetric about zero."""
    for value, colour in zip(np.linspace(-bound, bound, len(look.ramp)), look.ramp, strict=True):
        label = f"{value * look.factor:.3g}"
        yield node("item", {"value": f"{value:.9g}", "color": colour, "alpha": _alpha(OPACITY), "label": label})


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
    return node("pipe", None, value_renderer(look_of(quantity, run.classes), typical, run.min_depth, band))


def with_classes(run: ExportedRun, chosen: Mapping[str, tuple]) -> ExportedRun:
    """Return a run with limits of its classes: those chosen, and of depths that crowd in the last usual class.

    Parameters
    ----------
    run : ExportedRun
        With its maxima written.
    chosen : dict of str to tuple of float
        By quantity.
    """
    peaks = {name: run.read(run.maxima_file, (f"{name}_max",))[0] for name in ("h", "t") if name not in chosen}
    depths = {name: values[values > run.min_depth] for name, values in peaks.items() if values is not None}
    return replace(run, classes=fitting_classes(chosen, depths))


def hillshade_pipe() -> Element:
    """Return the element `pipe` of a terrain as a multidirectional hillshade, light under other colours."""
    return next(filled("hillshade.qml").iter("pipe"))


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
    style = filled("contours.qml", interval=f"{interval:g}", index=f"{5 * interval:g}")
    return next(style.iter("pipe"))


def class_pipe(classes: Iterable[tuple]) -> Element:
    """Return the element `pipe` of a band of whole numbers: a colour for each.

    Parameters
    ----------
    classes : iterable of (int, str, str)
        Number, label, colour #rrggbb.
    """
    entries = (
        node("paletteEntry", {"value": number, "color": colour, "alpha": _alpha(CLASS_OPACITY), "label": label})
        for number, label, colour in classes
    )
    return next(filled("palette.qml", entries=entries, opacity=layer_opacity(CLASS_OPACITY)).iter("pipe"))


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
