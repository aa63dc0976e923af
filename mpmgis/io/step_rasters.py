"""The rasters of the exported steps, in one of two layouts, written as the frames come in."""

from collections import deque
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ..errors import OutputError
from ..fields import NODATA
from .atomic import output_error
from .geotiff import BandStack, tag, write_rows


class SparseBands:
    """Bands that are known in some cells of a grid, given out by rows as the raster writer asks for them.

    Parameters
    ----------
    grid : Grid
    index : int64[k]
        Flat index of the known cells, ascending.
    bands : list of (float32[k], float)
        Values of those cells, and the one of all others.
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
    """A raster per step. Writing goes on in `threads` while the next frames are read; no more than `ahead` wait."""

    def __init__(self, folder, name, grid, quantities, count, cog, threads: Executor, ahead):
        self.folder, self.grid, self.quantities, self.cog = Path(folder), grid, quantities, cog
        self.files = tuple(f"{name}_{step:04d}.tif" for step in range(count))
        self._threads, self._ahead, self._waiting = threads, ahead, deque()

    def write(self, step, tags, rows_of, at_once=False):
        """Write step number `step`; `rows_of` as in `geotiff.write_rows`, `at_once` where it is good only now."""
        work = (write_rows, self.folder / self.files[step], self.grid, self.quantities, tags, rows_of, self.cog)
        if at_once:
            work[0](*work[1:])
            return
        self._waiting.append(self._threads.submit(*work))
        while len(self._waiting) > self._ahead:
            self._waiting.popleft().result()

    def finish(self):
        """Wait for what is still being written."""
        while self._waiting:
            self._waiting.popleft().result()


class StepStacks:
    """A raster per variable; the steps are VRTs that point into them, so that no value is stored twice."""

    def __init__(self, folder, name, grid, quantities, times, tags, cog):
        self.folder, self.grid, self.quantities = Path(folder), grid, quantities
        self.files = tuple(f"{name}_{step:04d}.vrt" for step in range(len(times)))
        self._stacks = {quantity.name: f"{name}_{quantity.name}.tif" for quantity in quantities}
        paths = {key: self.folder / file for key, file in self._stacks.items()}
        self._open = BandStack(paths, grid, quantities, times, tags, cog)

    def write(self, step, tags, rows_of, at_once=False):
        """Write step number `step`; `rows_of` as in `geotiff.write_rows`."""
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
        metadata = ElementTree.SubElement(root, "Metadata", domain="mpmgis")
        for key, value in tags.items():
            ElementTree.SubElement(metadata, "MDI", key=key).text = tag(value)
        for band, quantity in enumerate(self.quantities, start=1):
            self._add_band(root, band, quantity, step)
        ElementTree.indent(root)
        text = ElementTree.tostring(root, encoding="unicode")
        (self.folder / self.files[step]).write_text(text, encoding="utf-8", newline="\n")

    def _add_band(self, root, band, quantity, step):
        node = ElementTree.SubElement(root, "VRTRasterBand", dataType="Float32", band=str(band))
        ElementTree.SubElement(node, "Description").text = quantity.band
        ElementTree.SubElement(node, "NoDataValue").text = str(NODATA)
        ElementTree.SubElement(node, "UnitType").text = quantity.unit
        source = ElementTree.SubElement(node, "SimpleSource")
        ElementTree.SubElement(source, "SourceFilename", relativeToVRT="1").text = self._stacks[quantity.name]
        ElementTree.SubElement(source, "SourceBand").text = str(step + 1)


@contextmanager
def finished(writer):
    """Gives `writer` and finishes it, whatever happens."""
    try:
        yield writer
    finally:
        try:
            writer.finish()
        except OSError as error:
            raise OutputError(str(output_error(writer.folder, error))) from error
