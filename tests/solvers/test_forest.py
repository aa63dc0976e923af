"""Forest in the depth-averaged solver against exact solutions: resistance, detrainment, breaking, mass and energy."""

import math

import numpy as np
import pytest
from column_scenes import G, columns_of, seeded, solver_on, terrain_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mpmgis.compiled.block_order import CHUNKS
from mpmgis.laws.curvature import CURVATURE
from mpmgis.laws.entrainment import entrainment_law
from mpmgis.laws.forest import FOREST_ENTRIES, SHARE, STRENGTH, forest_breaks, forest_detrained
from mpmgis.laws.friction import friction_law
from mpmgis.solvers.columns import column_detrainment, column_forest, column_time_step
from mpmgis.solvers.columns.column_blocks import TouchedBlocks
from mpmgis.solvers.columns.feature_arrays import Places
from mpmgis.solvers.columns.node_grid import ColumnGrid

DENSITY = 1000.0
NEVER = 1e12  # [Pa] strength that no flow here reaches


def forested(frame, bed, length, width, dx, values, mu=0.0, erosion=0.0, erodible=0.0, pixel=None, **numerics):
    """A solver with forest at every node, or at those of `values(x, y)`; one kind of kernel for all tests."""
    terrain = terrain_of(bed, length, width, pixel or dx)
    grid = ColumnGrid.on(terrain, dx)
    x, y = grid.node_points()
    given_values = values(x, y) if callable(values) else np.broadcast_to(values, (*x.shape, len(values)))
    forest = np.zeros((*x.shape, FOREST_ENTRIES))
    forest[..., : given_values.shape[-1]] = np.where(grid.domain_nodes()[..., None], given_values, 0.0)
    forest[..., SHARE] = (forest[..., STRENGTH] > 0.0).astype(float)
    places = Places(forest=forest, erodible=np.full(x.shape, float(erodible)))
    laws = {"forest": True, "entrainment": entrainment_law("ErosionSpeed", erosion)}
    settings_ = {"density": DENSITY, **numerics}
    return solver_on(
        terrain,
        frame,
        dx,
        friction_law("Voellmy", mu, 1e12),
        curvature=CURVATURE,
        places=places,
        laws=laws,
        **settings_,
    )


def sheet(degrees, values, *, dx=4.0, per_side=4, speed=5.0, mu=0.2, depth=0.5, **numerics):
    """(Frame, solver) of a large sheet on a plane of `degrees`, with an initial `speed` along it."""
    slope, cosine = math.tan(math.radians(degrees)), math.cos(math.radians(degrees))
    frame = columns_of(depth, 40, 240, 0, 40, dx / per_side, velocity=(speed * cosine, 0.0))
    bed = lambda x, y: slope * (600.0 - x)  # noqa: E731
    return frame, forested(frame, bed, 600.0, 40.0, dx, values, mu, edges="wall", **numerics)


def middle(frame, solver):
    """(speed along the ground [m s-1], mass over that at the start) of the middle of the sheet, and their spread."""
    now, before = solver.frame().particles, frame.particles
    by_id = np.argsort(now.id)
    x, y = before.position[now.id[by_id].astype(int), 0], before.position[now.id[by_id].astype(int), 1]
    inside = (np.abs(x - 140) < 25) & (np.abs(y - 20) < 21)
    speed = np.linalg.norm(now.velocity[by_id][inside], axis=1)
    share = (now.mass[by_id] / before.mass[now.id[by_id].astype(int)])[inside]
    return speed.mean(), share.mean(), max(np.ptp(speed) / max(speed.mean(), 1e-9), np.ptp(share))


def speed_of(drive, drag, speed, time):
    """Exact U(t) of dU/dt = drive - drag U^2 with drive above 0."""
    limit = math.sqrt(drive / drag)
    return limit * math.tanh(math.atanh(min(speed / limit, limit / speed)) + math.sqrt(drive * drag) * time) ** (
        1 if speed < limit else -1
    )


# -------------------------------------------------------------------------------------------------------- resistance


