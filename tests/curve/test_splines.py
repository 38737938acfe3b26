"""Cubics and their chains: agreement with other curves, polynomial roots, joints, and rays that must stay inside."""

import math
import random
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from solen.arrays import FloatArray
from solen.curve import Arc, Bezier, Conic, Curve, Parabola, Segment, Spline, simple_pieces
from solen.errors import DesignError
from solen.plane import Point, Rigid, along, cross, dot, heading, left_of, minus, right_of, unit
from solen.refraction import reflected

Control = tuple[Point, Point, Point, Point]

position = st.tuples(st.floats(-5, 5), st.floats(-5, 5))
angle_deg = st.floats(-180, 180)
ARCH: Control = ((-2.0, 0.0), (-1.0, 2.0), (1.0, 2.0), (2.0, 0.0))
LOOP: Control = ((0.0, 0.0), (4.0, 3.0), (-3.0, 3.0), (1.0, 0.0))
WAVE: Control = ((0.0, 0.0), (1.0, 3.0), (2.0, -3.0), (3.0, 0.0))
CUSP: Control = ((0.0, 0.0), (1.0, 1.0), (0.0, 1.0), (1.0, 0.0))


def nearly_cusp(excess: float) -> Control:
    return ((0.0, 0.0), (1.0 + excess, 1.0), (0.0, 1.0), (1.0, 0.0))


def point_at(curve: Curve, u: float) -> Point:
    x, z = curve.points(np.array([u]))[0]
    return (float(x), float(z))


def leaning(curve: Curve, at: Point, lean: float) -> Point:
    """Direction along the curve, rotated to its left by an angle with the tangent ``lean``."""
    normal = curve.normal_at(at)
    return unit((right_of(normal)[0] + lean * normal[0], right_of(normal)[1] + lean * normal[1]))


def outline(seed: float, corners: int = 12, amplitude_mm: float = 0.8) -> Spline:
    """Smooth closed outline around the origin, with its inside on the left."""
    rng = random.Random(seed)  # noqa: S311  shapes, not secrets
    radii = [3.0 + rng.uniform(-amplitude_mm, amplitude_mm) for _ in range(corners)]
    return Spline.through(
        [along((0.0, 0.0), heading(360.0 * i / corners), r) for i, r in enumerate(radii)], closed=True
    )


def parabola_as_cubic(low: float, high: float, c: float = 0.3) -> Bezier:
    """The parabola z = c x² between two x, as a cubic."""
    middle = (0.5 * (low + high), c * low * high)
    a, b = (low, c * low**2), (high, c * high**2)
    third = [((end[0] + 2 * middle[0]) / 3, (end[1] + 2 * middle[1]) / 3) for end in (a, b)]
    return Bezier(a, third[0], third[1], b)


# --- construction -----------------------------------------------------------------------------------------------------


@given(points=st.lists(position, min_size=2, max_size=12), closed=st.booleans())
def test_a_spline_through_points_is_natural_or_periodic(points: list[Point], closed: bool) -> None:
    assume(len(points) > 2 or not closed)
    polygon = [*points, points[0]] if closed else points
    chords = [math.dist(a, b) for a, b in pairwise(polygon)]
    assume(min(chords) > 0.05)
    try:
        spline = Spline.through(points, closed=closed)
    except DesignError:
        assume(False)
    knots = np.concatenate([[0.0], np.cumsum(chords)])
    expected = CubicSpline(knots, polygon, bc_type="periodic" if closed else "natural")
    u = np.linspace(0.0, 1.0, 101)
    position_in_chords = u * len(chords)
    index = np.minimum(position_in_chords.astype(int), len(chords) - 1)
    at = knots[index] + (position_in_chords - index) * np.asarray(chords)[index]
    assert np.abs(spline.points(u) - expected(at)).max() < 1e-11
    assert (spline.start == spline.end) == (closed or points[0] == points[-1])


def test_a_spline_passes_exactly_through_many_points() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 5000, endpoint=False)
    points = np.column_stack([2 * np.cos(angle), np.sin(angle)])
    spline = Spline.through(points, closed=True)
    assert np.array_equal(np.array(spline.control_points[:-1:3]), points)
    assert len(spline.pieces) == 5000


