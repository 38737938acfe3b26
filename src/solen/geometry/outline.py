"""A drawn body: closed outlines from a file, with emitter and receivers by name, at any motion angle.

Faces have the names of their layers or elements, numbered if names repeat (``wall.2``). A face whose name begins with
``receiver`` detects, with ``mirror`` reflects, with ``black`` absorbs; any other face is a bare wall. Outlines inside
others are holes, or bodies in holes. The axis of a bend is x = 0.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from solen.curve import check_numbers
from solen.errors import DesignError
from solen.geometry.bend import Bend, bend_of, bent
from solen.geometry.body import Body, Face, Pose, area, place_text, polyline
from solen.geometry.drawing import Drawing, Lamp, read_drawing
from solen.geometry.face_names import check_names
from solen.geometry.join import closed_outlines
from solen.geometry.walls import behind_gap, with_walls
from solen.plane import Point, Rigid, along, heading, left_of, minus, right_of, unit
from solen.spec import Design

JOIN_MM = 1e-3
PIVOTS = ("pivot", "stem-base")
"""Names of a drawn pivot of the motion; the drawing origin is the default pivot."""
FLAT_MM = 1e-4
PARTS = {"lens": "lens", "receivers": "receiver", "mirrors": "mirror"}
"""First words of the names of faces that belong to the parts selected by a motion."""


def outline_body(design: Design, angle_deg: float = 0.0) -> Body:
    """Return the checked body of a drawn design, moved to ``angle_deg``.

    Raises
    ------
    DataError
        If the drawing cannot be read.
    DesignError
        If outlines are open or intersect, there is no emitter, or the motion would tear them.
    """
    if design.outline_file is None:
        raise DesignError("body.file", limit="missing")
    return drawn_body(design, read_drawing(design.outline_file, design.body.units), angle_deg)


def drawn_body(design: Design, drawing: Drawing, angle_deg: float = 0.0) -> Body:
    """Return the body of an outline, like `outline_body`, from a drawing in memory."""
    check_numbers("angle_deg", angle_deg)
    rest = _rest(design, drawing)
    moved = _bent(design, rest, angle_deg) if design.motion.kind == "bend" else _turned(design, rest, angle_deg)
    return moved.check()


def _rest(design: Design, drawing: Drawing) -> Body:
    """Return the body as drawn, with its emitter unmoved."""
    return drawn_rest(design, drawing, lambda faces: _emitter(design, drawing, faces))


def drawn_rest(design: Design, drawing: Drawing, emitter_before: Callable[[tuple[Face, ...]], Pose]) -> Body:
    """Return the body as drawn, with divided walls; a function of its faces returns the emitter."""
    check_names(drawing)
    found, alone = closed_outlines(drawing.strokes, JOIN_MM if design.body.join_mm is None else design.body.join_mm)
    ordered = [_from_lens(outline) for outline in _oriented(found)]
    names = _names([face.name for faces in (*ordered, alone) for face in faces])
    outlines = [tuple(replace(face, name=next(names)) for face in outline) for outline in ordered]
    standing = [replace(face, name=next(names)) for face in alone]
    bare = [behind_gap(outline, design.receivers.gap_mm) for outline in outlines]
    first, *others = with_walls([faces for faces, _ in bare], design.wall)
    all_faces = (*first, *(face for outline in others for face in outline))
    apart = (*(face for _, faces in bare for face in faces), *(_facing(face, all_faces) for face in standing))
    pivot = next((point for name, point in drawing.points if name in PIVOTS), (0.0, 0.0))
    return Body(first, emitter_before(all_faces), {"stem-base": pivot}, tuple(others), apart, embedded=True)


def _oriented(outlines: list[list[Face]]) -> list[list[Face]]:
    """Outlines with material on their left, largest first; an odd number of surrounding outlines makes a hole."""
    import shapely

    rings = [polyline(tuple(outline), FLAT_MM) for outline in outlines]
    oriented = []
    for i, (outline, ring) in enumerate(zip(outlines, rings, strict=True)):
        around = sum(shapely.contains_xy(shapely.Polygon(other), *ring[0]) for k, other in enumerate(rings) if k != i)
        backwards = (area(ring) > 0.0) != (around % 2 == 0)
        oriented.append([replace(f, curve=f.curve.reversed()) for f in reversed(outline)] if backwards else outline)
    sizes = [abs(area(ring)) for ring in rings]
    return [oriented[i] for i in sorted(range(len(oriented)), key=lambda i: -sizes[i])]


def _from_lens(outline: list[Face]) -> list[Face]:
    """Return the outline rotated to start at its first lens face, if it has one."""
    starts = [i for i, face in enumerate(outline) if face.part == "lens" and outline[i - 1].part != "lens"]
    return outline[starts[0] :] + outline[: starts[0]] if starts else outline


def _names(names: list[str]) -> Iterator[str]:
    """Return names in order, numbered if they repeat."""
    several, seen = Counter(names), Counter[str]()
    for name in names:
        seen[name] += 1
        yield f"{name}.{seen[name]}" if several[name] > 1 else name


def _facing(face: Face, walls: Iterable[Face]) -> Face:
    """Return a face in air, oriented with its left towards the nearest visible wall."""
    at = face.curve.middle_point
    normal = face.curve.normal_at(at)
    backwards = _nearest_mm(at, (-normal[0], -normal[1]), walls) < _nearest_mm(at, normal, walls)
    return replace(face, curve=face.curve.reversed()) if backwards else face


def _nearest_mm(at: Point, direction: Point, faces: Iterable[Face]) -> float:
    return min((t for face in faces for t in face.curve.hits(at, direction)), default=math.inf)


def _emitter(design: Design, drawing: Drawing, faces: tuple[Face, ...]) -> Pose:
    """Return the emitter of the drawing or the design, decentred by its offset."""
    stated = design.emitter
    if stated.point_mm is not None:
        pose = Pose(stated.point_mm, 0.0)
    elif len(drawing.lamps) == 1:
        pose = lamp_pose(drawing.lamps[0], faces)
    else:
        limit = (
            "the drawing must contain one emitter: a point, or a line as wide as the chip, on a layer called emitter"
        )
        raise DesignError(
            "emitter",
            value=f"{len(drawing.lamps)} drawn",
            limit=limit,
            remedy='specify emitter.point_mm = [x, z], or set body.kind = "network" for several emitters used in turn',
        )
    if stated.axis_deg is not None:
        pose = replace(pose, axis_deg=stated.axis_deg)
    return replace(pose, point=along(pose.point, right_of(heading(pose.axis_deg)), stated.offset_mm))


def lamp_pose(lamp: Lamp, faces: tuple[Face, ...]) -> Pose:
    """Return the pose of an emitter; a line faces along its normal towards the nearer face."""
    if lamp.end is None:
        return Pose(lamp.point, lamp.axis_deg or 0.0, lamp.width_mm)
    middle = (0.5 * (lamp.point[0] + lamp.end[0]), 0.5 * (lamp.point[1] + lamp.end[1]))
    across = minus(lamp.end, lamp.point)
    if across == (0.0, 0.0):
        return Pose(middle, lamp.axis_deg or 0.0)
    left = left_of(unit(across))
    right = (-left[0], -left[1])
    sees = {side: _nearest_mm(middle, side, faces) for side in (left, right)}
    direction = min(sees, key=sees.__getitem__)
    if math.isinf(sees[direction]):
        limit = "points past the body on both sides"
        raise DesignError("emitter", value=f"a line at {place_text(middle)}", limit=limit, remedy="rotate or move it")
    return Pose(middle, math.degrees(math.atan2(-direction[0], direction[1])), math.hypot(*across))


def _turned(design: Design, rest: Body, angle_deg: float) -> Body:
    """Return the body with its moving parts rotated about the pivot."""
    pivot, moves = design.motion.pivot, design.motion.moves
    if pivot == "stem-base":
        pivot = rest.marks["stem-base"]
    elif pivot == "emitter":
        pivot = undecentred(design, rest.emitter)
    turn = Rigid.about(pivot, angle_deg)
    words = {PARTS[part] for part in moves if part in PARTS}
    missing = words - {face.part for face in (*rest.all_faces, *rest.apart)}
    if missing:
        limit = f"the drawing has no face that begins with {min(missing)}"
        raise DesignError(
            "motion.moves", value=list(moves), limit=limit, remedy="omit the part, or name the layer accordingly"
        )

    def moved(faces: tuple[Face, ...]) -> tuple[Face, ...]:
        return tuple(replace(f, curve=f.curve.moved(turn)) if f.part in words else f for f in faces)

    emitter = rest.emitter
    if "emitter" in moves:
        emitter = replace(emitter, point=turn.point(emitter.point), axis_deg=emitter.axis_deg + angle_deg)
    if turn != Rigid():
        _check_whole(rest, words)
    first, *others = (moved(outline) for outline in rest.outlines)
    return replace(rest, faces=first, others=tuple(others), apart=moved(rest.apart), emitter=emitter)


def undecentred(design: Design, emitter: Pose) -> Point:
    """Return the position of the emitter without its decentre, which is a position error."""
    return along(emitter.point, right_of(heading(emitter.axis_deg)), -design.emitter.offset_mm)


def _check_whole(body: Body, words: set[str]) -> None:
    """Raise `DesignError` if a rotation would tear an outline: only complete outlines can rotate."""
    for outline in body.outlines:
        stays = next((face for face in outline if face.part not in words), None)
        turns = next((face for face in outline if face.part in words), None)
        if stays is not None and turns is not None:
            raise DesignError(
                "motion.moves",
                value=sorted(words),
                limit=f"would tear {turns.name} from {stays.name}: both are parts of one outline",
                remedy='rotate the emitter alone, or bend the body with motion.kind = "bend"',
            )


def _bent(design: Design, rest: Body, angle_deg: float) -> Body:
    """Return the body bent between two heights; separate objects move along."""
    low_mm, high_mm = design.motion.bend_mm or (0.0, 1.0)
    bend = bend_of(design.motion.centre_line, low_mm, high_mm, angle_deg)

    def moved(faces: tuple[Face, ...]) -> tuple[Face, ...]:
        return tuple(piece for face in faces for piece in _pieces(face, bend))

    first, *others = (moved(outline) for outline in rest.outlines)
    section = bend.section(rest.emitter.point[1])
    emitter = rest.emitter.moved(section)
    pivot = bend.section(rest.marks["stem-base"][1]).point(rest.marks["stem-base"])
    marks = {"stem-base": pivot}
    return replace(rest, faces=first, others=tuple(others), apart=moved(rest.apart), emitter=emitter, marks=marks)


def _pieces(face: Face, bend: Bend) -> list[Face]:
    """Return a bent face, divided into numbered segments if the bend begins or ends within it."""
    curves = bent(face.curve, bend)
    if len(curves) == 1:
        return [replace(face, curve=curves[0])]
    return [replace(face, name=f"{face.name}.{i}", curve=curve) for i, curve in enumerate(curves, start=1)]
