"""Cohesion, earth pressure and in-plane viscosity through the solver against exact answers; one variant for all."""

import numpy as np
import pytest
from column_scenes import G, columns_of, node_thickness, relative_l1, solver_on, terrain_of

from mpmgis.laws.internal_stress import EarthPressure, InPlaneViscosity


def laws(cohesion=0.0, active=1.0, passive=1.0, viscosity=0.0):
    return {
        "cohesion": cohesion,
        "earth_pressure": EarthPressure(active, passive),
        "viscosity": InPlaneViscosity(viscosity, 0.0),
    }


def vortex_rate(viscosity, cell=1.0, time=40.0, **numerics):
    """(rate [s-1] at which a vortex in a square box dies, its solver): u = sin kx cos ky, v = -cos kx sin ky."""
    side = 40.0
    k = np.pi / side
    frame = columns_of(1.0, 0, side, 0, side, cell / 2)

    def shape(particles):
        x, y = particles.position[:, 0], particles.position[:, 1]
        return np.stack([np.sin(k * x) * np.cos(k * y), -np.cos(k * x) * np.sin(k * y)], 1)

    frame.particles.velocity[:, :2] = 1e-3 * shape(frame.particles)
    terrain = terrain_of(lambda x, y: 0 * x, side, side, cell)
    solver = solver_on(terrain, frame, cell, laws=laws(viscosity=viscosity), edges="wall", **numerics)
    amplitudes = []
    for until in (5.0, 5.0 + time):
        solver.advance(until)
        particles = solver.frame().particles
        mode = shape(particles)
        amplitudes.append((mode * particles.velocity[:, :2]).sum() / (mode**2).sum())
    return float(np.log(amplitudes[0] / amplitudes[1]) / time), solver


@pytest.mark.thorough
def test_a_shear_wave_dies_at_its_rate():
    """exp(-eta |k|^2 t / rho), |k|^2 = 2 (pi / 40 m)^2; the transfer's own decay is taken off."""
    own, _ = vortex_rate(0.0)
    rate, solver = vortex_rate(1000.0)
    exact = 2.0 * (np.pi / 40.0) ** 2
    assert own < 0.02 * exact
    assert rate - own == pytest.approx(exact, rel=0.01)
    assert solver.balances()["viscosity_capped_share_max"] == 0.0


@pytest.mark.thorough
def test_a_viscosity_beyond_the_time_step_is_cut_and_counted():
    rate, solver = vortex_rate(4000.0, time_step=0.1)
    assert solver.balances()["viscosity_capped_share_max"] == 1.0
    largest = 0.125 / 0.1  # dx^2 / (8 dt) [m2 s-1]
    assert rate == pytest.approx(largest * 2.0 * (np.pi / 40.0) ** 2, rel=0.03)


@pytest.mark.thorough
@pytest.mark.parametrize(("active", "passive"), [(0.4, 0.4), (2.0, 2.0), (0.4, 3.0), (0.7, 3.25)])
def test_a_granular_dam_breaks_as_ritters_with_the_active_push(active, passive):
    """It stretches everywhere, so that K_passive must not show."""
    cell, time = 1.0, 2.5
    terrain = terrain_of(lambda x, y: 0 * x, 100.0, 4 * cell, cell)
    frame = columns_of(5.0, 0, 50, 0, 4 * cell, cell / 4)
    solver = solver_on(terrain, frame, cell, laws=laws(active=active, passive=passive), edges="wall")
    solver.advance(time)
    x, _, h = node_thickness(solver)
    ray, wave = (x - 50.0) / time, np.sqrt(active * G * 5.0)
    exact = np.where(ray < -wave, 5.0, np.where(ray > 2 * wave, 0.0, (2 * wave - ray) ** 2 / (9 * active * G)))
    assert relative_l1(h.mean(axis=0), exact) <= 0.03


@pytest.mark.thorough
def test_a_pile_in_compression_is_pushed_by_the_passive_factor():
    """Where the flow is compressed everywhere, another K_active changes nothing."""

    def run(active):
        terrain = terrain_of(lambda x, y: 0 * x, 100.0, 20.0, 5.0)
        frame = columns_of(2.0, 0, 100, 0, 20, 2.5)
        frame.particles.velocity[:, 0] = -1.0 * (frame.particles.position[:, 0] - 50.0)
        solver = solver_on(terrain, frame, 5.0, laws=laws(active=active, passive=2.0), time_step=0.03)
        solver.advance(0.03)  # the columns learn their rate
        solver.advance(0.15)
        p = solver.frame().particles
        middle = np.abs(p.position[:, 0] - 50.0) < 20.0
        return p.velocity[middle]

    np.testing.assert_allclose(run(0.5), run(2.0), rtol=0.1, atol=0.2)


def cohesive_speed(stress, degrees=20.0, time=1.0):
    """(largest, middle) speed of a layer 1 m thick that fills a frictionless plane from wall to wall."""
    tan, cos = np.tan(np.radians(degrees)), np.cos(np.radians(degrees))
    terrain = terrain_of(lambda x, y: -tan * x, 100.0, 20.0, 5.0)
    frame = columns_of(1.0 / cos, 0, 100, 0, 20, 2.5)
    solver = solver_on(terrain, frame, 5.0, laws=laws(cohesion=float(stress)), edges="wall")
    solver.advance(time)
    p = solver.frame().particles
    speed = np.linalg.norm(p.velocity, axis=1)
    return speed.max(), speed[np.abs(p.position[:, 0] - 50.0) < 10.0].mean()


@pytest.mark.thorough
def test_cohesion_stops_flow_below_its_stress_and_slows_it_above():
    driving = 1000.0 * G * np.sin(np.radians(20.0))
    assert cohesive_speed(1.001 * driving)[0] == 0.0
    assert cohesive_speed(0.5 * driving)[1] == pytest.approx(0.5 * driving / 1000.0, rel=1e-3)
