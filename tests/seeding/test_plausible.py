"""Releases that are possible and yet hardly meant: one line each, and the work goes on."""

import shutil

import pytest

from mpmgis.commands.demo_site import sample_folder
from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame
from mpmgis.seeding.implausible_values import Fixes, report_implausible
from mpmgis.simulation.preparation import prepare
from mpmgis.system.messages import collected

CURES = Fixes("--density", "--thickness", "give more", "give finer")
SCENE = """
[terrain]
dem = "lava_falls_dem_utm12n_10m.tif"
[release]
source = "lava_falls_release.shp"
thickness = {thickness}
density = {density}
[friction]
law = "Voellmy"
mu = {mu}
xi = {xi}
[numerics]
cell_size = {cell_size}
particles_per_cell = {per_cell}
[output]
end_time = 1
frame_interval = 1
"""


@pytest.mark.parametrize(
    "count, density, thickness, across, words",
    [
        (50, 100.0, 0.01, 9.0, []),
        (10**6, 3500.0, 100.0, 9.0, []),
        (50, 99.0, 1.0, 9.0, ["density of the release: 99 kg m-3"]),
        (50, 3501.0, 1.0, 9.0, ["density of the release: 3501 kg m-3"]),
        (50, 1000.0, 0.0099, 9.0, ["mean thickness of the release: 0.0099 m"]),
        (50, 1000.0, 101.0, 9.0, ["mean thickness of the release: 101 m"]),
        (49, 1000.0, 1.0, 9.0, ["only 49 columns carry the release"]),
        (1, 2e4, 500.0, 9.0, ["density", "mean thickness", "only 1 column carries the release"]),
        (64, 1000.0, 1.0, 4.0, []),
        (64, 1000.0, 1.0, 2.04, ["only 2 cells are across the release"]),
        (49, 1000.0, 1.0, 2.04, ["only 49 columns carry the release"]),
    ],
)
def test_what_is_reported(count, density, thickness, across, words):
    with collected() as said:
        report_implausible(count, density, thickness, across, CURES)
    assert len(said) == len(words)
    assert all(line.startswith(word) and "\n" not in line for line, word in zip(said, words, strict=True))


def seeded(tmp_path, capsys, *options):
    """Lines on stderr of `mpmgis seed` on the sample site, and the seed."""
    site, out = sample_folder(), tmp_path / "seed.h5"
    dem, release = site / "lava_falls_dem_utm12n_10m.tif", site / "lava_falls_release.shp"
    assert main(["seed", "--dem", str(dem), "--release", str(release), "-o", str(out), *options]) == 0
    return capsys.readouterr().err.splitlines(), read_frame(out)


def test_seed_warns_and_seeds(tmp_path, capsys):
    said, frame = seeded(tmp_path, capsys, "--density", "25", "--thickness", "150", "--count", "40")
    assert any("25 kg m-3, usual is 100 to 3500; check --density and its unit" in line for line in said)
    assert any("mean thickness" in line and "check --thickness" in line for line in said)
    (line,) = (line for line in said if line.startswith("only"))
    assert f"only {len(frame.particles)} columns" in line and "--per-cell" in line
    assert frame.header["density"] == 25.0


def test_seed_of_usual_input_has_no_warning(tmp_path, capsys):
    said, _ = seeded(tmp_path, capsys, "--density", "2000")
    assert not any(word in line for line in said for word in ("usual", "only"))


@pytest.mark.parametrize(
    "values, words",
    [
        ({}, []),
        ({"density": 20_000.0}, ["20000 kg m-3, usual is 100 to 3500; check [release] density"]),
        ({"thickness": 0.001}, ["mean thickness of the release", "check [release] thickness"]),
        ({"mu": 5.0}, ["[friction] mu = 5, usual is 0 to 1.2", "the tangent of the friction angle"]),
        ({"xi": 1.0}, ["[friction] xi = 1 m s-2, usual is 10 to 3000"]),
        (
            {"cell_size": 40.0, "per_cell": 1},
            ["columns carry the release", "[numerics] cell_size or more particles_per"],
        ),
    ],
)
def test_run_warns_before_its_first_step(tmp_path, values, words):
    for file in sample_folder().iterdir():
        shutil.copy(file, tmp_path)
    usual = {"thickness": 5.0, "density": 2000.0, "cell_size": 10.0, "per_cell": 4, "mu": 0.3, "xi": 1000.0}
    (tmp_path / "scene.toml").write_text(SCENE.format(**usual | values))
    with collected() as said:
        prepare(tmp_path / "scene.toml")
    told = [line for line in said if "usual" in line or line.startswith("only")]
    assert len(told) == (1 if words else 0)
    assert all(word in told[0] for word in words)
