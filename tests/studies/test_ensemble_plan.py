"""Ensemble plans: distributions, sampling, keys, and statistics against NumPy."""

import numpy as np
import pytest
from scipy import stats

from mpmgis.laws.own_law import NO_OWN_LAWS
from mpmgis.laws.quantities import MEMBER_BANDS
from mpmgis.studies.ensemble_statistics import ARRIVAL, Products, exceedances, statistics
from mpmgis.studies.sampling_plan import SamplingPlan, nearest_member, value_at
from mpmgis.studies.varied_keys import variation
from mpmgis.system.errors import InputError, SceneError

TABLES = {
    "terrain": {"dem": "dtm.tif"},
    "release": {"source": "a.shp", "thickness": 1.0},
    "friction": {"law": "Voellmy", "mu": 0.2, "xi": 1000.0},
    "zones": [{"source": "z.gpkg", "mu": 0.3}, {"source": "y.gpkg", "mu": 0.4}],
    "stage": [{"solver": "columns", "until": {"time": 5.0}}, {"solver": "points", "cell_size": 1.0}],
    "material": {"law": "Fluid", "bulk_modulus": 1e6},
    "output": {"end_time": 10.0, "frame_interval": 1.0},
}


KEYS = "friction.mu", "friction.xi", "release.thickness"


def plan(varied, **how):
    return SamplingPlan.of({key: variation(text, key) for key, text in varied.items()}, **how)


def members(varied, tables=None, **how):
    one = {name: table for name, table in TABLES.items() if name not in ("stage", "material")}
    return plan(varied, **how).members(tables or one, ".", "scene.toml", NO_OWN_LAWS)


@pytest.mark.parametrize(
    ("text", "law"),
    [
        ("0.1:0.3", stats.uniform(0.1, 0.2)),
        ("uniform:0.1:0.3", stats.uniform(0.1, 0.2)),
        ("normal:2:0.5", stats.norm(2, 0.5)),
        ("triangular:1:2:4", stats.triang(1 / 3, 1, 3)),
        ("normal:2:0.5:1.5:2.2", stats.truncnorm(-1, 0.4, 2, 0.5)),
    ],
)
def test_distributions_are_scipys(text, law):
    shares = np.linspace(0.001, 0.999, 57)
    found = [variation(text, "key").at(share) for share in shares]
    np.testing.assert_allclose(found, law.ppf(shares), rtol=1e-9)


def test_lognormal_has_the_given_mean_and_standard_deviation():
    values = [variation("lognormal:1000:400", "key").at((k + 0.5) / 5000) for k in range(5000)]
    assert np.mean(values) == pytest.approx(1000, rel=1e-3)
    assert np.std(values) == pytest.approx(400, rel=1e-2)


def test_truncated_values_stay_within_bounds_and_are_finite():
    cut = variation("lognormal:1:2:0.5:1.5", "key")
    values = [cut.at(share) for share in (0.0, 1e-300, 0.5, 1.0 - 1e-16, 1.0)]
    assert min(values) == 0.5 and max(values) == 1.5
    assert all(np.isfinite(variation("normal:0:1", "key").at(share)) for share in (0.0, 1.0))


@pytest.mark.parametrize("sampling", ["lhs", "sobol", "random"])
def test_same_seed_gives_bitwise_equal_members(sampling):
    varied = {"friction.mu": "0.1:0.3", "friction.xi": "lognormal:1000:300"}
    values = [plan(varied, sampling=sampling, samples=16, seed=seed).values() for seed in (3, 3, 4)]
    assert values[0] == values[1] != values[2]


def test_latin_hypercube_has_one_member_per_interval_of_each_key():
    values = np.array(plan({"friction.mu": "0:1", "friction.xi": "100:200"}, samples=40).values())
    for k, (low, width) in enumerate(((0, 1), (100, 100))):
        parts = np.floor((values[:, k] - low) / width * 40).astype(int)
        assert sorted(parts) == list(range(40))


def test_longer_sobol_sequences_begin_with_the_same_points():
    few, many = (plan({"friction.mu": "0.1:0.3"}, sampling="sobol", samples=n).values() for n in (8, 32))
    assert many[:8] == few
    assert not plan({"friction.mu": "0.1:0.3"}, sampling="sobol", samples=8).remark()
    assert "use 16" in plan({"friction.mu": "0.1:0.3"}, sampling="sobol", samples=12).remark()


