"""Network outlines: walks along the guide walls, with the parts on ends and sides.

At a node, the walk continues from the right side of an arriving guide to the next guide counter-clockwise. Every side
of every guide is therefore walked once with the material on its left, and each closed walk is one outline: the outer
outline or the hole of a loop.
"""

import math
from collections import Counter
from dataclasses import dataclass, field, replace

from solen.curve import Arc, Bezier, Curve, Measure, Segment
from solen.errors import DesignError
from solen.geometry.body import GAP_MM, Face, Pose, place_text
from solen.geometry.network.corners import Run, cut_at, joined
from solen.geometry.network.plan import GuidePath, Plan, composed
from solen.plane import Point, Rigid, along, dot, left_of, minus, right_of, unit
from solen.spec.network import NamedMotion, Network, Placed, PlacedEmitter, PlacedLens, PlacedReceiver

Key = tuple[str, str]
"""A side of a guide: guide name, and right or left; the right side is walked from the first node to the second."""
Part = PlacedLens | PlacedReceiver
WIDER_MM = 1e-9
"""Rounding tolerance by which a lens may be wider than its guide."""


@dataclass
class Walk:
    """Guide sides in walking order, the side that follows each, and the curve or faces between them."""

    plan: Plan
    runs: dict[Key, Run]
    following: dict[Key, Key] = field(default_factory=dict)
    between: dict[Key, list[Face]] = field(default_factory=dict)
    frames: dict[str, Rigid] = field(default_factory=dict)
    """Motion from the local coordinates of each lens or, for an emitter without a lens, of its wall (z = 0), by
    name.
    """

    @classmethod
    def of(cls, plan: Plan) -> "Walk":
        """Walk around all nodes of a plan."""
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
            on_it = [one for one in (*plan.network.lenses, *plan.network.receivers) if one.node == node.name]
            if node.end != "open" and (len(paths) > 1 or on_it):
                there = f"{on_it[0].name} is there" if on_it else f"{len(paths)} guides meet there"
                limit = f"does not apply: {there}, at {place_text(plan.places[node.name])}"
                raise DesignError(f"network.nodes[{number}].end", value=node.end, limit=limit, remedy="omit it")
            if len(paths) == 1 and node.fillet_mm:
                limit = f"does not apply where one guide ends, at {place_text(plan.places[node.name])}"
                raise DesignError(f"network.nodes[{number}].fillet_mm", value=node.fillet_mm, limit=limit)
        return walk

    def corner(self, arriving: Key, departing: Key, fillet_mm: float, node: str) -> None:
        """Cut two walls at their intersection."""
        first, second, curve = joined(
            self.runs[arriving], self.runs[departing], fillet_mm, node, self.plan.places[node]
        )
        self.runs[arriving], self.runs[departing] = first, second
        self.between[arriving] = []
        if curve is not None:
            self.between[arriving] = [Face(f"{'fillet' if isinstance(curve, Arc) else 'join'}-{node}", curve)]

    def cap(self, path: GuidePath, node: str, number: int) -> list[Face]:
        """Return the faces across the end of a guide, from the arriving side to the departing side."""
        network = self.plan.network
        start, end = self.runs[_arriving(path, node)].end, self.runs[_departing(path, node)].start
        base, inward = (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])), path.inwards(node)
        base = base if path.guide.flush else (path.spine.start if node == path.guide.nodes[0] else path.spine.end)
        lenses = [placed for placed in network.lenses if placed.node == node]
        receivers = [placed for placed in network.receivers if placed.node == node]
        self._check_alone(number, node, [*lenses, *receivers])
        for emitter in network.emitters:
            if emitter.node == node:
                self.frames[emitter.name] = _frame(base, inward, 0.0)
        if lenses:
            return self._lens_between(lenses[0], start, end, base, inward, f"end-{node}")
        name = f"receiver-{receivers[0].name}" if receivers else f"{network.nodes[number].end}-{node}"
        return [Face(name.replace("open-", "end-", 1), Segment(start, end))]

    def faces(self, key: Key) -> list[Face]:
        """Faces of one side of a guide with its parts, in walking direction, and the faces up to the next side."""
        name, side = key
        run, network = self.runs[key], self.plan.network
        rest, from_end = run.rest, side == "left"
        lacking = (run.curve, run.high, 1.0) if from_end else (run.curve, 0.0, run.low)
        begins_mm = Measure(lacking[0].part(*lacking[1:])).length_mm if lacking[1] < lacking[2] else 0.0
        whole = Face(f"{name}-{side}", rest, from_end=from_end, begins_mm=begins_mm)
        on_it: list[Part] = [lens for lens in network.lenses if (lens.guide, lens.side) == key]
        on_it += [receiver for receiver in network.receivers if (receiver.guide, receiver.side) == key]
        for emitter in network.emitters:
            if (emitter.guide, emitter.side) == key:
                self.frames[emitter.name] = self._on_side(whole, emitter.at_mm or 0.0, 0.0, emitter)[0]
        if not on_it:
            return [whole, *self.between[key]]
        return [*self._divided(whole, on_it), *self.between[key]]

    def emitter(self, placed: PlacedEmitter, distance_mm: float, offset_mm: float) -> Pose:
        """Return the pose of an emitter."""
        frame = self.frames[placed.lens or placed.name]
        pose = Pose(frame.point((offset_mm, -distance_mm)), frame.angle_deg)
        motion = self._turn(placed.name, "emitters")
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
        return self.plan.carried.get(node or "", Rigid()).point(motion.pivot)

    def _lens_between(
        self, placed: PlacedLens, start: Point, end: Point, base: Point, inward: Point, beside: str
    ) -> list[Face]:
        """Return a lens across an end or on a side, with straight faces on both sides of it if it is narrower."""
        lens = self.plan.lenses[placed.name]
        room_mm = math.dist(start, end)
        if 2.0 * lens.half_width_mm > room_mm + WIDER_MM:
            number = self.plan.network.lenses.index(placed)
            limit = f"must be at most {0.5 * room_mm:.4g} mm, half the width there, at {place_text(base)}"
            what = f"network.lenses[{number}].half_width_mm"
            raise DesignError(what, value=lens.half_width_mm, limit=limit, remedy="narrow the lens or widen the guide")
        frame = _frame(base, inward, lens.depth_mm)
        motion = self._turn(placed.name, "lenses")
        if motion is not None:
            distance_mm = next(
                (emitter.distance_mm for emitter in self.plan.network.emitters if emitter.lens == placed.name), None
            )
            before = frame.point((0.0, -(distance_mm or self.plan.distance_mm)))
            turn = Rigid.about(self._pivot(motion, placed.node, before, base), motion.at_deg)
            rest, frame = lens.front.moved(frame), composed(frame, turn)
            self._check_tear(placed, motion, turn, (rest.start, rest.end), lens.half_width_mm)
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
                return [Face(beside, low.reversed()), *faces, Face(beside, high)]
        if math.dist(start, front.start) > GAP_MM:
            faces.insert(0, Face(beside, Segment(start, front.start)))
        if math.dist(front.end, end) > GAP_MM:
            faces.append(Face(beside, Segment(front.end, end)))
        return faces

    def _check_tear(
        self, placed: PlacedLens, motion: NamedMotion, turn: Rigid, edges: tuple[Point, Point], most_mm: float
    ) -> None:
        """Raise `DesignError` if an edge of a lens moves away by more than its half width."""
        place = max(edges, key=lambda edge: math.dist(turn.point(edge), edge))
        off_mm = math.dist(turn.point(place), place)
        if off_mm > most_mm:
            limit = (
                f"would tear lens {placed.name} from {place_text(place)} by {off_mm:.3g} mm; "
                f"the limit is {most_mm:.3g} mm"
            )
            remedy = "reduce the rotation angle, or use a nearer pivot"
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
        """Walls of the guide that ends in a rotated lens, shortened to meet the lens according to `motion.join`."""
        (path,), node = self.plan.at(placed.node or ""), placed.node or ""
        room_mm, lens = math.dist(*corners), self.plan.lenses[placed.name]
        if room_mm > 2.0 * lens.half_width_mm + WIDER_MM:
            number = self.plan.network.motion.index(motion)
            limit = f"requires a lens as wide as its guide, {room_mm:.4g} mm, at {place_text(base)}"
            raise DesignError(
                f"network.motion[{number}].join", value=motion.join, limit=limit, remedy='set join = "seam"'
            )
        keys = _arriving(path, node), _departing(path, node)
        for key, edge in zip(keys, (front.start, front.end), strict=True):
            risen_mm = max(0.0, dot(minus(edge, base), inward)) + (
                lens.half_width_mm if motion.join == "smooth" else 0.0
            )
            if risen_mm > 0.0:
                self.runs[key] = cut_at(self.runs[key], base, inward, risen_mm, at_end=key == keys[0])
        return self.runs[keys[0]], self.runs[keys[1]]

    def _divided(self, whole: Face, on_it: list[Part]) -> list[Face]:
        """Return a side divided by the receivers and lenses on it."""
        measure = Measure(whole.curve)
        stretches = sorted(((*self._stretch(one), one) for one in on_it), key=lambda row: row[:2])
        faces: list[Face] = []
        done = whole.begins_mm
        last_mm = whole.begins_mm + measure.length_mm
        for low, high, one in stretches:
            if not (done - WIDER_MM <= low and high <= last_mm + WIDER_MM):
                place = place_text(whole.curve.middle_point)
                limit = f"must be between {done:.4g} and {last_mm:.4g} mm on {whole.name}, near {place}"
                raise DesignError(one.name, value=f"from {low:.4g} to {high:.4g} mm", limit=limit)
            if low - done > WIDER_MM:
                faces.append(_part(whole, measure, done, low))
            faces += self._standing(whole, measure, low, high, one)
            done = high
        if last_mm - done > WIDER_MM:
            faces.append(_part(whole, measure, done, last_mm))
        return faces[::-1] if whole.from_end else faces

    def _standing(self, whole: Face, measure: Measure, low: float, high: float, one: Part) -> list[Face]:
        """Return the faces of a receiver or a lens on a side, in order of length along it."""
        part = _part(whole, measure, low, high)
        if isinstance(one, PlacedReceiver):
            return [Face(f"receiver-{one.name}", part.curve)]
        frame, inward = self._on_side(whole, 0.5 * (low + high), 0.0, one)
        base = (frame.shift[0], frame.shift[1])
        faces = self._lens_between(one, part.curve.start, part.curve.end, base, inward, whole.name)
        return faces[::-1] if whole.from_end else faces

    def _stretch(self, one: Part) -> tuple[float, float]:
        """Return the range of lengths of a side that a part occupies."""
        if isinstance(one, PlacedReceiver):
            return one.from_mm or 0.0, one.to_mm or 0.0
        half_mm = self.plan.lenses[one.name].half_width_mm
        return (one.at_mm or 0.0) - half_mm, (one.at_mm or 0.0) + half_mm

    def _on_side(self, whole: Face, at_mm: float, depth_mm: float, one: Placed) -> tuple[Rigid, Point]:
        """Local coordinates of a part at a length along a straight side, and the direction into the guide."""
        if not isinstance(whole.curve, Segment):
            place = place_text(whole.curve.middle_point)
            limit = f"is not straight, near {place}"
            remedy = "place the part at the end of a separate short guide"
            raise DesignError(f"{one.name}.guide", value=whole.name, limit=limit, remedy=remedy)
        walked = unit(minus(whole.curve.b, whole.curve.a))
        length_mm = whole.begins_mm + whole.curve.length_mm
        if not whole.begins_mm <= at_mm <= length_mm:
            limit = f"must be between {whole.begins_mm:.4g} and {length_mm:.4g} mm on {whole.name}"
            raise DesignError(f"{one.name}.at_mm", value=at_mm, limit=limit)
        step = at_mm - whole.begins_mm
        base = along(whole.curve.b, walked, -step) if whole.from_end else along(whole.curve.a, walked, step)
        inward = left_of(walked)
        return _frame(base, inward, depth_mm), inward

    def _turn(self, name: str, kind: str) -> NamedMotion | None:
        """Return the motion that rotates a part; None if the part is not rotated."""
        names = {one.name for one in getattr(self.plan.network, kind)}
        turns = [motion for motion in self.plan.network.motion if motion.kind == "rotation" and motion.part == name]
        return next((turn for turn in turns if name in names and turn.at_deg != 0.0), None)

    def _check_alone(self, number: int, node: str, placed: list[Part]) -> None:
        """Raise `DesignError` if two parts are on one end."""
        if len(placed) > 1:
            names = " and ".join(one.name for one in placed)
            where = place_text(self.plan.places[node])
            limit = f"{names} are both there, at {where}"
            raise DesignError(f"network.nodes[{number}]", value=node, limit=limit, remedy="give each a separate end")


