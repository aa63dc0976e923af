"""Write the rasters of an export: one pass over the frames writes the steps; then maxima and last step follow."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ... import __version__
from ...frames.flow_end import FlowEnd, rests
from ...frames.headline_numbers import ERROR_TAG
from ...laws.quantities import BAND, Quantity
from ...system import operating_system
from ...terrain.raster_output import SparseBands, write_ascii_grid, write_rows
from ...terrain.raster_series import StepFiles, StepStacks, finished
from ..averaging.band_products import PRODUCTS
from ..averaging.exported_folder import ExportedRun
from ..averaging.frame_values import average_frame
from ..averaging.height_layers import layer_quantities
from ..averaging.maxima import MAXIMA_BANDS, PEAKS, Peak, RunningMaxima
from ..qgis.outlines import StepOutline, shown_particles, step_outline
from .bed_rasters import SURFACE_BANDS, bed_bands, write_bed_rasters
from .export_inputs import refuse_nowhere, release_name, run_end, solver_peaks

if TYPE_CHECKING:
    from ...exchange.frame_list import FrameEntry
    from ...system.parallel import FramePool
    from ...terrain.grid import Grid
    from ..averaging.frame_values import Averaging, FrameValues
    from ..averaging.maxima import SolverPeaks
    from ..qgis.outlines import StepSpool
    from .export_options import Export
    from .export_plan import ExportPlan

LAST_BANDS = ("h", "t", "t_vol")
ARROW_BANDS = ("Ut_E", "Ut_N")  # components of the arrows of the mesh
AROUND_FILE = "dtm_around.tif"
MOST_AROUND = 4_000_000  # [cells] of a DTM that a map shows whole
TERRAIN_BAND = Quantity("elevation", "m", "terrain elevation", "float32")
# ISeeSnow: peak flow thickness [m], peak flow velocity [m s-1], peak pressure [kPa]
ISEESNOW = {"pft": Peak("t_vol", True), "pfv": Peak("Ut", True), "ppr": Peak("p", True)}
ISEESNOW_PRODUCTS = ("h", "Ut", "t_vol", "p")
PASCAL_PER_KILOPASCAL = 1000.0  # [Pa kPa-1]
DIGEST_LENGTH = 10  # [letters] as in other codes of the intercomparison


@dataclass(frozen=True)
class StepShapes:
    """Features of an exported frame in the GeoPackage.

    Parameters
    ----------
    outline : StepOutline or None
    shown : dict
        The particles that are shown (`shown_particles`).
    """

    outline: StepOutline | None
    shown: dict


def average_entry(entry: "FrameEntry", averaging: "Averaging", totals: dict) -> "tuple[FrameValues, StepShapes | None]":
    """Read and average one frame on disk, and make its shapes.

    Particles are thinned separately for columns and points.

    Parameters
    ----------
    entry : FrameEntry
    averaging : Averaging
    totals : dict of int to int
        Number of particles by dimension, from which they are thinned; empty: no shapes.

    Returns
    -------
    (FrameValues, StepShapes or None)
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
    """The worst frame for each message, and the largest values.

    Parameters
    ----------
    outside : (int, float, str)
        Particles outside the DTM, their mass [kg], name of the frame.
    without_slope : (int, str)
        Particles on pixels without a slope, name of the frame.
    below : (float, float, str)
        Share of the mass below the DTM [1], smallest distance from it [m], name of the frame.
    moved : (int, str)
        Particles moved to the edge, name of the frame.
    column_side : float [m]
        Largest resolution of columns.
    point_side : (float, str)
        Largest cell size of Eq 15 [m], name of the frame.
    speeds : list of float [m s-1]
        Largest mean speed on the map of each frame.
    largest : dict of str to float
        Largest absolute value of each band over the steps.
    frames : list of (int, float, float)
        Particles, mass [kg], and share of it below the DTM of each frame.
    kinetic_peak : float [J]
        Largest kinetic energy of a frame.
    solver_cell : float [m]
        Largest node spacing of a solver; 0 if it is unknown.
    """

    outside: tuple = (0, 0.0, "")
    without_slope: tuple = (0, "")
    below: tuple = (0.0, 0.0, "")
    moved: tuple = (0, "")
    column_side: float = 0.0
    point_side: tuple = (0.0, "")
    speeds: list = field(default_factory=list)  # [m s-1] largest mean speed on the map of each frame
    largest: dict = field(default_factory=dict)
    frames: list = field(default_factory=list)  # (particles, mass [kg], share of it below the bed) of each
    kinetic_peak: float = 0.0
    solver_cell: float = 0.0

    def add(self, name: str, values: "FrameValues") -> None:
        """Add the values of a frame.

        Parameters
        ----------
        name : str
            Of the frame.
        values : FrameValues
        """
        self.frames.append((values.count, values.mass, values.below))
        self.outside = max(self.outside, (values.outside, values.mass_outside, name))
        self.without_slope = max(self.without_slope, (values.without_slope, name))
        self.moved = max(self.moved, (values.moved, name))
        self.below = max(self.below, (values.below, values.lowest, name))
        self.column_side = max(self.column_side, values.column_side)
        self.point_side = max(self.point_side, (values.point_side, name))
        self.speeds.append(values.fastest)
        self.kinetic_peak = max(self.kinetic_peak, values.kinetic)
        self.solver_cell = max(self.solver_cell, values.solver_cell)

    def add_step(self, values: "FrameValues") -> None:
        """Add the values of an exported step.

        Parameters
        ----------
        values : FrameValues
        """
        for name, value in values.values.items():
            largest = float(np.fmax.reduce(np.abs(value), initial=0.0))
            self.largest[name] = max(self.largest.get(name, 0.0), largest)


