"""The knobs that trade accuracy for time, and the settings of them that a study tries (design notes 9)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

from ..errors import InputError
from ..scene.tables import NumericsTable
from ..solvers.columns import CFL_ALONE, ColumnNumerics
from ..solvers.points import PointNumerics

HIGHEST_CFL = NumericsTable.__dataclass_fields__["cfl"].metadata["high"]  # above it the schemes are unstable
STEP = 2.0**0.5  # between two cell sizes
# cost goes with the inverse cell size to this power: particles with the square or cube, steps with one more
COST_POWER = {"columns": 3, "points": 4}
LEAST_FINER = 1.2  # times finer cells make a reference
COLUMNS_A_CELL = (4, 9, 16, 25, 36)


class Knob(NamedTuple):
    """What trades accuracy for time: `values(scene)` are tried, from cheap to dear, each the changes that it makes.

    A change is (key, value): a key of [numerics], or `stage2.cell_size` of the second [[stage]]. A scene that has not
    this knob has no values of it.
    """

    name: str
    values: Callable


def _cell_sizes(scene):
    """Coarser by 2, by its root, as the scene has it; columns, which cost less, also finer by the root of 2."""
    factors = (2.0, STEP, 1.0, 1.0 / STEP) if scene.solvers == {"columns"} else (2.0, STEP, 1.0)
    return tuple(cells_times(scene, factor) for factor in factors)


def _cell_sizes_of_stage(number):
    """Values of a knob for stage `number`, from 0: its cells alone."""

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
    """Also the spacing of points that columns are converted to."""
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
    """What the scene's language allows for a key of [numerics]."""
    return NumericsTable.__dataclass_fields__[key].metadata["choices"]


def _stage_key(number):
    return f"stage{number + 1}.cell_size"


def _rounded(size):
    return float(f"{size:.6g}")


def courant_number(scene):
    """That of [numerics]; of a scene in stages that leaves it to each solver the smaller one."""
    return scene.numerics.cfl or min(default_courant_number(scene, solver) for solver in scene.solvers)


def default_courant_number(scene, solver):
    """That of a `solver` ("columns", "points") where [numerics] has none.

    Columns that meet walls, take up ground or flow in take shorter steps: columns slipped through corners of walls, and
    the energy balance closed to 1.1e-3 and 5e-3 with the longer ones.
    """
    if solver == "points":
        return PointNumerics.cfl
    tables = (*scene.barrier, *scene.secondary_release, scene.entrainment, scene.hydrograph)
    more = any(table is not None and table.use != "off" for table in tables)
    return ColumnNumerics.cfl if more else CFL_ALONE


def cell_size_of(scene):
    """Cell size [m] that stands for the scene's: of a scene in stages the first stage's."""
    return scene.stage[0].cell_size if scene.stage else scene.numerics.cell_size


def cells_times(scene, factor):
    """The changes that make all cells `factor` times as large."""
    if not scene.stage:
        return (("cell_size", _rounded(scene.numerics.cell_size * factor)),)
    return tuple((_stage_key(n), _rounded(stage.cell_size * factor)) for n, stage in enumerate(scene.stage))


KNOBS = (
    Knob("cell_size", _cell_sizes),
    Knob("particles_per_cell", _columns_a_cell),
    Knob("points_per_cell", _points_a_cell),
    Knob("cfl", _courant_numbers),
    Knob("precision", _precisions),
    Knob("stiffness", _stiffnesses),
)
CROSSED = ("cell_size", "particles_per_cell", "points_per_cell", "cfl")  # of --full, three values each


@dataclass(frozen=True)
class Setting:
    """One set of values that is tried.

    Parameters
    ----------
    knob : str
        The one that differs from the scene; "scene", "reference", or "several".
    changes : tuple of (str, value)
        Keys of [numerics], or `stage2.cell_size`, and what they are set to.
    scene : Scene
    """

    knob: str
    changes: tuple
    scene: object

    @property
    def name(self):
        """Words for a table: what differs from the scene."""
        words = ", ".join(f"{key} = {value if isinstance(value, str) else f'{value:g}'}" for key, value in self.changes)
        return words or "as the scene has it"

    @property
    def cell_size(self):
        """Cell size [m], of a scene in stages the first stage's."""
        return cell_size_of(self.scene)

    def work_over(self, scene):
        """About how many times the work of `scene` this is: particles times steps."""
        numerics, own = self.scene.numerics, scene.numerics
        more = (numerics.particles_per_cell / own.particles_per_cell) * (numerics.points_per_cell / own.points_per_cell)
        pairs = zip(_cells(self.scene), _cells(scene), strict=True)
        finer = max((size / now_size) ** COST_POWER[solver] for (solver, now_size), (_, size) in pairs)
        return more * finer * courant_number(scene) / courant_number(self.scene)


