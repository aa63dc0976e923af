"""Tables of the material: what is refused, what comes back from text, and how numbers decide."""

import json

import pytest

from mpmgis.laws.effect_slots import ColumnEffects
from mpmgis.laws.friction import FRICTIONLESS, LAWS, friction_law
from mpmgis.laws.internal_stress import EarthPressure, InPlaneViscosity, earth_pressure
from mpmgis.scene import TerrainFacts, read_scene, resolve, scene_from_tables, scene_text, template
from mpmgis.scene.mass_point_runout import runout
from mpmgis.system.errors import SceneError

TABLES = {"terrain": {"dem": "d.tif"}, "release": {"source": "r.shp"}, "output": {"end_time": 5, "frame_interval": 1}}
RAMP = tuple((10.0 * k, max(500.0 - 4.0 * k, 0.0)) for k in range(400))  # 22 degrees for 1250 m, then flat
FACTS = TerrainFacts(
    centrifugal_ratio=0.2,
    slope_median=0.4,
    drop=500.0,
    speed=40.0,
    slope_steep=0.8,
    release_thickness=2.0,
    release_length=100.0,
    density=1000.0,
    profile=RAMP,
)


def scene(**tables):
    return scene_from_tables({**TABLES, **tables})


def decided(given, facts=FACTS):
    """(effects, name -> decision)."""
    effects, decisions = resolve(given, facts)
    return effects, {d.effect: d for d in decisions}


@pytest.mark.parametrize("name", LAWS)
def test_every_law_can_be_named_and_comes_back_from_text(name, tmp_path):
    values = {key: p.default or max(p.smallest, 0.5) for key, p in LAWS[name][1].items()}
    given = scene(
        friction={"law": name, **values},
        cohesion={"yield_stress": 50},
        viscosity={"viscosity": 3},
        earth_pressure={"friction_angle": 40},
    )
    path = tmp_path / "scene.toml"
    path.write_text(scene_text(given))
    assert read_scene(path).as_tables() == given.as_tables()
    assert f"law = '{name}' takes" in template()


def test_a_default_is_taken_where_a_law_has_one():
    given = scene(friction={"law": "ModifiedVoellmy", "mu": 0.5, "xi": 400})
    assert given.friction.parameters["crossover_speed"] == 4.0


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"cohesion": {}}, "yield_stress is missing"),
        ({"cohesion": {"yield_stress": -1}}, "at least 0"),
        ({"cohesion": {"yield_stres": 1}}, "did you mean 'yield_stress'"),
        ({"viscosity": {"viscosity": 0}}, "both 0"),
        ({"viscosity": {"viscosity": float("nan")}}, "finite"),
        ({"earth_pressure": {"friction_angle": 20, "bed_friction_angle": 25}}, "above friction_angle = 20"),
        ({"earth_pressure": {"friction_angle": 20}, "friction": {"law": "Coulomb", "mu": 0.5}}, "atan of the friction"),
        ({"earth_pressure": {"friction_angle": 95}}, "at most 89"),
        ({"friction": {"law": "Bingam", "yield_stress": 1, "viscosity": 1}}, "did you mean 'Bingham'"),
        ({"friction": {"law": "Bingham", "yield_stress": 1}}, "needs viscosity [Pa s]"),
        ({"friction": {"law": "Pouliquen", "mu1": 0.5, "mu2": 0.4, "length": 1e-3}}, "below mu1"),
        ({"cohesion": {"yield_stress": 1, "use": "perhaps"}}, "expected auto, on, off"),
        ({"friction": {"law": ["Coulomb"]}}, "[friction]: law = ['Coulomb'], expected text"),
        ({"friction": {"law": {"name": "Coulomb"}}}, "[friction]: law = {'name': 'Coulomb'}, expected text"),
        ({"terrain": {"dem": ""}}, "[terrain]: dem is empty, expected a file name"),
        ({"release": {"source": ""}}, "[release]: source is empty, expected a file name"),
        ({"release": {"particles": ""}}, "[release]: particles is empty, expected a file name"),
        ({"release": {"source": "r.shp", "thickness": ""}}, "thickness is empty, expected a number or the name of a"),
        ({"barrier": [{"source": "", "height": 3}]}, "[[barrier]] number 1: source is empty, expected a file name"),
        ({"barrier": [{"source": "b.shp", "height": 3, "name": "a\nb"}]}, "name = 'a\\nb' contains control characters"),
        ({"terrain": {"dem": "d.tif", "window": [0, 0, 10**400, 1]}}, "expected four numbers [west, south, east"),
        ({"release": {"source": "r.shp", "density": "9" * 5000}}, f"density = '{'9' * 76}..., expected a number"),
        (
            {"release": {"source": "r.shp", "density": [16**5000]}},
            "density = a number of thousands of digits, expected",
        ),
    ],
)
def test_invalid_scenes_are_refused_in_one_line(tables, words):
    with pytest.raises(SceneError) as error:
        scene(**tables)
    assert words in str(error.value) and "\n" not in str(error.value)


