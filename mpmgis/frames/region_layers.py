"""Layers of a region: its release areas with their results, and the areas that the flows reach."""

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..system.optional_libraries import GEOPACKAGE
from ..system.whole_files import whole_file

AREAS = "areas"  # name of the layer of the release areas
FOOTPRINTS = "footprints"  # name of the layer of the areas that the flows reach


def write_layer(path: Path, layer: str, shapes: Sequence, columns: Mapping[str, Sequence], crs: Any) -> None:
    """Write a GeoPackage with one layer of shapes.

    Parameters
    ----------
    path : Path
    layer : str
        Name of the layer.
    shapes : sequence of shapely.Geometry [m]
    columns : dict of str to sequence
        Attributes of the shapes.
    crs : pyproj.CRS or None
    """
    import geopandas  # 0.5 s

    table = geopandas.GeoDataFrame(columns, geometry=shapes, crs=crs)
    with whole_file(path) as part, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a local frame has no CRS
        table.to_file(part, layer=layer, driver="GPKG", engine="pyogrio", dataset_options=GEOPACKAGE)
