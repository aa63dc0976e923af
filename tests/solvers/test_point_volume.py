"""Volume check of points: lattices with and without their full volume, at any depth, slope and position."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mpmgis.frames.particles import Frame, Particles
from mpmgis.simulation.run_summary import unusable_lines, volume_words
from mpmgis.solvers.points.point_volume import HANGING_SHARE, LOOSE_SHARE, PACKED_SHARE, PointVolume, point_volume

DENSITY, ALONG = 1500.0, 6  # [kg m-3]; cells along either side of a layer


def layer(cells, cell_size=1.0, along=2, shift=(0.0, 0.0), speed=0.0):
    """(frame, heights) of a layer `cells` deep with `along` points along a cell's side, its columns at `shift`."""
    spacing = cell_size / along
    levels = max(round(cells * along), 1)
    across = spacing * (np.arange(ALONG * along) + 0.5)
    x, y, k = (part.ravel() for part in np.meshgrid(across, across, np.arange(levels), indexing="ij"))
    height = (k + 0.5) * cells * cell_size / levels
    volume = np.full(len(x), spacing**2 * cells * cell_size / levels)
    velocity = np.zeros((len(x), 3))
    velocity[:, 0] = speed
    position = np.column_stack([x + shift[0], y + shift[1], height])
    return Frame(Particles(position, velocity, DENSITY * volume, volume), dimension=3, time=0.0), height


def found(frame, height, slope=0.0, cell_size=1.0):
    return point_volume(frame, np.asarray(height, float), np.full(len(height), slope), cell_size, DENSITY)


depths = st.floats(0.5, 8.0)


@settings(deadline=None, max_examples=40)
@given(depths, st.floats(0.01, 50.0), st.sampled_from([2, 3]), st.floats(0.0, 2.0), st.floats(-0.2, 0.1))
@example(cells=0.5, cell_size=1.0, along=3, slope=0.0, sunk=0.0625)
def test_a_layer_on_its_bed_keeps_its_volume_at_any_depth(cells, cell_size, along, slope, sunk):
    """Slides rest up to a fifth of a cell below or above their lattice; columns may have unequal point numbers."""
    frame, height = layer(cells, cell_size, along)
    volume = found(frame, height + sunk * cell_size, slope, cell_size)
    assert volume.kept and volume.hanging_share == 0.0
    assert volume.cells_over_depth == pytest.approx(cells, rel=0.3)  # of columns at the rim, too
    assert volume.mass == pytest.approx(frame.particles.mass.sum())


@settings(deadline=None, max_examples=40)
@given(st.floats(1.5, 8.0), st.floats(0.01, 50.0))
def test_a_layer_compressed_to_a_third_is_detected(cells, cell_size):
    frame, height = layer(cells, cell_size)
    volume = found(frame, height / 3.0, 0.0, cell_size)
    assert volume.packed_share > PACKED_SHARE and not volume.kept


@settings(deadline=None, max_examples=40)
@given(depths, st.floats(0.01, 50.0), st.floats(0.0, 2.0))
def test_a_layer_at_rest_above_the_bed_is_detected(cells, cell_size, slope):
    """A gap of 1.6 cells along the normal, on any slope; fast falling or sliding mass is in flight."""
    lifted = 1.6 * cell_size * np.hypot(1.0, slope) + 0.5 * cell_size
    for speed, share in ((0.0, 1.0), (np.sqrt(2 * 9.81 * 1.6 * cell_size), 0.0)):
        frame, height = layer(cells, cell_size, speed=speed)
        volume = found(frame, height + lifted, slope, cell_size)
        assert volume.hanging_share == pytest.approx(share) and volume.kept == (share <= HANGING_SHARE)


def test_a_gap_is_compared_with_the_depth_of_the_hanging_layer():
    """A gap of 0.7 cells is normal below a deep layer of fallen material, but not below a layer of one cell."""
    for cells, share in ((4.0, 0.0), (1.0, 1.0)):
        frame, height = layer(cells)
        assert found(frame, height + 0.7).hanging_share == pytest.approx(share)


