"""What an export writes only if asked: a film, KMZ, a STAC item. Their options are checked before any work."""

from collections.abc import Callable
from pathlib import Path

import pyproj

from ..errors import OutputError
from ..gis.kml import require_kml, write_kml
from ..gis.stac import require_stac, write_stac_item
from ..io.atomic import refuse_existing
from ..io.exported import ExportedRun
from ..terrain.elevation import Terrain


def require_extra_files(request, output: Path, crs: pyproj.CRS | None) -> None:
    """Refuse what cannot be written: wrong suffix, missing library, no place on the globe, a file that exists.

    Parameters
    ----------
    request : ExportRequest
    output : Path
        The folder of the export, in which the film cannot lie: it is replaced as a whole.
    crs : CRS or None
        Of the DTM.

    Raises
    ------
    MpmgisError
    """
    if request.animation is not None:
        from ..reports.animation import require_animation

        require_animation(request.animation)
        refuse_existing(request.animation, request.overwrite)
        if output.resolve() in Path(request.animation).resolve().parents:
            place = f"--animation {request.animation} lies in {output}"
            raise OutputError(f"{place}, which is written as a whole; give it another place")
    if request.kml:
        require_kml(crs)
    if request.stac:
        require_stac(crs)


def write_extra_files(request, run: ExportedRun, terrain: Terrain, release_of: Callable) -> None:
    """Write them from the rasters of `run`; `release_of()` answers the polygons of the release or None."""
    if request.kml:
        write_kml(run, release_of())
    if request.stac:
        write_stac_item(run, request.cog)
    if request.animation is not None:
        from ..reports.animation import write_animation

        write_animation(Path(request.animation), run, terrain, release_of())
