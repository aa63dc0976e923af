"""Laws by number: numbers and tables agree, each number reaches its law, and what does nothing changes no bit."""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "solvers"))
from column_scenes import columns_of, solver_on, terrain_of

from mpmgis.laws import entrainment, friction, ground_metric
from mpmgis.laws.effect_slots import ColumnEffects, with_fixed_types
from mpmgis.laws.entrainment import Entrainment, entrainment_law
from mpmgis.laws.forest import FOREST_ENTRIES
from mpmgis.laws.friction import FRICTIONLESS, Friction, friction_law
from mpmgis.laws.internal_stress import EarthPressure, InPlaneViscosity
from mpmgis.solvers.columns.column_barriers import BARRIER_ENTRIES
from mpmgis.solvers.columns.feature_arrays import NO_LAKE, Places

STATE = (1500.0, 9.81, 8e3, 0.7, 3.0)
VALUES = (0.3, 0.6, 0.136, 0.05, 2.0, 0.7)


@pytest.mark.parametrize("name", friction.LAWS)
def test_each_number_of_friction_reaches_its_law(name):
    law, parameters = friction.LAWS[name]
    values = VALUES[: len(parameters)]
    made = friction_law(name, *values)
    assert friction.stress_parts(made, *STATE) == law(*values, *STATE)
    others = [law(*VALUES[: len(p)], *STATE) for other, (law, p) in friction.LAWS.items() if other != name]
    assert law(*values, *STATE) not in others  # so that no other law passes for it


@pytest.mark.parametrize("name", entrainment.LAWS)
def test_each_number_of_erosion_reaches_its_law(name):
    law = entrainment.LAWS[name][0]
    assert entrainment.erosion_rate(entrainment_law(name, 0.3), 1500.0, 2e3, 3.0) == law(0.3, 1500.0, 2e3, 3.0) > 0.0


@pytest.mark.parametrize("form", ground_metric.FORMS)
def test_each_number_of_a_metric_reaches_its_law(form):
    number = list(ground_metric.FORMS).index(form)
    assert ground_metric.metric_gradient(number, 0.3, 0.4) == ground_metric.FORMS[form](0.3, 0.4)
    assert ground_metric.cosine_squared(*ground_metric.FORMS[form](0.3, 0.4)) == {"slope": 0.8, "swe": 1.0}[form]


def test_numbers_are_places_in_the_tables():
    kinds = (
        *("COULOMB", "VOELLMY", "MODIFIED_VOELLMY", "BINGHAM", "POULIQUEN"),
        *("SAMOS_AT", "VOELLMY_MIN_SHEAR", "OBRIEN", "HERSCHEL_BULKLEY", "MANNING"),
    )
    assert [getattr(friction, kind) for kind in kinds] == [friction.NAMES.index(name) for name in friction.LAWS]
    assert [name.upper() for name in friction.LAWS] == [kind.replace("_", "") for kind in kinds]
    numbers = [entrainment.EROSION_ENERGY, entrainment.EROSION_SPEED]
    assert numbers == [entrainment.NAMES.index(name) for name in ("ErosionEnergy", "ErosionSpeed")]
    assert [list(ground_metric.FORMS).index(f) for f in ("slope", "swe")] == [ground_metric.SLOPE, ground_metric.WATER]
    assert (friction.NO_FRICTION, entrainment.NO_EROSION) == (0, 0)


def test_absent_laws_answer_with_nothing():
    assert friction.stress_parts(FRICTIONLESS, *STATE) == (0.0, 0.0, 0.0)
    assert entrainment.erosion_rate(Entrainment(), 1500.0, 2e3, 3.0) == 0.0


class Own(NamedTuple):
    mu: float


def test_numbers_in_slots_get_the_types_of_their_fields():
    """So that no other number compiles another program."""
    made = ColumnEffects(
        Friction(np.int64(1), 1),
        np.True_,
        5,
        earth_pressure=EarthPressure(1, np.float32(2.0)),
        viscosity=InPlaneViscosity(1, 2),
        entrainment=Entrainment(1.0, 5, 0),
    )
    plain = with_fixed_types(made)
    assert plain == made
    for law in plain:
        for number in law if isinstance(law, tuple) else (law,):
            assert type(number) in (bool, int, float)
    assert [type(value) for value in plain.friction] == [int, *[float] * 6]
    assert type(plain.entrainment.kind) is int and type(plain.zones) is bool and type(plain.cohesion) is float
    own = with_fixed_types(ColumnEffects(Own(1))).friction
    assert type(own) is Own and type(own.mu) is float


def does_nothing(name, shape):
    """(effects, Places) of an effect that is on, with values at which it does nothing."""
    nodes = np.zeros((*shape, 1))
    return {
        "nothing": ({}, {}),
        "zones": ({"zones": True}, {"zone_values": nodes + np.array([0.2, 800.0])}),
        "cohesion": ({"cohesion": 0.0}, {}),
        "still_water": ({"still_water": True}, {"lake_level": np.full((shape[0] - 3, shape[1] - 3), NO_LAKE)}),
        "earth_pressure": ({"earth_pressure": EarthPressure(1.0, 1.0 + 1e-300)}, {}),
        "viscosity": ({"viscosity": InPlaneViscosity(1e-300, 0.0)}, {}),
        "entrainment": ({"entrainment": entrainment_law("ErosionSpeed", 0.01, 1e-3)}, {"erodible": nodes[..., 0]}),
        "barrier": ({"barrier": True}, {"barriers": nodes + np.zeros(BARRIER_ENTRIES), "barrier_names": ("none",)}),
        "forest": ({"forest": True}, {"forest": nodes + np.zeros(FOREST_ENTRIES)}),
    }[name]


@pytest.mark.parametrize("name", sorted(set(ColumnEffects._fields) - {"friction", "metric", "curvature"}))
def test_an_effect_that_does_nothing_changes_no_bit(name):
    """Its branch takes the same arithmetic: adding 0 and multiplying by 1 are exact.

    Parts of the curvature are in `tests/solvers/test_curvature_parts.py`.
    """
    terrain = terrain_of(lambda x, y: 40.0 - 0.3 * x + 0.001 * x * y, 100.0, 60.0, 5.0)
    frame = columns_of(1.0, 10.0, 40.0, 20.0, 40.0, 2.5, velocity=(8.0, -3.0))

    def after(laws, places):
        law = friction_law("Voellmy", 0.2, 800.0)
        solver = solver_on(terrain, frame, 5.0, law, places=Places(**places), laws=laws, maxima=True)
        solver.advance(10.0, max_steps=20)
        return solver._alive()[0].tobytes() + solver.arrays.peaks.tobytes()

    shape = solver_on(terrain, frame, 5.0).grid.bed.shape
    assert after(*does_nothing(name, shape)) == after({}, {})
