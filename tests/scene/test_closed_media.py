"""Checks that media are closed: errors report the gap of an open boundary, and the media that do not fit."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from solen.curve import Arc, Bezier, Curve, Parabola, Segment, Spline
from solen.errors import DesignError
from solen.plane import Point, Rigid, along, heading
from solen.scene import Fan, Interface, Region, Scene
from solen.scene.closed_media import TOLERANCE_MM, check_closed
from tests.agreement.random_scene_support import Builder, add_circle, add_lens, add_polygon

SQUARE: list[Point] = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


def outline(corners: list[Point], inside: str = "glass", outside: str = "air", name: str = "side") -> list[Interface]:
    """Straight sides of a counter-clockwise body."""
    ends = pairwise([*corners, corners[0]])
    return [Interface(f"{name}-{i}", Segment(a, b), inside, outside) for i, (a, b) in enumerate(ends)]


def refused(interfaces: list[Interface]) -> str:
    with pytest.raises(DesignError) as refusal:
        check_closed(interfaces)
    line = str(refusal.value)
    assert len(line.splitlines()) == 1
    return line


def with_side(number: int, curve: Curve, left: str = "glass", right: str = "air") -> list[Interface]:
    """The square with one of its sides replaced."""
    sides = outline(SQUARE)
    sides[number] = Interface(sides[number].name, curve, left, right)
    return sides


def test_closed_body_passes_with_its_sides_in_either_direction() -> None:
    check_closed([])
    check_closed(outline(SQUARE))
    check_closed(with_side(1, Segment(SQUARE[2], SQUARE[1]), "air", "glass"))
    check_closed(outline(SQUARE)[::-1])


@pytest.mark.parametrize("gap_mm", [0.25, 1e-3, 1e-6, 1e-9, 1e-10])
def test_reports_size_position_and_neighbour_of_gap(gap_mm: float) -> None:
    line = refused(with_side(1, Segment((1.0, gap_mm), (1.0, 1.0))))
    assert "interface side-0; is not closed at its end" in line
    assert f"a gap of {gap_mm:.3g} mm at x = 1, z = 0 mm to the start of side-1" in line
    assert "glass and air" in line
    assert "join the ends" in line


@pytest.mark.parametrize("gap_mm", [1e-16, 1e-13, 1e-12, 1e-11])
def test_accepts_gaps_that_curves_bridge_beyond_their_ends(gap_mm: float) -> None:
    check_closed(with_side(1, Segment((1.0, gap_mm), (1.0, 1.0))))
    check_closed(with_side(1, Segment((1.0 + gap_mm, 0.0), (1.0, 1.0))))


def test_reports_missing_side_as_gap_of_its_neighbour() -> None:
    line = refused(outline([(0.0, 0.0), (1.0, 0.0), (1.0, 5.0), (0.0, 5.0)])[:3])
    assert "side-0; is not closed at its start: there is a gap of 5 mm at x = 0, z = 0 mm to the end of side-2" in line


def test_measures_gap_of_almost_closed_curve_to_its_other_end() -> None:
    line = refused([Interface("ring", Arc((0.0, 0.0), 2.0, 0.0, 350.0), "glass", "air")])
    gap_mm = 2 * 2.0 * math.sin(math.radians(5))
    assert f"not closed at its start: there is a gap of {gap_mm:.3g} mm at x = 2, z = 0 mm to the end of ring" in line


@pytest.mark.parametrize("short_mm", [1e-3, -1e-3])
def test_measures_gap_to_nearby_side(short_mm: float) -> None:
    line = refused([*outline(SQUARE), Interface("fin", Segment((0.3, 1.0 + short_mm), (0.3, 2.0)), "water", "air")])
    assert "interface fin; is not closed at its start: there is a gap of 0.001 mm at x = 0.3" in line
    assert "to the side of side-2" in line


@pytest.mark.parametrize("behaviour", ["refracting", "mirror", "absorbing"])
def test_single_curve_is_open_unless_both_sides_are_one_medium(behaviour: str) -> None:
    def alone(left: str) -> list[Interface]:
        return [Interface("alone", Segment((0.0, 0.0), (1.0, 0.0)), left, "air", behaviour)]  # type: ignore[arg-type]

    check_closed(alone("air"))
    assert "interface alone; is not closed at its start" in refused(alone("glass"))


@pytest.mark.parametrize(
    "end", [(0.5, 1.0), (1.0, 1.0), (0.2, 0.3), (5.0, 5.0)], ids=["on a side", "on a corner", "in another", "nowhere"]
)
def test_interface_within_one_medium_may_end_anywhere(end: Point) -> None:
    receiver = Interface("eye", Segment(end, (1.5, 2.0)), "air", "air", "receiver", "eye")
    check_closed([*outline(SQUARE), receiver])


def test_mirror_at_corner_must_be_in_its_own_medium() -> None:
    inwards = Interface("fin", Segment((1.0, 1.0), (0.6, 0.5)), "air", "air", "mirror")
    assert "between them, side-2 specifies glass and fin specifies air" in refused([*outline(SQUARE), inwards])
    check_closed([*outline(SQUARE), Interface("fin", inwards.curve, "glass", "glass", "mirror")])


@pytest.mark.parametrize(
    "circle",
    [
        Arc.circle((3.0, -200.0), 0.7),
        Arc.circle((3.0, -200.0), 0.7).reversed(),
        Arc((0.0, 0.0), 250.0, 77.7, 360.0),
        Arc((0.0, 0.0), 1e6, -13.0, -360.0),
        Spline.through([(0.0, 0.0), (1.0, 0.3), (1.5, 1.7), (-0.2, 1.0)], closed=True),
        Bezier((1.0, 1.0), (3.0, 1.5), (1.5, 3.0), (1.0, 1.0)),
    ],
)
def test_closed_curve_is_body(circle: Curve) -> None:
    check_closed([Interface("ball", circle, "glass", "air")])


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("turn_deg", [0.0, 140.0])
def test_closed_curve_may_have_corner_at_its_start(reverse: bool, turn_deg: float) -> None:
    """A drop of water that touches the square's corner with its tip, where it has two tangents."""
    tip = Bezier((1.0, 1.0), (3.0, 1.5), (1.5, 3.0), (1.0, 1.0))

    def scene(outside: str) -> list[Interface]:
        drop = Interface("drop", tip, "water", outside)
        if reverse:
            drop = Interface("drop", tip.reversed(), outside, "water")
        return moved([drop, *outline(SQUARE)], Rigid.about((0.0, 0.0), turn_deg))

    check_closed(scene("air"))
    assert "media do not fit" in refused(scene("glass"))


