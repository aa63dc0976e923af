"""Raster grids: the conversion between rows and columns and eastings and northings."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from affine import Affine


@dataclass(frozen=True)
class Grid:
    """A georeferenced raster grid: any invertible affine (north-up, south-up, rotated, non-square).

    Parameters
    ----------
    crs : pyproj.CRS or None
        Projected CRS in metres; None only for a local frame (`--crs local`).
    transform : affine.Affine
        Maps (column, row) of pixel *corners* to (x, y) [m]; pixel centres are at (column + 0.5, row + 0.5).
    shape : (int, int)
        Rows, columns.
    """

    crs: Any
    transform: "Affine"
    shape: tuple

    @classmethod
    def north_up(cls, crs, west, north, cell_size, shape):
        """A north-up square grid from its upper left corner (`west`, `north`) [m]."""
        from affine import Affine

        return cls(crs, Affine(cell_size, 0.0, west, 0.0, -cell_size, north), tuple(shape))

    @cached_property
    def matrix(self):
        """float64[2, 2]: columns are the map vectors of one step in column and one step in row [m]."""
        t = self.transform
        return np.array([[t.a, t.b], [t.d, t.e]], dtype=float)

    @cached_property
    def corner(self):
        """float64[2] [m]: map position of the raster's first corner (row 0, column 0)."""
        return np.array([self.transform.c, self.transform.f], dtype=float)

    @cached_property
    def axes(self):
        """float64[2, 3]: the inverse of `matrix`, rounded only once without rotation.

        Row 0 gives columns, row 1 rows: (first * east + second * north) / third, counted in cells from `corner`, of a
        place [m] from there.
        """
        t = self.transform
        if abs(t.a * t.e) >= abs(t.b * t.d):
            return np.array([[1.0, -t.b / t.e, t.a - t.b * t.d / t.e], [-t.d / t.a, 1.0, t.e - t.b * t.d / t.a]])
        return np.array([[-t.e / t.b, 1.0, t.d - t.a * t.e / t.b], [1.0, -t.a / t.d, t.b - t.a * t.e / t.d]])

    @property
    def is_rotated(self):
        """True where rows or columns do not run along east and north: rotated or sheared."""
        return self.transform.b != 0 or self.transform.d != 0

    @cached_property
    def sides(self):
        """(float, float) [m]: length of one step in column and of one step in row."""
        return tuple(np.hypot(*self.matrix).tolist())

    @cached_property
    def cell_area(self):
        """Plan area of one pixel [m2]."""
        return abs(float(np.linalg.det(self.matrix)))

    @cached_property
    def cell_size(self):
        """Side of the square with a pixel's area [m]."""
        return float(np.sqrt(self.cell_area))

    @cached_property
    def rounding(self):
        """Length [m] up to which map coordinates on this raster may differ by rounding alone.

        Four units in the last place of the largest coordinate of its corners: 4e-9 m at a northing of 5e6 m.
        """
        return 4.0 * float(np.spacing(np.abs(self.bounds).max()))

    def moved(self, east, north):
        """The same pixels, `east` and `north` [m] further; places near (0, 0) keep their digits there."""
        t = self.transform
        return Grid(self.crs, type(t)(t.a, t.b, t.c + east, t.d, t.e, t.f + north), self.shape)

    @property
    def is_north_up(self):
        """True where rows run south and columns east with square pixels."""
        t = self.transform
        return t.b == 0 and t.d == 0 and t.a > 0 and t.e < 0 and abs(t.a + t.e) <= 1e-9 * t.a

    def xy(self, row, column):
        """Map coordinates [m] of fractional (row, column), whole numbers being pixel *centres*."""
        t = self.transform
        column, row = np.asarray(column, float) + 0.5, np.asarray(row, float) + 0.5
        return t.a * column + t.b * row + t.c, t.d * column + t.e * row + t.f

    def rowcol(self, x, y):
        """Fractional (row, column) of map coordinates [m], whole numbers being pixel centres (NHESS Eq 2)."""
        t = self.transform
        dx, dy = np.asarray(x, float) - t.c, np.asarray(y, float) - t.f
        det = t.a * t.e - t.b * t.d
        return (t.a * dy - t.d * dx) / det - 0.5, (t.e * dx - t.b * dy) / det - 0.5

    def corners(self):
        """float64[4, 2]: map coordinates of the raster's four outer corners [m], in ring order."""
        rows, columns = self.shape
        x, y = self.xy(np.array([0, 0, rows, rows]) - 0.5, np.array([0, columns, columns, 0]) - 0.5)
        return np.stack([x, y], axis=-1)

    def pixel_range(self, bounds, margin=0):
        """((first row, first column), (row, column after the last)) of the pixels that meet `bounds` [m].

        `bounds` are (west, south, east, north); `margin` pixels more on each side, none beyond the raster; at least
        two along each axis where the raster has them. Bounds on a border of pixels, within rounding, do not meet the
        pixels beyond it.
        """
        west, south, east, north = bounds
        border = [0.5 + max(1e-9, self.rounding / side) for side in reversed(self.sides)]
        row, column = self.rowcol(np.array([west, east, east, west]), np.array([south, south, north, north]))
        first = [max(int(np.floor(v.min() + rim)) - margin, 0) for v, rim in zip((row, column), border, strict=True)]
        last = [
            min(int(np.ceil(v.max() + 1.0 - rim)) + margin, n)
            for v, n, rim in zip((row, column), self.shape, border, strict=True)
        ]
        return tuple(first), tuple(np.maximum(last, np.minimum(np.array(first) + 2, self.shape)).tolist())

    def window(self, bounds, margin=0):
        """(slice of rows, slice of columns) of the pixels that meet `bounds` [m], with `margin`; two along each axis.

        Bounds beyond the raster give the two pixels at its edge.
        """
        (i0, j0), (i1, j1) = self.pixel_range(bounds, margin)
        i0, j0 = (max(min(a, n - 2), 0) for a, n in zip((i0, j0), self.shape, strict=True))
        return slice(i0, i1), slice(j0, j1)

    def part(self, row, column, shape):
        """The grid of `shape` whose first pixel is pixel (row, column) of this one."""
        return Grid(self.crs, self.transform * self.transform.translation(int(column), int(row)), tuple(shape))

    @cached_property
    def bounds(self):
        """(west, south, east, north) [m] of the outer corners."""
        corners = self.corners()
        return (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())
