"""Effects that depend on the ground, the inflow and spatial features."""

from collections.abc import Iterable
from typing import Any

from ..laws import curvature, entrainment, ground_metric
from .decision_rules import (
    KEEPS_LOAD,
    THRESHOLD,
    Decision,
    Slots,
    TerrainFacts,
    as_asked,
    by_number,
    not_called_for,
    use_of,
)
from .scene import Scene

METRIC_THRESHOLD = 0.02  # [1] 1 / c^2 - 1: slopes above 8 degrees
FLIGHT_THRESHOLD = 1.0  # [1] U^2 curvature / (g cos): the bed falls away faster than the flow falls


def decide_metric(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Decide on lengths along the ground or on the map: as given in the scene.

    The number would decide for slope lengths.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    form = scene.numerics.form
    slots["metric"] = list(ground_metric.FORMS).index(form)
    steep = facts.slope_steep**2  # 1 / c^2 - 1
    words = {
        "slope": "form slope: lengths along the ground",
        "swe": "form swe: horizontal lengths, as for water on gentle beds"
        + ("; this ground is steep, form slope would be right for a mass flow" if steep > METRIC_THRESHOLD else ""),
    }
    return Decision("slope_metric", "on" if form == "slope" else "off", "scene", steep, METRIC_THRESHOLD, words[form])


def decide_curvature(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Decide on curvature of the bed, by the centrifugal acceleration that the energy line's speed would have.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    if scene.numerics.form == "swe":
        return not_called_for("curvature", "form swe has no curvature")
    reason = f"centrifugal over gravity where the flow can reach, at {facts.speed:.0f} m/s of the energy line"
    use = use_of(scene.curvature)
    if use in curvature.PARTS:
        slots["curvature"] = curvature.PARTS[use]
        return by_number("curvature", "on", facts.centrifugal_ratio, THRESHOLD, f"its {use} alone; {reason}")
    decision = by_number("curvature", use, facts.centrifugal_ratio, THRESHOLD, reason, KEEPS_LOAD)
    if decision.state == "on":
        slots["curvature"] = curvature.CURVATURE
    return decision


def decide_outflow(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Report whether outflow is likely, by the distance to the edge; it is always accounted for.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    if facts.edge_distance is None:
        reason = "outflow is reported"
    elif facts.edge_distance > 0:
        reason = f"the energy line ends {facts.edge_distance:.0f} m before the edge of the terrain"
    elif (facts.line_edge_distance or 0.0) > 0:
        reason = (
            f"the energy line ends {facts.line_edge_distance:.0f} m before the edge of the terrain, from there the "
            f"ground falls to the edge ({scene.numerics.edges}); outflow is reported"
        )
    else:
        reason = f"the energy line reaches the edge of the terrain ({scene.numerics.edges}); outflow is reported"
    if facts.hole_in_reach is not None:
        cells, east, north = facts.hole_in_reach
        reason += (
            f"; {cells} cells of nodata inside the DTM are in reach, around E {east:.1f} N {north:.1f}: "
            "[terrain] fill_nodata = 'interpolate' fills them"
        )
    return Decision("outflow", "on", "scene", None, None, reason)


def decide_flight(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Report whether a 3D run is advisable; never switched on by itself, it costs 100 to 1000 times more.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    ratio = facts.detachment_ratio
    over = ratio > FLIGHT_THRESHOLD
    word = "the flow takes off: columns do not compute it, a 3D run is recommended" if over else "the flow stays on"
    reason = f"U^2 curvature / (g cos) over convex ground: {word}"
    return Decision("flight_3d", "off", "auto", ratio, FLIGHT_THRESHOLD, reason)


def decide_hydrograph(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Report inflow wherever the scene has some.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    table = scene.hydrograph
    if table is None:
        return not_called_for("hydrograph", "no [hydrograph] in the scene")
    if not facts.inflow:
        return as_asked("hydrograph", table.use, "")
    volume, begins, ends, batches = facts.inflow
    reason = f"{volume:.6g} m3 from {begins:g} to {ends:g} s, in {batches} batches"
    return as_asked("hydrograph", table.use, reason)


def decide_secondary_release(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Report secondary areas wherever the scene has some; the number is their mass over that which moves by itself.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    if not scene.secondary_release:
        return not_called_for("secondary", "no [[secondary_release]] in the scene")
    if facts.secondary is None:
        return as_asked("secondary", "off", "")
    ratio, areas = facts.secondary
    uses = {table.use for table in scene.secondary_release if table.use != "off"}
    word = "1 area" if areas == 1 else f"{areas} areas"
    reason = f"{word}, released when the flow gets there; the number is their mass over the rest's"
    return as_asked("secondary", "on" if uses == {"on"} else "auto", reason, ratio)


def decide_zones(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Decide on friction zones: on where there is friction; decided after friction and drag.

    The number is the difference of a parameter on ground in reach. It decides nothing: the reach is an estimate.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    if not scene.zones:
        return not_called_for("zones", "no [[zones]] in the scene")
    if facts.zone_spread is None:
        return as_asked("zones", "off", "")
    if not {"friction", "contact"} & set(slots):
        return not_called_for("zones", "there is no friction that zones could change")
    reason = "(largest - smallest) / mean of the parameter that differs most in reach"
    decision = as_asked("zones", use_of_several(scene.zones), reason, facts.zone_spread)
    if decision.state == "on":
        slots["zones"] = True
    return decision


def decide_entrainment(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Decide on erosion: on where the scene has erodible ground.

    The number is the erodible mass in reach over the released mass. It decides nothing: the reach is an estimate.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    table = scene.entrainment
    if table is None:
        return not_called_for("entrainment", "no [entrainment] in the scene")
    if facts.erodible_ratio is None:
        return as_asked("entrainment", table.use, "")
    values = ", ".join(f"{name} = {value:g}" for name, value in table.parameters.items())
    reason = f"erodible mass in reach over the release's; {table.law}: {values}"
    decision = as_asked("entrainment", table.use, reason, facts.erodible_ratio)
    if decision.state == "on":
        lowering = 1.0 / (table.density or facts.density) if table.lower_bed else 0.0
        slots["entrainment"] = entrainment.entrainment_law(table.law, *table.parameters.values(), lowering=lowering)
    return decision


def decide_barrier(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Decide on barriers: on where the scene has some.

    The number is the height of the lowest crest in reach over that of the flow. It decides nothing: the reach is an
    estimate.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    if not scene.barrier:
        return not_called_for("barrier", "no [[barrier]] in the scene")
    if facts.barrier_distance is None:
        return as_asked("barrier", "off", "")
    ratio = facts.barrier_height_ratio
    where = f"the energy line ends {facts.barrier_distance:.0f} m before the nearest"
    if ratio is not None:
        where = f"in reach; the lowest crest is {ratio:.2g} times flow depth and energy head there"
    decision = as_asked("barrier", use_of_several(scene.barrier), f"{where}; screening only, loads need 3D", ratio)
    if decision.state == "on":
        slots["barrier"] = True
    return decision


def decide_still_water(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Decide on lakes at rest: a reference state wherever the scene has them.

    The number is the volume of their water over that of the release.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    table = scene.still_water
    if table is None:
        return not_called_for("still_water", "no [still_water] in the scene")
    level = f"at {table.level:g} m" if not isinstance(table.level, str) else f"at levels of column {table.level!r}"
    decision = as_asked("still_water", table.use, f"lake at rest {level}", facts.lake_ratio)
    if decision.state == "on":
        slots["still_water"] = True
    return decision


def use_of_several(tables: Iterable[Any]) -> str:
    """Return `use` of all tables of a name together: on if one is forced on, auto if one is not off.

    Parameters
    ----------
    tables : iterable of tables of a scene

    Returns
    -------
    {"auto", "on", "off"}
    """
    uses = {table.use for table in tables}
    return "on" if "on" in uses else "auto" if "auto" in uses else "off"
