"""A flow along a line at some times (Vicari et al. 2025, NHESS 25:3897, Fig. 2h and i), and at points over time."""

from dataclasses import dataclass

import numpy as np

from ..fields import BAND

PROFILE_PRODUCTS = ("h", "t", "Un", "Ut")
SERIES_PRODUCTS = (*PROFILE_PRODUCTS, "p")
PLACE_COLUMNS = (("time", "s"), ("along", "m"), ("E", "m"), ("N", "m"), ("terrain", "m"), ("surface", "m"))
POINT_COLUMNS = (("E", "m"), ("N", "m"), ("time", "s"))


@dataclass(frozen=True)
class ProfileFound:
    """A flow along a line.

    Parameters
    ----------
    name : str
    along, x, y, terrain : float64[n] [m]
        Places on the line: distance from its start, position, elevation.
    times : float64[k] [s]
    surface : float64[k, n] [m]
        Elevation of the free surface.
    values : dict of str to float64[k, n]
        Products of the cell that each place lies in.
    files : tuple of Path
    """

    name: str
    along: np.ndarray
    x: np.ndarray
    y: np.ndarray
    terrain: np.ndarray
    times: np.ndarray
    surface: np.ndarray
    values: dict
    files: tuple = ()

    def columns(self):
        """(name, unit) of the columns of `rows`."""
        return (*PLACE_COLUMNS, *((name, BAND[name].unit) for name in self.values))

    def rows(self):
        """A row for each time and place."""
        for k, time in enumerate(self.times):
            numbers = (self.along, self.x, self.y, self.terrain, self.surface[k], *(v[k] for v in self.values.values()))
            yield from ((time, *row) for row in zip(*numbers, strict=True))


@dataclass(frozen=True)
class SeriesFound:
    """A flow at points over time.

    Parameters
    ----------
    name : str
    names : tuple of str
        Of the points.
    x, y : float64[n] [m]
    times : float64[k] [s]
    values : dict of str to float64[k, n]
        By product.
    files : tuple of Path
    """

    name: str
    names: tuple
    x: np.ndarray
    y: np.ndarray
    times: np.ndarray
    values: dict
    files: tuple = ()

    def columns(self):
        """(name, unit) of the columns of `rows`."""
        return (("point", ""), *POINT_COLUMNS, *((name, BAND[name].unit) for name in self.values))

    def rows(self):
        """A row for each point and time."""
        for point, name in enumerate(self.names):
            for k, time in enumerate(self.times):
                values = (values[k, point] for values in self.values.values())
                yield (name, self.x[point], self.y[point], time, *values)

    def arrival(self, point, min_depth):
        """First of the times [s] with at least `min_depth` [m] at a point's number; NaN where the flow never came."""
        deep = self.values["h"][:, point] >= min_depth
        return float(self.times[np.argmax(deep)]) if deep.any() else np.nan

    def peak(self, product, point):
        """(largest value, its time [s]) of a product at a point's number; NaN where it has none."""
        values = self.values[product][:, point]
        if not np.isfinite(values).any():
            return np.nan, np.nan
        k = int(np.nanargmax(values))
        return float(values[k]), float(self.times[k])


def free_surface(terrain, x, y, depth):
    """Elevation [m] of a flow's surface over map points: `depth` [m] is normal to the bed, the answer upright above it.

    Parameters
    ----------
    terrain : Terrain
    x, y : float[n] [m]
    depth : float[k, n] [m]

    Returns
    -------
    float64[k, n] [m]
    """
    row, column = (np.floor(place + 0.5).astype(np.int64) for place in terrain.grid.rowcol(x, y))
    rows, columns = terrain.elevation.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    slope = np.full((len(x), 2), np.nan)
    slope[inside] = terrain.limited_gradient[row[inside], column[inside]]
    return terrain.sample(x, y) + depth * np.sqrt(1.0 + (slope**2).sum(axis=1))
