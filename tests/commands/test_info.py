"""`mpmgis info`: one screen of text, or one JSON object per line."""

import json
from dataclasses import replace

import geopandas
import numpy as np
import pyproj
import pytest
import rasterio
import shapely

from mpmgis.commands.demo_site import sample_folder
from mpmgis.commands.shell.info_text import screen_lines
from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame, write_frame
from mpmgis.frames.particles import Frame, Particles


@pytest.fixture
def seed(tmp_path):
    particles = Particles(
        position=np.zeros((12345, 3)),
        velocity=np.full((12345, 3), 2.0),
        mass=np.full(12345, 10.0),
        volume=np.full(12345, 0.01),
        thickness=np.ones(12345),
        area=np.full(12345, 0.01),
    )
    write_frame(tmp_path / "seed.h5", Frame(particles, header={"density": 1000.0}))
    return tmp_path / "seed.h5"


def test_a_screen_for_people(seed, capsys):
    assert main(["info", str(seed)]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    lines = out.splitlines()
    assert lines[0].startswith(f"{seed}: particles (")
    said = dict(line.strip().split("  ", 1) for line in lines[1:] if "  " in line.strip())
    assert said["particles"].strip() == "12 345"
    assert said["mass"].strip() == "123450.0 kg"
    assert said["CRS"].strip() == "none"
    assert said["largest speed now"].strip() == "3.4641 m s-1"
    assert said["column thickness, vertical"].strip() == "1 to 1 m" and said["column area"].strip() == "0.01 to 0.01 m2"
    assert "largest speed so far" not in said


def told(path, capsys):
    """Label -> text of one file's screen; its title under ''."""
    assert main(["info", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    rows = (line.strip().partition("  ") for line in lines[1:])
    return {"": lines[0], **{label: text.strip() for label, _, text in rows}}


def test_speeds_of_a_frame_and_of_all_steps_are_distinguished(seed, capsys):
    frame = read_frame(seed)
    peaks = {name: np.full((2, 3), value) for name, value in (("thickness", 4.0), ("speed", 31.5), ("pressure", 9.0))}
    peaks |= {"arrival_time": np.zeros((2, 3)), "transform": np.array([5.0, 0, 0, 0, 5.0, 0])}
    write_frame(seed.parent / "frame_000000.h5", replace(frame, time=8.0, maxima=peaks))
    for path in (seed.parent / "frame_000000.h5", seed.parent):
        said = told(path, capsys)
        assert (said["largest speed now"], said["largest speed so far"]) == ("3.4641 m s-1", "31.5 m s-1")
        assert said["largest thickness so far, vertical"] == "4 m"


def test_places_are_reported_in_the_maps_own_unit(tmp_path, capsys):
    values = np.ones((1, 4, 5), np.float32)
    shapes = {"EPSG:4326": "degrees", "EPSG:2226": "US survey foot", "EPSG:32632": "m"}
    for crs, unit in shapes.items():
        with rasterio.open(
            tmp_path / "a.tif", "w", "GTiff", 5, 4, 1, crs, rasterio.Affine(0.25, 0, 9.0, 0, -0.25, 46.0), "float32"
        ) as target:
            target.write(values)
        said = told(tmp_path / "a.tif", capsys)
        assert said["cell size"] == f"0.25, 0.25 {unit}" and said["W, S, E, N"] == f"9, 45, 10.25, 46 {unit}"
    table = geopandas.GeoDataFrame({"d0": [2.0]}, geometry=[shapely.box(9, 45, 10, 46)], crs="EPSG:4326")
    table.to_file(tmp_path / "a.gpkg")
    assert told(tmp_path / "a.gpkg", capsys)["bbox"] == "9, 45, 10, 46 degrees"


def test_angles_of_a_scene_are_degrees_and_times_seconds():
    tables = {"earth_pressure": {"friction_angle": 35.0, "use": "on"}, "output": {"end_time": 9.0, "maxima": True}}
    lines = screen_lines({"file": "scene.toml", "kind": "scene", **tables})
    assert any(line.endswith("friction_angle 35 degrees, use on") for line in lines)
    assert any(line.endswith("end_time 9 s, maxima yes") for line in lines)


def test_an_export_reports_its_extremes_with_units():
    facts = {"file": "a_gis", "kind": "export", "maxima": {"Ut_max": [1.5, 31.25], "t_arrival": [None, None]}}
    assert [line.split(None, 1) for line in screen_lines(facts)[2:]] == [
        ["Ut_max", "1.5 to 31.25 m s-1"],
        ["t_arrival", "no value"],
    ]


def test_a_style_is_reported_as_one(tmp_path, capsys):
    run = tmp_path / "slide"
    write_frame_on_a_terrain(run)
    assert main(["export-raster", str(run), "-q"]) == 0
    capsys.readouterr()
    said = told(tmp_path / "slide_gis" / "rasters" / "slide_max.qml", capsys)
    assert ": QGIS style (" in said[""] and said["layer"] == "raster"
    assert said["renderer"] == "singlebandpseudocolor" and "> 0.8 m" in said["classes"]
    assert told(tmp_path / "slide_gis" / "dtm.qml", capsys)["renderer"] == "hillshade"


def write_frame_on_a_terrain(folder):
    """A run of one frame, of four columns on a plane."""
    folder.mkdir()
    place = rasterio.Affine(5, 0, 600000, 0, -5, 5170000)
    with rasterio.open(folder / "terrain.tif", "w", "GTiff", 8, 8, 1, "EPSG:32632", place, "float32") as target:
        target.write(np.full((1, 8, 8), 100, np.float32))
    corner = np.array(
        [[600012.0, 5169978, 100], [600017, 5169978, 100], [600012, 5169983, 100], [600017, 5169983, 100]]
    )
    ones = np.ones(4)
    particles = Particles(corner, np.full((4, 3), 2.0), 25000 * ones, 25 * ones, thickness=ones, area=25 * ones)
    crs = pyproj.CRS.from_epsg(32632)
    write_frame(folder / "frame_000000.h5", Frame(particles, dem="terrain.tif", crs=crs, header={"density": 1000.0}))


def test_one_object_a_line_for_programs(seed, capsys):
    assert main(["info", "--json", str(seed), str(sample_folder() / "scene.toml")]) == 0
    objects = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [facts["kind"] for facts in objects] == ["particles", "scene"]
    assert set(objects[0]) >= {"reader", "time", "n", "mass", "bbox", "crs"}
    assert objects[0]["n"] == 12345


@pytest.mark.parametrize("files", ["lava_falls_dem_utm12n_10m.tif", "lava_falls_release.shp", "scene.toml", ""])
def test_one_screen_is_one_screen(files, seed, capsys):
    assert main(["info", str(sample_folder() / files) if files else str(seed)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert 3 < len(lines) <= 50
    assert max(map(len, lines)) < 160
    assert not any("{" in line or "[" in line or "'" in line for line in lines)


def test_a_bad_file_gives_one_line_and_the_others_are_reported(seed, tmp_path, capsys):
    (tmp_path / "junk.h5").write_text("junk")
    assert main(["info", str(tmp_path / "none.tif"), str(seed), str(tmp_path / "junk.h5")]) == 2
    out, err = capsys.readouterr()
    assert out.startswith(str(seed))
    assert [line.split(":")[0] for line in err.splitlines()] == ["mpmgis info"] * 2


def test_no_file_is_bad_input(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["info"])
    assert stop.value.code == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_long_lists_are_cut_and_counted():
    facts = {
        "file": "a.gpkg",
        "kind": "vector",
        "layers": [{"name": f"layer{k}"} for k in range(40)],
        "tags": {f"key{k}": k for k in range(100)},
        "columns": [f"column{k}" for k in range(100)],
    }
    lines = screen_lines(facts)
    assert len(lines) < 50
    assert any("... and 28 more" in line for line in lines)
    assert any("and 76 more" in line for line in lines)
    assert any("(100 in all)" in line or line.endswith("...") for line in lines)


@pytest.mark.parametrize("form", [[], ["--json"]])
def test_an_answer_in_a_file_is_what_would_be_printed(seed, tmp_path, capsys, form):
    assert main(["info", *form, str(seed), str(seed)]) == 0
    printed = capsys.readouterr().out
    told = tmp_path / "new" / "told.txt"
    assert main(["info", *form, str(seed), str(seed), "-o", str(told)]) == 0
    assert capsys.readouterr().out == f"{told}\n" and told.read_text() == printed
    assert main(["info", str(seed), "-o", str(told)]) == 2
    assert "exists already" in capsys.readouterr().err and told.read_text() == printed


def test_an_output_file_is_complete_and_never_replaces_an_input(seed, tmp_path, capsys):
    told, before = tmp_path / "told.txt", seed.read_bytes()
    assert main(["info", str(seed), str(tmp_path / "nosuch"), "-o", str(told)]) == 2 and not told.exists()
    assert main(["info", str(seed), "-o", str(seed), "--overwrite"]) == 2 and seed.read_bytes() == before
    assert capsys.readouterr().err.endswith("is also an input; give another -o\n")


def test_the_catalogue_of_effects_in_a_file(tmp_path, capsys):
    assert main(["effects", "--json", "-o", str(tmp_path / "effects.json")]) == 0
    out = capsys.readouterr().out
    assert out == f"{tmp_path / 'effects.json'}\n" and json.loads((tmp_path / "effects.json").read_text())
