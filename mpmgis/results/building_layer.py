"""Read a layer of buildings, and write its copy with the loads of a flow as attributes."""

import warnings
from collections.abc import Sequence
from pathlib import Path

import geopandas

from ..system.messages import log
from ..system.optional_libraries import GEOPACKAGE
from ..system.whole_files import whole_file
from ..terrain.elevation import Terrain
from ..terrain.spatial_inputs import Feature, read_polygons

LAYER = "buildings"  # of the GeoPackage


def read_buildings(path: Path, terrain: Terrain) -> list[Feature]:
    """Return the buildings at `path` as Features in the terrain's CRS.

    Parameters
    ----------
    path : Path
    terrain : Terrain

    Returns
    -------
    list of Feature

    Raises
    ------
    FormatError, GeoreferenceError, InputError
    """
    return read_polygons(path, terrain)


def write_buildings(path: Path, buildings: Sequence, loads: Sequence, terrain: Terrain) -> None:
    """Write a GeoPackage of the buildings with their own attributes and the loads added.

    Parameters
    ----------
    path : Path
    buildings : sequence of Feature
    loads : sequence of dict
        Attribute -> value, one dict for each building.
    terrain : Terrain
        Its CRS is that of the buildings.
    """
    own = list(buildings[0].columns)
    replaced = [name for name in own if name.lower() in loads[0]]
    if replaced:
        log.info(f"{buildings[0].path}: its attributes {', '.join(replaced)} are replaced by those of this flow")
    kept = [name for name in own if name not in replaced and name.lower() != "fid"]
    columns = {name: [building.columns[name] for building in buildings] for name in kept}
    columns |= {name: [of_one[name] for of_one in loads] for name in loads[0]}
    crs = None if terrain.grid.crs is None else terrain.grid.crs.to_wkt()
    table = geopandas.GeoDataFrame(columns, geometry=[building.shape for building in buildings], crs=crs)
    with whole_file(path) as part, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a missing CRS is allowed
        table.to_file(part, layer=LAYER, driver="GPKG", engine="pyogrio", dataset_options=GEOPACKAGE)
