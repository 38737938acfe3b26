"""Bodies from drawings: closed outlines with named emitter and receivers, moved to any angle of the motion.

Faces have the names of their layers or elements, numbered if names repeat (``wall.2``). A face whose name begins with
``receiver`` detects light, one with ``mirror`` reflects it and one with ``black`` absorbs it; any other face is a bare
wall. Outlines inside others are holes, or bodies in holes. The axis of a bend is x = 0.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from solen.curve import check_numbers
from solen.errors import DesignError
from solen.geometry.bend import Bend, bend_of, bent
from solen.geometry.body import Body, Face, Pose, area, point_text, polyline
from solen.geometry.drawing import Drawing, DrawnEmitter, read_drawing
from solen.geometry.face_names import check_names
from solen.geometry.join import closed_outlines
from solen.geometry.walls import behind_gap, with_walls
from solen.plane import Point, Rigid, along, heading, left_of, minus, right_of, unit
from solen.spec import Design

JOIN_MM = 1e-3
PIVOTS = ("pivot", "stem-base")
"""Names that a drawing may give to the pivot of the motion; the default pivot is the origin of the drawing."""
FLAT_MM = 1e-4
PART_WORDS = {"lens": "lens", "receivers": "receiver", "mirrors": "mirror"}
"""First words of the names of the faces that belong to each moving part."""


def outline_body(design: Design, angle_deg: float = 0.0) -> Body:
    """Return the checked body of a drawn design, moved to ``angle_deg``.

    Raises
    ------
    DataError
        If the drawing cannot be read.
    DesignError
        If outlines are open or intersect, there is no emitter, or the motion would tear an outline.
    """
    if design.outline_file is None:
        raise DesignError("body.file", limit="missing")
    return drawn_body(design, read_drawing(design.outline_file, design.body.units), angle_deg)


def drawn_body(design: Design, drawing: Drawing, angle_deg: float = 0.0) -> Body:
    """Return the body of a drawing in memory, checked and moved to ``angle_deg``; see `outline_body`."""
    check_numbers("angle_deg", angle_deg)
    rest = body_as_drawn(design, drawing, lambda faces: _emitter(design, drawing, faces))
    moved = _bent(design, rest, angle_deg) if design.motion.kind == "bend" else _rotated(design, rest, angle_deg)
    return moved.check()


def body_as_drawn(design: Design, drawing: Drawing, emitter_before: Callable[[tuple[Face, ...]], Pose]) -> Body:
    """Return the body as drawn, with its walls divided; ``emitter_before`` returns the emitter pose from all faces."""
    check_names(drawing)
    drawn_outlines, standalone = closed_outlines(
        drawing.strokes, JOIN_MM if design.body.join_mm is None else design.body.join_mm
    )
    ordered = [_from_lens(outline) for outline in _oriented(drawn_outlines)]
    names = _numbered([face.name for faces in (*ordered, standalone) for face in faces])
    outlines = [tuple(replace(face, name=next(names)) for face in outline) for outline in ordered]
    standalone_faces = [replace(face, name=next(names)) for face in standalone]
    split = [behind_gap(outline, design.receivers.gap_mm) for outline in outlines]
    first, *others = with_walls([faces for faces, _ in split], design.wall)
    all_faces = (*first, *(face for outline in others for face in outline))
    separate = (
        *(face for _, faces in split for face in faces),
        *(_facing(face, all_faces) for face in standalone_faces),
    )
    pivot = next((point for name, point in drawing.points if name in PIVOTS), (0.0, 0.0))
    return Body(first, emitter_before(all_faces), {"stem-base": pivot}, tuple(others), separate, embedded=True)


def _oriented(outlines: list[list[Face]]) -> list[list[Face]]:
    """Return outlines with material on their left, largest first; holes are inside an odd number of others."""
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


def _numbered(names: list[str]) -> Iterator[str]:
    """Yield the names in order, numbered if they repeat."""
    counts, seen = Counter(names), Counter[str]()
    for name in names:
        seen[name] += 1
        yield f"{name}.{seen[name]}" if counts[name] > 1 else name


def _facing(face: Face, walls: Iterable[Face]) -> Face:
    """Return a face in air, oriented with its left side towards the nearest visible wall."""
    middle = face.curve.middle_point
    normal = face.curve.normal_at(middle)
    backwards = _nearest_mm(middle, (-normal[0], -normal[1]), walls) < _nearest_mm(middle, normal, walls)
    return replace(face, curve=face.curve.reversed()) if backwards else face


def _nearest_mm(at: Point, direction: Point, faces: Iterable[Face]) -> float:
    return min((t for face in faces for t in face.curve.hits(at, direction)), default=math.inf)


def _emitter(design: Design, drawing: Drawing, faces: tuple[Face, ...]) -> Pose:
    """Return the emitter of the design or the drawing, decentred by its offset."""
    table = design.emitter
    if table.point_mm is not None:
        pose = Pose(table.point_mm, 0.0)
    elif len(drawing.emitters) == 1:
        pose = drawn_emitter_pose(drawing.emitters[0], faces)
    else:
        raise DesignError(
            "emitter",
            limit=f"the drawing contains {len(drawing.emitters)} emitters, but must contain one: a point, or a line as "
            "wide as the chip, on a layer called emitter",
            remedy='specify emitter.point_mm = [x, z], or set body.kind = "network" for several emitters used in turn',
        )
    if table.axis_deg is not None:
        pose = replace(pose, axis_deg=table.axis_deg)
    return replace(pose, point=along(pose.point, right_of(heading(pose.axis_deg)), table.offset_mm))


def drawn_emitter_pose(drawn: DrawnEmitter, faces: tuple[Face, ...]) -> Pose:
    """Return the pose of a drawn emitter; a line faces along its normal towards the nearer face."""
    if drawn.end is None:
        return Pose(drawn.point, drawn.axis_deg or 0.0, drawn.width_mm)
    middle = (0.5 * (drawn.point[0] + drawn.end[0]), 0.5 * (drawn.point[1] + drawn.end[1]))
    line = minus(drawn.end, drawn.point)
    if line == (0.0, 0.0):
        return Pose(middle, drawn.axis_deg or 0.0)
    left = left_of(unit(line))
    right = (-left[0], -left[1])
    distances = {side: _nearest_mm(middle, side, faces) for side in (left, right)}
    direction = min(distances, key=distances.__getitem__)
    if math.isinf(distances[direction]):
        limit = f"the line at {point_text(middle)} points past the body on both sides"
        raise DesignError("emitter", limit=limit, remedy="rotate or move it")
    return Pose(middle, math.degrees(math.atan2(-direction[0], direction[1])), math.hypot(*line))


def _rotated(design: Design, rest: Body, angle_deg: float) -> Body:
    """Return the body with its moving parts rotated about the pivot."""
    pivot, moves = design.motion.pivot, design.motion.moves
    if pivot == "stem-base":
        pivot = rest.marks["stem-base"]
    elif pivot == "emitter":
        pivot = centred_position(design, rest.emitter)
    rotation = Rigid.about(pivot, angle_deg)
    part_words = {PART_WORDS[part] for part in moves if part in PART_WORDS}
    missing = part_words - {face.part for face in (*rest.all_faces, *rest.separate)}
    if missing:
        limit = f"the drawing has no face that begins with {min(missing)}"
        remedy = "omit the part from motion.moves, or rename the layer or element"
        raise DesignError("motion.moves", value=list(moves), limit=limit, remedy=remedy)

    def moved(faces: tuple[Face, ...]) -> tuple[Face, ...]:
        return tuple(replace(f, curve=f.curve.moved(rotation)) if f.part in part_words else f for f in faces)

    emitter = rest.emitter
    if "emitter" in moves:
        emitter = replace(emitter, point=rotation.point(emitter.point), axis_deg=emitter.axis_deg + angle_deg)
    if rotation != Rigid():
        _check_tear(rest, part_words)
    first, *others = (moved(outline) for outline in rest.outlines)
    return replace(rest, faces=first, others=tuple(others), separate=moved(rest.separate), emitter=emitter)


def centred_position(design: Design, emitter: Pose) -> Point:
    """Return the position of the emitter without its decentre, which is an assembly error."""
    return along(emitter.point, right_of(heading(emitter.axis_deg)), -design.emitter.offset_mm)


def _check_tear(body: Body, part_words: set[str]) -> None:
    """Raise `DesignError` if a rotation would tear an outline: only complete outlines can rotate."""
    for outline in body.outlines:
        fixed = next((face for face in outline if face.part not in part_words), None)
        rotated = next((face for face in outline if face.part in part_words), None)
        if fixed is not None and rotated is not None:
            raise DesignError(
                "motion.moves",
                limit=f"would tear {rotated.name} from {fixed.name}: both are parts of one outline",
                remedy='rotate the emitter alone, or bend the body with motion.kind = "bend"',
            )


def _bent(design: Design, rest: Body, angle_deg: float) -> Body:
    """Return the body bent between two heights; separate objects move with it."""
    low_mm, high_mm = design.motion.bend_mm or (0.0, 1.0)
    bend = bend_of(design.motion.centre_line, low_mm, high_mm, angle_deg)

    def moved(faces: tuple[Face, ...]) -> tuple[Face, ...]:
        return tuple(piece for face in faces for piece in _pieces(face, bend))

    first, *others = (moved(outline) for outline in rest.outlines)
    section_motion = bend.section_motion(rest.emitter.point[1])
    emitter = rest.emitter.moved(section_motion)
    pivot = bend.section_motion(rest.marks["stem-base"][1]).point(rest.marks["stem-base"])
    marks = {"stem-base": pivot}
    return replace(rest, faces=first, others=tuple(others), separate=moved(rest.separate), emitter=emitter, marks=marks)


def _pieces(face: Face, bend: Bend) -> list[Face]:
    """Return a bent face, divided into numbered segments if the bend begins or ends within it."""
    curves = bent(face.curve, bend)
    if len(curves) == 1:
        return [replace(face, curve=curves[0])]
    return [replace(face, name=f"{face.name}.{i}", curve=curve) for i, curve in enumerate(curves, start=1)]
