"""Write the rasters of a run from the particles in memory: `[output] rasters = true`.

They are those of `export-raster` of its frames. A step is written before its frame. The maxima are in the state of
frames for a restart. A run that is continued writes the steps after its last frame again, with the same values.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...exchange.frame_list import FrameEntry
from ...frames.flow_end import FlowEnd
from ...frames.frame_contents import stored_type
from ...frames.frame_files import read_frame
from ...frames.run_maps import MAPS, RASTERS, TERRAIN, map_names, remove_summaries
from ...frames.run_terrain import dtm_name
from ...laws.quantities import BAND
from ...system.errors import FormatError, InputError, SceneError
from ...system.messages import log
from ...system.whole_files import whole_file
from ...terrain.raster_output import write_rows
from ..averaging.band_products import PRODUCTS, RUNNING, choose_products
from ..averaging.bed_change import eroded_depth
from ..averaging.export_resolution import default_cell_size, export_grid, require_cells_within
from ..averaging.frame_values import Averaging, average_frame
from ..averaging.maxima import MAXIMA_BANDS, RUNNING_BANDS, RunningMaxima, SolverPeaks
from ..averaging.placement import Bed
from ..qgis.raster_styles import raster_styles, with_classes
from .bed_rasters import write_bed_rasters
from .export_decisions import needed_products
from .export_messages import log_export
from .export_options import export_with
from .export_plan import ExportPlan
from .step_rasters import (
    Tally,
    absorb_peaks,
    exported,
    run_tags,
    write_last_step,
    write_maxima,
    write_step,
    write_terrain,
)

if TYPE_CHECKING:
    from ...frames.particles import Frame
    from ...frames.run_folder import RunFolder
    from ...terrain.elevation import Terrain
    from ...terrain.grid import Grid

PREFIX = "rasters_"  # of arrays in the state of a frame
RATE = f"{PREFIX}rate"  # largest speed at which the bed receded
KEPT_SECONDS = 60.0  # [s] shortest wall time between two frames with particles
KEPT_SHARE = 0.05  # [1] largest share of the wall time for writing these frames


@dataclass(frozen=True)
class RunPlan(ExportPlan):
    """The plan of an export of all frames of a run, which are in memory one after the other."""

    interval: float = 0.0  # [s]

    @property
    def frames_text(self) -> str:
        """Times of the frames."""
        return f"every {self.interval:g} s, in the run"


class RasterWriter:
    """Writer of the rasters of a run, and of frames of particles from time to time.

    Parameters
    ----------
    folder : RunFolder
        Locked.
    prepared : Prepared
        Scene and first frame of the run.
    terrain : Terrain
        As it is in the folder.
    resumed : bool
        The maxima are those of the newest frame in the folder.
    """

    def __init__(self, folder: "RunFolder", prepared: Any, terrain: "Terrain", resumed: bool):
        self.folder = folder
        output = prepared.scene.output
        bands = bands_of(output.raster_products)
        usual = export_with()
        least = usual["min_depth"] if output.raster_min_depth is None else output.raster_min_depth
        grid = raster_grid(terrain.grid, output.raster_cell_size, prepared.coarsest_cells)
        averaging = Averaging(
            bed=Bed.of(terrain, usual["bed"], 0.0, clamped=False),
            grid=grid,
            density=prepared.frame.header["density"],
            names=needed_products((*bands, "mass")),
            min_depth=least,
        )
        name = _name_of(folder, resumed)
        dem, interval = dtm_name(terrain.path), output.frame_interval
        self.plan = RunPlan(name, (), (), averaging, bands, terrain, None, dem=dem, interval=interval)
        self.maxima, self.tally = RunningMaxima(grid.shape[0] * grid.shape[1], averaging.min_depth), Tally()
        self._bed, self._rate, self._last = None, None, None
        self._kept_at, self._kept_for = time.perf_counter(), 0.0
        if resumed:
            self._restore(read_frame(folder.newest_frame()))
            remove_summaries(folder.path, name)
            return
        with whole_file(self._place / TERRAIN) as part:
            write_terrain(self._with(self._entry(prepared.frame)), part, False)

    @property
    def _place(self):
        return self.folder.place / MAPS

    def _entry(self, frame, path=None):
        """What an export knows of `frame`, the next one without a `path`, before it reads its particles."""
        path = path or self.folder.path / f"frame_{self.folder.frames:06d}.h5"
        return FrameEntry(path, replace(frame, particles=None, state={}, maxima={}, bed_change={}))

    def _with(self, entry, **changes):
        return replace(self.plan, entries=(entry,), steps=(0,), **changes)

    def add(self, frame: "Frame") -> None:
        """Write the step of the next frame, and the frame itself if it is time.

        Parameters
        ----------
        frame : Frame
        """
        frame = self._add_step(frame)
        if self.folder.frames == 0 or time.perf_counter() - self._kept_at >= max(
            KEPT_SECONDS, self._kept_for / KEPT_SHARE
        ):
            self._keep(frame)
        else:
            self.folder.pass_frame(frame)

    def _keep(self, frame=None):
        """Write the particles of `frame`, or of the newest frame."""
        began = time.perf_counter()
        self.folder.keep_frame(frame)
        self._kept_at = time.perf_counter()
        self._kept_for = self._kept_at - began

    def _add_step(self, frame):
        """Write the step of the next `frame`; returns the frame with the maxima in its state."""
        entry, plan = self._entry(frame), self.plan
        values = _values(frame, plan.averaging)
        self.tally.add(entry.path.name, values)
        self.tally.add_step(values)
        self.maxima.absorb(values.index, values.values, values.time, values.least)
        peaks = SolverPeaks.of(frame.maxima, frame.time) if set(plan.bands) & set(RUNNING_BANDS) else None
        absorb_peaks(plan.averaging, peaks, self.maxima)
        self._follow_bed(frame)
        write_step(self._with(entry), self, self.folder.frames, entry, values, self.maxima, peaks)
        self.plan = replace(plan, entries=(*plan.entries, entry))
        self._last = frame, values
        return replace(frame, state=frame.state | self._state())

    def write(self, step: int, tags: dict, rows_of: Callable, at_once: bool = False) -> None:
        """Write the raster of a step; called by `write_step`.

        Parameters
        ----------
        step : int
        tags : dict
        rows_of : callable
            Of (band, first row, row after the last): rows of a band.
        at_once : bool
            Not used.
        """
        path = self._place / RASTERS / f"{self.plan.name}_{step:04d}.tif"
        with whole_file(path) as part:
            write_rows(part, self.plan.averaging.grid, [BAND[name] for name in self.plan.bands], tags, rows_of)

    def finish(self, end: FlowEnd | None = None) -> None:
        """Write the newest frame, and maxima, last step and what became of the bed, of all frames so far.

        Parameters
        ----------
        end : FlowEnd, optional
            Of a run that is finished.
        """
        if self._last is None:  # the run ended before its first frame
            return
        self._keep()
        frame, values = self._last
        end = FlowEnd(values.time, values.moving, end is not None and end.came_to_rest)
        peaks = SolverPeaks.of(frame.maxima, frame.time)
        plan = replace(self.plan, steps=tuple(range(len(self.plan.entries))), peaks=peaks, bed_change=frame.bed_change)
        grid, name, rasters = plan.averaging.grid, plan.name, self._place / RASTERS
        absorb_peaks(plan.averaging, peaks, self.maxima)
        with whole_file(rasters / f"{name}_max.tif") as part:
            write_maxima(plan, part, self.maxima, self.tally, end, False)
        with whole_file(rasters / f"{name}_{end.file}.tif") as part:
            write_last_step(plan, part, values, end, False)
        write_bed_rasters(plan, rasters, values, end, run_tags(plan), False, self._rate)
        self._write_styles(plan, end)
        log.info(f"rasters of {self.folder.frames} steps, maxima and {end.words()}: {self._place}")
        log_export(export_with(cell_size=grid.cell_size), plan, self.tally)

    def _write_styles(self, plan, end):
        """Write a style for QGIS next to each raster."""
        files = [f"{plan.name}_{step:04d}.tif" for step in range(self.folder.frames)]
        run = exported(plan, self._place, files, self.maxima, self.tally, end)
        for file, text in raster_styles(with_classes(run, {})):
            with whole_file((self._place / file).with_suffix(".qml")) as part:
                part.write_text(text, encoding="utf-8", newline="\n")

    def _follow_bed(self, frame):
        """Add the speed at which the bed receded since the frame before."""
        if not frame.bed_change:
            return
        grid = self.plan.averaging.grid
        depth = eroded_depth(frame.bed_change, grid)
        if self._rate is None:
            self._rate = np.zeros(grid.shape)
        if self._bed is not None and frame.time > self._bed[0]:
            np.maximum(self._rate, (depth - self._bed[1]) / (frame.time - self._bed[0]), out=self._rate)
        self._bed = frame.time, depth

    def _state(self):
        """The maxima so far, by name: cells and values of each band; the largest rate of the bed."""
        state = {}
        for name in MAXIMA_BANDS:
            index = np.flatnonzero(self.maxima.seen[name])
            state |= {f"{PREFIX}{name}_cells": index, f"{PREFIX}{name}": self.maxima.values[name][index]}
        return state | ({} if self._rate is None else {RATE: self._rate})

    def _restore(self, frame):
        """Continue after the newest `frame` in the folder."""
        for name in MAXIMA_BANDS:
            index, found = self._restored(frame, f"{PREFIX}{name}_cells"), self._restored(frame, f"{PREFIX}{name}")
            sound = index.dtype.kind == "i" and index.shape == found.shape and found.dtype == np.float32
            if not sound or (index.size and not 0 <= index.min() <= index.max() < self.maxima.seen[name].size):
                raise _no_maxima(self.folder.newest_frame(), name)
            self.maxima.values[name][index], self.maxima.seen[name][index] = found, True
        if frame.bed_change:
            self._rate = self._restored(frame, RATE).copy()
            if self._rate.shape != self.plan.averaging.grid.shape or self._rate.dtype != float:
                raise _no_maxima(self.folder.newest_frame(), "erosion rate")
            self._bed = frame.time, eroded_depth(frame.bed_change, self.plan.averaging.grid)
        values = _values(frame, self.plan.averaging)
        self.tally.add(self.folder.newest_frame().name, values)
        self.plan = replace(self.plan, entries=(self._entry(frame, self.folder.newest_frame()),))
        self._last = frame, values

    def _restored(self, frame, name):
        """The array `name` of the state of `frame`."""
        if not isinstance(frame.state.get(name), np.ndarray):
            raise _no_maxima(self.folder.newest_frame(), name)
        return frame.state[name]


def bands_of(text: str | None) -> tuple[str, ...]:
    """Return the bands of a step, with those of [output] raster_products.

    Parameters
    ----------
    text : str or None
        Names, with commas between them.

    Raises
    ------
    SceneError
        Unknown bands.
    """
    names = () if text is None else tuple(name.strip() for name in text.split(","))
    for name in names:
        if name not in (*PRODUCTS, RUNNING):
            choice = ", ".join((*PRODUCTS, RUNNING))
            raise SceneError(f"[output] raster_products: unknown product {name!r}; choose from {choice}")
    products = choose_products([name for name in names if name != RUNNING])
    return (*products, *(RUNNING_BANDS if RUNNING in names else ()))


def raster_grid(terrain_grid: "Grid", cell_size: float | None, run_cells: float) -> "Grid":
    """Return the grid of the rasters, along the axes of the DTM.

    Parameters
    ----------
    terrain_grid : Grid
    cell_size : float or None [m]
        Of the scene; None: the finer of the cells of DTM and run.
    run_cells : float [m]
        Of the run.

    Raises
    ------
    SceneError
        Too many cells, or cells larger than the DTM.
    """
    option, otherwise = "raster_cell_size", "cut the terrain with [terrain] window"
    try:
        require_cells_within(terrain_grid, cell_size, False, option)
        cell_size = default_cell_size(terrain_grid, run_cells) if cell_size is None else cell_size
        return export_grid(terrain_grid, cell_size, north_up=False, option=option, otherwise=otherwise)
    except InputError as error:
        raise SceneError(f"[output] rasters: {error}") from error


def _name_of(folder, resumed):
    """The name of the rasters: of the folder, also if it got another name since the run began."""
    name = folder.path.resolve().name
    before = map_names(folder.path) if resumed else []
    if not before or name in before:
        return name
    log.info(f"the rasters keep the name that the folder had before: {before[0]}")
    return before[0]


def _no_maxima(path, name):
    return FormatError(f"{path} has no valid {name} of the rasters for a restart; start with --overwrite")


def _values(frame, averaging):
    """FrameValues of the particles as a frame stores them: points in single precision."""
    particles = frame.particles
    rounded = {
        name: values.astype(stored_type(name, frame.dimension)).astype(values.dtype)
        for name, values in particles.arrays().items()
    }
    return average_frame(replace(frame, particles=replace(particles, **rounded)), averaging)
