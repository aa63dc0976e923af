"""The exporter against a naive loop over particles, on random particles, to 1e-6 (both beds, both dimensions)."""

import numpy as np
import pytest
from exporting import AFFINES, CRS, naive_cells, random_frame, terrain

from mpmgis.maps.averaging.band_products import cell_values
from mpmgis.maps.averaging.cell_averages import bin_frame
from mpmgis.maps.averaging.export_resolution import export_grid
from mpmgis.maps.averaging.placement import Bed, place
from mpmgis.terrain.grid import Grid

NAMES = ("h", "t", "Un", "Ut", "Ut_E", "Ut_N", "t_vol", "n", "mass", "p")


def both(ground, frame, grid, kind, percentile=100.0):
    """(ours, naive): (row, column) -> product -> value."""
    bed = Bed.of(ground, kind)
    cells = bin_frame(frame, place(frame, bed), bed, grid, 1200.0, percentile)
    values = cell_values(cells, NAMES, min_depth=-np.inf)
    places = zip(*np.divmod(cells.index, grid.shape[1]), strict=True)
    ours = {(int(i), int(j)): {name: values[name][k] for name in NAMES} for k, (i, j) in enumerate(places)}
    return ours, naive_cells(ground, frame, grid, kind, percentile)


def assert_same(ours, naive):
    assert ours.keys() == naive.keys() and len(ours) > 0
    for cell, expected in naive.items():
        for name in NAMES:
            assert ours[cell][name] == pytest.approx(expected[name], rel=1e-6, abs=1e-6), (cell, name)


@pytest.mark.parametrize("kind", ["bilinear", "plane"])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("affine", AFFINES)
def test_any_affine(affine, dimension, kind):
    ground = terrain(AFFINES[affine], shape=(24, 30), holes=[(3, 4), (10, 11), (10, 12), (23, 29)])
    frame = random_frame(ground, 200, dimension, seed=1)
    assert_same(*both(ground, frame, export_grid(ground.grid), kind))


@pytest.mark.parametrize("cell_size", [0.7, 3.3, 5.0, 17.0, 1000.0])
@pytest.mark.parametrize("dimension", [2, 3])
def test_any_cell_size(dimension, cell_size):
    """Finer than a pixel, coarser than the domain (H37)."""
    ground = terrain(shape=(10, 12))
    frame = random_frame(ground, 60, dimension, seed=2)
    assert_same(*both(ground, frame, export_grid(ground.grid, cell_size), "bilinear"))


@pytest.mark.parametrize("percentile", [0.5, 20.0, 50.0, 90.0, 99.9, 100.0])
def test_any_percentile(percentile):
    ground = terrain()
    frame = random_frame(ground, 500, 3, seed=3)
    assert_same(*both(ground, frame, export_grid(ground.grid, 40.0), "bilinear", percentile))


def test_part_of_the_domain():
    """Particles outside the export grid are ignored."""
    ground = terrain()
    grid = Grid(CRS, export_grid(ground.grid).transform, (9, 7))
    for dimension in (2, 3):
        assert_same(*both(ground, random_frame(ground, 200, dimension, seed=4), grid, "bilinear"))
