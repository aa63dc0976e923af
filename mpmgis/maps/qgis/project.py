"""Write the QGIS project of an exported run.

Written with the standard library. Undocumented requirements of QGIS (found by tests): a CRS in every layer, layer ids
of more than 10 characters, `ProjectionsEnabled` for the project CRS, times in whole seconds, and the list of a mesh's
groups before its renderer settings. All paths are relative, so the folder can be moved.
"""

import re
import zipfile
from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np

from ...system.errors import InputError
from ..averaging.exported_folder import ExportedRun
from .map_clock import Clock, stamp
from .moving_layers import MOVING, animation_group, layers_group, vector_layer
from .outlines import layer_names
from .print_layout import parameter_facts, print_layout
from .project_layers import (
    TERRAIN_COLOUR,
    Group,
    Layer,
    elevation,
    ground_rows,
    layer_id,
    layers_of,
    map_layer,
    project_elevation,
    raster_layer,
    surface_layer,
    tree_row,
    without_copies,
)
from .raster_styles import contour_interval, hillshade_pipe
from .xml_markup import filled, qgis_document, reference_system

FIRST_SHOWN = ("release", "envelope")  # so that the first view shows where the flow starts and goes


def write_project(run: ExportedRun, qgis_min: str = "3.38") -> None:
    """Write the project: animation, maxima, last step, outlines and terrain, with styles, times and a map title.

    Parameters
    ----------
    run : ExportedRun
        With its rasters, stacks, mesh and outlines written; a missing mesh or outline is skipped.
    qgis_min : str
        Oldest QGIS version that must animate every layer; depth, arrows and outline move in all of them.

    Raises
    ------
    InputError
        `qgis_min` is not a version, or older than 3.22.
    """
    version = parse_version(qgis_min)
    clock = Clock.of(run.times)
    groups = [
        animation_group(run, clock, version),
        _outlines(run),
        _maxima(run),
        _last_step(run),
        layers_group(run, clock),
        _bed(run),
        _terrain(run),
    ]
    write_archive(run, _project(run, clock, [group for group in groups if group.rows]))


