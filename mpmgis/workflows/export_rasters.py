"""The rasters of an export: one pass over the frames, steps written on the way, maxima and deposit at the end."""

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from .. import __version__, system
from ..analysis.frame_values import average_frame
from ..analysis.maxima import MAXIMA_BANDS, PEAKS, Peak, RunningMaxima
from ..analysis.quantities import PRODUCTS
from ..fields import BAND, Quantity
from ..gis.outlines import shown_particles, step_outline
from ..io.exported import ExportedRun
from ..io.raster_output import SparseBands, StepFiles, StepStacks, finished, write_ascii_grid, write_rows
from .export_inputs import refuse_nowhere, release_name, solver_peaks

DEPOSIT_BANDS = ("h", "t", "t_vol")
ARROW_BANDS = ("Ut_E", "Ut_N")
TERRAIN_BAND = Quantity("elevation", "m", "terrain elevation", "float32")
# ISeeSnow: peak flow thickness [m], peak flow velocity [m s-1], peak pressure [kPa]
ISEESNOW = {"pft": Peak("t_vol", True), "pfv": Peak("Ut", True), "ppr": Peak("p", True)}
ISEESNOW_PRODUCTS = ("h", "Ut", "t_vol", "p")
PASCAL_PER_KILOPASCAL = 1000.0
DIGEST_LENGTH = 10  # as many characters as the intercomparison's other codes give


@dataclass(frozen=True)
class StepShapes:
    """What a frame gives to the GeoPackage if it is exported: its outline and the particles to show."""

    outline: object
    shown: dict


def average_entry(entry, averaging, totals):
    """The values of one frame on disk and its shapes, particles thinned as if from `totals[dimension]` (or no shapes).

    One run may hold columns first and points then: each kind is shown by as many.
    """
    frame = entry.read(averaging.density)
    values = average_frame(frame, averaging)
    if not totals:
        return values, None
    bands = values.values
    outline = step_outline(values.index, bands["h"], bands["Ut"], averaging.grid, averaging.min_depth)
    return values, StepShapes(outline, shown_particles(frame, totals[frame.dimension]))


@dataclass
class Tally:
    """The worst frame of each kind, and the largest values, told when all frames are done."""

    outside: tuple = (0, 0.0, "")
    without_slope: tuple = (0, "")
    below: tuple = (0.0, 0.0, "")
    moved: tuple = (0, "")
    column_side: float = 0.0
    point_side: tuple = (0.0, "")
    speeds: list = field(default_factory=list)  # [m s-1] largest mean speed on the map of each frame
    largest: dict = field(default_factory=dict)
    frames: list = field(default_factory=list)  # (particles, mass [kg], share of it below the bed) of each

    def add(self, name, values):
        """Take in the values of the frame called `name`."""
        self.frames.append((values.count, values.mass, values.below))
        self.outside = max(self.outside, (values.outside, values.mass_outside, name))
        self.without_slope = max(self.without_slope, (values.without_slope, name))
        self.moved = max(self.moved, (values.moved, name))
        self.below = max(self.below, (values.below, values.lowest, name))
        self.column_side = max(self.column_side, values.column_side)
        self.point_side = max(self.point_side, (values.point_side, name))
        self.speeds.append(values.fastest)

    def add_step(self, values):
        """Take in the values of an exported step."""
        for name, value in values.values.items():
            largest = float(np.fmax.reduce(np.abs(value), initial=0.0))
            self.largest[name] = max(self.largest.get(name, 0.0), largest)


