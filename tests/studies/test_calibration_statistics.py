"""Statistics of calibrations: against the exact posterior of linear normal models, and closed forms of the emulator."""

import numpy as np
import pytest

from mpmgis.studies.calibration_posterior import (
    identified_directions,
    posterior,
    scores_of_shares,
    self_test,
    shares_of_scores,
    weighted_quantiles,
)
from mpmgis.studies.calibration_priors import priors
from mpmgis.studies.calibration_result import Calibration, rounded
from mpmgis.studies.gaussian_process import Emulator, Process
from mpmgis.studies.sampling_plan import SamplingPlan
from mpmgis.studies.varied_keys import variation
from mpmgis.system.errors import InputError

MATRIX = np.array([[1.0, 0.5], [1.0, 0.45], [0.2, 0.1]])
VARIANCES = np.array([0.01, 0.04, 0.02])


def linear(matrix):
    """Predictions of a model that is linear in the normal scores, without an error of the emulator."""
    return lambda shares: (scores_of_shares(shares) @ matrix.T, np.zeros((len(shares), len(matrix))))


def exact(observed):
    """(mean, covariance) of the posterior of the linear model with a standard normal prior."""
    covariance = np.linalg.inv(np.eye(2) + MATRIX.T @ (MATRIX / VARIANCES[:, None]))
    return covariance @ MATRIX.T @ (observed / VARIANCES), covariance


def test_the_posterior_of_a_linear_model_is_the_exact_one():
    observed = MATRIX @ [0.4, -0.7] + [0.05, -0.1, 0.08]
    found, (mean, covariance) = posterior(linear(MATRIX), observed, VARIANCES, 2, seed=1), exact(observed)
    deviation = np.sqrt(np.diag(covariance))
    assert found.inflation == 1.0 and found.effective_size > 5000
    np.testing.assert_allclose(found.weights @ found.scores, mean, atol=0.05 * deviation.max())
    np.testing.assert_allclose(found.covariance, covariance, atol=0.04 * covariance.max())
    for share, score in ((0.05, -1.6449), (0.5, 0.0), (0.95, 1.6449)):
        np.testing.assert_allclose(found.quantiles((share,))[0], mean + score * deviation, atol=0.08 * deviation.max())


def test_directions_are_eigenvectors_of_the_posterior_covariance():
    found = identified_directions(posterior(linear(MATRIX), MATRIX @ [0.4, -0.7], VARIANCES, 2, seed=1))
    values, vectors = np.linalg.eigh(exact(np.zeros(3))[1])
    np.testing.assert_allclose([one.ratio for one in found], np.sqrt(values), rtol=0.05)
    assert abs(found[0].weights @ vectors[:, 0]) > 0.999
    assert found[0].ratio < 0.1 and found[1].ratio > 0.9  # the sum is known, the difference is not


def test_without_information_the_posterior_is_the_prior():
    found = posterior(linear(np.zeros((3, 2))), np.zeros(3), VARIANCES, 2, seed=3)
    np.testing.assert_allclose(found.quantiles((0.05, 0.95)).T, [[-1.6449, 1.6449]] * 2, atol=0.06)
    np.testing.assert_allclose(found.covariance, np.eye(2), atol=0.05)


def test_a_model_that_does_not_fit_widens_the_intervals_by_its_residuals():
    """Ten equal summaries with alternating offsets of 5 deviations: chi squared is 250 with 9 degrees of freedom."""
    matrix, variances = np.ones((10, 1)), np.full(10, 0.01)
    observed = 0.5 * (-1.0) ** np.arange(10)
    found = posterior(linear(matrix), observed, variances, 1, seed=0)
    assert found.inflation == pytest.approx(250 / 9, rel=0.01)
    assert found.covariance[0, 0] == pytest.approx(1 / (1 + 1000 / found.inflation), rel=0.05)


def test_posteriors_of_the_same_seed_are_equal_and_draws_follow_the_weights():
    first, second = (posterior(linear(MATRIX), MATRIX @ [1.0, 0.0], VARIANCES, 2, seed=4, draws=512) for _ in range(2))
    np.testing.assert_array_equal(first.scores, second.scores)
    np.testing.assert_array_equal(first.weights, second.weights)
    draws = first.drawn(4000, seed=0)
    np.testing.assert_allclose(draws.mean(axis=0), first.weights @ first.scores, atol=0.02)
    np.testing.assert_allclose(np.cov(draws.T), first.covariance, atol=0.03)


