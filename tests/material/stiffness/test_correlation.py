"""Correlated residuals: uncertainties cover the truth although the machine samples faster than it knows."""

import numpy as np
import pytest
from scipy.stats import t

from solen.material.stiffness.correlation import effective_points, log_likelihood, scatter


def noise(rng: np.random.Generator, lag_one: float, draws: int, points: int) -> np.ndarray:
    """First-order autoregressive series, each from its stationary state."""
    white = rng.standard_normal((draws, points))
    found = np.empty_like(white)
    found[:, 0] = white[:, 0] / np.sqrt(1 - lag_one**2)
    for at in range(1, points):
        found[:, at] = lag_one * found[:, at - 1] + white[:, at]
    return found


@pytest.mark.parametrize(
    ("lag_one", "points", "least"),
    # 95 % wanted. 1,000 draws have a standard error of 0.7 %; with few effective points ρ itself is poorly known
    [(0.0, 40, 0.93), (0.5, 100, 0.92), (0.9, 300, 0.90)],
)
def test_a_slope_is_covered_at_its_nominal_rate(lag_one: float, points: int, least: float) -> None:
    rng = np.random.default_rng(7)
    x = np.linspace(0, 1, points)
    rows = np.column_stack([np.ones(points), x])
    series = noise(rng, lag_one, 1000, points)
    slopes = np.linalg.lstsq(rows, series.T, rcond=None)[0]
    inside, plain = 0, 0
    for coefficients, each in zip(slopes.T, series, strict=True):
        residuals = each - rows @ coefficients
        found = scatter([rows], [residuals])
        assert found.covariance is not None
        wide = t.ppf(0.975, max(found.effective_points - 2, 1)) * np.sqrt(found.covariance[1, 1])
        inside += abs(coefficients[1]) < wide
        naive = np.sqrt(residuals @ residuals / (points - 2) / np.sum((x - 0.5) ** 2))
        plain += abs(coefficients[1]) < t.ppf(0.975, points - 2) * naive
    assert least < inside / 1000 < 0.98
    if lag_one == 0.9:
        assert plain / 1000 < 0.5  # what independent residuals would have claimed


def test_the_correlation_is_found_without_bias_although_the_fit_follows_some_of_it() -> None:
    rng = np.random.default_rng(3)
    x = np.linspace(0, 1, 120)
    rows = x[:, None] ** np.arange(5)
    series = noise(rng, 0.7, 400, 120)
    residuals = series - (rows @ np.linalg.lstsq(rows, series.T, rcond=None)[0]).T
    found = [scatter([rows], [each]).lag_one for each in residuals]
    raw = [float(each[1:] @ each[:-1] / (each @ each)) for each in residuals]
    assert np.median(found) == pytest.approx(0.7, abs=0.03)  # standard error of the median: 0.005
    assert np.median(raw) < 0.64


def test_the_covariance_is_that_of_the_dense_matrices() -> None:
    rng = np.random.default_rng(5)
    rows = [rng.standard_normal((n, 3)) for n in (9, 14)]
    residuals = [rng.standard_normal(9), rng.standard_normal(14)]
    found = scatter(rows, residuals)
    dense, v = np.vstack(rows), np.zeros((23, 23))
    for start, n in ((0, 9), (9, 14)):
        apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
        v[start : start + n, start : start + n] = found.lag_one**apart if found.lag_one else np.eye(n)
    inverse = np.linalg.inv(dense.T @ dense)
    maker = np.eye(23) - dense @ inverse @ dense.T
    variance = sum(float(r @ r) for r in residuals) / np.trace(maker @ v)
    wanted = variance * inverse @ dense.T @ v @ dense @ inverse
    assert found.covariance is not None
    np.testing.assert_allclose(found.covariance, wanted, rtol=1e-10)


def test_parameters_that_are_not_determined_have_no_covariance() -> None:
    x = np.linspace(0, 1, 20)
    found = scatter([np.column_stack([x, 2 * x])], [np.sin(40 * x)])
    assert found.covariance is None
    assert found.sigma > 0


def test_the_likelihood_prefers_the_correlation_that_made_the_series() -> None:
    series = noise(np.random.default_rng(2), 0.8, 1, 4000)[0]
    tried = np.array([0.0, 0.4, 0.7, 0.8, 0.9, 0.97])
    assert tried[np.argmax([log_likelihood([series], lag) for lag in tried])] == 0.8


def test_what_points_are_worth() -> None:
    assert effective_points(100, 0.0) == 100
    assert effective_points(190, 0.9) == pytest.approx(10)
    assert effective_points(5, 0.99) == 1
