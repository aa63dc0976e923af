"""`size` in place of `mu` of SamosAT: the sizes of com1DFA, by the volume of the release or given."""

import json

import numpy as np
import pytest
from slope_site import SCENE, decisions, write_site

from mpmgis.laws.friction import SIZES, mu_of_size, size_of_release
from mpmgis.scene import mu_least, read_scene, scene_from_tables, scene_text
from mpmgis.scene.json_schema import json_schema
from mpmgis.simulation.preparation import prepare
from mpmgis.system.errors import SceneError

SIZED = SCENE.replace('law = "Voellmy"\nmu = 0.2\nxi = 1000\n', 'law = "SamosAT"\nsize = "auto"\n')


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return write_site(tmp_path_factory.mktemp("sized"))


def prepared(site, text):
    (site / "scene.toml").write_text(text)
    return prepare(site / "scene.toml")


@pytest.mark.parametrize(
    ("volume", "size"),
    [
        (0.0, "small"),
        (np.nextafter(25_000.0, 0.0), "small"),
        (25_000.0, "medium"),
        (np.nextafter(60_000.0, 0.0), "medium"),
        (60_000.0, "large"),
        (1e9, "large"),
    ],
)
def test_sizes_have_the_limits_of_com1dfa(volume, size):
    assert size_of_release(volume) == size


@pytest.mark.parametrize(("thickness", "size"), [(2.0, "small"), (2.3, "medium"), (5.3, "medium"), (5.4, "large")])
def test_auto_is_the_size_of_the_release(site, capsys, thickness, size):
    """10 000 m2 in plan, of a slope of 1 : 2: 1.118 m3 for a metre of thickness on each of them."""
    text = SIZED.replace("thickness = 2.0", f"thickness = {thickness}")
    made = prepared(site, text)
    assert made.effects.friction.a == SIZES[size]
    volume = made.frame.particles.volume.sum()
    assert volume == pytest.approx(1e4 * thickness * np.sqrt(1.25), rel=1e-3)
    reason = decisions(site, text, capsys)["friction"]["reason"]
    assert f"size = auto ({size}, for a release of {volume:.6g} m3), mu = {SIZES[size]:g}" in reason


def test_a_size_is_that_mu_with_the_defaults(site):
    for size, mu in SIZES.items():
        given = prepared(site, SIZED.replace('"auto"', f'"{size}"')).effects.friction
        assert given == prepared(site, SIZED.replace('size = "auto"', f"mu = {mu}")).effects.friction


def test_before_the_release_is_known_the_least_mu_applies(site):
    (site / "scene.toml").write_text(SIZED)
    assert mu_least(read_scene(site / "scene.toml")) == 0.155 == mu_of_size("auto")


def test_a_resolved_scene_keeps_the_size(site, tmp_path):
    scene = prepared(site, SIZED).scene
    assert scene.friction.parameters["mu"] == 0.22
    assert 'size = "auto"' in scene_text(scene) and "mu = " not in scene_text(scene)
    assert scene_from_tables(scene.as_tables(), site).friction.written == {"size": "auto"}


def test_the_schema_has_the_sizes():
    jsonschema = pytest.importorskip("jsonschema")
    check = jsonschema.Draft202012Validator(json.loads(json.dumps(json_schema())))
    tables = {"terrain": {"dem": "a.tif"}, "release": {"source": "a.gpkg"}, "friction": {"law": "SamosAT"}}
    tables |= {"numerics": {"cell_size": 5.0}, "output": {"end_time": 10.0, "frame_interval": 1.0}}
    for size, valid in (("auto", True), ("large", True), ("huge", False), (3, False)):
        tables["friction"]["size"] = size
        assert check.is_valid(tables) == valid, size
    tables["friction"] = {"law": "Voellmy", "mu": 0.2, "xi": 1000, "size": "auto"}
    assert not check.is_valid(tables)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (SIZED.replace('size = "auto"', 'size = "auto"\nmu = 0.2'), "size is in place of mu, and both are given"),
        (SIZED.replace('"auto"', '"huge"'), "size = 'huge'; expected small, medium, large, auto"),
        (SIZED.replace('"auto"', "3"), "size = 3, expected text"),
        (SCENE.replace("xi = 1000", 'xi = 1000\nsize = "auto"'), "Voellmy has no parameter 'size'"),
        (
            SIZED + '[[zones]]\nsource = "a.gpkg"\nsize = "small"\n',
            "[[zones]] number 1: size = 'small' is only for [friction], expected mu, tau0, Rs0, kappa, R, B; give the "
            "mu of a size: 0.22 (small), 0.17 (medium), 0.155 (large), or the column size in the table of `mpmgis "
            "friction-map`",
        ),
        (
            SIZED.replace('size = "auto"\n', "") + '[[zones]]\nsource = "a.gpkg"\nsize = "small"\n',
            "[[zones]] number 1: size = 'small' is only for [friction]",
        ),
    ],
)
def test_a_wrong_size_has_one_line(site, text, said):
    with pytest.raises(SceneError) as refused:
        prepared(site, text)
    assert said in str(refused.value)
