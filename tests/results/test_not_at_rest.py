"""A hazard map names members of an ensemble that did not come to rest."""

import pytest

from mpmgis.results.hazard.hazard_scenarios import unfinished_members


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
