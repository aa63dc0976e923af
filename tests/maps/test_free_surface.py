"""Free surface of a profile: depth is normal to the bed, the surface is vertically above it."""

import numpy as np
import pytest

from mpmgis.results.profile_answer import free_surface
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.synthetic_terrain import plane

SLOPE = np.tan(np.radians(30.0))


@pytest.fixture(scope="module")
def terrain():
    return plane(30.0).terrain(Grid.north_up(None, 0.0, 40.0, 10.0, (4, 6)))


@pytest.mark.parametrize("x", [5.0, 25.0, 55.0])
@pytest.mark.parametrize("y", [5.0, 15.0, 35.0])
def test_surface_height_is_depth_over_cosine_of_the_slope(terrain, x, y):
    surface = free_surface(terrain, np.array([x]), np.array([y]), np.array([[0.0], [2.0]]))
    np.testing.assert_allclose(surface[:, 0], -SLOPE * x + np.array([0.0, 2.0 / np.cos(np.radians(30.0))]), rtol=1e-12)


@pytest.mark.parametrize(("x", "y"), [(-20.0, 15.0), (80.0, 15.0), (25.0, -20.0), (25.0, 60.0)])
def test_no_surface_outside_the_terrain(terrain, x, y):
    assert np.isnan(free_surface(terrain, np.array([x]), np.array([y]), np.array([[2.0]]))).all()
