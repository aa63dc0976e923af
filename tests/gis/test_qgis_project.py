"""Structure of the project file: requirements of QGIS, and settings that it would lose silently."""

import re
import shutil
import zipfile
from datetime import datetime, timedelta
from itertools import pairwise

import numpy as np
import pytest
import qgis_run
import rasterio
from pyproj import CRS

from mpmgis.errors import InputError
from mpmgis.gis.mesh import group_names
from mpmgis.gis.project import write_project
from mpmgis.io.exported import ExportedRun

UTM = CRS.from_epsg(32632)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return qgis_run.write_all(qgis_run.make_run(tmp_path_factory.mktemp("export"), UTM))


@pytest.fixture(scope="module")
def root(run):
    return qgis_run.project_root(run)


def layers(root):
    return root.findall("projectlayers/maplayer")


def moment(text):
    return datetime.strptime(text, "%Y-%m-%dT%H:%M:%SZ")


def test_every_layer_has_an_id_that_qgis_accepts(root):
    ids = [layer.findtext("id") for layer in layers(root)]
    assert len(ids) == len(set(ids)) > 10
    assert all(len(name) > 10 and re.fullmatch(r"\w+", name, re.ASCII) for name in ids)


def test_tree_and_layers_are_the_same(root):
    tree = [node.get("id") for node in root.iter("layer-tree-layer")]
    assert tree == [layer.findtext("id") for layer in layers(root)]


def test_one_letter_run_still_has_long_ids(tmp_path):
    run = qgis_run.write_all(qgis_run.make_run(tmp_path, UTM, name="h", times=[0.0, 1.0]))
    assert min(len(layer.findtext("id")) for layer in layers(qgis_run.project_root(run))) > 10


def test_all_sources_are_relative_and_there(run, root):
    for layer in layers(root):
        source = layer.findtext("datasource")
        assert source.startswith("./")
        assert (run.folder / source.partition("|")[0]).is_file()
    assert str(run.folder) not in zipfile.ZipFile(run.folder / run.project_file).read(f"{run.name}.qgs").decode()
    assert root.findtext("properties/Paths/Absolute") == "false"


def test_every_layer_and_the_project_have_the_crs(root):
    systems = [layer.find("srs/spatialrefsys") for layer in layers(root)] + [root.find("projectCrs/spatialrefsys")]
    for system in systems:
        assert CRS.from_wkt(system.findtext("wkt")) == UTM
        assert system.findtext("authid") == "EPSG:32632"
    assert root.findtext("properties/SpatialRefSys/ProjectionsEnabled") == "1"


def test_times_are_whole_seconds(root):
    texts = [e.text for tag in ("start", "end", "StartDateTime", "EndDateTime") for e in root.iter(tag)]
    texts += [r.get(end) for r in root.iter("range") for end in ("begin", "end")]
    assert len(texts) > 8
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", text) for text in texts)


def test_band_ranges_tile_the_run(run, root):
    stacks = [layer for layer in layers(root) if layer.findtext("datasource").endswith(".vrt")]
    assert len(stacks) == len(run.step_bands)
    whole = root.find("ProjectTimeSettings/TemporalRange")
    for layer in stacks:
        ranges = layer.findall("temporal/ranges/range")
        assert [int(r.get("band")) for r in ranges] == list(range(1, len(run.times) + 1))
        assert [r.get("end") for r in ranges[:-1]] == [r.get("begin") for r in ranges[1:]]
        assert (ranges[0].get("begin"), ranges[-1].get("end")) == (whole.findtext("start"), whole.findtext("end"))
        shown = [(moment(r.get("begin")) - datetime(2000, 1, 1)).total_seconds() / 60 for r in ranges]
        assert np.allclose(shown, run.times)


def test_controller_plays_at_the_steps_length(root):
    assert root.findtext("properties/TemporalControllerWidget/NavigationMode") == "1"
    settings = root.find("ProjectTimeSettings")
    assert (settings.get("timeStep"), settings.get("timeStepUnit")) == ("12", "s")


def test_mesh_groups_are_in_the_order_of_qgis(run, root):
    mesh = next(layer for layer in layers(root) if layer.get("type") == "mesh")
    names = [(int(e.get("global-index")), e.get("name")) for e in mesh.findall("name-to-global-index")]
    assert names[0] == (0, "Bed Elevation")
    assert [name for _, name in names[1:]] == sorted(name for _, name in names[1:])
    assert [k for k, _ in names] == list(range(6))
    active = int(mesh.find("mesh-renderer-settings/active-dataset-group").get("vector"))
    assert names[active][1] == "velocity along the slope (m/s)"
    assert [name for _, name in names] == group_names(run.folder / run.mesh_file)


