"""Write a STAC item (version 1.1) of an exported folder: where it lies, what it holds, the bands of each raster."""

import json
from datetime import timedelta

import numpy as np
import pyproj
import shapely

from ... import __version__
from ...laws.quantities import NODATA
from ...system.errors import GeoreferenceError
from ..averaging.exported_folder import ExportedRun
from .map_clock import BASE

PROJECTION = "https://stac-extensions.github.io/projection/v2.0.0/schema.json"
GEOTIFF = "image/tiff; application=geotiff"
OTHERS = {  # suffix -> media type, roles, title
    ".qgz": ("application/zip", ["overview"], "QGIS project"),
    ".nc": ("application/netcdf", ["data"], "UGRID mesh of the flow"),
    ".gpkg": ("application/geopackage+sqlite3", ["data"], "outlines, release area and particles"),
    ".kmz": ("application/vnd.google-earth.kmz", ["overview"], "outlines and maxima"),
}
EDGE_POINTS = 21  # [points] along each side of the footprint, so that it stays on the map's edge when it is projected


def require_stac(crs: pyproj.CRS | None) -> None:
    """Raise an error unless the run has a place on the globe, before any work.

    Parameters
    ----------
    crs : pyproj.CRS or None
        None: a local frame.

    Raises
    ------
    GeoreferenceError
    """
    if crs is None:
        raise GeoreferenceError("--stac needs a CRS; the DTM lies in a local frame without a place on the globe")


def write_stac_item(run: ExportedRun, cog: bool = False) -> None:
    """Write `<name>.stac.json`, with all files of the folder that are there as assets.

    Simulated time has no date: it counts from 2000-01-01T00:00:00Z, and `mpmgis:times` has the seconds of the steps.

    Parameters
    ----------
    run : ExportedRun
    cog : bool
        The rasters are cloud-optimised.
    """
    text = json.dumps(stac_item(run, cog), indent=1, ensure_ascii=False)
    (run.folder / f"{run.name}.stac.json").write_text(text + "\n", encoding="utf-8", newline="\n")


def stac_item(run: ExportedRun, cog: bool = False) -> dict:
    """Return the item as plain JSON.

    Parameters
    ----------
    run : ExportedRun
    cog : bool
        As in `write_stac_item`.
    """
    footprint = _footprint(run.grid)
    begin, end = (_date(time) for time in (run.times[0], run.times[-1]))
    code = run.grid.crs.to_authority()
    t = run.grid.transform
    return {
        "type": "Feature",
        "stac_version": "1.1.0",
        "stac_extensions": [PROJECTION],
        "id": run.name,
        "bbox": [float(value) for value in shapely.bounds(footprint)],
        "geometry": json.loads(shapely.to_geojson(footprint)),
        "properties": {
            "title": f"{run.name}: flow over terrain",
            "description": f"Landslide or avalanche by the Material Point Method, written by mpmgis {__version__}",
            "datetime": None,
            "start_datetime": begin,
            "end_datetime": end,
            "proj:code": None if code is None else ":".join(code),
            "proj:wkt2": run.grid.crs.to_wkt(),
            "proj:shape": list(run.grid.shape),
            "proj:transform": [t.a, t.b, t.c, t.d, t.e, t.f],
            "mpmgis:version": __version__,
            "mpmgis:times": list(run.times),
            "mpmgis:min_depth": run.min_depth,
        },
        "links": [],
        "assets": _rasters(run, cog) | _other_files(run),
    }


def _rasters(run, cog):
    kind = GEOTIFF + ("; profile=cloud-optimized" if cog else "")
    steps = {
        f"step_{step:04d}": (file, f"t = {time:g} s", run.step_bands, ["data"])
        for step, (file, time) in enumerate(zip(run.step_files, run.times, strict=True))
    }
    known = (
        {
            "maxima": (run.maxima_file, "maxima over all steps", run.maxima_bands, ["data"]),
            run.end.file: (run.last_file, run.end.words(), run.last_bands, ["data"]),
            "terrain": (run.terrain_file, "terrain", (), ["data", "elevation"]),
        }
        | _bed(run)
        | _around(run)
        | steps
        | _layers(run)
    )
    return {
        key: {
            "href": f"./{file}",
            "type": kind if file.endswith(".tif") else "application/xml",
            "title": title,
            "roles": roles,
        }
        | ({"bands": [_band(quantity) for quantity in bands]} if bands else {})
        for key, (file, title, bands, roles) in known.items()
    }


def _around(run):
    """Raster of the terrain around the flow, where there is one."""
    if not run.around_file:
        return {}
    return {"terrain_around": (run.around_file, "terrain around the flow", (), ["data", "elevation"])}


def _layers(run):
    """Rasters of layers of height over the bed, one per step."""
    return {
        f"layers_{step:04d}": (file, f"layers of height, t = {time:g} s", run.layer_bands, ["data"])
        for step, (file, time) in enumerate(zip(run.layer_files, run.times, strict=False))
    }


def _bed(run):
    """Rasters of a run with erosion."""
    if not run.bed_bands:
        return {}
    return {
        "bed": (run.bed_file, "bed change, last step", run.bed_bands, ["data"]),
        "surface": (run.ground_file, "ground and bed, last step", run.surface_bands, ["data", "elevation"]),
    }


def _band(quantity):
    return {
        "name": quantity.name,
        "description": quantity.long_name,
        "unit": quantity.unit,
        "data_type": "float32",
        "nodata": NODATA,
    }


def _other_files(run):
    found = [path for path in sorted(run.folder.glob(f"{run.name}.*")) if path.suffix in OTHERS]
    return {
        path.suffix[1:]: dict(
            zip(("href", "type", "roles", "title"), (f"./{path.name}", *OTHERS[path.suffix]), strict=True)
        )
        for path in found
    }


def _footprint(grid):
    """Polygon of a grid's edge in longitude and latitude [degrees], counter-clockwise."""
    corners = np.asarray(grid.corners(), dtype=float)
    ends = np.roll(corners, -1, axis=0)
    share = np.linspace(0, 1, EDGE_POINTS, endpoint=False)[:, None]
    ring = np.concatenate([start + share * (end - start) for start, end in zip(corners, ends, strict=True)])
    to_globe = pyproj.Transformer.from_crs(grid.crs, "EPSG:4326", always_xy=True)
    polygon = shapely.Polygon(np.column_stack(to_globe.transform(*ring.T)))
    return shapely.geometry.polygon.orient(polygon)


def _date(time):
    return (BASE + timedelta(seconds=float(time))).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
