"""Errors of the depth-averaged solver against exact solutions, at three resolutions: the table of validation.md.

The cases are those of the tests, with columns as `run` seeds them. Other codes were measured on the same cases with the
same exact solutions and norms: com1DFA of AvaFrame 2.1 with its own test settings (SPH kernel as wide as a cell, 20 and
25 particles in it); "prototype" is the prototype of the design.
"""

import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "solvers"))
from catalogue_scenes import cap_on_slope, energy_drift_in_a_valley, pool_in_bowl, runout_angle
from column_scenes import dam_break, orders, relative_l1

from mpmgis.laws.curvature import TURN
from mpmgis.laws.ground_metric import WATER
from mpmgis.scene.tables import NumericsTable
from mpmgis.solvers.columns.column_solver import CFL_ALONE

DEFAULTS = {  # columns along a cell's side and Courant number, as `run` has them
    "per_side": round(NumericsTable().particles_per_cell ** 0.5),
    "cfl": CFL_ALONE,
}

HEADINGS = ("case", "cells", "error", "order", "required", "other codes, same cells")


def _water(tail):
    """Error [%] of the depth of a dam break on level ground, dry or on `tail` m of water."""

    def error(dx):
        _, h, exact, _ = dam_break(dx, metric=WATER, tail=tail, **DEFAULTS)
        return 100 * relative_l1(h, exact)

    return error


def _slope(degrees, friction):
    """Error [%] of the depth of a dam break on a slope, from 50 m above the dam on."""

    def error(dx):
        x, h, exact, _ = dam_break(dx, degrees=degrees, friction_degrees=friction, reservoir=80, length=160, **DEFAULTS)
        return 100 * relative_l1(h, exact, x > -50)

    return error


def _cap(time, friction):
    """Error [%], relative L2, of the thickness of a cap on 35 degrees."""
    return lambda dx: 100 * cap_on_slope(dx, time, friction, **DEFAULTS)[0]


def _pool(kind):
    return lambda dx: 100 * pool_in_bowl(kind, dx, **DEFAULTS)[0]


def _energy_off(dx):
    return 100 * abs(energy_drift_in_a_valley(100.0, dx, **DEFAULTS)[0])


def _angle_off(dx):
    return abs(runout_angle(TURN, dx, **DEFAULTS)[0] - np.degrees(np.arctan(0.4)))


class Case(NamedTuple):
    """One row: name, cell sizes [m], error and its unit, requirement of the catalogue, errors of other codes.

    `asked` is (largest error, on cells of [m]); `others` a name and its errors on the same cells.
    """

    name: str
    cells: tuple
    error: Callable
    unit: str
    asked: tuple
    others: tuple = ("", ())


METRES, PROTOTYPE, COM1DFA = (1.0, 0.5, 0.25), "prototype", "com1DFA"
CASES = (
    Case("water from a dam onto dry ground", METRES, _water(0.0), "%", (3, 1), (PROTOTYPE, (2.3, 1.95, 1.8))),
    Case("water from a dam into water", METRES, _water(1.0), "%", (1.5, 0.5), (PROTOTYPE, (1.20, 0.67, 0.34))),
    Case("dam on 22 degrees, no friction", METRES, _slope(22, 0), "%", (3, 1)),
    Case("dam on 30 degrees, friction 20", METRES, _slope(30, 20), "%", (3, 1)),
    Case("dam on 35 degrees, friction 25", METRES, _slope(35, 25), "%", (3, 1)),
    Case("the same, coarser", (4.0, 2.0, 1.0), _slope(35, 25), "%", (3, 1), (COM1DFA, (5.0, 3.7, 2.9))),
    Case("cap on 35 degrees, no friction, 5 s", (8.0, 4.0, 2.0), _cap(5.0, 0), "%", (5, 4)),
    Case("cap with friction 25, 5 s", (8.0, 4.0, 2.0), _cap(5.0, 25), "%", (5, 4), (COM1DFA, (5.9, 3.6, 3.5))),
    Case("the same after 10 s", (8.0, 4.0, 2.0), _cap(10.0, 25), "%", (5, 4)),
    Case("pool that circles in a bowl", (0.8, 0.4, 0.2), _pool("slosh"), "%", (1, 0.2)),
    Case("pool that breathes in a bowl", (0.8, 0.4, 0.2), _pool("breathe"), "%", (3, 0.2)),
    Case("energy of a body in a valley", (2.5, 1.0, 0.5), _energy_off, "%", (3, 1)),
    Case("run-out angle, Coulomb 0.4", (4.0, 2.0, 1.0), _angle_off, "degrees", (0.5, 4)),
)


@cache
def _errors(case):
    return tuple(case.error(dx) for dx in case.cells)


def _asked(case):
    return f"{case.asked[0]:g} {case.unit} at {case.asked[1]:g} m"


def rows():
    """Rows of the table: the error of each case for each cell size; the ratio is to the error of the other code."""
    for case in CASES:
        name, others = case.others[0], case.others[1] or (None,) * len(case.cells)
        for dx, error, other in zip(case.cells, _errors(case), others, strict=True):
            reference = f"exact; asked for {_asked(case)}" + (f"; {name} {other:g} {case.unit}" if other else "")
            yield f"{case.name}, cells {dx:g} m", error, case.unit, reference, error / other if other else None


def summary():
    """(headings, rows of words): one row per case, for validation.md."""
    return HEADINGS, [_words(case) for case in CASES]


def _words(case):
    errors, (name, others) = _errors(case), case.others
    halvings = np.log2(np.array(case.cells[:-1]) / case.cells[1:])  # an order counts per halving
    order = [found / by for found, by in zip(orders(errors), halvings, strict=True)]
    return (
        case.name,
        ", ".join(f"{dx:g}" for dx in case.cells) + " m",
        ", ".join(f"{error:.2g}" for error in errors) + f" {case.unit}",
        ", ".join(f"{number:.1f}" for number in order),
        _asked(case),
        f"{name}: " + ", ".join(f"{other:g}" for other in others) + f" {case.unit}" if others else "",
    )
