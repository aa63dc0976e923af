"""Inputs of an export, checked before any work: output folder, DTM, density of the release, release outlines."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...system.errors import GeoreferenceError, InputError, MpmgisError, OutputError
from ...system.folder_lock import is_above
from ...system.messages import log
from ...system.whole_files import refuse_existing
from ...system.zip_archives import require_local
from ...terrain.dtm import read_terrain
from ...terrain.georeference import AUTO, LOCAL, name_of, same_place, warp_command
from ...terrain.raster_input import open_raster
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


def refuse_within(output, path):
    """Raise OutputError if the folder `output`, which will be replaced, contains the input at `path`."""
    if is_above(output, path.resolve()):
        raise OutputError(f"{output} contains the input {path.name} and would be replaced; give another `output`")


def run_terrain(source, entries, output):
    """The DTM of the request, or the one named in the frames. Its CRS must be that of the frames.

    `output` is the folder to write, None if nothing is written.

    Raises
    ------
    MpmgisError
        Missing, not usable, in another CRS, or inside the folder that will be replaced.
    """
    header, first = entries[0].header, entries[0].path
    path, crs = source.dem, source.crs
    if path is None:
        if not header.dem:
            raise InputError(f"{first} names no DTM; give it with `dem`")
        path = first.parent / header.dem
        require_local(path, first)
        if not path.exists():
            raise InputError(f"{path}, the DTM named in {first.name}, does not exist; give it with `dem`")
        if crs is None and not _carries_crs(path):
            crs = _crs_option(header.crs)
    terrain = read_terrain(path, crs, source.dem_band, to_crs=_target(source, header))
    if output is not None:
        refuse_within(output, Path(path))
    if header.crs is None and terrain.grid.crs is not None:
        log.info(f"the frames have no CRS; that of the DTM, {name_of(terrain.grid.crs)}, is assumed")
    elif not same_place(header.crs, terrain.grid.crs):
        fix = f"give the DTM that the run used{_reprojection(path, header.crs)}"
        if source.to_crs is not None:
            fix = f"leave `to_crs` out, or give `to_crs={AUTO}`"
        elif terrain.grid.crs is None:
            fix = (
                f"give the DTM that the run used, or declare the CRS of this one: "
                f"`crs={_crs_option(header.crs) or 'EPSG:n'}`"
            )
        raise GeoreferenceError(
            f"{first} is in {name_of(header.crs)}, but {path} is {'in' if source.to_crs is None else 'reprojected to'} "
            f"{name_of(terrain.grid.crs)}; {fix}"
        )
    if header.dem_sha256 and terrain.sha256 and header.dem_sha256 != terrain.sha256:
        log.info(f"{path} is not the DTM of the run (its sha256 differs)")
    return terrain


def _target(source, header):
    """CRS for the DTM: that of `to_crs` (auto: that of the frames), or the one that the frames were made with."""
    if source.to_crs == AUTO:
        return (_crs_option(header.crs) if header.crs is not None else None) or AUTO
    return source.to_crs or (header.header.get("to_crs") if source.dem is None else None)


def terrain_of_rasters(path, crs, band=None, to_crs=None):
    """The DTM at `path` for rasters in `crs`, which is assumed if the DTM has no CRS.

    `to_crs` is as for `read_terrain`, auto the CRS of the rasters.

    Raises
    ------
    GeoreferenceError
        It has another CRS.
    """
    if to_crs == AUTO and crs is not None:
        to_crs = _crs_option(crs) or AUTO
    terrain = read_terrain(path, None if _carries_crs(path) else LOCAL, band, to_crs=to_crs)
    if None not in (terrain.grid.crs, crs) and not same_place(terrain.grid.crs, crs):
        code = crs.to_epsg() or "n"
        raise GeoreferenceError(
            f"{path} is in {name_of(terrain.grid.crs)}, the results in {name_of(crs)}; give `to_crs=auto`, or "
            f"reproject it: {warp_command(path, f'EPSG:{code}')}"
        )
    return replace(terrain, grid=replace(terrain.grid, crs=crs))


def _reprojection(path, crs):
    """Command that reprojects the DTM at `path` to `crs`; "" if `crs` has no EPSG code."""
    code = None if crs is None else crs.to_epsg()
    return f", or `to_crs=auto`, or reproject it: {warp_command(path, f'EPSG:{code}')}" if code else ""


def _carries_crs(path):
    with open_raster(path) as source:
        return source.crs is not None


def _crs_option(crs):
    """Value of the option `crs` for `crs`; None if it has no EPSG code."""
    if crs is None:
        return "local"
    code = crs.to_epsg()
    return f"EPSG:{code}" if code else None


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
