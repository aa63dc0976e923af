"""Structure of the project file: requirements of QGIS, and settings that it would lose silently."""

import re
import shutil
import zipfile
from dataclasses import replace
from datetime import date, datetime, timedelta
from itertools import pairwise

import numpy as np
import pytest
import qgis_run
import rasterio
from pyproj import CRS

from mpmgis.maps.averaging.exported_folder import ExportedRun
from mpmgis.maps.qgis.flow_mesh import group_names
from mpmgis.maps.qgis.print_layout import SCALES, print_layout
from mpmgis.maps.qgis.project import write_project
from mpmgis.maps.qgis.project_layers import Group
from mpmgis.system.errors import InputError

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
    tree = [node.get("id") for node in root.find("layer-tree-group").iter("layer-tree-layer")]
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


def test_depth_arrows_and_outline_move_in_every_version_and_are_shown(root):
    tree = {e.get("id"): e.get("checked") == "Qt::Checked" for e in root.iter("layer-tree-layer")}
    shown = [layer for layer in layers(root) if tree[layer.findtext("id")] and layer.find("temporal") is not None]
    assert [layer.get("type") for layer in shown] == ["mesh", "vector", "mesh"]
    newer = next(e for e in root.iter("layer-tree-group") if e.get("name") == "rasters over time (QGIS 3.38 or later)")
    stacks = {e.get("id") for e in newer.iter("layer-tree-layer")}
    assert stacks == {layer.findtext("id") for layer in layers(root) if layer.find("temporal/ranges") is not None}
    assert not any(tree[name] for name in stacks)


def test_the_mesh_has_the_classes_of_the_rasters(root):
    items = {}
    for layer in layers(root):
        if layer.findtext("layername").startswith("h [m]"):
            classes = [tuple(sorted(item.attrib.items())) for item in layer.iter("item")]
            items.setdefault(layer.get("type"), set()).add(tuple(classes))
    assert items["mesh"] == items["raster"]
    assert len(items["mesh"]) == 1


def test_legends_show_neither_the_first_step_nor_values_that_are_not_drawn(root):
    found = {layer.findtext("id"): layer for layer in layers(root)}
    for row in root.iter("layer-tree-layer"):
        shader = found[row.get("id")].find(".//colorrampshader")
        if shader is None:
            continue
        shown = row.find("customproperties/Option/Option").get("value").split(",")
        drawn = [k for k, item in enumerate(shader.findall("item"), 1) if item.get("alpha") != "0"]
        assert shown == (["1"] if shader.get("colorRampType") == "INTERPOLATED" else [str(k) for k in drawn])


def test_before_3_38_no_layer_needs_time_by_band(tmp_path):
    bands = ("h", "t", "Un", "Ut", "t_vol")
    run = qgis_run.make_run(tmp_path, UTM, times=[0, 0.2, 0.4, 1.0], step_bands=bands)
    root = qgis_run.project_root(qgis_run.write_all(run, qgis_min="3.22"))
    assert not list(root.iter("range"))
    meshes = [layer.findtext("layername").split(" ")[0] for layer in layers(root) if layer.get("type") == "mesh"]
    assert meshes == ["velocity", "h", "t", "Un", "Ut"]
    steps = [layer for layer in layers(root) if layer.find("temporal/fixedRange") is not None]
    assert [layer.findtext("layername") for layer in steps] == [f"t_vol at t = {t} s" for t in (0.0, 0.2, 0.4, 1.0)]
    assert {layer.find("pipe/rasterrenderer").get("band") for layer in steps} == {"5"}
    spans = [[moment(layer.findtext(f"temporal/fixedRange/{end}")) for end in ("start", "end")] for layer in steps]
    assert all(start <= end for start, end in spans)
    assert [later[0] - earlier[1] for earlier, later in pairwise(spans)] == [timedelta(seconds=2)] * 3


def test_title_shows_simulated_time(root):
    label = root.findtext("properties/TitleLabel/Label")
    assert "/ 1000.0 / 60, 1)" in label
    assert "THEN 'maxima over all steps'" in label
    assert "1 s = 1 min" in root.find("layer-tree-group/layer-tree-group").get("name")


def test_layer_names_begin_with_what_differs(root):
    names = {layer.findtext("layername") for layer in layers(root)}
    assert {
        "h [m]: flow depth (normal)",
        "Ut [m/s]: speed along the slope",
        "Un [m/s]: velocity normal to the slope",
        "h max [m]: largest flow depth (normal)",
        "p max [kPa]: largest impact pressure",
        "t arrival [s]: time of arrival",
    } <= names


def test_terrain_and_flow_surface_are_elevations(run, root):
    high = {layer.findtext("datasource"): layer.find("elevation") for layer in layers(root)}
    high = {source: element for source, element in high.items() if element is not None}
    assert sorted(high) == ["./dtm.tif", "./slide_surface.tif"]
    assert {element.get("enabled") for element in high.values()} == {"1"}
    terrain = root.find("ElevationProperties/terrainProvider/TerrainProvider")
    assert terrain.get("layer") in {layer.findtext("id") for layer in layers(root)}


