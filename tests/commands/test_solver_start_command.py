"""`--for` of `seed` and `convert` as a user types it: folders, refusals, and what Kratos makes of its folder."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from slope_site import SOUTH, WEST, write_shapes, write_site

from mpmgis.commands.shell.main import main
from mpmgis.exchange.frame_list import list_frames
from mpmgis.frames.frame_files import read_frame, write_frame

MATERIAL = """
[material]
law = "DruckerPrager"
bulk_modulus = 4e6
shear_modulus = 2e6
friction_angle = 35
cohesion = 500
"""
BED = '[friction]\nlaw = "Coulomb"\nmu = 0.3\n'
MU_I = MATERIAL.replace("DruckerPrager", "MuI").replace("friction_angle = 35\ncohesion = 500\n", "").rstrip() + (
    "\nmu1 = 0.4\nmu2 = 0.7\ngrain_diameter = 0.01\ngrain_density = 2600\n"
)
COHESIVE_MU_I = MATERIAL.replace("DruckerPrager", "CohesiveMuI") + (
    "rate_friction = 0.3\ngrain_diameter = 0.01\ngrain_density = 2600\n"
)
# A Python with KratosMultiphysics and KratosMPMApplication, where it is not this one
KRATOS_PYTHON = os.environ.get("MPMGIS_KRATOS_PYTHON", sys.executable)
# Runs the case for some steps and writes place, volume, mass and velocity of its material points, first and last.
KRATOS_CHECK = """
import json, sys
import KratosMultiphysics as Kratos
from KratosMultiphysics import MPMApplication as MPM
from MainKratos import Start

settings = json.load(open("ProjectParameters.json"))
settings["problem_data"]["end_time"] = 10 * settings["solver_settings"]["time_stepping"]["time_step"]
settings["output_processes"] = {}
told = []

class Watched(Start):
    def tell(self):
        part = self.model["MPM_Material"]
        names = MPM.MP_COORD, MPM.MP_VELOCITY, MPM.MP_VOLUME, MPM.MP_MASS
        rows = [[p.CalculateOnIntegrationPoints(name, part.ProcessInfo)[0] for name in names] for p in part.Elements]
        told.append([[*x, *v, volume, mass] for x, v, volume, mass in rows])

    def Initialize(self):
        super().Initialize()
        self.tell()

    def Finalize(self):
        self.tell()
        super().Finalize()

Watched(Kratos.Model(), Kratos.Parameters(json.dumps(settings))).Run()
json.dump(told, open("told.json", "w"))
"""


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A slope, a release of 6 m on it, materials, here."""
    import shapely

    write_site(tmp_path)
    write_shapes(tmp_path / "block.geojson", [shapely.box(60, 150, 100, 190)])
    (tmp_path / "soil.toml").write_text(MATERIAL)
    (tmp_path / "soil_on_bed.toml").write_text(MATERIAL + BED)
    (tmp_path / "mu_i.toml").write_text(MU_I)
    (tmp_path / "cohesive.toml").write_text(COHESIVE_MU_I)
    monkeypatch.chdir(tmp_path)
    return tmp_path


KRATOS = ("--for", "kratos", "--cell", "4", "--material", "soil.toml")
SEED = ("seed", "--dem", "dtm.tif", "--release", "block.geojson", "--thickness", "6", "--spacing", "5")


