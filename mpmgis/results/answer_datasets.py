"""Convert results of verbs to xarray datasets."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray

from ..laws.quantities import BAND
from .hydrograph_answer import HydrographFound
from .profile_answer import ProfileFound
from .timeseries_answer import SeriesFound
from .vertical_answer import PROFILE_COLUMNS, VerticalFound


def _bands(values: dict[str, Any], dims: tuple[str, str]) -> dict[str, Any]:
    return {
        name: (dims, value, {"units": BAND[name].unit, "long_name": BAND[name].long_name})
        for name, value in values.items()
    }


def _metres(dim: str, values: Any) -> tuple[str, Any, dict[str, str]]:
    return dim, values, {"units": "m"}


def _time(values: Any) -> tuple[str, Any, dict[str, str]]:
    return "time", values, {"units": "s"}


def _attributes(found: Any, **more: Any) -> dict[str, Any]:
    return {"title": found.name, "files": [str(Path(file)) for file in found.files], **more}


def profile_dataset(found: ProfileFound) -> xarray.Dataset:
    """Return products over (time, along).

    Parameters
    ----------
    found : ProfileFound

    Returns
    -------
    xarray.Dataset
    """
    places = {"elevation": found.terrain, "x": found.x, "y": found.y}
    variables = _bands(found.values, ("time", "along"))
    variables["surface"] = ("time", "along"), found.surface, {"units": "m"}
    coordinates = {name: _metres("along", values) for name, values in {"along": found.along, **places}.items()}
    return xarray.Dataset(variables, {"time": _time(found.times), **coordinates}, _attributes(found))


def series_dataset(found: SeriesFound) -> xarray.Dataset:
    """Return products over (time, point).

    Parameters
    ----------
    found : SeriesFound

    Returns
    -------
    xarray.Dataset
    """
    coordinates = {"point": list(found.names), "x": _metres("point", found.x), "y": _metres("point", found.y)}
    variables = _bands(found.values, ("time", "point"))
    return xarray.Dataset(variables, {"time": _time(found.times), **coordinates}, _attributes(found))


def hydrograph_dataset(found: HydrographFound) -> xarray.Dataset:
    """Return volume and mass of each interval, at the time of its end.

    Parameters
    ----------
    found : HydrographFound

    Returns
    -------
    xarray.Dataset
    """
    variables = {
        "volume": ("time", found.volume, {"units": "m3"}),
        "mass": ("time", found.mass, {"units": "kg"}),
        "by_particles": ("time", found.by_particles),
        "begin": ("time", found.times[:-1], {"units": "s"}),
    }
    return xarray.Dataset(variables, {"time": _time(found.times[1:])}, _attributes(found, azimuth=found.azimuth))


def vertical_dataset(found: VerticalFound) -> xarray.Dataset:
    """Return the table of layers, a row for each layer of a profile.

    Parameters
    ----------
    found : VerticalFound

    Returns
    -------
    xarray.Dataset
    """
    columns = list(zip(*found.rows(), strict=True)) or [()] * len(PROFILE_COLUMNS)
    variables = {
        name: ("row", np.array(values), {"units": unit})
        for (name, unit), values in zip(PROFILE_COLUMNS, columns, strict=True)
    }
    return xarray.Dataset(variables, attrs=_attributes(found, width=found.width))
