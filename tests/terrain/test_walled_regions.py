"""Constant regions of a DTM behind walls: value x size x place, and ground that looks like them."""

import numpy as np
import pytest

from mpmgis.system.errors import InputError
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.flow_reach import reach_of
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.walled_regions import require_real, walled_in_reach, walled_lines, walled_regions

VALUES = (0.0, -1.0, -99.0, -999.0, -9998.9, -9999.9, 255.0)
PLACES = {
    "middle": (slice(50, 58), slice(36, 44)),
    "corner": (slice(0, 8), slice(0, 8)),
    "edge": (slice(40, 60), slice(-3, None)),
    "row": (slice(70, 71), slice(None)),
    "collar": None,
}


def grid(shape, cell=10.0):
    return Grid.north_up(None, 600_000.0, 5_201_000.0, cell, shape)


def slope(shape=(100, 80), cell=10.0, top=1500.0, tangent=0.466):
    """A plane that falls to the south, with a shallow channel."""
    row, column = np.indices(shape)
    return top - tangent * cell * (row + 0.5) + 0.0004 * ((column - shape[1] / 2) * 10.0) ** 2


@pytest.mark.parametrize("cell", [0.5, 2.0, 10.0, 30.0, 90.0])
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("value", VALUES)
def test_a_constant_region_behind_walls_is_named(value, place, cell):
    heights = slope(cell=cell, top=4000.0, tangent=min(0.466, 9.0 / cell))
    false = np.zeros(heights.shape, bool)
    if PLACES[place] is None:
        false[:6], false[-6:], false[:, :6], false[:, -6:] = True, True, True, True
    else:
        false[PLACES[place]] = True
    heights[false] = value
    heights = heights.astype(np.float32).astype(float)
    (region,) = walled_regions(heights, grid(heights.shape, cell))
    assert region.value == np.float32(value) and region.cells == false.sum()
    row, column = grid(heights.shape, cell).rowcol(region.east, region.north)
    assert false[round(float(row)), round(float(column))]
    (line,) = walled_lines((region,), "d.tif")
    assert f"{false.sum()} cells" in line and f"{value:.7g}" in line and f"E {region.east:.1f}" in line


@pytest.mark.parametrize("size", [100, 900, 2000])
def test_at_any_size_of_the_raster(size):
    heights = 2400.0 - 0.466 * 5.0 * np.indices((size, size))[0] * 400 / size
    inner = slice(3 * size // 10, 7 * size // 10)
    heights[inner, inner] = 0.0
    (region,) = walled_regions(heights, grid(heights.shape, 5.0))
    assert region.cells == (4 * size // 10) ** 2 and region.parts == 1 and region.wall > 100


def test_several_regions_and_values():
    heights = slope()
    heights[10:13, 10:13], heights[30:35, 20:24], heights[60, 60] = 0.0, 0.0, 0.0
    heights[80:82, 5:9] = -999.0
    zero, other = walled_regions(heights, grid(heights.shape))
    assert (zero.value, zero.cells, zero.parts) == (0.0, 30, 3) and (other.value, other.cells) == (-999.0, 8)


def test_neighbours_of_two_values():
    heights = slope()
    heights[30:35, 20:24], heights[35:40, 20:24] = 0.0, -999.0
    assert {(r.value, r.cells) for r in walled_regions(heights, grid(heights.shape))} == {(0.0, 20), (-999.0, 20)}


def lake():
    heights = slope()
    return np.maximum(heights, heights[60, 40])


def sea():
    """An island in a sea of 0 with a cliff of 400 m at one side, a beach at the other."""
    row, column = np.indices((100, 80))
    heights = 400.0 - 8.0 * np.abs(row - 50) - 8.0 * np.abs(column - 40)
    heights[:, 45:] = 0.0
    return np.maximum(heights, 0.0)


def cliff():
    heights = slope()
    heights[:50] += 600.0
    return heights


def cliff_in_whole_metres_over_a_terrace():
    heights = np.floor(slope())
    heights[:50] = np.floor(heights[:50] / 50.0) * 50.0 + 400.0
    return heights


def reservoir_behind_a_dam():
    heights = np.maximum(slope(), slope()[60, 40])
    heights[60:62, 20:60] += 90.0
    heights[62:, :] -= 150.0
    return heights


def harbour():
    """A basin of 0 with quays of 3 m, cells of half a metre."""
    heights = np.full((100, 80), 3.0) + np.indices((100, 80))[0] * 0.01
    heights[30:60, 20:60] = 0.0
    return heights


def flume_in_the_laboratory():
    heights = np.zeros((60, 200))
    heights[:20], heights[40:] = 2.0, 2.0
    return heights


def block_on_a_plain():
    heights = np.full((100, 100), 700.0)
    heights[40:60, 40:60] = 800.0
    return heights


def pinnacles():
    """Single steep cells in rough rock, all of other heights."""
    heights = slope() + np.random.default_rng(1).normal(0, 150, (100, 80))
    return heights


@pytest.mark.parametrize(
    "ground, cell",
    [
        (lake, 10.0),
        (sea, 5.0),
        (cliff, 10.0),
        (cliff_in_whole_metres_over_a_terrace, 10.0),
        (reservoir_behind_a_dam, 5.0),
        (harbour, 0.5),
        (flume_in_the_laboratory, 0.1),
        (pinnacles, 10.0),
    ],
)
def test_real_ground_is_none(ground, cell):
    heights = ground()
    assert walled_regions(heights, grid(heights.shape, cell)) == ()


def test_the_plain_around_a_block_is_none():
    found = walled_regions(block_on_a_plain(), grid((100, 100), 5.0))
    assert all(region.value == 800.0 and region.wall < 0 for region in found)


def test_nodata_beside_a_region():
    heights = slope()
    heights[50:58, 36:44] = 0.0
    heights[50:58, 44:47] = np.nan
    (region,) = walled_regions(heights, grid(heights.shape))
    assert region.cells == 64


def test_in_reach_or_not_and_declared():
    """The flow is down the middle: a region there is refused, one at the upper corner is not."""
    heights = slope()
    heights[50:58, 36:44] = 0.0
    heights[0:4, 0:4] = -999.0
    terrain = Terrain(grid(heights.shape), heights)
    regions = walled_regions(heights, terrain.grid)
    xy = np.stack(np.meshgrid(np.arange(600_355.0, 600_450.0, 10.0), np.arange(5_200_775.0, 5_200_850.0, 10.0)), -1)
    xy = xy.reshape(-1, 2)
    reach = reach_of(terrain, xy, terrain.sample(*xy.T), 0.2)
    found = walled_in_reach(regions, reach, terrain.grid, 10.0)
    assert [region.value for region in found] == [0.0]
    with pytest.raises(InputError, match=r"64 cells have the constant elevation 0 .*--nodata 0\).*real_values = \[0\]"):
        require_real(found, (), "d.tif")
    (line,) = require_real(found, (0,), "d.tif")
    assert line.startswith("warning") and "64 cells" in line
    assert require_real((), (), "d.tif") == []
