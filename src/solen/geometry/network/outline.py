"""Outlines of a network: closed walks along the walls of guides, with the parts on their ends and sides.

At a node, the walk continues from the right side of an arriving guide to the next guide counter-clockwise. Every side
of every guide is therefore walked once with the material on its left, and each closed walk is one outline: the outer
outline or the hole of a loop.
"""

import math
from collections import Counter
from dataclasses import dataclass, field, replace

from solen.curve import Arc, ArcLength, Bezier, Curve, Segment
from solen.errors import DesignError
from solen.geometry.body import GAP_MM, Face, Pose, point_text
from solen.geometry.network.corners import Run, cut_at, joined
from solen.geometry.network.plan import GuidePath, Plan, composed
from solen.plane import Point, Rigid, along, dot, left_of, minus, right_of, unit
from solen.spec.network import NamedMotion, Network, Placed, PlacedEmitter, PlacedLens, PlacedReceiver

SideKey = tuple[str, str]
"""Name of a guide, and its side: right or left; the right side is walked from the first node to the second."""
Part = PlacedLens | PlacedReceiver
SIDES = ("right", "left")
ROUNDING_MM = 1e-9
"""Rounding tolerance by which a lens may be wider than its guide."""


@dataclass
class Walk:
    """The sides of guides; for each side, the side that follows it in the walk, and the faces between the two."""

    plan: Plan
    runs: dict[SideKey, Run]
    following: dict[SideKey, SideKey] = field(default_factory=dict)
    between: dict[SideKey, list[Face]] = field(default_factory=dict)
    frames: dict[str, Rigid] = field(default_factory=dict)
    """Motions from local coordinates to those of the body, keyed by the name of a lens or of an emitter without a lens.
    The wall is at z = 0 in local coordinates.
    """

    @classmethod
    def of(cls, plan: Plan) -> "Walk":
        """Return the walk around all nodes of a plan."""
        walk = cls(plan, {(path.guide.name, side): _run(path, side) for path in plan.paths.values() for side in SIDES})
        for number, node in enumerate(plan.network.nodes):
            paths = _in_order(plan, node.name)
            for path, following in zip(paths, [*paths[1:], *paths[:1]], strict=True):
                arriving, departing = _arriving(path, node.name), _departing(following, node.name)
                walk.following[arriving] = departing
                if len(paths) == 1:
                    walk.between[arriving] = walk.cap(path, node.name, number)
                else:
                    walk.corner(arriving, departing, node.fillet_mm, node.name)
            _check_node(plan, number, len(paths))
        return walk

    def corner(self, arriving: SideKey, departing: SideKey, fillet_mm: float, node: str) -> None:
        """Cut two walls at their intersection, and insert the face between them."""
        first, second, curve = joined(
            self.runs[arriving], self.runs[departing], fillet_mm, node, self.plan.positions[node]
        )
        self.runs[arriving], self.runs[departing] = first, second
        part = "fillet" if isinstance(curve, Arc) else "join"
        self.between[arriving] = [] if curve is None else [Face(f"{part}-{node}", curve)]

    def cap(self, path: GuidePath, node: str, number: int) -> list[Face]:
        """Return the faces across the end of a guide, from the arriving side to the departing side."""
        network = self.plan.network
        start, end = self.runs[_arriving(path, node)].end, self.runs[_departing(path, node)].start
        base, inward = (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])), path.inwards(node)
        base = base if path.guide.flush else (path.spine.start if node == path.guide.nodes[0] else path.spine.end)
        lenses = [placed for placed in network.lenses if placed.node == node]
        receivers = [placed for placed in network.receivers if placed.node == node]
        self._check_single(number, node, [*lenses, *receivers])
        for emitter in network.emitters:
            if emitter.node == node:
                self.frames[emitter.name] = _frame(base, inward, 0.0)
        if lenses:
            return self._lens_between(lenses[0], start, end, base, inward, f"end-{node}")
        name = f"receiver-{receivers[0].name}" if receivers else f"{network.nodes[number].end}-{node}"
        return [Face(name.replace("open-", "end-", 1), Segment(start, end))]

    def faces(self, side_key: SideKey) -> list[Face]:
        """Return the faces of a guide's side and its parts in walking direction, then those up to the next side."""
        name, side = side_key
        run, network = self.runs[side_key], self.plan.network
        curve, from_end = run.remaining, side == "left"
        low, high = (run.high, 1.0) if from_end else (0.0, run.low)  # the part that a corner has removed
        begins_mm = ArcLength(run.curve.part(low, high)).length_mm if low < high else 0.0
        guide_face = Face(f"{name}-{side}", curve, from_end=from_end, begins_mm=begins_mm)
        parts: list[Part] = [lens for lens in network.lenses if (lens.guide, lens.side) == side_key]
        parts += [receiver for receiver in network.receivers if (receiver.guide, receiver.side) == side_key]
        for emitter in network.emitters:
            if (emitter.guide, emitter.side) == side_key:
                self.frames[emitter.name] = self._on_side(guide_face, emitter.at_mm or 0.0, emitter)[0]
        if not parts:
            return [guide_face, *self.between[side_key]]
        return [*self._divided(guide_face, parts), *self.between[side_key]]

    def emitter(self, placed: PlacedEmitter, distance_mm: float, offset_mm: float) -> Pose:
        """Return the pose of an emitter after its motion."""
        frame = self.frames[placed.lens or placed.name]
        pose = Pose(frame.point((offset_mm, -distance_mm)), frame.angle_deg)
        motion = self._rotation_of(placed.name, "emitters")
        if motion is None:
            return pose
        lens = self.plan.lenses[placed.lens] if placed.lens else None
        node = next((lens.node for lens in self.plan.network.lenses if lens.name == placed.lens), placed.node)
        base = frame.point((0.0, 0.0 if lens is None else lens.depth_mm))
        pivot = self._pivot(motion, node, frame.point((0.0, -distance_mm)), base)
        return pose.moved(Rigid.about(pivot, motion.at_deg))

    def _pivot(self, motion: NamedMotion, node: str | None, emitter: Point, base: Point) -> Point:
        """Return the pivot of a lens or an emitter at a node, moved with that node."""
        if motion.pivot is None:
            return base
        if motion.pivot == "emitter":
            return emitter
        return self.plan.node_motions.get(node or "", Rigid()).point(motion.pivot)

    def _lens_between(
        self, placed: PlacedLens, start: Point, end: Point, base: Point, inward: Point, name: str
    ) -> list[Face]:
        """Return the faces of a lens across an end or on a side, and those beside it if the lens is narrower."""
        lens = self.plan.lenses[placed.name]
        room_mm = math.dist(start, end)
        if 2.0 * lens.half_width_mm > room_mm + ROUNDING_MM:
            number = self.plan.network.lenses.index(placed)
            limit = f"must be at most {0.5 * room_mm:.4g} mm, half the width at {point_text(base)}"
            what = f"network.lenses[{number}].half_width_mm"
            raise DesignError(what, value=lens.half_width_mm, limit=limit, remedy="narrow the lens or widen the guide")
        frame = _frame(base, inward, lens.depth_mm)
        motion = self._rotation_of(placed.name, "lenses")
        if motion is not None:
            distance_mm = next(
                (emitter.distance_mm for emitter in self.plan.network.emitters if emitter.lens == placed.name), None
            )
            emitter_point = frame.point((0.0, -(distance_mm or self.plan.distance_mm)))
            rotation = Rigid.about(self._pivot(motion, placed.node, emitter_point, base), motion.at_deg)
            front_at_rest, frame = lens.front.moved(frame), composed(frame, rotation)
            self._check_tear(placed, motion, rotation, (front_at_rest.start, front_at_rest.end), lens.half_width_mm)
        self.frames[placed.name] = frame
        front = lens.front if frame == Rigid() else lens.front.moved(frame)
        faces = [Face(f"lens-{placed.name}", front)]
        if motion is not None and motion.join in ("bridge", "smooth"):
            walls = self._trimmed(placed, motion, front, (start, end), base, inward)
            start, end = walls[0].end, walls[1].start
            if motion.join == "smooth":
                axis = frame.vector((0.0, 1.0))
                low, high = (
                    _smooth(wall, edge, axis, base, inward)
                    for wall, edge in zip(walls, (front.start, front.end), strict=True)
                )
                return [Face(name, low.reversed()), *faces, Face(name, high)]
        if math.dist(start, front.start) > GAP_MM:
            faces.insert(0, Face(name, Segment(start, front.start)))
        if math.dist(front.end, end) > GAP_MM:
            faces.append(Face(name, Segment(front.end, end)))
        return faces

    def _check_tear(
        self, placed: PlacedLens, motion: NamedMotion, rotation: Rigid, edges: tuple[Point, Point], max_mm: float
    ) -> None:
        """Raise `DesignError` if an edge of a lens moves by more than its half width."""
        edge = max(edges, key=lambda edge: math.dist(rotation.point(edge), edge))
        displacement_mm = math.dist(rotation.point(edge), edge)
        if displacement_mm > max_mm:
            limit = (
                f"would tear lens {placed.name} from {point_text(edge)} by {displacement_mm:.3g} mm; "
                f"the limit is {max_mm:.3g} mm"
            )
            remedy = "reduce the rotation angle, or use a closer pivot"
            raise DesignError(f"network.motion {motion.name}", value=motion.at_deg, limit=limit, remedy=remedy)

    def _trimmed(
        self,
        placed: PlacedLens,
        motion: NamedMotion,
        front: Curve,
        corners: tuple[Point, Point],
        base: Point,
        inward: Point,
    ) -> tuple[Run, Run]:
        """Return the walls of the guide that ends in a rotated lens, shortened according to `motion.join`."""
        (path,), node = self.plan.at(placed.node or ""), placed.node or ""
        room_mm, lens = math.dist(*corners), self.plan.lenses[placed.name]
        if room_mm > 2.0 * lens.half_width_mm + ROUNDING_MM:
            number = self.plan.network.motion.index(motion)
            limit = f"requires a lens as wide as its guide, {room_mm:.4g} mm, at {point_text(base)}"
            raise DesignError(
                f"network.motion[{number}].join", value=motion.join, limit=limit, remedy='set join = "seam"'
            )
        sides = _arriving(path, node), _departing(path, node)
        for side_key, edge in zip(sides, (front.start, front.end), strict=True):
            height_mm = max(0.0, dot(minus(edge, base), inward)) + (
                lens.half_width_mm if motion.join == "smooth" else 0.0
            )
            if height_mm > 0.0:
                self.runs[side_key] = cut_at(self.runs[side_key], base, inward, height_mm, at_end=side_key == sides[0])
        return self.runs[sides[0]], self.runs[sides[1]]

    def _divided(self, side: Face, parts: list[Part]) -> list[Face]:
        """Return a side divided by the receivers and lenses on it."""
        measure = ArcLength(side.curve)
        ranges = sorted(((*self._range_mm(part), part) for part in parts), key=lambda row: row[:2])
        faces: list[Face] = []
        start_mm = side.begins_mm
        end_mm = side.begins_mm + measure.length_mm
        for low, high, part in ranges:
            if not (start_mm - ROUNDING_MM <= low and high <= end_mm + ROUNDING_MM):
                middle_text = point_text(side.curve.middle_point)
                limit = (
                    f"extends from {low:.4g} to {high:.4g} mm, but must be between {start_mm:.4g} and {end_mm:.4g} mm "
                    f"on {side.name}, near {middle_text}"
                )
                raise DesignError(part.name, limit=limit)
            if low - start_mm > ROUNDING_MM:
                faces.append(_segment(side, measure, start_mm, low))
            faces += self._part_faces(side, measure, low, high, part)
            start_mm = high
        if end_mm - start_mm > ROUNDING_MM:
            faces.append(_segment(side, measure, start_mm, end_mm))
        return faces[::-1] if side.from_end else faces

    def _part_faces(self, side: Face, measure: ArcLength, low: float, high: float, placed: Part) -> list[Face]:
        """Return the faces of a receiver or a lens on a side, in order of length along it."""
        segment = _segment(side, measure, low, high)
        if isinstance(placed, PlacedReceiver):
            return [Face(f"receiver-{placed.name}", segment.curve)]
        frame, inward = self._on_side(side, 0.5 * (low + high), placed)
        base = (frame.shift[0], frame.shift[1])
        faces = self._lens_between(placed, segment.curve.start, segment.curve.end, base, inward, side.name)
        return faces[::-1] if side.from_end else faces

    def _range_mm(self, part: Part) -> tuple[float, float]:
        """Return the range of lengths that a part occupies on its side."""
        if isinstance(part, PlacedReceiver):
            return part.from_mm or 0.0, part.to_mm or 0.0
        half_mm = self.plan.lenses[part.name].half_width_mm
        return (part.at_mm or 0.0) - half_mm, (part.at_mm or 0.0) + half_mm

    def _on_side(self, side_face: Face, at_mm: float, placed: Placed) -> tuple[Rigid, Point]:
        """Return the motion from the coordinates of a part on a straight side to the body, and the inward direction."""
        if not isinstance(side_face.curve, Segment):
            middle_text = point_text(side_face.curve.middle_point)
            limit = f"is not straight near {middle_text}"
            remedy = "place the part at the end of a separate short guide"
            raise DesignError(f"{placed.name}.guide", value=side_face.name, limit=limit, remedy=remedy)
        direction = unit(minus(side_face.curve.b, side_face.curve.a))
        length_mm = side_face.begins_mm + side_face.curve.length_mm
        if not side_face.begins_mm <= at_mm <= length_mm:
            limit = f"must be between {side_face.begins_mm:.4g} and {length_mm:.4g} mm on {side_face.name}"
            raise DesignError(f"{placed.name}.at_mm", value=at_mm, limit=limit)
        distance_mm, curve = at_mm - side_face.begins_mm, side_face.curve
        base = along(curve.b, direction, -distance_mm) if side_face.from_end else along(curve.a, direction, distance_mm)
        inward = left_of(direction)
        return _frame(base, inward, 0.0), inward

    def _rotation_of(self, name: str, kind: str) -> NamedMotion | None:
        """Return the motion that rotates a part; None if the part is not rotated."""
        names = {placed.name for placed in getattr(self.plan.network, kind)}
        rotations = [motion for motion in self.plan.network.motion if motion.kind == "rotation" and motion.part == name]
        return next((motion for motion in rotations if name in names and motion.at_deg != 0.0), None)

    def _check_single(self, number: int, node: str, placed: list[Part]) -> None:
        """Raise `DesignError` if there are several parts on one end."""
        if len(placed) > 1:
            names = " and ".join(part.name for part in placed)
            position_text = point_text(self.plan.positions[node])
            limit = f"{names} are on the same end, at {position_text}"
            raise DesignError(f"network.nodes[{number}]", value=node, limit=limit, remedy="give each a separate end")


