"""Where a flow would leave the ground: free flight against the terrain ahead (design notes 2.4 and 8)."""

import numpy as np

from ..fields import GRAVITY

SECONDS = 0.5  # of free flight, after which a flow should be clear of the ground
STEP = 0.1  # [s] between two looks at the ground ahead
AHEAD = 2.0  # [s] of the flow's way


def takes_off(terrain, x, y, u, v, depth, ahead=AHEAD, gravity=GRAVITY):
    """bool[n]: would what moves on like this be clear of the ground by more than its depth somewhere ahead?

    From each place on its way it flies freely for half a second, along the slope that it has come down: over ground of
    the curvature k it is then clear by (U^2 k / g - 1) g s^2 / 2, which is the detachment indicator of design notes 8
    in metres. A kink in the terrain counts by how far one falls from it, so that rough ground is no cliff.

    Parameters
    ----------
    terrain : Terrain
    x, y : float64[n] [m]
    u, v : float64[n] [m s-1]
        Horizontal velocity.
    depth : float64[n] [m]
    ahead : float [s]
        Of the way, the flight included.
    """
    moments = STEP * np.arange(-1, round(ahead / STEP) + 1)
    bed = terrain.sample(x[:, None] + np.outer(u, moments), y[:, None] + np.outer(v, moments))
    flight = round(SECONDS / STEP)
    start = bed[:, 1:-flight]
    rising = (start - bed[:, : -flight - 1]) / STEP
    clear = start + rising * SECONDS - 0.5 * gravity * SECONDS**2 - bed[:, flight + 1 :]
    with np.errstate(invalid="ignore"):
        return (clear > depth[:, None]).any(axis=1)