def test_the_flow_surface_is_the_depth_above_the_bed_along_its_normal(run):
    with rasterio.open(run.folder / run.surface_file) as file:
        assert file.descriptions == ("surface [m]",)
        surface = np.where(file.read(1) == file.nodata, np.nan, file.read(1))
    (depth,), bed = run.read(run.maxima_file, ("h_max",)), run.read_terrain().astype(float)
    down, right = np.gradient(bed, 5.0)
    assert np.array_equal(np.isfinite(surface), np.isfinite(depth))
    expected = bed + depth * np.sqrt(1.0 + down**2 + right**2)
    wet = np.isfinite(depth)
    assert np.allclose(surface[wet], expected[wet], atol=1e-3)


def test_print_layout_keeps_the_layers_of_its_map(root):
    layout = root.find("Layouts/Layout")
    items = {item.get("id"): item for item in layout.iter("LayoutItem")}
    assert set(items) == {"page", "title", "map", "legend", "north", "scale", "scale bar", "notes", "author"}
    ids = {layer.findtext("id") for layer in layers(root)}
    kept = [layer.text for layer in items["map"].findall("LayerSet/Layer")]
    assert len(kept) >= 4 and set(kept) <= ids
    moving = {layer.findtext("id") for layer in layers(root) if layer.find("temporal") is not None}
    assert not moving & set(kept)
    assert {items["legend"].get("map_uuid"), items["scale bar"].get("mapUuid")} == {items["map"].get("uuid")}


def test_the_page_names_parameters_date_and_author(tmp_path):
    run = qgis_run.make_run(tmp_path, UTM, times=[0, 1])
    facts = {"release": "areas.gpkg", "thickness": "2 m", "volume": "1200 m3", "friction": "Voellmy mu 0.2"}
    write_project(replace(run, facts=facts, author="A. Muster"))
    items = {item.get("id"): item for item in qgis_run.project_root(run).iter("LayoutItem")}
    notes, signed = items["notes"].get("labelText"), items["author"].get("labelText")
    assert "Friction: Voellmy mu 0.2\n" in notes and "contours every" in notes
    assert "Release: areas.gpkg; thickness 2 m; volume 1200 m3" in notes
    assert "Author: A. Muster" in signed and "(EPSG:32632)" in signed and f"{date.today()}" in signed
    assert "map_scale" in items["scale"].get("labelText")
    extent, (width, height, _) = items["map"].find("Extent"), items["map"].get("size").split(",")
    sides = [float(extent.get(f"{end}max")) - float(extent.get(f"{end}min")) for end in "xy"]
    scales = [side / float(paper) * 1000 for side, paper in zip(sides, (width, height), strict=True)]
    assert np.allclose(scales, scales[0]) and round(scales[0], 6) in SCALES
    assert float(items["map"].find("ComposerMapGrid").get("intervalX")) >= 40 * scales[0] / 1000


def test_long_facts_have_smaller_letters_and_are_never_cut_silently(tmp_path):
    run = qgis_run.make_run(tmp_path, UTM, times=[0, 1])
    found = {}
    for count in (1, 10, 40):
        facts = [(f"fact {k}", "words " * 20) for k in range(count)]
        layout = print_layout(run, run.grid.bounds, Group("map", []), "title", facts)
        (notes,) = [item for item in layout.iter("LayoutItem") if item.get("id") == "notes"]
        found[count] = notes.find("LabelFont").get("description").split(",")[1], notes.get("labelText").split("\n")
    assert [size for size, _ in found.values()] == ["7.5", "6.0", "5.0"]
    assert len(found[40][1]) == 13 and found[40][1][-1].startswith("... (28 lines more")


def test_columns_have_one_depth(tmp_path):
    run = qgis_run.make_run(tmp_path, UTM, times=[0, 1])
    with rasterio.open(run.folder / run.maxima_file, "r+") as file:
        file.write(file.read(1), 2)
    qgis_run.write_all(run)
    names = [layer.findtext("layername") for layer in layers(qgis_run.project_root(run))]
    assert not [name for name in names if name.startswith(("t [m]", "t max"))]
    assert [name for name in names if name.startswith("h max")] and "t_vol [m]: thickness by volume (normal)" in names


def test_title_and_scale_bar_have_room_beside_the_flow(run, root):
    view = root.find("ProjectViewSettings/DefaultViewExtent")
    south, north = float(view.get("ymin")), float(view.get("ymax"))
    row, column = np.nonzero(run.read(run.maxima_file, ("h_max",))[0] >= run.min_depth)
    _, y = run.flow_grid.xy(row, column)
    assert min(y.min() - south, north - y.max()) > 0.07 * (north - south)
    assert root.findtext("properties/ScaleBar/Placement") == "0"  # the blob goes to the lower right


def test_scale_bar_is_at_the_other_side_of_the_flow(tmp_path):
    run = qgis_run.make_run(tmp_path, UTM, times=[0, 1])
    with rasterio.open(run.folder / run.maxima_file, "r+") as file:
        for band in range(1, file.count + 1):
            file.write(file.read(band)[:, ::-1], band)
    write_project(run)
    assert qgis_run.project_root(run).findtext("properties/ScaleBar/Placement") == "3"


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
    for file in (run.step_files[0], run.maxima_file, run.last_file):
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
