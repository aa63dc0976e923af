"""Print layout of a QGIS project: an A4 page with map, title, legend, scale bar, source and parameters."""

from uuid import NAMESPACE_URL, uuid5
from xml.etree.ElementTree import Element

from ..averaging.exported_folder import ExportedRun
from .colours import round_up
from .project_layers import Group, tree_row
from .xml_markup import filled, node

MAP = (205.0, 162.0)  # [mm] width and height in the template
BAR = 22.0  # [mm] shortest half of the scale bar


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
    west, south, east, north = extent = _fitted(view, MAP[0] / MAP[1])
    half, unit, size = _scale_bar((east - west) / MAP[0])
    west, south, east, north = map(repr, extent)
    return filled(
        "layout.qpt",
        name=run.name,
        title=title,
        notes=notes,
        map=f"{{{uuid5(NAMESPACE_URL, f'mpmgis/{run.name}/map')}}}",  # to which legend and scale bar refer
        west=west,
        south=south,
        east=east,
        north=north,
        layers=(_layer(row) for row in rows.rows),
        tree=(tree_row(row) for row in rows.rows if row.unfolded),
        half=f"{half:g}",
        unit=unit,
        size=size,
    )


def _fitted(view, aspect):
    """The smallest extent around `view` with the map's ratio of sides."""
    west, south, east, north = view
    width = max(east - west, (north - south) * aspect)
    x, y = 0.5 * (west + east), 0.5 * (south + north)
    return x - width / 2, y - width / aspect / 2, x + width / 2, y + width / aspect / 2


def _layer(row):
    """A layer that the map keeps."""
    source, provider = row.maplayer.findtext("datasource"), row.maplayer.findtext("provider")
    named = {"name": row.title, "source": source, "provider": provider}
    return node("Layer", named, text=row.maplayer.findtext("id"))


def _scale_bar(metres):
    """(half, unit, unit [m]): a bar has two halves of a round length; `metres` of the ground are 1 mm of the map."""
    half = round_up(BAR * metres)
    half = half if half <= 2.0 * BAR * metres else half / 2
    return (half, "km", 1000) if half >= 1000 else (half, "m", 1)
