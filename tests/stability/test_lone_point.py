"""The time step of a single point, which oscillates faster than waves cross cells (found by `test_random_scenes`)."""

import numpy as np
import pytest
from hard_scenes import STEPPING, Watch, points_on, terrain_of
from point_scenes import block_of
from scene_strategies import Box, Ground, PointScene

from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import drucker_prager, fluid
from mpmgis.solvers.points.point_numerics import LONE_SHARE, PointNumerics, courant_number

SOIL = drucker_prager(2e5, 1.2e5, 0.0, 1e6)


def gained(material, cfl):
    """Largest share of its energy that a point on a gentle slope gains in a second."""
    terrain = terrain_of(lambda x, y: 5.0 - 0.087 * x, 40.0, 20.0, 1.0)
    point = block_of((0.5, 0.5, 0.5), 0.5, (10.3, 10.1, 5.0 - 0.087 * 10.3))
    solver = points_on(terrain, point, 1.0, material, friction_law("Coulomb", 0.0), cfl=cfl)
    start, most = sum(solver.energy_start), -np.inf
    for time in np.linspace(0.02, 1.0, 50):
        solver.advance(time)
        most = max(most, -solver.balances()["energy_lost"] / start)
    return most


@pytest.mark.parametrize("shear_modulus", [1.2e5, 1e4])
def test_the_highest_courant_number_makes_no_energy(shear_modulus):
    """Measured at a Courant number of 0.9: 5e-4; without the limit 0.3 (G = 0.6 K), 2.6 (G = 0.05 K) of the energy."""
    assert gained(SOIL._replace(shear_modulus=shear_modulus), 0.9) <= STEPPING


@pytest.mark.parametrize("precision", ["float64", pytest.param("float32", marks=pytest.mark.thorough)])
def test_steps_of_changing_length_make_no_energy(precision):
    """A point that slides on rough ground, with shorter steps at 24 frames: at 0.95 of the limit it gained 1.1 %."""
    ground = Ground("rough slope", 68.0, 5.281555225472457, 2.0, 0.21746847238858066, 127, 40.0, 20.0)
    box = Box(0.21746847238858066, 0.21746847238858066, 0.0, 0.0, 0.5, 2, 3.0, 0.21746847238858066)
    watch = Watch(PointScene(ground, box, 0.1, 0.9, "wall", 1.0, 5.0, 1e3, 0.0, precision).solver())
    watch.march(1.2, looks=24)
    assert watch.gain <= 0.0


def test_the_limit_is_that_of_the_lone_swing():
    """dx / sqrt(max(3 K, 2 G) / rho) over dx / c_p; a smaller requested Courant number is used unchanged."""
    numerics = PointNumerics(1.0, cfl=0.9)
    assert courant_number(fluid(1e6, 0.0, 0.0), numerics) == pytest.approx(LONE_SHARE / np.sqrt(3.0))
    assert courant_number(SOIL, numerics) == pytest.approx(LONE_SHARE * np.sqrt(3.6 / 6.0))
    assert courant_number(SOIL, PointNumerics(1.0, cfl=0.4)) == 0.4
