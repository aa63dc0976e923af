"""The compiled 3D step against a plain loop over points and nodes."""

import numpy as np
import pytest
from plain_points import plain_step, yields_of
from point_scenes import block_of, plane, points_on, sorted_points

from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import FLUID, drucker_prager, elastic, fluid
from mpmgis.laws.material_choice import wave_speed
from mpmgis.laws.softening import Softening

MATERIALS = {
    "elastic": elastic(6.7e6, 4e6),
    "frictional": drucker_prager(6.7e6, 4e6, 35.0, 500.0),
    "fluid": fluid(1e6, 10.0, 0.0),
}
STEPS, DT, DX = 3, 2e-3, 1.0


def plain(solver, frame, material, mu, xi=0.0):
    """Places, velocities and stresses of the frame's points after STEPS plain steps."""
    place = frame.particles.position - solver._corner_from((0.0, 0.0, 0.0))
    n = len(place)
    velocity, affine = frame.particles.velocity.copy(), np.zeros((n, 3, 3))
    state, stress = np.zeros((n, 8)), np.zeros((n, 6))
    state[:, 0] = 1.0 if material.kind == FLUID else 0.0
    ground = solver._ground[..., :3]
    nodes = np.zeros((int(place[:, 2].max() / DX) + 14, *ground.shape[:2], 4))
    sound, yields = wave_speed(material, 1000.0), yields_of(solver)
    for _ in range(STEPS):
        plain_step(
            place,
            velocity,
            affine,
            frame.particles.mass,
            state,
            stress,
            nodes,
            ground,
            yields,
            DX,
            DT,
            1000.0,
            9.81,
            mu,
            material,
            Softening(),
            sound,
            xi,
        )
    return place, velocity


@pytest.mark.parametrize(
    ("material", "contact"),
    [
        (MATERIALS["elastic"], friction_law("Coulomb", 0.3)),
        (MATERIALS["frictional"], friction_law("Coulomb", 0.3)),
        pytest.param(MATERIALS["elastic"], friction_law("Voellmy", 0.3, 40.0), marks=pytest.mark.thorough),
        pytest.param(MATERIALS["fluid"], friction_law("Voellmy", 0.3, 400.0), marks=pytest.mark.thorough),
    ],
    ids=["elastic", "frictional", "drag", "fluid"],
)
def test_steps_equal_the_plain_loop(material, contact):
    """Relative errors of positions and velocities 1e-12 after three steps, on a slope with friction and with drag."""
    corner = (20.3, 5.2, 60.0 - 20.3 * np.tan(np.radians(30)))
    velocity = (4.0, -1.0, -2.0)
    frame = block_of((2.0, 1.5, 1.5), 0.5, corner, velocity=velocity, turned=np.radians(30))
    rng = np.random.default_rng(3)
    frame.particles.velocity[:] += rng.normal(size=frame.particles.velocity.shape)
    terrain = plane(30, length=40.0, width=12.0, height=60.0, pixel=4.0)
    solver = points_on(terrain, frame, DX, material, contact, time_step=DT)
    place, velocity = plain(solver, frame, material, contact.a, contact.b)
    solver.advance(STEPS * DT)
    now = sorted_points(solver)
    assert solver.step == STEPS
    np.testing.assert_allclose(now.position, place + solver._corner_from((0.0, 0.0, 0.0)), rtol=0, atol=1e-12 * 60.0)
    np.testing.assert_allclose(now.velocity, velocity, rtol=0, atol=1e-11)