def test_lists_are_combined_on_a_grid_and_ranges_use_medians_of_intervals():
    crossed = plan({"friction.mu": "0.1,0.2", "friction.xi": "500,1000,2000"})
    assert crossed.sampling == "grid" and crossed.count == 6
    assert crossed.values() == [(mu, xi) for mu in (0.1, 0.2) for xi in (500, 1000, 2000)]
    mixed = plan({"friction.mu": "0.1:0.5", "friction.xi": "500,1000"}, sampling="grid", samples=4)
    assert sorted({mu for mu, _ in mixed.values()}) == [0.15, 0.25, 0.35, 0.45]


def test_values_are_set_in_the_scene_tables():
    made = members({"release.thickness": "0.5,2", "zones.2.mu": "0.35", "release.speed": "5"})
    assert [m.tables["release"] for m in made] == [{"source": "a.shp", "thickness": t, "speed": 5} for t in (0.5, 2)]
    assert [z["mu"] for z in made[0].tables["zones"]] == [0.3, 0.35]
    assert TABLES["zones"][1]["mu"] == 0.4
    staged = {name: table for name, table in TABLES.items() if name != "zones"}
    made = members({"stage.1.until.time": "3:4", "stage.2.cell_size": "1,2"}, staged, samples=2)
    assert all(3 < m.tables["stage"][0]["until"]["time"] < 4 for m in made)


@pytest.mark.parametrize(
    ("varied", "words"),
    [
        ({"friction.mue": "0.1:0.3"}, ("member 1", "'mue'", "did you mean 'mu'")),
        ({"frction.mu": "0.1:0.3"}, ("frction", "did you mean 'friction'")),
        ({"cohesion.yield_stress": "1:3"}, ("no [cohesion]",)),
        ({"friction.mu": "0.1,0.2,99"}, ("member 3", "99", "at most")),
        ({"friction.mu": "normal:0.2:0.2"}, ("member", "mu = -", "at least 0")),
        ({"zones.mu": "0.1:0.3"}, ("zones.1.KEY",)),
        ({"zones.3.mu": "0.1:0.3"}, ("the scene has 2",)),
        ({"friction": "0.1:0.3"}, ("friction.KEY",)),
        ({"friction.mu.x": "0.1:0.3"}, ("friction.KEY",)),
        ({"numerics.particles_per_cell": "4:16"}, ("member 1", "a whole number")),
    ],
)
def test_invalid_keys_and_values_are_named(varied, words):
    base = {name: table for name, table in TABLES.items() if name not in ("stage", "material")} | {"numerics": {}}
    with pytest.raises(SceneError) as caught:
        members(varied, base)
    assert all(word in str(caught.value) for word in words), str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "0.3:0.1",
        "0.1:",
        "0.1:0.2:0.3",
        "normal:1",
        "normal:1:-1",
        "normal:1:1:3:2",
        "lognormal:-1:1",
        "",
        "1,,2",
        "triangular:1:5:4",
        "norml:1:2",
        "normal:a:b",
        "normal:0:1:50:60",
        "nan:1",
    ],
)
def test_invalid_distributions_are_rejected(text):
    with pytest.raises(InputError, match="--vary k") as caught:
        variation(text, "--vary k")
    assert "\n" not in str(caught.value)


# ------------------------------------------------------------------------------------------------------- statistics


@pytest.fixture(scope="module")
def stack():
    """33 members on 7 x 9 cells: some reach no cell of the first row, some no other cell; rounded to float32."""
    source = np.random.default_rng(1)
    made = source.gamma(2.0, 1.0, (33, 7, 9)).astype(np.float32)
    made[source.random(made.shape) < 0.3] = np.nan
    made[:, 0] = np.nan
    return made


def made_of(stack, products, raster):
    bands, found = products.rasters()[raster], {}
    for source in {band.source for band in bands}:
        found |= statistics(bands, source, stack.copy())
    return {band.quantity.name: found[k] for k, band in enumerate(bands)}


def test_statistics_equal_numpy_on_stacked_members(stack):
    products = Products.of({"h": (0.5, 3.0), "p": (1.0,)}, (0, 5, 37.5, 50, 100))
    depth = np.nan_to_num(stack).astype(float)
    found = made_of(stack, products, "h")
    assert set(found) == {"h_mean", "h_min", "h_max", "h_p0", "h_p5", "h_p37.5", "h_p50", "h_p100"}
    for name, expected in {
        "h_mean": depth.mean(axis=0),
        "h_min": depth.min(axis=0),
        "h_max": depth.max(axis=0),
        "h_p5": np.percentile(depth, 5, axis=0),
        "h_p37.5": np.percentile(depth, 37.5, axis=0),
        "h_p50": np.median(depth, axis=0),
    }.items():
        np.testing.assert_array_equal(found[name][1:], expected[1:].astype(np.float32), name)
        assert np.isnan(found[name][0]).all()
    probability = made_of(stack, products, "probability")
    assert list(probability) == ["P_h_0.5", "P_h_3", "P_p_1", "P_arrival"]
    np.testing.assert_array_equal(probability["P_h_3"][1:], ((depth >= 3).mean(axis=0))[1:].astype(np.float32))
    np.testing.assert_array_equal(probability["P_arrival"][1:], np.isfinite(stack).mean(axis=0)[1:].astype(np.float32))


