"""Which effects a scene calls for, decided by numbers, with the reason (design notes 8)."""

from ..effects import barrier, curvature, entrainment, friction, metric, still_water, zones
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


def catalogue():
    """Every effect that a scene may name: list of {table, law, what, parameters (name -> unit)}."""
    entries = [
        {
            "table": "friction",
            "law": name,
            "what": law.__doc__.strip().splitlines()[0],
            "parameters": {key: unit for key, (unit, *_) in parameters.items()},
        }
        for name, (law, parameters) in friction.LAWS.items()
    ]
    entries.append(_catalogue_entry("curvature", curvature.Curvature, {}))
    entries.append(_catalogue_entry("still_water", still_water.StillWater, {"level": "m"}))
    entries.append(_catalogue_entry("zones", zones.FrictionZones, {"mu, xi, ...": "as the law has them"}))
    entries.append(_catalogue_entry("barrier", barrier.Barrier, {"height": "m", "crest": "m", "mu": "1"}))
    for law, parameters in entrainment.LAWS.values():
        units = {key: unit for key, (unit, *_) in parameters.items()}
        entries.append(_catalogue_entry("entrainment", law, {**units, "thickness": "m", "density": "kg m-3"}))
    for form, law in metric.FORMS.items():
        entry = _catalogue_entry("numerics", law, {})
        entries.append({**entry, "law": f"form = {form!r}"})
    return entries


def _catalogue_entry(table, law, parameters):
    what = law.__doc__.strip().splitlines()[0]
    return {"table": table, "law": law.__name__, "what": what, "parameters": parameters}
