"""`mpmgis exposure`: objects that a block of known depth and speed reaches, by result and by release area."""

import json

import geopandas
import numpy as np
import pytest
import shapely
from block_frames import MIDDLE, SIDE, table, write_block_run
from slope_site import SCENE, write_shapes

import mpmgis
from mpmgis.commands.shell.main import main

PLACES = (150.0, 450.0, 600.0)  # middles of the block in each frame
ROAD = [(100, 50), (100, 350)]  # across the first block, which is 100 m wide
OBJECTS = {
    "road": shapely.LineString(ROAD),
    "track": shapely.LineString([(0, MIDDLE), (350, MIDDLE)]),  # 100 m of it in the first block
    "mast": shapely.Point(452, MIDDLE),
    "far mast": shapely.Point(5000, MIDDLE),
    "dry mast": shapely.Point(300, MIDDLE),
    "house": shapely.box(590, MIDDLE - 10, 670, MIDDLE + 10),  # 60 of its 80 m in the third block
    "touching": shapely.LineString([(300, 400), (310, 420)]),  # touches the edge of the terrain from outside
    "bridge": shapely.LineString([(600, 300), (600, 500)]),  # half of it beyond the terrain, none in the block
}


@pytest.fixture
def run(tmp_path):
    folder = write_block_run(tmp_path, PLACES, speeds=(0.0, 10.0, 0.0))
    write_shapes(tmp_path / "objects.geojson", list(OBJECTS.values()), name=list(OBJECTS), owner=["a"] * len(OBJECTS))
    return folder


def rows(folder, file="exposure.csv"):
    return {row["name"]: row for row in table(folder / file)}


def test_lengths_areas_and_values_are_those_of_the_block(tmp_path, run, capsys):
    assert main(["exposure", str(run), "--objects", str(tmp_path / "objects.geojson")]) == 0
    shown = capsys.readouterr()
    found = rows(tmp_path / "run_exposure")
    assert {name: row["state"] for name, row in found.items()} == {
        **dict.fromkeys(("road", "track", "mast", "house"), "reached"),
        **dict.fromkeys(("dry mast", "bridge"), "not reached"),
        **dict.fromkeys(("far mast", "touching"), "outside the terrain"),
    }
    assert float(found["road"]["length_m"]) == SIDE and float(found["track"]["length_m"]) == SIDE
    assert float(found["house"]["area_m2"]) == pytest.approx(60 * 20) and found["house"]["length_m"] == ""
    assert float(found["house"]["share"]) == pytest.approx(0.75)
    assert float(found["mast"]["h_max_m"]) == pytest.approx(2.0, rel=1e-6)
    assert float(found["mast"]["Ut_max_m_s"]) == pytest.approx(10.0, rel=1e-6)
    assert float(found["mast"]["p_max_Pa"]) == pytest.approx(1e5, rel=1e-6)
    assert float(found["bridge"]["on_terrain"]) == 0.5 and found["far mast"]["on_terrain"] == "0"
    assert "4 reached, 2 not reached, 2 outside the terrain; 200.0 m of lines, 1200.0 m2 of polygons" in shown.out
    assert "2 of 8 objects are outside the terrain, and of 1 a part" in shown.err


def test_the_layer_has_the_objects_with_a_style(tmp_path, run):
    assert main(["exposure", str(run), "--objects", str(tmp_path / "objects.geojson"), "-o", str(tmp_path / "o")]) == 0
    path = tmp_path / "o" / "exposure.gpkg"
    layers = {name: geopandas.read_file(path, layer=name) for name in ("points", "lines", "polygons")}
    assert layers["lines"]["name"].tolist() == ["road", "track", "touching", "bridge"]
    assert layers["lines"]["class"].tolist() == [1, 1, 3, 2] and layers["points"]["class"].tolist() == [1, 3, 2]
    assert set(layers["polygons"]["owner"]) == {"a"} and layers["polygons"]["scenarios"].tolist() == ["run"]
    styles = geopandas.read_file(path, layer="layer_styles")
    assert sorted(styles["f_table_name"]) == ["lines", "points", "polygons"]
    assert "SimpleLine" in styles.set_index("f_table_name").loc["lines", "styleQML"]