def test_a_spline_through_collinear_points_is_straight() -> None:
    spline = Spline.through([(0.0, 0.0), (1.0, 2.0), (1.5, 3.0), (4.0, 8.0)])
    assert spline.hits((1.0, 0.0), (0.0, 1.0)) == pytest.approx((2.0,), abs=1e-15)
    assert spline.flattened().tolist() == [[0.0, 0.0], [1.0, 2.0], [1.5, 3.0], [4.0, 8.0]]


REFUSED: list[tuple[Control, str]] = [
    (((0.0, 0.0),) * 4, "x = 0 mm, z = 0 mm"),
    (((0.0, 0.0), (0.0, 0.0), (1.0, 1.0), (2.0, 0.0)), "x = 0 mm, z = 0 mm"),
    (((0.0, 0.0), (1.0, 1.0), (2.0, 0.0), (2.0, 0.0)), "x = 2"),
    (CUSP, "x = 0.5 mm, z = 0.75 mm"),
    (((0.0, 0.0), (2.0, 0.0), (-1.0, 0.0), (1.0, 0.0)), "must not have"),
    (nearly_cusp(1e-9), "x = 0.5 mm, z = 0.75 mm"),
]


@pytest.mark.parametrize(("control", "message"), REFUSED)
def test_refuses_a_degenerate_cubic_in_one_line(control: Control, message: str) -> None:
    for make in (lambda: Bezier(*control), lambda: Spline(((-1.0, -2.0), (-1.0, -1.0), (-0.5, -1.0), *control))):
        with pytest.raises(DesignError, match="a cusp") as refusal:
            make()
        assert message in str(refusal.value)
        assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("points", "closed", "message"),
    [
        ([(0.0, 0.0)], False, "spline points = 1; must be at least 2 points"),
        ([(0.0, 0.0), (1.0, 1.0)], True, "spline points = 2; must be at least 3 points"),
        (
            [(0.0, 0.0), (1.0, 1.0), (1.0, 1.0), (2.0, 0.0)],
            False,
            "spline points = (1.0, 1.0); must differ from its neighbour",
        ),
        ([(0.0, 0.0), (1.0, 1.0), (2.0, 0.0), (0.0, 0.0)], True, "does not repeat its first point"),
        ([(0.0, 0.0), (1.0, math.nan)], False, "pairs (x, z) of finite numbers"),
        ([(0.0, 0.0), (1.0, 2.0, 3.0)], False, "pairs (x, z) of finite numbers"),
        ("straight", False, "pairs (x, z) of finite numbers"),
    ],
)
def test_refuses_unsuitable_points_in_one_line(points: list[Point], closed: bool, message: str) -> None:
    with pytest.raises(DesignError) as refusal:
        Spline.through(points, closed=closed)
    assert message in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize("count", [0, 1, 2, 3, 5, 6, 8])
def test_refuses_a_wrong_number_of_control_points(count: int) -> None:
    with pytest.raises(DesignError, match=rf"spline control_points = {count}; must be 3 N \+ 1 points"):
        Spline(tuple((float(i), float(i * i)) for i in range(count)))


def test_refuses_invalid_control_points() -> None:
    with pytest.raises(DesignError, match="finite number"):
        Bezier((0.0, 0.0), (1.0, math.inf), (2.0, 0.0), (3.0, 0.0))
    with pytest.raises(DesignError, match="must be a pair"):
        Spline(((0.0, 0.0), (1.0,), (2.0, 0.0), (3.0, 0.0)))  # type: ignore[arg-type]  # wrong on purpose
    with pytest.raises(DesignError, match="must be a tuple"):
        Spline([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (3.0, 0.0)])  # type: ignore[arg-type]  # wrong on purpose


# --- simple pieces ----------------------------------------------------------------------------------------------------


def turn_angles(control: Control) -> list[float]:
    """Angles in degrees by which the tangent turns, over 200 steps."""
    u = np.linspace(0.0, 1.0, 201)[:, None]
    a, b, c, d = np.asarray(control)
    tangent = (1 - u) ** 2 * (b - a) + 2 * u * (1 - u) * (c - b) + u**2 * (d - c)
    angle = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    return [float(turn) for turn in np.degrees(np.diff(angle))]


