"""Read the steps of an export on disk, and the values of selected cells over time."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...system.errors import FormatError, InputError
from ...terrain.raster_input import grid_of, open_raster, read_raster
from ...terrain.raster_output import NAMESPACE
from ...terrain.undeclared_nodata import RESULT
from .frame_values import NOWHERE

_STEP_NAME = re.compile(r"(.+)_\d{4,}\.(?:tif|vrt)")


@dataclass(frozen=True)
class ExportedSteps:
    """The steps of an export on disk.

    Parameters
    ----------
    name : str
    files : tuple of Path
        One raster for each of `times`.
    times : tuple of float [s]
    bands : tuple of str
        Names, in the order of the rasters.
    grid : Grid
    tags : dict of str to str
        Of the rasters.
    terrain : Path
    """

    name: str
    files: tuple
    times: tuple
    bands: tuple
    grid: object
    tags: dict
    terrain: Path

    def read(self, step: int, names: Iterable, cells: np.ndarray) -> dict[str, np.ndarray]:
        """Read the values of selected cells in one step.

        Parameters
        ----------
        step : int
        names : iterable of str
        cells : int64[n]
            Flat numbers in the grid, or NOWHERE.

        Returns
        -------
        dict of str to float64[n]
            By band; NaN outside the grid and for nodata.
        """
        row, column = np.divmod(np.where(cells == NOWHERE, 0, cells), self.grid.shape[1])
        found = {}
        for name in names:
            values, _ = read_raster(self.files[step], RESULT, self.bands.index(name) + 1, may_be_empty=True)
            found[name] = np.where(cells == NOWHERE, np.nan, values[row, column])
        return found


def is_export(path: str | Path) -> bool:
    """Return whether a path is a folder that `export-raster` wrote.

    Parameters
    ----------
    path : str or Path
    """
    return (Path(path) / "rasters").is_dir()


def open_steps(folder: str | Path) -> ExportedSteps:
    """Open the steps in the folder of an export.

    Parameters
    ----------
    folder : str or Path

    Raises
    ------
    FormatError, InputError
        No steps, steps of several runs, or steps without times.
    """
    folder = Path(folder)
    matches = [(path, _STEP_NAME.fullmatch(path.name)) for path in sorted((folder / "rasters").iterdir())]
    found = {path: match[1] for path, match in matches if match}
    if not found:
        raise FormatError(
            f"{folder} contains no steps (rasters/<name>_0000.tif, ...); give frames, or a folder of export-raster"
        )
    if len(set(found.values())) > 1:
        raise InputError(
            f"{folder} contains steps of {len(set(found.values()))} runs; give the frames of one run instead"
        )
    timed = sorted((_time(path), path) for path in found)
    with open_raster(timed[0][1]) as source:
        bands = tuple((text or "").partition(" [")[0] for text in source.descriptions)
        tags, grid = source.tags(ns=NAMESPACE), grid_of(source, timed[0][1])
    times, files = zip(*timed, strict=True)
    return ExportedSteps(next(iter(found.values())), files, times, bands, grid, tags, folder / "dtm.tif")


def _time(path):
    """Time [s] in the tags of a step."""
    with open_raster(path) as source:
        time = source.tags(ns=NAMESPACE).get("time")
    try:
        return float(time)
    except (TypeError, ValueError):
        raise FormatError(f"{path} has no valid tag time (mpmgis: {time}); export the frames again") from None
