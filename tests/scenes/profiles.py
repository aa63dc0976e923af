"""Exported rasters along a line and on a map, for the pictures on the scenes' pages.

Matplotlib is drawn on by object (`Figure`), so that nothing here needs a screen or leaves a figure open.
"""

from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
import rasterio
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

DPI = 110
LARGEST = 300_000  # [bytes] of a picture on a page
TAGS = "mpmgis"  # namespace of the tags of an export


class Step(NamedTuple):
    """One exported step."""

    time: float  # [s]
    path: Path


def steps(folder):
    """The steps of the export in `folder`, in order of time."""
    found = []
    for path in sorted((Path(folder) / "rasters").glob("*_[0-9]*.tif")):
        with rasterio.open(path) as source:
            found.append(Step(float(source.tags(ns=TAGS)["time"]), path))
    return sorted(found)


def step_at(folder, time):
    """The exported step nearest to `time` [s]."""
    return min(steps(folder), key=lambda step: abs(step.time - time))


def maxima(folder):
    """Path of the export's extremes over all frames."""
    return one(folder, "*_max.tif")


def deposit(folder):
    """Path of the export's last step: its deposit, or that of a flow that did not come to rest."""
    names = ("*_deposit.tif", "*_last.tif")
    return one(folder, next(name for name in names if any((Path(folder) / "rasters").glob(name))))


def one(folder, pattern):
    """The only raster of the export in `folder` that has a name like `pattern`."""
    (path,) = (Path(folder) / "rasters").glob(pattern)
    return path


def bands(path, *names):
    """(the named bands as float64[rows, columns] with NaN for nodata, all of them if none is named; their transform).

    Bands are described as `NAME [unit]`; answers a dict by NAME.
    """
    with rasterio.open(path) as source:
        order = {str(text).split(" ")[0]: k for k, text in enumerate(source.descriptions, 1)}
        read = {name: source.read(order[name], masked=True).astype(float).filled(np.nan) for name in names or order}
        return read, source.transform


def cells_along(path, start, end, step, *names):
    """(distance from `start` [m], band -> values) of the cells under places `step` [m] apart on a line of the map.

    NaN off the raster; cells are not interpolated, as a profile in a GIS reads them.
    """
    read, transform = bands(path, *names)
    start, end = np.asarray(start, float), np.asarray(end, float)
    length = float(np.hypot(*(end - start)))
    distance = (np.arange(int(length / step)) + 0.5) * step
    x, y = start[:, None] + (end - start)[:, None] / length * distance
    column = np.floor((x - transform.c) / transform.a).astype(int)  # exports are north-up
    row = np.floor((y - transform.f) / transform.e).astype(int)
    values = {}
    for name, band in read.items():
        inside = (row >= 0) & (row < band.shape[0]) & (column >= 0) & (column < band.shape[1])
        values[name] = np.full(len(distance), np.nan)
        values[name][inside] = band[row[inside], column[inside]]
    return distance, values


def picture(rows=1, columns=1, size=(9.0, 6.0), **options):
    """(Figure, axes[rows, columns])."""
    figure = Figure(figsize=size, dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def save(figure, path):
    """Write `figure` as PNG of at most LARGEST bytes: fewer colours, before fewer pixels."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=DPI, metadata={"Software": None})
    if path.stat().st_size > LARGEST:
        from PIL import Image

        Image.open(path).convert("RGB").quantize(160).save(path, optimize=True)
    if path.stat().st_size > LARGEST:
        raise ValueError(f"{path} has {path.stat().st_size} bytes, wanted at most {LARGEST}")
    print(f"{path}: {path.stat().st_size / 1e3:.0f} kB", flush=True)


def hillshade(elevation, cell, azimuth=315.0, altitude=45.0):
    """float[rows, columns] 0 to 1: how light ground looks, its first row in the north."""
    south, east = np.gradient(elevation, cell)
    slope, aspect = np.arctan(np.hypot(south, east)), np.arctan2(-east, south)  # of the way down, from north
    zenith, sun = np.radians(90.0 - altitude), np.radians(azimuth)
    light = np.cos(zenith) * np.cos(slope) + np.sin(zenith) * np.sin(slope) * np.cos(sun - aspect)
    return np.clip(light, 0.0, 1.0)


def extent_of(transform, shape, origin=(0.0, 0.0)):
    """[west, east, south, north] of a raster, counted from `origin`, as matplotlib wants it."""
    rows, columns = shape
    west, north = transform.c - origin[0], transform.f - origin[1]
    return [west, west + columns * transform.a, north + rows * transform.e, north]


def ground(axis, dem, origin=(0.0, 0.0)):
    """Draw the terrain as hillshade; map coordinates are counted from `origin`."""
    with rasterio.open(dem) as source:
        elevation, transform = source.read(1).astype(float), source.transform
    shade = hillshade(elevation, transform.a)
    axis.imshow(0.35 + 0.65 * shade, cmap="gray", vmin=0, vmax=1, extent=extent_of(transform, shade.shape, origin))
    axis.set_aspect("equal")


def layer(axis, path, name, label, origin=(0.0, 0.0), low=None, high=None, cmap="viridis", above=None):
    """Draw the band `name` of a raster over what is there, with its colour bar; values up to `above` stay clear."""
    read, transform = bands(path, name)
    values = read[name] if above is None else np.where(read[name] > above, read[name], np.nan)
    image = axis.imshow(
        values,
        cmap=matplotlib.colormaps[cmap],
        vmin=low,
        vmax=high,
        extent=extent_of(transform, values.shape, origin),
        interpolation="nearest",
    )
    axis.figure.colorbar(image, ax=axis, label=label, shrink=0.9, pad=0.01)
    return image


def view(axis, box):
    """Show [west, east, south, north] only."""
    axis.set_xlim(box[0], box[1])
    axis.set_ylim(box[2], box[3])
