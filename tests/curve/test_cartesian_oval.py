"""The oval's front: its equation, its second root, Newton's method compared with a search, and grazing lines."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from solen.curve import CartesianOval
from solen.plane import Point, Rigid, along, dot, heading, left_of

EDGE_DEG = 35.4329160335
PAPER = CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, 1.44, 1.0, 20.0, EDGE_DEG, -EDGE_DEG)


def roots_by_search(origin: Point, direction: Point, longest: float) -> list[float]:
    """Intersections with the full oval, from sign changes along the ray."""

    def side(t: float) -> float:
        return PAPER.residual_mm(along(origin, direction, t))

    grid = np.linspace(0.0, longest, 801)
    sides = np.array([side(float(t)) for t in grid])
    indices = np.flatnonzero((sides[:-1] < 0) != (sides[1:] < 0))
    return [float(brentq(side, float(grid[i]), float(grid[i + 1]), xtol=1e-14)) for i in indices]


@pytest.mark.parametrize("n2", [1.44, 1.49, 1.54])
def test_the_front_solves_the_equation(n2: float) -> None:
    oval = CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, n2, 1.0, 20.0, 35.0, -35.0)
    for x, z in oval.points(np.linspace(0.0, 1.0, 501)):
        assert abs(oval.residual_mm((float(x), float(z)))) < 1e-12
        assert -1e-14 < z < 2.0
    assert oval.points(np.array([0.5]))[0] == pytest.approx([0.0, 0.0], abs=1e-14)


@pytest.mark.parametrize("x", [0.0, 0.5, 1.0, 1.5, 1.9, 1.9999999])
def test_a_line_along_z_hits_the_front_but_not_the_back(x: float) -> None:
    roots = roots_by_search((x, -1.0), (0.0, 1.0), 30.0)
    assert len(roots) == 2
    assert roots[1] > 20.0  # the second root of the equation, near z = 23
    assert PAPER.hits((x, -1.0), (0.0, 1.0)) == pytest.approx(roots[:1], abs=1e-12)
    assert PAPER.hits((x, 10.0), (0.0, 1.0)) == ()
    assert PAPER.hits((x, 10.0), (0.0, -1.0)) == pytest.approx([11.0 - roots[0]], abs=1e-12)


@settings(max_examples=80, deadline=None)
@given(target=st.tuples(st.floats(-3, 3), st.floats(-1, 3)), towards=st.floats(-180, 180), back=st.floats(0, 60))
def test_newton_agrees_with_a_search(target: Point, towards: float, back: float) -> None:
    direction = heading(towards)
    origin = along(target, direction, -back)
    assume(abs(PAPER.residual_mm(origin)) > 1e-6)
    expected = []
    for t in roots_by_search(origin, direction, 120.0):
        x, z = along(origin, direction, t)
        if z < PAPER.depth_mm - 1e-9:
            expected.append(t)
            assert abs(x) <= 2.0
    hits = sorted(t for t in PAPER.hits(origin, direction) if along(origin, direction, t)[1] < PAPER.depth_mm - 1e-9)
    if len(expected) == len(hits):
        for hit, t in zip(hits, expected, strict=True):
            tilt = abs(dot(PAPER.normal_at(along(origin, direction, t)), direction))
            assert hit == pytest.approx(t, abs=1e-12 + 1e-13 / max(tilt, 1e-6))
    else:  # two intersections between two samples of the search
        assert len(hits) == len(expected) + 2
        assert max(abs(PAPER.residual_mm(along(origin, direction, t))) for t in hits) < 1e-12


@pytest.mark.parametrize("offset_mm", [1e-3, 1e-5, 1e-7, 1e-9, 1e-11])
@pytest.mark.parametrize("u", [0.2, 0.5, 0.71])
def test_a_grazing_line_hits_twice_inside_and_never_outside(u: float, offset_mm: float) -> None:
    x, z = PAPER.points(np.array([u]))[0]
    outwards = PAPER.normal_at((float(x), float(z)))
    if dot(outwards, (0.0, 1.0)) > 0:  # the normal out of the material
        outwards = (-outwards[0], -outwards[1])
    direction = left_of(outwards)
    outside = along(along((float(x), float(z)), outwards, offset_mm), direction, -0.9)
    assert PAPER.hits(outside, direction) == ()
    inside = along(along((float(x), float(z)), outwards, -offset_mm), direction, -0.9)
    near, far = sorted(PAPER.hits(inside, direction))
    assert near < 0.9 < far
    for t in (near, far):
        assert abs(PAPER.residual_mm(along(inside, direction, t))) < 1e-13
    start = along(inside, direction, near)
    assert PAPER.hits(start, direction, leaving=True) == pytest.approx([far - near], abs=1e-8)


def test_the_front_faces_the_emitter_with_its_right_side() -> None:
    assert PAPER.start == pytest.approx((-2.0, 1.810852142230), abs=1e-9)
    assert PAPER.end == pytest.approx((2.0, 1.810852142230), abs=1e-9)
    assert PAPER.normal_at((0.0, 0.0)) == pytest.approx((0.0, 1.0), abs=1e-15)
    assert PAPER.reversed().normal_at((0.0, 0.0)) == pytest.approx((0.0, -1.0), abs=1e-15)


def test_points_beyond_tangency_are_nan_without_a_warning() -> None:
    radius = PAPER.radius_from_object(np.array([0.0, 60.0, 120.0]))
    assert radius[0] == pytest.approx(1.0, abs=1e-15)
    assert np.isnan(radius[1:]).all()


@pytest.mark.parametrize("distance_mm", [1e3, 1e4, 1e6])
def test_distant_rays_hit_the_front(distance_mm: float) -> None:
    for x in np.linspace(-1.9, 1.9, 101):
        for turn in (-5.0, 0.0, 5.0):
            direction = heading(turn)
            target: Point = (float(x), 1.9)
            hits = PAPER.hits(along(target, direction, -distance_mm), direction)
            assert len(hits) >= 1, (x, turn)


PIECES = [(30.0, 10.0), (-5.0, -25.0), (20.0, -3.0), (5.0, -35.0), (0.0, -30.0), (1.0, 0.5)]


@pytest.mark.parametrize("turn_deg", [0.0, 20.0, -90.0, 180.0])
@pytest.mark.parametrize(("from_deg", "to_deg"), PIECES + [(to, start) for start, to in PIECES])
def test_rays_hit_a_piece_only_between_its_ends(from_deg: float, to_deg: float, turn_deg: float) -> None:
    unmoved = CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, 1.44, 1.0, 20.0, from_deg, to_deg)
    motion = Rigid.about((0.3, 0.4), turn_deg)
    piece = unmoved.moved(motion)
    low, high = sorted((unmoved.start[0], unmoved.end[0]))
    for x in [*np.linspace(-2.09, 2.11, 85), low - 1e-9, low + 1e-9, high - 1e-9, high + 1e-9]:
        met = piece.hits(motion.point((float(x), -1.0)), motion.vector((0.0, 1.0)))
        assert len(met) == (1 if low < x < high else 0), x
        assert not piece.hits(
            motion.point((float(x), 10.0)), motion.vector((0.0, 1.0))
        )  # the back is not part of the curve
    for fraction in np.linspace(0.01, 0.99, 7):
        angle = from_deg + fraction * (to_deg - from_deg)
        radius = float(unmoved.radius_from_object(np.array([angle]))[0])
        met = piece.hits(motion.point((0.0, -1.0)), motion.vector(heading(float(angle))))
        assert met == pytest.approx([radius], abs=1e-12)
    for angle in (min(from_deg, to_deg) - 0.01, max(from_deg, to_deg) + 0.01):
        assert piece.hits(motion.point((0.0, -1.0)), motion.vector(heading(angle))) == ()


def test_a_piece_on_one_side_ends_at_its_angles() -> None:
    piece = CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, 1.44, 1.0, 20.0, 30.0, 10.0)  # x from −0.96 to −0.18
    assert len(piece.hits((-0.5, -1.0), (0.0, 1.0))) == 1
    assert piece.hits((0.0, -1.0), (0.0, 1.0)) == ()
    assert piece.hits((0.5, -1.0), (0.0, 1.0)) == ()


@pytest.mark.parametrize("focus_mm", [1e5, 1e7])
def test_a_nearly_collimating_oval_keeps_its_digits(focus_mm: float) -> None:
    oval = CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, 1.44, 1.0, focus_mm, 30.0, -30.0)
    assert oval.hits((0.0, -1.0), (0.0, 1.0)) == pytest.approx([1.0], abs=1e-12)
    for angle in (-25.0, 5.0, 20.0):
        r = float(oval.radius_from_object(np.array([angle]))[0])
        point = along(oval.object_focus, heading(angle), r)
        assert oval.hits((point[0], -1.0), (0.0, 1.0)) == pytest.approx([point[1] + 1.0], abs=1e-12)
