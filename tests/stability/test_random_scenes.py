"""Random scenes run without NaN, keep their mass, gain no energy and stay below the speed that energy allows.

A failing scene becomes a separate case in `test_hard_columns.py` or `test_hard_points.py`.
"""

import pytest
from hard_scenes import EDGES, Watch
from hypothesis import HealthCheck, given, settings
from scene_strategies import column_scenes, point_scenes

from mpmgis.solvers.points.point_loop import LEAKED

FEW = settings(max_examples=40, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))
MANY = settings(FEW, max_examples=600, derandomize=False, print_blob=True)


def check_columns(scene):
    Watch(scene.solver(), EDGES).march(8.0, looks=4)


def check_points(scene):
    """A material that is too soft for its fall may leak through the ground; the run reports it and ends."""
    Watch(scene.solver()).march(1.0, looks=4, may_end=(LEAKED,) if scene.stiffness < 1.0 else ())


@FEW
@given(column_scenes())
def test_columns_of_a_random_scene(scene):
    check_columns(scene)


@pytest.mark.thorough
@FEW
@given(point_scenes())
def test_points_of_a_random_scene(scene):
    check_points(scene)


@pytest.mark.slow
@MANY
@given(column_scenes())
def test_columns_of_many_random_scenes(scene):
    check_columns(scene)


@pytest.mark.slow
@MANY
@given(point_scenes())
def test_points_of_many_random_scenes(scene):
    check_points(scene)
