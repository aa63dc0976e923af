"""Results in memory: folders and frames as xarray datasets, averaged as `mpmgis export-raster` does."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...exchange.frame_list import list_frames
from ...exchange.frame_source import ground_of, terms_of
from ...exchange.map_coordinates import Ground
from ...exchange.readers.reader_list import OWN
from ...frames.headline_numbers import ERROR_TAG
from ...frames.particles import Frame
from ...frames.run_terrain import run_terrain
from ...laws.quantities import BAND
from ...system.errors import GeoreferenceError, InputError
from ...system.parallel import frame_pool
from ...terrain.elevation import Terrain
from ...terrain.georeference import name_of, same_place
from ..averaging.band_products import PRODUCTS, choose_products
from ..averaging.exported_steps import is_export
from ..averaging.frame_values import Averaging, average_frame
from ..averaging.maxima import RunningMaxima, SolverPeaks
from .export_decisions import make_plan
from .export_inputs import refuse_nowhere
from .xarray_datasets import ELEVATION, averaged_step, averaged_steps, computed_bands, gridded, open_export, terrain_of

if TYPE_CHECKING:
    import xarray

    from .export_options import Export


@dataclass(frozen=True)
class GivenFrame:
    """A Frame in memory with the interface of a FrameEntry."""

    frame: Frame
    path: Path = Path("the frame")
    reader: str = OWN

    @property
    def header(self) -> Frame:
        """The frame without its particles."""
        return replace(self.frame, particles=None, header=self.frame.header | {"count": self.count})

    @property
    def time(self) -> float:
        """Time [s]."""
        return self.frame.time

    @property
    def count(self) -> int:
        """Number of particles."""
        return len(self.frame.particles)

    def read(self, density: float = 1000.0) -> Frame:
        """Return the frame, which has mass and volume.

        Parameters
        ----------
        density : float [kg m-3]
            Not used.
        """
        return self.frame

    def read_positions(self) -> Frame:
        """Return the frame."""
        return self.frame

    def read_maxima(self) -> dict:
        """Return the running peaks of the solver."""
        return self.frame.maxima

    def read_bed_change(self) -> dict:
        """Return what the flow took from its bed."""
        return self.frame.bed_change


@dataclass(frozen=True)
class AveragedSteps:
    """Function of the number of a step that reads and averages it at each call, to FrameValues.

    Parameters
    ----------
    entries : tuple of FrameEntry
        Of the steps.
    averaging : Averaging
    terrain : Terrain
        Of the entries.
    """

    entries: tuple
    averaging: Averaging
    terrain: Terrain

    def __call__(self, step):
        entry = self.entries[step]
        values = average_frame(entry.read(self.averaging.density), self.averaging)
        if values.outside == values.count:
            refuse_nowhere(entry, self.terrain)
        return values


@dataclass(frozen=True)
class SolverMaxima:
    """Function without arguments that puts the solver's maxima over all steps on cells, as float32 by band name.

    Parameters
    ----------
    peaks : SolverPeaks
    averaging : Averaging
        Its grid has the cells.
    """

    peaks: SolverPeaks
    averaging: Averaging

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the maxima bands."""
        return self.peaks.bands(self.averaging.min_depth)

    def __call__(self):
        grid, min_depth = self.averaging.grid, self.averaging.min_depth
        maxima = RunningMaxima(grid.shape[0] * grid.shape[1], min_depth)
        for index, values in self.peaks.on(grid, self.averaging.bed, min_depth):
            maxima.absorb_peaks(index, values)
        return {name: maxima.rows(name, 0, *grid.shape) for name in self.names}


