"""STEP files of exact solids, made with the Open CASCADE kernel (the extra ``cad``), which is loaded only on demand.

Each curve of an outline becomes one edge per primitive (`solen.fabricate.bspline`): lines, arcs and B-splines in the
plane of the build plate; adjacent edges share exactly one corner point. Extrusion gives planes, cylinders and surfaces
of extrusion, so a CAD program receives exact curves, not facets. Faces have the names of the faces of the body, ``top``
or ``bottom``; faces that result from a cut have the name of the cut. A layered part has one solid for each layer; the
smooth face of a lens that varies with height is one B-spline surface.
"""

import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Segment
from solen.errors import DesignError, OutputError
from solen.extras import need
from solen.fabricate.bspline import Bspline, Primitive, primitives
from solen.fabricate.label import WRITER, Label, ascii_of
from solen.fabricate.lens_parts import FRONT_GAP_MM, FacedPart, Hollow, StackedPart
from solen.fabricate.part import Cut, Part, Prism
from solen.geometry import Face
from solen.plane import Point

SCHEMA = "AP214IS"
TIME = "1970-01-01T00:00:00"
"""Time in the header, which is mandatory; it is fixed so that the same design always gives the same file."""
MAX_TEXT_LENGTH = 200
Named = list[tuple[Any, str]]
"""Kernel faces with their names."""


def check_kernel() -> None:
    """Raise `OutputError` if the kernel is not installed."""
    need("OCP", what="--step", doing="writing STEP")


def as_step(part: Part, label: Label) -> bytes:
    """Return a STEP file (ISO 10303-21, AP214) of a part, in mm.

    Raises
    ------
    OutputError
        If the kernel is not installed, or fails to write.
    DesignError
        If the kernel cannot make a valid solid from the outlines.
    """
    check_kernel()
    with _silence():
        solid, named = _solid(part)
        return _written(solid, named, label)


def _solid(part: Part) -> tuple[Any, Named]:
    """Return the part as a kernel shape, with the names of its faces."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse
    from OCP.BRepCheck import BRepCheck_Analyzer

    if isinstance(part, StackedPart):
        return _stack(part)
    solid, named = _prism(part.prisms[0], part.prisms[0].name)
    operations = [(BRepAlgoAPI_Fuse, prism, "") for prism in part.prisms[1:]]
    operations += [(BRepAlgoAPI_Cut, cut.tool, cut.name) for cut in part.cuts]
    tools = [(operation, *_prism(prism, prism.name, name), prism.name) for operation, prism, name in operations]
    if isinstance(part, FacedPart):
        tools.append((BRepAlgoAPI_Cut, *_hollow(part.hollow), "lens"))
    for operation, tool, tool_named, name in tools:
        result = operation(solid, tool)
        if not result.IsDone():
            raise _no_solid(part, name)
        solid = result.Shape()
        named = [(new, label) for face, label in (*named, *tool_named) for new in _resulting_faces(result, face)]
    if not BRepCheck_Analyzer(solid).IsValid():
        raise _no_solid(part, "its faces")
    return solid, named


def _no_solid(part: Part, what: str) -> DesignError:
    limit = f"the CAD kernel cannot make a valid solid with {what}"
    return DesignError(part.name, limit=limit, remedy="simplify the outline, or export a mesh")


def _resulting_faces(operation: Any, face: Any) -> list[Any]:
    """Return the faces that an operation made from a face: none if it was removed, or the face itself if unchanged."""
    return [] if operation.IsDeleted(face) else list(operation.Modified(face)) or [face]


def _stack(part: StackedPart) -> tuple[Any, Named]:
    """Return the layers as separate solids, minus the cuts."""
    solids, named = [], []
    for prism in part.prisms:
        cuts = tuple(cut for cut in part.cuts if prism.from_mm < cut.tool.to_mm and cut.tool.from_mm < prism.to_mm)
        solid, faces = _solid(Part(prism.name, (prism,), tuple(_within(cut, prism) for cut in cuts)))
        solids.append(solid)
        named += faces
    return _compound(solids), named


def _within(cut: Cut, prism: Prism) -> Cut:
    """Return the part of a cut within the height of a layer."""
    low, high = max(cut.removed.from_mm, prism.from_mm), min(cut.removed.to_mm, prism.to_mm)
    return replace(cut, removed=replace(cut.removed, from_mm=low, to_mm=high))


def _hollow(hollow: Hollow) -> tuple[Any, Named]:
    """Return the space in front of a smooth face: its surface, extruded towards the emitter."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
    from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
    from OCP.gp import gp_Vec

    face = BRepBuilderAPI_MakeFace(_surface(*hollow.fitted()), 1e-7).Face()
    extrusion = BRepPrimAPI_MakePrism(
        face, gp_Vec(0.0, -(hollow.lens.deepest_mm - hollow.front_mm + FRONT_GAP_MM), 0.0)
    )
    if not extrusion.IsDone():
        raise DesignError("lens", limit="the CAD kernel cannot extrude its face", remedy="export a mesh")
    return extrusion.Shape(), [(extrusion.FirstShape(), "lens")]