def test_effects_that_are_off_leave_the_types_of_a_scene_without_them():
    """The compiled solver is chosen by these types: an absent effect adds no field and no instruction."""
    friction = {"law": "Voellmy", "mu": 0.2, "xi": 1500}
    bare, _ = decided(scene(friction=friction))
    use_off, _ = decided(
        scene(
            friction=friction,
            cohesion={"yield_stress": 500, "use": "off"},
            earth_pressure={"friction_angle": 40, "use": "off"},
            viscosity={"viscosity": 500, "use": "off"},
        )
    )
    auto_off, decisions = decided(
        scene(
            friction=friction,
            cohesion={"yield_stress": 5},
            viscosity={"viscosity": 5},
            earth_pressure={"friction_angle": 40},
        ),
        FACTS._replace(release_length=20000.0),
    )
    for name in ("cohesion", "earth_pressure", "viscosity"):
        assert (decisions[name].state, decisions[name].decided_by) == ("off", "auto")
    assert list(map(type, bare)) == list(map(type, use_off)) == list(map(type, auto_off))
    nothing, _ = decided(scene(curvature={"use": "off"}))
    assert nothing == ColumnEffects()


@pytest.mark.parametrize(
    ("name", "table", "law"),
    [
        ("cohesion", {"yield_stress": 5.0}, 5.0),
        ("viscosity", {"viscosity": 5.0}, InPlaneViscosity(5.0, 0.0)),
        ("earth_pressure", {"friction_angle": 40.0, "bed_friction_angle": 20.0}, earth_pressure(40.0, 20.0)),
    ],
)
def test_on_is_on_whatever_the_number(name, table, law):
    effects, decisions = decided(scene(**{name: {**table, "use": "on"}}), FACTS._replace(release_length=1e6))
    assert getattr(effects, name) == law
    assert (decisions[name].state, decisions[name].decided_by) == ("on", "forced")


def test_cohesion_is_decided_by_its_share_of_the_load():
    load = 1000.0 * 9.81 * 2.0
    for share, on in ((0.0019, False), (0.0021, True)):
        effects, decisions = decided(scene(cohesion={"yield_stress": share * load}))
        assert effects.cohesion == (share * load if on else 0.0)
        assert decisions["cohesion"].indicator == pytest.approx(share)


def test_earth_pressure_takes_the_beds_angle_from_mu():
    effects, decisions = decided(scene(friction={"law": "Coulomb", "mu": 0.35}, earth_pressure={"friction_angle": 35}))
    expected = earth_pressure(35.0, 19.290046219188735)
    assert effects.earth_pressure == pytest.approx(expected)
    ratio = 2.0 / (100.0 * 0.05) * (expected.passive - 1.0)
    assert decisions["earth_pressure"].indicator == pytest.approx(ratio)
    assert decided(scene())[0].earth_pressure == EarthPressure()


