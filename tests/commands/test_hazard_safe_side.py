"""`mpmgis report --map`: what could make a level too low is known, or reported."""

import json

import numpy as np
import pytest
from affine import Affine
from block_frames import write_block_run
from test_hazard_map import levels, run, write_dtm, write_peaks

from mpmgis.commands.shell.main import main


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


@pytest.mark.parametrize(
    ("record", "words"),
    [
        (
            {
                "state": "finished",
                "time": 30.0,
                "balances": {"kinetic_energy": 5e7, "kinetic_energy_peak": 1e8, "mass_now": 2e6},
            },
            "ended at t = 30 s with a mean speed of 7.1 m/s",
        ),
        ({"state": "interrupted"}, "is interrupted"),
        (
            {
                "state": "finished",
                "time": 30.0,
                "balances": {"kinetic_energy": 5e5, "kinetic_energy_peak": 1e8, "mass_now": 2e6},
            },
            "",
        ),
        (
            {
                "state": "finished",
                "time": 30.0,
                "balances": {"kinetic_energy": 6e-6, "kinetic_energy_peak": 1e-5, "mass_now": 2e6},
            },
            "",
        ),
    ],
    ids=["moving", "interrupted", "nearly at rest", "never moved"],
)
def test_a_run_that_has_not_come_to_rest_is_named(tmp_path, capsys, record, words):
    frames = write_block_run(tmp_path, (150.0, 450.0), times=(0.0, 10.0), speeds=(0.0, 10.0))
    (frames / "run.json").write_text(json.dumps(record))
    assert run("swiss-debris-flow", "--scenario", f"30={frames}", "-o", tmp_path / "map.tif") == 0
    said = capsys.readouterr().err
    assert words in said and ("would give later" in said) == bool(words)


@pytest.mark.parametrize(("which", "warns"), [("frame_000001.h5", True), ("frame_000000.h5", False), ("", False)])
def test_one_frame_is_not_a_whole_flow(tmp_path, capsys, which, warns):
    frames = write_block_run(tmp_path, (150.0, 450.0), times=(0.0, 10.0), speeds=(0.0, 10.0))
    assert run("swiss-debris-flow", "--scenario", f"30={frames / which}", "-o", tmp_path / "map.tif") == 0
    said = capsys.readouterr().err
    assert ("frame_000001.h5 is the only frame: maxima are those of t = 10 s alone" in said) == warns
