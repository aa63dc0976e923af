"""`mpmgis hydrograph` for a block that crosses a section at a known speed."""

import math

import h5py
import numpy as np
import pytest
from block_frames import DENSITY, MASS, MIDDLE, SIDE, THICKNESS, table, write_block_run, write_line

from mpmgis.commands.shell.main import main

SPEED, FIRST = 10.0, 150.0  # [m s-1] horizontal, [m] of the block's middle at the start
SECTION = 250.0  # [m] on the slope; the front gets there at 5 s, the tail leaves it at 15 s
DISCHARGE = SPEED * THICKNESS * SIDE  # [m3 s-1] while it goes through


def moving(folder, interval=1.0, dimension=2, end=16.0):
    times = np.arange(0.0, end + 1e-9, interval)
    return write_block_run(folder, FIRST + SPEED * times, times, np.full(len(times), SPEED), dimension)


def columns(path, *names):
    return np.array([[float(row[name]) if row[name] else np.nan for name in names] for row in table(path)]).T


def hydrograph(capsys, *arguments):
    capsys.readouterr()
    code = main(["hydrograph", *map(str, arguments)])
    out, said = capsys.readouterr()
    assert code == 0, said
    return out.splitlines(), said


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("cell", [10.0, 5.0])
def test_all_mass_goes_through_once_and_the_balance_closes(tmp_path, capsys, dimension, cell):
    run = moving(tmp_path, dimension=dimension)
    section = write_line(tmp_path / "section.gpkg", (SECTION, 20), (SECTION, 380))
    shown, _ = hydrograph(capsys, run, "--section", section, "--cs-e", cell)
    time, rate, volume, mass, by_cells = columns(
        tmp_path / "run_hydrograph" / "hydrograph.csv",
        "time_s",
        "discharge_m3_s",
        "volume_m3",
        "mass_kg",
        "cells_mass_kg",
    )
    assert mass[-1] == pytest.approx(MASS, rel=1e-12) and volume[-1] == pytest.approx(MASS / DENSITY, rel=1e-12)
    assert rate[(time > 6) & (time < 15)] == pytest.approx(DISCHARGE, rel=1e-9)
    assert (mass[time < 5] == 0).all()
    assert by_cells[-1] == pytest.approx(MASS, rel=0.06)  # fronts between frames, and cells as long as a frame's way
    assert "90 degrees from north; 16 of 16" in shown[0]
    assert any("0 around its ends, 0 new there; error 0.0e+00 kg" in line for line in shown)


def test_a_section_drawn_the_other_way_reports_the_same(tmp_path, capsys):
    run = moving(tmp_path, 2.0)
    tables = []
    for ends in ((20, 380), (380, 20)):
        section = write_line(tmp_path / f"section{ends[0]}.gpkg", *((SECTION, y) for y in ends))
        hydrograph(capsys, run, "--section", section, "-o", tmp_path / "h.csv", "--overwrite")
        tables.append(columns(tmp_path / "h.csv", "time_s", "volume_m3", "cells_volume_m3"))
    assert tables[0] == pytest.approx(tables[1])


def test_half_a_section_counts_half_and_reports_what_passed_around(tmp_path, capsys):
    run = moving(tmp_path, 2.0)
    section = write_line(tmp_path / "section.gpkg", (SECTION, MIDDLE), (SECTION, 390))
    shown, _ = hydrograph(capsys, run, "--section", section)
    assert f"{MASS / 2:.6g} through it, {MASS / 2:.6g} around its ends" in "\n".join(shown)


def test_the_cells_flux_comes_nearer_with_the_frames(tmp_path, capsys):
    section = write_line(tmp_path / "section.gpkg", (SECTION, 20), (SECTION, 380))
    errors = []
    for interval in (4.0, 0.5):
        folder = tmp_path / f"{interval:g}"
        folder.mkdir()
        run = moving(folder, interval)
        shown, said = hydrograph(capsys, run, "--section", section, "--method", "cells", "--cs-e", 2.5)
        assert "0 of" in shown[0] and "trapezoidal" in said
        mass = columns(folder / "run_hydrograph" / "hydrograph.csv", "mass_kg")[0]
        errors.append(abs(mass[-1] / MASS - 1))
    assert errors[1] < 0.02 < errors[0]


