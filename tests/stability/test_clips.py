"""Every clip counts the particle-steps in which it acted; a report names the clips that acted unusually often."""

import numpy as np
import pytest
from column_scenes import columns_of, solver_on, terrain_of
from point_scenes import block_of, integrate_to, points_on
from test_guard import SOIL

from mpmgis.laws.friction import friction_law
from mpmgis.simulation.run_summary import CLIP_SHARE, CLIPPED, account
from mpmgis.solvers.columns import column_balances, column_rows
from mpmgis.solvers.points import point_balances
from mpmgis.solvers.points.point_blocks import set_places


def flat(length=40.0, width=20.0):
    return terrain_of(lambda x, y: 0.0 * x, length, width, 1.0)


def heap(velocity=(0.0, 0.0), **more):
    """A square heap of columns on level ground."""
    return solver_on(
        flat(), columns_of(2.0, 15, 25, 5, 15, 0.5, velocity=velocity), 1.0, friction_law("Coulomb", 0.3), **more
    )


def test_a_usual_flow_is_held_nowhere_and_its_steps_are_counted():
    solver = heap()
    solver.advance(1.0)
    balances = solver.balances()
    assert balances["particle_steps"] == solver.step * 400
    assert set(balances["clips"]) == set(column_balances.CLIPS)
    assert max(balances["clips"].values()) <= CLIP_SHARE * balances["particle_steps"]


@pytest.mark.parametrize(
    ("name", "column", "value"),
    [
        ("thinnest_column", column_rows.AREA, 1e9),
        ("area_factor", column_rows.U, 400.0),
        ("speed_bound", column_rows.U, 400.0),
    ],
)
def test_what_is_done_to_one_column_is_counted(name, column, value):
    solver = heap()
    rows = solver.arrays.rows
    if name == "thinnest_column":
        rows[100, column] = value
    else:  # halves that move towards each other: in one step they would pass through each other
        rows[:, column] = np.where(rows[:, column_rows.X] < 20.0, value, -value)
    solver._clock[solver.kernel.SPEED] = 1.0
    solver.advance(10.0, max_steps=1)
    assert solver.balances()["clips"][name] >= 1


def test_walls_hold_columns_and_points_and_count_them():
    solver = heap((30.0, 0.0), edges="wall", cfl=0.9)
    solver.advance(1.0)
    assert set(solver.balances()["clips"]) == set(column_balances.CLIPS)
    block = block_of((4.0, 4.0, 4.0), 0.5, (30.0, 8.0, 0.0), velocity=(20.0, 0.0, 0.0))
    walled = points_on(flat(), block, 1.0, SOIL, friction_law("Coulomb", 0.3), edges="wall")
    integrate_to(walled, 0.5)
    balances = walled.balances()
    assert balances["particle_steps"] == walled.step * 512 and set(balances["clips"]) == set(point_balances.CLIPS)


def test_points_under_the_ground_are_counted_one_by_one():
    solver = points_on(
        flat(), block_of((4.0, 4.0, 4.0), 0.5, (18.0, 8.0, 0.0)), 1.0, SOIL, friction_law("Coulomb", 0.3)
    )
    solver._settings = solver._settings._replace(leak_stop=1.0)
    place = solver.frame().particles.position - solver._corner_from((0.0, 0.0, 0.0))
    place[0, 2] -= 3.0
    set_places(solver.arrays.rows, solver.arrays.keys, place, 1.0, solver._lowest)
    solver.advance(1.0, 2.0, 1)
    assert solver.balances()["clips"]["lifted_onto_ground"] == 1


def test_the_account_names_clips_above_their_share_and_no_others():
    solver = heap()
    solver.advance(0.5)
    balances = solver.balances()
    steps = balances["particle_steps"]
    for name in column_balances.CLIPS:
        for share, told in ((0.5 * CLIP_SHARE, False), (2.0 * CLIP_SHARE, True)):
            clips = dict.fromkeys(column_balances.CLIPS, 0.0) | {name: share * steps}
            lines = [line for line in account(balances | {"clips": clips}, "columns") if line.startswith("clipped: ")]
            assert [CLIPPED[name] in line for line in lines] == [True] * told
    assert set(CLIPPED) == set(column_balances.CLIPS) | set(point_balances.CLIPS)


def test_the_account_names_corrections_of_volumes_with_their_energy():
    solver = points_on(
        flat(), block_of((4.0, 4.0, 4.0), 0.5, (18.0, 8.0, 0.0)), 1.0, SOIL, friction_law("Coulomb", 0.3)
    )
    integrate_to(solver, 0.1)
    balances = solver.balances()
    assert balances["volume_corrections"] == 0 and balances["energy_of_volume_corrections"] == 0.0
    for share, energy, word in ((0.5, 1.0, None), (2.0, 0.25, "supplied 25 %"), (2.0, -0.03, "took 3 %")):
        corrected = {
            "volume_corrections": int(share * CLIP_SHARE * balances["particle_steps"]) + 1,
            "energy_of_volume_corrections": energy * balances["energy_start"],
        }
        lines = [line for line in account(balances | corrected, "points") if "corrections of volumes" in line]
        assert [word in line for line in lines] == [True] * (word is not None)
