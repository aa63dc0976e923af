"""Forest in a scene: run, resumed run, rasters, decisions, and what is refused."""

import geopandas
import h5py
import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine
from slope_site import (
    COLUMNS,
    ROWS,
    SCENE,
    SOUTH,
    WEST,
    contents,
    decisions,
    record,
    refused,
    run,
    write_raster,
    write_shapes,
    write_site,
)

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_bed_change
from mpmgis.frames.run_folder import RunFolder

FOREST = '[[forest]]\nsource = "forest.gpkg"\nstrength = "strength"\ndetrainment = 500\ndrag = 0.01\nfriction = 0.02\n'
CORNER = np.array([WEST, SOUTH])
STANDS, BREAKS = shapely.box(180, 0, 500, 200), shapely.box(180, 200, 500, 400)


def wooded(site):
    """The site with a forest that stands south of the middle of the flow, and one that breaks north of it."""
    write_site(site)
    write_shapes(site / "forest.gpkg", [STANDS, BREAKS], strength=[1e9, 1000.0])
    return site


@pytest.fixture(scope="module")
def forested(tmp_path_factory):
    """A run through forest: its site."""
    site = wooded(tmp_path_factory.mktemp("forest"))
    assert run(site, SCENE + FOREST) == 0
    return site


def test_the_ledger_of_a_run_closes(forested):
    b = record(forested)["balances"]
    assert b["mass_detrained"] > 0.01 * b["mass_start"]
    come = b["mass_start"] + b["mass_entrained"]
    found = b["mass_flowing"] + b["mass_at_rest"] + b["mass_detrained"] + b["mass_out"]
    assert found == pytest.approx(come, rel=1e-12)
    assert abs(b["mass_error_relative"]) <= 1e-12
    assert b["energy_lost_to_forest"] > 0.0
    assert abs(b["energy_error_relative"]) < 1e-3


@pytest.mark.parametrize("degrees", [17.0, 90.0, pytest.param(200.0, marks=pytest.mark.thorough)])
def test_forest_on_a_rotated_dtm_is_that_of_the_site(forested, tmp_path, degrees):
    """The whole site turned about its corner. Grid and seeds stay north-up, so that only a right angle keeps them."""
    turn = Affine.rotation(degrees)
    for path in (forested / "release.geojson", forested / "forest.gpkg"):
        table = geopandas.read_file(path)
        table.geometry = shapely.transform(
            table.geometry.values, lambda p: np.column_stack(turn * (p - CORNER).T) + CORNER
        )
        table.to_file(tmp_path / path.name)
    with rasterio.open(forested / "dtm.tif") as source:
        place = Affine.translation(*CORNER) * turn * Affine.translation(*-CORNER) * source.transform
        with rasterio.open(tmp_path / "dtm.tif", "w", **source.profile | {"transform": place}) as target:
            target.write(source.read())
    finer = (SCENE + FOREST).replace("cell_size = 10.0", "cell_size = 5.0")
    turned, plain = (balances_of(folder, finer) for folder in (tmp_path, wooded_again(tmp_path)))
    for name in ("mass_start", "mass_detrained", "energy_lost_to_forest", "forest_broken_area"):
        assert turned[name] == pytest.approx(plain[name], rel=1e-3 if degrees % 90 == 0 else 0.1), name


def wooded_again(folder):
    """The site in a folder of its own."""
    (folder / "plain").mkdir()
    return wooded(folder / "plain")


def balances_of(site, scene):
    """The balances of a run of `scene`."""
    assert run(site, scene) == 0
    return record(site)["balances"]


def test_frames_store_what_stopped_and_what_broke(forested):
    last = read_bed_change(max((forested / "results").glob("frame_*.h5")))
    b, cell = record(forested)["balances"], last["transform"][0] ** 2
    assert last["detrained_mass"].sum() * cell == pytest.approx(b["mass_detrained"], rel=1e-12)
    assert last["broken_forest"].sum() * cell == b["forest_broken_area"] > 0.0
    assert not last["eroded_mass"].any()
    north = last["transform"][5] + last["transform"][0] * (np.arange(len(last["broken_forest"])) + 0.5) - 5.1e6
    assert not last["broken_forest"][north < 200.0].any()
    middle, half = north < 200.0, north >= 200.0
    assert last["detrained_mass"][middle].sum() > last["detrained_mass"][half].sum()


def test_a_resumed_run_is_the_same(forested, tmp_path, monkeypatch):
    write = RunFolder.write_frame

    def stop(folder, frame):
        if folder.frames == 3:
            raise KeyboardInterrupt
        write(folder, frame)

    words = ["run", str(forested / "scene.toml"), "-q", "-o", str(tmp_path / "cut")]
    monkeypatch.setattr(RunFolder, "write_frame", stop)
    assert main(words) == 130
    monkeypatch.undo()
    assert main([*words, "--resume"]) == 0
    assert record(tmp_path, "cut")["result_digest"] == record(forested)["result_digest"]
    assert record(tmp_path, "cut")["balances"] == record(forested)["balances"]


