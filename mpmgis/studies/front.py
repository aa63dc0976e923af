"""Which settings are worth their time, and which knob pays most next."""

import math
from typing import NamedTuple

import numpy as np

NEAR_FRONT = 1.5  # a setting whose time is within this factor of the front's at its error is as good as on it


def on_front(seconds, errors):
    """bool[n]: no other setting is both at least as quick and at least as right, and better in one of them."""
    t, e = np.asarray(seconds, float), np.asarray(errors, float)
    better = (t[None, :] <= t[:, None]) & (e[None, :] <= e[:, None])
    strictly = (t[None, :] < t[:, None]) | (e[None, :] < e[:, None])
    return np.isfinite(e) & ~(better & strictly).any(axis=1)


def time_over_front(seconds, errors):
    """float64[n]: time of each setting over that of the quickest one which is at least as right; 1 on the front."""
    t, e = np.asarray(seconds, float), np.asarray(errors, float)
    return np.array([t[k] / t[e <= e[k]].min() if np.isfinite(e[k]) else np.nan for k in range(len(t))])


class Gain(NamedTuple):
    """What turning one knob from the scene's value brings.

    setting: what is set to what, in words; time, error: those of the new setting over the scene's [1]; pays: logarithm
    of the error's fall over that of the time's growth; infinite where both fall, 0 where the error does not.
    """

    knob: str
    setting: str
    time: float
    error: float
    pays: float


def gains(base, others):
    """Gains of the `others`, (knob, setting, seconds, error) each, over `base`, (seconds, error); best first."""
    found = []
    for knob, setting, seconds, error in others:
        time, ratio = seconds / base[0], error / base[1] if base[1] > 0.0 else math.inf
        if ratio < 1.0:
            found.append(Gain(knob, setting, time, ratio, _pays(time, ratio)))
    return sorted(found, key=lambda gain: -gain.pays)


def _pays(time, ratio):
    if time <= 1.0:
        return math.inf
    return -math.log(max(ratio, 1e-300)) / math.log(time)
