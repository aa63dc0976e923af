"""The seed is a pure function of inputs, options and seed number: any threads, any slabs."""

import numba
import numpy as np
import pytest
import shapely
from affine import Affine
from hypothesis import given, settings
from hypothesis import strategies as st
from seed_sites import CENTRE, PIXELS, area_of, inclined, ring, two_islands

from mpmgis.seeding.column_seeding import plan_seed, seed_columns
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.release_parts import ReleaseArea, ReleasePart

CASES = [
    {},
    {"points": "jittered"},
    {"points": "random"},
    {"points": "halton"},
    {"refine_slope": 2.0},
    {"points": "halton", "refine_slope": 2.0},
    {"count": 5000},
    {"mass": "equal"},
    {"mass": "equal", "points": "random"},
    {"mass": "paper"},
    {"velocity": (1.0, 2.0)},
]
IDS = [",".join(map(str, case.values())) or "default" for case in CASES]
RELEASE = area_of(ring(), shapely.box(*np.add(CENTRE * 2, (60, 10, 80, 60))), thickness=[2.0, 3.0])


def same(first, second):
    arrays = first.arrays()
    assert list(arrays) == list(second.arrays())
    for name, values in arrays.items():
        assert np.array_equal(values, second.arrays()[name]), name


@pytest.fixture
def threads():
    """Gives numba.set_num_threads, and puts the number back."""
    before = numba.get_num_threads()
    yield numba.set_num_threads
    numba.set_num_threads(before)


@pytest.mark.parametrize("options", CASES, ids=IDS)
def test_same_bits_for_any_number_of_threads(options, threads):
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one core: there is no second thread to compare with")
    terrain = inclined(PIXELS["north_up"])
    frames = []
    for count in (1, 2):
        threads(count)
        frames.append(seed_columns(terrain, RELEASE, seed=7, **options))
    same(frames[0].particles, frames[1].particles)
    assert frames[0].header == frames[1].header


@pytest.mark.parametrize("options", CASES, ids=IDS)
@pytest.mark.parametrize("size", [1, 333, 10_000])
def test_same_bits_in_slabs(options, size):
    plan = plan_seed(inclined(PIXELS["rotated"]), RELEASE, **options)
    whole = plan.frame().particles
    slabs = list(plan.slabs(size))
    assert sum(map(len, slabs)) == plan.count == len(whole)
    assert len(slabs) > 1 or size >= plan.count
    for name, values in whole.arrays().items():
        assert np.array_equal(np.concatenate([slab.arrays()[name] for slab in slabs]), values), name


@pytest.mark.parametrize("points", ["jittered", "random", "halton"])
def test_seed_numbers_matter_and_repeat(points):
    terrain = inclined(PIXELS["north_up"])
    first, again, other = (
        seed_columns(terrain, RELEASE, points=points, seed=seed).particles.position for seed in (1, 1, 2)
    )
    assert np.array_equal(first, again)
    assert first.shape != other.shape or not np.allclose(first, other)


def test_random_points_belong_to_their_cells():
    """Keyed by (seed, cell, number): a larger release has the same columns in the cells that both cover whole."""
    terrain = inclined(PIXELS["north_up"])
    small = seed_columns(terrain, area_of(shapely.box(*np.add(CENTRE * 2, (-30, -30, 30, 30)))), points="random")
    large = seed_columns(terrain, area_of(shapely.box(*np.add(CENTRE * 2, (-60, -45, 65, 50)))), points="random")
    x, y = small.map_xy()
    deep = (np.abs(x - CENTRE[0]) < 19) & (np.abs(y - CENTRE[1]) < 19)
    places = set(map(tuple, np.round(large.particles.position, 6).tolist()))
    assert deep.sum() > 500
    assert all(tuple(p) in places for p in np.round(small.particles.position[deep], 6).tolist())


@settings(max_examples=10, deadline=None)
@given(st.integers(-2_000_000, 2_000_000), st.integers(-2_000_000, 2_000_000))
def test_moving_the_scene_moves_the_columns(east, north):
    """Shifted by whole metres, positions relative to the origin stay (V22: local frame)."""
    terrain = inclined(Affine(5, 0, 0, 0, -5, 0))
    here = seed_columns(terrain, area_of(two_islands()))
    grid = Grid(None, Affine.translation(east, north) * terrain.grid.transform, terrain.grid.shape)
    moved = shapely.affinity.translate(two_islands(), east, north)
    there = seed_columns(Terrain(grid, terrain.elevation), ReleaseArea((ReleasePart("A1", moved, 2.0),), "normal"))
    np.testing.assert_allclose(here.particles.position, there.particles.position, atol=1e-6)
    np.testing.assert_allclose(here.particles.mass, there.particles.mass, rtol=1e-6)
