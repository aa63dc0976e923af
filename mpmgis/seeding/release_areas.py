"""Release areas from a vector file or a raster, with their thickness."""

import difflib
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely

from ..system.errors import InputError
from ..system.messages import log, muted
from ..system.source_names import file_of, source_of
from ..terrain.dtm import TerrainFile
from ..terrain.elevation import Terrain
from ..terrain.mask_values import THICKEST
from ..terrain.raster_input import RASTER_SUFFIXES, file_sha256
from ..terrain.release_parts import NORMAL, VERTICAL, ReleaseArea, ReleasePart, require_on_terrain, without_overlaps
from ..terrain.spatial_inputs import is_raster, repaired, to_terrain
from ..terrain.vector_table import VectorTable, names_of, read_table, require_polygons
from .release_rasters import area_of_raster, surface_thickness, thickness_raster, within_thickness

USUAL_COLUMNS = ("thickness", "d0", "relth")  # names of a column with the thickness, lower case


def read_release(
    path: str | Path,
    terrain: Terrain | TerrainFile,
    thickness: float | str | Path | None = None,
    thickness_mode: str = NORMAL,
    surface: str | Path | None = None,
    check: Callable[[float], None] | None = None,
) -> ReleaseArea:
    """Read the release areas at `path`, in the terrain's CRS, with their thickness.

    Parameters
    ----------
    path : str or Path
        Vector file (polygons; ``file.gpkg|layername=name`` selects a layer) or raster (mask, or thickness per cell).
    terrain : Terrain or TerrainFile
    thickness : float [m], str or Path, optional
        A number, the name of a column, or the path of a raster. Default: the first of the columns thickness, d0,
        relth, or the values of a release raster.
    thickness_mode : {"normal", "vertical"}
    surface : str or Path, optional
        Raster of the material's surface [m]: vertical thickness is surface minus bed, clipped at 0.
    check : callable (float [m2]) -> None, optional
        Called with the area of all parts before the terrain under them is read; it may refuse a large one.

    Raises
    ------
    FormatError, GeoreferenceError, InputError
        The file is not readable, in an unsuitable CRS, or has no usable area or thickness.
    """
    from .release_bed import bed_under, report_heights  # imports the kernels of seeding; not needed for outlines

    if surface is not None and thickness is not None:
        raise InputError("--thickness and --surface exclude each other; give only one")
    wanted = _Thickness.parse(thickness, surface)
    if is_raster(path):
        features, own = area_of_raster(path, terrain, wanted)
    else:
        features, own = _vector_features(path, terrain, wanted)[0], None
    record = {}
    for part in features:
        require_on_terrain(part, terrain.grid)
    if check is not None:
        check(math.fsum(part.polygon.area for part in features))
    report_heights(features, bed_under(features, terrain), terrain, path)
    if wanted.raster is not None:
        own = (
            surface_thickness(wanted.raster, terrain, features, record)
            if surface is not None
            else (thickness_raster(wanted.raster, terrain))
        )
    if own is not None:
        features = [within_thickness(part, own) for part in features]
    plain = file_of(path)
    return ReleaseArea(
        without_overlaps(features),
        VERTICAL if surface is not None else thickness_mode,
        name=plain.stem,
        path=str(plain),
        sha256=file_sha256(plain),
        record=record,
    )


@muted()
def read_outlines(path: str | Path, terrain: Terrain | TerrainFile) -> list[shapely.Geometry]:
    """Read the polygons of the release areas at `path` in the terrain's CRS, without overlaps.

    Parameters
    ----------
    path : str or Path
        As for `read_release`.
    terrain : Terrain or TerrainFile

    Raises
    ------
    FormatError, GeoreferenceError, InputError
        The file is not readable, in an unsuitable CRS, or has no usable area.
    """
    wanted = _Thickness(number=1.0)
    if is_raster(path):
        features, _ = area_of_raster(path, terrain, wanted)
    else:
        features, _ = _vector_features(path, terrain, wanted)
    for part in features:
        require_on_terrain(part, terrain.grid)
    return [part.polygon for part in without_overlaps(features)]


def read_parts(
    path: str | Path,
    terrain: Terrain | TerrainFile,
    thickness: float | str | Path | None = None,
    surface: str | Path | None = None,
) -> tuple[list[ReleasePart], dict[str, np.ndarray]]:
    """Read a release part for each polygon of a vector file, overlaps included, and the columns of the file.

    Parameters
    ----------
    path : str or Path
    terrain : Terrain or TerrainFile
    thickness : float [m], str or Path, optional
        As for `read_release`.
    surface : str or Path, optional
        As for `read_release`.

    Returns
    -------
    parts : list of ReleasePart
        Thickness NaN where a raster gives it. Polygons with thickness 0 in their column are left out.
    columns : dict of str to array
        Of the parts.

    Raises
    ------
    InputError
        The file is a raster, or its polygons or thickness are not usable.
    """
    if is_raster(path):
        raise InputError(f"{path} is a raster, expected polygons; convert it in QGIS: Polygonize")
    return _vector_features(path, terrain, _Thickness.parse(thickness, surface))


