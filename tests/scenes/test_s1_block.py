"""NHESS 25:3897, supplement S1, through `mpmgis run` and `mpmgis export-raster` (V2 of the catalogue)."""

import numpy as np
import pytest
from chain import scene_module

s1 = scene_module("s1_block")


@pytest.mark.thorough
@pytest.mark.parametrize(("cell", "interval"), [(0.05, 0.005), pytest.param(0.01, None, marks=pytest.mark.slow)])
def test_the_block_of_the_paper_from_points_to_bands(tmp_path, cell, interval):
    """Asked: speeds 1 %, depth in flight 2 % of 10.1 m, thickness 0.095 to 0.32 m, a point's size added."""
    record = s1.make(tmp_path / "s1", cell, interval)
    found = s1.compared(tmp_path / "s1", cell)
    assert record["state"] == "finished"
    assert record["balances"]["mass_error_relative"] == 0.0
    assert abs(record["balances"]["momentum_error_relative"]) <= 1e-10
    assert found["Ut"] <= 0.01
    assert found["Un on the plane, of v_term"] <= 0.01
    assert found["Un in flight"] <= 0.01
    assert found["h in flight, of 10.1 m"] <= 0.02
    assert found["t and a point's size [m], least"] >= 0.095
    assert found["t and a point's size [m], largest"] <= 0.32
    standoff = 0.1 - found["h on the plane [m], least"] - 0.5 * cell / s1.PER_CELL  # of the topmost point under the top
    assert abs(standoff) <= 0.5 * cell


def test_what_the_page_compares_with_is_the_papers():
    """Eqs S2 to S5 at the edge and where the tail's foot comes down, as the paper's numbers give them."""
    at = s1.exact(np.array([19.0, 19.06, 30.038]))
    np.testing.assert_allclose((s1.TERMINAL, s1.EDGE), (14.691, 19.053), atol=1e-3)
    assert at["h"] == pytest.approx([0.1, 10.1, 0.1], abs=5e-3)
    assert at["Ut"] == pytest.approx([14.67, 12.723, 12.723], abs=5e-3)
    assert at["Un"] == pytest.approx([0.0, -7.345, -15.816], abs=1e-2)
