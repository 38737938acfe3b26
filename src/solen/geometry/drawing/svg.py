"""Drawings from vector graphics programs: SVG, in which labels, classes or ids of elements name the faces.

The name of a face is the Inkscape label of its element, its class or its id (unless a program generated the id, for
example ``path12``), otherwise that of an enclosing group. Paths (all commands), lines, polylines, polygons, rectangles,
circles and ellipses are supported, with groups, transforms and clones. Lines, circular arcs and Bézier segments are
read exactly, and smoothly joined Bézier segments of a path as one spline; an ellipse becomes a spline within
`SHAPE_TOLERANCE_MM`. The y axis of SVG, which points down, becomes −z.
"""

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree as ET

from solen.curve import Curve
from solen.errors import DataError
from solen.files import read_text
from solen.geometry.drawing.model import (
    EMITTER,
    NO_UNITS_REMEDY,
    UNITS_MM,
    WALL,
    Drawing,
    DrawnEmitter,
    Stroke,
    emitter_name,
    face_name,
    is_annotation,
    is_called,
)
from solen.geometry.drawing.path import NUMBER, PathSegment, coordinate, path_segments
from solen.geometry.drawing.shapes import beziers, ellipse
from solen.geometry.drawing.transform import Affine
from solen.plane import Point, cross, dot, minus

LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
GENERATED_NAME = re.compile(
    r"(path|rect|circle|ellipse|line|polyline|polygon|g|group|layer|svg|use|shape)[-_\d]*", re.I
)
INVISIBLE = frozenset(
    {"defs", "symbol", "clipPath", "mask", "marker", "pattern", "linearGradient", "radialGradient", "filter", "style"}
    | {"title", "desc", "metadata", "namedview", "text", "script", "image", "foreignObject", "switch"}
)
GROUPS = frozenset({"g", "a", "use"})
LENGTH_MM = {"mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72, "pc": 25.4 / 6, "Q": 0.25}
PIXEL_MM = 25.4 / 96
"""Length of a user unit in a drawing without a view box."""
MAX_CLONE_DEPTH = 16
SMOOTH_RAD = 1e-3
"""Maximum angle in radians between Bézier segments that join smoothly; programs write smooth nodes more accurately."""


def read_svg(path: Path, units: str | None) -> Drawing:
    """Read a drawing from an SVG file; raise the errors of `read_drawing`."""
    try:
        root = ET.fromstring(read_text(path, DataError))  # noqa: S314  expat limits the expansion of entities
    except ET.ParseError as bad:
        raise DataError(str(path), limit=f"is not SVG: {bad}") from None
    if _tag(root) != "svg":
        raise DataError(str(path), value=_tag(root), limit="must be an SVG file with the root element svg")
    scale = _scale(path, root, units)
    return _Reader(root, str(path)).drawing(Affine(scale, 0.0, 0.0, -scale))


def _scale(path: Path, root: ET.Element, units: str | None) -> float:
    """Return millimetres per user unit, from the width or height in a unit of length and the view box."""
    if units is not None:
        return UNITS_MM[units]
    box = [float(number) for number in NUMBER.findall(root.get("viewBox", ""))]
    scale = []
    for key, index in (("width", 2), ("height", 3)):
        match = re.fullmatch(r"\s*([-+.\deE]+?)\s*([a-zA-Z]+)\s*", root.get(key, ""))
        if match and match[2] in LENGTH_MM:
            length_mm = float(match[1]) * LENGTH_MM[match[2]]
            if len(box) == 4 and not box[index] > 0.0:
                raise DataError(f"{path}: viewBox", value=root.get("viewBox"), limit="must have a size above 0")
            scale.append(length_mm / box[index] if len(box) == 4 else PIXEL_MM)
    if not scale:
        limit = "the drawing does not specify its unit: neither width nor height is in mm, cm, in or pt"
        raise DataError(f"{path}: width", value=root.get("width"), limit=limit, remedy=NO_UNITS_REMEDY)
    if abs(scale[0] - scale[-1]) > 1e-3 * scale[0]:
        limit = "distorts the drawing: width and height are scaled differently"
        raise DataError(
            f"{path}: viewBox",
            value=root.get("viewBox"),
            limit=limit,
            remedy="give the view box the proportions of width and height",
        )
    return scale[0]


class _Reader:
    """A reader that collects the visible content of an SVG file."""

    def __init__(self, root: ET.Element, where: str) -> None:
        self._root, self._where = root, where
        self._by_id = {element.get("id"): element for element in root.iter() if element.get("id")}
        self._strokes: list[Stroke] = []
        self._emitters: list[DrawnEmitter] = []
        self._points: list[tuple[str, Point]] = []

    def drawing(self, transform: Affine) -> Drawing:
        """Return all visible content; ``transform`` maps user units to the coordinates of the drawing."""
        self._children(self._root, transform, WALL, 0)
        return Drawing(tuple(self._strokes), tuple(self._emitters), tuple(self._points))

    def _children(self, parent: ET.Element, transform: Affine, name: str, depth: int) -> None:
        for element in parent:
            if isinstance(element.tag, str):
                self._element(element, transform, name, depth)

    def _element(self, element: ET.Element, transform: Affine, inherited: str, depth: int) -> None:
        tag, name = _tag(element), _name(element) or inherited
        if tag in INVISIBLE or is_annotation(name) or _is_hidden(element):
            return
        transform = transform.after(Affine.of(element.get("transform", ""), self._where))
        if tag in GROUPS:
            self._children(element, transform, name, depth)
            if tag == "use":
                self._clone(element, transform, name, depth)
            return
        what = f"{tag} {element.get('id', '')}".strip()
        if tag == "svg":
            limit = "is a nested svg element, which is not supported"
            raise DataError(f"{self._where}: {what}", limit=limit, remedy="ungroup it")
        self._collect(
            name, what, _segments(element, f"{self._where}: {what}"), transform, is_round=tag in ("circle", "ellipse")
        )

    def _clone(self, element: ET.Element, transform: Affine, name: str, depth: int) -> None:
        target = next((element.get(key) for key in HREFS if element.get(key)), "")
        original = self._by_id.get((target or "").removeprefix("#"))
        if original is None or depth > MAX_CLONE_DEPTH:
            raise DataError(f"{self._where}: use", value=target, limit="must refer to another element of the drawing")
        shift = Affine(1.0, 0.0, 0.0, 1.0, _number(element.attrib, "x"), _number(element.attrib, "y"))
        self._element(original, transform.after(shift), name, depth + 1)

    def _collect(self, name: str, what: str, segments: list[PathSegment], transform: Affine, *, is_round: bool) -> None:
        """Collect the point, the emitter or the strokes of an element."""
        segments = [segment.moved(transform) for segment in segments]
        if not segments:
            raise DataError(f"{self._where}: {what}", limit="has no size", remedy="give it a size, or remove it")
        if is_round and is_called(name, "pivot"):
            self._points.append((name, segments[0].points[0]))
        elif is_round and is_called(name, EMITTER):
            self._emitters.append(DrawnEmitter(segments[0].points[0], name=emitter_name(name)))
        elif is_called(name, EMITTER) and len(segments) == 1 and len(segments[0].points) == 2:
            self._emitters.append(DrawnEmitter(segments[0].points[0], segments[0].points[1], name=emitter_name(name)))
        else:
            curves = (_curve(run) for run in _runs(segments))
            self._strokes += [Stroke(name, curve, what) for curve in curves if curve is not None]


def _curve(run: list[PathSegment]) -> Curve | None:
    """Return the curve of smoothly joined Bézier segments, or of one other segment; None if its length is zero."""
    segment = run[0]
    if segment.sweep is None:
        return beziers([segment.points for segment in run])
    center, u, v = segment.points
    return ellipse(center, u, v, segment.start, segment.sweep)


def _runs(segments: list[PathSegment]) -> list[list[PathSegment]]:
    """Return path segments in runs that each form a curve: smoothly joined Bézier segments, or one segment."""
    runs: list[list[PathSegment]] = []
    for segment in segments:
        if runs and _continues(runs[-1][-1], segment):
            runs[-1].append(segment)
        else:
            runs.append([segment])
    return runs


def _continues(previous: PathSegment, following: PathSegment) -> bool:
    if (
        previous.sweep is not None
        or following.sweep is not None
        or min(len(previous.points), len(following.points)) < 3
    ):
        return False
    arriving, departing = (
        minus(previous.points[-1], previous.points[-2]),
        minus(following.points[1], following.points[0]),
    )
    turn = math.atan2(abs(cross(arriving, departing)), dot(arriving, departing))
    return (
        previous.points[-1] == following.points[0]
        and 0.0 not in (math.hypot(*arriving), math.hypot(*departing))
        and turn < SMOOTH_RAD
    )


def _segments(element: ET.Element, where: str) -> list[PathSegment]:
    """Return the segments of a shape in its own coordinates."""
    tag, data = _tag(element), element.attrib
    if tag == "path":
        return list(path_segments(data.get("d", ""), where))
    if tag == "line":
        return [PathSegment(((_number(data, "x1"), _number(data, "y1")), (_number(data, "x2"), _number(data, "y2"))))]
    if tag in ("polyline", "polygon"):
        numbers = [
            float(number) for number in re.findall(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", data.get("points", ""))
        ]
        corners = list(zip(numbers[::2], numbers[1::2], strict=False))
        return _between(corners, closed=tag == "polygon")
    if tag in ("circle", "ellipse"):
        rx, ry = (_number(data, key) for key in (("r", "r") if tag == "circle" else ("rx", "ry")))
        center = (_number(data, "cx"), _number(data, "cy"))
        return [PathSegment((center, (rx, 0.0), (0.0, ry)), 0.0, math.tau)] if rx > 0.0 and ry > 0.0 else []
    if tag == "rect":
        return list(_rectangle(data))
    raise DataError(where, limit="is not supported", remedy="convert it to a path")


def _between(corners: list[Point], *, closed: bool) -> list[PathSegment]:
    following = [*corners[1:], corners[0]] if closed and corners else corners[1:]
    return [PathSegment((a, b)) for a, b in zip(corners, following, strict=False) if a != b]


def _rectangle(data: Mapping[str, str]) -> Iterator[PathSegment]:
    """Yield the sides of a rectangle and its rounded corners."""
    x, y, width, height = (_number(data, key) for key in ("x", "y", "width", "height"))
    rx, ry = _number(data, "rx") or _number(data, "ry"), _number(data, "ry") or _number(data, "rx")
    rx, ry = min(rx, width / 2), min(ry, height / 2)
    if rx <= 0.0 or ry <= 0.0:
        yield from _between([(x, y), (x + width, y), (x + width, y + height), (x, y + height)], closed=True)
        return
    centers = ((x + width - rx, y + ry), (x + width - rx, y + height - ry), (x + rx, y + height - ry), (x + rx, y + ry))
    arcs = [
        PathSegment((center, (rx, 0.0), (0.0, ry)), (i - 1) * math.pi / 2, math.pi / 2)
        for i, center in enumerate(centers)
    ]
    for arc, following in zip(arcs, (*arcs[1:], arcs[0]), strict=True):
        yield arc
        if math.dist(arc.at(1.0), following.at(0.0)) > 1e-12 * (width + height):
            yield PathSegment((arc.at(1.0), following.at(0.0)))


def _name(element: ET.Element) -> str | None:
    """Return the name of an element; None if it was not named."""
    classes = element.get("class", "").split()
    for text in (element.get(LABEL), classes[0] if classes else None, element.get("id")):
        if text and not GENERATED_NAME.fullmatch(text.strip()):
            return face_name(text)
    return None


def _is_hidden(element: ET.Element) -> bool:
    style = element.get("style", "").replace(" ", "")
    return element.get("display") == "none" or "display:none" in style


def _number(data: Mapping[str, str], key: str) -> float:
    """Return the number in an attribute, in user units; 0 if the attribute is missing."""
    text = data.get(key, "0").strip().removesuffix("px")
    try:
        number = float(text)
    except ValueError:
        raise DataError(f"drawing: {key}", value=text, limit="must be a number without a unit") from None
    return coordinate(number, key)


def _tag(element: ET.Element) -> str:
    return str(element.tag).rpartition("}")[2]