def check_simple(control: Control) -> int:
    pieces = simple_pieces(control)
    assert pieces[0].control[0] == control[0]
    assert pieces[-1].control[3] == control[3]
    assert (pieces[0].u_from, pieces[-1].u_to) == (0.0, 1.0)
    size = max(math.dist(a, b) for a in control for b in control) + max(abs(x) for point in control for x in point)
    for before, after in pairwise(pieces):
        assert before.control[3] == after.control[0]
        assert before.u_to == after.u_from
    for piece in pieces:
        turns = turn_angles(piece.control)
        assert abs(sum(turns)) < 60.0
        assert min(turns) > -1e-6 or max(turns) < 1e-6  # apart from the rounding errors of short pieces
        v = np.linspace(0.0, 1.0, 7)
        u = piece.u_from + v * (piece.u_to - piece.u_from)
        assert np.abs(Bezier(*control).points(u) - Bezier(*piece.control).points(v)).max() < 2e-15 * size
    return len(pieces)


@pytest.mark.parametrize(
    ("control", "count"),
    [
        (((0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (3.0, 0.0)), 1),
        (((0.0, 0.0), (1.0, 0.1), (2.0, 0.1), (3.0, 0.0)), 1),
        (((0.0, 0.0), (1.0, 0.1), (2.0, -0.1), (3.0, 0.0)), 2),
        (ARCH, 4),
        (WAVE, 8),
        (LOOP, 8),
        (nearly_cusp(1e-4), 8),
        (nearly_cusp(-1e-6), 8),
    ],
)
def test_a_cubic_is_split_into_few_pieces(control: Control, count: int) -> None:
    assert check_simple(control) <= count


@given(a=position, b=position, c=position, d=position)
def test_simple_pieces_cover_the_cubic_and_are_simple(a: Point, b: Point, c: Point, d: Point) -> None:
    assume(math.dist(a, b) > 0.01 and math.dist(c, d) > 0.01)
    try:
        Bezier(a, b, c, d)
    except DesignError:
        assume(False)
    assert check_simple((a, b, c, d)) <= 40


def test_pieces_of_a_spline_have_its_parameters() -> None:
    spline = outline(3.0, 5)
    assert [piece.u_from for piece in spline.pieces][1:] == [piece.u_to for piece in spline.pieces][:-1]
    for piece in spline.pieces:
        for v in (0.0, 0.3, 1.0):
            u = piece.u_from + v * (piece.u_to - piece.u_from)
            assert math.dist(point_at(Bezier(*piece.control), v), point_at(spline, u)) < 1e-14


# --- agreement with other curves --------------------------------------------------------------------------------------


@given(
    a=position,
    b=position,
    fractions=st.tuples(st.floats(0.05, 0.6), st.floats(0.05, 0.6)),
    target=position,
    towards=angle_deg,
)
def test_a_straight_cubic_is_a_segment(
    a: Point, b: Point, fractions: tuple[float, float], target: Point, towards: float
) -> None:
    assume(math.dist(a, b) > 0.5)
    segment, direction = Segment(a, b), heading(towards)
    bezier = Bezier(a, along(a, minus(b, a), fractions[0]), along(b, minus(a, b), fractions[1]), b)
    tilt = abs(dot(segment.normal_at(a), direction))
    assume(tilt > 0.01)
    origin = along(target, direction, -12.0)
    hits = segment.hits(origin, direction)
    assert bezier.hits(origin, direction) == pytest.approx(hits, abs=1e-14 / tilt)
    for t in hits:
        assert bezier.hits(along(origin, direction, t), direction, leaving=True) == ()
        assert bezier.normal_at(along(origin, direction, t)) == pytest.approx(segment.normal_at(a), abs=1e-9)


@settings(deadline=None)
@given(ends=st.tuples(st.floats(-3, 3), st.floats(-3, 3)), target=position, towards=angle_deg)
def test_a_degree_elevated_parabola_is_a_parabola(ends: tuple[float, float], target: Point, towards: float) -> None:
    assume(abs(ends[0] - ends[1]) > 0.01)
    parabola, bezier = Parabola((0.0, 0.0), (-1.0, 0.0), 0.3, -ends[0], -ends[1]), parabola_as_cubic(*ends)
    direction = heading(towards)
    origin = along(target, direction, -12.0)
    hits, bezier_hits = sorted(parabola.hits(origin, direction)), sorted(bezier.hits(origin, direction))
    for t in hits + bezier_hits:
        at = along(origin, direction, t)
        assume(min(math.dist(at, bezier.start), math.dist(at, bezier.end)) > 1e-9)
        assume(abs(dot(parabola.normal_at(at), direction)) > 0.01)
    assert bezier_hits == pytest.approx(hits, abs=1e-11)
    for i, t in enumerate(hits):
        at = along(origin, direction, t)
        assert bezier.normal_at(at) == pytest.approx(parabola.normal_at(at), abs=1e-11)
        left = [later - t for later in hits[i + 1 :]]
        assert bezier.hits(at, direction, leaving=True) == pytest.approx(left, abs=1e-11)


def test_four_cubics_approximate_a_circle_to_the_known_error() -> None:
    k = 4 / 3 * (math.sqrt(2) - 1)
    quarter: list[Point] = [(1.0, 0.0), (1.0, k), (k, 1.0)]
    turned = [Rigid.about((0.0, 0.0), 90.0 * i).point(point) for i in range(4) for point in quarter]
    spline = Spline((*turned, turned[0]))
    radius = np.hypot(*spline.points(np.linspace(0.0, 1.0, 2001)).T)
    assert radius.max() == pytest.approx(1.00027253, abs=1e-8)
    assert radius.min() == pytest.approx(1.0, abs=1e-15)
    circle = Arc.circle((0.0, 0.0), 1.0)
    for towards in range(0, 360, 7):
        for x in (-0.8, 0.1, 0.7):
            direction = heading(towards)
            origin = along(along((0.0, 0.0), left_of(direction), x), direction, -4.0)
            expected = sorted(circle.hits(origin, direction))
            assert sorted(spline.hits(origin, direction)) == pytest.approx(expected, abs=6e-4)


def test_a_fine_spline_of_a_conic_has_the_hits_of_the_conic() -> None:
    conic = Conic((0.0, 0.0), (0.0, 1.0), 0.5, -2.0, -2.0, 2.0)
    spline = Spline.through(conic.points(np.linspace(0.0, 1.0, 401)))
    for towards in (-60.0, -20.0, 0.0, 45.0):
        origin = along((0.1, 0.3), heading(towards), -5.0)
        hits = [t for t in conic.hits(origin, heading(towards)) if abs(along(origin, heading(towards), t)[0]) < 1.8]
        spline_hits = spline.hits(origin, heading(towards))
        assert len(spline_hits) >= len(hits) > 0
        for t in hits:
            assert min(abs(t - other) for other in spline_hits) < 1e-8  # a natural spline has no curvature at its ends


@settings(deadline=None)
@given(seed=st.integers(0, 999), closed=st.booleans(), target=position, towards=angle_deg)
def test_a_spline_has_the_hits_of_its_cubics(seed: int, closed: bool, target: Point, towards: float) -> None:
    whole = outline(seed, 7)
    spline = whole if closed else Spline(whole.control_points[:-3])
    direction = heading(towards)
    origin = along(target, direction, -15.0)
    hits = sorted(spline.hits(origin, direction))
    for t in hits:
        at = along(origin, direction, t)
        assume(min(math.dist(at, joint) for joint in spline.control_points[::3]) > 1e-9)
    single = [t for control in spline.controls for t in Bezier(*control).hits(origin, direction)]
    assert hits == pytest.approx(sorted(single), abs=1e-12)


# --- polynomial roots -------------------------------------------------------------------------------------------------


def polynomial(control: Control, origin: Point, direction: Point) -> FloatArray:
    """Distance of the point at u from the ray's line, as coefficients of powers of u."""
    a, b, c, d = (cross(direction, minus(point, origin)) for point in control)
    return np.array([d - 3 * c + 3 * b - a, 3 * (c - 2 * b + a), 3 * (b - a), a])


@settings(deadline=None, max_examples=300)
@given(a=position, b=position, c=position, d=position, u=st.floats(0, 1), offset=st.floats(-2, 2), towards=angle_deg)
def test_hits_are_the_roots_of_the_polynomial(
    a: Point, b: Point, c: Point, d: Point, u: float, offset: float, towards: float
) -> None:
    try:
        bezier = Bezier(a, b, c, d)
    except DesignError:
        assume(False)
    direction = heading(towards)
    origin = along(along(point_at(bezier, u), left_of(direction), offset), direction, -30.0)
    power = polynomial((a, b, c, d), origin, direction)
    assume(abs(power[0]) > 1e-6)
    roots = np.roots(power)
    near = roots[(np.abs(roots.imag) < 1e-4) & (roots.real > -1e-6) & (roots.real < 1 + 1e-6)]
    assume(np.all(near.imag == 0) and np.all((near.real > 1e-6) & (near.real < 1 - 1e-6)))
    assume(np.all(np.abs(np.polyval(np.polyder(power), near.real)) > 1e-3))
    expected = sorted(dot(direction, minus(point_at(bezier, float(root)), origin)) for root in near.real)
    hits = sorted(bezier.hits(origin, direction))
    assert hits == pytest.approx(expected, abs=1e-10)
    for i, t in enumerate(hits):
        at = along(origin, direction, t)
        assume(all(math.dist(at, along(origin, direction, other)) > 1e-6 for other in hits[:i] + hits[i + 1 :]))
        left = sorted(bezier.hits(at, direction, leaving=True))
        assert left == pytest.approx([later - t for later in hits[i + 1 :]], abs=1e-10)


@pytest.mark.parametrize("excess", [1e-2, 1e-4, -1e-2, -1e-4])
def test_both_branches_next_to_a_near_cusp_are_hit(excess: float) -> None:
    bezier = Bezier(*nearly_cusp(excess))
    for below in (1e-1, 1e-2, 1e-3):
        origin = (-3.0, 0.75 - below)
        roots = np.roots(polynomial(nearly_cusp(excess), origin, (1.0, 0.0)))
        expected = sorted(point_at(bezier, float(u))[0] + 3.0 for u in roots[np.isreal(roots)].real if 0 <= u <= 1)
        assert sorted(bezier.hits(origin, (1.0, 0.0))) == pytest.approx(expected, abs=1e-9)
        assert len(expected) == 2


# --- joints and ends --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_a_ray_through_a_joint_hits_it_once(seed: int) -> None:
    spline = outline(seed, 9)
    for turn in (0.0, 12.3, 90.0):
        motion = Rigid.about((0.4, 0.2), turn)
        moved = spline.moved(motion)
        for piece in moved.pieces:
            joint = piece.control[0]
            direction = unit(minus(joint, motion.shift))
            (t,) = moved.hits(motion.shift, direction)
            assert along(motion.shift, direction, t) == pytest.approx(joint, abs=1e-13)
            assert len(moved.hits(along(joint, direction, -20.0), direction)) == 2


def test_a_crossed_joint_is_hit_once_and_a_touched_one_never() -> None:
    square: tuple[Point, ...] = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0), (1.0, 0.0))
    points = [square[0]]
    for a, b in pairwise(square):
        points += [along(a, minus(b, a), 1 / 3), along(b, minus(a, b), 1 / 3), b]
    for diamond in (Spline(tuple(points)), Spline(tuple(points)).reversed()):
        assert sorted(diamond.hits((-3.0, 0.0), (1.0, 0.0))) == [2.0, 4.0]
        assert sorted(diamond.hits((0.0, 5.0), (0.0, -1.0))) == [4.0, 6.0]
        assert diamond.hits((-3.0, 1.0), (1.0, 0.0)) == ()
        assert diamond.hits((1.0, -3.0), (0.0, 1.0)) == ()
        assert len(diamond.hits((-3.0, 1.0 - 1e-12), (1.0, 0.0))) == 2
    arches = Spline((*ARCH[:1], (-1.5, 0.8), (-0.75, 1.0), (0.0, 1.0), (0.75, 1.0), (1.5, 0.8), ARCH[3]))
    for curve in (arches, arches.reversed(), arches.moved(Rigid(-1.0, 0.0, (0.0, 2.0)))):
        assert curve.hits((-3.0, 1.0), (1.0, 0.0)) == ()
    assert len(arches.hits((-3.0, 1.0 - 1e-12), (1.0, 0.0))) == 2
    assert arches.hits((-3.0, 1.0 + 1e-12), (1.0, 0.0)) == ()


