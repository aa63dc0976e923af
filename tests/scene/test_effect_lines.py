"""What the list of effects says of each number: what it is, and which results its limit protects."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpmgis.scene import scene_from_tables
from mpmgis.scene.decision_rules import TerrainFacts, as_asked
from mpmgis.scene.effect_decisions import resolve

TABLES = {
    "terrain": {"dem": "dtm.tif"},
    "release": {"source": "a.shp", "thickness": 1.0},
    "friction": {"law": "Voellmy", "mu": 0.3, "xi": 2000.0},
    "cohesion": {"yield_stress": 20.0},
    "earth_pressure": {"friction_angle": 30.0},
    "viscosity": {"viscosity": 100.0},
    "output": {"end_time": 10.0, "frame_interval": 1.0},
}
LIMITED = ("turbulent_drag", "cohesion", "earth_pressure", "viscosity", "curvature")


@given(
    st.floats(0.0, 3.0), st.floats(0.01, 30.0), st.floats(0.0, 90.0), st.floats(1.0, 500.0), st.floats(100.0, 3000.0)
)
def test_numbers_of_any_ground_can_be_read_and_limits_name_what_they_protect(slope, thickness, speed, length, density):
    """No 2e+05, on level ground neither; every limit that leaves an effect out says which results it protects."""
    facts = TerrainFacts(0.01, slope, 100.0, speed, release_thickness=thickness, release_length=length, density=density)
    _, decisions = resolve(scene_from_tables(TABLES), facts)
    found = {decision.effect: decision for decision in decisions}
    for name in LIMITED:
        assert "below the limit" in found[name].reason, name
    for decision in decisions:
        head = decision.line()[: -len(decision.reason)]
        assert not re.search(r"\de[+-]\d", head), head
    assert (found["friction"].indicator is None) == (slope < 0.01)


def test_zones_without_friction_do_not_claim_to_be_off_in_the_scene():
    tables = TABLES | {"friction": TABLES["friction"] | {"use": "off"}, "zones": [{"source": "z.gpkg", "mu": 0.1}]}
    facts = TerrainFacts(0.0, 0.5, 100.0, 20.0, zone_spread=0.5)
    _, decisions = resolve(scene_from_tables(tables), facts)
    (zones,) = (decision for decision in decisions if decision.effect == "zones")
    assert zones.state == "off" and "use = " not in zones.reason


@pytest.mark.parametrize(
    "value, text", [(2e5, "> 1000"), (1e-5, "< 0.001"), (0.0, "0"), (12.34, "12.3"), (-5e4, "< -1000")]
)
def test_a_number_without_meaning_is_not_printed_in_full(value, text):
    assert text in as_asked("friction", "auto", "words", value).line().split("words")[0]
