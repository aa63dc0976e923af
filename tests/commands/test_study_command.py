"""`mpmgis study` through the command line: table, plot, text, settings for an error; refusals."""

import csv

import h5py
import numpy as np
import pytest
import rasterio
from matplotlib.image import imread
from slope_site import SCENE, slide, write_block_site, write_site

from mpmgis.commands.shell.main import main
from mpmgis.commands.shell.simulation_verbs import target_lines
from mpmgis.studies.study_table import RECORD_NAMES, SettingChoice


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = write_site(tmp_path_factory.mktemp("study"))
    (folder / "scene.toml").write_text(SCENE)
    return folder


def rows(path):
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def studied(site):
    """One study of two knobs, against a finer run."""
    arguments = ["study", str(site / "scene.toml"), "--knobs", "cell_size,cfl", "--repeats", "2", "-q"]
    assert main(arguments) == 0
    return site / "study"


def test_a_study_writes_every_setting_with_its_time_and_errors(studied):
    found = rows(studied / "study.csv")
    assert tuple(found[0]) == RECORD_NAMES
    assert [row["knob"] for row in found] == ["scene"] + ["cell_size"] * 3 + ["cfl"] * 2
    for row in found:
        assert 0 < float(row["seconds_min"]) <= float(row["seconds"]) <= float(row["seconds_max"])
        assert int(row["particle_steps"]) > int(row["steps"]) > 0 and float(row["compile_seconds"]) > 0
        assert float(row["predicted_seconds"]) > 0 and abs(float(row["mass_error"])) < 1e-12
    error = {float(row["cell_size_m"]): float(row["error_thickness"]) for row in found if row["knob"] != "cfl"}
    assert error[20.0] > error[10.0] > error[7.07107] > 0
    assert any(row["on_front"] == "1" for row in found)


def test_an_export_of_fewer_frames_or_larger_cells_is_further_from_the_finest(studied):
    found = {(float(row["cs_e"]), float(row["dt_e"])): row for row in rows(studied / "export.csv")}
    assert float(found[5.0, 5.0]["h_max"]) == float(found[5.0, 5.0]["Ut_max"]) == 0.0
    assert 0 < float(found[5.0, 10.0]["h_max"]) < float(found[5.0, 40.0]["h_max"])
    assert 0 < float(found[10.0, 5.0]["h_max"]) < float(found[40.0, 5.0]["h_max"])
    assert int(found[5.0, 10.0]["frames"]) == 4


def test_the_plot_is_a_picture(studied):
    shown = imread(studied / "study.png")
    assert shown.shape[1] > 1000 and len(np.unique(shown)) > 20