@pytest.mark.parametrize(
    "table, mu, xi",
    [
        ({"law": "VoellmyMinShear", "mu": 0.2, "xi": 3000}, 0.2, 3000.0),
        (
            {"law": "OBrien", "yield_stress": 0.0, "viscosity": 20, "manning_n": 0.05},
            0.0,
            (2 / 1.16**0.5) ** (1 / 3) / 0.05**2,
        ),
        ({"law": "Manning", "manning_n": 0.05, "mu": 0.1}, 0.1, (2 / 1.16**0.5) ** (1 / 3) / 0.05**2),
    ],
)
def test_every_law_with_turbulent_drag_names_it(table, mu, xi):
    """(U / U_t)^2 with the speed U_t at which drag balances the drive: xi of Chezy's h^(1/3) / n^2 for Manning's n."""
    drag = decided(scene(friction=table))[1]["turbulent_drag"]
    terminal = xi * 2.0 / 1.16**0.5 * (0.4 - mu) / 1.16**0.5
    assert drag.state == "on" and drag.indicator == pytest.approx(FACTS.speed**2 / terminal, rel=1e-9)
    samos = decided(scene(friction={"law": "SamosAT", "mu": 0.155}))[1]["turbulent_drag"]
    assert samos.state == "on" and samos.indicator > 0.0
    for law in (
        {"law": "Coulomb", "mu": 0.2},
        {"law": "HerschelBulkley", "yield_stress": 100, "consistency": 50, "exponent": 0.5},
    ):
        assert decided(scene(friction=law))[1]["turbulent_drag"].state == "off"


def test_drag_that_changes_little_is_left_out_of_voellmy_unless_forced():
    slow = FACTS._replace(speed=2.0)
    friction = {"law": "Voellmy", "mu": 0.2, "xi": 3000}
    effects, decisions = decided(scene(friction=friction), slow)
    assert effects.friction == friction_law("Coulomb", 0.2) and decisions["turbulent_drag"].state == "off"
    assert decisions["turbulent_drag"].indicator == pytest.approx(
        4.0 / (3000 * 2.0 / (1.16**0.5) * (0.4 - 0.2) / 1.16**0.5), rel=1e-9
    )
    effects, decisions = decided(scene(friction={**friction, "use": "on"}), slow)
    assert (
        effects.friction == friction_law("Voellmy", 0.2, 3000.0) and decisions["turbulent_drag"].decided_by == "forced"
    )
    assert decided(scene(friction=friction))[0].friction == friction_law("Voellmy", 0.2, 3000.0)
    modified = decided(scene(friction={"law": "ModifiedVoellmy", "mu": 0.2, "xi": 3000}), slow)[0].friction
    assert modified == friction_law("ModifiedVoellmy", 0.2, 3000.0, 4.0)


def test_bingham_is_never_left_out_by_itself():
    """It is all the resistance that there is: without it the flow would not stop."""
    effects, decisions = decided(scene(friction={"law": "Bingham", "yield_stress": 1.0, "viscosity": 0.01}))
    assert effects.friction == friction_law("Bingham", 1.0, 0.01) and decisions["bingham"].indicator < 0.01
    off, _ = decided(scene(friction={"law": "Bingham", "yield_stress": 1.0, "viscosity": 0.01, "use": "off"}))
    assert off.friction == FRICTIONLESS


def test_the_mass_point_of_coulomb_runs_drop_over_mu():
    assert runout(FACTS, friction_law("Coulomb", 0.25)) == pytest.approx(500.0 / 0.25, rel=1e-3)
    assert runout(FACTS) is None  # never comes to rest
    assert runout(FACTS, friction_law("Coulomb", 0.5)) is None  # never starts
    assert runout(FACTS._replace(profile=()), friction_law("Coulomb", 0.25)) is None


def test_a_decision_has_the_runout_without_the_effect():
    load = 1000.0 * 9.81 * 2.0
    friction = {"law": "Coulomb", "mu": 0.25}
    _, decisions = decided(scene(friction=friction, cohesion={"yield_stress": 0.05 * load}))
    change = decisions["cohesion"].runout_change
    assert 0.1 < change < 0.3  # about 0.05 / 0.25, less on the flat where the load is larger
    _, decisions = decided(scene(friction=friction, cohesion={"yield_stress": 0.05 * load, "use": "off"}))
    assert decisions["cohesion"].runout_change == pytest.approx(1.0 / (1.0 + change) - 1.0)


def test_decisions_are_plain_enough_for_the_record():
    _, decisions = resolve(scene(friction={"law": "Voellmy", "mu": 0.4, "xi": 1500}), FACTS._replace(slope_median=0.0))
    for decision in decisions:
        json.dumps(decision._asdict(), allow_nan=False)
        assert "\n" not in decision.line()
