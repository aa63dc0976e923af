"""Questions to results that are rasters: an export, and other codes' *_pft, *_pfv, *_ppr."""

import numpy as np
import pytest
import rasterio
from block_frames import SIDE, table, write_block_run
from test_report_command import Reader

from mpmgis.commands.shell.main import main

PLACES = (150.0, 450.0, 600.0)
DENSITY = 1000.0


@pytest.fixture
def run(tmp_path):
    return write_block_run(tmp_path, PLACES, speeds=(0.0, 10.0, 0.0))


@pytest.fixture
def export(tmp_path, run):
    assert main(["export-raster", str(run), "--no-qgis"]) == 0
    return tmp_path / "run_gis"


@pytest.fixture
def other_code(tmp_path, export):
    """Peak thickness [m] and speed [m/s] of the export as another code names them; answers how the names begin."""
    folder = tmp_path / "other"
    folder.mkdir()
    with rasterio.open(export / "rasters" / "run_max.tif") as source:
        names = [text.partition(" [")[0] for text in source.descriptions]
        for kind, band in (("pft", "h_max"), ("pfv", "Ut_max")):
            profile = source.profile | {"count": 1}
            with rasterio.open(folder / f"com1DFA_{kind}.tif", "w", **profile) as target:
                target.write(source.read(names.index(band) + 1), 1)
    return folder / "com1DFA"


def ask(verb, *arguments):
    return main([verb, *map(str, arguments)])


def test_another_codes_rasters_have_the_runout_and_classes_of_the_export(tmp_path, export, other_code):
    dem = ["--dem", export / "dtm.tif"]
    found = []
    for source, options in ((export, []), (other_code, dem)):
        out = tmp_path / f"runout_{len(found)}"
        assert ask("runout", source, *options, "-o", out) == 0
        found.append({row["quantity"]: row["value"] for row in table(out / "runout.csv")})
    shared = [name for name in found[1] if "deposit" not in name and "centre" not in name]
    assert len(shared) >= 6 and all(found[0][name] == found[1][name] for name in shared)
    for k, source in enumerate((export, other_code)):
        assert ask("intensity", source, "--guideline", "swiss-debris-flow", "-o", tmp_path / f"classes_{k}") == 0
    areas = [[row["area_m2"] for row in table(tmp_path / f"classes_{k}" / "intensity.csv")] for k in (0, 1)]
    assert areas[0] == areas[1] and sum(map(float, areas[0])) == 3 * SIDE**2


def test_pressure_of_another_codes_rasters_comes_from_density_and_speed(tmp_path, other_code, capsys):
    asked = ("intensity", other_code, "--guideline", "swiss-avalanche", "-o", tmp_path / "classes")
    assert ask(*asked) == 2
    assert "--density" in capsys.readouterr().err
    assert ask(*asked, "--density", 500) == 0  # 500 kg m-3 at 10 m/s on the flat: 50 kPa
    assert [float(row["area_m2"]) for row in table(tmp_path / "classes" / "intensity.csv")] == [2 * SIDE**2, 0, SIDE**2]
    with rasterio.open(other_code.parent / "com1DFA_pfv.tif") as source:
        kilopascals = np.where(source.read(1) > 0, 5.0, 0.0).astype(np.float32)
        with rasterio.open(other_code.parent / "com1DFA_ppr.tif", "w", **source.profile) as target:
            target.write(kilopascals, 1)
    capsys.readouterr()
    assert ask(*asked, "--density", 500, "--overwrite") == 0
    assert "not used" in capsys.readouterr().err
    assert [float(row["area_m2"]) for row in table(tmp_path / "classes" / "intensity.csv")] == [2 * SIDE**2, SIDE**2, 0]


@pytest.mark.thorough
def test_a_report_of_an_export_and_of_rasters(tmp_path, export, other_code):
    assert ask("report", export, "--no-player", "-o", tmp_path / "export.html") == 0
    page = Reader((tmp_path / "export.html").read_text(encoding="utf-8"))
    assert len(page.pictures) == 6 and "from an export of 3 steps" in page.text  # five maps, the profile
    assert "last frame at" in page.text and "rasters have no balances: balances are not known" in page.text
    assert ask("report", other_code, "--dem", export / "dtm.tif", "-o", tmp_path / "r.html") == 0
    page = Reader((tmp_path / "r.html").read_text(encoding="utf-8"))
    assert len(page.pictures) == 4 and "largest impact pressure" not in page.text
    assert "com1DFA: report" in page.text and "energy line tangent" in page.text
    assert ask("report", other_code, "--dem", export / "dtm.tif", "--density", DENSITY, "-o", tmp_path / "p.html") == 0
    page = Reader((tmp_path / "p.html").read_text(encoding="utf-8"))
    assert len(page.pictures) == 5
    lines = page.text.splitlines()
    assert lines[lines.index("largest impact pressure") + 1] == "100 kPa"


def test_what_rasters_cannot_answer_is_refused_in_one_line(tmp_path, export, other_code, capsys):
    line = ["--line", tmp_path / "none.gpkg"]
    dem = ["--dem", export / "dtm.tif"]
    for arguments, words in (
        (("runout", other_code), "there is no DTM beside"),
        (("runout", other_code, *dem, "--density", 3), "--density requires frames"),
        (("runout", other_code, other_code, *dem), "at a time, without frames"),
        (("report", export, "--density", 3), "--density requires frames"),
        (("profile", other_code, *dem, *line), "largest values without times"),
        (("timeseries", other_code, *dem, "--at", "1,2"), "largest values without times"),
        (("vertical", other_code, *dem, "--at", "1,2"), "are rasters"),
        (("intensity", f"{other_code}_pft.tif", "--guideline", "swiss-debris-flow"), "the beginning of their names"),
        (("intensity", other_code, "--guideline", "austrian-torrent-deposit"), "no h_deposit"),
    ):
        assert ask(*arguments) == 2, arguments
        message = capsys.readouterr().err
        assert words in message and len(message.splitlines()) == 1, message


def test_a_dtm_in_another_crs_or_elsewhere_is_refused(tmp_path, export, other_code, capsys):
    with rasterio.open(export / "dtm.tif") as source:
        values, profile = source.read(), source.profile
    for name, changes, words in (
        ("crs.tif", {"crs": "EPSG:32633"}, "reproject it"),
        ("far.tif", {"transform": profile["transform"].translation(5e4, 0) * profile["transform"]}, "elevations under"),
    ):
        with rasterio.open(tmp_path / name, "w", **profile | changes) as target:
            target.write(values)
        for result in (export, other_code):
            assert ask("runout", result, "--dem", tmp_path / name, "-o", tmp_path / "out") == 2
            assert words in capsys.readouterr().err
