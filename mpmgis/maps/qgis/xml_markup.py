"""Make XML elements for QGIS and GDAL files, with the standard library.

What all files of a kind have in common is in the folder `templates`, with a `$name` where a file has its own value.
The .qml files there are styles of QGIS, the .qgs is a project and the .qpt a print layout; .xml files are parts of
these. Settings of symbols are there twice: as `Option` for QGIS 3.44 and as `prop` for QGIS 3.22.
"""

import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING
from xml.etree import ElementTree

if TYPE_CHECKING:
    from pyproj import CRS

TEMPLATES = Path(__file__).with_name("templates")
_SPACE = re.compile(r"(?<=>)\s+|\s+(?=<)")  # between elements
_ESCAPED = str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}
)
QGIS_HEAD = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
LOCAL_FRAME = (
    'ENGCRS["local frame in metres",EDATUM["local frame"],CS[Cartesian,2],'
    'AXIS["easting (E)",east,ORDER[1],LENGTHUNIT["metre",1]],'
    'AXIS["northing (N)",north,ORDER[2],LENGTHUNIT["metre",1]]]'
)


def node(
    tag: str, attributes: dict | None = None, *children: ElementTree.Element | None, text: object = None
) -> ElementTree.Element:
    """Return an element.

    Parameters
    ----------
    tag : str
    attributes : dict, optional
        Values are converted by str.
    *children : Element or None
        None is skipped.
    text : object
        Converted by str.
    """
    element = ElementTree.Element(tag, {key: str(value) for key, value in (attributes or {}).items()})
    element.text = None if text is None else str(text)
    element.extend(child for child in children if child is not None)
    return element


def qgis_document(root: ElementTree.Element) -> str:
    """Return the text of a QGIS style or project file.

    Parameters
    ----------
    root : Element
    """
    return QGIS_HEAD + ElementTree.tostring(root, encoding="unicode")


def filled(name: str, /, **values: object) -> ElementTree.Element:
    """Return the root element of a template with a value in each of its places.

    Parameters
    ----------
    name : str
        File in the folder of templates.
    **values : Element, iterable of Element, or object
        Elements are inserted as children, other values as text (by str).
    """
    return ElementTree.fromstring(_template(name).substitute({key: _markup(value) for key, value in values.items()}))


@cache
def _template(name):
    """The Template without white space between elements."""
    return Template(_SPACE.sub("", (TEMPLATES / name).read_text(encoding="utf-8")))


def _markup(value):
    if isinstance(value, ElementTree.Element):
        return ElementTree.tostring(value, encoding="unicode")
    if isinstance(value, Iterable) and not isinstance(value, str):
        return "".join(map(_markup, value))
    return str(value).translate(_ESCAPED)


def reference_system(crs: "CRS | None") -> ElementTree.Element:
    """Return the element `spatialrefsys` of a CRS.

    Parameters
    ----------
    crs : pyproj.CRS or None
        None: a local frame.
    """
    wkt = reference_text(crs)
    authority = None if crs is None else crs.to_authority()
    return node(
        "spatialrefsys",
        {"nativeFormat": "Wkt"},
        node("wkt", text=wkt),
        node("authid", text=":".join(authority)) if authority else None,
    )


def reference_text(crs: "CRS | None") -> str:
    """Return the WKT of a CRS; that of a local frame is an engineering CRS in metres.

    Parameters
    ----------
    crs : pyproj.CRS or None
        None: a local frame.
    """
    return LOCAL_FRAME if crs is None else crs.to_wkt()
