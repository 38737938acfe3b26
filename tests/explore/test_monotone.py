"""Ranges over which a reading only rises or only falls, compared with curves whose turning points are known."""

import math

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.explore.monotone import monotone_deg

CURVES = 60
SPAN = 20.0


def turning(turns: FloatArray, angle: FloatArray) -> FloatArray:
    """Return a polynomial over 0 to SPAN with turning points at some angles and a range of values of 1."""
    slope = np.polynomial.Polynomial(np.polynomial.polynomial.polyfromroots(turns / SPAN))
    dense = slope.integ()(np.linspace(0.0, 1.0, 801))
    return np.asarray(slope.integ()(angle / SPAN) / np.ptp(dense))


@pytest.mark.parametrize("steps", [10, 20, 40, 80])
@pytest.mark.parametrize("noise", [0.0, 1e-4, 1e-3, 1e-2, 0.05, 0.2])
def test_uncertainty_covers_range_between_known_turns(steps: int, noise: float) -> None:
    rng = np.random.default_rng([steps, int(1e4 * noise)])
    angle, results = np.linspace(0.0, SPAN, steps + 1), []
    for _ in range(CURVES):
        distances = rng.uniform(4.0, 9.0, 3)  # larger than a tenth of the motion and than a step
        turns = np.cumsum(distances)[: rng.integers(0, 4)] - rng.uniform(0.0, 3.0)
        turns = turns[(turns > 0.0) & (turns < SPAN)]
        at, ends = rng.uniform(0.0, SPAN), np.r_[0.0, turns, SPAN]
        after = int(np.searchsorted(ends, at))
        value = turning(turns, angle) + rng.normal(0.0, noise, angle.size)
        length, u = monotone_deg(angle, value, np.full(angle.size, noise), at)
        results.append((abs(length - (ends[after] - ends[after - 1])), u))
    finite = np.array([pair for pair in results if not math.isnan(pair[0])]).reshape(-1, 2)
    error, us = finite[:, 0], finite[:, 1]
    two_steps = 2.0 * SPAN / steps  # a turning point within a step of an end of the motion is not detected
    assert np.mean(error <= us + 1e-9) > 0.9, finite[error > us]
    assert (error <= 2.0 * us + two_steps).mean() > 0.98
    assert error.size > CURVES / 3
    if noise <= 1e-4:
        assert np.median(us) <= two_steps + 1.0


@pytest.mark.parametrize("steps", [10, 20, 40, 80])
def test_no_range_without_significant_change(steps: int) -> None:
    angle = np.linspace(0.0, SPAN, steps + 1)
    rng, ones = np.random.default_rng(3), np.ones(angle.size)
    assert np.isnan(monotone_deg(angle, np.sin(angle), ones, 9.0)).all()
    assert np.isnan(monotone_deg(angle, 0.0 * ones, 0.0 * ones, 9.0)).all()
    noisy = [monotone_deg(angle, rng.normal(0.0, 0.1, angle.size), 0.1 * ones, 9.0) for _ in range(40)]
    assert np.isnan(noisy).all(axis=1).mean() > 0.9


def test_dark_interval_does_not_hide_turn() -> None:
    angle = np.linspace(0.0, SPAN, 41)
    dark_first = np.maximum(0.0, np.sin((angle - 2.0) / 3.0)) * (angle < 11.0) - 0.3 * np.clip(angle - 11.0, 0.0, 4.0)
    length, u = monotone_deg(angle, dark_first, np.full(angle.size, 1e-6), 0.0)
    turn = 2.0 + 1.5 * math.pi
    assert length + u < turn + 1.0
    assert u > 2.0  # it is unknown whether the dark interval rises or falls


def test_range_does_not_depend_on_step_beyond_uncertainty() -> None:
    angle = np.linspace(0.0, SPAN, 81)
    rng = np.random.default_rng(4)
    value, u = turning(np.array([7.0, 11.0]), angle), np.full(81, 0.02)
    value = value + rng.normal(0.0, 0.02, 81)
    lengths, us = np.array([monotone_deg(angle[::k], value[::k], u[::k], 3.0) for k in (1, 2, 4)]).T
    assert (np.abs(np.subtract.outer(lengths, lengths)) <= np.add.outer(us, us)).all()


def test_clear_rise_is_monotonic_over_all_angles() -> None:
    angle = np.linspace(-3.0, 3.0, 25)
    assert monotone_deg(angle, 0.25 * angle, np.full(25, 1e-3), 0.1) == (6.0, 0.0)