SIDES = ("right", "left")


def outlines(walk: Walk) -> list[tuple[Face, ...]]:
    """Return closed outlines; the outline with the end of the first lens or emitter comes first and begins there."""
    left, found = dict.fromkeys(walk.runs), []
    while left:
        key, faces = next(iter(left)), []
        while key in left:
            del left[key]
            faces += walk.faces(key)
            key = walk.following[key]
        found.append(faces)
    counts, seen = Counter(face.name for faces in found for face in faces), Counter[str]()

    def numbered(face: Face) -> Face:
        seen[face.name] += 1
        return replace(face, name=f"{face.name}.{seen[face.name]}") if counts[face.name] > 1 else face

    first = _first_name(walk.plan.network)
    ordered = sorted((_from(faces, first) for faces in found), key=lambda faces: faces[0].name != first)
    return [tuple(numbered(face) for face in faces) for faces in ordered]


def check_places(walk: Walk) -> None:
    """Raise `DesignError` if a part is at a node at which several guides meet."""
    network = walk.plan.network
    for kind in ("lenses", "emitters", "receivers"):
        for number, placed in enumerate(getattr(network, kind)):
            if placed.node is not None and len(walk.plan.at(placed.node)) != 1:
                where = place_text(walk.plan.places[placed.node])
                limit = (
                    f"{len(walk.plan.at(placed.node))} guides meet there, at {where}; a part "
                    "must be where a single guide ends"
                )
                raise DesignError(f"network.{kind}[{number}].node", value=placed.node, limit=limit)


