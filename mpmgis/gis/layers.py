"""Layers and groups of a QGIS project: `maplayer` elements, and their rows in the layer list.

Undocumented requirements of QGIS (found by tests): a CRS in every layer, and layer ids of more than 10 characters.
"""

import re
from collections.abc import Iterator
from typing import NamedTuple
from xml.etree.ElementTree import Element

from ..fields import Quantity
from ..io.exported import ExportedRun
from .colours import look_of
from .markup import node, reference_system
from .styles import value_pipe


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


def raster_layer(run: ExportedRun, kind: str, file: str, quantity: Quantity, band: int, shown: bool) -> Layer:
    """Layer of one band of a raster, in the colours of `quantity`."""
    title = look_of(quantity).layer_name(quantity.name)
    pipe = value_pipe(quantity, run, band)
    return Layer(
        title, map_layer(run, "raster", f"{kind}_{quantity.name}", file, title, "gdal", None, pipe), shown, shown
    )


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
    """A layer id for QGIS (more than 10 characters), unique for several runs in one project."""
    return "mpmgis_" + re.sub(r"\W+", "_", f"{run.name}_{part}", flags=re.ASCII)


def layers_of(group: Group) -> Iterator[Layer]:
    """All layers below a group, in order."""
    for row in group.rows:
        yield from layers_of(row) if isinstance(row, Group) else (row,)


def tree_row(row: Layer | Group) -> Element:
    """`layer-tree-group` or `layer-tree-layer` of a row."""
    shown = {"checked": "Qt::Checked" if row.shown else "Qt::Unchecked", "expanded": int(row.unfolded)}
    if isinstance(row, Layer):
        maplayer = row.maplayer
        named = {"id": maplayer.findtext("id"), "name": row.title, "source": maplayer.findtext("datasource")}
        named |= {"providerKey": maplayer.findtext("provider")} | shown
        return node("layer-tree-layer", named, legend_entries(maplayer))
    choice = {"mutually-exclusive": 1, "mutually-exclusive-child": 0} if row.exclusive else {}
    return node("layer-tree-group", {"name": row.title} | shown | choice, *(tree_row(child) for child in row.rows))


def legend_entries(maplayer: Element) -> Element | None:
    """`customproperties` of a row: the legend entries that are shown.

    Entry 0 is the name of the band or dataset, of a raster over time always that of the first one ("h at t = 0 s"); it
    is left out, as are values that are not drawn.
    """
    shader = maplayer.find(".//colorrampshader")
    if shader is None:
        return None
    drawn = [int(item.get("alpha")) > 0 for item in shader.findall("item")]
    drawn = [True] if shader.get("colorRampType") == "INTERPOLATED" else drawn  # one bar
    order = ",".join(str(k) for k, seen in enumerate(drawn, start=1) if seen)
    entry = {"type": "QString", "name": "legend/node-order", "value": order}
    return node("customproperties", None, node("Option", {"type": "Map"}, node("Option", entry)))
