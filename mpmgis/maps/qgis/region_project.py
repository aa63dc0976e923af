"""Write the QGIS project of a region: its maps by scenario, release areas and footprints over the terrain."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from ...frames.region_layers import AREAS, FOOTPRINTS
from ...frames.region_maps import LARGEST, AreaRaster, not_at_rest
from ...laws.quantities import BAND, MEMBER_BANDS
from ...terrain.grid import Grid
from ...terrain.raster_input import open_raster
from ..averaging.exported_folder import TYPICAL_PERCENTILE
from .colours import ACTON_REVERSED, DAVOS_REVERSED, PROBABILITY_LIMITS, Look, fitting_classes, look_of
from .print_layout import parameter_facts, print_layout
from .project import project_document, write_archive
from .project_layers import Group, Layer, ground_rows, map_layer
from .raster_styles import contour_interval, style_document, value_renderer, write_sidecar
from .vector_styles import OUTLINE, RELEASE, outline_renderer
from .xml_markup import node

SAMPLED = 64  # [areas] evenly chosen, whose values determine the classes
PROBED = 32  # [cells] along a side of an area, from which the relief is read
MARGIN = 0.08  # [1] around the flow, as a share of its longer side
COUNT_LIMITS = (1, 2, 3, 5, 10, 20)  # [areas] of classes
FREQUENCY_LIMITS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3)  # [a-1] of classes
COUNTED = Look("number of release areas that reach the cell", "", DAVOS_REVERSED, "size", COUNT_LIMITS)
OFTEN = Look("events a year that reach the cell", "1/year", ACTON_REVERSED, "size", FREQUENCY_LIMITS)
PROBABLE = Look("probability of at least one event in a year", "", ACTON_REVERSED, "size", PROBABILITY_LIMITS)
TERRAIN_SUFFIXES = (".tif", ".tiff", ".vrt", ".img", ".asc")  # that QGIS reads as one raster


@dataclass(frozen=True)
class RegionProject:
    """Maps of a region in a folder while it is written.

    Parameters
    ----------
    folder : Path
    grid : Grid
        Of the DTM.
    areas : dict of str to list of AreaRaster
        Areas with flow, by name of their maps ("all", "scenario_30").
    min_depth : float [m]
    frequency : bool
        Whether there are maps of frequency and probability.
    terrain : str or None
        Path of the DTM relative to the final folder, for hillshade and contours.
    facts : dict of str to str
        Parameters of the runs for the print layout, by name.
    author : str
        Of the maps; "" if unknown.
    classes : dict of str to tuple of float
        Limits of classes that the user chose, by quantity.
    """

    folder: Path
    grid: Grid
    areas: Mapping[str, Sequence[AreaRaster]]
    min_depth: float
    frequency: bool
    terrain: str | None
    name: str = "region"
    facts: Mapping[str, str] = field(default_factory=dict)
    author: str = ""
    classes: Mapping[str, tuple] = field(default_factory=dict)
    project_file: str = field(default="region.qgz", init=False)

    @cached_property
    def _sampled(self):
        """Some areas with flow, evenly chosen."""
        areas = self.areas.get("all", ())
        chosen = np.unique(np.linspace(0, len(areas) - 1, min(SAMPLED, len(areas))).round().astype(int))
        return [areas[number] for number in chosen]

    @cached_property
    def relief(self) -> float:
        """Highest minus lowest elevation [m] below the flows of some areas; 0 without a terrain."""
        path = None if self.terrain is None else self.folder / self.terrain
        if path is None or not path.is_file():
            return 0.0
        ends = []
        with open_raster(path) as source:
            for area in self._sampled:
                top, bottom, left, right = area.place
                read = source.read(1, window=((top, bottom), (left, right)), out_shape=(PROBED, PROBED), masked=True)
                ends += [read.min(), read.max()] if read.count() else []
        return float(max(ends) - min(ends)) if ends else 0.0

    @cached_property
    def _largest(self):
        """Largest values above 0 in some areas, by band name."""
        values = {key: [] for key in LARGEST}
        for area in self._sampled:
            top, bottom, left, right = area.extent
            with open_raster(area.path) as source:
                bands = [MEMBER_BANDS.index(key) + 1 for key in LARGEST]
                for key, read in zip(LARGEST, source.read(bands, window=((top, bottom), (left, right))), strict=True):
                    values[key].append(read[(read != np.float32(source.nodata)) & (read > 0.0)])
        return {key: np.concatenate(parts) if parts else np.empty(0) for key, parts in values.items()}

    @cached_property
    def typical(self) -> dict[str, float]:
        """Typical size of the largest values by band name; all scenarios have the same classes."""
        flat = self._largest.items()
        return {key: float(np.percentile(own, TYPICAL_PERCENTILE)) if own.size else 0.0 for key, own in flat}

    @cached_property
    def limits(self) -> dict[str, tuple]:
        """Limits of classes by quantity: those chosen, and of depths that crowd in the last usual class."""
        depths = self._largest["h_max"]
        return fitting_classes(self.classes, {"h": depths[depths > self.min_depth]})

    def view(self) -> tuple[float, float, float, float]:
        """Choose the initial view: all cells with flow, or the whole grid without flow.

        Returns
        -------
        (float, float, float, float)
            West, south, east, north [m].
        """
        places = np.array([area.place for area in self.areas.get("all", ())])
        if not len(places):
            return self.grid.bounds
        (top, _, left, _), (_, bottom, _, right) = places.min(axis=0), places.max(axis=0)
        west, south, east, north = self.grid.part(top, left, (bottom - top, right - left)).bounds
        rim = MARGIN * max(east - west, north - south)
        return west - rim, south - rim, east + rim, north + rim


def write_region_project(project: RegionProject) -> list[Path]:
    """Write the project and a style beside each raster.

    Parameters
    ----------
    project : RegionProject

    Returns
    -------
    list of Path
        The files written, the project first.

    Raises
    ------
    OutputError
    """
    polygons = [
        _polygons(project, AREAS, "../areas.gpkg", "release areas", RELEASE, shown=True),
        _polygons(project, FOOTPRINTS, "all_footprints.gpkg", "footprints of the areas", OUTLINE, shown=False),
    ]
    groups = [_maps(project, name, shown=name == "all") for name in sorted(project.areas, key=_in_order)]
    terrain = _terrain(project)
    groups = [Group("areas", polygons), *groups, *([terrain] if terrain else [])]
    count, view = len(project.areas.get("all", ())), project.view()
    title = f"{project.name}: largest values of {count} release areas"
    largest = [group.rows[0] for group in groups[1:] if group.shown and group is not terrain]
    shown = [polygons[0]._replace(unfolded=True), *largest, *(terrain.rows if terrain else [])]
    page = print_layout(project, view, Group("map", shown), title, _facts(project, shown), project.author)
    write_archive(project, project_document(project, groups, view, title, [page]))
    styles = [_style(project, file, looked) for name in project.areas for file, looked in _files(project, name).items()]
    return [project.folder / project.project_file, *styles]


def _in_order(name):
    """All areas first, then scenarios by number, then by name."""
    text = name.removeprefix("scenario_")
    try:
        return name != "all", float(text), ""
    except ValueError:
        return name != "all", math.inf, text


def _facts(project, shown):
    """(name, text) of what the page says below the map."""
    areas = project.areas.get("all", ())
    moving = not_at_rest(areas)
    contours = next((row.title for row in shown if row.title.startswith("contours")), "")
    dtm = Path(project.terrain).name if project.terrain else ""
    return (
        *parameter_facts({name: text for name, text in project.facts.items() if name != "release"}),
        ("Largest depth", f"of {len(areas)} areas, each simulated separately; shown from {project.min_depth:g} m on"),
        ("Not at rest", f"{moving} areas" if moving else ""),
        ("Terrain", "; ".join(filter(None, [dtm, contours]))),
    )


def _files(project, name):
    """File of each map -> (band name, look, typical size) of its bands that are drawn."""
    drawn = {f"{name}_{key}.tif": [(key, look_of(BAND[key], project.limits), project.typical[key])] for key in LARGEST}
    drawn[f"{name}_areas.tif"] = [("areas", COUNTED, COUNT_LIMITS[-1])]
    if project.frequency:
        largest = max(area.frequency for area in project.areas[name])
        often, probable = ("frequency", OFTEN, largest), ("probability", PROBABLE, PROBABILITY_LIMITS[-1])
        drawn[f"{name}_probability.tif"] = [often, probable]
    return drawn


def _pipe(project, look, typical, band):
    return node("pipe", None, value_renderer(look, typical, project.min_depth, band))


def _maps(project, name, shown):
    """The maps of one scenario; the largest depth is visible."""
    rows = []
    for file, bands in _files(project, name).items():
        for number, (key, look, typical) in enumerate(bands, 1):
            title, pipe = look.layer_name(key), _pipe(project, look, typical, number)
            layer = map_layer(project, "raster", f"{name}_{key}", file, title, "gdal", None, pipe)
            rows.append(Layer(title, layer, not rows, not rows))
    count, moving = len(project.areas[name]), not_at_rest(project.areas[name])
    flow = f"{count} with flow" + (f", {moving} of them not at rest" if moving else "")
    words = "all areas" if name == "all" else name.replace("_", " ", 1)
    return Group(f"{words} ({flow})", rows, shown=shown, unfolded=shown, exclusive=True)


def _polygons(project, layer, file, title, pen, shown):
    maplayer = map_layer(
        project, "vector", f"areas_{layer}", f"{file}|layername={layer}", title, "ogr", None, outline_renderer(pen)
    )
    maplayer.set("geometry", "Polygon")
    return Layer(title, maplayer, shown)


def _terrain(project):
    """Contours over a hillshade of the DTM; None without its path."""
    if project.terrain is None:
        return None
    interval = contour_interval(project.relief) if project.relief else 0.0
    return Group("terrain", ground_rows(project, project.terrain, interval), unfolded=False)


def _style(project, file, bands):
    _, look, typical = bands[0]
    write_sidecar(project, file, style_document(_pipe(project, look, typical, 1)))
    return (project.folder / file).with_suffix(".qml")


def terrain_path(dem: Path, band: int | None, folder: Path) -> str | None:
    """Return the path of the DTM for a layer, relative to the folder of the project.

    Parameters
    ----------
    dem : Path
    band : int or None
    folder : Path

    Returns
    -------
    str or None
        None where QGIS would not show the DTM as the run reads it.
    """
    if not dem.is_file() or dem.suffix.lower() not in TERRAIN_SUFFIXES or band not in (None, 1):
        return None
    try:
        return Path(os.path.relpath(dem.resolve(), folder.resolve())).as_posix()
    except ValueError:  # another drive of Windows
        return None