def test_a_chain_extends_by_the_end_tolerance_only() -> None:
    for curve in (Bezier(*ARCH), Spline.through([(-2.0, 0.0), (-1.0, 1.2), (1.0, 1.5), (2.0, 0.0)])):
        for x in (-2.0, 2.0):
            outwards = math.copysign(1.0, x)
            assert len(curve.hits((x - outwards * 1e-8, 3.0), (0.0, -1.0))) == 1
            assert len(curve.hits((x + outwards * 1e-12, 3.0), (0.0, -1.0))) == 1
            assert curve.hits((x + outwards * 1e-10, 3.0), (0.0, -1.0)) == ()
            assert curve.hits((x, 0.0), (-outwards, 0.0), leaving=True) == pytest.approx([4.0], abs=1e-13)
            assert curve.hits((x, 0.0), (0.0, 1.0), leaving=True) == ()


def test_no_ray_slips_between_two_curves_with_a_common_corner() -> None:
    left, right = (
        Bezier((-2.0, 1.0), (-1.0, 0.7), (-0.5, 0.2), (0.0, 0.0)),
        Bezier(*ARCH).moved(Rigid(shift=(2.0, 0.0))),
    )
    rng = random.Random(1)  # noqa: S311  rays, not secrets
    for _ in range(300):
        direction = heading(rng.uniform(-60, 60))
        origin = along((rng.uniform(-1e-13, 1e-13), 0.0), direction, -rng.uniform(0.5, 3))
        assert left.hits(origin, direction) or right.hits(origin, direction)


