"""Back-tracking in a region: which release areas reach which objects."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import shapely

from ..frames.many_runs_folder import AREAS_FILE, MAPS, REGION, RunFiles
from ..laws.quantities import MEMBER_BANDS
from ..system.errors import FormatError
from ..system.messages import muted
from ..terrain.grid import Grid
from ..terrain.raster_input import grid_of, open_raster
from ..terrain.vector_table import read_table

WINDOW = ("window_west", "window_south", "window_east", "window_north")  # columns of the table of areas
COLUMNS = ("number", "scenario", "status", "digest", *WINDOW)
SCENARIO = "scenario_"  # beginning of the names of the maps of one scenario


def region_of(path: Path) -> tuple[Path, str | None] | None:
    """Return the folder of a region and the scenario (None: all), or None for another result.

    Parameters
    ----------
    path : Path
        Folder of a region, or the beginning of the names of its maps of one scenario.
    """
    if path.is_dir():
        return (path, None) if (path / REGION.record).is_file() else None
    folder = path.parent.parent
    if path.parent.name != MAPS or not (folder / REGION.record).is_file():
        return None
    return folder, path.name.removeprefix(SCENARIO) if path.name.startswith(SCENARIO) else None


def areas_near(
    folder: Path, scenario: str | None, shapes: Sequence[shapely.Geometry]
) -> Iterator[tuple[int, list[int], Grid, dict[str, np.ndarray]]]:
    """Yield each finished release area whose window meets a shape, with its maxima.

    Parameters
    ----------
    folder : Path
        Of a region.
    scenario : str or None
        Only areas of it.
    shapes : sequence of shapely.Geometry [m]
        In the CRS of the DTM.

    Yields
    ------
    (int, list of int, Grid, dict of str to float64[rows, columns])
        Number of the area, places of the shapes in their sequence, grid and MEMBER_BANDS, NaN without flow.

    Raises
    ------
    FormatError
        The folder has no table of areas as `mpmgis region` writes it.
    """
    with muted():
        columns = read_table(folder / AREAS_FILE, flag="").columns
    if missing := [name for name in COLUMNS if name not in columns]:
        raise FormatError(f"{folder / AREAS_FILE} has no column {missing[0]}; run mpmgis region again")
    chosen = columns["status"] == "finished"
    if scenario is not None:
        chosen &= np.array([str(value) == scenario for value in columns["scenario"]], bool)
    rows = np.flatnonzero(chosen)
    windows = shapely.box(*(np.asarray(columns[side], float)[rows] for side in WINDOW))
    near = defaultdict(list)
    for shape, place in shapely.STRtree(windows).query(list(shapes)).T.tolist():
        near[int(rows[place])].append(shape)
    for row in sorted(near):
        path = RunFiles(folder / REGION.runs, str(columns["digest"][row])).maxima
        if not path.is_file():
            continue  # no flow
        with open_raster(path) as source:
            values = source.read(masked=True).astype(float).filled(np.nan)
            grid = grid_of(source, path)
        yield int(columns["number"][row]), near[row], grid, dict(zip(MEMBER_BANDS, values, strict=True))
