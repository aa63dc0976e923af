"""Terrain: elevation on a grid, with its gradient, its normal and its value at any point.

Cells without elevation: holes inside the DTM, and the nodata collar that extends to its edge.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy  # its parts are loaded when they are first used

from .grid import Grid

if TYPE_CHECKING:
    from .reprojection import Reprojection

BREAK_TANGENT = 1.0  # one-sided slopes that differ by more than this in tan mark a cliff edge


@dataclass(frozen=True)
class Terrain:
    """A digital terrain model.

    Parameters
    ----------
    grid : Grid
    elevation : float64[rows, columns] [m]
        NaN where there is no data; the value of a pixel is that at its centre.
    path, sha256 : str
        Where it came from and the digest of that file; '' where unknown.
    reprojection : Reprojection, optional
        How it came to its CRS and to metres, where that was asked for.
    """

    grid: Grid
    elevation: np.ndarray
    path: str = ""
    sha256: str = ""
    reprojection: "Reprojection | None" = None

    @cached_property
    def valid(self):
        """bool[rows, columns]: pixels with an elevation."""
        return np.isfinite(self.elevation)

    @cached_property
    def gradient(self):
        """float64[rows, columns, 2]: (db/dE, db/dN) at pixel centres by central differences (NHESS Eq 4).

        One-sided to second order at the rim and first order next to nodata; both components NaN where one axis has
        no valid neighbour; 0 across a raster of a single row or column. Mapped by the inverse
        transpose of the pixel matrix, for any affine.
        """
        return self._map_gradient(*(_difference(self.elevation, axis) for axis in (1, 0)))

    @cached_property
    def limited_gradient(self):
        """As `gradient`, but with the smaller one-sided slope where the two differ by more than 1 in tan."""
        pixel = [np.hypot(*self.grid.matrix[:, k]) for k in (0, 1)]
        return self._map_gradient(
            *(_difference(self.elevation, axis, BREAK_TANGENT * pixel[1 - axis]) for axis in (1, 0))
        )

    @cached_property
    def breaks(self):
        """bool[rows, columns]: pixels at a terrain break, where the one-sided slopes differ by more than 1."""
        different = self.gradient != self.limited_gradient
        return np.any(different & np.isfinite(self.gradient), axis=-1)

    def _map_gradient(self, d_column, d_row):
        inverse_transpose = np.linalg.inv(self.grid.matrix).T
        return np.stack([d_column, d_row], axis=-1) @ inverse_transpose.T

    def sample(self, x, y):
        """Bilinear elevation [m] at map points `x`, `y` [m] (any shape); NaN outside the raster or next to nodata.

        Within the outermost half pixel the outer two pixels are extended linearly, so that a plane stays a plane.
        """
        row, column = self.grid.rowcol(x, y)
        return bilinear(self.elevation, row, column)

    def rows_on(self, grid, first, last):
        """Elevation [m] at the centres of some rows of `grid`: interpolated, or next to nodata that of the pixel."""
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

    def moved(self, east, north):
        """The same ground `east` and `north` [m] further; see `Grid.moved`."""
        return replace(self, grid=self.grid.moved(east, north))

    def cropped(self, bounds, margin):
        """The Terrain of the pixels that meet `bounds` (west, south, east, north) [m] and `margin` pixels around."""
        return self.part(*self.grid.window(bounds, margin))

    def part(self, rows, columns):
        """The Terrain of two slices, of `rows` and of `columns`."""
        elevation = self.elevation[rows, columns]
        return replace(self, grid=self.grid.part(rows.start, columns.start, elevation.shape), elevation=elevation)


def continued(elevation, pad=0, most=np.inf):
    """`elevation` with `pad` more pixels on every side; without data the ground is extended with its slope.

    Each missing pixel is on the tangent plane of the nearest pixel with a known slope, so that a plane stays
    one, whatever its holes; beyond `most` pixels along an axis it is level. What has an elevation keeps it.
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


def bilinear(values, row, column):
    """Bilinear interpolation of `values` [rows, columns] at fractional `row`, `column` (whole = pixel centre).

    Linear extrapolation over the outermost half pixel; NaN beyond it and wherever one of the four pixels is NaN.
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


def _difference(elevation, axis, limit=np.inf):
    """Difference per pixel step along `axis`: central inside, one-sided at the rim and next to nodata.

    Where the forward and backward differences differ by more than `limit` the smaller one is taken (min-mod: zero
    where they have opposite signs would hide a ridge, so the smaller in size is kept).
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
