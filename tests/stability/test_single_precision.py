"""H33: difficult 3D scenes end at the same place in single and in double precision."""

from dataclasses import replace

import numpy as np
import pytest
from hard_scenes import Watch, in_the_map
from test_same_bits import SCENES


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["sand off a step", "water off a step"])
def test_single_precision_ends_where_double_precision_does(name):
    """Mass within 1e-6; the foremost hundredth and the middle of the flow within a cell of 1 m, energies within 1 %."""
    scene, end = SCENES[name]
    ends = []
    for precision in ("float64", "float32"):
        solver = replace(scene, precision=precision).solver()
        Watch(solver).march(end, looks=2)
        ends.append((solver.mass_start, in_the_map(solver), sum(solver.energy())))
    (mass, place, energy), (single_mass, single_place, single_energy) = ends
    assert abs(single_mass / mass - 1.0) <= 1e-6
    assert np.abs(place.mean(axis=0) - single_place.mean(axis=0)).max() <= 0.1
    assert abs(np.quantile(place[:, 0], 0.99) - np.quantile(single_place[:, 0], 0.99)) <= 1.0
    assert single_energy == pytest.approx(energy, rel=0.01)