def test_particles_without_ids_are_counted_by_cells_and_that_is_reported(tmp_path, capsys):
    run = moving(tmp_path, 2.0)
    for path in run.glob("frame_*.h5"):
        with h5py.File(path, "a") as file:
            del file["particles/id"]
    section = write_line(tmp_path / "section.gpkg", (SECTION, 20), (SECTION, 380))
    shown, said = hydrograph(capsys, run, "--section", section)
    assert "0 of 8 intervals" in shown[0] and "no ids in common" in said
    assert not any(line.startswith("mass beyond") for line in shown)
    assert main(["hydrograph", str(run), "--section", str(section), "--method", "particles", "--overwrite"]) == 2
    assert "no particles in common by id" in capsys.readouterr().err


def test_speed_along_the_slope_does_not_count_twice(tmp_path, capsys):
    """A discharge is a matter of the plan: the block's speed along the ground is 12 % more than that."""
    run = moving(tmp_path, 1.0)
    section = write_line(tmp_path / "section.gpkg", (SECTION, 20), (SECTION, 380))
    hydrograph(capsys, run, "--section", section)
    cells = columns(tmp_path / "run_hydrograph" / "hydrograph.csv", "cells_discharge_m3_s")[0]
    assert cells[10] == pytest.approx(DISCHARGE, rel=1e-9) and math.hypot(1, 0.5) > 1.1


def test_an_export_has_the_flux_of_the_frames_cells(tmp_path, capsys):
    """On the slope, where the speed across the bed must not be lost: the block's motion there is not along the bed."""
    run = moving(tmp_path, 2.0, dimension=3)
    for path in run.glob("*.h5"):
        with h5py.File(path, "r+") as file:
            file["particles/velocity"][:, 2] = 3.0  # it also lifts off
    section = write_line(tmp_path / "section.gpkg", (SECTION, 20), (SECTION + 30, 380))
    assert main(["export-raster", str(run), "--no-qgis", "--products", "mass,Ut_E,Ut_N"]) == 0
    found = {}
    for source in ("run", "run_gis"):
        _, said = hydrograph(capsys, tmp_path / source, "--section", section, "--method", "cells")
        rows = table(tmp_path / f"{source}_hydrograph" / "hydrograph.csv")
        found[source] = np.array([[float(row["volume_m3"]), float(row["mass_kg"])] for row in rows])
    assert found["run"][-1, 1] == pytest.approx(MASS, rel=0.1)
    assert found["run_gis"] == pytest.approx(found["run"], rel=1e-5)
    assert "rasters have no particles" in said


def test_sections_that_are_none_are_refused(tmp_path, capsys):
    run = moving(tmp_path, 8.0)
    assert main(["export-raster", str(run), "--no-qgis"]) == 0
    across = write_line(tmp_path / "across.gpkg", (SECTION, 20), (SECTION, 380))
    for arguments, words in (
        (
            (run, "--section", write_line(tmp_path / "x.gpkg", (100, 20), (200, 380), (200, 20), (100, 380))),
            "crosses itself",
        ),
        ((run, "--section", write_line(tmp_path / "off.gpkg", (900, 20), (900, 380))), "is outside the raster"),
        ((run / "frame_000000.h5", "--section", across), "one frame"),
        ((tmp_path / "run_gis", "--section", across), "export with --products mass,Ut_E,Ut_N"),
        ((tmp_path / "run_gis", "--section", across, "--method", "particles"), "is an export without particles"),
        ((tmp_path / "run_gis", "--section", across, "--cs-e", 5), "--cs-e requires frames"),
        ((run, "--section", tmp_path / "no.gpkg"), "no such file"),
    ):
        capsys.readouterr()
        assert main(["hydrograph", *map(str, arguments)]) == 2
        said = capsys.readouterr().err.splitlines()
        assert len(said) == 1 and words in said[0], said
    assert not (tmp_path / "run_hydrograph").exists()