@pytest.mark.parametrize(("degrees", "dx"), [(25.0, 8.0), (25.0, 4.0), (25.0, 2.0), (40.0, 4.0)])
def test_a_sheet_in_forest_has_the_exact_speed(degrees, dx):
    """dU/dt = g (sin - (mu + mu_f) cos) - c U^2, whatever the cells."""
    drag, added, mu, time = 0.03, 0.05, 0.2, 6.0
    frame, solver = sheet(degrees, (0.0, drag, added, NEVER), dx=dx, mu=mu, time_step=0.02)
    solver.advance(time)
    angle = math.radians(degrees)
    exact = speed_of(G * (math.sin(angle) - (mu + added) * math.cos(angle)), drag, 5.0, time)
    speed, share, spread = middle(frame, solver)
    assert speed == pytest.approx(exact, rel=2e-3)
    assert share == 1.0 and spread < 1e-3


def test_the_speed_converges_with_the_time_step():
    drag, time = 0.05, 4.0
    exact = speed_of(G * (math.sin(math.radians(30)) - 0.2 * math.cos(math.radians(30))), drag, 15.0, time)
    errors = []
    for step in (0.16, 0.08, 0.04):
        frame, solver = sheet(30.0, (0.0, drag, 0.0, NEVER), speed=15.0, time_step=step)
        solver.advance(time)
        errors.append(abs(middle(frame, solver)[0] - exact))
    assert errors[1] < 0.6 * errors[0] and errors[2] < 0.6 * errors[1]


@pytest.mark.parametrize(("added", "moves"), [(0.12, True), (0.22, False)])
def test_added_friction_holds_what_is_flatter_than_it(added, moves):
    """tan(22 degrees) = 0.404 against mu + mu_f = 0.32 and 0.42: a static test, exact."""
    frame, solver = sheet(22.0, (0.0, 0.0, added, NEVER), speed=0.0)
    solver.advance(2.0)
    assert (middle(frame, solver)[0] > 0.5) == moves
    assert moves or middle(frame, solver)[0] == 0.0


# ------------------------------------------------------------------------------------------------------- detrainment


def exact_loss(k, time, speed, deceleration, depth):
    """h / h0 [1] of dh/dt = -K / (rho U), U = speed - deceleration t, until U or h is 0."""
    if deceleration == 0.0:
        lost = k * time / (DENSITY * speed)
    else:
        lost = k / (DENSITY * deceleration) * math.log(speed / (speed - deceleration * time))
    return max(1.0 - lost / depth, 0.0)


@pytest.mark.parametrize("degrees", [0.0, 30.0])
@pytest.mark.parametrize("dx", [8.0, 4.0])
def test_a_sheet_of_constant_speed_loses_mass_linearly(degrees, dx):
    """Normal thickness falls by K / (rho U); friction balances the slope, so that U stays."""
    mu, k, time = math.tan(math.radians(degrees)), 200.0, 5.0
    frame, solver = sheet(degrees, (k, 0.0, 0.0, NEVER), dx=dx, mu=mu, speed=8.0, gravity=G if mu else 1e-9)
    solver.advance(time)
    speed, share, _ = middle(frame, solver)
    assert speed == pytest.approx(8.0, rel=2e-3)
    normal = 0.5 * math.cos(math.radians(degrees))
    assert share == pytest.approx(exact_loss(k, time, 8.0, 0.0, normal), abs=2e-3)


def test_all_of_a_thin_sheet_stops_when_it_is_used_up():
    """0.5 m at 8 m/s with K 2000 Pa: all mass stops within 2 s. No columns are left; the mass is on the ground."""
    frame, solver = sheet(0.0, (2000.0, 0.0, 0.0, NEVER), mu=0.0, speed=8.0, gravity=1e-9)
    solver.advance(1.9)
    assert middle(frame, solver)[1] == pytest.approx(0.05, abs=0.01)
    solver.advance(2.2)
    b = solver.balances()
    assert 1 <= solver.particles < 0.04 * len(frame.particles)  # a film before the front, where no trees are reached
    assert b["mass_detrained"] > 0.9999 * b["mass_start"] and abs(b["mass_error_relative"]) <= 1e-12
    lying = solver.fields.forest_state[..., column_forest.STOPPED].sum()
    assert lying == pytest.approx(b["mass_detrained"], rel=1e-12)


