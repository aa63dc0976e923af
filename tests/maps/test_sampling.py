"""Cell size, time step, steps and grid: Eqs 15 and 17, and rules for empty cells."""

import math

import numpy as np
import pytest
from exporting import AFFINES, CRS, random_frame, terrain
from hypothesis import given, settings
from hypothesis import strategies as st

from mpmgis.maps.averaging.export_resolution import (
    FrameFacts,
    automatic_cell_size,
    automatic_time_step,
    choose_steps,
    export_grid,
    require_cells_within,
)
from mpmgis.maps.averaging.frame_values import automatic_standoff, fastest_mean, resting_offset, survey_frame
from mpmgis.maps.averaging.placement import Bed
from mpmgis.system.errors import InputError
from mpmgis.terrain.grid import Grid


def naive_steps(times, time_step):
    """For each multiple between the first and the last time the nearest frame, the earlier of two."""
    chosen, k = set(), math.ceil(times[0] / time_step - 1e-9)
    while k * time_step <= times[-1] + 1e-9 * time_step:
        chosen.add(min(range(len(times)), key=lambda i: (round(abs(times[i] - k * time_step), 9), i)))
        k += 1
    return sorted(chosen)


@settings(max_examples=200, deadline=None)
@given(
    times=st.lists(st.integers(0, 400), min_size=1, max_size=30, unique=True),
    time_step=st.sampled_from([0.05, 0.1, 0.3, 1.0, 2.5, 7.0]),
)
def test_steps_are_the_frames_nearest_to_the_multiples(times, time_step):
    times = sorted(t / 10 for t in times)
    expected = naive_steps(times, time_step)
    if expected:
        assert choose_steps(times, time_step) == expected
    else:
        assert len(choose_steps(times, time_step)) == 1


def test_steps_in_plain_cases():
    assert choose_steps([0, 1, 2, 3, 4, 5], 2.0) == [0, 2, 4]
    assert choose_steps([0, 1, 2, 3], None) == [0, 1, 2, 3]
    assert choose_steps([0, 0.9, 2.1, 3], 1.0) == [0, 1, 2, 3]
    assert choose_steps([0, 1, 2], 0.01) == [0, 1, 2]
    assert choose_steps([0, 1, 2], 100.0) == [0]
    assert choose_steps([3.0], 2.0) == [0]
    assert choose_steps([0, 1, 2], math.inf) == [0]
    assert choose_steps(np.arange(301) * 0.1, 0.2) == list(range(0, 301, 2))  # 0.1 and 0.2 are not exact


def facts(**changes):
    usual = FrameFacts((0, 0, 1, 1), particle_volume=1 / 6, dilation=1.0, thickness=3.0, spacing=1.0, below=0, offset=0)
    return usual._replace(**changes)


def test_cell_size_of_the_papers_case():
    """NHESS: gs = 1 m, 6 points a cell: Eq 15 alone gives 0.55 m; with a fifth of the density about 0.94 m."""
    cell, why = automatic_cell_size([facts(thickness=1e9, spacing=0.01)], 10.0)
    assert pytest.approx(0.5503, abs=1e-4) == (1 / 6) ** (1 / 3)
    assert cell == pytest.approx(10.0 / 18)  # the divisor of the DTM's cell next above 0.5503
    assert "0.55" in why
    cell, _ = automatic_cell_size([facts(thickness=1e9, spacing=0.01, dilation=0.2)], 10.0)
    assert cell == pytest.approx(10.0 / 10)  # 0.941 up to a divisor


def test_cell_size_leaves_few_cells_empty():
    cell, _ = automatic_cell_size([facts(thickness=0.1)], 10.0)
    wanted = math.sqrt(5 * (1 / 6) / 0.1)
    assert wanted <= cell <= 10.0 and (10.0 / cell) == pytest.approx(round(10.0 / cell))


def test_cell_size_above_the_terrains_is_a_multiple_of_half_the_solvers():
    cell, _ = automatic_cell_size([facts(thickness=0.001)], 10.0)
    assert cell == pytest.approx(math.ceil(math.sqrt(5 / 6 / 0.001) / 0.5) * 0.5)


def test_cell_size_never_below_the_finer_grid():
    assert automatic_cell_size([facts(particle_volume=1e-6, thickness=1e3, spacing=2.0)], 10.0)[0] == pytest.approx(2.0)


def test_columns_are_not_smoothed_away():
    """A thin sheet has no gaps: cells as wide as its columns show all of it."""
    thin = facts(thickness=0.01, spacing=5.0, column_side=4.0)
    cell, why = automatic_cell_size([thin, thin._replace(spacing=16.0)], 10.0)
    assert cell == pytest.approx(5.0)
    assert "squares of 4 m" in why


def test_time_step_is_a_cell_at_full_speed():
    assert automatic_time_step(1.0, 50.0) == pytest.approx(0.02)  # Eq 17; the paper's 0.2 s is ten times that
    assert automatic_time_step(1.0, 0.0) == math.inf


def test_fastest_mean_is_in_the_map_plane():
    ground = terrain()
    frame = random_frame(ground, 300, 3)
    frame.particles.velocity[:] = [3.0, 4.0, 100.0]
    assert fastest_mean(frame, Bed.of(ground), export_grid(ground.grid), 1200.0) == pytest.approx(5.0)


