"""Write the maps of an ensemble for GIS: rasters of statistics with styles, a QGIS project, a picture."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import shapely

from ..frames.member_stack import MemberStack
from ..frames.region_layers import write_layer
from ..laws.quantities import Quantity
from ..maps.averaging.exported_folder import TYPICAL_PERCENTILE, moved_corner
from ..maps.export.band_map import write_band_map
from ..maps.qgis.colours import look_of, symbol
from ..maps.qgis.outlines import POLYGONS, polygons
from ..maps.qgis.print_layout import print_layout
from ..maps.qgis.project import project_document, terrain_group, write_archive
from ..maps.qgis.project_layers import Group, Layer, map_layer, raster_layer
from ..maps.qgis.raster_styles import hillshade_pipe, style_document, value_pipe, write_sidecar
from ..maps.qgis.vector_styles import RELEASE, outline_renderer, vector_style_document, write_layer_styles
from ..terrain.elevation import Terrain
from ..terrain.grid import Grid
from ..terrain.raster_input import open_raster
from ..terrain.raster_output import write_rows
from .ensemble_statistics import ARRIVAL, PEAKS, PROBABILITY, WORDS, statistics

RELEASE_LAYER = "release"  # of the GeoPackage
TERRAIN_FILE = "dtm.tif"
TERRAIN_BAND = Quantity("elevation", "m", "terrain elevation", "float32")
MARGIN = 0.08  # [1] around the flow in the view of the project, over its longer side


@dataclass(frozen=True)
class EnsembleMaps:
    """The rasters of an ensemble in `folder` while it is written.

    Parameters
    ----------
    folder : Path
    name : str
        Prefix of its files.
    grid : Grid
    extent : (int, int, int, int) or None
        First and one past the last row, first and one past the last column that any member reached.
    min_depth : float [m]
    bands : dict of str to list of studies.ensemble_statistics.Band
        By raster name.
    facts : sequence of (str, str)
        Parameters of the runs for the print layout: name and text.
    author : str
        Of the maps; "" if unknown.
    classes : dict of str to tuple of float
        Limits of classes that the user chose, by quantity.
    """

    folder: Path
    name: str
    grid: Grid
    extent: tuple | None
    min_depth: float
    bands: dict = field(default_factory=dict)
    facts: Sequence[tuple[str, str]] = ()
    author: str = ""
    classes: dict = field(default_factory=dict)
    shown_terrain_file: str = TERRAIN_FILE

    @property
    def project_file(self) -> str:
        """Name of the QGIS project."""
        return f"{self.name}.qgz"

    @property
    def outlines_file(self) -> str:
        """Name of the GeoPackage with the release."""
        return f"{self.name}.gpkg"

    @property
    def picture_file(self) -> str:
        """Name of the picture."""
        return f"{self.name}.png"

    def file(self, raster: str) -> str:
        """Return the name of the file of a raster.

        Parameters
        ----------
        raster : str
        """
        return f"rasters/{self.name}_{raster}.tif"

    def read(self, raster: str, number: int) -> np.ndarray:
        """Read a band within `window`.

        Parameters
        ----------
        raster : str
        number : int
            Of the band, from 0.

        Returns
        -------
        float32[rows, columns]
            NaN for nodata.
        """
        return self._read(self.file(raster), number)

    def read_terrain(self) -> np.ndarray:
        """Read the elevation within `window`.

        Returns
        -------
        float32[rows, columns] [m]
        """
        return self._read(TERRAIN_FILE, 0)

    def _read(self, file, number):
        with open_raster(self.folder / file) as source:
            top, bottom, left, right = self.window
            values = source.read(number + 1, window=((top, bottom), (left, right)))
            values[values == np.float32(source.nodata)] = np.nan
            return values

    @property
    def window(self) -> tuple:
        """The extent, or the whole grid without flow."""
        return self.extent or (0, self.grid.shape[0], 0, self.grid.shape[1])

    @cached_property
    def window_grid(self) -> Grid:
        """Grid of `window`."""
        top, bottom, left, right = self.window
        return Grid(self.grid.crs, moved_corner(self.grid.transform, top, left), (bottom - top, right - left))

    @cached_property
    def typical(self) -> dict[str, float]:
        """Typical size of the values by band name; all statistics of a quantity have the same colours."""
        made = {band.quantity.name: 1.0 for band in self.bands[PROBABILITY]}
        for name in (*PEAKS, ARRIVAL):
            widest = "smallest" if name == ARRIVAL else "largest"
            number = next(k for k, band in enumerate(self.bands[name]) if band.kind == widest)
            values = self.read(name, number)
            values = values[np.isfinite(values) & (values > 0)]
            size = float(np.percentile(values, TYPICAL_PERCENTILE)) if values.size else 0.0
            made |= {band.quantity.name: size for band in self.bands[name]}
        return made


def write_maps(maps: EnsembleMaps, stack: MemberStack, terrain: Terrain, tags: dict, release: list, title: str) -> None:
    """Write all rasters of `maps`, their styles, the project and the picture.

    Parameters
    ----------
    maps : EnsembleMaps
    stack : MemberStack
    terrain : Terrain
    tags : dict
    release : list of shapely polygons
        May be empty.
    title : str
        Title of the picture.
    """
    (maps.folder / "rasters").mkdir()
    for raster, bands in maps.bands.items():
        sources = list(dict.fromkeys(band.source for band in bands))
        compute = partial(statistics, bands)
        quantities = [band.quantity for band in bands]
        rows = stack.rows_of(len(bands), sources, compute)
        write_rows(maps.folder / maps.file(raster), maps.grid, quantities, tags | {"product": raster}, rows)
    heights = lambda _, first, last: terrain.rows_on(maps.grid, first, last)  # noqa: E731
    write_rows(maps.folder / TERRAIN_FILE, maps.grid, [TERRAIN_BAND], {}, heights)
    for raster, bands in maps.bands.items():
        write_sidecar(maps, maps.file(raster), style_document(value_pipe(bands[0].quantity, maps, 1)))
    write_sidecar(maps, TERRAIN_FILE, style_document(hillshade_pipe()))
    if release:
        shapes = [shapely.MultiPolygon(polygons(part)) for part in release]
        write_layer(maps.folder / maps.outlines_file, RELEASE_LAYER, shapes, {}, maps.grid.crs)
        style = vector_style_document(outline_renderer(RELEASE), POLYGONS)
        write_layer_styles(maps.folder / maps.outlines_file, {RELEASE_LAYER: style})
    _write_project(maps, tags, bool(release))
    _write_picture(maps, terrain, release, title)


def _layer(maps, raster, band, number):
    """The layer of a statistic; its name says that it is of all runs."""
    layer = raster_layer(maps, raster, maps.file(raster), band.quantity, number, shown=number == 1)
    if raster == PROBABILITY:
        return layer
    title = f"{symbol(band.quantity.name)}{look_of(band.quantity).bracket}: {band.quantity.long_name}"
    layer.maplayer.find("layername").text = title
    return layer._replace(title=title)


def _release_rows(maps):
    """The layer of the release."""
    source, pen = f"{maps.outlines_file}|layername={RELEASE_LAYER}", outline_renderer(RELEASE)
    maplayer = map_layer(maps, "vector", "vector_release", source, "release area", "ogr", None, pen)
    maplayer.set("geometry", "Polygon")
    return [Layer("release area", maplayer, True, True)]


def _write_project(maps, tags, has_release):
    titles = {PROBABILITY: "probabilities"} | {name: WORDS[name] for name in (*PEAKS, ARRIVAL)}
    groups = [
        Group(
            titles[raster],
            [_layer(maps, raster, band, number) for number, band in enumerate(bands, 1)],
            shown=raster == PROBABILITY,
            unfolded=raster == PROBABILITY,
            exclusive=True,
        )
        for raster, bands in maps.bands.items()
    ]
    label, terrain = f"{maps.name}: {tags['members']} runs", terrain_group(maps)
    release = [Group("release", _release_rows(maps), unfolded=False)] if has_release else []
    first = next(group.rows[0] for group in groups if group.shown)
    rows = [*(row for group in release for row in group.rows), first, *terrain.rows]
    facts = [*maps.facts, ("Terrain", terrain.rows[0].title)]
    page = print_layout(maps, _view(maps), Group("map", rows), f"{label}, {_short_title(first)}", facts, maps.author)
    write_archive(maps, project_document(maps, [*release, *groups, terrain], _view(maps), label, [page]))


def _short_title(layer):
    """Symbol of a layer without its words."""
    return layer.title.partition(":")[0]


def _view(maps):
    west, south, east, north = maps.window_grid.bounds
    rim = MARGIN * max(east - west, north - south)
    return west - rim, south - rim, east + rim, north + rim


def _write_picture(maps, terrain, release, title):
    """Write a PNG of the probability of the first threshold, or of arrival without thresholds, over a hillshade."""
    values, quantity = maps.read(PROBABILITY, 0), maps.bands[PROBABILITY][0].quantity
    look = look_of(quantity)
    look = look._replace(words=look.words.replace(" that the ", "\nthat the ").replace(" is at ", "\nis at "))
    write_band_map(maps.folder / maps.picture_file, terrain, maps.window_grid, values, look, title, release)
