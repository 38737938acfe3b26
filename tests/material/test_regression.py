"""Lines with intervals: against formulas, against scipy and by how often they hold the truth."""

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
BOTH = ((1.0, 0.0), (0.0, 1.0))


def within(estimate: float, truth: float, share: float, draws: int, sigmas: float = 3.5) -> bool:
    """Whether a share of draws is as expected: ``sigmas`` binomial standard deviations, a false alarm in 2,000."""
    return abs(estimate - truth) <= sigmas * math.sqrt(share * (1.0 - share) / draws)


def test_a_plain_line_is_that_of_scipy() -> None:
    ours, theirs = fitted(LINE, Y), stats.linregress(X, Y)
    assert ours.parameters == pytest.approx([theirs.intercept, theirs.slope], rel=1e-12)
    assert ours.u((0.0, 1.0)) == pytest.approx(theirs.stderr, rel=1e-12)
    assert ours.u((1.0, 0.0)) == pytest.approx(theirs.intercept_stderr, rel=1e-12)
    assert ours.df((0.0, 1.0)) == pytest.approx(ours.error_df) == 4
    half = stats.t.ppf(0.975, 4) * theirs.stderr
    assert ours.interval((0.0, 1.0)) == pytest.approx((theirs.slope - half, theirs.slope + half), rel=1e-12)


def test_weights_are_repeated_points() -> None:
    weights = np.array([1, 2, 1, 3, 1, 1])
    often = np.repeat(np.arange(6), weights)
    ours, long = fitted(LINE, Y, weights=weights), fitted(LINE[often], Y[often])
    assert ours.parameters == pytest.approx(long.parameters, rel=1e-12)
    assert ours.covariance * ours.error_df == pytest.approx(long.covariance * long.error_df, rel=1e-9)


def test_deletion_t_is_what_leaving_a_point_out_says() -> None:
    whole = fitted(LINE, Y)
    for gone in range(6):
        keep = np.arange(6) != gone
        rest = fitted(LINE[keep], Y[keep])
        at = LINE[gone]
        spread = math.sqrt(rest.sigma**2 + rest.u(at) ** 2)
        assert whole.deletion_t[gone] == pytest.approx((Y[gone] - at @ rest.parameters) / spread, rel=1e-9)


def test_a_weighted_fit_is_the_plain_one_of_rows_divided_by_their_standard_deviations() -> None:
    each = np.array([1.0, 0.5, 2.0, 1.0, 3.0, 0.7])
    scale = np.sqrt(each)
    weighted, plain = fitted(LINE, Y, weights=1.0 / each), fitted(LINE / scale[:, None], Y / scale)
    for name in ("parameters", "covariance", "sigma", "deletion_t"):
        assert getattr(weighted, name) == pytest.approx(getattr(plain, name), rel=1e-10), name
    assert weighted.residuals / scale == pytest.approx(plain.residuals, rel=1e-10)
    assert weighted.criterion == pytest.approx(plain.criterion + np.sum(np.log(each)), rel=1e-10)
    for contrast in BOTH:
        assert weighted.df(contrast) == pytest.approx(plain.df(contrast)) == 4


def test_exact_data_leave_no_residual_to_judge_points_by() -> None:
    fit = fitted(LINE, 3.0 + 2.0 * X)
    assert fit.sigma == 0.0
    assert not fit.deletion_t.any()
    assert rosner_outliers(lambda keep: fitted(LINE[keep], (3.0 + 2.0 * X)[keep]), 6, 2) == {}


def test_a_balanced_random_effect_is_the_analysis_of_variance() -> None:
    """Groups of equal size: REML's variances are those of the mean squares, and the mean's freedom that of groups."""
    rng = np.random.default_rng(1)
    groups = np.repeat(np.arange(6), 4)
    y = rng.normal(0.0, 2.0, 6)[groups] + rng.normal(0.0, 0.5, 24)
    means = np.array([y[groups == g].mean() for g in range(6)])
    inside = float(np.sum((y - means[groups]) ** 2)) / 18
    between = 4.0 * float(np.var(means, ddof=1))
    effect = group_covariance(groups.tolist())
    assert effect is not None
    fit = fitted(np.ones((24, 1)), y, effects=[effect])
    assert fit.sigma**2 == pytest.approx(inside, rel=1e-4)
    assert fit.effect_sigmas[0] ** 2 == pytest.approx((between - inside) / 4.0, rel=1e-4)
    assert fit.u([1.0]) ** 2 == pytest.approx(between / 24.0, rel=1e-4)
    assert fit.df([1.0]) == pytest.approx(5.0, rel=1e-3)


def test_an_effect_that_is_not_there_or_that_the_design_has_is_left_out() -> None:
    assert group_covariance(["a", "b", "c"]) is None
    everything = group_covariance(["a"] * 6)
    assert everything is not None
    fit = fitted(LINE, Y, effects=[everything])  # one group: its effect is the line's start
    assert fit.effect_sigmas == (0.0,)
    assert fit.covariance == pytest.approx(fitted(LINE, Y).covariance)
    groups = np.tile(np.arange(3), 2)
    apart = Y - np.array([0.1, 0.0, -0.1])[groups] * np.repeat([1.0, -1.0], 3)  # means of groups scatter less than half
    pairs = group_covariance(groups.tolist())
    assert pairs is not None
    assert fitted(LINE, apart, effects=[pairs]).effect_sigmas[0] >= 0.0


