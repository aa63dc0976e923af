"""V15: a column of sand that collapses, on mu(I), through `mpmgis run`: runout as Lube et al. measured it.

README.md of the scene has the whole table and what falls short.
"""

import numpy as np
import pytest
from chain import scene_module

sand = scene_module("granular_column")


def collapsed(folder, *column):
    """The Deposit of a run, and its Column."""
    column = sand.Column(*column)
    record = sand.make(folder / "_".join(map(str, column)), column)
    assert record["balances"]["mass_error_relative"] == 0.0
    return sand.deposit(folder / "_".join(map(str, column)), column), column


def test_the_laws_of_the_experiments_join():
    for law, border in ((sand.lube_plane, 1.8), (sand.lube_plane, 2.8), (sand.lube_round, 1.7)):
        assert law(border - 1e-9) == pytest.approx(law(border + 1e-9), rel=0.02)
    assert sand.lube_plane(4.0) / sand.lube_plane(32.0) == pytest.approx(0.25)
    assert sand.lube_round(4.0) / sand.lube_round(16.0) == pytest.approx(0.5)


def test_a_deposit_ends_where_it_is_one_grain_thick():
    """A wedge from 2 L0 down to nothing at 3 L0, its points on a lattice as the run's; lone points before it."""
    column = sand.Column(1.0, 8)
    step = column.cell / sand.PER_CELL
    x, z = (part.ravel() for part in np.meshgrid((np.arange(60) + 0.5) * step, (np.arange(16) + 0.5) * step))
    inside = z < np.clip(0.3 - x, 0.0, 0.1) * 0.8
    out = np.repeat(x[inside], sand.WIDE * sand.PER_CELL)
    end = sand.ends(np.append(out, 0.36), column)
    assert 2.0 * sand.LENGTH < end <= 3.0 * sand.LENGTH


@pytest.mark.thorough
@pytest.mark.parametrize(("aspect", "cells", "found"), [(1.0, 16, 1.125), (2.0, 8, 2.274), (4.0, 8, 5.090)])
def test_v15_a_plane_column_runs_out_as_measured(tmp_path, aspect, cells, found):
    """99 % of the mass lie within 15 % of Lube et al. (2005): 0.94, 0.92, 1.06 times its runout."""
    deposit, column = collapsed(tmp_path, aspect, cells)
    assert deposit.mass99 == pytest.approx(found, rel=0.02)
    assert deposit.mass99 == pytest.approx(column.measured, rel=0.15)
    assert deposit.mass99 <= deposit.front and deposit.speed < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    ("aspect", "change"),
    [
        (0.5, 0.07),
        pytest.param(1.0, 0.07, marks=pytest.mark.xfail(strict=True, reason="11 %, where 7 % is asked")),
        (2.0, 0.07),
    ],
)
def test_v15_runout_on_mu_of_i_changes_little_with_the_cells(tmp_path, aspect, change):
    """16 to 32 cells: 6.9, 10.9 and 3.8 %."""
    before, _ = collapsed(tmp_path, aspect, 16)
    after, column = collapsed(tmp_path, aspect, 32)
    assert after.mass99 == pytest.approx(column.measured, rel=0.15)
    assert after.mass99 == pytest.approx(before.mass99, rel=change)


@pytest.mark.slow
@pytest.mark.parametrize(("aspect", "found"), [(0.5, 0.85), (1.0, 0.84)])
def test_v15_a_round_column_on_16_cells(tmp_path, aspect, found):
    """99 % of the mass, over Lube et al. (2004): low round columns are 15 and 16 % short on 16 cells."""
    deposit, column = collapsed(tmp_path, aspect, 16, True)
    assert deposit.mass99 / column.measured == pytest.approx(found, abs=0.03)


@pytest.mark.slow
@pytest.mark.xfail(strict=True, reason="0.83 round on 8 cells, where 1/2 was measured")
@pytest.mark.parametrize(("low", "shape", "exponent"), [(2.0, True, 0.5)])
def test_v15_exponents_of_high_columns(tmp_path, low, shape, exponent):
    """Asked within 0.12; low columns run short and high ones too far on coarse cells."""
    near, far = (collapsed(tmp_path, aspect, 8, shape)[0].mass99 for aspect in (low, 8.0))
    assert np.log(far / near) / np.log(8.0 / low) == pytest.approx(exponent, abs=0.12)


@pytest.mark.slow
def test_drucker_prager_runs_further_the_finer_its_cells_are(tmp_path):
    """What `effects` and the page of limits state of it."""
    runs = [collapsed(tmp_path, 1.0, cells, False, "DruckerPrager")[0].mass99 for cells in (8, 16, 32)]
    assert runs[0] < runs[1] < runs[2]
    assert runs[1] / runs[0] > 1.15 and runs[2] / runs[1] > 1.07
