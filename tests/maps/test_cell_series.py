"""The cell of a point."""

import numpy as np

from mpmgis.maps.averaging.frame_values import NOWHERE, cells_of
from mpmgis.terrain.grid import Grid

GRID = Grid.north_up(None, 1000.0, 2000.0, 10.0, (3, 4))  # from E 1000 to 1040, N 1970 to 2000


def test_every_cell_contains_its_centre_and_points_near_its_corners():
    row, column = np.indices(GRID.shape).reshape(2, -1)
    east, north = 1005.0 + 10.0 * column, 1995.0 - 10.0 * row
    for across, along in ((0.0, 0.0), (-4.9, -4.9), (4.9, -4.9), (-4.9, 4.9), (4.9, 4.9)):
        assert cells_of(GRID, east + across, north + along).tolist() == list(range(12))


def test_points_outside_the_grid_have_no_cell():
    east, north = np.array([999.9, 1040.1, 1020.0, 1020.0]), np.array([1985.0, 1985.0, 2000.1, 1969.9])
    assert (cells_of(GRID, east, north) == NOWHERE).all()
