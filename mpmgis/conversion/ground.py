"""The bed under columns and points: the surface that the 3D solver stands on (design note E9)."""

from dataclasses import dataclass

import numpy as np

from ..geo.terrain import Terrain, bilinear

_MARGIN = 3  # [pixels] beyond the particles, so that gradients under them are central


@dataclass(frozen=True)
class Ground:
    """Bilinear height of a terrain, and its gradient limited at cliff edges (X3), interpolated likewise."""

    terrain: Terrain

    @classmethod
    def under(cls, terrain, x, y, reach=0.0):
        """The ground under map points `x`, `y` [m] and up to `reach` [m] beside them."""
        bounds = (x.min() - reach, y.min() - reach, x.max() + reach, y.max() + reach)
        return cls(terrain.cropped(bounds, _MARGIN))

    def height(self, x, y):
        """float64[n] [m]; NaN off the terrain and beside nodata."""
        return self.terrain.sample(x, y)

    def gradient(self, x, y):
        """(db/dE, db/dN), float64[n] each; NaN where there is no height."""
        row, column = self.terrain.grid.rowcol(x, y)
        slopes = self.terrain.limited_gradient
        return tuple(bilinear(slopes[..., axis], row, column) for axis in (0, 1))


def slope_cosine(gradient_east, gradient_north):
    """Cosine of the slope angle."""
    return 1.0 / np.sqrt(1.0 + gradient_east**2 + gradient_north**2)
