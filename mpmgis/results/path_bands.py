"""Summarize a footprint for its comparison with a mapped outline: areas along the flow path, and the runout.

The path is divided into bands of equal length. The area covered in each band to the left and to the right of the path,
and the farthest position along it, vary smoothly with the parameters of a flow, which missed and over-covered areas do
not: these have a kink where the model agrees with the outline.
"""

from dataclasses import dataclass

import numpy as np

from ..terrain.grid import Grid
from .flow_line import places_along, positions_along

BANDS = 6  # of equal length along a path
SIDES = ("left", "right")  # of the path, in the order of the numbers of `PathBands.place`


@dataclass(frozen=True)
class PathBands:
    """Cells of a grid by band along a path and side of it.

    Parameters
    ----------
    place : int64[rows, columns]
        Band times 2, plus 1 to the right of the path; -1 where no flow is compared.
    along : float64[rows, columns] [m]
        Position along the path; NaN where no flow is compared.
    edges : float64[BANDS + 1] [m]
        Along the path.
    cell_area, cell_size : float [m2], [m]
    """

    place: np.ndarray
    along: np.ndarray
    edges: np.ndarray
    cell_area: float
    cell_size: float

    @classmethod
    def of(cls, line: np.ndarray, grid: Grid, compared: np.ndarray) -> "PathBands":
        """Divide the cells of a grid along a path.

        Parameters
        ----------
        line : float64[n, 2] [m]
            The path.
        grid : Grid
        compared : bool[rows, columns]
            Cells in which flow is compared.

        Returns
        -------
        PathBands
        """
        row, column = np.nonzero(compared)
        x, y = grid.xy(row, column)
        at = positions_along(line, x, y)
        edges = np.linspace(at.min(), at.max() + 0.5 * grid.cell_size, BANDS + 1)
        band = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, BANDS - 1)
        step = 0.5 * grid.cell_size
        (x0, y0), (x1, y1) = places_along(line, at - step), places_along(line, at + step)
        right = (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) < 0
        place = np.full(grid.shape, -1)
        place[row, column] = 2 * band + right
        along = np.full(grid.shape, np.nan)
        along[row, column] = at
        return cls(place, along, edges, grid.cell_area, grid.cell_size)

    @property
    def names(self) -> list[str]:
        """Names of the summaries of `of_mask`."""
        areas = [f"area_{k + 1}_{side}" for k in range(BANDS) for side in SIDES]
        return [*areas, "runout"]

    def of_mask(self, mask: np.ndarray) -> np.ndarray:
        """Return covered areas and runout of a footprint.

        Parameters
        ----------
        mask : bool[rows, columns]

        Returns
        -------
        float64[2 BANDS + 1] [m2, the last m]
            In the order of `names`.
        """
        inside = mask & (self.place >= 0)
        areas = np.bincount(self.place[inside], minlength=2 * BANDS) * self.cell_area
        runout = self.along[inside].max() if inside.any() else self.edges[0]
        return np.r_[areas, runout]

    def of_volume(self, thickness: np.ndarray) -> np.ndarray:
        """Return the volume of a flow in each band.

        Parameters
        ----------
        thickness : float[rows, columns] [m]
            Vertical; NaN counts as 0.

        Returns
        -------
        float64[BANDS] [m3]
        """
        inside = (self.place >= 0) & np.isfinite(thickness)
        volumes = np.bincount(self.place[inside] // 2, thickness[inside], minlength=BANDS)
        return volumes * self.cell_area

    def deviations(self, smaller: np.ndarray, larger: np.ndarray, error: float) -> np.ndarray:
        """Return standard deviations of the summaries of an outline whose position has an error.

        They are half the difference of the summaries of the outline moved inwards (`smaller`) and outwards (`larger`)
        by the error; at least an edge of the length of a band that is displaced by it.

        Parameters
        ----------
        smaller, larger : bool[rows, columns]
        error : float [m]

        Returns
        -------
        float64[2 BANDS + 1] [m2, the last m]
            In the order of `names`.
        """
        half = 0.5 * np.abs(self.of_mask(larger) - self.of_mask(smaller))
        least = np.r_[np.full(2 * BANDS, error * (self.edges[1] - self.edges[0])), np.hypot(error, self.cell_size / 2)]
        return np.maximum(half, least)
