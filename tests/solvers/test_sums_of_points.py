"""Sums over the points of a run: against NumPy, the same bits with any number of threads, of the current state."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from column_scenes import terrain_of
from hypothesis import given, settings
from hypothesis import strategies as st
from point_scenes import block_of, points_on

from mpmgis.compiled import particle_slices
from mpmgis.compiled.jit import set_threads
from mpmgis.frames.particles import Frame
from mpmgis.laws.material import drucker_prager, elastic
from mpmgis.laws.material_choice import stored_energy
from mpmgis.solvers.points import point_sums as sums
from mpmgis.solvers.points import point_time_step as clock
from mpmgis.solvers.points.point_balances import PointBalances
from mpmgis.solvers.points.point_blocks import packed
from mpmgis.solvers.points.point_rows import MASS, PX, PZ, ROW_LONG, ROW_SHORT, S2, S7, Y, Z

ICE = elastic(6.7e6, 4e6)
SOIL = drucker_prager(6.7e6, 4e6, 35.0, 500.0)
FLAT = terrain_of(lambda x, y: 0.0 * x, 60.0, 60.0, 5.0)
DX, GRAVITY, DENSITY = 0.5, 9.81, 1000.0


def random_points(count, width, dtype, seed):
    """(rows, keys, lowest) of points anywhere in 6 x 5 x 3 blocks, strained by up to half."""
    random = np.random.default_rng(seed)
    rows = np.zeros((count, width), dtype)
    rows[:, : Z + 1] = random.uniform(0.5, 4.5, (count, 3))
    rows[:, PX : PZ + 1] = random.normal(0.0, 5.0, (count, 3))
    rows[:, MASS] = random.uniform(0.1, 2.0, count)
    scale = random.choice([1e-3, 0.1, 0.5], (count, 1))
    for k in [3, 11, 15, 19, *range(20, min(width, S7))]:
        rows[:, k] = (scale * random.uniform(-0.5, 0.5, (count, 1)))[:, 0]
    row, column, level = (random.integers(0, n, count) for n in (6, 5, 3))
    lowest = random.integers(-2, 3, (7, 6, 2))
    return rows, np.array([packed(*key) for key in zip(row, column, level, strict=True)], np.int64), lowest


class Points(PointBalances):
    """Balances of given rows, without a run."""

    def __init__(self, rows, keys, lowest, material):
        self.moving, self._lowest = (rows, None, keys), lowest
        self.numerics = SimpleNamespace(cell_size=DX, gravity=GRAVITY, density=DENSITY)
        self.effects = SimpleNamespace(material=material)

    def _seen(self):
        return self.moving


@settings(max_examples=25, deadline=None)
@given(
    st.sampled_from([1, 63, 64, 65, 127, 128, 500]),
    st.sampled_from([np.float32, np.float64]),
    st.sampled_from([(ROW_SHORT, ICE), (ROW_LONG, SOIL)]),
    st.integers(0, 1000),
)
def test_sums_are_those_of_numpy(count, dtype, kind, seed):
    width, material = kind
    rows, keys, lowest = random_points(count, width, dtype, seed)
    points = Points(rows, keys, lowest, material)
    found, mass = points._sums(), rows[:, MASS].astype(float)
    momentum, place = rows[:, PX : PZ + 1].astype(float), points._places(rows, keys)
    energies = [
        stored_energy(material, [float(rows[p, k]) if k < width else 0.0 for k in (3, 11, 15, 19, 20, 21, 22, 23)])
        for p in range(count)
    ]
    expected = np.zeros(sums.SUMS)
    expected[: sums.MOMENTUM_ABS] = momentum.sum(axis=0)
    expected[sums.MOMENTUM_ABS] = np.abs(momentum).sum()
    expected[sums.KINETIC] = (0.5 * (momentum**2).sum(axis=1) / mass).sum()
    expected[sums.POTENTIAL] = (mass * GRAVITY * place[:, 2]).sum()
    expected[sums.STORED] = (mass / DENSITY * np.array(energies)).sum()
    expected[sums.OF_STATE] = (mass * rows[:, S2]).sum()
    largest = np.array([np.abs(momentum).sum(), (mass * GRAVITY * np.abs(place[:, 2])).sum()])
    bound = 1e-13 * np.array([*[largest[0]] * 4, expected[4], largest[1], expected[6], mass.sum()])
    bound[sums.STORED] *= 1.0 if dtype == np.float64 else 1e7  # strains have the precision of the rows
    assert (np.abs(found - expected) <= bound).all()
    np.testing.assert_allclose(points._speeds(), np.linalg.norm(momentum, axis=1) / mass, rtol=1e-14)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 400), st.sampled_from([np.float32, np.float64]), st.integers(0, 1000))
def test_the_mass_of_cells_is_linear_between_their_centres(count, dtype, seed):
    """The largest thickness, its place and its time, against sums of NumPy; points on cell edges too."""
    rows, keys, lowest = random_points(count, ROW_SHORT, dtype, seed)
    rows[::3, : Y + 1] = np.round(2.0 * rows[::3, : Y + 1]) / 2.0
    points = Points(rows, keys, lowest, ICE)
    points._clock = np.zeros(200)
    points.kernel = SimpleNamespace(TIME=clock.TIME)
    points._note_thickness()
    cell = points._places(rows, keys)[:, :2] / DX - 0.5
    held = {}
    for (x, y), mass in zip(cell, rows[:, MASS].astype(float), strict=True):
        for i in (np.floor(x), np.floor(x) + 1):
            for j in (np.floor(y), np.floor(y) + 1):
                held[i, j] = held.get((i, j), 0.0) + mass * (1 - abs(x - i)) * (1 - abs(y - j))
    assert points._clock[clock.DEEPEST] == pytest.approx(max(held.values()) / (DENSITY * DX * DX), rel=1e-12)
    at = points._clock[clock.DEEPEST_X] / DX - 0.5, points._clock[clock.DEEPEST_X + 1] / DX - 0.5
    assert held[at] == pytest.approx(max(held.values()), rel=1e-12)


def test_bits_do_not_depend_on_threads(monkeypatch):
    """Slices have a fixed size, so that sums, frames and states are the same with any number of threads."""
    monkeypatch.setattr(particle_slices, "SLICE", 1000)
    rows, keys, lowest = random_points(10_500, ROW_LONG, np.float32, 3)
    set_threads(1)
    try:
        one = Points(rows, keys, lowest, SOIL)
        expected = one._sums().tobytes(), one._speeds().tobytes()
        set_threads(None)
        for _ in range(3):
            several = Points(rows, keys, lowest, SOIL)
            assert (several._sums().tobytes(), several._speeds().tobytes()) == expected
    finally:
        set_threads(None)


@pytest.mark.parametrize("mass", [0.1, 0.3])
def test_the_percentile_of_the_speed_does_not_depend_on_the_precision(mass):
    """Of equal masses the share that exceeds it is exact; sums of float32 masses gave the next point."""
    rows, keys, lowest = random_points(100_000, ROW_SHORT, np.float32, 1)
    rows[:, MASS] = mass
    rows[:, PX : PZ + 1] = 0.0
    rows[:, PX] = np.float32(mass) * np.random.default_rng(2).permutation(len(rows))
    assert Points(rows, keys, lowest, ICE)._speed_p999() == pytest.approx(len(rows) - 101, abs=0.1)


@pytest.mark.parametrize("count", [0, 1, 999, 1000, 1001, 5500])
def test_slices_cover_each_particle_once(count, monkeypatch):
    monkeypatch.setattr(particle_slices, "SLICE", 1000)
    seen = np.zeros(count, int)

    def look(some):
        seen[some] += 1
        return some.stop - some.start

    assert sum(particle_slices.in_slices(look, count)) == count and (seen == 1).all()
    values = np.random.default_rng(0).normal(size=(count, 3))
    index = np.flatnonzero(values[:, 0] > 0.0)
    assert (particle_slices.copied(values) == values).all() and (
        particle_slices.taken(values, index) == values[index]
    ).all()


def test_what_was_computed_is_forgotten_when_the_state_changes():
    """Energies after steps, after points are inserted and after a restart are those of a solver that computes anew."""

    def moving(frame, time=0.0):
        return points_on(FLAT, replace(frame, time=time), 1.0, ICE, time_step=0.01)

    def fresh(solver):
        solver._forget_computed()
        return solver.energy(), solver.balances()["momentum_error_relative"], solver.balances()["mass_now"]

    def known(solver):
        return solver.energy(), solver.balances()["momentum_error_relative"], solver.balances()["mass_now"]

    solver = moving(block_of((4, 4, 4), 0.5, (20, 20, 30), velocity=(3.0, 2.0, 1.0)))
    first = known(solver)
    solver.advance(0.1)
    frame, second = solver.frame(), known(solver)
    assert second[0] != first[0] and second == fresh(solver)
    more = block_of((2, 2, 2), 0.5, (30, 30, 30))
    solver.insert(Frame(replace(more.particles, id=np.arange(10_000, 10_000 + len(more.particles))), dimension=3))
    third = known(solver)
    assert third[2] > second[2] and third == fresh(solver)
    other = moving(block_of((4, 4, 4), 0.5, (20, 20, 30), velocity=(3.0, 2.0, 1.0)))
    other.advance(0.05)
    known(other)
    other.restore(frame)
    assert known(other)[0] == second[0] and known(other) == fresh(other)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6), st.floats(0.2, 0.3))
def test_the_elastic_energy_is_smooth_at_the_reach_of_the_series(shape, norm):
    """On both sides of |b - I| = 0.25, energies by the series and by principal values agree to 1e-11.

    Entries of 1e-90 are left out: beside them LAPACK's principal values, the reference, are wrong by 1e-9.
    """
    x = np.array([part if abs(part) > 1e-12 else 0.0 for part in shape])
    size = np.sqrt((x[:3] ** 2).sum() + 2.0 * (x[3:] ** 2).sum())
    if size < 1e-3:
        return
    x *= norm / size
    xx, yy, zz, xy, xz, yz = x.tolist()
    values = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    strain = 0.5 * np.log1p(values)
    expected = 0.5 * 6.7e6 * strain.sum() ** 2 + 4e6 * ((strain - strain.mean()) ** 2).sum()
    assert stored_energy(ICE, (*x.tolist(), 0.0, 0.0)) == pytest.approx(expected, rel=1e-11)