@pytest.mark.parametrize("number", range(4))
def test_reports_side_with_swapped_media_and_its_neighbour(number: int) -> None:
    side = outline(SQUARE)[number].curve
    for sides in (with_side(number, side, "air", "glass"), with_side(number, side.reversed())):
        line = refused(sides)
        assert f"side-{number}" in line.split(";", maxsplit=1)[0]
        assert "media do not fit at x = " in line
        assert (line.count("specifies glass"), line.count("specifies air")) == (1, 1)
        assert "swap the left and right regions" in line


def test_reports_both_media_of_side_with_wrong_medium() -> None:
    line = refused(with_side(2, Segment(SQUARE[2], SQUARE[3]), "water"))
    assert "interfaces side-2 and side-1; media do not fit at x = 1, z = 1 mm" in line
    assert "in the sector between them, side-2 specifies water and side-1 specifies glass" in line


def divided(*, whole_side: bool) -> list[Interface]:
    """A square of water below and oil above, its left side in one piece or in two."""
    left = [((0.0, 1.0), (0.0, 0.5), "oil"), ((0.0, 0.5), (0.0, 0.0), "water")]
    pieces = [((0.0, 1.0), (0.0, 0.0), "oil")] if whole_side else left
    rest = [
        ((0.0, 0.0), (1.0, 0.0), "water"),
        ((1.0, 0.0), (1.0, 0.5), "water"),
        ((1.0, 0.5), (1.0, 1.0), "oil"),
        ((1.0, 1.0), (0.0, 1.0), "oil"),
    ]
    sides = [Interface(f"side-{i}", Segment(a, b), inside, "air") for i, (a, b, inside) in enumerate([*pieces, *rest])]
    return [*sides, Interface("level", Segment((0.0, 0.5), (1.0, 0.5)), "oil", "water")]


