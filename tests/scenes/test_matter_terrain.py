"""Another 3D code's slide, run by ours from its own particles."""

import pytest
from chain import scene_module

matter = scene_module("matter_terrain")


@pytest.mark.slow
@pytest.mark.skipif(not matter.DATA.is_dir(), reason="no third-party data: ../shared/data/matter_terrain")
def test_our_run_ends_where_matters_does(tmp_path):
    """Measured: IoU 0.804 of all times and 0.683 of the deposits, centres of mass within 1.3 m after 370 m of travel.

    The bed of Matter lets points sink by up to a cell, and its flow spreads further.
    """
    record = matter.make(tmp_path / "ms")
    found = {what: (ours, theirs) for what, ours, theirs, _ in matter.compared(tmp_path / "ms")}
    assert record["state"] == "finished" and record["balances"]["mass_error_relative"] == 0.0
    assert record["balances"]["mass_lifted_onto_ground"] <= 0.005 * record["balances"]["mass_start"]
    assert record["volume"]["kept"] and record["volume"]["packed_share"] <= 0.03
    assert float(found["overlap of the footprints (IoU), all times"][0]) > 0.78
    assert float(found["overlap of the deposits (IoU)"][0]) > 0.66
    for what, largest in {
        "centre of mass at 9 s, E [m]": 1.5,
        "centre of mass at 18 s, E [m]": 1.5,
        "centre of mass at 30 s, E [m]": 2.0,
        "centre of mass at 30 s, height [m]": 0.6,
        "front of the deposit, E [m]": 31.0,
        "volume at 30 s [m3]": 1.0,
    }.items():
        ours, theirs = map(float, found[what])
        assert abs(ours - theirs) <= largest, what
    assert float(found["volume at 30 s [m3]"][0]) == pytest.approx(18732.6, rel=1e-4)
