"""`mpmgis report`: a page for each barrier, and one of places; figures against the files of the run."""

import csv
import json
import re
import warnings
from dataclasses import replace

import matplotlib.image
import numpy as np
import pytest
import shapely
from slope_site import SCENE, SOUTH, WEST, run, write_shapes, write_site
from test_report_command import Reader

from mpmgis.commands.shell.main import main
from mpmgis.frames.load_table import read_barrier_table
from mpmgis.results.barrier_loads import BarrierHistory, RunUp, history_rows, load_verdict, missed_crest
from mpmgis.results.load_plots import write_history_plot, write_section_plot
from mpmgis.results.reports.printed_numbers import THIN, grouped, printed

DAM = '[[barrier]]\nsource = "dam.gpkg"\nwidth = 2\nheight = 3\n'
RUN_UP = RunUp(4.0, 0.0, 0.0, 2.0, 1, 104.0, 103.0, 2.0)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    site = write_site(tmp_path_factory.mktemp("dam"))
    write_shapes(site / "dam.gpkg", [shapely.LineString([(450, 100), (450, 300)])])
    assert run(site, SCENE + DAM) == 0
    return site


@pytest.fixture(scope="module")
def page(site):
    return page_of(site)


def page_of(site, *options):
    assert main(["report", "--no-player", str(site / "results"), "--overwrite", *options]) == 0
    return Reader((site / "results_report" / "report.html").read_text(encoding="utf-8"))


def figures(page, title):
    """Figure -> value of the table under a heading."""
    text = page.text[page.text.index(f"\n{title}\n") :]
    found = re.findall(r"\n([^\n]+)\n([-.\d\u202f]+) (?:kN|kg|m³|m|s)\b", text)
    return {what: value.replace(THIN, "") for what, value in found}


def test_a_barrier_has_its_page(site, page):
    assert page.titles.count("Barrier dam") == 1 and "loads are estimates of a depth-averaged run" in page.text
    found = figures(page, "Barrier dam")
    with open(site / "results" / "barriers.csv", newline="") as handle:
        rows = list(csv.DictReader(handle))
    taken = json.loads((site / "results" / "run.json").read_text())["balances"]["barriers"]["dam"]
    largest = max(float(row["mean normal force [N]"]) for row in rows)
    assert float(found["largest mean force between two frames, normal to the wall"]) == pytest.approx(
        largest / 1e3, rel=5e-3
    )
    assert float(found["largest force of a single step"]) == pytest.approx(taken["peak_normal_force"] / 1e3, rel=5e-3)
    over = taken["overtopped_mass"]
    assert over > 0 and float(found["mass that overtopped it"]) == pytest.approx(over, rel=5e-3)
    assert float(found["volume of that at the density of the release"]) == pytest.approx(over / 1000.0, rel=5e-3)
    surface = float(found["elevation of the surface there (run-up)"])
    depth = float(found["largest flow depth at the wall, normal to the bed"])
    assert float(found["elevation of the crest there"]) == 103.0  # 3 m over the flat at 100 m
    assert surface == pytest.approx(100.0 + depth, abs=0.01)
    assert float(found["crest above the surface (freeboard)"]) == pytest.approx(103.0 - surface, abs=0.01)
    assert sum(picture[:4] == b"\x89PNG" for picture in page.pictures) == len(page.pictures) >= 8


def test_without_its_polygons_a_barrier_has_its_loads_but_no_drawing(site, page):
    whole = len(page.pictures)
    (site / "dam.gpkg").rename(site / "gone.gpkg")
    try:
        page = page_of(site)
    finally:
        (site / "gone.gpkg").rename(site / "dam.gpkg")
    assert "Barrier dam" in page.titles and "its polygons are not there" in page.text
    assert len(page.pictures) == whole - 2


def test_places_have_coordinates_and_times(site, page):
    assert "Places" in page.titles
    one = json.loads((site / "results" / "run.json").read_text())["extremes"]["speed"]
    east, north = (grouped(place, 1) for place in one["at"])
    wanted = f"{printed(one['value'])} m/s\n{east}\n{north}\n{one['time']:.1f}"
    assert f"largest speed of any step\n{wanted}" in page.text


def test_places_name_where_mass_left(tmp_path):
    site = write_site(tmp_path)
    write_shapes(site / "release.geojson", [shapely.box(650, 150, 750, 250)])
    assert (
        run(site, SCENE.replace("thickness = 2.0", "thickness = 2.0\nvelocity = [20, 0]").replace("= 30", "= 8")) == 0
    )
    place = json.loads((site / "results" / "run.json").read_text())["balances"]["left_places"][0]
    assert place["where"] == "east" and place["mass"] > 0
    text = page_of(site).text
    row = text[text.index("mass left over the east edge of the DTM") :].split("\n")
    assert row[1].startswith(f"{printed(place['mass'])} kg")
    assert row[2:4] == [grouped(place["east"], 1), grouped(place["north"], 1)]
    assert WEST + 790 <= place["east"] <= WEST + 810 and SOUTH + 150 < place["north"] < SOUTH + 250


def history(solver="points", cell=0.5, kept=True, **more):
    columns = {
        "time [s]": np.array([0.0, 1.0, 2.0]),
        "mean normal force [N]": np.array([0.0, 4e3, 1e3]),
        "largest normal force of a step so far [N]": np.array([0.0, 6e3, 6e3]),
        "normal impulse [N s]": np.array([0.0, 4e3, 5e3]),
        "impulse east [N s]": np.array([0.0, 3e3, 3e3]),
        "impulse north [N s]": np.array([0.0, 4e3, 4e3]),
        "overtopped mass [kg]": np.array([0.0, 0.0, 50.0]),
    }
    return BarrierHistory("dam", solver, columns | more, cell, kept)


