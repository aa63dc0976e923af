"""MOX report 15/2025, 4.4.1, through `mpmgis run` (V23 of the catalogue)."""

import numpy as np
import pytest
from chain import FORCE, frames, loads, record, scene_module

pytestmark = pytest.mark.thorough

wall = scene_module("wall")
SMALL = wall.Size(width=0.4, cell=0.1)


@pytest.fixture(scope="module")
def free(tmp_path_factory):
    """The channel without its wall, columns until T = 3 s."""
    folder = tmp_path_factory.mktemp("wall") / "free"
    wall.make_free(folder, SMALL)
    return folder


def test_columns_slide_as_water_does(free):
    """Bulk 6.6 m/s at 3 s (asked 0.2), front at 20 m at 2.0 s (asked 0.2), both as finite volumes have them."""
    slide, exact = wall.slide_of(free, SMALL.width), wall.slide_by_finite_volumes(np.arange(1, 61) * 0.05)
    assert abs(record(free)["balances"]["mass_error_relative"]) <= 1e-12
    assert slide.speed[-1] == pytest.approx(6.6, abs=0.2)
    assert slide.speed[-1] == pytest.approx(exact.speed[-1], rel=0.015)
    assert slide.arrival() == pytest.approx(2.0, abs=0.2)
    assert slide.arrival() == pytest.approx(exact.arrival(), abs=0.1)
    assert slide.past[-1] == pytest.approx(exact.past[-1], abs=0.02)


def test_the_papers_numbers_are_those_of_a_block():
    """Without friction a rigid block from x = 5 m is at the wall at 3.59 s; all the head there is makes 7.45 m/s."""
    time, place = wall.rigid_front()
    assert time[-1] == pytest.approx(3.59, abs=0.01) and place[-1] == wall.WALL
    assert pytest.approx(7.45, abs=0.01) == wall.BERNOULLI


def check_impact(folder, least):
    """V23: mass, momentum, run-up of the 2 % wettest height at most 9.7 m; the wall takes more than still water."""
    balances = record(folder)["balances"]
    assert abs(balances["mass_error_relative"]) <= 1e-12 and abs(balances["momentum_error_relative"]) <= 1e-10
    impact, (time, force) = wall.impact_of(folder), loads(folder, *FORCE)
    assert least < impact.run_up.max() <= 9.7
    assert impact.volume.max() <= 1.0 and impact.volume.min() > 0.99
    assert np.all(np.diff(impact.energy) < 1e-3 * impact.energy[0])  # no blow gives energy
    return impact, time, force


def test_water_runs_up_the_wall(tmp_path):
    """Columns, then 3D: the force is the momentum that shallow water brings (0.97, 0.98) before it falls back."""
    wall.make_wall(tmp_path / "wall", SMALL, end_time=3.0)
    impact, time, force = check_impact(tmp_path / "wall", least=7.9)
    assert impact.run_up[0] < 7.0
    x, lines = wall.finite_volumes((2.45, 2.6))
    for line in lines:
        flux = np.interp(wall.WALL, x, line.depth * (line.speed**2 + 0.5 * wall.GRAVITY * line.depth))
        mean = force[(time > line.time - 0.1) & (time < line.time + 0.1)].mean()
        assert mean == pytest.approx(wall.DENSITY * flux * SMALL.width, rel=0.15)


def test_the_scene_as_printed_leaves_out_what_has_passed(tmp_path, free):
    """3D from T = 3 s: a quarter of the water is past the wall's place by then and is told of."""
    run = wall.make_printed(tmp_path / "printed", free, SMALL, end_time=0.6)
    kept = run["balances"]["mass_start"] / record(free)["balances"]["mass_start"]
    assert 0.70 < kept < 0.78
    check_impact(tmp_path / "printed", least=7.9)


@pytest.mark.slow
def test_the_whole_size(tmp_path):
    """71 680 columns as the paper has them, some 670 000 points where it has 503 000."""
    run = wall.make_wall(tmp_path / "wall", wall.Size())
    *_, last = frames(tmp_path / "wall")
    assert run["particles"] == 71_680 and len(last.particles) >= 400_000
    check_impact(tmp_path / "wall", least=8.5)