def _check_node(plan: Plan, number: int, guide_count: int) -> None:
    """Raise `DesignError` if a key of a node does not apply."""
    node = plan.network.nodes[number]
    where = f"at {point_text(plan.positions[node.name])}"
    parts = [part for part in (*plan.network.lenses, *plan.network.receivers) if part.node == node.name]
    if node.end != "open" and (guide_count > 1 or parts):
        reason = f"{parts[0].name} is {where}" if parts else f"{guide_count} guides meet {where}"
        limit = f"does not apply: {reason}"
        raise DesignError(f"network.nodes[{number}].end", value=node.end, limit=limit, remedy="omit end")
    if guide_count == 1 and node.fillet_mm:
        limit = f"does not apply: a single guide ends {where}"
        raise DesignError(
            f"network.nodes[{number}].fillet_mm", value=node.fillet_mm, limit=limit, remedy="omit fillet_mm"
        )


def outlines(walk: Walk) -> list[tuple[Face, ...]]:
    """Return closed outlines; the first begins with the end that has the first emitter."""
    unwalked, walked = dict.fromkeys(walk.runs), []
    while unwalked:
        side_key, faces = next(iter(unwalked)), []
        while side_key in unwalked:
            del unwalked[side_key]
            faces += walk.faces(side_key)
            side_key = walk.following[side_key]
        walked.append(faces)
    counts, seen = Counter(face.name for faces in walked for face in faces), Counter[str]()

    def numbered(face: Face) -> Face:
        seen[face.name] += 1
        return replace(face, name=f"{face.name}.{seen[face.name]}") if counts[face.name] > 1 else face

    first_name = _first_name(walk.plan.network)
    ordered = sorted(
        (_beginning_with(faces, first_name) for faces in walked), key=lambda faces: faces[0].name != first_name
    )
    return [tuple(numbered(face) for face in faces) for faces in ordered]


