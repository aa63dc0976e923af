"""Particles and cells as GeoDataFrames."""

import warnings

import geopandas
import numpy as np
import shapely

from ..errors import InputError
from ..particles import Frame


def particle_table(frame):
    """GeoDataFrame of a Frame's particles: points with x, y, z [m], u, v, w [m s-1], mass [kg], volume [m3], ...

    `frame` is one in memory; a column's z is its bed.
    """
    if not isinstance(frame, Frame) or frame.particles is None:
        raise InputError(f"got {type(frame).__name__}, wanted a Frame with its particles (mpmgis.read_frame)")
    arrays = frame.particles.arrays()
    x, y = frame.map_xy()
    columns = {name: arrays.pop(name) for name in ("id", "parent") if name in arrays}
    columns |= {"x": x, "y": y, "z": arrays["position"][:, 2] + frame.origin[2]}
    columns |= dict(zip("uvw", arrays["velocity"].T, strict=True))
    columns |= {name: values for name, values in arrays.items() if values.ndim == 1}
    return geopandas.GeoDataFrame(columns, geometry=shapely.points(x, y), crs=frame.crs)


def cell_table(dataset, wet="h"):
    """GeoDataFrame of a Dataset's cells, squares with a column a band; only those where `wet` is above 0.

    `dataset` has no dimension of time (take one: `.isel(time=-1)`).
    """
    if "time" in dataset.dims:
        raise InputError("the dataset has times; take one of them, for example dataset.isel(time=-1)")
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
