"""The steps of an exported folder, read back as values of cells over time."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import FormatError, InputError
from ..products.cell_series import NOWHERE
from .geotiff import NAMESPACE
from .raster import grid_of, open_raster, read_raster

_STEP_NAME = re.compile(r"(.+)_\d{4,}\.(?:tif|vrt)")


@dataclass(frozen=True)
class ExportedSteps:
    """An export on disk: its `name`, a raster of each of `times` [s] on one `grid`, and what its `tags` say."""

    name: str
    files: tuple
    times: tuple
    bands: tuple
    grid: object
    tags: dict
    terrain: Path

    def read(self, step, names, cells):
        """Name -> float64[n] of the named bands in the flat `cells` of the grid; NaN off it and for nodata."""
        row, column = np.divmod(np.where(cells == NOWHERE, 0, cells), self.grid.shape[1])
        found = {}
        for name in names:
            values, _ = read_raster(self.files[step], self.bands.index(name) + 1, may_be_empty=True)
            found[name] = np.where(cells == NOWHERE, np.nan, values[row, column])
        return found


def is_export(path):
    """Whether `path` is a folder that `export-raster` wrote."""
    return (Path(path) / "rasters").is_dir()


def open_steps(folder):
    """The ExportedSteps in `folder`.

    Raises
    ------
    FormatError, InputError
        No steps of one run, or without times.
    """
    folder = Path(folder)
    matches = [(path, _STEP_NAME.fullmatch(path.name)) for path in sorted((folder / "rasters").iterdir())]
    found = {path: match[1] for path, match in matches if match}
    if not found:
        raise FormatError(
            f"{folder} holds no steps (rasters/<name>_0000.tif, ...); give the frames, or a folder of export-raster"
        )
    if len(set(found.values())) > 1:
        raise InputError(f"{folder} holds steps of {len(set(found.values()))} runs; name the frames of one instead")
    timed = sorted((_time(path), path) for path in found)
    with open_raster(timed[0][1]) as source:
        bands = tuple((text or "").partition(" [")[0] for text in source.descriptions)
        tags, grid = source.tags(ns=NAMESPACE), grid_of(source, timed[0][1])
    times, files = zip(*timed, strict=True)
    return ExportedSteps(next(iter(found.values())), files, times, bands, grid, tags, folder / "dtm.tif")


def _time(path):
    """Time [s] in the tags of a step."""
    with open_raster(path) as source:
        said = source.tags(ns=NAMESPACE).get("time")
    try:
        return float(said)
    except (TypeError, ValueError):
        raise FormatError(f"{path} does not say its time (mpmgis' tag time: {said}); export the frames anew") from None
