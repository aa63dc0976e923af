"""`mpmgis runout` for a block with a known path, from frames of columns and points and from their export."""

import json
import math

import pytest
from block_frames import FRICTION, MASS, REST, SIDE, START, TANGENT, table, write_block_run, write_line
from slope_site import FOOT, PIXEL

from mpmgis.commands.shell.main import main


def runout(capsys, *arguments):
    """Facts that the command prints with --json, and its messages."""
    capsys.readouterr()
    code = main(["runout", *map(str, arguments), "--json"])
    out, said = capsys.readouterr()
    assert code == 0, said
    return json.loads(out), said


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_block_with_coulomb_friction_has_its_mu_as_tangent_of_the_centre_of_mass(tmp_path, capsys, dimension):
    run = write_block_run(tmp_path, dimension=dimension)
    facts, _ = runout(capsys, run, "--cs-e", 5, "--line", write_line(tmp_path / "line.gpkg"))
    assert facts["centre_of_mass_tangent"] == pytest.approx(FRICTION, rel=1e-6)
    assert facts["centre_of_mass_runout_m"] == pytest.approx(REST - START, rel=1e-6)
    assert facts["centre_of_mass_drop_m"] == pytest.approx(TANGENT * (FOOT - START), rel=1e-6)
    (east, north, height), (*there, lower) = facts["top"], facts["toe"]
    assert facts["runout_straight_m"] == pytest.approx(math.dist((east, north), there))
    assert facts["drop_height_m"] == pytest.approx(height - lower)


@pytest.mark.parametrize("cell", [10.0, 5.0, 2.5])
def test_reach_and_the_99_percent_of_the_mass_are_exact_to_half_a_cell_and_to_one(tmp_path, capsys, cell):
    line = write_line(tmp_path / "line.gpkg")
    facts, _ = runout(capsys, write_block_run(tmp_path), "--cs-e", cell, "--line", line)
    first, last = START - SIDE / 2, REST + SIDE / 2
    assert facts["runout_m"] == pytest.approx(last - first - cell, abs=1e-6)  # from cell centre to cell centre
    assert facts["drop_height_m"] == pytest.approx(TANGENT * (FOOT - first - cell / 2), abs=1e-6)
    assert facts["runout_99_percent_of_mass_m"] == pytest.approx(last - SIDE / 100 - first - cell / 2, abs=cell)
    assert facts["deposit_runout_m"] == facts["runout_m"]
    slope = math.hypot(1, TANGENT)
    bend = PIXEL * math.hypot(1, TANGENT / 2) - PIXEL * (slope + 1) / 2  # the DTM's last pixel rounds the foot
    longer = (slope - 1) * (FOOT - first - cell / 2) + bend
    assert facts["runout_along_ground_m"] - facts["runout_m"] == pytest.approx(longer, abs=1e-6)


