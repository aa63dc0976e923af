"""The knobs that trade accuracy for time, and the settings of them that a study tries (design notes 9)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

from ..errors import InputError
from ..scene.tables import NumericsTable

HIGHEST_CFL = NumericsTable.__dataclass_fields__["cfl"].metadata["high"]  # above it the schemes are unstable
STEP = 2.0**0.5  # between two cell sizes
# cost goes with the inverse cell size to this power: particles with the square or cube, steps with one more
COST_POWER = {"columns": 3, "points": 4}
LEAST_FINER = 1.2  # times finer cells make a reference
COLUMNS_A_CELL = (4, 9, 16, 25, 36)


class Knob(NamedTuple):
    """A key of [numerics] that costs time; `values(scene)` gives what is tried, from cheap to dear."""

    name: str
    values: Callable


def _cell_sizes(scene):
    """Coarser by 2, by its root, as the scene has it; columns, which cost less, also finer by the root of 2."""
    factors = (2.0, STEP, 1.0, 1.0 / STEP) if scene.solver == "columns" else (2.0, STEP, 1.0)
    return tuple(float(f"{scene.numerics.cell_size * factor:.6g}") for factor in factors)


def _columns_a_cell(scene):
    if scene.solver != "columns":
        return ()
    return tuple(sorted({*COLUMNS_A_CELL, scene.numerics.particles_per_cell}))


def _points_a_cell(scene):
    return _choices("points_per_cell")[:2] if scene.solver == "points" else ()


def _courant_numbers(scene):
    cfl = scene.numerics.cfl
    return tuple(sorted({min(2.0 * cfl, HIGHEST_CFL), cfl, 0.5 * cfl}, reverse=True))


def _precisions(scene):
    return tuple(sorted(_choices("precision"))) if scene.solver == "points" else ()


def _stiffnesses(scene):
    return ("scaled", "given") if scene.solver == "points" else ()


def _choices(key):
    """What the scene's language allows for a key of [numerics]."""
    return NumericsTable.__dataclass_fields__[key].metadata["choices"]


KNOBS = (
    Knob("cell_size", _cell_sizes),
    Knob("particles_per_cell", _columns_a_cell),
    Knob("points_per_cell", _points_a_cell),
    Knob("cfl", _courant_numbers),
    Knob("precision", _precisions),
    Knob("stiffness", _stiffnesses),
)
BY_NAME = {knob.name: knob for knob in KNOBS}
CROSSED = ("cell_size", "particles_per_cell", "points_per_cell", "cfl")  # of --full, three values each


@dataclass(frozen=True)
class Setting:
    """One set of values that is tried.

    Parameters
    ----------
    knob : str
        The one that differs from the scene; "scene", "reference", or "several".
    changes : tuple of (str, value)
        Keys of [numerics] and what they are set to.
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


def setting(scene, knob, **changes):
    """The Setting of `scene` with `changes` to its [numerics]."""
    return Setting(knob, tuple(changes.items()), replace(scene, numerics=replace(scene.numerics, **changes)))


def knobs_of(scene, names=None, cell_sizes=None):
    """The knobs that `scene` has, all or those of `names`; `cell_sizes` [m] are tried instead of the usual ones.

    Raises
    ------
    InputError
        A name that is no knob, or not one of this solver.
    """
    there = {knob.name: knob for knob in KNOBS if len(knob.values(scene)) > 1}
    for name in names or ():
        if name not in BY_NAME:
            raise InputError(f"--knobs {name}: no such knob; wanted some of {', '.join(there)}")
        if name not in there:
            raise InputError(f"--knobs {name}: solver = {scene.solver!r} has no such knob; it has {', '.join(there)}")
    if cell_sizes:
        tried = tuple(sorted({*cell_sizes, scene.numerics.cell_size}, reverse=True))
        there["cell_size"] = there["cell_size"]._replace(values=lambda scene: tried)
    return tuple(knob for knob in there.values() if names is None or knob.name in names)


def one_at_a_time(scene, knobs):
    """Settings: the scene as it is, then each knob's other values alone."""
    settings = [setting(scene, "scene")]
    for knob in knobs:
        now = getattr(scene.numerics, knob.name)
        settings += [setting(scene, knob.name, **{knob.name: v}) for v in knob.values(scene) if not _same(v, now)]
    return settings


def crossed(scene, knobs):
    """Settings: all combinations of three values (cheapest, as it is, dearest) of cell size, particles and cfl."""
    chosen = [knob for knob in knobs if knob.name in CROSSED]
    settings = []
    for values in product(*(_three(knob, scene) for knob in chosen)):
        changes = {
            k.name: v for k, v in zip(chosen, values, strict=True) if not _same(v, getattr(scene.numerics, k.name))
        }
        if len(changes) > 1:
            settings.append(setting(scene, "several", **changes))
    return settings


def _three(knob, scene):
    values, now = knob.values(scene), getattr(scene.numerics, knob.name)
    return tuple(dict.fromkeys((values[0], now, values[-1])))


def reference(scene, settings, refinement=None):
    """The Setting that `settings` are held against: finer cells, half the Courant number.

    Cells are the scene's over `refinement`, without it the smallest of `settings` over the root of 2.

    Raises
    ------
    InputError
        Cells that are no finer than those of a setting.
    """
    numerics, smallest = scene.numerics, min(setting.scene.numerics.cell_size for setting in settings)
    size = smallest / STEP if refinement is None else numerics.cell_size / refinement
    if size > smallest / LEAST_FINER:
        raise InputError(
            f"--refinement {refinement:g} makes cells of {size:g} m, but cells of {smallest:g} m are to be held "
            "against them; give a larger one, or other --cell-sizes"
        )
    return setting(scene, "reference", cell_size=float(f"{size:.6g}"), cfl=0.5 * numerics.cfl)


def _same(value, now):
    return value == now if isinstance(value, str) else abs(value - now) <= 1e-9 * abs(now)
