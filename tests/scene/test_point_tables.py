"""Scenes of the 3D solver: what is refused, what comes back from text, and how numbers decide."""

import tomllib

import numpy as np
import pytest

from mpmgis.commands.shell.main import main
from mpmgis.laws.contact_friction import sticking_contact
from mpmgis.laws.friction import FRICTIONLESS, LAWS, friction_law
from mpmgis.laws.material import COHESIVE_MU_I, DRUCKER_PRAGER, ELASTIC, MU_I, fluid
from mpmgis.laws.softening import EXPONENTIAL, LINEAR, NONE, Softening
from mpmgis.scene import TerrainFacts, catalogue, mu_least, resolve, scene_from_tables, scene_text
from mpmgis.scene.key_checks import meant
from mpmgis.scene.material_table import MATERIALS
from mpmgis.system.errors import SceneError

MODULI = {"bulk_modulus": 6.7e6, "shear_modulus": 4e6}
ICE = {"law": "DruckerPrager", **MODULI, "friction_angle": 40, "cohesion": 1000}
GRAINS = {"law": "MuI", **MODULI, "mu1": 0.38, "mu2": 0.64, "grain_diameter": 0.1, "grain_density": 2500}
RATE = {"rate_friction": 0.26, "grain_diameter": 0.5, "grain_density": 900}
GROWING = {**ICE, "law": "CohesiveMuI", **RATE}
WATER = {"law": "Fluid", "bulk_modulus": 2.2e9}
ROCK = {"law": "Elastic", **MODULI}
TABLES = {
    "solver": "points",
    "terrain": {"dem": "d.tif"},
    "release": {"source": "r.shp"},
    "output": {"end_time": 5, "frame_interval": 1},
    "numerics": {"cell_size": 2},
    "material": ICE,
    "friction": {"law": "Coulomb", "mu": 0.55},
}
FACTS = TerrainFacts(
    centrifugal_ratio=0.2,
    slope_median=0.5,
    drop=100.0,
    speed=40.0,
    release_thickness=5.0,
    release_length=100.0,
    density=850.0,
    edge_distance=30.0,
)


def scene(**tables):
    """The scene of TABLES with these in place of its own; None takes a table out."""
    made = {**TABLES, **tables}
    return scene_from_tables({name: table for name, table in made.items() if table is not None})


def decided(given, facts=FACTS):
    """(PointEffects, name -> decision)."""
    effects, decisions = resolve(given, facts)
    return effects, {d.effect: d for d in decisions}


@pytest.mark.parametrize("material", [ICE, GRAINS, GROWING, WATER, ROCK])
def test_every_material_comes_back_from_text(material):
    given = scene(material=material)
    again = scene_from_tables(tomllib.loads(scene_text(given)))
    assert again == given and again.digest() == given.digest()


def test_text_of_a_solver_names_no_key_of_the_other():
    points, columns = scene_text(scene()), scene_text(scene(solver="columns", material=None))
    for key in ("points_per_cell", "stiffness"):
        assert key in points and key not in columns
    for key in ("particles_per_cell", "form", "clamp"):
        assert key in columns and key not in points


