"""Runs without any motion report it: on the screen, in run.json, in the warnings of a report."""

import pytest
from slope_site import SCENE, record, run, slide, write_block_site

from mpmgis.commands.shell.main import main
from mpmgis.simulation.run_summary import stood_still

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


def test_columns_at_rest_give_one_warning_and_the_report_repeats_it(site, capsys):
    said, kept = told(site, capsys, SCENE.replace("mu = 0.2", "mu = 1.2"))
    assert len(said) == 1 and len(kept) == 1 and kept[0] in said[0]
    assert main(["report", str(site / "results"), "-o", str(site / "report.html"), "-q"]) == 0
    assert STILL in (site / "report.html").read_text(encoding="utf-8")


def test_a_flow_that_moves_gives_no_warning(site, capsys):
    assert told(site, capsys, SCENE) == ([], [])


@pytest.mark.thorough
def test_points_at_rest_give_a_warning_although_they_settle(site, capsys):
    assert [len(lines) for lines in told(site, capsys, HELD)] == [1, 1]


def test_stages_that_move_give_no_warning(site, capsys):
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
    small = balances | {"thickness_max": 0.01}  # the same speed is fast in a layer of 1 cm: 0.01 m/s and 0.3 mm at most
    assert bool(stood_still([small])) == (speed < 0.0125 and fall < 3e-4)
    assert bool(stood_still([balances | {"thickness_max": 2.0}])) == still
    unknown = {name: value for name, value in balances.items() if name != "kinetic_energy_peak"}
    assert stood_still([unknown]) == ""
