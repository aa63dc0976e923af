"""What an export starts from: where it goes, the DTM, the density of the release. Every refusal before any work."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..analysis.maxima import SolverPeaks
from ..errors import GeoreferenceError, InputError, MpmgisError, OutputError
from ..io.atomic import refuse_existing
from ..io.gdal_input import require_local
from ..io.links import is_above
from ..io.raster import open_raster, read_terrain
from ..messages import log
from ..terrain.georeference import LOCAL, name_of, same_place, warp_command


def output_folder(request, entries):
    """Path that was asked for, else `<name>_gis` next to the folder `<name>` that holds the frames.

    Raises
    ------
    OutputError
        It exists and was not to be replaced, or holds what the export is made from.
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
    """Raise OutputError where the folder `output`, which is going to be replaced, holds the file at `path`."""
    if is_above(output, path.resolve()):
        raise OutputError(
            f"{output} holds {path.name}, which this is made from, and would be replaced; give another -o"
        )


def run_terrain(request, entries, output):
    """The DTM asked for, or the one that the frames name. It must lie in the frames' CRS.

    `output` is the folder that is going to be written, None where nothing is.

    Raises
    ------
    MpmgisError
        Missing, not usable, in another CRS, or inside the folder that is going to be replaced.
    """
    header, first = entries[0].header, entries[0].path
    path, crs = request.dem, request.crs
    if path is None:
        if not header.dem:
            raise InputError(f"{first} names no DTM; give it with --dem")
        path = first.parent / header.dem
        require_local(path, first)
        if not path.exists():
            raise InputError(f"{path}, which {first.name} names as its DTM, is not there; give it with --dem")
        if crs is None and not _carries_crs(path):
            crs = _word_of(header.crs)
    terrain = read_terrain(path, crs, request.dem_band)
    if output is not None:
        refuse_within(output, Path(path))
    if header.crs is None and terrain.grid.crs is not None:
        log.info(f"the frames carry no CRS; taken to be in the DTM's, {name_of(terrain.grid.crs)}")
    elif not same_place(header.crs, terrain.grid.crs):
        cure = _reprojection(path, header.crs)
        if terrain.grid.crs is None:
            cure = f", or say where this one lies: --crs {_word_of(header.crs) or 'EPSG:n'}"
        raise GeoreferenceError(
            f"{first} is in {name_of(header.crs)}, but {path} is in {name_of(terrain.grid.crs)}; give the DTM that the "
            f"run used{cure}"
        )
    if header.dem_sha256 and terrain.sha256 and header.dem_sha256 != terrain.sha256:
        log.info(f"{path} is not the DTM that the frames were made on (its sha256 differs)")
    return terrain


def terrain_of_rasters(path, crs, band=None):
    """The DTM at `path` under rasters in `crs`, which it takes where it carries none.

    Raises
    ------
    GeoreferenceError
        It lies in another CRS.
    """
    terrain = read_terrain(path, None if _carries_crs(path) else LOCAL, band)
    if None not in (terrain.grid.crs, crs) and not same_place(terrain.grid.crs, crs):
        code = crs.to_epsg() or "n"
        raise GeoreferenceError(
            f"{path} is in {name_of(terrain.grid.crs)}, the results in {name_of(crs)}; reproject it: "
            f"{warp_command(path, f'EPSG:{code}')}"
        )
    return replace(terrain, grid=replace(terrain.grid, crs=crs))


def _reprojection(path, crs):
    """How to bring the DTM at `path` to `crs`; nothing where that has no code to name it by."""
    code = None if crs is None else crs.to_epsg()
    return f", or reproject it: {warp_command(path, f'EPSG:{code}')}" if code else ""


def _carries_crs(path):
    with open_raster(path) as source:
        return source.crs is not None


def _word_of(crs):
    """What --crs would have to say for `crs`; None where it cannot say it."""
    if crs is None:
        return "local"
    code = crs.to_epsg()
    return f"EPSG:{code}" if code else None


def release_density(request, entries):
    """Density of the release [kg m-3]: what the frames say, else --density, else mass over volume of the first one."""
    first = entries[0]
    said = first.header.header.get("density")
    if said is not None:
        said = float(said)
        if not (np.isfinite(said) and said > 0):
            raise InputError(f"{first.path}: density {said:g} kg m-3, wanted a number above 0")
        if request.density not in (None, said):
            log.info(f"the frames say that their density is {said:g} kg m-3; --density {request.density:g} is not used")
        return said
    if request.density is not None:
        return request.density
    particles = first.read().particles
    density = float(particles.mass.sum() / particles.volume.sum())
    log.info(f"density of the release: {density:.6g} kg m-3, mass over volume in {first.path.name} (or give --density)")
    return density


def tell_of_columns(request, entries):
    """Say which of the request's options change nothing, where all frames are columns."""
    if all(entry.header.dimension == 2 for entry in entries) and (request.percentile < 100 or request.standoff != 0):
        log.info(
            "the frames are columns, which stand on the bed and fill it: --percentile and --standoff change nothing"
        )


def solver_peaks(entry):
    """What the solver kept of every step up to a frame (SolverPeaks); None where it kept nothing."""
    return SolverPeaks.of(entry.read_maxima(), entry.time)


def release_file(entries):
    """Path of the release that the run beside the frames was made from; None where no scene there names one."""
    scene = entries[0].path.parent / "scene.toml"
    try:
        source = tomllib.loads(scene.read_text(encoding="utf-8"))["release"]["source"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return scene.parent / str(source)


def release_name(entries):
    """Name of the release: as the frames say, else that of its file, else that of the frames' folder."""
    said, file = entries[0].header.header.get("release"), release_file(entries)
    return str(said) if said else file.stem if file is not None else entries[0].path.resolve().parent.name


def release_outlines(entries, terrain):
    """Polygons of the run's release in the terrain's CRS; None where its file is not known or gone."""
    file = release_file(entries)
    if file is None:
        return None
    from ..io.vector import read_outlines  # brings GDAL's vector files, which rasters alone do without

    try:
        require_local(file, entries[0].path)
        return read_outlines(file, terrain) if file.exists() else None
    except MpmgisError:
        return None


def refuse_nowhere(entry, terrain):
    """Raise the refusal of a frame that has no particle on the DTM."""
    west, south, east, north = terrain.grid.bounds
    raise GeoreferenceError(
        f"{entry.path}: none of its {entry.count} particles lies on {terrain.path} (E {west:.0f} to {east:.0f}, N "
        f"{south:.0f} to {north:.0f}); give the DTM that the run used"
    )
