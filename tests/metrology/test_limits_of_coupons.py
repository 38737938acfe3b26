"""The smallest resolved features: the rules on tables of sizes, and how often chance alone would pass them."""

import numpy as np
import pytest

from solen.metrology.coupons import MeasuredSize, limits_of
from solen.metrology.coupons.limits import OUTSIDE, hole_variation, rise_by_chance, smallest, z_step


def told(nominal: float, resolved: bool | None, kind: str = "pillar", reason: str = "") -> MeasuredSize:
    size = nominal + 0.01 if resolved else None
    return MeasuredSize(f"{kind}-{nominal}", kind, nominal, size, 0.001 if resolved else None, resolved, reason)


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
def test_the_smallest_is_the_last_of_an_unbroken_row(
    resolved: list[bool | None], nominal: float | None, following: float | None, bound: bool
) -> None:
    some = [told(size, one) for size, one in zip((0.5, 0.3, 0.2, 0.1), resolved, strict=True)]
    found = smallest("gap", some[::-1])
    assert found is not None
    assert (found.nominal_mm, found.next_mm, found.bound) == (nominal, following, bound)
    assert found.measured_mm == (None if nominal is None else nominal + 0.01)


def test_one_of_two_alike_that_fails_fails_both() -> None:
    found = smallest("hole", [told(1.6, True), told(1.4, True), told(1.4, False)])
    assert found is not None
    assert (found.nominal_mm, found.next_mm) == (1.6, 1.4)


def test_what_is_not_in_the_image_neither_passes_nor_fails() -> None:
    found = smallest("gap", [told(0.5, None, reason=OUTSIDE), told(0.3, True), told(0.2, False)])
    assert found is not None
    assert found.nominal_mm == 0.3
    assert smallest("gap", [told(0.5, None, reason=OUTSIDE)]) is None
    assert limits_of([]) == ()


NOMINAL = np.array([1.65, 1.65, 1.6, 1.55, 1.5, 1.45, 1.4, 1.4])


def holes(sizes: np.ndarray, u_mm: float = 1e-4) -> list[MeasuredSize]:
    return [
        MeasuredSize(f"h{k}", "hole", n, float(d), u_mm, True)
        for k, (n, d) in enumerate(zip(NOMINAL, sizes, strict=True))
    ]


def test_holes_that_do_not_follow_their_nominal_sizes_show_no_variation() -> None:
    """All of one true size: in 95 % of the prints at least nothing is claimed (by Bonferroni far more often)."""
    rng = np.random.default_rng(4)
    claimed = [hole_variation(holes(1.5 + 0.01 * rng.standard_normal(8))) for _ in range(400)]
    share = np.mean([one is not None and one.nominal_mm is not None for one in claimed])
    assert share <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 400)


@pytest.mark.parametrize(
    ("scatter", "nominal", "following"), [(0.002, 0.05, None), (0.012, 0.15, 0.1), (0.2, None, 0.25)]
)
def test_the_variation_grows_with_the_scatter(scatter: float, nominal: float | None, following: float | None) -> None:
    """A scatter of fixed signs, of which no line takes a part."""
    signs = np.array([1, -1, 1, 0, -1, 0, 1, -1]) * scatter
    found = hole_variation(holes(NOMINAL - 0.04 + signs))
    assert found is not None
    assert (found.nominal_mm, found.next_mm) == (nominal, following)


def test_the_uncertainty_of_measuring_counts_where_it_is_more() -> None:
    good, bad = hole_variation(holes(NOMINAL, 1e-4)), hole_variation(holes(NOMINAL, 0.03))
    assert good is not None
    assert bad is not None
    assert good.nominal_mm == 0.05
    assert bad.nominal_mm is None or bad.nominal_mm > 0.1


def test_too_few_holes_tell_no_variation() -> None:
    assert hole_variation(holes(NOMINAL)[:3]) is None
    assert hole_variation(holes(NOMINAL)[:2] * 2) is None


def test_a_rise_by_chance_is_as_rare_as_stated() -> None:
    """Means of twelve pieces each, no rise: the probabilities are even, within three standard deviations."""
    rng = np.random.default_rng(9)
    low, high = rng.standard_normal((2, 2000, 12))
    rise = high.mean(axis=1) - low.mean(axis=1)
    u = [part.std(axis=1, ddof=1) / np.sqrt(12) for part in (low, high)]
    chance = np.array([rise_by_chance(r, a, b, 11.0) for r, a, b in zip(rise, *u, strict=True)])
    for level in (0.05, 0.5, 0.95):
        assert np.mean(chance < level) == pytest.approx(level, abs=3 * np.sqrt(level * (1 - level) / 2000))


def test_a_step_is_reproduced_where_all_of_its_size_are() -> None:
    def step(size: float, rise: float, resolved: bool | None) -> MeasuredSize:
        return MeasuredSize(f"s{size}{rise}", "step", size, rise, 1e-4, resolved)

    some = [step(0.1, 0.098, True), step(0.1, 0.102, True), step(0.025, 0.05, True), step(0.025, 0.0, False)]
    found = z_step(some)
    assert found is not None
    assert (found.nominal_mm, found.next_mm, found.bound) == (0.1, 0.025, False)
    assert found.measured_mm == pytest.approx(0.1)
    assert found.u_measured_mm == pytest.approx(0.002, rel=0.01), "their scatter is more than their own uncertainties"
    whole = z_step(some[:3])
    assert whole is not None
    assert (whole.nominal_mm, whole.bound) == (0.025, True)
    assert z_step([step(0.1, 0.0, None)]) is None
