"""Checks on the stages of a scene: order, end conditions, and incompatible tables of two solvers."""

from itertools import pairwise

from ..system.errors import SceneError
from ..system.source_names import file_of
from .key_checks import is_finite, shown
from .scene import Scene
from .tables import CLIFF, WALLS, StageTable


def check_stages(scene: Scene, where: str) -> None:
    """Refuse stages that contradict each other or the scene's tables; numbers of `until` become floats in place.

    Parameters
    ----------
    scene : Scene
    where : str
        Name of the scene in messages.

    Raises
    ------
    SceneError
    """
    for number, stage in enumerate(scene.stage, 1):
        here = f"{where} [[stage]] number {number}"
        _check_until(stage, here, last=number == len(scene.stage))
        if stage.reach == WALLS and all(barrier.use == "off" for barrier in scene.barrier):
            raise SceneError(f"{here}: until reach = 'barrier' needs a [[barrier]] in the scene; add it")
        if stage.solver != "points" and (stage.window or stage.outside):
            key = "window" if stage.window else "outside"
            raise SceneError(f"{here}: {key} requires solver = 'points', this is {stage.solver!r}; take it out")
        if stage.outside and not stage.window:
            raise SceneError(f"{here}: outside is of a window, and there is none; give window, or take outside out")
        if stage.outside == "columns" and number == 1:
            raise SceneError(f"{here}: outside = 'columns' continues those of a previous stage; there is none")
    for number, (before, stage) in enumerate(pairwise(scene.stage), 2):
        if before.solver == stage.solver:
            raise SceneError(
                f"{where} [[stage]] number {number} has the solver of the one before, {stage.solver!r}; make them one"
            )
    if scene.stage:
        _check_times(scene, where)
        _check_tables(scene, where)


def _check_until(stage: StageTable, here: str, last: bool) -> None:
    """Check the keys of `until`, each by itself."""
    if last:
        if stage.until is not None:
            raise SceneError(f"{here} is the last and lasts to [output] end_time; take until out, or add a [[stage]]")
        return
    if not stage.until:
        raise SceneError(f"{here}: until is missing, for example until = {{time = 30}}; the next stage begins then")
    for key, value in stage.until.items():
        if key == "reach":
            _check_reach(value, here)
            continue
        if not (is_finite(value) and value > 0.0):
            raise SceneError(f"{here}: until {key} = {shown(value)}, expected a finite number of seconds above 0")
        stage.until[key] = float(value)
    if "calm" in stage.until and stage.solver != "points":
        raise SceneError(f"{here}: until calm is of points, which may become columns then; this is {stage.solver!r}")


def _check_reach(value, here):
    if not isinstance(value, str) or (value not in (WALLS, CLIFF) and not file_of(value).suffix):
        raise SceneError(
            f"{here}: until reach = {shown(value)}, expected 'barrier', 'cliff' or a file of polygons such as "
            "'area.gpkg'"
        )


def _check_times(scene: Scene, where: str) -> None:
    """Check that the times at which stages end increase and are within the run."""
    before = 0.0
    for number, stage in enumerate(scene.stage, 1):
        time = (stage.until or {}).get("time")
        if time is None:
            continue
        here = f"{where} [[stage]] number {number}: until time = {time:g}"
        if time <= before:
            raise SceneError(f"{here} s is not after the {before:g} s of a stage before; correct one of them")
        if time >= scene.output.end_time:
            raise SceneError(f"{here} s is not before [output] end_time = {scene.output.end_time:g} s")
        before = time


def _check_tables(scene: Scene, where: str) -> None:
    """Refuse tables of one solver that the other stages would lose or use in part only."""
    solvers = [stage.solver for stage in scene.stage]
    inflow, release = scene.hydrograph, scene.release
    events = [table for table in (inflow, *scene.secondary_release) if table is not None and table.use != "off"]
    if events and solvers[0] != "columns":
        raise SceneError(f"{where}: [hydrograph] and [[secondary_release]] require a first [[stage]] of columns")
    if release is not None and release.window is not None and solvers[0] != "points":
        raise SceneError(f"{where} [release]: window selects points at the start; use the window of a [[stage]]")
    if "points" not in solvers:
        return
    bed = scene.entrainment
    beds = solvers.count("columns") + sum(stage.outside == "columns" for stage in scene.stage)
    if bed is not None and bed.use != "off" and (bed.lower_bed or beds > 1):
        what = "a bed that it lowers" if bed.lower_bed else "the eroded bed"
        raise SceneError(
            f"{where} [entrainment]: {what} is not kept through a [[stage]] of points; remove "
            f"{'lower_bed' if bed.lower_bed else 'the table, or the later stages of columns'}"
        )
