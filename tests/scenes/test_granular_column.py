"""V15: a column of sand that collapses, on mu(I), through `mpmgis run`: runout as Lube et al. measured it.

README.md of the scene has the whole table and what falls short.
"""

import shutil

import numpy as np
import pytest
from chain import scene_module

sand = scene_module("granular_column")


@pytest.fixture(scope="module")
def collapsed(tmp_path_factory):
    """The function that answers the Deposit of a run, and its Column; each column is run once."""
    found = {}

    def run(*column):
        column = sand.Column(*column)
        if column not in found:
            folder = tmp_path_factory.mktemp("column") / "run"
            record = sand.make(folder, column)
            assert record["balances"]["mass_error_relative"] == 0.0
            found[column] = sand.deposit(folder, column)
            shutil.rmtree(folder)
        return found[column], column

    return run


def short(reason):
    return pytest.mark.xfail(strict=True, reason=reason)


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
@pytest.mark.parametrize(("aspect", "cells", "found"), [(1.0, 16, 1.143), (2.0, 8, 2.485), (4.0, 8, 5.157)])
def test_v15_a_plane_column_runs_out_as_measured(collapsed, aspect, cells, found):
    """99 % of the mass lie within 15 % of Lube et al. (2005): 0.95, 1.01, 1.08 times its runout."""
    deposit, column = collapsed(aspect, cells)
    assert deposit.mass99 == pytest.approx(found, rel=0.02)
    assert deposit.mass99 == pytest.approx(column.measured, rel=0.15)
    assert deposit.mass99 <= deposit.front and deposit.speed < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    ("aspect", "cells", "round", "found"),
    [
        (0.5, 32, False, 0.515),
        (1.0, 32, False, 1.221),
        (2.0, 16, False, 2.702),
        (2.0, 32, False, 2.789),
        (4.0, 16, False, 5.469),
        (4.0, 32, False, 5.357),
        (1.0, 32, True, 1.136),
        (2.0, 16, True, 2.076),
    ],
)
def test_v15_runout_is_within_15_percent_of_the_experiments(collapsed, aspect, cells, round, found):
    """0.86 to 1.14 times that of Lube et al. (2005), 0.92 of Lube et al. (2004)."""
    deposit, column = collapsed(aspect, cells, round)
    assert deposit.mass99 == pytest.approx(found, rel=0.02)
    assert deposit.mass99 == pytest.approx(column.measured, rel=0.15)


OUTSIDE = [(8.0, 16, False), (4.0, 16, True), (8.0, 8, True), (0.5, 16, False), (0.5, 16, True), (1.0, 16, True)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("column", "found"), list(zip(OUTSIDE, (9.509, 3.721, 5.376, 0.485, 0.509, 1.046), strict=True))
)
def test_v15_runout_of_high_columns_and_of_low_ones_on_few_cells(collapsed, column, found):
    """25, 16 and 19 % further than measured; 19, 18 and 16 % shorter."""
    assert collapsed(*column)[0].mass99 == pytest.approx(found, rel=0.02)


@pytest.mark.slow
@short("25, 16 and 19 % too far; 19, 18 and 16 % too short")
@pytest.mark.parametrize("column", OUTSIDE)
def test_v15_high_columns_and_low_ones_on_few_cells_run_out_as_measured(collapsed, column):
    deposit, column = collapsed(*column)
    assert deposit.mass99 == pytest.approx(column.measured, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("aspect", "round"),
    [(0.5, False), (1.0, False), (2.0, False), (4.0, False), pytest.param(1.0, True, marks=short("8.6 %"))],
)
def test_v15_runout_on_mu_of_i_changes_by_7_percent_from_16_to_32_cells(collapsed, aspect, round):
    before, after = (collapsed(aspect, cells, round)[0].mass99 for cells in (16, 32))
    assert after == pytest.approx(before, rel=0.07)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("low", "high", "round", "exponent"),
    [
        pytest.param(0.5, 1.0, False, 1.0, marks=short("1.24")),
        pytest.param(4.0, 8.0, False, 2.0 / 3.0, marks=short("0.80")),
        (0.5, 1.0, True, 1.0),
        pytest.param(2.0, 4.0, True, 0.5, marks=short("0.84")),
    ],
)
def test_v15_exponents_on_16_cells(collapsed, low, high, round, exponent):
    """Asked within 0.12."""
    near, far = (collapsed(aspect, 16, round)[0].mass99 for aspect in (low, high))
    assert np.log(far / near) / np.log(high / low) == pytest.approx(exponent, abs=0.12)


@pytest.mark.slow
def test_drucker_prager_runs_further_the_finer_its_cells_are(collapsed):
    """What `effects` and the page of limits state of it."""
    runs = [collapsed(1.0, cells, False, "DruckerPrager")[0].mass99 for cells in (8, 16, 32)]
    assert runs[0] < runs[1] < runs[2]
    assert runs[1] / runs[0] > 1.15 and runs[2] / runs[1] > 1.07


@pytest.fixture(scope="module")
def plane_strain():
    """The second program, which keeps the velocities that the grid cannot represent."""
    return scene_module("granular_column", "plane_strain")


@pytest.mark.slow
@pytest.mark.parametrize(("aspect", "found"), [(0.5, 0.532), (1.0, 1.273), (2.0, 2.813), (4.0, 5.337)])
def test_the_second_program_converges(plane_strain, aspect, found):
    """From 16 to 32 cells its runout changes by at most 4 %, for a = 1 by 5.6 %."""
    coarse, fine = (plane_strain.runout(sand.Column(aspect, cells), 4.0) for cells in (16, 32))
    assert fine == pytest.approx(found, rel=0.01) and fine == pytest.approx(coarse, rel=0.06 if aspect == 1.0 else 0.04)


@pytest.mark.slow
@short("5.6 %")
def test_the_second_program_converges_within_4_percent_for_columns_as_high_as_long(plane_strain):
    coarse, fine = (plane_strain.runout(sand.Column(1.0, cells), 4.0) for cells in (16, 32))
    assert fine == pytest.approx(coarse, rel=0.04)


@pytest.mark.slow
def test_the_time_step_matters_less_where_residual_velocities_are_kept(plane_strain):
    column = sand.Column(1.0, 16)
    apic, kept = (
        [plane_strain.runout(column, rate, courant) for courant in (0.2, 0.6)] for rate in (plane_strain.APIC, 4.0)
    )
    assert apic[1] - apic[0] > 0.05 and 0.0 < kept[1] - kept[0] < 0.03
