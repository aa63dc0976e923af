"""Decisions on all effects of a scene, in the order of the report."""

from ..laws.effect_slots import ColumnEffects, PointEffects
from .decision_rules import Decision, TerrainFacts
from .forest_effect import decide_forest
from .point_effects import (
    decide_depth_cells,
    decide_elasticity,
    decide_fluid_viscosity,
    decide_material,
    decide_mu_i,
    decide_plasticity,
    decide_point_barrier,
    decide_point_cohesion,
    decide_softening,
    decide_stiffness,
    decide_volume_correction,
    decide_wall_cells,
)
from .resistance_effects import (
    decide_bingham,
    decide_cohesion,
    decide_drag,
    decide_earth_pressure,
    decide_friction,
    decide_lateral_pressure,
    decide_viscosity,
)
from .scene import Scene
from .terrain_effects import (
    decide_barrier,
    decide_curvature,
    decide_entrainment,
    decide_flight,
    decide_hydrograph,
    decide_metric,
    decide_outflow,
    decide_secondary_release,
    decide_still_water,
    decide_zones,
)

# in the order of the report; each puts its law into its slot (see `decision_rules`)
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
    decide_forest,
    decide_barrier,
    decide_still_water,
    decide_hydrograph,
    decide_secondary_release,
    decide_outflow,
    decide_flight,
)

POINT_DECIDERS = (
    decide_material,
    decide_stiffness,
    decide_elasticity,
    decide_plasticity,
    decide_point_cohesion,
    decide_softening,
    decide_mu_i,
    decide_fluid_viscosity,
    decide_volume_correction,
    decide_friction,
    decide_drag,
    decide_zones,
    decide_point_barrier,
    decide_depth_cells,
    decide_wall_cells,
    decide_outflow,
)
# solver -> (its slots, the functions that fill them)
SOLVERS = {"columns": (ColumnEffects, DECIDERS), "points": (PointEffects, POINT_DECIDERS)}


def resolve(scene: Scene, facts: TerrainFacts) -> tuple[ColumnEffects | PointEffects, list[Decision]]:
    """Decide every effect of the scene's solver.

    Parameters
    ----------
    scene : Scene
    facts : TerrainFacts

    Returns
    -------
    effects : ColumnEffects or PointEffects
    decisions : list of Decision
        In the order of the report.
    """
    kind, deciders = SOLVERS[scene.solver]
    slots = {}
    decisions = [decide(scene, facts, slots) for decide in deciders]
    return kind(**slots), decisions