REFUSED = {
    "no material": ({"material": None}, "needs [material]"),
    "no cell size": ({"numerics": {}}, "needs cell_size"),
    "unknown material": ({"material": {**ICE, "law": "DrukerPrager"}}, "did you mean 'DruckerPrager'"),
    "unknown key": ({"material": {**ICE, "frictionangle": 3}}, "did you mean 'friction_angle'"),
    "negative bulk modulus": ({"material": {**ICE, "bulk_modulus": -1e6}}, "= -1e+06, expected at least 1"),
    "shear modulus 0": ({"material": {**ICE, "shear_modulus": 0}}, "shear_modulus = 0, expected at least 1"),
    "infinite modulus": ({"material": {**ICE, "bulk_modulus": float("inf")}}, "finite"),
    "negative Poisson's ratio": ({"material": {**ICE, "shear_modulus": 2e7}}, "negative Poisson's ratio"),
    "modulus missing": ({"material": {"law": "Elastic", "bulk_modulus": 1e6}}, "Elastic needs shear_modulus [Pa]"),
    "angle of a wall": ({"material": {**ICE, "friction_angle": 90}}, "at most 80"),
    "negative cohesion": ({"material": {**ICE, "cohesion": -1}}, "at least 0"),
    "mu2 below mu1": ({"material": {**GRAINS, "mu2": 0.3}}, "not above mu1 = 0.38"),
    "match of a fluid": ({"material": {**WATER, "match": "triaxial"}}, "belongs to DruckerPrager and CohesiveMuI"),
    "rate of plain ice": ({"material": {**ICE, "rate_friction": 0.2}}, "has no parameter 'rate_friction'"),
    "friction that falls": ({"material": {**GROWING, "rate_friction": -0.1}}, "expected at least 0"),
    "no grains": ({"material": {**ICE, "law": "CohesiveMuI", "rate_friction": 0.2}}, "needs grain_diameter [m]"),
    "pressure of ice": ({"material": {**ICE, "pressure": "tait"}}, "pressure belongs to Fluid"),
    "unknown match": ({"material": {**ICE, "match": "plane"}}, "expected triaxial, plane_strain"),
    "softening of a fluid": ({"material": WATER, "softening": {"residual_friction_angle": 20}}, "material is Fluid"),
    "softening of beads": ({"material": GRAINS, "softening": {"residual_friction_angle": 20}}, "CohesiveMuI soften"),
    "softening that hardens": ({"softening": {"residual_friction_angle": 45}}, "softening takes away"),
    "cohesion that grows": ({"softening": {"residual_friction_angle": 20, "residual_cohesion": 2e3}}, "takes away"),
    "linear without a rate": (
        {"softening": {"residual_friction_angle": 20, "form": "linear", "coefficient": 0}},
        "coefficient above 0",
    ),
    "peak of an exponential": ({"softening": {"residual_friction_angle": 20, "peak_strain": 0.1}}, "form = 'linear'"),
    "drag without its number": ({"friction": {"law": "Voellmy", "mu": 0.2}}, "xi"),
    "a law of one's own": (
        {"friction": {"law": "my_law.py:Mine", "mu": 0.2}},
        "the 3D solver takes no law from a Python file",
    ),
    "unknown law on the bed": ({"friction": {"law": "Coulom", "mu": 0.2}}, "did you mean 'Coulomb'"),
    "mu of what sticks": ({"friction": {"law": "Sticking", "mu": 0.2}}, "has no parameter 'mu'; it takes none"),
    "zones without friction": ({"friction": None, "zones": [{"source": "z.shp", "mu": 0.3}]}, "need [friction]"),
    "spatially varying xi": ({"zones": [{"source": "z.shp", "xi": 300}]}, "Coulomb has no parameter 'xi'"),
    "inflow": ({"hydrograph": {"source": "i.shp", "file": "h.csv"}}, "the 3D solver has no [hydrograph]"),
    "earth pressure": ({"earth_pressure": {"friction_angle": 30}}, "use [material] friction_angle"),
    "cohesion of columns": ({"cohesion": {"yield_stress": 50}}, "give [material] cohesion"),
    "curvature": ({"curvature": {}}, "follows the ground by itself"),
    "form": ({"numerics": {"cell_size": 2, "form": "slope"}}, "form requires solver = 'columns'"),
    "columns a cell": ({"numerics": {"cell_size": 2, "particles_per_cell": 16}}, "particles_per_cell requires solver"),
    "clearance of two cells": ({"numerics": {"cell_size": 2, "clearance": 2}}, "expected at most 1"),
    "clearance of columns": (
        {"solver": "columns", "material": None, "numerics": {"clearance": 0.5}},
        "clearance requires solver",
    ),
    "nine points a cell": ({"numerics": {"cell_size": 2, "points_per_cell": 9}}, "expected 8, 27, 64"),
    "half precision": ({"numerics": {"cell_size": 2, "precision": "float16"}}, "expected float64, float32"),
    "float32 of columns": (
        {"solver": "columns", "material": None, "numerics": {"precision": "float32"}},
        "requires solver = 'points'",
    ),
    "material of columns": ({"solver": "columns"}, "the depth-averaged solver has no [material]"),
    "stiffness of columns": (
        {"solver": "columns", "material": None, "numerics": {"stiffness": "scaled"}},
        "stiffness requires solver",
    ),
    "window of an area": ({"release": {"source": "r.shp", "window": "b.gpkg"}}, "window is used only with particles"),
    "window of columns": (
        {"solver": "columns", "material": None, "release": {"particles": "a.h5", "window": "b.gpkg"}},
        "requires",
    ),
    "window of three": ({"terrain": {"dem": "d.tif", "window": [1, 2, 3]}}, "four numbers"),
    "window of words": ({"terrain": {"dem": "d.tif", "window": ["a", 2, 3, 4]}}, "four numbers"),
    "window inside out": ({"terrain": {"dem": "d.tif", "window": [5, 2, 3, 4]}}, "west below east"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_invalid_scenes_are_refused_in_one_line(name):
    tables, words = REFUSED[name]
    with pytest.raises(SceneError) as error:
        scene(**tables)
    assert words in str(error.value) and "\n" not in str(error.value)


def test_a_message_on_an_unknown_law_offers_only_what_the_solver_takes():
    with pytest.raises(SceneError) as error:
        scene(friction={"law": "Coulom", "mu": 0.2})
    assert str(error.value).endswith("Manning, Sticking")


def test_laws_fill_the_slots():
    effects, _ = decided(scene())
    assert effects.material.kind == DRUCKER_PRAGER and effects.contact == friction_law("Coulomb", 0.55)
    assert (effects.softening, effects.zones, effects.barrier) == (Softening(), False, False)
    assert decided(scene(material=GRAINS))[0].material.kind == MU_I
    assert decided(scene(material=ROCK))[0].material.kind == ELASTIC
    assert decided(scene(material={**WATER, "viscosity": 3, "pressure": "tait"}))[0].material == fluid(2.2e9, 3.0, 1.0)
    assert decided(scene(friction={"law": "Sticking"}))[0].contact == sticking_contact()
    assert decided(scene(friction=None))[0].contact == FRICTIONLESS
    plain = decided(scene(material={**ICE, "volume_correction": False, "match": "plane_strain", "tension_limit": 10}))
    assert (plain[0].material.volume_correction, plain[0].material.tension_limit) == (0.0, 10.0)
    assert plain[0].material.slope == pytest.approx(3**0.5 * 0.6427876)
    assert plain[1]["vol_correction"].state == "off"


def test_cohesive_mu_i_has_its_cone_softening_and_rate():
    effects, decisions = decided(scene(material=GROWING, softening={"residual_friction_angle": 20}))
    law, cone = effects.material, decided(scene())[0].material
    assert law.kind == COHESIVE_MU_I and effects.softening.kind == EXPONENTIAL
    grains = {"rate_friction": 0.26, "inertial_number": 0.279, "grain_diameter": 0.5, "grain_density": 900.0}
    assert law == cone._replace(kind=COHESIVE_MU_I, **grains)
    for name in ("plasticity", "cohesion", "softening", "mu_i", "vol_correction"):
        assert decisions[name].state == "on", name
    assert "tan(phi)" in decisions["plasticity"].reason and "collapse" not in decisions["plasticity"].reason
    strict = {"match": "plane_strain", "tension_limit": 10, "volume_correction": False}
    law = decided(scene(material={**GROWING, **strict}))[0].material
    assert (law.slope, law.tension_limit, law.volume_correction) == (pytest.approx(3**0.5 * 0.6427876), 10.0, 0.0)
    assert mu_least(scene(material=GROWING, softening={"residual_friction_angle": 20})) == pytest.approx(
        0.364, abs=1e-4
    )
    constant = decided(scene(material={**GROWING, "rate_friction": 0}))[1]["mu_i"]
    assert constant.state == "off" and "does not depend on its rate" in constant.reason
    slow = FACTS._replace(speed=0.0, release_thickness=50.0)
    felt = decided(scene(material={**GROWING, "grain_diameter": 1e-3}), slow)[1]["mu_i"].reason
    assert felt.endswith("; DruckerPrager would do")


def test_drag_on_the_bed_is_left_out_where_it_is_not_felt():
    """As of columns, with which a scene shares the table: (U / U_t)^2 against its threshold, mu alone elsewhere."""
    voellmy = {"law": "Voellmy", "mu": 0.2, "xi": 1000}
    effects, decisions = decided(scene(friction=voellmy))
    assert effects.contact == friction_law("Voellmy", 0.2, 1000.0)
    drag = decisions["turbulent_drag"]
    assert drag.state == "on" and drag.indicator == pytest.approx(1600 / (1000 * 5 * 0.8 * 0.3 * 0.8944), rel=0.2)
    slow = FACTS._replace(speed=3.0)
    effects, decisions = decided(scene(friction=voellmy), slow)
    assert effects.contact == friction_law("Coulomb", 0.2) and decisions["turbulent_drag"].state == "off"
    assert decided(scene(friction={**voellmy, "use": "on"}), slow)[0].contact == friction_law("Voellmy", 0.2, 1000.0)
    assert decided(scene())[1]["turbulent_drag"].state == "off"


@pytest.mark.parametrize("law", [law for law in LAWS if law not in ("Coulomb", "Voellmy")])
def test_every_law_of_friction_is_on_the_bed_in_3d_as_in_2d(law):
    """The same law, number over the slope and turbulent part as of columns, from one table."""
    friction = {"law": law, **{name: min(0.5 + k, of.largest) for k, (name, of) in enumerate(LAWS[law][1].items())}}
    effects, decisions = decided(scene(friction=friction))
    in_2d = {"solver": "columns", "material": None, "numerics": None}
    as_columns, other = decided(scene(friction=friction, **in_2d))
    assert effects.contact == as_columns.friction
    for name in ("friction", "turbulent_drag"):
        assert decisions[name] == other[name]
    assert mu_least(scene(friction=friction, material=ROCK)) == mu_least(scene(friction=friction, **in_2d))


def test_size_of_an_avalanche_in_3d():
    effects, decisions = decided(scene(friction={"law": "SamosAT", "size": "medium"}))
    assert effects.contact == friction_law("SamosAT", 0.17)
    assert decisions["friction"].reason.startswith("SamosAT: size = medium, mu = 0.17")


def test_softening_is_on_where_it_takes_something_away():
    on, decisions = decided(scene(softening={"residual_friction_angle": 20}))
    assert on.softening.kind == EXPONENTIAL and decisions["softening"].indicator == 1.0  # all of the cohesion
    linear = {"residual_friction_angle": 20, "form": "linear", "peak_strain": 0.1}
    assert decided(scene(softening=linear))[0].softening.kind == LINEAR
    nothing = {"residual_friction_angle": 40, "residual_cohesion": 1000}
    for table in (nothing, {**nothing, "use": "on"}, {"residual_friction_angle": 20, "use": "off"}):
        off, decisions = decided(scene(softening=table))
        assert off.softening.kind == NONE and decisions["softening"].state == "off"


def test_mach_number_shows_when_the_stiffness_matters():
    """NHESS's ice: waves of 119 m/s. 40 m/s of the line and the head of a front 5 m thick are 42 m/s, Mach 0.36."""
    _, decisions = decided(scene())
    assert decisions["stiffness"].indicator == pytest.approx(np.hypot(40.0, 2 * np.sqrt(9.81 * 5)) / 119.0, abs=1e-3)
    assert "is compressed" in decisions["stiffness"].reason
    assert decisions["elasticity"].indicator == pytest.approx(850 * 9.81 * 5 / 6.7e6)


def test_stiffness_is_scaled_only_downwards_and_keeps_poissons_ratio():
    stiff = {**ICE, "bulk_modulus": 9e9, "shear_modulus": 3.5e9}
    numerics = {"cell_size": 2, "stiffness": "scaled"}
    assert "stiffness = 'scaled' would take steps" in decided(scene(material=stiff))[1]["stiffness"].reason
    effects, decisions = decided(scene(material=stiff, numerics=numerics))
    assert effects.material.bulk_modulus == pytest.approx(850 * (400.0**2 + 100 * 4 * 9.81 * 5))
    assert effects.material.shear_modulus / effects.material.bulk_modulus == pytest.approx(3.5 / 9)
    assert decisions["stiffness"].state == "on"
    effects, decisions = decided(scene(numerics=numerics))
    assert effects.material.bulk_modulus == 6.7e6 and decisions["stiffness"].state == "off"
    water, _ = decided(scene(material=WATER, numerics=numerics))
    assert water.material.bulk_modulus == pytest.approx(850 * (400.0**2 + 100 * 4 * 9.81 * 5))


def test_the_energy_line_falls_by_the_least_friction_on_the_bed_or_inside():
    assert mu_least(scene()) == 0.55
    assert mu_least(scene(softening={"residual_friction_angle": 20})) == pytest.approx(0.36397, abs=1e-5)
    assert mu_least(scene(friction={"law": "Sticking"})) == pytest.approx(0.8391, abs=1e-4)
    assert mu_least(scene(material=WATER)) == 0.0
    assert mu_least(scene(material=GRAINS)) == 0.38
    assert mu_least(scene(material=ROCK)) == 0.55
    assert mu_least(scene(friction=None)) == 0.0


def test_numbers_of_what_is_hardly_felt():
    decisions = decided(scene(material={**WATER, "viscosity": 1e-3}))[1]
    assert "hardly felt" in decisions["fluid_viscosity"].reason
    assert "hardly" not in decided(scene(material={**WATER, "viscosity": 100}))[1]["fluid_viscosity"].reason
    slow = FACTS._replace(speed=0.0, release_thickness=50.0)
    assert "would do" in decided(scene(material={**GRAINS, "grain_diameter": 1e-3}), slow)[1]["mu_i"].reason
    assert "would do" not in decided(scene(material=GRAINS))[1]["mu_i"].reason
    assert "too little" in decided(scene(material={**ICE, "cohesion": 1}))[1]["cohesion"].reason


def test_the_catalogue_has_every_material(capsys):
    entries = [entry for entry in catalogue() if entry["table"] == "material"]
    assert [entry["law"] for entry in entries] == list(MATERIALS)
    assert entries[0]["parameters"]["bulk_modulus"] == "Pa"
    assert main(["effects"]) == 0
    assert "[material] Fluid:" in capsys.readouterr().out


@pytest.mark.parametrize("got, suggested", [("gpu", ""), ("cuad", "cuda"), ("atuo", "auto")])
def test_a_device_is_suggested_only_where_the_word_is_similar(got, suggested):
    """cpu is no suggestion for gpu, which means cuda."""
    assert meant(got, ["cpu", "cuda", "auto"]) == (f" (did you mean {suggested!r}?)" if suggested else "")
