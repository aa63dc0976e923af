"""The slots of each solver, each with a law or a null law without cost."""

from typing import Any, NamedTuple

from .affine_transfer import WholeGradient
from .barrier import NoBarrier
from .contact_friction import CoulombContact
from .curvature import NoCurvature
from .entrainment import NoEntrainment
from .forest import NoForest
from .friction import Frictionless, NoCohesion, NoZones
from .ground_metric import SlopeMetric
from .internal_stress import NoEarthPressure, NoViscosity
from .softening import NoSoftening
from .still_water import NoStillWater


class ColumnEffects(NamedTuple):
    """Effects on the columns of the depth-averaged solver; defaults are the null forms."""

    friction: Any = Frictionless()
    zones: Any = NoZones()
    cohesion: Any = NoCohesion()
    metric: Any = SlopeMetric()
    curvature: Any = NoCurvature()
    still_water: Any = NoStillWater()
    earth_pressure: Any = NoEarthPressure()
    viscosity: Any = NoViscosity()
    entrainment: Any = NoEntrainment()
    barrier: Any = NoBarrier()
    forest: Any = NoForest()


class PointEffects(NamedTuple):
    """Effects on the points of the 3D solver; the material has no null form."""

    material: Any
    softening: Any = NoSoftening()
    contact: Any = CoulombContact(0.0)
    zones: Any = NoZones()
    barrier: Any = NoBarrier()
    transfer: Any = WholeGradient()
