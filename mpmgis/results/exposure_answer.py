"""Answer `mpmgis exposure`: what reaches roads, railways, masts and buildings, by scenario and by release area."""

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import shapely

from ..maps.averaging.result_bands import Result
from ..system.csv_rows import column_name, write_columns
from ..system.errors import InputError
from ..system.messages import Progress, log, unwatched
from ..system.option import PathLike
from ..terrain.elevation import Terrain
from ..terrain.georeference import same_place
from ..terrain.grid import Grid
from ..terrain.raster_input import grid_of, open_raster
from ..terrain.spatial_inputs import Feature
from .answer_files import answer_output, four_digits, with_files, write_rows
from .exposed_objects import ATTRIBUTE, CLASSES, LAYERS, read_objects, write_objects
from .object_cells import LINE, POLYGON, dimension_of, object_cells, size_of
from .opened_results import distinct_names, peaks_of, read_peaks
from .question_options import Question
from .region_back_tracking import areas_near, region_of

TABLE_FILE, LAYER_FILE, AREA_FILE = "exposure.csv", "exposure.gpkg", "release_areas.csv"
FILES = (TABLE_FILE, LAYER_FILE)
WORD = "exposure"  # end of the name of the default output folder
ARRIVAL = "t_arrival"
LARGEST = (("h_max", "m"), ("Ut_max", "m s-1"), ("p_max", "Pa"), (ARRIVAL, "s"))  # of arrival the earliest
REACHED, NOT_REACHED, OUTSIDE = (label for _, label, _ in CLASSES)
FIGURES = (("length", "m"), ("area", "m2"), ("share", "1"), *LARGEST)
SHOWN = 20  # rows of objects that are printed


class Reach(NamedTuple):
    """What reaches one object.

    Parameters
    ----------
    size : float
        Number of points, length [m] or area [m2] that is reached.
    values : dict of str to float
        Largest depth [m], speed [m s-1], pressure [Pa], and time of first arrival [s]; NaN where it is not known.
    """

    size: float
    values: dict[str, float]


class ObjectRow(NamedTuple):
    """An object in one scenario.

    Parameters
    ----------
    number : int
        Of the object, from 1.
    scenario : str
    state : str
        REACHED, NOT_REACHED or OUTSIDE.
    reach : Reach
    on_terrain : float [1]
        Share of the object on the terrain.
    areas : tuple of int
        Numbers of the release areas that reach it, of a region.
    """

    number: int
    scenario: str
    state: str
    reach: Reach
    on_terrain: float
    areas: tuple[int, ...]


class AreaRow(NamedTuple):
    """An object that one release area of a region reaches."""

    number: int
    scenario: str
    area: int
    reach: Reach


