"""Holes of a DTM filled by interpolation from the surrounding cells."""

from dataclasses import dataclass, replace

import numpy as np
import scipy
from rasterio.fill import fillnodata

from .elevation import Terrain
from .nodata_groups import nodata_groups

INTERPOLATE = "interpolate"
FILLS = (INTERPOLATE,)
FAR_PIXELS = 10.0  # [pixels] distance to known cells above which filled elevations are uncertain


@dataclass(frozen=True)
class NodataFill:
    """Filled holes of a DTM.

    Parameters
    ----------
    holes, cells : int
        Number of filled holes inside the DTM, and of their cells.
    distance : float [m]
        Largest distance from the centre of a filled cell to the nearest cell with elevation.
    east, north : float [m]
        Position of this cell.
    left : int
        Cells without elevation that are connected to the edge of the DTM; they are not filled.
    """

    holes: int
    cells: int
    distance: float
    east: float
    north: float
    left: int

    def lines(self, pixel: float) -> list[str]:
        """Return messages about the filling.

        Parameters
        ----------
        pixel : float [m]
            Cell size of the DTM.
        """
        stay = f"; {self.left} nodata cells connected to the edge of the DTM are kept" if self.left else ""
        if not self.cells:
            return [f"[terrain] fill_nodata: the DTM has no hole{stay}"]
        lines = [
            f"filled {self.cells} cells without elevation in {self.holes} holes of the DTM, up to "
            f"{self.distance:.4g} m from known cells (E {self.east:.1f} N {self.north:.1f}){stay}"
        ]
        if self.distance > FAR_PIXELS * pixel:
            lines.append(
                f"elevations {self.distance:.4g} m from known cells are uncertain; if the flow reaches them, use a DTM "
                "without this hole"
            )
        return lines


def filled(terrain: Terrain) -> tuple[Terrain, NodataFill]:
    """Fill the holes of a DTM.

    A hole is a group of cells without elevation that is not connected to the edge of the DTM. The fill is the
    least-squares plane through the surrounding cells plus their interpolated residuals: the mean of the nearest known
    cells in four quadrants, weighted by inverse distance (`rasterio.fill.fillnodata`, i.e. GDALFillNodata, without
    smoothing). It is exact on a plane. Cells with elevation keep their bits.

    Parameters
    ----------
    terrain : Terrain

    Returns
    -------
    (Terrain, NodataFill)
        The Terrain with its holes filled, and where.
    """
    nodata = ~terrain.valid
    labels, at_edge = nodata_groups(nodata)
    left = int(np.isin(labels, list(at_edge)).sum())
    elevation, cells, worst = terrain.elevation.copy(), 0, (0.0, (0, 0))
    windows = enumerate(scipy.ndimage.find_objects(labels), 1)
    holes = [(number, window) for number, window in windows if number not in at_edge]
    sides = [float(np.hypot(*terrain.grid.matrix[:, k])) for k in (1, 0)]
    for number, inner in holes:
        window = tuple(slice(part.start - 1, part.stop + 1) for part in inner)
        hole, known = labels[window] == number, ~nodata[window]
        elevation[window][hole] = _heights(terrain.elevation[window], hole, known)[hole]
        apart = np.where(hole, scipy.ndimage.distance_transform_edt(~known, sampling=sides), 0.0)
        row, column = np.unravel_index(np.argmax(apart), apart.shape)
        cells += int(hole.sum())
        worst = max(worst, (float(apart[row, column]), (int(row) + window[0].start, int(column) + window[1].start)))
    if not holes:
        return terrain, NodataFill(0, 0, 0.0, 0.0, 0.0, left)
    east, north = terrain.grid.xy(*worst[1])
    fill = NodataFill(len(holes), cells, worst[0], float(east), float(north), left)
    return replace(terrain, elevation=elevation), fill


def _heights(elevation: np.ndarray, hole: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return elevations [m] in the cells `hole` of a window, from its `known` cells."""
    around = scipy.ndimage.binary_dilation(hole, np.ones((3, 3))) & known
    row, column = np.indices(hole.shape)
    terms = np.stack([np.ones(hole.shape), row, column], axis=-1)
    plane = terms @ np.linalg.lstsq(terms[around], elevation[around], rcond=None)[0]
    residual = np.where(known, elevation - plane, 0.0).astype(np.float32)
    reach = float(np.hypot(*hole.shape)) + 1.0
    return plane + fillnodata(residual, known.astype(np.uint8), max_search_distance=reach, smoothing_iterations=0)
