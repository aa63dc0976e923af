"""Export frames to a folder for GIS: `mpmgis export-raster` (Vicari et al. 2025, NHESS 25:3897)."""

import math
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

from ...exchange.frame_source import frames_at
from ...frames.run_facts import record_facts
from ...frames.run_folder import record_of
from ...frames.run_terrain import run_terrain
from ...laws.quantities import BAND
from ...system.errors import InputError, OutputError
from ...system.messages import Progress, unwatched
from ...system.option_values import defaults_of
from ...system.optional_libraries import pyogrio
from ...system.parallel import frame_pool
from ...system.whole_files import refuse_existing, whole_folder
from ...terrain.raster_output import require_square
from ..averaging.band_products import choose_products
from ..averaging.result_bands import BandInMemory, Result
from ..qgis import qgis_files as qgis_folder
from ..qgis.colours import chosen_classes
from ..qgis.kml import require_kml, write_kml
from ..qgis.outlines import StepSpool
from ..qgis.raster_styles import with_classes
from ..qgis.stac import require_stac, write_stac_item
from .export_decisions import make_plan
from .export_inputs import output_folder, release_outlines
from .export_messages import log_export
from .export_options import Export, ExportOptions
from .step_rasters import frame_maxima, write_rasters

SPOOL_FOLDER = ".steps"  # temporary, in the output folder


def export_raster(asked: Export, progress: Progress = unwatched) -> list[Path]:
    """Write the folder for GIS, atomically.

    Parameters
    ----------
    asked : Export
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
    asked = _as_the_paper(asked)
    products, classes = choose_products(asked["products"]), chosen_classes(asked["classes"])
    entries = frames_at(asked["frames"], asked)
    _require_points(asked, entries)
    output = output_folder(asked, entries)
    terrain = run_terrain(asked, entries, output)
    _require_extra_files(asked, output, terrain.grid.crs)
    if asked["naming"] == "iseesnow":
        require_square(terrain.grid, "`naming=iseesnow`", terrain.path)
    if asked["qgis"]:
        pyogrio()  # before threads start, so that it is imported without pandas
    with frame_pool(asked["workers"], asked["dask"]) as pool:
        if asked["qgis"]:
            pool.threads.submit(qgis_folder.load)  # while the first frames are read
        plan = make_plan(asked, entries, terrain, products, pool)
        with whole_folder(output, asked["overwrite"]) as folder, pool.ended():
            spool = StepSpool(folder / SPOOL_FOLDER) if asked["qgis"] else None
            run, tally = write_rasters(asked, plan, folder, pool, spool, progress)
            run = _for_print(with_classes(run, classes), plan, asked)
            if asked["qgis"]:
                qgis_folder.write_qgis_files(run, _release(run, plan), spool, asked["qgis_min"], pool.threads)
                shutil.rmtree(folder / SPOOL_FOLDER)
            _write_extra_files(asked, run, terrain, partial(_release, run, plan))
            files = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file() and path.name[0] != "."]
    log_export(asked, plan, tally)
    apart = [] if asked["animation"] is None else [Path(asked["animation"])]
    return [output / file for file in sorted(files, key=lambda file: (file.suffix != ".qgz", file))] + apart


def _require_points(asked, entries):
    """Refuse layers of height of columns, which have one density and one velocity over their height."""
    flat = next((entry for entry in entries if entry.header.dimension != 3), None)
    if asked["layers"] and flat is not None:
        raise InputError(
            f"`layers` needs 3D frames, but {flat.path.name} holds columns, which are uniform over their height; run "
            'the scene with solver = "points", or name its 3D frames only'
        )


def _as_the_paper(asked):
    """`asked` with the settings of `paper` (Vicari et al. 2025, Eqs 2 to 14 as printed)."""
    if not asked["paper"]:
        return asked
    usual = defaults_of(ExportOptions)
    for name in ("min_depth", "standoff"):
        if asked[name] not in (usual[name], 0.0):
            raise InputError(f"`paper` requires `{name}=0`; leave {asked[name]} out")
    return {**asked, "bed": "plane", "min_depth": 0.0}


def peaks_of_frames(asked: Export, progress: Progress = unwatched) -> Result:
    """Compute the maxima and the last step of frames in memory, with their terrain.

    Parameters
    ----------
    asked : Export
        Files are not used.
    progress : callable
        Called with (frames done, frames in all).
    """
    asked = {**asked, "time_step": math.inf, "qgis": False}  # maxima, no steps
    entries = frames_at(asked["frames"], asked)
    terrain = run_terrain(asked, entries, None)
    with frame_pool() as pool:
        plan = make_plan(asked, entries, terrain, choose_products(()), pool)
        bands, tally, end = frame_maxima(plan, pool, progress)
    log_export(asked, plan, tally)
    units = {name: BAND[name.removesuffix(f"_{end.file}")] for name in bands}
    sources = {
        name: BandInMemory(entries[0].path.parent, units[name]._replace(name=name), values, plan.averaging.grid)
        for name, values in bands.items()
    }
    return Result(plan.name, "run", sources, terrain, end)


def _for_print(run, plan, asked):
    """The run with its parameters and the author of the maps."""
    first = plan.entries[0]
    facts = record_facts(record_of(first.path.parent, first.header.digest))
    return replace(run, facts=facts, author=asked["author"] or "")


def _release(run, plan):
    """Outlines of the release: from the scene of the run, else of the wet cells in the first frame at time 0."""
    from ..qgis.outlines import mask_outline

    release = release_outlines(plan.entries, plan.terrain)
    if release is None and plan.steps[0] == 0 and run.times[0] == 0:
        (depth,) = run.read(run.step_files[0], ("h",))
        footprint = mask_outline(depth > 0, run.flow_grid.transform)
        release = None if footprint is None else [footprint]
    return release


def _require_extra_files(asked, output, crs):
    """Refuse a film, KMZ or STAC item that cannot be written: wrong suffix, missing library, no geographic position.

    `output` is the folder of the export, which cannot contain the film because it is replaced; `crs` is the DTM's.
    """
    if asked["animation"] is not None:
        from .animation import require_animation

        require_animation(asked["animation"])
        refuse_existing(asked["animation"], asked["overwrite"])
        if output.resolve() in Path(asked["animation"]).resolve().parents:
            raise OutputError(
                f"`animation={asked['animation']}` is inside {output}, which is replaced; give another folder"
            )
    if asked["kml"]:
        require_kml(crs)
    if asked["stac"]:
        require_stac(crs)


def _write_extra_files(asked, run, terrain, release_of):
    """Write film, KMZ and STAC item from the rasters of `run`; `release_of()` gives the release polygons or None."""
    if asked["kml"]:
        write_kml(run, release_of())
    if asked["stac"]:
        write_stac_item(run, asked["cog"])
    if asked["animation"] is not None:
        from .animation import write_animation

        write_animation(Path(asked["animation"]), run, terrain, release_of())