def write_rasters(
    asked: "Export", plan: "ExportPlan", folder: Path, pool: "FramePool", spool: "StepSpool | None", progress: Callable
) -> tuple[ExportedRun, Tally]:
    """Average every frame of a plan and write all rasters.

    Parameters
    ----------
    asked : Export
    plan : ExportPlan
    folder : Path
        Being written.
    pool : FramePool
    spool : StepSpool or None
        For the QGIS files.
    progress : callable
        Called with (frames done, frames in all).

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
    with finished(_step_writer(asked, plan, rasters, pool)) as writer:
        results = pool.map(average_entry, plan.entries, averaging, totals)
        for frame, (entry, (values, shapes)) in enumerate(zip(plan.entries, results, strict=True)):
            peaks = _absorb(plan, frame, values, tally, maxima, second)
            if frame in step_of:
                tally.add_step(values)
                write_step(plan, writer, step_of[frame], entry, values, maxima, peaks)
                tally.largest |= _write_layers(plan, folder, step_of[frame], entry, values, tally, asked["cog"])
                if spool is not None:
                    spool.add(values.index, values.values, shapes.outline, shapes.shown)
            progress(frame + 1, len(plan.entries))
    end = _end_of_frames(plan, values, tally)
    write_maxima(plan, rasters / f"{plan.name}_max.tif", maxima, tally, end, asked["cog"])
    # of the last frame, whatever the steps
    write_last_step(plan, rasters / f"{plan.name}_{end.file}.tif", values, end, asked["cog"])
    write_terrain(plan, folder / "dtm.tif", asked["cog"])
    tally.largest |= write_bed_rasters(plan, rasters, values, end, run_tags(plan), asked["cog"])
    if second is not None:
        _write_iseesnow(plan, rasters, second)
    run = exported(plan, folder, writer.files, maxima, tally, end)
    if not asked["qgis"]:
        return run, tally
    return replace(run, around_file=_write_around(plan, folder, maxima, asked["cog"])), tally


def _end_of_frames(plan, values, tally):
    """Return the FlowEnd of the last frame, with `values`: as its run recorded it, else from the energy of all frames.

    The record of the run decides only whether the flow came to rest, and only if the frame is its last one.
    """
    recorded = run_end(plan.entries[-1])
    at_rest = rests(values.moving, values.kinetic, tally.kinetic_peak) if recorded is None else recorded.came_to_rest
    return FlowEnd(values.time, values.moving, at_rest)


def frame_maxima(plan: "ExportPlan", pool: "FramePool", progress: Callable) -> tuple[dict, Tally, FlowEnd]:
    """Compute maxima and last step of the frames of a plan in memory.

    Parameters
    ----------
    plan : ExportPlan
    pool : FramePool
    progress : callable
        Called with (frames done, frames in all).

    Returns
    -------
    (dict of str to float32[rows, columns], Tally, FlowEnd)
        Bands as in an export, those of the last step with the ending of its file; NaN where there was no flow.
    """
    averaging, grid = plan.averaging, plan.averaging.grid
    rows, columns = grid.shape
    maxima, tally = RunningMaxima(rows * columns, averaging.min_depth), Tally()
    for frame, (values, _) in enumerate(pool.map(average_entry, plan.entries, averaging, {})):
        _absorb(plan, frame, values, tally, maxima, None)
        progress(frame + 1, len(plan.entries))
    bands = {name: maxima.rows(name, 0, rows, columns) for name in MAXIMA_BANDS}
    end = _end_of_frames(plan, values, tally)
    last = SparseBands(grid, values.index, [(values.values[name], PRODUCTS[name].empty) for name in LAST_BANDS])
    return bands | {f"{name}_{end.file}": last(band, 0, rows) for band, name in enumerate(LAST_BANDS)}, tally, end


def _absorb(plan, frame, values, tally, maxima, second):
    """Add the values of frame number `frame` to `tally` and the maxima; the solver's maxima up to it, or None."""
    entry, averaging = plan.entries[frame], plan.averaging
    if values.count in (values.outside, values.moved):
        refuse_nowhere(entry, plan.terrain)
    tally.add(entry.path.name, values)
    maxima.absorb(values.index, values.values, values.time, values.least)
    if second is not None:
        second.absorb(*values.second, values.time, values.least)
    peaks = _peaks_up_to(plan, frame)
    absorb_peaks(averaging, peaks, maxima, second)
    return peaks


