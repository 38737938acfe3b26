"""Sections of a body at a height, as in one layer of a print.

Behind the base of the stem, a body whose lens varies with height is a prism. In front of the base, a section is bounded
by the lens curve at that height and by the straight sides of the aperture; if the curve ends behind the base, the stem
begins at its ends.
"""

from dataclasses import replace

from solen.curve import Curve, Parabola, Segment
from solen.errors import DesignError
from solen.geometry.body import GAP_MM, Body, Face
from solen.plane import Point


def section(body: Body, y_mm: float) -> Body:
    """Return a prism with the section of a body at ``y_mm`` from mid-height, without motion.

    A body that is already a prism is returned unchanged.
    """
    return body if body.front is None else with_front(body, body.front.lens.section(y_mm))


def with_front(body: Body, front: Curve) -> Body:
    """Return the prism, without motion, whose lens is a curve across the aperture from left to right."""
    if body.front is None:
        raise AssertionError("the body is already a prism")
    lens, (_, *rest) = body.front.lens, body.faces
    depth, base = front.end[1], lens.depth_mm
    faces = list(rest)
    if depth > base + GAP_MM:
        faces[0], faces[-1] = _trimmed(rest[0], depth, ends=False), _trimmed(rest[-1], depth, ends=True)
    right = _side("side-right", front.end, faces[0].curve.start)
    left = _side("side-left", faces[-1].curve.end, front.start)
    return replace(body, faces=(Face("lens", front), *right, *faces, *left), front=None)


def _side(name: str, start: Point, end: Point) -> list[Face]:
    """Return the straight face between two points; an empty list if they coincide."""
    distance_mm = abs(start[0] - end[0]) + abs(start[1] - end[1])
    return [Face(name, Segment(start, end))] if distance_mm > GAP_MM else []


def _trimmed(face: Face, depth_mm: float, *, ends: bool) -> Face:
    """Return a side of the stem, trimmed to begin at a depth, or to end there if ``ends`` is set."""
    curve = face.curve
    if isinstance(curve, Parabola):
        fraction = (depth_mm - curve.start[1]) / (curve.end[1] - curve.start[1])
        if 0.0 < fraction < 1.0:
            return replace(face, curve=curve.part(0.0, fraction) if ends else curve.part(fraction, 1.0))
    limit = f"ends in front of z = {depth_mm:.3f} mm, where the lens ends at another height"
    remedy = "reduce the thickness of the body, or move the part of the wall that [[wall]] covers away from the lens"
    raise DesignError(face.name, limit=limit, remedy=remedy)
