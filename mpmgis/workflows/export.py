"""`mpmgis export-raster`: frames to a folder for GIS (Vicari et al. 2025, NHESS 25:3897)."""

import shutil
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from ..analysis.cells import Bed
from ..analysis.frame_values import Averaging, automatic_standoff, fastest_mean, reached, survey_frame
from ..analysis.maxima import BANDS as SOLVER_BANDS
from ..analysis.maxima import MAXIMA_BANDS, PRODUCTS_NEEDED, RUNNING_BANDS, WITHOUT_THRESHOLD, SolverPeaks
from ..analysis.quantities import PRODUCTS, RUNNING, choose_products
from ..analysis.sampling import (
    automatic_cell_size,
    automatic_time_step,
    choose_steps,
    export_axes,
    export_grid,
    farthest_crossing,
)
from ..errors import InputError
from ..gis import folder as qgis_folder
from ..gis.outlines import StepSpool
from ..interop.declarations import Declarations
from ..interop.frame_list import OWN, list_frames, missing_frames
from ..io.atomic import whole_folder
from ..io.libraries import pyogrio
from ..io.raster_output import require_square
from ..messages import log
from ..terrain.elevation import Terrain
from .export_extra_files import require_extra_files, write_extra_files
from .export_inputs import (
    output_folder,
    refuse_nowhere,
    release_density,
    release_outlines,
    run_terrain,
    solver_peaks,
    tell_of_columns,
)
from .export_rasters import ARROW_BANDS, DEPOSIT_BANDS, ISEESNOW_PRODUCTS, write_rasters
from .parallel import frame_pool

AUTO = "auto"
MOST_FRAMES_TOLD = 12  # of another code, a line each
SPOOL_FOLDER = ".steps"  # in the folder that is being made, on the disk that must hold as much anyway


@dataclass(frozen=True)
class ExportRequest:
    """What was asked for: the command's options by name, with `auto` where they can say so. Its help tells more."""

    frames: tuple
    output: Path | None = None
    overwrite: bool = False
    dem: Path | None = None
    dem_band: int | None = None
    crs: str | None = None
    cell_size: float | str | None = None  # [m]
    time_step: float | str | None = None  # [s]
    extent: str | None = None
    north_up: bool = False
    percentile: float = 100.0
    bed: str = "bilinear"
    min_depth: float = 0.05  # [m]
    standoff: float | str = 0.0  # [m]
    paper: bool = False
    density: float | None = None  # [kg m-3]
    products: tuple = ()
    layout: str = "steps"
    naming: str = "mpmgis"
    cog: bool = False
    qgis: bool = True
    qgis_min: str = "3.38"
    animation: Path | None = None
    kml: bool = False
    stac: bool = False
    workers: int | None = None
    dask: str | None = None
    reader: str | None = None  # and what else is said about another code's files
    origin: tuple | None = None
    axes: tuple | None = None
    times: tuple | None = None
    frame_step: float | None = None  # [s]
    frames_per_second: float | None = None
    columns: tuple = ()
    particle_volume: float | None = None  # [m3]
    sidecar: Path | None = None

    def terms(self):
        """Declarations: what is said about another code's files."""
        return Declarations.named(vars(self) | {"time_step": self.frame_step}, self.crs)


@dataclass(frozen=True)
class Plan:
    """What is going to be done: the run's `name`, its frames, which of them are `steps`, how they are averaged.

    `peaks` are what the solver kept of every step up to the last frame, None where it kept nothing.
    """

    name: str
    entries: tuple
    steps: tuple
    averaging: Averaging
    bands: tuple
    terrain: Terrain
    time_step: float | None
    peaks: SolverPeaks | None = None


def export_raster(request, progress=lambda done, total: None):
    """Write the folder for GIS that README describes; it appears whole or not at all.

    Parameters
    ----------
    request : ExportRequest
    progress : callable
        Told (frames done, frames in all).

    Returns
    -------
    list of Path
        Every file written, the QGIS project first.

    Raises
    ------
    MpmgisError
    """
    request = _as_the_paper(request)
    products = choose_products(request.products)
    entries = list_frames(request.frames, request.terms())
    output = output_folder(request, entries)
    terrain = run_terrain(request, entries, output)
    require_extra_files(request, output, terrain.grid.crs)
    if request.naming == "iseesnow":
        require_square(terrain.grid, "--naming iseesnow", terrain.path)
    if request.qgis:
        pyogrio()  # before there are threads, for it then comes without pandas
    with frame_pool(request.workers, request.dask) as pool:
        if request.qgis:
            pool.threads.submit(qgis_folder.load)  # while the first frames are read
        plan = make_plan(request, entries, terrain, products, pool)
        with whole_folder(output, request.overwrite) as folder:
            spool = StepSpool(folder / SPOOL_FOLDER) if request.qgis else None
            run, tally = write_rasters(request, plan, folder, pool, spool, progress)
            if request.qgis:
                qgis_folder.write_qgis_files(run, _release(run, plan), spool, request.qgis_min, pool.threads)
                shutil.rmtree(folder / SPOOL_FOLDER)
            write_extra_files(request, run, terrain, partial(_release, run, plan))
            files = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file() and path.name[0] != "."]
    tell(request, plan, tally)
    apart = [] if request.animation is None else [Path(request.animation)]
    return [output / file for file in sorted(files, key=lambda file: (file.suffix != ".qgz", file))] + apart


