"""Terrain and flow surface as elevations for the profile tool and the 3D view of QGIS (3.28 and later)."""

from xml.etree.ElementTree import Element

import numpy as np

from ..fields import Quantity
from ..io.exported import ExportedRun
from ..io.raster_output import write_geotiff
from .layers import Layer, layer_id, map_layer
from .markup import node, options
from .styles import contour_interval, contour_pipe, hillshade_pipe, style_document, write_sidecar

SURFACE = Quantity("surface", "m", "highest surface of the flow: terrain and largest flow depth", "float32")
TITLE = "surface max [m]: terrain and largest flow depth"
TERRAIN_COLOUR, SURFACE_COLOUR = "90,70,50,255", "190,60,50,255"


def write_surface(run: ExportedRun) -> None:
    """Write the elevation of the highest flow surface on the cells that the flow reached; without flow, no file.

    The flow depth is measured normal to the bed: its vertical extent is the depth divided by the cosine of the slope.
    """
    (depth,) = run.read(run.maxima_file, ("h_max",))
    if not np.isfinite(depth).any():
        return
    bed = run.read_terrain().astype(float)
    surface = bed + depth / _slope_cosine(bed, run.flow_grid)
    write_geotiff(run.folder / run.surface_file, run.flow_grid, [(SURFACE, surface.astype(np.float32))], {})
    write_sidecar(run, run.surface_file, style_document(hillshade_pipe()))


def _slope_cosine(bed, grid):
    """float64[rows, columns]: vertical part of the bed's unit normal; 1 where a neighbour's elevation is unknown."""
    if min(bed.shape) < 2:
        return np.ones(bed.shape)
    by_row, by_column = np.gradient(bed)
    across = np.linalg.inv(grid.matrix).T @ np.stack([by_column.ravel(), by_row.ravel()])
    return np.nan_to_num(1.0 / np.sqrt(1.0 + (across**2).sum(axis=0)), nan=1.0).reshape(bed.shape)


def surface_layer(run: ExportedRun, relief: float) -> Layer | None:
    """Hidden layer of the flow surface as contours, with elevations; None without the file."""
    if not (run.folder / run.surface_file).exists():
        return None
    pipe = contour_pipe(contour_interval(relief))
    maplayer = map_layer(run, "raster", "surface_max", run.surface_file, TITLE, "gdal", None, pipe)
    maplayer.append(elevation(SURFACE_COLOUR))
    return Layer(TITLE, maplayer)


def elevation(colour: str) -> Element:
    """`elevation` of a raster layer: its first band is a surface, a line of `colour` in the profile tool."""
    pen = {"line_color": colour, "line_width": 0.5, "line_width_unit": "MM"}
    line = node("layer", {"class": "SimpleLine", "enabled": 1, "pass": 0, "locked": 0}, *options(pen))
    symbol = node("symbol", {"type": "line", "name": "", "alpha": 1}, line)
    settings = {"enabled": 1, "mode": "RepresentsElevationSurface", "symbology": "Line"}
    settings |= {"band": 1, "zoffset": 0, "zscale": 1}
    return node("elevation", settings, node("profileLineSymbol", None, symbol))


def project_elevation(run: ExportedRun, part: str) -> Element:
    """`ElevationProperties` of a project: the raster layer `part` is its terrain."""
    layer = {"layer": layer_id(run, part), "layerSource": f"./{run.terrain_file}", "layerProvider": "gdal"}
    provider = node("TerrainProvider", layer | {"layerName": "hillshade", "offset": 0, "scale": 1})
    return node("ElevationProperties", None, node("terrainProvider", {"type": "raster"}, provider))
