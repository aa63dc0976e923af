"""Runs in which nothing ever moves say so: on the screen, in run.json, in a report's warnings."""

import pytest
from slope_site import SCENE, record, run, slide, write_block_site

from mpmgis.analysis.run_summary import stood_still
from mpmgis.cli.main import main

STILL = "nothing ever moved"
HELD = slide(4.0, 2, 1, friction='law = "Sticking"')
HELD = HELD.replace("friction_angle = 35", "friction_angle = 35\ncohesion = 1e5")
STAGES = '[[stage]]\nsolver = "columns"\nuntil = {time = 1}\n[[stage]]\nsolver = "points"\n'


@pytest.fixture
def site(tmp_path):
    return write_block_site(tmp_path)


def told(site, capsys, scene):
    """(lines on the screen, troubles in run.json) that say that nothing moved."""
    capsys.readouterr()
    assert run(site, scene) == 0
    said = [line for line in capsys.readouterr().err.splitlines() if STILL in line]
    return said, [line for line in record(site)["troubles"] if STILL in line]


def test_columns_that_friction_holds_say_so_once_and_the_report_warns(site, capsys):
    said, kept = told(site, capsys, SCENE.replace("mu = 0.2", "mu = 1.2"))
    assert len(said) == 1 and len(kept) == 1 and kept[0] in said[0]
    assert main(["report", str(site / "results"), "-o", str(site / "report.html"), "-q"]) == 0
    assert STILL in (site / "report.html").read_text(encoding="utf-8")


def test_a_flow_that_moves_does_not_say_so(site, capsys):
    assert told(site, capsys, SCENE) == ([], [])


@pytest.mark.thorough
def test_points_that_stick_say_so_although_they_swing_as_they_settle(site, capsys):
    assert [len(lines) for lines in told(site, capsys, HELD)] == [1, 1]


def test_stages_that_move_do_not_say_so(site, capsys):
    assert told(site, capsys, slide(8.0, 2, 1, head="", friction='law = "Coulomb"\nmu = 0.2') + STAGES) == ([], [])


@pytest.mark.parametrize(
    ("speed", "fall", "still"),
    [(0.0, 0.0, True), (0.04, 0.02, True), (0.06, 0.0, False), (0.01, 0.2, False), (0.0, -0.001, True)],
)
def test_neither_creep_nor_a_jerk_is_rest(speed, fall, still):
    mass = 2000.0
    balances = {"mass_start": mass, "kinetic_energy_peak": 0.5 * mass * speed**2, "energy_lost": mass * 9.81 * fall}
    assert bool(stood_still([balances])) == still
    moved = balances | {"kinetic_energy_peak": mass}
    assert stood_still([balances, moved]) == stood_still([moved, balances]) == ""
    unknown = {name: value for name, value in balances.items() if name != "kinetic_energy_peak"}
    assert stood_still([unknown]) == ""