def test_side_must_be_divided_where_three_media_meet() -> None:
    check_closed(divided(whole_side=False))
    line = refused(divided(whole_side=True)[1:] + divided(whole_side=True)[:1])
    assert "media do not fit at x = 0, z = " in line


def test_interface_that_ends_within_another_does_not_close_its_medium() -> None:
    """A curve has the same medium along all of each side, so the medium cannot change at a T-junction."""
    square = outline(SQUARE, "water")
    across = Interface("level", Segment((0.0, 0.5), (1.0, 0.5)), "oil", "water")
    line = refused([*square, across])
    assert "media do not fit at x = 0, z = 0.5 mm" in line
    assert "in the sector between them, level specifies oil and side-3 specifies water" in line
    assert "divide side-3 at this point" in line


def moved(interfaces: list[Interface], motion: Rigid) -> list[Interface]:
    return [Interface(i.name, i.curve.moved(motion), i.left, i.right, i.behaviour, i.receiver) for i in interfaces]


def wedge(name: str, up: float, outside: str) -> list[Interface]:
    """A triangle of glass with a corner at the origin, above or below it."""
    return outline([(0.0, 0.0), (0.3 * up, up), (-0.3 * up, up)], "glass", outside, name)


@pytest.mark.parametrize("turn_deg", [0.0, 33.0, 200.0])
@pytest.mark.parametrize("level", [Segment((-9.0, 0.0), (9.0, 0.0)), Arc((0.0, -30.0), 30.0, 110.0, -40.0)])
def test_bodies_may_touch_middle_of_side_from_both_sides(level: Curve, turn_deg: float) -> None:
    walls = pairwise([level.end, (20.0, -20.0), (-20.0, -20.0), level.start])
    pool = [level, *(Segment(a, b) for a, b in walls)]
    sea = [Interface(f"sea-{i}", curve, "air", "water") for i, curve in enumerate(pool)]
    turn = Rigid.about((3.0, 2.0), turn_deg)
    check_closed(moved([*sea, *wedge("boat", 1.0, "air"), *wedge("fish", -1.0, "water")], turn))
    line = refused(moved([*sea, *wedge("boat", 1.0, "water"), *wedge("fish", -1.0, "air")], turn))
    assert "media do not fit" in line
    assert "divide sea-0 at this point" in line


def test_bodies_may_be_nested_and_touch_at_corners() -> None:
    inner = outline([(0.2, 0.2), (0.8, 0.2), (0.8, 0.8)], "water", "glass", "inner")
    drop = Interface("drop", Arc.circle((0.7, 0.4), 0.05), "oil", "water")
    check_closed([*outline(SQUARE), *inner, drop])
    neighbour = outline([(1.0, 1.0), (2.0, 1.0), (2.0, 2.0)], "water", "air", "neighbour")
    check_closed([*outline(SQUARE), *neighbour])
    wrong = outline([(1.0, 1.0), (2.0, 1.0), (2.0, 2.0)], "water", "glass", "neighbour")
    assert "media do not fit at x = 1, z = 1 mm" in refused([*outline(SQUARE), *wrong])
    within = outline([(0.0, 0.0), (0.5, 0.2), (0.2, 0.5)], "water", "glass", "within")  # shares a corner
    check_closed([*outline(SQUARE), *within])