class _Thickness:
    """Thickness by --thickness or --surface: a number, the name of a column, or a raster."""

    def __init__(self, number=None, column=None, raster=None):
        self.number, self.column, self.raster = number, column, raster

    @classmethod
    def parse(cls, thickness, surface):
        if surface is not None:
            return cls(raster=surface)
        if thickness is None:
            return cls()
        try:
            return cls(number=require_thickness(float(thickness), "--thickness"))
        except (TypeError, ValueError):
            pass
        text, found = str(thickness), source_of(thickness)
        if found.file.exists() or not found.is_plain or found.file.suffix.lower() in RASTER_SUFFIXES or "/" in text:
            return cls(raster=thickness)
        return cls(column=text)


def require_thickness(value: float, where: str) -> float:
    """Return a thickness [m] if it is a finite number above 0.

    Parameters
    ----------
    value : float [m]
    where : str
        Source of the number, for the message.

    Raises
    ------
    InputError
        It is not a finite number above 0, or above THICKEST.
    """
    if not math.isfinite(value) or value <= 0:
        raise InputError(f"{where}: thickness is {value:g}, expected a number of metres above 0")
    if value > THICKEST:
        raise InputError(f"{where}: thickness is {value:g}, expected at most {THICKEST:g} metres; check its unit")
    return value


def _vector_features(
    path: str | Path, terrain: Terrain | TerrainFile, wanted: "_Thickness"
) -> tuple[list[ReleasePart], dict[str, np.ndarray]]:
    """Read a ReleasePart per feature, in the terrain's CRS, and the columns; NaN where a raster gives thickness later.

    Features with thickness 0 in their column, such as areas too low for snow, are left out.
    """
    table = read_table(path)
    table = require_polygons(table, path)
    names = names_of(table, path)
    heights = np.array(_feature_thickness(table, names, path, wanted))
    thick = heights != 0.0
    if not thick.any():
        raise InputError(
            f"{path}: the thickness of all {len(names)} areas is 0, expected metres above 0 in one of them"
        )
    if not thick.all():
        log.info(f"{path}: {np.count_nonzero(~thick)} of {len(names)} areas have a thickness of 0 and are left out")
        table, heights = table.where(thick), heights[thick]
        names = [name for name, kept in zip(names, thick, strict=True) if kept]
    shapes = to_terrain(table.geometry, table.crs, terrain.grid, path)
    shapes = [repaired(shape, name, path) for shape, name in zip(shapes, names, strict=True)]
    parts = [ReleasePart(name, shape, h) for name, shape, h in zip(names, shapes, heights.tolist(), strict=True)]
    return parts, table.columns


def _feature_thickness(table: VectorTable, names: list[str], path: str | Path, wanted: "_Thickness") -> list[float]:
    """Return the thickness [m] per feature, from the number or the column; NaN where a raster gives it later."""
    if wanted.raster is not None:
        return [math.nan] * len(names)
    if wanted.number is not None:
        if found := _usual_column(table):
            log.info(f"{path}: a thickness of {wanted.number:g} m is used, column {found!r} is not")
        return [wanted.number] * len(names)
    column = _thickness_column(table, path, wanted.column)
    values = table.columns[column]
    if values.dtype.kind not in "fiu":
        raise InputError(f"{path}: column {column!r} contains {_kind(values)}, expected numbers (thickness in metres)")
    values = values.astype(float).tolist()
    places = (f"{path}: '{name}', column {column!r}" for name in names)
    return [v and require_thickness(v, place) for v, place in zip(values, places, strict=True)]


def _usual_column(table: VectorTable) -> str | None:
    """Return the first of USUAL_COLUMNS that the table has; None without one."""
    lower = {c.lower(): c for c in reversed(list(table.columns))}
    return next((lower[name] for name in USUAL_COLUMNS if name in lower), None)


def _kind(values):
    return "text" if any(isinstance(value, str) for value in values) else str(values.dtype)


def _thickness_column(table: VectorTable, path: str | Path, asked: str | None) -> str:
    """Return the thickness column: `asked`, or the first of USUAL_COLUMNS with a message."""
    columns = list(table.columns)
    if asked is None:
        found = _usual_column(table)
        if found is None:
            raise InputError(
                f"{path} has none of the columns {', '.join(USUAL_COLUMNS)} ({_listing(columns)}); give --thickness, "
                f"or thickness in the table of the scene, as a number of metres, a column or a raster"
            )
        log.info(f"{path}: thickness is read from column {found!r}")
        return found
    if asked in columns:
        return asked
    near = difflib.get_close_matches(asked, columns, 1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise InputError(
        f"`thickness={asked}` is neither a number, a raster nor a column of {path}; {hint}{_listing(columns)}"
    )


def _listing(columns):
    return f"it has {', '.join(columns[:8])}" if columns else "it has no columns"
