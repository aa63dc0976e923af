"""Raster output: GeoTIFF bands as docs/formats.md describes them, ASCII grids, and rasters of the steps.

Time, program and meaning of a raster in GDAL's default metadata domain, which GIS programs show.

`gdalinfo`, the information panel of QGIS and the attributes of rioxarray show this domain; they do not show the
namespace `mpmgis`, in which programs find the exact values. Symbols are those of Vicari et al. (2025), NHESS 25:3897.
"""

import ctypes
import os
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import rasterio
import rasterio._base
import rasterio.shutil

from ..laws.quantities import NODATA, Quantity
from ..system.errors import InputError, OutputError, one_line
from ..system.whole_files import whole_file
from .georeference import warp_command
from .raster_metadata import band_metadata, dataset_metadata

NAMESPACE = "mpmgis"
BLOCK = 256
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


def write_geotiff(path, grid, bands, tags, cog=False):
    """Write a raster atomically.

    Parameters
    ----------
    path : path
    grid : Grid
        North-up, or rotated like the DTM.
    bands : list of (Quantity, float array [rows, columns])
        NaN where there is no data.
    tags : dict
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


def write_rows(path, grid, quantities, tags, rows_of, cog=False):
    """As `write_geotiff`, directly to `path` and in strips, so that no complete band is in memory.

    `rows_of(band, first, last)` returns float[last - first, columns] of band number `band`.
    """
    with new_geotiff(path, grid, quantities, tags, cog) as target:
        for first, last in strips(grid):
            for band in range(len(quantities)):
                write_strip(target, band + 1, first, last, rows_of(band, first, last))


def strips(grid):
    """(first, last) rows of each strip of tiles."""
    rows = grid.shape[0]
    return [(first, min(first + BLOCK, rows)) for first in range(0, rows, BLOCK)]


def tag_text(value):
    """`value` as text of a tag; numbers with all digits."""
    return repr(float(value)) if isinstance(value, float | np.floating) else str(value)


@contextmanager
def new_geotiff(path, grid, quantities, tags, cog):
    path = Path(path)
    plain = path.with_name(f".{path.name}.plain.tif") if cog else path
    try:
        with rasterio.open(plain, "w", **LAYOUT, **_place(grid), count=len(quantities)) as target:
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


def _place(grid):
    rows, columns = grid.shape
    crs = None if grid.crs is None else rasterio.crs.CRS.from_wkt(grid.crs.to_wkt())
    return {"crs": crs, "transform": grid.transform, "width": columns, "height": rows}


def write_strip(target, band, first, last, values):
    values = np.asarray(values, dtype=np.float32)
    gaps = np.isnan(values)
    if gaps.any():
        values = np.where(gaps, np.float32(NODATA), values)
    target.write(values, band, window=((first, last), (0, target.width)))


def require_square(grid, what, path):
    """Refuse a grid (of the DTM at `path`) that is rotated or has non-square pixels: ASCII grids cannot store it."""
    t = grid.transform
    if t.b or t.d or abs(abs(t.a) - abs(t.e)) > 1e-9 * abs(t.a):
        size = f"{grid.cell_size:.6g}"
        raise InputError(
            f"{what} writes ASCII grids, which require square north-up pixels; warp the DTM: "
            f"{warp_command(path, size=size)}"
        )


def write_ascii_grid(path, grid, values):
    """Write float array [rows, columns] as an ASCII grid (NaN: -9999) with its .prj; `path` must be new."""
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
    """Bands with values in some cells of a grid, returned by rows for the raster writer.

    Parameters
    ----------
    grid : Grid
    index : int64[k]
        Flat index of the cells with values, ascending.
    bands : list of (float32[k], float)
        Values of these cells, and the value of all others.
    """

    def __init__(self, grid, index, bands):
        self.columns, self.index, self.bands = grid.shape[1], index, bands

    def __call__(self, band, first, last):
        """float32[last - first, columns] of band number `band`."""
        values, empty = self.bands[band]
        rows = np.full((last - first) * self.columns, empty, np.float32)
        begin, end = np.searchsorted(self.index, (first * self.columns, last * self.columns))
        rows[self.index[begin:end] - first * self.columns] = values[begin:end]
        return rows.reshape(-1, self.columns)
