"""Terrain: elevation on a grid, with its gradient, its terrain breaks and its value at any point."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy  # its parts are loaded when they are first used

from .grid import Grid

if TYPE_CHECKING:
    from .reprojection_record import Reprojection

BREAK_TANGENT = 1.0  # [1] one-sided slopes that differ by more than this in tan mark a cliff edge


@dataclass(frozen=True)
class Terrain:
    """A digital terrain model.

    Parameters
    ----------
    grid : Grid
    elevation : float64[rows, columns] [m]
        NaN where there is no data; the value of a pixel is that at its centre.
    path, sha256 : str
        File of the DTM and its digest; "" where unknown.
    reprojection : Reprojection, optional
        Where the file was in another CRS or its heights in another unit.
    """

    grid: Grid
    elevation: np.ndarray
    path: str = ""
    sha256: str = ""
    reprojection: "Reprojection | None" = None

    @cached_property
    def valid(self) -> np.ndarray:
        """Pixels with an elevation, bool[rows, columns]."""
        return np.isfinite(self.elevation)

    @cached_property
    def extremes(self) -> tuple[float, float]:
        """Lowest and highest elevation [m]; NaN without any."""
        return tuple(float(edge.reduce(self.elevation, axis=None)) for edge in (np.fmin, np.fmax))

    @cached_property
    def gradient(self) -> np.ndarray:
        """Gradient (db/dE, db/dN) [1] at pixel centres by central differences (NHESS Eq 4), float64[rows, columns, 2].

        One-sided to second order at the rim and first order next to nodata; both components NaN where one axis has
        no valid neighbour; 0 across a raster of a single row or column. Mapped by the inverse
        transpose of the pixel matrix, for any affine.
        """
        return self._map_gradient(*(_difference(self.elevation, axis) for axis in (1, 0)))

    @cached_property
    def limited_gradient(self) -> np.ndarray:
        """Gradient [1] as `gradient`, but with the smaller one-sided slope at a terrain break.

        A break is where the two one-sided slopes differ by more than BREAK_TANGENT.
        """
        pixel = [np.hypot(*self.grid.matrix[:, k]) for k in (0, 1)]
        return self._map_gradient(
            *(_difference(self.elevation, axis, BREAK_TANGENT * pixel[1 - axis]) for axis in (1, 0))
        )

    @cached_property
    def breaks(self) -> np.ndarray:
        """Pixels at a terrain break, where the one-sided slopes differ by more than 1, bool[rows, columns]."""
        different = self.gradient != self.limited_gradient
        return np.any(different & np.isfinite(self.gradient), axis=-1)

    def _map_gradient(self, d_column, d_row):
        inverse_transpose = np.linalg.inv(self.grid.matrix).T
        return np.stack([d_column, d_row], axis=-1) @ inverse_transpose.T

    def sample(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Interpolate the elevation [m] bilinearly at map points; NaN outside the raster or next to nodata.

        Within the outermost half pixel the outer two pixels are extended linearly, so that a plane stays a plane.

        Parameters
        ----------
        x, y : float64[...] [m]
        """
        row, column = self.grid.rowcol(x, y)
        return bilinear(self.elevation, row, column)

    def rows_on(self, grid: Grid, first: int, last: int) -> np.ndarray:
        """Return the elevation [m] at the centres of some rows of another grid.

        It is interpolated; next to nodata it is that of the pixel.

        Parameters
        ----------
        grid : Grid
        first, last : int
            The first row, and the row after the last one.

        Returns
        -------
        float64[last - first, columns] [m]
        """
        if (grid.transform, grid.shape) == (self.grid.transform, self.grid.shape):
            return self.elevation[first:last]
        row, column = np.meshgrid(np.arange(first, last), np.arange(grid.shape[1]), indexing="ij")
        x, y = grid.xy(row, column)
        between = self.sample(x, y)
        i, j = (np.floor(place + 0.5).astype(np.int64) for place in self.grid.rowcol(x, y))
        rows, columns = self.grid.shape
        on = (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
        own = np.where(on, self.elevation[np.where(on, i, 0), np.where(on, j, 0)], np.nan)
        return np.where(np.isfinite(between), between, own)

    def moved(self, east: float, north: float) -> "Terrain":
        """Return the same ground, moved horizontally; see `Grid.moved`.

        Parameters
        ----------
        east, north : float [m]
        """
        return replace(self, grid=self.grid.moved(east, north))

    def cropped(self, bounds: tuple[float, float, float, float], margin: int) -> "Terrain":
        """Return the Terrain of the pixels that meet `bounds` and some around.

        Parameters
        ----------
        bounds : (float, float, float, float) [m]
            West, south, east, north.
        margin : int [pixels]
            Added on every side.
        """
        return self.part(*self.grid.window(bounds, margin))

    def part(self, rows: slice, columns: slice) -> "Terrain":
        """Return the Terrain of a part of the pixels.

        Parameters
        ----------
        rows, columns : slice
        """
        elevation = self.elevation[rows, columns]
        return replace(self, grid=self.grid.part(rows.start, columns.start, elevation.shape), elevation=elevation)


def continued(elevation: np.ndarray, pad: int = 0, most: float = np.inf) -> np.ndarray:
    """Extend the ground with its slope to pixels without data, and beyond the rim.

    Each missing pixel is on the tangent plane of the nearest pixel with a known slope, so that a plane stays
    one, whatever its holes. Pixels with an elevation keep it.

    Parameters
    ----------
    elevation : float64[rows, columns] [m]
    pad : int [pixels]
        Added on every side.
    most : float [pixels]
        Along an axis; beyond it the ground is level.

    Returns
    -------
    float64[rows + 2 pad, columns + 2 pad] [m]
    """
    padded = np.pad(elevation, pad, constant_values=np.nan)
    known = np.isfinite(padded)
    if known.all() or not known.any():
        return padded
    slopes = [np.pad(_difference(elevation, axis), pad, constant_values=np.nan) for axis in (0, 1)]
    sloping = np.isfinite(slopes[0]) & np.isfinite(slopes[1])
    if not sloping.any():
        sloping, slopes = known, [np.zeros(padded.shape)] * 2
    nearest = scipy.ndimage.distance_transform_edt(~sloping, return_distances=False, return_indices=True)
    missing = np.nonzero(~known)
    source = tuple(axis[missing] for axis in nearest)
    rise = sum(
        slope[source] * np.clip(to - back, -most, most) for slope, to, back in zip(slopes, missing, source, strict=True)
    )
    padded[missing] = padded[source] + rise
    return padded


def bilinear(values: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Interpolate a raster bilinearly at fractional rows and columns; whole numbers are pixel centres.

    Linear extrapolation over the outermost half pixel; NaN beyond it and wherever one of the four pixels is NaN.

    Parameters
    ----------
    values : float[rows, columns]
    row, column : float64[...]
    """
    row, column = np.asarray(row, float), np.asarray(column, float)
    rows, columns = values.shape
    inside = (row >= -0.5) & (row <= rows - 0.5) & (column >= -0.5) & (column <= columns - 0.5)
    row, column = np.where(inside, row, 0.0), np.where(inside, column, 0.0)
    i = np.clip(np.floor(row), 0, max(rows - 2, 0)).astype(np.intp)
    j = np.clip(np.floor(column), 0, max(columns - 2, 0)).astype(np.intp)
    i1, j1 = np.minimum(i + 1, rows - 1), np.minimum(j + 1, columns - 1)
    fi, fj = row - i, column - j
    result = (values[i, j] * (1 - fi) + values[i1, j] * fi) * (1 - fj) + (
        values[i, j1] * (1 - fi) + values[i1, j1] * fi
    ) * fj
    return np.where(inside, result, np.nan)


def _difference(elevation: np.ndarray, axis: int, limit: float = np.inf) -> np.ndarray:
    """Return the difference per pixel step along `axis`: central inside, one-sided at the rim and next to nodata.

    Where the forward and backward differences differ by more than `limit` the one that is smaller in size is taken.
    (The min-mod limiter would take zero where they have opposite signs, and hide a ridge.)
    """
    z = np.moveaxis(elevation, axis, 0)
    n = z.shape[0]
    if n == 1:
        return np.where(np.isfinite(elevation), 0.0, np.nan)
    step = z[1:] - z[:-1]
    forward, backward = np.full(z.shape, np.nan), np.full(z.shape, np.nan)
    forward[:-1] = backward[1:] = step
    with np.errstate(invalid="ignore"):
        result = 0.5 * (forward + backward)
        smaller = np.where(np.abs(forward) < np.abs(backward), forward, backward)
        result = np.where(np.abs(forward - backward) > limit, smaller, result)
        if n > 2:  # second-order one-sided at the edge, unless there is a cliff one pixel further inside
            for rim, inner in ((0, 1), (-1, -2)):
                smooth = np.abs(step[rim] - step[inner]) <= limit
                result[rim] = np.where(smooth, 1.5 * step[rim] - 0.5 * step[inner], step[rim])
    result = np.where(np.isfinite(result), result, np.where(np.isfinite(forward), forward, backward))
    return np.moveaxis(np.where(np.isfinite(z), result, np.nan), 0, axis)
