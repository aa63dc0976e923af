"""A scene in, its decisions about effects and what each of them costs out."""

from ..errors import SceneError
from ..solvers.effect_costs import effect_costs, under_way
from .prepare import prepare
from .run import use_threads


def decided(scene_path, laws=None, say=lambda text: None):
    """((stage in words, decisions), ...) of the scene at `scene_path`, with the user's own `laws`; nothing is run.

    A scene without [[stage]] is one stage, without words.
    """
    stages = prepare(scene_path, say, laws).stages
    return tuple(("" if stage.table is None else stage.words(), stage.decisions) for stage in stages)


def measured(scene_path, laws=None, say=lambda text: None, tell=lambda text: None):
    """(decisions, EffectCosts): the scene's first steps are run, with each of its effects and without it.

    `say` gets the small print of the preparation, `tell` what takes long.
    """
    prepared = prepare(scene_path, say, laws)
    if prepared.scene.solvers != {"columns"}:
        raise SceneError("--measure times the effects of solver = 'columns' only; leave it out")
    use_threads(prepared.particles)
    solver = prepared.solver()
    start = under_way(solver, prepared.events, prepared.scene.output.end_time)
    return prepared.decisions, effect_costs(solver, start, tell)
