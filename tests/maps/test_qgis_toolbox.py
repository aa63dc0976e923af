"""The toolbox in QGIS: seeding, simulation, export, opening of results, and one-line errors."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import geopandas
import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine
from qgis_python import clean_environment, python_with_qgis, qgis_process, report_of

from mpmgis.commands.plugin_forms import plugin_forms
from mpmgis.commands.shell.main import main

pytestmark = [pytest.mark.qgis, pytest.mark.thorough]
HERE = Path(__file__).parent
ROOT = HERE.parents[1]
WEST, NORTH, PIXEL, SHAPE = 500_000.0, 5_200_400.0, 10.0, (40, 60)
# says how far it is, and ends when it is told to, which it writes down
SLEEPER = """#!/bin/sh
MARK='{mark}'
trap 'echo stopped > "$MARK"; exit 143' TERM
echo 't = 1.0 of 4 s, fastest 2 m/s' >&2
while :; do sleep 0.05; done
"""


def make_site(folder):
    """A slope of 31 degrees and a release on it, in files."""
    rows, columns = np.indices(SHAPE)
    with rasterio.open(
        folder / "dtm.tif",
        "w",
        driver="GTiff",
        height=SHAPE[0],
        width=SHAPE[1],
        count=1,
        dtype="float32",
        crs="EPSG:32632",
        transform=Affine(PIXEL, 0, WEST, 0, -PIXEL, NORTH),
    ) as dtm:
        dtm.write((1000.0 - 6.0 * columns + 0.0 * rows).astype("float32"), 1)
    area = shapely.box(WEST + 60, NORTH - 260, WEST + 140, NORTH - 140)
    release = geopandas.GeoDataFrame({"thickness": [2.0]}, geometry=[area], crs="EPSG:32632")
    release.to_file(folder / "release.gpkg")


def script(path, text):
    path.write_text(text)
    path.chmod(0o755)
    return path


def command_of_tests(folder):
    """The command `mpmgis` of the Python that runs the tests, as one file."""
    return script(folder / "mpmgis", f'#!/bin/sh\nexport PYTHONPATH="{ROOT}"\nexec "{sys.executable}" -m mpmgis "$@"\n')


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("toolbox and space")
    make_site(folder)
    return folder


@pytest.fixture(scope="module")
def report(site):
    sleeper = script(site / "sleeper", SLEEPER.format(mark=site / "stopped"))
    plugins = site / "plugins"
    assert main(["qgis-plugin", "-o", str(site / "mpmgis_qgis.zip"), "-q"]) == 0
    zipfile.ZipFile(site / "mpmgis_qgis.zip").extractall(plugins)
    return report_of(HERE / "qgis_toolbox_check.py", plugins, site, command_of_tests(site), sleeper, timeout=1200)


def test_the_toolbox_has_the_verbs(report):
    names = {form["name"] or form["verb"].replace("-", "") for form in plugin_forms()["forms"]}
    assert set(report["algorithms"]) == names | {"simulate"}
    assert report["unloaded_provider"]


def test_every_parameter_has_a_help_text(report):
    assert all(all(texts) for texts in report["help"].values())
    assert any("[--dem]" in text for text in report["help"]["seed"])
    assert "Command: mpmgis export-raster" in report["texts"]["exportraster"]
    assert "mpmgis run and mpmgis export-raster" in report["texts"]["simulate"]
    assert len(report["icons"]) == 4 and all(report["icons"].values())
    assert len(set(report["icons"].values())) == 4  # an icon for each group


def test_scenarios_are_a_table_and_columns_are_lists(report):
    assert report["scenarios"] == "30=a\n100=b\n300=c"
    assert report["columns"] == [["field", "RELEASE"]] * 2


def test_seeded_particles_are_loaded(site, report):
    assert report["seed"]["error"] == ""
    assert report["seed"]["to_load"] == ["seed"]
    assert any("columns on 9600 m2: " in line for line in report["seed"]["said"])
    particles = geopandas.read_file(report["seed"]["outputs"]["OUTPUT"])
    assert abs(len(particles) - 200) <= 2
    assert report["temporary"]["to_load"] == ["Particles"]
    assert report["temporary"]["error"] == "" and Path(report["temporary"]["outputs"]["OUTPUT"]).suffix == ".gpkg"


def test_an_error_is_the_message_of_the_command(report):
    assert report["existing"]["error"].startswith("mpmgis seed: ")
    assert "exists already" in report["existing"]["error"]
    assert "no_such_column" in report["local"]["error"]
    assert "\n" not in report["existing"]["error"] + report["local"]["error"]
    assert not any(report[name]["error"] in report[name]["said"] for name in ("existing", "local"))  # QGIS prints it


def test_the_form_makes_an_animated_map(report):
    found = report["simulate"]
    assert found["error"] == "" and not found["errors"]
    assert found["progress"] == 100
    assert any(line.startswith("ended: ") for line in found["said"])
    (group,) = [part for part in report["tree"] if isinstance(part, dict)]
    ((name, parts),) = group.items()
    assert name == "results"
    assert [next(iter(part)) for part in parts] != []
    assert all(report["valid"]) and len(report["valid"]) > 10
    assert set(report["renderers"]) == {"hillshade", "contour", "singlebandpseudocolor"}
    assert report["timed"] >= 4 and report["has_times"]


def test_an_unsaved_release_is_stored_with_the_scene(site, report):
    assert (site / "slide" / "release.gpkg").exists()
    assert 'source = "release.gpkg' in (site / "slide" / "scene.toml").read_text()
    assert 'thickness = "thickness"' in (site / "slide" / "scene.toml").read_text()


def test_an_earlier_simulation_is_not_overwritten_by_default(report):
    assert "exists already" in report["again"]["error"]


def test_export_is_loaded_on_request(site, report):
    assert report["export"]["outputs"]["OUTPUT"] == str(site / "maps")
    assert sorted(path.name for path in (site / "maps" / "rasters").glob("*_00*.tif")) == [
        "results_0000.tif",
        "results_0001.tif",
    ]
    with rasterio.open(site / "maps" / "rasters" / "results_0000.tif") as raster:
        assert raster.res == (5.0, 5.0)
    assert report["count_twice"] > 1.5
    assert report["unloaded"]["error"] == "" and (site / "more" / "results.qgz").exists()
    assert report["unloaded"]["outputs"]["ANIMATION"] == str(site / "film.gif") and (site / "film.gif").exists()


def test_command_output_is_in_the_log(report):
    assert any(line.startswith("curvature ") for line in report["effects"]["printed"])
    page = Path(report["effects"]["outputs"]["TABLE"]).read_text(encoding="utf-8")
    assert "<th>decided by</th>" in page and "<td>curvature</td>" in page
    assert any(line.startswith("footprint: ") for line in report["compare"]["printed"])
    assert "exactly one of" in report["unclear"]["error"]


def test_point_queries_use_layers(site, report):
    assert report["intensity"]["error"] == "" and len(report["intensity"]["to_load"]) == 1
    assert report["report"]["error"] == "" and "<html" in (site / "slide.html").read_text()[:500].lower()
    assert report["timeseries"]["error"] == ""
    assert any(line.startswith("below") for line in report["timeseries"]["printed"])


def test_a_study_is_reported_and_its_plot_is_shown(site, report):
    assert report["study"]["error"] == ""
    assert report["study"]["progress"] == 100
    assert any("cfl" in line for line in report["study"]["printed"])
    assert report["study"]["outputs"]["PLOT"] == str(site / "slide" / "study" / "study.png")


def test_an_ensemble_becomes_styled_maps(site, report):
    found = report["ensemble"]
    assert found["error"] == "" and not found["errors"]
    assert found["outputs"]["PROJECT"] == str(site / "slide" / "ensemble" / "maps" / "ensemble.qgz")
    assert any("--vary=friction.mu=0.1,0.2 --vary=friction.xi=500,1000" in line for line in found["said"])
    assert any("4 finished" in line for line in found["said"])
    assert all(valid for _, valid, _ in report["maps"])
    shown = {name for name, _, renderer in report["maps"] if renderer == "singlebandpseudocolor"}
    assert all(any(band in name for name in shown) for band in ("P(h >= 0.5 m)", "P(Ut >= 1 m/s)")), shown
    assert "has no parameter 'moo'" in report["no_such_key"]["error"] and "\n" not in report["no_such_key"]["error"]


def test_columns_have_no_profile_over_the_height(report):
    assert "depth-averaged frames have no vertical profile" in report["flat"]["error"]
    assert any("place.geojson" in line for line in report["flat"]["said"])
    assert "exactly one of 'Points' / 'or: one place on the map'" in report["both"]["error"]


def test_a_comparison_is_loaded_with_its_style(site, report):
    assert report["classes"]["error"] == "" and report["classes"]["to_load"] == ["classes"]
    assert report["classes"]["outputs"]["PLOT"] == str(site / "compared" / "map.png")


def test_rejected_input_leaves_the_folder_unchanged(report):
    assert report["refused"]["error"].startswith("mpmgis run: ") and "\n" not in report["refused"]["error"]
    assert not report["refused_left"]
    assert report["both_thicknesses"]["error"] == "Release thickness: give metres or a column, not both"
    assert "no_such_column" in report["replaced"]["error"] and report["as_before"]
    assert "Release areas: the layer unsaved has no CRS; set it in its properties" in report["placeless"]["errors"]


def test_it_runs_in_a_background_thread(report):
    ((succeeded, answer),) = report["background"]
    assert succeeded and "EPSG:32632" in answer


def test_cancelling_stops_the_command(site, report):
    assert report["cancelled"]["error"].endswith("mpmgis effects: cancelled")
    assert report["cancelled"]["progress"] == 25
    assert report["cancelled"]["texts"][-1] == "cancelling: mpmgis effects ends after its current step"
    assert (site / "stopped").read_text() == "stopped\n"


def test_a_missing_command_is_reported_with_the_fix(site, report):
    assert f"is not at {site / 'gone'}" in report["missing"]["error"]
    assert report["missing_at_once"] == [False, report["missing"]["error"]]
    assert "Settings > Options > Processing > Providers > mpmgis" in report["missing"]["error"]
    assert "never in QGIS' Python" in report["not_on_path"]["error"]


def test_qgis_process_runs_the_toolbox(site, tmp_path):
    program, reason = qgis_process()
    if program is None:
        pytest.skip(reason)
    environment = clean_environment(python_with_qgis())
    assert main(["qgis-plugin", "-o", str(tmp_path / "mpmgis_qgis.zip"), "-q"]) == 0
    with zipfile.ZipFile(tmp_path / "mpmgis_qgis.zip") as archive:  # what Install from ZIP does
        archive.extractall(tmp_path / "plugins")
    told = {
        "QGIS_PLUGINPATH": str(tmp_path / "plugins"),
        "QT_QPA_PLATFORM": "offscreen",
        "QGIS_CUSTOM_CONFIG_PATH": str(tmp_path),
    }
    path = os.pathsep.join([str(command_of_tests(tmp_path).parent), environment["PATH"]])
    environment |= told | {"PATH": path}

    def process(*words):
        return subprocess.run([program, *words], env=environment, capture_output=True, text=True, check=False)

    assert process("plugins", "enable", "mpmgis_qgis").returncode == 0
    given = (f"DEM={site / 'dtm.tif'}", f"RELEASE={site / 'release.gpkg'}", "COUNT=100")
    done = process("run", "mpmgis:seed", "--", *given, f"OUTPUT={tmp_path / 'a.h5'}")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.h5").exists()
    assert "columns on 9600 m2" in done.stdout
    failed = process("run", "mpmgis:seed", "--", *given, f"OUTPUT={tmp_path / 'a.h5'}")
    assert failed.returncode == 1
    assert "exists already" in failed.stdout + failed.stderr