@pytest.mark.parametrize("lean", [1e-2, 1e-4, 1e-6, 1e-8, 1e-9])
@pytest.mark.parametrize("offset", [0.0, 1e-15, -1e-12, 1e-9, -1e-7, 1e-5, -1e-3])
def test_short_chords_even_across_a_joint_agree_with_the_curvature(lean: float, offset: float) -> None:
    ellipse = [(3.0 * math.cos(a), 2.0 * math.sin(a)) for a in np.linspace(0.0, 2 * math.pi, 60, endpoint=False)]
    spline = Spline.through(ellipse, closed=True)
    for piece in spline.pieces[::7]:
        at = point_at(spline, (piece.u_from + offset) % 1.0)
        a = math.atan2(at[1] / 2.0, at[0] / 3.0)
        curvature = 6.0 / ((3.0 * math.sin(a)) ** 2 + (2.0 * math.cos(a)) ** 2) ** 1.5
        for sign in (1.0, -1.0):
            inwards = leaning(spline, at, sign * lean)
            direction = (sign * inwards[0], sign * inwards[1])
            chord = min(spline.hits(at, direction, leaving=True))
            # 1e-2: error of the spline's curvature; the rest is the rounding of its points at such a small angle
            assert chord == pytest.approx(2 * lean / curvature, rel=0.01 + 2 * lean + 1e-13 / lean)


