"""Slopes and heights of terrain against surfaces that are known exactly."""

import numpy as np
import pytest
from affine import Affine
from hypothesis import given
from hypothesis import strategies as st

from mpmgis.terrain import synthetic_terrain
from mpmgis.terrain.elevation import Terrain, bilinear
from mpmgis.terrain.grid import Grid

AFFINES = {
    "north-up": Affine(10, 0, 500, 0, -10, 900),
    "south-up": Affine(10, 0, 500, 0, 10, 700),
    "non-square": Affine(4, 0, 500, 0, -10, 900),
    "rotated": Affine(8.66025404, 5, 500, 5, -8.66025404, 900),
    "sheared": Affine(10, 3, 500, -2, -8, 900),
}
any_affine = pytest.mark.parametrize("transform", AFFINES.values(), ids=AFFINES)


def centres(grid):
    return grid.xy(*np.indices(grid.shape))


@given(
    slope=st.floats(0, 80),
    azimuth=st.floats(0, 360),
    angle=st.floats(-180, 180),
    width=st.floats(0.5, 50),
    height=st.floats(0.5, 50),
    mirrored=st.booleans(),
)
def test_slope_of_a_plane_at_any_pixel_shape(slope, azimuth, angle, width, height, mirrored):
    cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    height = height if mirrored else -height
    transform = Affine(width * cosine, -height * sine, 0, width * sine, height * cosine, 0)
    surface = synthetic_terrain.plane(slope, azimuth)
    terrain = surface.terrain(Grid(None, transform, (6, 5)))
    exact = np.stack(surface.gradient(*centres(terrain.grid)), axis=-1)
    assert np.allclose(terrain.gradient, exact, rtol=1e-9, atol=1e-9)
    steep = np.degrees(np.arctan(np.hypot(*terrain.gradient[2, 2])))
    assert steep == pytest.approx(slope, abs=1e-7)


@any_affine
def test_plane_at_utm_coordinates(transform):
    """The gradient comes from differences, so that a northing of 5e6 m costs no digits of the slope."""
    a, b, c, d, e, f = transform[:6]
    shifted = Affine(a, b, c + 4e5, d, e, f + 5e6)
    surface = synthetic_terrain.plane(35, 200, point=(4e5, 5e6), height=2000)
    terrain = surface.terrain(Grid(None, shifted, (8, 9)))
    assert np.allclose(terrain.gradient, np.stack(surface.gradient(*centres(terrain.grid)), axis=-1), atol=1e-7)


@any_affine
def test_quadratics_are_exact_up_to_the_rim(transform):
    """Central differences and the one-sided (-3, 4, -1)/2 are both exact on a paraboloid."""
    surface = synthetic_terrain.bowl(50, 300, centre=(520, 850))
    terrain = surface.terrain(Grid(None, transform, (9, 11)))
    exact = np.stack(surface.gradient(*centres(terrain.grid)), axis=-1)
    assert np.allclose(terrain.gradient, exact, atol=1e-11)
    assert not terrain.breaks.any()


@any_affine
def test_gradient_converges_with_order_two(transform):
    surface = synthetic_terrain.bumps(5.0, 400.0) + synthetic_terrain.plane(20, 130)
    worst = []
    for refinement in (1, 2, 4, 8):
        a, b, c, d, e, f = transform[:6]
        fine = Affine(a / refinement, b / refinement, c, d / refinement, e / refinement, f)
        terrain = surface.terrain(Grid(None, fine, (20 * refinement, 20 * refinement)))
        exact = np.stack(surface.gradient(*centres(terrain.grid)), axis=-1)
        worst.append(np.abs(terrain.gradient - exact).max())
    orders = np.log2(np.array(worst[:-1]) / worst[1:])
    assert orders[-1] == pytest.approx(2.0, abs=0.1)


@given(st.floats(-0.5, 6.5), st.floats(-0.5, 4.5), st.sampled_from(sorted(AFFINES)))
def test_sampling_is_exact_on_planes_up_to_the_outer_edge(row, column, name):
    surface = synthetic_terrain.plane(40, 75, point=(500, 900), height=1000)
    grid = Grid(None, AFFINES[name], (7, 5))
    x, y = grid.xy(row, column)
    # A point drawn on the very edge may lie one rounding outside it: it is asked for by pixel, not by map.
    assert bilinear(surface.terrain(grid).elevation, row, column) == pytest.approx(surface.height(x, y), abs=1e-9)
    inner = np.clip(row, -0.49, 6.49), np.clip(column, -0.49, 4.49)
    x, y = grid.xy(*inner)
    assert surface.terrain(grid).sample(x, y) == pytest.approx(surface.height(x, y), abs=1e-9)


def test_sampling_is_bilinear_between_four_pixels():
    elevation = np.array([[0.0, 1.0], [2.0, 7.0]])
    assert bilinear(elevation, 0.25, 0.5) == pytest.approx(0.75 * 0.5 + 0.25 * 4.5)
    assert bilinear(elevation, 1, 1) == 7.0


