"""Checks on the stages of a scene: order, end conditions, and incompatible tables of two solvers.

Tables and keys of only one solver, and the requirements of each solver on a scene.
"""

from dataclasses import fields
from itertools import pairwise
from pathlib import Path

from ..system.errors import SceneError
from .material_table import CONES, OPTIONS
from .table_values import is_finite, shown
from .tables import CLIFF, WALLS

NAMES = {"columns": "the depth-averaged solver", "points": "the 3D solver"}
OTHER = {"columns": "points", "points": "columns"}
# tables of only one solver -> that solver, and the fix for the other
ONLY = {
    "material": ("points", "its material is defined by [friction] and related tables"),
    "softening": ("points", "take it out, or set solver = 'points'"),
    "hydrograph": ("columns", "start with [release]"),
    "secondary_release": ("columns", "start with [release]"),
    "cohesion": ("columns", "give [material] cohesion"),
    "earth_pressure": ("columns", "use [material] friction_angle"),
    "viscosity": ("columns", "give [material] law = 'Fluid' with viscosity"),
    "curvature": ("columns", "3D flow follows the ground by itself; take it out"),
    "still_water": ("columns", "water is at rest by itself; take it out"),
    "entrainment": ("columns", "take it out, or set solver = 'columns'"),
    "forest": ("columns", "take it out, or set solver = 'columns'"),
}


def check_solver(tables, solvers, kinds, where):
    """Refuse tables and keys, `tables` as TOML gave them, that none of `solvers` has; `kinds` are their classes.

    Raises
    ------
    SceneError
    """
    for name, given in tables.items():
        only, fix = ONLY.get(name, (None, ""))
        if only not in (None, *solvers):
            raise SceneError(f"{where}: {NAMES[OTHER[only]]} has no [{name}]; {fix}")
        own = {f.name: f.metadata.get("solver") for f in fields(kinds[name])}
        for key in given if isinstance(given, dict) else ():
            if own.get(key) not in (None, *solvers):
                raise SceneError(
                    f"{where} [{name}]: {key} requires solver = {own[key]!r}, this is {OTHER[own[key]]!r}; remove it"
                )


def check_points(scene, where):
    """Requirements of the 3D solver on a scene, and contradictions.

    Raises
    ------
    SceneError
    """
    material, softening = scene.material, scene.softening
    if material is None:
        raise SceneError(f"{where}: solver = 'points' needs [material] with its law; `mpmgis effects` lists them")
    if any(alone.solver == "points" and alone.numerics.cell_size is None for alone in scene.alone()):
        raise SceneError(
            f"{where} [numerics]: solver = 'points' needs cell_size [m], the side of its cells in 3D: a third of the "
            "flow's thickness or less"
        )
    for key, (laws, _) in OPTIONS.items():
        if getattr(material, key) is not None and material.law not in laws:
            raise SceneError(f"{where} [material]: {key} belongs to {' and '.join(laws)}, not to {material.law}")
    if softening is None:
        return
    if material.law not in CONES:
        raise SceneError(f"{where} [softening]: only {' and '.join(CONES)} soften, the material is {material.law}")
    for key in ("friction_angle", "cohesion"):
        initial, residual = material.parameters[key], getattr(softening, f"residual_{key}")
        if residual > initial:
            raise SceneError(
                f"{where} [softening]: residual_{key} = {residual:g} is above [material] {key} = {initial:g}; "
                "softening takes away"
            )
    if softening.form == "linear" and softening.coefficient == 0.0:
        raise SceneError(f"{where} [softening]: the linear form requires a coefficient above 0")
    if softening.form != "linear" and softening.peak_strain != 0.0:
        raise SceneError(f"{where} [softening]: peak_strain requires form = 'linear'")


UNTIL = ("time", "reach", "calm")


def check_stages(scene, where):
    """Refuse stages that contradict each other or the scene's tables; `until` is left with floats.

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


def _check_until(stage, here, last):
    """The keys of `until`, each by itself."""
    if last:
        if stage.until is not None:
            raise SceneError(f"{here} is the last and lasts to [output] end_time; take until out, or add a [[stage]]")
        return
    if not stage.until:
        raise SceneError(f"{here}: until is missing, for example until = {{time = 30}}; the next stage begins then")
    for key, value in stage.until.items():
        if key not in UNTIL:
            raise SceneError(f"{here}: until has no {shown(key)}; it takes {', '.join(UNTIL)}")
        if key == "reach":
            _check_reach(value, here)
            continue
        if not (is_finite(value) and value > 0.0):
            raise SceneError(f"{here}: until {key} = {shown(value)}, expected a finite number of seconds above 0")
        stage.until[key] = float(value)
    if "calm" in stage.until and stage.solver != "points":
        raise SceneError(f"{here}: until calm is of points, which may become columns then; this is {stage.solver!r}")


def _check_reach(value, here):
    if not isinstance(value, str) or (value not in (WALLS, CLIFF) and not Path(value.partition("|")[0]).suffix):
        raise SceneError(
            f"{here}: until reach = {shown(value)}, expected 'barrier', 'cliff' or a file of polygons such as "
            "'area.gpkg'"
        )


def _check_times(scene, where):
    """Times at which stages end increase and are within the run."""
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


def _check_tables(scene, where):
    """Tables of one solver that the other stages would leave half done."""
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
