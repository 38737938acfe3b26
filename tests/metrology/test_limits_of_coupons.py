"""The smallest resolved features: the rules applied to tables of sizes, and the probability of passing by chance."""

import numpy as np
import pytest

from solen.metrology.coupons import MeasuredSize, limits_of
from solen.metrology.coupons.limits import OUTSIDE, hole_variation, rise_by_chance, smallest, z_step


def measured_size(nominal: float, resolved: bool | None, kind: str = "pillar", reason: str = "") -> MeasuredSize:
    measured = nominal + 0.01 if resolved else None
    return MeasuredSize(f"{kind}-{nominal}", kind, nominal, measured, 0.001 if resolved else None, resolved, reason)


@pytest.mark.parametrize(
    ("resolved", "nominal", "following", "bound"),
    [
        ([True, True, True, True], 0.1, None, True),
        ([True, True, False, False], 0.3, 0.2, False),
        ([True, False, True, True], 0.5, 0.3, False),
        ([False, True, True, True], None, 0.5, False),
        ([True, True, None, None], 0.3, 0.2, True),
        ([True, True, None, False], 0.3, 0.2, True),
    ],
)
def test_limit_is_last_size_of_unbroken_sequence(
    resolved: list[bool | None], nominal: float | None, following: float | None, bound: bool
) -> None:
    gaps = [measured_size(*pair) for pair in zip((0.5, 0.3, 0.2, 0.1), resolved, strict=True)]
    limit = smallest("gap", gaps[::-1])
    assert limit is not None
    assert (limit.nominal_mm, limit.next_mm, limit.bound) == (nominal, following, bound)
    assert limit.measured_mm == (None if nominal is None else nominal + 0.01)


def test_one_failure_among_equal_sizes_fails_size() -> None:
    limit = smallest("hole", [measured_size(1.6, True), measured_size(1.4, True), measured_size(1.4, False)])
    assert limit is not None
    assert (limit.nominal_mm, limit.next_mm) == (1.6, 1.4)


def test_ignores_features_outside_image() -> None:
    limit = smallest(
        "gap", [measured_size(0.5, None, reason=OUTSIDE), measured_size(0.3, True), measured_size(0.2, False)]
    )
    assert limit is not None
    assert limit.nominal_mm == 0.3
    assert smallest("gap", [measured_size(0.5, None, reason=OUTSIDE)]) is None
    assert limits_of([]) == ()


NOMINAL = np.array([1.65, 1.65, 1.6, 1.55, 1.5, 1.45, 1.4, 1.4])


def holes(sizes: np.ndarray, u_mm: float = 1e-4) -> list[MeasuredSize]:
    return [
        MeasuredSize(f"h{k}", "hole", n, float(d), u_mm, True)
        for k, (n, d) in enumerate(zip(NOMINAL, sizes, strict=True))
    ]


def test_no_variation_is_claimed_for_random_holes() -> None:
    """For holes of equal true size, no variation is claimed in at least 95 % of prints (in far more, by Bonferroni)."""
    rng = np.random.default_rng(4)
    claimed = [hole_variation(holes(1.5 + 0.01 * rng.standard_normal(8))) for _ in range(400)]
    fraction = np.mean([limit is not None and limit.nominal_mm is not None for limit in claimed])
    assert fraction <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 400)


@pytest.mark.parametrize(
    ("scatter", "nominal", "following"), [(0.002, 0.05, None), (0.012, 0.15, 0.1), (0.2, None, 0.25)]
)
def test_variation_grows_with_scatter(scatter: float, nominal: float | None, following: float | None) -> None:
    """The scatter has fixed signs and is orthogonal to a straight line."""
    signs = np.array([1, -1, 1, 0, -1, 0, 1, -1]) * scatter
    limit = hole_variation(holes(NOMINAL - 0.04 + signs))
    assert limit is not None
    assert (limit.nominal_mm, limit.next_mm) == (nominal, following)


def test_larger_measurement_uncertainty_determines_variation() -> None:
    precise, imprecise = hole_variation(holes(NOMINAL, 1e-4)), hole_variation(holes(NOMINAL, 0.03))
    assert precise is not None
    assert imprecise is not None
    assert precise.nominal_mm == 0.05
    assert imprecise.nominal_mm is None or imprecise.nominal_mm > 0.1


def test_too_few_holes_give_no_variation() -> None:
    assert hole_variation(holes(NOMINAL)[:3]) is None
    assert hole_variation(holes(NOMINAL)[:2] * 2) is None


def test_probability_of_rise_by_chance() -> None:
    """For means of twelve values without a rise, the probabilities are uniform to within three standard deviations."""
    rng = np.random.default_rng(9)
    low, high = rng.standard_normal((2, 2000, 12))
    rise = high.mean(axis=1) - low.mean(axis=1)
    u = [heights.std(axis=1, ddof=1) / np.sqrt(12) for heights in (low, high)]
    chance = np.array([rise_by_chance(r, a, b, 11.0) for r, a, b in zip(rise, *u, strict=True)])
    for level in (0.05, 0.5, 0.95):
        assert np.mean(chance < level) == pytest.approx(level, abs=3 * np.sqrt(level * (1 - level) / 2000))


def test_step_is_resolved_if_all_of_its_size_are() -> None:
    def step(size: float, rise: float, resolved: bool | None) -> MeasuredSize:
        return MeasuredSize(f"s{size}{rise}", "step", size, rise, 1e-4, resolved)

    steps = [step(0.1, 0.098, True), step(0.1, 0.102, True), step(0.025, 0.05, True), step(0.025, 0.0, False)]
    limit = z_step(steps)
    assert limit is not None
    assert (limit.nominal_mm, limit.next_mm, limit.bound) == (0.1, 0.025, False)
    assert limit.measured_mm == pytest.approx(0.1)
    assert limit.u_measured_mm == pytest.approx(0.002, rel=0.01), (
        "from their scatter, which exceeds their own uncertainties"
    )
    whole = z_step(steps[:3])
    assert whole is not None
    assert (whole.nominal_mm, whole.bound) == (0.025, True)
    assert z_step([step(0.1, 0.0, None)]) is None
