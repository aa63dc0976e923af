"""Check the inputs of an export before any work: output folder, DTM, density of the release, release outlines."""

import math
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...frames.flow_end import FlowEnd, recorded_end
from ...frames.run_folder import record_of
from ...frames.run_terrain import refuse_within
from ...system.errors import GeoreferenceError, InputError, MpmgisError
from ...system.file_references import require_local
from ...system.messages import log
from ...system.source_names import file_of, joined
from ...system.whole_files import refuse_existing
from ..averaging.maxima import SolverPeaks

if TYPE_CHECKING:
    from ...exchange.frame_list import FrameEntry
    from ...frames.frame_options import DensityOptions
    from ...terrain.elevation import Terrain
    from ..averaging.averaging_options import CellOptions
    from .export_options import Export, ExportAveragingOptions


def output_folder(asked: "Export", entries: Sequence) -> Path:
    """Return the folder of an export: the one asked for, else `<name>_gis` next to the folder `<name>` of the frames.

    Parameters
    ----------
    asked : Export
    entries : sequence of FrameEntry

    Raises
    ------
    OutputError
        It exists and may not be replaced, or contains an input.
    """
    if asked["output"] is not None:
        output = Path(asked["output"])
    else:
        folder = entries[0].path.parent
        folder = folder if folder.name not in ("", "..") else folder.resolve()
        output = folder.parent / f"{folder.name}_gis"
    refuse_existing(output, asked["overwrite"])
    for entry in entries:
        refuse_within(output, entry.path)
    return output


def release_density(asked: "DensityOptions", entries: Sequence) -> float:
    """Return the density of the release [kg m-3].

    It is that of the frames, else `density`, else mass over volume of the first frame.

    Parameters
    ----------
    asked : DensityOptions
    entries : sequence of FrameEntry

    Raises
    ------
    InputError
        The density in the frames is not above 0.
    """
    first = entries[0]
    stored = first.header.header.get("density")
    if stored is not None:
        stored = float(stored)
        if not (np.isfinite(stored) and stored > 0):
            raise InputError(f"{first.path}: density {stored:g} kg m-3, expected a number above 0")
        if asked["density"] not in (None, stored):
            log.info(f"the density in the frames is {stored:g} kg m-3; `density={asked['density']:g}` is not used")
        return stored
    if asked["density"] is not None:
        return asked["density"]
    particles = first.read().particles
    density = float(particles.mass.sum() / particles.volume.sum())
    log.info(f"density of the release: {density:.6g} kg m-3, mass over volume in {first.path.name} (or give `density`)")
    return density


def log_unused_options(asked: "CellOptions | ExportAveragingOptions", entries: Sequence) -> None:
    """Log options of the averaging without effect if all frames are columns.

    Parameters
    ----------
    asked : CellOptions or ExportAveragingOptions
    entries : sequence of FrameEntry
    """
    if all(entry.header.dimension == 2 for entry in entries) and (asked["percentile"] < 100 or asked["standoff"] != 0):
        log.info("the frames are columns, which stand on the bed: `percentile` and `standoff` have no effect")


def solver_peaks(entry: "FrameEntry") -> SolverPeaks | None:
    """Read the solver's maxima of all steps up to a frame; None if it stored none.

    Parameters
    ----------
    entry : FrameEntry
    """
    return SolverPeaks.of(entry.read_maxima(), entry.time)


def run_end(entry: "FrameEntry") -> FlowEnd | None:
    """Return the FlowEnd that a finished run recorded beside its last frame; None for any other frame.

    Parameters
    ----------
    entry : FrameEntry
    """
    end = recorded_end(record_of(entry.path.parent, entry.header.digest))
    return end if end is not None and math.isclose(end.time, entry.time) else None


def release_file(entries: Sequence) -> Path | str | None:
    """Return the path of the release in the scene beside the frames; None without one.

    Parameters
    ----------
    entries : sequence of FrameEntry
    """
    scene = entries[0].path.parent / "scene.toml"
    try:
        source = tomllib.loads(scene.read_text(encoding="utf-8"))["release"]["source"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return joined(scene.parent, str(source))


def release_name(entries: Sequence) -> str:
    """Return the name of the release: from the frames, else from its file, else from the frames' folder.

    Parameters
    ----------
    entries : sequence of FrameEntry
    """
    stored, file = entries[0].header.header.get("release"), release_file(entries)
    return str(stored) if stored else file_of(file).stem if file is not None else entries[0].path.resolve().parent.name


def release_outlines(entries: Sequence, terrain: "Terrain") -> list | None:
    """Read the polygons of the run's release in the terrain's CRS; None if its file is unknown or missing.

    Parameters
    ----------
    entries : sequence of FrameEntry
    terrain : Terrain
    """
    file = release_file(entries)
    if file is None:
        return None
    from ...seeding.release_areas import read_outlines  # imports GDAL's vector library, not needed for rasters

    try:
        require_local(file, entries[0].path)
        return read_outlines(file, terrain) if file_of(file).exists() else None
    except MpmgisError:
        return None


def refuse_nowhere(entry: "FrameEntry", terrain: "Terrain") -> None:
    """Raise the error for a frame without a particle on the DTM.

    Parameters
    ----------
    entry : FrameEntry
    terrain : Terrain

    Raises
    ------
    GeoreferenceError
    """
    west, south, east, north = terrain.grid.bounds
    raise GeoreferenceError(
        f"{entry.path}: none of its {entry.count} particles is on {terrain.path} (E {west:.0f} to {east:.0f}, N "
        f"{south:.0f} to {north:.0f}); give the DTM that the run used"
    )
