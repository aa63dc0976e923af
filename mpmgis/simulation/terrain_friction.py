"""Friction by class of terrain as rasters and lines of a scene: `mpmgis friction-map`."""

import itertools
import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .. import __version__
from ..laws.friction import parameters_to_give
from ..laws.quantities import SQUARE_METRES_PER_HECTARE, Quantity
from ..maps.qgis.raster_styles import class_pipe, style_document
from ..scene.scene_text import toml_value
from ..system.errors import InputError, OutputError
from ..system.links import is_above
from ..system.messages import Progress, muted, unwatched
from ..system.option import PathLike
from ..system.parallel import frame_pool
from ..system.whole_files import refuse_existing, whole_folder
from ..terrain.class_limits import ClassLimits
from ..terrain.class_rasters import new_class_raster
from ..terrain.dtm import TerrainFile
from ..terrain.dtm_blocks import Block, block_heights, dtm_blocks
from ..terrain.elevation import Terrain
from ..terrain.friction_table import FrictionCells, read_friction_table, rows_of_event
from ..terrain.grid import Grid
from ..terrain.raster_output import BLOCK as TILE
from ..terrain.raster_output import new_geotiff, strips, write_strip
from ..terrain.terrain_classes import CLASSES, OUTSIDE, block_classes, class_halo

CLASS_FILE, CLASS_STYLE, SCENE_FILE = "terrain_class.tif", "terrain_class.qml", "friction.toml"
COLOURS = {"open": "#e3cf9f", "channel": "#74a9cf", "gully": "#045a8d", "flat": "#a6d8a0"}  # of classes on the map
ENTRIES = [(number, name, COLOURS[name]) for name, number in CLASSES.items()]
SIDE = 512  # [cells] of a block


@dataclass(frozen=True)
class FrictionFound:
    """Friction on a terrain.

    Parameters
    ----------
    name : str
        Of the DTM.
    law : str
    areas : dict of str to float [m2]
        In plan, by class of terrain.
    parameters : dict of str to (float, float)
        Smallest and largest value of each parameter.
    files : tuple of Path
        `friction.toml` first.
    """

    name: str
    law: str
    areas: dict[str, float]
    parameters: dict[str, tuple[float, float]]
    files: tuple[Path, ...]

    def lines(self) -> list[str]:
        """Return lines of text for a terminal."""
        lines = [f"{self.name}: friction {self.law} by class of terrain"]
        lines += [f"{name:<12}{area / SQUARE_METRES_PER_HECTARE:>12.2f} ha" for name, area in self.areas.items()]
        units = {name: parameter.unit for name, parameter in parameters_to_give(self.law).items()}
        for name, (low, high) in self.parameters.items():
            lines.append(f"{name:<12}{f'{low:g}' if low == high else f'{low:g} to {high:g}':>12} [{units[name]}]")
        return lines


def terrain_friction(
    terrain: Terrain | TerrainFile,
    table: PathLike,
    law: str,
    event: tuple[float | None, float | None],
    limits: ClassLimits,
    output: PathLike | None = None,
    overwrite: bool = False,
    side: int | None = None,
    progress: Progress = unwatched,
) -> FrictionFound:
    """Write the classes of a terrain, the friction of a table on them, and the lines of a scene that uses it.

    A parameter that is the same everywhere is a number of [friction], so that a constant table gives the run of a scene
    with these numbers, bit for bit.

    Parameters
    ----------
    terrain : Terrain or TerrainFile
        A TerrainFile is read by block.
    table : path
        CSV, as `friction_table` describes it.
    law : str
        Name of a built-in law.
    event : (float or None, float or None) [m3], [years]
        Volume of the release, and return period.
    limits : ClassLimits
    output : path, optional
        Folder; default ``<name of the DTM>_friction`` in the current folder.
    overwrite : bool
    side : int, optional [cells]
        Of a block; it does not change the files. Default SIDE, or the reach of the classes where that is larger.
    progress : callable
        Called with (blocks done, blocks in all).

    Returns
    -------
    FrictionFound

    Raises
    ------
    MpmgisError
        An invalid table, or one with a gap; nothing is written then.
    """
    name = Path(terrain.path).stem
    folder = Path(f"{name}_friction" if output is None else output)
    if folder.suffix.lower() in (".tif", ".toml"):
        raise InputError(f"`output={folder}` is one file, and several are written; give a folder")
    refuse_existing(folder, overwrite)
    for path in (terrain.path, table):
        if is_above(folder, Path(path).resolve()):
            raise OutputError(f"{folder} contains the input {path} and would be replaced; give another `output`")
    volume, period = event
    cells = FrictionCells(rows_of_event(read_friction_table(table, law), volume, period, table), table)
    blocks = dtm_blocks(terrain, side or max(SIDE, class_halo(terrain.grid, limits)))
    tags = {
        "version": __version__,
        "dem": name,
        "table": Path(table).name,
        "law": law,
        "volume": "any" if volume is None else f"{volume:g}",
        "return_period": "any" if period is None else f"{period:g}",
        "class_limits": json.dumps(vars(limits)),
    }
    files = [SCENE_FILE, CLASS_FILE, CLASS_STYLE]
    with whole_folder(folder, overwrite) as part:
        with frame_pool() as pool, pool.ended():
            found = _shown(pool.map(_friction_of_block, blocks, terrain, cells, limits), len(blocks), progress)
            counts = _write_rasters(part, terrain.grid, law, cells, _strips(blocks, found), tags)
        if not counts.any():
            raise InputError(f"{terrain.path}: every cell is nodata")
        parameters = cells.found()
        for key in cells.varying():
            if parameters[key][0] == parameters[key][1]:
                (part / _file(key)).unlink()
            else:
                files.append(_file(key))
        style = style_document(class_pipe(ENTRIES))
        (part / CLASS_STYLE).write_text(style, encoding="utf-8", newline="\n")
        text = _scene_lines(law, parameters, folder.resolve().name, tags)
        (part / SCENE_FILE).write_text(text, encoding="utf-8", newline="\n")
    areas = {key: float(counts[number]) * terrain.grid.cell_area for key, number in CLASSES.items()}
    return FrictionFound(name, law, areas, parameters, tuple(folder / file for file in files))