def _second_maxima(averaging):
    if averaging.second_grid is None:
        return None
    rows, columns = averaging.second_grid.shape
    return RunningMaxima(rows * columns, averaging.min_depth, ISEESNOW)


def _peaks_up_to(plan, frame):
    """The solver's maxima up to a frame: for the last one, and for each if the steps contain running maxima."""
    if frame == len(plan.entries) - 1:
        return plan.peaks
    return solver_peaks(plan.entries[frame]) if set(plan.bands) & set(PEAKS) else None


def absorb_peaks(
    averaging: "Averaging", peaks: "SolverPeaks | None", maxima: RunningMaxima, second: RunningMaxima | None = None
) -> None:
    """Add the solver's maxima to the maxima on the export's grid and on the second one.

    Parameters
    ----------
    averaging : Averaging
    peaks : SolverPeaks or None
    maxima : RunningMaxima
    second : RunningMaxima, optional
        On the second grid.
    """
    if peaks is None:
        return
    for store, grid in ((maxima, averaging.grid), (second, averaging.second_grid)):
        if store is not None:
            for index, values in peaks.on(grid, averaging.bed, averaging.min_depth):
                store.absorb_peaks(index, values)


def _maxima_tags(plan, peaks):
    """Tags: source of the maxima, and names of those stored by the solver."""
    if peaks is None:
        return {"maxima": "frames"}
    return {
        "maxima": "solver, every step",
        "maxima_solver": ", ".join(peaks.bands(plan.averaging.min_depth)),
        "maxima_arrival_thickness": f"{peaks.arrival_thickness:g}",
    }


def _step_writer(asked, plan, rasters, pool):
    quantities = [BAND[name] for name in plan.bands]
    grid, times = plan.averaging.grid, [plan.entries[frame].time for frame in plan.steps]
    if asked["layout"] == "stacks":
        return StepStacks(rasters, plan.name, grid, quantities, times, run_tags(plan), asked["cog"])
    return StepFiles(rasters, plan.name, grid, quantities, len(times), asked["cog"], pool.threads, pool.workers)


def write_step(
    plan: "ExportPlan",
    writer: object,
    step: int,
    entry: "FrameEntry",
    values: "FrameValues",
    maxima: RunningMaxima,
    peaks: "SolverPeaks | None",
) -> None:
    """Write the bands of a step.

    Parameters
    ----------
    plan : ExportPlan
    writer : StepFiles, StepStacks or RasterWriter
    step : int
    entry : FrameEntry
    values : FrameValues
        Of the entry.
    maxima : RunningMaxima
    peaks : SolverPeaks or None
    """
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


