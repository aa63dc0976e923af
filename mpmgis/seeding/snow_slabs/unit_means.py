"""Compute means over the cells of each release unit."""

import math

import numpy as np

from ...compiled.jit import jit


@jit
def unit_means(
    labels: np.ndarray, slope: np.ndarray, elevation: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute means of the cells of each unit.

    Parameters
    ----------
    labels : int[rows, columns]
        Number of the unit of each cell, from 1; 0 for none.
    slope : float[rows, columns] [degrees]
    elevation : float[rows, columns] [m]
    count : int
        Number of units.

    Returns
    -------
    float64[count] [degrees]
        Slope.
    float64[count] [1]
        Surface over plan area.
    float64[count] [m]
        Elevation.
    """
    cells = np.zeros(count)
    slopes, surfaces, heights = np.zeros(count), np.zeros(count), np.zeros(count)
    rows, columns = labels.shape
    for i in range(rows):
        for j in range(columns):
            k = labels[i, j] - 1
            if k >= 0:
                angle = float(slope[i, j])
                cells[k] += 1.0
                slopes[k] += angle
                surfaces[k] += 1.0 / math.cos(math.radians(angle))
                heights[k] += float(elevation[i, j])
    return slopes / cells, surfaces / cells, heights / cells