def test_the_verdict_follows_cells_solver_and_volume():
    assert load_verdict(history(cell=0.5), RUN_UP).startswith("loads are usable: 4 cells of 0.5 m")
    assert load_verdict(history(cell=2.0), RUN_UP).startswith("loads are not usable: 1 cells of 2 m")
    assert "lost their volume" in load_verdict(history(kept=False), RUN_UP)
    assert "estimates" in load_verdict(history("columns"), RUN_UP)
    nothing = dict.fromkeys(("mean normal force [N]", "normal impulse [N s]"), np.zeros(3))
    assert "no load" in load_verdict(history(**nothing), None)


def test_a_barrier_that_was_loaded_between_two_frames_is_not_called_unloaded():
    said = load_verdict(history(), None)
    assert "no load" not in said and "loads are not usable" in said and "frame_interval" in said


def test_a_freeboard_above_an_overtopped_crest_is_called_too_favourable():
    low = replace(RUN_UP, surface=102.5)
    assert "too favourable" in missed_crest(history(), low)
    dry = history(**{"overtopped mass [kg]": np.zeros(3)})
    assert missed_crest(history(), RUN_UP) == missed_crest(dry, low) == missed_crest(history(), None) == ""


def test_flow_that_stays_before_a_wall_does_not_load_it(tmp_path):
    """The release rests 15 m above a dam on the slope: its surface is higher than the crest, because the ground is."""
    site = write_site(tmp_path)
    write_shapes(site / "dam.gpkg", [shapely.LineString([(190, 100), (190, 300)])])
    assert run(site, SCENE.replace("mu = 0.2", "mu = 2.0").replace("= 30", "= 6") + DAM) == 0
    text = page_of(site).text
    assert "the flow did not come to it: no load" in text and "freeboard" not in text


def test_the_flow_behind_a_wall_is_no_run_up(site, page):
    """The dam of the site is overtopped: its run-up is west of it, where the flow comes from."""
    text = page.text[page.text.index("\nBarrier dam\n") :]
    east = float(re.search(r"\nat\nE ([\d.]+) N", text)[1])
    assert WEST + 400 < east < WEST + 450


def test_a_freeboard_on_a_slope_is_not_known():
    steep = replace(RUN_UP, rise=1.6, wall=3.0)
    rows = {name: value for name, value, _ in history_rows(history(), steep, 1000.0)}
    assert "1.6 m above" in rows["crest above the surface (freeboard)"]
    assert missed_crest(history(), replace(steep, surface=102.0)) == ""
    rows = {name: value for name, value, _ in history_rows(history(), replace(steep, rise=-1.4), 1000.0)}
    assert rows["crest above the surface (freeboard)"] == -1.0


def test_figures_of_a_known_history():
    moments = {
        f"mean moment {axis} [N m]": np.array(values)
        for axis, values in (("east", [0.0, 3e3, 0.0]), ("north", [0.0, 4e3, 1e3]), ("up", [0.0, 0.0, 0.0]))
    }
    known = history(**moments)
    rows = history_rows(known, RUN_UP, 2000.0)
    values = {what: value for what, value, _ in rows}
    assert values["largest mean moment about the foot"] == 5.0 and known.direction.tolist() == [0.6, 0.8]
    assert known.overtopping() == (50.0, 2.0)
    assert values["volume of that at the density of the release"] == 0.025
    assert values["crest above the surface (freeboard)"] == -1.0


def test_a_table_that_is_none_is_refused(tmp_path):
    from mpmgis.system.errors import FormatError

    (tmp_path / "b.csv").write_text("a,b\n1,2\n")
    with pytest.raises(FormatError, match="not a table of barriers"):
        read_barrier_table(tmp_path / "b.csv")


def test_a_long_name_stays_on_its_plot(tmp_path):
    name = "the dam above the village with a name that is longer than the section through it, by far"
    along = np.linspace(-10.0, 10.0, 50)
    write_section_plot(tmp_path / "s.png", name, along, 0 * along, {"surface": 0 * along + 1}, abs(along) < 1, 3.0)
    write_history_plot(tmp_path / "h.png", replace(history(), name=name * 2))
    for file in ("s.png", "h.png"):
        right = matplotlib.image.imread(tmp_path / file)[:, -3:, :3]
        assert (right == 1.0).all(), file


def test_letters_that_the_font_of_plots_lacks_give_no_warning(site, capfd):
    scene = SCENE.replace("end_time = 30", "end_time = 5") + DAM + 'name = "\u5821"\n'
    assert run(site, scene, "-o", str(site / "letters")) == 0
    capfd.readouterr()
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        assert main(["report", "--no-player", str(site / "letters"), "-q"]) == 0
    assert capfd.readouterr().err == ""


def test_a_name_of_two_lines_is_refused(site, capsys):
    write_shapes(site / "lines.gpkg", [shapely.box(450, 100, 460, 300)], name=["a\nb"])
    scene = SCENE + DAM.replace("dam.gpkg", "lines.gpkg").replace("width = 2\n", "")
    assert run(site, scene, "-o", str(site / "lines")) == 2
    assert "lines.gpkg: feature 1 has the name 'a\\nb' with control characters; rename it" in capsys.readouterr().err
