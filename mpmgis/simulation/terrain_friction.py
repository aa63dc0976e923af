"""Friction by class of terrain as rasters and lines of a scene: `mpmgis friction-map`."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .. import __version__
from ..laws.quantities import SQUARE_METRES_PER_HECTARE, Quantity
from ..maps.qgis.raster_styles import class_pipe, style_document
from ..scene.scene_text import toml_value
from ..system.errors import InputError, OutputError
from ..system.links import is_above
from ..system.option import PathLike
from ..system.whole_files import refuse_existing, whole_folder
from ..terrain.class_limits import ClassLimits
from ..terrain.class_rasters import write_class_raster
from ..terrain.elevation import Terrain
from ..terrain.friction_table import friction_values, read_friction_table, rows_of_event, table_parameters
from ..terrain.raster_output import write_geotiff
from ..terrain.terrain_classes import CLASSES, terrain_classes

CLASS_FILE, CLASS_STYLE, SCENE_FILE = "terrain_class.tif", "terrain_class.qml", "friction.toml"
COLOURS = {"open": "#e3cf9f", "channel": "#74a9cf", "gully": "#045a8d", "flat": "#a6d8a0"}  # of classes on the map


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
        units = {name: parameter.unit for name, parameter in table_parameters(self.law).items()}
        for name, (low, high) in self.parameters.items():
            lines.append(f"{name:<12}{f'{low:g}' if low == high else f'{low:g} to {high:g}':>12} [{units[name]}]")
        return lines


def terrain_friction(
    terrain: Terrain,
    table: PathLike,
    law: str,
    event: tuple[float | None, float | None],
    limits: ClassLimits,
    output: PathLike | None = None,
    overwrite: bool = False,
) -> FrictionFound:
    """Write the classes of a terrain, the friction of a table on them, and the lines of a scene that uses it.

    A parameter that is the same everywhere is a number of [friction], so that a constant table gives the run of a scene
    with these numbers, bit for bit.

    Parameters
    ----------
    terrain : Terrain
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
    rows = rows_of_event(read_friction_table(table, law), volume, period, table)
    classes = terrain_classes(terrain, limits)
    values = friction_values(rows, classes, terrain.elevation, table)
    tags = {
        "version": __version__,
        "dem": name,
        "table": Path(table).name,
        "law": law,
        "volume": "any" if volume is None else f"{volume:g}",
        "return_period": "any" if period is None else f"{period:g}",
        "class_limits": json.dumps(vars(limits)),
    }
    entries = [(number, name, COLOURS[name]) for name, number in CLASSES.items()]
    files = [SCENE_FILE, CLASS_FILE, CLASS_STYLE]
    with whole_folder(folder, overwrite) as part:
        write_class_raster(part / CLASS_FILE, terrain.grid, classes, entries, "terrain class [1]", {}, tags)
        style = style_document(class_pipe(entries))
        (part / CLASS_STYLE).write_text(style, encoding="utf-8", newline="\n")
        for key, value in values.items():
            if isinstance(value, np.ndarray):
                parameter = table_parameters(law)[key]
                band = Quantity(key, parameter.unit, f"{parameter.meaning}, of the friction law {law}", "float32")
                write_geotiff(part / _file(key), terrain.grid, [(band, value)], tags)
                files.append(_file(key))
        text = _scene_lines(law, values, folder.resolve().name, tags)
        (part / SCENE_FILE).write_text(text, encoding="utf-8", newline="\n")
    return FrictionFound(
        name,
        law,
        {key: float(np.count_nonzero(classes == number)) * terrain.grid.cell_area for key, number in CLASSES.items()},
        {key: (float(np.nanmin(value)), float(np.nanmax(value))) for key, value in values.items()},
        tuple(folder / file for file in files),
    )


def _file(parameter: str) -> str:
    return f"{parameter}.tif"


def _scene_lines(law: str, values: Mapping[str, np.ndarray | float], folder: str, tags: Mapping[str, str]) -> str:
    """Return the tables of a scene that stands beside the folder."""
    rasters = [name for name, value in values.items() if isinstance(value, np.ndarray)]
    lines = [
        f"# Friction by class of terrain: {tags['table']} on {tags['dem']}, volume {tags['volume']} m3, return period "
        f"{tags['return_period']} years.",
        "# For a scene beside this folder; paths are relative to the scene.",
        "[friction]",
        f"law = {toml_value(law)}",
        *(f"{name} = {toml_value(value)}" for name, value in values.items() if name not in rasters),
    ]
    if rasters:
        lines += ["", "[[zones]]", *(f"{name} = {toml_value(f'{folder}/{_file(name)}')}" for name in rasters)]
    return "\n".join(lines) + "\n"
