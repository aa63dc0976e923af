"""Draw a variable of results as a map, with the colours, classes and hillshade of reports and QGIS."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray

from ...laws.quantities import Quantity
from ...system.errors import InputError
from ...terrain.dtm import read_terrain
from ...terrain.elevation import Terrain
from ..averaging.averaging_options import USUAL_DEPTH
from ..qgis.colours import LOOKS, Look, look_of
from .band_map import draw_band, floor_of
from .run_picture import classes_of, classes_up_to, draw_scale_and_north, fit_axes, map_axes, map_view
from .xarray_datasets import grid_of, terrain_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_band(
    band: xarray.DataArray,
    terrain: str | Path | Terrain | xarray.DataArray | None = None,
    title: str = "",
    release: str | Path | None = None,
    min_depth: float = USUAL_DEPTH,
    like: xarray.DataArray | None = None,
    axes: "Axes | None" = None,
    legend: bool = True,
) -> "Axes":
    """Draw a variable as a map.

    Parameters
    ----------
    band : xarray.DataArray
        [y, x].
    terrain : path, Terrain or DataArray, optional [m]
        For the hillshade and contours; None: neither.
    title : str
    release : path, optional
        Polygons of the release, drawn as outlines.
    min_depth : float [m]
        Depths up to this are not drawn.
    like : DataArray, optional
        Variable whose values choose the view and the classes; None: the band's.
    axes : matplotlib.axes.Axes, optional
        To draw in; None: a new figure.
    legend : bool
        With legend, right of the map; a new figure also has scale bar and north arrow there.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        Not a variable of one time.
    """
    values, grid = _values_of(band), grid_of(band)
    shown, shown_grid = (values, grid) if like is None else (_values_of(like), grid_of(like))
    ground = terrain if isinstance(terrain, Terrain) else None
    if ground is None and terrain is not None:
        ground = read_terrain(terrain) if isinstance(terrain, str | Path) else terrain_of(terrain)
    around = Terrain(grid, np.zeros(grid.shape)) if ground is None else ground
    look = _look(band)
    floor = floor_of(look, min_depth)
    outlines = []
    if release is not None:
        from ...seeding.release_areas import read_outlines  # imports GDAL's vector library, not needed for rasters

        outlines = read_outlines(release, around)
    with np.errstate(invalid="ignore"):
        view = map_view(around, shown_grid, shown > floor, outlines)
    if axes is None:
        from matplotlib import pyplot

        axes = map_axes(pyplot.figure(), view)
        if legend:
            draw_scale_and_north(axes, view)
    else:
        fit_axes(axes, view)
    classes = classes_of(shown, look, floor)
    entries = classes_up_to(shown, classes) if legend else None
    draw_band(axes, view, ground, grid, values, look, classes, title, release=outlines, legend=entries)
    return axes


def _values_of(band):
    """float64[rows, columns] of a variable of one time."""
    if not isinstance(band, xarray.DataArray):
        raise InputError(f"plot got {type(band).__name__}, expected one variable of results, for example results.h_max")
    band = band.squeeze(drop=True)
    if band.ndim != 2:
        dimensions = ", ".join(map(str, band.dims))
        raise InputError(
            f"{band.name} has the dimensions {dimensions}, expected y and x; select one time, for example "
            "results.h.sel(time=10)"
        )
    return np.asarray(band, float)


def _look(band: xarray.DataArray) -> Look:
    name = str(band.name)
    unit, words = str(band.attrs.get("units", "")), str(band.attrs.get("long_name", name))
    return LOOKS[name] if name in LOOKS else look_of(Quantity(name, unit, words))
