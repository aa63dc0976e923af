"""What the flow can reach, by the energy line, in seconds: numbers that decide which effects a scene calls for."""

import numpy as np
from scipy import ndimage

from ..fields import GRAVITY


def reach_facts(terrain, release_xy, release_bed, mu):
    """Numbers about the ground below the energy line of the highest release (design notes 8).

    Parameters
    ----------
    terrain : Terrain
    release_xy : float[n, 2] [m]
        Some points of the release.
    release_bed : float[n] [m]
    mu : float
        Smallest friction coefficient; the line falls with it.

    Returns
    -------
    dict
        centrifugal_ratio: 95 % quantile of |u^T Hess b u| / g at the line's speed over the reachable cells;
        slope_median; drop [m]; speed [m s-1], the largest of the line.
    """
    grid, elevation = terrain.grid, terrain.elevation
    rows, columns = elevation.shape
    step = max(1, int(np.sqrt(rows * columns / 2e6)))  # enough cells for a quantile, whatever the raster's size
    r, c = np.meshgrid(np.arange(0, rows, step), np.arange(0, columns, step), indexing="ij")
    x, y = grid.xy(r, c)
    centre = np.average(release_xy, axis=0)
    start = float(np.max(release_bed))
    distance = np.hypot(x - centre[0], y - centre[1])
    height = start - mu * distance - elevation[::step, ::step]
    with np.errstate(invalid="ignore"):
        reach = height > 0
    labels, _ = ndimage.label(reach, structure=np.ones((3, 3)))
    row, column = grid.rowcol(*centre)
    i, j = (int(np.clip(np.round(v / step), 0, m - 1)) for v, m in zip((row, column), labels.shape, strict=True))
    if labels[i, j]:
        reach = labels == labels[i, j]  # only what is connected with the release
    if not reach.any():
        return {"centrifugal_ratio": 0.0, "slope_median": 0.0, "drop": 0.0, "speed": 0.0}
    speed2 = 2 * GRAVITY * np.where(reach, height, 0.0)
    gradient = terrain.gradient[::step, ::step]
    bending = _bending(elevation)[::step, ::step] / grid.cell_area
    ratio = (speed2 * bending / GRAVITY)[reach]
    slope = np.hypot(gradient[..., 0], gradient[..., 1])[reach]
    return {
        "centrifugal_ratio": float(np.nanquantile(ratio, 0.95)),
        "slope_median": float(np.nanmedian(slope)),
        "drop": float(start - np.nanmin(elevation[::step, ::step][reach])),
        "speed": float(np.sqrt(speed2.max())),
    }


def _bending(elevation):
    """Largest absolute eigenvalue of the Hessian [m per pixel^2], smoothed over two pixels."""
    filled = np.where(np.isfinite(elevation), elevation, np.nanmean(elevation))
    smooth = ndimage.gaussian_filter(filled, 2.0, mode="nearest")
    d_row, d_column = np.gradient(smooth)
    rr, rc = np.gradient(d_row)
    _, cc = np.gradient(d_column)
    return np.abs(0.5 * (rr + cc)) + np.sqrt(0.25 * (rr - cc) ** 2 + rc**2)