def _as_the_paper(request):
    """`request` with all that `paper` stands for (Vicari et al. 2025, Eqs 2 to 14 to the letter)."""
    if not request.paper:
        return request
    usual = ExportRequest(())
    for name in ("min_depth", "standoff"):
        if getattr(request, name) not in (getattr(usual, name), 0.0):
            raise InputError(f"--paper has --{name.replace('_', '-')} 0; leave {getattr(request, name)} out")
    return replace(request, bed="plane", min_depth=0.0)


def make_plan(request, entries, terrain, products, pool):
    """Choose cells, steps and standoff, with a look over the frames only where one of them needs it."""
    density = release_density(request, entries)
    tell_of_columns(request, entries)
    standoff = 0.0 if request.standoff == AUTO else request.standoff
    bed = Bed.of(terrain, request.bed, standoff, clamped=request.paper)
    axes = export_axes(terrain.grid, request.north_up)
    facts = _survey(request, entries, bed, density, axes, pool)
    bounds = _bounds(request, entries, facts, bed, axes, terrain, pool)
    if request.standoff == AUTO:
        bed = replace(bed, standoff=automatic_standoff(facts))
        log.info(f"--standoff auto: {bed.standoff:.3g} m")
    peaks = solver_peaks(entries[-1])
    if bounds is not None and peaks is not None:
        bounds = _with_peaks(bounds, peaks.bounds(request.min_depth), axes)
    cell_size = _cell_size(request, facts, terrain)
    grid = export_grid(terrain.grid, cell_size, bounds, north_up=request.north_up)
    time_step = _time_step(request, entries, bed, grid, density, pool)
    steps = choose_steps([entry.time for entry in entries], time_step)
    needed = (*products, *PRODUCTS_NEEDED, *DEPOSIT_BANDS, *(ARROW_BANDS if request.qgis else ()))
    averaging = Averaging(
        bed=bed,
        grid=grid,
        density=density,
        names=tuple(name for name in PRODUCTS if name in needed),
        percentile=request.percentile,
        min_depth=request.min_depth,
        second_grid=export_grid(terrain.grid) if request.naming == "iseesnow" else None,
        second_names=ISEESNOW_PRODUCTS,
    )
    bands = (*products, *(RUNNING_BANDS if RUNNING in request.products else ()))
    name = entries[0].path.resolve().parent.name or "frames"
    return Plan(name, tuple(entries), tuple(steps), averaging, bands, terrain, time_step, peaks)


def _extent(request):
    return request.extent or ("dtm" if request.cell_size is None else "flow")


def _survey(request, entries, bed, density, axes, pool):
    """FrameFacts of every frame where something is to be chosen by them; none otherwise."""
    if AUTO not in (request.cell_size, request.standoff):
        return []
    return list(pool.map(_survey_entry, entries, bed, density, axes))


def _survey_entry(entry, bed, density, axes):
    return survey_frame(entry.read(density), bed, density, axes)


def _reached_by_entry(entry, bed, axes):
    return reached(entry.read_positions(), bed, axes)


def _fastest_entry(entry, bed, grid, density):
    return fastest_mean(entry.read(density), bed, grid, density)


def _bounds(request, entries, facts, bed, axes, terrain, pool):
    """Where the flow is in all frames, along `axes` [m]; None for all of the DTM."""
    whole = _extent(request) == "dtm"
    if whole and not facts:
        return None
    found = [fact.bounds for fact in facts] or list(pool.map(_reached_by_entry, entries, bed, axes))
    for entry, bounds in zip(entries, found, strict=True):
        if bounds is None:
            refuse_nowhere(entry, terrain)
    return None if whole else _around(found)


def _around(found):
    """The bounds around several ones."""
    bounds = np.array(found)
    return (*bounds[:, :2].min(axis=0).tolist(), *bounds[:, 2:].max(axis=0).tolist())


