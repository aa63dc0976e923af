"""Release areas in: any vector file or raster that GDAL reads, GeoParquet besides (design note D2, D9, D10, H16 to
H19)."""

import difflib
import math
import warnings
from pathlib import Path

import numpy as np
import pyproj
import rasterio.features
import shapely
from affine import Affine

from ..errors import FormatError, GeoreferenceError, InputError, MpmgisError
from ..messages import log, muted
from ..terrain.elevation import bilinear
from ..terrain.georeference import horizontal, name_of, same_place, warp_command
from ..terrain.grid import Grid
from ..terrain.release import (
    NORMAL,
    VERTICAL,
    ReleaseArea,
    ReleasePart,
    ThicknessRaster,
    polygons_only,
    require_on_terrain,
    without_overlaps,
)
from .gdal_input import require_undisguised
from .ogr import pyogrio
from .raster import WithoutCRS, file_sha256, open_raster, read_raster
from .vector_table import LAYER, names_of, read_table, require_polygons

USUAL_COLUMNS = ("thickness", "d0", "relth")
_RASTER_SUFFIXES = {".tif", ".tiff", ".vrt", ".asc", ".img", ".nc", ".grd", ".hgt", ".bil", ".dem", ".sdat", ".jp2"}
_ELEVATION, _NEAR_GROUND = 10.0, 50.0  # [m] a raster of larger values so near to the ground holds elevations
_SAME_METRES = 1e-3  # [m] reprojection that moves nothing further than this is none
_SURFACE_CUT, _MOST_PIXELS = 8, 20_000_000  # a surface's pixels are cut so finely, memory permitting
_AFFINE_PIXELS = 0.25  # a raster of another CRS is placed by the affine that fits to this share of a pixel


def read_release(path, terrain, thickness=None, thickness_mode=NORMAL, surface=None):
    """The release areas at `path`, in the terrain's CRS, with their thickness.

    Parameters
    ----------
    path : str or Path
        Vector file (polygons; ``file.gpkg|layername=name`` picks a layer) or raster (mask, or thickness per cell).
    terrain : Terrain or TerrainFile
    thickness : float, str or Path, optional
        A number [m], a column's name, or a raster's path. Without it the first of the columns thickness, d0, relth is
        used, or the values of a release raster.
    thickness_mode : {"normal", "vertical"}
    surface : str or Path, optional
        Raster of the material's surface [m]: thickness is surface minus bed, vertical, clipped at 0.

    Raises
    ------
    FormatError, GeoreferenceError, InputError
    """
    from ..seeding.bed import bed_under  # brings the kernels of seeding, which outlines do without

    if surface is not None and thickness is not None:
        raise InputError("--thickness and --surface exclude each other; give one of them")
    wanted = _Thickness.parse(thickness, surface)
    if is_raster(path):
        features, own = _raster_features(path, terrain, wanted)
    else:
        features, own = _vector_features(path, terrain, wanted), None
    record = {}
    for part in features:
        require_on_terrain(part, terrain.grid)
    bed_under(features, terrain)
    if wanted.raster is not None:
        own = (
            _surface_thickness(wanted.raster, terrain, features, record)
            if surface is not None
            else (_thickness_raster(wanted.raster, terrain))
        )
    if own is not None:
        features = [_where_thick(part, own) for part in features]
    plain = Path(str(path).split(LAYER)[0])
    return ReleaseArea(
        without_overlaps(features),
        VERTICAL if surface is not None else thickness_mode,
        name=plain.stem,
        path=str(plain),
        sha256=file_sha256(plain),
        record=record,
    )


@muted()
def read_outlines(path, terrain):
    """Polygons of the release areas at `path` in the terrain's CRS, without overlaps; as `read_release` has them.

    Raises
    ------
    FormatError, GeoreferenceError, InputError
    """

    wanted = _Thickness(number=1.0)
    if is_raster(path):
        features, _ = _raster_features(path, terrain, wanted)
    else:
        features = _vector_features(path, terrain, wanted)
    for part in features:
        require_on_terrain(part, terrain.grid)
    return [part.polygon for part in without_overlaps(features)]


