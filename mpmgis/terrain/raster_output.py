"""Raster output: GeoTIFF bands as docs/formats.md describes them, ASCII grids, and rasters of the steps.

Time, program and meaning of a raster in GDAL's default metadata domain, which GIS programs show.

`gdalinfo`, the information panel of QGIS and the attributes of rioxarray show this domain; they do not show the
namespace `mpmgis`, in which programs find the exact values. Symbols are those of Vicari et al. (2025), NHESS 25:3897.
"""

import ctypes
import os
import tempfile
from collections import deque
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import rasterio
import rasterio._base
import rasterio.shutil

from ..laws.quantities import NODATA, Quantity
from ..system.errors import InputError, OutputError, one_line
from ..system.whole_files import output_error, whole_file
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
    with _new_file(path, grid, quantities, tags, cog) as target:
        for first, last in strips(grid):
            for band in range(len(quantities)):
                _write_strip(target, band + 1, first, last, rows_of(band, first, last))


class BandStack:
    """One raster per variable with the steps as bands; all are open and written step by step.

    Parameters
    ----------
    paths : dict of str to path
        Variable name -> file.
    grid : Grid
    quantities : list of Quantity
        One per file.
    times : sequence of float [s]
        One per band; a tag of the band.
    tags : dict
    cog : bool
    """

    def __init__(self, paths, grid, quantities, times, tags, cog=False):
        self.grid = grid
        self._stack = ExitStack()
        self._files = []
        with ExitStack() as opening:
            for quantity in quantities:
                file = _new_file(paths[quantity.name], grid, [quantity] * len(times), tags, cog)
                self._files.append(opening.enter_context(file))
                for band, time in enumerate(times, start=1):
                    self._files[-1].update_tags(band, ns=NAMESPACE, time=tag(float(time)))
                    self._files[-1].update_tags(band, **band_metadata(quantity, time))
            self._stack = opening.pop_all()

    def __enter__(self):
        return self

    def __exit__(self, *problem):
        return self._stack.__exit__(*problem)

    def write(self, step, rows_of):
        """Write step number `step`; `rows_of` as in `write_rows`, by number of the variable."""
        for number, target in enumerate(self._files):
            for first, last in strips(self.grid):
                _write_strip(target, step + 1, first, last, rows_of(number, first, last))


def strips(grid):
    """(first, last) rows of each strip of tiles."""
    rows = grid.shape[0]
    return [(first, min(first + BLOCK, rows)) for first in range(0, rows, BLOCK)]


def tag(value):
    """`value` as text of a tag; numbers with all digits."""
    return repr(float(value)) if isinstance(value, float | np.floating) else str(value)


@contextmanager
def _new_file(path, grid, quantities, tags, cog):
    path = Path(path)
    plain = path.with_name(f".{path.name}.plain.tif") if cog else path
    try:
        with rasterio.open(plain, "w", **LAYOUT, **_place(grid), count=len(quantities)) as target:
            target.update_tags(**dataset_metadata(quantities, tags))
            for band, quantity in enumerate(quantities, start=1):
                target.set_band_description(band, quantity.band)
                target.set_band_unit(band, quantity.unit)
                target.update_tags(band, **band_metadata(quantity))
            target.update_tags(ns=NAMESPACE, **{key: tag(value) for key, value in tags.items()})
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


def _write_strip(target, band, first, last, values):
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


class StepFiles:
    """One raster per step, written in `threads` while the next frames are read; at most `ahead` wait."""

    def __init__(self, folder, name, grid, quantities, count, cog, threads: Executor, ahead):
        self.folder, self.grid, self.quantities, self.cog = Path(folder), grid, quantities, cog
        self.files = tuple(f"{name}_{step:04d}.tif" for step in range(count))
        self._threads, self._ahead, self._waiting = threads, ahead, deque()

    def write(self, step, tags, rows_of, at_once=False):
        """Write step number `step`; `rows_of` as in `write_rows`; `at_once` where its data are valid only now."""
        work = (write_rows, self.folder / self.files[step], self.grid, self.quantities, tags, rows_of, self.cog)
        if at_once:
            work[0](*work[1:])
            return
        self._waiting.append(self._threads.submit(*work))
        while len(self._waiting) > self._ahead:
            self._waiting.popleft().result()

    def finish(self):
        """Wait for all writes."""
        while self._waiting:
            self._waiting.popleft().result()


class StepStacks:
    """One raster per variable; the steps are VRTs that refer to them, so that no value is stored twice."""

    def __init__(self, folder, name, grid, quantities, times, tags, cog):
        self.folder, self.grid, self.quantities = Path(folder), grid, quantities
        self.files = tuple(f"{name}_{step:04d}.vrt" for step in range(len(times)))
        self._stacks = {quantity.name: f"{name}_{quantity.name}.tif" for quantity in quantities}
        paths = {key: self.folder / file for key, file in self._stacks.items()}
        self._open = BandStack(paths, grid, quantities, times, tags, cog)

    def write(self, step, tags, rows_of, at_once=False):
        """Write step number `step`; `rows_of` as in `write_rows`."""
        self._open.write(step, rows_of)
        self._write_vrt(step, tags)

    def finish(self):
        """Close the files."""
        self._open.__exit__(None, None, None)

    def _write_vrt(self, step, tags):
        rows, columns = self.grid.shape
        root = ElementTree.Element("VRTDataset", rasterXSize=str(columns), rasterYSize=str(rows))
        if self.grid.crs is not None:
            ElementTree.SubElement(root, "SRS").text = self.grid.crs.to_wkt()
        numbers = self.grid.transform.to_gdal()
        ElementTree.SubElement(root, "GeoTransform").text = ", ".join(repr(float(number)) for number in numbers)
        _add_metadata(root, dataset_metadata(self.quantities, tags))
        _add_metadata(root, {key: tag(value) for key, value in tags.items()}, domain=NAMESPACE)
        for band, quantity in enumerate(self.quantities, start=1):
            self._add_band(root, band, quantity, step)
        ElementTree.indent(root)
        text = ElementTree.tostring(root, encoding="unicode")
        (self.folder / self.files[step]).write_text(text, encoding="utf-8", newline="\n")

    def _add_band(self, root, band, quantity, step):
        node = ElementTree.SubElement(root, "VRTRasterBand", dataType="Float32", band=str(band))
        ElementTree.SubElement(node, "Description").text = quantity.band
        _add_metadata(node, band_metadata(quantity))
        ElementTree.SubElement(node, "NoDataValue").text = str(NODATA)
        ElementTree.SubElement(node, "UnitType").text = quantity.unit
        source = ElementTree.SubElement(node, "SimpleSource")
        ElementTree.SubElement(source, "SourceFilename", relativeToVRT="1").text = self._stacks[quantity.name]
        ElementTree.SubElement(source, "SourceBand").text = str(step + 1)


def _add_metadata(parent, tags, **domain):
    metadata = ElementTree.SubElement(parent, "Metadata", **domain)
    for key, value in tags.items():
        ElementTree.SubElement(metadata, "MDI", key=key).text = value


@contextmanager
def finished(writer):
    """Yield `writer` and finish it, also after errors."""
    try:
        yield writer
    finally:
        try:
            writer.finish()
        except OSError as error:
            raise OutputError(str(output_error(writer.folder, error))) from error
