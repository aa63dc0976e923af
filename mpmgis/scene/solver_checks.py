"""Tables and keys of only one solver, and the requirements of each solver on a scene."""

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

from ..system.errors import SceneError
from .material_table import CONES, OPTIONS
from .tables import SOLVERS, TABLES, keys_of

if TYPE_CHECKING:
    from .scene import Scene


def check_solver(tables: dict[str, Any], solvers: Collection[str], where: str) -> None:
    """Refuse tables and keys that none of the solvers has.

    Parameters
    ----------
    tables : dict of str to Any
        As TOML gave them.
    solvers : collection of str
        Of the scene.
    where : str
        Name of the scene in messages.

    Raises
    ------
    SceneError
    """
    for name, given in tables.items():
        rule, keys = TABLES[name].rule, keys_of(TABLES[name])
        if rule.solver not in (None, *solvers):
            raise SceneError(f"{where}: {SOLVERS[_other(rule.solver)]} has no [{name}]; {rule.fix}")
        for key in given if isinstance(given, dict) else ():
            only = keys[key].metadata["solver"] if key in keys else None
            if only not in (None, *solvers):
                raise SceneError(
                    f"{where} [{name}]: {key} requires solver = {only!r}, this is {_other(only)!r}; remove it"
                )


def _other(solver):
    return next(name for name in SOLVERS if name != solver)


def check_points(scene: "Scene", where: str) -> None:
    """Refuse a scene that the 3D solver cannot run, or with contradictions in its tables.

    Parameters
    ----------
    scene : Scene
    where : str
        Name of the scene in messages.

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