def write_rasters(request, plan, folder, pool, spool, progress):
    """Average every frame of `plan` and write all rasters into `folder`.

    Parameters
    ----------
    request : ExportRequest
    plan : Plan
    folder : Path
        In the making.
    pool : FramePool
    spool : StepSpool or None
        Filled where the QGIS files are going to be made.
    progress : callable
        Told (frames done, frames in all).

    Returns
    -------
    (ExportedRun, Tally)
    """
    rasters = folder / "rasters"
    rasters.mkdir()
    averaging, grid = plan.averaging, plan.averaging.grid
    maxima = RunningMaxima(grid.shape[0] * grid.shape[1], averaging.min_depth)
    second = _second_maxima(averaging)
    tally, step_of = Tally(), {frame: step for step, frame in enumerate(plan.steps)}
    totals = {entry.header.dimension: entry.count for entry in reversed(plan.entries)} if spool is not None else {}
    with finished(_step_writer(request, plan, rasters, pool)) as writer:
        results = pool.map(average_entry, plan.entries, averaging, totals)
        for frame, (entry, (values, shapes)) in enumerate(zip(plan.entries, results, strict=True)):
            if values.count in (values.outside, values.moved):
                refuse_nowhere(entry, plan.terrain)
            tally.add(entry.path.name, values)
            maxima.absorb(values.index, values.values, values.time, values.least)
            if second is not None:
                second.absorb(*values.second, values.time, values.least)
            peaks = _peaks_up_to(plan, frame)
            _absorb_peaks(averaging, peaks, maxima, second)
            if frame in step_of:
                tally.add_step(values)
                _write_step(plan, writer, step_of[frame], entry, values, maxima, peaks)
                if spool is not None:
                    spool.add(values.index, values.values, shapes.outline, shapes.shown)
            progress(frame + 1, len(plan.entries))
    _write_maxima(plan, rasters, maxima, tally, request.cog)
    _write_deposit(plan, rasters, values, request.cog)  # of the last frame, whichever steps were asked for
    _write_terrain(plan, folder, request.cog)
    if second is not None:
        _write_iseesnow(plan, rasters, second)
    return _exported(plan, folder, writer.files, maxima, tally), tally


def _second_maxima(averaging):
    if averaging.second_grid is None:
        return None
    rows, columns = averaging.second_grid.shape
    return RunningMaxima(rows * columns, averaging.min_depth, ISEESNOW)


def _peaks_up_to(plan, frame):
    """The solver's peaks up to a frame: of the last one, and of each where the steps show maxima so far."""
    if frame == len(plan.entries) - 1:
        return plan.peaks
    return solver_peaks(plan.entries[frame]) if set(plan.bands) & set(PEAKS) else None


def _absorb_peaks(averaging, peaks, maxima, second):
    """Let what the solver kept of every step into the maxima on the export's grid and on the second one."""
    if peaks is None:
        return
    for store, grid in ((maxima, averaging.grid), (second, averaging.second_grid)):
        if store is not None:
            for index, values in peaks.on(grid, averaging.bed, averaging.min_depth):
                store.absorb_peaks(index, values)


def _maxima_tags(plan, peaks):
    """Where the maxima come from, and which of them the solver kept."""
    if peaks is None:
        return {"maxima": "frames"}
    return {
        "maxima": "solver, every step",
        "maxima_solver": ", ".join(peaks.bands(plan.averaging.min_depth)),
        "maxima_arrival_thickness": f"{peaks.arrival_thickness:g}",
    }


def _step_writer(request, plan, rasters, pool):
    quantities = [BAND[name] for name in plan.bands]
    grid, times = plan.averaging.grid, [plan.entries[frame].time for frame in plan.steps]
    if request.layout == "stacks":
        return StepStacks(rasters, plan.name, grid, quantities, times, run_tags(plan), request.cog)
    return StepFiles(rasters, plan.name, grid, quantities, len(times), request.cog, pool.threads, pool.workers)


def _write_step(plan, writer, step, entry, values, maxima, peaks):
    products = [name for name in plan.bands if name in PRODUCTS]
    running = plan.bands[len(products) :]
    known = SparseBands(
        plan.averaging.grid, values.index, [(values.values[name], PRODUCTS[name].empty) for name in products]
    )

    def rows_of(band, first, last):
        if band < len(products):
            return known(band, first, last)
        return maxima.rows(running[band - len(products)], first, last, known.columns)

    tags = run_tags(plan) | {
        "time": values.time,
        "step": step,
        "frame": entry.path.name,
        "particles": values.count,
        "particles_outside": values.outside,
        "mass_outside": values.mass_outside,
    }
    tags |= _maxima_tags(plan, peaks) if running else {}
    writer.write(step, tags, rows_of, at_once=bool(running))


