"""Another code's points through `convert`: to columns, to what other solvers start from; what `info` tells of that."""

import json
import shutil

import numpy as np
import pytest
from block_frames import MASS, MIDDLE, SIDE, THICKNESS, block, write_block_run
from slope_site import SOUTH, WEST

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame

DENSITY = 1000.0
TERMS = ("--axes", "e,n,u", "--origin", f"{WEST},{SOUTH},0", "--density", DENSITY, "--crs", "EPSG:32632")
MATERIAL = """
[material]
law = "DruckerPrager"
bulk_modulus = 2e7
shear_modulus = 1.2e7
friction_angle = 32
[friction]
law = "Coulomb"
mu = 0.3
"""


def run(verb, *arguments):
    return main([verb, *map(str, arguments)])


@pytest.fixture
def table(tmp_path):
    """A table of the block's points on the slope at 0 s and on the flat, moving, at 10 s; its DTM is `dtm.tif`."""
    shutil.copy(write_block_run(tmp_path, (150.0,), (0.0,)) / "terrain.tif", tmp_path / "dtm.tif")
    rows = ["time,x,y,z,vx,vy,vz,volume"]
    for time, middle, speed in ((0.0, 150.0, 0.0), (10.0, 600.0, 4.0)):
        points = block(middle, speed, dimension=3)
        values = np.column_stack([np.full(len(points), time), points.position, points.velocity, points.volume])
        rows += [",".join(f"{value:.9g}" for value in row) for row in values]
    path = tmp_path / "particles.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def test_points_of_another_code_become_columns_with_their_mass_and_momentum(tmp_path, table, capsys):
    out = tmp_path / "columns.h5"
    asked = ("convert", table, *TERMS, "--dem", tmp_path / "dtm.tif", "--cell", 5, "-o", out)
    assert run(*asked) == 2
    assert "contains 2 frames, from 0 to 10 s; choose one with --at-time" in capsys.readouterr().err
    assert run(*asked, "--at-time", 9) == 2
    assert "the nearest, particles.csv, is at 10 s" in capsys.readouterr().err
    assert not out.exists()
    assert run(*asked, "--at-time", 10) == 0
    frame = read_frame(out)
    columns = frame.particles
    assert frame.dimension == 2 and frame.time == 10 and "count" not in frame.header
    assert columns.mass.sum() == pytest.approx(MASS, rel=1e-12)
    assert np.sum(columns.mass * columns.velocity[:, 0]) == pytest.approx(4 * MASS, rel=1e-12)
    assert np.allclose(columns.thickness, THICKNESS, rtol=1e-6)  # on the flat each cell holds what stands on it
    assert np.mean(frame.map_xy(), axis=1) == pytest.approx([WEST + 600, SOUTH + MIDDLE], abs=1e-6)


def test_another_solver_starts_from_another_codes_points_and_info_reports_the_folder(tmp_path, table, capsys):
    (tmp_path / "soil.toml").write_text(MATERIAL)
    given = (table, *TERMS, "--dem", tmp_path / "dtm.tif")
    for solver, more in (("geotaichi", ("--cell", 5, "--material", tmp_path / "soil.toml")), ("paraview", ())):
        folder = tmp_path / solver
        capsys.readouterr()
        if solver == "geotaichi":
            assert run("convert", *given, "--for", solver, *more, "-o", folder) == 2  # two times, one start
            assert "starts from one frame, got 2" in capsys.readouterr().err
            more = (*more, "--at-time", 0)
        assert run("convert", *given, "--for", solver, *more, "-o", folder) == 0
        capsys.readouterr()
        assert run("info", "--json", folder) == 0
        facts = json.loads(capsys.readouterr().out)
        assert facts["n"] == 1600 and facts["mass"] == pytest.approx(MASS, rel=1e-6)
        assert facts["crs"] == "EPSG:32632" and facts["axes"] == ["e", "n", "u"] and "README.txt" in facts["holds"]
        middle = 600 if solver == "paraview" else 150
        west, south, east, north = facts["bbox"]
        assert (west + east) / 2 == pytest.approx(WEST + middle, abs=1e-3)
        assert (south + north) / 2 == pytest.approx(SOUTH + MIDDLE, abs=1e-3)
    assert facts["kind"] == "start of ParaView" and facts["frames"] == 2 and facts["time"] == 10


def test_a_start_folder_that_was_changed_is_reported(tmp_path, table, capsys):
    folder = tmp_path / "start"
    (tmp_path / "soil.toml").write_text(MATERIAL)
    run_folder = tmp_path / "own"
    run_folder.mkdir()
    frame = write_block_run(run_folder, (150.0,), (0.0,), dimension=3) / "frame_000000.h5"
    assert (
        run("convert", frame, "--for", "kratos", "--cell", 5, "--material", tmp_path / "soil.toml", "-o", folder) == 0
    )
    assert run("info", folder) == 0
    assert "start of Kratos MPM" in capsys.readouterr().out
    readme = folder / "README.txt"
    readme.write_text(readme.read_text().replace("1600 points", "1601 points"))
    assert run("info", folder) == 2
    message = capsys.readouterr().err
    assert "has 1600 points" in message and "expected 1601" in message and len(message.splitlines()) == 1
    next(folder.glob("*_Body.mdpa")).write_text("damaged")
    assert run("info", folder) == 2
    message = capsys.readouterr().err
    assert "cannot be read" in message and len(message.splitlines()) == 1


def test_options_for_other_codes_files_are_refused_with_our_own(tmp_path, capsys):
    frame = write_block_run(tmp_path, (150.0,), (0.0,)) / "frame_000000.h5"
    for option, words in (
        (("--axes", "e,n,u"), "--axes is only for files of other codes"),
        (("--density", 3), "which contains its density"),
        (("--for", "paraview", "--at-time", 3), "no frame at 3 s; the nearest, frame_000000.h5, is at 0 s"),
    ):
        assert run("convert", frame, *option, "-o", tmp_path / "out.h5") == 2
        assert words in capsys.readouterr().err


def test_another_codes_points_are_compared_like_a_run(tmp_path, table, capsys):
    own = tmp_path / "own"
    own.mkdir()
    ours = write_block_run(own, (150.0, 600.0), (0.0, 10.0), speeds=(0.0, 4.0), dimension=3)
    folder = tmp_path / "theirs"
    folder.mkdir()
    theirs = shutil.move(table, folder / "particles.csv")
    dem = ("--dem", tmp_path / "dtm.tif")
    for other in (theirs, folder):
        capsys.readouterr()
        assert run("compare", ours, other, *TERMS, *dem, "--json") == 0
        facts = json.loads(capsys.readouterr().out)
        assert facts["iou"] == 1 and facts["both_m2"] == pytest.approx(2 * SIDE**2)
        assert facts["a"]["runout_m"] == facts["b"]["runout_m"] == pytest.approx(550, abs=10)  # from 100 m to 650
    assert run("compare", ours, ours, "--axes", "e,n,u") == 2
    assert "neither" in capsys.readouterr().err
    assert run("compare", ours, folder) == 2
    assert "its origin (--origin" in capsys.readouterr().err
