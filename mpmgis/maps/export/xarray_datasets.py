"""Open results as lazy xarray datasets with CRS and CF attributes; particles as GeoDataFrames.

Dimensions are (time, y, x), rows from north to south as in the rasters; NaN where a raster has nodata.
"""

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import geopandas
import numpy as np
import pyproj
import rioxarray  # noqa: F401  registers `.rio`, which carries the CRS
import shapely
import xarray

from ... import __version__
from ...frames.flow_end import DEPOSIT, LAST
from ...frames.headline_numbers import ERROR_TAG
from ...frames.particles import Frame
from ...laws.quantities import BAND, Quantity
from ...system.errors import FormatError, InputError
from ...terrain.dtm import require_heights
from ...terrain.elevation import Terrain
from ...terrain.georeference import require_metric
from ...terrain.grid import Grid
from ...terrain.raster_input import open_raster
from ...terrain.raster_output import NAMESPACE, SparseBands
from ...terrain.undeclared_nodata import HEIGHTS, mask_undeclared
from ..averaging.exported_folder import read_part
from ..averaging.exported_steps import open_steps

if TYPE_CHECKING:
    from ..averaging.frame_values import FrameValues

BLOCK = 2048  # [cells] rows and columns that are read at once
ELEVATION = Quantity("elevation", "m", "terrain elevation", "float32")
END_TAGS = ("came_to_rest", "still_moving")  # of the maxima and the last step, copied to the dataset
TAGS = ("digest", "dem", "density", "min_depth", "bed", "percentile", ERROR_TAG)  # of the steps, copied to the dataset
_TIME = {"units": "s", "long_name": "time since the start of the run", "axis": "T"}
_PACKED = {"zlib": True, "complevel": 4, "dtype": "float32"}  # encoding in NetCDF


def particle_table(frame: Frame) -> geopandas.GeoDataFrame:
    """Return a table of a frame's particles, one point each.

    Parameters
    ----------
    frame : Frame
        With its particles in memory.

    Returns
    -------
    geopandas.GeoDataFrame
        With x, y, z [m] (z of a column is its bed), u, v, w [m s-1], mass [kg], volume [m3], ...

    Raises
    ------
    InputError
        Not a Frame, or without particles.
    """
    if not isinstance(frame, Frame) or frame.particles is None:
        raise InputError(f"got {type(frame).__name__}, expected a Frame with its particles (mpmgis.read_frame)")
    arrays = frame.particles.arrays()
    x, y = frame.map_xy()
    columns = {name: arrays.pop(name) for name in ("id", "parent") if name in arrays}
    columns |= {"x": x, "y": y, "z": arrays["position"][:, 2] + frame.origin[2]}
    columns |= dict(zip("uvw", arrays["velocity"].T, strict=True))
    columns |= {name: values for name, values in arrays.items() if values.ndim == 1}
    return geopandas.GeoDataFrame(columns, geometry=shapely.points(x, y), crs=frame.crs)