def _write_maxima(plan, rasters, maxima, tally, cog):
    columns = plan.averaging.grid.shape[1]
    tags = run_tags(plan) | _maxima_tags(plan, plan.peaks)
    tags |= {"particles_outside": tally.outside[0], "mass_outside": tally.outside[1]}
    write_rows(
        rasters / f"{plan.name}_max.tif",
        plan.averaging.grid,
        [BAND[name] for name in MAXIMA_BANDS],
        tags,
        lambda band, first, last: maxima.rows(MAXIMA_BANDS[band], first, last, columns),
        cog,
    )


def _write_deposit(plan, rasters, values, cog):
    bands = [(values.values[name], PRODUCTS[name].empty) for name in DEPOSIT_BANDS]
    write_rows(
        rasters / f"{plan.name}_deposit.tif",
        plan.averaging.grid,
        [BAND[name] for name in DEPOSIT_BANDS],
        run_tags(plan)
        | {"time": values.time, "particles_outside": values.outside, "mass_outside": values.mass_outside},
        SparseBands(plan.averaging.grid, values.index, bands),
        cog,
    )


def _write_terrain(plan, folder, cog):
    grid, tags = plan.averaging.grid, {"dem": Path(plan.terrain.path).name, "dem_sha256": plan.terrain.sha256}
    rows_of = partial(_elevation, plan.terrain, grid)
    write_rows(folder / "dtm.tif", grid, [TERRAIN_BAND], tags, rows_of, cog)


def _elevation(terrain, grid, band, first, last):
    return terrain.rows_on(grid, first, last)


def _write_iseesnow(plan, rasters, maxima):
    """Peaks on the DTM's grid under the names of the model intercomparison; 0 where the flow never was."""
    grid, header = plan.averaging.second_grid, plan.entries[0].header
    release, digest = release_name(plan.entries), header.digest[:DIGEST_LENGTH] or "unknown"
    rows, columns = grid.shape
    on_terrain = np.isfinite(plan.terrain.rows_on(grid, 0, rows))
    for kind in ISEESNOW:
        values = np.nan_to_num(maxima.rows(kind, 0, rows, columns), nan=0.0)
        values = values / PASCAL_PER_KILOPASCAL if kind == "ppr" else values
        file = f"{system.file_name(f'{release}_{digest}')}_null_mpmgis_{kind}.asc"  # what a frame says is any text
        write_ascii_grid(rasters / file, grid, np.where(on_terrain, values, np.nan))


def run_tags(plan):
    """What every raster of the export says about how it was made."""
    averaging, first = plan.averaging, plan.entries[0]
    return {
        "version": __version__,
        "digest": first.header.digest,
        "dem": Path(plan.terrain.path).name,
        "cs_e": float(f"{averaging.grid.cell_size:.12g}"),  # the root of a pixel's area, without its rounding
        "dt_e": "every frame" if plan.time_step is None else plan.time_step,
        "percentile": averaging.percentile,
        "min_depth": averaging.min_depth,
        "bed": averaging.bed.kind,
        "standoff": averaging.bed.standoff,
        "outside": "in the nearest cell of the rim" if averaging.bed.clamped else "left out",
        "density": averaging.density,
        "thickness": "normal to the bed",
        "frames": f"{len(plan.entries)}, {first.path.name} to {plan.entries[-1].path.name}",
    }


def _exported(plan, folder, step_files, maxima, tally):
    largest = tally.largest | {name: maxima.largest(name) for name in MAXIMA_BANDS}
    return ExportedRun(
        folder=folder,
        name=plan.name,
        grid=plan.averaging.grid,
        terrain_file="dtm.tif",
        times=tuple(plan.entries[frame].time for frame in plan.steps),
        step_files=tuple(f"rasters/{file}" for file in step_files),
        step_bands=tuple(BAND[name] for name in plan.bands),
        maxima_file=f"rasters/{plan.name}_max.tif",
        maxima_bands=tuple(BAND[name] for name in MAXIMA_BANDS),
        deposit_file=f"rasters/{plan.name}_deposit.tif",
        deposit_bands=tuple(BAND[name] for name in DEPOSIT_BANDS),
        largest={name: value for name, value in largest.items() if name in BAND},
        min_depth=plan.averaging.min_depth,
    )
