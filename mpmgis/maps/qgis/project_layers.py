"""Layers, groups and elevations of a QGIS project: `maplayer` elements, their rows in the list, the flow's surface.

Undocumented requirements of QGIS (found by tests): a CRS in every layer, and layer ids of more than 10 characters.
"""

import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from ...laws.quantities import Quantity
from ...terrain.raster_output import write_geotiff
from ..averaging.exported_folder import ExportedRun
from .colours import look_of
from .raster_styles import contour_interval, contour_pipe, hillshade_pipe, style_document, value_pipe, write_sidecar
from .xml_markup import filled, node, reference_system

SURFACE = Quantity("surface", "m", "highest surface of the flow: terrain and largest flow depth", "float32")
TITLE = "surface max [m]: terrain and largest flow depth"
TERRAIN_COLOUR = "90,70,50,255"  # brown, of the terrain in the profile tool
SURFACE_COLOUR = "190,60,50,255"  # red, of the surface of the flow there


class Layer(NamedTuple):
    """One row of the layer list.

    Parameters
    ----------
    title : str
    maplayer : Element
    shown, unfolded : bool
        At first.
    """

    title: str
    maplayer: Element
    shown: bool = False
    unfolded: bool = False


class Group(NamedTuple):
    """A group of rows of the layer list.

    Parameters
    ----------
    title : str
    rows : list of Layer or Group
    shown, unfolded : bool
        At first.
    exclusive : bool
        Only one row is visible at a time.
    """

    title: str
    rows: list
    shown: bool = True
    unfolded: bool = True
    exclusive: bool = False


def raster_layer(run: ExportedRun, kind: str, file: str, quantity: Quantity, band: int, shown: bool) -> Layer:
    """Return the layer of one band of a raster, in the colours of its quantity.

    Parameters
    ----------
    run : ExportedRun
    kind : str
        Beginning of the layer's id.
    file : str
    quantity : Quantity
    band : int
        From 1.
    shown : bool
        At first.
    """
    title = look_of(quantity).layer_name(quantity.name)
    pipe = value_pipe(quantity, run, band)
    return Layer(
        title, map_layer(run, "raster", f"{kind}_{quantity.name}", file, title, "gdal", None, pipe), shown, shown
    )


def without_copies(run: ExportedRun, bands: Sequence[Quantity]) -> list[Quantity]:
    """Return the bands without the thickness of columns, which is their depth.

    Parameters
    ----------
    run : ExportedRun
    bands : sequence of Quantity
    """
    return [quantity for quantity in bands if not (run.thickness_is_depth and quantity.name in ("t", "t_max"))]


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
    """Return the element `maplayer` of a layer.

    Parameters
    ----------
    run : ExportedRun
        Or another object with a name and a grid.
    kind : {"raster", "vector", "mesh"}
    part : str
        Part of the layer's id.
    source : str
        File, relative to the project.
    title : str
    provider : {"gdal", "ogr", "mdal"}
    temporal : Element or None
        Times of the layer.
    drawing : Element
        Its pipe or renderer.
    """
    return node(
        "maplayer",
        {"type": kind, "styleCategories": "AllStyleCategories"},
        node("id", text=layer_id(run, part)),
        node("datasource", text=f"./{source}"),
        node("layername", text=title),
        node("srs", None, reference_system(run.grid.crs)),
        node("provider", {"encoding": "UTF-8"} if provider == "ogr" else None, text=provider),
        temporal,
        drawing,
        node("blendMode", text=0),
    )


def layer_id(run: ExportedRun, part: str) -> str:
    """Return an id for a layer, unique for several runs in one project.

    Parameters
    ----------
    run : ExportedRun
    part : str

    Returns
    -------
    str
        Of more than 10 characters, as QGIS requires.
    """
    return "mpmgis_" + re.sub(r"\W+", "_", f"{run.name}_{part}", flags=re.ASCII)


def layers_of(group: Group) -> Iterator[Layer]:
    """Yield all layers below a group, in order.

    Parameters
    ----------
    group : Group
    """
    for row in group.rows:
        yield from layers_of(row) if isinstance(row, Group) else (row,)


