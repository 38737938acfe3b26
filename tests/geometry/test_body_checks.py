"""The check of an outline: what is open, inside out or crossing is refused with the place."""

import math
from itertools import pairwise

import numpy as np
import pytest

from solen.curve import Arc, Curve, Segment
from solen.errors import DesignError
from solen.geometry import Body, Face, Pose
from solen.plane import Point

BELOW = Pose((1.0, -1.0), 0.0)
SQUARE: tuple[Point, ...] = ((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0))


def body(*corners: Point, emitter: Pose = BELOW) -> Body:
    sides = [Face(f"side-{i}", Segment(a, b)) for i, (a, b) in enumerate(pairwise((*corners, corners[0])))]
    return Body(tuple(sides), emitter, {})


def refused(outline: Body) -> str:
    with pytest.raises(DesignError) as refusal:
        outline.check()
    line = str(refusal.value)
    assert len(line.splitlines()) == 1
    return line


def test_a_sound_body_is_returned_as_it_is() -> None:
    square = body(*SQUARE)
    assert square.check() is square
    assert square.area_mm2() == pytest.approx(4.0, abs=1e-12)


def test_curved_faces_count_with_their_bulge() -> None:
    faces: list[Curve] = [Segment((-1.0, 0.0), (1.0, 0.0)), Arc((0.0, 0.0), 1.0, 0.0, 180.0)]
    half = Body(tuple(Face(f"f{i}", curve) for i, curve in enumerate(faces)), BELOW, {})
    assert half.check().area_mm2() == pytest.approx(math.pi / 2, abs=2e-3)


def test_the_outline_is_closed_and_within_its_tolerance() -> None:
    outline = body(*SQUARE).outline(1e-3)
    assert np.array_equal(outline[0], outline[-1])
    assert outline.min() == 0.0
    assert outline.max() == 2.0


def test_a_clockwise_outline_is_refused() -> None:
    assert "clockwise" in refused(body(*reversed(SQUARE)))


def test_an_open_outline_is_refused_with_the_faces_and_the_gap() -> None:
    square = body(*SQUARE)
    faces = (square.faces[0], Face("side-1", Segment((2.0, 1e-6), (2.0, 2.0))), *square.faces[2:])
    line = refused(Body(faces, BELOW, {}))
    assert "open between side-0 and side-1" in line
    assert "1e-06 mm at x = 2, z = 0" in line


def test_an_open_end_is_found_at_the_seam_too() -> None:
    faces = (*body(*SQUARE).faces[:3], Face("side-3", Segment((0.0, 2.0), (0.0, 0.5))))
    assert "open between side-3 and side-0" in refused(Body(faces, BELOW, {}))


def test_a_crossing_outline_is_refused_with_the_faces_and_the_place() -> None:
    line = refused(body((0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (1.0, -1.0), (0.0, 4.0)))
    assert "intersects itself" in line
    assert "x = 1.75, z = 0" in line or "x = 0.8, z = 0" in line
    assert "side-0 and side-2" in line or "side-0 and side-3" in line


def test_a_figure_of_eight_is_refused() -> None:
    line = refused(body((0.0, 0.0), (2.0, 2.0), (2.0, 0.0), (0.0, 3.0)))
    assert "clockwise" in line or "x = 1.2, z = 1.2" in line


@pytest.mark.parametrize("place", [(1.0, 1.0), (0.0, 0.0), (1.0, 0.0)])
def test_an_emitter_inside_or_on_the_body_is_refused_with_its_place(place: Point) -> None:
    line = refused(body(*SQUARE, emitter=Pose(place, 0.0)))
    assert line.startswith("emitter")
    assert f"x = {place[0]:g}, z = {place[1]:g}" in line


@pytest.mark.parametrize("corner", [(math.nan, 0.0), (math.inf, 0.0)])
def test_a_corner_that_is_no_number_is_refused(corner: Point) -> None:
    with pytest.raises(DesignError, match="must be a finite number"):
        body((0.0, 0.0), corner, (2.0, 2.0)).check()


def test_a_body_without_faces_is_refused() -> None:
    assert "no faces" in refused(Body((), BELOW, {}))
