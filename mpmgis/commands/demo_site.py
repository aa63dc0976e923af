"""Simulate and map the shipped sample site, for `mpmgis demo`."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..maps.averaging.maxima import MAXIMA_BANDS
from ..maps.averaging.result_bands import open_result
from ..maps.export.export_options import export_with
from ..maps.export.map_export import export_raster
from ..maps.export.run_picture import write_picture
from ..scene import read_scene
from ..seeding.release_areas import read_release
from ..simulation.scene_run import RunSummary, run
from ..system.errors import InputError
from ..system.links import refuse_link
from ..system.messages import Progress, details, muted, unwatched
from ..system.whole_files import refuse_existing, whole_folder
from ..terrain.dtm import read_terrain
from ..terrain.raster_input import read_raster
from ..terrain.undeclared_nodata import RESULT

SITE = "lava_falls"  # folder of the shipped data
_PACKAGE = Path(__file__).resolve().parents[1]
# A wheel has the data inside the package (see pyproject.toml), a checkout beside it.
_PLACES = (_PACKAGE / "sample_data", _PACKAGE.parent / "sample_data")
TITLE = "Lava Falls, Grand Canyon: a hypothetical rock avalanche"
CREDIT = "United States 3DEP (formerly NED) terrain data courtesy of the U.S. Geological Survey. Simulated by mpmgis."


def sample_folder(site: str = SITE) -> Path:
    """Return the folder of the sample site: DTM, releases, `scene.toml` and the README with the credit.

    Parameters
    ----------
    site : str

    Returns
    -------
    Path

    Raises
    ------
    InputError
        The data are missing in this installation.
    """
    for place in _PLACES:
        if (place / site / "scene.toml").is_file():
            return place / site
    raise InputError(f"sample site {site!r} is not in {_PLACES[0]} nor in {_PLACES[1]}; reinstall mpmgis")


def demo(
    output: str | Path,
    *,
    overwrite: bool = False,
    threads: int | None = None,
    watch: Callable[[Any, float, str], None] = lambda solver, end_time, left: None,
    progress: Progress = unwatched,
) -> tuple[RunSummary, Path, Path]:
    """Copy the sample site to `output`/site, simulate it, export it for QGIS, and draw one picture.

    Parameters
    ----------
    output : str or Path
        Folder for site, frames, maps and picture.
    overwrite : bool
        Replace an earlier demo in `output`, but no other files.
    threads : int, optional
        Processor threads.
    watch : callable
        Called with (solver, end time [s], wall time left in words) a few times a second.
    progress : callable
        Called with (frames done, frames in all) of the export.

    Returns
    -------
    (RunSummary, Path of the QGIS project, Path of the picture)
    """
    output = Path(output)
    refuse_existing(output, overwrite)
    for name in ("site", SITE, f"{SITE}_gis", f"{SITE}.png"):
        refuse_link(output / name)
    with whole_folder(output / "site", overwrite) as site:
        for file in sample_folder().iterdir():
            if file.is_file():
                shutil.copy(file, site / file.name)
    scene = output / "site" / "scene.toml"
    with details():
        summary = run(scene, output / SITE, overwrite=overwrite, threads=threads, watch=watch)
    frames = tuple(sorted((output / SITE).glob("frame_*.h5")))
    asked = export_with(frames=frames, output=output / f"{SITE}_gis", overwrite=overwrite, workers=threads)
    with details():
        project = export_raster(asked, progress)[0]
    picture = output / f"{SITE}.png"
    draw(picture, scene, output / f"{SITE}_gis", SITE)
    return summary, project, picture


@muted()
def draw(
    picture: Path, scene_path: Path, gis_folder: Path, name: str, title: str = TITLE, credit: str = CREDIT
) -> None:
    """Draw the picture of a run from its exported folder.

    It shows hillshade, largest speed, and outlines of release and last step.

    Parameters
    ----------
    picture : Path
        The file.
    scene_path : Path
    gis_folder : Path
        The exported folder.
    name : str
        With which the names of its rasters begin.
    title, credit : str
    """
    scene = read_scene(scene_path)
    terrain = read_terrain(scene.path(scene.terrain.dem), crs=scene.terrain.crs, band=scene.terrain.band)
    release = read_release(scene.path(scene.release.source), terrain, thickness=1.0).polygons  # only its outline
    rasters = Path(gis_folder) / "rasters"
    speed, grid = read_raster(rasters / f"{name}_max.tif", RESULT, MAXIMA_BANDS.index("Ut_max") + 1)
    result = open_result(gis_folder)
    depth, _ = result.read(f"h_{result.end.file}")
    write_picture(
        picture, terrain, grid, speed, np.nan_to_num(depth), release, title, credit, min_depth=0.5, end=result.end
    )
