"""Write the QGIS project of a hazard map: zones, levels and releases over the terrain, with a page for print."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...laws.quantities import Quantity
from ...maps.qgis.outlines import layer_names
from ...maps.qgis.print_layout import page_extent, print_layout
from ...maps.qgis.project import project_document, write_archive
from ...maps.qgis.project_layers import Group, Layer, ground_rows, map_layer
from ...maps.qgis.raster_styles import contour_interval
from ...terrain.elevation import Terrain
from ...terrain.grid import Grid
from ...terrain.raster_input import open_raster
from ...terrain.raster_output import write_rows
from .hazard_files import HazardMap, level_pipe, zone_renderers

TERRAIN_BAND = Quantity("elevation", "m", "terrain elevation", "float32")
TITLES = {
    "release": "release areas",
    "uncertainty": "outlines that are uncertain",
    "zones": "hazard zones",
    "not_assessed": "not assessed: no data",
}
CELLS = "hazard level of each cell"
ON_PAGE = ("matrix", "guideline", "no scenario", "DTM", "zones", "uncertainty")  # facts of every page


@dataclass(frozen=True)
class HazardProject:
    """Files of a hazard map in the folder of its project.

    Parameters
    ----------
    folder : Path
    grid : Grid
    raster_file, zones_file, terrain_file : str
        The last one is "" without a terrain.
    author : str
        Of the map; "" if unknown.
    """

    folder: Path
    grid: Grid
    raster_file: str
    zones_file: str
    terrain_file: str
    author: str = ""
    name: str = "hazard"

    @property
    def project_file(self) -> str:
        """Name of the QGIS project."""
        return f"{self.name}.qgz"

    def relief(self) -> float:
        """Return the highest minus the lowest elevation [m] of the terrain; 0 without data."""
        with open_raster(self.folder / self.terrain_file) as source:
            heights = source.read(1, masked=True)
        return float(np.ptp(heights.compressed())) if heights.count() else 0.0


def write_ground(path: Path, terrain: Terrain, view: tuple, cells: Grid) -> None:
    """Write the terrain that the page shows, on north-up cells as large as those of the levels or the DTM.

    Parameters
    ----------
    path : Path
    terrain : Terrain
    view : (float, float, float, float) [m]
        West, south, east, north.
    cells : Grid
        Of the levels.
    """
    west, south, east, north = page_extent(view)
    size = max(cells.cell_size, terrain.grid.cell_size)
    shape = max(round((north - south) / size), 1), max(round((east - west) / size), 1)
    grid = Grid.north_up(cells.crs, west, north, size, shape)
    write_rows(path, grid, [TERRAIN_BAND], {}, lambda _, first, last: terrain.rows_on(grid, first, last))


def write_hazard_project(project: HazardProject, made: HazardMap, view: tuple) -> None:
    """Write the project: zones and releases over levels and terrain, and a page with the facts of the map.

    Parameters
    ----------
    project : HazardProject
        With its files written.
    made : HazardMap
    view : (float, float, float, float) [m]
        West, south, east, north that the map has to show.
    """
    known = layer_names(project.folder / project.zones_file)
    pens = zone_renderers(made.matrix)
    zones = [_polygons(project, name, pens[name]) for name in TITLES if name in known]
    pipe = level_pipe(made.matrix)
    levels = map_layer(project, "raster", "levels", project.raster_file, CELLS, "gdal", None, pipe)
    terrain = _terrain(project)
    groups = [Group("hazard map", zones), Group("cells", [Layer(CELLS, levels)], shown=False)]
    groups += [Group("terrain", terrain, unfolded=False)] if terrain else []
    contours = terrain[0].title if len(terrain) > 1 else ""
    shown = Group("map", [*zones, *terrain])
    page = print_layout(project, view, shown, made.title, _facts(made, contours), project.author)
    write_archive(project, project_document(project, groups, view, made.title, [page]))


def _facts(made, contours):
    """(name, text) of the page: what the sheet says, the scenarios first, and those that are not finished."""
    scenarios = [(f"{scenario.years:g} years", scenario.facts) for scenario in made.scenarios]
    known = [(name, text) for name, text in made.facts if name in ON_PAGE]
    return [("Not finished", "; ".join(made.unfinished())), *scenarios, ("terrain", contours), *known]


def _polygons(project, name, renderer):
    source = f"{project.zones_file}|layername={name}"
    layer = map_layer(project, "vector", f"zones_{name}", source, TITLES[name], "ogr", None, renderer)
    layer.set("geometry", "Polygon")
    return Layer(TITLES[name], layer, True, True)


def _terrain(project):
    """Rows of contours over a hillshade; none without a terrain."""
    if not project.terrain_file:
        return []
    relief = project.relief()
    return ground_rows(project, project.terrain_file, contour_interval(relief) if relief else 0.0)
