"""A drawn network: outlines whose emitters, lenses and receivers are listed by name in the design.

The layers ``emitter-tip``, ``lens-tip`` and ``receiver-tip`` are the parts called ``tip`` in the lists
``[[network.emitters]]`` etc. An emitter drawn as a point faces along the axis of its lens, or along +z if it has no
lens, as in any drawing.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from solen.errors import DesignError
from solen.geometry.body import GAP_MM, Body, Face, Pose, place_text
from solen.geometry.drawing import Drawing, Lamp, read_drawing
from solen.geometry.drawing.model import face_name
from solen.geometry.outline import PIVOTS, drawn_rest, lamp_pose
from solen.plane import Point, Rigid, along, dot, heading, left_of, minus, right_of, unit
from solen.spec import Design
from solen.spec.network import PlacedEmitter
from solen.spec.placed import emitter_table

FLAT_MM = 1e-4


@dataclass(frozen=True)
class DrawnLens:
    """A lens as drawn: midpoint of the line between its ends, axis into the material, and dimensions."""

    base: Point
    axis: Point
    half_width_mm: float
    depth_mm: float
    shape: str = "drawn"


def drawn_network(design: Design) -> Body:
    """Return the unchecked body of a drawn network with its active emitter and its motions at their angles.

    Raises
    ------
    DataError
        If the drawing cannot be read.
    DesignError
        If outlines are open, if the drawn parts differ from the listed ones, or if an emitter does not face its lens.
    """
    if design.outline_file is None:
        raise AssertionError("a drawn network must have a drawing")
    drawing = read_drawing(design.outline_file, design.body.units)
    _check_lamps(design, drawing)
    rest = drawn_rest(design, drawing, lambda _: Pose((0.0, 0.0), 0.0))
    named = _named(design, rest)
    lenses = drawn_lenses(design, named)
    lamps = {lamp.name: lamp for lamp in drawing.lamps}
    poses = {
        emitter.name: _pose(design, number, lamps[_drawn(emitter.name)], named, lenses.get(emitter.lens or ""))
        for number, emitter in enumerate(design.network.emitters)
    }
    lit = poses[design.network.lit or ""]
    return replace(named, emitter=lit, marks={}, lamps=tuple(poses.items()))


def drawn_lenses(design: Design, body: Body) -> dict[str, DrawnLens]:
    """Return the lenses of a drawn network by name; `DesignError` if one is drawn in several places, or closed."""
    return {lens.name: _lens(lens.name, body.all_faces) for lens in design.network.lenses}


def _drawn(name: str) -> str:
    """Return the name of a part in the form used in a drawing."""
    return face_name(name)


def _check_lamps(design: Design, drawing: Drawing) -> None:
    """Raise `DesignError` if the drawn emitters differ from the listed ones, or a pivot is drawn."""
    pivot = next((point for name, point in drawing.points if name in PIVOTS), None)
    if pivot is not None:
        limit = f"does not apply in a network, at {place_text(pivot)}"
        raise DesignError("body outline", value="pivot", limit=limit, remedy="specify network.motion[0].pivot")
    places: dict[str, Lamp] = {}
    for lamp in drawing.lamps:
        other = places.setdefault(lamp.name, lamp)
        if other is not lamp:
            limit = f"is drawn twice, at {place_text(other.point)} and at {place_text(lamp.point)}"
            what = f"emitter-{lamp.name}" if lamp.name else "emitter"
            raise DesignError("body outline", value=what, limit=limit, remedy="give each a different name")
    _check_listed("emitter", "emitters", [emitter.name for emitter in design.network.emitters], places)


def _check_listed(part: str, key: str, listed: Sequence[str], drawn: Iterable[str]) -> None:
    """Raise `DesignError` if drawn and listed parts differ, or a part is listed with two spellings."""
    there = dict.fromkeys(drawn)
    spelt: dict[str, str] = {}
    for number, name in enumerate(listed):
        what = f"network.{key}[{number}].name"
        if spelt.setdefault(_drawn(name), name) != name:
            limit = f"has the same name in a drawing as {spelt[_drawn(name)]}: names in drawings are read in lower case"
            raise DesignError(what, value=name, limit=limit, remedy="give it another name")
        if _drawn(name) not in there:
            shown = ", ".join(f"{part}-{one}" if one else part for one in there) or f"no {part}"
            remedy = f"name its layer or element {part}-{_drawn(name)}"
            raise DesignError(what, value=name, limit=f"is not drawn; the drawing contains {shown}", remedy=remedy)
    for name in there:
        if name not in spelt:
            what, limit = (
                f"{part}-{name}" if name else part,
                (f"is not listed in [[network.{key}]]: {', '.join(listed)}"),
            )
            raise DesignError("body outline", value=what, limit=limit, remedy="list it, or give it another name")


def _named(design: Design, rest: Body) -> Body:
    """Return the body with the names of lenses and receivers in the design; raises `DesignError` if the two differ."""
    names: dict[tuple[str, str], str] = {}
    faces = (*rest.all_faces, *rest.apart)
    for part, key in (("lens", "lenses"), ("receiver", "receivers")):
        listed = [one.name for one in getattr(design.network, key)]
        drawn = [face.whose for face in faces if face.part == part]
        if part == "lens":
            drawn = [name for name in drawn if name != part]  # a lens without a name is a wall
        _check_listed(part, key, listed, ["" if name == part else name for name in drawn])
        names |= {(part, _drawn(name)): name for name in listed}

    def called(face: Face) -> Face:
        name = names.get((face.part, face.whose))
        tail = face.name.rpartition(".")[2]
        piece = f".{tail}" if "." in face.name and tail.isdigit() else ""
        return face if name is None else replace(face, name=f"{face.part}-{name}{piece}")

    first, *others = (tuple(called(face) for face in outline) for outline in rest.outlines)
    return replace(rest, faces=first, others=tuple(others), apart=tuple(called(face) for face in rest.apart))


def _lens(name: str, faces: Sequence[Face]) -> DrawnLens:
    """Return a lens made of consecutive faces with one name."""
    own = [face.curve for face in faces if face.part == "lens" and face.whose == name]
    for before, after in pairwise(own):
        if math.dist(before.end, after.start) > GAP_MM:
            limit = f"is drawn in several places, at {place_text(before.end)} and at {place_text(after.start)}"
            raise DesignError("body outline", value=f"lens-{name}", limit=limit, remedy="give each a different name")
    if not own:
        raise DesignError("body outline", value=f"lens-{name}", limit="is separate: a lens must be part of an outline")
    start, end = own[0].start, own[-1].end
    width_mm = math.dist(start, end)
    if width_mm <= GAP_MM:
        limit = f"is closed, at {place_text(start)}: a lens must have two ends"
        raise DesignError("body outline", value=f"lens-{name}", limit=limit)
    base, axis = (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])), left_of(unit(minus(end, start)))
    points = (point for curve in own for point in curve.flattened(FLAT_MM).tolist())
    depth_mm = max(dot(minus(base, (x, z)), axis) for x, z in points)
    return DrawnLens(base, axis, 0.5 * width_mm, max(depth_mm, 0.0))


def _pose(design: Design, number: int, lamp: Lamp, body: Body, lens: DrawnLens | None) -> Pose:
    """Return the pose of an emitter, including its decentre and its motion."""
    placed = design.network.emitters[number]
    table = emitter_table(design, placed)
    pose = lamp_pose(lamp, body.all_faces)
    if lens is not None and lamp.end is None and lamp.axis_deg is None:
        pose = replace(pose, axis_deg=math.degrees(math.atan2(-lens.axis[0], lens.axis[1])))
    elif lens is not None and lamp.end is not None and dot(heading(pose.axis_deg), minus(lens.base, pose.point)) < 0.0:
        pose = replace(pose, axis_deg=pose.axis_deg + 180.0)
    meets = _check_ahead(f"network.emitters[{number}]", placed, pose, body)
    motion = next((motion for motion in design.network.motion if motion.part == placed.name), None)
    centre = pose.point
    pose = replace(pose, point=along(centre, right_of(heading(pose.axis_deg)), table.offset_mm))
    pose = replace(pose, width_mm=pose.width_mm or table.width_mm)
    if motion is None or motion.at_deg == 0.0:
        return pose
    pivot: Point = meets if lens is None else lens.base
    if motion.pivot is not None:
        pivot = centre if motion.pivot == "emitter" else motion.pivot
    return pose.moved(Rigid.about(pivot, motion.at_deg))


def _check_ahead(what: str, placed: PlacedEmitter, pose: Pose, body: Body) -> Point:
    """Raise `DesignError` unless the axis of an emitter meets its lens before any other face of the body."""
    ahead = heading(pose.axis_deg)
    hits = [(t, face) for face in body.all_faces for t in face.curve.hits(pose.point, ahead)]
    where = f"from {place_text(pose.point)} towards {pose.axis_deg:.4g} deg"
    if not hits:
        limit, remedy = (
            f"points past the body, {where}",
            ("draw the emitter as a line across its axis, or specify its lens"),
        )
        raise DesignError(f"{what}.name", value=placed.name, limit=limit, remedy=remedy)
    t, face = min(hits, key=lambda hit: hit[0])
    if placed.lens is not None and (face.part, face.whose) != ("lens", placed.lens):
        limit = f"is not the face in front of the emitter, {where}: that face is {face.name}"
        raise DesignError(f"{what}.lens", value=placed.lens, limit=limit, remedy="move or rotate the emitter")
    return along(pose.point, ahead, t)
