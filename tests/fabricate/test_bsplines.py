"""Lines, arcs and B-splines that represent curves: their position, joints and accuracy."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from solen.curve import Arc, Bezier, CubicChain, Curve, Parabola, Segment, Spline
from solen.fabricate import Bspline, primitives
from solen.fabricate.bspline import FIT_TOLERANCE_MM, cubics, quadratic
from solen.plane import cross, minus, unit
from tests.curve.test_every_curve import LEAVES, distance_to
from tests.fabricate.solid_support import body_of, design, oval_distance_mm

every_curve = pytest.mark.parametrize("leaf", LEAVES, ids=lambda leaf: leaf.__name__)
few = settings(max_examples=15, deadline=None)
ROUNDING_MM = 1e-12


def points_of(piece: Segment | Arc | Bspline, u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points of a primitive; those of a B-spline are evaluated by scipy."""
    if not isinstance(piece, Bspline):
        return piece.points(u)
    return np.asarray(BSpline(piece.knot_vector, np.array(piece.points), piece.degree)(u))


@every_curve
@few
@given(st.data())
def test_primitives_lie_on_their_curve_and_join(leaf: type[Curve], data: st.DataObject) -> None:
    curve = data.draw(LEAVES[leaf])
    pieces = primitives(curve)
    assert math.dist(pieces[0].start, curve.start) <= ROUNDING_MM
    assert math.dist(pieces[-1].end, curve.end) <= ROUNDING_MM
    for before, after in pairwise(pieces):
        assert before.end == after.start
    exact = leaf in (Segment, Arc, Parabola) or issubclass(leaf, CubicChain)
    for piece in pieces:
        for x, z in points_of(piece, np.linspace(0.0, 1.0, 8)).tolist():
            # the distance itself is accurate to 1e-8
            assert distance_to(curve, (x, z)) < (1e-8 if exact else FIT_TOLERANCE_MM + 1e-8)


@every_curve
@few
@given(st.data())
def test_tangents_at_the_ends_agree_with_the_curve(leaf: type[Curve], data: st.DataObject) -> None:
    curve = data.draw(LEAVES[leaf])
    pieces = primitives(curve)
    for end, piece in ((0.0, pieces[0]), (1.0, pieces[-1])):
        if isinstance(piece, Bspline):
            i = 0 if end == 0.0 else -2
            sine = cross(
                unit(minus(piece.points[i + 1], piece.points[i])),
                unit(tuple(curve.velocities(np.array([end]))[0].tolist())),
            )
            assert abs(sine) < 1e-9


@pytest.mark.parametrize(
    "leaf", [leaf for leaf in LEAVES if leaf not in (Segment, Arc, Parabola)], ids=lambda leaf: leaf.__name__
)
@few
@given(st.data())
def test_cubic_pieces_lie_on_their_curve_and_join(leaf: type[Curve], data: st.DataObject) -> None:
    curve = data.draw(LEAVES[leaf])
    ends = cubics(curve)
    assert (ends[0][0], ends[-1][3]) == (curve.start, curve.end)
    for before, after in pairwise(ends):
        assert before[3] == after[0]
    for piece in ends[:: max(1, len(ends) // 4)]:
        x, z = Bezier(*piece).middle_point
        assert distance_to(curve, (x, z)) < FIT_TOLERANCE_MM + 1e-8


@pytest.mark.parametrize("index", [1.44, 1.49, 1.54])
def test_the_b_spline_of_a_lens_is_within_10_nm(index: float) -> None:
    (spline,) = primitives(body_of(design(material__index=index)).face("lens").curve)
    assert isinstance(spline, Bspline)
    assert spline.degree == 3
    assert set(spline.multiplicities[1:-1]) == {1}, "curvature is continuous"
    assert oval_distance_mm(points_of(spline, np.linspace(0.0, 1.0, 20_001)), index) < 1e-5


def test_a_parabola_is_a_b_spline_of_degree_2() -> None:
    curve = Parabola((1.0, 2.0), (0.0, 1.0), 0.004, 0.0, 16.2)
    (spline,) = primitives(curve)
    assert isinstance(spline, Bspline)
    assert (spline.degree, spline.points) == (2, quadratic(curve))
    u = np.linspace(0.0, 1.0, 101)
    assert np.abs(points_of(spline, u) - curve.points(u)).max() < 1e-14


def test_a_smooth_chain_is_one_b_spline_with_a_continuous_derivative() -> None:
    chain = Spline.through([(0.0, 0.0), (1.0, 0.5), (3.0, 0.2), (3.5, 2.0)])
    (spline,) = primitives(chain)
    assert isinstance(spline, Bspline)
    assert spline.multiplicities == (4, 2, 2, 4)
    derivative = BSpline(spline.knot_vector, np.array(spline.points), 3).derivative()
    for knot in spline.knots[1:-1]:
        before, after = derivative(knot - 1e-12), derivative(knot + 1e-12)
        assert np.abs(before - after).max() < 1e-9
    assert points_of(spline, np.array(spline.knots)) == pytest.approx(chain.points(np.linspace(0, 1, 4)), abs=1e-13)


def test_a_corner_divides_a_chain() -> None:
    chain = Spline(((0, 0), (1, 0), (2, 0.5), (3, 0), (3, 1), (3.5, 2), (3, 3)))
    first, second = primitives(chain)
    assert first.end == second.start == (3, 0)


def test_a_closed_chain_is_a_closed_b_spline() -> None:
    chain = Spline.through([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)], closed=True)
    (spline,) = primitives(chain)
    assert spline.start == spline.end
