"""A flow as it is now, whichever solver marches it: what decides whether it comes near to something."""

from typing import NamedTuple

import numpy as np


class Flow(NamedTuple):
    """Arrays float64[n], one entry a column or point."""

    x: np.ndarray  # [m] on the map
    y: np.ndarray
    u: np.ndarray  # [m s-1] to the east
    v: np.ndarray  # to the north
    speed: np.ndarray  # [m s-1] with its vertical part
    depth: np.ndarray  # [m] of the flow there, vertical
    mass: np.ndarray  # [kg]

    def __len__(self):
        return len(self.mass)

    def take(self, index):
        """The entries that `index` (bool, int or slice) picks."""
        return Flow(*(values[index] for values in self))