@pytest.mark.parametrize("affine", AFFINES)
@pytest.mark.parametrize("cell_size", [None, 0.8, 5.0, 13.0, 5000.0])
def test_grid_covers_the_terrain_from_its_upper_left_corner(affine, cell_size):
    grid = Grid(CRS, AFFINES[affine], (40, 36))
    west, south, east, north = grid.bounds
    result = export_grid(grid, cell_size)
    t = result.transform
    assert (t.c, t.f) == (west, north) and t.b == t.d == 0 and t.a > 0 > t.e
    assert result.bounds[2] >= east - 1e-6 * t.a and result.bounds[1] <= south - 1e-6 * t.e
    assert result.bounds[2] < east + t.a and result.bounds[1] > south + t.e
    if cell_size is not None:
        assert (t.a, -t.e) == (cell_size, cell_size)
    elif affine in ("north-up", "oblong"):
        assert result.transform == grid.transform and result.shape == grid.shape
    elif affine == "south-up":
        assert result.shape == grid.shape and (t.a, -t.e) == (5, 5)


@settings(max_examples=60, deadline=None)
@given(
    cell_size=st.one_of(st.none(), st.floats(0.3, 300)),
    low=st.tuples(st.floats(0, 0.9), st.floats(0, 0.9)),
    size=st.tuples(st.floats(0, 0.5), st.floats(0, 0.5)),
)
def test_grid_of_the_flow_is_a_part_of_the_whole_with_a_margin(cell_size, low, size):
    grid = Grid(CRS, AFFINES["north-up"], (40, 36))
    west, south, east, north = grid.bounds
    box = (
        west + low[0] * (east - west),
        south + low[1] * (north - south),
        west + min(1, low[0] + size[0]) * (east - west),
        south + min(1, low[1] + size[1]) * (north - south),
    )
    whole, part = (
        export_grid(grid, cell_size),
        export_grid(grid, cell_size, (box[0] - west, north - box[3], box[2] - west, north - box[1])),
    )
    step = whole.transform.a
    shift = (part.transform.c - whole.transform.c) / step, (whole.transform.f - part.transform.f) / step
    assert shift == pytest.approx((round(shift[0]), round(shift[1])), abs=1e-6)
    assert round(shift[0]) + part.shape[1] <= whole.shape[1] and round(shift[1]) + part.shape[0] <= whole.shape[0]
    for edge, wanted, limit in ((0, box[0] - step, west), (1, box[1] - step, south)):
        assert part.bounds[edge] <= max(wanted, limit) + step + 1e-6
    assert part.bounds[0] <= box[0] + 1e-6 and part.bounds[3] >= box[3] - 1e-6
    assert part.bounds[2] >= box[2] - 1e-6 and part.bounds[1] <= box[1] + 1e-6


def test_a_grid_too_large_is_rejected_with_a_fix():
    with pytest.raises(InputError, match="larger --cs-e"):
        export_grid(Grid(CRS, AFFINES["north-up"], (4000, 4000)), 1e-3)
    with pytest.raises(InputError):
        export_grid(Grid(CRS, AFFINES["north-up"], (4000, 4000)), 1e-320)


@pytest.mark.parametrize("affine", ["north-up", "rotated"])
def test_cells_larger_than_the_dtm_are_rejected(affine):
    """The longer side of the DTM along the axes of the cells may be one cell, not less."""
    grid = Grid(CRS, AFFINES[affine], (30, 40))
    length = 40 * grid.sides[0]
    require_cells_within(grid, length, north_up=False)
    with pytest.raises(InputError, match=rf"--cs-e got cells of \S+ m, .* longer side of the DTM, {length:g} m"):
        require_cells_within(grid, 1.001 * length, north_up=False)


def test_survey_finds_the_flow():
    ground = terrain()
    for dimension in (2, 3):
        frame = random_frame(ground, 200, dimension, margin=-0.3)
        found = survey_frame(frame, Bed.of(ground), 1200.0)
        x, y = frame.map_xy()
        half = 0.5 * np.sqrt(frame.particles.area) if dimension == 2 else 0.0
        east, south = x - ground.grid.bounds[0], ground.grid.bounds[3] - y
        around = (east - half).min(), (south - half).min(), (east + half).max(), (south + half).max()
        assert found.bounds == pytest.approx(around)
        assert found.particle_volume == pytest.approx(frame.particles.volume.mean())
        assert found.thickness > 0 and found.dilation == pytest.approx(1.0)


def test_standoff_of_a_code_with_particles_below_the_bed():
    """A third of 1000 particles is below the bed: 1 % of the mass is below the standoff."""
    distance = np.linspace(-1.0, 2.0, 1000)
    share, offset = resting_offset(distance, np.ones(1000))
    assert share == pytest.approx(1 / 3, abs=2e-3)
    assert offset == pytest.approx(np.quantile(distance, 0.01), abs=5e-3)
    assert automatic_standoff([facts(), facts(below=share, offset=offset), facts(below=0.1, offset=-9.0)]) == offset


def test_no_standoff_with_little_mass_below_the_bed():
    distance = np.linspace(-0.005, 1.0, 1000)
    share, offset = resting_offset(distance, np.ones(1000))
    assert 0 < share < 0.01 and offset == 0.0
    assert automatic_standoff([facts(below=share, offset=offset)]) == 0.0