def test_a_random_slope_is_that_of_groups() -> None:
    """Many points a group: the slope's variance is that of the slopes, and its freedom that of groups."""
    rng = np.random.default_rng(3)
    x, groups = np.tile(np.linspace(-1.0, 1.0, 20), 5), np.repeat(np.arange(5), 20)
    slopes = 2.0 + rng.normal(0.0, 1.0, 5)
    y = slopes[groups] * x + rng.normal(0.0, 0.01, 100)
    effects = [
        one for one in (group_covariance(groups.tolist()), group_covariance(groups.tolist(), x)) if one is not None
    ]
    fit = fitted(np.column_stack([np.ones(100), x]), y, effects=effects)
    own = [np.polyfit(x[groups == g], y[groups == g], 1)[0] for g in range(5)]
    assert fit.parameters[1] == pytest.approx(np.mean(own), rel=1e-3)
    assert fit.u((0.0, 1.0)) == pytest.approx(np.std(own, ddof=1) / math.sqrt(5), rel=1e-2)
    assert fit.df((0.0, 1.0)) == pytest.approx(4.0, rel=1e-2)


def test_a_covariance_from_residuals_is_hc2() -> None:
    """Means of two groups: HC2 is the sum of the variances of both means, with Welch's freedom."""
    rng = np.random.default_rng(5)
    y = np.concatenate([rng.normal(0.0, 1.0, 6), rng.normal(3.0, 5.0, 9)])
    which = np.repeat([0.0, 1.0], (6, 9))
    fit = fitted(np.column_stack([1.0 - which, which]), y, robust=True)
    variances = [np.var(y[which == g], ddof=1) / np.sum(which == g) for g in (0.0, 1.0)]
    assert np.diag(fit.covariance) == pytest.approx(variances, rel=1e-12)
    assert fit.df((1.0, 0.0)) == pytest.approx(5.0)
    assert fit.df((0.0, 1.0)) == pytest.approx(8.0)
    equal = (1 / 6 + 1 / 9) ** 2 / (1 / 6**2 / 5 + 1 / 9**2 / 8)  # Welch's freedom, were the variances the same
    assert fit.df((-1.0, 1.0)) == pytest.approx(equal)


def test_the_freedom_of_a_covariance_from_residuals_is_that_of_its_matrices() -> None:
    """Bell and McCaffrey's ratio with the residuals' covariance written out, n by n."""
    weights = np.array([1.0, 4.0, 0.5, 2.0, 1.0, 0.3])
    fit = fitted(LINE, Y, weights=weights, robust=True)
    rows = np.linalg.solve(LINE.T @ (weights[:, None] * LINE), LINE.T * weights)
    left = np.eye(6) - LINE @ rows
    residuals = left @ np.diag(1.0 / weights) @ left.T
    for contrast in (*BOTH, (1.0, 4.0)):
        shares = (np.array(contrast) @ rows) ** 2 / np.diag(left)
        expected = float(shares @ np.diag(residuals)) ** 2 / float(shares @ residuals**2 @ shares)
        assert fit.df(contrast) == pytest.approx(max(expected, MIN_DF * 4), rel=1e-9)


def test_a_covariance_from_residuals_keeps_some_freedom() -> None:
    design, y = np.tile(LINE, (2, 1)), np.concatenate([Y, Y + 0.1])
    weights = np.array([1e6] + [1.0] * 11)  # one point decides the value there nearly alone
    fit = fitted(design, y, weights=weights, robust=True)
    assert fit.df((1.0, 1.0)) == MIN_DF * 10


def test_bad_points_are_found_together_and_seldom_where_there_are_none() -> None:
    rng = np.random.default_rng(7)
    x = np.linspace(0.0, 1.0, 20)
    design = np.column_stack([np.ones(20), x])

    def named(y: np.ndarray) -> set[int]:
        return set(rosner_outliers(lambda keep: fitted(design[keep], y[keep]), 20, 4))

    noise = rng.normal(0.0, 0.1, 20)
    hidden = x + noise + 3.0 * (np.arange(20) == 9) + 3.2 * (np.arange(20) == 10)  # one hides the other
    assert named(hidden) == {9, 10}
    draws = 1000
    alarms = sum(bool(named(x + rng.normal(0.0, 0.1, 20))) for _ in range(draws))
    assert within(alarms / draws, 0.01, 0.01, draws, 4.0)  # Bonferroni's bound is nearly reached


def test_quantiles_and_tails_are_those_of_scipy() -> None:
    assert t_quantile(0.95, 3.7) == pytest.approx(stats.t.ppf(0.975, 3.7))
    assert t_tail(-2.1, 5.0) == pytest.approx(2.0 * stats.t.sf(2.1, 5.0))
    assert f_tail(3.0, 2.0, 7.0) == pytest.approx(stats.f.sf(3.0, 2.0, 7.0))
    assert group_numbers(["b", "a", "b"]).tolist() == [0, 1, 0]
    assert frequency(0.0301) == "in 3 % of such tables"
    assert frequency(1e-9) == "in less than 0.1 % of such tables"
