"""Layouts of coupons: the values of the source, the interpretations of its ambiguities, and refused values."""

import math
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solen.errors import SpecError
from solen.geometry.coupons import (
    COUPONS,
    Coupon,
    CouponOptions,
    Feature,
    Slab,
    group_a,
    group_b,
    group_c,
    holes,
    layout,
)
from solen.geometry.coupons.raised import heights_mm

every_coupon = pytest.mark.parametrize("name", COUPONS)


def test_group_a_has_diameters_of_source() -> None:
    pillars = group_a().of_kind("pillar")
    nominal = [1.00, 0.80, 0.60, 0.50, 0.40, 0.30, 0.25, 0.20, 0.18, 0.16, 0.14, 0.12, 0.10, 0.08, 0.06]
    assert [feature.diameter_mm for feature in pillars] == nominal
    assert all(feature.height_mm == pytest.approx(3.0) and feature.from_mm == 0.8 for feature in pillars)


@pytest.mark.parametrize("reading", ["pairs", "row"])
@pytest.mark.parametrize("pitch_um", [None, 62.0])
def test_group_b_has_gaps_of_source(reading: str, pitch_um: float | None) -> None:
    coupon = group_b(CouponOptions(gap_reading=reading, pitch_um=pitch_um))
    nominal = [0.50, 0.30, 0.20, 0.15, 0.12, 0.10, 0.08, 0.06, 0.05, 0.04, 0.03, 0.02]
    assert [gap.gap_mm for gap in coupon.gaps] == nominal
    assert len(coupon.of_kind("pillar")) == (24 if reading == "pairs" else 13)
    for gap in coupon.gaps:
        left, right = (coupon.feature(name) for name in gap.between)
        assert left.distance_mm(right) == pytest.approx(gap.gap_mm, abs=1e-12)
        assert left.diameter_mm == right.diameter_mm == 0.3


def test_group_c_has_row_for_each_step() -> None:
    coupon = group_c()
    rows = {k: [p for p in coupon.of_kind("pillar") if p.name.startswith(f"row-{k}-")] for k in (1, 2, 3)}
    assert [len(row) for row in rows.values()] == [10, 7, 13]
    for number, step in ((1, 0.1), (2, 0.05), (3, 0.025)):
        heights = [feature.height_mm for feature in rows[number]]
        assert np.diff(heights) == pytest.approx(step, abs=1e-9)
    assert (rows[1][0].height_mm, rows[1][-1].height_mm) == pytest.approx((0.1, 1.0))
    assert all(rows[k][-1].height_mm == pytest.approx(0.5) for k in (2, 3))
    for coupon_step in coupon.steps:
        low, high = (coupon.feature(name) for name in coupon_step.between)
        assert high.height_mm - low.height_mm == pytest.approx(coupon_step.step_mm, abs=1e-9)


def test_literal_steps_give_one_and_two_heights() -> None:
    names = [feature.name for feature in group_c(CouponOptions(step_reading="literal")).of_kind("pillar")]
    assert [sum(name.startswith(f"row-{k}-") for name in names) for k in (1, 2, 3)] == [10, 1, 2]


@pytest.mark.parametrize(
    ("reading", "smallest", "largest", "step"),
    [("repeats", 1.40, 1.65, 0.05), ("even", 1.40, 1.65, 0.25 / 7), ("tenths", 1.40, 2.10, 0.1)],
)
def test_every_hole_reading_has_eight_holes_on_slab(reading: str, smallest: float, largest: float, step: float) -> None:
    coupon = holes(CouponOptions(hole_reading=reading))
    sizes = [feature.diameter_mm for feature in coupon.of_kind("hole")]
    assert len(sizes) == 8
    assert sizes == sorted(sizes, reverse=True), "decreasing"
    assert (min(sizes), max(sizes)) == pytest.approx((smallest, largest))
    steps = -np.diff(sizes)
    assert steps[steps > 0] == pytest.approx(step, abs=1e-6)
    assert coupon.size_mm == (16.0, 3.0, 1.0)
    walls = [feature.distance_mm(other) for feature, other in pairwise(coupon.features)]
    ends = [8.0 - abs(feature.x_mm) - 0.5 * feature.width_mm for feature in (coupon.features[0], coupon.features[-1])]
    assert [*walls, *ends] == pytest.approx([walls[0]] * 9)


def test_z_reference_heights_and_slab() -> None:
    literal, staircase = (layout("z-reference", CouponOptions(reference_reading=r)) for r in ("literal", "staircase"))
    assert [feature.height_mm for feature in literal.features] == pytest.approx([1.0, 1.025, 0.025])
    assert [feature.height_mm for feature in staircase.features] == pytest.approx([1.0, 1.025, 1.05])
    assert literal.slab == Slab(10.0, 3.2, 0.8)


def test_film_layer_has_platform_offset() -> None:
    coupon = layout("film-layer", CouponOptions(film_mm=0.125, layer_um=50.0))
    base, layer = coupon.stages
    assert (base.z_offset_mm, layer.z_offset_mm) == pytest.approx((0.0, 0.625))
    assert "0.125 mm higher than with the base alone" in layer.note
    assert coupon.feature("layer").height_mm == pytest.approx(0.05)
    assert coupon.feature("base").height_mm == 0.5


