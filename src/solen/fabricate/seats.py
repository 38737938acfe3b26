"""Seats for the electronics: pockets for the receiver packages, and slots for film supports.

A pocket is cut into a receiver face, centred on its midpoint, with the longer side of the package along the face and
the shorter side along the height; it is as deep as the package unless a depth is specified. A slot is cut into the top,
as deep as the film is thick: at a receiver, from the face inwards; at the emitter, through the top of the lens into the
stem. The film fits the slot and thereby centres the component mounted on it. The underside has no slots, because the
long exposures of the first layers would close them.

A mark is a round dimple in the top of the left arm. Without it, a print of a symmetric design is its own mirror image,
and a photograph does not show which face is visible and which receiver was drawn on the left.

In the sensor of the paper, the parts are glued to films 0.1 mm thick at the extremities; the figure with the details is
not public, so the shape of these seats is a choice of solen.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq

from solen.curve import Arc, Curve, Segment
from solen.errors import DataError, DesignError
from solen.fabricate.lens_parts import faced_part
from solen.fabricate.part import Cut, Part, Prism, sensor_prism
from solen.geometry import Body, Face
from solen.geometry.body import point_text
from solen.parts import ReceiverPart, library_part, load_part
from solen.plane import Point, along, left_of, minus, unit
from solen.spec import Design
from solen.spec.strict import Options

OVERHANG_MM = 0.5
"""Overhang of a tool beyond the surface that it cuts."""
MARK_MM, MARK_DEPTH_MM, MARK_DISTANCE_MM = 1.0, 0.2, 0.5
"""Diameter and depth of the mark, and its distance from the receiver face or from the slot in it."""


class SeatOptions(Options):
    """Options that set keys of the ``[fabricate]`` table of a design."""

    pockets: bool = False
    """Cut pockets for the receivers; the same as --set fabricate.pockets=true."""
    slots: bool = False
    """Cut slots for supporting films at receivers and emitter; the same as --set fabricate.slots=[...]."""
    mark: bool = False
    """Mark the top of the left arm with a dimple, which shows the orientation of a print; the same as
    --set fabricate.mark=true.
    """

    @property
    def assignments(self) -> list[str]:
        """Assignments of design keys, as --set takes them."""
        options = {
            "fabricate.pockets=true": self.pockets,
            'fabricate.slots=["receivers", "emitter"]': self.slots,
            "fabricate.mark=true": self.mark,
        }
        return [assignment for assignment, is_set in options.items() if is_set]


def sensor_part(design: Design, body: Body) -> Part:
    """Return the printed part of a design: its body at rest, extruded by the thickness, with its seats.

    Raises
    ------
    DataError
        If the receiver part file cannot be read or is not a receiver, or the package size is unknown.
    DesignError
        If the body cannot be built, or a seat does not fit.
    """
    cuts = (*_pockets(design, body), *_slots(design, body), *_mark(design, body))
    if body.front is not None:
        return faced_part(design.name, body, design.body.thickness_mm, cuts)
    return Part(design.name, (sensor_prism(body, design.body.thickness_mm),), cuts)


def _pockets(design: Design, body: Body) -> list[Cut]:
    spec, thickness_mm = design.fabricate, design.body.thickness_mm
    if not spec.pockets:
        return []
    width_mm, height_mm, depth_mm = _package(design)
    half_mm, up_mm = 0.5 * width_mm + spec.clearance_mm, 0.5 * height_mm + spec.clearance_mm
    heights = (0.5 * thickness_mm - up_mm, 0.5 * thickness_mm + up_mm)
    return [
        Cut(*(Prism(name, (_rectangle(face, half_mm, overhang, depth_mm),), *heights) for overhang in (OVERHANG_MM, 0)))
        for name, face in _receivers(body, "pocket", "fabricate.pockets")
    ]


def _slots(design: Design, body: Body) -> list[Cut]:
    spec, top_mm = design.fabricate, design.body.thickness_mm
    half_mm = 0.5 * spec.slot_width_mm + spec.clearance_mm
    outlines: list[tuple[str, tuple[Face, ...], tuple[Face, ...]]] = []
    if "receivers" in spec.slots:
        for name, face in _receivers(body, "slot", "fabricate.slots"):
            tool, removed = (
                _rectangle(face, half_mm, overhang, spec.slot_length_mm) for overhang in (OVERHANG_MM, 0.0)
            )
            outlines.append((name, tool, removed))
    if "emitter" in spec.slots:
        outlines.append(("slot-emitter", *_through_lens(design, body, half_mm)))
    floor_mm = top_mm - spec.film_mm
    return [
        Cut(Prism(name, (tool,), floor_mm, top_mm + OVERHANG_MM), Prism(name, (removed,), floor_mm, top_mm))
        for name, tool, removed in outlines
    ]


def _mark(design: Design, body: Body) -> list[Cut]:
    spec, top_mm = design.fabricate, design.body.thickness_mm
    if not spec.mark:
        return []
    faces = [face for _, face in _receivers(body, "mark", "fabricate.mark")]
    face = min(faces, key=lambda face: face.curve.middle_point[0])
    slot_mm = spec.slot_length_mm if "receivers" in spec.slots else 0.0
    inwards = left_of(unit(minus(face.curve.end, face.curve.start)))
    middle = along(face.curve.middle_point, inwards, slot_mm + MARK_DISTANCE_MM + 0.5 * MARK_MM)
    outline = (Face("mark", Arc.circle(middle, 0.5 * MARK_MM)),)
    floor_mm = top_mm - MARK_DEPTH_MM
    return [Cut(*(Prism("mark", (outline,), floor_mm, to_mm) for to_mm in (top_mm + OVERHANG_MM, top_mm)))]


def _package(design: Design) -> tuple[float, float, float]:
    """Return width, height and depth of the receiver package in mm; the design may override the depth."""
    path, name = design.receiver_file, design.fabricate.receiver_part
    part = library_part(name) if path is None else load_part(path)
    if not isinstance(part, ReceiverPart):
        raise DataError("fabricate.receiver_part", value=part.name, limit=f"is an {part.kind}, not a receiver")
    sizes = {key: getattr(part, key) for key in ("package_width_mm", "package_height_mm", "package_depth_mm")}
    if design.fabricate.pocket_depth_mm is not None:
        del sizes["package_depth_mm"]
    missing = next((key for key, size in sizes.items() if size is None), None)
    if missing is not None:
        remedy = f"add a table [{missing}] to the part file of the receiver"
        if missing == "package_depth_mm":
            remedy += ", or set fabricate.pocket_depth_mm"
        raise DataError(f"receiver {part.name}", limit=f"has no {missing}, which a pocket requires", remedy=remedy)
    width_mm, height_mm, *depth = (size.nominal for size in sizes.values())
    return width_mm, height_mm, depth[0] if depth else float(design.fabricate.pocket_depth_mm or 0.0)


def _receivers(body: Body, what: str, key: str) -> list[tuple[str, Face]]:
    """Return the names of the seats, each with the receiver face in which it is cut."""
    faces = [face for face in body.all_faces if face.part == "receiver"]
    if not faces:
        raise DesignError(key, limit="requires a body with receiver faces", remedy=f"omit {key}")
    for face in faces:
        if not isinstance(face.curve, Segment):
            limit = f"requires straight faces, but {face.name} is curved at {point_text(face.curve.middle_point)}"
            raise DesignError(key, limit=limit, remedy="make the face straight, or omit the seats")
    return [(f"{what}-{face.name.removeprefix('receiver-')}", face) for face in faces]


def _rectangle(face: Face, half_mm: float, overhang_mm: float, depth_mm: float) -> tuple[Face, ...]:
    """Return a rectangle centred on a straight face, from ``overhang_mm`` in front of it to ``depth_mm`` behind it."""
    direction = unit(minus(face.curve.end, face.curve.start))
    inwards, middle = left_of(direction), face.curve.middle_point
    corners = [
        along(along(middle, direction, side * half_mm), inwards, inwards_mm)
        for side, inwards_mm in ((-1, -overhang_mm), (1, -overhang_mm), (1, depth_mm), (-1, depth_mm))
    ]
    return _polygon(corners)


def _polygon(corners: Sequence[Point]) -> tuple[Face, ...]:
    following = [*corners[1:], corners[0]]
    return tuple(Face(f"side-{i}", Segment(a, b)) for i, (a, b) in enumerate(zip(corners, following, strict=True), 1))


def _through_lens(design: Design, body: Body, half_mm: float) -> tuple[tuple[Face, ...], tuple[Face, ...]]:
    """Return the outlines of the emitter slot: that of the tool, and that of the removed material, up to the lens."""
    body.prism('remove the emitter from fabricate.slots, or set lens.shape = "cartesian-oval"')
    lens = [face for face in body.faces if face.part == "lens"]
    if design.body.lens_is_drawn or design.body.kind == "network" or not lens:
        limit = 'requires body.kind = "y" and a lens that is not drawn'
        remedy = "remove the emitter from fabricate.slots"
        raise DesignError("fabricate.slots", value="emitter", limit=limit, remedy=remedy)
    lens_half_mm = design.lens.half_width_mm
    if not half_mm < lens_half_mm:
        max_mm = 2 * (lens_half_mm - design.fabricate.clearance_mm)
        limit = f"must be less than {max_mm:g} mm, or the slot would remove the whole top of the lens"
        raise DesignError("fabricate.slot_width_mm", value=design.fabricate.slot_width_mm, limit=limit)
    top_mm = body.marks["stem-base"][1] + design.fabricate.slot_length_mm
    front = [piece for face in lens if (piece := _within(face, half_mm)) is not None]
    left, right = front[0].curve.start, front[-1].curve.end
    corners = [right, (right[0], top_mm), (left[0], top_mm), left]
    sides = tuple(Face(f"side-{i}", Segment(corners[i], corners[i + 1])) for i in range(3))
    before_mm = min(float(face.curve.points(np.linspace(0.0, 1.0, 9))[:, 1].min()) for face in front) - OVERHANG_MM
    tool = _polygon([(left[0], before_mm), (right[0], before_mm), *corners[1:3]])
    return tool, (*front, *sides)


def _within(face: Face, half_mm: float) -> Face | None:
    """Return the part of a lens segment at |x| below ``half_mm``; the segment must be directed from left to right."""
    low, high = (_u_at(face.curve, x_mm) for x_mm in (-half_mm, half_mm))
    if not low < high:
        return None
    return face if (low, high) == (0.0, 1.0) else Face(face.name, face.curve.part(low, high))


def _u_at(curve: Curve, x_mm: float) -> float:
    """Return the parameter of a curve, directed from left to right, at ``x_mm``; 0 or 1 outside the curve."""
    if x_mm <= curve.start[0]:
        return 0.0
    if x_mm >= curve.end[0]:
        return 1.0
    return float(brentq(lambda u: curve.points(np.array([u]))[0, 0] - x_mm, 0.0, 1.0, xtol=1e-15))