def test_a_point_in_the_air_does_not_hide_a_packed_layer():
    frame, height = layer(4.0)
    height = height / 3.0
    height[:: len(height) // ALONG] = 50.0
    assert found(frame, height).packed_share > 0.5


def test_points_without_ground_are_ignored():
    frame, height = layer(2.0)
    height[frame.particles.position[:, 0] < 0.5 * ALONG] = np.nan
    volume = found(frame, height)
    assert volume.mass == pytest.approx(0.5 * frame.particles.mass.sum()) and volume.kept
    nothing = found(frame, np.full(len(height), np.nan))
    assert nothing.mass == 0.0 and nothing.kept


def test_lost_volume_is_reported_with_a_fix():
    frame, height = layer(1.0)
    words = volume_words(found(frame, height + 3.0).as_numbers())
    assert "hangs above the bed" in words and "use smaller cells" in words and words.startswith("unusable: ")
    packed = found(frame, height).as_numbers() | {"kept": False, "packed_share": 0.3, "cells_over_depth": 6.0}
    assert "smaller cells do not help" in volume_words(packed)
    assert "use smaller cells" in volume_words(packed | {"cells_over_depth": 2.0})
    assert volume_words(found(frame, height).as_numbers()).endswith(": conserved")


@settings(deadline=None, max_examples=40)
@given(st.floats(3.0, 8.0), st.floats(0.01, 50.0))
def test_a_layer_compressed_by_a_quarter_has_missing_volume(cells, cell_size):
    """No point is packed beyond 1.2 times its density (with clearance), but volume is missing."""
    frame, height = layer(cells, cell_size)
    volume = found(frame, 0.75 * height, 0.0, cell_size)
    assert volume.missing_share == pytest.approx(0.25 - 0.25 / cells, abs=0.1) and not volume.kept
    assert found(frame, height, 0.0, cell_size).missing_share == 0.0


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 8), st.floats(0.01, 50.0), st.floats(1.15, 1.6), st.sampled_from([2, 3]), st.floats(0.0, 0.1))
def test_a_layer_at_rest_that_is_looser_than_its_mass_is_found(cells, cell_size, looser, along, gap):
    """At any depth, but for the gap under it, which is no loose volume; what flies or slides is loose by right."""
    frame, height = layer(cells, cell_size, along)
    volume = found(frame, looser * height + gap * cell_size, 0.0, cell_size)
    under = 1.0 / max(round(cells * along), 1)
    assert volume.loose_share == pytest.approx((looser - 1.0) * (1.0 - under), abs=0.03)
    assert volume.kept == (volume.loose_share <= LOOSE_SHARE)
    assert found(frame, height + gap * cell_size, 0.0, cell_size).loose_share <= 0.03
    flying, _ = layer(cells, cell_size, along, speed=np.sqrt(9.81 * cells * cell_size))
    assert found(flying, looser * height, 0.0, cell_size).loose_share == 0.0


def heap(cell_size, slope, along=2):
    """(frame, heights) of a heap 16 cells wide whose surface falls by `slope` to both sides, on level ground."""
    spacing = cell_size / along
    x = spacing * (np.arange(16 * along) + 0.5)
    depth = slope * np.minimum(x, x.max() + 0.5 * spacing - x)
    columns = [spacing * (np.arange(max(round(d / spacing), 1)) + 0.5) for d in depth]
    places = [(a, b, z) for a, stack in zip(x, columns, strict=True) for b in x[: 6 * along] for z in stack]
    position = np.array(places)
    volume = np.full(len(position), spacing**3)
    frame = Frame(Particles(position, np.zeros_like(position), DENSITY * volume, volume), dimension=3, time=0.0)
    return frame, position[:, 2]


@pytest.mark.parametrize("slope", [0.2, 0.6, 1.0])
@pytest.mark.parametrize("cell_size", [0.1, 5.0])
def test_a_heap_is_not_loose_because_its_surface_falls(slope, cell_size):
    """Nor because its rim is cut by the cells: only columns within it are judged."""
    volume = found(*heap(cell_size, slope), cell_size=cell_size)
    assert volume.loose_share <= 0.05 and volume.kept


def test_a_few_points_at_rest_make_no_result_unusable():
    """A loose layer that flows, of which less than a tenth has stopped."""
    frame, height = layer(4.0, speed=8.0)
    stopped = frame.particles.position[:, 0] < 0.5
    frame.particles.velocity[stopped] = 0.0
    assert found(frame, 1.4 * height).loose_share == 0.0


@pytest.mark.parametrize(
    "shares", [(0.06, 0.0, 0.0, 0.0), (0.0, 0.11, 0.0, 0.0), (0.0, 0.0, 0.11, 0.0), (0.0, 0.0, 0.0, 0.11)]
)
def test_each_loss_of_volume_makes_a_result_unusable_in_one_line(shares):
    numbers = PointVolume(2.0, 1.0, *shares[:3], 1.2, shares[3]).as_numbers()
    (line,) = unusable_lines({"volume": numbers})
    assert line.startswith("unusable: ") and "1.2 cells over the depth" in line and "\n" not in line
    staged = unusable_lines({"stages": [{"solver": "columns"}, {"volume": numbers}]})
    assert staged == [f"stage 2: {line}"]
    assert unusable_lines({"volume": PointVolume(2.0, 1.0, 0.0, 0.0, 0.0, 1.2).as_numbers()}) == []
    assert unusable_lines({"stages": [{"solver": "columns"}]}) == []
