"""Undeclared nodata, masks and pits through the commands: the right numbers, or one line that says what is wrong."""

import numpy as np
import pytest
from slope_site import SCENE, decisions, distances, record, refused, run, write_raster, write_site

from mpmgis.commands.shell.main import main

SHORT = SCENE.replace("end_time = 30", "end_time = 5")
ZONES = '[[zones]]\nsource = "zones.tif"\nmu = 0.6\n'
FOREST = '[[forest]]\nsource = "zones.tif"\nstrength = 20000\ndetrainment = 5\n'
EROSION = '[entrainment]\nlaw = "ErosionEnergy"\nerosion_energy = 5000\nsource = "zones.tif"\ndensity = 1500\n'
OUTSIDE = (0.0, -9999.0, -3.4028235e38, 9999.0, -1.0, 1e-30)


@pytest.fixture
def site(tmp_path):
    return write_site(tmp_path)


def mask(folder, outside, inside, name="zones.tif", nodata=None):
    x, _ = distances()
    write_raster(folder / name, np.where((x > 200) & (x < 300), inside, outside), nodata=nodata)


@pytest.mark.parametrize("tables", [ZONES, FOREST], ids=["zones", "forest"])
def test_a_mask_of_a_scene_is_the_same_whatever_is_outside(site, capsys, tables):
    """The numbers that decide effects are those of the mask with declared nodata, to the last bit."""
    mask(site, -7.0, 1.0, nodata=-7.0)
    expected = decisions(site, SHORT + tables, capsys)
    for outside in OUTSIDE:
        mask(site, outside, 1.0)
        assert decisions(site, SHORT + tables, capsys) == expected, outside


@pytest.mark.parametrize("given", [("", 0.5), ("thickness = 0.5\n", 1.0)], ids=["thickness raster", "mask"])
def test_erodible_ground_is_the_same_whatever_is_outside(site, capsys, given):
    line, inside = given
    mask(site, -7.0, 0.5, nodata=-7.0)
    expected = decisions(site, SHORT + EROSION, capsys)["entrainment"]
    for outside in OUTSIDE:
        if outside == -1.0 and not line:
            continue
        mask(site, outside, inside)
        assert decisions(site, SHORT + EROSION + line, capsys)["entrainment"] == expected, outside
    mask(site, -1.0, 0.5)
    assert "reaches -1" in refused(site, capsys, SHORT + EROSION)
    mask(site, 0.0, 255.0)
    assert "a mask or ids of areas; give [entrainment] thickness" in refused(site, capsys, SHORT + EROSION)
    mask(site, 0.0, 1500.5)
    assert "at most 1000 metres" in refused(site, capsys, SHORT + EROSION)


@pytest.mark.parametrize("table", ["friction", "zones"])
def test_a_parameter_is_the_same_whatever_is_outside(site, capsys, table):
    """mu of a raster: cells without a value have the mu of [friction]."""
    zones = '[[zones]]\nmu = "zones.tif"\n' if table == "zones" else '[[zones]]\nsource = "m.tif"\nmu = "zones.tif"\n'
    mask(site, 0.0, 1.0, name="m.tif")
    mask(site, -7.0, 0.45, nodata=-7.0)
    expected = decisions(site, SHORT + zones, capsys)
    for outside in (np.nan, -9999.0, -32768.0, -3.4028235e38, 9999.0, 65535.0, 1e20):
        mask(site, outside, 0.45)
        assert decisions(site, SHORT + zones, capsys) == expected, outside


@pytest.mark.parametrize("value", [0.0, -999.0, -9999.9])
def test_a_run_into_a_pit_is_refused_unless_it_is_ground(site, capsys, value):
    x, y = distances()
    heights = np.maximum(0.5 * (400.0 - x), 0.0) + 1100.0
    heights[(x > 300) & (x < 340) & (y > 180) & (y < 220)] = value
    write_raster(site / "dtm.tif", heights, nodata=-7.0)
    words = f"16 cells have the constant elevation {value:g} behind walls"
    line = refused(site, capsys, SHORT)
    assert words in line and f"--nodata {value:g}" in line and f"real_values = [{value:g}]" in line
    scene = site / "scene.toml"
    scene.write_text(SHORT)
    assert main(["effects", str(scene)]) == 2
    assert words in capsys.readouterr().err
    assert main(["info", str(site / "dtm.tif")]) == 0
    assert words in capsys.readouterr().out
    seed = ["seed", "--dem", str(site / "dtm.tif"), "--release", str(site / "release.geojson"), "--thickness", "2"]
    assert main([*seed, "-o", str(site / "s.h5")]) == 0
    said = capsys.readouterr().err
    assert words in said and "the ground there is between 12" in said and f"the terrain between {value:.0f} and" in said
    declared = SHORT.replace('dem = "dtm.tif"', f'dem = "dtm.tif"\nreal_values = [{value}]')
    scene.write_text(declared)
    assert main(["effects", str(scene)]) == 0
    assert words in capsys.readouterr().err
    assert main(["effects", str(scene), "-v"]) == 0
    assert f"warning: the flow can reach constant ground behind walls: {words}" in capsys.readouterr().err


def test_a_pit_out_of_reach_is_named_only(site, capsys):
    x, y = distances()
    heights = np.maximum(0.5 * (400.0 - x), 0.0) + 1100.0
    heights[(x < 40) & (y > 340)] = 0.0
    write_raster(site / "dtm.tif", heights, nodata=-7.0)
    assert run(site, SHORT) == 0
    assert "24 cells have the constant elevation 0 behind walls" in capsys.readouterr().err
    assert record(site)["balances"]["mass_out"] == 0.0


@pytest.mark.parametrize("values", ["[]", '["a"]', "[nan]", "0.0"])
def test_real_values_are_a_list_of_elevations(site, capsys, values):
    assert "real_values" in refused(site, capsys, SHORT.replace("[release]", f"real_values = {values}\n[release]"))


def test_a_thickness_above_1000_m_is_refused_by_seed_and_run(site, capsys):
    assert "thickness" in refused(site, capsys, SHORT.replace("thickness = 2.0", "thickness = 1500.0"))
    options = ["--dem", str(site / "dtm.tif"), "--release", str(site / "release.geojson"), "-o", str(site / "s.h5")]
    assert main(["seed", *options, "--thickness", "1500"]) == 2
    assert "at most 1000 metres" in capsys.readouterr().err
