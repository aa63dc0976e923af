"""`k` in place of `xi` (k = g / xi) in Voellmy's friction; what a scene does not give is reported."""

import geopandas
import numpy as np
import pytest
import shapely
from slope_site import SCENE, distances, slide, write_block_site, write_raster, write_shapes

from mpmgis.laws.quantities import GRAVITY
from mpmgis.scene import read_scene, scene_from_tables, scene_text
from mpmgis.simulation.preparation import prepare
from mpmgis.system.errors import MpmgisError
from mpmgis.system.messages import collected

K = SCENE.replace("xi = 1000", f"k = {GRAVITY / 1000.0!r}")
AREA = '[[zones]]\nsource = "zones.gpkg"\n'


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = write_block_site(tmp_path_factory.mktemp("turbulent"))
    write_shapes(
        folder / "zones.gpkg",
        [shapely.box(0, 0, 800, 400), shapely.box(300, 0, 800, 400)],
        xi=[500.0, 250.0],
        k=[GRAVITY / 500.0, GRAVITY / 250.0],
    )
    x, _ = distances()
    xi = np.where(x < 300, 800.0, 200.0)
    write_raster(folder / "xi.tif", xi)
    write_raster(folder / "k.tif", GRAVITY / xi)
    write_raster(folder / "k0.tif", np.where(x < 300, 0.0, 0.01))
    return folder


def prepared(site, text):
    (site / "scene.toml").write_text(text)
    return prepare(site / "scene.toml")


def test_a_number_k_is_xi_and_stays_k_in_the_resolved_scene(site, tmp_path):
    (site / "k.toml").write_text(K)
    scene = read_scene(site / "k.toml")
    assert scene.friction.parameters["xi"] == pytest.approx(1000.0, rel=1e-15)
    assert "k = " in scene_text(scene) and "xi = " not in scene_text(scene)
    (tmp_path / "again.toml").write_text(scene_text(scene))
    assert read_scene(tmp_path / "again.toml").friction == scene.friction
    assert prepared(site, K).effects.friction == prepared(site, SCENE).effects.friction
    points = slide(5.0, 1, 1, friction=f'law = "Voellmy"\nmu = 0.3\nk = {GRAVITY / 500.0!r}')
    (site / "points.toml").write_text(points)
    assert read_scene(site / "points.toml").friction.parameters["xi"] == pytest.approx(500.0, rel=1e-15)


@pytest.mark.parametrize(
    "zones",
    [
        AREA + '{0} = {1}\nuse = "on"\n',
        AREA + '{0} = "{0}"\n',
        '[[zones]]\n{0} = "{0}.tif"\n',
        AREA + '{0} = "{0}.tif"\nmu = 0.4\n',
    ],
    ids=["number", "column", "raster", "raster in polygons"],
)
@pytest.mark.parametrize("friction", [SCENE, SCENE.replace("xi = 1000\n", "")], ids=["over a number", "alone"])
def test_k_in_zones_equals_xi_in_zones(site, zones, friction):
    by_xi = prepared(site, friction + zones.format("xi", 400.0)).places.zone_values
    by_k = prepared(site, friction + zones.format("k", GRAVITY / 400.0)).places.zone_values
    assert by_xi is not None
    np.testing.assert_allclose(by_k, by_xi, rtol=1e-14)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (K.replace("mu = 0.2", "mu = 0.2\nxi = 1000"), "k is in place of xi, and both are given"),
        (SCENE + AREA + "k = 0.01\nxi = 1000\n", "k is in place of xi, and both are given"),
        (SCENE.replace("xi = 1000", "k = 0"), "k = 0, expected at least"),
        (SCENE.replace("xi = 1000", "k = 20"), "k = 20, expected at most 9.8"),
        (SCENE.replace("xi = 1000", 'k = "k.tif"'), "k = 'k.tif', expected a number"),
        (SCENE + '[[zones]]\nk = "k0.tif"\n', "k reaches 0, expected"),
        (SCENE.replace('"Voellmy"', '"Coulomb"').replace("xi = 1000", "k = 0.01"), "Coulomb has no parameter 'k'"),
    ],
)
def test_what_is_wrong_with_k_is_refused(site, text, said):
    with pytest.raises(MpmgisError, match=said.replace(".", r"\.")):
        prepared(site, text)


def test_the_assumed_density_and_missing_friction_are_reported(site):
    bare = SCENE.replace("density = 1000\n", "")
    bare = bare[: bare.index("[friction]")] + bare[bare.index("[numerics]") :]
    with collected() as said:
        assert prepared(site, bare).scene.release.density == 1000.0
    assert next(line for line in said if "density" in line).startswith("no density is given: 1000 kg m-3 is assumed")
    assert any(line.startswith("there is no friction: no [friction] in the scene") for line in said)
    with collected() as said:
        prepared(site, SCENE)
    assert not any("density" in line or "there is no friction" in line for line in said)
    with collected() as said:
        prepared(site, SCENE.replace('law = "Voellmy"', 'law = "Voellmy"\nuse = "off"'))
    assert any(line == "there is no friction: use = 'off'" for line in said)


def test_a_density_that_is_given_elsewhere_is_that_of_the_release(site):
    (site / "inflow.csv").write_text("time,discharge\n0,10\n9,10\n")
    geopandas.read_file(site / "release.geojson").to_file(site / "inlet.gpkg")
    inflow = '[hydrograph]\nsource = "inlet.gpkg"\nfile = "inflow.csv"\ndensity = 1800\n'
    made = prepared(site, SCENE.replace("density = 1000\n", "") + inflow)
    assert made.scene.release.density == 1800.0 == made.frame.header["density"]


def test_tables_with_k_vary_as_any_other(site):
    tables = read_scene(site / "k.toml").as_tables()
    assert "k" in tables["friction"] and "xi" not in tables["friction"]
    tables["friction"]["k"] = 0.02
    scene = scene_from_tables(tables, site)
    assert scene.friction.parameters["xi"] == pytest.approx(GRAVITY / 0.02)
