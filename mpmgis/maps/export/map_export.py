"""Export frames to a folder for GIS: `mpmgis export-raster` (Vicari et al. 2025, NHESS 25:3897)."""

import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ...exchange.frame_list import list_frames
from ...frames.run_terrain import run_terrain
from ...laws.quantities import BAND
from ...system.errors import InputError, OutputError
from ...system.optional_libraries import pyogrio
from ...system.parallel import frame_pool
from ...system.whole_files import refuse_existing, whole_folder
from ...terrain.raster_output import require_square
from ..averaging.averaging_settings import CellAveraging
from ..averaging.band_products import choose_products
from ..averaging.result_bands import BandInMemory, Result
from ..qgis import qgis_files as qgis_folder
from ..qgis.kml import require_kml, write_kml
from ..qgis.outlines import StepSpool
from ..qgis.stac import require_stac, write_stac_item
from .export_decisions import make_plan
from .export_inputs import output_folder, release_outlines
from .export_messages import log_export
from .export_request import ExportFiles, ExportRequest
from .step_rasters import frame_maxima, write_rasters

if TYPE_CHECKING:
    from .export_request import Results

SPOOL_FOLDER = ".steps"  # temporary, in the output folder


def export_raster(request: ExportRequest, progress: Callable = lambda done, total: None) -> list[Path]:
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
    entries = list_frames(request.source.frames, request.source.terms(), request.source.ground())
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


def peaks_of_frames(results: "Results", progress: Callable = lambda done, total: None) -> Result:
    """Compute the maxima and the last step of frames in memory, with their terrain.

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
    entries = list_frames(request.source.frames, request.source.terms(), request.source.ground())
    terrain = run_terrain(request.source, entries, None)
    with frame_pool() as pool:
        plan = make_plan(request, entries, terrain, choose_products(()), pool)
        bands, tally, end = frame_maxima(plan, pool, progress)
    log_export(request, plan, tally)
    units = {name: BAND[name.removesuffix(f"_{end.file}")] for name in bands}
    sources = {
        name: BandInMemory(entries[0].path.parent, units[name]._replace(name=name), values, plan.averaging.grid)
        for name, values in bands.items()
    }
    return Result(plan.name, "run", sources, terrain, end)


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