def test_missing_arrival_is_later_than_all_others(stack):
    found = made_of(stack, Products.of(percentiles=(50, 90)), ARRIVAL)
    never = np.sort(np.where(np.isnan(stack), np.inf, stack), axis=0)
    median = never[16]  # of 33
    np.testing.assert_array_equal(found["t_arrival_p50"], np.where(np.isinf(median), np.nan, median))
    np.testing.assert_array_equal(found["t_arrival_min"][1:], np.nanmin(stack[:, 1:], axis=0))
    assert np.isnan(found["t_arrival_p90"]).mean() > 0.9  # three in ten never arrive


@pytest.mark.parametrize(
    ("members", "number", "expected"),
    [
        ([1, 2, 3, np.nan, np.nan], 50, 3.0),  # the third of five; NumPy has NaN here
        ([1, 2, 3, np.nan, np.nan], 60, np.nan),  # between the third and one that never comes
        ([4], 50, 4.0),
        ([*range(101), np.nan], 100 * 7 / 101, 7.0),  # a place that round-off leaves beside a member
        ([*range(20), np.nan], 95, 19.0),
    ],
)
def test_percentile_at_a_member_equals_its_arrival(members, number, expected):
    found = made_of(np.array(members, np.float32).reshape(-1, 1, 1), Products.of(percentiles=(number,)), ARRIVAL)
    np.testing.assert_array_equal(found[f"t_arrival_p{number:g}"], [[expected]])


def test_every_band_has_a_source_band_of_the_members():
    for bands in Products.of().rasters().values():
        assert {band.source for band in bands} <= set(MEMBER_BANDS)


def test_thresholds_are_collected_by_quantity():
    assert exceedances(["h=1,2", "p=5", "h=3"]) == {"h": (1, 2, 3), "p": (5,)}


@pytest.mark.parametrize(
    ("make", "asked", "words"),
    [
        *((exceedances, [text], "--exceed") for text in ("h", "h=", "h=a")),
        (Products.of, {"x": (1,)}, "expected one of h, Ut, p"),
        (Products.of, {"h": (0,)}, "expected numbers above 0"),
        (lambda percentiles: Products.of(percentiles=percentiles), (101,), "expected numbers from 0 to 100"),
        (SamplingPlan.of, {}, "nothing varies"),
        (lambda varied: plan(varied, sampling="grid", samples=100), dict.fromkeys(KEYS, "0:1"), "at most"),
        (lambda varied: plan(varied, sampling="latin"), {"friction.mu": "0:1"}, "lhs"),
    ],
)
def test_invalid_plans_and_products_are_rejected(make, asked, words):
    with pytest.raises(InputError, match=words):
        make(asked)


def test_list_values_have_the_types_of_a_scene_file():
    values = variation("true,false,2,0.5,text", "--vary key").values
    assert values == (True, False, 2, 0.5, "text") and [type(value) for value in values[:3]] == [bool, bool, int]


@pytest.mark.parametrize(
    ("own", "members", "nearest"),
    [
        ((0.2,), [(0.1,), (0.25,), (0.4,)], 1),
        ((0.2, 1000.0), [(0.2, 2000.0), (0.3, 1000.0), (0.21, 1010.0)], 2),  # by the range of each, not by the unit
        (("a.shp", 0.2), [("b.shp", 0.2), ("a.shp", 0.3)], 0),  # equally far: the first
        (("a.shp", 0.2), [("b.shp", 0.3), ("a.shp", 0.4), ("a.shp", 0.2)], 2),
        ((True,), [(False,), (True,)], 1),
        ((None, 0.2), [(5.0, 0.1), (9.0, 0.2)], 1),  # the scene gives no value
        ((9.0,), [(0.1,), (0.3,)], 1),  # outside the range
        ((0.2,), [(0.3,), (0.3,)], 0),
    ],
)
def test_the_reference_is_the_member_nearest_to_the_scene(own, members, nearest):
    assert nearest_member(own, members) == nearest


@pytest.mark.parametrize(
    ("key", "value"),
    [("friction.mu", 0.2), ("zones.2.mu", 0.4), ("release.density", None), ("release.source", "a.shp")],
)
def test_the_own_value_of_a_key(key, value):
    assert value_at(TABLES, key) == value
