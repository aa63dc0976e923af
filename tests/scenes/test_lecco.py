"""MOX report 15/2025, 4.4.2, through `mpmgis run` (V24 of the catalogue)."""

import numpy as np
import pytest
from chain import frames, record, scene_module

lecco = scene_module("lecco")
SMALL = lecco.Size(per_cell=16, points=2.0)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The scene with 3600 columns and cells of 2 m, 3D for 5 s."""
    folder = tmp_path_factory.mktemp("lecco") / "small"
    lecco.make(folder, SMALL, end_time=35)
    return folder


def test_the_site_is_the_papers():
    """Volume 5.8e3 m3 within 2 %, slopes up to 60 to 68 degrees, an L 100 m long in the printed box."""
    height = lecco.ground()
    assert height.shape == (200, 150)
    thickness = lecco.SHARE * np.mean(height[_inside(height.shape)])
    assert thickness * lecco.release().area == pytest.approx(5.8e3, rel=0.02)
    assert lecco.release().area == pytest.approx(1405.0, abs=1.0)
    down, right = np.gradient(height, lecco.PIXEL)
    assert 60.0 < np.degrees(np.arctan(np.hypot(down, right)).max()) < 68.0
    west, south, east, north = lecco.barrier().bounds
    assert lecco.BOX[0] < west and east < lecco.BOX[1] and lecco.BOX[2] < south and north < lecco.BOX[3]
    assert lecco.ARM[1] - lecco.ARM[0] + lecco.RETURN == 100.0
    distance, left = lecco.along(*lecco.on_map(40.0, -7.0))
    np.testing.assert_allclose((distance, left), (40.0, -7.0))
    assert 100.0 < lecco.foot() < 150.0


def _inside(shape):
    row, column = np.mgrid[0 : shape[0], 0 : shape[1]]
    x, y = (column + 0.5) * lecco.PIXEL, lecco.NORTH - (row + 0.5) * lecco.PIXEL
    return (y - 550.0) ** 2 / 4.0 + (x - 420.0) ** 2 / 5.0 <= 100.0


def check_run(folder, cell):
    """V24: volume, mass and momentum over the switch, all mass accounted for, pressure of the order of rho v^2."""
    run, found = record(folder), lecco.summary(folder, cell)
    switch, mass = run["stages"][0]["switch"], run["mass"]
    assert mass["released"] / lecco.DENSITY == pytest.approx(5.8e3, rel=0.02)
    assert abs(switch["mass_error_relative"]) <= 1e-12 and switch["momentum_error_relative"] <= 1e-12
    assert abs(mass["error_relative"]) <= 1e-12 and run["balances"]["momentum_error_relative"] <= 1e-10
    assert mass["outside_windows"] < 0.1 * mass["released"]
    for frame in frames(folder):
        assert np.isfinite(frame.particles.position).all() and np.isfinite(frame.particles.velocity).all()
    assert 15.0 < found["front speed, largest before the barrier [m/s]"] < 25.0
    assert 0.1 < found["pressure on 2 x 1 m [MPa]"] < 2.0
    assert found["force, mean of 1 s [MN]"] <= found["force, mean of 0.1 s [MN]"] <= found["force, single step [MN]"]
    return run, found


@pytest.mark.thorough
def test_mud_runs_up_the_barrier(small):
    """Columns for 30 s, then points in the box: what each switch and the run keep, and what the barrier takes up."""
    run, found = check_run(small, SMALL.points)
    assert run["stages"][0]["time"] == 30.0
    assert found["over it [t]"] + found["past its open end [t]"] < 0.02 * lecco.DENSITY * 5.8
    load = lecco.load_of(small)
    assert load.time[np.argmax(load.force > 0.0)] == pytest.approx(31.0, abs=1.0)


@pytest.mark.slow
def test_the_whole_size(tmp_path):
    """72 800 columns, 560 000 points, 38 s, as the paper has them."""
    lecco.make(tmp_path / "whole", frame_interval=0.2)
    _, found = check_run(tmp_path / "whole", lecco.Size().points)
    assert found["points"] == pytest.approx(5.6e5, rel=0.25)