def _first_name(network: Network) -> str:
    first = network.emitters[0]
    return f"lens-{first.lens}" if first.lens else f"end-{first.node}"


def _from(faces: list[Face], name: str) -> list[Face]:
    """Return faces rotated to begin with the named one, if there is one."""
    start = next((number for number, face in enumerate(faces) if face.name == name), 0)
    return faces[start:] + faces[:start]


def _run(path: GuidePath, side: str) -> Run:
    curve: Curve = path.walls[side]
    stated = path.spine.heading_deg if len(path.guide.widths) == 1 and isinstance(curve, Segment) else None
    back_mm = path.spine.length_mm if path.guide.flush not in (None, side) else 0.0
    return Run(
        path.guide.name, side, curve if side == "right" else curve.reversed(), heading_deg=stated, back_mm=back_mm
    )


def _arriving(path: GuidePath, node: str) -> Key:
    """Return the side of a guide that is walked towards a node."""
    return (path.guide.name, "right" if node == path.guide.nodes[1] else "left")


def _departing(path: GuidePath, node: str) -> Key:
    """Return the side of a guide that is walked away from a node."""
    return (path.guide.name, "right" if node == path.guide.nodes[0] else "left")


def _in_order(plan: Plan, node: str) -> list[GuidePath]:
    """Guides at a node, counter-clockwise by outward direction; of parallel guides, the right one comes first."""
    at = plan.places[node]

    def order(path: GuidePath) -> tuple[float, float]:
        inward = path.inwards(node)
        angle = round(math.degrees(math.atan2(-inward[0], inward[1])), 9) % 360.0
        return angle, -dot(minus(path.middle(node), at), right_of(inward))

    return sorted(plan.at(node), key=order)