@pytest.mark.thorough
def test_table_words_and_settings_for_an_error_are_printed(site, studied, capsys, tmp_path):
    """The error asked for is that of the smallest cells, which no other setting reaches."""
    least = min(float(row["error_with_reference"]) for row in rows(studied / "study.csv") if row["knob"] != "cfl")
    scene, out = str(site / "scene.toml"), str(tmp_path / "out")
    arguments = ["study", scene, "--knobs", "cell_size", "--repeats", "1", "--no-exports", "-o", out, "-q"]
    assert main([*arguments, "--target-error", str(1.0001 * least)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert sum(line.startswith("*") for line in lines) >= 2
    assert any("is of order" in line for line in lines) or any("follows no power" in line for line in lines)
    at = lines.index("[numerics]")
    assert lines[at + 1] == "cell_size = 7.07107" and f"at most {1.0001 * least:g}" in lines[at - 1]
    assert lines[-1] == f"{out}/study.png" and not (tmp_path / "out" / "export.csv").exists()


@pytest.mark.thorough
def test_against_an_exact_answer(site, tmp_path):
    """The run itself at its end, with frames at the study's times, is the answer: its own error is none."""
    (site / "as_studied.toml").write_text(SCENE.replace("frame_interval = 5", "frame_interval = 7.5"))
    assert main(["run", str(site / "as_studied.toml"), "-o", str(tmp_path / "results"), "-q"]) == 0
    frames, gis = str(tmp_path / "results" / "frame_000004.h5"), str(tmp_path / "gis")
    with h5py.File(frames, "r+") as file:  # without it columns are squares, as a study compares them
        del file["particles"].attrs["cell_size"]
    assert main(["export-raster", frames, "-o", gis, "--products", "t_vol,mass", "--no-qgis", "-q"]) == 0
    (step,) = (tmp_path / "gis" / "rasters").glob("*_0000.tif")
    with rasterio.open(step) as source:
        at = source.descriptions.index("mass [kg m-2]") + 1
        thickness, profile = source.read(at) / 1000.0, source.profile | {"count": 1}
    with rasterio.open(tmp_path / "exact.tif", "w", **profile) as target:
        target.write(thickness, 1)
    out = tmp_path / "study"
    arguments = ["study", str(site / "scene.toml"), "--exact", str(tmp_path / "exact.tif"), "--knobs", "cfl"]
    assert main([*arguments, "--repeats", "1", "--no-exports", "-o", str(out), "-q"]) == 0
    found = rows(out / "study.csv")
    assert float(found[0]["error_thickness"]) < 1e-6 < float(found[1]["error_thickness"])
    assert found[0]["error_area"] == ""


@pytest.fixture(scope="module")
def beside(site, studied):
    """A study of one knob with two results beside it: numbers of another code, and that of the study before."""
    (site / "other.csv").write_text(
        "code,setting,seconds,seconds_min,seconds_max,error_thickness\n"
        "Other 1.0,fine,50,40,70,0.0001\nOther 1.0,coarse,30,,,0.9\n"
    )
    arguments = ["study", str(site / "scene.toml"), "--knobs", "cfl", "--repeats", "1", "--no-exports", "-q"]
    tables = ["--beside", str(site / "other.csv"), "--beside", str(studied / "study.csv")]
    assert main([*arguments, *tables, "-o", str(site / "beside")]) == 0
    return site / "beside"


@pytest.mark.thorough
def test_results_of_others_are_in_the_table_and_decide_nothing(beside, studied):
    found = rows(beside / "study.csv")
    own, others = found[:3], found[3:]
    assert {row["knob"] for row in others} == {"beside"} and "beside" not in {row["knob"] for row in own}
    assert [row["setting"] for row in others[:2]] == ["Other 1.0: fine", "Other 1.0: coarse"]
    assert others[2]["setting"] == "study: unchanged scene" and len(others) == 2 + len(rows(studied / "study.csv"))
    fine, coarse = others[:2]
    assert (fine["seconds"], fine["seconds_min"], fine["seconds_max"]) == ("50", "40", "70")
    assert fine["time_over_front"] == "" and fine["error_momentum"] == "" and fine["on_front"] == ""
    assert float(coarse["error_thickness"]) == 0.9
    assert {row["error_with_reference"] for row in own} == {""}  # no order: the error of the reference is unknown
    quickest = min(float(row["seconds"]) for row in own if float(row["error_thickness"]) <= 0.9)
    assert float(coarse["time_over_front"]) == pytest.approx(30 / quickest, rel=1e-6)
    assert sum(row["on_front"] == "1" for row in own) >= 1


@pytest.mark.thorough
def test_a_table_with_results_of_others_is_read_again_without_them(beside, site, tmp_path):
    arguments = ["study", str(site / "scene.toml"), "--knobs", "cfl", "--repeats", "1", "--no-exports", "-q"]
    assert main([*arguments, "--beside", str(beside / "study.csv"), "-o", str(tmp_path / "out")]) == 0
    assert len(rows(tmp_path / "out" / "study.csv")) == 6


@pytest.mark.thorough
def test_a_raster_beside_an_exact_answer_is_held_against_it_as_own_runs_are(site, tmp_path, capsys):
    """Half the exact thickness is off by a half; the exact answer itself by nothing."""
    with rasterio.open(site / "dtm.tif") as source:
        profile, thickness = source.profile, np.where(source.read(1) > 200.0, 2.0, 0.0)
    for name, factor in (("exact", 1.0), ("half", 0.5)):
        with rasterio.open(tmp_path / f"{name}.tif", "w", **profile) as target:
            target.write(factor * thickness, 1)
    (tmp_path / "other.csv").write_text("setting,seconds,thickness\nhalf,1,half.tif\nall,1e9,exact.tif\n")
    arguments = ["study", str(site / "scene.toml"), "--knobs", "cfl", "--repeats", "1", "--no-exports", "-q"]
    others = ["--exact", str(tmp_path / "exact.tif"), "--beside", str(tmp_path / "other.csv")]
    assert main([*arguments, *others, "-o", str(tmp_path / "out")]) == 0
    half, whole = rows(tmp_path / "out" / "study.csv")[-2:]
    assert float(half["error_thickness"]) == 0.5 and float(whole["error_thickness"]) == 0.0
    printed = capsys.readouterr().out.splitlines()
    assert any(line.startswith("+ other: half") and line.endswith("50 %") for line in printed)
    assert any("other: all: no setting of this study is as accurate" in line for line in printed)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("setting,seconds\na,1\n", "has no column 'error_thickness'"),
        ("name,seconds,error_thickness\na,1,0.1\n", "has no column 'setting'"),
        ("setting,seconds,error_thickness\na,0,0.1\n", "line 2: seconds = '0', expected a number above 0"),
        ("setting,seconds,error_thickness\na,1,0.1\nb,1,bad\n", "line 3: error_thickness = 'bad'"),
        ("setting,seconds,error_thickness\na,1,-0.1\n", "expected a number of at least 0"),
        ("setting,seconds,error_thickness\na,1,\n", "error_thickness is empty"),
        ("setting,seconds,error_thickness\na,,0.1\n", "seconds is empty"),
        ("setting,seconds,error_thickness\n,1,0.1\n", "setting is empty"),
        ("setting,seconds,seconds_max,error_thickness\na,2,1,0.1\n", "is not between"),
        ("setting,seconds,thickness\na,1,dtm.tif\n", "whose error requires --exact"),
        ("setting,seconds,error_thickness\n\xff", "is not readable text"),
    ],
)
def test_a_table_beside_that_makes_no_sense_is_refused_in_one_line(site, capsys, tmp_path, text, words):
    (tmp_path / "other.csv").write_bytes(text.encode("latin-1"))
    arguments = ["study", str(site / "scene.toml"), "--beside", str(tmp_path / "other.csv")]
    assert main([*arguments, "-o", str(tmp_path / "out")]) in (2, 4)
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("mpmgis")]
    assert len(lines) == 1 and words in lines[0] and not (tmp_path / "out").exists()


