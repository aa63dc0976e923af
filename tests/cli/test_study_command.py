"""`mpmgis study` as a user meets it: table, plot, words, settings for an error; refusals."""

import csv

import numpy as np
import pytest
import rasterio
from matplotlib.image import imread
from slope_site import SCENE, write_site

from mpmgis.cli.main import main
from mpmgis.studies.report import RECORD_NAMES


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


def test_table_words_and_settings_for_an_error_are_printed(site, capsys, tmp_path):
    scene, out = str(site / "scene.toml"), str(tmp_path / "out")
    arguments = ["study", scene, "--knobs", "cell_size", "--repeats", "1", "--no-exports", "-o", out, "-q"]
    assert main([*arguments, "--target-error", "1.5"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert sum(line.startswith("*") for line in lines) >= 2
    assert any("to the power" in line for line in lines) or any("follows no power" in line for line in lines)
    at = lines.index("[numerics]")
    assert lines[at + 1] == "cell_size = 20.0" and "at most 1.5" in lines[at - 1]
    assert lines[-1] == f"{out}/study.png" and not (tmp_path / "out" / "export.csv").exists()


def test_against_an_exact_answer(site, tmp_path):
    """The run itself at its end, with frames at the study's times, is the answer: its own error is none."""
    (site / "as_studied.toml").write_text(SCENE.replace("frame_interval = 5", "frame_interval = 7.5"))
    assert main(["run", str(site / "as_studied.toml"), "-o", str(tmp_path / "results"), "-q"]) == 0
    frames, gis = str(tmp_path / "results" / "frame_000004.h5"), str(tmp_path / "gis")
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


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--knobs", "cell"], "no such knob"),
        (["--measure", "depth"], "wanted one of thickness, momentum, area, reach"),
        (["--exact", "none.tif"], "none.tif: no such file"),
        (["--exact", "dtm.tif", "--measure", "area"], "tells of thickness only"),
        (["--refinement", "1"], "give a larger one"),
        (["--repeats", "0"], "wanted a whole number above 0"),
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
