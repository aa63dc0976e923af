"""Time scale of QGIS: whole seconds, at least two apart, and simulated times."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpmgis.maps.qgis.map_clock import Clock, stamp
from mpmgis.system.errors import InputError


@pytest.mark.parametrize(
    ("times", "stretch", "begins"),
    [
        ([0, 0.2, 0.4], 60, (0, 12, 24)),
        ([0.1 * k for k in range(4)], 60, (0, 6, 12, 18)),
        ([0, 5, 10], 60, (0, 300, 600)),
        ([0, 0.01, 0.02], 3600, (0, 36, 72)),
        ([0, 0.001, 0.002], 86_400, (0, 86, 173)),
        ([0, 1 / 7, 2 / 7], 3600, (0, 514, 1029)),  # 8.57 s of a minute's clock would make uneven frames
        ([0, 0.0001, 0.0002], 86_400_000, (0, 8640, 17280)),
        ([0, 1e-5], 86_400_000, (0, 864)),
        ([7.0], 60, (420,)),
    ],
)
def test_smallest_stretch_with_whole_steps(times, stretch, begins):
    clock = Clock.of(times)
    assert (clock.stretch, clock.begins) == (stretch, begins)


def test_single_precision_times_count_as_whole():
    assert Clock.of(np.arange(5, dtype=np.float32) * np.float32(0.2)).begins == (0, 12, 24, 36, 48)


@given(st.lists(st.floats(1e-4, 50.0), min_size=1, max_size=30), st.floats(0, 1000))
def test_any_times_are_covered_without_gap_or_overlap(steps, start):
    times = start + np.cumsum(steps)
    if np.any(np.diff(times) <= 0):
        return
    clock = Clock.of(times)
    lengths = np.subtract(clock.ends, clock.begins)
    assert np.all(lengths >= 2)
    assert clock.ends[:-1] == clock.begins[1:]
    assert np.allclose(np.array(clock.begins) / clock.stretch, times, atol=0.5 / clock.stretch)


@pytest.mark.parametrize("times", [[], [0, 0], [1, 0.5], [0, np.nan], [0, 1e-9], [0, 1e-5, 1e5]])
def test_invalid_times_are_rejected(times):
    with pytest.raises(InputError) as refusal:
        Clock.of(times)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("times", "decimals"), [([0, 0.2], 1), ([0, 0.25], 2), ([0, 5], 0), ([0, 12.5], 1), ([0, 0.005], 3)]
)
def test_decimals_distinguish_steps(times, decimals):
    assert Clock.of(times).decimals == decimals


def test_frames_of_the_controller_follow_the_shortest_step():
    assert Clock.of([0, 0.25, 0.75, 3]).step == 15
    assert Clock.of([0, 2, 4, 6, 6.5]).step == 120  # the run came to rest before its next frame
    assert Clock.of([0, 0.5]).step == 30
    assert Clock.of([0, 0.1, 10_000]).step == 120  # not 100 000 frames for one short step


def test_stamp_is_utc():
    assert stamp(192) == "2000-01-01T00:03:12Z"