def test_several_results_are_scenarios_and_an_export_agrees_with_its_frames(tmp_path, run, capsys):
    assert main(["export-raster", str(run), "--no-qgis"]) == 0
    found = mpmgis.exposure([run, tmp_path / "run_gis"], tmp_path / "objects.geojson", tmp_path / "o.csv")
    assert found.scenarios == ("run", "run_gis")
    first, second = found.found[: len(OBJECTS)], found.found[len(OBJECTS) :]
    for one, other in zip(first, second, strict=True):
        assert one.state == other.state and one.reach.size == pytest.approx(other.reach.size)
        np.testing.assert_allclose(list(one.reach.values.values()), list(other.reach.values.values()), rtol=1e-6)
    assert found.attributes()[0]["scenarios"] == "run, run_gis"
    capsys.readouterr()
    assert main(["exposure", str(run), "--objects", str(tmp_path / "objects.geojson"), "-o", "-", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["rows"]) == len(OBJECTS)


@pytest.fixture(scope="module")
def region(tmp_path_factory):
    """Two release areas apart on one slope; a road below both of them and objects below one."""
    from slope_site import distances, write_raster

    folder = tmp_path_factory.mktemp("exposed")
    x, _ = distances()
    write_raster(folder / "dtm.tif", np.maximum(0.5 * (400.0 - x), 0.0) + 100.0)
    columns = {"T": ["30", "100"]}
    write_shapes(folder / "areas.gpkg", [shapely.box(60, 40, 160, 100), shapely.box(60, 300, 160, 360)], **columns)
    objects = {
        "road": shapely.LineString([(300, 0), (300, 400)]),
        "south": shapely.Point(280, 70),
        "north": shapely.box(270, 320, 290, 340),
    }
    write_shapes(folder / "objects.gpkg", [objects["road"]], name=["road"])
    write_shapes(folder / "all.geojson", list(objects.values()), name=list(objects))
    scene = SCENE.replace('source = "release.geojson"\n', "").replace("end_time = 30", "end_time = 15")
    (folder / "scene.toml").write_text(scene)
    mpmgis.region(folder / "scene.toml", folder / "areas.gpkg", folder / "region", scenario="T", workers=1)
    return folder


def test_release_areas_that_reach_an_object_are_found(region, tmp_path):
    found = mpmgis.exposure(region / "region", region / "all.geojson", tmp_path / "o")
    assert [row.areas for row in found.found] == [(1, 2), (1,), (2,)]
    assert sorted(file.name for file in found.files) == ["exposure.csv", "exposure.gpkg", "release_areas.csv"]
    road = [row for row in found.by_area if row.number == 1]
    whole = found.found[0].reach
    assert whole.size == pytest.approx(sum(row.reach.size for row in road))  # the flows are apart
    for name in ("h_max", "Ut_max", "p_max"):
        assert whole.values[name] == max(row.reach.values[name] for row in road)
    assert whole.values["t_arrival"] == min(row.reach.values["t_arrival"] for row in road) > 0.0
    assert [row["release_areas"] for row in table(tmp_path / "o" / "exposure.csv")] == ["1 2", "1", "2"]
    assert len(table(tmp_path / "o" / "release_areas.csv")) == 4


def test_maps_of_a_scenario_of_a_region_have_its_areas_alone(region, tmp_path):
    maps = [region / "region" / "maps" / f"scenario_{years}" for years in ("30", "100")]
    found = mpmgis.exposure(maps, region / "all.geojson", tmp_path / "o")
    assert found.scenarios == ("scenario_30", "scenario_100")
    assert [row.areas for row in found.found] == [(1,), (1,), (), (2,), (), (2,)]
    assert [one["scenarios"] for one in found.attributes()] == [
        "scenario_30, scenario_100",
        "scenario_30",
        "scenario_100",
    ]


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (("--objects", "missing.gpkg"), "missing.gpkg"),
        (("--objects", "empty.csv"), "empty.csv"),
        (("--objects", "objects.geojson", "-o", "o.tif"), "expected .csv, .gpkg or a folder"),
        (("--objects", "objects.geojson", "--min-depth", "0"), "--min-depth"),
        ((), "--objects"),
    ],
)
def test_bad_input_has_one_line(tmp_path, run, capsys, monkeypatch, words, part):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty.csv").write_text("a,b\n1,2\n")
    try:
        assert main(["exposure", "run", *words]) == 2
    except SystemExit as end:
        assert end.code == 2
    lines = capsys.readouterr().err.splitlines()
    assert part in lines[-1] and not (tmp_path / "run_exposure").exists()
