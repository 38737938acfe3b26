"""Line fits with intervals: compared with formulas and scipy, and by their coverage."""

import math

import numpy as np
import pytest
from scipy import stats

from solen.material.regression import (
    MIN_DF,
    f_tail,
    fitted,
    frequency,
    group_covariance,
    group_numbers,
    rosner_outliers,
    t_quantile,
    t_tail,
)

X = np.array([1.0, 2.0, 3.0, 5.0, 8.0, 9.0])
Y = np.array([2.1, 3.9, 6.2, 9.8, 16.3, 17.9])
LINE = np.column_stack([np.ones(6), X])
CONTRASTS = ((1.0, 0.0), (0.0, 1.0))


def test_an_ordinary_line_agrees_with_scipy() -> None:
    fit, expected = fitted(LINE, Y), stats.linregress(X, Y)
    assert fit.parameters == pytest.approx([expected.intercept, expected.slope], rel=1e-12)
    assert fit.u((0.0, 1.0)) == pytest.approx(expected.stderr, rel=1e-12)
    assert fit.u((1.0, 0.0)) == pytest.approx(expected.intercept_stderr, rel=1e-12)
    assert fit.df((0.0, 1.0)) == pytest.approx(fit.error_df) == 4
    half = stats.t.ppf(0.975, 4) * expected.stderr
    assert fit.interval((0.0, 1.0)) == pytest.approx((expected.slope - half, expected.slope + half), rel=1e-12)


def test_integer_weights_are_equivalent_to_repeated_points() -> None:
    weights = np.array([1, 2, 1, 3, 1, 1])
    rows = np.repeat(np.arange(6), weights)
    weighted, repeated = fitted(LINE, Y, weights=weights), fitted(LINE[rows], Y[rows])
    assert weighted.parameters == pytest.approx(repeated.parameters, rel=1e-12)
    assert weighted.covariance * weighted.error_df == pytest.approx(repeated.covariance * repeated.error_df, rel=1e-9)


def test_deletion_t_equals_that_of_a_fit_without_the_point() -> None:
    fit = fitted(LINE, Y)
    for omitted in range(6):
        keep = np.arange(6) != omitted
        rest = fitted(LINE[keep], Y[keep])
        row = LINE[omitted]
        u = math.sqrt(rest.sigma**2 + rest.u(row) ** 2)
        assert fit.deletion_t[omitted] == pytest.approx((Y[omitted] - row @ rest.parameters) / u, rel=1e-9)


def test_a_weighted_fit_equals_an_ordinary_fit_of_scaled_rows() -> None:
    variances = np.array([1.0, 0.5, 2.0, 1.0, 3.0, 0.7])
    scale = np.sqrt(variances)
    weighted, ordinary = fitted(LINE, Y, weights=1.0 / variances), fitted(LINE / scale[:, None], Y / scale)
    for name in ("parameters", "covariance", "sigma", "deletion_t"):
        assert getattr(weighted, name) == pytest.approx(getattr(ordinary, name), rel=1e-10), name
    assert weighted.residuals / scale == pytest.approx(ordinary.residuals, rel=1e-10)
    assert weighted.criterion == pytest.approx(ordinary.criterion + np.sum(np.log(variances)), rel=1e-10)
    for contrast in CONTRASTS:
        assert weighted.df(contrast) == pytest.approx(ordinary.df(contrast)) == 4


def test_exact_data_have_no_outliers() -> None:
    fit = fitted(LINE, 3.0 + 2.0 * X)
    assert fit.sigma == 0.0
    assert not fit.deletion_t.any()
    assert rosner_outliers(lambda keep: fitted(LINE[keep], (3.0 + 2.0 * X)[keep]), 6, 2) == {}


def test_a_balanced_random_effect_agrees_with_the_analysis_of_variance() -> None:
    """Groups of equal size: REML yields the variances of the mean squares, and the mean has 5 degrees of freedom."""
    rng = np.random.default_rng(1)
    groups = np.repeat(np.arange(6), 4)
    y = rng.normal(0.0, 2.0, 6)[groups] + rng.normal(0.0, 0.5, 24)
    means = np.array([y[groups == group].mean() for group in range(6)])
    within = float(np.sum((y - means[groups]) ** 2)) / 18
    between = 4.0 * float(np.var(means, ddof=1))
    effect = group_covariance(groups.tolist())
    assert effect is not None
    fit = fitted(np.ones((24, 1)), y, effects=[effect])
    assert fit.sigma**2 == pytest.approx(within, rel=1e-4)
    assert fit.effect_sigmas[0] ** 2 == pytest.approx((between - within) / 4.0, rel=1e-4)
    assert fit.u([1.0]) ** 2 == pytest.approx(between / 24.0, rel=1e-4)
    assert fit.df([1.0]) == pytest.approx(5.0, rel=1e-3)


def test_effects_that_are_absent_or_contained_in_the_design_are_omitted() -> None:
    assert group_covariance(["a", "b", "c"]) is None
    everything = group_covariance(["a"] * 6)
    assert everything is not None
    fit = fitted(LINE, Y, effects=[everything])  # with a single group, its effect is the intercept
    assert fit.effect_sigmas == (0.0,)
    assert fit.covariance == pytest.approx(fitted(LINE, Y).covariance)
    groups = np.tile(np.arange(3), 2)
    opposed = Y - np.array([0.1, 0.0, -0.1])[groups] * np.repeat([1.0, -1.0], 3)  # cancels in the group means
    pairs = group_covariance(groups.tolist())
    assert pairs is not None
    assert fitted(LINE, opposed, effects=[pairs]).effect_sigmas[0] >= 0.0


