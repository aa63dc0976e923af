"""The QGIS project of an exported run.

Written with the standard library. Undocumented requirements of QGIS (found by tests): a CRS in every layer, layer ids
of more than 10 characters, `ProjectionsEnabled` for the project CRS, times in whole seconds, and the list of a mesh's
groups before its renderer settings. All paths are relative, so the folder can be moved.
"""

import re
import zipfile
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from ..errors import InputError
from ..fields import Quantity
from ..io.exported import ExportedRun
from .clock import BASE_TEXT, Clock, stamp
from .markup import node, qgis_document, reference_system
from .mesh import VELOCITY, group_names
from .outlines import geometry_type, layer_names, vector_renderer
from .styles import bands_over_time, contour_interval, contour_pipe, hillshade_pipe, look_of, one_step, value_pipe
from .symbols import feature_times

TIME_BY_BAND = (3, 38)  # first QGIS version that animates the bands of one layer
FRAME_RATE = 8  # frames per second in the temporal controller
ARROW_GRID = 18  # pixels between velocity arrows on the screen
VECTOR_TITLES = {
    "outline": "outline of the flow",
    "envelope": "envelope of all steps",
    "release": "release area",
    "particles": "particles (thinned), by speed",
}
MOVING = ("outline", "particles")


class Layer(NamedTuple):
    """One row of the layer list: its `maplayer` element and its initial visibility."""

    title: str
    maplayer: Element
    shown: bool = False
    unfolded: bool = False


class Group(NamedTuple):
    """A group of rows (Layer or Group); `exclusive`: only one row is visible at a time."""

    title: str
    rows: list
    shown: bool = True
    unfolded: bool = True
    exclusive: bool = False


def write_project(run: ExportedRun, qgis_min: str = "3.38") -> None:
    """Write the project: animation, maxima, deposit, outlines and terrain, with styles, times and a map title.

    Parameters
    ----------
    run : ExportedRun
        With its rasters, stacks, mesh and outlines written; a missing mesh or outline is skipped.
    qgis_min : str
        Oldest QGIS version that must animate it. From 3.38 on a variable is one layer with time by band; below, one
        layer per step and variable.

    Raises
    ------
    InputError
        `qgis_min` is not a version, or older than 3.22.
    """
    by_band = parse_version(qgis_min) >= TIME_BY_BAND
    clock = Clock.of(run.times)
    groups = [
        _animation(run, clock, by_band),
        _outlines(run),
        _maxima(run),
        _deposit(run),
        terrain_group(run),
    ]
    write_archive(run, _project(run, clock, [group for group in groups if group.rows]))