@pytest.mark.thorough
def test_a_scene_in_stages_is_studied_as_a_whole(tmp_path):
    """Columns become points after a second; both stages' steps and the conversion are in the time."""
    folder = write_block_site(tmp_path)
    stages = '[[stage]]\nsolver = "columns"\nuntil = {time = 1}\n[[stage]]\nsolver = "points"\ncell_size = 6\n'
    (folder / "scene.toml").write_text(slide(10.0, 2, 0.5, head="", more="particles_per_cell = 4") + stages)
    arguments = ["study", str(folder / "scene.toml"), "--knobs", "points_per_cell,stage2.cell_size", "--repeats", "1"]
    assert main([*arguments, "--refinement", "1.5", "-q"]) == 0
    found = rows(folder / "study" / "study.csv")
    assert [row["knob"] for row in found] == ["scene", "points_per_cell", "stage2.cell_size", "stage2.cell_size"]
    assert [row["cell_size_m"] for row in found] == ["10+6", "10+6", "10+12", "10+8.48528"]
    assert [row["particles_per_cell"] for row in found] == ["4+8", "4+27", "4+8", "4+8"]
    assert {row["solver"] for row in found} == {"columns+points"}
    work = [int(row["particle_steps"]) for row in found]
    assert work[2] < work[3] < work[0] < work[1]
    assert all(abs(float(row["mass_error"])) < 1e-12 and float(row["compile_seconds"]) > 0 for row in found)
    assert all(float(row["error_thickness"]) > 0 for row in found)
    steps = {float(row["dt_e"]) for row in rows(folder / "study" / "export.csv")}
    assert steps == {0.5, 1.0, 2.0, 4.0}


def test_settings_for_an_error_name_their_table():
    choice = SettingChoice({"stage1.cell_size": 8.0, "stage2.cell_size": 2.0, "precision": "float32"}, 3.0, 0.05, False)
    assert target_lines(0.1, choice)[1:] == [
        "[[stage]] number 1",
        "cell_size = 8.0",
        "[[stage]] number 2",
        "cell_size = 2.0",
        "[numerics]",
        'precision = "float32"',
    ]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--knobs", "cell"], "unknown parameter"),
        (["--beside", "none.csv"], "none.csv: no such file"),
        (["--measure", "depth"], "choose from"),
        (["--exact", "none.tif"], "none.tif: no such file"),
        (["--exact", "dtm.tif", "--measure", "area"], "contains only thickness"),
        (["--refinement", "1"], "use a larger --refinement"),
        (["--repeats", "0"], "expected a whole number above 0"),
        (["--target-error", "-1"], "above 0"),
    ],
)
def test_what_cannot_be_studied_is_refused_in_one_line(site, capsys, tmp_path, monkeypatch, options, words):
    monkeypatch.chdir(site)
    try:
        code = main(["study", "scene.toml", "-o", str(tmp_path / "out"), *options])
    except SystemExit as stopped:
        code = stopped.code
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("mpmgis")]
    assert code == 2 and len(lines) == 1 and words in lines[0]
    assert not (tmp_path / "out").exists()


def test_a_study_that_is_there_is_not_replaced_unasked(studied, capsys):
    assert main(["study", str(studied.parent / "scene.toml"), "-q"]) == 2
    assert "--overwrite" in capsys.readouterr().err