@dataclass(frozen=True)
class ExposureFound:
    """Objects at risk.

    Parameters
    ----------
    objects : list of Feature
    found : list of ObjectRow
        For each scenario and object.
    by_area : list of AreaRow
        For each object and release area that reaches it.
    scenarios : tuple of str
    min_depth : float [m]
        From which a cell counts as reached.
    files : tuple of Path
    """

    objects: list[Feature]
    found: list[ObjectRow]
    by_area: list[AreaRow]
    scenarios: tuple[str, ...]
    min_depth: float
    files: tuple[Path, ...] = ()

    def columns(self) -> list[tuple[str, str]]:
        """Return (name, unit) of each column of `rows`."""
        names = (("object", ""), ("name", ""), ("kind", ""), ("scenario", ""), ("state", ""))
        return [*names, *FIGURES, ("on_terrain", "1"), ("release_areas", "")]

    def rows(self) -> list[tuple[str | float, ...]]:
        """Return a row for each scenario and object."""
        return [
            (
                row.number,
                *self._name_and_kind(row.number),
                row.scenario,
                row.state,
                *_figures(self.objects[row.number - 1].shape, row.reach),
                row.on_terrain,
                _listed(row.areas),
            )
            for row in self.found
        ]

    def area_rows(self) -> list[tuple[str | float, ...]]:
        """Return a row for each object and release area that reaches it, with the columns of `area_columns`."""
        return [
            (
                row.number,
                *self._name_and_kind(row.number),
                row.scenario,
                row.area,
                *_figures(self.objects[row.number - 1].shape, row.reach),
            )
            for row in self.by_area
        ]

    @staticmethod
    def area_columns() -> list[tuple[str, str]]:
        """Return (name, unit) of each column of `area_rows`."""
        return [("object", ""), ("name", ""), ("kind", ""), ("scenario", ""), ("release_area", ""), *FIGURES]

    def _name_and_kind(self, number):
        one = self.objects[number - 1]
        return one.name, LAYERS[dimension_of(one.shape)][:-1]

    def attributes(self) -> list[dict[str, Any]]:
        """Return for each object what reaches it in any scenario: the largest values and the earliest arrival."""
        rows = _by_object(self.found)
        return [self._over_scenarios(number, rows[number]) for number in range(1, len(self.objects) + 1)]

    def _over_scenarios(self, number, rows):
        worst = _together([row.reach for row in rows])
        states = [row.state for row in rows]
        state = next(one for one in (REACHED, NOT_REACHED, OUTSIDE) if one in states)
        figures = zip(FIGURES, _figures(self.objects[number - 1].shape, worst), strict=True)
        return {
            "object": number,
            ATTRIBUTE: next(code for code, label, _ in CLASSES if label == state),
            "state": state,
            "scenarios": ", ".join(row.scenario for row in rows if row.state == REACHED),
            **{column_name(*column): value for column, value in figures},
            "release_areas": _listed(sorted({area for row in rows for area in row.areas})),
        }

    def lines(self) -> list[str]:
        """Return lines of text for a terminal."""
        lines = [f"{len(self.objects)} objects; reached where the flow was ever {self.min_depth:g} m deep"]
        for scenario in self.scenarios:
            rows = [row for row in self.found if row.scenario == scenario]
            counts = ", ".join(
                f"{sum(row.state == state for row in rows)} {state}" for state in (REACHED, NOT_REACHED, OUTSIDE)
            )
            sizes = [
                sum(row.reach.size for row in rows if dimension_of(self.objects[row.number - 1].shape) == dimension)
                for dimension in (LINE, POLYGON)
            ]
            lines.append(f"{scenario}: {counts}; {sizes[0]:.1f} m of lines, {sizes[1]:.1f} m2 of polygons")
        reached = [row for row in self.found if row.state == REACHED]
        if reached:
            lines.append(f"{'object':<20}{'scenario':<16}" + "".join(f"{f'{name} [{u}]':>15}" for name, u in FIGURES))
        for row in reached[:SHOWN]:
            one = self.objects[row.number - 1]
            figures = "".join(f"{four_digits(value):>15}" for value in _figures(one.shape, row.reach))
            lines.append(f"{one.name[:19]:<20}{row.scenario[:15]:<16}{figures}")
        if len(reached) > SHOWN:
            lines.append(f"... and {len(reached) - SHOWN} more in the table")
        return lines


def _by_object(rows: Iterable[Any]) -> dict[int, list[Any]]:
    """Return rows by the number of their object."""
    found = defaultdict(list)
    for row in rows:
        found[row.number].append(row)
    return found


def _listed(numbers):
    return " ".join(map(str, numbers))


def _figures(shape: shapely.Geometry, reach: Reach) -> tuple[float, ...]:
    """Return the values of FIGURES."""
    dimension = dimension_of(shape)
    whole = size_of(shape, dimension)
    sizes = (reach.size if dimension == kind else math.nan for kind in (LINE, POLYGON))
    return (*sizes, reach.size / whole if whole else math.nan, *(reach.values[name] for name, _ in LARGEST))


def exposure(asked: Question, objects: PathLike, progress: Progress = unwatched) -> ExposureFound:
    """Find what reaches each object in each result; write tables and a layer.

    Parameters
    ----------
    asked : Question
        Each of its results is a scenario.
    objects : path
        Points, lines and polygons.
    progress : callable
        Called with (frames done, frames in all).

    Returns
    -------
    ExposureFound

    Raises
    ------
    MpmgisError
        Unreadable input, results in several CRS, or no object; nothing is written then.
    """
    inputs = cast("Question", {**asked, "objects": Path(objects)})
    output = answer_output(inputs, WORD, FILES)
    features: list[Feature] = []
    first: Grid | None = None
    rows: list[ObjectRow] = []
    by_area: list[AreaRow] = []
    scenarios = distinct_names(asked["frames"])
    for path, scenario in zip(asked["frames"], scenarios, strict=True):
        result = peaks_of({**asked, "frames": (path,)}, progress, ("min_depth",), ("density",))
        bands, grid = _bands(result, asked["density"], first)
        ground = _ground(result, grid, asked["dem"])
        if first is None:
            first, features = grid, read_objects(objects, ground)
        tracked = _tracked(Path(path), scenario, features, asked["min_depth"])
        by_area += tracked
        rows += _rows(features, scenario, bands, grid, ground, asked["min_depth"], tracked)
    assert first is not None
    grid = first
    _log_outside(features, rows, scenarios[0])
    found = ExposureFound(features, rows, by_area, scenarios, asked["min_depth"])
    writers = {
        TABLE_FILE: write_rows,
        LAYER_FILE: lambda path, found: write_objects(path, features, found.attributes(), grid),
    }
    if any(region_of(Path(path)) for path in asked["frames"]):
        writers[AREA_FILE] = lambda path, found: write_columns(path, found.area_columns(), found.area_rows())
    return with_files(found, output, asked["overwrite"], writers)


