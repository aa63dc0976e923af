"""Find the input files of a scene; read its spatial features onto the solver's grid."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..solvers.features.feature_placement import PlacedFiles, erodible_ground, painted_zones
from ..solvers.features.features_by_place import KnownByPlace
from ..solvers.features.forest_values import ENTRY, forest_values
from ..solvers.features.lakes import lake_levels
from ..solvers.features.wall_placement import standing_walls, walls_of
from ..system.errors import MpmgisError
from ..system.source_names import file_of
from ..terrain.mask_values import TRACE, inside_of, require_metres, without_traces
from ..terrain.raster_input import raster_files
from ..terrain.spatial_inputs import is_raster, read_placed_raster, read_polygons, read_walls
from ..terrain.undeclared_nodata import MASK, PARAMETER, THICKNESS

if TYPE_CHECKING:
    from ..frames.particles import Frame
    from ..scene import Scene
    from ..solvers.columns.node_grid import ColumnGrid
    from ..solvers.features.walls import Wall
    from ..terrain.elevation import Terrain

VIRTUAL = b"<VRTDataset"  # at the start of a virtual raster


def input_files(given: str | Path | Mapping, scene: "Scene", laws: str | Path | None = None) -> Iterator[Path]:
    """Yield the path of every existing file that a run of `scene` reads.

    Parameters
    ----------
    given : path or Mapping
        Source of the scene.
    scene : Scene
    laws : path, optional
        File with the user's own friction laws.
    """
    if not isinstance(given, Mapping):
        yield Path(given)
    if laws is not None:
        yield Path(laws)
    for name in scene.files():
        yield from _with_companions(file_of(scene.path(name)))


def _with_companions(path):
    """Yield `path` or the files in this folder, files with the same stem, and the sources of a virtual raster."""
    if path.is_dir():
        yield from (entry for entry in path.rglob("*") if entry.is_file())
        return
    if not path.exists():
        return
    yield path
    stem = path.name.partition(".")[0]
    yield from (entry for entry in path.parent.iterdir() if entry.name.startswith(f"{stem}.") and entry.is_file())
    with suppress(MpmgisError, OSError), open(path, "rb") as file:
        if VIRTUAL in file.read(1000):
            yield from raster_files(path)


def read_spatial_features(
    scene: "Scene", terrain: "Terrain", grid: "ColumnGrid", start: "Frame", everything: "Frame"
) -> KnownByPlace:
    """Read all spatial features of a scene onto the grid.

    Parameters
    ----------
    scene : Scene
    terrain : Terrain
    grid : ColumnGrid
        Of the solver.
    start, everything : Frame
        The columns at the start, and all that are ever released.

    Raises
    ------
    InputError
        A file cannot be read or does not match terrain, release and scene.
    """
    notes = []
    in_3d = scene.solver == "points"
    walls, nodes = standing_walls(_barriers(scene, terrain), grid, everything, in_3d, notes)
    return KnownByPlace(
        grid,
        scene,
        _zones(scene, terrain, grid, notes),
        _erodible(scene, terrain, grid, everything, notes),
        walls,
        nodes,
        _lakes(scene, terrain, grid, start),
        _forest(scene, terrain, grid, notes),
        notes,
    )


def trial_parameters(scene: "Scene") -> dict[str, float]:
    """Return parameters for a trial of the scene's friction law.

    Each is that of [friction], else of the first zone that has it, else the least allowed value.

    Parameters
    ----------
    scene : Scene
    """
    law = scene.laws[scene.friction.law][1]
    numbers = {}
    for zone in scene.zones:
        numbers = {name: v for name, v in zone.parameters.items() if not isinstance(v, str)} | numbers
    return {name: scene.friction.parameters.get(name, numbers.get(name, allowed[2])) for name, allowed in law.items()}


def _used(table):
    return table is not None and table.use != "off"


def _spatial_file(path, terrain):
    """Return polygons or the mask at `path`: 1 inside, NaN outside."""
    if not is_raster(path):
        return PlacedFiles(features=read_polygons(path, terrain))
    values, grid = read_placed_raster(path, terrain, MASK)
    return PlacedFiles(raster=(np.where(inside_of(values, path), 1.0, np.nan), grid))


def _zones(scene, terrain, grid, notes):
    """Return parameter -> values at the nodes; {} without zones."""
    used = [(k, zone) for k, zone in enumerate(scene.zones, 1) if _used(zone)]
    if not used or not _used(scene.friction):
        return {}
    read = ((number, zone, _zone_files(scene, zone, terrain)) for number, zone in used)
    return painted_zones(scene, read, grid, notes)


def _forest(scene, terrain, grid, notes):
    """Return values of the trees at the nodes; None without [[forest]]."""
    used = [(k, table) for k, table in enumerate(scene.forest, 1) if _used(table)]
    if not used:
        return None
    given = ((k, table, {key: getattr(table, key) for key in ENTRY}) for k, table in used)
    return forest_values(
        ((k, table, _files_by_place(scene, table.source, values, terrain)) for k, table, values in given), grid, notes
    )


def _zone_files(scene, zone, terrain):
    """Return polygons or mask of a zone, and the rasters that its parameters name."""
    return _files_by_place(scene, zone.source, zone.parameters, terrain)


def _files_by_place(scene: "Scene", source: str | None, parameters: dict, terrain: "Terrain") -> PlacedFiles:
    """Return polygons or mask of `source`, and rasters that `parameters` (name -> number, column or raster) name."""
    values = {
        name: read_placed_raster(scene.path(value), terrain, PARAMETER)
        for name, value in parameters.items()
        if isinstance(value, str) and (Path(value).suffix or file_of(scene.path(value)).exists())
    }
    where = PlacedFiles() if source is None else _spatial_file(scene.path(source), terrain)
    return PlacedFiles(where.features, where.raster, values)


def scene_walls(scene: "Scene", terrain: "Terrain") -> "tuple[Wall, ...]":
    """Return the walls of the scene's barriers, with the names of its results.

    Parameters
    ----------
    scene : Scene
    terrain : Terrain
    """
    return walls_of(_barriers(scene, terrain))


def _barriers(scene, terrain):
    """Yield (table, its files) of every barrier that is not off."""
    for table in filter(_used, scene.barrier):
        yield table, PlacedFiles(features=read_walls(scene.path(table.source), terrain, table.width))


def _erodible(scene: "Scene", terrain: "Terrain", grid: "ColumnGrid", frame: "Frame", notes: list) -> object:
    """Return the Erodible ground at the nodes; None without [entrainment]."""
    table = scene.entrainment
    if not _used(table):
        return None
    path = scene.path(table.source)
    mask_or_polygons = table.thickness is not None or not is_raster(path)
    files = _spatial_file(path, terrain) if mask_or_polygons else _erodible_raster(path, terrain)
    return erodible_ground(table, files, path, grid, frame.header["density"], notes)


def _erodible_raster(path, terrain):
    """Return the raster of thickness of erodible ground at `path`."""
    values, grid = read_placed_raster(path, terrain, THICKNESS)
    inside = without_traces(values, path, TRACE)
    if (values[inside] > 0).any():
        require_metres(values[inside & (values > 0)], path, "give [entrainment] thickness = metres with it")
    return PlacedFiles(raster=(np.where(inside, values, np.nan), grid))


def _lakes(scene: "Scene", terrain: "Terrain", grid: "ColumnGrid", start: "Frame") -> object:
    """Return the still level in the cells [m]; None without [still_water]."""
    table = scene.still_water
    if not _used(table):
        return None
    features = None if table.source is None else read_polygons(scene.path(table.source), terrain)
    return lake_levels(table, PlacedFiles(features), grid, start)
