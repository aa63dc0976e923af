"""Read matrices of hazard levels, and write raster, style, zones and table of a hazard map."""

import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import geopandas
import numpy as np
import rasterio
import rasterio.features
import shapely

from ...laws.quantities import Quantity
from ...maps.qgis.outlines import POLYGONS, mask_outline
from ...maps.qgis.raster_styles import class_pipe, style_document
from ...maps.qgis.vector_styles import (
    RELEASE,
    class_renderer,
    outline_renderer,
    vector_style_document,
    write_layer_styles,
)
from ...system.csv_rows import write_records
from ...system.errors import InputError
from ...system.optional_libraries import GEOPACKAGE
from ...system.whole_files import whole_file
from ...terrain.class_rasters import write_class_raster
from ...terrain.grid import Grid
from ...terrain.raster_output import write_geotiff
from .guideline_files import read_guidelines, read_tables
from .hazard_levels import NOT_ASSESSED, Hazard, HazardMatrix, parse_matrices
from .zone_outlines import Generalized, polygons

SHIPPED = Path(__file__).with_name("hazard_matrices.toml")
NOT_ASSESSED_COLOUR, NOT_ASSESSED_WORDS = "#8c8c8c", "not assessed: no data"
LEAST, MOST = 0.1, 0.9  # [1] shares of runs between which an outline is uncertain
HEADINGS = ("level", "name", "meaning", "area_m2", "zone_area_m2", "scenarios", "unfinished", "matrix", "source")
BAND_PEN = ("40,40,40,255", 0.3, "dash")  # of uncertain outlines in QGIS: colour, width [mm], style


@dataclass(frozen=True)
class HazardMap:
    """All contents of a hazard map.

    Parameters
    ----------
    matrix : HazardMatrix
    grid : Grid
    hazard : Hazard
    scenarios : list of results.hazard.hazard_scenarios.Scenario
    zones : Generalized
    shares : float32[levels, rows, columns] or None
        Share of runs with at least a level; None without an ensemble.
    scale, least : float
        Denominator of the map scale; minimum mapping area [m2].
    title : str
    facts : tuple of (str, str)
        Source and parameters.
    """

    matrix: HazardMatrix
    grid: Grid
    hazard: Hazard
    scenarios: list
    zones: Generalized
    shares: np.ndarray | None
    scale: float
    least: float
    title: str
    facts: tuple = ()

    def unfinished(self) -> list[str]:
        """Return a line for each scenario that ended before its flow was at rest: its levels can be too low."""
        return [f"{one.years:g} years: {one.unfinished}" for one in self.scenarios if one.unfinished]

    def areas(self) -> np.ndarray:
        """Return the plan area of the cells of each level.

        Returns
        -------
        float64[levels] [m2]
        """
        counts = np.bincount(self.hazard.level.ravel(), minlength=len(self.matrix.levels) + 1)[1:]
        return counts * self.grid.cell_area

    def bands(self) -> list[shapely.MultiPolygon | None]:
        """Return for each level where its outline is uncertain; empty without an ensemble.

        It is the band between the outlines that LEAST and MOST of the runs reach with at least this level.
        """
        if self.shares is None:
            return []
        return [self._band(share) for share in self.shares]

    def _band(self, share):
        outer, inner = (
            mask_outline(share >= np.float32(least), self.grid.transform, smooth=True) for least in (LEAST, MOST)
        )
        if outer is None:
            return None
        band = outer if inner is None else polygons(shapely.difference(outer, inner))
        return None if band.is_empty else band

    def not_assessed(self) -> shapely.MultiPolygon | None:
        """Return the outline of the cells without data."""
        return mask_outline(self.hazard.unknown, self.grid.transform)


def read_matrices(own: Path | None = None, guidelines: Path | None = None) -> dict[str, HazardMatrix]:
    """Return matrices by name: of the shipped table, and of the file `own`, which have priority.

    Parameters
    ----------
    own : Path, optional
    guidelines : Path, optional
        A file with guidelines of the user.

    Returns
    -------
    dict of str to HazardMatrix

    Raises
    ------
    FormatError, InputError
        A file is missing, not TOML, or not a table of matrices.
    """
    known = read_guidelines(guidelines)
    matrices = parse_matrices(read_tables(SHIPPED), known, SHIPPED.name)
    return matrices if own is None else matrices | parse_matrices(read_tables(own), known, own)


