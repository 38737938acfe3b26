"""Layouts of coupons: what the source states of them, the readings of what it does not, and what is refused."""

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


def test_group_a_is_the_sources() -> None:
    pillars = group_a().of_kind("pillar")
    stated = [1.00, 0.80, 0.60, 0.50, 0.40, 0.30, 0.25, 0.20, 0.18, 0.16, 0.14, 0.12, 0.10, 0.08, 0.06]
    assert [one.diameter_mm for one in pillars] == stated
    assert all(one.height_mm == pytest.approx(3.0) and one.from_mm == 0.8 for one in pillars)


@pytest.mark.parametrize("reading", ["pairs", "row"])
@pytest.mark.parametrize("pitch_um", [None, 62.0])
def test_group_b_has_the_sources_gaps(reading: str, pitch_um: float | None) -> None:
    coupon = group_b(CouponOptions(gap_reading=reading, pitch_um=pitch_um))
    stated = [0.50, 0.30, 0.20, 0.15, 0.12, 0.10, 0.08, 0.06, 0.05, 0.04, 0.03, 0.02]
    assert [gap.gap_mm for gap in coupon.gaps] == stated
    assert len(coupon.of_kind("pillar")) == (24 if reading == "pairs" else 13)
    for gap in coupon.gaps:
        one, other = (coupon.feature(name) for name in gap.between)
        assert one.distance_mm(other) == pytest.approx(gap.gap_mm, abs=1e-12)
        assert one.diameter_mm == other.diameter_mm == 0.3


def test_group_c_has_a_row_for_each_step() -> None:
    coupon = group_c()
    rows = {k: [p for p in coupon.of_kind("pillar") if p.name.startswith(f"row-{k}-")] for k in (1, 2, 3)}
    assert [len(row) for row in rows.values()] == [10, 7, 13]
    for number, step in ((1, 0.1), (2, 0.05), (3, 0.025)):
        heights = [one.height_mm for one in rows[number]]
        assert np.diff(heights) == pytest.approx(step, abs=1e-9)
    assert (rows[1][0].height_mm, rows[1][-1].height_mm) == pytest.approx((0.1, 1.0))
    assert all(rows[k][-1].height_mm == pytest.approx(0.5) for k in (2, 3))
    for step_of in coupon.steps:
        low, high = (coupon.feature(name) for name in step_of.between)
        assert high.height_mm - low.height_mm == pytest.approx(step_of.step_mm, abs=1e-9)


def test_steps_as_printed_leave_one_height_and_two() -> None:
    names = [one.name for one in group_c(CouponOptions(step_reading="literal")).of_kind("pillar")]
    assert [sum(name.startswith(f"row-{k}-") for name in names) for k in (1, 2, 3)] == [10, 1, 2]


@pytest.mark.parametrize(
    ("reading", "smallest", "largest", "step"),
    [("repeats", 1.40, 1.65, 0.05), ("even", 1.40, 1.65, 0.25 / 7), ("tenths", 1.40, 2.10, 0.1)],
)
def test_every_reading_of_the_holes_has_eight_on_the_slab(
    reading: str, smallest: float, largest: float, step: float
) -> None:
    coupon = holes(CouponOptions(hole_reading=reading))
    sizes = [one.diameter_mm for one in coupon.of_kind("hole")]
    assert len(sizes) == 8
    assert sizes == sorted(sizes, reverse=True), "decreasing"
    assert (min(sizes), max(sizes)) == pytest.approx((smallest, largest))
    steps = -np.diff(sizes)
    assert steps[steps > 0] == pytest.approx(step, abs=1e-6)
    assert coupon.size_mm == (16.0, 3.0, 1.0)
    walls = [one.distance_mm(other) for one, other in pairwise(coupon.features)]
    ends = [8.0 - abs(one.x_mm) - 0.5 * one.width_mm for one in (coupon.features[0], coupon.features[-1])]
    assert [*walls, *ends] == pytest.approx([walls[0]] * 9)


def test_the_reference_stands_on_its_slab() -> None:
    literal, stairs = (layout("z-reference", CouponOptions(reference_reading=r)) for r in ("literal", "staircase"))
    assert [one.height_mm for one in literal.features] == pytest.approx([1.0, 1.025, 0.025])
    assert [one.height_mm for one in stairs.features] == pytest.approx([1.0, 1.025, 1.05])
    assert literal.slab == Slab(10.0, 3.2, 0.8)


def test_the_film_layer_tells_the_offset_of_the_printer() -> None:
    coupon = layout("film-layer", CouponOptions(film_mm=0.125, layer_um=50.0))
    base, layer = coupon.stages
    assert (base.z_offset_mm, layer.z_offset_mm) == pytest.approx((0.0, 0.625))
    assert "0.125 mm higher than for continuing the base" in layer.note
    assert coupon.feature("layer").height_mm == pytest.approx(0.05)
    assert coupon.feature("base").height_mm == 0.5


