"""Print layout of a QGIS project: an A4 page with map, title, legend, scale bar, source and parameters."""

from typing import NamedTuple
from uuid import NAMESPACE_URL, uuid5
from xml.etree.ElementTree import Element

from ..averaging.exported_folder import ExportedRun
from .colours import round_up
from .project_layers import Group, tree_row
from .xml_markup import node

PAGE = (297.0, 210.0)  # [mm] A4, landscape
MAP = (10.0, 22.0, 205.0, 162.0)  # [mm] left, top, width, height
COLUMN = (219.0, 68.0)  # [mm] left and width of the legend's column
BAR = 22.0  # [mm] shortest half of the scale bar
INK = {"red": 0, "green": 0, "blue": 0, "alpha": 255}
WHITE = {"red": 255, "green": 255, "blue": 255, "alpha": 255}
FONT = "Open Sans,{size},-1,5,{weight},0,0,0,0,0"  # description of a font of Qt


class Kind(NamedTuple):
    """Type numbers of layout items."""

    page: int = 65638
    map: int = 65639
    label: int = 65641
    legend: int = 65642
    scale_bar: int = 65646


KIND = Kind()


def print_layout(run: ExportedRun, view: tuple, rows: Group, title: str, notes: str) -> Element:
    """Return the element `Layouts` with one page that is ready to export.

    Parameters
    ----------
    run : object
        With a name.
    view : (float, float, float, float) [m]
        West, south, east, north that the map has to show.
    rows : Group
        Layers of the map and of its legend, the uppermost first. The map keeps them, whatever the project shows.
    title, notes : str
        Above and below the map.
    """
    extent = _fitted(view, MAP[2] / MAP[3])
    left, width = COLUMN
    items = [
        _label("title", title, (MAP[0], 8.0, 277.0, 11.0), 18, 75),
        _map(run, extent, rows),
        _legend(run, rows, (left, MAP[1], width, 110.0)),
        _label("north", "N\n\u25b2", (left + width - 9.0, 168.0, 8.0, 14.0), 12, 75),
        _scale_bar(run, (left, 170.0, width - 12.0, 14.0), (extent[2] - extent[0]) / MAP[2]),
        _label("notes", notes, (MAP[0], 187.0, 277.0, 18.0), 8, 50),
    ]
    pages = node("PageCollection", None, _item(KIND.page, "page", (0.0, 0.0, *PAGE), {"background": "true"}))
    for height, item in enumerate(reversed(items), start=1):
        item.set("zValue", str(height))
    head = {"name": f"{run.name}: A4", "units": "mm", "printResolution": 300, "worldFileMap": ""}
    return node("Layouts", None, node("Layout", head, pages, *items))


def _fitted(view, aspect):
    """The smallest extent around `view` with the map's ratio of sides."""
    west, south, east, north = view
    width = max(east - west, (north - south) * aspect)
    x, y = 0.5 * (west + east), 0.5 * (south + north)
    return x - width / 2, y - width / aspect / 2, x + width / 2, y + width / aspect / 2


def _item(kind, name, box, more, *children):
    """`LayoutItem` in a box (left, top, width, height) [mm]."""
    left, top, width, height = box
    place = {"position": f"{left:g},{top:g},mm", "positionOnPage": f"{left:g},{top:g},mm"}
    usual = {"type": kind, "id": name, "size": f"{width:g},{height:g},mm", "visibility": 1, "opacity": 1}
    frame = {"referencePoint": 0, "frame": "false", "background": "false", "outlineWidthM": "0.3,mm"}
    return node(
        "LayoutItem", usual | place | frame | more, node("FrameColor", INK), node("BackgroundColor", WHITE), *children
    )


def _identifier(run):
    """The map's identifier, to which legend and scale bar refer."""
    return f"{{{uuid5(NAMESPACE_URL, f'mpmgis/{run.name}/map')}}}"


def _map(run, extent, rows):
    corners = dict(zip(("xmin", "ymin", "xmax", "ymax"), map(repr, extent), strict=True))
    own = {"uuid": _identifier(run), "keepLayerSet": "true", "frame": "true", "background": "true"}
    own |= {"followPreset": "false", "isTemporal": 0, "mapRotation": 0, "drawCanvasItems": "true"}
    layers = [
        node(
            "Layer",
            {
                "name": row.title,
                "source": row.maplayer.findtext("datasource"),
                "provider": row.maplayer.findtext("provider"),
            },
            text=row.maplayer.findtext("id"),
        )
        for row in rows.rows
    ]
    return _item(KIND.map, "map", MAP, own, node("Extent", corners), node("LayerSet", None, *layers))


def _legend(run, rows, box):
    own = {"map_uuid": _identifier(run), "resizeToContents": 1, "title": "", "symbolWidth": 7, "symbolHeight": 4}
    own |= {"boxSpace": 0, "columnCount": 1, "legendFilterByAtlas": 0, "wrapChar": ""}
    sizes = {"title": 11, "group": 9, "subgroup": 9, "symbol": 8, "symbolLabel": 8}
    styles = [
        node(
            "style",
            {
                "name": name,
                "alignment": 1,
                "marginTop": 2.5 if name in ("subgroup", "symbol") else 1.2,
                "marginLeft": 2,
            },
            node("styleFont", {"description": FONT.format(size=size, weight=75 if name == "subgroup" else 50)}),
        )
        for name, size in sizes.items()
    ]
    tree = node("layer-tree-group", None, *(tree_row(row) for row in rows.rows if row.unfolded))
    return _item(KIND.legend, "legend", box, own, node("styles", None, *styles), tree)


def _label(name, text, box, size, weight):
    font = node("LabelFont", {"description": FONT.format(size=size, weight=weight), "style": ""})
    own = {"labelText": text, "halign": 4 if name == "north" else 1, "valign": 32, "htmlState": 0}
    return _item(KIND.label, name, box, own | {"marginX": 0, "marginY": 0}, font, node("FontColor", INK))


def _scale_bar(run, box, metres):
    """A bar of two halves of a round length; `metres` of the ground are 1 mm of the map."""
    half = round_up(BAR * metres)
    half = half if half <= 2.0 * BAR * metres else half / 2
    unit, size = ("km", 1000) if half >= 1000 else ("m", 1)
    own = {"mapUuid": _identifier(run), "style": "Single Box", "unitType": "meters", "unitLabel": unit}
    own |= {"numMapUnitsPerScaleBarUnit": size, "numUnitsPerSegment": f"{half:g}", "numSegments": 2}
    own |= {"numSegmentsLeft": 0, "segmentSizeMode": 0, "height": 2, "labelBarSpace": 1.5, "boxContentSpace": 1}
    own |= {"outlineWidth": 0.3, "alignment": 0, "labelVerticalPlacement": 0, "labelHorizontalPlacement": 0}
    colours = [node("fillColor", INK), node("fillColor2", WHITE), node("strokeColor", INK)]
    text = {
        "fontFamily": "Open Sans",
        "fontSize": 8,
        "fontSizeUnit": "Point",
        "textColor": "0,0,0,255",
        "textOpacity": 1,
    }
    return _item(KIND.scale_bar, "scale bar", box, own, node("text-style", text), *colours)
