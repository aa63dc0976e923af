"""Parts of a study against known cases: error laws, Pareto fronts, parameters, losses of exports."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpmgis.scene import scene_from_tables
from mpmgis.simulation import numerical_parameters
from mpmgis.studies import convergence, run_measures
from mpmgis.studies.run_measures import State, errors_against_exact, errors_of
from mpmgis.studies.study_table import fastest_as_accurate
from mpmgis.system.errors import InputError

SIZES = np.array([8.0, 4.0, 2.0, 1.0])


def scene(solver="columns", **numerics):
    tables = {
        "solver": solver,
        "terrain": {"dem": "dtm.tif"},
        "release": {"source": "a.shp", "thickness": 1.0},
        "output": {"end_time": 10.0, "frame_interval": 1.0},
        "numerics": {"cell_size": 4.0, "cfl": 0.3} | numerics,
    }
    if solver == "points":
        tables["material"] = {"law": "Fluid", "bulk_modulus": 1e6}
    return scene_from_tables(tables)


@pytest.mark.parametrize("order", [0.5, 1.0, 2.0])
def test_order_is_found_against_an_exact_solution(order):
    law = convergence.fitted(SIZES, 0.03 * SIZES**order)
    assert law.order == pytest.approx(order, abs=1e-3) and law.factor == pytest.approx(0.03, rel=1e-3)
    assert law.cell_size(law.error(3.0)) == pytest.approx(3.0)


@pytest.mark.parametrize("order", [0.7, 1.0, 2.0])
def test_order_is_found_against_a_finer_run_with_equal_kind_of_error(order):
    law = convergence.fitted(SIZES, 0.03 * (SIZES**order - 0.5**order), 0.5)
    assert not law.independent
    assert law.order == pytest.approx(order, abs=1e-3)
    assert law.error(0.5) == pytest.approx(0.03 * 0.5**order, rel=1e-2)


def test_order_is_found_against_a_finer_run_with_independent_error():
    law = convergence.fitted(SIZES, 0.03 * np.hypot(SIZES, 0.5), 0.5)
    assert law.independent and law.order == pytest.approx(1.0, abs=1e-3)
    assert law.error(0.5) == pytest.approx(0.015, rel=1e-2)


def test_errors_without_power_law_have_no_order():
    assert convergence.fitted(SIZES, [0.1, 0.4, 0.05, 0.3]) is None
    assert convergence.fitted(SIZES, [0.1, 0.1, 0.1, 0.1]) is None
    assert convergence.fitted([1.0], [0.1]) is None


def test_cell_size_below_which_refinement_is_not_worthwhile():
    assert convergence.stops_paying(SIZES, [0.8, 0.4, 0.38, 0.37]) == 4.0
    assert convergence.stops_paying(SIZES, [0.8, 0.4, 0.2, 0.1]) is None


def test_pareto_front():
    seconds, errors = [1.0, 2.0, 4.0, 3.0, 2.0], [0.4, 0.2, 0.1, 0.3, 0.2]
    exact = [(second, second) for second in seconds]
    assert convergence.on_front(exact, errors).tolist() == [True, True, True, False, True]
    assert convergence.time_over_front(seconds, exact, errors).tolist() == [1.0, 1.0, 1.0, 1.5, 1.0]
    assert convergence.on_front([(1.0, 1.0), (2.0, 2.0)], [np.nan, 0.1]).tolist() == [False, True]


def test_overlapping_times_are_ties():
    """4 s is a tie with 3 s if their ranges overlap: only the less accurate setting is dominated."""
    spreads = [(0.9, 1.1), (2.8, 3.9), (3.5, 4.4)]
    assert convergence.ties(spreads).tolist() == [[False] * 3, [False, False, True], [False, True, False]]
    assert convergence.on_front(spreads, [0.4, 0.2, 0.2]).tolist() == [True, True, True]
    assert convergence.on_front(spreads, [0.4, 0.2, 0.1]).tolist() == [True, False, True]
    assert convergence.on_front(spreads, [0.4, 0.1, 0.2]).tolist() == [True, True, False]
    assert convergence.time_over_front([1.0, 3.0, 4.0], spreads, [0.4, 0.2, 0.2]).tolist() == [1.0, 1.0, 1.0]


@settings(deadline=None, max_examples=50)
@given(st.lists(st.tuples(st.floats(0.5, 0.99), st.floats(1.01, 2.0), st.floats(0.0, 1.0)), min_size=1, max_size=8))
def test_noise_alone_gives_no_recommendation(rows):
    """All settings take a second within their range: none is over the front, and no gain changes the time."""
    spreads, errors = [row[:2] for row in rows], [row[2] for row in rows]
    assert convergence.time_over_front([sum(spread) / 2 for spread in spreads], spreads, errors).tolist() == [
        1.0
    ] * len(rows)
    others = [(str(k), k, sum(s) / 2, s, e) for k, (s, e) in enumerate(zip(spreads, errors, strict=True))]
    found = convergence.gains((1.0, spreads[0], errors[0]), others)
    assert all(gain.time == 1.0 and gain.error <= 1.0 - convergence.LEAST_FALL for gain in found)
    assert convergence.on_front(spreads, errors).tolist() == [error == min(errors) for error in errors]


def test_best_refinement_is_first_and_gains_without_cost_precede():
    others = [
        ("a", 1, 2.0, (2.0, 2.0), 0.2),
        ("b", 2, 8.0, (8.0, 8.0), 0.1),
        ("c", 3, 0.9, (0.9, 0.9), 0.3),
        ("d", 4, 2.0, (2.0, 2.0), 0.5),
        ("e", 5, 0.5, (0.5, 0.5), 0.39),
    ]
    found = convergence.gains((1.0, (1.0, 1.0), 0.4), others)
    assert [gain.parameter for gain in found] == ["c", "a", "b"]
    assert convergence.best_gains(found) == found[:1]
    assert math.isinf(found[0].pays) and found[1].pays == pytest.approx(1.0)
    assert found[2].pays == pytest.approx(math.log(4) / math.log(8))


def test_gains_with_overlapping_times_are_ties():
    base = (1.0, (0.95, 1.05), 0.4)
    a, b, c = ("a", 1, 2.0, (1.8, 2.3), 0.2), ("b", 2, 2.2, (1.9, 2.4), 0.2), ("c", 3, 8.0, (7.9, 8.1), 0.2)
    assert [gain.parameter for gain in convergence.best_gains(convergence.gains(base, [c, b, a]))] == ["a", "b"]


def test_runs_are_interleaved_and_every_second_turn_is_reversed():
    """A machine that slows down linearly affects all settings equally over two turns."""
    order, said, clock = [], [], iter(range(1000))

    class Flow:
        steps = particle_steps = 1
        mass_error = 0.0

        def __init__(self, name):
            order.append(name)

        def __iter__(self):
            return iter([SimpleNamespace(time=1.0)])

    cells = SimpleNamespace(state_of=lambda frame: State(frame.time, next(clock), 0.0, 0.0))
    made = run_measures.outcomes(
        "abc",
        lambda s: SimpleNamespace(particles=7, name=s),
        lambda p: None,
        lambda p: Flow(p.name),
        cells,
        [1.0],
        4,
        lambda p: 2.0,
        lambda turn, number: said.append((turn, number)),
    )
    assert "".join(order) == "abccbaabccba" and said[:4] == [(0, 0), (0, 1), (0, 2), (1, 2)]
    assert [one.setting for one in made] == ["a", "b", "c"] and all(len(one.seconds) == 4 for one in made)
    assert [one.states[0].thickness for one in made] == [0, 1, 2]  # of the first run; the others are the same


def test_parameters_change_one_at_a_time_after_the_scene():
    own = scene()
    settings = numerical_parameters.one_at_a_time(own, numerical_parameters.parameters_of(own))
    assert settings[0].scene == own and settings[0].name == "unchanged scene"
    for setting in settings[1:]:
        ((key, value),) = setting.changes
        assert getattr(setting.scene.numerics, key) == value != getattr(own.numerics, key)
        assert replace(setting.scene, numerics=own.numerics) == own
    assert {setting.parameter for setting in settings} == {"scene", "cell_size", "particles_per_cell", "cfl"}
    assert max(setting.scene.numerics.cfl for setting in settings) <= 0.9


def test_a_3d_scene_has_other_parameters():
    names = {parameter.name for parameter in numerical_parameters.parameters_of(scene("points"))}
    assert {"cell_size", "points_per_cell", "cfl", "stiffness"} <= names and "particles_per_cell" not in names


def test_combinations_differ_in_several_parameters():
    own = scene()
    crossed = numerical_parameters.crossed(own, numerical_parameters.parameters_of(own))
    assert all(len(setting.changes) > 1 for setting in crossed)
    assert len(crossed) == 3 * 3 * 3 - 1 - 3 * 2
    assert len({setting.changes for setting in crossed}) == len(crossed)


def staged(**numerics):
    """Columns on cells of 4 m, then points on cells of 1 m."""
    return scene_from_tables(
        {
            "terrain": {"dem": "dtm.tif"},
            "release": {"source": "a.shp", "thickness": 1.0},
            "output": {"end_time": 10.0, "frame_interval": 1.0},
            "material": {"law": "Fluid", "bulk_modulus": 1e6},
            "numerics": {"cell_size": 4.0} | numerics,
            "stage": [
                {"solver": "columns", "until": {"time": 5.0}, "cell_size": 4.0},
                {"solver": "points", "cell_size": 1.0},
            ],
        }
    )


def test_a_scene_in_stages_has_parameters_per_stage():
    own = staged()
    settings = numerical_parameters.one_at_a_time(own, numerical_parameters.parameters_of(own))
    found = {setting.changes: setting.scene for setting in settings}
    assert found[("points_per_cell", 27),].numerics.points_per_cell == 27
    both = found[("stage1.cell_size", 8.0), ("stage2.cell_size", 2.0)]
    assert [stage.cell_size for stage in both.stage] == [8.0, 2.0] and both.numerics == own.numerics
    alone = found[("stage2.cell_size", 2.0),]
    assert [stage.cell_size for stage in alone.stage] == [4.0, 2.0]
    assert found[("stage1.cell_size", 8.0),].stage[1] == own.stage[1]
    sizes = {(key, size) for ((key, size), *more) in filter(None, found) if not more and key.endswith(".cell_size")}
    assert sizes == {
        ("stage1.cell_size", 8.0),
        ("stage1.cell_size", 2.82843),
        *(("stage2.cell_size", size) for size in (2.0, 1.41421)),
    }
    assert found[("cfl", 0.8),].numerics.cfl == 0.8 and found[("particles_per_cell", 4),]
    assert {setting.parameter for setting in settings} == {
        "scene",
        "cell_size",
        "stage1.cell_size",
        "stage2.cell_size",
        "particles_per_cell",
        "points_per_cell",
        "cfl",
        "precision",
        "stiffness",
    }


def test_the_reference_of_a_scene_in_stages_is_finer_than_any_setting_in_each():
    own = staged()
    settings = numerical_parameters.one_at_a_time(own, numerical_parameters.parameters_of(own))
    finer = numerical_parameters.reference(own, settings)
    for n, stage in enumerate(finer.scene.stage):
        least = min(setting.scene.stage[n].cell_size for setting in settings)
        assert stage.cell_size < 0.8 * least
    assert finer.scene.numerics.cfl == 0.2 and finer.cell_size == finer.scene.stage[0].cell_size
    with pytest.raises(InputError, match="use a larger --refinement"):
        numerical_parameters.reference(own, settings, 1.0)


def test_the_work_of_a_setting_grows_with_finer_cells_more_particles_and_shorter_steps():
    own = staged()
    settings = numerical_parameters.one_at_a_time(own, numerical_parameters.parameters_of(own))
    turned = {s.changes: s.work_over(own) for s in settings}
    assert turned[()] == 1.0
    assert turned[("points_per_cell", 27),] == 27 / 8 and turned[("cfl", 0.2),] == 2.0
    assert turned[("stage1.cell_size", 8.0), ("stage2.cell_size", 2.0)] == 1 / 8
    assert scene().numerics.cell_size == 4.0
    assert numerical_parameters.setting(scene(), "cell_size", (("cell_size", 2.0),)).work_over(scene()) == 8.0


def test_fastest_setting_of_the_same_accuracy():
    seconds, errors = [1.0, 2.0, 4.0], [0.3, 0.2, 0.2]
    assert [fastest_as_accurate(seconds, errors, error) for error in (0.3, 0.25, 0.1, math.nan)] == [0, 1, None, None]


@pytest.mark.parametrize(
    ("own", "name", "words"),
    [
        (scene, "cel_size", "unknown parameter"),
        (scene, "points_per_cell", "not for columns"),
        (staged, "stage3.cell_size", "unknown parameter"),
        (staged, "stage2.cfl", "unknown parameter"),
    ],
)
def test_unknown_parameters_are_rejected(own, name, words):
    with pytest.raises(InputError, match=words):
        numerical_parameters.parameters_of(own(), (name,))


def state(thickness, speed=1.0, reach=10.0):
    thickness = np.asarray(thickness, float)
    return State(1.0, thickness, np.stack([thickness * speed, 0 * thickness], axis=-1), reach)


def test_errors_of_a_shifted_block():
    first, second = state([[1, 1, 0, 0]], 2.0, 12.0), state([[0, 1, 1, 0]], 2.0, 10.0)
    found = errors_of([first], [second])
    assert found.thickness == pytest.approx(1.0) and found.momentum == pytest.approx(1.0)
    assert found.area == pytest.approx(1 - 1 / 3) and found.reach == 2.0
    assert errors_of([second], [second]) == (0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("times", [1, 3])
@pytest.mark.parametrize(("film", "error"), [(0.0999, 0.0), (0.1001, 1 / 3)])
def test_a_film_of_less_than_a_hundredth_is_no_footprint(film, error, times):
    """Of the largest thickness of the reference at all times; a film of either run."""
    first = [state([[10.0, 5.0, 0.0]])] * (times - 1)
    thick, filmy = [*first, state([[10.0, 5.0, 0.0]])], [*first, state([[1.0, 5.0, film]])]
    assert errors_of(filmy, thick).area == pytest.approx(error)
    reference = [state([[10.0, 0.0, 0.0]]), state([[0.0, 1.0, film]])]
    assert errors_of([state([[1.0, 0.0, 0.0]]), state([[0.0, 1.0, 0.0]])], reference).area == pytest.approx(error)


def test_cells_without_exact_solution_are_ignored():
    found = errors_against_exact([state([[2, 1, 5]])], np.array([[1.0, 1.0, np.nan]]))
    assert found.thickness == pytest.approx(0.5) and math.isnan(found.area)
