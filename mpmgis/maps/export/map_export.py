"""`mpmgis export-raster`: frames to a folder for GIS (Vicari et al. 2025, NHESS 25:3897).

Messages about the frames of an export.
"""

import math
import shutil
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from ...exchange.frame_list import OWN, list_frames, missing_frames
from ...laws.quantities import BAND
from ...system.errors import InputError, OutputError
from ...system.messages import log
from ...system.optional_libraries import pyogrio
from ...system.parallel import frame_pool
from ...system.whole_files import refuse_existing, whole_folder
from ...terrain.raster_output import require_square
from ..averaging.band_products import choose_products
from ..averaging.maxima import BANDS as SOLVER_BANDS
from ..averaging.maxima import MAXIMA_BANDS, WITHOUT_THRESHOLD
from ..averaging.result_bands import DEPOSIT, BandInMemory, Result
from ..averaging.sampling import automatic_time_step, farthest_crossing
from ..qgis import qgis_files as qgis_folder
from ..qgis.kml import require_kml, write_kml
from ..qgis.outlines import StepSpool
from ..qgis.stac import require_stac, write_stac_item
from .export_inputs import output_folder, release_outlines, run_terrain
from .export_plan import make_plan
from .export_request import CellAveraging, ExportFiles, ExportRequest
from .step_rasters import frame_maxima, write_rasters

MOST_FRAMES_LISTED = 12  # of another code, a line each


def log_export(request, plan, tally):
    """Log facts and warnings about the frames of an export, each once."""
    if plan.entries[0].reader != OWN:
        _log_third_party(plan, tally)
    _log_kinds(plan.entries)
    grid, times = plan.averaging.grid, [entry.time for entry in plan.entries]
    crossing = farthest_crossing(times, tally.speeds, grid.cell_size)
    if plan.peaks is not None:
        log.info(_peaks_text(plan, crossing))
    count, mass, name = tally.outside
    if count:
        log.info(
            f"{name}: {count} particles ({mass:.4g} kg) are outside the DTM or on nodata; they are left out, not moved"
        )
    count, name = tally.moved
    if count:
        log.info(
            f"{name}: {count} particles are outside the DTM; `paper` moves them to the nearest cell of its edge (Eq 5)"
        )
    count, name = tally.without_slope
    if count:
        log.info(f"{name}: {count} particles are where the DTM has no slope; only their mass and number are used")
    share, lowest, name = tally.below
    if share >= 0.01 and request.averaging.standoff == 0:
        log.info(
            f"{name}: {100 * share:.0f} % of the mass is below the DTM (lowest {lowest:.2f} m), as usual in grid-based "
            "codes; `standoff=auto` moves the surface; t_vol is computed from mass and is correct without it"
        )
    missing = missing_frames(plan.entries)
    if missing:
        log.info(f"frames are missing in this series: {', '.join(missing)}; maxima and steps omit them")
    if tally.column_side > grid.cell_size * (1 + 1e-6) and request.sampling.cell_size is not None:
        log.info(
            f"the frames resolve {tally.column_side:.3g} m: cells of {grid.cell_size:.3g} m show the same flow on a "
            "finer raster and add no detail"
        )
    side, name = tally.point_side
    if grid.cell_size < side * (1 - 1e-6):
        log.info(
            f"warning: cells of {grid.cell_size:.3g} m are smaller than required by Eq 15, {side:.3g} m (cube root of "
            f"a point's mean volume in {name}): cells inside the flow remain empty; use `cell_size={side:.3g}` or "
            "more, or auto"
        )
    _warn_of_crossing(plan, crossing)
    _log_last_step(plan, times)


def _log_third_party(plan, tally):
    """Log number, mass and volume of every frame; in a long series of the first, the last, and each with a change."""
    density, before = plan.averaging.density, None
    for k, (entry, (count, mass, below)) in enumerate(zip(plan.entries, tally.frames, strict=True)):
        now = (count, f"{mass:.6g}")
        if now != before or len(plan.entries) <= MOST_FRAMES_LISTED or k == len(plan.entries) - 1:
            log.info(
                f"{entry.path.name}: {entry.time:g} s, {count} particles, {mass:.6g} kg, {mass / density:.6g} m3 at "
                f"{density:g} kg m-3; {100 * below:.0f} % of the mass below the DTM"
            )
        before = now
    _log_loss(plan, tally)


def _log_loss(plan, tally):
    """Log particles that a code lost between the frame with the most particles and the last."""
    k = max(range(len(tally.frames)), key=lambda k: tally.frames[k][:2])
    (most, most_mass, _), (last, last_mass, _) = tally.frames[k], tally.frames[-1]
    if last < most or last_mass < most_mass * (1 - 1e-9):
        fullest = "the first" if k == 0 else f"that of {plan.entries[k].time:g} s"
        log.info(
            f"the last frame has {most - last} particles and {most_mass - last_mass:.4g} kg less than {fullest}: the "
            "code removed them, or they left its grid; maxima and deposit omit them"
        )