class _Thickness:
    """What --thickness or --surface asks for: a number, a column's name, or a raster."""

    def __init__(self, number=None, column=None, raster=None):
        self.number, self.column, self.raster = number, column, raster

    @classmethod
    def parse(cls, thickness, surface):
        if surface is not None:
            return cls(raster=Path(surface))
        if thickness is None:
            return cls()
        try:
            return cls(number=require_thickness(float(thickness), "--thickness"))
        except (TypeError, ValueError):
            pass
        text = str(thickness)
        if Path(text).exists() or Path(text).suffix.lower() in _RASTER_SUFFIXES or "/" in text:
            return cls(raster=Path(text))
        return cls(column=text)


def require_thickness(value, where):
    """`value` [m] if it is a finite number above 0; `where` names it in the refusal."""
    if not math.isfinite(value) or value <= 0:
        raise InputError(f"{where}: thickness is {value:g}, wanted a number of metres above 0")
    return value


# ---------------------------------------------------------------------------------------------------- vector sources


def _vector_features(path, terrain, wanted):
    """ReleasePart per feature of a vector file, in the terrain's CRS; thickness NaN where a raster will give it."""
    table = read_table(path)
    table = require_polygons(table, path)
    names = names_of(table)
    heights = _feature_thickness(table, names, path, wanted)
    shapes = to_terrain(table.geometry, table.crs, terrain, path)
    shapes = [repaired(shape, name, path) for shape, name in zip(shapes, names, strict=True)]
    return [ReleasePart(name, shape, h) for name, shape, h in zip(names, shapes, heights, strict=True)]


def _feature_thickness(table, names, path, wanted):
    """Thickness [m] per feature: the number, or the column's values; NaN where a raster gives it."""
    if wanted.raster is not None:
        return [math.nan] * len(names)
    if wanted.number is not None:
        return [wanted.number] * len(names)
    column = _thickness_column(table, path, wanted.column)
    values = table.columns[column]
    if values.dtype.kind not in "fiu":
        raise InputError(f"{path}: column {column!r} holds {_kind(values)}, wanted numbers (thickness in metres)")
    values = values.astype(float).tolist()
    return [require_thickness(v, f"{path}: '{name}', column {column!r}") for name, v in zip(names, values, strict=True)]


def _kind(values):
    return "text" if any(isinstance(value, str) for value in values) else str(values.dtype)


