"""Correlated residuals: uncertainties cover the truth although neighbouring points are not independent."""

import numpy as np
import pytest
from scipy.stats import t

from solen.material.stiffness.correlation import effective_points, log_likelihood, scatter


def noise(rng: np.random.Generator, lag_one: float, draws: int, points: int) -> np.ndarray:
    """Return first-order autoregressive series, each started in its stationary state."""
    white = rng.standard_normal((draws, points))
    series = np.empty_like(white)
    series[:, 0] = white[:, 0] / np.sqrt(1 - lag_one**2)
    for index in range(1, points):
        series[:, index] = lag_one * series[:, index - 1] + white[:, index]
    return series


@pytest.mark.parametrize(
    ("lag_one", "points", "min_coverage"),
    # nominally 95 %; the standard error for 1,000 draws is 0.7 %, and with few effective points ρ is uncertain
    [(0.0, 40, 0.93), (0.5, 100, 0.92), (0.9, 300, 0.90)],
)
def test_the_interval_of_a_slope_covers_the_truth(lag_one: float, points: int, min_coverage: float) -> None:
    rng = np.random.default_rng(7)
    x = np.linspace(0, 1, points)
    rows = np.column_stack([np.ones(points), x])
    series = noise(rng, lag_one, 1000, points)
    slopes = np.linalg.lstsq(rows, series.T, rcond=None)[0]
    covered, covered_naively = 0, 0
    for coefficients, y in zip(slopes.T, series, strict=True):
        residuals = y - rows @ coefficients
        estimate = scatter([rows], [residuals])
        assert estimate.covariance is not None
        half = t.ppf(0.975, max(estimate.effective_points - 2, 1)) * np.sqrt(estimate.covariance[1, 1])
        covered += abs(coefficients[1]) < half
        naive = np.sqrt(residuals @ residuals / (points - 2) / np.sum((x - 0.5) ** 2))
        covered_naively += abs(coefficients[1]) < t.ppf(0.975, points - 2) * naive
    assert min_coverage < covered / 1000 < 0.98
    if lag_one == 0.9:
        assert covered_naively / 1000 < 0.5  # if the residuals are assumed independent


def test_the_estimated_correlation_is_unbiased_although_the_fit_absorbs_some_of_it() -> None:
    rng = np.random.default_rng(3)
    x = np.linspace(0, 1, 120)
    rows = x[:, None] ** np.arange(5)
    series = noise(rng, 0.7, 400, 120)
    residuals = series - (rows @ np.linalg.lstsq(rows, series.T, rcond=None)[0]).T
    estimates = [scatter([rows], [residual]).lag_one for residual in residuals]
    raw = [float(residual[1:] @ residual[:-1] / (residual @ residual)) for residual in residuals]
    assert np.median(estimates) == pytest.approx(0.7, abs=0.03)  # standard error of the median: 0.005
    assert np.median(raw) < 0.64


def test_the_covariance_equals_that_of_dense_matrices() -> None:
    rng = np.random.default_rng(5)
    rows = [rng.standard_normal((n, 3)) for n in (9, 14)]
    residuals = [rng.standard_normal(9), rng.standard_normal(14)]
    estimate = scatter(rows, residuals)
    dense, v = np.vstack(rows), np.zeros((23, 23))
    for start, n in ((0, 9), (9, 14)):
        lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
        v[start : start + n, start : start + n] = estimate.lag_one**lag if estimate.lag_one else np.eye(n)
    inverse = np.linalg.inv(dense.T @ dense)
    maker = np.eye(23) - dense @ inverse @ dense.T
    variance = sum(float(r @ r) for r in residuals) / np.trace(maker @ v)
    expected = variance * inverse @ dense.T @ v @ dense @ inverse
    assert estimate.covariance is not None
    np.testing.assert_allclose(estimate.covariance, expected, rtol=1e-10)


def test_undetermined_parameters_have_no_covariance() -> None:
    x = np.linspace(0, 1, 20)
    estimate = scatter([np.column_stack([x, 2 * x])], [np.sin(40 * x)])
    assert estimate.covariance is None
    assert estimate.sigma > 0


def test_the_likelihood_is_largest_for_the_true_correlation() -> None:
    series = noise(np.random.default_rng(2), 0.8, 1, 4000)[0]
    candidates = np.array([0.0, 0.4, 0.7, 0.8, 0.9, 0.97])
    assert candidates[np.argmax([log_likelihood([series], lag_one) for lag_one in candidates])] == 0.8


def test_effective_number_of_points() -> None:
    assert effective_points(100, 0.0) == 100
    assert effective_points(190, 0.9) == pytest.approx(10)
    assert effective_points(5, 0.99) == 1
