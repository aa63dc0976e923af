"""Effects of resistance, decided by numbers and by the runout of a mass point with and without them."""

from math import sqrt

from ..laws import friction, internal_stress
from ..laws.quantities import GRAVITY
from .decision_rules import (
    KEEPS_ALL,
    THRESHOLD,
    Decision,
    Slots,
    TerrainFacts,
    as_asked,
    by_number,
    not_called_for,
    number_words,
    over_slope,
)
from .mass_point_runout import change, runout
from .material_table import STICKING_LAW, least_internal_friction
from .scene import Scene
from .tables import FrictionTable

# An effect that is left out must change runout, footprint and 99th percentile of the largest thickness by less than 5 %
# (tests/laws/test_auto_long.py). On the sample site cohesion of 0.47 % of the load changes the footprint by 2 % and the
# mean thickness of the deposit by 6 %, of 0.19 % by 0.7 and 0.4 %; earth pressure at 0.029 the footprint by 4 % and the
# largest thickness by 14 %, at 0.010 by 2 and 6 %, at 0.005 by 1 and 3 %; viscosity at 0.043 by 1 and 3 %; turbulent
# drag at (U / U_t)^2 = 0.025 by 1 and 1 % (2026-11-28).
COHESION_THRESHOLD = 0.002  # [1] yield stress over rho g h0
EARTH_PRESSURE_THRESHOLD = 0.007  # [1] h0 / L0 |K - 1| / |T - mu|
DRAG_THRESHOLD = 0.025  # [1] (U / U_t)^2
LATERAL_THRESHOLD = 0.01  # [1] h0 / (L0 |T - mu|)
SPEEDS = (1e-6, 1.0, 5.0, 20.0, 80.0)  # [m s-1] at which a user-defined law is evaluated
NO_DRAG = "the law of friction has none"
SLOTS = {"columns": "friction", "points": "contact"}  # solver -> slot of the law of friction
LEAST_DRIVE = 0.01  # [1] of gravity: remaining driving force where friction balances the slope


def mu_least(scene: Scene) -> float:
    """Return the least that friction can be in the scene, by which the energy line falls; 0 without friction.

    Hergarten's modified law is lightest just above its crossover speed v_c: v_c^2 / xi for a flow of 1 m; of a law of
    the user's own it is the least over speeds, for 1 m of water on level ground. A 3D flow shears inside, too, where it
    yields.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    float [1]
    """
    table = scene.friction
    if table is None or table.use == "off":
        return 0.0
    inside = least_internal_friction(scene.material, scene.softening) if scene.solver == "points" else None
    found = [] if table.law == STICKING_LAW else [_least_on_bed(scene, table)]
    return min(found + ([] if inside is None else [inside]), default=0.0)


def _least_on_bed(scene, table):
    """Return the least friction [1] of the law of a FrictionTable."""
    if table.law in friction.LAWS and table.law != "ModifiedVoellmy":
        return scene.dry_friction()
    if table.law == "ModifiedVoellmy":
        return min(table.parameters["mu"], table.parameters["crossover_speed"] ** 2 / table.parameters["xi"])
    law, load = _law_of(scene), 1000.0 * GRAVITY
    return min(friction.basal_stress(law, 1000.0, GRAVITY, load, 1.0, speed) for speed in SPEEDS) / load