def test_a_seed_becomes_a_case_and_its_results_find_their_place(site, capsys):
    assert main([*SEED, "--velocity", "1,-2", "--for", "houdini", "--cell", "4"]) == 0
    out, err = capsys.readouterr()
    assert out.strip() == "block_houdini"
    assert "read back from the files" in err and "lost: stress" in err and "density: 1000 kg m-3" in err
    assert main([*SEED, "--velocity", "1,-2", "-o", "seed.h5", "-q"]) == 0
    seed = read_frame(site / "seed.h5").particles
    lines = (site / "block_houdini/README.txt").read_text().splitlines()
    assert len(lines) == 5 and "block.geojson" in lines[0] and "--sidecar georef.json" in lines[4]
    (entry,) = list_frames([site / "block_houdini/points_0000.ply"])
    points = entry.read()
    assert points.particles.mass.sum() == pytest.approx(seed.mass.sum(), rel=1e-6)
    x, y = points.map_xy()
    assert x.min() > WEST + 60 and x.max() < WEST + 100 and y.min() > SOUTH + 150 and y.max() < SOUTH + 190
    assert points.particles.velocity[:, :2] == pytest.approx(np.tile([1, -2], (len(x), 1)))
    assert points.crs.to_epsg() == 32632 and (site / "block_houdini" / entry.header.dem).resolve() == site / "dtm.tif"
    capsys.readouterr()
    assert (
        main(["export-raster", "block_houdini/points_0000.ply", "--cs-e", "10", "-o", "maps", "--no-qgis", "-q"]) == 0
    )


@pytest.mark.parametrize("solver", ["kratos", "cbgeo", "geotaichi", "mpm-geomechanics"])
def test_columns_and_their_points_give_the_same_case(site, capsys, solver):
    assert main([*SEED, "-o", "seed.h5", "-q"]) == 0
    assert main(["convert", "seed.h5", "--cell", "4", "-o", "points.h5", "-q"]) == 0
    options = ("--for", solver, "--material", "soil_on_bed.toml", "-q")
    assert main(["convert", "seed.h5", *options, "--cell", "4", "-o", "one"]) == 0
    assert main(["convert", "points.h5", *options, "-o", "two"]) == 0
    capsys.readouterr()
    names = sorted(path.name for path in (site / "one").iterdir())
    assert names == sorted(path.name for path in (site / "two").iterdir())
    assert {"README.txt", "georef.json", "terrain.stl", "terrain.asc", ".mpmgis"} <= set(names)
    assert (site / "one/terrain.stl").read_bytes() == (site / "two/terrain.stl").read_bytes()
    assert json.loads((site / "one/georef.json").read_text()) == json.loads((site / "two/georef.json").read_text())
    text = (site / "one/README.txt").read_text()
    assert "PLACEHOLDER: the end, 10 s" in text
    kept, _, lost = text.splitlines()[3].partition(" Lost: ")
    assert ("stress" in kept, "stress" in lost) == ((True, False) if solver == "cbgeo" else (False, True))
    assert main(["convert", "points.h5", *options, "-o", "two", "--overwrite"]) == 0


def test_a_run_becomes_one_series(site, capsys):
    assert main([*SEED, "-o", "seed.h5", "-q"]) == 0
    frame = read_frame(site / "seed.h5")
    (site / "results").mkdir()
    for number, time in enumerate((0.0, 2.0, 4.0)):
        moved = type(frame)(**{**vars(frame), "time": time, "dem": "../dtm.tif"})
        moved.particles.position[:, 0] += 10
        write_frame(site / "results" / f"frame_{number:06d}.h5", moved)
    capsys.readouterr()
    assert main(["convert", *(f"results/frame_00000{k}.h5" for k in (2, 0, 1)), "--for", "paraview"]) == 0
    assert capsys.readouterr().out.strip() == "results_paraview"
    assert "stress, which" not in (site / "results_paraview/README.txt").read_text()
    entries = list_frames([site / "results_paraview/points.pvd"])
    assert [entry.time for entry in entries] == [0, 2, 4]
    east = [entry.read().map_xy()[0].mean() for entry in entries]
    assert np.diff(east) == pytest.approx([10, 10], abs=1e-3)


