"""Drawings from CAD programs: DXF, in which layers name the faces and the header contains the unit.

Lines, arcs, circles, ellipses, polylines with bulges, splines and blocks are supported. A non-rational spline of up to
degree 3 is read exactly as its Bézier segments; an ellipse, a rational spline or a spline of higher degree becomes a
spline within `SHAPE_TOLERANCE_MM`. Text, dimensions and hatches are ignored, and so are layers that are switched off
or frozen.
"""

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Arc, Curve, Segment, Spline, fitted_spline
from solen.errors import DataError
from solen.extras import need
from solen.geometry.drawing.model import (
    EMITTER,
    NO_UNITS_REMEDY,
    UNITS_MM,
    Drawing,
    DrawnEmitter,
    Stroke,
    emitter_name,
    face_name,
    is_annotation,
    is_called,
)
from solen.geometry.drawing.shapes import SHAPE_TOLERANCE_MM, beziers, ellipse
from solen.plane import Point

INSUNITS_MM = {
    1: 25.4,
    2: 304.8,
    3: 1_609_344.0,
    4: 1.0,
    5: 10.0,
    6: 1e3,
    7: 1e6,
    8: 25.4e-6,
    9: 25.4e-3,
    10: 914.4,
    11: 1e-7,
    12: 1e-6,
    13: 1e-3,
    14: 100.0,
    15: 1e4,
    16: 1e5,
}
"""Millimetres per unit, keyed by $INSUNITS of the header; 0 means unitless (Autodesk's DXF reference)."""
ANNOTATIONS = frozenset(
    {"TEXT", "MTEXT", "DIMENSION", "ARC_DIMENSION", "LEADER", "MULTILEADER", "MLEADER", "HATCH", "ATTRIB", "ATTDEF"}
    | {"TOLERANCE", "VIEWPORT", "IMAGE", "WIPEOUT", "XLINE", "RAY", "ACAD_TABLE"}
)
MAX_TILT = 1e-9
BEFORE_END = 1.0 - 1e-12
MAX_BLOCK_DEPTH = 16
"""Maximum nesting depth of blocks."""


def read_dxf(path: Path, units: str | None) -> Drawing:
    """Read a drawing from a text or binary DXF file; raise the errors of `read_drawing`."""
    need("ezdxf", what=str(path), doing="reading DXF", error=DataError)
    from ezdxf import recover
    from ezdxf.lldxf.const import DXFError

    try:
        document, _ = recover.readfile(path)
    except (OSError, DXFError) as bad:
        raise DataError(str(path), limit=f"cannot be read as DXF: {bad}") from None
    return _Reader(document, _scale(path, document.header.get("$INSUNITS", 0), units)).drawing()


def _scale(path: Path, insunits: int, units: str | None) -> float:
    """Return millimetres per drawing unit."""
    if units is not None:
        return UNITS_MM[units]
    if insunits not in INSUNITS_MM:
        limit = "the drawing does not specify its unit" if insunits == 0 else "is the number of an unsupported unit"
        raise DataError(f"{path}: $INSUNITS", value=insunits, limit=limit, remedy=NO_UNITS_REMEDY)
    return INSUNITS_MM[insunits]