def choose_matrix(name: str, own: Path | None = None, guidelines: Path | None = None) -> HazardMatrix:
    """Return the HazardMatrix called `name`.

    Parameters
    ----------
    name : str
    own : Path, optional
        A file with matrices of the user.
    guidelines : Path, optional
        A file with guidelines of the user.

    Raises
    ------
    FormatError, InputError
        An unreadable file, or an unknown name; the message lists the known ones.
    """
    matrices = read_matrices(own, guidelines)
    if name not in matrices:
        raise InputError(f"--map {name!r} is unknown; choose from {', '.join(matrices)}")
    return matrices[name]


def _entries(matrix):
    """(number, label, colour) of the levels, then of cells without data."""
    named = [(k, level.meaning or level.name, level.colour) for k, level in enumerate(matrix.levels, 1)]
    return [*named, (NOT_ASSESSED, NOT_ASSESSED_WORDS, NOT_ASSESSED_COLOUR)]


def write_hazard_raster(path: Path, made: HazardMap, tags: dict) -> None:
    """Write the levels as GeoTIFF (uint8) with colours and names.

    NOT_ASSESSED marks cells without data; 0 is nodata (no hazard).

    Parameters
    ----------
    path : Path
    made : HazardMap
    tags : dict of str to str
        Of the file.
    """
    matrix, numbers = made.matrix, made.hazard.coded()
    source = {"matrix": matrix.name, "title": matrix.title, "source": matrix.source}
    write_class_raster(path, made.grid, numbers, _entries(matrix), "hazard level [1]", source, tags)


def write_hazard_style(path: Path, matrix: HazardMatrix) -> None:
    """Write the .qml of the raster for QGIS.

    Parameters
    ----------
    path : Path
    matrix : HazardMatrix
    """
    with whole_file(path) as part:
        part.write_text(style_document(level_pipe(matrix)), encoding="utf-8", newline="\n")


def level_pipe(matrix: HazardMatrix) -> Element:
    """Return the element `pipe` of QGIS that draws the raster of levels.

    Parameters
    ----------
    matrix : HazardMatrix
    """
    return class_pipe(_entries(matrix))


def zone_renderers(matrix: HazardMatrix) -> dict[str, Element]:
    """Return the elements `renderer-v2` of QGIS for the layers of the GeoPackage, by name.

    Parameters
    ----------
    matrix : HazardMatrix
    """
    entries = _entries(matrix)
    return {
        "zones": class_renderer("level", entries[:-1]),
        "uncertainty": outline_renderer(BAND_PEN),
        "not_assessed": class_renderer("level", entries[-1:]),
        "release": outline_renderer(RELEASE),
    }


def write_shares(path: Path, made: HazardMap, tags: dict) -> None:
    """Write the share of runs with at least each level, a band for each level.

    Parameters
    ----------
    path : Path
    made : HazardMap
        With shares.
    tags : dict of str to str
        Of the file.
    """
    bands = [
        (Quantity(f"P_{level.name}", "1", f"share of runs with at least level {level.name}", "float32"), share)
        for level, share in zip(made.matrix.levels, made.shares, strict=True)
    ]
    write_geotiff(path, made.grid, bands, tags)


def write_zones(path: Path, made: HazardMap, tags: dict) -> None:
    """Write a GeoPackage: `zones` with the scenarios that decide, `uncertainty`, `not_assessed`, `release`.

    Parameters
    ----------
    path : Path
    made : HazardMap
    tags : dict of str to str
        Of the source.
    """
    layers = {
        "zones": _zone_rows(made),
        "uncertainty": _band_rows(made),
        "not_assessed": _gap_rows(made),
        "release": _release_rows(made),
    }
    styles = zone_renderers(made.matrix)
    crs = None if made.grid.crs is None else made.grid.crs.to_wkt()
    written = {}
    with whole_file(path) as part, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a missing CRS is allowed
        for name, (rows, shapes) in layers.items():
            if shapes or name == "zones":
                columns = {key: [row[key] for row in rows] for key in (rows[0] if rows else _zone_row(made, 1, "", 0))}
                table = (
                    geopandas.GeoDataFrame(columns | tags, geometry=shapes, crs=crs)
                    if rows
                    else (geopandas.GeoDataFrame(columns, geometry=[], crs=crs))
                )
                older = {} if part.exists() else {"dataset_options": GEOPACKAGE}
                table.to_file(part, layer=name, driver="GPKG", engine="pyogrio", **older)
                written[name] = vector_style_document(styles[name], POLYGONS)
        write_layer_styles(part, written)