def test_a_slowing_sheet_loses_mass_by_the_logarithm_of_its_speed():
    """On level ground U = U0 - mu g t; flow at rest keeps its mass. The error decreases with the time step."""
    k, mu, speed, time = 150.0, 0.3, 10.0, 3.0
    exact, errors = exact_loss(k, time, speed, mu * G, 0.5), []
    for step in (0.1, 0.05, 0.025):
        frame, solver = sheet(0.0, (k, 0.0, 0.0, NEVER), mu=mu, speed=speed, time_step=step)
        solver.advance(time)
        errors.append(abs(middle(frame, solver)[1] - exact))
    assert errors[-1] < 2e-3 and errors[1] < 0.7 * errors[0] and errors[2] < 0.7 * errors[1]
    solver.advance(4.0)
    rests = middle(frame, solver)
    assert rests[0] == 0.0
    solver.advance(5.0)
    assert middle(frame, solver)[1] == rests[1] > 0.0


def test_the_loss_does_not_depend_on_the_number_of_columns():
    shares = []
    for per_side in (2, 3, 5):
        frame, solver = sheet(30.0, (300.0, 0.02, 0.0, NEVER), per_side=per_side, speed=8.0, time_step=0.05)
        solver.advance(4.0)
        shares.append(middle(frame, solver)[1])
    assert np.ptp(shares) < 2e-3 and shares[0] < 0.9


def test_detrained_mass_takes_its_momentum_along():
    """The rest keeps its speed (Feistl et al. 2014: the stress K on the flow is the momentum of what stops)."""
    frame, solver = sheet(0.0, (500.0, 0.0, 0.0, NEVER), mu=0.0, speed=10.0, gravity=1e-9)
    solver.advance(4.0)
    p, b = solver.frame().particles, solver.balances()
    assert middle(frame, solver)[0] == pytest.approx(10.0, rel=1e-9)
    momentum = (p.mass * p.velocity[:, 0]).sum()
    assert momentum == pytest.approx(10.0 * (b["mass_start"] - b["mass_detrained"]), rel=1e-6)


# ------------------------------------------------------------------------------------------------ limits, as in com1DFA


@pytest.mark.parametrize(
    ("slow", "thin", "takes"),
    [(5.0, 0.0, False), (8.1, 0.0, True), (0.0, 0.42, False), (0.0, 0.45, True), (5.0, 0.42, False), (5.0, 0.45, True)],
)
def test_within_the_limits_mass_stops_and_beyond_them_the_flow_is_braked(slow, thin, takes):
    """8 m/s and 0.5 cos 30 = 0.433 m: the rule of com1DFA, slow or thin flow loses mass, the rest is braked."""
    mu, k, drag, time = math.tan(math.radians(30.0)), 200.0, 0.02, 0.5
    frame, solver = sheet(30.0, (k, drag, 0.0, NEVER, slow, thin), mu=mu, speed=8.0, time_step=0.02)
    solver.advance(time)
    speed, share, _ = middle(frame, solver)
    if takes:
        assert speed == pytest.approx(8.0, rel=2e-3)
        assert share == pytest.approx(exact_loss(k, time, 8.0, 0.0, 0.5 * math.cos(math.radians(30.0))), abs=2e-3)
    else:
        assert share == 1.0
        assert speed == pytest.approx(8.0 / (1.0 + drag * 8.0 * time), rel=2e-3)


def test_a_braked_sheet_loses_mass_once_it_is_slow_enough():
    """Level ground, drag alone from 10 m/s down to 6 m/s, detrainment alone from then on: both parts are exact."""
    k, drag, time = 300.0, 0.1, 2.0
    frame, solver = sheet(0.0, (k, drag, 0.0, NEVER, 6.0), mu=0.0, speed=10.0, gravity=1e-9, time_step=0.005)
    solver.advance(time)
    speed, share, _ = middle(frame, solver)
    slow_at = (10.0 / 6.0 - 1.0) / (drag * 10.0)
    assert speed == pytest.approx(6.0, rel=5e-3)
    assert share == pytest.approx(exact_loss(k, time - slow_at, 6.0, 0.0, 0.5), abs=3e-3)


