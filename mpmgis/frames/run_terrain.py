"""DTM of a run: that of the user, or the one that the frames name."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..system.errors import GeoreferenceError, InputError, MpmgisError, OutputError
from ..system.file_references import require_local
from ..system.links import is_above
from ..system.messages import log
from ..system.source_names import file_of, joined
from ..terrain.dtm import read_terrain
from ..terrain.elevation import Terrain
from ..terrain.georeference import AUTO, LOCAL, name_of, same_place, warp_command
from ..terrain.raster_input import open_raster
from ..terrain.raster_output import NAMESPACE
from .frame_options import TerrainOptions
from .run_folder import TERRAIN_FILE, read_record


def refuse_within(output: Path, path: Path) -> None:
    """Raise unless an input lies outside the folder that will be replaced.

    Parameters
    ----------
    output : Path
        Folder that will be replaced.
    path : Path
        Path of the input.

    Raises
    ------
    OutputError
        The folder contains the input.
    """
    if is_above(output, path.resolve()):
        raise OutputError(f"{output} contains the input {path.name} and would be replaced; give another `output`")


def run_terrain(asked: TerrainOptions, entries: Sequence, output: Path | None) -> Terrain:
    """Read the DTM that is asked for, or the one named in the frames. Its CRS must be that of the frames.

    Parameters
    ----------
    asked : TerrainOptions
    entries : sequence of FrameEntry
        Frames of the run.
    output : Path or None
        Folder to write, None if nothing is written.

    Raises
    ------
    MpmgisError
        Missing, not usable, in another CRS, or inside the folder that will be replaced.
    """
    header, first = entries[0].header, entries[0].path
    path, crs = asked["dem"], asked["crs"]
    if path is None:
        if not header.dem:
            raise InputError(f"{first} names no DTM; give it with `dem`")
        path = joined(first.parent, header.dem)
        require_local(path, first)
        if not file_of(path).exists():
            raise InputError(f"{path}, the DTM named in {first.name}, does not exist; give it with `dem`")
        if crs is None and not _carries_crs(path):
            crs = _crs_option(header.crs)
    terrain = read_terrain(path, crs, asked["dem_band"], to_crs=_target(asked, header))
    if output is not None:
        refuse_within(output, file_of(path))
    if header.crs is None and terrain.grid.crs is not None:
        log.info(f"the frames have no CRS; that of the DTM, {name_of(terrain.grid.crs)}, is assumed")
    elif not same_place(header.crs, terrain.grid.crs):
        fix = f"give the DTM that the run used{_reprojection(path, header.crs)}"
        if asked["to_crs"] is not None:
            fix = f"leave `to_crs` out, or give `to_crs={AUTO}`"
        elif terrain.grid.crs is None:
            fix = (
                f"give the DTM that the run used, or declare the CRS of this one: "
                f"`crs={_crs_option(header.crs) or 'EPSG:n'}`"
            )
        raise GeoreferenceError(
            f"{first} is in {name_of(header.crs)}, but {path} is "
            f"{'in' if asked['to_crs'] is None else 'reprojected to'} {name_of(terrain.grid.crs)}; {fix}"
        )
    if header.dem_sha256 and terrain.sha256 and header.dem_sha256 != terrain.sha256:
        log.info(f"{path} is not the DTM of the run (its sha256 differs)")
    return terrain


def dtm_name(path: str | Path) -> str:
    """Return the name of the DTM of the user of which a file is a copy: in the folder of a run, or in an export.

    Parameters
    ----------
    path : str or Path
        Path of a DTM, of the copy in the folder of a run, or of the terrain of an export.
    """
    path = Path(path)
    name = ""
    try:
        if path.name == TERRAIN_FILE:
            name = (read_record(path.parent).get("terrain") or {}).get("dem", "")
        if not name and path.is_file():
            with open_raster(path) as source:
                name = source.tags(ns=NAMESPACE).get("dem", "")
    except (MpmgisError, AttributeError):
        name = ""
    return Path(str(name)).name or path.name


def _target(asked: TerrainOptions, header: Any) -> str | None:
    """Return the CRS for the DTM: that of `to_crs` (auto: that of the frames), or the one recorded in the frames."""
    if asked["to_crs"] == AUTO:
        return (_crs_option(header.crs) if header.crs is not None else None) or AUTO
    return asked["to_crs"] or (header.header.get("to_crs") if asked["dem"] is None else None)


def terrain_of_rasters(path: str | Path, crs: Any, band: int | None = None, to_crs: str | None = None) -> Terrain:
    """Read a DTM for rasters in a given CRS, which is assumed if the DTM has no CRS.

    Parameters
    ----------
    path : str or Path
        Path of the DTM.
    crs : pyproj.CRS or None
        CRS of the rasters.
    band : int, optional
    to_crs : str, optional
        As for `read_terrain`; auto is the CRS of the rasters.

    Raises
    ------
    GeoreferenceError
        The DTM has another CRS.
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


def _reprojection(path: Path, crs: Any) -> str:
    """Return advice on how to reproject the DTM at `path` to `crs`; "" if `crs` has no EPSG code."""
    code = None if crs is None else crs.to_epsg()
    return f", or `to_crs=auto`, or reproject it: {warp_command(path, f'EPSG:{code}')}" if code else ""


def _carries_crs(path):
    with open_raster(path) as source:
        return source.crs is not None


def _crs_option(crs: Any) -> str | None:
    """Return the value of the option `crs` for `crs`; None if it has no EPSG code."""
    if crs is None:
        return "local"
    code = crs.to_epsg()
    return f"EPSG:{code}" if code else None
