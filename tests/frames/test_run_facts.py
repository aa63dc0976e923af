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
        "friction": "Voellmy mu 0.25 xi 1000",
        "ended": "at rest",
        "digest": "01234567",
    }


def test_a_measured_thickness_has_its_source():
    release = {"volume": 1234.4, "mean_thickness": 1.5, "largest_thickness": 3.0}
    scene = SCENE | {"release": {"thickness": "depth"}}
    facts = record_facts({"scene": scene, "release": release, "plan": {"vary": {"friction.mu": "0.1..0.3"}}})
    assert facts["vertical thickness"] == "from 'depth' 1.5 m on average, 3 m at most"
    assert (facts["volume"], facts["varied"]) == ("1234 m3", "friction.mu")


@pytest.mark.parametrize("record", [{}, {"scene": None}, {"scene": {"release": 3, "friction": "Coulomb"}}])
def test_a_record_without_a_scene_has_no_facts(record):
    assert record_facts(record) == {}
