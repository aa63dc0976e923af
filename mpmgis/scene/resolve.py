"""Which effects a scene calls for, decided by numbers, with the reason (design notes 8)."""

from typing import NamedTuple

from ..effects import curvature, friction, metric, still_water
from ..effects.slots import ColumnEffects

CURVATURE_THRESHOLD = 0.05  # centrifugal acceleration over gravity below which curvature changes little


class Decision(NamedTuple):
    """Why an effect is on or off: the number that decided, its threshold, and the reason in words."""

    effect: str
    state: str  # "on" | "off"
    decided_by: str  # "scene" | "auto" | "forced"
    indicator: float | None
    threshold: float | None
    reason: str

    def line(self):
        """One line for a table on the terminal."""
        number = "" if self.indicator is None else f"{self.indicator:.3g}"
        threshold = "" if self.threshold is None else f"> {self.threshold:g}"
        return f"{self.effect:<12} {self.state:<4} {self.decided_by:<7} {number:>9} {threshold:<8} {self.reason}"


class TerrainFacts(NamedTuple):
    """Numbers about the reachable terrain that decide effects (`geo.reach` computes them in seconds)."""

    centrifugal_ratio: float  # p95 of |u^T Hess b u| / g at the energy line's speed
    slope_median: float
    drop: float  # [m]
    speed: float  # [m s-1] of the energy line


def mu_least(scene):
    """The smallest dry friction coefficient in the scene [1]; 0 without friction."""
    active = scene.friction is not None and scene.friction.use != "off"
    return float(scene.friction.parameters.get("mu", 0.0)) if active else 0.0


def resolve(scene, facts):
    """Decide every effect of the depth-averaged solver.

    Returns
    -------
    (ColumnEffects, list of Decision)
    """
    decisions, slots = [], {"metric": metric.FORMS[scene.numerics.form]()}
    words = {"slope": "lengths along the ground: mass flows", "swe": "horizontal lengths: water"}
    reason = f"form {scene.numerics.form}, {words[scene.numerics.form]}"
    decisions.append(Decision("metric", "on", "scene", None, None, reason))
    decisions.append(_friction(scene, slots))
    decisions.append(_curvature(scene, facts, slots))
    decisions.append(_still_water(scene, slots))
    return ColumnEffects(**slots), decisions


def _friction(scene, slots):
    table = scene.friction
    if table is None or table.use == "off":
        reason = "no [friction] in the scene: nothing slows the flow" if table is None else "use = 'off'"
        return Decision("friction", "off", "scene" if table is None else "forced", None, None, reason)
    law = friction.LAWS[table.law][0](**table.parameters)
    slots["friction"] = law
    values = ", ".join(f"{k} = {v:g}" for k, v in table.parameters.items())
    return Decision("friction", "on", "scene", None, None, f"{table.law}: {values}")


def _curvature(scene, facts, slots):
    use = scene.curvature.use if scene.curvature is not None else "auto"
    ratio = facts.centrifugal_ratio
    if scene.numerics.form == "swe":
        return Decision("curvature", "off", "scene", None, None, "form swe has no curvature")
    on = use == "on" or (use == "auto" and ratio > CURVATURE_THRESHOLD)
    if on:
        slots["curvature"] = curvature.Curvature()
    reason = f"centrifugal over gravity where the flow can reach, at {facts.speed:.0f} m/s of the energy line"
    return Decision(
        "curvature", "on" if on else "off", "auto" if use == "auto" else "forced", ratio, CURVATURE_THRESHOLD, reason
    )


def _still_water(scene, slots):
    table = scene.still_water
    if table is None or table.use == "off":
        reason = "no [still_water] in the scene" if table is None else "use = 'off'"
        return Decision("still_water", "off", "scene" if table is None else "forced", None, None, reason)
    slots["still_water"] = still_water.StillWater()
    return Decision("still_water", "on", "scene", None, None, f"lake at rest at {table.level:g} m")


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
    for form, law in metric.FORMS.items():
        entry = _catalogue_entry("numerics", law, {})
        entries.append({**entry, "law": f"form = {form!r}"})
    return entries


def _catalogue_entry(table, law, parameters):
    what = law.__doc__.strip().splitlines()[0]
    return {"table": table, "law": law.__name__, "what": what, "parameters": parameters}
