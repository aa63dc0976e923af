"""Ensembles and regions count the runs that did not come to rest."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpmgis.results.hazard.hazard_scenarios import unfinished_members
from mpmgis.studies.ensemble_runs import log_moving
from mpmgis.system.messages import collected

RECORDS = st.lists(st.sampled_from([("finished", 1), ("finished", 0), ("unphysical", None)]), max_size=12)


@given(RECORDS)
def test_runs_that_still_move_are_counted_and_named(states):
    records = [{"status": status} | ({} if rest is None else {"came_to_rest": rest}) for status, rest in states]
    with collected() as said:
        moving = log_moving(records, "members")
    count, finished = states.count(("finished", 0)), len([1 for status, _ in states if status == "finished"])
    assert len(moving) == count
    assert [text.split(" did not")[0] for text in said] == ([f"{count} of {finished} members"] if count else [])


@pytest.mark.parametrize(
    ("record", "words"),
    [
        ({"not_at_rest": 0, "members": {"finished": 12}}, ""),
        ({"not_at_rest": 3, "members": {"finished": 12}}, "3 of 12 members did not come to rest"),
        (
            {"not_at_rest": 3, "members": {"finished": 12, "unphysical": 2}},
            "2 members gave no result; 3 of 12 members did not come to rest",
        ),
    ],
)
def test_a_hazard_map_names_them(tmp_path, record, words):
    assert unfinished_members(tmp_path, record | {"state": "finished"}, 12) == words
