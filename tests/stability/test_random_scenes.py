"""Random scenes run without NaN, keep their mass, gain no energy and stay below the speed that energy allows.

Whatever this finds becomes a case of its own in `test_hard_columns.py` or `test_hard_points.py`.
"""

import pytest
from hard_scenes import Watch
from hypothesis import HealthCheck, given, settings
from scene_strategies import column_scenes, point_scenes

FEW = settings(max_examples=40, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))
MANY = settings(FEW, max_examples=600, derandomize=False, print_blob=True)


def check_columns(scene):
    Watch(scene.solver()).march(8.0, looks=4)


def check_points(scene):
    Watch(scene.solver()).march(1.0, looks=4)


@FEW
@given(column_scenes())
def test_columns_of_a_random_scene(scene):
    check_columns(scene)


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
