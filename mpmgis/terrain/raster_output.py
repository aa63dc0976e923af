"""Raster output: GeoTIFF bands as docs/formats.md describes them, and ASCII grids."""

import ctypes
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import rasterio._base
import rasterio.shutil
from rasterio.io import DatasetWriter

from ..laws.quantities import NODATA, Quantity
from ..system.errors import InputError, OutputError, one_line
from ..system.whole_files import whole_file
from .georeference import warp_command
from .grid import Grid
from .raster_tags import band_metadata, dataset_metadata

NAMESPACE = "mpmgis"  # metadata domain of the exact values, for programs
BLOCK = 256  # [pixels] side of a tile
LAYOUT = {
    "driver": "GTiff",
    "dtype": "float32",
    "nodata": NODATA,
    "tiled": True,
    "blockxsize": BLOCK,
    "blockysize": BLOCK,
    "compress": "deflate",
    "predictor": 3,
    "zlevel": 1,  # 3 % larger than the default 6, in three quarters of the time (measured)
    "interleave": "band",
    "sparse_ok": True,
    "bigtiff": "if_safer",
}
COG_LAYOUT = {
    "driver": "COG",
    "compress": "deflate",
    "predictor": "YES",
    "blocksize": BLOCK,
    "overview_resampling": "average",  # nearest loses thin fronts (measured)
    "sparse_ok": True,
    "bigtiff": "if_safer",
    "copy_src_mdd": "YES",
}
# GDAL turns errors of libtiff into exceptions; libtiff also prints failed writes to stderr, with temporary names.
with suppress(OSError, AttributeError):  # where the functions of linked libraries are not accessible
    ctypes.CDLL(rasterio._base.__file__).TIFFSetErrorHandler(None)


def write_geotiff(
    path: str | Path,
    grid: Grid,
    bands: Sequence[tuple[Quantity, np.ndarray]],
    tags: Mapping[str, object],
    cog: bool = False,
) -> None:
    """Write a raster atomically.

    Parameters
    ----------
    path : str or Path
    grid : Grid
        North-up, or rotated like the DTM.
    bands : sequence of (Quantity, float[rows, columns])
        NaN where there is no data.
    tags : mapping of str to object
        Written in the namespace `mpmgis`.
    cog : bool
        A Cloud Optimized GeoTIFF.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    arrays = [values for _, values in bands]
    with whole_file(path) as part:
        write_rows(
            part, grid, [quantity for quantity, _ in bands], tags, lambda k, first, last: arrays[k][first:last], cog
        )


def write_rows(
    path: str | Path,
    grid: Grid,
    quantities: Sequence[Quantity],
    tags: Mapping[str, object],
    rows_of: Callable[[int, int, int], np.ndarray],
    cog: bool = False,
) -> None:
    """Write a raster in strips, so that no complete band is in memory, and directly to `path`.

    Parameters
    ----------
    path : str or Path
    grid : Grid
    quantities : sequence of Quantity
        One per band.
    tags : mapping of str to object
        Written in the namespace `mpmgis`.
    rows_of : callable (band, first, last) -> float[last - first, columns]
        Rows of a band, counted from 0; NaN where there is no data.
    cog : bool
        A Cloud Optimized GeoTIFF.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    with new_geotiff(path, grid, quantities, tags, cog) as target:
        for first, last in strips(grid):
            for band in range(len(quantities)):
                write_strip(target, band + 1, first, last, rows_of(band, first, last))


def strips(grid: Grid) -> list[tuple[int, int]]:
    """Return the first row and the row after the last one of each strip of tiles.

    Parameters
    ----------
    grid : Grid
    """
    rows = grid.shape[0]
    return [(first, min(first + BLOCK, rows)) for first in range(0, rows, BLOCK)]


def tag_text(value: object) -> str:
    """Return a value as text of a tag; numbers with all digits.

    Parameters
    ----------
    value : object
    """
    return repr(float(value)) if isinstance(value, float | np.floating) else str(value)


