"""Measured cost of effects: which effects are left out, the arithmetic with an artificial clock, and a real flow."""

from types import SimpleNamespace

import numpy as np
import pytest
from column_scenes import columns_of, solver_on, terrain_of

from mpmgis.laws.curvature import LOAD, NO_CURVATURE
from mpmgis.laws.effect_slots import ColumnEffects
from mpmgis.laws.friction import FRICTIONLESS, friction_law
from mpmgis.laws.ground_metric import WATER
from mpmgis.simulation.effect_cost import STEPS, effect_costs, under_way, without_each
from mpmgis.simulation.release_events import Events
from mpmgis.system.errors import SceneError


def test_each_effect_is_left_out_and_nothing_else():
    whole = ColumnEffects(friction_law("Voellmy", 0.2, 1000.0), True, 100.0, curvature=LOAD, barrier=True)
    variants = without_each(whole)
    assert set(variants) == {"friction", "turbulent_drag", "zones", "cohesion", "curvature", "barrier"}
    changed = {
        name: {slot for slot in whole._fields if getattr(variant, slot) != getattr(whole, slot)}
        for name, variant in variants.items()
    }
    assert changed.pop("friction") == {"friction", "zones"}
    assert changed.pop("turbulent_drag") == {"friction"}
    assert all(slots == {name} for name, slots in changed.items())
    assert variants["friction"].friction == FRICTIONLESS and not variants["friction"].zones
    assert variants["turbulent_drag"].friction == friction_law("Coulomb", 0.2) and variants["turbulent_drag"].zones
    assert variants["curvature"].curvature == NO_CURVATURE and not variants["barrier"].barrier


def test_what_has_no_drag_or_no_absence_is_not_left_out():
    assert without_each(ColumnEffects()) == {}
    assert set(without_each(ColumnEffects(friction_law("Bingham", 100.0, 10.0)))) == {"friction"}
    assert set(without_each(ColumnEffects(friction_law("ModifiedVoellmy", 0.3, 500.0, 4.0)))) == {
        "friction",
        "turbulent_drag",
    }
    lake = without_each(ColumnEffects(metric=WATER, still_water=True))
    assert set(lake) == {"still_water"} and not lake["still_water"].still_water
    assert lake["still_water"].metric == WATER


class Timed:
    """A solver whose steps take `milliseconds` in total, those of an effect only while it is on; every seventh
    measurement is disturbed. The times do not depend on the machine."""

    def __init__(self, effects, friction, cohesion, rest, last=10**9):
        self.effects, self.cost, self.last = effects, (friction, cohesion, rest), last
        self.now, self.step, self.time, self.particles, self.looks = 0.0, 0, 7.0, 50, 0

    def restore(self, start):
        self.step = start

    def advance(self, until, max_steps, may_stop):
        friction, cohesion, rest = self.cost
        rest += friction * (self.effects.friction != FRICTIONLESS) + cohesion * (self.effects.cohesion > 0.0)
        self.looks += 1
        self.now += max_steps * rest * (3.0 if self.looks % 7 == 0 else 1.0)
        self.step = min(self.step + max_steps, self.last)


def test_shares_are_what_a_step_saves_whatever_disturbs_some_of_them():
    effects = ColumnEffects(friction_law("Coulomb", 0.3), cohesion=50.0)
    solver = Timed(effects, friction=0.03, cohesion=0.05, rest=0.02)
    costs = effect_costs(solver, 3, lambda: solver.now)
    assert costs.shares == pytest.approx({"friction": 0.3, "cohesion": 0.5})
    assert costs.noise == pytest.approx(0.0, abs=1e-9) and costs.step_seconds == pytest.approx(0.1)
    assert (costs.columns, costs.time) == (50, 7.0)
    assert (solver.step, solver.effects) == (3, effects)


def test_a_machine_that_slows_down_is_reported_as_noise():
    effects = ColumnEffects(friction_law("Coulomb", 0.3))
    solver = Timed(effects, friction=0.0, cohesion=0.0, rest=0.1)
    slower = SimpleNamespace(looks=0)

    def clock():
        slower.looks += 1
        return solver.now * (1.0 + 0.001 * slower.looks)

    costs = effect_costs(solver, 0, clock=clock)
    assert costs.noise > 0.0


def test_a_flow_that_ends_has_no_cost():
    solver = Timed(ColumnEffects(friction_law("Coulomb", 0.3)), 0.1, 0.0, 0.1, last=STEPS // 2)
    with pytest.raises(SceneError, match="the flow ends within"):
        effect_costs(solver, 0, clock=lambda: solver.now)
    assert solver.effects == ColumnEffects(friction_law("Coulomb", 0.3))


def test_the_flow_is_measured_under_way_and_left_as_it_was():
    """A sheet on 20 degrees: it is moving, and after all measurements its state is the same, to the bit."""
    terrain = terrain_of(lambda x, y: -np.tan(np.radians(20.0)) * x, 200.0, 60.0, 5.0)
    solver = solver_on(terrain, columns_of(1.0, 20.0, 60.0, 20.0, 40.0, 2.5), 5.0, friction_law("Coulomb", 0.1))
    start = under_way(solver, Events(), 3.0)
    assert 0.5 < start.time <= 3.0 and np.linalg.norm(start.particles.velocity, axis=1).max() > 1.0
    costs = effect_costs(solver, start)
    assert set(costs.shares) == {"friction"} and costs.shares["friction"] < 1.0 and costs.step_seconds > 0.0
    assert costs.time == start.time == solver.time and solver.effects.friction != FRICTIONLESS
    for name, values in solver.frame().particles.arrays().items():
        assert values.tobytes() == start.particles.arrays()[name].tobytes(), name
