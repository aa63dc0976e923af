"""`mpmgis report --map`: what could make a level too low is known, or reported."""

import csv
import json

import geopandas
import numpy as np
import pytest
import rasterio
from affine import Affine
from block_frames import write_block_run
from test_hazard_map import levels, run, write_dtm, write_peaks

from mpmgis.commands.shell.main import main
from mpmgis.results.hazard import hazard_sheet


def test_a_raster_without_any_value_is_not_free_of_hazard(tmp_path, capsys):
    site = write_dtm(tmp_path / "dtm.tif")
    depth = np.zeros((40, 40))
    depth[10:30, 10:30] = 2.0
    write_peaks(tmp_path / "a", depth)
    write_peaks(tmp_path / "b", np.full((40, 40), np.nan))
    options = ["--scenario", f"300={tmp_path / 'a'}", "--scenario", f"30={tmp_path / 'b'}", "--dem", site]
    assert run("swiss-hillslope-debris-flow", *options, "-o", tmp_path / "map.tif") == 0
    assert "all cells are nodata" in capsys.readouterr().err
    assert np.array_equal(levels(tmp_path / "map.tif")[0] == 255, depth == 0)


def test_an_export_of_the_extent_of_the_flow_is_dry_beyond_it(tmp_path, capsys):
    """Two exports with cells of 5 m, each cut to its flow: no cell beyond them is 'not assessed'."""
    for name, places in (("a", (150.0, 250.0)), ("b", (150.0, 450.0))):
        (tmp_path / name).mkdir()
        frames = write_block_run(tmp_path / name, places, times=(0.0, 10.0), speeds=(0.0, 10.0))
        assert main(["export-raster", str(frames), "--no-qgis", "--cs-e", "5"]) == 0
    options = ["--scenario", f"30={tmp_path}/a/run_gis", "--scenario", f"300={tmp_path}/b/run_gis"]
    for more in ([], ["--dem", str(tmp_path / "a" / "run" / "terrain.tif")]):
        capsys.readouterr()
        found = run("swiss-debris-flow", *options, *more, "--overwrite", "-o", tmp_path / "map.tif")
        said = capsys.readouterr().err
        assert found == 0 and "different cells" not in said and "not assessed" not in said
        assert not (levels(tmp_path / "map.tif")[0] == 255).any()


def test_beyond_an_export_that_the_flow_leaves_nothing_is_known(tmp_path, capsys):
    frames = write_block_run(tmp_path, (150.0, 750.0), times=(0.0, 10.0), speeds=(0.0, 10.0))
    assert main(["export-raster", str(frames), "--no-qgis"]) == 0
    whole = np.zeros((60, 120))
    whole[25, 5] = 2.0
    write_peaks(tmp_path / "b", whole, whole, transform=Affine(10, 0, 400000, 0, -10, 5100500))
    options = ["--scenario", f"30={tmp_path}/run_gis", "--scenario", f"300={tmp_path}/b"]
    dtm = write_dtm(tmp_path / "wide.tif", (399900, 5099800, 401400, 5100600))
    assert run("swiss-debris-flow", *options, "--dem", dtm, "-o", tmp_path / "map.tif") == 0
    found, place = levels(tmp_path / "map.tif")
    row, column = np.indices(found.shape)
    x, _ = place * (column + 0.5, row + 0.5)
    assert (found[x > 400810] == 255).all()


def write_region(folder, depth):
    """A region whose areas flow as deep as `depth`, on a DTM of the same cells."""
    (folder / "maps").mkdir(parents=True)
    (folder / "region.json").write_text("{}")
    for name, values in (("h_max [m]", depth), ("Ut_max [m s-1]", 5 * depth), ("p_max [Pa]", 1e4 * depth)):
        path = folder / "maps" / f"all_{name.split()[0]}.tif"
        place = {"crs": "EPSG:32632", "transform": Affine(10, 0, 400000, 0, -10, 5100400), "nodata": -9999}
        height, width = depth.shape
        with rasterio.open(path, "w", "GTiff", width, height, 1, dtype="float32", **place) as target:
            target.write(np.where(depth > 0, values, -9999).astype(np.float32), 1)
            target.set_band_description(1, name)