class _Reader:
    """A reader that collects the visible content of the modelspace."""

    def __init__(self, document: Any, scale: float) -> None:
        self._document, self._scale = document, scale
        self._strokes: list[Stroke] = []
        self._emitters: list[DrawnEmitter] = []
        self._points: list[tuple[str, Point]] = []

    def drawing(self) -> Drawing:
        """Return all visible content."""
        for entity, layer in self._visible_entities(self._document.modelspace(), "0", 0):
            self._collect(entity, face_name(layer))
        return Drawing(tuple(self._strokes), tuple(self._emitters), tuple(self._points))

    def _visible_entities(self, entities: Iterable[Any], inherited: str, depth: int) -> Iterator[tuple[Any, str]]:
        """Yield the entities on visible layers with their layer; blocks and polylines are exploded."""
        for entity in entities:
            layer = inherited if entity.dxf.layer == "0" else entity.dxf.layer
            if entity.dxftype() in ANNOTATIONS or not self._is_visible(layer) or is_annotation(face_name(layer)):
                continue
            if entity.dxftype() in ("INSERT", "LWPOLYLINE", "POLYLINE"):
                if depth > MAX_BLOCK_DEPTH:
                    limit = f"contains blocks nested more than {MAX_BLOCK_DEPTH} levels deep"
                    raise DataError("drawing layer", value=layer, limit=limit, remedy="explode the blocks")
                yield from self._visible_entities(entity.virtual_entities(), layer, depth + 1)
            else:
                yield entity, layer

    def _is_visible(self, name: str) -> bool:
        layers = self._document.layers
        return name not in layers or not (layers.get(name).is_off() or layers.get(name).is_frozen())

    def _collect(self, entity: Any, name: str) -> None:
        kind, dxf = entity.dxftype(), entity.dxf
        if kind == "POINT":
            point = self._point(dxf.location)
            if is_called(name, EMITTER):
                self._emitters.append(DrawnEmitter(point, name=emitter_name(name)))
            else:
                self._points.append((name, point))
            return
        if kind == "LINE" and is_called(name, EMITTER):
            self._emitters.append(DrawnEmitter(self._point(dxf.start), self._point(dxf.end), name=emitter_name(name)))
            return
        curve = self._curve(entity)
        if curve is not None:
            self._strokes.append(Stroke(name, curve, _label(entity)))

    def _curve(self, entity: Any) -> Curve | None:
        """Return the curve of an entity; None if its length is zero."""
        kind, dxf = entity.dxftype(), entity.dxf
        if kind == "LINE":
            a, b = self._point(dxf.start), self._point(dxf.end)
            return Segment(a, b) if a != b else None
        if kind in ("ARC", "CIRCLE"):
            return self._arc(entity)
        if kind == "ELLIPSE":
            tool = entity.construction_tool()
            u, v = self._point(tool.major_axis), self._point(tool.minor_axis)
            sweep = (tool.end_param - tool.start_param) % math.tau or math.tau
            return ellipse(self._point(tool.center), u, v, tool.start_param, sweep)
        if kind == "SPLINE":
            return self._spline(entity.construction_tool())
        remedy = "convert it to lines, arcs or splines, or hide its layer"
        raise DataError("drawing", value=_label(entity), limit="is not supported", remedy=remedy)

    def _arc(self, entity: Any) -> Arc:
        """Return an arc or a circle, mirrored if its plane faces away from the viewer."""
        dxf, normal = entity.dxf, entity.dxf.extrusion
        if abs(normal.x) > MAX_TILT or abs(normal.y) > MAX_TILT:
            limit = "is not drawn in the x-y plane"
            raise DataError("drawing", value=_label(entity), limit=limit, remedy="rotate it into this plane")
        center = self._point(entity.ocs().to_wcs(dxf.center))
        start, sweep = 0.0, 360.0
        if entity.dxftype() == "ARC":
            start, sweep = dxf.start_angle, (dxf.end_angle - dxf.start_angle) % 360.0 or 360.0
        if normal.z < 0.0:
            start, sweep = 180.0 - start, -sweep
        return Arc(center, self._scale * dxf.radius, start, sweep)

    def _spline(self, tool: Any) -> Curve | None:
        """Return the exact Bézier segments of a non-rational spline of up to degree 3; fit a spline to any other."""
        if tool.degree <= 3 and not tool.is_rational and tool.is_clamped:
            return beziers([[self._point(point) for point in piece] for piece in tool.bezier_decomposition()])
        knots = sorted({knot for knot in tool.knots() if tool.knots()[tool.degree] <= knot <= tool.knots()[tool.count]})
        return Spline.chained([self._span(tool, low, high) for low, high in pairwise(knots)])

    def _span(self, tool: Any, low: float, high: float) -> Spline:
        """Return the spline fitted between two neighbouring knots, with the left-hand derivative at the later one."""

        def derivative(u: FloatArray, n: int) -> FloatArray:
            knots = low + np.clip(u, 0.0, BEFORE_END) * (high - low)
            return np.array([self._point(row[n]) for row in tool.derivatives(knots.tolist(), n)]) * (high - low) ** n

        return fitted_spline(lambda u: derivative(u, 0), lambda u: derivative(u, 1), SHAPE_TOLERANCE_MM)

    def _point(self, vector: Any) -> Point:
        return (self._scale * float(vector.x), self._scale * float(vector.y))


def _label(entity: Any) -> str:
    """Return the name of an entity for messages; parts of blocks and polylines have no handle."""
    handle = f" {entity.dxf.handle}" if entity.dxf.handle else ""
    return f"{entity.dxftype()}{handle} on layer {entity.dxf.layer}"
