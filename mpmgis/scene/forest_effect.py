"""The decision on forest, and the checks of its tables."""

from ..system.errors import SceneError
from .decision_rules import Decision, Slots, TerrainFacts, as_asked, not_called_for
from .key_checks import is_number
from .scene import Scene

LIMITS = ("detrainment_speed", "detrainment_thickness")
DOES = ("detrainment", "drag", "friction")  # keys of [[forest]] of which one at least acts


def decide_forest(scene: Scene, facts: TerrainFacts, slots: Slots) -> Decision:
    """Decide on forest: it acts where the scene names it.

    It lowers the hazard, so that no number switches it on.

    Parameters
    ----------
    scene, facts, slots : Scene, TerrainFacts, dict
        As of every decider (`decision_rules`).
    """
    used = [table for table in scene.forest if table.use != "off"]
    if not scene.forest:
        return not_called_for("forest", "no [[forest]] in the scene")
    if not used or facts.forest_areas is None:
        return as_asked("forest", "off", "")
    slots["forest"] = True
    area, in_reach = (f"{hectares / 1e4:.3g} ha" for hectares in facts.forest_areas)
    forced = all(table.use == "on" for table in used)
    return as_asked("forest", "on" if forced else "auto", f"{area} of forest, {in_reach} of it in reach of the flow")


def check_forest(scene: Scene, where: str) -> None:
    """Refuse tables of forest that do nothing, apply everywhere, or would be lost in a stage of points.

    Parameters
    ----------
    scene : Scene
    where : str
        Name of the scene in messages.

    Raises
    ------
    SceneError
    """
    for number, table in enumerate(scene.forest, 1):
        here = f"{where} [[forest]] number {number}"
        values = [getattr(table, key) for key in (*DOES, "strength")]
        if all(value == 0.0 for value in values[:-1]):
            raise SceneError(f"{here}: detrainment, drag and friction are all 0; give one, or remove the table")
        limited = any(getattr(table, key) != 0.0 for key in LIMITS)
        if limited and table.detrainment == 0.0:
            raise SceneError(f"{here}: {' and '.join(LIMITS)} limit detrainment, which is 0; give it, or remove them")
        if table.source is None and all(is_number(value) for value in values):
            raise SceneError(f"{here}: without source, numbers would apply everywhere; give source (polygons)")
    used = any(table.use != "off" for table in scene.forest)
    if used and "points" in scene.solvers:
        raise SceneError(f"{where}: [[forest]] is not kept through a [[stage]] of points; remove it")