@pytest.mark.parametrize(("thickest", "breaks"), [(0.49, True), (0.51, False), (0.0, False)])
def test_thick_flow_breaks_forest(thickest, breaks):
    _, solver = sheet(0.0, (0.0, 0.02, 0.0, NEVER, 0.0, 0.0, thickest), mu=0.0, speed=5.0, gravity=1e-9)
    solver.advance(0.5)
    assert (solver.balances()["forest_broken_area"] > 5000.0) == breaks


# ---------------------------------------------------------------------------------------------------------- breaking


@pytest.mark.parametrize(("strength", "breaks"), [(0.98e5, True), (1.02e5, False)])
def test_forest_breaks_at_the_pressure_of_the_front(strength, breaks):
    """10 m/s and 1000 kg/m3 give 100 kPa. Broken forest has no resistance; standing forest brakes with c."""
    drag = 0.05
    frame = columns_of(1.0, 20, 120, 0, 40, 1.0, velocity=(10.0, 0.0))
    values = lambda x, y: np.where((x > 150)[..., None], (0.0, drag, 0.0, strength), 0.0)  # noqa: E731
    solver = forested(frame, lambda x, y: 0 * x, 400.0, 40.0, 4.0, values, edges="wall", gravity=1e-9, time_step=0.05)
    solver.advance(20.0)
    p, b = solver.frame().particles, solver.balances()
    if breaks:
        assert b["forest_broken_area"] > 0.95 * (320 - 152) * 40.0
        np.testing.assert_allclose(p.velocity[:, 0], 10.0, rtol=1e-9)
        assert b["energy_lost_to_forest"] == 0.0
    else:
        assert b["forest_broken_area"] == 0.0
        way = p.position[:, 0].max() - 150.0  # of the front: U = U0 exp(-c s)
        exact = math.log(1.0 + drag * 10.0 * (20.0 - 3.0)) / drag
        assert way == pytest.approx(exact, rel=0.05)


def test_broken_forest_stops_no_more_mass_and_stays_broken():
    frame, solver = sheet(0.0, (500.0, 0.0, 0.0, 5e4), mu=0.35, speed=10.0)  # 100 kPa at first, later below 50
    solver.advance(2.5)
    b = solver.balances()
    assert 0.0 < b["forest_broken_area"] <= b["forest_area"]
    assert middle(frame, solver)[1] == 1.0


# ------------------------------------------------------------------------------------------------- ledger and restart


def hill(x, y, turn=0.0):
    """30 degrees that ease to level ground, turned by `turn` about the middle of the map."""
    along = (x - 120) * math.cos(turn) + (y - 120) * math.sin(turn) + 120
    return 0.5 * math.tan(math.radians(30)) * np.maximum(160.0 - along, 0.0) ** 2 / 80.0


def wood(seed, k, strength):
    """Random patches of forest: values(x, y)."""
    rng = np.random.default_rng(seed)
    patches = rng.uniform((40, 40, 10), (200, 200, 50), (8, 3))
    own = np.column_stack(
        [k * rng.random(8), 0.05 * rng.random(8), 0.1 * rng.random(8), strength * (0.1 + rng.random(8))]
    )

    def values(x, y):
        found = np.zeros((*x.shape, 4))
        for (east, north, radius), kind in zip(patches, own, strict=True):
            found = np.where((np.hypot(x - east, y - north) < radius)[..., None], kind, found)
        return found

    return values