OUTSIDE = [(-0.6, 1), (1, -0.6), (3.6, 1), (1, 3.6), (np.nan, 1), (1, np.inf), (-np.inf, np.nan)]


@pytest.mark.parametrize("point", OUTSIDE)
def test_sampling_outside_is_nan_without_a_warning(point):
    with np.errstate(all="raise"):
        assert np.isnan(bilinear(np.ones((4, 4)), *point))


def test_sampling_beside_nodata_is_nan():
    elevation = np.ones((4, 4))
    elevation[2, 2] = np.nan
    assert np.isnan(bilinear(elevation, 1.5, 1.5))
    assert bilinear(elevation, 0.5, 2.5) == 1.0


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1), (2, 2)])
def test_tiny_rasters(shape):
    """Where there is one row or column the slope across it is unknown and taken as 0."""
    terrain = synthetic_terrain.plane(45, 90).terrain(Grid.north_up(None, 0, 0, 2.0, shape))
    assert np.allclose(terrain.gradient[..., 0], -1.0 if shape[1] > 1 else 0.0)
    assert np.allclose(terrain.gradient[..., 1], 0.0)
    if shape[1] > 1:
        x, y = terrain.grid.xy(0, 0.25)
        assert terrain.sample(x, y) == pytest.approx(terrain.elevation[0, 0] - 0.5)


def test_nodata_makes_neighbours_one_sided_and_itself_nan():
    terrain = synthetic_terrain.plane(30, 120).terrain(Grid.north_up(None, 0, 0, 5.0, (9, 9)))
    elevation = terrain.elevation.copy()
    elevation[4, 4] = elevation[0, 2] = elevation[8, 6] = np.nan
    holed = Terrain(terrain.grid, elevation)
    assert np.array_equal(np.isnan(holed.gradient).all(axis=-1), np.isnan(elevation))
    assert np.allclose(holed.gradient[holed.valid], terrain.gradient[holed.valid])
    assert np.array_equal(holed.valid, np.isfinite(elevation))


def test_a_pixel_without_valid_neighbours_has_no_slope():
    elevation = np.full((3, 3), np.nan)
    elevation[1, 1] = 100.0
    terrain = Terrain(Grid.north_up(None, 0, 0, 1.0, (3, 3)), elevation)
    assert np.isnan(terrain.gradient).all()
    assert not terrain.breaks.any()


def test_a_slope_known_along_one_axis_only_is_no_slope():
    elevation = np.full((3, 3), np.nan)
    elevation[1] = [0.0, 1.0, 2.0]
    terrain = Terrain(Grid.north_up(None, 0, 0, 1.0, (3, 3)), elevation)
    assert np.isnan(terrain.gradient).all()


@pytest.mark.parametrize("azimuth", [0, 90, 180, 270])
@pytest.mark.parametrize("size", [1.0, 0.5])
def test_limited_gradient_at_a_cliff_is_that_of_the_ground_beside_it(azimuth, size):
    """No pixel's tangent follows the cliff face; both sides keep their own slope exactly."""
    surface = synthetic_terrain.ramp_with_cliff(30, 10, edge=(0.1, 0.1), azimuth=azimuth)
    terrain = surface.terrain(Grid.north_up(None, -10, 10, size, (round(20 / size), round(20 / size))))
    exact = np.stack(surface.gradient(*centres(terrain.grid)), axis=-1)
    assert np.allclose(terrain.limited_gradient, exact, atol=1e-9)
    steepest = np.hypot(*np.moveaxis(terrain.gradient, -1, 0)).max()
    assert steepest > 4 / size  # the plain one does follow it
    assert np.count_nonzero(terrain.breaks) == 2 * terrain.grid.shape[0]  # the pixels on both sides, no others


@pytest.mark.parametrize("column", [1, 2, 18, 19])
def test_limited_gradient_at_a_cliff_beside_the_rim(column):
    """The one-sided formula of the rim reaches two pixels in: it must not see the cliff either."""
    grid = Grid.north_up(None, 0, 0, 1.0, (4, 20))
    surface = synthetic_terrain.ramp_with_cliff(20, 30, edge=(column, 0))
    terrain = surface.terrain(grid)
    exact = np.stack(surface.gradient(*centres(grid)), axis=-1)
    inside = np.ones(20, bool)
    if column in (1, 19):  # a strip one pixel wide has its only neighbour across the cliff: nothing to go by
        inside[0 if column == 1 else -1] = False
    assert np.allclose(terrain.limited_gradient[:, inside], exact[:, inside], atol=1e-9)


@any_affine
def test_limiting_leaves_smooth_ground_alone(transform):
    terrain = (synthetic_terrain.plane(40, 10) + synthetic_terrain.bumps(3.0, 150.0)).terrain(
        Grid(None, transform, (25, 25))
    )
    assert np.array_equal(terrain.gradient, terrain.limited_gradient)
    assert not terrain.breaks.any()
