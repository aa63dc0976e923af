"""Seeding from files: columns from a DTM and release areas (`mpmgis seed`)."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..frames.particle_files import require_format, write_columns
from ..frames.particles import Frame, Particles
from ..system import source_names
from ..system.errors import InputError, OutputError
from ..system.memory import memory_lack
from ..system.whole_files import refuse_existing
from ..terrain.dtm import TerrainFile, read_terrain, whole_or_parts
from ..terrain.elevation import Terrain
from ..terrain.release_parts import NORMAL, ReleaseArea
from ..terrain.spatial_inputs import with_crs_hint
from .column_seeding import Seed, plan_seed
from .implausible_values import Fixes, report_implausible
from .release_areas import read_release
from .seeding_options import SeedOptions

_BYTES_PER_COLUMN = 120  # of a frame in memory: 14 numbers and its identity
_FIXES = Fixes(
    "`density`",
    "`thickness`",
    "give a larger `per_cell` or `count`, a smaller `spacing`, or a finer DTM",
    "give a finer DTM, or in a scene a smaller [numerics] cell_size",
)


@dataclass(frozen=True)
class Seeded:
    """Result of `seed_file`.

    Parameters
    ----------
    path : Path
        File of the columns.
    count : int
        Number of columns.
    record : dict
        Record of the seeding.
    """

    path: Path
    count: int
    record: dict


def seed_file(
    dem: str | Path,
    release: str | Path,
    output: str | Path | None = None,
    *,
    crs: str | None = None,
    dem_band: int | None = None,
    fill_nodata: str | None = None,
    to_crs: str | None = None,
    thickness: float | str | Path | None = None,
    thickness_mode: str = NORMAL,
    surface: str | Path | None = None,
    overwrite: bool = False,
    **options: object,
) -> Seeded:
    """Seed a release on a DTM and write the columns to a file.

    Parameters
    ----------
    dem, release : str or Path
    output : str or Path, optional
        Its suffix picks the format; default ``<release name>_particles.h5`` in the current folder.
    crs, dem_band, fill_nodata, to_crs
        As for `read_terrain`.
    thickness, thickness_mode, surface
        As for `read_release`.
    overwrite : bool
    **options
        Fields of `SeedOptions`.

    Raises
    ------
    OutputError
        The file exists, or is an input.
    InputError
        As from `seed_columns`.
    """
    if output is not None:
        require_format(output)
        refuse_existing(output, overwrite)
    file = with_crs_hint(release, lambda: TerrainFile(dem, crs, dem_band, fill_nodata, to_crs))
    terrain = whole_or_parts(file, "only those around the release are read and checked")
    area = read_release(release, terrain, thickness, thickness_mode, surface, _memory_check(terrain, options))
    path = Path(output) if output is not None else Path(f"{area.name}_particles.h5")
    refuse_existing(path, overwrite)
    _refuse_replacing(path, (dem, release, thickness, surface))
    seed = _planned(terrain, area, options)
    frame = replace(seed.empty_frame(), dem=source_names.moved(terrain.path, path.parent))
    write_columns(path, frame, seed.count, seed.slabs())
    return Seeded(path, seed.count, seed.record)


def seed_frame(
    dem: str | Path,
    release: str | Path,
    *,
    crs: str | None = None,
    dem_band: int | None = None,
    fill_nodata: str | None = None,
    to_crs: str | None = None,
    thickness: float | str | Path | None = None,
    thickness_mode: str = NORMAL,
    surface: str | Path | None = None,
    **options: object,
) -> tuple[Frame, Terrain, str, dict]:
    """Seed a release on a DTM in memory.

    Parameters
    ----------
    dem, release : str or Path
    crs, dem_band, fill_nodata, to_crs
        As for `read_terrain`.
    thickness, thickness_mode, surface
        As for `read_release`.
    **options
        Fields of `SeedOptions`.

    Returns
    -------
    frame : Frame
        All columns.
    terrain : Terrain
    name : str
        Name of the release.
    record : dict
        Record of the seeding.
    """
    terrain = with_crs_hint(
        release, lambda: read_terrain(dem, crs=crs, band=dem_band, fill_nodata=fill_nodata, to_crs=to_crs)
    )
    area = read_release(release, terrain, thickness, thickness_mode, surface, _memory_check(terrain, options))
    seed = _planned(terrain, area, options)
    slabs = [particles.arrays() for particles in seed.slabs()]
    particles = Particles(**{name: np.concatenate([slab[name] for slab in slabs]) for name in slabs[0]})
    return replace(seed.empty_frame(), particles=particles), terrain, area.name, seed.record


def _memory_check(terrain: Terrain | TerrainFile, options: dict) -> Callable[[float], None]:
    """Return a function of the release area [m2] that refuses more columns than the free memory can contain.

    Columns that the user asks for (`per_cell`, `count`, `spacing`) are not refused: they are written slab by slab.
    """
    asked = any(options.get(name) is not None for name in ("per_cell", "count", "spacing"))

    def check(area):
        cell = (options.get("cell_size") or terrain.grid.cell_size) ** 2
        columns = area / cell * SeedOptions().per_cell
        if not asked and (lack := memory_lack(columns * _BYTES_PER_COLUMN)):
            raise InputError(
                f"{terrain.path}: its cells of {math.sqrt(cell):.4g} m make {columns:.3g} columns on {area:.6g} m2, "
                f"which need {lack}; give `spacing`, `count` or `per_cell`, or a coarser DTM"
            )

    return check


def _planned(terrain: Terrain | TerrainFile, area: ReleaseArea, options: dict) -> Seed:
    """Return the Seed of a release on a terrain; implausible values are logged."""
    seed = plan_seed(terrain, area, **options)
    mean_thickness = seed.record["reference_volume"] / seed.record["release_area"]
    across = math.sqrt(seed.record["release_area"] / terrain.grid.cell_area)
    report_implausible(seed.count, seed.record["density"], mean_thickness, across, _FIXES)
    return seed


def _refuse_replacing(path, inputs):
    """Refuse to replace an input, even with `overwrite`."""
    for given in inputs:
        named = source_names.file_of(given)
        if path.exists() and named.exists() and path.samefile(named):
            raise OutputError(f"{path} is an input and would be replaced; give another `output`")
