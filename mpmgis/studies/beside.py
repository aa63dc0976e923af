"""Results of other codes, or of other studies, that are shown beside a study's own."""

from typing import NamedTuple

import numpy as np

from .errors import Errors


class Beside(NamedTuple):
    """One result that this study did not run.

    code, setting : str
        Whose it is, and with which settings.
    seconds : (float, float, float) [s]
        Wall time of its loop over steps: typical, least, most.
    errors : Errors
        NaN where nothing tells.
    """

    code: str
    setting: str
    seconds: tuple
    errors: Errors

    @property
    def name(self):
        """Words for a table."""
        return f"{self.code}: {self.setting}"


def quickest_as_right(seconds, errors, error):
    """Number of the quickest setting whose error is at most `error`, None where no setting is as right."""
    right = np.flatnonzero(np.asarray(errors) <= error)
    return int(right[np.argmin(np.asarray(seconds)[right])]) if right.size else None
