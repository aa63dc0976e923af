"""Rasters of whole numbers that stand for classes, with a colour for each."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rasterio
from rasterio.enums import ColorInterp
from rasterio.io import DatasetWriter

from ..system.whole_files import whole_file
from .grid import Grid
from .raster_output import BLOCK, NAMESPACE, placement


def write_class_raster(
    path: Path,
    grid: Grid,
    numbers: np.ndarray,
    classes: Iterable[tuple[int, str, str]],
    band: str,
    source: Mapping[str, str],
    tags: Mapping[str, str],
) -> None:
    """Write numbers of classes as GeoTIFF with their colours; 0 is nodata.

    Parameters
    ----------
    path : Path
    grid : Grid
    numbers : uint8[rows, columns]
    classes, band, source, tags
        As for `new_class_raster`.
    """
    with new_class_raster(path, grid, classes, band, source, tags) as target:
        target.write(numbers, 1)


@contextmanager
def new_class_raster(
    path: Path,
    grid: Grid,
    classes: Iterable[tuple[int, str, str]],
    band: str,
    source: Mapping[str, str],
    tags: Mapping[str, str],
) -> Iterator[DatasetWriter]:
    """Create a GeoTIFF of numbers of classes with their colours, and open it for this block; 0 is nodata.

    Parameters
    ----------
    path : Path
    grid : Grid
    classes : iterable of (int, str, str)
        Number, label, colour #rrggbb.
    band : str
        Description of the band.
    source, tags : mapping of str to str
        Of the file, before and after those of the classes.

    Yields
    ------
    rasterio dataset
        With one band, uint8.
    """
    profile = {
        "driver": "GTiff",
        "count": 1,
        "dtype": "uint8",
        "nodata": 0,
        "compress": "deflate",
        "tiled": True,
        "blockxsize": BLOCK,
        "blockysize": BLOCK,
    }
    colours, meaning = {0: (0, 0, 0, 0)}, {}
    for number, label, colour in classes:
        red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
        colours[number] = red, green, blue, 255
        meaning[f"class_{number}"] = label
    with whole_file(path) as part, rasterio.open(part, "w", **profile, **placement(grid)) as target:
        yield target
        target.write_colormap(1, colours)
        target.colorinterp = [ColorInterp.palette]
        target.set_band_description(1, band)
        target.update_tags(ns=NAMESPACE, **source, **meaning, **tags)
