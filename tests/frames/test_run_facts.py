"""Facts of a run from its record."""

import pytest

from mpmgis.frames.run_facts import record_facts

SCENE = {
    "release": {"source": "in/areas.gpkg", "thickness": 2.0, "density": 300},
    "friction": {"law": "Voellmy", "use": "auto", "mu": 0.25, "xi": 1000.0},
}


def test_facts_of_a_run_have_values():
    record = {"scene": SCENE, "reason": "at rest", "digest": "0123456789ab", "balances": {"mass_released": 3e5}}
    assert record_facts(record) == {
        "release": "areas.gpkg",
        "thickness": "2 m",
        "volume": "1000 m3",
        "density": "300 kg/m3",
        "friction": "Voellmy mu 0.25, xi 1000 m s-2",
        "ended": "at rest",
        "digest": "01234567",
    }


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"law": "Bingham", "yield_stress": 500, "viscosity": 20.0}, "Bingham yield_stress 500 Pa, viscosity 20 Pa s"),
        ({"law": "Voellmy", "mu": 0.2, "k": 0.01}, "Voellmy mu 0.2, k 0.01"),
        ({"law": "own.py:Mine", "b": 2.0}, "own.py:Mine b 2"),
        ({"law": "Coulomb"}, "Coulomb"),
    ],
)
def test_parameters_of_friction_have_the_units_of_their_law(table, words):
    assert record_facts({"scene": {"friction": table}})["friction"] == words


def test_a_measured_thickness_has_its_source():
    release = {"volume": 1234.4, "mean_thickness": 1.5, "largest_thickness": 3.0}
    scene = SCENE | {"release": {"thickness": "depth"}}
    facts = record_facts({"scene": scene, "release": release, "plan": {"vary": {"friction.mu": "0.1..0.3"}}})
    assert facts["vertical thickness"] == "from 'depth' 1.5 m on average, 3 m at most"
    assert (facts["volume"], facts["varied"]) == ("1234 m3", "friction.mu")


@pytest.mark.parametrize("record", [{}, {"scene": None}, {"scene": {"release": 3, "friction": "Coulomb"}}])
def test_a_record_without_a_scene_has_no_facts(record):
    assert record_facts(record) == {}