def _with_peaks(bounds, reached, axes):
    """`bounds` and what the flow reached between frames, (west, south, east, north) [m] or None."""
    if reached is None:
        return bounds
    west, south, east, north = reached
    row, column = axes.rowcol(np.array([west, east]), np.array([north, south]))
    return _around([bounds, (column[0] + 0.5, row[0] + 0.5, column[1] + 0.5, row[1] + 0.5)])


def _cell_size(request, facts, terrain):
    if request.cell_size != AUTO:
        return request.cell_size
    points = [fact for fact in facts if fact.column_side == 0]  # of a run of columns and points, the finer kind
    cell_size, why = automatic_cell_size(points or facts, terrain.grid.cell_size)
    log.info(f"--cs-e auto: {cell_size:.4g} m; {why}")
    return cell_size


def _time_step(request, entries, bed, grid, density, pool):
    if request.time_step != AUTO:
        return request.time_step
    fastest = max(pool.map(_fastest_entry, entries, bed, grid, density))
    time_step = automatic_time_step(grid.cell_size, fastest)
    log.info(
        f"--dt-e auto: {time_step:.4g} s (Eq 17: cells of {grid.cell_size:.4g} m, mean speed up to {fastest:.4g} m/s)"
    )
    return time_step


def _release(run, plan):
    """Outlines of the release: from the run's scene, else of the cells wet in a first frame at time 0."""
    from ..gis.outlines import mask_outline

    release = release_outlines(plan.entries, plan.terrain)
    if release is None and plan.steps[0] == 0 and run.times[0] == 0:
        (depth,) = run.read(run.step_files[0], ("h",))
        footprint = mask_outline(depth > 0, run.flow_grid.transform)
        release = None if footprint is None else [footprint]
    return release


def tell(request, plan, tally):
    """Say what the user should know about the frames, each thing once."""
    if plan.entries[0].reader != OWN:
        _tell_of_foreign(plan, tally)
    _tell_of_kinds(plan.entries)
    grid, times = plan.averaging.grid, [entry.time for entry in plan.entries]
    crossing = farthest_crossing(times, tally.speeds, grid.cell_size)
    if plan.peaks is not None:
        log.info(_word_on_peaks(plan, crossing))
    count, mass, name = tally.outside
    if count:
        log.info(
            f"{name}: {count} particles ({mass:.4g} kg) lie outside the DTM or on its nodata; left out, never moved in"
        )
    count, name = tally.moved
    if count:
        log.info(
            f"{name}: {count} particles lie outside the DTM; --paper takes them to the nearest cell of its rim (Eq 5)"
        )
    count, name = tally.without_slope
    if count:
        log.info(f"{name}: {count} particles stand where the DTM has no slope; only their mass and number count")
    share, lowest, name = tally.below
    if share >= 0.01 and request.standoff == 0:
        log.info(
            f"{name}: {100 * share:.0f} % of the mass lies below the DTM (lowest {lowest:.2f} m), as grid-based codes "
            "leave it; --standoff auto moves the surface, t_vol comes from mass and is right as it is"
        )
    missing = missing_frames(plan.entries)
    if missing:
        log.info(f"frames are missing in this series: {', '.join(missing)}; maxima and steps go without them")
    if tally.column_side > grid.cell_size * (1 + 1e-6) and request.cell_size is not None:
        log.info(
            f"the frames resolve {tally.column_side:.3g} m: cells of {grid.cell_size:.3g} m show the same flow on a "
            "finer raster and add no detail"
        )
    side, name = tally.point_side
    if grid.cell_size < side * (1 - 1e-6):
        log.info(
            f"warning: cells of {grid.cell_size:.3g} m are smaller than Eq 15 asks for, {side:.3g} m (cube root of a "
            f"point's mean volume in {name}): cells inside the flow stay empty; take --cs-e {side:.3g} or more, or auto"
        )
    _warn_of_crossing(plan, crossing)
    _tell_of_time(plan, times)


def _tell_of_foreign(plan, tally):
    """Number, mass and volume of every frame; of a long series where they change, besides first and last."""
    density, before = plan.averaging.density, None
    for k, (entry, (count, mass, below)) in enumerate(zip(plan.entries, tally.frames, strict=True)):
        now = (count, f"{mass:.6g}")
        if now != before or len(plan.entries) <= MOST_FRAMES_TOLD or k == len(plan.entries) - 1:
            log.info(
                f"{entry.path.name}: {entry.time:g} s, {count} particles, {mass:.6g} kg, {mass / density:.6g} m3 at "
                f"{density:g} kg m-3; {100 * below:.0f} % of the mass below the DTM"
            )
        before = now
    _tell_of_loss(plan, tally)


