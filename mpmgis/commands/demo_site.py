"""`mpmgis demo`: the whole workflow on the shipped sample site."""

import shutil
from pathlib import Path

import numpy as np

from ..exchange.frame_source import FrameSource
from ..maps.averaging.maxima import MAXIMA_BANDS
from ..maps.export.export_request import ExportRequest
from ..maps.export.map_export import export_raster
from ..maps.export.run_picture import write_picture
from ..maps.export.step_rasters import DEPOSIT_BANDS
from ..scene import read_scene
from ..seeding.release_areas import read_release
from ..simulation.scene_run import run
from ..system.errors import InputError
from ..system.links import refuse_link
from ..system.messages import details, muted
from ..system.whole_files import refuse_existing, whole_folder
from ..terrain.dtm import read_terrain
from ..terrain.raster_input import read_raster

SITE = "lava_falls"
_PACKAGE = Path(__file__).resolve().parents[1]
# A wheel has the data inside the package (see pyproject.toml), a checkout beside it.
_PLACES = (_PACKAGE / "sample_data", _PACKAGE.parent / "sample_data")
TITLE = "Lava Falls, Grand Canyon: a hypothetical rock avalanche"
CREDIT = "United States 3DEP (formerly NED) terrain data courtesy of the U.S. Geological Survey. Simulated by mpmgis."


def sample_folder(site=SITE):
    """The folder of the sample site: DTM, releases, `scene.toml` and the README with the credit.

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
    output, *, overwrite=False, threads=None, watch=lambda solver, end_time: None, progress=lambda done, total: None
):
    """Copy the sample site to `output`/site, simulate it, export it for QGIS, and draw one picture.

    With `overwrite` an earlier demo in `output` is replaced, but no other files.

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
    request = ExportRequest(
        source=FrameSource(frames=frames), output=output / f"{SITE}_gis", overwrite=overwrite, workers=threads
    )
    with details():
        project = export_raster(request, progress)[0]
    picture = output / f"{SITE}.png"
    draw(picture, scene, output / f"{SITE}_gis", SITE)
    return summary, project, picture


@muted()
def draw(picture, scene_path, gis_folder, name, title=TITLE, credit=CREDIT):
    """The picture of a run from its exported folder: hillshade, largest speed, outlines of release and deposit."""
    scene = read_scene(scene_path)
    terrain = read_terrain(scene.path(scene.terrain.dem), crs=scene.terrain.crs, band=scene.terrain.band)
    release = read_release(scene.path(scene.release.source), terrain, thickness=1.0).polygons  # only its outline
    rasters = Path(gis_folder) / "rasters"
    speed, grid = read_raster(rasters / f"{name}_max.tif", MAXIMA_BANDS.index("Ut_max") + 1)
    depth, _ = read_raster(rasters / f"{name}_deposit.tif", DEPOSIT_BANDS.index("h") + 1)
    write_picture(picture, terrain, grid, speed, np.nan_to_num(depth), release, title, credit, min_depth=0.5)
