"""Description of an export folder, and values of cells over time read from it."""

import re
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from affine import Affine

from ...system.errors import FormatError, InputError
from ...terrain.grid import Grid
from ...terrain.raster_input import grid_of, open_raster, read_raster
from ...terrain.raster_output import NAMESPACE
from .frame_values import NOWHERE

TYPICAL_PERCENTILE = 99.0  # of the wet cells' maxima: a few extreme cells must not use up the colour scale


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
    step_bands, maxima_bands, deposit_bands : tuple of Quantity
        Bands of the rasters of a step, of the maxima and of the deposit.
    maxima_file, deposit_file : str
    largest : dict of str to float
        Largest absolute finite value of each band over all steps.
    min_depth : float [m]
        Depth below which velocities are nodata; outlines enclose the cells at least this deep.
    bed_bands, surface_bands : tuple of Quantity
        Bands of `bed_file` and `ground_file`; empty without erosion, where there are no such files.
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
    deposit_file: str
    deposit_bands: tuple
    largest: dict = field(default_factory=dict)
    min_depth: float = 0.05
    bed_bands: tuple = ()
    surface_bands: tuple = ()

    @property
    def bed_file(self):
        """Name of the raster of eroded depth, rate and deposit, which runs with erosion have."""
        return f"rasters/{self.name}_bed.tif"

    @property
    def ground_file(self):
        """Name of the raster of the ground and the bed at the end, which runs with erosion have."""
        return f"rasters/{self.name}_surface.tif"

    @property
    def mesh_file(self):
        """Name of the UGRID mesh."""
        return f"{self.name}.nc"

    @property
    def outlines_file(self):
        """Name of the GeoPackage."""
        return f"{self.name}.gpkg"

    @property
    def project_file(self):
        """Name of the QGIS project."""
        return f"{self.name}.qgz"

    @property
    def surface_file(self):
        """Name of the raster of the highest flow surface."""
        return f"{self.name}_surface.tif"

    def stack_file(self, band):
        """Name of the stack of all steps of one band (its name or Quantity)."""
        return f"{self.name}_{getattr(band, 'name', band)}.vrt"

    def read(self, file, names):
        """Bands by name of one of the run's rasters, within `flow_window`.

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
        import rasterio

        bands = [quantity.name for quantity in self.bands_of(file)]
        with rasterio.open(self.folder / file) as source:
            return [read_part(source, bands.index(name) + 1, window) if name in bands else None for name in names]

    def tags(self, file):
        """Dict of str to str: the tags of one of the run's rasters that say how it was made."""
        with open_raster(self.folder / file) as source:
            return source.tags(ns=NAMESPACE)

    def bands_of(self, file):
        """Tuple of Quantity: the bands of one of the run's rasters, in order."""
        known = {
            self.maxima_file: self.maxima_bands,
            self.deposit_file: self.deposit_bands,
            self.bed_file: self.bed_bands,
            self.ground_file: self.surface_bands,
        }
        return known.get(file, self.step_bands)

    def read_terrain(self):
        """float32[rows, columns] [m]: elevation on `flow_grid`, NaN where there is none."""
        import rasterio

        with rasterio.open(self.folder / self.terrain_file) as source:
            return read_part(source, 1, self.flow_window)

    @cached_property
    def flow_window(self):
        """(row slice, column slice) of the cells that the flow reached, plus one cell on each side.

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
    def flow_grid(self):
        """Grid of `flow_window`."""
        rows, columns = self.flow_window
        transform = moved_corner(self.grid.transform, rows.start, columns.start)
        return Grid(self.grid.crs, transform, (rows.stop - rows.start, columns.stop - columns.start))

    @cached_property
    def typical(self):
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


def moved_corner(transform, row, column):
    """Affine transform of the part of a raster that begins at `row`, `column`."""
    t = transform
    return Affine(t.a, t.b, t.c + t.a * column + t.b * row, t.d, t.e, t.f + t.d * column + t.e * row)


def read_part(source, band, window):
    """float32[rows, columns]: `window` (row slice, column slice) of a band of an open raster, NaN for nodata."""
    values = source.read(band, window=tuple((part.start, part.stop) for part in window), out_dtype="float32")
    if source.nodata is not None:
        values[values == np.float32(source.nodata)] = np.nan
    return values


_STEP_NAME = re.compile(r"(.+)_\d{4,}\.(?:tif|vrt)")


@dataclass(frozen=True)
class ExportedSteps:
    """An export on disk: `name`, one raster for each of `times` [s] on one `grid`, `tags` of the rasters."""

    name: str
    files: tuple
    times: tuple
    bands: tuple
    grid: object
    tags: dict
    terrain: Path

    def read(self, step, names, cells):
        """Name -> float64[n] of bands in the flat `cells` of the grid; NaN outside the grid and for nodata."""
        row, column = np.divmod(np.where(cells == NOWHERE, 0, cells), self.grid.shape[1])
        found = {}
        for name in names:
            values, _ = read_raster(self.files[step], self.bands.index(name) + 1, may_be_empty=True)
            found[name] = np.where(cells == NOWHERE, np.nan, values[row, column])
        return found


def is_export(path):
    """Whether `path` is a folder that `export-raster` wrote."""
    return (Path(path) / "rasters").is_dir()


def open_steps(folder):
    """The ExportedSteps in `folder`.

    Raises
    ------
    FormatError, InputError
        No steps, steps of several runs, or steps without times.
    """
    folder = Path(folder)
    matches = [(path, _STEP_NAME.fullmatch(path.name)) for path in sorted((folder / "rasters").iterdir())]
    found = {path: match[1] for path, match in matches if match}
    if not found:
        raise FormatError(
            f"{folder} contains no steps (rasters/<name>_0000.tif, ...); give frames, or a folder of export-raster"
        )
    if len(set(found.values())) > 1:
        raise InputError(
            f"{folder} contains steps of {len(set(found.values()))} runs; give the frames of one run instead"
        )
    timed = sorted((_time(path), path) for path in found)
    with open_raster(timed[0][1]) as source:
        bands = tuple((text or "").partition(" [")[0] for text in source.descriptions)
        tags, grid = source.tags(ns=NAMESPACE), grid_of(source, timed[0][1])
    times, files = zip(*timed, strict=True)
    return ExportedSteps(next(iter(found.values())), files, times, bands, grid, tags, folder / "dtm.tif")


def _time(path):
    """Time [s] in the tags of a step."""
    with open_raster(path) as source:
        time = source.tags(ns=NAMESPACE).get("time")
    try:
        return float(time)
    except (TypeError, ValueError):
        raise FormatError(f"{path} has no valid tag time (mpmgis: {time}); export the frames again") from None
