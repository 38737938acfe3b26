"""Merits of responses with known nulls, slopes and linearity, and their uncertainties."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.explore.merits import MERITS, merits_of, unresolved_change
from solen.plane import deviation_from_line
from solen.sensor import Response

ANGLES = np.linspace(-3.0, 3.0, 25)


def response(contrast: FloatArray, light: float = 0.6, u: float = 1e-6) -> Response:
    right, left = 0.5 * light * (1.0 + contrast), 0.5 * light * (1.0 - contrast)
    return Response("power", ANGLES[: contrast.size], right, left, np.full(contrast.size, u), ())


def test_merits_of_straight_response() -> None:
    merits = merits_of(response(0.25 * (ANGLES - 0.4)))
    assert merits.null_deg == pytest.approx(0.4, abs=1e-9)
    assert merits.slope_per_deg == pytest.approx(0.25, abs=1e-9)
    assert merits.span == pytest.approx(1.5)
    assert merits.linearity_percent == pytest.approx(0.0, abs=1e-6)
    assert merits.range_deg == 6.0
    assert merits.light == pytest.approx(0.6)


@pytest.mark.parametrize("width_deg", [0.7, 1.0, 1.6, 2.5])
@pytest.mark.parametrize("null_deg", [-0.55, 0.0, 0.11, 0.83])
def test_uncertainty_covers_interpolation_error(width_deg: float, null_deg: float) -> None:
    def curve(angle: FloatArray) -> FloatArray:
        return np.tanh((angle - null_deg) / width_deg)

    merits = merits_of(response(curve(ANGLES)))
    assert abs(merits.null_deg - null_deg) < 2.0 * merits.u_null_deg
    assert abs(merits.slope_per_deg - 1.0 / width_deg) < 2.0 * merits.u_slope_per_deg
    assert merits.u_slope_per_deg < 0.08 / width_deg
    dense = np.linspace(-3.0, 3.0, 4001)
    deviation = _minimax_deviation(dense, curve(dense))
    assert abs(merits.linearity_percent - 100.0 * deviation / float(np.ptp(curve(dense)))) < max(
        2.0 * merits.u_linearity_percent, 0.02
    )


def kinked(angle: FloatArray, null: float, kink: float, terms: Sequence[float]) -> FloatArray:
    """Return a contrast with a null and a kink; terms: slope, half the change of slope, second and third order."""
    slope, half, second, third = terms
    x = angle - null
    return np.asarray(slope * x + half * (np.abs(angle - kink) - abs(null - kink)) + second * x**2 + third * x**3)


@pytest.mark.parametrize(("from_null_deg", "on_an_angle"), [(0.0, True), (0.0, False), (0.5, False)])
def test_uncertainty_covers_kink(from_null_deg: float, on_an_angle: bool) -> None:
    """At a kink, the uncertainty covers the slopes on both sides."""
    rng = np.random.default_rng(2)
    errors = []
    for _ in range(30):
        null, change = (0.0 if on_an_angle else rng.uniform(-0.25, 0.25)), rng.uniform(0.05, 0.25) * rng.choice([-1, 1])
        kink, second, third = null + from_null_deg * rng.uniform(-1.0, 1.0), rng.normal(0, 0.01), rng.normal(0, 0.004)

        curve = partial(kinked, null=null, kink=kink, terms=(0.25, 0.5 * change, second, third))
        merits = merits_of(response(curve(ANGLES)))
        near = curve(np.array([null - 1e-6, null, null + 1e-6]))
        dense = np.linspace(-3.0, 3.0, 385)
        true = 100.0 * deviation_from_line(dense, curve(dense)) / merits.span
        errors.append(
            (
                np.abs(np.diff(near) / 1e-6 - merits.slope_per_deg).max() / merits.u_slope_per_deg,
                (merits.null_deg - null) / merits.u_null_deg,
                (merits.linearity_percent - true) / merits.u_linearity_percent,
            )
        )
    assert (np.abs(errors) < 2.5).all(), np.abs(errors).max(axis=0)
    assert np.mean(np.abs(errors) < 2.0) >= 0.85
    assert np.abs(errors).max() > 0.2


@pytest.mark.parametrize("step_deg", [3.0, 1.5, 1.0, 0.5, 0.25, 0.1])
@pytest.mark.parametrize("width_deg", [0.1, 0.22])
@pytest.mark.parametrize("null_deg", [0.0, 0.11])
def test_detects_step_too_coarse_for_steep_null(step_deg: float, width_deg: float, null_deg: float) -> None:
    angle = np.arange(-3.0, 3.0 + 1e-9, step_deg)
    power = 0.5 + 0.5 * np.tanh((angle - null_deg) / width_deg)
    traced = Response("power", angle, power, 1.0 - power, np.full(angle.size, 3e-7), ())
    merits = merits_of(traced, (0.0003, 1e-6))
    assert abs(merits.slope_per_deg - 1.0 / width_deg) <= 2.0 * merits.u_slope_per_deg
    assert abs(merits.null_deg - null_deg) <= 2.0 * merits.u_null_deg
    dense = np.linspace(-3.0, 3.0, 801)
    true = 50.0 * _minimax_deviation(dense, np.tanh((dense - null_deg) / width_deg))
    assert abs(merits.linearity_percent - true) <= max(2.0 * merits.u_linearity_percent, 0.02)
    change = unresolved_change(traced)
    assert math.isnan(merits.resolution_deg) is (change > 0.0)
    assert (change > 0.0) or step_deg <= width_deg


@pytest.mark.parametrize("angles", [3, 4])
def test_few_angles_leave_linearity_uncertain(angles: int) -> None:
    angle_deg = np.linspace(-3.0, 3.0, angles)
    power = 0.5 + 0.25 * np.tanh(angle_deg / 1.5)
    merits = merits_of(Response("power", angle_deg, power, 1.0 - power, np.full(angles, 1e-6), ()))
    dense = np.linspace(-3.0, 3.0, 4001)
    curve = np.tanh(dense / 1.5)
    true = 100.0 * _minimax_deviation(dense, curve) / float(np.ptp(curve))
    assert abs(merits.linearity_percent - true) < merits.u_linearity_percent


def _minimax_deviation(x: FloatArray, y: FloatArray) -> float:
    """Return the largest deviation from the minimax straight line, by linear programming."""
    from scipy.optimize import linprog

    ones = np.ones_like(x)
    above = np.column_stack([x, ones, -ones])
    below = np.column_stack([-x, -ones, -ones])
    result: Any = linprog([0, 0, 1], np.vstack([above, below]), np.concatenate([y, -y]), bounds=[(None, None)] * 3)
    return float(result.fun)


def test_uncertainty_covers_noise() -> None:
    rng = np.random.default_rng(1)
    u = 3e-4
    clean = np.tanh((ANGLES - 0.2) / 2.0)
    errors = []
    for _ in range(200):
        noisy = response(clean + rng.normal(0.0, 2.0 * u / 0.6 / math.sqrt(3.0), ANGLES.size), u=u)
        merits = merits_of(noisy)
        null_error, slope_error = merits.null_deg - 0.2, merits.slope_per_deg - 0.5
        errors.append((null_error / merits.u_null_deg, slope_error / merits.u_slope_per_deg))
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert (rms < 1.0).all()
    assert (rms > 0.1).all()


def test_range_lies_between_turning_points() -> None:
    merits = merits_of(response(np.sin(ANGLES / 2.0 * math.pi / 2.0)))  # turns at 2 deg
    assert merits.range_deg == pytest.approx(4.0, abs=merits.u_range_deg)
    assert merits.u_range_deg == 0.5


def test_dark_response_has_no_merit_except_light() -> None:
    merits = merits_of(response(np.zeros(25), light=0.0))
    assert merits.light == 0.0
    assert all(math.isnan(getattr(merits, name)) for name in MERITS if name != "light")


def test_no_slope_or_range_without_null() -> None:
    merits = merits_of(response(0.5 + 0.05 * ANGLES))
    assert math.isnan(merits.null_deg)
    assert math.isnan(merits.slope_per_deg)
    assert math.isnan(merits.range_deg)
    assert merits.span == pytest.approx(0.3)