@pytest.mark.parametrize("lean", [1e-1, 1e-3, 1e-5, 1e-7, 1e-9])
@pytest.mark.parametrize("u", [0.0, 0.013, 0.4, 0.99, 1.0])
def test_short_chords_of_a_degree_elevated_parabola_are_accurate(u: float, lean: float) -> None:
    parabola, bezier = Parabola((0.0, 0.0), (-1.0, 0.0), 0.3, 2.0, -2.5), parabola_as_cubic(-2.0, 2.5)
    at = point_at(bezier, u)
    forwards = -1.0 if u > 0.5 else 1.0
    direction = leaning(parabola, at, forwards * lean)
    direction = (forwards * direction[0], forwards * direction[1])
    (expected,) = parabola.hits(at, direction, leaving=True)
    (chord,) = bezier.hits(at, direction, leaving=True)
    # Rounding puts the ray 1e-15 mm off both curves; if the chord is too short to correct for it, see SMALL.
    assert chord == pytest.approx(expected, rel=1e-12, abs=min(2e-15 / lean, 2e-3 * expected))


@pytest.mark.parametrize("deviation_mm", [1e-15, -1e-13, 1e-12])
def test_a_start_slightly_off_the_curve_is_corrected(deviation_mm: float) -> None:
    for curve in (outline(5.0, 8), parabola_as_cubic(-2.5, 2.0)):
        for u in (0.11, 0.25, 0.5, 0.6):
            on_it = point_at(curve, u)
            at = along(on_it, curve.normal_at(on_it), deviation_mm)
            direction = leaning(curve, on_it, 0.2)
            t = min(curve.hits(at, direction, leaving=True))
            assert t == pytest.approx(min(curve.hits(along(at, direction, 1e-3), direction)) + 1e-3, abs=2e-14)


