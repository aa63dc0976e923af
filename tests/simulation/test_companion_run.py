"""The companion of a run: stated numerical errors against an exact answer, its record, its failures, its restart."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import rasterio
import study as shipped
from slope_site import SCENE, contents, record, run, slide, write_block_site, write_site

import mpmgis
from mpmgis.commands.shell.main import main
from mpmgis.frames.headline_numbers import HEADLINES, error_lines, error_words
from mpmgis.maps.averaging.result_bands import open_result
from mpmgis.results.hazard.scenario_facts import facts_of
from mpmgis.simulation import companion_run
from mpmgis.simulation.companion_run import (
    LEAST_CELLS,
    LEAST_SHARE,
    SAFETY,
    companion_lines,
    stated_error,
    without_companion,
)

OFF = SCENE.replace("[output]", "companion = false\n[output]")


@pytest.fixture
def site(tmp_path):
    return write_site(tmp_path)


def test_stated_errors_cover_those_against_an_exact_dam_break(tmp_path):
    """Ritter's dam break of 5 m onto dry ground, 100 m long and 8 m wide, after 2.5 s."""
    shipped.dam(tmp_path)
    numbers = mpmgis.run(tmp_path / "scene.toml").companion["numbers"]
    time, depth, wave = 2.5, 5.0, np.sqrt(9.81 * 5.0)
    front = wave * (2.0 - 3.0 * np.sqrt(0.01)) * time  # of the depth from which nodes count as reached, 1 %
    exact = {
        "runout": np.hypot(25.0 + front, 4.0),
        "footprint_area": (50.0 + front + 0.5) * (8.0 + 1.0),  # nodes on walls count half a cell beyond them
        "thickness_p99": depth,
        "speed_max": 2.0 * wave,
        "volume_at_end": 50.0 * 8.0 * depth,
    }
    assert numbers.keys() == exact.keys() == HEADLINES.keys()
    assert all(abs(one["value"] - exact[name]) <= one["error"] for name, one in numbers.items()), numbers
    assert abs(numbers["volume_at_end"]["value"] / exact["volume_at_end"] - 1.0) < 1e-9


def test_a_run_prints_and_stores_its_errors_and_nothing_else_of_it_changes(site, capsys):
    assert run(site, OFF) == 0
    assert "numerical error" not in capsys.readouterr().err
    alone, frames = record(site), contents(site / "results")
    assert "companion" not in alone and alone["numbers"].keys() == HEADLINES.keys()
    assert run(site, SCENE) == 0
    said, kept = capsys.readouterr().err, record(site)
    assert all(line in said for line in companion_lines(kept["companion"]))
    assert kept["companion"]["cell_size"] == 20.0
    assert {name: one["value"] for name, one in kept["companion"]["numbers"].items()} == alone["numbers"]
    assert kept["result_digest"] == alone["result_digest"] and contents(site / "results") == frames
    volume = kept["companion"]["numbers"]["volume_at_end"]
    assert volume["value"] == pytest.approx(volume["larger_cells"], rel=1e-9)


def test_maps_report_and_results_carry_the_errors(site):
    assert run(site, SCENE) == 0
    words = error_words(record(site)["companion"])
    assert words.count("+-") == len(HEADLINES)
    assert main(["export-raster", str(site / "results"), "-o", str(site / "gis"), "-q"]) == 0
    with rasterio.open(site / "gis" / "rasters" / "results_max.tif") as source:
        assert source.tags(ns="mpmgis")["numerical_error"] == words
    assert f"numerical errors: {words}" in facts_of(site / "results")  # on the sheet of a hazard map
    exported = open_result(site / "gis" / "rasters" / "results_max.tif")
    assert f"numerical errors: {words}" in facts_of(site / "gis" / "rasters" / "results_max.tif", exported)
    for folder in ("results", "gis"):
        assert mpmgis.open_results(site / folder).attrs["numerical_error"] == words
        assert main(["report", str(site / folder), "-o", str(site / "report.html"), "--overwrite", "-q"]) == 0
        assert "Numerical error" in (site / "report.html").read_text(encoding="utf-8")