def open_results(
    folder: str | Path,
    asked: "Export",
    dem: "str | Path | Terrain | xarray.DataArray | None" = None,
    given: Sequence = (),
) -> "xarray.Dataset":
    """Open a folder as a lazy dataset: an export, or frames that are averaged when values are needed.

    Parameters
    ----------
    folder : str or Path
    asked : Export
        Of frames.
    dem : str, Path, Terrain or xarray.DataArray, optional
        As in `depth_average`.
    given : sequence of str
        Names of the options given, which are an error for an exported folder.

    Raises
    ------
    MpmgisError
    """
    folder = Path(folder)
    if is_export(folder):
        idle = [*(["dem"] if dem is not None else []), *given]
        if idle:
            raise InputError(f"{folder} is an exported folder with fixed cells; {', '.join(idle)} requires frames")
        return open_export(folder)
    return _dataset(asked, _entries(asked, folder, dem), dem, lazy=True)


def depth_average(
    frame: "str | Path | Frame", asked: "Export", dem: "str | Path | Terrain | xarray.DataArray | None" = None
) -> "xarray.Dataset":
    """Average one frame onto cells in memory (NHESS Eqs 2 to 14).

    Parameters
    ----------
    frame : str, Path or Frame
    asked : Export
    dem : str, Path, Terrain or xarray.DataArray, optional
        With the georeference of rioxarray if it is an array. Default: the DTM named in the frame.

    Returns
    -------
    xarray.Dataset
        Without a dimension of time.

    Raises
    ------
    MpmgisError
    """
    given = isinstance(frame, Frame)
    entries = (GivenFrame(frame),) if given else _entries(asked, frame, dem)
    if len(entries) > 1:
        raise InputError(f"{frame} contains {len(entries)} frames, expected one; mpmgis.open_results averages them all")
    return _dataset(asked, entries, dem, lazy=False).isel(time=0)


def _dataset(asked, entries, dem, lazy):
    """The steps, averaged when needed, with the solver's maxima; if not `lazy` the first step in memory."""
    products = choose_products(asked["products"])
    if dem is None or isinstance(dem, (str, Path)):
        terrain = run_terrain({**asked, "dem": None if dem is None else Path(dem)}, entries, None)
    else:
        terrain = _terrain_in_memory(dem, entries[0])
    with frame_pool() as pool:
        plan = make_plan(asked, entries, terrain, products, pool)
    grid, steps = plan.averaging.grid, tuple(plan.entries[frame] for frame in plan.steps)
    quantities = [(BAND[name], PRODUCTS[name].empty) for name in products]
    averaged = AveragedSteps(steps, plan.averaging, terrain)
    if lazy:
        variables = averaged_steps(len(steps), quantities, grid, averaged)
    else:
        variables = averaged_step(quantities, grid, averaged(0))
    if lazy and plan.peaks is not None:
        kept = SolverMaxima(plan.peaks, plan.averaging)
        variables |= computed_bands([BAND[name] for name in kept.names], grid, kept)
    variables[ELEVATION.name] = ELEVATION, plan.terrain.rows_on(grid, 0, grid.shape[0]).astype(np.float32)
    return gridded(
        grid,
        variables,
        [entry.time for entry in steps],
        title=plan.name,
        density=plan.averaging.density,
        min_depth=plan.averaging.min_depth,
        **({ERROR_TAG: plan.errors} if plan.errors else {}),
    )


def _entries(asked, path, dem):
    """The frames at a path on a DTM; an array is none here, because its georeference is not known yet."""
    if isinstance(dem, (str, Path)):
        asked = {**asked, "dem": Path(dem)}
    ground = Ground(terrain=dem) if isinstance(dem, Terrain) else ground_of(asked)
    return list_frames([path], terms_of(asked), ground)


def _terrain_in_memory(dem, entry):
    terrain = dem if isinstance(dem, Terrain) else terrain_of(dem)
    if entry.header.crs is not None and not same_place(entry.header.crs, terrain.grid.crs):
        raise GeoreferenceError(
            f"{entry.path} is in {name_of(entry.header.crs)}, but the DTM given is in {name_of(terrain.grid.crs)}; "
            "reproject it (dem.rio.reproject)"
        )
    return terrain
