"""Another 3D code's slide, run by ours from its own particles."""

import pytest
from chain import scene_module

matter = scene_module("matter_terrain")


@pytest.mark.slow
@pytest.mark.skipif(not matter.DATA.is_dir(), reason="no third-party data: ../shared/data/matter_terrain")
def test_our_run_ends_where_matters_does(tmp_path):
    """Measured: IoU 0.965 of all times and 0.947 of the deposits, centres of mass within 1 m after 370 m of way."""
    record = matter.make(tmp_path / "ms")
    found = {what: (ours, theirs) for what, ours, theirs, _ in matter.compared(tmp_path / "ms")}
    assert record["state"] == "finished" and record["balances"]["mass_error_relative"] == 0.0
    assert float(found["overlap of the footprints (IoU), all times"][0]) > 0.95
    assert float(found["overlap of the deposits (IoU)"][0]) > 0.93
    for what, largest in {
        "centre of mass at 9 s, E [m]": 1.0,
        "centre of mass at 18 s, E [m]": 1.5,
        "centre of mass at 30 s, E [m]": 2.0,
        "centre of mass at 30 s, height [m]": 0.3,
        "front of the deposit, E [m]": 8.0,
        "volume at 30 s [m3]": 1.0,
    }.items():
        ours, theirs = map(float, found[what])
        assert abs(ours - theirs) <= largest, what
    assert float(found["volume at 30 s [m3]"][0]) == pytest.approx(18732.6, rel=1e-4)