@every_coupon
@pytest.mark.parametrize("pitch_um", [None, 27.0, 62.0])
def test_features_stand_apart_and_on_their_slab(name: str, pitch_um: float | None) -> None:
    coupon = layout(name, CouponOptions(pitch_um=pitch_um))
    for one, other in combinations(coupon.features, 2):
        assert one.stage != other.stage or not one.meets(other) or one.distance_mm(other) > 0.0
    width, depth, _ = coupon.size_mm
    for one in coupon.features:
        assert abs(one.x_mm) + 0.5 * one.width_mm <= 0.5 * width + 1e-9
        assert abs(one.y_mm) + 0.5 * one.depth_mm <= 0.5 * depth + 1e-9


@pytest.mark.parametrize("name", ["group-a", "group-b", "group-c"])
def test_no_turn_or_mirror_image_maps_the_marks_onto_themselves(name: str) -> None:
    marks = np.array([(one.x_mm, one.y_mm) for one in layout(name).of_kind("mark")])
    for turn in (np.diag([-1, -1]), np.diag([1, -1]), np.diag([-1, 1])):
        moved = marks @ turn
        assert not all(np.hypot(*(marks - one).T).min() < 0.5 for one in moved)


@pytest.mark.parametrize("name", ["group-a", "group-c"])
def test_pillars_stand_on_corners_of_pixels(name: str) -> None:
    for one in layout(name, CouponOptions(pitch_um=62.0)).features:
        for place in (one.x_mm, one.y_mm):
            assert math.remainder(place, 0.062) == pytest.approx(0.0, abs=1e-9)


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
def test_choices_that_cannot_be_are_refused(values: dict[str, object], part: str) -> None:
    with pytest.raises(SpecError) as told:
        CouponOptions(**values)
    assert part in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("make", "part"),
    [
        (lambda: group_a(diameters_mm=(1.0, 0.0)), "must be above 0"),
        (lambda: group_a(diameters_mm=(1.0, 1.0)), "two features have the same size"),
        (lambda: group_b(gaps_mm=(0.1, -0.02)), "overlap"),
        (lambda: holes(diameters_mm=(9.0, 9.0)), "do not fit side by side"),
        (lambda: holes(diameters_mm=(3.0,)), "does not fit on the slab"),
        (lambda: layout("group-x"), "must be one of group-a"),
        (lambda: layout("group-a", CouponOptions(bevel_mm=9.0)), "must be less than the slab"),
        (lambda: Coupon("empty", "", ()), "at least one"),
    ],
)
def test_coupons_that_cannot_be_are_refused(make: object, part: str) -> None:
    with pytest.raises(SpecError) as told:
        make()  # type: ignore[operator]
    assert part in str(told.value)


@settings(max_examples=40, deadline=None)
@given(st.floats(0.01, 1.0), st.floats(0.001, 0.5), st.integers(1, 20))
def test_heights_reach_the_highest_without_the_rounding_of_sums(low: float, step: float, count: int) -> None:
    found = heights_mm(low, low + count * step, step)
    assert len(found) == count + 1
    assert found[-1] == pytest.approx(low + count * step, abs=1e-8)


def test_distances_of_round_and_square() -> None:
    disc = Feature("a", "pillar", 0.0, 0.0, 2.0, 2.0, 0.0, 1.0)
    other = Feature("b", "pillar", 3.0, 4.0, 2.0, 2.0, 0.0, 1.0)
    block = Feature("c", "pillar", 5.0, 6.0, 2.0, 2.0, 0.0, 1.0, round=False)
    assert disc.distance_mm(other) == pytest.approx(3.0)
    assert disc.distance_mm(block) == pytest.approx(5.0), "corner to corner, 3 and 4 apart"


def test_bars_of_ledges_have_a_waist() -> None:
    """Each layer stands back by the ledge at both sides up to the middle, and out again; both faces are alike."""
    made = layout("ledges", CouponOptions(ledges_um=(10.0,), ledge_layers=8, layer_um=50.0))
    upright, *bar = made.features
    assert (upright.width_mm, upright.height_mm) == pytest.approx((3.0, 0.4))
    assert [layer.width_mm for layer in bar] == pytest.approx([3.0, 2.98, 2.96, 2.94, 2.94, 2.96, 2.98, 3.0])
    assert [layer.from_mm for layer in bar] == pytest.approx([0.05 * i for i in range(8)])
    with pytest.raises(SpecError, match="overlap"):
        replace(made, features=(*bar, replace(bar[0], name="again")))


def test_a_pillar_over_a_hole_overlaps() -> None:
    hole = Feature("hole", "hole", 0.0, 0.0, 1.0, 1.0, 0.0, 0.8)
    pillar = Feature("pillar", "pillar", 0.0, 0.0, 0.5, 0.5, 0.8, 2.0)
    with pytest.raises(SpecError, match="overlap"):
        Coupon("both", "", (hole, pillar), Slab(5.0, 5.0, 0.8))