def test_the_dtm_of_a_region_is_dry_beyond_its_flow_although_this_leaves_the_dtm(tmp_path, capsys):
    """The flows of two regions on one DTM reach its edge; the second one goes farther."""
    near, far = np.zeros((40, 40)), np.zeros((40, 40))
    near[:10, 15:20], far[:30, 10:30] = 2.0, 2.0
    write_region(tmp_path / "near", near)
    write_region(tmp_path / "far", far)
    options = ["--scenario", f"30={tmp_path / 'near'}", "--scenario", f"300={tmp_path / 'far'}"]
    dtm = write_dtm(tmp_path / "dtm.tif", (400000, 5100000, 400400, 5100400))
    assert run("swiss-debris-flow", *options, "--dem", dtm, "-o", tmp_path / "map.tif") == 0
    assert "not assessed" not in capsys.readouterr().err
    assert not (levels(tmp_path / "map.tif")[0] == 255).any()


def finished(came_to_rest):
    end = {"time": 10.0, "moving": 0.2, "came_to_rest": came_to_rest}
    return {"state": "finished", "digest": "b" * 64, "end": end}


@pytest.mark.parametrize("exported", [False, True])
@pytest.mark.parametrize(
    ("record", "words"),
    [
        (finished(False), "the flow did not come to rest: last step, t = 10 s, 100 % still moving"),
        (finished(True), ""),
        ({"state": "interrupted", "time": 10.0}, "the run is interrupted at t = 10 s"),
        (None, "the flow did not come to rest: last step, t = 10 s, 100 % still moving"),
    ],
    ids=["moving", "at rest", "interrupted", "frames alone"],
)
def test_a_run_that_has_not_come_to_rest_is_named_in_red_and_in_every_file(
    tmp_path, capsys, monkeypatch, record, words, exported
):
    """The block moves in its last frame. An export knows the end of its flow from its tags, but not an interruption."""
    figures = []
    monkeypatch.setattr(hazard_sheet.Print, "save", lambda self, path, kind: figures.append(self.figure))
    results = write_block_run(tmp_path, (150.0, 450.0), times=(0.0, 10.0), speeds=(0.0, 10.0))
    if record is not None:
        (results / "run.json").write_text(json.dumps(record | {"terrain": {"dem": "/far/away/valley_1m.tif"}}))
    if exported:
        assert main(["export-raster", str(results), "--no-qgis", "--cs-e", "5"]) == 0
        results = tmp_path / "run_gis"
        words = words and "the flow did not come to rest: last step, t = 10 s, 100 % still moving"
    capsys.readouterr()
    assert run("swiss-debris-flow", "--scenario", f"30={results}", "-o", tmp_path / "map") == 0
    said = capsys.readouterr().err
    assert words in said and ("would give later" in said) == bool(words)
    texts = figures[0].texts
    red = " ".join(text.get_text() for text in texts if text.get_color() == hazard_sheet.WARNING_COLOUR)
    assert all(word in red for word in words.split()) and bool(red) == bool(words)
    named = f"30 years: {words}" if words else ""
    with (tmp_path / "map" / "hazard.csv").open(newline="") as file:
        assert {row["unfinished"] for row in csv.DictReader(file)} == {named}
    zones = geopandas.read_file(tmp_path / "map" / "hazard.gpkg", layer="zones")
    assert set(zones["unfinished"].fillna("")) == {named}
    dtm = "terrain.tif" if record is None else "valley_1m.tif"
    assert any(f"DTM: {dtm}" in text.get_text() for text in texts)


@pytest.mark.parametrize(("which", "warns"), [("frame_000001.h5", True), ("frame_000000.h5", False), ("", False)])
def test_one_frame_is_not_a_whole_flow(tmp_path, capsys, which, warns):
    frames = write_block_run(tmp_path, (150.0, 450.0), times=(0.0, 10.0), speeds=(0.0, 10.0))
    assert run("swiss-debris-flow", "--scenario", f"30={frames / which}", "-o", tmp_path / "map.tif") == 0
    said = capsys.readouterr().err
    assert ("frame_000001.h5 is the only frame: maxima are those of t = 10 s alone" in said) == warns
