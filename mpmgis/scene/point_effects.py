"""Effects of the 3D solver, as decisions: material, stiffness, softening, resolution."""

from math import atan, cos, radians, sqrt, tan

from ..laws.material_choice import wave_speed
from ..laws.quantities import GRAVITY
from ..laws.softening import NONE
from .decision_rules import Decision, Slots, TerrainFacts, as_asked, by_number, not_called_for, over_slope
from .material_table import CONES, made_material, made_softening, stiffened
from .scene import Scene
from .tables import SofteningTable
from .terrain_effects import use_of_several

MACH_THRESHOLD = 0.3  # [1] largest speed over the speed of pressure waves, above which the stiffness is felt
FEWEST_CELLS = 3.0  # [cells] over the depth of a flow, and over the height of a wall, for a resolved 3D flow
JUDGED_ALIKE = 1.5  # [1] factor by which the largest speed may differ from the expected one without a report
SCALED_MACH = 0.1  # [1] of a scaled stiffness: densities within 1 %
COHESION_THRESHOLD = 0.02  # [1] of the load of the release; less has no visible effect
# Columns as high as long on 8 and 16 cells: 99 % of the mass within 0.95 and 1.22 lengths, measured 1.2; on mu(I) 1.01
# and 1.14 (tests/scenes/granular_column)
COLLAPSE = (
    "runout of a free collapse depends on the cell size, by 30 % from 8 to 16 cells over the height (MuI with "
    "volume_correction = false: by 13 %)"
)
MU_I_THRESHOLD = 0.1  # [1] I / I0 below which the flow is so slow that friction is mu1
VISCOUS_REYNOLDS = 1e4  # [1] Reynolds number above which viscosity has no effect