def check_part_nodes(walk: Walk) -> None:
    """Raise `DesignError` if a part is at a node at which several guides meet."""
    network = walk.plan.network
    for kind in ("lenses", "emitters", "receivers"):
        for number, placed in enumerate(getattr(network, kind)):
            if placed.node is not None and len(walk.plan.at(placed.node)) != 1:
                position_text = point_text(walk.plan.positions[placed.node])
                limit = (
                    f"a part must be where a single guide ends, but {len(walk.plan.at(placed.node))} guides meet at "
                    f"{position_text}"
                )
                raise DesignError(f"network.{kind}[{number}].node", value=placed.node, limit=limit)


def _first_name(network: Network) -> str:
    emitter = network.emitters[0]
    return f"lens-{emitter.lens}" if emitter.lens else f"end-{emitter.node}"


def _beginning_with(faces: list[Face], name: str) -> list[Face]:
    """Return the faces, rotated to begin with the named one if there is one."""
    start = next((number for number, face in enumerate(faces) if face.name == name), 0)
    return faces[start:] + faces[:start]


def _run(path: GuidePath, side: str) -> Run:
    curve: Curve = path.walls[side]
    heading_deg = path.spine.heading_deg if len(path.guide.widths) == 1 and isinstance(curve, Segment) else None
    extension_mm = path.spine.length_mm if path.guide.flush not in (None, side) else 0.0
    return Run(
        path.guide.name,
        side,
        curve if side == "right" else curve.reversed(),
        heading_deg=heading_deg,
        extension_mm=extension_mm,
    )


