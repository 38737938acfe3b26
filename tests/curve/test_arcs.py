"""Arcs: through three points, full circles, and more than half a circle."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from solen.curve import Arc
from solen.errors import DesignError
from solen.plane import Point, along, cross, heading, minus
from solen.refraction import reflected

position = st.tuples(st.floats(-10, 10), st.floats(-10, 10))


@given(a=position, middle=position, b=position)
def test_an_arc_through_three_points_visits_them_in_order(a: Point, middle: Point, b: Point) -> None:
    assume(min(math.dist(a, b), math.dist(a, middle), math.dist(middle, b)) > 0.1)
    assume(abs(cross(minus(middle, a), minus(b, a))) > 0.1)
    arc = Arc.through(a, middle, b)
    size = 1e-13 * (10 + arc.radius_mm)
    assert math.dist(arc.start, a) < 10 * size
    assert math.dist(arc.end, b) < 10 * size
    assert math.dist(arc.center, middle) == pytest.approx(arc.radius_mm, abs=10 * size)
    assert (arc.sweep_deg > 0) == (cross(minus(middle, a), minus(b, middle)) > 0)
    towards_middle = minus(middle, arc.center)
    along_arc = math.cos(math.radians(abs(arc.sweep_deg)) / 2) * arc.radius_mm
    reach = towards_middle[0] * arc.middle[0] + towards_middle[1] * arc.middle[1]
    assert reach > along_arc - 1e-9  # the middle lies on this arc, not on its complement


@pytest.mark.parametrize("third", [(2.0, 2.0), (0.0, 0.0), (1.0, 1.0), (-3.0, -3.0)])
def test_refuses_an_arc_through_collinear_points(third: Point) -> None:
    with pytest.raises(DesignError, match="one line"):
        Arc.through((0.0, 0.0), (1.0, 1.0), third)


@given(towards=st.floats(-180, 180), x=st.floats(-0.9, 0.9))
def test_rays_from_all_directions_hit_a_circle_twice(towards: float, x: float) -> None:
    direction = heading(towards)
    origin = (x * direction[1] - 5 * direction[0], -x * direction[0] - 5 * direction[1])  # x mm beside the centre
    half = math.sqrt(1 - x * x)
    for circle in (Arc.circle((0.0, 0.0), 1.0), Arc.circle((0.0, 0.0), 1.0).reversed()):
        assert sorted(circle.hits(origin, direction)) == pytest.approx([5 - half, 5 + half], abs=1e-12)


def test_the_inside_of_a_circle_is_on_its_left() -> None:
    assert Arc.circle((1.0, 1.0), 2.0).normal_at((3.0, 1.0)) == (-1.0, 0.0)
    assert Arc.circle((1.0, 1.0), 2.0).reversed().normal_at((3.0, 1.0)) == (1.0, 0.0)


@pytest.mark.parametrize("sweep_deg", [270.0, -270.0, 181.0, 359.0])
def test_an_arc_above_half_a_circle_has_its_gap_beyond_its_ends(sweep_deg: float) -> None:
    arc = Arc((0.0, 0.0), 1.0, 10.0, sweep_deg)
    sign = math.copysign(1.0, sweep_deg)
    for turn_deg in np.arange(0.5, 360.0, 1.7):
        polar = math.radians(10.0 + sign * turn_deg)
        hits = arc.hits((0.0, 0.0), (math.cos(polar), math.sin(polar)))
        expected = (1.0,) if turn_deg < abs(sweep_deg) else ()
        assert hits == pytest.approx(expected, abs=1e-15), turn_deg


def largest_deviation(circle: Arc, angle_deg: float, chords: int) -> float:
    """Largest distance from the circle of a ray that is reflected inside it ``chords`` times."""
    at, direction = (circle.center[0] + circle.radius_mm, circle.center[1]), heading(angle_deg)
    worst = 0.0
    for _ in range(chords):
        (t,) = circle.hits(at, direction, leaving=True)
        assert t == pytest.approx(2 * circle.radius_mm * math.sin(math.radians(angle_deg)), abs=1e-9)
        at = along(at, direction, t)
        direction = reflected(direction, circle.normal_at(at))
        worst = max(worst, abs(math.dist(at, circle.center) - circle.radius_mm))
    return worst


@pytest.mark.parametrize("angle_deg", [0.5, 10.0, 60.0, 89.9])
def test_a_ray_reflected_in_a_circle_follows_equal_chords(angle_deg: float) -> None:
    assert largest_deviation(Arc.circle((0.3, 0.7), 2.0), angle_deg, 100) < 1e-11


def test_a_ray_reflected_in_a_circle_stays_on_it() -> None:
    assert largest_deviation(Arc.circle((0.0, 0.0), 1.0), 60.0, 5000) < 1e-11


@pytest.mark.parametrize("bulge_mm", [1e-3, 1e-4, 1e-5, 2.1e-6])
def test_a_nearly_flat_arc_keeps_its_ends(bulge_mm: float) -> None:
    arc = Arc.through((0.0, 0.0), (1.0, bulge_mm), (2.0, 0.0))
    assert math.dist(arc.end, (2.0, 0.0)) < 1e-9
    assert len(arc.hits((1.999999, -1.0), (0.0, 1.0))) == 1
    assert arc.hits((2.000001, -1.0), (0.0, 1.0)) == ()


@pytest.mark.parametrize("bulge_mm", [1e-6, 1e-7, 1e-8, 0.0, -1e-6])
def test_refuses_an_arc_too_flat_to_locate_its_centre(bulge_mm: float) -> None:
    with pytest.raises(DesignError, match=r"on one line; use a segment") as refusal:
        Arc.through((0.0, 0.0), (1.0, bulge_mm), (2.0, 0.0))
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize("distance_mm", [1e2, 1e4, 1e6])
@pytest.mark.parametrize("order", [(0, 1, 2), (0, 2, 1), (1, 0, 2)])
def test_a_flat_arc_with_a_distant_point_is_refused_or_keeps_its_ends(
    distance_mm: float, order: tuple[int, ...]
) -> None:
    points: list[Point] = [(0.0, 0.0), (distance_mm, 0.5), (1.0, 0.0)]
    a, middle, b = (points[i] for i in order)
    try:
        arc = Arc.through(a, middle, b)
    except DesignError:
        return
    for point in (a, middle, b):
        assert math.dist(arc.center, point) == pytest.approx(arc.radius_mm, abs=1e-8)
    assert math.dist(arc.start, a) < 1e-8
    assert math.dist(arc.end, b) < 1e-8


@pytest.mark.parametrize("sweep_deg", [0.001, 359.999])
def test_an_arc_reaches_no_further_than_the_end_tolerance(sweep_deg: float) -> None:
    assert Arc((0.0, 0.0), 1.0, 0.0, sweep_deg).hits((0.5, -1e-8), (1.0, 0.0)) == ()
