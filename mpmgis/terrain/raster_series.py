"""Rasters of the steps of a run: one file for each step, or one stack for each variable."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ..laws.quantities import NODATA, Quantity
from ..system.errors import OutputError
from ..system.whole_files import output_error
from .grid import Grid
from .raster_output import NAMESPACE, new_geotiff, strips, tag_text, write_rows, write_strip
from .raster_tags import band_metadata, dataset_metadata


class BandStack:
    """Rasters of several variables, one file each, whose bands are the steps; all are open and written step by step.

    Parameters
    ----------
    paths : mapping of str to path
        Variable name -> file.
    grid : Grid
    quantities : sequence of Quantity
        One per file.
    times : sequence of float [s]
        One per band; a tag of the band.
    tags : mapping of str to object
        Written in the namespace `mpmgis`.
    cog : bool
        Cloud Optimized GeoTIFFs.

    Raises
    ------
    OutputError
        They cannot be written.
    """

    def __init__(
        self,
        paths: Mapping[str, Path],
        grid: Grid,
        quantities: Sequence[Quantity],
        times: Sequence[float],
        tags: Mapping[str, object],
        cog: bool = False,
    ):
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

    def write(self, step: int, rows_of: Callable[[int, int, int], np.ndarray]) -> None:
        """Write a step.

        Parameters
        ----------
        step : int
            Counted from 0.
        rows_of : callable (variable, first, last) -> float[last - first, columns]
            Rows of a variable, counted from 0.
        """
        for number, target in enumerate(self._files):
            for first, last in strips(self.grid):
                write_strip(target, step + 1, first, last, rows_of(number, first, last))


class StepFiles:
    """One raster per step, written by threads while the next frames are read.

    Parameters
    ----------
    folder : str or Path
    name : str
        Of the run, the first part of the file names.
    grid : Grid
    quantities : sequence of Quantity
        One per band.
    count : int
        Number of steps.
    cog : bool
        Cloud Optimized GeoTIFFs.
    threads : Executor
    ahead : int
        Most steps that wait to be written.

    Attributes
    ----------
    files : tuple of str
        Names of the files of all steps.
    """

    def __init__(
        self,
        folder: str | Path,
        name: str,
        grid: Grid,
        quantities: Sequence[Quantity],
        count: int,
        cog: bool,
        threads: Executor,
        ahead: int,
    ):
        self.folder, self.grid, self.quantities, self.cog = Path(folder), grid, quantities, cog
        self.files = tuple(f"{name}_{step:04d}.tif" for step in range(count))
        self._threads, self._ahead, self._waiting = threads, ahead, deque()

    def write(
        self,
        step: int,
        tags: Mapping[str, object],
        rows_of: Callable[[int, int, int], np.ndarray],
        at_once: bool = False,
    ) -> None:
        """Write a step, or hand it to a thread.

        Parameters
        ----------
        step : int
            Counted from 0.
        tags : mapping of str to object
            Of this step, in the namespace `mpmgis`.
        rows_of : callable (band, first, last) -> float[last - first, columns]
            As in `write_rows`.
        at_once : bool
            Write it in this thread, where its data are valid only now.

        Raises
        ------
        OutputError
            A step cannot be written.
        """
        work = (write_rows, self.folder / self.files[step], self.grid, self.quantities, tags, rows_of, self.cog)
        if at_once:
            work[0](*work[1:])
            return
        self._waiting.append(self._threads.submit(*work))
        while len(self._waiting) > self._ahead:
            self._waiting.popleft().result()

    def finish(self) -> None:
        """Wait until all steps are written."""
        while self._waiting:
            self._waiting.popleft().result()


class StepStacks:
    """One raster per variable; the steps are VRTs that refer to them, so that no value is stored twice.

    Parameters
    ----------
    folder : str or Path
    name : str
        Of the run, the first part of the file names.
    grid : Grid
    quantities : sequence of Quantity
        One per file.
    times : sequence of float [s]
    tags : mapping of str to object
        Of the stacks, in the namespace `mpmgis`.
    cog : bool
        Cloud Optimized GeoTIFFs.

    Attributes
    ----------
    files : tuple of str
        Names of the VRTs of all steps.
    """

    def __init__(
        self,
        folder: str | Path,
        name: str,
        grid: Grid,
        quantities: Sequence[Quantity],
        times: Sequence[float],
        tags: Mapping[str, object],
        cog: bool,
    ):
        self.folder, self.grid, self.quantities = Path(folder), grid, quantities
        self.files = tuple(f"{name}_{step:04d}.vrt" for step in range(len(times)))
        self._stacks = {quantity.name: f"{name}_{quantity.name}.tif" for quantity in quantities}
        paths = {key: self.folder / file for key, file in self._stacks.items()}
        self._open = BandStack(paths, grid, quantities, times, tags, cog)

    def write(
        self,
        step: int,
        tags: Mapping[str, object],
        rows_of: Callable[[int, int, int], np.ndarray],
        at_once: bool = False,
    ) -> None:
        """Write a step; the interface of `StepFiles.write`.

        Parameters
        ----------
        step : int
            Counted from 0.
        tags : mapping of str to object
            Of the VRT of this step.
        rows_of : callable (variable, first, last) -> float[last - first, columns]
        at_once : bool
            Without effect: steps are always written at once.
        """
        self._open.write(step, rows_of)
        self._write_vrt(step, tags)

    def finish(self) -> None:
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
def finished(writer: StepFiles | StepStacks) -> Iterator[StepFiles | StepStacks]:
    """Yield the writer of the steps, and finish it after this block, also after errors.

    Parameters
    ----------
    writer : StepFiles or StepStacks

    Raises
    ------
    OutputError
        The last steps cannot be written.
    """
    try:
        yield writer
    finally:
        try:
            writer.finish()
        except OSError as error:
            raise OutputError(str(output_error(writer.folder, error))) from error