def test_a_random_slope_has_the_variance_of_the_group_slopes() -> None:
    """Many points per group: the variance of the slope is that between groups, with 4 degrees of freedom."""
    rng = np.random.default_rng(3)
    x, groups = np.tile(np.linspace(-1.0, 1.0, 20), 5), np.repeat(np.arange(5), 20)
    slopes = 2.0 + rng.normal(0.0, 1.0, 5)
    y = slopes[groups] * x + rng.normal(0.0, 0.01, 100)
    candidates = (group_covariance(groups.tolist()), group_covariance(groups.tolist(), x))
    effects = [effect for effect in candidates if effect is not None]
    fit = fitted(np.column_stack([np.ones(100), x]), y, effects=effects)
    fits = [np.polyfit(x[groups == group], y[groups == group], 1)[0] for group in range(5)]
    assert fit.parameters[1] == pytest.approx(np.mean(fits), rel=1e-3)
    assert fit.u((0.0, 1.0)) == pytest.approx(np.std(fits, ddof=1) / math.sqrt(5), rel=1e-2)
    assert fit.df((0.0, 1.0)) == pytest.approx(4.0, rel=1e-2)


def test_the_robust_covariance_is_hc2() -> None:
    """Means of two groups: HC2 yields the variances of both means, with Welch's degrees of freedom."""
    rng = np.random.default_rng(5)
    y = np.concatenate([rng.normal(0.0, 1.0, 6), rng.normal(3.0, 5.0, 9)])
    group = np.repeat([0.0, 1.0], (6, 9))
    fit = fitted(np.column_stack([1.0 - group, group]), y, robust=True)
    variances = [np.var(y[group == value], ddof=1) / np.sum(group == value) for value in (0.0, 1.0)]
    assert np.diag(fit.covariance) == pytest.approx(variances, rel=1e-12)
    assert fit.df((1.0, 0.0)) == pytest.approx(5.0)
    assert fit.df((0.0, 1.0)) == pytest.approx(8.0)
    equal = (1 / 6 + 1 / 9) ** 2 / (1 / 6**2 / 5 + 1 / 9**2 / 8)  # Welch's value for equal variances
    assert fit.df((-1.0, 1.0)) == pytest.approx(equal)


def test_the_degrees_of_freedom_of_the_robust_covariance_follow_bell_and_mccaffrey() -> None:
    """Their ratio, computed from the full covariance of the residuals."""
    weights = np.array([1.0, 4.0, 0.5, 2.0, 1.0, 0.3])
    fit = fitted(LINE, Y, weights=weights, robust=True)
    rows = np.linalg.solve(LINE.T @ (weights[:, None] * LINE), LINE.T * weights)
    residual_maker = np.eye(6) - LINE @ rows
    residuals = residual_maker @ np.diag(1.0 / weights) @ residual_maker.T
    for contrast in (*CONTRASTS, (1.0, 4.0)):
        factors = (np.array(contrast) @ rows) ** 2 / np.diag(residual_maker)
        expected = float(factors @ np.diag(residuals)) ** 2 / float(factors @ residuals**2 @ factors)
        assert fit.df(contrast) == pytest.approx(max(expected, MIN_DF * 4), rel=1e-9)


def test_the_degrees_of_freedom_of_the_robust_covariance_have_a_minimum() -> None:
    design, y = np.tile(LINE, (2, 1)), np.concatenate([Y, Y + 0.1])
    weights = np.array([1e6] + [1.0] * 11)  # a single point almost determines the value at its x
    fit = fitted(design, y, weights=weights, robust=True)
    assert fit.df((1.0, 1.0)) == MIN_DF * 10


def test_outliers_that_mask_each_other_are_found_at_the_nominal_false_alarm_rate() -> None:
    rng = np.random.default_rng(7)
    x = np.linspace(0.0, 1.0, 20)
    design = np.column_stack([np.ones(20), x])

    def outliers(y: np.ndarray) -> set[int]:
        return set(rosner_outliers(lambda keep: fitted(design[keep], y[keep]), 20, 4))

    noise = rng.normal(0.0, 0.1, 20)
    masked = x + noise + 3.0 * (np.arange(20) == 9) + 3.2 * (np.arange(20) == 10)  # each hides the other
    assert outliers(masked) == {9, 10}
    draws = 1000
    alarms = sum(bool(outliers(x + rng.normal(0.0, 0.1, 20))) for _ in range(draws))
    assert abs(alarms / draws - 0.01) <= 4.0 * math.sqrt(0.01 * 0.99 / draws)  # Bonferroni's bound is nearly reached


def test_quantiles_and_tails_agree_with_scipy() -> None:
    assert t_quantile(0.95, 3.7) == pytest.approx(stats.t.ppf(0.975, 3.7))
    assert t_tail(-2.1, 5.0) == pytest.approx(2.0 * stats.t.sf(2.1, 5.0))
    assert f_tail(3.0, 2.0, 7.0) == pytest.approx(stats.f.sf(3.0, 2.0, 7.0))
    assert group_numbers(["b", "a", "b"]).tolist() == [0, 1, 0]
    assert frequency(0.0301) == "in 3 % of such tables"
    assert frequency(1e-9) == "in less than 0.1 % of such tables"