def _write_layers(plan, folder, step, entry, values, tally, cog):
    """Write density and pressure of a step by height over the bed, if asked for; return the largest value by band."""
    grid, edges = plan.averaging.grid, plan.averaging.layers
    if not edges:
        return {}
    tags = run_tags(plan) | {"time": values.time, "step": step, "frame": entry.path.name}
    tags["layers"] = ",".join(f"{edge:g}" for edge in edges)
    found = values.layers
    bands, quantities = [band.astype(np.float32) for band in found.bands()], layer_quantities(edges)
    rows_of = SparseBands(grid, found.index, [(band, 0.0) for band in bands])
    (folder / "layers").mkdir(exist_ok=True)
    write_rows(folder / _layer_file(plan, step), grid, quantities, tags, rows_of, cog)
    names = [quantity.name for quantity in quantities]
    return {
        name: max(tally.largest.get(name, 0.0), float(np.fmax.reduce(np.abs(band), initial=0.0)))
        for name, band in zip(names, bands, strict=True)
    }


def _layer_file(plan, step):
    return f"layers/{plan.name}_{step:04d}.tif"


def write_maxima(plan: "ExportPlan", path: Path, maxima: RunningMaxima, tally: Tally, end: FlowEnd, cog: bool) -> None:
    """Write the maxima of a run.

    Parameters
    ----------
    plan : ExportPlan
    path : Path
    maxima : RunningMaxima
    tally : Tally
    end : FlowEnd
    cog : bool
        Cloud-optimised file.
    """
    columns = plan.averaging.grid.shape[1]
    tags = run_tags(plan) | _maxima_tags(plan, plan.peaks)
    tags |= {"particles_outside": tally.outside[0], "mass_outside": tally.outside[1]} | end.tags()
    write_rows(
        path,
        plan.averaging.grid,
        [BAND[name] for name in MAXIMA_BANDS],
        tags,
        lambda band, first, last: maxima.rows(MAXIMA_BANDS[band], first, last, columns),
        cog,
    )


def write_last_step(plan: "ExportPlan", path: Path, values: "FrameValues", end: FlowEnd, cog: bool) -> None:
    """Write the raster of the last step, the deposit of a flow that came to rest.

    Parameters
    ----------
    plan : ExportPlan
    path : Path
    values : FrameValues
        Of the last frame.
    end : FlowEnd
    cog : bool
        Cloud-optimised file.
    """
    bands = [(values.values[name], PRODUCTS[name].empty) for name in LAST_BANDS]
    write_rows(
        path,
        plan.averaging.grid,
        [BAND[name] for name in LAST_BANDS],
        run_tags(plan)
        | {"name": end.words()}
        | end.tags()
        | {"time": values.time, "particles_outside": values.outside, "mass_outside": values.mass_outside},
        SparseBands(plan.averaging.grid, values.index, bands),
        cog,
    )


def write_terrain(plan: "ExportPlan", path: Path, cog: bool, grid: "Grid | None" = None) -> None:
    """Write the elevation of cells.

    Parameters
    ----------
    plan : ExportPlan
    path : Path
    cog : bool
        Cloud-optimised file.
    grid : Grid, optional
        Default: that of the export.
    """
    grid = plan.averaging.grid if grid is None else grid
    tags = {"dem": plan.dem, "dem_sha256": plan.terrain.sha256} | _tags_of_reprojection(plan.terrain)
    rows_of = partial(_elevation, plan.terrain, grid)
    write_rows(path, grid, [TERRAIN_BAND], tags, rows_of, cog)


def _write_around(plan, folder, maxima, cog):
    """Write the terrain around the flow on the cells of the DTM, for the map; return the name of its file.

    It is all of the DTM, or of a large one what is within one length of the flow. "": `dtm.tif` shows it already.
    """
    grid, of_dtm = plan.averaging.grid, plan.terrain.grid
    if grid.shape == of_dtm.shape and grid.transform == of_dtm.transform:
        return ""
    rows, columns = of_dtm.shape
    top, bottom, left, right = 0, rows, 0, columns
    if rows * columns > MOST_AROUND:
        top, bottom, left, right = _window_around(maxima, grid, of_dtm)
    write_terrain(plan, folder / AROUND_FILE, cog, of_dtm.part(top, left, (bottom - top, right - left)))
    return AROUND_FILE