def decide_material(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Decide on the law of the material; without it there is no 3D run.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    table = scene.material
    slots["material"] = made_material(table)
    values = ", ".join(f"{name} = {value:g}" for name, value in table.parameters.items())
    return as_asked("material", "auto", f"{table.law}: {values}")


def decide_stiffness(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Decide on the moduli: as given, or limited to those for a Mach number near 0.1.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    material, speed = slots["material"], largest_speed(facts)
    waves = wave_speed(material, facts.density)
    mach, enough = speed / waves, facts.density * (speed / SCALED_MACH) ** 2
    scaled = scene.numerics.stiffness == "scaled"
    if scaled and 0.0 < enough < material.bulk_modulus:
        slots["material"] = stiffened(material, enough)
        moduli = f"bulk modulus {enough:.3g} in place of {material.bulk_modulus:.3g} Pa"
        return Decision("stiffness", "on", "scene", mach, None, f"{moduli}; the number is Mach, U / c_p, as given")
    word = "as given"
    if mach > MACH_THRESHOLD:
        word = f"the flow is compressed; a bulk modulus of {enough:.2g} Pa would limit this to 1 %"
    elif mach < 0.5 * SCALED_MACH and not scaled:
        word = f"[numerics] stiffness = 'scaled' would take steps {SCALED_MACH / mach:.1f} times as long"
    reason = f"Mach, U / c_p = {speed:.0f} m/s of the energy line over {waves:.0f} m/s of waves: {word}"
    return Decision("stiffness", "off", "auto", mach, None, reason)


def largest_speed(facts: TerrainFacts) -> float:
    """Estimate the largest speed of the flow.

    It is that of the energy line with the head 2 h0 of a front driven by the thickness of the release.
    At rest on level ground it is the front speed of a dam break, 2 sqrt(g h0) (Ritter, 1892).

    Parameters
    ----------
    facts : TerrainFacts

    Returns
    -------
    float [m s-1]
    """
    return sqrt(facts.speed**2 + 4.0 * GRAVITY * max(facts.release_thickness, 0.0))


def stiffness_in_hindsight(facts: TerrainFacts, density: float, fastest: float, mach: float) -> str:
    """Return a line that compares the speed assumed for the stiffness with that of the run.

    Parameters
    ----------
    facts : TerrainFacts
    density : float [kg m-3]
    fastest : float [m s-1]
        Largest speed of the run.
    mach : float [1]
        Its ratio to the speed of pressure waves.

    Returns
    -------
    str
        Empty if the speeds are similar.
    """
    expected = largest_speed(facts)
    if fastest <= 0.0 or expected / JUDGED_ALIKE < fastest < expected * JUDGED_ALIKE:
        return ""
    return (
        f"the stiffness was chosen for {expected:.0f} m/s before the run; the flow had at most {fastest:.3g} m/s, Mach "
        f"{mach:.2f}: a bulk modulus of {density * (fastest / SCALED_MACH) ** 2:.2g} Pa limits density changes to 1 %"
    )


def decide_elasticity(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Report the compression of the flow by its weight; elasticity is always on.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    squeezed = facts.density * GRAVITY * facts.release_thickness / slots["material"].bulk_modulus
    return Decision("elasticity", "on", "scene", squeezed, None, "compression by its weight, rho g h0 / K")


def decide_plasticity(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Report the plastic yielding of solids.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    table, values = scene.material, scene.material.parameters
    if table.law not in (*CONES, "MuI"):
        return not_called_for("plasticity", f"{table.law} does not yield")
    inside = tan(radians(values["friction_angle"])) if table.law in CONES else values["mu1"]
    reason = "mu1 over the slope" if table.law == "MuI" else "internal friction, tan(phi), over the slope"
    if table.law == "DruckerPrager":
        reason = f"internal friction, tan(phi), over the slope; {COLLAPSE}"
    return as_asked("plasticity", "auto", reason, over_slope(inside, facts))


def decide_point_cohesion(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Report the cohesion of the material relative to the load of the release; it has no cost and is always on.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    cohesion = scene.material.parameters.get("cohesion", 0.0)
    if cohesion <= 0.0:
        return not_called_for("cohesion", "no cohesion in [material]")
    ratio = cohesion / (facts.density * GRAVITY * max(facts.release_thickness, 1e-6))
    felt = "" if ratio > COHESION_THRESHOLD else "; too little to be felt"
    return as_asked("cohesion", "auto", f"cohesion over rho g h0{felt}", ratio)


def decide_softening(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Decide on the permanent loss of strength, if there is any to lose.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    table, material = scene.softening, scene.material
    if table is None:
        return not_called_for("softening", "no [softening] in the scene")
    law = made_softening(table, material)
    lost = _lost(material.parameters, table)
    reason = f"share of tan(phi) or of cohesion that shearing takes away ({table.form}, xi_s {table.coefficient:g})"
    decision = by_number("softening", table.use, lost, 0.0, reason)
    if decision.state == "on" and law.kind == NONE:
        return decision._replace(state="off", reason="no loss: the residual strength is that of the material")
    if decision.state == "on":
        slots["softening"] = law
    return decision


def _lost(values: dict[str, float], table: SofteningTable) -> float:
    """Return the larger share [1] of tan(phi) and cohesion that softening takes away."""
    pairs = (
        (tan(radians(values["friction_angle"])), tan(radians(table.residual_friction_angle))),
        (values["cohesion"], table.residual_cohesion),
    )
    return max((1.0 - residual / initial for initial, residual in pairs if initial > 0.0), default=0.0)


def decide_mu_i(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Report whether the flow is fast enough for friction to grow with its rate.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    table = scene.material
    if "grain_diameter" not in table.parameters or table.parameters.get("rate_friction") == 0.0:
        return not_called_for("mu_i", "the material's friction does not depend on its rate")
    values, cosine = table.parameters, cos(atan(facts.slope_median))
    depth = max(facts.release_thickness * cosine, 1e-6)
    number = 2.5 * largest_speed(facts) * values["grain_diameter"] / (depth * sqrt(GRAVITY * depth * cosine))
    slower = "DruckerPrager with tan(phi) = mu1" if table.law == "MuI" else "DruckerPrager"
    felt = "" if number > MU_I_THRESHOLD * values["inertial_number"] else f"; {slower} would do"
    reason = f"I / I0 of a flow at the energy line's speed{felt}"
    return as_asked("mu_i", "auto", reason, number / values["inertial_number"])


def decide_fluid_viscosity(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Report the viscosity of a fluid relative to its inertia.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    viscosity = slots["material"].dynamic_viscosity
    if viscosity <= 0.0:
        return not_called_for("fluid_viscosity", "the material has none")
    reynolds = facts.density * largest_speed(facts) * facts.release_thickness / viscosity
    felt = "" if reynolds < VISCOUS_REYNOLDS else "; hardly felt, viscosity = 0 would do"
    reason = f"1 / Reynolds number at the energy line's speed{felt}"
    return as_asked("fluid_viscosity", "auto", reason, 1.0 / max(reynolds, 1e-300))


def decide_volume_correction(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Report whether separated material bears load only after compression.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    table = scene.material
    if table.law not in (*CONES, "MuI"):
        return not_called_for("vol_correction", "the material remembers no gaps")
    use = "off" if table.volume_correction is False else "auto"
    return as_asked("vol_correction", use, "material that was pulled apart bears load only after compression")


def decide_depth_cells(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Report whether the cells resolve the depth of the release; a stage that begins later reports that of the flow.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    size = scene.numerics.cell_size
    reason = f"cells of {size:g} m over the release's mean thickness of {facts.release_thickness:.3g} m"
    return _resolved("cells_over_depth", facts.release_thickness / size, reason)


def decide_wall_cells(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Report whether the cells resolve the height of the lowest barrier in reach.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    height, size = facts.barrier_height, scene.numerics.cell_size
    if height is None or "barrier" not in slots:
        return not_called_for("cells_over_wall", "no barrier in reach")
    reason = f"cells of {size:g} m over the lowest crest in reach, {height:.3g} m above the ground"
    return _resolved("cells_over_wall", height / size, reason)


def _resolved(name: str, cells: float, reason: str) -> Decision:
    """Return a Decision that is on where there are enough `cells`."""
    few = "" if cells > FEWEST_CELLS else "; too few for a 3D run: take a smaller cell_size, or solver = 'columns'"
    return by_number(name, "auto", cells, FEWEST_CELLS, reason + few)


def decide_point_barrier(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Decide on rigid barriers: on where the scene has some, as `decide_barrier` of columns does.

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
    reason = f"the energy line ends {facts.barrier_distance:.0f} m before the nearest"
    if ratio is not None:
        reason = f"in reach; the lowest crest is {ratio:.2g} times flow depth and energy head there"
    decision = as_asked("barrier", use_of_several(scene.barrier), reason, ratio)
    if decision.state == "on":
        slots["barrier"] = True
    return decision
