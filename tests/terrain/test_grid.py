"""Rows and columns against map coordinates, for any affine."""

import numpy as np
import pytest
from affine import Affine
from hypothesis import given
from hypothesis import strategies as st

from mpmgis.terrain.grid import Grid

AFFINES = {
    "north-up": Affine(10, 0, 311600, 0, -10, 4010200),
    "south-up": Affine(10, 0, 311600, 0, 10, 4007400),
    "west-up": Affine(-10, 0, 314200, 0, -10, 4010200),
    "non-square": Affine(5, 0, 311600, 0, -12.5, 4010200),
    "rotated": Affine(8.66025404, 5, 311600, 5, -8.66025404, 4010200),
    "sheared": Affine(10, 3, 311600, -2, -8, 4010200),
    "transposed": Affine(0, 10, 311600, -10, 0, 4010200),
}


@st.composite
def transforms(draw):
    """Any invertible affine that a DTM can have: turned, stretched, sheared, mirrored, at UTM coordinates."""
    width, height = draw(st.floats(0.1, 100)), draw(st.floats(0.1, 100))
    angle = np.radians(draw(st.floats(-180, 180)))
    between = np.radians(draw(st.floats(30, 150)) * draw(st.sampled_from([-1, 1])))
    column = width * np.cos(angle), width * np.sin(angle)
    row = height * np.cos(angle + between), height * np.sin(angle + between)
    west, north = draw(st.floats(-1e6, 1e6)), draw(st.floats(-1e7, 1e7))
    return Affine(column[0], row[0], west, column[1], row[1], north)


def corner(transform, column, row):
    """The map point of a pixel corner, written out."""
    return (
        transform.a * column + transform.b * row + transform.c,
        transform.d * column + transform.e * row + transform.f,
    )


@given(transforms(), st.floats(-50, 250), st.floats(-50, 250))
def test_there_and_back(transform, row, column):
    grid = Grid(None, transform, (200, 150))
    rounding = 1e-9 * 1e7 / np.sqrt(abs(transform.determinant))  # of a northing, in pixels
    assert np.allclose(grid.rowcol(*grid.xy(row, column)), (row, column), rtol=0, atol=rounding)


@pytest.mark.parametrize("name", AFFINES)
def test_whole_numbers_are_pixel_centres(name):
    transform = AFFINES[name]
    grid = Grid(None, transform, (20, 30))
    assert grid.xy(0, 0) == pytest.approx(corner(transform, 0.5, 0.5), abs=1e-9)
    assert grid.xy(-0.5, -0.5) == pytest.approx(corner(transform, 0, 0), abs=1e-9)
    assert grid.rowcol(*corner(transform, 7.5, 3.5)) == pytest.approx((3, 7), abs=1e-8)


def test_xy_and_rowcol_keep_any_shape():
    grid = Grid(None, AFFINES["rotated"], (20, 30))
    rows, columns = np.indices((4, 5))
    x, y = grid.xy(rows, columns)
    assert x.shape == y.shape == (4, 5)
    back = grid.rowcol(x, y)
    assert np.allclose(back[0], rows) and np.allclose(back[1], columns)


@given(transforms())
def test_area_is_that_of_the_pixel_as_a_polygon(transform):
    grid = Grid(None, transform, (1, 1))
    x, y = (grid.corners() - grid.corners()[0]).T
    shoelace = 0.5 * abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1)))
    assert grid.cell_area == pytest.approx(shoelace, rel=1e-6, abs=1e-7)
    assert grid.cell_size**2 == pytest.approx(grid.cell_area)


@pytest.mark.parametrize("name", AFFINES)
def test_north_up_means_square_and_upright(name):
    assert Grid(None, AFFINES[name], (2, 2)).is_north_up is (name == "north-up")


@pytest.mark.parametrize("name", AFFINES)
def test_corners_go_round_the_raster(name):
    around = [(0, 0), (30, 0), (30, 20), (0, 20)]
    wanted = [corner(AFFINES[name], *point) for point in around]
    assert np.allclose(Grid(None, AFFINES[name], (20, 30)).corners(), wanted, rtol=0, atol=1e-8)


def test_north_up_from_its_corner():
    grid = Grid.north_up(None, west=100.0, north=900.0, cell_size=2.0, shape=(10, 5))
    assert grid.bounds == (100.0, 880.0, 110.0, 900.0)
    assert grid.xy(0, 0) == (101.0, 899.0)
    assert grid.cell_size == 2.0


@given(transforms())
def test_bounds_hold_every_pixel(transform):
    grid = Grid(None, transform, (7, 9))
    west, south, east, north = grid.bounds
    x, y = grid.xy(*np.indices(grid.shape))
    slack = 1e-6
    assert west - slack <= x.min() and x.max() <= east + slack
    assert south - slack <= y.min() and y.max() <= north + slack
