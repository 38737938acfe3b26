"""Interfaces that coincide over a length, or cross, are refused; neighbours and T-junctions are accepted."""

import math

import pytest

from solen.curve import Arc, Bezier, Curve, Segment
from solen.errors import DesignError
from solen.plane import Point, Rigid
from solen.scene import Fan, Interface, Region, Scene
from solen.scene.overlaps import check_overlaps


def box(name: str, low: Point, high: Point, inside: str = "glass", outside: str = "air") -> list[Interface]:
    corners = [low, (high[0], low[1]), high, (low[0], high[1])]
    sides = zip(corners, corners[1:] + corners[:1], strict=True)
    return [Interface(f"{name}{i}", Segment(a, b), inside, outside) for i, (a, b) in enumerate(sides)]


FIRST = box("a", (-1.0, 1.0), (1.0, 3.0))


def refused(interfaces: list[Interface]) -> str:
    with pytest.raises(DesignError) as refusal:
        check_overlaps(interfaces)
    return str(refusal.value)


@pytest.mark.parametrize(("low_x", "high_x", "at_x"), [(-1.0, 1.0, 0.0), (-0.5, 0.5, 0.0), (0.0, 2.0, 0.5)])
def test_reports_position_of_common_face(low_x: float, high_x: float, at_x: float) -> None:
    """Without this check, 44 to 88 % of the light of a fan became undefined there."""
    second = box("b", (low_x, 3.0), (high_x, 5.0))
    line = refused([*FIRST, *second])
    assert "interfaces a2 and b0" in line
    assert f"overlap at x = {at_x:g}, z = 3 mm" in line
    regions = (Region("air", 1.0), Region("glass", 1.5))
    with pytest.raises(DesignError, match="overlap"):
        Scene(regions, (*FIRST, *second), (Fan((0.0, 0.0), 0.0, 20.0, 10),))


@pytest.mark.parametrize("turn_deg", [0.0, 17.0, 211.0])
@pytest.mark.parametrize("gap_mm", [1e-6, 0.1])
def test_accepts_bodies_separated_by_gap(gap_mm: float, turn_deg: float) -> None:
    turn = Rigid.about((0.3, 0.7), turn_deg)
    interfaces = [*FIRST, *box("b", (-1.0, 3.0 + gap_mm), (1.0, 5.0))]
    check_overlaps([Interface(i.name, i.curve.moved(turn), i.left, i.right) for i in interfaces])


def test_reports_crossing_of_overlapping_bodies() -> None:
    line = refused([*FIRST, *box("b", (0.0, 2.0), (2.0, 5.0))])
    assert "interfaces a2 and b3" in line
    assert "cross at x = " in line
    assert "z = 3 mm" in line


CIRCLE = Arc.circle((0.0, 0.0), 2.0)


@pytest.mark.parametrize(
    ("first", "second", "fault"),
    [
        (CIRCLE, Arc((0.0, 0.0), 2.0, 30.0, 360.0), "overlap"),
        (CIRCLE, Arc((0.0, 0.0), 2.0, 30.0, 45.0), "overlap"),
        (CIRCLE, Arc.circle((1.0, 0.0), 2.0), "cross"),
        (CIRCLE, Segment((-3.0, 0.5), (3.0, 0.4)), "cross"),
        (Bezier((0.0, 0.0), (1.0, 2.0), (3.0, 2.0), (4.0, 0.0)), Segment((0.5, -1.0), (0.5, 5.0)), "cross"),
        (
            Bezier((0.0, 0.0), (1.0, 2.0), (3.0, 2.0), (4.0, 0.0)),
            Bezier((4.0, 0.0), (3.0, 2.0), (1.0, 2.0), (0.0, 0.0)),
            "overlap",
        ),
        (Bezier((0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (3.0, 0.0)), Segment((-1.0, 0.0), (4.0, 0.0)), "overlap"),
    ],
)
def test_refuses_curves_that_coincide_or_cross(first: Curve, second: Curve, fault: str) -> None:
    pair = [Interface("one", first, "glass", "air"), Interface("two", second, "glass", "air")]
    assert fault in refused(pair)
    assert fault in refused(pair[::-1])
    assert fault in refused([pair[0], Interface("two", second.reversed(), "air", "glass")])


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (CIRCLE, Arc.circle((0.0, 0.0), 2.001)),
        (CIRCLE, Arc.circle((4.0, 0.0), 2.0)),  # touching circles
        (CIRCLE, Segment((-3.0, 2.0), (3.0, 2.0))),  # a tangent
        (Arc((0.0, 0.0), 2.0, 0.0, 90.0), Arc((0.0, 0.0), 2.0, 90.0, 90.0)),  # consecutive arcs
        (Arc((0.0, 0.0), 2.0, 0.0, 90.0), Segment((2.0, 0.0), (2.0, -5.0))),  # a fillet
        (Arc((0.0, 0.0), 1e4, 0.0, 0.01), Segment((1e4, 0.0), (1e4, 1.5))),  # leaves its tangent by 1e-4 mm
        (Segment((0.0, 0.0), (1.0, 0.0)), Segment((1.0, 0.0), (3.0, 0.0))),
        (Segment((0.0, 0.0), (1.0, 0.0)), Segment((0.5, 0.0), (0.5, 3.0))),  # a T
    ],
)
def test_accepts_curves_that_touch_or_join(first: Curve, second: Curve) -> None:
    pair = [Interface("one", first, "glass", "air"), Interface("two", second, "glass", "air")]
    check_overlaps(pair)
    check_overlaps(pair[::-1])


def test_walls_within_one_medium_may_cross_but_not_coincide() -> None:
    wall = Interface("wall", Segment((-1.0, 0.0), (1.0, 0.0)), "air", "air", "absorbing")
    check_overlaps([wall, Interface("mirror", Segment((0.0, -1.0), (0.0, 1.0)), "air", "air", "mirror")])
    line = refused([wall, Interface("mirror", Segment((0.5, 0.0), (4.0, 0.0)), "air", "air", "mirror")])
    assert "x = 0.75, z = 0 mm" in line
    across = Interface("mirror", Segment((0.0, -1.0), (0.0, math.pi)), "air", "air", "mirror")
    assert "cross" in refused([*FIRST, across])