def _friction_of_block(
    block: Block, terrain: Terrain | TerrainFile, cells: FrictionCells, limits: ClassLimits
) -> tuple[np.ndarray, np.ndarray]:
    """Return the class of each cell of a block, and the row of the table."""
    halo = class_halo(terrain.grid, limits)
    with muted():
        ground = block_heights(terrain, block, halo)
    classes = block_classes(ground, block, terrain.grid, limits)
    return classes, cells.chosen(classes, ground[halo:-halo, halo:-halo])


def _shown(parts: Iterable, count: int, progress: Progress) -> Iterator:
    """Yield the parts, and report the progress after each."""
    for number, part in enumerate(parts, 1):
        yield part
        progress(number, count)


def _strips(blocks: Iterable[Block], parts: Iterable[tuple[np.ndarray, ...]]) -> Iterator[tuple[np.ndarray, ...]]:
    """Yield the arrays of blocks, given row by row, as strips of whole rows of tiles: files do not show the blocks."""
    rows: tuple[np.ndarray, ...] = ()
    pairs = zip(blocks, parts, strict=True)
    for _, row in itertools.groupby(pairs, lambda pair: pair[0].first[0]):
        new = tuple(np.hstack(arrays) for arrays in zip(*(arrays for _, arrays in row), strict=True))
        rows = tuple(map(np.vstack, zip(rows, new, strict=True))) if rows else new
        whole = len(rows[0]) // TILE * TILE
        for first in range(0, whole, TILE):
            yield tuple(array[first : first + TILE] for array in rows)
        rows = tuple(array[whole:] for array in rows)
    if len(rows[0]):
        yield rows


def _write_rasters(
    folder: Path,
    grid: Grid,
    law: str,
    cells: FrictionCells,
    found: Iterable[tuple[np.ndarray, ...]],
    tags: Mapping[str, str],
) -> np.ndarray:
    """Write the classes, and the parameters that vary in the table; return the number of cells of each class."""
    counts = np.zeros(1 + max(CLASSES.values()), np.int64)
    with ExitStack() as stack:
        of_classes = stack.enter_context(
            new_class_raster(folder / CLASS_FILE, grid, ENTRIES, "terrain class [1]", {}, tags)
        )
        targets = {}
        for key in cells.varying():
            parameter = parameters_to_give(law)[key]
            band = Quantity(key, parameter.unit, f"{parameter.meaning}, of the friction law {law}", "float32")
            targets[key] = stack.enter_context(new_geotiff(folder / _file(key), grid, [band], tags, cog=False))
        for (first, last), (classes, chosen) in zip(strips(grid), found, strict=True):
            of_classes.write(classes, 1, window=((first, last), (0, grid.shape[1])))
            for key, target in targets.items():
                write_strip(target, 1, first, last, cells.values(key, chosen))
            counts += np.bincount(classes.ravel(), minlength=len(counts))
    counts[OUTSIDE] = 0
    return counts


def _file(parameter: str) -> str:
    return f"{parameter}.tif"


def _scene_lines(law: str, parameters: Mapping[str, tuple[float, float]], folder: str, tags: Mapping[str, str]) -> str:
    """Return the tables of a scene that stands beside the folder, from the range of each parameter."""
    rasters = [name for name, (low, high) in parameters.items() if low != high]
    lines = [
        f"# Friction by class of terrain: {tags['table']} on {tags['dem']}, volume {tags['volume']} m3, return period "
        f"{tags['return_period']} years.",
        "# For a scene beside this folder; paths are relative to the scene.",
        "[friction]",
        f"law = {toml_value(law)}",
        *(f"{name} = {toml_value(value)}" for name, (value, _) in parameters.items() if name not in rasters),
    ]
    if rasters:
        lines += ["", "[[zones]]", *(f"{name} = {toml_value(f'{folder}/{_file(name)}')}" for name in rasters)]
    return "\n".join(lines) + "\n"