def _arriving(path: GuidePath, node: str) -> SideKey:
    """Return the side of a guide that is walked towards a node."""
    return (path.guide.name, "right" if node == path.guide.nodes[1] else "left")


def _departing(path: GuidePath, node: str) -> SideKey:
    """Return the side of a guide that is walked away from a node."""
    return (path.guide.name, "right" if node == path.guide.nodes[0] else "left")


def _in_order(plan: Plan, node: str) -> list[GuidePath]:
    """Return the guides at a node, counter-clockwise by outward direction, and from right to left if parallel."""
    at = plan.positions[node]

    def order(path: GuidePath) -> tuple[float, float]:
        inward = path.inwards(node)
        angle = round(math.degrees(math.atan2(-inward[0], inward[1])), 9) % 360.0
        return angle, -dot(minus(path.middle(node), at), right_of(inward))

    return sorted(plan.at(node), key=order)


def _smooth(wall: Run, edge: Point, axis: Point, base: Point, inward: Point) -> Bezier:
    """Return a smooth curve into a wall from the edge of a rotated lens, where its tangent is along the lens axis."""
    at_end = math.dist(wall.end, edge) < math.dist(wall.start, edge)
    point, u = (wall.end, wall.high) if at_end else (wall.start, wall.low)
    slope = wall.curve.velocity_at(u)
    third_mm = (dot(minus(point, base), inward) - max(dot(minus(edge, base), inward), 0.0)) / 3.0
    return Bezier(edge, along(edge, axis, third_mm), along(point, slope, -third_mm / dot(slope, inward)), point)


def _frame(base: Point, inward: Point, depth_mm: float) -> Rigid:
    """Return the motion from the coordinates of a lens of a given depth to those of the body, from its base."""
    x, z = inward
    return Rigid(z, -x, along(base, inward, -depth_mm))


def _segment(side: Face, measure: ArcLength, low: float, high: float) -> Face:
    """Return the part of a side between two lengths along it."""
    length_mm = measure.length_mm
    low, high = low - side.begins_mm, high - side.begins_mm
    ends = (length_mm - high, length_mm - low) if side.from_end else (low, high)
    curve = side.curve.part(*(measure.u_at(end) for end in ends))
    return replace(side, curve=curve, begins_mm=side.begins_mm + low)
