"""Lakes at rest: which cells belong to a water body below a still level that the released water fills (note 3.6)."""

import numpy as np
from scipy import ndimage

FILLED = 0.9  # share of a body's volume below the level that the released water must hold for it to be a lake at rest


def lake_cells(corner_bed, level, water, touched=None):
    """Cells of all lakes at one still level.

    A lake is a connected body of cells with ground below `level`, of which the released water fills at least FILLED:
    a valley that lies as low but is dry is none, and no reference state either.

    Parameters
    ----------
    corner_bed : float[ny + 1, nx + 1] [m]
    level : float [m]
    water : float[ny, nx] [m]
        Mean depth of the released material in each cell.
    touched : bool[ny, nx], optional
        Only bodies with one of these cells.

    Returns
    -------
    (bool[ny, nx], list of float)
        Cells of lakes; filled share of every other body that holds some of the water.
    """
    corners = [corner_bed[:-1, :-1], corner_bed[:-1, 1:], corner_bed[1:, :-1], corner_bed[1:, 1:]]
    depth = np.mean([np.maximum(level - bed, 0.0) for bed in corners], axis=0)
    labels, count = ndimage.label(depth > 0.0)
    index = np.arange(1, count + 1)
    wet = ndimage.maximum((water > 0.0) & (depth > 0.0), labels, index) if count else np.zeros(0)
    filled = ndimage.sum(np.minimum(water, depth), labels, index) / ndimage.sum(depth, labels, index) if count else wet
    if touched is not None and count:
        wet = wet * ndimage.maximum(touched, labels, index)
    lakes = index[(np.asarray(wet) > 0) & (np.asarray(filled) >= FILLED)]
    others = np.asarray(filled)[(np.asarray(wet) > 0) & (np.asarray(filled) < FILLED)]
    return np.isin(labels, lakes), others.tolist()


def water_depth(x, y, volume, shape, cell_size):
    """float64[ny, nx] [m]: mean depth of columns at x, y [m] from the south-west corner, of `volume` [m3] each."""
    rows, columns = shape
    j, i = np.clip((y / cell_size).astype(int), 0, rows - 1), np.clip((x / cell_size).astype(int), 0, columns - 1)
    return np.bincount(j * columns + i, volume, rows * columns).reshape(shape) / cell_size**2
