"""The slots of each solver: records of numbers that choose the laws of a run, whose defaults mean that there is none.

One compiled program has all built-in laws; a step takes the branches that these numbers choose.
"""

from typing import Any, NamedTuple, get_type_hints

from .affine_transfer import WHOLE_GRADIENT
from .curvature import NO_CURVATURE
from .entrainment import Entrainment
from .friction import FRICTIONLESS, Friction
from .ground_metric import SLOPE
from .internal_stress import EarthPressure, InPlaneViscosity
from .material import Material
from .softening import Softening


class ColumnEffects(NamedTuple):
    """Effects on the columns of the depth-averaged solver; by default none acts.

    Parameters
    ----------
    friction : Friction, or a user-defined law
    zones : bool
        The parameters of friction are those of each node.
    cohesion : float [Pa]
        Basal stress that does not depend on load or speed, added to the friction law's: tau_0 of VoellmyMinShear
        (AvaFrame com1DFA). Dry snow 0 to 100 Pa, wet snow 50 to 1000 Pa, debris flows 100 to 5000 Pa.
    metric : int
        A kind of `ground_metric`.
    curvature : int
        Sum of the parts of `curvature`.
    still_water : bool
        Cells have a still-water level (`still_water`).
    earth_pressure : EarthPressure
    viscosity : InPlaneViscosity
    entrainment : Entrainment
    barrier : bool
        There are walls (`barrier`).
    forest : bool
        There are trees (`forest`).
    """

    friction: Any = FRICTIONLESS
    zones: bool = False
    cohesion: float = 0.0
    metric: int = SLOPE
    curvature: int = NO_CURVATURE
    still_water: bool = False
    earth_pressure: EarthPressure = EarthPressure()
    viscosity: InPlaneViscosity = InPlaneViscosity()
    entrainment: Entrainment = Entrainment()
    barrier: bool = False
    forest: bool = False


class PointEffects(NamedTuple):
    """Effects on the points of the 3D solver; by default none acts, but a material is needed.

    Parameters
    ----------
    material : Material
    softening : Softening
    contact : Friction
        Law of friction on the ground, or sticking.
    zones : bool
        The parameters of the contact are those of each node.
    barrier : bool
        There are rigid barriers.
    transfer : int
        A constant of `affine_transfer`.
    """

    material: Material
    softening: Softening = Softening()
    contact: Friction = FRICTIONLESS
    zones: bool = False
    barrier: bool = False
    transfer: int = WHOLE_GRADIENT


def with_fixed_types(effects: ColumnEffects | PointEffects) -> ColumnEffects | PointEffects:
    """Convert the numbers in all slots to the types of the fields, for each of which kernels would be compiled.

    The parameters of a user-defined law are floats.

    Parameters
    ----------
    effects : ColumnEffects or PointEffects
    """
    return type(effects)(*(_fixed(value, kind) for value, kind in _typed(effects)))


def in_precision(record: tuple, real: type) -> tuple:
    """Return a record with its floats in a precision; compiled, a float32 with a float64 gives a float64.

    Parameters
    ----------
    record : NamedTuple
        Of numbers: a law, or settings of kernels.
    real : type
        np.float32 or np.float64.
    """
    return type(record)(*(real(value) if isinstance(value, float) else value for value in record))


def _fixed(value, kind):
    if not isinstance(value, tuple):
        return kind(value)
    if kind is Any and not isinstance(value, Friction):
        return type(value)(*map(float, value))
    return type(value)(*(number_type(number) for number, number_type in _typed(value)))


def _typed(record):
    """Return pairs of each value in `record` and the type of its field."""
    return zip(record, get_type_hints(type(record)).values(), strict=True)
