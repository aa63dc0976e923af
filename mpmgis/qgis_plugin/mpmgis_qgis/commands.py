"""Every verb of the command `mpmgis` that the toolbox has; a new one is a row here and in one of the tables.

A test holds every option, choice and default of them against the command's own parser.
"""

from __future__ import annotations

from .answering import COMPARE, EXPORT, HYDROGRAPH, INFO, INTENSITY, PROFILE, REPORT, RUNOUT, TIMESERIES
from .simulating import CONVERT, EFFECTS, RUN, SEED

VERBS = (
    *(SEED, RUN, EFFECTS, CONVERT, EXPORT, RUNOUT, PROFILE, TIMESERIES, HYDROGRAPH),
    *(INTENSITY, COMPARE, REPORT, INFO),
)
