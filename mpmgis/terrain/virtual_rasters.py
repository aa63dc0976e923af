"""Virtual rasters (VRT) of virtual rasters: how often their files are read."""

import re
from pathlib import Path

from ..system.errors import InputError

MOST_READS = 20_000  # of files for one pass over nested virtual rasters: a few seconds
_HEAD = b"<VRTDataset"
_LARGEST = 50_000_000  # [bytes] of a virtual raster; mosaics of 100 000 tiles have as much
_SOURCE = re.compile(rb"<SourceFilename([^>]*)>([^<]+)<")
_RELATIVE = re.compile(rb"relativeToVRT\s*=\s*[\"']1")


def require_few_reads(path: str | Path) -> None:
    """Refuse virtual rasters within virtual rasters whose sources are read too often; others pass.

    Every level multiplies the reads: six levels of twelve sources read one small file three million times.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    InputError
    """
    path = Path(path)
    sources = _sources(path)
    if not any(_sources(source) for source in set(sources)):
        return
    reads = _reads(path, {}, ())
    if reads > MOST_READS:
        raise InputError(
            f"{path}: its virtual rasters within virtual rasters read files {reads:.3g} times, expected at most "
            f"{MOST_READS}; make one raster of it (rio convert, QGIS: Export, Save as)"
        )


def _sources(path):
    """Return the paths of the sources of a virtual raster; () for other files."""
    try:
        if not path.is_file():
            return ()
        with open(path, "rb") as file:
            if _HEAD not in file.read(1000):
                return ()
            file.seek(0)
            text = file.read(_LARGEST)
    except (OSError, ValueError):
        return ()
    names = []
    for attributes, name in _SOURCE.findall(text):
        given = Path(name.decode("utf-8", "replace").strip())
        names.append(path.parent / given if _RELATIVE.search(attributes) else given)
    return tuple(names)


def _reads(path, known, above):
    """Return how many files are read for one read of `path`; a virtual raster that contains itself counts once."""
    if path in known or path in above:
        return known.get(path, 1)
    known[path] = sum(_reads(source, known, (*above, path)) for source in _sources(path)) or 1
    return known[path]