@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(
    seed=st.integers(0, 1000),
    turn=st.floats(0, 6.28),
    k=st.sampled_from([20.0, 500.0, 5000.0]),
    strength=st.sampled_from([1e3, 2e4, NEVER]),
    dx=st.sampled_from([3.0, 5.0, 8.0]),
    speed=st.sampled_from([0.0, 12.0]),
    erodible=st.sampled_from([0.0, 300.0]),
    edges=st.sampled_from(["open", "wall"]),
)
def test_mass_and_energy_close_and_a_restart_is_the_same(seed, turn, k, strength, dx, speed, erodible, edges):
    east, north = 120 - 60 * math.cos(turn), 120 - 60 * math.sin(turn)
    velocity = (speed * math.cos(turn), speed * math.sin(turn))

    def made():
        frame = seeded(1.5, east - 15, east + 15, north - 15, north + 15, dx, per_side=3, velocity=velocity)
        return forested(
            frame,
            lambda x, y: hill(x, y, turn),
            240.0,
            240.0,
            dx,
            wood(seed, k, strength),
            0.15,
            5e-3,
            erodible,
            edges=edges,
        )

    solver = made()
    solver.advance(6.0)
    half = solver.frame()
    solver.advance(12.0)
    b = solver.balances()
    come = b["mass_start"] + b["mass_entrained"]
    assert abs(b["mass_flowing"] + b["mass_at_rest"] + b["mass_detrained"] + b["mass_out"] - come) <= 1e-12 * come
    lying = solver.fields.forest_state[..., column_forest.STOPPED]
    assert lying.min() >= 0.0 and abs(lying.sum() - b["mass_detrained"]) <= 1e-12 * come
    trees = solver.fields.forest[..., 3] > 0.0
    assert not lying[~trees].any()
    assert abs(b["energy_error_relative"]) < 1e-3
    again = made()
    again.restore(half)
    again.advance(12.0)
    one, other = solver.frame(), again.frame()
    assert one.particles.mass.tobytes() == other.particles.mass.tobytes()
    assert one.particles.position.tobytes() == other.particles.position.tobytes()
    for name in ("forest", "forest_sums", "clock", "erodible"):
        assert one.state[name].tobytes() == other.state[name].tobytes(), name


# ---------------------------------------------------------------------------------------------------- compiled, plain


def test_laws_and_kernels_agree_with_plain_python():
    """Passes over nodes and columns with the compiled and with the plain functions, from the same state."""
    states = []
    for plain in (False, True):
        frame = seeded(1.5, 45, 75, 105, 135, 8.0, per_side=2)
        solver = forested(frame, hill, 240.0, 240.0, 8.0, wood(2, 500.0, 1e5), 0.15, 5e-3, 300.0)
        solver.advance(3.0)
        states.append(_passes(solver, plain))
    for one, other in zip(*states, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-300)
    assert all(array.any() for array in states[0])


def _passes(solver, plain):
    """Shares of nodes, mass that stopped, sums and masses after one more pass over the nodes of the last step."""

    def function(f):
        return getattr(f, "py_func", f) if plain else f

    fields, effects, settings_ = solver.fields, solver.effects, solver._settings
    nodes, counts = solver._nodes, solver._counts
    west, south, east, north = (int(counts[k]) for k in range(column_time_step.WEST, column_time_step.NORTH + 1))
    width, height = east - west + 1, north - south + 1
    places = np.arange((width + 1) * (height + 1), dtype=np.int32)
    touched = TouchedBlocks(places, len(places), west, south, width, height)
    function(column_forest.find_shares)(nodes, fields, touched, 0.1, settings_, effects.metric, effects.entrainment)
    shares = fields.forest_share.copy()
    n = int(counts[column_time_step.ROWS])
    order = np.arange(n, dtype=np.int32)
    function(column_detrainment.detrain)(
        solver.arrays.rows, solver.arrays.keys, order, n, fields, solver._clock, counts, 0.05, settings_, effects.metric
    )
    momentum, report = nodes.copy(), np.zeros(CHUNKS)
    momentum[..., 1:3] *= momentum[..., :1]
    momentum[..., 3] = 0.5 * momentum[..., 0] * 25.0
    fields.forest_state[..., column_forest.TREES] = 0.0
    function(column_forest.break_forest)(momentum, fields, touched, report, settings_, effects.metric)
    resistance = [
        function(column_forest.added_resistance)(fields.forest, fields.forest_state, j, i, 9.0)
        for j, i in np.ndindex(fields.forest_share.shape)
    ]
    return (
        shares,
        fields.forest_state.copy(),
        fields.forest_sums.copy(),
        solver.arrays.rows[:n].copy(),
        np.array(resistance),
        report,
    )


def test_trees_break_and_detrain_by_their_numbers():
    assert forest_detrained(30.0, 0.0, 1.0) == 0.0
    assert forest_detrained(30.0, 10.0, 2.0) == 6.0
    assert forest_breaks(1e5, 0.0, 1000.0, 1.0, 10.0) and forest_breaks(1e9, 0.9, 1000.0, 1.0, 10.0)
    assert not forest_breaks(1.001e5, 0.0, 1000.0, 1.0, 10.0)
