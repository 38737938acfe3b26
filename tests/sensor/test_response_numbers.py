"""What is read off a response curve: contrast, null, saturation, or that there is none."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from solen.sensor import SATURATED, Response


def response(angle_deg: Sequence[float], contrast: Sequence[float], total: float = 0.5) -> Response:
    """A response of given contrasts; NaN stands for no light."""
    angles, wanted = np.array(angle_deg, dtype=float), np.array(contrast, dtype=float)
    dark = np.isnan(wanted)
    right = np.where(dark, 0.0, total * (1 + wanted) / 2)
    left = np.where(dark, 0.0, total * (1 - wanted) / 2)
    n = len(angles)
    return Response("power", angles, right, left, np.zeros(n), ())


def test_contrast_is_the_difference_over_the_sum() -> None:
    found = response([-1, 0, 1], [0.5, 0.0, -1.0])
    assert found.contrast == pytest.approx([0.5, 0.0, -1.0])


def test_contrast_without_light_is_missing_and_warns_of_nothing() -> None:
    found = response([-1, 0, 1], [math.nan, 0.2, math.nan])
    assert np.isnan(found.contrast).tolist() == [True, False, True]


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
def test_null_is_where_both_see_the_same(
    angles: Sequence[float], contrast: Sequence[float], null: float | None
) -> None:
    found = response(angles, contrast).null_deg()
    assert found == (None if null is None else pytest.approx(null, abs=1e-12))


def test_a_null_within_the_uncertainty_is_at_the_traced_angle() -> None:
    found = response([-1, 0, 1], [0.5, 1e-5, 0.4])
    assert found.null_deg() is None
    uncertain = replace(found, u_power=np.full(3, 0.5 * 1e-5))
    assert uncertain.null_deg() == 0.0
    unknown = replace(found, u_power=np.full(3, math.nan))
    assert unknown.null_deg() is None


def test_of_several_nulls_that_nearest_to_rest_is_reported() -> None:
    found = response([-40, -30, -1, 1, 30, 40], [-0.5, 0.9, 0.8, -0.8, -0.9, 0.5])
    assert found.null_deg() == pytest.approx(0.0)


def test_saturation_is_the_smallest_distance_from_the_null() -> None:
    found = response([-1, 0, 1, 2, 3], [SATURATED, 0.6, 0.0, -0.6, -SATURATED])
    assert found.null_deg() == 1.0
    assert found.saturation_deg() == pytest.approx(2.0)


def test_saturation_between_two_angles_is_on_a_straight_line() -> None:
    found = response([-2, -1, 0, 1, 2], [1.0, 0.9, 0.0, -0.9, -1.0])
    assert found.saturation_deg() == pytest.approx(1.5)


def test_saturation_between_two_angles_with_the_null_between_them_is_on_the_line_that_the_null_is_on() -> None:
    found = response([0, 1], [0.6, -1.0])
    assert found.null_deg() == pytest.approx(0.6 / 1.6)
    assert found.saturation_deg() == pytest.approx(SATURATED / 1.6)


def test_saturation_is_missing_where_it_is_never_reached_or_nothing_balances() -> None:
    assert response([-1, 0, 1], [0.9, 0.0, -0.9]).saturation_deg() is None
    assert response([1, 2], [-0.99, -1.0]).saturation_deg() is None
    assert response([-1, 0, 1], [math.nan] * 3).saturation_deg() is None


def test_nearest_angle() -> None:
    found = response([-3, 0, 3], [0.5, 0.0, -0.5])
    assert [found.at(angle) for angle in (-9.0, -1.6, 1.4, 2.0)] == [0, 0, 1, 2]