@contextmanager
def new_geotiff(
    path: str | Path, grid: Grid, quantities: Sequence[Quantity], tags: Mapping[str, object], cog: bool
) -> Iterator[DatasetWriter]:
    """Create a GeoTIFF with its metadata, and open it for this block.

    Parameters
    ----------
    path : str or Path
    grid : Grid
    quantities : sequence of Quantity
        One per band.
    tags : mapping of str to object
        Written in the namespace `mpmgis`.
    cog : bool
        The file is converted to a Cloud Optimized GeoTIFF after the block.

    Yields
    ------
    rasterio dataset

    Raises
    ------
    OutputError
        It cannot be written.
    """
    path = Path(path)
    plain = path.with_name(f".{path.name}.plain.tif") if cog else path
    try:
        with rasterio.open(plain, "w", **LAYOUT, **placement(grid), count=len(quantities)) as target:
            target.update_tags(**dataset_metadata(quantities, tags))
            for band, quantity in enumerate(quantities, start=1):
                target.set_band_description(band, quantity.band)
                target.set_band_unit(band, quantity.unit)
                target.update_tags(band, **band_metadata(quantity))
            target.update_tags(ns=NAMESPACE, **{key: tag_text(value) for key, value in tags.items()})
            yield target
        if cog:
            rasterio.shutil.copy(plain, path, **COG_LAYOUT)
    except rasterio.errors.RasterioError as error:
        raise OutputError(f"{path}: cannot be written ({one_line(error)})") from error
    finally:
        if cog:
            plain.unlink(missing_ok=True)


def placement(grid: Grid) -> dict[str, Any]:
    """Return what a profile of rasterio says about a grid: CRS, transform, width, height.

    Parameters
    ----------
    grid : Grid
    """
    rows, columns = grid.shape
    crs = None if grid.crs is None else rasterio.crs.CRS.from_wkt(grid.crs.to_wkt())
    return {"crs": crs, "transform": grid.transform, "width": columns, "height": rows}


def write_strip(target: DatasetWriter, band: int, first: int, last: int, values: np.ndarray) -> None:
    """Write some rows of a band.

    Parameters
    ----------
    target : rasterio dataset
    band : int
        Counted from 1.
    first, last : int
        The first row, and the row after the last one.
    values : float[last - first, columns]
        NaN where there is no data.
    """
    values = np.asarray(values, dtype=np.float32)
    gaps = np.isnan(values)
    if gaps.any():
        values = np.where(gaps, np.float32(NODATA), values)
    target.write(values, band, window=((first, last), (0, target.width)))


def require_square(grid: Grid, what: str, path: str | Path) -> None:
    """Refuse a grid that is rotated or has non-square pixels: ASCII grids cannot store it.

    Parameters
    ----------
    grid : Grid
    what : str
        What writes ASCII grids, for the message.
    path : str or Path
        The DTM, for the message.

    Raises
    ------
    InputError
    """
    t = grid.transform
    if t.b or t.d or abs(abs(t.a) - abs(t.e)) > 1e-9 * abs(t.a):
        size = f"{grid.cell_size:.6g}"
        raise InputError(
            f"{what} writes ASCII grids, which require square north-up pixels; warp the DTM: "
            f"{warp_command(path, size=size)}"
        )


def write_ascii_grid(path: str | Path, grid: Grid, values: np.ndarray) -> None:
    """Write an ASCII grid with its .prj.

    Parameters
    ----------
    path : str or Path
        Of a new file.
    grid : Grid
    values : float[rows, columns]
        NaN becomes -9999.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    path = Path(path)
    with tempfile.TemporaryDirectory() as folder:
        plain = os.path.join(folder, "values.tif")
        write_rows(plain, grid, [Quantity("values", "1", "")], {}, lambda _, first, last: values[first:last])
        try:
            rasterio.shutil.copy(plain, path, driver="AAIGrid", decimal_precision=4)
        except rasterio.errors.RasterioError as error:
            raise OutputError(f"{path}: cannot be written ({one_line(error)})") from error
    path.with_name(path.name + ".aux.xml").unlink(missing_ok=True)


class SparseBands:
    """Bands with values in some cells of a grid, returned by rows for the raster writer (`rows_of` of `write_rows`).

    Parameters
    ----------
    grid : Grid
    index : int64[k]
        Flat index of the cells with values, ascending.
    bands : sequence of (float32[k], float)
        Values of these cells, and the value of all others.
    """

    def __init__(self, grid: Grid, index: np.ndarray, bands: Sequence[tuple[np.ndarray, float]]):
        self.columns, self.index, self.bands = grid.shape[1], index, bands

    def __call__(self, band: int, first: int, last: int) -> np.ndarray:
        """Return rows of a band, float32[last - first, columns]."""
        values, empty = self.bands[band]
        rows = np.full((last - first) * self.columns, empty, np.float32)
        begin, end = np.searchsorted(self.index, (first * self.columns, last * self.columns))
        rows[self.index[begin:end] - first * self.columns] = values[begin:end]
        return rows.reshape(-1, self.columns)
