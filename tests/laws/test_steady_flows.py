"""Laws through the solver on a plane: terminal speeds, and no motion at all.

Those of Voellmy and of Bingham are V19, in `test_columns_exact.py` and `test_columns_catalogue.py` of the solvers.
"""

import numpy as np
import pytest
from column_scenes import G, columns_of, solver_on, terrain_of

from mpmgis.laws.friction import basal_stress, friction_law

DENSITY, CELL = 1500.0, 5.0


def slab_speed(law, degrees, time, length=200.0, run=600.0, density=DENSITY):
    """(speed, normal thickness) in the middle of a slab 1 m thick that slides down a plane from rest."""
    tan, cos = np.tan(np.radians(degrees)), np.cos(np.radians(degrees))
    terrain = terrain_of(lambda x, y: -tan * x, run, 4 * CELL, CELL)
    frame = columns_of(1.0 / cos, 20, 20 + length, 0, 4 * CELL, CELL / 2, density=density)
    solver = solver_on(terrain, frame, CELL, law, density=density, edges="wall")
    solver.advance(time)
    p = solver.frame().particles
    x = p.position[:, 0]
    middle = np.abs(x - np.median(x)) < 10
    return float(np.linalg.norm(p.velocity[middle], axis=1).mean()), float(p.thickness[middle].mean() * cos)


@pytest.mark.thorough
def test_pouliquen():
    theta = np.radians(25.0)
    mu1, mu2, beta, length = np.tan(np.radians(21.0)), np.tan(np.radians(31.0)), 0.136, 0.05
    law = friction_law("Pouliquen", mu1, mu2, beta, length)
    speed, depth = slab_speed(law, 25.0, 25.0)
    scale = beta * depth * np.sqrt(G * np.cos(theta) * depth) / length
    exact, dt = 0.0, 1e-3  # of a point; after 25 s it is 7 % below its terminal speed
    for _ in range(25000):
        mu = mu1 + (mu2 - mu1) * exact / (exact + scale)
        exact += dt * G * np.cos(theta) * (np.tan(theta) - mu)
    assert speed == pytest.approx(exact, rel=0.01)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "law, degrees, density, time, run",
    [
        (friction_law("ModifiedVoellmy", 0.15, 500.0, 4.0), 20.0, 1500.0, 25.0, 700.0),
        (friction_law("SamosAT", 0.155), 25.0, 200.0, 25.0, 1000.0),
        (friction_law("VoellmyMinShear", 0.155, 1000.0, 70.0), 25.0, 200.0, 30.0, 1200.0),
        (friction_law("OBrien", 300.0, 20.0, 500.0, 0.05), 10.0, 1900.0, 12.0, 600.0),
        (friction_law("HerschelBulkley", 200.0, 1200.0, 0.5), 10.0, 1900.0, 16.0, 600.0),
        (friction_law("Manning", 0.05, 0.1), 10.0, 1900.0, 30.0, 600.0),
    ],
    ids=lambda value: str(value) if isinstance(value, tuple) else "",
)
def test_the_solver_reaches_the_steady_speed_of_a_law(law, degrees, density, time, run):
    """That at which the stress of the law carries the weight (`test_friction_laws` has its value by other means)."""
    speed, depth = slab_speed(law, degrees, time, 300.0, run, density)
    angle = np.radians(degrees)
    weight = density * G * depth
    drive = weight * np.sin(angle)
    faster = basal_stress(law, density, G, weight * np.cos(angle), depth, 1.005 * speed)
    slower = basal_stress(law, density, G, weight * np.cos(angle), depth, 0.995 * speed)
    assert slower < drive < faster, (speed, depth)


def moved(law, degrees):
    """Largest displacement [m] in 5 s of a layer 1 m thick that fills a plane from wall to wall."""
    tan, cos = np.tan(np.radians(degrees)), np.cos(np.radians(degrees))
    terrain = terrain_of(lambda x, y: -tan * x, 100.0, 4 * CELL, CELL)
    frame = columns_of(1.0 / cos, 0, 100, 0, 4 * CELL, CELL / 2, density=DENSITY)
    solver = solver_on(terrain, frame, CELL, law, density=DENSITY, edges="wall")
    solver.advance(5.0)
    after = solver.frame().particles
    order = np.argsort(after.id)
    return float(np.abs(after.position[order, :2] - frame.particles.position[:, :2]).max())


@pytest.mark.thorough
def test_bingham_does_not_move_below_its_yield_stress():
    driving = DENSITY * G * np.sin(np.radians(15.0))
    assert moved(friction_law("Bingham", float(1.01 * driving), 200.0), 15.0) == 0.0
    assert moved(friction_law("Bingham", float(0.9 * driving), 200.0), 15.0) > 1e-3


@pytest.mark.thorough
def test_pouliquen_does_not_move_on_slopes_below_mu1():
    law = friction_law("Pouliquen", float(np.tan(np.radians(21.0))), float(np.tan(np.radians(31.0))), 0.136, 0.05)
    assert moved(law, 20.9) == 0.0
    assert moved(law, 22.0) > 1e-3