def test_a_ray_leaving_outwards_hits_only_where_the_curve_turns_back() -> None:
    wave = Bezier(*WAVE)
    top = point_at(wave, 0.2)
    assert wave.hits(top, leaning(wave, top, 0.5), leaving=True) == ()
    (t,) = wave.hits(wave.start, (1.0, 0.0), leaving=True)[:1]
    assert sorted(wave.hits(wave.start, (1.0, 0.0), leaving=True)) == pytest.approx([1.5, 3.0], abs=1e-14)
    assert t > 0


def test_a_ray_along_a_straight_piece_does_not_hit_it() -> None:
    spline = Spline.through([(0.0, 0.0), (1.0, 0.0), (3.0, 0.0)])
    assert spline.hits((0.5, 0.0), (1.0, 0.0), leaving=True) == ()
    assert spline.hits((-1.0, 0.0), (1.0, 0.0)) == ()


# --- closed outlines --------------------------------------------------------------------------------------------------


def deviation_mm(spline: Spline, at: Point) -> float:
    """Distance of a point from the curve, by a ray along the normal that starts 1e-3 mm from the point."""
    normal = spline.normal_at(at)
    hits = spline.hits(along(at, normal, 1e-3), (-normal[0], -normal[1]))
    return min(abs(t - 1e-3) for t in hits)


def deviation_after_reflections(spline: Spline, at: Point, direction: Point, times: int, *, leaving: bool) -> float:
    """Reflect a ray inside an outline; return its distance from the curve at the end."""
    for _ in range(times):
        hits = spline.hits(at, direction, leaving=leaving)
        assert len(hits) % 2 == 1  # from inside to outside
        at = along(at, direction, min(hits))
        normal = spline.normal_at(at)
        assert dot(direction, normal) < 0.0  # from the left
        direction, leaving = reflected(direction, normal), True
    return deviation_mm(spline, at)


def largest_deviation(outlines: int, rays: int, times: int) -> float:
    """Reflect rays inside outlines; return the largest distance from the curve. Every second ray grazes it at first."""
    rng = random.Random(7)  # noqa: S311  rays, not secrets
    worst = 0.0
    for number in range(outlines):
        motion = Rigid.about((20.0, 3.0), rng.uniform(-180, 180))
        spline = outline(number, rng.randint(5, 16)).moved(motion)
        for ray in range(rays):
            at, direction = motion.point((0.0, 0.0)), heading(rng.uniform(-180, 180))
            if ray % 2:
                at = point_at(spline, rng.random())
                direction = leaning(spline, at, 10 ** rng.uniform(-9, 0))
            worst = max(worst, deviation_after_reflections(spline, at, direction, times, leaving=ray % 2 == 1))
    return worst


def test_rays_reflected_inside_closed_splines_never_escape() -> None:
    assert largest_deviation(20, 10, 40) < 1e-13


@pytest.mark.evidence
def test_very_many_rays_reflected_inside_closed_splines_never_escape() -> None:
    worst = largest_deviation(20, 200, 200)
    print(f"20 outlines, 200 rays each, 200 reflections each: at most {worst:.1e} mm from the curve")
    assert worst < 1e-12


@pytest.mark.parametrize("corners", [12, 150])
def test_grazing_rays_from_next_to_joints_never_escape(corners: int) -> None:
    rng = random.Random(corners)  # noqa: S311  rays, not secrets
    spline = outline(1.0, corners, 0.8 * (12 / corners) ** 1.5)
    for piece in spline.pieces[:: len(spline.pieces) // 10]:
        for _ in range(4):
            at = point_at(spline, (piece.u_from + rng.choice([-1, 1]) * 10 ** rng.uniform(-16, -4)) % 1.0)
            deviation_after_reflections(spline, at, leaning(spline, at, 10 ** rng.uniform(-10, -2)), 15, leaving=True)


def test_a_wavy_outline_is_flattened_to_the_tolerance() -> None:
    wavy = Spline.through([(0.1 * i, 0.05 * (-1) ** i) for i in range(81)])
    polyline = wavy.flattened(1e-3)
    assert len(polyline) > 200
    depth = np.abs(wavy.points(np.linspace(0, 1, 4001))[:, 1]).max()
    assert np.abs(polyline[:, 1]).max() > depth - 1e-3
    with pytest.raises(DesignError, match="would need more than"):
        wavy.flattened(0.0)
