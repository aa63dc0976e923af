"""Effects that a scene has by place: zones of friction, erodible ground, barriers, lakes."""

from dataclasses import replace

from ..effects import barrier, entrainment, still_water, zones
from .decisions import THRESHOLD, Decision, as_asked, by_number, not_called_for

ZONE_THRESHOLD = 0.02  # (largest - smallest) / mean of a parameter in reach
TABLE_OF = {"zones": "zones", "entrainment": "entrainment", "barrier": "barrier"}  # effects that a run may turn on


def with_effects_on(scene, effects):
    """`scene` with those `effects` of TABLE_OF on that its tables have and do not turn off."""
    on = {}
    for name in (TABLE_OF[effect] for effect in effects):
        tables = getattr(scene, name)
        if isinstance(tables, tuple):
            on[name] = tuple(table if table.use == "off" else replace(table, use="on") for table in tables)
        else:
            on[name] = replace(tables, use="on")
    return replace(scene, **on)


def decide_zones(scene, facts, slots):
    """Friction by place, if a parameter differs where the flow can get to; decided after friction and drag."""
    if not scene.zones:
        return not_called_for("zones", "no [[zones]] in the scene")
    if facts.zone_spread is None or not {"friction", "contact"} & set(slots):
        return as_asked("zones", "off", "")
    decision = by_number(
        "zones", use_of_several(scene.zones), facts.zone_spread, ZONE_THRESHOLD,
        "(largest - smallest) / mean of the parameter that differs most in reach",
    )  # fmt: skip
    if decision.state == "on":
        slots["zones"] = zones.FrictionZones()
    return decision


def decide_entrainment(scene, facts, slots):
    """Erosion, by what lies in reach against what is released."""
    table = scene.entrainment
    if table is None:
        return not_called_for("entrainment", "no [entrainment] in the scene")
    if facts.erodible_ratio is None:
        return as_asked("entrainment", table.use, "")
    values = ", ".join(f"{name} = {value:g}" for name, value in table.parameters.items())
    reason = f"erodible mass in reach over the release's; {table.law}: {values}"
    decision = by_number("entrainment", table.use, facts.erodible_ratio, THRESHOLD, reason)
    if decision.state == "on":
        lowering = 1.0 / (table.density or facts.density) if table.lower_bed else 0.0
        slots["entrainment"] = entrainment.LAWS[table.law][0](**table.parameters, lowering=lowering)
    return decision


def decide_barrier(scene, facts, slots):
    """Barriers, if the flow can get to one of them."""
    if not scene.barrier:
        return not_called_for("barrier", "no [[barrier]] in the scene")
    if facts.barrier_distance is None:
        return as_asked("barrier", "off", "")
    use = use_of_several(scene.barrier)
    touched = facts.barrier_distance <= 0.0
    on = use == "on" or (use == "auto" and touched)
    if on:
        slots["barrier"] = barrier.Barrier()
    apart = f"the energy line ends {facts.barrier_distance:.0f} m before the nearest"
    height = facts.barrier_height_ratio
    ratio = 0.0 if height is None else height
    lowest = f"in reach; the lowest crest is {ratio:.2g} times flow depth and energy head there"
    return Decision(
        "barrier", "on" if on else "off", "auto" if use == "auto" else "forced", height, None,
        f"{lowest if touched else apart}; screening only, loads need 3D",
    )  # fmt: skip


def decide_still_water(scene, facts, slots):
    """Lakes at rest are a reference state wherever the scene has them; the number is their water over the release's."""
    table = scene.still_water
    if table is None:
        return not_called_for("still_water", "no [still_water] in the scene")
    level = f"at {table.level:g} m" if not isinstance(table.level, str) else f"at levels of column {table.level!r}"
    decision = as_asked("still_water", table.use, f"lake at rest {level}", facts.lake_ratio)
    if decision.state == "on":
        slots["still_water"] = still_water.StillWater()
    return decision


def use_of_several(tables):
    """`use` of all tables of a name together: on if one is forced on, auto if one is not off."""
    uses = {table.use for table in tables}
    return "on" if "on" in uses else "auto" if "auto" in uses else "off"
