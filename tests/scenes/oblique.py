"""A scene seen from above and aside: dots painted from far to near, so that what stands before hides what is behind."""

import numpy as np


class View:
    """A parallel view of places on the map.

    Parameters
    ----------
    towards : float [degrees]
        Clockwise from north: the way that one looks.
    downwards : float [degrees]
        How steeply one looks down.
    pixel : float [m]
        Of the picture.
    """

    def __init__(self, towards, downwards, pixel):
        bearing, down = np.radians(towards), np.radians(downwards)
        self.right = np.array([np.cos(bearing), -np.sin(bearing), 0.0])
        self.ahead = np.array([np.sin(bearing) * np.cos(down), np.cos(bearing) * np.cos(down), -np.sin(down)])
        self.up = np.cross(self.right, self.ahead)
        self.pixel, self._dots = pixel, []

    def add(self, place, colour, size=1):
        """Dots at `place` [n, 3] [m] of `colour` [n, 3] (0 to 1) or [3], `size` pixels wide."""
        self._dots.append((place, np.broadcast_to(colour, place.shape), size))

    def image(self):
        """float[rows, columns, 3] of all that was added; white where nothing is."""
        flat = [(dots @ self.right, dots @ self.up) for dots, _, _ in self._dots]
        left, low = (min(part[k].min() for part in flat) for k in (0, 1))
        wide, high = (int((max(part[k].max() for part in flat) - m) / self.pixel) + 6 for k, m in ((0, left), (1, low)))
        picture, depth = np.ones((high * wide, 3)), np.full(high * wide, np.inf)
        for (x, y), (dots, colour, size) in zip(flat, self._dots, strict=True):
            away = dots @ self.ahead
            column, row = ((x - left) / self.pixel).astype(int), ((y - low) / self.pixel).astype(int)
            for across in range(size):
                for upwards in range(size):
                    at = (row + upwards) * wide + column + across
                    order = np.argsort(-away)  # the nearest is written last
                    nearer = away[order] < depth[at[order]]
                    depth[at[order][nearer]], picture[at[order][nearer]] = away[order][nearer], colour[order][nearer]
        return picture.reshape(high, wide, 3)[::-1]