def test_properties_missing_in_a_frame_or_not_transferred_are_reported(site, capsys):
    assert main([*SEED, "-o", "seed.h5", "-q"]) == 0
    assert main(["convert", "seed.h5", "--cell", "4", "-o", "points.h5", "-q"]) == 0
    frame = read_frame(site / "points.h5")
    write_frame(site / "later.h5", type(frame)(**{**vars(frame), "state": {}}))
    softened = "[softening]\nresidual_friction_angle = 20\n" + BED.replace("Coulomb", "Voellmy") + "xi = 1000\n"
    (site / "soft.toml").write_text(MATERIAL + softened)
    for solver, left in (("cbgeo", "softening"), ("mpm-geomechanics", "softening, all of Voellmy on the bed but mu")):
        capsys.readouterr()
        assert main(["convert", "later.h5", "--for", solver, "--material", "soft.toml"]) == 0
        lines = capsys.readouterr().err.splitlines()
        assert f"not handed over: {left}" in lines
        (lost,) = [line for line in lines if line.startswith("lost: ")]
        assert lost.endswith("stress, which this frame does not contain")
        assert f"Not handed over: {left}." in (site / f"later_{solver}/README.txt").read_text()


REFUSED = {
    ("--for", "kratoz"): "invalid choice: 'kratoz'",
    ("--for", "kratos"): "needs a material: --material FILE, a scene with [material]",
    ("--for", "kratos", "--material", "soil.toml"): "seed.h5: Kratos MPM needs the cell size of its grid: --cell M",
    ("--for", "kratos", "--cell", "4", "--material", "dtm.tif"): "dtm.tif is not a readable text file",
    ("--for", "kratos", "--cell", "4", "--material", "none.toml"): "none.toml: no such file",
    ("--for", "kratos", "--cell", "4", "--material", "bed.toml"): "bed.toml has no table [material]; write one: law",
    ("--for", "kratos", "--cell", "4", "--material", "half.toml"): "DruckerPrager needs shear_modulus [Pa]",
    ("--for", "kratos", "--cell", "4", "--material", "more.toml"): "[zones] is in a file without [terrain]",
    ("--for", "kratos", "--cell", "4", "--material", "mu_i.toml"): "no counterpart of MuI",
    ("--for", "kratos", "--cell", "4", "--material", "cohesive.toml"): "no counterpart of CohesiveMuI",
    ("--for", "mpm-geomechanics", "--cell", "4", "--material", "soil.toml"): "add [friction] to soil.toml",
    ("--for", "paraview", "--material", "soil.toml"): "ParaView needs no material; leave it out",
    ("--for", "paraview", "--to", "columns"): "--to columns: paraview starts from points",
    ("--for", "paraview", "--by", "cell"): "--by requires --to columns",
    ("--for", "paraview", "--window", "3,4"): "expected four numbers W,S,E,N",
    ("--for", "paraview", "--window", "400000,5100000,400050,5100050"): "not all within the window 400000,5100000,",
    (*KRATOS, "--window", "1,2,3,4"): "not all within the window 1,2,",
    ("--for", "paraview", "-o", "dtm.tif"): "dtm.tif exists already",
    ("--for", "paraview", "-o", "dtm.tif", "--overwrite"): "dtm.tif is a file, expected a folder",
    ("--for", "paraview", "-o", ".", "--overwrite"): "contains the input",
    ("--material", "soil.toml"): "--material requires --for",
    ("--window", "0,0,1,1"): "--window requires --for",
    ("seed.h5",): "2 frames, expected one; --for paraview and --for houdini take several",
    ("seed.h5", "--for", "cbgeo", "--cell", "4", "--material", "soil.toml"): "starts from one frame, got 2",
    ("points.h5", "--for", "paraview"): "have the same time, 0 s",
}


@pytest.fixture
def with_files(site):
    assert main([*SEED, "-o", "seed.h5", "-q"]) == 0
    assert main(["convert", "seed.h5", "--cell", "4", "-o", "points.h5", "-q"]) == 0
    (site / "bed.toml").write_text(BED)
    (site / "half.toml").write_text(MATERIAL.replace("shear_modulus = 2e6\n", ""))
    (site / "more.toml").write_text(MATERIAL + "[[zones]]\nmu = 3\n")
    return site