def _window_around(maxima, grid, of_dtm):
    """Return (top, bottom, left, right) of the cells of the DTM within one length of the flow of its bounds."""
    row, column = np.divmod(np.flatnonzero(maxima.seen["h_max"]), grid.shape[1])
    x, y = grid.xy(row, column)
    length = float(np.hypot(np.ptp(x), np.ptp(y)))
    corners_x = np.array([x.min() - length, x.max() + length, x.min() - length, x.max() + length])
    corners_y = np.array([y.min() - length, y.min() - length, y.max() + length, y.max() + length])
    rows, columns = of_dtm.rowcol(corners_x, corners_y)
    (top, bottom), (left, right) = (
        (max(int(at.min()), 0), min(int(at.max()) + 2, size))
        for at, size in zip((rows, columns), of_dtm.shape, strict=True)
    )
    return top, bottom, left, right


def _elevation(terrain, grid, band, first, last):
    return terrain.rows_on(grid, first, last)


def _write_iseesnow(plan, rasters, maxima):
    """Peaks on the DTM's grid with the names of the model intercomparison; 0 where there was no flow."""
    grid, header = plan.averaging.second_grid, plan.entries[0].header
    release, digest = release_name(plan.entries), header.digest[:DIGEST_LENGTH] or "unknown"
    rows, columns = grid.shape
    on_terrain = np.isfinite(plan.terrain.rows_on(grid, 0, rows))
    for kind in ISEESNOW:
        values = np.nan_to_num(maxima.rows(kind, 0, rows, columns), nan=0.0)
        values = values / PASCAL_PER_KILOPASCAL if kind == "ppr" else values
        file = f"{operating_system.file_name(f'{release}_{digest}')}_null_mpmgis_{kind}.asc"
        write_ascii_grid(rasters / file, grid, np.where(on_terrain, values, np.nan))


def _tags_of_reprojection(terrain):
    """How the DTM was brought to metres; nothing where its file is in metres."""
    how = terrain.reprojection
    return {} if how is None else {f"dem_{name}": value for name, value in how.facts().items()}


def run_tags(plan: "ExportPlan") -> dict:
    """Return the tags of every raster of the export: version, inputs and settings.

    Parameters
    ----------
    plan : ExportPlan
    """
    averaging, first = plan.averaging, plan.entries[0]
    errors = {ERROR_TAG: plan.errors} if plan.errors else {}
    return (
        _tags_of_reprojection(plan.terrain)
        | errors
        | {
            "version": __version__,
            "digest": first.header.digest,
            "dem": plan.dem,
            "cs_e": float(f"{averaging.grid.cell_size:.12g}"),  # without rounding errors
            "dt_e": "every frame" if plan.time_step is None else plan.time_step,
            "percentile": averaging.percentile,
            "min_depth": averaging.min_depth,
            "bed": averaging.bed.kind,
            "standoff": averaging.bed.standoff,
            "outside": "in the nearest cell of the rim" if averaging.bed.clamped else "left out",
            "density": averaging.density,
            "thickness": "normal to the bed",
            "frames": plan.frames_text,
        }
    )


def exported(
    plan: "ExportPlan", folder: Path, step_files: Iterable, maxima: RunningMaxima, tally: Tally, end: FlowEnd
) -> ExportedRun:
    """Describe the rasters of a plan.

    Parameters
    ----------
    plan : ExportPlan
    folder : Path
    step_files : iterable of str
        Names in the folder `rasters`.
    maxima : RunningMaxima
    tally : Tally
    end : FlowEnd
    """
    largest = tally.largest | {name: maxima.largest(name) for name in MAXIMA_BANDS}
    layers = layer_quantities(plan.averaging.layers) if plan.averaging.layers else []
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
        last_bands=tuple(BAND[name] for name in LAST_BANDS),
        end=end,
        largest={name: value for name, value in largest.items() if name in {*BAND, *(q.name for q in layers)}},
        min_depth=plan.averaging.min_depth,
        bed_bands=tuple(BAND[name] for name in bed_bands(plan.bed_change, end)),
        surface_bands=tuple(BAND[name] for name in SURFACE_BANDS if plan.bed_change),
        layer_files=tuple(_layer_file(plan, step) for step in range(len(plan.steps))) if layers else (),
        layer_bands=tuple(layers),
    )