def _log_kinds(entries):
    """Log changes between columns and points, whose depths are defined differently."""
    kinds = {2: "columns", 3: "points"}
    for before, entry in pairwise(entries):
        if before.header.dimension != entry.header.dimension:
            log.info(
                f"frames up to {before.path.name} are {kinds[before.header.dimension]}, {entry.path.name} is "
                f"{kinds[entry.header.dimension]}: h of columns is their thickness, of points the highest point; "
                "t_vol has the same meaning in both"
            )


def _peaks_text(plan, crossing):
    """Text: maxima from the solver, the others with the reason, and the interval of the frames for these."""
    peaks = plan.peaks
    bands = peaks.bands(plan.averaging.min_depth)
    word = f"maxima: {', '.join(bands)} include the solver's maxima of all steps up to t = {peaks.time:g} s"
    others = [name for name in SOLVER_BANDS if name not in bands]
    if any(entry.header.dimension == 3 for entry in plan.entries):
        word += "; of points, h_max and t_max include the thickness from mass, as t_vol, and h and t of the frames"
    if not others:
        word += f"; {', '.join(name for name in bands if name not in WITHOUT_THRESHOLD)} are of flow deeper than "
        word += f"{peaks.arrival_thickness:g} m"
        if apart := _crossing_text(plan, crossing):
            of_frames = [name for name in MAXIMA_BANDS if name not in bands]
            word += f"; {' and '.join(of_frames)} are from the frames alone: {apart}"
    if others:
        word += (
            f"; its {', '.join(others)} are of flow deeper than {peaks.arrival_thickness:g} m and are not used with "
            f"`min_depth={plan.averaging.min_depth:g}`: give `min_depth={peaks.arrival_thickness:g}` to use them"
        )
    return word


def _log_last_step(plan, times):
    if plan.time_step is None or np.isinf(plan.time_step) or len(times) < 2:  # infinite: maxima alone
        return
    last = times[plan.steps[-1]]
    if last < times[-1]:
        end = f"the last step is at {last:.4g} s, the last frame at {times[-1]:.4g} s"
        log.info(f"`time_step={plan.time_step:.4g}`: {end}; maxima and deposit are of all frames")


def _crossing_text(plan, crossing):
    """Text: interval of the frames and that required by Eq 17; "" if it is short enough."""
    if crossing.cells <= 1 + 1e-6:
        return ""
    cell = plan.averaging.grid.cell_size
    got = f"the frames are up to {crossing.interval:.4g} s apart"
    if plan.time_step is not None and plan.time_step < crossing.interval * (1 - 1e-6):
        got += f", so `time_step={plan.time_step:.4g}` uses each of them once"
    required = automatic_time_step(cell, crossing.fastest)
    fastest = f"mean speed up to {crossing.fastest:.3g} m/s"
    return f"{got}; Eq 17 requires dt_e = {required:.3g} s (cells of {cell:.4g} m, {fastest})"


def _warn_of_crossing(plan, crossing):
    """Warn if maxima from the frames alone miss cells: farther apart than Eq 17 requires, or one frame alone."""
    if len(plan.entries) == 1 and plan.entries[0].time > 0 and not _has_all_maxima(plan):
        entry = plan.entries[0]
        log.info(f"warning: {entry.path.name} is the only frame: maxima are those of t = {entry.time:.4g} s alone")
    word = _crossing_text(plan, crossing)
    if word and not _has_all_maxima(plan):
        required = automatic_time_step(plan.averaging.grid.cell_size, crossing.fastest)
        log.info(
            f"warning: {word}. The flow crosses {crossing.cells:.3g} cells between frames and maxima miss cells: write "
            f"frames every {required:.3g} s, or use cells of {crossing.interval * crossing.speed:.3g} m (`cell_size`)"
        )


def _has_all_maxima(plan):
    """Whether the solver stored all maxima that it can store."""
    return plan.peaks is not None and plan.peaks.bands(plan.averaging.min_depth) == SOLVER_BANDS


SPOOL_FOLDER = ".steps"  # temporary, in the output folder