def test_weighted_quantiles_of_equal_weights_are_those_of_hazen():
    values = np.random.default_rng(0).normal(size=101)
    found = weighted_quantiles(values, np.full(101, 1 / 101), (0.1, 0.5, 0.9))
    np.testing.assert_allclose(found, np.quantile(values, (0.1, 0.5, 0.9), method="hazen"))
    heavy = weighted_quantiles(np.array([3.0, 1.0, 2.0]), np.array([0.2, 0.2, 0.6]), (0.1, 0.3, 0.5, 0.9))
    np.testing.assert_allclose(heavy, [1.0, 1.5, 2.0, 3.0])


@pytest.fixture(scope="module")
def smooth():
    source = np.random.default_rng(2)
    points = source.random((60, 2))
    return points, np.column_stack([np.sin(3 * points[:, 0]) + points[:, 1] ** 2, np.full(60, 7.0)])


def test_an_emulator_predicts_a_smooth_function_and_a_constant(smooth):
    points, values = smooth
    emulator, new = Emulator.fitted(points, values), np.random.default_rng(5).random((200, 2)) * 0.9 + 0.05
    mean, variance = emulator.at(new)
    np.testing.assert_allclose(mean[:, 0], np.sin(3 * new[:, 0]) + new[:, 1] ** 2, atol=0.01)
    np.testing.assert_array_equal(mean[:, 1], 7.0)
    assert (variance[:, 0] > 0).all() and (variance[:, 1] == 0).all()


def test_the_error_of_an_emulator_is_that_of_noisy_runs():
    source = np.random.default_rng(6)
    points = source.random((150, 1))
    values = np.sin(4 * points[:, 0]) + 0.1 * source.standard_normal(150)
    mean, variance = Process.fitted(points, values).left_out()
    assert np.sqrt(variance.mean()) == pytest.approx(0.1, rel=0.25)
    assert 0.84 <= np.mean(np.abs(values - mean) < 1.645 * np.sqrt(variance)) <= 0.96


def test_left_out_predictions_in_closed_form_are_those_without_the_run():
    """With zero mean and given variance the identity is exact; here mean and variance change slightly with the run."""
    source = np.random.default_rng(7)
    points = source.random((80, 2))
    process = Process(points, np.cos(3 * points[:, 0]) * points[:, 1], np.array([0.5, 0.8]), 1e-4)
    mean, variance = process.left_out()
    for k in (0, 17, 50):
        one, error = process.without(k).at(points[k : k + 1])
        assert one[0] == pytest.approx(mean[k], abs=0.3 * np.sqrt(variance[k]))
        assert error[0] == pytest.approx(variance[k], rel=0.1)


def test_the_gradient_of_the_likelihood_is_that_of_finite_differences():
    source = np.random.default_rng(10)
    points = source.random((30, 2))
    values = np.sin(3 * points[:, 0]) + points[:, 1] + 0.05 * source.standard_normal(30)
    logs = np.log([0.7, 1.5, 0.01])

    def cost(logs):
        return Process(points, values, np.exp(logs[:2]), float(np.exp(logs[2])))._cost()

    for k, step in enumerate(1e-5 * np.eye(3)):
        numeric = (cost(logs + step)[0] - cost(logs - step)[0]) / 2e-5
        assert cost(logs)[1][k] == pytest.approx(numeric, rel=1e-5)


def test_ranks_of_the_self_test_are_uniform_for_a_linear_model():
    """Simulation-based calibration: 30 runs of a linear model whose emulator is nearly exact."""
    source = np.random.default_rng(8)
    shares = source.random((40, 2)) * 0.98 + 0.01
    summaries = scores_of_shares(shares) @ MATRIX.T
    emulator = Emulator.fitted(shares, summaries)
    test = self_test(emulator, shares, summaries, VARIANCES, range(30), seed=1)
    assert test.ranks.shape == (30, 2) and (test.uniform > 0.01).all() and (test.covered >= 0.75).all()


