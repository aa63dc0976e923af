"""Rasters of the steps of a run: one file for each step, or one stack for each variable."""

from collections import deque
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from xml.etree import ElementTree

from ..laws.quantities import NODATA
from ..system.errors import OutputError
from ..system.whole_files import output_error
from .raster_metadata import band_metadata, dataset_metadata
from .raster_output import NAMESPACE, new_geotiff, strips, tag_text, write_rows, write_strip


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
                file = new_geotiff(paths[quantity.name], grid, [quantity] * len(times), tags, cog)
                self._files.append(opening.enter_context(file))
                for band, time in enumerate(times, start=1):
                    self._files[-1].update_tags(band, ns=NAMESPACE, time=tag_text(float(time)))
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
                write_strip(target, step + 1, first, last, rows_of(number, first, last))


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
        _add_metadata(root, {key: tag_text(value) for key, value in tags.items()}, domain=NAMESPACE)
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
