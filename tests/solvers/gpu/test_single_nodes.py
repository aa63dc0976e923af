"""Ground, faces, layers, density of a 3D flow in single precision, as on the device, move it as in double precision."""

from functools import partial

import contact_scenes
import face_scenes
import numpy as np
import point_scenes
import pytest
import shapely
import test_point_layers as layers
from column_scenes import terrain_of
from single_nodes import SingleNodes

from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import elastic, fluid
from mpmgis.solvers.features.walls import Wall
from mpmgis.solvers.points.point_solver import PointSolver
from mpmgis.solvers.points.point_time_step import CORRECTED_TOTAL

pytestmark = pytest.mark.slow  # the step is compiled for it


def both(monkeypatch, modules, run):
    """What `run` gives with nodes in double and in single precision; `modules` make the solvers."""
    found = []
    for solver in (PointSolver, SingleNodes):
        for module in modules:
            monkeypatch.setattr(module, "PointSolver", solver)
        found.append(run())
    return found


@pytest.mark.parametrize(
    "scene",
    [
        {"degrees": 24.0, "time": 6.0, "above": 0.37, "weighted": True},
        {"degrees": 26.0, "time": 6.0},
        {"degrees": 35.0, "time": 4.0},
        {"degrees": 0.0, "time": 6.0, "speed": 10.0, "length": 4.0},
    ],
)
@pytest.mark.parametrize("deep", [0.0, 3000.0])
def test_slabs_slide_and_rest_alike_whatever_the_height_of_the_terrain(monkeypatch, scene, deep):
    """`deep` [m] is a pit in the terrain, far from the slab: heights count from its bottom."""
    terrain_of = contact_scenes.terrain_of

    def with_pit(height, length, width, cell):
        return terrain_of(lambda x, y: height(x, y) - np.where(x > length - 8.0, deep, 0.0), length, width, cell)

    monkeypatch.setattr(contact_scenes, "terrain_of", with_pit)
    double, single = both(monkeypatch, [point_scenes], lambda: contact_scenes.slab(precision="float32", **scene))
    assert type(single[3]) is SingleNodes and single[3].step > 300
    assert abs(single[0] - double[0]) < 1e-4 * max(double[0], 1.0)
    assert abs(single[1] - double[1]) < 1e-4 * max(double[1], 1.0)


@pytest.mark.parametrize("degrees", [24.0, 35.0])
def test_a_block_slides_along_a_wall_alike(monkeypatch, degrees):
    points_on = partial(point_scenes.points_on, precision="float32")
    monkeypatch.setattr(face_scenes, "points_on", points_on)
    scene = partial(face_scenes.along_wall, degrees, 2.0, elastic(6.7e6, 4e6), place=0.3)
    double, single = both(monkeypatch, [point_scenes], scene)
    assert single[3]._faces.size > 0 and 0.8 < single[2] < 1.2
    assert abs(single[0] - double[0]) < 1e-4 * max(double[0], 1.0)
    assert abs(single[2] - double[2]) < 1e-3


def test_a_chute_of_voellmy_runs_alike(monkeypatch):
    scene = partial(layers.Chute, 20.0, friction_law("Voellmy", 0.2, 1000.0), 2.0, precision="float32")
    double, single = both(monkeypatch, [layers], lambda: scene().solver)
    for value in (lambda s: s.energy()[0], lambda s: s.balances()["energy_lost_to_ground"]):
        assert value(single) == pytest.approx(value(double), rel=2e-4)


@pytest.mark.parametrize("deep", [0.0, 3000.0])
def test_a_fluid_that_is_too_dense_expands_alike(monkeypatch, deep):
    """`deep` [m] is a pit in the terrain, far from the fluid, which begins before a wall."""
    terrain = terrain_of(lambda x, y: 10.0 - 0.2 * x - np.where(x > 32.0, deep, 0.0), 40.0, 16.0, 1.0)
    walls = (Wall("wall", shapely.box(14.0, -10.0, 18.0, 30.0), height=6.0, mu=0.2),)

    def run():
        frame = point_scenes.block_of((5.0, 4.0, 2.0), 0.5, (8.7, 6.2, 0.0))
        frame.particles.position[:, 2] *= 0.5
        frame.particles.position[:, 2] += 10.0 - 0.2 * frame.particles.position[:, 0]
        contact, numerics = friction_law("Coulomb", 0.2), {"precision": "float32", "walls": walls}
        solver = point_scenes.points_on(terrain, frame, 1.0, fluid(1e6, 10.0, 1.0), contact, **numerics)
        solver.advance(0.5)
        return solver

    double, single = both(monkeypatch, [point_scenes], run)
    assert type(single) is SingleNodes and single.step == double.step > 32
    assert single._clock[CORRECTED_TOTAL] == double._clock[CORRECTED_TOTAL] > 0.5 * len(double.arrays.rows)
    for value in (lambda s: s.energy()[0], lambda s: s.balances()["energy_of_volume_corrections"]):
        assert value(single) == pytest.approx(value(double), rel=1e-3)