def _thickness_column(table, path, asked):
    """The column to use: the one asked for, or the first of the usual ones (which is said)."""
    columns = list(table.columns)
    if asked is None:
        lower = {c.lower(): c for c in reversed(columns)}
        found = next((lower[name] for name in USUAL_COLUMNS if name in lower), None)
        if found is None:
            raise InputError(
                f"{path} has none of the columns {', '.join(USUAL_COLUMNS)} ({_listing(columns)}); give --thickness, "
                f"or thickness in the scene's table, as a number of metres, a column or a raster"
            )
        log.info(f"{path}: thickness is taken from column {found!r}")
        return found
    if asked in columns:
        return asked
    near = difflib.get_close_matches(asked, columns, 1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise InputError(
        f"--thickness {asked!r} is no number, no raster and no column of {path}; {hint}{_listing(columns)}"
    )


def _listing(columns):
    return f"it has {', '.join(columns[:8])}" if columns else "it has no columns"


def repaired(shape, name, path):
    """`shape` as valid areas; a repair is said with the areas before and after."""
    if not shapely.is_valid(shape):
        reason = shapely.is_valid_reason(shape).split("[")[0].strip().lower()
        fixed = polygons_only(_make_valid(shape))
        log.info(f"{path}: '{name}' was invalid ({reason}) and is repaired; its area is {fixed.area:.6g} m2")
        shape = fixed
    if shape.is_empty or shape.area <= 0:
        raise InputError(f"{path}: '{name}' has no area; draw it anew, or remove it")
    return shape


def _make_valid(shape):
    """GEOS's repair that unites overlapping parts (the other method would cut them out as holes)."""
    try:
        return shapely.make_valid(shape, method="structure", keep_collapsed=False)
    except TypeError:  # shapely before 2.1 knows only the other method: unite part by part
        parts = [shapely.make_valid(part) for part in shapely.get_parts(shape)]
        return shapely.union_all(parts)


def to_terrain(shapes, crs, terrain, path):
    """2D shapes in the terrain's CRS; reprojection and assumptions are said."""
    shapes = shapely.force_2d(shapes)
    target = terrain.grid.crs
    if crs is None or target is None:
        require_lies_on(shapely.total_bounds(shapes), crs, terrain, path)
        return list(shapes)
    if same_place(crs, target):
        return list(shapes)
    transformer = transformer_to(horizontal(pyproj.CRS(crs)), target, path)
    before = shapely.get_coordinates(shapes)
    after = np.column_stack(transformer.transform(*before.T))
    if not np.isfinite(after).all():
        unnamed = "; without a CRS inside, GeoJSON is in degrees" if Path(path).suffix in (".json", ".geojson") else ""
        raise GeoreferenceError(
            f"{path} is in {name_of(crs)} and cannot be brought to {name_of(target)}; check its CRS{unnamed}"
        )
    if np.abs(after - before).max() > _SAME_METRES:
        log.info(f"{path}: reprojected from {name_of(crs)} to {name_of(target)}, the terrain's CRS")
    return list(shapely.set_coordinates(shapes, after))


def transformer_to(crs, target, path):
    """pyproj's Transformer from `crs` to `target`, of what lies at `path`.

    Raises
    ------
    GeoreferenceError
        There is no way, as from another planet's.
    """
    try:
        return pyproj.Transformer.from_crs(crs, target, always_xy=True)
    except pyproj.exceptions.ProjError as error:
        raise GeoreferenceError(
            f"{path} is in {name_of(crs)} and cannot be brought to {name_of(target)}; check its CRS"
        ) from error


def require_lies_on(bounds, crs, terrain, path):
    """Without a CRS on one side the coordinates must lie on the terrain (that is said; else refused)."""
    grid = terrain.grid
    west, south, east, north = bounds
    apart = west > grid.bounds[2] or east < grid.bounds[0] or south > grid.bounds[3] or north < grid.bounds[1]
    if apart:
        small = max(abs(west), abs(east)) <= 360 and max(abs(south), abs(north)) <= 90
        degrees = " and look like degrees" if small else ""
        problem = "carries no CRS" if crs is None else f"is in {name_of(crs)}, the DTM in a local frame"
        raise GeoreferenceError(
            f"{path} {problem}, and its coordinates ({west:.6g}, {south:.6g}) do not lie on the DTM{degrees}; assign "
            f"its CRS (QGIS: Define projection), or use the frame of the DTM"
        )
    if crs is None and grid.crs is not None:
        log.info(f"{path} carries no CRS; its coordinates lie on the terrain, so {name_of(grid.crs)} is assumed")
    elif crs is not None:
        log.info(
            f"{path} is in {name_of(crs)}, the DTM in a local frame; its coordinates lie on the terrain and are used "
            "as they are"
        )


def with_crs_beside(path, open_terrain):
    """`open_terrain()`. Where its DTM carries no CRS, the refusal names that of the file `path` that lies on it.

    Raises
    ------
    MpmgisError
    """
    try:
        return open_terrain()
    except WithoutCRS as error:
        raise GeoreferenceError(f"{error}{_crs_that_may_do(path, error.bounds)}") from error


def _crs_that_may_do(path, bounds):
    """Words about the CRS of the file `path`; empty without an EPSG code in metres, or where it lies off `bounds`."""
    crs, lies = (None, None) if path is None else _crs_and_bounds(path)
    number = crs.to_epsg() if crs is not None else None
    if number is None or not all(axis.unit_name == "metre" for axis in crs.axis_info):
        return ""
    if lies[0] > bounds[2] or lies[2] < bounds[0] or lies[1] > bounds[3] or lies[3] < bounds[1]:
        return ""
    return f"; {path} lies on it in {name_of(crs)}: if the DTM is in that, too, --crs EPSG:{number}"


def _crs_and_bounds(path):
    """(pyproj.CRS or None, bounds) of a vector file or a raster; (None, None) of what cannot be read."""
    try:
        if is_raster(path):
            grid = read_raster(path)[1]
            return grid.crs, grid.bounds
        table = read_table(path)
    except MpmgisError:  # its own refusal comes once the DTM has a CRS
        return None, None
    return (table.crs, shapely.total_bounds(table.geometry)) if table.geometry is not None else (None, None)


# ---------------------------------------------------------------------------------------------------- raster sources


def is_raster(path):
    """True where GDAL reads `path` as a raster; files that may be both (GeoPackage) count as vector if they can."""
    text = str(path)
    if LAYER in text:
        return False
    path = Path(text)
    if path.suffix.lower() in _RASTER_SUFFIXES:
        return True
    require_undisguised(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if len(pyogrio().list_layers(path)):
                return False
    except Exception:  # not a vector file: the raster door says whether it is one
        pass
    try:
        with open_raster(path):
            return True
    except FormatError:
        return False


def _raster_features(path, terrain, wanted):
    """(one ReleasePart, its ThicknessRaster or None) from a release raster: a mask, or thickness per cell."""
    if wanted.column is not None:
        raise InputError(
            f"--thickness {wanted.column!r}: {path} is a raster and has no columns; give a number of metres or a raster"
        )
    values, grid = read_raster(path)
    grid = _grid_on_terrain(values, grid, terrain, path)
    inside = np.isfinite(values) & (values != 0)
    if not inside.any():
        raise InputError(f"{path}: no cell holds a value other than 0, wanted a mask or a thickness in metres")
    own, number = None, math.nan
    if wanted.number is not None:
        number = wanted.number
    elif wanted.raster is None:
        if set(np.unique(values[inside]).tolist()) == {1.0}:
            raise InputError(
                f"{path} holds only 0 and 1, which is a mask; give --thickness, or thickness in the scene's table, as "
                f"a number of metres or a raster"
            )
        _refuse_elevations(values, inside, grid, terrain, path)
        own = ThicknessRaster(_require_no_negative(np.where(inside, values, np.nan), path), grid)
        log.info(f"{path}: its values are taken as thickness in metres")
    return [ReleasePart(Path(path).stem, _outline(inside, grid), number)], own


def _refuse_elevations(values, inside, grid, terrain, path):
    """Refuse a release raster whose values are the elevations of the terrain under it: a DTM given by mistake."""
    x, y = grid.xy(*np.nonzero(inside))
    ground = terrain.sample(x, y)
    apart = np.abs(values[inside] - ground)
    least, most = values[inside].min(), values[inside].max()
    if np.isfinite(apart).any() and least > _ELEVATION and np.nanmedian(apart) < _NEAR_GROUND:
        raise InputError(
            f"{path} holds elevations as the DTM does ({least:.6g} to {most:.6g}), wanted a mask or a thickness in "
            "metres; the surface of the material belongs to --surface, with the release area beside it"
        )


def _outline(inside, grid):
    """The union of the pixel squares that are `inside` (design note D9: no contour through centres)."""
    shapes = rasterio.features.shapes(inside.astype(np.uint8), mask=inside, connectivity=4)
    pieces = [shapely.geometry.shape(shape) for shape, _ in shapes]
    whole = shapely.union_all(pieces)
    t = grid.transform
    return shapely.transform(
        whole, lambda p: np.column_stack((t.a * p[:, 0] + t.b * p[:, 1] + t.c, t.d * p[:, 0] + t.e * p[:, 1] + t.f))
    )


def _require_no_negative(values, path):
    with np.errstate(invalid="ignore"):
        bad = values < 0
    if bad.any():
        row, column = np.argwhere(bad)[0].tolist()
        raise InputError(
            f"{path}: thickness is {values[row, column]:g} in {int(bad.sum())} cells, the first in row {row}, column "
            f"{column}; wanted metres above 0; declare the nodata value (rio edit-info FILE --nodata N), or use "
            "--surface"
        )
    return values


def _thickness_raster(path, terrain):
    """The thickness raster at `path` on its own grid, expressed in the terrain's CRS; 0 and nodata are no material."""
    values, grid = read_raster(path)
    grid = _grid_on_terrain(values, grid, terrain, path)
    _require_no_negative(values, path)
    with np.errstate(invalid="ignore"):
        return ThicknessRaster(np.where(values > 0, values, np.nan), grid)


def _surface_thickness(path, terrain, features, record):
    """Surface minus bed on the finer of the two grids, clipped at 0; what was clipped under the release is said (D2).

    Pixels are cut into smaller ones before clipping, so that the material ends where surface and bed meet and not at
    the border of a pixel.
    """
    values, grid = read_raster(path)
    grid = _grid_on_terrain(values, grid, terrain, path)
    polygons = [part.polygon for part in features]
    finer = grid.cell_size <= terrain.grid.cell_size * (1 + 1e-9)
    rows, columns = around = _pixels_around(grid if finer else terrain.grid, shapely.total_bounds(polygons))
    if finer:
        thickness = values[around] - _bed_at(terrain, *grid.xy(*np.mgrid[around]))
    else:
        points = terrain.grid.xy(*np.mgrid[around])
        thickness, grid = bilinear(values, *grid.rowcol(*points)) - terrain.part(*around).elevation, terrain.grid
    whole = ThicknessRaster(thickness, grid.part(rows.start, columns.start, thickness.shape))
    under = rasterio.features.geometry_mask(polygons, whole.grid.shape, whole.grid.transform, invert=True)
    with np.errstate(invalid="ignore"):
        clipped = under & (whole.values < 0)
    count, volume = int(clipped.sum()), float(-whole.values[clipped].sum() * grid.cell_area)
    record.update(clipped_cells=count, clipped_volume=volume)
    if count:
        log.info(f"{path}: lies below the bed in {count} cells of the release; {volume:.4g} m3 clipped to thickness 0")
    fine = _finer(whole)
    with np.errstate(invalid="ignore"):
        return ThicknessRaster(np.where(fine.values > 0, fine.values, np.nan), fine.grid)


def _bed_at(terrain, x, y):
    """Elevation [m] at map points [m]; of a TerrainFile only the pixels around them are read."""
    rows, columns = terrain.grid.window((x.min(), y.min(), x.max(), y.max()), 2)
    row, column = terrain.grid.rowcol(x, y)
    return bilinear(terrain.part(rows, columns).elevation, row - rows.start, column - columns.start)


def _finer(raster):
    """`raster` with every pixel cut into up to 8 x 8, bilinear."""
    cut = int(np.clip(np.sqrt(_MOST_PIXELS / raster.values.size), 1, _SURFACE_CUT))
    rows, columns = (n * cut for n in raster.grid.shape)
    row, column = np.ogrid[:rows, :columns]
    values = bilinear(raster.values, (row + 0.5) / cut - 0.5, (column + 0.5) / cut - 0.5)
    transform = raster.grid.transform * Affine.scale(1 / cut)
    return ThicknessRaster(values, Grid(raster.grid.crs, transform, (rows, columns)))


def _where_thick(part, thickness):
    """`part` cut to the pixels that hold a thickness; what falls away is said."""
    near = _cropped(thickness, part.polygon.bounds)
    valid = np.isfinite(near.values)
    polygon = part.polygon
    if not valid.all():
        polygon = polygons_only(polygon.intersection(_outline(valid, near.grid)))
    elif not (corners := shapely.Polygon(near.grid.corners())).covers(polygon):
        polygon = polygons_only(polygon.intersection(corners))
    if polygon.is_empty or polygon.area <= 0:
        raise InputError(
            f"release '{part.name}' has zero thickness everywhere: the thickness raster holds nothing above 0 there"
        )
    lost = part.polygon.area - polygon.area
    if lost > 1e-9 * part.polygon.area:
        log.info(
            f"release '{part.name}': {lost:.4g} m2 ({100 * lost / part.polygon.area:.1f} %) without thickness are "
            "left out"
        )
    return ReleasePart(part.name, polygon, thickness)


def _cropped(thickness, bounds):
    """The part of a ThicknessRaster that meets `bounds` [m], one cell at least."""
    rows, columns = around = _pixels_around(thickness.grid, bounds)
    values = thickness.values[around]
    return ThicknessRaster(values, thickness.grid.part(rows.start, columns.start, values.shape))


def _pixels_around(grid, bounds):
    """(slice of rows, slice of columns) of the pixels whose values count in `bounds` [m], one at least."""
    west, south, east, north = bounds
    places = grid.rowcol(np.array([west, east, east, west]), np.array([south, south, north, north]))
    slices = []
    for place, size in zip(places, grid.shape, strict=True):
        first = int(np.clip(np.floor(place.min()) - 1, 0, size - 1))
        slices.append(slice(first, int(np.clip(np.ceil(place.max()) + 2, first + 1, size))))
    return tuple(slices)


def _grid_on_terrain(values, grid, terrain, path):
    """The raster's grid in the terrain's CRS; another CRS is met by the affine that fits it over the valued pixels."""
    target = terrain.grid.crs
    if grid.crs is None or target is None:
        require_lies_on(grid.bounds, grid.crs, terrain, path)
        return Grid(target, grid.transform, grid.shape)
    if same_place(grid.crs, target):
        return Grid(target, grid.transform, grid.shape)
    rows, columns = np.nonzero(np.isfinite(values) & (values != 0))
    if rows.size == 0:
        raise InputError(f"{path}: no cell holds a value other than 0")
    i = np.linspace(rows.min() - 0.5, rows.max() + 0.5, 9)
    j = np.linspace(columns.min() - 0.5, columns.max() + 0.5, 9)
    i, j = (a.ravel() for a in np.meshgrid(i, j))
    transformer = transformer_to(grid.crs, target, path)
    x, y = transformer.transform(*grid.xy(i, j))
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise GeoreferenceError(
            f"{path} is in {name_of(grid.crs)} and cannot be brought to {name_of(target)}; check its CRS"
        )
    design = np.column_stack((j + 0.5, i + 0.5, np.ones_like(i)))
    (a, d), (b, e), (c, f) = np.linalg.lstsq(design - [0, 0, 0], np.column_stack((x, y)), rcond=None)[0]
    placed = Grid(target, Affine(a, b, c, d, e, f), grid.shape)
    row, column = placed.rowcol(x, y)
    misfit = max(np.abs(row - i).max(), np.abs(column - j).max())
    if misfit > _AFFINE_PIXELS:
        code = target.to_epsg() or "n"
        raise GeoreferenceError(
            f"{path} is in {name_of(grid.crs)} and too large to be placed in {name_of(target)} without resampling; "
            f"reproject it: {warp_command(path, f'EPSG:{code}')}"
        )
    log.info(
        f"{path}: placed from {name_of(grid.crs)} in {name_of(target)}, the terrain's CRS (within {misfit:.2g} of a "
        "pixel)"
    )
    return placed