def _surface(control: FloatArray, *knots: FloatArray) -> Any:
    """Return a B-spline surface of the kernel."""
    from OCP.collections import Array2_gp_Pnt
    from OCP.Geom import Geom_BSplineSurface
    from OCP.gp import gp_Pnt

    rows, columns = control.shape[:2]
    points = Array2_gp_Pnt(1, rows, 1, columns)
    for i in range(rows):
        for j in range(columns):
            points.SetValue(i + 1, j + 1, gp_Pnt(*control[i, j].tolist()))
    (u, u_counts), (v, v_counts) = (_knots(*np.unique(vector, return_counts=True)) for vector in knots)
    return Geom_BSplineSurface(points, u, v, u_counts, v_counts, 3, 3, False, False)


def _prism(prism: Prism, name: str, face_name: str = "") -> tuple[Any, Named]:
    """Return a prism as one shape, with the names of its faces; ``face_name`` replaces them all."""
    from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
    from OCP.gp import gp_Vec

    named: Named = []
    solids = []
    for region in _regions(prism):
        base, edges = _face(region, prism.from_mm)
        extrusion = BRepPrimAPI_MakePrism(base, gp_Vec(0.0, 0.0, prism.height_mm))
        if not extrusion.IsDone():
            raise DesignError(name, limit="the CAD kernel cannot extrude it")
        solids.append(extrusion.Shape())
        named += [(extrusion.FirstShape(), "bottom"), (extrusion.LastShape(), "top")]
        named += [(side, edge_name) for edge, edge_name in edges for side in extrusion.Generated(edge)]
    named = [(face, face_name or label) for face, label in named]
    return (solids[0] if len(solids) == 1 else _compound(solids)), named


def _compound(solids: list[Any]) -> Any:
    """Combine solids into one shape."""
    from OCP.BRep import BRep_Builder
    from OCP.TopoDS import TopoDS_Compound

    compound, builder = TopoDS_Compound(), BRep_Builder()
    builder.MakeCompound(compound)
    for solid in solids:
        builder.Add(compound, solid)
    return compound


def _regions(prism: Prism) -> list[list[tuple[Face, ...]]]:
    """Return the outlines of each region: its outer outline, then the holes directly inside it."""
    import shapely

    polygons = [shapely.Polygon(ring) for ring in prism.rings(1e-3)]
    around = [
        [k for k, outer in enumerate(polygons) if k != i and outer.contains(inner)] for i, inner in enumerate(polygons)
    ]
    regions = {i: [prism.outlines[i]] for i, outer in enumerate(around) if len(outer) % 2 == 0}
    for i, outer in enumerate(around):
        if len(outer) % 2:
            owner = max((k for k in outer if k in regions), key=lambda k: len(around[k]))
            regions[owner].append(prism.outlines[i])
    return list(regions.values())


def _face(outlines: list[tuple[Face, ...]], height_mm: float) -> tuple[Any, Named]:
    """Return the plane face within outlines at a height, and its named edges."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
    from OCP.gp import gp_Dir, gp_Pln, gp_Pnt

    plane = gp_Pln(gp_Pnt(0.0, 0.0, height_mm), gp_Dir(0.0, 0.0, 1.0))
    named: Named = []
    builder = None
    for outline in outlines:
        wire, edges = _wire(outline, height_mm)
        named += edges
        if builder is None:
            builder = BRepBuilderAPI_MakeFace(plane, wire, True)
        else:
            builder.Add(wire)
    if builder is None or not builder.IsDone():
        raise DesignError(outlines[0][0].name, limit="the CAD kernel cannot make a face from its outline")
    return builder.Face(), named


def _wire(outline: tuple[Face, ...], height_mm: float) -> tuple[Any, Named]:
    """Return the closed wire of an outline; each corner is one vertex, owned by the curve that starts there."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeVertex, BRepBuilderAPI_MakeWire

    pieces = [(piece, face.name) for face in outline for piece in primitives(face.curve)]
    corners = [BRepBuilderAPI_MakeVertex(_point(piece.start, height_mm)).Vertex() for piece, _ in pieces]
    wire, named = BRepBuilderAPI_MakeWire(), []
    for i, (piece, name) in enumerate(pieces):
        curve, length = _curve(piece, height_mm)
        edge = BRepBuilderAPI_MakeEdge(curve, corners[i], corners[(i + 1) % len(corners)], 0.0, length)
        if not edge.IsDone():
            raise DesignError(
                name, limit="the CAD kernel cannot make an edge of it", remedy="simplify the outline there"
            )
        wire.Add(edge.Edge())
        named.append((edge.Edge(), name))
    if not wire.IsDone():
        raise DesignError(outline[0].name, limit="the CAD kernel cannot join its outline")
    return wire.Wire(), named


