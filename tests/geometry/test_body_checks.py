"""Checks of a body: open, inverted and intersecting outlines are refused with their position."""

import math
from itertools import pairwise

import numpy as np
import pytest

from solen.curve import Arc, Curve, Segment
from solen.errors import DesignError
from solen.geometry import Body, Face, Pose
from solen.plane import Point

EMITTER = Pose((1.0, -1.0), 0.0)
SQUARE: tuple[Point, ...] = ((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0))


def body_of_corners(*corners: Point, emitter: Pose = EMITTER) -> Body:
    sides = [Face(f"side-{i}", Segment(a, b)) for i, (a, b) in enumerate(pairwise((*corners, corners[0])))]
    return Body(tuple(sides), emitter, {})


def error_line(outline: Body) -> str:
    with pytest.raises(DesignError) as raised:
        outline.check()
    line = str(raised.value)
    assert len(line.splitlines()) == 1
    return line


def test_returns_valid_body() -> None:
    square = body_of_corners(*SQUARE)
    assert square.check() is square
    assert square.area_mm2() == pytest.approx(4.0, abs=1e-12)


def test_area_includes_curved_faces() -> None:
    faces: list[Curve] = [Segment((-1.0, 0.0), (1.0, 0.0)), Arc((0.0, 0.0), 1.0, 0.0, 180.0)]
    half_disc = Body(tuple(Face(f"f{i}", curve) for i, curve in enumerate(faces)), EMITTER, {})
    assert half_disc.check().area_mm2() == pytest.approx(math.pi / 2, abs=2e-3)


def test_outline_is_closed_polyline() -> None:
    outline = body_of_corners(*SQUARE).outline(1e-3)
    assert np.array_equal(outline[0], outline[-1])
    assert outline.min() == 0.0
    assert outline.max() == 2.0


def test_refuses_clockwise_outline() -> None:
    assert "clockwise" in error_line(body_of_corners(*reversed(SQUARE)))


def test_refuses_gap_between_faces() -> None:
    square = body_of_corners(*SQUARE)
    faces = (square.faces[0], Face("side-1", Segment((2.0, 1e-6), (2.0, 2.0))), *square.faces[2:])
    line = error_line(Body(faces, EMITTER, {}))
    assert "gap of 1e-06 mm between side-0 and side-1, at x = 2, z = 0" in line


def test_refuses_gap_between_last_and_first_face() -> None:
    faces = (*body_of_corners(*SQUARE).faces[:3], Face("side-3", Segment((0.0, 2.0), (0.0, 0.5))))
    assert "between side-3 and side-0" in error_line(Body(faces, EMITTER, {}))


def test_refuses_intersection_with_faces_and_position() -> None:
    line = error_line(body_of_corners((0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (1.0, -1.0), (0.0, 4.0)))
    assert "intersects itself" in line
    assert "x = 1.75, z = 0" in line or "x = 0.8, z = 0" in line
    assert "side-0 and side-2" in line or "side-0 and side-3" in line


def test_refuses_figure_of_eight() -> None:
    line = error_line(body_of_corners((0.0, 0.0), (2.0, 2.0), (2.0, 0.0), (0.0, 3.0)))
    assert "clockwise" in line or "x = 1.2, z = 1.2" in line


@pytest.mark.parametrize("position", [(1.0, 1.0), (0.0, 0.0), (1.0, 0.0)])
def test_refuses_emitter_inside_or_on_body(position: Point) -> None:
    line = error_line(body_of_corners(*SQUARE, emitter=Pose(position, 0.0)))
    assert line.startswith("emitter")
    assert f"x = {position[0]:g}, z = {position[1]:g}" in line


@pytest.mark.parametrize("corner", [(math.nan, 0.0), (math.inf, 0.0)])
def test_refuses_corner_that_is_not_finite(corner: Point) -> None:
    with pytest.raises(DesignError, match="must be a finite number"):
        body_of_corners((0.0, 0.0), corner, (2.0, 2.0)).check()


def test_refuses_body_without_faces() -> None:
    assert "no faces" in error_line(Body((), EMITTER, {}))
