"""Description of an export folder: names of its files, its grid, its bands and their typical values."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from affine import Affine

from ...frames.flow_end import FlowEnd
from ...terrain.grid import Grid
from ...terrain.raster_input import open_raster
from ...terrain.raster_output import NAMESPACE

if TYPE_CHECKING:
    from ...laws.quantities import Quantity

TYPICAL_PERCENTILE = 99.0  # [%] of the wet cells' maxima: a few extreme cells must not use up the colour scale


@dataclass(frozen=True)
class ExportedRun:
    """The rasters of one exported run in a folder.

    `folder` is usually a temporary folder (`whole_files.whole_folder`), so that files in it need no temporary
    names.

    Parameters
    ----------
    folder : Path
        All file names below are relative to it.
    name : str
        Name of the run; prefix of its files.
    grid : Grid
        Export grid.
    terrain_file : str
        Terrain on the export grid.
    times : tuple of float [s]
        One per step, increasing.
    step_files : tuple of str
        One raster per step.
    step_bands, maxima_bands, last_bands : tuple of Quantity
        Bands of the rasters of a step, of the maxima and of the last step.
    maxima_file : str
    end : FlowEnd
        State of the flow in the last step, which names its raster.
    largest : dict of str to float
        Largest absolute finite value of each band over all steps.
    min_depth : float [m]
        Depth below which velocities are nodata; outlines enclose the cells at least this deep.
    around_file : str
        Terrain around the flow on the cells of the DTM; "" where `terrain_file` already shows it.
    layer_files, layer_bands : tuple of str, tuple of Quantity
        Rasters of layers of height, one per step, and their bands; empty without layers.
    bed_bands, surface_bands : tuple of Quantity
        Bands of `bed_file` and `ground_file`; empty without erosion, where there are no such files.
    facts : dict of str to str
        Parameters of the run for its print layout, by name.
    author : str
        Of the maps; "" if unknown.
    classes : dict of str to tuple of float
        Limits of classes that the user chose, by quantity.
    """

    folder: Path
    name: str
    grid: Grid
    terrain_file: str
    times: tuple
    step_files: tuple
    step_bands: tuple
    maxima_file: str
    maxima_bands: tuple
    last_bands: tuple
    end: FlowEnd
    largest: dict = field(default_factory=dict)
    min_depth: float = 0.05
    bed_bands: tuple = ()
    surface_bands: tuple = ()
    around_file: str = ""
    layer_files: tuple = ()
    layer_bands: tuple = ()
    facts: dict = field(default_factory=dict)
    author: str = ""
    classes: dict = field(default_factory=dict)

    @property
    def shown_terrain_file(self) -> str:
        """Name of the raster of the terrain on maps: with ground on every side of the flow."""
        return self.around_file or self.terrain_file

    @property
    def last_file(self) -> str:
        """Name of the raster of the last step: `_deposit` of a flow that came to rest, else `_last`."""
        return f"rasters/{self.name}_{self.end.file}.tif"

    @property
    def bed_file(self) -> str:
        """Name of the raster of eroded depth, rate and deposit, which runs with erosion have."""
        return f"rasters/{self.name}_bed.tif"

    @property
    def ground_file(self) -> str:
        """Name of the raster of the ground and the bed at the end, which runs with erosion have."""
        return f"rasters/{self.name}_surface.tif"

    @property
    def mesh_file(self) -> str:
        """Name of the UGRID mesh."""
        return f"{self.name}.nc"

    @property
    def outlines_file(self) -> str:
        """Name of the GeoPackage."""
        return f"{self.name}.gpkg"

    @property
    def project_file(self) -> str:
        """Name of the QGIS project."""
        return f"{self.name}.qgz"

    @property
    def surface_file(self) -> str:
        """Name of the raster of the highest flow surface."""
        return f"{self.name}_surface.tif"

    def stack_file(self, band: "str | Quantity") -> str:
        """Return the name of the stack of all steps of one band.

        Parameters
        ----------
        band : str or Quantity
        """
        return f"{self.name}_{getattr(band, 'name', band)}.vrt"

    def read(self, file: str, names: Sequence) -> list:
        """Read bands of one of the run's rasters, within `flow_window`.

        Parameters
        ----------
        file : str
            One of the run's own file names.
        names : sequence of str

        Returns
        -------
        list of float32[rows, columns]
            On `flow_grid`, NaN where there is no data; None for a band that the file does not have.
        """
        return self._read(file, names, self.flow_window)

    def _read(self, file, names, window):
        bands = [quantity.name for quantity in self.bands_of(file)]
        with open_raster(self.folder / file) as source:
            return [read_part(source, bands.index(name) + 1, window) if name in bands else None for name in names]

    def tags(self, file: str) -> dict[str, str]:
        """Read the tags of one of the run's rasters, which say how it was made.

        Parameters
        ----------
        file : str
        """
        with open_raster(self.folder / file) as source:
            return source.tags(ns=NAMESPACE)

    def bands_of(self, file: str) -> tuple:
        """Return the quantities of the bands of one of the run's rasters, in order.

        Parameters
        ----------
        file : str
        """
        known = {
            self.maxima_file: self.maxima_bands,
            self.last_file: self.last_bands,
            self.bed_file: self.bed_bands,
            self.ground_file: self.surface_bands,
        }
        return known.get(file, self.layer_bands if file in self.layer_files else self.step_bands)

    def read_terrain(self) -> np.ndarray:
        """Read the elevation on `flow_grid`.

        Returns
        -------
        float32[rows, columns] [m]
            NaN where there is none.
        """
        with open_raster(self.folder / self.terrain_file) as source:
            return read_part(source, 1, self.flow_window)

    @cached_property
    def flow_window(self) -> tuple[slice, slice]:
        """Rows and columns of the cells that the flow reached, plus one cell on each side.

        Dry terrain is not read at every step. The whole grid where no cell was reached.
        """
        everything = tuple(slice(0, size) for size in self.grid.shape)
        (peak,) = self._read(self.maxima_file, ("h_max",), everything)
        reached = np.isfinite(peak)
        if not reached.any():
            return everything
        found = (np.flatnonzero(reached.any(axis=axis)) for axis in (1, 0))
        return tuple(
            slice(max(int(along[0]) - 1, 0), min(int(along[-1]) + 2, size))
            for along, size in zip(found, self.grid.shape, strict=True)
        )

    @cached_property
    def thickness_is_depth(self) -> bool:
        """Whether the flow has one thickness and depth everywhere, as columns have."""
        depth, thickness = self.read(self.maxima_file, ("h_max", "t_max"))
        return depth is not None and thickness is not None and np.array_equal(depth, thickness, equal_nan=True)

    @cached_property
    def flow_grid(self) -> Grid:
        """Grid of `flow_window`."""
        rows, columns = self.flow_window
        transform = moved_corner(self.grid.transform, rows.start, columns.start)
        return Grid(self.grid.crs, transform, (rows.stop - rows.start, columns.stop - columns.start))

    @cached_property
    def typical(self) -> dict[str, float]:
        """Typical size of the values of each band, by name: range of the colour scale.

        The 99th percentile over the wet cells of a maxima band, also for the band of which it is the maximum; the
        largest value where there is no maximum.
        """
        typical = {name: value for name, value in self.largest.items() if value > 0}
        names = [quantity.name for quantity in self.maxima_bands]
        peaks = {}
        for name, values in zip(names, self.read(self.maxima_file, names), strict=True):
            sizes = np.abs(values[np.isfinite(values) & (values != 0)])
            if sizes.size:
                typical[name] = float(np.percentile(sizes, TYPICAL_PERCENTILE))
                peak_of = name.removesuffix("_max").removesuffix("_min")
                peaks[peak_of] = max(peaks.get(peak_of, 0.0), typical[name])
        for name in ("Un_max", "Un_min"):  # both ends share one symmetric scale with Un
            if name in typical and "Un" in peaks:
                typical[name] = peaks["Un"]
        if "t_arrival" in names and len(self.times):
            typical["t_arrival"] = float(self.times[-1])
        return typical | {name: peak for name, peak in peaks.items() if name not in names}


def moved_corner(transform: Affine, row: int, column: int) -> Affine:
    """Return the affine transform of the part of a raster that begins at a cell.

    Parameters
    ----------
    transform : Affine
        Of the raster.
    row, column : int
    """
    t = transform
    return Affine(t.a, t.b, t.c + t.a * column + t.b * row, t.d, t.e, t.f + t.d * column + t.e * row)


def read_part(source: object, band: int, window: (slice | slice)) -> np.ndarray:
    """Read a part of a band of an open raster.

    Parameters
    ----------
    source : rasterio.DatasetReader
    band : int
        From 1.
    window : (slice, slice)
        Rows and columns.

    Returns
    -------
    float32[rows, columns]
        NaN for nodata.
    """
    values = source.read(band, window=tuple((part.start, part.stop) for part in window), out_dtype="float32")
    if source.nodata is not None:
        values[values == np.float32(source.nodata)] = np.nan
    return values