@every_coupon
@pytest.mark.parametrize("pitch_um", [None, 27.0, 62.0])
def test_features_are_separate_and_on_slab(name: str, pitch_um: float | None) -> None:
    coupon = layout(name, CouponOptions(pitch_um=pitch_um))
    for feature, other in combinations(coupon.features, 2):
        assert feature.stage != other.stage or not feature.must_clear(other) or feature.distance_mm(other) > 0.0
    width, depth, _ = coupon.size_mm
    for feature in coupon.features:
        assert abs(feature.x_mm) + 0.5 * feature.width_mm <= 0.5 * width + 1e-9
        assert abs(feature.y_mm) + 0.5 * feature.depth_mm <= 0.5 * depth + 1e-9


@pytest.mark.parametrize("name", ["group-a", "group-b", "group-c"])
def test_marks_have_no_symmetry(name: str) -> None:
    marks = np.array([(mark.x_mm, mark.y_mm) for mark in layout(name).of_kind("mark")])
    for symmetry in (np.diag([-1, -1]), np.diag([1, -1]), np.diag([-1, 1])):
        transformed = marks @ symmetry
        assert not all(np.hypot(*(marks - position).T).min() < 0.5 for position in transformed)


@pytest.mark.parametrize("name", ["group-a", "group-c"])
def test_pillars_are_centred_on_pixel_corners(name: str) -> None:
    for feature in layout(name, CouponOptions(pitch_um=62.0)).features:
        for position_mm in (feature.x_mm, feature.y_mm):
            assert math.remainder(position_mm, 0.062) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("values", "part"),
    [
        ({"spacing_mm": 0.0}, "spacing_mm = 0.0"),
        ({"layer_um": math.nan}, "layer_um"),
        ({"layer_um": math.inf}, "layer_um"),
        ({"hole_reading": "fifths"}, "hole_reading = 'fifths'"),
        ({"guide_lengths_mm": ()}, "guide_lengths_mm"),
        ({"guide_lengths_mm": (5.0, -1.0)}, "guide_lengths_mm = -1.0"),
        ({"cubes": 0}, "cubes = 0"),
    ],
)
def test_refuses_invalid_options(values: dict[str, object], part: str) -> None:
    with pytest.raises(SpecError) as raised:
        CouponOptions(**values)
    assert part in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("make", "part"),
    [
        (lambda: group_a(diameters_mm=(1.0, 0.0)), "must be above 0"),
        (lambda: group_a(diameters_mm=(1.0, 1.0)), "2 features are named d-1; specify each size only once"),
        (lambda: group_b(gaps_mm=(0.1, -0.02)), "overlap"),
        (lambda: holes(diameters_mm=(9.0, 9.0)), "do not fit side by side"),
        (lambda: holes(diameters_mm=(3.0,)), "does not fit on the slab"),
        (lambda: layout("group-x"), "must be one of group-a"),
        (lambda: layout("group-a", CouponOptions(bevel_mm=9.0)), "must be smaller than the sides of the slab"),
        (lambda: Coupon("empty", "", ()), "at least one"),
    ],
)
def test_refuses_impossible_coupons(make: object, part: str) -> None:
    with pytest.raises(SpecError) as raised:
        make()  # type: ignore[operator]
    assert part in str(raised.value)


@settings(max_examples=40, deadline=None)
@given(st.floats(0.01, 1.0), st.floats(0.001, 0.5), st.integers(1, 20))
def test_heights_reach_highest_without_accumulated_rounding(low: float, step: float, count: int) -> None:
    heights = heights_mm(low, low + count * step, step)
    assert len(heights) == count + 1
    assert heights[-1] == pytest.approx(low + count * step, abs=1e-8)


def test_distances_of_round_and_square_features() -> None:
    disc = Feature("a", "pillar", 0.0, 0.0, 2.0, 2.0, 0.0, 1.0)
    second_disc = Feature("b", "pillar", 3.0, 4.0, 2.0, 2.0, 0.0, 1.0)
    block = Feature("c", "pillar", 5.0, 6.0, 2.0, 2.0, 0.0, 1.0, round=False)
    assert disc.distance_mm(second_disc) == pytest.approx(3.0)
    assert disc.distance_mm(block) == pytest.approx(5.0), "corner to corner, 3 and 4 mm apart in x and y"


def test_ledge_bars_have_waist() -> None:
    """Layers recede by the ledge on both sides up to the middle, then protrude again; first and last are equal."""
    coupon = layout("ledges", CouponOptions(ledges_um=(10.0,), ledge_layers=8, layer_um=50.0))
    plain_bar, *bar = coupon.features
    assert (plain_bar.width_mm, plain_bar.height_mm) == pytest.approx((3.0, 0.4))
    assert [layer.width_mm for layer in bar] == pytest.approx([3.0, 2.98, 2.96, 2.94, 2.94, 2.96, 2.98, 3.0])
    assert [layer.from_mm for layer in bar] == pytest.approx([0.05 * i for i in range(8)])
    with pytest.raises(SpecError, match="overlap"):
        replace(coupon, features=(*bar, replace(bar[0], name="again")))


def test_refuses_pillar_over_hole() -> None:
    hole = Feature("hole", "hole", 0.0, 0.0, 1.0, 1.0, 0.0, 0.8)
    pillar = Feature("pillar", "pillar", 0.0, 0.0, 0.5, 0.5, 0.8, 2.0)
    with pytest.raises(SpecError, match="overlap"):
        Coupon("both", "", (hole, pillar), Slab(5.0, 5.0, 0.8))
