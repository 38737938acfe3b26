"""Rigid motions: the sign of an angle, the identity, and successive rotations."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from solen.plane import Point, Rigid, cross, heading

position = st.tuples(st.floats(-100, 100), st.floats(-100, 100))
angle_deg = st.floats(-720, 720)


@given(pivot=position, point=position)
def test_rotation_by_zero_is_exactly_the_identity(pivot: Point, point: Point) -> None:
    assert Rigid.about(pivot, 0.0) == Rigid()
    assert Rigid.about(pivot, 0.0).point(point) == point


@given(pivot=position, angle=angle_deg)
def test_the_pivot_is_fixed(pivot: Point, angle: float) -> None:
    assert math.dist(Rigid.about(pivot, angle).point(pivot), pivot) < 1e-12


@given(pivot=position, point=position, first=angle_deg, second=angle_deg)
def test_rotations_about_one_pivot_add_up(pivot: Point, point: Point, first: float, second: float) -> None:
    twice = Rigid.about(pivot, second).point(Rigid.about(pivot, first).point(point))
    assert math.dist(twice, Rigid.about(pivot, first + second).point(point)) < 1e-10


@given(pivot=position, a=position, b=position, angle=angle_deg)
def test_rotations_preserve_lengths_and_handedness(pivot: Point, a: Point, b: Point, angle: float) -> None:
    turn = Rigid.about(pivot, angle)
    assert math.dist(turn.point(a), turn.point(b)) == pytest.approx(math.dist(a, b), abs=1e-11)
    assert cross(turn.vector(a), turn.vector(b)) == pytest.approx(cross(a, b), abs=1e-9)


def test_minus_three_degrees_lean_the_axis_to_the_right() -> None:
    x, z = Rigid.about((5.0, 5.0), -3.0).vector((0.0, 1.0))
    assert x == pytest.approx(math.sin(math.radians(3.0)), abs=1e-16)
    assert z == pytest.approx(math.cos(math.radians(3.0)), abs=1e-16)
    assert heading(-3.0) == pytest.approx((x, z), abs=1e-16)
    assert heading(0.0) == (0.0, 1.0)


def test_ninety_degrees_rotate_right_to_up() -> None:
    assert Rigid.about((1.0, 1.0), 90.0).point((2.0, 1.0)) == pytest.approx((1.0, 2.0), abs=1e-15)