def decide_friction(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Decide on the law of basal resistance.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    table = scene.friction
    if table is None:
        without = "the flow has no resistance" if scene.solver == "columns" else "the flow slides freely on its bed"
        return not_called_for("friction", f"no [friction] in the scene: {without}")
    values = table.parameter_words()
    if friction.SIZE in table.written:
        values = f"{friction.SIZE} = {table.written[friction.SIZE]}{table.chosen}, {values}"
    law = _law_of(scene)
    ratio = over_slope(scene.dry_friction(), facts) if table.parameters else None
    words = f"{table.law}: {values}" if values else table.law
    decision = as_asked("friction", table.use, f"{words}{number_words(ratio)}", ratio)
    if decision.state == "on":
        slots[SLOTS[scene.solver]] = law
    return decision


def _law_of(scene):
    """Return the law of [friction]."""
    table = scene.friction
    if table.law in friction.LAWS:
        return friction.friction_law(table.law, **table.parameters)
    return scene.laws[table.law][0](**table.parameters)


def decide_drag(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Decide on Voellmy's turbulent part: left out where the flow cannot become fast enough for it to matter.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    slot = SLOTS[scene.solver]
    law = slots.get(slot)
    mu, xi = _as_voellmy(law, scene, facts)
    if law is None or xi is None:
        return not_called_for("turbulent_drag", NO_DRAG)
    if not _is(law, friction.VOELLMY):
        return as_asked("turbulent_drag", "auto", *_drag_felt(mu, xi, facts))
    decision = _drag_by_number(scene, mu, xi, facts)
    if decision.state == "off":
        slots[slot] = friction.friction_law("Coulomb", mu)
    return decision


def _is(law, kind):
    """Return whether the law of friction in a slot is the built-in one of a kind."""
    return isinstance(law, friction.Friction) and law.kind == kind


def _as_voellmy(law: tuple | None, scene: Scene, facts: TerrainFacts) -> tuple[float, float | None]:
    """Return (mu [1], xi [m s-2]) of Voellmy's law with the resistance of `law`; xi is None without turbulent drag.

    A law without a parameter xi (SamosAT, OBrien, Manning) is taken at the speed of the energy line.
    """
    mu, xi = scene.dry_friction(), scene.friction_value(friction.DRAG)
    if xi is not None or not isinstance(law, friction.Friction):
        return mu, xi
    _, cosine = _sine_cosine(facts)
    depth = max(facts.release_thickness * cosine, 1e-6)
    load = facts.density * GRAVITY * depth * cosine
    dry, _, drag = friction.stress_parts(law, facts.density, GRAVITY, load, depth, facts.speed)
    return (dry / load, friction.turbulent_coefficient(drag)) if drag > 0.0 else (mu, None)


def _drag_by_number(scene: Scene, mu: float, xi: float, facts: TerrainFacts) -> Decision:
    """Decide on the drag of Voellmy's law, with its effect on the runout of a point."""
    reason, ratio = _drag_felt(mu, xi, facts)
    decision = by_number("turbulent_drag", _forced_on(scene.friction), ratio, DRAG_THRESHOLD, reason, KEEPS_ALL)
    with_it, without = friction.friction_law("Voellmy", mu, xi), friction.friction_law("Coulomb", mu)
    return _with_change(decision, runout(facts, with_it), runout(facts, without))


def _drag_felt(mu: float, xi: float, facts: TerrainFacts) -> tuple[str, float]:
    """Return (reason, number) that decide on the drag of a law with coefficients `mu` [1] and `xi` [m s-2]."""
    terminal = _terminal_speed(mu, xi, facts)
    speeds = f"U = {facts.speed:.0f} m/s of the energy line, U_t = {terminal:.0f} m/s on the median slope in reach"
    return f"(U / U_t)^2, {speeds}", (facts.speed / terminal) ** 2


def _terminal_speed(mu: float, xi: float, facts: TerrainFacts) -> float:
    """Return U_t [m s-1] at which drag balances the drive: U_t^2 = xi h_n (sin - mu cos) on the median slope."""
    sine, cosine = _sine_cosine(facts)
    drive = max(sine - mu * cosine, LEAST_DRIVE)
    return sqrt(max(xi * facts.release_thickness * cosine * drive, 1e-6))


def decide_bingham(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Report yield stress and viscosity at the bed, relative to the driving stress.

    However small, they are the only resistance in the scene: without them the flow would never come to rest.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    law = slots.get("friction")
    if not _is(law, friction.BINGHAM):
        return not_called_for("bingham", "no Bingham law in the scene")
    sine, cosine = _sine_cosine(facts)
    depth = facts.release_thickness * cosine
    drive = facts.density * GRAVITY * max(depth, 1e-6) * max(sine, LEAST_DRIVE)  # [Pa]
    yield_stress, viscosity = friction.parameters_of(law).values()
    ratio = max(yield_stress, 3.0 * viscosity * facts.speed / max(depth, 1e-6)) / drive
    reason = "yield stress or 3 eta U / h over the driving stress, the larger; always on"
    return as_asked("bingham", scene.friction.use, reason, ratio)


def decide_cohesion(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Decide on a yield stress at the bed, relative to the load of the release.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    table = scene.cohesion
    if table is None:
        return not_called_for("cohesion", "no [cohesion] in the scene")
    load = facts.density * GRAVITY * max(facts.release_thickness, 1e-6)
    decision = by_number(
        "cohesion", table.use, table.yield_stress / load, COHESION_THRESHOLD, "yield stress over rho g h0", KEEPS_ALL
    )
    if decision.state == "on":
        slots["cohesion"] = table.yield_stress
    law = slots.get("friction")
    return _with_change(decision, runout(facts, law, table.yield_stress), runout(facts, law))


def decide_earth_pressure(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Decide on active and passive earth pressure, relative to the driving stress.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    table = scene.earth_pressure
    if table is None:
        return not_called_for("earth_pressure", "no [earth_pressure] in the scene: K = 1")
    bed_angle = scene.bed_friction_angle()
    law = internal_stress.earth_pressure(table.friction_angle, bed_angle)
    ratio = _aspect(scene, facts) * max(abs(law.active - 1.0), abs(law.passive - 1.0))
    reason = f"h0 / L0 |K - 1| / |T - mu|; K {law.active:.2f} to {law.passive:.2f}, bed {bed_angle:.1f} degrees"
    decision = by_number("earth_pressure", table.use, ratio, EARTH_PRESSURE_THRESHOLD, reason, KEEPS_ALL)
    if decision.state == "on":
        slots["earth_pressure"] = law
    return decision


def decide_viscosity(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Decide on viscous stress in the plane of the map, relative to the driving stress.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    table = scene.viscosity
    if table is None:
        return not_called_for("viscosity", "no [viscosity] in the scene")
    law = internal_stress.InPlaneViscosity(table.viscosity, table.yield_stress)
    sine, cosine = _sine_cosine(facts)
    depth = max(facts.release_thickness * cosine, 1e-6)
    apparent = internal_stress.apparent_viscosity(law, depth, facts.speed, 0.0, 0.0, 0.0, 0.0)
    drive = facts.density * GRAVITY * depth * depth * max(sine, LEAST_DRIVE)
    ratio = 3.0 * apparent * facts.speed / drive * (facts.release_thickness / max(facts.release_length, 1e-6)) ** 2
    reason = "3 eta U / (rho g h^2 sin) (h0 / L0)^2"
    decision = by_number("viscosity", table.use, ratio, THRESHOLD, reason, KEEPS_ALL)
    if decision.state == "on":
        slots["viscosity"] = law
    return decision


def decide_lateral_pressure(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Report the pressure of the weight of the flow: it is always computed, the number shows its importance.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    ratio = _aspect(scene, facts)
    matters = "spreads the flow" if ratio > LATERAL_THRESHOLD else "so little that the flow moves like single points"
    reason = f"h0 / (L0 |T - mu|): {matters}"
    return Decision("lateral_pressure", "on", "scene", ratio, LATERAL_THRESHOLD, reason)


def _aspect(scene: Scene, facts: TerrainFacts) -> float:
    """Return eps = h0 / (L0 |T - mu|) [1]: lateral push over drive."""
    drive = max(abs(facts.slope_median - scene.dry_friction()), LEAST_DRIVE)
    return facts.release_thickness / (max(facts.release_length, 1e-6) * drive)


def _sine_cosine(facts: TerrainFacts) -> tuple[float, float]:
    """Return sine and cosine of the median slope in reach."""
    cosine = 1.0 / sqrt(1.0 + facts.slope_median**2)
    return facts.slope_median * cosine, cosine


def _forced_on(table: FrictionTable) -> str:
    """Return `use` of a part of a law: forced on if the law is on, else auto."""
    return "on" if table.use == "on" else "auto"


def _with_change(decision: Decision, with_it: float | None, without: float | None) -> Decision:
    """Return the decision with the estimated change in runout if it were the other way round."""
    now, otherwise = (with_it, without) if decision.state == "on" else (without, with_it)
    return decision._replace(runout_change=change(now, otherwise))
