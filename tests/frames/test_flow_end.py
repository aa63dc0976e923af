"""What the last step of a flow is called: a deposit only at rest, by the record of a run or by the energy of frames."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpmgis.frames.flow_end import FlowEnd, moving_share, recorded_end, rests

BODIES = st.lists(st.tuples(st.floats(0.001, 1e6), st.floats(0.0, 100.0)), min_size=1, max_size=40)


@given(BODIES)
def test_the_share_that_moves_is_that_of_a_loop(bodies):
    fast = sum(mass for mass, speed in bodies if speed > 1.0)
    mass, speed = (np.array(values) for values in zip(*bodies, strict=True))
    assert moving_share(mass, speed) == pytest.approx(fast / sum(mass for mass, _ in bodies), rel=1e-12)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1e12), st.floats(0.0, 1e12))
def test_both_rules_must_hold(moving, kinetic, peak):
    assert rests(moving, kinetic, peak) == (not moving >= 0.05 and not kinetic > 0.01 * peak)


def test_a_flow_that_never_moved_rests():
    assert rests(0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    "record",
    [
        {},
        {"state": "finished"},
        {"state": "finished", "end": {"time": "1", "moving": 0.0, "came_to_rest": True}},
        {"state": "running", "end": {"time": 1, "moving": 0.1, "came_to_rest": True}},
        {"state": "unphysical", "end": {"time": 1, "moving": 0.1, "came_to_rest": True}},
    ],
)
def test_an_end_is_known_only_of_a_finished_run(record):
    assert recorded_end(record) is None


def test_a_recorded_end_names_the_last_step():
    end = recorded_end({"state": "finished", "end": {"time": 12, "moving": 0.43, "came_to_rest": False}})
    assert end == FlowEnd(12.0, 0.43, False)
    assert (end.file, end.words()) == ("last", "last step, t = 12 s, 43 % still moving")
    assert end.tags() == {"came_to_rest": "false", "still_moving": "0.43"}
    assert FlowEnd(12.0, 0.02, True).words() == "deposit"
