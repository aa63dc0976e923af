"""Effects that the shape of the ground calls for: slope metric, curvature, edges of the terrain, flight."""

from ..effects import curvature, metric
from .decisions import THRESHOLD, Decision, by_number, not_called_for, use_of

METRIC_THRESHOLD = 0.02  # 1 / c^2 - 1: slopes above 8 degrees
FLIGHT_THRESHOLD = 1.0  # U^2 curvature / (g cos): the bed falls away faster than the flow falls


def decide_metric(scene, facts, slots):
    """Lengths along the ground or on the map: as the scene says, with the number that speaks for the slope's."""
    form = scene.numerics.form
    slots["metric"] = metric.FORMS[form]()
    steep = facts.slope_steep**2  # 1 / c^2 - 1
    words = {
        "slope": "form slope: lengths along the ground",
        "swe": "form swe: horizontal lengths, as for water on gentle beds"
        + ("; this ground is steep, form slope would be right for a mass flow" if steep > METRIC_THRESHOLD else ""),
    }
    return Decision("slope_metric", "on" if form == "slope" else "off", "scene", steep, METRIC_THRESHOLD, words[form])


def decide_curvature(scene, facts, slots):
    """Curvature of the bed, by the centrifugal acceleration that the energy line's speed would have."""
    if scene.numerics.form == "swe":
        return not_called_for("curvature", "form swe has no curvature")
    reason = f"centrifugal over gravity where the flow can reach, at {facts.speed:.0f} m/s of the energy line"
    use = use_of(scene.curvature)
    if use in curvature.PARTS:
        slots["curvature"] = curvature.PARTS[use]()
        return by_number("curvature", "on", facts.centrifugal_ratio, THRESHOLD, f"its {use} alone; {reason}")
    decision = by_number("curvature", use, facts.centrifugal_ratio, THRESHOLD, reason)
    if decision.state == "on":
        slots["curvature"] = curvature.Curvature()
    return decision


def decide_outflow(scene, facts, slots):
    """The ledger of what leaves the terrain is always kept; the distance tells whether it will be needed."""
    if facts.edge_distance is None:
        reason = "what leaves the terrain is booked"
    elif facts.edge_distance > 0:
        reason = f"the energy line ends {facts.edge_distance:.0f} m before the edge of the terrain"
    elif (facts.line_edge_distance or 0.0) > 0:
        reason = (
            f"the energy line ends {facts.line_edge_distance:.0f} m before the edge of the terrain, from there the "
            f"ground falls to the edge ({scene.numerics.edges}); what leaves is booked"
        )
    else:
        reason = f"the energy line reaches the edge of the terrain ({scene.numerics.edges}); what leaves is booked"
    if facts.hole_in_reach is not None:
        cells, east, north = facts.hole_in_reach
        reason += (
            f"; {cells} cells of nodata amid the DTM are in reach, around E {east:.1f} N {north:.1f}: "
            "[terrain] fill_nodata = 'interpolate' fills them"
        )
    return Decision("outflow", "on", "scene", None, None, reason)


def decide_flight(scene, facts, slots):
    """Whether a 3D phase should be thought of; never switched on by itself, it costs 100 to 1000 times more."""
    ratio = facts.detachment_ratio
    over = ratio > FLIGHT_THRESHOLD
    word = "the ground falls away faster than the flow falls; a 3D run would follow it" if over else "the flow stays on"
    reason = f"U^2 curvature / (g cos) over convex ground: {word}"
    return Decision("flight_3d", "off", "auto", ratio, FLIGHT_THRESHOLD, reason)
