"""Files that the codes wrote themselves, where the project's data folder is at hand."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from mpmgis.commands.shell.main import main
from mpmgis.laws.quantities import Quantity
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.raster_output import write_geotiff

DATA = Path(__file__).parents[2] / "../shared/data/foreign"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="no files of other codes: ../shared/data/foreign")
HERE = ("--axes", "e,n,u", "--origin", "0,0,0", "--crs", "local")
SAMPLES = {  # what the codes' own README files say: reader, particles, mass [kg], time [s], the options that are needed
    "cbgeo/particles2000.h5": ("cbgeo", 8000, 1000.0, 0.4, ()),
    "kratos/MPM_Material_0_0.2000000.vtk": ("kratos", 4096, 1000.0, 0.2, ()),
    "geotaichi/MPMParticle000001.npz": ("geotaichi", 8000, 1000.0, 0.449890, ("--density", "1000")),
    "geotaichi/GraphicMPMParticle000001.vtu": (
        "vtk",
        8000,
        1000.0,
        0.45,
        ("--density", "1000", "--dt", "0.45", "--particle-volume", "1.25e-4"),
    ),
    "mpm_geomechanics/particles_3.vtu": (
        "mpm-geomechanics",
        8000,
        2.5e6,
        0.798327,
        ("--density", "2500", "--particle-volume", "0.125"),
    ),
}


@pytest.fixture(scope="module")
def dtm(tmp_path_factory):
    """Flat ground under all of them."""
    path = tmp_path_factory.mktemp("ground") / "dtm.tif"
    grid = Grid.north_up(None, -2.0, 16.0, 0.25, (72, 72))
    write_geotiff(path, grid, [(Quantity("elevation", "m", ""), np.zeros((72, 72)))], {})
    return path


@pytest.mark.parametrize("sample", SAMPLES)
def test_info_prints_what_the_code_wrote(sample, capsys):
    reader, count, mass, time, options = SAMPLES[sample]
    assert main(["info", "--json", str(DATA / sample), *HERE, *options]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["reader"], facts["n"], facts["to_be_told"]) == (reader, count, [])
    if "Graphic" not in sample:
        assert facts["mass"] == pytest.approx(mass, rel=1e-6)
    assert facts["time"] == pytest.approx(time, rel=1e-5)


@pytest.mark.parametrize("sample", SAMPLES)
def test_an_export_keeps_mass_and_volume(sample, dtm, tmp_path, capsys):
    _, count, mass, time, options = SAMPLES[sample]
    output = tmp_path / "gis"
    words = ["export-raster", str(DATA / sample), "--dem", str(dtm), "-o", str(output), "--no-qgis", *HERE, *options]
    assert main(words) == 0
    line = re.search(
        rf"{Path(sample).name}: (\S+) s, {count} particles, (\S+) kg, (\S+) m3 at (\S+) kg", capsys.readouterr().err
    )
    assert float(line[1]) == pytest.approx(time, rel=1e-5)
    within = 0.005 if "Graphic" in sample else 1e-5  # which has volumes, and those of now
    assert float(line[2]) == pytest.approx(mass, rel=within)
    assert float(line[3]) == pytest.approx(mass / float(line[4]), rel=within)


def test_the_block_on_a_plane_agrees_with_its_readme(capsys):
    """Mean displacement of MPM-Geomechanics' example: 0.5 (g_t - mu g_n) t^2, 1.13 m at 0.798 s."""
    assert main(["info", "--json", str(DATA / "mpm_geomechanics"), *HERE]) == 0
    facts = json.loads(capsys.readouterr().out)
    (low, high), t = facts["own_axes"]["x"], facts["time"]
    assert low - 2.25 == pytest.approx(0.5 * (7.07 - 0.5 * 7.07) * t**2, abs=0.1)
    assert high - low == pytest.approx(9.5, abs=0.1)
