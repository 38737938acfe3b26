"""A drawn network: outlines whose emitters, lenses and receivers are listed by name in the design.

The layers ``emitter-tip``, ``lens-tip`` and ``receiver-tip`` are the parts named ``tip`` in ``[[network.emitters]]``,
``[[network.lenses]]`` and ``[[network.receivers]]``. An emitter drawn as a point faces along the axis of its lens, or
along +z if it has no lens, as in any drawing.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from solen.errors import DesignError
from solen.geometry.body import GAP_MM, Body, Face, Pose, point_text
from solen.geometry.drawing import Drawing, DrawnEmitter, read_drawing
from solen.geometry.drawing.model import face_name
from solen.geometry.outline import PIVOTS, body_as_drawn, drawn_emitter_pose
from solen.plane import Point, Rigid, along, dot, heading, left_of, minus, right_of, unit
from solen.spec import Design
from solen.spec.network import PlacedEmitter
from solen.spec.placed import emitter_table

FLAT_MM = 1e-4


@dataclass(frozen=True)
class DrawnLens:
    """A lens as drawn: the midpoint between its ends, its axis into the material, and its dimensions."""

    base: Point
    axis: Point
    half_width_mm: float
    depth_mm: float
    shape: str = "drawn"


def drawn_network(design: Design) -> Body:
    """Return the body, not yet checked, of a drawn network with its active emitter and its motions at their angles.

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
    _check_emitters(design, drawing)
    rest = body_as_drawn(design, drawing, lambda _: Pose((0.0, 0.0), 0.0))
    body = _with_listed_names(design, rest)
    lenses = drawn_lenses(design, body)
    drawn_emitters = {drawn.name: drawn for drawn in drawing.emitters}
    poses = {
        emitter.name: _pose(
            design, number, drawn_emitters[face_name(emitter.name)], body, lenses.get(emitter.lens or "")
        )
        for number, emitter in enumerate(design.network.emitters)
    }
    active = poses[design.network.lit or ""]
    return replace(body, emitter=active, marks={}, emitters=tuple(poses.items()))


def drawn_lenses(design: Design, body: Body) -> dict[str, DrawnLens]:
    """Return the lenses of a drawn network, keyed by name; raise `DesignError` if one is closed or not contiguous."""
    return {lens.name: _lens(lens.name, body.all_faces) for lens in design.network.lenses}


def _check_emitters(design: Design, drawing: Drawing) -> None:
    """Raise `DesignError` if the drawn emitters differ from the listed ones, or a pivot is drawn."""
    pivot = next((point for name, point in drawing.points if name in PIVOTS), None)
    if pivot is not None:
        limit = f"does not apply in a network, at {point_text(pivot)}"
        raise DesignError("pivot", limit=limit, remedy="specify network.motion[0].pivot")
    by_name: dict[str, DrawnEmitter] = {}
    for drawn in drawing.emitters:
        earlier = by_name.setdefault(drawn.name, drawn)
        if earlier is not drawn:
            limit = f"is drawn twice, at {point_text(earlier.point)} and at {point_text(drawn.point)}"
            what = f"emitter-{drawn.name}" if drawn.name else "emitter"
            raise DesignError(what, limit=limit, remedy="give each a different name")
    _check_listed("emitter", "emitters", [emitter.name for emitter in design.network.emitters], by_name)


def _check_listed(part: str, key: str, listed: Sequence[str], drawn: Iterable[str]) -> None:
    """Raise `DesignError` if drawn and listed parts differ, or if two listed names are the same in a drawing."""
    present = dict.fromkeys(drawn)
    spellings: dict[str, str] = {}
    for number, name in enumerate(listed):
        what = f"network.{key}[{number}].name"
        if spellings.setdefault(face_name(name), name) != name:
            limit = f"is the same as {spellings[face_name(name)]} in a drawing, where names are read in lower case"
            raise DesignError(what, value=name, limit=limit, remedy="give it another name")
        if face_name(name) not in present:
            content = ", ".join(f"{part}-{name}" if name else part for name in present) or f"no {part}"
            remedy = f"name its layer or element {part}-{face_name(name)}"
            raise DesignError(what, value=name, limit=f"is not drawn; the drawing contains {content}", remedy=remedy)
    for name in present:
        if name not in spellings:
            what = f"{part}-{name}" if name else part
            limit = f"is drawn, but not listed in [[network.{key}]], which contains {', '.join(listed)}"
            raise DesignError(what, limit=limit, remedy="list it, or give it another name")