def _tell_of_loss(plan, tally):
    """Particles that a code lost between its fullest frame and its last."""
    k = max(range(len(tally.frames)), key=lambda k: tally.frames[k][:2])
    (most, most_mass, _), (last, last_mass, _) = tally.frames[k], tally.frames[-1]
    if last < most or last_mass < most_mass * (1 - 1e-9):
        fullest = "the first" if k == 0 else f"that of {plan.entries[k].time:g} s"
        log.info(
            f"the last frame has {most - last} particles and {most_mass - last_mass:.4g} kg less than {fullest}: the "
            "code left them out, or they left its grid; maxima and deposit go without them"
        )


def _tell_of_kinds(entries):
    """Where a run goes from columns to points or back: the two kinds measure depth each in its own way."""
    kinds = {2: "columns", 3: "points"}
    for before, entry in pairwise(entries):
        if before.header.dimension != entry.header.dimension:
            log.info(
                f"{before.path.name} and before are {kinds[before.header.dimension]}, {entry.path.name} is "
                f"{kinds[entry.header.dimension]}: h of columns is their thickness, of points the highest of them; "
                "t_vol is the same in both"
            )


def _word_on_peaks(plan, crossing):
    """Which maxima come from the solver, which do not and why, and how far apart the frames are for those."""
    peaks = plan.peaks
    bands = peaks.bands(plan.averaging.min_depth)
    word = f"maxima: {', '.join(bands)} take in the solver's own peaks, of every step up to t = {peaks.time:g} s"
    others = [name for name in SOLVER_BANDS if name not in bands]
    if any(entry.header.dimension == 3 for entry in plan.entries):
        word += "; of points, h_max and t_max take in the thickness from mass, as t_vol, and the frames' own h and t"
    if not others:
        word += f"; {', '.join(name for name in bands if name not in WITHOUT_THRESHOLD)} are of flow over "
        word += f"{peaks.arrival_thickness:g} m"
        if apart := _word_on_crossing(plan, crossing):
            of_frames = [name for name in MAXIMA_BANDS if name not in bands]
            word += f"; {' and '.join(of_frames)} are of the frames alone: {apart}"
    if others:
        word += (
            f"; its {', '.join(others)} are of flow over {peaks.arrival_thickness:g} m and are not mixed with "
            f"--min-depth {plan.averaging.min_depth:g}: give --min-depth {peaks.arrival_thickness:g} to have them"
        )
    return word


def _tell_of_time(plan, times):
    if plan.time_step is None or np.isinf(plan.time_step) or len(times) < 2:  # infinite: maxima alone were asked for
        return
    last = times[plan.steps[-1]]
    if last < times[-1]:
        end = f"the last step is that of {last:.4g} s, the frames go on to {times[-1]:.4g} s"
        log.info(f"--dt-e {plan.time_step:.4g}: {end}; maxima and deposit are of all of them")


def _word_on_crossing(plan, crossing):
    """How far apart the frames are and what Eq 17 asks for; "" where they are close enough."""
    if crossing.cells <= 1 + 1e-6:
        return ""
    cell = plan.averaging.grid.cell_size
    got = f"the frames are up to {crossing.interval:.4g} s apart"
    if plan.time_step is not None and plan.time_step < crossing.interval * (1 - 1e-6):
        got += f", so --dt-e {plan.time_step:.4g} takes each of them once"
    wanted = automatic_time_step(cell, crossing.fastest)
    fastest = f"mean speed up to {crossing.fastest:.3g} m/s"
    return f"{got}; Eq 17 asks for dt_e = {wanted:.3g} s (cells of {cell:.4g} m, {fastest})"


def _warn_of_crossing(plan, crossing):
    """Warn where maxima of the frames alone miss cells because the frames are farther apart than Eq 17 asks for."""
    word = _word_on_crossing(plan, crossing)
    if word and not _all_of_every_step(plan):
        wanted = automatic_time_step(plan.averaging.grid.cell_size, crossing.fastest)
        log.info(
            f"warning: {word}. The flow crosses {crossing.cells:.3g} cells between frames and maxima miss cells: write "
            f"frames every {wanted:.3g} s, or take cells of {crossing.interval * crossing.speed:.3g} m (--cs-e)"
        )


def _all_of_every_step(plan):
    """Whether the solver kept all the maxima that it can keep."""
    return plan.peaks is not None and plan.peaks.bands(plan.averaging.min_depth) == SOLVER_BANDS