def test_a_finished_run_gets_its_missing_companion(site, capsys):
    assert run(site, OFF) == 0
    (site / "scene.toml").write_text(SCENE)
    assert main(["run", str(site / "scene.toml"), "--resume"]) == 0
    later = record(site)["companion"]["numbers"]
    assert run(site, SCENE) == 0
    assert record(site)["companion"]["numbers"] == later
    capsys.readouterr()
    assert main(["run", str(site / "scene.toml"), "--resume"]) == 0  # it is made once
    said = capsys.readouterr().err
    assert "companion run on cells" not in said and "numerical error about" in said


def test_a_run_continued_in_the_middle_states_the_same_numbers(site):
    assert run(site, OFF.replace("end_time = 30", "end_time = 15")) == 0
    (site / "scene.toml").write_text(SCENE)
    assert main(["run", str(site / "scene.toml"), "--resume"]) == 0
    continued = record(site)
    assert run(site, SCENE) == 0
    assert record(site)["companion"]["numbers"] == continued["companion"]["numbers"]


def test_a_companion_that_fails_leaves_the_run_complete(site, capsys, monkeypatch):
    def broken(*given):
        raise RuntimeError("no such cells")

    monkeypatch.setattr(companion_run, "on_larger_cells", broken)
    assert run(site, SCENE) == 0
    kept = record(site)
    assert kept["state"] == "finished" and kept["companion"]["failed"] == "no such cells"
    assert "numerical error unknown: no such cells" in capsys.readouterr().err
    assert error_words(kept["companion"]) == ""


def test_a_stopped_companion_leaves_the_run_complete(site, monkeypatch):
    def stopped(*given):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(companion_run, "on_larger_cells", stopped)
        assert run(site, SCENE) == 0
    kept = record(site)
    assert kept["state"] == "finished" and "companion" not in kept
    assert main(["run", str(site / "scene.toml"), "--resume"]) == 0
    assert record(site)["companion"]["numbers"]


def test_rasters_of_a_run_get_the_errors_once_they_are_known(site, monkeypatch):
    def stopped(*given):
        raise KeyboardInterrupt

    def tags():
        found = {}
        for path in (site / "results" / "maps" / "rasters").glob("*.tif"):
            with rasterio.open(path) as source:
                found[path.stem.removeprefix("results_")] = source.tags(ns="mpmgis").get("numerical_error")
        return found

    with monkeypatch.context() as patched:
        patched.setattr(companion_run, "on_larger_cells", stopped)
        assert run(site, SCENE + "rasters = true\n") == 0
    assert set(tags().values()) == {None}
    assert main(["run", str(site / "scene.toml"), "--resume", "-q"]) == 0
    words, found = error_words(record(site)["companion"]), tags()
    assert words and {found.pop(name) for name in ("max", "last")} == {words} and set(found.values()) == {None}


def test_one_stage_of_columns_has_the_companion_of_a_run_without_stages(site):
    assert run(site, SCENE) == 0
    alone = record(site)["companion"]["numbers"]
    assert run(site, SCENE + '[[stage]]\nsolver = "columns"\n') == 0
    assert record(site)["companion"]["numbers"] == alone


STAGES = [{"solver": "columns", "until": {"time": 1.0}}, {"solver": "points", "cell_size": 1.0}]


@pytest.mark.parametrize(
    ("solver", "stages", "given", "words"),
    [
        ("columns", [], {}, ""),
        ("columns", [], {"companion": False}, ""),
        ("columns", STAGES[:1], {}, ""),
        ("columns", STAGES, {}, "a stage is 3D"),
        ("columns", STAGES, {"companion": False}, ""),
        ("points", [], {}, "companion = true makes one"),
        ("points", [], {"companion": True}, ""),
    ],
)
def test_a_run_that_states_no_error_by_default_says_so(solver, stages, given, words):
    numerics = SimpleNamespace(companion=given.get("companion"))
    solvers = {stage["solver"] for stage in stages} or {solver}
    found = without_companion(SimpleNamespace(numerics=numerics, solvers=solvers, stage=stages))
    assert words in found and bool(found) == bool(words)