@pytest.mark.parametrize("cell", [None, "7"])
def test_the_export_has_the_mass_that_stopped(forested, tmp_path, cell):
    words = ["export-raster", str(forested / "results"), "-o", str(tmp_path / "maps")]
    assert main(words + (["--cs-e", cell] if cell else [])) == 0
    bands = {}
    for word in ("surface", "bed"):
        with rasterio.open(tmp_path / "maps" / "rasters" / f"results_{word}.tif") as file:
            bands |= dict(zip([text.split(" ")[0] for text in file.descriptions], file.read(masked=True), strict=True))
            area = abs(file.transform.a * file.transform.e)
    assert set(bands) >= {"eroded", "thickness_end", "detrained", "broken_forest", "surface_new", "bed_new"}
    b = record(forested)["balances"]
    stopped = float(bands["detrained"].astype(float).sum()) * area * 1000.0
    assert stopped == pytest.approx(b["mass_detrained"], rel=1e-5)  # float32
    broken = float(bands["broken_forest"].astype(float).sum()) * area
    assert broken == pytest.approx(b["forest_broken_area"], rel=1e-5)
    raised = bands["surface_new"] - bands["bed_new"]
    np.testing.assert_allclose(raised, bands["thickness_end"] + bands["detrained"], atol=1e-4)


def _arrays(site):
    """All that the frames of a run hold but the scene's digest, which is in `time`."""
    return {name: values for name, values in contents(site / "results").items() if name[1] != "time"}


def test_forest_that_is_off_changes_no_bit(tmp_path):
    wooded(tmp_path)
    assert run(tmp_path, SCENE) == 0
    plain, digest = _arrays(tmp_path), record(tmp_path)["result_digest"]
    assert run(tmp_path, SCENE + FOREST + 'use = "off"\n') == 0
    assert _arrays(tmp_path) == plain and record(tmp_path)["result_digest"] == digest
    with h5py.File(max((tmp_path / "results").glob("frame_*.h5"))) as file:
        assert "bed_change" not in file and not [name for name in file["state"] if "forest" in name]
    assert "mass_detrained" not in record(tmp_path)["balances"]


def test_forest_from_rasters_is_that_of_polygons(forested, tmp_path):
    write_site(tmp_path)
    x, y = (np.arange(COLUMNS) + 0.5) * 10.0, (ROWS - np.arange(ROWS) - 0.5) * 10.0
    strength = np.where((x[None] > 180) & (x[None] < 500), np.where(y[:, None] < 200, 1e9, 1000.0), np.nan)
    write_raster(tmp_path / "strength.tif", strength)
    assert (
        run(tmp_path, SCENE + FOREST.replace('"strength"', '"strength.tif"').replace('source = "forest.gpkg"\n', ""))
        == 0
    )
    ours, theirs = record(tmp_path)["balances"], record(forested)["balances"]
    for name in ("mass_detrained", "energy_lost_to_forest", "forest_area", "forest_broken_area"):
        assert ours[name] == pytest.approx(theirs[name], rel=1e-9), name


def test_the_decision_names_the_area(forested, tmp_path, capsys):
    wooded(tmp_path)
    found = decisions(tmp_path, SCENE + FOREST, capsys)["forest"]
    assert found["state"] == "on" and "12.8 ha of forest" in found["reason"]
    assert decisions(tmp_path, SCENE + FOREST + 'use = "off"\n', capsys)["forest"]["state"] == "off"
    assert decisions(tmp_path, SCENE, capsys)["forest"]["state"] == "off"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("detrainment = 500\ndrag = 0.01\nfriction = 0.02\n", ""), "detrainment, drag and friction are all 0"),
        (('strength = "strength"\n', ""), "strength is missing"),
        (('strength = "strength"', "strength = 0"), "strength = 0, expected above 0"),
        (("drag = 0.01", "drag = -1"), "drag = -1, expected at least 0"),
        (('source = "forest.gpkg"\nstrength = "strength"', "strength = 1000"), "without source"),
        (('strength = "strength"', 'strength = "height"'), "height"),
        (('source = "forest.gpkg"\n', ""), "without polygons there are no columns"),
        (("detrainment = 500", "detrainment_speed = 6"), "limit detrainment, which is 0"),
        (("drag = 0.01", "breaking_thickness = -1"), "breaking_thickness = -1, expected at least 0"),
        (("[[forest]]", "[forest]"), "there can be several forest"),
    ],
)
def test_what_is_refused(tmp_path, capsys, change, words):
    wooded(tmp_path)
    assert words in refused(tmp_path, capsys, SCENE + FOREST.replace(*change))


def test_a_value_outside_its_range_is_named(tmp_path, capsys):
    """The smallest value, 0, is within the range of drag; the largest is not."""
    wooded(tmp_path)
    drag = np.zeros((ROWS, COLUMNS))
    drag[:, 40:] = 200.0
    write_raster(tmp_path / "drag.tif", drag)
    said = refused(tmp_path, capsys, SCENE + FOREST.replace("drag = 0.01", 'drag = "drag.tif"'))
    assert "drag reaches 200, expected 0 to 100" in said


def test_a_forest_off_the_terrain_is_refused(tmp_path, capsys):
    write_site(tmp_path)
    write_shapes(tmp_path / "forest.gpkg", [shapely.box(5000, 0, 5100, 100)], strength=[1e4])
    assert "forest" in refused(tmp_path, capsys, SCENE + FOREST)


def test_3d_points_refuse_forest(tmp_path, capsys):
    wooded(tmp_path)
    scene = SCENE.replace("particles_per_cell = 4\n", "")
    said = refused(tmp_path, capsys, f'solver = "points"\n{scene}{FOREST}')
    assert "the 3D solver has no [forest]; take it out" in said
    stages = '[[stage]]\nsolver = "columns"\nuntil = {time = 5}\n[[stage]]\nsolver = "points"\n'
    material = '[material]\nlaw = "Fluid"\nbulk_modulus = 1e6\n'
    assert "[[forest]] is not kept through" in refused(tmp_path, capsys, scene + FOREST + material + stages)
