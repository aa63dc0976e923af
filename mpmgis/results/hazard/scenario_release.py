"""Find the release areas of a scenario: in the GeoPackage of an export or ensemble, or in the scene of a run."""

from pathlib import Path
from typing import Any, NamedTuple

import shapely

from ...maps.export.export_inputs import release_outlines
from ...maps.qgis.outlines import layer_names, polygons
from ...terrain.elevation import Terrain
from ...terrain.georeference import same_place
from ...terrain.vector_table import read_table

LAYER = "release"  # of a GeoPackage
PLACES = (".", "maps")  # folders of the GeoPackage, from that of the results


class _Frame(NamedTuple):
    """Place of the frames of a run, whose scene names the release."""

    path: Path


def release_of(path: Path, terrain: Terrain | Path | None, crs: Any) -> tuple[shapely.MultiPolygon, ...]:
    """Return the release areas of results; none where the results do not name them, or are in another CRS.

    Parameters
    ----------
    path : Path
        Folder of a run, an export or an ensemble, or other results.
    terrain : Terrain, Path or None
        Of the results.
    crs : pyproj.CRS or None
        Of the map.
    """
    if not path.is_dir():
        return ()
    for file in (found for place in PLACES for found in sorted((path / place).glob("*.gpkg"))):
        if LAYER in layer_names(file):
            table = read_table(f"{file}|layername={LAYER}")
            if None not in (table.crs, crs) and not same_place(table.crs, crs):
                return ()
            return _shapes(table.geometry)
    if not isinstance(terrain, Terrain):
        return ()
    return _shapes(release_outlines([_Frame(path / "frame")], terrain) or ())


def _shapes(geometries):
    parts = (polygons(geometry) for geometry in geometries if geometry is not None)
    return tuple(shapely.MultiPolygon(part) for part in parts if part)
