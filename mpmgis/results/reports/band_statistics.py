"""Range and valid cells of a band of a raster, from all of its cells or from a sample of its blocks."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rasterio.io import DatasetReader
from rasterio.windows import Window

from ...system.errors import FormatError, innermost_reason

MOST_READ = 100_000_000  # [cells] that are read of a raster: about two seconds
MOST_BLOCKS = 1_000_000  # whose existence is looked up; of more only some are


class BandStatistics(NamedTuple):
    """Range and valid cells of a band.

    Parameters
    ----------
    low, high : float or None
        Of the valid values, scale and offset applied; None without any.
    valid_share : float [1]
        Of the cells that were read or are in blocks that the file does not contain.
    known_share : float [1]
        Of all cells that were read or are in such blocks.
    """

    low: float | None
    high: float | None
    valid_share: float
    known_share: float


def band_statistics(source: DatasetReader, path: str | Path, band: int) -> BandStatistics:
    """Return the statistics of a band; of a large raster from blocks that are evenly spread over it.

    Parameters
    ----------
    source : rasterio dataset
    path : str or Path
        For messages.
    band : int
        From 1.

    Raises
    ------
    FormatError
        A block cannot be read.
    """
    low, high, valid, known = np.inf, -np.inf, 0, 0
    total = source.width * source.height
    windows, empty = _chosen(source, band, max(1, MOST_READ // source.count))
    if empty and source.nodatavals[band - 1] is None:  # GDAL reads 0 there
        low, high, valid = 0.0, 0.0, empty
    known += empty
    try:
        for window in windows:
            block = source.read(band, window=window, masked=True).compressed()
            block = block[np.isfinite(block)]
            known += int(window.width * window.height)
            if block.size:
                low, high, valid = min(low, block.min()), max(high, block.max()), valid + block.size
    except Exception as error:  # rasterio, GDAL and NumPy raise different types for a damaged block
        raise FormatError(f"{path} is damaged: band {band} cannot be read ({innermost_reason(error)[:100]})") from error
    if not valid:
        return BandStatistics(None, None, 0.0, known / total)
    ends = sorted(float(value) * source.scales[band - 1] + source.offsets[band - 1] for value in (low, high))
    return BandStatistics(*ends, valid / known, known / total)


def _chosen(source: DatasetReader, band: int, most: int) -> tuple[Iterator[Window], int]:
    """Return (windows of the blocks to read, number of cells in blocks that the file does not contain)."""
    if source.width * source.height <= most:
        return (window for _, window in source.block_windows(band)), 0
    height, width = source.block_shapes[band - 1]
    down, across = -(-source.height // height), -(-source.width // width)
    places = np.arange(0, down * across, -(-down * across // MOST_BLOCKS))
    there = [divmod(int(place), across) for place in places]
    empty = 0
    if source.driver == "GTiff":
        found = [place for place in there if _is_there(source, band, *place)]
        if len(places) == down * across:
            missing = set(there) - set(found)
            empty = sum(_cells(source, row, column, height, width) for row, column in missing)
        there = found
    step = max(1, math.ceil(len(there) * height * width / most))
    if height * width > most:  # a single block is too much
        there = []
    return (_window(source, row, column, height, width) for row, column in there[step // 2 :: step]), empty


def _is_there(source, band, row, column):
    """Return whether a GeoTIFF contains a block: a sparse one leaves out those without data."""
    return source.get_tag_item(f"BLOCK_OFFSET_{column}_{row}", "TIFF", bidx=band) is not None


def _window(source, row, column, height, width):
    top, left = row * height, column * width
    return Window(left, top, min(width, source.width - left), min(height, source.height - top))


def _cells(source, row, column, height, width):
    window = _window(source, row, column, height, width)
    return int(window.width * window.height)