def test_colours_do_not_change_between_the_steps_of_a_variable(tmp_path):
    run = qgis_run.write_all(qgis_run.make_run(tmp_path, UTM, times=[0, 1, 2, 3]), qgis_min="3.22")
    drawn = {}
    for layer in layers(qgis_run.project_root(run)):
        if layer.find("temporal/fixedRange") is not None:
            name = layer.findtext("layername").split(" at ")[0]
            items = tuple(tuple(sorted(i.attrib.items())) for i in layer.iter("item"))
            drawn.setdefault(name, set()).add(items)
    assert sorted(drawn) == ["Un", "Ut", "h", "t"]
    assert all(len(styles) == 1 for styles in drawn.values())


def test_before_3_38_each_step_is_a_separate_layer(tmp_path):
    run = qgis_run.write_all(qgis_run.make_run(tmp_path, UTM, times=[0, 0.2, 0.4, 1.0]), qgis_min="3.22")
    root = qgis_run.project_root(run)
    assert not list(root.iter("range"))
    spans = {}
    for layer in layers(root):
        fixed = layer.find("temporal/fixedRange")
        if fixed is not None:
            band = layer.find("pipe/rasterrenderer").get("band")
            spans.setdefault(band, []).append((moment(fixed.findtext("start")), moment(fixed.findtext("end"))))
    assert sorted(spans) == ["1", "2", "3", "4"]
    for steps in spans.values():
        assert len(steps) == 4
        assert all(start <= end for start, end in steps)
        gaps = [later[0] - earlier[1] for earlier, later in pairwise(steps)]
        assert gaps == [timedelta(seconds=2)] * 3


def test_title_shows_simulated_time(root):
    label = root.findtext("properties/TitleLabel/Label")
    assert "/ 1000.0 / 60, 1)" in label
    assert "1 s = 1 min" in root.find("layer-tree-group/layer-tree-group").get("name")


def test_layer_names_are_words_with_units(root):
    names = {layer.findtext("layername") for layer in layers(root)}
    assert {
        "flow depth (normal) h (m)",
        "speed along the slope Ut (m/s)",
        "velocity normal to the slope Un (m/s; + away from it, - into it)",
        "largest impact pressure p_max (kPa)",
        "time of arrival t_arrival (s)",
    } <= names


def test_names_with_xml_signs(tmp_path):
    run = qgis_run.write_all(qgis_run.make_run(tmp_path, UTM, name="a & <b>", times=[0, 1]))
    assert qgis_run.project_root(run).findtext("title") == "a & <b>"


def test_project_without_mesh_and_outlines(tmp_path):
    run = qgis_run.make_run(tmp_path, UTM, times=[0, 1])
    write_project(run)
    kinds = {layer.get("type") for layer in layers(qgis_run.project_root(run))}
    assert kinds == {"raster"}


def test_a_run_that_never_flowed_still_opens(tmp_path):
    run = qgis_run.make_run(tmp_path, UTM, times=[0.0])
    for file in (run.step_files[0], run.maxima_file, run.deposit_file):
        with rasterio.open(run.folder / file, "r+") as raster:
            for band in range(1, raster.count + 1):
                raster.write(np.full(raster.shape, -9999, dtype="float32"), band)
    qgis_run.write_all(run)
    root = qgis_run.project_root(run)
    view = root.find("ProjectViewSettings/DefaultViewExtent")
    assert tuple(float(view.get(side)) for side in ("xmin", "ymin", "xmax", "ymax")) == run.grid.bounds
    assert not (run.folder / run.mesh_file).exists()
    assert {layer.get("type") for layer in layers(root)} <= {"raster", "vector"}


def test_local_frame_is_an_engineering_crs(tmp_path):
    run = qgis_run.write_all(qgis_run.make_run(tmp_path, None, times=[0, 1]))
    system = qgis_run.project_root(run).find("projectCrs/spatialrefsys")
    assert CRS.from_wkt(system.findtext("wkt")).is_engineering
    assert system.find("authid") is None


def test_the_folder_can_be_moved(run, root, tmp_path):
    moved = tmp_path / "elsewhere"
    shutil.copytree(run.folder, moved)
    there = ExportedRun(**{**{f: getattr(run, f) for f in run.__dataclass_fields__}, "folder": moved})
    for layer in layers(qgis_run.project_root(there)):
        assert (moved / layer.findtext("datasource").partition("|")[0]).is_file()


@pytest.mark.parametrize("version", ["", "new", "3", "2.18", "3.20", "3.x"])
def test_invalid_versions_are_rejected(tmp_path, version):
    with pytest.raises(InputError, match=r"from 3\.22 on"):
        write_project(qgis_run.make_run(tmp_path, UTM, times=[0, 1]), version)
    assert not list(tmp_path.glob("*.qgz"))
