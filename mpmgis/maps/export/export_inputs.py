"""Inputs of an export, checked before any work: output folder, DTM, density of the release, release outlines."""

import tomllib
from pathlib import Path

import numpy as np

from ...frames.run_terrain import refuse_within
from ...system.disguised_files import require_local
from ...system.errors import GeoreferenceError, InputError, MpmgisError
from ...system.messages import log
from ...system.whole_files import refuse_existing
from ..averaging.maxima import SolverPeaks


def output_folder(request, entries):
    """Path of the request, else `<name>_gis` next to the folder `<name>` of the frames.

    Raises
    ------
    OutputError
        It exists and may not be replaced, or contains an input.
    """
    if request.output is not None:
        output = Path(request.output)
    else:
        folder = entries[0].path.parent
        folder = folder if folder.name not in ("", "..") else folder.resolve()
        output = folder.parent / f"{folder.name}_gis"
    refuse_existing(output, request.overwrite)
    for entry in entries:
        refuse_within(output, entry.path)
    return output


def release_density(source, entries):
    """Density of the release [kg m-3]: that of the frames, else `density`, else mass over volume of the first frame."""
    first = entries[0]
    stored = first.header.header.get("density")
    if stored is not None:
        stored = float(stored)
        if not (np.isfinite(stored) and stored > 0):
            raise InputError(f"{first.path}: density {stored:g} kg m-3, expected a number above 0")
        if source.density not in (None, stored):
            log.info(f"the density in the frames is {stored:g} kg m-3; `density={source.density:g}` is not used")
        return stored
    if source.density is not None:
        return source.density
    particles = first.read().particles
    density = float(particles.mass.sum() / particles.volume.sum())
    log.info(f"density of the release: {density:.6g} kg m-3, mass over volume in {first.path.name} (or give `density`)")
    return density


def log_unused_options(averaging, entries):
    """Log options of the request without effect if all frames are columns."""
    if all(entry.header.dimension == 2 for entry in entries) and (
        averaging.percentile < 100 or averaging.standoff != 0
    ):
        log.info("the frames are columns, which stand on the bed: `percentile` and `standoff` have no effect")


def solver_peaks(entry):
    """The solver's maxima of all steps up to a frame (SolverPeaks); None if it stored none."""
    return SolverPeaks.of(entry.read_maxima(), entry.time)


def release_file(entries):
    """Path of the release in the scene beside the frames; None without one."""
    scene = entries[0].path.parent / "scene.toml"
    try:
        source = tomllib.loads(scene.read_text(encoding="utf-8"))["release"]["source"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return scene.parent / str(source)


def release_name(entries):
    """Name of the release: from the frames, else from its file, else from the frames' folder."""
    stored, file = entries[0].header.header.get("release"), release_file(entries)
    return str(stored) if stored else file.stem if file is not None else entries[0].path.resolve().parent.name


def release_outlines(entries, terrain):
    """Polygons of the run's release in the terrain's CRS; None if its file is unknown or missing."""
    file = release_file(entries)
    if file is None:
        return None
    from ...seeding.release_areas import read_outlines  # imports GDAL's vector library, not needed for rasters

    try:
        require_local(file, entries[0].path)
        return read_outlines(file, terrain) if file.exists() else None
    except MpmgisError:
        return None


def refuse_nowhere(entry, terrain):
    """Raise an error: the frame has no particle on the DTM."""
    west, south, east, north = terrain.grid.bounds
    raise GeoreferenceError(
        f"{entry.path}: none of its {entry.count} particles is on {terrain.path} (E {west:.0f} to {east:.0f}, N "
        f"{south:.0f} to {north:.0f}); give the DTM that the run used"
    )
