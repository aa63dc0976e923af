"""Which effects a scene calls for, decided by numbers, with the reason (design notes 8)."""

from ..effects.slots import ColumnEffects
from .ground import decide_curvature, decide_flight, decide_metric, decide_outflow
from .placed import decide_barrier, decide_entrainment, decide_still_water, decide_zones
from .resistance import (
    decide_bingham,
    decide_cohesion,
    decide_drag,
    decide_earth_pressure,
    decide_friction,
    decide_lateral_pressure,
    decide_viscosity,
)
from .sources import decide_hydrograph, decide_secondary_release

# in the order in which a reader wants them; each puts its law into its slot (see `scene/decisions`)
DECIDERS = (
    decide_metric,
    decide_friction,
    decide_drag,
    decide_bingham,
    decide_zones,
    decide_cohesion,
    decide_earth_pressure,
    decide_lateral_pressure,
    decide_viscosity,
    decide_curvature,
    decide_entrainment,
    decide_barrier,
    decide_still_water,
    decide_hydrograph,
    decide_secondary_release,
    decide_outflow,
    decide_flight,
)


def resolve(scene, facts):
    """Decide every effect of the depth-averaged solver.

    Parameters
    ----------
    scene : Scene
    facts : TerrainFacts

    Returns
    -------
    (ColumnEffects, list of Decision)
    """
    slots = {}
    decisions = [decide(scene, facts, slots) for decide in DECIDERS]
    return ColumnEffects(**slots), decisions
