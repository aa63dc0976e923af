"""Raster grids: the conversion between rows and columns and eastings and northings."""

from dataclasses import dataclass, replace
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
        Maps (column, row) of pixel *corners* to (x, y) [m]; pixel centres are at (column + 0.5, row + 0.5). Solvers
        need only the six numbers a to f: a NamedTuple of them is enough where affine is not installed.
    shape : (int, int)
        Rows, columns.
    """

    crs: Any
    transform: "Affine"
    shape: tuple

    @classmethod
    def north_up(cls, crs: Any, west: float, north: float, cell_size: float, shape: tuple[int, int]) -> "Grid":
        """Return a north-up grid of square cells from its upper left corner.

        Parameters
        ----------
        crs : pyproj.CRS or None
        west, north : float [m]
        cell_size : float [m]
        shape : (int, int)
            Rows, columns.
        """
        from affine import Affine  # the solvers run without it

        return cls(crs, Affine(cell_size, 0.0, west, 0.0, -cell_size, north), tuple(shape))

    @cached_property
    def matrix(self) -> np.ndarray:
        """Map vectors [m] of one step in column and of one step in row, the columns of a float64[2, 2]."""
        t = self.transform
        return np.array([[t.a, t.b], [t.d, t.e]], dtype=float)

    @cached_property
    def corner(self) -> np.ndarray:
        """Map position [m] of the raster's first corner (row 0, column 0), float64[2]."""
        return np.array([self.transform.c, self.transform.f], dtype=float)

    @cached_property
    def axes(self) -> np.ndarray:
        """Inverse of `matrix`, rounded only once without rotation, float64[2, 3].

        Row 0 gives columns, row 1 rows: (first * east + second * north) / third, counted in cells from `corner`, of a
        place [m] from there.
        """
        t = self.transform
        if abs(t.a * t.e) >= abs(t.b * t.d):
            return np.array([[1.0, -t.b / t.e, t.a - t.b * t.d / t.e], [-t.d / t.a, 1.0, t.e - t.b * t.d / t.a]])
        return np.array([[-t.e / t.b, 1.0, t.d - t.a * t.e / t.b], [1.0, -t.a / t.d, t.b - t.a * t.e / t.d]])

    @property
    def is_rotated(self) -> bool:
        """Whether rows or columns do not run along east and north: rotated or sheared."""
        return self.transform.b != 0 or self.transform.d != 0

    @cached_property
    def sides(self) -> tuple[float, float]:
        """Length [m] of one step in column and of one step in row."""
        return tuple(np.hypot(*self.matrix).tolist())

    @cached_property
    def cell_area(self) -> float:
        """Plan area of one pixel [m2]."""
        return abs(float(np.linalg.det(self.matrix)))

    @cached_property
    def cell_size(self) -> float:
        """Side of the square with a pixel's area [m]."""
        return float(np.sqrt(self.cell_area))

    @cached_property
    def rounding(self) -> float:
        """Length [m] up to which map coordinates on this raster may differ by rounding alone.

        Four units in the last place of the largest coordinate of its corners: 4e-9 m at a northing of 5e6 m.
        """
        return 4.0 * float(np.spacing(np.abs(self.bounds).max()))

    def moved(self, east: float, north: float) -> "Grid":
        """Return the same pixels at another place; places near (0, 0) keep their digits there.

        Parameters
        ----------
        east, north : float [m]
            Of the move.
        """
        t = self.transform
        return replace(self, transform=type(t)(t.a, t.b, t.c + east, t.d, t.e, t.f + north))

    @property
    def is_north_up(self) -> bool:
        """Whether rows run south and columns east with square pixels."""
        t = self.transform
        return t.b == 0 and t.d == 0 and t.a > 0 and t.e < 0 and abs(t.a + t.e) <= 1e-9 * t.a

    def xy(self, row: np.ndarray, column: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Convert fractional rows and columns to map coordinates; whole numbers are pixel *centres*.

        Parameters
        ----------
        row, column : float64[...]

        Returns
        -------
        (float64[...], float64[...]) [m]
        """
        t = self.transform
        column, row = np.asarray(column, float) + 0.5, np.asarray(row, float) + 0.5
        return t.a * column + t.b * row + t.c, t.d * column + t.e * row + t.f

    def rowcol(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Convert map coordinates to fractional rows and columns; whole numbers are pixel centres (NHESS Eq 2).

        Parameters
        ----------
        x, y : float64[...] [m]

        Returns
        -------
        (float64[...], float64[...])
            Row, column.
        """
        t = self.transform
        dx, dy = np.asarray(x, float) - t.c, np.asarray(y, float) - t.f
        det = t.a * t.e - t.b * t.d
        return (t.a * dy - t.d * dx) / det - 0.5, (t.e * dx - t.b * dy) / det - 0.5

    def corners(self) -> np.ndarray:
        """Return the map coordinates [m] of the raster's four outer corners, in ring order, as float64[4, 2]."""
        rows, columns = self.shape
        x, y = self.xy(np.array([0, 0, rows, rows]) - 0.5, np.array([0, columns, columns, 0]) - 0.5)
        return np.stack([x, y], axis=-1)

    def pixel_range(
        self, bounds: tuple[float, float, float, float], margin: int = 0
    ) -> tuple[tuple[int, int], tuple[int, int]]:
        """Return the range of the pixels that meet `bounds`, at least two along each axis where the raster has them.

        Bounds on a border of pixels, within rounding, do not meet the pixels beyond it.

        Parameters
        ----------
        bounds : (float, float, float, float) [m]
            West, south, east, north.
        margin : int [pixels]
            Added on each side, none beyond the raster.

        Returns
        -------
        ((int, int), (int, int))
            First row and column; row and column after the last ones.
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

    def window(self, bounds: tuple[float, float, float, float], margin: int = 0) -> tuple[slice, slice]:
        """Return the rows and columns of the pixels that meet `bounds`, two along each axis or more.

        Bounds beyond the raster give the two pixels at its edge.

        Parameters
        ----------
        bounds : (float, float, float, float) [m]
            West, south, east, north.
        margin : int [pixels]
            Added on each side, none beyond the raster.
        """
        (i0, j0), (i1, j1) = self.pixel_range(bounds, margin)
        i0, j0 = (max(min(a, n - 2), 0) for a, n in zip((i0, j0), self.shape, strict=True))
        return slice(i0, i1), slice(j0, j1)

    def part(self, row: int, column: int, shape: tuple[int, int]) -> "Grid":
        """Return the grid of a part of the pixels.

        Parameters
        ----------
        row, column : int
            First pixel of the part.
        shape : (int, int)
            Rows, columns.
        """
        t, column, row = self.transform, int(column), int(row)
        moved = self.moved(t.a * column + t.b * row, t.d * column + t.e * row)
        return replace(moved, shape=tuple(shape))

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north [m] of the outer corners."""
        corners = self.corners()
        return (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())