def cell_table(dataset: xarray.Dataset, wet: str = "h") -> geopandas.GeoDataFrame:
    """Return a table of the cells with flow: squares, one table column per band.

    Parameters
    ----------
    dataset : xarray.Dataset
        Without a time dimension (select one time: `.isel(time=-1)`).
    wet : str
        Band that is above 0 in cells with flow.

    Raises
    ------
    InputError
        A time dimension, or no band `wet`.
    """
    if "time" in dataset.dims:
        raise InputError("the dataset has a time dimension; select one time, for example dataset.isel(time=-1)")
    if wet not in dataset:
        raise InputError(f"the dataset has no {wet!r}, only {', '.join(map(str, dataset.data_vars))}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        row, column = np.nonzero(np.asarray(dataset[wet]) > 0)
    t = dataset.rio.transform()
    west, north = t.c + t.a * column, t.f + t.e * row
    bands = {str(name): np.asarray(band)[row, column] for name, band in dataset.data_vars.items() if band.ndim == 2}
    return geopandas.GeoDataFrame(
        bands, geometry=shapely.box(west, north + t.e, west + t.a, north), crs=dataset.rio.crs
    )


def gridded(grid: Grid, variables: dict, times: Sequence | None = None, **attributes: object) -> xarray.Dataset:
    """Put arrays on a grid into a dataset.

    Parameters
    ----------
    grid : Grid
    variables : dict of str to (Quantity, array)
        Each [time, rows, columns] or [rows, columns].
    times : sequence of float [s], optional
    **attributes
        Of the dataset.

    Returns
    -------
    xarray.Dataset
        With x, y [m] of the cell centres, time [s] and, where the grid has a CRS, `spatial_ref` with the affine
        transform as GeoTransform. A rotated grid has the centres xc, yc [y, x] as in rioxarray, because its rows and
        columns have no common x and y.
    """
    coordinates = _centres(grid)
    if times is not None:
        coordinates["time"] = ("time", np.asarray(times, float), _TIME)
    dataset = xarray.Dataset(
        {name: _variable(quantity, values) for name, (quantity, values) in variables.items()},
        coordinates,
        {"Conventions": "CF-1.8", "source": f"mpmgis {__version__}", **attributes},
    )
    if grid.crs is not None:
        dataset = dataset.rio.write_crs(grid.crs.to_wkt())
    dataset = dataset.rio.write_transform(grid.transform)
    return dataset if grid.is_rotated else dataset.rio.write_coordinate_system()


def _centres(grid):
    """Coordinates of the cells' centres [m] by name."""
    rows, columns = grid.shape
    if not grid.is_rotated:
        return {"y": grid.xy(np.arange(rows), 0)[1], "x": grid.xy(0, np.arange(columns))[0]}
    x, y = grid.xy(*np.indices(grid.shape))
    return {
        f"{axis}c": (("y", "x"), values, {"units": "m", "standard_name": f"projection_{axis}_coordinate"})
        for axis, values in (("x", x), ("y", y))
    }


def _variable(quantity, values):
    dimensions = ("time", "y", "x")[3 - values.ndim :]
    return xarray.Variable(
        dimensions, values, {"units": quantity.unit, "long_name": quantity.long_name}, encoding=dict(_PACKED)
    )


def _lazy(function, **options):
    """dask.array.map_blocks of a function without arrays."""
    import dask.array  # 0.1 s; not needed for values in memory

    return dask.array.map_blocks(function, **options)


def averaged_steps(count: int, quantities: list, grid: Grid, frame_values: Callable) -> dict:
    """Return bands of steps that are averaged on access.

    Parameters
    ----------
    count : int
        Number of steps.
    quantities : list of (Quantity, float)
        Averaged quantity, and its value in cells without particles.
    grid : Grid
    frame_values : callable
        `frame_values(step)` returns a FrameValues with these quantities.

    Returns
    -------
    dict of str to (Quantity, float32[count, rows, columns])
        By name; the arrays are lazy.
    """
    rows, columns = grid.shape
    stack = _lazy(
        _averaged_block,
        chunks=((1,) * count, (len(quantities),), (rows,), (columns,)),
        dtype=np.float32,
        meta=np.empty((0, 0, 0, 0), np.float32),
        quantities=quantities,
        grid=grid,
        frame_values=frame_values,
    )
    return {quantity.name: (quantity, stack[:, k]) for k, (quantity, _) in enumerate(quantities)}


def _averaged_block(quantities, grid, frame_values, block_info=None):
    values = frame_values(block_info[None]["array-location"][0][0])
    return averaged_bands(quantities, grid, values)[np.newaxis]


def averaged_step(quantities: list, grid: Grid, values: "FrameValues") -> dict:
    """Return the bands of one step.

    Parameters
    ----------
    quantities : list of (Quantity, float)
    grid : Grid
        Both as in `averaged_steps`.
    values : FrameValues

    Returns
    -------
    dict of str to (Quantity, float32[1, rows, columns])
        By name.
    """
    bands = averaged_bands(quantities, grid, values)
    return {quantity.name: (quantity, bands[k : k + 1]) for k, (quantity, _) in enumerate(quantities)}


def averaged_bands(quantities: list, grid: Grid, values: "FrameValues") -> np.ndarray:
    """Put the cell values of a step on the grid.

    Parameters
    ----------
    quantities : list of (Quantity, float)
    grid : Grid
        Both as in `averaged_steps`.
    values : FrameValues

    Returns
    -------
    float32[bands, rows, columns]
    """
    bands = [(values.values[quantity.name], empty) for quantity, empty in quantities]
    rows_of = SparseBands(grid, values.index, bands)
    return np.stack([rows_of(band, 0, grid.shape[0]) for band in range(len(bands))])


def computed_bands(quantities: list, grid: Grid, compute: Callable) -> dict:
    """Return bands that are computed together on first access.

    Parameters
    ----------
    quantities : list of Quantity
    grid : Grid
    compute : callable
        `compute()` returns name -> float32[rows, columns].

    Returns
    -------
    dict of str to (Quantity, float32[rows, columns])
        By name; the arrays are lazy.
    """
    stack = _lazy(
        _computed_block,
        chunks=((len(quantities),), *((length,) for length in grid.shape)),
        dtype=np.float32,
        meta=np.empty((0, 0, 0), np.float32),
        names=[quantity.name for quantity in quantities],
        compute=compute,
    )
    return {quantity.name: (quantity, stack[k]) for k, quantity in enumerate(quantities)}


def _computed_block(names, compute):
    values = compute()
    return np.stack([values[name] for name in names])


def open_export(folder: str | Path) -> xarray.Dataset:
    """Open an export folder: bands of the steps, maxima, last step and terrain, all lazy.

    Parameters
    ----------
    folder : str or Path

    Raises
    ------
    FormatError, InputError
        As `open_steps`; rasters on different grids.
    """
    steps = open_steps(folder)
    first, shape = steps.files[0], steps.grid.shape
    variables = {
        quantity.name: (quantity, _lazy_bands(steps.files, band, shape)) for band, quantity in _bands(first, steps.grid)
    }
    for path in steps.files[1:]:
        _bands(path, steps.grid)
    about = {key: steps.tags[key] for key in TAGS if key in steps.tags}
    for kind, suffix in (("max", ""), (DEPOSIT, f"_{DEPOSIT}"), (LAST, f"_{LAST}")):
        path = first.with_name(f"{steps.name}_{kind}.tif")
        if not path.exists():
            continue
        for band, quantity in _bands(path, steps.grid):
            variables[quantity.name + suffix] = quantity, _lazy_bands([path], band, shape)[0]
        with open_raster(path) as source:
            tags = source.tags(ns=NAMESPACE)
        about |= {key: tags[key] for key in END_TAGS if key in tags}
    if steps.terrain.exists():
        _bands(steps.terrain, steps.grid)
        variables[ELEVATION.name] = ELEVATION, _lazy_bands([steps.terrain], 1, shape)[0]
    return gridded(steps.grid, variables, steps.times, title=steps.name, **about)


def _bands(path, grid):
    """(number, Quantity) of each band of a raster on `grid`, by its description `NAME [unit]`."""
    with open_raster(path) as source:
        if source.shape != tuple(grid.shape) or source.transform != grid.transform:
            raise FormatError(f"{path} has another grid than the other steps; export again")
        described = [(band, text or f"band_{band}") for band, text in enumerate(source.descriptions, start=1)]
    return [(band, _quantity(text)) for band, text in described]


def _quantity(text):
    name, _, unit = text.partition(" [")
    return BAND.get(name) or Quantity(name, unit.rstrip("]") or "1", name, "float32")


def _lazy_bands(paths, band, shape):
    """Lazy float32[files, rows, columns] of one band of rasters of one shape."""
    rows, columns = (_cut(length) for length in shape)
    return _lazy(
        _read_block,
        chunks=((1,) * len(paths), rows, columns),
        dtype=np.float32,
        meta=np.empty((0, 0, 0), np.float32),
        paths=tuple(map(str, paths)),
        band=band,
    )


def _cut(length):
    whole, rest = divmod(length, BLOCK)
    return (BLOCK,) * whole + ((rest,) if rest else ())


def _read_block(paths, band, block_info=None):
    (step, _), *window = block_info[None]["array-location"]
    with open_raster(paths[step]) as source:
        return read_part(source, band, tuple(slice(*part) for part in window))[np.newaxis]


def grid_of(band: xarray.DataArray) -> Grid:
    """Return the Grid of a variable with the georeference of rioxarray.

    Parameters
    ----------
    band : xarray.DataArray
        [y, x], after length-one dimensions are dropped.
    """
    band = band.squeeze(drop=True)
    crs = None if band.rio.crs is None else pyproj.CRS.from_wkt(band.rio.crs.to_wkt())
    return Grid(crs, band.rio.transform(), band.shape)


def terrain_of(array: xarray.DataArray) -> Terrain:
    """Return the terrain in an array of elevations with the georeference of rioxarray.

    Parameters
    ----------
    array : xarray.DataArray [m]
        Dimensions y and x.

    Raises
    ------
    InputError, GeoreferenceError
        Another type, not two dimensions, not in metres, impossible elevations.
    """
    name = "the DTM given"
    if not isinstance(array, xarray.DataArray):
        raise InputError(f"dem is {type(array).__name__}, expected a path, a Terrain or an xarray.DataArray")
    array = array.squeeze(drop=True)
    if array.ndim != 2:
        raise InputError(f"dem has the dimensions {', '.join(map(str, array.dims))}, expected y and x; select one band")
    elevation = np.asarray(array, float)
    if array.rio.nodata is not None:
        elevation = np.where(elevation == array.rio.nodata, np.nan, elevation)
    grid = grid_of(array)
    if grid.crs is not None:
        require_metric(grid.crs, grid.bounds, name)
    elevation = np.where(np.isfinite(elevation), elevation, np.nan)
    mask_undeclared(elevation, name, HEIGHTS)
    require_heights(elevation, name)
    return Terrain(grid, elevation, path=name)
