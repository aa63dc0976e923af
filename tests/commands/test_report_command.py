"""`mpmgis report`: one self-contained file with the results of the run and its frames."""

import base64
import json
import re
from html.parser import HTMLParser

import pytest
from block_frames import write_block_run, write_line
from slope_site import SCENE, run, write_site

from mpmgis.commands.shell.main import main
from mpmgis.results.reports.printed_numbers import printed_line

EMPTY = {"meta", "img", "br", "link", "input"}


class Reader(HTMLParser):
    """Collects text and pictures; fails on what is not closed, on scripts and on anything from elsewhere."""

    def __init__(self, text):
        super().__init__()
        self.open, self.pictures, self.texts, self.titles = [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        assert tag not in ("script", "link", "iframe", "object")
        for name, value in attributes:
            assert name not in ("href", "onload") and not name.startswith("on")
            if name == "src":
                kind, data = value.split(",", 1)
                assert kind == "data:image/png;base64"
                self.pictures.append(base64.b64decode(data, validate=True))
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)
        if self.open and self.open[-1] == "h2":
            self.titles.append(data)

    @property
    def text(self):
        return "\n".join(text for text in self.texts if text.strip())


def report(*arguments):
    """Write a report without the player, which test_report_player.py tests."""
    assert main(["report", "--no-player", *map(str, arguments)]) == 0


def test_the_report_of_a_run_is_complete(tmp_path, capsys):
    site = write_site(tmp_path)
    assert run(site, SCENE.replace("end_time = 30", "end_time = 10")) == 0
    at_its_end = capsys.readouterr().err
    report(site / "results", "--title", "Scenario <300> & more", "--author", "A & B", "--date", "2026-01-31")
    assert capsys.readouterr().out == f"{site / 'results_report' / 'report.html'}\n"
    page = Reader((site / "results_report" / "report.html").read_text(encoding="utf-8"))
    assert page.titles == [
        "Warnings",
        "Result",
        "Maps",
        "Places",
        "Runout",
        "Numerical error",
        "Balances",
        "Effects, and why",
        "Parameters",
        "Origin",
    ]
    assert len(page.pictures) == 6 and all(png.startswith(b"\x89PNG") for png in page.pictures)
    assert "Scenario <300> & more" in page.text and "date: 2026-01-31; author: A & B\n" in page.text
    assert not re.search(r"\d[eE][+-]\d", page.text.split("Effects, and why")[0]) and "1000 kg/m³" in page.text
    mass = next(line for line in at_its_end.splitlines() if line.startswith("mass: "))
    assert printed_line(mass) in page.text  # in the same words as the run's
    record = json.loads((site / "results" / "run.json").read_text())
    for words in (record["result_digest"], record["reason"], "Voellmy: mu = 0.2", "mu = 0.2\n", "energy line angle"):
        assert words in page.text, words


def test_frames_without_a_run_have_a_report_too(tmp_path):
    folder = write_block_run(tmp_path)
    report(folder, "--line", write_line(tmp_path / "line.gpkg"), "-o", tmp_path / "r.html")
    page = Reader((tmp_path / "r.html").read_text(encoding="utf-8"))
    assert "no run.json beside the frames" in page.text and "Effects, and why" not in page.titles
    rows = re.findall(r"centre of mass tangent\n([\d.]+)", page.text)
    assert float(rows[0]) == pytest.approx(0.25, rel=1e-4)


def test_an_effect_that_is_off_against_its_number_is_a_warning(tmp_path):
    folder = write_block_run(tmp_path)
    decision = {"effect": "flight_3d", "state": "off", "decided_by": "auto", "indicator": 2.5, "threshold": 1.0}
    decision["reason"] = "flies"
    quiet = decision | {"effect": "curvature", "indicator": 0.01}
    (folder / "run.json").write_text(json.dumps({"effects": [decision, quiet], "troubles": ["it <broke> once"]}))
    report(folder, "-o", tmp_path / "r.html")
    page = Reader((tmp_path / "r.html").read_text(encoding="utf-8"))
    warnings = page.text.split("Warnings\n")[1].split("Result\n")[0]
    assert "flight_3d is off although its number 2.5 is beyond 1: flies" in warnings
    assert "it <broke> once" in warnings and "curvature" not in warnings


def test_a_flow_that_went_nowhere_has_a_report_without_runout(tmp_path):
    folder = write_block_run(tmp_path, places=(150.0,), times=(0.0,))
    report(folder, "--threshold", 50, "-o", tmp_path / "r.html")
    page = Reader((tmp_path / "r.html").read_text(encoding="utf-8"))
    assert "Runout" not in page.titles and "no runout: " in page.text


def test_refusals_are_one_line_and_leave_nothing(tmp_path, capsys):
    folder = write_block_run(tmp_path)
    assert main(["export-raster", str(folder), "--no-qgis"]) == 0
    broken = tmp_path / "broken"
    broken.mkdir()
    other = write_block_run(broken)
    (other / "run.json").write_text("{ not json")
    for arguments, words in (
        ((tmp_path / "run_gis", "--cs-e", 5), "--cs-e requires frames"),
        ((other,), "run.json cannot be read"),
        ((folder, "-o", tmp_path / "r.pdf"), "expected .html"),
        ((folder, "--line", tmp_path / "none.gpkg"), "no such file"),
    ):
        capsys.readouterr()
        assert main(["report", *map(str, arguments)]) == 2
        said = capsys.readouterr().err.splitlines()
        assert len(said) == 1 and words in said[0], said
    assert not (tmp_path / "run_report").exists() and not (broken / "run_report").exists()


@pytest.mark.parametrize(
    ("record", "words"),
    [
        ({"balances": [1, 2]}, "balances is not a table"),
        ({"effects": 3}, "effects is not a list"),
        ({"stages": [{"effects": [3]}]}, "effects has an entry that is not a table"),
        ({"scene": [1]}, "scene is not a table"),
        ([1, 2], "it is not a table"),
        ({}, "it is empty"),
    ],
)
@pytest.mark.parametrize("verb", ["report", "info"])
def test_a_record_that_no_run_wrote_is_refused(tmp_path, capsys, record, words, verb):
    folder = write_block_run(tmp_path)
    (folder / "run.json").write_text(json.dumps(record))
    assert main([verb, str(folder)]) == 2
    out, err = capsys.readouterr()
    assert not out and len(err.splitlines()) == 1 and f"run.json was not written by a run: {words}; remove it" in err


def test_a_record_and_a_scene_that_are_damaged_within_have_a_report(tmp_path):
    folder = write_block_run(tmp_path)
    record = {"balances": {"mass_start": "x"}, "effects": [{}], "stages": None, "wall_seconds": "1"}
    (folder / "run.json").write_text(json.dumps(record))
    (folder / "scene.toml").write_bytes(b"solver = '\xff'")
    report(folder, "-o", tmp_path / "r.html")
    assert "solver = '\ufffd'" in Reader((tmp_path / "r.html").read_text(encoding="utf-8")).text


def test_balances_of_another_version_are_shown_unchanged(tmp_path):
    folder = write_block_run(tmp_path)
    (folder / "run.json").write_text(json.dumps({"balances": {"mass_start": 5.0, "momentum_error_relative": 0.0}}))
    report(folder, "-o", tmp_path / "r.html")
    page = Reader((tmp_path / "r.html").read_text(encoding="utf-8"))
    assert "of another version of mpmgis" in page.text and "mass_start: 5" in page.text