def tree_row(row: Layer | Group) -> Element:
    """Return the element `layer-tree-group` or `layer-tree-layer` of a row.

    Parameters
    ----------
    row : Layer or Group
    """
    shown = {"checked": "Qt::Checked" if row.shown else "Qt::Unchecked", "expanded": int(row.unfolded)}
    if isinstance(row, Layer):
        maplayer = row.maplayer
        named = {"id": maplayer.findtext("id"), "name": row.title, "source": maplayer.findtext("datasource")}
        named |= {"providerKey": maplayer.findtext("provider")} | shown
        return node("layer-tree-layer", named, legend_entries(maplayer))
    choice = {"mutually-exclusive": 1, "mutually-exclusive-child": 0} if row.exclusive else {}
    return node("layer-tree-group", {"name": row.title} | shown | choice, *(tree_row(child) for child in row.rows))


def legend_entries(maplayer: Element) -> Element | None:
    """Return the element `customproperties` of a row: the legend entries that are shown.

    Entry 0 is the name of the band or dataset, of a raster over time always that of the first one ("h at t = 0 s"); it
    is left out, as are values that are not drawn.

    Parameters
    ----------
    maplayer : Element
    """
    shader = maplayer.find(".//colorrampshader")
    if shader is None:
        return None
    drawn = [int(item.get("alpha")) > 0 for item in shader.findall("item")]
    drawn = [True] if shader.get("colorRampType") == "INTERPOLATED" else drawn  # one bar
    order = ",".join(str(k) for k, seen in enumerate(drawn, start=1) if seen)
    entry = {"type": "QString", "name": "legend/node-order", "value": order}
    return node("customproperties", None, node("Option", {"type": "Map"}, node("Option", entry)))


def ground_rows(run: Any, file: str, interval: float) -> list[Layer]:
    """Return the layers of a raster of elevations: contours over a hillshade.

    Parameters
    ----------
    run : object
        With a name and a grid.
    file : str
    interval : float [m]
        Of the contours; 0 for none.
    """
    pipes = {f"contours every {interval:g} m": contour_pipe(interval)} if interval else {}
    pipes["hillshade"] = hillshade_pipe()
    return [
        Layer(title, map_layer(run, "raster", f"terrain_{k}", file, title, "gdal", None, pipe), True)
        for k, (title, pipe) in enumerate(pipes.items())
    ]


def write_surface(run: ExportedRun) -> None:
    """Write the elevation of the highest flow surface on the cells that the flow reached; without flow, no file.

    The flow depth is measured normal to the bed: its vertical extent is the depth divided by the cosine of the slope.

    Parameters
    ----------
    run : ExportedRun
    """
    (depth,) = run.read(run.maxima_file, ("h_max",))
    if not np.isfinite(depth).any():
        return
    bed = run.read_terrain().astype(float)
    surface = bed + depth / _slope_cosine(bed, run.flow_grid)
    write_geotiff(run.folder / run.surface_file, run.flow_grid, [(SURFACE, surface.astype(np.float32))], {})
    write_sidecar(run, run.surface_file, style_document(hillshade_pipe()))


def _slope_cosine(bed, grid):
    """float64[rows, columns]: vertical part of the bed's unit normal; 1 where a neighbour's elevation is unknown."""
    if min(bed.shape) < 2:
        return np.ones(bed.shape)
    by_row, by_column = np.gradient(bed)
    across = np.linalg.inv(grid.matrix).T @ np.stack([by_column.ravel(), by_row.ravel()])
    return np.nan_to_num(1.0 / np.sqrt(1.0 + (across**2).sum(axis=0)), nan=1.0).reshape(bed.shape)


def surface_layer(run: ExportedRun, relief: float) -> Layer | None:
    """Return the hidden layer of the flow surface as contours, with elevations.

    Parameters
    ----------
    run : ExportedRun
    relief : float [m]
        Highest minus lowest elevation of the terrain.

    Returns
    -------
    Layer or None
        None without the file.
    """
    if not (run.folder / run.surface_file).exists():
        return None
    pipe = contour_pipe(contour_interval(relief))
    maplayer = map_layer(run, "raster", "surface_max", run.surface_file, TITLE, "gdal", None, pipe)
    maplayer.append(elevation(SURFACE_COLOUR))
    return Layer(TITLE, maplayer)


def elevation(colour: str) -> Element:
    """Return the element `elevation` of a raster layer: its first band is a surface, a line in the profile tool.

    Parameters
    ----------
    colour : str
        Of the line: red, green, blue and opacity from 0 to 255, with commas.
    """
    return filled("elevation.xml", colour=colour)


def project_elevation(run: ExportedRun, part: str) -> Element:
    """Return the element `ElevationProperties` of a project: a raster layer is its terrain.

    Parameters
    ----------
    run : ExportedRun
    part : str
        Of the id of the layer.
    """
    return filled("project_terrain.xml", id=layer_id(run, part), source=f"./{run.shown_terrain_file}")
