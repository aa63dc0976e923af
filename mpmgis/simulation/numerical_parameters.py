"""Numerical parameters of a study (accuracy against run time), and the settings that it runs."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

from ..scene.scene import Scene
from ..scene.tables import NumericsTable
from ..solvers.columns.column_solver import CFL_ALONE, ColumnNumerics
from ..solvers.points.point_numerics import PointNumerics
from ..system.errors import InputError

HIGHEST_CFL = NumericsTable.__dataclass_fields__["cfl"].metadata["high"]  # stability limit of the schemes
STEP = 2.0**0.5  # [1] ratio of two cell sizes
# the cost is proportional to the inverse cell size to this power: particles (2 or 3) and steps (1)
COST_POWER = {"columns": 3, "points": 4}
LEAST_FINER = 1.2  # [1] smallest refinement of the reference over the finest setting
COLUMNS_A_CELL = (4, 9, 16, 25, 36)  # values of particles_per_cell that a study runs
CROSSED = ("cell_size", "particles_per_cell", "points_per_cell", "cfl")  # combined by --full, three values each


class Parameter(NamedTuple):
    """A numerical parameter of a study.

    A change is (key, value): a key of [numerics], or `stage2.cell_size` of the second [[stage]].

    Parameters
    ----------
    name : str
    values : callable
        scene -> values to run, from cheap to expensive, each a tuple of changes. Without values the scene does not have
        this parameter.
    """

    name: str
    values: Callable


def _cell_sizes(scene):
    """Return 2 and sqrt(2) times the scene's cells, and these; for columns (cheaper) also 1 / sqrt(2) times."""
    factors = (2.0, STEP, 1.0, 1.0 / STEP) if scene.solvers == {"columns"} else (2.0, STEP, 1.0)
    return tuple(cells_times(scene, factor) for factor in factors)


def _cell_sizes_of_stage(number):
    """Return the values of the parameter for the cell size of stage `number`, from 0."""

    def values(scene):
        stage = scene.stage[number]
        factors = (2.0, 1.0, 1.0 / STEP) if stage.solver == "columns" else (2.0, STEP, 1.0)
        return tuple(((_stage_key(number), _rounded(stage.cell_size * factor)),) for factor in factors)

    return values


def _columns_a_cell(scene):
    if "columns" not in scene.solvers:
        return ()
    return _of_numerics("particles_per_cell", sorted({*COLUMNS_A_CELL, scene.numerics.particles_per_cell}))


def _points_a_cell(scene):
    """Return the numbers of points per cell, which also give the spacing of points converted from columns."""
    if "points" not in scene.solvers:
        return ()
    return _of_numerics("points_per_cell", sorted({*_choices("points_per_cell")[:2], scene.numerics.points_per_cell}))


def _courant_numbers(scene):
    cfl = courant_number(scene)
    return _of_numerics("cfl", sorted({min(2.0 * cfl, HIGHEST_CFL), cfl, 0.5 * cfl}, reverse=True))


def _precisions(scene):
    return _of_numerics("precision", sorted(_choices("precision"))) if "points" in scene.solvers else ()


def _stiffnesses(scene):
    return _of_numerics("stiffness", ("scaled", "given")) if "points" in scene.solvers else ()


def _of_numerics(key, values):
    return tuple(((key, value),) for value in values)


def _choices(key):
    """Return the allowed values of a key of [numerics]."""
    return NumericsTable.__dataclass_fields__[key].metadata["choices"]


def _stage_key(number):
    return f"stage{number + 1}.cell_size"


def _rounded(size):
    return float(f"{size:.6g}")


def courant_number(scene: Scene) -> float:
    """Return the Courant number of [numerics]; without it the smaller default of the scene's solvers.

    Parameters
    ----------
    scene : Scene
    """
    return scene.numerics.cfl or min(default_courant_number(scene, solver) for solver in scene.solvers)


def default_courant_number(scene: Scene, solver: str) -> float:
    """Return the default Courant number of a solver.

    Columns with walls, entrainment or inflow use shorter steps: with longer ones columns passed through corners of
    walls, and the energy balance closed to 1.1e-3 and 5e-3 only.

    Parameters
    ----------
    scene : Scene
    solver : {"columns", "points"}
    """
    if solver == "points":
        return PointNumerics.cfl
    tables = (*scene.barrier, *scene.secondary_release, scene.entrainment, scene.hydrograph)
    more = any(table is not None and table.use != "off" for table in tables)
    return ColumnNumerics.cfl if more else CFL_ALONE


