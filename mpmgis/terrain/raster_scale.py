"""Scale and offset of a raster's numbers, and the file that they stand in."""

import re
from pathlib import Path

from rasterio.io import DatasetReader

_SIDECAR = ".aux.xml"
_WRITTEN = re.compile(rb"<(Scale|Offset)>")
_LARGEST_SIDECAR = 10_000_000  # [bytes] a larger one is not searched


def sidecars(source: DatasetReader) -> list[str]:
    """Return the names of the files beside a raster that GDAL reads with it.

    Parameters
    ----------
    source : rasterio dataset
    """
    return [Path(name).name for name in source.files[1:]]


def scale_of(source: DatasetReader, band: int) -> dict:
    """Return scale, offset and the sidecar that gives them; {} without.

    Parameters
    ----------
    source : rasterio dataset
    band : int
        From 1.

    Returns
    -------
    dict
        `scale` and `offset` [1], `scaled_by`: name of the sidecar, "" for the file itself.
    """
    scale, offset = source.scales[band - 1], source.offsets[band - 1]
    if (scale, offset) == (1.0, 0.0):
        return {}
    beside = [Path(name) for name in source.files[1:] if name.lower().endswith(_SIDECAR)]
    given = next((path.name for path in beside if _gives_scale(path)), "")
    return {"scale": scale, "offset": offset, "scaled_by": given}


def _gives_scale(path):
    if not path.is_file() or path.stat().st_size > _LARGEST_SIDECAR:
        return False
    return _WRITTEN.search(path.read_bytes()) is not None


def scale_line(source: DatasetReader, path: str | Path, band: int) -> str:
    """Return a message on scale and offset of a raster; "" without.

    Parameters
    ----------
    source : rasterio dataset
    path : str or Path
        For the message.
    band : int
        From 1.
    """
    found = scale_of(source, band)
    if not found:
        return ""
    by = f" ({found['scaled_by']})" if found["scaled_by"] else ""
    return f"{path}: its numbers are scaled: x {found['scale']:.10g} + {found['offset']:.10g}{by}"