def write_archive(run: ExportedRun, project: Element) -> None:
    """Write a project as .qgz into the run's folder.

    Parameters
    ----------
    run : ExportedRun
    project : Element
    """
    with zipfile.ZipFile(run.folder / run.project_file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(f"{run.name}.qgs", qgis_document(project))


def parse_version(text: str) -> tuple[int, int]:
    """Return the major and minor number of a QGIS version.

    Parameters
    ----------
    text : str

    Raises
    ------
    InputError
        Invalid, or older than 3.22.
    """
    match = re.fullmatch(r"(\d+)\.(\d+)(\.\d+)?", str(text).strip())
    if match is None or (int(match[1]), int(match[2])) < (3, 22):
        raise InputError(f"--qgis-min {text}: expected a QGIS version from 3.22 on, for example 3.22 or 3.38")
    return int(match[1]), int(match[2])


def _outlines(run):
    names = [name for name in layer_names(run.folder / run.outlines_file) if name not in MOVING]
    rows = [vector_layer(run, name, shown=name in FIRST_SHOWN) for name in names]
    return Group("release and envelope", rows[::-1], unfolded=False)


def _rows(run, kind, file, bands):
    """A layer for each band of a raster except copies; the first one is shown."""
    shown = without_copies(run, bands)
    return [
        raster_layer(run, kind, file, quantity, n, shown=n == 1)
        for n, quantity in enumerate(bands, start=1)
        if quantity in shown
    ]


def _maxima(run):
    rows = _rows(run, "maxima", run.maxima_file, run.maxima_bands)
    return Group(f"{run.name}: maxima over all steps", rows, shown=False, unfolded=False, exclusive=True)


def _last_step(run):
    rows = _rows(run, run.end.file, run.last_file, run.last_bands)
    return Group(f"{run.name}: {run.end.words()}", rows, shown=False, unfolded=False, exclusive=True)


def _terrain(run):
    """The terrain with the highest surface of the flow above it."""
    group = terrain_group(run)
    heights = run.read_terrain()
    surface = surface_layer(run, float(np.nanmax(heights) - np.nanmin(heights)) if np.isfinite(heights).any() else 0.0)
    return group if surface is None else group._replace(rows=[surface, *group.rows])


def _bed(run):
    """Eroded depth, rate and deposit, over the ground that is left as a hillshade; nothing without erosion."""
    rows = _rows(run, "bed", run.bed_file, run.bed_bands)
    if rows:
        title = "ground at the end (hillshade)"
        layer = map_layer(run, "raster", "surface_new", run.ground_file, title, "gdal", None, hillshade_pipe())
        rows.append(Layer(title, layer, False))
    return Group(f"{run.name}: bed change (last step)", rows, shown=False, unfolded=False)


def terrain_group(run: ExportedRun) -> Group:
    """Return the group of contours over a hillshade.

    Parameters
    ----------
    run : ExportedRun
    """
    heights = run.read_terrain()
    heights = heights[np.isfinite(heights)]
    interval = contour_interval(float(np.ptp(heights)) if heights.size else 0.0)
    rows = ground_rows(run, run.shown_terrain_file, interval)
    rows[-1].maplayer.append(elevation(TERRAIN_COLOUR))
    return Group("terrain", rows, unfolded=False)


def _project(run, clock, groups):
    times, view = {"start": stamp(clock.begins[0]), "end": stamp(clock.ends[-1])}, _view(run)
    parts = [filled("project_times.xml", step=clock.step, **times), project_elevation(run, "terrain_1")]
    page = _page(run, view, groups)
    return project_document(
        run,
        groups,
        view,
        map_title(run, clock, groups),
        parts if page is None else [*parts, page],
        corner=emptier_corner(run),
        controller=[filled("time_controller.xml", **times)],
    )


def _page(run, view, groups):
    """The print layout: largest depth, envelope and release over the terrain; None without a largest depth."""
    layers = {layer.maplayer.findtext("id"): layer for group in groups for layer in layers_of(group)}
    wanted = ("vector_release", "vector_envelope", "maxima_h_max", "terrain_0", "terrain_1")
    names = [layer_id(run, part) for part in wanted]
    rows = [layers[name]._replace(unfolded="_terrain_" not in name) for name in names if name in layers]
    if layer_id(run, "maxima_h_max") not in layers:
        return None
    title = f"{run.name}: largest flow depth, t = {run.times[0]:g} to {run.times[-1]:g} s"
    contours = next((row.title for row in rows if row.title.startswith("contours")), "")
    return print_layout(run, view, Group("map", rows), title, _facts(run, contours), run.author)


def _facts(run, contours):
    """(name, text) of the parameters of a run, from its record and from the tags of the maxima."""
    tags, known = run.tags(run.maxima_file), dict(run.facts)
    density = {"density": f"{_short(tags['density'])} kg/m3"} if "density" in tags else {}
    drawn = {
        "maxima": "of the {}",
        "cs_e": "cells of {} m",
        "min_depth": "shown from {} m on",
        "percentile": "from the {}th percentile of the particles",
    }
    whole = _short(tags.get("percentile", "")) == "100"
    shown = [text.format(_short(tags[key])) for key, text in drawn.items() if tags.get(key)]
    return (
        *parameter_facts({**density, **known}),
        ("Largest depth", "; ".join(shown[:-1] if whole else shown)),
        ("Terrain", "; ".join(filter(None, [tags.get("dem", ""), contours]))),
        ("Run", "; ".join(filter(None, [known.get("ended", ""), tags.get("digest") and f"scene {tags['digest']}"]))),
        ("Numerical errors", known.get("numerical errors", "")),
    )


def _short(text):
    """A tag's text; a number without needless decimals."""
    return text.removesuffix(".0")


def project_document(
    run: ExportedRun,
    groups: list[Group],
    view: tuple,
    title: str,
    parts: Sequence[Element] = (),
    corner: int = 0,
    controller: Sequence[Element] = (),
) -> Element:
    """Return the element `qgis` of a project.

    Parameters
    ----------
    run : object
        With a name and a grid.
    groups : list of Group
    view : (float, float, float, float) [m]
        West, south, east, north of the initial view.
    title : str
        Of the map.
    parts : sequence of Element
        Additional children, for example `ProjectTimeSettings`.
    corner : int
        Of the scale bar, 0 lower left, 3 lower right.
    controller : sequence of Element
        Settings of the temporal controller.
    """
    west, south, east, north = map(repr, view)
    return filled(
        "project.qgs",
        name=run.name,
        crs=reference_system(run.grid.crs),
        tree=map(tree_row, groups),
        layers=(layer.maplayer for group in groups for layer in layers_of(group)),
        west=west,
        south=south,
        east=east,
        north=north,
        label=title,
        corner=corner,
        controller=controller,
        parts=parts,
    )


def _view(run, margin=0.1):
    """(west, south, east, north) [m] around the cells with flow; the whole grid without flow.

    The margin has room for title and scale bar (some 50 of 700 pixels), so that they are not over the flow.
    """
    (peak,) = run.read(run.maxima_file, ("h_max",))
    row, column = np.nonzero(peak >= run.min_depth)
    if row.size == 0:
        return run.grid.bounds
    shape = int(row.max() - row.min()) + 1, int(column.max() - column.min()) + 1
    x, y = run.flow_grid.part(row.min(), column.min(), shape).corners().T
    rim = margin * max(np.ptp(x), np.ptp(y))
    return float(x.min() - rim), float(y.min() - rim), float(x.max() + rim), float(y.max() + rim)


def emptier_corner(run: ExportedRun) -> int:
    """Return the QGIS number of the lower corner with less flow beside it: 0 left, 3 right.

    Parameters
    ----------
    run : ExportedRun
    """
    (peak,) = run.read(run.maxima_file, ("h_max",))
    x, y = run.flow_grid.xy(*np.nonzero(peak >= run.min_depth))
    if x.size == 0:
        return 0
    low = y < y.min() + np.ptp(y) / 3
    right = x[low] > 0.5 * (x.min() + x.max())
    return 0 if np.mean(right) >= 0.5 else 3


def map_title(run: ExportedRun, clock: Clock, groups: list[Group]) -> str:
    """Return the text of the map title with an expression of QGIS: the run's name, and what is shown.

    The time of the step that is shown while a moving layer is visible; else that maxima or the last step are shown.

    Parameters
    ----------
    run : ExportedRun
    clock : Clock
    groups : list of Group
        The moving layers first.
    """
    moving, still = layers_of(groups[0]), {group.title: layers_of(group) for group in groups[1:]}
    parts = [
        f"WHEN {_visible(moving)} AND @map_start_time IS NOT NULL THEN 't = ' || {_shown_time(run, clock)} || ' s'"
    ]
    for title, layers in still.items():
        if title.startswith(run.name):
            words = title.removeprefix(f"{run.name}: ").replace("'", "''")
            parts.append(f"WHEN {_visible(layers)} THEN '{words}'")
    return f"{run.name}   [% CASE {' '.join(parts)} ELSE '' END %]"


def _visible(layers):
    """Expression: whether any of the layers is on the map."""
    ids = ",".join(f"'{layer.maplayer.findtext('id')}'" for layer in layers)
    return f"array_length(array_filter(array({ids}), array_contains(@map_layer_ids, @element))) > 0"


def _shown_time(run, clock):
    """Expression: time [s] of the last step at or before the frame, as the layers show it."""
    frame = "(epoch(@map_start_time) - epoch(make_datetime(2000,1,1,0,0,0))) / 1000.0"
    if len(set(np.diff(clock.begins))) <= 1:
        return f"format_number({frame} / {clock.stretch}, {clock.decimals})"
    begins = ",".join(map(str, clock.begins))
    last = f"coalesce(array_last(array_filter(array({begins}), @element <= {frame} + 0.5)), {clock.begins[0]})"
    return f"format_number({last} / {float(clock.stretch)}, {clock.decimals})"