def cell_size_of(scene: Scene) -> float:
    """Return the cell size [m] of the scene, or of its first stage.

    Parameters
    ----------
    scene : Scene
    """
    return scene.stage[0].cell_size if scene.stage else scene.numerics.cell_size


def cells_times(scene: Scene, factor: float) -> tuple:
    """Return the changes that multiply all cell sizes by `factor`.

    Parameters
    ----------
    scene : Scene
    factor : float [1]

    Returns
    -------
    tuple of (str, float)
        Key and cell size [m].
    """
    if not scene.stage:
        return (("cell_size", _rounded(scene.numerics.cell_size * factor)),)
    return tuple((_stage_key(n), _rounded(stage.cell_size * factor)) for n, stage in enumerate(scene.stage))


PARAMETERS = (
    Parameter("cell_size", _cell_sizes),
    Parameter("particles_per_cell", _columns_a_cell),
    Parameter("points_per_cell", _points_a_cell),
    Parameter("cfl", _courant_numbers),
    Parameter("precision", _precisions),
    Parameter("stiffness", _stiffnesses),
)


@dataclass(frozen=True)
class Setting:
    """One set of numerical parameters of a study.

    Parameters
    ----------
    parameter : str
        The parameter that differs from the scene; "scene", "reference", or "several".
    changes : tuple of (str, value)
        Keys of [numerics], or `stage2.cell_size`, with their values.
    scene : Scene
    """

    parameter: str
    changes: tuple
    scene: Scene

    @property
    def name(self) -> str:
        """Text for a table: the differences from the scene."""
        words = ", ".join(f"{key} = {value if isinstance(value, str) else f'{value:g}'}" for key, value in self.changes)
        return words or "unchanged scene"

    @property
    def cell_size(self) -> float:
        """Cell size [m] of the scene, or of its first stage."""
        return cell_size_of(self.scene)

    def work_over(self, scene: Scene) -> float:
        """Return the approximate work (particles times steps) relative to that of another scene.

        Parameters
        ----------
        scene : Scene
        """
        numerics, own = self.scene.numerics, scene.numerics
        more = (numerics.particles_per_cell / own.particles_per_cell) * (numerics.points_per_cell / own.points_per_cell)
        pairs = zip(_cells(self.scene), _cells(scene), strict=True)
        finer = max((size / now_size) ** COST_POWER[solver] for (solver, now_size), (_, size) in pairs)
        return more * finer * courant_number(scene) / courant_number(self.scene)


def _cells(scene):
    """Return (solver, cell size [m]) of each stage."""
    return [(one.solver, one.numerics.cell_size) for one in scene.alone()]


def cost_power(scene: Scene) -> int:
    """Return the power of the inverse cell size to which the work of the most expensive solver is proportional.

    Parameters
    ----------
    scene : Scene
    """
    return max(COST_POWER[solver] for solver in scene.solvers)


def setting(scene: Scene, parameter: str, changes: tuple = ()) -> Setting:
    """Return the Setting of a scene with changes.

    Parameters
    ----------
    scene : Scene
    parameter : str
        Name of the parameter that differs.
    changes : tuple of (str, value)
        Keys of [numerics], or `stage2.cell_size`, with their values.
    """
    stages, numerics = list(scene.stage), scene.numerics
    for key, value in changes:
        if key.startswith("stage"):
            number = int(key.removeprefix("stage").partition(".")[0]) - 1
            stages[number] = replace(stages[number], cell_size=value)
        else:
            numerics = replace(numerics, **{key: value})
    return Setting(parameter, tuple(changes), replace(scene, numerics=numerics, stage=tuple(stages)))


