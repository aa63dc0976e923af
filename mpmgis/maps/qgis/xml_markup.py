"""Make XML elements for QGIS and GDAL files, with the standard library."""

from typing import TYPE_CHECKING
from xml.etree import ElementTree

if TYPE_CHECKING:
    from pyproj import CRS


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


def options(values: dict) -> list[ElementTree.Element]:
    """Return the settings of a symbol layer in both forms: of QGIS 3.44 and of QGIS 3.22.

    Parameters
    ----------
    values : dict of str to str
    """
    newer = node(
        "Option",
        {"type": "Map"},
        *(node("Option", {"type": "QString", "name": k, "value": v}) for k, v in values.items()),
    )
    return [newer, *(node("prop", {"k": k, "v": v}) for k, v in values.items())]


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