@pytest.mark.parametrize("ratio", [0.5, 0.999, -0.5, -3.0])
@pytest.mark.parametrize("turn_deg", [0.0, 90.0, 123.0])
@pytest.mark.parametrize("reverse", [False, True])
def test_distinguishes_touching_circles_by_curvature(ratio: float, turn_deg: float, reverse: bool) -> None:
    """All four branches leave along one line; the second circle is inside the first (ratio above 0) or outside it."""
    second = Arc((1.0 - ratio, 0.0), abs(ratio), 0.0 if ratio > 0 else 180.0, 360.0)
    turn = Rigid.about((-7.0, 2.0), turn_deg)

    def scene(around_second: str) -> list[Interface]:
        ball = Interface("ball", Arc.circle((0.0, 0.0), 1.0), "glass", "air")
        core = Interface("core", second, "core", around_second)
        if reverse:
            core = Interface("core", second.reversed(), around_second, "core")
        return moved([core, ball], turn)

    right, wrong = ("glass", "air") if ratio > 0 else ("air", "glass")
    check_closed(scene(right))
    assert "media do not fit" in refused(scene(wrong))


def pie(spokes: list[Curve]) -> list[Interface]:
    """Sectors of different media between spokes that leave the origin counter-clockwise; behind the last one is air."""
    media = [*(f"m{k}" for k in range(len(spokes) - 1)), "air"]
    parts = [Interface(f"spoke-{k}", curve, media[k], media[k - 1]) for k, curve in enumerate(spokes)]
    rims = [Segment(a.end, b.end) for a, b in pairwise(spokes)]
    return [*parts, *(Interface(f"rim-{k}", rim, media[k], "air") for k, rim in enumerate(rims))]


def straight(n: int) -> list[Curve]:
    return [Segment((0.0, 0.0), along((0.0, 0.0), heading(k * 270.0 / n), 2.0)) for k in range(n)]


def tangent(n: int) -> list[Curve]:
    """Curves that all leave upwards, from the one bent most to the right to the one bent most to the left."""
    return [Parabola((0.0, 0.0), (0.0, 1.0), 0.1 * (0.4 * n - k), 0.0, 3.0) for k in range(n)]


@pytest.mark.parametrize("spokes", [straight, tangent])
@pytest.mark.parametrize("n", [3, 4, 9])
@pytest.mark.parametrize("turn_deg", [0.0, 77.0, 180.0])
def test_any_number_of_media_may_meet_at_point(spokes: Callable[[int], list[Curve]], n: int, turn_deg: float) -> None:
    turn = Rigid.about((50.0, -20.0), turn_deg)
    sectors = moved(pie(spokes(n)), turn)
    shuffled = [sectors[k] for k in np.random.default_rng(n).permutation(len(sectors))]
    check_closed(shuffled)
    for k, i in enumerate(shuffled):
        reversed_curve = [*shuffled[:k], Interface(i.name, i.curve.reversed(), i.right, i.left), *shuffled[k + 1 :]]
        check_closed(reversed_curve)
        wrong = [*shuffled[:k], Interface(i.name, i.curve, i.right, i.left), *shuffled[k + 1 :]]
        assert "media do not fit" in refused(wrong)


def random_bodies(seed: int) -> list[Interface]:
    """A polygon with straight and curved sides, a circle and another polygon within, and a lens beside them."""
    build = Builder(np.random.default_rng(seed))
    inside = add_polygon(build, (0.0, 0.0), 5.0, "air")
    add_circle(build, (0.0, 0.0), 0.5, add_polygon(build, (0.0, 0.0), 2.0, inside))
    add_lens(build, (12.0, 0.0), 5.0, "air")
    return build.interfaces