def test_the_files_hold_the_same_and_the_screen_names_them(tmp_path, capsys):
    run = write_block_run(tmp_path)
    facts, _ = runout(capsys, run)
    folder = tmp_path / "run_runout"
    assert sorted(file.name for file in folder.iterdir() if file.suffix) == [
        "mass_over_time.csv",
        "profile.csv",
        "runout.csv",
        "runout.png",
    ]
    rows = {row["quantity"]: float(row["value"]) for row in table(folder / "runout.csv")}
    assert rows["energy_line_angle"] == pytest.approx(facts["energy_line_angle_deg"], rel=1e-9)
    times = table(folder / "mass_over_time.csv")
    assert [float(row["time_s"]) for row in times] == [0, 10, 20]
    assert all(float(row["mass_kg"]) == pytest.approx(MASS) for row in times)
    assert main(["runout", str(run), "--overwrite"]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert shown[-4:] == [
        str(folder / name) for name in ("runout.png", "runout.csv", "mass_over_time.csv", "profile.csv")
    ]


def test_an_export_has_the_same_reach_and_no_way_of_the_mass(tmp_path, capsys):
    run = write_block_run(tmp_path)
    assert main(["export-raster", str(run), "--no-qgis"]) == 0
    of_frames, _ = runout(capsys, run)
    of_export, _ = runout(capsys, tmp_path / "run_gis", "-o", tmp_path / "plot.png")
    assert of_export["runout_m"] == pytest.approx(of_frames["runout_m"], abs=1e-4)
    assert of_export["drop_height_m"] == pytest.approx(of_frames["drop_height_m"], abs=1e-3)
    assert "centre_of_mass_runout_m" not in of_export
    assert (tmp_path / "plot.png").is_file() and not (tmp_path / "run_gis_runout").exists()


def test_a_given_line_is_reprojected_and_turned_downhill(tmp_path, capsys):
    run = write_block_run(tmp_path)
    line = write_line(tmp_path / "line.gpkg", (780, 200), (20, 200), crs="EPSG:4326")
    facts, said = runout(capsys, run, "--line", line)
    assert "reprojected" in said and "it is reversed" in said
    assert facts["line"]["source"] == str(line)
    assert facts["runout_m"] == pytest.approx(REST - START + SIDE - 10, abs=0.01)


def test_a_line_across_the_flow_is_reported(tmp_path, capsys):
    run = write_block_run(tmp_path)
    across = write_line(tmp_path / "across.gpkg", (300, 100), (310, 300))
    _, said = runout(capsys, run, "--line", across)
    assert "does not follow the flow" in said
    _, said = runout(capsys, run, "--line", write_line(tmp_path / "line.gpkg"), "--overwrite")
    assert "follow" not in said


def test_what_cannot_be_answered_is_refused_in_one_line(tmp_path, capsys):
    run = write_block_run(tmp_path)
    elsewhere = write_line(tmp_path / "elsewhere.gpkg", (100, 20), (700, 20))
    assert main(["export-raster", str(run), "--no-qgis"]) == 0
    export = tmp_path / "run_gis"
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "letter.txt").write_text("mine")
    written = tmp_path / "written"  # by the program, with a file of the user's in it
    assert main(["runout", str(run), "-o", str(written)]) == 0
    write_line(written / "line.gpkg")
    nowhere = write_line(tmp_path / "nowhere.gpkg", (100, 200), (100, 200))
    for arguments, words in (
        ((run, "--threshold", 50), "lower one"),
        ((run, "--line", elsewhere), "m away from the flow"),
        ((run, "--line", tmp_path / "none.gpkg"), "no such file"),
        ((tmp_path / "nothing",), "nothing"),
        ((export, "--cs-e", 5), "--cs-e requires frames"),
        ((run, "-o", tmp_path / "x.pdf"), "expected .png, .csv"),
        ((run, "-o", tmp_path / "taken"), "exists already"),
        ((run, "-o", tmp_path / "taken", "--overwrite"), "not written by mpmgis"),
        ((run, "-o", run, "--overwrite"), "would be replaced"),
        ((run, "-o", written, "--overwrite", "--line", written / "line.gpkg"), "contains the input"),
        ((run, "--line", nowhere), "has no length"),
    ):
        capsys.readouterr()
        assert main(["runout", *map(str, arguments)]) == 2
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 1 and words in lines[0], lines
    assert (tmp_path / "taken" / "letter.txt").read_text() == "mine" and (written / "line.gpkg").exists()
    assert not (tmp_path / "run_runout").exists()


def test_a_flow_of_which_the_centre_comes_back_has_no_angle_of_nan(tmp_path, monkeypatch):
    labels = []
    from mpmgis.results import runout_answer

    monkeypatch.setattr(runout_answer, "legend", lambda axes, **_: labels.extend(axes.get_legend_handles_labels()[1]))
    folder = write_block_run(tmp_path, (600.0, 650.0, 600.0))
    assert main(["runout", str(folder), "-o", str(tmp_path / "r.png")]) == 0
    assert "centre of mass" in labels and not any("nan" in label for label in labels)


@pytest.mark.parametrize("exported", [False, True])
def test_a_flow_that_did_not_move_has_no_angle(tmp_path, capsys, exported):
    """The highest and the lowest cell of a release on a slope give the angle of the slope, which is no runout."""
    folder = write_block_run(tmp_path, (START, START), times=(0.0, 10.0))
    if exported:
        assert main(["export-raster", str(folder), "--no-qgis", "--cs-e", "5"]) == 0
        folder = tmp_path / "run_gis"
    capsys.readouterr()
    assert main(["runout", str(folder), "-o", str(tmp_path / "none")]) == 2
    assert "the flow did not move" in capsys.readouterr().err and not (tmp_path / "none").exists()


def test_a_flow_that_still_moves_has_no_toe_of_a_deposit(tmp_path, capsys):
    folder = write_block_run(tmp_path, speeds=(0.0, 20.0, 20.0))
    facts, said = runout(capsys, folder)
    assert "did not come to rest (last step, t = 20 s, 100 % still moving)" in said
    assert facts["runout_m"] > 0 and "deposit_runout_m" not in facts
