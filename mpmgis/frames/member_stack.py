"""Maxima of many members of an ensemble on one grid, read a window at a time."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..terrain.raster_input import open_raster
from ..terrain.raster_output import BLOCK

if TYPE_CHECKING:
    from ..terrain.grid import Grid

STACK_BYTES = 64_000_000  # [bytes] of members' values in memory at a time, all threads together


class MemberStack:
    """The maxima of many members on one grid, read a window at a time.

    Memory is bounded by the window, whose size follows from the number of members.

    Parameters
    ----------
    paths : list of Path
        Rasters of the members.
    grid : Grid
    extent : (int, int, int, int) or None
        First and one past the last row, first and one past the last column that any member reached.
    bands : sequence of str
        Names of the bands in each raster, in order.
    threads : int
    """

    def __init__(
        self,
        paths: list[Path],
        grid: "Grid",
        extent: tuple[int, int, int, int] | None,
        bands: Sequence[str],
        threads: int = 1,
    ):
        self.paths, self.grid, self.extent, self.bands = list(paths), grid, extent, list(bands)
        self.threads = max(1, threads)

    def windows(self, first: int, last: int) -> list[tuple[int, int, int, int]]:
        """Return windows that cover the reached cells of the rows first <= row < last, small enough for memory.

        Parameters
        ----------
        first, last : int
            First row, and one past the last row.

        Returns
        -------
        list of (int, int, int, int)
            First and one past the last row, first and one past the last column.
        """
        if self.extent is None:
            return []
        top, bottom, left, right = self.extent
        first, last = max(first, top), min(last, bottom)
        cells = max(1, STACK_BYTES // (4 * len(self.paths) * self.threads))
        width = min(BLOCK, cells)
        height = max(1, cells // width)
        rows = [(row, min(row + height, last)) for row in range(first, last, height)]
        columns = [(column, min(column + width, right)) for column in range(left - left % width, right, width)]
        return [(*row, max(column, left), end) for row in rows for column, end in columns]

    def read(self, band: str, window: tuple[int, int, int, int]) -> np.ndarray:
        """Read a band of all members in a window.

        Parameters
        ----------
        band : str
            Name of the band.
        window : (int, int, int, int)
            First and one past the last row, first and one past the last column.

        Returns
        -------
        float32[members, rows, columns]
            NaN where there is no data.
        """
        row, row_end, column, column_end = window
        number = self.bands.index(band) + 1
        stack = np.empty((len(self.paths), row_end - row, column_end - column), np.float32)
        for values, path in zip(stack, self.paths, strict=True):
            with open_raster(path) as source:
                source.read(number, window=((row, row_end), (column, column_end)), out=values)
                values[values == np.float32(source.nodata)] = np.nan
        return stack

    def rows_of(
        self, count: int, sources: Sequence[str], compute: Callable[[str, np.ndarray], dict[int, np.ndarray]]
    ) -> Callable[[int, int, int], np.ndarray]:
        """Return a function that computes rows of `count` bands, for `raster_output.write_rows`.

        The bands of a strip of rows are computed together, once.

        Parameters
        ----------
        count : int
            Number of bands to write.
        sources : sequence of str
            Bands of the members to read.
        compute : callable
            (source, stack) -> {number of a band: float32[rows, columns]}.

        Returns
        -------
        callable
            (band, first, last) -> float32[last - first, columns].
        """
        strip = {}

        def rows(band, first, last):
            if strip.get("rows") != (first, last):
                strip["rows"], strip["values"] = (first, last), self._strip(count, sources, compute, first, last)
            return strip["values"][band]

        return rows

    def _strip(self, count: int, sources: Sequence[str], compute: Callable, first: int, last: int) -> np.ndarray:
        """Return the bands of a strip of rows, float32[count, rows, columns]."""
        strip = np.full((count, last - first, self.grid.shape[1]), np.nan, np.float32)

        def fill(window):
            row, row_end, column, column_end = window
            for source in sources:
                for number, values in compute(source, self.read(source, window)).items():
                    strip[number, row - first : row_end - first, column:column_end] = values

        with ThreadPoolExecutor(self.threads) as threads:
            list(threads.map(fill, self.windows(first, last)))
        return strip