def _smooth(wall: Run, edge: Point, axis: Point, base: Point, inward: Point) -> Bezier:
    """Return a curve from the edge of a rotated lens, along the lens axis, into the wall of its guide."""
    at_end = math.dist(wall.end, edge) < math.dist(wall.start, edge)
    place, u = (wall.end, wall.high) if at_end else (wall.start, wall.low)
    slope = wall.curve.velocity_at(u)
    third_mm = (dot(minus(place, base), inward) - max(dot(minus(edge, base), inward), 0.0)) / 3.0
    return Bezier(edge, along(edge, axis, third_mm), along(place, slope, -third_mm / dot(slope, inward)), place)


def _frame(base: Point, inward: Point, depth_mm: float) -> Rigid:
    """Return the motion from the coordinates of a lens, with its vertex in front of a base, to those of the body."""
    x, z = inward
    return Rigid(z, -x, along(base, inward, -depth_mm))


def _part(whole: Face, measure: Measure, low: float, high: float) -> Face:
    """Return the part of a side between two lengths along it."""
    length_mm = measure.length_mm
    low, high = low - whole.begins_mm, high - whole.begins_mm
    ends = (length_mm - high, length_mm - low) if whole.from_end else (low, high)
    curve = whole.curve.part(*(measure.u_at(end) for end in ends))
    return replace(whole, curve=curve, begins_mm=whole.begins_mm + low)
