"""The slots of each solver: every one holds a law, or the null form that costs nothing."""

from typing import Any, NamedTuple

from .curvature import NoCurvature
from .friction import Frictionless
from .metric import SlopeMetric
from .still_water import NoStillWater


class ColumnEffects(NamedTuple):
    """What moves the columns of the depth-averaged solver; defaults are the null forms."""

    friction: Any = Frictionless()
    metric: Any = SlopeMetric()
    curvature: Any = NoCurvature()
    still_water: Any = NoStillWater()
