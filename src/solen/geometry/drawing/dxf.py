"""Drawings from CAD programs: DXF, with faces named by layers and the unit in the header.

Lines, arcs, circles, ellipses, polylines with bulges, splines and blocks are supported. A non-rational spline of up to
degree 3 is read exactly as its Bézier segments; an ellipse, a rational spline or a spline of higher degree becomes a
spline within `SHAPE_TOLERANCE_MM`. Texts, dimensions and hatches are ignored, and so are layers that are switched off
or frozen.
"""

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Arc, Curve, Segment, Spline, fitted
from solen.errors import DataError
from solen.extras import need
from solen.geometry.drawing.model import (
    EMITTER,
    NO_UNITS_REMEDY,
    UNITS_MM,
    Drawing,
    Lamp,
    Stroke,
    face_name,
    is_aside,
    is_named,
    lamp_name,
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
"""Millimetres per unit of $INSUNITS in the header; 0 means unitless (Autodesk's DXF reference)."""
NOTES = frozenset(
    {"TEXT", "MTEXT", "DIMENSION", "ARC_DIMENSION", "LEADER", "MULTILEADER", "MLEADER", "HATCH", "ATTRIB", "ATTDEF"}
    | {"TOLERANCE", "VIEWPORT", "IMAGE", "WIPEOUT", "XLINE", "RAY", "ACAD_TABLE"}
)
UPRIGHT = 1e-9
JUST_INSIDE = 1.0 - 1e-12
MAX_BLOCKS = 16
"""Maximum nesting depth of blocks."""


def read_dxf(path: Path, units: str | None) -> Drawing:
    """Read the drawing from a text or binary DXF file; raises the errors of `read_drawing`."""
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
        limit = "does not specify its unit" if insunits == 0 else f"has an unsupported unit ({insunits})"
        raise DataError(f"{path}: $INSUNITS", value=insunits, limit=limit, remedy=NO_UNITS_REMEDY)
    return INSUNITS_MM[insunits]


class _Reader:
    """Reader that collects the visible content of the modelspace."""

    def __init__(self, document: Any, scale: float) -> None:
        self._document, self._scale = document, scale
        self._strokes: list[Stroke] = []
        self._lamps: list[Lamp] = []
        self._points: list[tuple[str, Point]] = []

    def drawing(self) -> Drawing:
        """Return all visible content."""
        for entity, layer in self._shown(self._document.modelspace(), "0", 0):
            self._collect(entity, face_name(layer))
        return Drawing(tuple(self._strokes), tuple(self._lamps), tuple(self._points))

    def _shown(self, entities: Iterable[Any], inherited: str, depth: int) -> Iterator[tuple[Any, str]]:
        """Yield entities on visible layers with the layer name; blocks and polylines are exploded."""
        for entity in entities:
            layer = inherited if entity.dxf.layer == "0" else entity.dxf.layer
            if entity.dxftype() in NOTES or not self._visible(layer) or is_aside(face_name(layer)):
                continue
            if entity.dxftype() in ("INSERT", "LWPOLYLINE", "POLYLINE"):
                if depth > MAX_BLOCKS:
                    raise DataError("drawing", value=layer, limit=f"blocks more than {MAX_BLOCKS} deep")
                yield from self._shown(entity.virtual_entities(), layer, depth + 1)
            else:
                yield entity, layer

    def _visible(self, name: str) -> bool:
        layers = self._document.layers
        return name not in layers or not (layers.get(name).is_off() or layers.get(name).is_frozen())

    def _collect(self, entity: Any, name: str) -> None:
        kind, dxf = entity.dxftype(), entity.dxf
        if kind == "POINT":
            point = self._at(dxf.location)
            if is_named(name, EMITTER):
                self._lamps.append(Lamp(point, name=lamp_name(name)))
            else:
                self._points.append((name, point))
            return
        if kind == "LINE" and is_named(name, EMITTER):
            self._lamps.append(Lamp(self._at(dxf.start), self._at(dxf.end), name=lamp_name(name)))
            return
        curve = self._curve(entity)
        if curve is not None:
            self._strokes.append(
                Stroke(name, curve, f"{kind} {dxf.handle or ''} on layer {dxf.layer}".replace("  ", " "))
            )

    def _curve(self, entity: Any) -> Curve | None:
        """Return the curve of an entity; None if its length is zero."""
        kind, dxf = entity.dxftype(), entity.dxf
        if kind == "LINE":
            a, b = self._at(dxf.start), self._at(dxf.end)
            return Segment(a, b) if a != b else None
        if kind in ("ARC", "CIRCLE"):
            return self._arc(entity)
        if kind == "ELLIPSE":
            tool = entity.construction_tool()
            u, v = self._at(tool.major_axis), self._at(tool.minor_axis)
            sweep = (tool.end_param - tool.start_param) % math.tau or math.tau
            return ellipse(self._at(tool.center), u, v, tool.start_param, sweep)
        if kind == "SPLINE":
            return self._spline(entity.construction_tool())
        limit = "is not understood"
        where = f"{kind} {dxf.handle} on layer {dxf.layer}"
        raise DataError(
            "drawing", value=where, limit=limit, remedy="convert it to lines, arcs or splines, or hide its layer"
        )

    def _arc(self, entity: Any) -> Arc:
        """Return an arc, mirrored if its plane faces away from the viewer."""
        dxf, across = entity.dxf, entity.dxf.extrusion
        if abs(across.x) > UPRIGHT or abs(across.y) > UPRIGHT:
            limit = "is not drawn in the x-y plane"
            raise DataError("drawing", value=_what(entity), limit=limit, remedy="rotate it into this plane")
        center = self._at(entity.ocs().to_wcs(dxf.center))
        start, sweep = 0.0, 360.0
        if entity.dxftype() == "ARC":
            start, sweep = dxf.start_angle, (dxf.end_angle - dxf.start_angle) % 360.0 or 360.0
        if across.z < 0.0:
            start, sweep = 180.0 - start, -sweep
        return Arc(center, self._scale * dxf.radius, start, sweep)

    def _spline(self, tool: Any) -> Curve | None:
        """Bézier segments of a non-rational, at most cubic spline; otherwise fit a spline between its knots."""
        if tool.degree <= 3 and not tool.is_rational and tool.is_clamped:
            return beziers([[self._at(point) for point in piece] for piece in tool.bezier_decomposition()])
        knots = sorted({knot for knot in tool.knots() if tool.knots()[tool.degree] <= knot <= tool.knots()[tool.count]})
        return Spline.chained([self._span(tool, low, high) for low, high in pairwise(knots)])

    def _span(self, tool: Any, low: float, high: float) -> Spline:
        """Spline between two neighbouring knots; at the later knot, the derivative is the limit from this side."""

        def derived(u: FloatArray, n: int) -> FloatArray:
            at = low + np.clip(u, 0.0, JUST_INSIDE) * (high - low)
            return np.array([self._at(row[n]) for row in tool.derivatives(at.tolist(), n)]) * (high - low) ** n

        return fitted(lambda u: derived(u, 0), lambda u: derived(u, 1), SHAPE_TOLERANCE_MM)

    def _at(self, vector: Any) -> Point:
        return (self._scale * float(vector.x), self._scale * float(vector.y))


def _what(entity: Any) -> str:
    """Return the name of an entity in error messages; parts of blocks and polylines have no handle."""
    handle = f" {entity.dxf.handle}" if entity.dxf.handle else ""
    return f"{entity.dxftype()}{handle} on layer {entity.dxf.layer}"
