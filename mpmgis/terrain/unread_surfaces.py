"""Surfaces of triangles and shapes with arcs, which GEOS does not read: what a message says of them."""

SURFACES = {15: "PolyhedralSurface", 16: "TIN", 17: "Triangle"}  # by the numbers of ISO WKB
CURVES = ("CircularString", "CompoundCurve", "CurvePolygon", "MultiCurve", "MultiSurface")


def unread_kind(text: str) -> str:
    """Return the kind of a geometry in WKT that is not read; "" for other kinds.

    Parameters
    ----------
    text : str
    """
    word = text.strip().partition("(")[0].split()
    names = {name.upper(): name for name in (*SURFACES.values(), *CURVES)}
    return names.get(word[0].upper(), "") if word else ""


def unread_line(number: int, kind: str, file: str) -> str:
    """Return the words on a feature of a kind that is not read, with the remedy.

    Parameters
    ----------
    number : int
        Of the feature, from 1.
    kind : str
    file : str
        Name of the file, for the command.
    """
    return (
        f"feature {number} is a {kind}, expected a polygon; convert it: ogr2ogr -nlt MULTIPOLYGON polygons.gpkg {file}"
    )