def ends_on(i: Interface, other: Interface) -> bool:
    """Whether an end of one interface lies on the other, within twice the tolerance, measured along the normal."""
    normals = [(end, other.curve.normal_at(end)) for end in (i.curve.start, i.curve.end)]
    hits = [other.curve.hits(along(end, normal, -1.0), normal) for end, normal in normals]
    return any(abs(t - 1.0) <= 2.0 * TOLERANCE_MM for ts in hits for t in ts)


@settings(max_examples=60, deadline=None)
@example(seed=60, turn_deg=177.0, pivot=(0.0, 0.0), shift=(0.0, 0.0))
@given(
    seed=st.integers(0, 10**6),
    turn_deg=st.floats(-360, 360),
    pivot=st.tuples(st.floats(-500, 500), st.floats(-500, 500)),
    shift=st.tuples(st.floats(-500, 500), st.floats(-500, 500)),
)
def test_random_bodies_stay_closed_under_rigid_motions(seed: int, turn_deg: float, pivot: Point, shift: Point) -> None:
    bodies = moved(moved(random_bodies(seed), Rigid.about(pivot, turn_deg)), Rigid(shift=shift))
    check_closed(bodies)
    rng = np.random.default_rng(seed)
    k = int(rng.integers(len(bodies)))
    i = bodies[k]
    if isinstance(i.curve, Arc) and abs(i.curve.sweep_deg) == 360.0:
        return  # a closed circle is a body by itself
    others = [*bodies[:k], *bodies[k + 1 :]]
    assert "not closed at its" in refused(others)
    shift_mm = float(10.0 ** rng.uniform(-10, -2))
    nudge = Rigid(shift=along((0.0, 0.0), heading(float(rng.uniform(0, 360))), shift_mm))
    (displaced,) = moved([i], nudge)
    line = refused([*others, displaced])
    # a shift along the side or its neighbour may leave an end of one within the other
    touches = any(ends_on(displaced, other) or ends_on(other, displaced) for other in others)
    assert "a gap of" in line or ("divide" in line and touches)
    assert "media do not fit" in refused([*others, Interface(i.name, i.curve, i.right, i.left)])


def test_rounding_of_large_coordinates_is_not_gap() -> None:
    """A kilometre from the origin, coordinates are rounded to 1e-10 mm, but a gap of 1e-6 mm is still reported."""
    bodies = moved(random_bodies(3), Rigid(shift=(1e6, -1e6)))
    check_closed(bodies)
    assert "a gap of" in refused([*moved(bodies[:1], Rigid(shift=(1e-6, 1e-6))), *bodies[1:]])


@pytest.mark.parametrize("radius_mm", [1e2, 1e3, 1e4, 1e5])
def test_flat_arc_closes_within_its_rounding_error(radius_mm: float) -> None:
    a, b, sag = (-3.1, 0.2), (4.7, 0.2), 3.9**2 / (2 * radius_mm)
    top = Arc.through(b, (0.8, 0.2 + sag), a)
    check_closed([Interface("top", top, "glass", "air"), *outline([a, (0.0, -5.0), b], "glass", "air")[:2]])


def test_collinear_sides_are_sorted_into_order_that_fits() -> None:
    """The sides of two touching bodies coincide: the same line occurs twice between two vertices of three media."""
    lower, upper = outline(SQUARE, "glass", "air", "low"), outline([(0, 1), (1, 1), (1, 2), (0, 2)], "oil", "air", "up")
    touching = [*lower, *upper]
    check_closed(touching)
    check_closed(touching[::-1])


def test_scene_refuses_open_media_unless_allowed() -> None:
    regions, fan = (Region("air", 1.0), Region("glass", 1.5)), Fan((0.0, -1.0), 0.0, 60.0, 3)
    half_space = (Interface("face", Segment((-9.0, 0.0), (9.0, 0.0)), "glass", "air"),)
    with pytest.raises(
        DesignError, match="interface face; is not closed at its start: there is a gap of 18 mm at x = -9"
    ):
        Scene(regions, half_space, (fan,))
    assert Scene(regions, half_space, (fan,), open_media=True).open_media