def export_raster(request: ExportRequest, progress=lambda done, total: None) -> list[Path]:
    """Write the folder for GIS, atomically.

    Parameters
    ----------
    request : ExportRequest
    progress : callable
        Called with (frames done, frames in all).

    Returns
    -------
    list of Path
        Every file written, the QGIS project first.

    Raises
    ------
    MpmgisError
    """
    request = _as_the_paper(request)
    products = choose_products(request.files.products)
    entries = list_frames(request.source.frames, request.source.terms())
    _require_points(request, entries)
    output = output_folder(request, entries)
    terrain = run_terrain(request.source, entries, output)
    _require_extra_files(request, output, terrain.grid.crs)
    if request.files.naming == "iseesnow":
        require_square(terrain.grid, "`naming=iseesnow`", terrain.path)
    if request.files.qgis:
        pyogrio()  # before threads start, so that it is imported without pandas
    with frame_pool(request.workers, request.dask) as pool:
        if request.files.qgis:
            pool.threads.submit(qgis_folder.load)  # while the first frames are read
        plan = make_plan(request, entries, terrain, products, pool)
        with whole_folder(output, request.overwrite) as folder, pool.ended():
            spool = StepSpool(folder / SPOOL_FOLDER) if request.files.qgis else None
            run, tally = write_rasters(request, plan, folder, pool, spool, progress)
            if request.files.qgis:
                qgis_folder.write_qgis_files(run, _release(run, plan), spool, request.files.qgis_min, pool.threads)
                shutil.rmtree(folder / SPOOL_FOLDER)
            _write_extra_files(request, run, terrain, partial(_release, run, plan))
            files = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file() and path.name[0] != "."]
    log_export(request, plan, tally)
    apart = [] if request.files.animation is None else [Path(request.files.animation)]
    return [output / file for file in sorted(files, key=lambda file: (file.suffix != ".qgz", file))] + apart


def _require_points(request, entries):
    """Refuse layers of height of columns, which have one density and one velocity over their height."""
    flat = next((entry for entry in entries if entry.header.dimension != 3), None)
    if request.files.layers and flat is not None:
        raise InputError(
            f"`layers` needs 3D frames, but {flat.path.name} holds columns, which are uniform over their height; run "
            'the scene with solver = "points", or name its 3D frames only'
        )


def _as_the_paper(request):
    """`request` with the settings of `paper` (Vicari et al. 2025, Eqs 2 to 14 as printed)."""
    averaging, usual = request.averaging, CellAveraging()
    if not averaging.paper:
        return request
    for name in ("min_depth", "standoff"):
        value = getattr(averaging, name)
        if value not in (getattr(usual, name), 0.0):
            raise InputError(f"`paper` requires `{name}=0`; leave {value} out")
    return replace(request, averaging=replace(averaging, bed="plane", min_depth=0.0))


def peaks_of_frames(results, progress=lambda done, total: None):
    """The Result (maxima, deposit, terrain) of frames, in memory.

    Parameters
    ----------
    results : Results
    progress : callable
        Called with (frames done, frames in all).
    """
    request = ExportRequest(
        source=results.source,
        averaging=results.averaging,
        sampling=replace(results.sampling, time_step=math.inf),  # maxima, no steps
        files=ExportFiles(qgis=False),
    )
    entries = list_frames(request.source.frames, request.source.terms())
    terrain = run_terrain(request.source, entries, None)
    with frame_pool() as pool:
        plan = make_plan(request, entries, terrain, choose_products(()), pool)
        bands, tally = frame_maxima(plan, pool, progress)
    log_export(request, plan, tally)
    units = {name: BAND[name.removesuffix(DEPOSIT)] for name in bands}
    sources = {
        name: BandInMemory(entries[0].path.parent, units[name]._replace(name=name), values, plan.averaging.grid)
        for name, values in bands.items()
    }
    return Result(plan.name, "run", sources, terrain)


def _release(run, plan):
    """Outlines of the release: from the scene of the run, else of the wet cells in the first frame at time 0."""
    from ..qgis.outlines import mask_outline

    release = release_outlines(plan.entries, plan.terrain)
    if release is None and plan.steps[0] == 0 and run.times[0] == 0:
        (depth,) = run.read(run.step_files[0], ("h",))
        footprint = mask_outline(depth > 0, run.flow_grid.transform)
        release = None if footprint is None else [footprint]
    return release


def _require_extra_files(request, output, crs):
    """Refuse a film, KMZ or STAC item that cannot be written: wrong suffix, missing library, no geographic position.

    `output` is the folder of the export, which cannot contain the film because it is replaced; `crs` is the DTM's.
    """
    if request.files.animation is not None:
        from .animation import require_animation

        require_animation(request.files.animation)
        refuse_existing(request.files.animation, request.overwrite)
        if output.resolve() in Path(request.files.animation).resolve().parents:
            raise OutputError(
                f"`animation={request.files.animation}` is inside {output}, which is replaced; give another folder"
            )
    if request.files.kml:
        require_kml(crs)
    if request.files.stac:
        require_stac(crs)


def _write_extra_files(request, run, terrain, release_of):
    """Write film, KMZ and STAC item from the rasters of `run`; `release_of()` gives the release polygons or None."""
    if request.files.kml:
        write_kml(run, release_of())
    if request.files.stac:
        write_stac_item(run, request.files.cog)
    if request.files.animation is not None:
        from .animation import write_animation

        write_animation(Path(request.files.animation), run, terrain, release_of())