def parameters_of(
    scene: Scene, names: Sequence | None = None, cell_sizes: Sequence | None = None
) -> tuple[Parameter, ...]:
    """Return the parameters of a scene that have several values.

    Parameters
    ----------
    scene : Scene
    names : sequence of str, optional
        Only these.
    cell_sizes : sequence of float, optional [m]
        Instead of the default cell sizes.

    Raises
    ------
    InputError
        An unknown name, or a parameter that this scene does not have.
    """
    stages = [Parameter(_stage_key(number), _cell_sizes_of_stage(number)) for number in range(len(scene.stage))]
    known = {parameter.name: parameter for parameter in (*PARAMETERS, *stages)}
    there = {name: parameter for name, parameter in known.items() if len(parameter.values(scene)) > 1}
    for name in names or ():
        if name not in known:
            raise InputError(f"--knobs {name}: unknown parameter; choose from {', '.join(there)}")
        if name not in there:
            solvers = " and ".join(sorted(scene.solvers))
            raise InputError(f"--knobs {name}: not for {solvers}; choose from {', '.join(there)}")
    if cell_sizes:
        now = cell_size_of(scene)
        tried = tuple(cells_times(scene, size / now) for size in sorted({*cell_sizes, now}, reverse=True))
        there["cell_size"] = there["cell_size"]._replace(values=lambda scene: tried)
    return tuple(parameter for parameter in there.values() if names is None or parameter.name in names)


def one_at_a_time(scene: Scene, parameters: Iterable[Parameter]) -> list[Setting]:
    """Return Settings: the unchanged scene, then every other value of each parameter alone.

    Parameters
    ----------
    scene : Scene
    parameters : iterable of Parameter
    """
    settings = [setting(scene, "scene")]
    for parameter in parameters:
        changed = (_changing(scene, value) for value in parameter.values(scene))
        settings += [setting(scene, parameter.name, changes) for changes in changed if changes]
    return settings


def crossed(scene: Scene, parameters: Iterable[Parameter]) -> list[Setting]:
    """Return Settings: all combinations of three values of cell size, particles and Courant number.

    The three values are the cheapest, that of the scene, and the most expensive.

    Parameters
    ----------
    scene : Scene
    parameters : iterable of Parameter
    """
    chosen = [parameter for parameter in parameters if parameter.name in CROSSED]
    settings = []
    for values in product(*(_three(parameter, scene) for parameter in chosen)):
        changed = [changes for value in values if (changes := _changing(scene, value))]
        if len(changed) > 1:
            settings.append(setting(scene, "several", sum(changed, ())))
    return settings


def _three(parameter, scene):
    values = parameter.values(scene)
    return tuple(dict.fromkeys((values[0], (), values[-1])))


def _changing(scene, changes):
    """Return the `changes` that differ from the scene."""
    return tuple((key, value) for key, value in changes if not _same(value, _now(scene, key)))


def _now(scene, key):
    """Return the value of the scene for the `key` of a change."""
    if key.startswith("stage"):
        return scene.stage[int(key.removeprefix("stage").partition(".")[0]) - 1].cell_size
    return courant_number(scene) if key == "cfl" else getattr(scene.numerics, key)


def reference(scene: Scene, settings: Sequence, refinement: float | None = None) -> Setting:
    """Return the Setting of the reference run: smaller cells, half the Courant number.

    All stages have the same factor of the cell size.

    Parameters
    ----------
    scene : Scene
    settings : sequence of Setting
        The runs that are compared with the reference.
    refinement : float, optional [1]
        Cell size of the scene over that of the reference; without it the reference has the smallest cells of
        `settings` over sqrt(2).

    Raises
    ------
    InputError
        Cells that are not smaller than those of a setting.
    """
    now = dict(enumerate(size for _, size in _cells(scene)))
    smallest = min(size / now[n] for setting in settings for n, (_, size) in enumerate(_cells(setting.scene)))
    factor = smallest / STEP if refinement is None else 1.0 / refinement
    if factor > smallest / LEAST_FINER:
        own = cell_size_of(scene)
        raise InputError(
            f"--refinement {refinement:g} makes cells of {own * factor:g} m, too large as a reference for cells of "
            f"{own * smallest:g} m; use a larger --refinement, or other --cell-sizes"
        )
    return setting(scene, "reference", (*cells_times(scene, factor), ("cfl", 0.5 * courant_number(scene))))


def _same(value, now):
    return value == now if isinstance(value, str) else abs(value - now) <= 1e-9 * abs(now)