def test_wrong_errors_are_seen_in_the_ranks():
    """Summaries with 3 times the stated deviation give ranks near 0 and 1."""
    source = np.random.default_rng(9)
    shares = source.random((60, 1)) * 0.98 + 0.01
    exactly = scores_of_shares(shares) @ np.ones((1, 1))
    emulator = Emulator.fitted(shares, exactly)
    seen = exactly + 0.9 * source.standard_normal(exactly.shape)
    ranks = []
    for k in range(40):
        found = posterior(emulator.without(k).at, seen[k], np.array([0.09]), 1, 0, draws=512)
        ranks.append(found.weights @ (found.scores < scores_of_shares(shares[k])))
    assert np.mean(np.abs(np.array(ranks) - 0.5) <= 0.45) < 0.75


@pytest.mark.parametrize("text", ["2:5", "normal:3:1", "normal:3:1:2:4", "lognormal:3:1", "triangular:1:2:5"])
def test_the_share_of_a_value_is_the_inverse_of_its_quantile(text):
    prior = variation(text, "vary")
    for share in (0.01, 0.3, 0.5, 0.97):
        assert prior.share_of(prior.at(share)) == pytest.approx(share, abs=1e-8)


def test_a_joint_plan_has_the_lists_row_by_row():
    plan = SamplingPlan.of({"a": variation([1.0, 2.0], "a"), "b": variation([5.0, 6.0], "b")}, "joint")
    assert plan.values() == [(1.0, 5.0), (2.0, 6.0)] and plan.count == 2
    for wrong in ({"a": variation([1.0, 2.0], "a"), "b": variation([5.0], "b")}, {"a": variation("1:2", "a")}):
        with pytest.raises(InputError, match="of the same length"):
            SamplingPlan.of(wrong, "joint")


def test_priors_come_from_the_material_or_from_the_user():
    found = priors(("friction.mu", "friction.xi=400:600"), "debris-flow")
    assert (found["friction.mu"].text, found["friction.xi"].text) == ("0.05:0.2", "400:600")
    assert priors({"friction.mu": None}, "snow-avalanche")["friction.mu"].parameters == (0.15, 0.4)


@pytest.mark.parametrize(
    ("vary", "material", "word"),
    [
        ((), None, "nothing is calibrated"),
        (("friction.mu",), None, "no distribution"),
        (("release.thickness",), "debris-flow", "has no range"),
        (("friction.mu=0.1,0.2",), None, "is a list"),
        (("friction.mu=0.1:0.2", "friction.mu=0.1:0.2"), None, "given twice"),
    ],
)
def test_priors_that_give_no_distribution_are_refused(vary, material, word):
    with pytest.raises(InputError, match=word):
        priors(vary, material)


@pytest.mark.parametrize(
    ("value", "width", "expected"),
    [(0.123456, 0.034, 0.123), (1234.567, 850.0, 1230.0), (0.5, 0.0, 0.5), (22.3456, 1.2, 22.3)],
)
def test_figures_have_two_digits_of_their_interval(value, width, expected):
    assert rounded(value, width) == expected


def test_what_is_not_identified_and_what_trades_off_is_reported():
    """Only the sum of two of three parameters is observed."""
    matrix = np.array([[1.0, 1.0, 0.0]] * 2)
    found = posterior(linear(matrix), np.array([0.3, 0.3]), np.full(2, 1e-3), 3, seed=0)
    varied = {key: variation("0:1", key) for key in "abc"}
    runs = np.random.default_rng(0).random((10, 3))
    simulated = scores_of_shares(runs) @ matrix.T
    misfits = np.sum((simulated - 0.3) ** 2, axis=1)
    made = Calibration(
        varied,
        ["s", "t"],
        np.full(2, 0.3),
        np.full(2, 1e-3),
        runs,
        simulated,
        misfits,
        found,
        (simulated, np.ones_like(simulated)),
    )
    (pair,) = made.trade_offs()
    assert pair["keys"] == ["a", "b"] and pair["correlation"] < -0.95
    assert made.parameters()["c"]["identified"] == "no" and made.directions()[0]["identified"] == "yes"
    assert any("hardly constrain" in text and text.startswith("c:") for text in made.remarks())
    assert any(text.startswith("2 compared quantities for 3 parameters: whether the model") for text in made.remarks())
    low, high = made.parameters()["c"]["interval_90"]
    assert (low, high) == pytest.approx((0.05, 0.95), abs=0.02)
    np.testing.assert_allclose(shares_of_scores(scores_of_shares(runs)), runs, atol=1e-12)
