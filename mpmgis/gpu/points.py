"""Time loop of the 3D MPM on a CUDA device; what `kernels.points.advance` is on the CPU.

Interface (used by the solver):

    device = DevicePoints(state, places, settings, effects)   # copies everything to the device
    reason = device.advance(until, after, max_steps)          # as `kernels.points.advance`; rows stay on the device
    device.download()                                         # all of `state` on the host is current again

`state` holds the solver's own host arrays: `advance` keeps `clock` and `counts` current in them, `download` all others.
After any change of the host arrays (insertion, restart, other laws) make a new DevicePoints.
`unsupported(...)` names what a device cannot take, before the run.
"""

from typing import NamedTuple

import numpy as np


class PointState(NamedTuple):
    """Arrays of a run that change, as in `kernels.points.advance`; they belong to the host and keep their identity."""

    rows: np.ndarray
    ids: np.ndarray
    keys: np.ndarray
    clock: np.ndarray
    counts: np.ndarray
    ledger: np.ndarray
    left_cells: np.ndarray
    peaks: np.ndarray
    yields: np.ndarray


class PointPlaces(NamedTuple):
    """Ground and map of a run, as in `kernels.points.advance`."""

    ground: NamedTuple  # `kernels.point_ground.Ground`
    lowest: np.ndarray
    inside: np.ndarray
    zone_values: np.ndarray
    watched: np.ndarray
