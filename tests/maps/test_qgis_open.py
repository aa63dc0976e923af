"""The exported folder in QGIS: it opens with styles and animation."""

from pathlib import Path

import pytest
import qgis_run
import shapely
from pyproj import CRS
from qgis_python import report_of

from mpmgis.maps.qgis.print_layout import SCALES

pytestmark = [pytest.mark.qgis, pytest.mark.thorough]
HERE = Path(__file__).parent
MOVING = {"h [m]: flow depth (normal)", "outline of the flow", "velocity arrows"}


def look(run, *files):
    return report_of(HERE / "qgis_check.py", *(run.folder / file for file in (run.project_file, *files)))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    run = qgis_run.make_run(tmp_path_factory.mktemp("open") / ".", CRS.from_epsg(32632))
    return qgis_run.write_all(run, [shapely.Point(686160, 5211880).buffer(40)])


@pytest.fixture(scope="module")
def report(run):
    rasters = (run.step_files[5], run.maxima_file, run.last_file, run.terrain_file)
    return look(run, *rasters, *map(run.stack_file, run.step_bands), run.outlines_file, run.mesh_file)


def require_sound_project(project):
    assert project["read"]
    assert project["crs_valid"]
    assert not project["lost"]
    assert all(valid and placed for _, valid, placed in project["layers"])
    assert project["mode"] == 1
    assert min(project["painted"]) == 300 * 220  # hillshade everywhere
    assert project["differ"] == 3


def test_project_opens_completely(report):
    require_sound_project(report["project"])
    assert report["project"]["crs"] == "EPSG:32632"
    assert report["project"]["visible"][-1] == "hillshade"


def test_a_frame_for_each_step(run, report):
    assert report["project"]["frames"] == len(run.times)


def test_flow_outline_and_arrows_move_together(report):
    moving = report["project"]["moving"]
    assert set(moving) == MOVING
    for name, (different, painted) in moving.items():
        assert different == 3, name
        assert min(painted) > 20, name
        assert max(painted) < 0.25 * 300 * 220, name


def test_map_title_shows_the_simulated_time(report):
    assert report["project"]["map_title"] == ["slide   t = 0.0 s", "slide   t = 1.2 s", "slide   t = 2.2 s"]
    assert report["project"]["still_title"] == "slide   maxima over all steps"


def test_the_print_layout_is_ready_to_export(run, report):
    page = report["project"]["layouts"]["slide: A4"]
    assert page["pdf"] and page["colours"] > 100
    assert page["page"] == [297, 210]
    names = ["release area", "envelope of all steps", "h max [m]: largest flow depth (normal)"]
    assert page["layers"] == [*names, "contours every 10 m", "hillshade"]
    assert page["legend"] == names
    assert page["linked"]
    assert page["over_map"] == page["outside"] == 0
    assert "slide: largest flow depth, t = 0 to 2.2 s" in page["texts"]
    (signed,) = [text for text in page["texts"] if text.startswith("CRS: ")]
    assert "UTM zone 32N (EPSG:32632)" in signed and "Date of the map: 2" in signed and "Author: ...." in signed
    assert page["scale"] in SCALES and page["grid"] > 0
    assert any("contours every 10 m" in text for text in page["texts"])
    width = page["extent"][2] - page["extent"][0]
    assert 0.09 * width < page["bar"] < 0.26 * width


def test_legends_have_no_time(report):
    entries = report["project"]["legends"]
    assert entries["h [m]: flow depth (normal)"][0] == "0.05 - 0.5 m"
    assert not [text for texts in entries.values() for text in texts if "t = " in text or "not drawn" in text]


def test_files_dropped_without_the_project_are_styled_and_placed(run, report):
    west, south, east, north = run.grid.bounds
    for file, layers in report["files"].items():
        for layer in layers:
            assert layer["valid"] and layer["crs"] == "EPSG:32632", file
            assert layer["painted"] > 20 and layer["colours"] > 1, (file, layer["name"])
            assert layer["styled"] is not False, (file, layer["name"])
            assert west - 1 <= layer["extent"][0] < layer["extent"][2] <= east + 1
            assert south - 1 <= layer["extent"][1] < layer["extent"][3] <= north + 1


def test_rasters_are_drawn_in_class_colours(report):
    rasters = {file: layers[0] for file, layers in report["files"].items() if "renderer" in layers[0]}
    assert len(rasters) == 8
    for file, layer in rasters.items():
        assert layer["renderer"] == ("hillshade" if file == "dtm.tif" else "singlebandpseudocolor")


def test_vector_layers_are_valid(report):
    layers = report["files"]["slide.gpkg"]
    assert [layer["name"] for layer in layers] == ["outline", "envelope", "release", "particles"]
    assert all(layer["features"] == layer["sound"] > 0 for layer in layers)


def test_mesh_has_its_groups(run, report):
    (mesh,) = report["files"]["slide.nc"]
    assert ["velocity along the slope (m/s)", True, len(run.times)] in mesh["groups"]
    root = qgis_run.project_root(run)
    layer = next(e for e in root.iter("maplayer") if e.get("type") == "mesh")
    named = [e.get("name") for e in layer.findall("name-to-global-index")]
    assert [name for name, *_ in mesh["groups"]] == named


def test_old_qgis_animates_a_variable_that_the_mesh_does_not_have(tmp_path):
    bands = ("h", "t", "Un", "Ut", "t_vol")
    run = qgis_run.make_run(tmp_path, CRS.from_epsg(32632), times=[0, 0.2, 0.4, 0.6], step_bands=bands)
    qgis_run.write_all(run, qgis_min="3.22")
    project = look(run)["project"]
    require_sound_project(project)
    assert project["frames"] == 4
    assert set(project["moving"]) == MOVING


def test_uneven_steps_are_shown_until_the_next(tmp_path):
    run = qgis_run.make_run(tmp_path, CRS.from_epsg(32632), times=[0, 0.25, 0.75, 3.0])
    project = look(qgis_run.write_all(run))["project"]
    assert project["frames"] == 13
    assert set(project["moving"]) == MOVING
    assert project["map_title"] == ["slide   t = 0.00 s", "slide   t = 0.75 s", "slide   t = 3.00 s"]
    assert all(min(painted) > 20 for _, painted in project["moving"].values())


def test_local_frame_opens(tmp_path):
    run = qgis_run.make_run(tmp_path, None, times=[0, 1, 2], corner=(0.0, 600.0))
    require_sound_project(look(qgis_run.write_all(run))["project"])