def _cells(scene):
    """(solver, cell size [m]) of each stage."""
    return [(one.solver, one.numerics.cell_size) for one in scene.alone()]


def cost_power(scene):
    """The work goes with the inverse cell size to this power, that of its dearest solver."""
    return max(COST_POWER[solver] for solver in scene.solvers)


def setting(scene, knob, changes=()):
    """The Setting of `scene` with `changes`: (key, value) each."""
    stages, numerics = list(scene.stage), scene.numerics
    for key, value in changes:
        if key.startswith("stage"):
            number = int(key.removeprefix("stage").partition(".")[0]) - 1
            stages[number] = replace(stages[number], cell_size=value)
        else:
            numerics = replace(numerics, **{key: value})
    return Setting(knob, tuple(changes), replace(scene, numerics=numerics, stage=tuple(stages)))


def knobs_of(scene, names=None, cell_sizes=None):
    """The knobs that `scene` has, all or those of `names`; `cell_sizes` [m] are tried instead of the usual ones.

    Raises
    ------
    InputError
        A name that is no knob, or not one of this scene.
    """
    stages = [Knob(_stage_key(number), _cell_sizes_of_stage(number)) for number in range(len(scene.stage))]
    known = {knob.name: knob for knob in (*KNOBS, *stages)}
    there = {name: knob for name, knob in known.items() if len(knob.values(scene)) > 1}
    for name in names or ():
        if name not in known:
            raise InputError(f"--knobs {name}: no such knob; wanted some of {', '.join(there)}")
        if name not in there:
            solvers = " and ".join(sorted(scene.solvers))
            raise InputError(f"--knobs {name}: a scene of {solvers} has no such knob; it has {', '.join(there)}")
    if cell_sizes:
        now = cell_size_of(scene)
        tried = tuple(cells_times(scene, size / now) for size in sorted({*cell_sizes, now}, reverse=True))
        there["cell_size"] = there["cell_size"]._replace(values=lambda scene: tried)
    return tuple(knob for knob in there.values() if names is None or knob.name in names)


def one_at_a_time(scene, knobs):
    """Settings: the scene as it is, then each knob's other values alone."""
    settings = [setting(scene, "scene")]
    for knob in knobs:
        settings += [setting(scene, knob.name, changes) for v in knob.values(scene) if (changes := _changing(scene, v))]
    return settings


def crossed(scene, knobs):
    """Settings: all combinations of three values (cheapest, as it is, dearest) of cell size, particles and cfl."""
    chosen = [knob for knob in knobs if knob.name in CROSSED]
    settings = []
    for values in product(*(_three(knob, scene) for knob in chosen)):
        turned = [changes for value in values if (changes := _changing(scene, value))]
        if len(turned) > 1:
            settings.append(setting(scene, "several", sum(turned, ())))
    return settings


def _three(knob, scene):
    values = knob.values(scene)
    return tuple(dict.fromkeys((values[0], (), values[-1])))


def _changing(scene, changes):
    """Those of `changes` that differ from the scene."""
    return tuple((key, value) for key, value in changes if not _same(value, _now(scene, key)))


def _now(scene, key):
    """What the scene has for a `key` of a change."""
    if key.startswith("stage"):
        return scene.stage[int(key.removeprefix("stage").partition(".")[0]) - 1].cell_size
    return courant_number(scene) if key == "cfl" else getattr(scene.numerics, key)


def reference(scene, settings, refinement=None):
    """The Setting that `settings` are held against: finer cells, half the Courant number.

    Cells are the scene's over `refinement`, without it the smallest of `settings` over the root of 2; those of all
    stages alike.

    Raises
    ------
    InputError
        Cells that are no finer than those of a setting.
    """
    now = dict(enumerate(size for _, size in _cells(scene)))
    smallest = min(size / now[n] for setting in settings for n, (_, size) in enumerate(_cells(setting.scene)))
    factor = smallest / STEP if refinement is None else 1.0 / refinement
    if factor > smallest / LEAST_FINER:
        own = cell_size_of(scene)
        raise InputError(
            f"--refinement {refinement:g} makes cells of {own * factor:g} m, but cells of {own * smallest:g} m are to "
            "be held against them; give a larger one, or other --cell-sizes"
        )
    return setting(scene, "reference", (*cells_times(scene, factor), ("cfl", 0.5 * courant_number(scene))))


def _same(value, now):
    return value == now if isinstance(value, str) else abs(value - now) <= 1e-9 * abs(now)