def _with_listed_names(design: Design, rest: Body) -> Body:
    """Return the body with lenses and receivers named as in the design.

    Raises
    ------
    DesignError
        If the parts listed in the design differ from the drawn ones.
    """
    names: dict[tuple[str, str], str] = {}
    faces = (*rest.all_faces, *rest.separate)
    for part, key in (("lens", "lenses"), ("receiver", "receivers")):
        listed = [placed.name for placed in getattr(design.network, key)]
        drawn = [face.label for face in faces if face.part == part]
        if part == "lens":
            drawn = [name for name in drawn if name != part]  # a lens without a name of its own is a wall
        _check_listed(part, key, listed, ["" if name == part else name for name in drawn])
        names |= {(part, face_name(name)): name for name in listed}

    def renamed(face: Face) -> Face:
        name = names.get((face.part, face.label))
        number = face.name.rpartition(".")[2]
        suffix = f".{number}" if "." in face.name and number.isdigit() else ""
        return face if name is None else replace(face, name=f"{face.part}-{name}{suffix}")

    first, *others = (tuple(renamed(face) for face in outline) for outline in rest.outlines)
    return replace(rest, faces=first, others=tuple(others), separate=tuple(renamed(face) for face in rest.separate))


def _lens(name: str, faces: Sequence[Face]) -> DrawnLens:
    """Return a lens, which consists of consecutive faces with the same name."""
    curves = [face.curve for face in faces if face.part == "lens" and face.label == name]
    for previous, following in pairwise(curves):
        if math.dist(previous.end, following.start) > GAP_MM:
            limit = f"is drawn in several places, at {point_text(previous.end)} and at {point_text(following.start)}"
            raise DesignError(f"lens-{name}", limit=limit, remedy="give each a different name")
    if not curves:
        raise DesignError(f"lens-{name}", limit="is separate, but a lens must be part of an outline")
    start, end = curves[0].start, curves[-1].end
    width_mm = math.dist(start, end)
    if width_mm <= GAP_MM:
        limit = f"is closed at {point_text(start)}, but a lens must have two ends"
        raise DesignError(f"lens-{name}", limit=limit)
    base, axis = (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])), left_of(unit(minus(end, start)))
    points = (point for curve in curves for point in curve.flattened(FLAT_MM).tolist())
    depth_mm = max(dot(minus(base, (x, z)), axis) for x, z in points)
    return DrawnLens(base, axis, 0.5 * width_mm, max(depth_mm, 0.0))


def _pose(design: Design, number: int, drawn: DrawnEmitter, body: Body, lens: DrawnLens | None) -> Pose:
    """Return the pose of an emitter, with its decentre and its motion."""
    placed = design.network.emitters[number]
    table = emitter_table(design, placed)
    pose = drawn_emitter_pose(drawn, body.all_faces)
    if lens is not None and drawn.end is None and drawn.axis_deg is None:
        pose = replace(pose, axis_deg=math.degrees(math.atan2(-lens.axis[0], lens.axis[1])))
    elif lens is not None and drawn.end is not None and dot(heading(pose.axis_deg), minus(lens.base, pose.point)) < 0.0:
        pose = replace(pose, axis_deg=pose.axis_deg + 180.0)
    hit_point = _point_ahead(f"network.emitters[{number}]", placed, pose, body)
    motion = next((motion for motion in design.network.motion if motion.part == placed.name), None)
    point = pose.point
    pose = replace(pose, point=along(point, right_of(heading(pose.axis_deg)), table.offset_mm))
    pose = replace(pose, width_mm=pose.width_mm or table.width_mm)
    if motion is None or motion.at_deg == 0.0:
        return pose
    pivot: Point = hit_point if lens is None else lens.base
    if motion.pivot is not None:
        pivot = point if motion.pivot == "emitter" else motion.pivot
    return pose.moved(Rigid.about(pivot, motion.at_deg))


def _point_ahead(what: str, placed: PlacedEmitter, pose: Pose, body: Body) -> Point:
    """Return the first point of the body on an emitter's axis; raise `DesignError` unless it is on its lens."""
    ahead = heading(pose.axis_deg)
    hits = [(t, face) for face in body.all_faces for t in face.curve.hits(pose.point, ahead)]
    direction_text = f"from {point_text(pose.point)} towards {pose.axis_deg:.4g} deg"
    if not hits:
        limit = f"points past the body, {direction_text}"
        remedy = "draw the emitter as a line across its axis, or specify its lens"
        raise DesignError(f"{what}.name", value=placed.name, limit=limit, remedy=remedy)
    t, face = min(hits, key=lambda hit: hit[0])
    if placed.lens is not None and (face.part, face.label) != ("lens", placed.lens):
        limit = f"is not the face in front of the emitter, {direction_text}: that face is {face.name}"
        raise DesignError(f"{what}.lens", value=placed.lens, limit=limit, remedy="move or rotate the emitter")
    return along(pose.point, ahead, t)