def _bands(result: Result, density: float | None, first: Grid | None) -> tuple[dict[str, np.ndarray], Grid]:
    """Return the bands of LARGEST that a result has, and their grid."""
    bands, grid = read_peaks(result, [name for name, _ in LARGEST], density, first)
    if "h_max" not in bands or grid is None:
        raise InputError(f"{result.name} has no largest depth (h_max, or <name>_pft), which `exposure` requires")
    return bands, grid


def _ground(result: Result, grid: Grid, dem: PathLike | None) -> Grid:
    """Return the grid of the terrain of a result, where it is known, else that of its rasters."""
    terrain = dem or result.terrain
    if isinstance(terrain, Terrain):
        return terrain.grid
    path = Path(terrain) if terrain is not None else getattr(result.bands["h_max"], "path", None)
    if path is None or not path.is_file():
        return grid
    with open_raster(path) as source:
        ground = grid_of(source, path)
    known = None not in (ground.crs, grid.crs)
    return grid if known and not same_place(ground.crs, grid.crs) else ground


def _rows(features, scenario, bands, grid, ground, min_depth, tracked):
    """Return the ObjectRow of each feature."""
    reached = np.nan_to_num(bands["h_max"], nan=-1.0) >= np.float32(min_depth)
    extent = shapely.Polygon(ground.corners())
    shapely.prepare(extent)
    rows, causes = [], _by_object(tracked)
    for number, feature in enumerate(features, 1):
        shape = feature.shape
        inside = _share_inside(shape, extent)
        reach = _reach(shape, bands, grid, reached)
        own = causes[number]
        if own and ARRIVAL not in bands:
            reach = reach._replace(
                values=reach.values | {ARRIVAL: _together([one.reach for one in own]).values[ARRIVAL]}
            )
        state = REACHED if reach.size > 0.0 else NOT_REACHED if inside > 0.0 else OUTSIDE
        rows.append(ObjectRow(number, scenario, state, reach, inside, tuple(row.area for row in own)))
    return rows


def _share_inside(shape: shapely.Geometry, extent: shapely.Polygon) -> float:
    dimension = dimension_of(shape)
    whole = size_of(shape, dimension)
    if extent.covers(shape) or whole == 0.0:
        return float(extent.intersects(shape))
    return size_of(shape.intersection(extent), dimension) / whole


def _reach(shape: shapely.Geometry, bands: dict[str, np.ndarray], grid: Grid, reached: np.ndarray) -> Reach:
    cells, sizes = object_cells(shape, grid, reached)
    values = {}
    for name, _ in LARGEST:
        own = bands[name].reshape(-1)[cells] if name in bands else np.empty(0)
        own = own[np.isfinite(own)]
        values[name] = math.nan if not own.size else float(own.min() if name == ARRIVAL else own.max())
    return Reach(float(sizes.sum()), values)


def _together(reaches: Sequence[Reach]) -> Reach:
    """Return the largest size and values of several, and the earliest arrival."""
    values = {}
    for name, _ in LARGEST:
        own = [reach.values[name] for reach in reaches if math.isfinite(reach.values[name])]
        values[name] = math.nan if not own else min(own) if name == ARRIVAL else max(own)
    return Reach(max(reach.size for reach in reaches), values)


def _tracked(path: Path, scenario: str, features: list[Feature], min_depth: float) -> list[AreaRow]:
    """Return an AreaRow for each release area of a region that reaches a feature; none for another result."""
    region = region_of(path)
    if region is None:
        return []
    found = []
    for area, near, grid, bands in areas_near(*region, [feature.shape for feature in features]):
        reached = np.nan_to_num(bands["h_max"], nan=-1.0) >= np.float32(min_depth)
        for place in near:
            reach = _reach(features[place].shape, bands, grid, reached)
            if reach.size > 0.0:
                found.append(AreaRow(place + 1, scenario, area, reach))
    return sorted(found, key=lambda row: (row.number, row.area))


def _log_outside(features: list[Feature], rows: list[ObjectRow], scenario: str) -> None:
    """Report objects that are not, or only in part, on the terrain."""
    shares = [row.on_terrain for row in rows if row.scenario == scenario]
    whole, partly = sum(share == 0.0 for share in shares), sum(0.0 < share < 1.0 for share in shares)
    if whole or partly:
        log.info(
            f"{features[0].path}: {whole} of {len(shares)} objects are outside the terrain, and of {partly} a part; "
            "nothing is known there"
        )
