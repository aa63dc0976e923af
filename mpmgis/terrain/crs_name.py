"""The name of a CRS in messages and records."""

from ..errors import one_line


def name_of(crs):
    """Short name of a CRS for messages: EPSG:n where it has one, else its name."""
    if crs is None:
        return "a local frame"
    epsg = crs.to_epsg()
    return f"EPSG:{epsg}" if epsg else one_line(crs.name)
