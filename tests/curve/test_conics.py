"""Conics in vertex form: agreement with circles and parabolas, foci, the omitted side and branch, and ends."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from solen.curve import Arc, Conic, Curve, Parabola
from solen.errors import DesignError
from solen.plane import Point, Rigid, along, cross, dot, heading, left_of, minus, right_of, unit
from solen.refraction import reflected

UP: Point = (0.0, 1.0)
KINDS = [-4.0, -1.5, -1.0, -0.6, -0.1, 0.0, 0.3, 2.0]
angle_deg = st.floats(-180, 180)
position = st.tuples(st.floats(-5, 5), st.floats(-5, 5))
fractions = st.tuples(st.floats(-0.99, 0.99), st.floats(-0.99, 0.99))


def opening(k: float, c: float = 0.5, fraction: float = 0.8) -> Conic:
    """Symmetric piece with its vertex at the origin, to a fraction of its half width or of its vertex radius."""
    half_width = Conic((0.0, 0.0), UP, c, k, 0.0, 1e-3).half_width_mm
    return Conic((0.0, 0.0), UP, c, k, -fraction * min(half_width, 1 / abs(c)), fraction * min(half_width, 1 / abs(c)))


def assert_same_hits(curve: Curve, other: Curve, origin: Point, direction: Point) -> None:
    """Both curves have the same hits, also for a ray that leaves them; rays that graze them are excluded."""
    hits = sorted(curve.hits(origin, direction))
    tilts = [abs(dot(curve.normal_at(along(origin, direction, t)), direction)) for t in hits]
    assume(all(tilt > 0.01 for tilt in tilts))
    near_end = [math.dist(along(origin, direction, t), end) for t in hits for end in (curve.start, curve.end)]
    assume(min(near_end, default=1.0) > 1e-9)
    assert hits == pytest.approx(sorted(other.hits(origin, direction)), abs=1e-12)
    for i, t in enumerate(hits):
        at = along(origin, direction, t)
        assert curve.normal_at(at) == pytest.approx(other.normal_at(at), abs=1e-13)
        later = curve.hits(at, direction, leaving=True)
        assert later == pytest.approx(other.hits(at, direction, leaving=True), abs=1e-12)
        assert later == pytest.approx([t_later - t for t_later in hits[i + 1 :]], abs=1e-11)


@settings(deadline=None)
@given(vertex=position, turn=angle_deg, radius=st.floats(0.5, 3), ends=fractions, through=position, towards=angle_deg)
def test_a_conic_constant_of_zero_makes_a_circle(
    vertex: Point, turn: float, radius: float, ends: tuple[float, float], through: Point, towards: float
) -> None:
    assume(abs(ends[0] - ends[1]) > 0.01)
    axis = heading(turn)
    conic = Conic(vertex, axis, 1 / radius, 0.0, ends[0] * radius, ends[1] * radius)
    from_deg, to_deg = (turn - 90.0 + math.degrees(math.asin(end)) for end in ends)
    arc = Arc(along(vertex, axis, radius), radius, from_deg, to_deg - from_deg)
    assert math.dist(conic.start, arc.start) < 1e-13
    assert math.dist(conic.end, arc.end) < 1e-13
    direction = heading(towards)
    aim = along(vertex, through, radius / 8)
    assert_same_hits(conic, arc, along(aim, direction, -10.0), direction)


@settings(deadline=None)
@given(vertex=position, turn=angle_deg, c=st.floats(-1, 1), ends=position, through=position, towards=angle_deg)
def test_a_conic_constant_of_minus_one_makes_a_parabola(
    vertex: Point, turn: float, c: float, ends: tuple[float, float], through: Point, towards: float
) -> None:
    assume(abs(ends[0] - ends[1]) > 0.01)
    axis = heading(turn)
    conic = Conic(vertex, axis, c, -1.0, *ends)
    parabola = Parabola(vertex, left_of(axis), c / 2, -ends[0], -ends[1])
    assert math.dist(conic.start, parabola.start) < 1e-13
    assert math.dist(conic.middle_point, parabola.middle_point) < 1e-13
    direction = heading(towards)
    assert_same_hits(conic, parabola, along(along(vertex, through, 0.4), direction, -10.0), direction)


@pytest.mark.parametrize("k", KINDS)
@pytest.mark.parametrize("c", [-2.0, 0.1, 1.0])
def test_points_satisfy_the_equation(k: float, c: float) -> None:
    r, w = opening(k, c).points(np.linspace(0.0, 1.0, 101)).T
    assert np.abs(c * r**2 - 2 * w + (1 + k) * c * w**2).max() < 1e-14
    assert np.all(1 - (1 + k) * c * w > 0)  # the vertex side


def focal(k: float, c: float) -> tuple[Point, Point]:
    """Foci from the vertex form: on the axis, or for an oblate ellipse on both sides of it."""
    if k > 0:
        focus_x = math.sqrt(1 / (1 + k) - 1 / (1 + k) ** 2) / c
        return (-focus_x, 1 / (c * (1 + k))), (focus_x, 1 / (c * (1 + k)))
    e = math.sqrt(-k)
    return (0.0, 1 / (c * (1 + e))), (0.0, 1 / (c * (1 - e)))


@pytest.mark.parametrize("k", [k for k in KINDS if k != -1.0])
def test_a_ray_from_one_focus_is_reflected_through_the_other(k: float) -> None:
    conic = opening(k)
    focus, other = focal(k, 0.5)
    for u in (0.05, 0.3, 0.5001, 0.8):
        x, z = conic.points(np.array([u]))[0]
        direction = unit(minus((float(x), float(z)), focus))
        (t,) = conic.hits(focus, direction)
        at = along(focus, direction, t)
        assert math.dist(at, (x, z)) < 1e-13
        back = reflected(direction, conic.normal_at(at))
        assert abs(cross(back, minus(other, at))) < 1e-12


def test_a_parabola_reflects_rays_from_its_focus_along_its_axis() -> None:
    conic = opening(-1.0)
    for towards in (130.0, 150.0, 200.0, 230.0):
        direction = heading(towards)
        (t,) = conic.hits((0.0, 1.0), direction)
        back = reflected(direction, conic.normal_at(along((0.0, 1.0), direction, t)))
        assert back == pytest.approx(UP, abs=1e-14)


@pytest.mark.parametrize("k", KINDS)
@pytest.mark.parametrize("turn", [0.0, 33.0, 180.0])
def test_the_omitted_side_and_branch_are_never_hit(k: float, turn: float) -> None:
    motion = Rigid.about((0.7, -0.3), turn)
    conic = opening(k).moved(motion)
    for x in np.linspace(-1.2, 1.2, 41):
        up, down = motion.vector(UP), motion.vector((0.0, -1.0))
        inside = abs(x) < abs(opening(k).to_mm)
        assert len(conic.hits(motion.point((float(x), -30.0)), up)) == (1 if inside else 0)
        assert len(conic.hits(motion.point((float(x), 30.0)), down)) == (1 if inside else 0)
        assert conic.hits(motion.point((float(x), -30.0)), down) == ()
        sag = float(opening(k).sag_mm(np.array(x))) if inside else 0.0
        start = motion.point((float(x), sag))
        if inside:
            assert conic.hits(start, up, leaving=True) == conic.hits(start, down, leaving=True) == ()


@pytest.mark.parametrize("k", KINDS)
@pytest.mark.parametrize("lean", [1e-2, 1e-4, 1e-6, 1e-9])
def test_short_chords_are_accurate(k: float, lean: float) -> None:
    conic = opening(k)
    at = (0.4, float(conic.sag_mm(np.array(0.4))))
    normal = conic.normal_at(at)
    direction = unit((right_of(normal)[0] + lean * normal[0], right_of(normal)[1] + lean * normal[1]))
    (t,) = conic.hits(at, direction, leaving=True)
    steep = math.sqrt(1 - (1 + k) * (0.5 * 0.4) ** 2)
    curvature = 0.5 / (steep**2 + (0.5 * 0.4) ** 2) ** 1.5
    assert t == pytest.approx(2 * lean / curvature, rel=2 * lean + 1e-15 / lean)


@pytest.mark.parametrize("distance_mm", [1e3, 1e5, 1e7])
@pytest.mark.parametrize("k", KINDS)
def test_distant_rays_hit_it(k: float, distance_mm: float) -> None:
    for x in (-0.9, -0.2, 0.0, 0.8):
        target = (x, float(opening(k).sag_mm(np.array(x))))
        for towards in (-20.0, 0.0, 40.0):
            origin = along(target, heading(towards), -distance_mm)
            hits = opening(k).hits(origin, heading(towards))
            assert min(abs(t - distance_mm) for t in hits) < 1e-14 * distance_mm  # rounding of the origin


@pytest.mark.parametrize("short_mm", [1e-1, 1e-3, 3e-6])
@pytest.mark.parametrize("k", [-0.5, 0.0, 1.0])
def test_a_conic_ends_at_its_ends_even_near_its_widest_point(k: float, short_mm: float) -> None:
    wide = opening(k).half_width_mm
    for conic in (
        Conic((0.0, 0.0), UP, 0.5, k, -0.5, wide - short_mm),
        Conic((0.0, 0.0), UP, 0.5, k, wide - short_mm, 0.5),
    ):
        depth = float(conic.sag_mm(np.array(wide - short_mm)))
        assert len(conic.hits((1.0, depth - 1e-10), (1.0, 0.0))) == 1
        assert conic.hits((1.0, depth + 1e-10), (1.0, 0.0)) == ()
        assert conic.hits((0.2, depth - 1e-10), (-1.0, 0.0)) == ()
        other = min(conic.from_mm, conic.to_mm)
        assert len(conic.hits((other + 1e-10, -1.0), UP)) == 1
        assert conic.hits((other - 1e-10, -1.0), UP) == ()


def test_rays_hit_an_off_axis_piece_only_between_its_ends() -> None:
    for low, high in ((0.2, 1.1), (-1.3, -0.4), (-1e-12, 1e-3), (-0.7, 0.9)):
        conic = Conic((0.0, 0.0), UP, 0.5, 0.2, low, high)
        for x in (low - 1e-9, low + 1e-10, 0.5 * (low + high), high - 1e-10, high + 1e-9):
            assert len(conic.hits((x, -1.0), UP)) == (1 if low < x < high else 0), x
            assert len(conic.reversed().hits((x, 5.0), (0.0, -1.0))) == (1 if low < x < high else 0), x


def test_a_ray_reflected_in_a_circle_of_conic_and_arc_stays_on_it() -> None:
    fraction = 0.999
    conic = Conic((0.0, -2.0), UP, 0.5, 0.0, -2 * fraction, 2 * fraction)
    from_deg = -math.degrees(math.acos(fraction))
    arc = Arc((0.0, 0.0), 2.0, from_deg, 180.0 - 2 * from_deg)
    curves: tuple[Curve, Curve] = (conic, arc)
    at, direction, last = (0.0, -2.0), heading(37.7), 0
    for _ in range(3000):
        t, last = min((t, i) for i, curve in enumerate(curves) for t in curve.hits(at, direction, leaving=i == last))
        assert t == pytest.approx(4 * math.cos(math.radians(37.7)), abs=1e-9)
        at = along(at, direction, t)
        direction = reflected(direction, curves[last].normal_at(at))
        assert abs(math.hypot(*at) - 2.0) < 1e-11


def test_a_conic_without_curvature_is_straight() -> None:
    conic = Conic((0.0, 1.0), UP, 0.0, -3.0, -1.0, 2.0)
    assert conic.hits((0.5, -1.0), UP) == (2.0,)
    assert conic.hits((2.5, -1.0), UP) == ()
    assert conic.hits((0.5, 1.0), heading(80.0), leaving=True) == ()
    assert conic.half_width_mm == math.inf


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"to_mm": 2.0}, "conic to_mm = 2.0; must be within 1.999999 mm of the axis; end the conic nearer"),
        ({"from_mm": -3.0}, "conic from_mm = -3.0; must be within 1.999999 mm of the axis"),
        ({"to_mm": -1.0}, "conic from_mm and to_mm = -1.0; must differ"),
        ({"curvature_per_mm": math.nan}, "must be a finite number"),
        ({"conic_constant": "0"}, "must be a finite number"),
        ({"axis": (0.0, 2.0)}, "conic axis = (0.0, 2.0); must be a unit vector"),
        ({"vertex": (0.0,)}, "must be a pair (x, z)"),
    ],
)
def test_refuses_an_invalid_conic_in_one_line(change: dict[str, object], message: str) -> None:
    fields: dict[str, object] = {"vertex": (0.0, 0.0), "axis": UP, "curvature_per_mm": 0.5, "conic_constant": 0.0}
    with pytest.raises(DesignError) as refusal:
        Conic(**(fields | {"from_mm": -1.0, "to_mm": 1.5} | change))  # type: ignore[arg-type]  # wrong on purpose
    assert message in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1
