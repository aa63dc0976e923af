"""Holes of a DTM filled by interpolation from the ground around them."""

from dataclasses import dataclass, replace

import numpy as np
from rasterio.fill import fillnodata
from scipy import ndimage

from ..geo.nodata import holes_of, nodata_groups

INTERPOLATE = "interpolate"
FILLS = (INTERPOLATE,)
FAR_PIXELS = 10.0  # from known ground, above which the heights of a filled hole are hardly known


@dataclass(frozen=True)
class NodataFill:
    """What was filled of a DTM.

    Parameters
    ----------
    holes, cells : int
        Number of holes amid the DTM, and of their cells, all of which were filled.
    distance : float [m]
        From the centre of a filled cell to that of the nearest cell with elevation, the largest.
    east, north : float [m]
        Where that is.
    left : int
        Cells without elevation that reach the edge of the DTM, which stay as they are.
    """

    holes: int
    cells: int
    distance: float
    east: float
    north: float
    left: int

    def lines(self, pixel):
        """What to tell of it, on a DTM with pixels of `pixel` [m]."""
        stay = f"; {self.left} cells of nodata that reach the edge of the DTM stay" if self.left else ""
        if not self.cells:
            return [f"[terrain] fill_nodata: the DTM has no hole{stay}"]
        lines = [
            f"filled {self.cells} cells without elevation in {self.holes} holes amid the DTM, up to "
            f"{self.distance:.4g} m from known ground (E {self.east:.1f} N {self.north:.1f}){stay}"
        ]
        if self.distance > FAR_PIXELS * pixel:
            lines.append(
                f"heights {self.distance:.4g} m from known ground are a guess; if the flow gets there, use a DTM "
                "without that hole"
            )
        return lines


def filled(terrain):
    """(`terrain` with its holes filled, the NodataFill).

    A hole is a group of cells without elevation that does not reach the edge of the DTM. Each of its cells becomes the
    mean of the nearest known cells in four quadrants around it, weighted by the inverse of their distance
    (`rasterio.fill.fillnodata`, GDALFillNodata, without smoothing). Cells with elevation keep their bits.
    """
    nodata = ~terrain.valid
    holes = holes_of(nodata)
    left = int(nodata.sum() - holes.sum())
    if not holes.any():
        return terrain, NodataFill(0, 0, 0.0, 0.0, 0.0, left)
    rows, columns = np.nonzero(holes)
    window = tuple(slice(at.min() - 1, at.max() + 2) for at in (rows, columns))
    elevation, hole = terrain.elevation[window], holes[window]
    known = np.isfinite(elevation)
    sides = [float(np.hypot(*terrain.grid.matrix[:, k])) for k in (1, 0)]
    apart = ndimage.distance_transform_edt(~known, sampling=sides)
    datum = elevation[known].mean()  # GDAL interpolates in single precision
    image = np.where(known, elevation - datum, 0.0).astype(np.float32)
    reach = float(np.hypot(*hole.shape)) + 1.0
    made = fillnodata(image, known.astype(np.uint8), max_search_distance=reach, smoothing_iterations=0)
    whole = terrain.elevation.copy()
    whole[window] = np.where(hole, made + datum, elevation)
    worst = np.unravel_index(np.argmax(np.where(hole, apart, 0.0)), hole.shape)
    east, north = terrain.grid.xy(*(at + part.start for at, part in zip(worst, window, strict=True)))
    count = len(np.unique(nodata_groups(nodata)[0][holes]))
    fill = NodataFill(count, len(rows), float(apart[worst]), float(east), float(north), left)
    return replace(terrain, elevation=whole), fill
