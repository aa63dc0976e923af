"""Layers of a QGIS project that move: depth and arrows of the mesh, rasters over time, outlines and particles.

A mesh moves in every QGIS from 3.22 on. The bands of a raster move from 3.38 on; below, QGIS shows the first band at
all times without a warning. So a project shows the mesh first, and rasters over time have a group of their own.
"""

from xml.etree.ElementTree import Element

from ...laws.quantities import Quantity
from ..averaging.exported_folder import ExportedRun
from .colours import OPACITY, look_of
from .flow_mesh import MESH_BANDS, VELOCITY, dataset_title, group_names
from .map_clock import BASE_TEXT, Clock, stamp
from .outlines import geometry_type, layer_names, vector_renderer
from .project_layers import Group, Layer, map_layer, without_copies
from .raster_styles import bands_over_time, layer_opacity, one_step, value_pipe, value_shader
from .vector_styles import feature_times
from .xml_markup import filled, node

TIME_BY_BAND = (3, 38)  # first QGIS version that animates the bands of one layer
VECTOR_TITLES = {
    "outline": "outline of the flow",
    "envelope": "envelope of all steps",
    "release": "release area",
    "particles": "particles (thinned), by speed",
}
MOVING = ("outline", "particles")  # layers of the GeoPackage with times


def animation_group(run: ExportedRun, clock: Clock, version: tuple) -> Group:
    """Return the group of all moving layers.

    Parameters
    ----------
    run : ExportedRun
    clock : Clock
    version : (int, int)
        Oldest QGIS version that must animate all of them. From 3.38 on there is a raster over time for each variable;
        below, a mesh layer, or one layer per step for variables that the mesh does not have.
    """
    names = group_names(run.folder / run.mesh_file)
    vectors = [
        vector_layer(run, name, shown=name == "outline")
        for name in layer_names(run.folder / run.outlines_file)
        if name in MOVING
    ]
    meshed = [quantity for quantity in run.step_bands if names and quantity.name in MESH_BANDS]
    by_band = version >= TIME_BY_BAND
    shown = without_copies(run, run.step_bands)
    meshed = [quantity for quantity in meshed if quantity in shown]
    fields = [mesh_layer(run, clock, names, quantity, shown=k == 0) for k, quantity in enumerate(meshed)]
    fields = fields[:1] if by_band else fields
    rest = shown if by_band else [quantity for quantity in shown if quantity not in meshed]
    make = _stacked_layer if by_band else _steps_group
    rasters = [make(run, clock, quantity, shown=not meshed and k == 0) for k, quantity in enumerate(rest)]
    if by_band and meshed:
        rasters = [Group("rasters over time (QGIS 3.38 or later)", rasters, shown=True, unfolded=False)]
    return Group(f"{run.name}: animation ({clock.label})", [*_arrows(run, clock, names), *vectors, *fields, *rasters])


def layers_group(run: ExportedRun, clock: Clock) -> Group:
    """Return the group of density and pressure by height over the bed, over time (QGIS 3.38 or later); empty without.

    Parameters
    ----------
    run : ExportedRun
    clock : Clock
    """
    rows = [_stacked_layer(run, clock, quantity, shown=k == 0) for k, quantity in enumerate(run.layer_bands)]
    return Group(f"{run.name}: layers of height over the bed", rows, shown=False, unfolded=False, exclusive=True)


def vector_layer(run: ExportedRun, name: str, shown: bool) -> Layer:
    """Return a layer of the GeoPackage.

    Parameters
    ----------
    run : ExportedRun
    name : str
        Of the layer.
    shown : bool
        Visible at first.
    """
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


def _stacked_layer(run, clock, quantity, shown):
    title = look_of(quantity).layer_name(quantity.name)
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


def _steps_group(run, clock, quantity, shown):
    """A group with one layer per step, animated by every QGIS since 3.14."""
    rows, band = [], run.step_bands.index(quantity) + 1
    for k, file in enumerate(run.step_files):
        title = f"{quantity.name} at t = {run.times[k]:.{clock.decimals}f} s"
        part = f"step_{quantity.name}_{k:04d}"
        pipe = value_pipe(quantity, run, band)
        rows.append(Layer(title, map_layer(run, "raster", part, file, title, "gdal", one_step(clock, k), pipe), True))
    return Group(look_of(quantity).layer_name(quantity.name), rows, shown=shown, unfolded=False)


def mesh_layer(run: ExportedRun, clock: Clock, names: list[str], quantity: Quantity, shown: bool) -> Layer:
    """Return the layer of a variable of the mesh, cell by cell in the classes of its rasters.

    Parameters
    ----------
    run : ExportedRun
    clock : Clock
    names : list of str
        Of the mesh's groups (`group_names`).
    quantity : Quantity
    shown : bool
        Visible at first.
    """
    look, number = look_of(quantity, run.classes), names.index(dataset_title(run, quantity.name))
    shader = value_shader(look, run.typical.get(quantity.name, 0.0), run.min_depth)
    title = look.layer_name(quantity.name)
    limits = {"lowest": shader.get("minimumValue"), "highest": shader.get("maximumValue")}
    settings = filled("mesh_values.xml", group=number, opacity=layer_opacity(OPACITY), shader=shader, **limits)
    return Layer(title, _mesh(run, clock, names, f"mesh_{quantity.name}", title, settings), shown, unfolded=shown)


def _arrows(run, clock, names):
    """The mesh as arrows only; no layer without a mesh or a velocity vector."""
    if VELOCITY not in names:
        return []
    settings = filled("mesh_arrows.xml", group=names.index(VELOCITY))
    title = "velocity arrows"
    return [Layer(title, _mesh(run, clock, names, "mesh_velocity", title, settings), True)]


def _mesh(run, clock, names, part, title, settings) -> Element:
    """`maplayer` of the mesh; the list of its groups is required, or QGIS ignores the renderer settings."""
    start, end = stamp(clock.begins[0]), stamp(clock.ends[-1])
    temporal = filled("mesh_times.xml", base=BASE_TEXT, start=start, end=end)
    maplayer = map_layer(run, "mesh", part, run.mesh_file, title, "mdal", temporal, settings)
    maplayer.extend(node("name-to-global-index", {"name": n, "global-index": k}) for k, n in enumerate(names))
    return maplayer
