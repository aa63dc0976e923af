"""The exact surfaces are exact: their gradients are those of their heights, and they are what they are called."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpmgis.system.errors import InputError
from mpmgis.terrain import synthetic_terrain
from mpmgis.terrain.grid import Grid

SURFACES = {
    "plane": synthetic_terrain.plane(33, 110, point=(3, 4), height=7),
    "bowl": synthetic_terrain.bowl(2.0, 30.0, centre=(1, -2)),
    "ramp": synthetic_terrain.ramp_with_cliff(30, 10, edge=(5, 5), azimuth=140),
    "circle": synthetic_terrain.circular_channel(40, 12, 75, bank_angle=50, point=(2, 3)),
    "v": synthetic_terrain.v_channel(25, 10, 200),
    "bumps": synthetic_terrain.bumps(1.5, 25.0, point=(4, 2)),
    "sum": synthetic_terrain.plane(20, 300) + synthetic_terrain.bumps(0.5, 12.0),
}


@pytest.mark.parametrize("name", SURFACES)
@given(x=st.floats(-60, 60), y=st.floats(-60, 60))
def test_gradient_is_that_of_the_height(name, x, y):
    surface, step = SURFACES[name], 1e-4
    slope = np.array(surface.gradient(x, y))
    differences = np.array(
        [
            (surface.height(x + step, y) - surface.height(x - step, y)) / (2 * step),
            (surface.height(x, y + step) - surface.height(x, y - step)) / (2 * step),
        ]
    )
    around = np.array([surface.gradient(x + i * step, y + j * step) for i, j in ((1, 1), (1, -1), (-1, 1), (-1, -1))])
    if np.abs(around - slope).max() < 0.01:  # no kink or cliff between the points of the difference
        assert differences == pytest.approx(slope, abs=1e-3)


@pytest.mark.parametrize("name", SURFACES)
def test_heights_lie_on_the_grid_s_pixel_centres(name):
    grid = Grid.north_up(None, 100.0, 500.0, 2.5, (6, 8))
    terrain = SURFACES[name].terrain(grid)
    assert terrain.elevation.shape == (6, 8)
    assert terrain.elevation[2, 3] == pytest.approx(SURFACES[name].height(100 + 3.5 * 2.5, 500 - 2.5 * 2.5))


def test_plane_falls_towards_its_azimuth():
    south = synthetic_terrain.plane(30, 180, point=(10, 20), height=100)
    assert south.height(10, 20) == 100
    assert south.height(10, 10) == pytest.approx(100 - 10 * np.tan(np.radians(30)))
    assert south.height(99, 20) == pytest.approx(100)


def test_bowl_is_thackers():
    surface = synthetic_terrain.bowl(3.0, 50.0)
    assert surface.height(0, 0) == -3
    assert surface.height(30, 40) == pytest.approx(0)


def test_ramp_drops_by_the_cliff():
    surface = synthetic_terrain.ramp_with_cliff(30, 10, edge=(19.053, 0), foot=5)
    assert surface.height(19.052999, 0) - surface.height(19.053, 0) == pytest.approx(10, abs=1e-5)
    assert surface.height(0, 3) == pytest.approx(5 + 10 + 19.053 * np.tan(np.radians(30)))
    assert surface.height(100, -8) == 5


def test_channel_is_round_and_its_banks_go_on_straight():
    surface = synthetic_terrain.circular_channel(50, bank_angle=60)
    assert surface.height(7, 30) == pytest.approx(50 - 40)
    assert surface.height(7, -30) == pytest.approx(50 - 40)
    reach = 50 * np.sin(np.radians(60))
    assert surface.gradient(0, reach + 20)[1] == pytest.approx(np.tan(np.radians(60)))
    assert surface.height(0, reach + 20) - surface.height(0, reach + 10) == pytest.approx(10 * np.tan(np.radians(60)))


def test_channels_fall_along_their_beds():
    for surface in (
        synthetic_terrain.v_channel(30, 10, 90, point=(5, 5), height=9),
        synthetic_terrain.circular_channel(9, 10, 90),
    ):
        assert surface.gradient(40, 5)[0] == pytest.approx(-np.tan(np.radians(10)))


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: synthetic_terrain.plane(90),
        lambda: synthetic_terrain.plane(-1),
        lambda: synthetic_terrain.plane(np.nan),
        lambda: synthetic_terrain.bowl(0, 10),
        lambda: synthetic_terrain.bowl(1, np.inf),
        lambda: synthetic_terrain.ramp_with_cliff(30, -1),
        lambda: synthetic_terrain.circular_channel(-5),
        lambda: synthetic_terrain.circular_channel(5, bank_angle=90),
        lambda: synthetic_terrain.v_channel(95),
        lambda: synthetic_terrain.bumps(1, 0),
    ],
)
def test_impossible_shapes_are_refused_in_one_line(wrong):
    with pytest.raises(InputError, match=r"expected") as caught:
        wrong()
    assert "\n" not in str(caught.value)
