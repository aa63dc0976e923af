"""Effects of the material: friction, drag, yield stress, earth pressure, viscosity."""

from ..effects import friction
from .decisions import as_asked, not_called_for


def mu_least(scene):
    """The smallest dry friction coefficient in the scene [1]; 0 without friction."""
    active = scene.friction is not None and scene.friction.use != "off"
    return float(scene.friction.parameters.get("mu", 0.0)) if active else 0.0


def decide_friction(scene, facts, slots):
    """The law of basal resistance."""
    table = scene.friction
    if table is None:
        return not_called_for("friction", "no [friction] in the scene: nothing slows the flow")
    values = ", ".join(f"{k} = {v:g}" for k, v in table.parameters.items())
    decision = as_asked("friction", table.use, f"{table.law}: {values}")
    if decision.state == "on":
        slots["friction"] = friction.LAWS[table.law][0](**table.parameters)
    return decision
