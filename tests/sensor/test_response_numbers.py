"""Numbers from a response curve: contrast, null and saturation, or None if there is none."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from solen.sensor import SATURATION_CONTRAST, Response


def response(angle_deg: Sequence[float], contrast: Sequence[float], total: float = 0.5) -> Response:
    """A response with given contrasts; NaN means no light."""
    angles, contrasts = np.array(angle_deg, dtype=float), np.array(contrast, dtype=float)
    dark = np.isnan(contrasts)
    right = np.where(dark, 0.0, total * (1 + contrasts) / 2)
    left = np.where(dark, 0.0, total * (1 - contrasts) / 2)
    n = len(angles)
    return Response("power", angles, right, left, np.zeros(n), ())


def test_contrast_is_the_difference_over_the_sum() -> None:
    curve = response([-1, 0, 1], [0.5, 0.0, -1.0])
    assert curve.contrast == pytest.approx([0.5, 0.0, -1.0])


def test_contrast_without_light_is_nan() -> None:
    curve = response([-1, 0, 1], [math.nan, 0.2, math.nan])
    assert np.isnan(curve.contrast).tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("angles", "contrast", "null"),
    [
        ([-2, 0, 2], [0.6, 0.0, -0.6], 0.0),
        ([-2, 0, 2], [0.6, 0.2, -0.2], 1.0),
        ([-2, 0, 2], [-0.6, 0.2, 0.4], -0.5),
        ([0, 1, 2], [0.0, -0.5, -0.9], 0.0),
        ([-2, -1, 0], [0.9, 0.5, 0.0], 0.0),
        ([-2, 0, 2], [0.6, 0.5, 0.4], None),
        ([1, 2], [-0.6, -0.9], None),
        ([1], [-0.6], None),
        ([1], [0.0], 1.0),
        ([-1, 0, 1], [math.nan, math.nan, math.nan], None),
        ([-1, 0, 1], [0.5, math.nan, -0.5], None),
    ],
)
def test_null_is_the_angle_of_equal_powers(
    angles: Sequence[float], contrast: Sequence[float], null: float | None
) -> None:
    curve = response(angles, contrast).null_deg()
    assert curve == (None if null is None else pytest.approx(null, abs=1e-12))


def test_null_within_the_uncertainty_is_a_traced_angle() -> None:
    curve = response([-1, 0, 1], [0.5, 1e-5, 0.4])
    assert curve.null_deg() is None
    uncertain = replace(curve, u_power=np.full(3, 0.5 * 1e-5))
    assert uncertain.null_deg() == 0.0
    unknown = replace(curve, u_power=np.full(3, math.nan))
    assert unknown.null_deg() is None


def test_null_is_the_one_nearest_to_rest() -> None:
    curve = response([-40, -30, -1, 1, 30, 40], [-0.5, 0.9, 0.8, -0.8, -0.9, 0.5])
    assert curve.null_deg() == pytest.approx(0.0)


def test_saturation_is_the_smallest_distance_from_the_null() -> None:
    curve = response([-1, 0, 1, 2, 3], [SATURATION_CONTRAST, 0.6, 0.0, -0.6, -SATURATION_CONTRAST])
    assert curve.null_deg() == 1.0
    assert curve.saturation_deg() == pytest.approx(2.0)


def test_saturation_is_interpolated_linearly() -> None:
    curve = response([-2, -1, 0, 1, 2], [1.0, 0.9, 0.0, -0.9, -1.0])
    assert curve.saturation_deg() == pytest.approx(1.5)


def test_saturation_and_null_are_interpolated_on_the_same_line() -> None:
    curve = response([0, 1], [0.6, -1.0])
    assert curve.null_deg() == pytest.approx(0.6 / 1.6)
    assert curve.saturation_deg() == pytest.approx(SATURATION_CONTRAST / 1.6)


def test_saturation_is_none_without_a_null_or_below_the_level() -> None:
    assert response([-1, 0, 1], [0.9, 0.0, -0.9]).saturation_deg() is None
    assert response([1, 2], [-0.99, -1.0]).saturation_deg() is None
    assert response([-1, 0, 1], [math.nan] * 3).saturation_deg() is None


def test_index_of_the_nearest_angle() -> None:
    curve = response([-3, 0, 3], [0.5, 0.0, -0.5])
    assert [curve.index_at(angle) for angle in (-9.0, -1.6, 1.4, 2.0)] == [0, 0, 1, 2]