def _zone_row(made, number, scenarios, area):
    level = made.matrix.levels[number - 1]
    return {
        "level": number,
        "name": level.name,
        "meaning": level.meaning,
        "area_m2": round(float(area), 3),
        "scenarios": scenarios,
        "matrix": made.matrix.name,
        "guideline": made.matrix.source,
    }


def _zone_rows(made):
    """Rows and polygons of the zones, one for each part."""
    rows, shapes = [], []
    for number, zone in enumerate(made.zones.zones, 1):
        parts = [] if zone is None else list(shapely.get_parts(zone))
        deciding = _deciding(made, number, parts)
        rows += [_zone_row(made, number, words, part.area) for part, words in zip(parts, deciding, strict=True)]
        shapes += [shapely.MultiPolygon([part]) for part in parts]
    return rows, shapes


def _deciding(made, number, parts):
    """For each part of a zone the return periods of the scenarios that give its cells their level, as text."""
    if not parts:
        return []
    cells = rasterio.features.rasterize(
        zip(parts, range(1, len(parts) + 1), strict=True),
        made.grid.shape,
        transform=made.grid.transform,
        all_touched=True,
        dtype="int32",
    )
    found = [set() for _ in range(len(parts) + 1)]
    for scenario in made.scenarios:
        for part in np.unique(cells[_gives(made, scenario, number)]):
            found[part].add(scenario.years)
    return [", ".join(f"{years:g}" for years in sorted(years)) for years in found[1:]]


def _gives(made: HazardMap, scenario: Any, number: int) -> np.ndarray:
    """bool[rows, columns]: cells of a level that a scenario has too, and no scenario a higher one."""
    return (made.hazard.level == number) & (scenario.level == number)


def _band_rows(made):
    rows, shapes = [], []
    for level, (number, shape) in zip(made.matrix.levels, enumerate(made.bands(), 1), strict=False):
        if shape is not None:
            rows.append(
                {
                    "level": number,
                    "name": level.name,
                    "share_from": LEAST,
                    "share_to": MOST,
                    "area_m2": round(shape.area, 3),
                }
            )
            shapes.append(shape)
    return rows, shapes


def _gap_rows(made):
    shape = made.not_assessed()
    if shape is None:
        return [], []
    return [{"level": NOT_ASSESSED, "name": NOT_ASSESSED_WORDS, "area_m2": round(shape.area, 3)}], [shape]


def _release_rows(made):
    """Rows and shapes of the releases of the scenarios, as far as their results have them."""
    found = [(scenario.years, shape) for scenario in made.scenarios for shape in scenario.release]
    return [{"years": years} for years, _ in found], [shape for _, shape in found]


def write_hazard_table(path: Path, made: HazardMap) -> None:
    """Write the areas of the levels, and of cells without data, as CSV.

    Parameters
    ----------
    path : Path
    made : HazardMap
    """
    rows, unfinished = [], "; ".join(made.unfinished())
    for number, (level, area) in enumerate(zip(made.matrix.levels, made.areas(), strict=True), 1):
        zone = made.zones.zones[number - 1]
        years = [f"{scenario.years:g}" for scenario in made.scenarios if _gives(made, scenario, number).any()]
        rows.append(
            (
                number,
                level.name,
                level.meaning,
                float(area),
                0.0 if zone is None else zone.area,
                ", ".join(dict.fromkeys(years)),
                unfinished,
                made.matrix.name,
                made.matrix.source,
            )
        )
    gap = float(np.count_nonzero(made.hazard.unknown) * made.grid.cell_area)
    rows.append((NOT_ASSESSED, "not assessed", NOT_ASSESSED_WORDS, gap, math.nan, "", unfinished, made.matrix.name, ""))
    write_records(path, HEADINGS, rows)
