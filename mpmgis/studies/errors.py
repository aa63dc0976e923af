"""How far two runs of the same flow are apart (design notes 9)."""

from typing import NamedTuple

import numpy as np

FOOTPRINT_SHARE = 0.01  # of the largest thickness of the reference, above which a cell counts as flow


class Errors(NamedTuple):
    """Errors of a run against a reference; NaN where the reference does not tell.

    thickness [1]: sum |h - h_ref| / sum h_ref, mean over the times. momentum [1]: the same of h u, against its largest
    sum over the times. area [1]: 1 - IoU of all cells that the flow was in. reach [m]: mean over the times.
    """

    thickness: float
    momentum: float
    area: float
    reach: float


NAMES = Errors._fields
UNITS = {"thickness": "1", "momentum": "1", "area": "1", "reach": "m"}


def errors_of(states, reference):
    """Errors of `states` against those of the `reference`, two sequences of State at the same times."""
    pairs = list(zip(states, reference, strict=True))
    thickness = [_apart(a.thickness, b.thickness) / max(b.thickness.sum(), 1e-300) for a, b in pairs]
    most = max(np.abs(b.momentum).sum() for b in reference)
    momentum = [_apart(a.momentum, b.momentum) / max(most, 1e-300) for a, b in pairs]
    least = FOOTPRINT_SHARE * max(b.thickness.max() for b in reference)
    covered = [np.any([s.thickness > least for s in run], axis=0) for run in (states, reference)]
    area = 1.0 - np.count_nonzero(covered[0] & covered[1]) / max(np.count_nonzero(covered[0] | covered[1]), 1)
    reach = [abs(a.reach - b.reach) for a, b in pairs]
    return Errors(float(np.mean(thickness)), float(np.mean(momentum)), float(area), float(np.mean(reach)))


def errors_against_exact(states, thickness):
    """Errors of the last of `states` against an exact `thickness` float64[rows, columns] [m]; where it is NaN none."""
    known = np.isfinite(thickness)
    exact = np.where(known, thickness, 0.0)
    error = _apart(np.where(known, states[-1].thickness, 0.0), exact) / max(exact.sum(), 1e-300)
    return Errors(float(error), np.nan, np.nan, np.nan)


def _apart(first, second):
    return float(np.abs(first - second).sum())
