"""Bodies of simple shape."""

from itertools import pairwise

from solen.curve import Segment
from solen.geometry import Body, Face, Pose
from solen.plane import Point

SIDES = ("bottom", "right", "top", "left")


def polygon(corners: dict[str, Point]) -> Body:
    """A body of straight faces; each is named with its first corner, counter-clockwise."""
    points = [*corners.values()]
    ends = pairwise([*points, points[0]])
    faces = tuple(Face(name, Segment(a, b)) for name, (a, b) in zip(corners, ends, strict=True))
    return Body(faces, Pose((0.0, -100.0), 0.0), {}).check()


def block(width_mm: float, height_mm: float) -> Body:
    """A rectangle on x = 0 … width, z = 0 … height."""
    w, h = width_mm, height_mm
    return polygon(dict(zip(SIDES, [(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)], strict=True)))