def test_the_errors_of_one_of_many_runs_say_of_which():
    one = {"value": 10.0, "larger_cells": 12.0, "error": 2.5}
    made = {"cell_size": 20.0, "numbers": {"speed_max": one}, "of": "member 3"}
    assert error_words(made) == "largest speed 10 +- 2.5 m/s (member 3)"
    assert error_words({"failed": "there was no flow", "of": "member 3"}) == ""


@pytest.mark.parametrize("share", [0.0, 0.001, 0.05, 0.4])
def test_the_error_of_a_run_that_hardly_converges_names_smaller_cells(share):
    error = stated_error("speed_max", 20.0, 20.0 * (1.0 + share), 5.0)
    assert error == pytest.approx(20.0 * max(SAFETY * share, LEAST_SHARE))
    assert stated_error("runout", 100.0, 100.0, 5.0) == LEAST_CELLS * 5.0
    made = {"cell_size": 10.0, "numbers": {"speed_max": {"value": 20.0, "larger_cells": 21.0, "error": error}}}
    more = {"largest_share": 0.4, "smaller": {"cell_size": 1.2, "seconds": 7200.0}}
    assert len(companion_lines(made | {"smaller": None})) == 1
    assert companion_lines(made | more)[-1].startswith(
        "numerical errors of up to 40 %: for 10 % cells of about 1.2 m are needed, 2.0 h of steps"
    )


def test_numbers_are_printed_without_exponents():
    one = {"value": 123456789.0, "larger_cells": 2e8, "error": 77e6}
    lines = error_lines({"cell_size": 20.0, "numbers": {"volume_at_end": one}})
    assert lines == [
        "volume at the end 123500000 m3; with cells of 20 m 200000000 m3; numerical error about 77000000 m3"
    ]


@pytest.mark.parametrize(
    "damaged",
    [
        {},
        {"numbers": []},
        {"numbers": {"runout": 3.0}, "cell_size": 1.0},
        {"numbers": {"runout": {"value": 1.0}}, "cell_size": 1.0},
        {"numbers": {"runout": {"value": 1.0, "larger_cells": None, "error": 1.0}}, "cell_size": 1.0},
        {"numbers": {"runout": {"value": 1.0, "larger_cells": 2.0, "error": 1.0}}, "cell_size": "1"},
    ],
)
def test_a_damaged_record_has_no_errors(damaged):
    assert error_words(damaged) == "" and len(error_lines(damaged)) == bool(damaged)


@pytest.mark.parametrize("head", ['solver = "points"', ""])
def test_a_companion_that_has_nothing_to_compare_is_refused(tmp_path, capsys, head):
    scene = slide(8.0, 2, 1, head=head, more="companion = true")
    stages = "" if head else '[[stage]]\nsolver = "columns"\nuntil = {time = 1}\n[[stage]]\nsolver = "points"\n'
    assert run(write_block_site(tmp_path), scene + stages) == 2
    assert "companion = true" in capsys.readouterr().err


@pytest.mark.thorough
def test_a_3d_run_has_a_companion_on_request(tmp_path, capsys):
    scene = slide(8.0, 2, 1, more="companion = true") + "maxima = true\n"
    assert run(write_block_site(tmp_path), scene) == 0
    said = capsys.readouterr().err
    assert said.index("a companion run on cells of 16 m follows, of about 6 % of the time of the steps") < said.index(
        "ended"
    )
    assert json.loads((tmp_path / "results" / "run.json").read_text())["companion"]["numbers"]["runout"]["value"] > 0.0
