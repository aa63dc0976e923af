"""Effects that a scene has by place: zones of friction, erodible ground, barriers, lakes."""

from ..effects import still_water
from .decisions import as_asked, not_called_for


def decide_still_water(scene, facts, slots):
    """Lakes at rest are a reference state wherever the scene has them."""
    table = scene.still_water
    if table is None:
        return not_called_for("still_water", "no [still_water] in the scene")
    decision = as_asked("still_water", table.use, f"lake at rest at {table.level:g} m", facts.lake_ratio)
    if decision.state == "on":
        slots["still_water"] = still_water.StillWater()
    return decision