def _point(point: Point, height_mm: float) -> Any:
    from OCP.gp import gp_Pnt

    return gp_Pnt(*point, height_mm)


def _curve(piece: Primitive, height_mm: float) -> tuple[Any, float]:
    """Return a kernel curve and its last parameter; the first is 0."""
    from OCP.Geom import Geom_Circle, Geom_Line
    from OCP.gp import gp_Ax2, gp_Dir

    if isinstance(piece, Bspline):
        return _bspline(piece, height_mm), 1.0
    if isinstance(piece, Segment):
        (x, z), length = piece.end, piece.length_mm
        direction = gp_Dir((x - piece.start[0]) / length, (z - piece.start[1]) / length, 0.0)
        return Geom_Line(_point(piece.start, height_mm), direction), length
    begin = math.radians(piece.start_deg)
    normal = gp_Dir(0.0, 0.0, math.copysign(1.0, piece.sweep_deg))
    axes = gp_Ax2(_point(piece.center, height_mm), normal, gp_Dir(math.cos(begin), math.sin(begin), 0.0))
    return Geom_Circle(axes, piece.radius_mm), math.radians(abs(piece.sweep_deg))


def _bspline(piece: Bspline, height_mm: float) -> Any:
    from OCP.collections import Array1_gp_Pnt
    from OCP.Geom import Geom_BSplineCurve

    points = Array1_gp_Pnt(1, len(piece.points))
    for i, point in enumerate(piece.points, start=1):
        points.SetValue(i, _point(point, height_mm))
    return Geom_BSplineCurve(points, *_knots(piece.knots, piece.multiplicities), piece.degree)


def _knots(values: Iterable[float], multiplicities: Iterable[int]) -> tuple[Any, Any]:
    """Return the knots and their multiplicities as arrays of the kernel."""
    from OCP.collections import Array1_double, Array1_int

    pairs = list(zip(values, multiplicities, strict=True))
    knots, counts = Array1_double(1, len(pairs)), Array1_int(1, len(pairs))
    for i, (knot, count) in enumerate(pairs, start=1):
        knots.SetValue(i, float(knot))
        counts.SetValue(i, int(count))
    return knots, counts


def _written(solid: Any, named: Named, label: Label) -> bytes:
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.Interface import Interface_Static
    from OCP.STEPConstruct import STEPConstruct
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer

    writer = STEPControl_Writer()
    Interface_Static.SetCVal_s("write.step.schema", SCHEMA)
    Interface_Static.SetCVal_s("write.step.unit", "MM")
    if writer.Transfer(solid, STEPControl_AsIs) != IFSelect_RetDone:
        raise OutputError("--step", limit="the CAD kernel cannot translate the solid")
    process = writer.WS().TransferWriter().FinderProcess()
    for face, name in named:
        item = STEPConstruct.FindEntity_s(process, face)
        if item is not None:
            item.SetName(_text(name))
    _head(writer.Model(), label)
    with TemporaryDirectory() as folder:
        target = Path(folder) / "part.step"
        if writer.Write(str(target)) != IFSelect_RetDone:
            raise OutputError("--step", limit="the CAD kernel cannot write the file")
        return target.read_bytes()


def _head(model: Any, label: Label) -> None:
    """Set the header and the product: name and description of the design, and solen as the originating system."""
    from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
    from OCP.StepBasic import StepBasic_Product

    name = _text(label.name)
    head = APIHeaderSection_MakeHeader(model)
    head.SetName(name)
    head.SetDescriptionValue(1, _text("; ".join(label.lines[2:])))
    head.SetAuthorValue(1, _text(""))
    head.SetOrganizationValue(1, _text(""))
    head.SetAuthorisation(_text(""))
    head.SetOriginatingSystem(_text(WRITER))
    head.SetTimeStamp(_text(TIME))
    entities = (model.Entity(number) for number in range(1, model.NbEntities() + 1))
    products = [entity for entity in entities if isinstance(entity, StepBasic_Product)]
    for number, product in enumerate(products):  # the first is the whole part; others are its solids, if it has several
        product_name = _text(f"{label.name} {number}") if number else name
        product.SetId(product_name)
        product.SetName(product_name)


def _text(text: str) -> Any:
    from OCP.TCollection import TCollection_HAsciiString

    return TCollection_HAsciiString(ascii_of(text, MAX_TEXT_LENGTH))


@contextmanager
def _silence() -> Iterator[None]:
    """Keep kernel messages off stdout, which is reserved for command output."""
    from OCP.Message import Message, Message_Gravity

    printers = list(Message.DefaultMessenger_s().Printers())
    levels = [printer.GetTraceLevel() for printer in printers]
    for printer in printers:
        printer.SetTraceLevel(Message_Gravity.Message_Fail)
    try:
        yield
    finally:
        for printer, level in zip(printers, levels, strict=True):
            printer.SetTraceLevel(level)