def refusal(capsys, words):
    """The one line with which a command is refused."""
    capsys.readouterr()
    try:
        code = main(words)
    except SystemExit as error:
        code = error.code
    out, err = capsys.readouterr()
    assert code == 2 and not out
    (line,) = [line for line in err.splitlines() if line.startswith("mpmgis")]
    assert err.count("\n") == 1 or words[0] == "seed"
    return line


def test_wrong_input_is_one_line_and_leaves_nothing(with_files, capsys):
    before = sorted(path.name for path in with_files.iterdir())
    for options, words in REFUSED.items():
        assert words in refusal(capsys, ["convert", "seed.h5", *options]), options
    spaced = ["convert", "points.h5", "--for", "houdini", "--spacing", "1"]
    assert "points.h5 already contains points" in refusal(capsys, spaced)
    assert "needs no grid; leave --cell out" in refusal(
        capsys, ["convert", "points.h5", "--for", "houdini", "--cell", "1"]
    )
    assert "--cell requires --for" in refusal(capsys, [*SEED, "--cell", "4"])
    large = [*SEED, "--cell", "4000", "--for", "cbgeo", "--material", "soil.toml"]
    assert "cells of 4000 m do not fit into the ground" in refusal(capsys, large)
    (with_files / "theirs.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\n"
        + "".join(f"property float {name}\n" for name in ("x", "y", "z", "vx", "vy", "vz"))
        + "end_header\n1 2 3 0 0 0\n"
    )
    assert "theirs.ply (ply) lacks: the volume of the particles" in refusal(
        capsys, ["convert", "theirs.ply", "--for", "paraview"]
    )
    (with_files / "theirs.ply").unlink()
    assert "--cell M" in refusal(capsys, [*SEED, "--for", "cbgeo", "--material", "soil.toml"])
    assert sorted(path.name for path in with_files.iterdir()) == before


def kratos_is_there():
    words = [KRATOS_PYTHON, "-c", "from KratosMultiphysics import MPMApplication"]
    return subprocess.run(words, capture_output=True).returncode == 0


@pytest.mark.parametrize("law", ["DruckerPrager", "Elastic"])
def test_kratos_starts_from_it_to_the_last_digit(site, capsys, law):
    if not kratos_is_there():
        pytest.skip(
            "no KratosMultiphysics with KratosMPMApplication here (MPMGIS_KRATOS_PYTHON names a Python with it)"
        )
    text = MATERIAL if law == "DruckerPrager" else MATERIAL.split("friction_angle")[0]
    (site / "soil.toml").write_text(text.replace("DruckerPrager", law))
    assert main([*SEED, "--velocity", "1,-2", *KRATOS, "-o", "case", "-q"]) == 0
    (site / "case/check.py").write_text(KRATOS_CHECK)
    subprocess.run([KRATOS_PYTHON, "check.py"], cwd=site / "case", check=True, capture_output=True, timeout=120)
    first, last = (np.array(rows) for rows in json.loads((site / "case/told.json").read_text()))
    assert main([*SEED, "--velocity", "1,-2", "--for", "paraview", "--cell", "4", "-o", "points", "-q"]) == 0
    (entry,) = list_frames([site / "points/points.pvd"])
    points = entry.read()
    origin = json.loads((site / "case/georef.json").read_text())["origin"]
    place = points.particles.position + np.array(points.origin) - origin
    assert first[:, :3] == pytest.approx(place, abs=3e-8)
    assert first[:, 3:6] == pytest.approx(points.particles.velocity, abs=1e-12)
    assert first[:, 6] == pytest.approx(points.particles.volume, rel=4e-11)
    assert first[:, 7].sum() == pytest.approx(points.particles.mass.sum(), rel=1e-12)
    assert len(last) == len(first) and last[:, 7].sum() == pytest.approx(first[:, 7].sum(), rel=1e-12)
    assert 0 < np.abs(last[:, :3] - first[:, :3]).max() < 2.0
