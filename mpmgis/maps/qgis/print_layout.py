"""Print layout of a QGIS project: an A4 page at a usual scale, with map, grid, legend, parameters, date and author."""

import datetime
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING
from uuid import NAMESPACE_URL, uuid5
from xml.etree.ElementTree import Element

from ... import __version__
from .colours import round_up
from .project_layers import Group, tree_row
from .xml_markup import filled, node

if TYPE_CHECKING:
    from pyproj import CRS

    from ..averaging.exported_folder import ExportedRun

MAP = (196.0, 150.0)  # [mm] width and height in the template
BAR = 9.7  # [mm] shortest half of the scale bar; the longest is 2.5 times as long
CROSSES = 40.0  # [mm] least distance of two lines of the grid of coordinates
METRES_PER_MM = 1e-3  # on the map at scale 1
# usual denominators of map scales
SCALES = (500, 1000, 2000, 2500, 5000, 10000, 15000, 20000, 25000, 50000, 100000, 200000, 250000, 500000)
LEGEND_LINE = 38  # characters of a line of the legend
FACT_SIZES = ((7.5, 135, 9), (6.0, 168, 11), (5.0, 200, 13))  # [points], characters of a line, lines below the map
RELEASE = ("release", "thickness", "vertical thickness", "volume", "density")  # facts of the release
NO_AUTHOR = "." * 40  # to be filled in by hand


def print_layout(
    run: "ExportedRun", view: tuple, rows: Group, title: str, facts: Sequence[tuple[str, str]], author: str = ""
) -> Element:
    """Return the element `Layouts` with one page that is ready to export.

    Parameters
    ----------
    run : object
        With a name and a grid.
    view : (float, float, float, float) [m]
        West, south, east, north that the map has to show.
    rows : Group
        Layers of the map and of its legend, the uppermost first. The map keeps them, whatever the project shows.
    title : str
        Above the map.
    facts : sequence of (str, str)
        Parameters below the map: name and text; entries without text are left out.
    author : str
        "": a line to fill in.
    """
    scale = _scale(view)
    points, lines = _fact_lines(facts)
    half, unit, size = _scale_bar(scale * METRES_PER_MM)
    west, south, east, north = map(repr, page_extent(view))
    return filled(
        "layout.qpt",
        name=run.name,
        title=title,
        facts="\n".join(lines),
        points=points,
        signed=_signed(run.grid.crs, author),
        map=f"{{{uuid5(NAMESPACE_URL, f'mpmgis/{run.name}/map')}}}",  # to which legend and scale bar refer
        west=west,
        south=south,
        east=east,
        north=north,
        interval=f"{round_up(CROSSES * scale * METRES_PER_MM):g}",
        layers=(_layer(row) for row in rows.rows),
        tree=(_legend_row(row) for row in rows.rows if row.unfolded),
        half=f"{half:g}",
        unit=unit,
        size=size,
    )


def parameter_facts(known: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return friction and release for the page, name and text.

    Parameters
    ----------
    known : dict of str to str
        Facts of a run or ensemble (`frames.run_facts`).
    """
    parts = [known[name] if name == "release" else f"{name} {known[name]}" for name in RELEASE if name in known]
    return [("Friction", known.get("friction", "")), ("Release", "; ".join(parts))]


def usual_scale(needed: float) -> float:
    """Return the denominator of the largest usual map scale at which a map fits.

    Parameters
    ----------
    needed : float
        Smallest denominator at which it fits.
    """
    return next((float(value) for value in SCALES if value >= needed), round_up(needed))


def _scale(view):
    """Denominator of the largest usual scale at which the map shows `view`."""
    return usual_scale(max((view[2] - view[0]) / MAP[0], (view[3] - view[1]) / MAP[1]) / METRES_PER_MM)


def page_extent(view: tuple) -> tuple[float, float, float, float]:
    """Return west, south, east, north [m] that the page shows around a view.

    Parameters
    ----------
    view : (float, float, float, float) [m]
        West, south, east, north that it has to show.
    """
    scale = _scale(view)
    west, south, east, north = view
    x, y = 0.5 * (west + east), 0.5 * (south + north)
    right, up = (0.5 * side * scale * METRES_PER_MM for side in MAP)
    return x - right, y - up, x + right, y + up


def _fact_lines(facts):
    """(size [points], lines) of facts, each with its name in front: the largest letters with which all have room."""
    for points, width, most in FACT_SIZES:
        texts = [f"{name}: {text}" for name, text in facts if text]
        lines = [line for text in texts for line in textwrap.wrap(text, width, subsequent_indent="    ")]
        if len(lines) <= most:
            return points, lines
    return points, [*lines[: most - 1], f"... ({len(lines) - most + 1} lines more than the page has room for)"]


def _signed(crs: "CRS | None", author: str) -> str:
    """CRS, program, date and author, which every page has."""
    code = None if crs is None else crs.to_authority()
    named = "local frame in metres" if crs is None else crs.name + (f" ({':'.join(code)})" if code else "")
    lines = [
        *textwrap.wrap(f"CRS: {named}", 48),
        f"Date of the map: {datetime.date.today().isoformat()}",
        f"Author: {author or NO_AUTHOR}",
        f"mpmgis {__version__} (Material Point Method)",
        "Simulated, not checked in the field",
    ]
    return "\n".join(lines)


def _layer(row):
    """A layer that the map keeps."""
    source, provider = row.maplayer.findtext("datasource"), row.maplayer.findtext("provider")
    named = {"name": row.title, "source": source, "provider": provider}
    return node("Layer", named, text=row.maplayer.findtext("id"))


def _legend_row(row):
    """The row of a layer in the legend, with a title of several lines that is no wider than the page."""
    made = tree_row(row)
    shown = "|".join(textwrap.wrap(row.title, LEGEND_LINE))
    entry = node("Option", {"type": "QString", "name": "legend/title-label", "value": shown})
    properties = made.find("customproperties")
    if properties is None:
        made.append(node("customproperties", None, node("Option", {"type": "Map"}, entry)))
    else:
        properties[0].append(entry)
    return made


def _scale_bar(metres):
    """(half, unit, unit [m]): a bar has two halves of a round length; `metres` of the ground are 1 mm of the map."""
    half = round_up(BAR * metres)
    return (half, "km", 1000) if half >= 1000 else (half, "m", 1)
