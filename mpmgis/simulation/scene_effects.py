"""Decide the effects of a scene and measure their cost, without a whole run."""

from pathlib import Path
from typing import TYPE_CHECKING

from ..system.errors import SceneError
from ..system.messages import details, log
from ..terrain.walled_regions import walled_lines
from .effect_cost import effect_costs, under_way
from .preparation import prepare
from .scene_run import use_threads

if TYPE_CHECKING:
    from ..scene import Decision
    from .effect_cost import EffectCosts


def scene_decisions(
    scene_path: str | Path, laws: str | Path | None = None
) -> "tuple[tuple[str, tuple[Decision, ...]], ...]":
    """Return the decisions on the effects of a scene, without running it.

    Parameters
    ----------
    scene_path : path
    laws : path, optional
        Python file with the user's own friction laws; it is executed.

    Returns
    -------
    tuple of (str, tuple of Decision)
        Description of each stage and its decisions. A scene without [[stage]] is one stage with the description "".
    """
    with details():
        prepared = prepare(scene_path, laws)
    for line in walled_lines(prepared.walled, prepared.terrain.path):
        log.info(line)
    stages = prepared.stages
    return tuple(("" if stage.table is None else stage.words(), stage.decisions) for stage in stages)


def scene_effect_costs(
    scene_path: str | Path, laws: str | Path | None = None
) -> "tuple[tuple[Decision, ...], EffectCosts]":
    """Measure the cost of the effects of a scene: its first steps are run with and without each of them.

    Parameters
    ----------
    scene_path : path
    laws : path, optional
        Python file with the user's own friction laws; it is executed.

    Returns
    -------
    decisions : tuple of Decision
    costs : EffectCosts

    Raises
    ------
    SceneError
        The scene has a solver other than columns.
    """
    with details():
        prepared = prepare(scene_path, laws)
    if prepared.scene.solvers != {"columns"}:
        raise SceneError("`measure` times the effects of solver = 'columns' only; leave it out")
    use_threads(prepared.particles)
    solver = prepared.solver()
    start = under_way(solver, prepared.events, prepared.scene.output.end_time)
    return prepared.decisions, effect_costs(solver, start)
