"""Drawings from vector graphics programs: SVG, with faces named by the labels, classes or ids of elements.

The name of a face is taken from the Inkscape label of an element, its class or its id (unless a program generated the
id, for example ``path12``), otherwise from those of the enclosing groups. Paths (all commands), lines, polylines,
polygons, rectangles, circles and ellipses are supported, with groups, transforms and clones. Lines, circular arcs and
Bézier segments are read exactly, and smoothly joined Bézier segments of a path as one spline; an ellipse becomes a
spline within `SHAPE_TOLERANCE_MM`. The y axis of SVG, which points down, becomes −z.
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
    Lamp,
    Stroke,
    face_name,
    is_aside,
    is_named,
    lamp_name,
)
from solen.geometry.drawing.path import NUMBER, Piece, coordinate, path_pieces
from solen.geometry.drawing.shapes import beziers, ellipse
from solen.geometry.drawing.transform import Affine
from solen.plane import Point, cross, dot, minus

LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
GENERATED = re.compile(r"(path|rect|circle|ellipse|line|polyline|polygon|g|group|layer|svg|use|shape)[-_\d]*", re.I)
INVISIBLE = frozenset(
    {"defs", "symbol", "clipPath", "mask", "marker", "pattern", "linearGradient", "radialGradient", "filter", "style"}
    | {"title", "desc", "metadata", "namedview", "text", "script", "image", "foreignObject", "switch"}
)
GROUPS = frozenset({"g", "a", "use"})
LENGTH_MM = {"mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72, "pc": 25.4 / 6, "Q": 0.25}
PIXEL_MM = 25.4 / 96
"""Length of a user unit in a drawing without a view box."""
MAX_CLONES = 16
SMOOTH = 1e-3
"""Maximum angle in radians of a smooth joint between Bézier segments; smooth nodes written by programs are within
it.
"""


def read_svg(path: Path, units: str | None) -> Drawing:
    """Read the drawing from an SVG file; raises the errors of `read_drawing`."""
    try:
        root = ET.fromstring(read_text(path, DataError))  # noqa: S314  expat limits the expansion of entities
    except ET.ParseError as bad:
        raise DataError(str(path), limit=f"not SVG: {bad}") from None
    if _tag(root) != "svg":
        raise DataError(str(path), value=_tag(root), limit="must be an SVG file with the root element svg")
    scale = _scale(path, root, units)
    return _Reader(root, str(path)).drawing(Affine(scale, 0.0, 0.0, -scale))


def _scale(path: Path, root: ET.Element, units: str | None) -> float:
    """Return millimetres per user unit, from the width in mm or inches and the view box."""
    if units is not None:
        return UNITS_MM[units]
    box = [float(number) for number in NUMBER.findall(root.get("viewBox", ""))]
    scale = []
    for key, place in (("width", 2), ("height", 3)):
        length = re.fullmatch(r"\s*([-+.\deE]+?)\s*([a-zA-Z]+)\s*", root.get(key, ""))
        if length and length[2] in LENGTH_MM:
            whole_mm = float(length[1]) * LENGTH_MM[length[2]]
            if len(box) == 4 and not box[place] > 0.0:
                raise DataError(f"{path}: viewBox", value=root.get("viewBox"), limit="must have a size above 0")
            scale.append(whole_mm / box[place] if len(box) == 4 else PIXEL_MM)
    if not scale:
        limit = "does not specify its unit: neither width nor height is in mm, cm, in or pt"
        raise DataError(f"{path}: width", value=root.get("width"), limit=limit, remedy=NO_UNITS_REMEDY)
    if abs(scale[0] - scale[-1]) > 1e-3 * scale[0]:
        limit = "distorts the drawing: width and height are scaled differently from the view box"
        raise DataError(f"{path}: viewBox", value=root.get("viewBox"), limit=limit, remedy="make them fit")
    return scale[0]


class _Reader:
    """Reader that collects the visible content of an SVG file."""

    def __init__(self, root: ET.Element, where: str) -> None:
        self._root, self._where = root, where
        self._by_id = {element.get("id"): element for element in root.iter() if element.get("id")}
        self._strokes: list[Stroke] = []
        self._lamps: list[Lamp] = []
        self._points: list[tuple[str, Point]] = []

    def drawing(self, onto: Affine) -> Drawing:
        """Return all visible content, in the coordinates to which user units are mapped."""
        self._children(self._root, onto, WALL, 0)
        return Drawing(tuple(self._strokes), tuple(self._lamps), tuple(self._points))

    def _children(self, parent: ET.Element, onto: Affine, name: str, depth: int) -> None:
        for element in parent:
            if isinstance(element.tag, str):
                self._element(element, onto, name, depth)

    def _element(self, element: ET.Element, onto: Affine, inherited: str, depth: int) -> None:
        tag, name = _tag(element), _name(element) or inherited
        if tag in INVISIBLE or is_aside(name) or _hidden(element):
            return
        onto = onto.after(Affine.of(element.get("transform", ""), self._where))
        if tag in GROUPS:
            self._children(element, onto, name, depth)
            if tag == "use":
                self._clone(element, onto, name, depth)
            return
        what = f"{tag} {element.get('id', '')}".strip()
        if tag == "svg":
            raise DataError(f"{self._where}: {what}", limit="a nested svg element is not supported")
        self._collect(
            name, what, _pieces(element, f"{self._where}: {what}"), onto, is_round=tag in ("circle", "ellipse")
        )

    def _clone(self, element: ET.Element, onto: Affine, name: str, depth: int) -> None:
        target = next((element.get(key) for key in HREFS if element.get(key)), "")
        original = self._by_id.get((target or "").removeprefix("#"))
        if original is None or depth > MAX_CLONES:
            raise DataError(f"{self._where}: use", value=target, limit="must refer to another element of the drawing")
        shift = Affine(1.0, 0.0, 0.0, 1.0, _number(element.attrib, "x"), _number(element.attrib, "y"))
        self._element(original, onto.after(shift), name, depth + 1)

    def _collect(self, name: str, what: str, pieces: list[Piece], onto: Affine, *, is_round: bool) -> None:
        """Collect a mark, an emitter, or the strokes of one element."""
        placed = [piece.moved(onto) for piece in pieces]
        if not placed:
            raise DataError(
                f"{self._where}: {what}", value=name, limit="has no size", remedy="give it one or remove it"
            )
        if is_round and is_named(name, "pivot"):
            self._points.append((name, placed[0].points[0]))
        elif is_round and is_named(name, EMITTER):
            self._lamps.append(Lamp(placed[0].points[0], name=lamp_name(name)))
        elif is_named(name, EMITTER) and len(placed) == 1 and len(placed[0].points) == 2:
            self._lamps.append(Lamp(placed[0].points[0], placed[0].points[1], name=lamp_name(name)))
        else:
            curves = (_curve(run) for run in _runs(placed))
            self._strokes += [Stroke(name, curve, what) for curve in curves if curve is not None]


def _curve(run: list[Piece]) -> Curve | None:
    """Curve of smoothly joined Bézier segments, or of one segment of another kind; None if its length is zero."""
    piece = run[0]
    if piece.sweep is None:
        return beziers([piece.points for piece in run])
    center, u, v = piece.points
    return ellipse(center, u, v, piece.start, piece.sweep)


def _runs(pieces: list[Piece]) -> list[list[Piece]]:
    """Group path segments into runs that each form one curve: curved Bézier segments as long as they join smoothly."""
    runs: list[list[Piece]] = []
    for piece in pieces:
        if runs and _goes_on(runs[-1][-1], piece):
            runs[-1].append(piece)
        else:
            runs.append([piece])
    return runs


def _goes_on(before: Piece, after: Piece) -> bool:
    if before.sweep is not None or after.sweep is not None or min(len(before.points), len(after.points)) < 3:
        return False
    arrives, leaves = minus(before.points[-1], before.points[-2]), minus(after.points[1], after.points[0])
    turn = math.atan2(abs(cross(arrives, leaves)), dot(arrives, leaves))
    return (
        before.points[-1] == after.points[0]
        and 0.0 not in (math.hypot(*arrives), math.hypot(*leaves))
        and turn < SMOOTH
    )


def _pieces(element: ET.Element, where: str) -> list[Piece]:
    """Return the segments of a shape, in its own coordinates."""
    tag, data = _tag(element), element.attrib
    if tag == "path":
        return list(path_pieces(data.get("d", ""), where))
    if tag == "line":
        return [Piece(((_number(data, "x1"), _number(data, "y1")), (_number(data, "x2"), _number(data, "y2"))))]
    if tag in ("polyline", "polygon"):
        numbers = [
            float(number) for number in re.findall(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", data.get("points", ""))
        ]
        corners = list(zip(numbers[::2], numbers[1::2], strict=False))
        return _between(corners, closed=tag == "polygon")
    if tag in ("circle", "ellipse"):
        rx, ry = (_number(data, key) for key in (("r", "r") if tag == "circle" else ("rx", "ry")))
        center = (_number(data, "cx"), _number(data, "cy"))
        return [Piece((center, (rx, 0.0), (0.0, ry)), 0.0, math.tau)] if rx > 0.0 and ry > 0.0 else []
    if tag == "rect":
        return list(_rectangle(data))
    raise DataError(where, limit="is not supported", remedy="convert it to a path")


def _between(corners: list[Point], *, closed: bool) -> list[Piece]:
    following = [*corners[1:], corners[0]] if closed and corners else corners[1:]
    return [Piece((a, b)) for a, b in zip(corners, following, strict=False) if a != b]


def _rectangle(data: Mapping[str, str]) -> Iterator[Piece]:
    """Return the sides of a rectangle and its rounded corners."""
    x, y, width, height = (_number(data, key) for key in ("x", "y", "width", "height"))
    rx, ry = _number(data, "rx") or _number(data, "ry"), _number(data, "ry") or _number(data, "rx")
    rx, ry = min(rx, width / 2), min(ry, height / 2)
    if rx <= 0.0 or ry <= 0.0:
        yield from _between([(x, y), (x + width, y), (x + width, y + height), (x, y + height)], closed=True)
        return
    middles = ((x + width - rx, y + ry), (x + width - rx, y + height - ry), (x + rx, y + height - ry), (x + rx, y + ry))
    arcs = [
        Piece((middle, (rx, 0.0), (0.0, ry)), (i - 1) * math.pi / 2, math.pi / 2) for i, middle in enumerate(middles)
    ]
    for arc, following in zip(arcs, (*arcs[1:], arcs[0]), strict=True):
        yield arc
        if math.dist(arc.at(1.0), following.at(0.0)) > 1e-12 * (width + height):
            yield Piece((arc.at(1.0), following.at(0.0)))


def _name(element: ET.Element) -> str | None:
    """Return the name of an element, if it was named."""
    classes = element.get("class", "").split()
    for text in (element.get(LABEL), classes[0] if classes else None, element.get("id")):
        if text and not GENERATED.fullmatch(text.strip()):
            return face_name(text)
    return None


def _hidden(element: ET.Element) -> bool:
    style = element.get("style", "").replace(" ", "")
    return element.get("display") == "none" or "display:none" in style


def _number(data: Mapping[str, str], key: str) -> float:
    """Return the number in an attribute in user units, 0 if it is missing."""
    text = data.get(key, "0").strip().removesuffix("px")
    try:
        number = float(text)
    except ValueError:
        raise DataError(f"drawing: {key}", value=text, limit="must be a number without a unit") from None
    return coordinate(number, key)


def _tag(element: ET.Element) -> str:
    return str(element.tag).rpartition("}")[2]
