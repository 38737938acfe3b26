"""SVG drawings of a body: a user unit is 1 mm, and each face is a path with the name of the face.

Lines, arcs, parabolas and cubics are exact; any other curve is drawn as the Bézier segments of its B-spline, within
1 nm. Names are stored as path ids and as Inkscape labels, so that `solen.geometry.drawing` can read the body back. The
y axis of SVG points down: it is −z. Small circles mark the emitter and the pivot of the motion.
"""

import math
from collections.abc import Iterator, Sequence
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from solen.curve import Arc, Curve, Parabola, Segment
from solen.fabricate.bspline import cubics, quadratic
from solen.fabricate.dxf import emitter_line, emitters
from solen.fabricate.label import Label
from solen.fabricate.numbers import LETTER_WIDTH, LINE_MM, TEXT_MM, NumberedPart
from solen.geometry import Body
from solen.plane import Point

MARGIN_MM = 1.0
STROKE_MM = 0.1
MARK_MM = 0.1
MAX_ARC_DEG = 90.0
"""Maximum angle of an arc segment, because the ends of a larger arc determine its centre less accurately."""


def as_svg(body: Body, label: Label, parts: Sequence[NumberedPart] = ()) -> bytes:
    """Return an SVG file of a body, in mm, with its parts numbered and listed."""
    faces = (*body.all_faces, *body.separate)
    corners = np.vstack([*(face.curve.flattened(1e-3) for face in faces), [pose.point for _, pose in emitters(body)]])
    low, high = corners.min(axis=0) - MARGIN_MM, corners.max(axis=0) + MARGIN_MM
    table = (float(high[0]) + TEXT_MM, float(high[1]) - TEXT_MM)
    if parts:
        positions = np.array([part.position for part in parts])
        width, height = LETTER_WIDTH * TEXT_MM * max(len(part.row) for part in parts), LINE_MM * len(parts)
        low = np.minimum(np.minimum(low, positions.min(axis=0) - TEXT_MM), [low[0], table[1] - height])
        high = np.maximum(np.maximum(high, positions.max(axis=0) + TEXT_MM), [table[0] + width, high[1]])
    width, height = (high - low).tolist()
    box = " ".join(_number(value) for value in (low[0], -high[1], width, height))
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"',
        f'  width="{_number(width)}mm" height="{_number(height)}mm" viewBox="{box}">',
        f"<title>{escape(label.name)}</title>",
        f"<desc>{escape('; '.join(label.lines[1:]))}</desc>",
        f'<g fill="none" stroke="black" stroke-width="{STROKE_MM:g}">',
        *(_path(face.name, "".join(_path_data(face.curve))) for face in faces),
        *_marks(body),
        "</g>",
        *_numbers(parts, table),
        "</svg>\n",
    ]
    return "\n".join(lines).encode()


def _numbers(parts: Sequence[NumberedPart], table: Point) -> Iterator[str]:
    """Draw the part numbers and the table of parts."""
    if not parts:
        return
    yield f'<g id="notes" font-family="sans-serif" font-size="{TEXT_MM:g}">'
    for row, part in enumerate(parts):
        yield f"{_text(part.position, 'middle')}{part.number}</text>"
        yield f"{_text((table[0], table[1] - row * LINE_MM), 'start')}{escape(part.row)}</text>"
    yield "</g>"


def _text(point: Point, anchor: str) -> str:
    x, y = _at(point).split()
    return f'<text x="{x}" y="{y}" text-anchor="{anchor}" dominant-baseline="central">'


def _path(name: str, data: str) -> str:
    quoted = quoteattr(name)
    return f'<path id={quoted} inkscape:label={quoted} d="{data}"/>'


def _marks(body: Body) -> Iterator[str]:
    for name, emitter in emitters(body):
        start, end = emitter_line(emitter)
        if math.dist(start, end) > 0.0:
            yield _path(name, f"M{_at(start)}L{_at(end)}")
        else:
            yield _circle(name, emitter.point)
    if "stem-base" in body.marks:
        yield _circle("pivot", body.marks["stem-base"])


def _circle(name: str, point: Point) -> str:
    x, y = _at(point).split()
    return f'<circle id="{name}" inkscape:label="{name}" cx="{x}" cy="{y}" r="{MARK_MM:g}"/>'


def _path_data(curve: Curve) -> Iterator[str]:
    yield f"M{_at(curve.start)}"
    if isinstance(curve, Segment):
        yield f"L{_at(curve.end)}"
    elif isinstance(curve, Arc):
        pieces = math.ceil(abs(curve.sweep_deg) / MAX_ARC_DEG)
        radius, clockwise = _number(curve.radius_mm), int(curve.sweep_deg < 0.0)
        for x, z in curve.points(np.linspace(0.0, 1.0, pieces + 1)[1:]).tolist():
            yield f"A{radius} {radius} 0 0 {clockwise} {_at((x, z))}"
    elif isinstance(curve, Parabola):
        _, middle, end = quadratic(curve)
        yield f"Q{_at(middle)} {_at(end)}"
    else:
        for _, first, second, end in cubics(curve):
            yield f"C{_at(first)} {_at(second)} {_at(end)}"


def _at(point: Point) -> str:
    return f"{_number(point[0])} {_number(-point[1])}"


def _number(value: float) -> str:
    """Format a length in mm with at most twelve decimals, a femtometre."""
    return f"{value + 0.0:.12f}".rstrip("0").rstrip(".")