def write_archive(run: ExportedRun, project: Element) -> None:
    """Write the project element as .qgz into the run's folder."""
    with zipfile.ZipFile(run.folder / run.project_file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(f"{run.name}.qgs", qgis_document(project))


def parse_version(text: str) -> tuple[int, int]:
    """(major, minor) of a QGIS version; InputError if it is invalid or older than 3.22."""
    match = re.fullmatch(r"(\d+)\.(\d+)(\.\d+)?", str(text).strip())
    if match is None or (int(match[1]), int(match[2])) < (3, 22):
        raise InputError(f"--qgis-min {text}: expected a QGIS version from 3.22 on, for example 3.22 or 3.38")
    return int(match[1]), int(match[2])


def _animation(run, clock, by_band):
    vectors = [
        _vector_layer(run, name, shown=name == "outline")
        for name in layer_names(run.folder / run.outlines_file)
        if name in MOVING
    ]
    fields = [
        (_stacked_layer if by_band else _steps_group)(run, clock, quantity, band, shown=band == 1)
        for band, quantity in enumerate(run.step_bands, start=1)
    ]
    return Group(f"{run.name}: animation ({clock.label})", [*_arrows(run, clock), *vectors, *fields])


def _outlines(run):
    names = [name for name in layer_names(run.folder / run.outlines_file) if name not in MOVING]
    rows = [_vector_layer(run, name, shown=name == "release") for name in names]
    return Group("release and envelope", rows[::-1], unfolded=False)


def _maxima(run):
    rows = [
        raster_layer(run, "maxima", run.maxima_file, quantity, band, shown=band == 1)
        for band, quantity in enumerate(run.maxima_bands, start=1)
    ]
    return Group(f"{run.name}: maxima over all steps", rows, shown=False, unfolded=False, exclusive=True)


def _deposit(run):
    rows = [
        raster_layer(run, "deposit", run.deposit_file, quantity, band, shown=band == 1)
        for band, quantity in enumerate(run.deposit_bands, start=1)
    ]
    return Group(f"{run.name}: deposit (last step)", rows, shown=False, unfolded=False, exclusive=True)


def terrain_group(run: ExportedRun) -> Group:
    """Group of contours over a hillshade."""
    heights = run.read_terrain()
    heights = heights[np.isfinite(heights)]
    interval = contour_interval(float(np.ptp(heights)) if heights.size else 0.0)
    pipes = {f"contours every {interval:g} m": contour_pipe(interval), "hillshade": hillshade_pipe()}
    rows = [
        Layer(title, map_layer(run, "raster", f"terrain_{k}", run.terrain_file, title, "gdal", None, pipe), True)
        for k, (title, pipe) in enumerate(pipes.items())
    ]
    return Group("terrain", rows, unfolded=False)


def _stacked_layer(run, clock, quantity, band, shown):
    title = look_of(quantity).title(quantity.name)
    maplayer = map_layer(
        run,
        "raster",
        f"animation_{quantity.name}",
        run.stack_file(quantity),
        title,
        "gdal",
        bands_over_time(clock),
        value_pipe(quantity, run, 1),
    )
    return Layer(title, maplayer, shown, unfolded=shown)


def _steps_group(run, clock, quantity, band, shown):
    """A group with one layer per step, animated by every QGIS since 3.14."""
    rows = []
    for k, file in enumerate(run.step_files):
        title = f"{quantity.name} at t = {run.times[k]:.{clock.decimals}f} s"
        part = f"step_{quantity.name}_{k:04d}"
        pipe = value_pipe(quantity, run, band)
        rows.append(Layer(title, map_layer(run, "raster", part, file, title, "gdal", one_step(clock, k), pipe), True))
    return Group(look_of(quantity).title(quantity.name), rows, shown=shown, unfolded=False)


def raster_layer(run: ExportedRun, kind: str, file: str, quantity: Quantity, band: int, shown: bool) -> Layer:
    """Layer of one band of a raster, in the colours of `quantity`."""
    title = look_of(quantity).title(quantity.name)
    pipe = value_pipe(quantity, run, band)
    return Layer(
        title, map_layer(run, "raster", f"{kind}_{quantity.name}", file, title, "gdal", None, pipe), shown, shown
    )


def _vector_layer(run, name, shown):
    maplayer = map_layer(
        run,
        "vector",
        f"vector_{name}",
        f"{run.outlines_file}|layername={name}",
        VECTOR_TITLES[name],
        "ogr",
        feature_times() if name in MOVING else None,
        vector_renderer(name, run),
    )
    maplayer.set("geometry", geometry_type(name)[1])
    return Layer(VECTOR_TITLES[name], maplayer, shown)


def _arrows(run, clock):
    """The mesh as arrows only; no layer without a mesh or a velocity vector."""
    names = group_names(run.folder / run.mesh_file)
    if VELOCITY not in names:
        return []
    temporal = node(
        "temporal",
        {
            "temporal-active": 1,
            "matching-method": 0,
            "reference-time": BASE_TEXT,
            "start-time-extent": stamp(clock.begins[0]),
            "end-time-extent": stamp(clock.ends[-1]),
        },
    )
    vector = names.index(VELOCITY)
    arrow = node(
        "vector-arrow-settings",
        {"arrow-head-width-ratio": 0.3, "arrow-head-length-ratio": 0.4},
        node("shaft-length", {"method": "minmax", "min": 1, "max": 6}),
    )
    drawn = {
        "group": vector,
        "symbology": 0,
        "line-width": 0.3,
        "color": "20,20,20,255",
        "coloring-method": 0,
        "filter-min": -1,
        "filter-max": -1,
        "user-grid-enabled": 1,
        "user-grid-width": ARROW_GRID,
        "user-grid-height": ARROW_GRID,
    }
    settings = node(
        "mesh-renderer-settings",
        None,
        node("active-dataset-group", {"scalar": -1, "vector": vector}),
        node("vector-settings", drawn, arrow),
    )
    title = "velocity arrows"
    maplayer = map_layer(run, "mesh", "mesh_velocity", run.mesh_file, title, "mdal", temporal, settings)
    maplayer.extend(node("name-to-global-index", {"name": n, "global-index": k}) for k, n in enumerate(names))
    return [Layer(title, maplayer, True)]


def map_layer(
    run: ExportedRun,
    kind: str,
    part: str,
    source: str,
    title: str,
    provider: str,
    temporal: Element | None,
    drawing: Element,
) -> Element:
    """`maplayer` element; `part` is used in its id, `drawing` is its pipe or renderer. `run` has a name and a grid."""
    return node(
        "maplayer",
        {"type": kind, "styleCategories": "AllStyleCategories"},
        node("id", text=_layer_id(run, part)),
        node("datasource", text=f"./{source}"),
        node("layername", text=title),
        node("srs", None, reference_system(run.grid.crs)),
        node("provider", {"encoding": "UTF-8"} if provider == "ogr" else None, text=provider),
        temporal,
        drawing,
        node("blendMode", text=0),
    )


def _layer_id(run, part):
    """A layer id for QGIS (more than 10 characters), unique for several runs in one project."""
    return "mpmgis_" + re.sub(r"\W+", "_", f"{run.name}_{part}", flags=re.ASCII)


def _project(run, clock, groups):
    start, end = stamp(clock.begins[0]), stamp(clock.ends[-1])
    times = {"timeStep": clock.step, "timeStepUnit": "s", "frameRate": FRAME_RATE, "cumulativeTemporalRange": 0}
    settings = node(
        "ProjectTimeSettings", times, node("TemporalRange", None, node("start", text=start), node("end", text=end))
    )
    return project_document(run, groups, _view(run), _animation_settings(run, clock, start, end), settings)


def project_document(
    run: ExportedRun, groups: list[Group], view: tuple, settings: dict, times: Element | None = None
) -> Element:
    """`qgis` element of a project.

    Parameters
    ----------
    run : object
        With a name and a grid.
    groups : list of Group
    view : (float, float, float, float) [m]
        West, south, east, north of the initial view.
    settings : dict
        Additional settings for `_properties`.
    times : Element, optional
        `ProjectTimeSettings`.
    """
    west, south, east, north = view
    corners = {"xmin": west, "ymin": south, "xmax": east, "ymax": north}
    canvas = node(
        "mapcanvas",
        {"name": "theMapCanvas"},
        node("units", text="meters"),
        node("extent", None, *(node(side, text=repr(value)) for side, value in corners.items())),
        node("destinationsrs", None, reference_system(run.grid.crs)),
    )
    return node(
        "qgis",
        {"version": "3.22.0", "projectname": run.name},
        node("title", text=run.name),
        node("projectCrs", None, reference_system(run.grid.crs)),
        node("layer-tree-group", None, *(_tree(group) for group in groups)),
        canvas,
        node("projectlayers", None, *(layer.maplayer for group in groups for layer in _layers(group))),
        _properties(settings),
        node(
            "ProjectViewSettings",
            {"UseProjectScales": 0},
            node("DefaultViewExtent", corners, reference_system(run.grid.crs)),
        ),
        times,
    )


def _view(run, margin=0.08):
    """(west, south, east, north) [m] around the cells with flow; the whole grid without flow."""
    (peak,) = run.read(run.maxima_file, ("h_max",))
    row, column = np.nonzero(peak >= run.min_depth)
    if row.size == 0:
        return run.grid.bounds
    shape = int(row.max() - row.min()) + 1, int(column.max() - column.min()) + 1
    x, y = run.flow_grid.part(row.min(), column.min(), shape).corners().T
    rim = margin * max(np.ptp(x), np.ptp(y))
    return float(x.min() - rim), float(y.min() - rim), float(x.max() + rim), float(y.max() + rim)


def _layers(group):
    """All layers below a group, in order."""
    for row in group.rows:
        yield from _layers(row) if isinstance(row, Group) else (row,)


def _tree(row):
    """`layer-tree-group` or `layer-tree-layer` of a row."""
    shown = {"checked": "Qt::Checked" if row.shown else "Qt::Unchecked", "expanded": int(row.unfolded)}
    if isinstance(row, Layer):
        maplayer = row.maplayer
        named = {"id": maplayer.findtext("id"), "name": row.title, "source": maplayer.findtext("datasource")}
        return node("layer-tree-layer", named | {"providerKey": maplayer.findtext("provider")} | shown)
    choice = {"mutually-exclusive": 1, "mutually-exclusive-child": 0} if row.exclusive else {}
    return node("layer-tree-group", {"name": row.title} | shown | choice, *(_tree(child) for child in row.rows))


def _animation_settings(run, clock, start, end):
    """Settings of an animated project: temporal controller, and simulated time in the map title."""
    elapsed = "(epoch(@map_start_time) - epoch(make_datetime(2000,1,1,0,0,0)))"
    label = f"{run.name}   t = [% format_number({elapsed} / 1000.0 / {clock.stretch}, {clock.decimals}) %] s"
    return title_settings(label) | {
        "TemporalControllerWidget": {
            "NavigationMode": ("int", 1),
            "StartDateTime": ("QString", start),
            "EndDateTime": ("QString", end),
        },
    }


def title_settings(label: str) -> dict:
    """Settings of a map title."""
    return {
        "TitleLabel": {
            "Enabled": ("bool", "true"),
            "Placement": ("int", 4),
            "BackgroundColor": ("QString", "255,255,255,200"),
            "Label": ("QString", label),
        },
    }


def _properties(more):
    """Project settings: CRS in use, relative paths, scale bar, and `more`, {scope: {key: (type, value)}}."""
    settings = {
        "SpatialRefSys": {"ProjectionsEnabled": ("int", 1)},
        "Paths": {"Absolute": ("bool", "false")},
        "ScaleBar": {"Enabled": ("bool", "true"), "Placement": ("int", 0)},
        **more,
    }
    return node(
        "properties",
        None,
        *(
            node(scope, None, *(node(key, {"type": kind}, text=value) for key, (kind, value) in entries.items()))
            for scope, entries in settings.items()
        ),
    )
