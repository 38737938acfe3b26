"""Positions of the guides and parts of a network, unmoved and with its motions at their angles.

A node without a specified position is at the end of the guide that leads there. Motions propagate outwards from the
fixed node: everything beyond a guide that bends or rotates is carried along.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

from numpy.polynomial import polynomial

from solen.curve import Curve
from solen.errors import DesignError
from solen.geometry.body import place_text
from solen.geometry.network.spine import Offset, Spine
from solen.lens import Lens, lens_of
from solen.material import optical
from solen.plane import Point, Rigid, along, minus
from solen.spec import Design
from solen.spec.network import Guide, NamedMotion, Network, PlacedLens
from solen.spec.placed import lens_table, lit

MEETS_MM = 1e-9
"""Maximum distance of the end of a guide from its second node."""


@dataclass(frozen=True)
class GuidePath:
    """A guide with its centre line.

    ``right`` and ``left`` are the distances of its walls to the right of that line.
    """

    guide: Guide
    spine: Spine
    right: Offset
    left: Offset

    @cached_property
    def walls(self) -> dict[str, Curve]:
        """Return both walls from the first node of the guide to the second, by side."""
        what = f"guide {self.guide.name}"
        return {side: self.spine.wall(getattr(self, side), what) for side in ("right", "left")}

    def middle(self, node: str) -> Point:
        """Return the midpoint of the guide section at one of its nodes."""
        (a, b), (c, d) = (self.section(node, side) for side in ("right", "left"))
        return (0.5 * (a + c), 0.5 * (b + d))

    def section(self, node: str, side: str) -> Point:
        """Return the corners of the guide section at one of its nodes."""
        wall = self.walls[side]
        return wall.start if node == self.guide.nodes[0] else wall.end

    def inwards(self, node: str) -> Point:
        """Return the unit direction of the guide as it leaves a node."""
        if node == self.guide.nodes[0]:
            return self.spine.direction
        x, z = self.spine.end_direction
        return (-x, -z)

    def moved(self, motion: Rigid) -> "GuidePath":
        """Return the guide after a rigid motion."""
        return self if motion == Rigid() else replace(self, spine=self.spine.moved(motion))


@dataclass(frozen=True)
class Plan:
    """Guides by name after motion, node positions, and lenses by name.

    ``carried`` are the motions of the nodes from the unmoved state; empty if no node has moved.
    """

    network: Network
    paths: dict[str, GuidePath]
    places: dict[str, Point]
    lenses: dict[str, Lens]
    carried: dict[str, Rigid] = field(default_factory=dict)
    distance_mm: float = 0.0
    """distance from its lens of an emitter for which none is specified"""

    def at(self, node: str) -> list[GuidePath]:
        """Return the guides at a node."""
        return [path for path in self.paths.values() if node in path.guide.nodes]


def plan_of(design: Design) -> Plan:
    """Return the plan of a design's network with its motions at their angles.

    Raises
    ------
    DesignError
        If a node is not connected, the position of a guide is undefined, a lens cannot be made, or a motion would tear
        a loop.
    """
    rest = replace(at_rest(design), network=design.network, distance_mm=design.shared_emitter.distance_mm)
    return _in_motion(rest, design.network.motion)


def at_rest(design: Design) -> Plan:
    """Return the plan of a design's network without motion."""
    resting = tuple(motion.model_copy(update={"at_deg": 0.0}) for motion in design.network.motion)
    network = design.network.model_copy(update={"motion": resting, "lit": None})
    shared = design.shared_emitter
    rest = design.model_copy(update={"network": network, "emitter": shared})
    stated = (frozenset(rest.lens.model_fields_set), frozenset(shared.model_fields_set))
    indices = tuple(optical(lit(rest, emitter.name)).index for emitter in network.emitters)
    return _planned(_Key(rest, (network, rest.lens, shared, rest.material, *stated, indices, str(rest.folder))))


@dataclass(frozen=True)
class _Key:
    """Cache key of a design, equal for all designs with the same network, lenses and material."""

    design: Design
    of: tuple[object, ...]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self.of == other.of

    def __hash__(self) -> int:
        return hash(self.of)


@lru_cache(maxsize=64)
def _planned(key: _Key) -> Plan:
    design = key.design
    network = design.network
    _check_connected(network)
    lenses = {placed.name: _lens(design, number, placed) for number, placed in enumerate(network.lenses)}
    places: dict[str, Point] = {node.name: node.at_mm for node in network.nodes if node.at_mm is not None}
    first = network.nodes[0].name
    if first not in places:
        places[first] = _origin(network, lenses, first)
    paths: dict[str, GuidePath] = {}
    waiting = list(network.guides)
    while waiting:
        ready = next((guide for guide in waiting if (path := _placed(guide, network, places, paths)) is not None), None)
        if ready is None:
            number = network.guides.index(waiting[0])
            limit = "has no position: neither of its nodes has one, or its direction is missing"
            remedy = "specify direction_deg and length_mm, or at_mm of its nodes"
            raise DesignError(f"network.guides[{number}]", value=waiting[0].name, limit=limit, remedy=remedy)
        waiting.remove(ready)
        path = _placed(ready, network, places, paths)
        assert path is not None  # noqa: S101  the path is complete
        paths[ready.name] = path
        _settle(path, places, network.guides.index(ready))
    order = {guide.name: paths[guide.name] for guide in network.guides}
    return Plan(network, order, places, lenses)


def _check_connected(network: Network) -> None:
    """Raise `DesignError` for a node that is not connected to the first by a chain of guides."""
    reached = {network.nodes[0].name} if network.nodes else set[str]()
    for _ in network.guides:
        reached |= {node for guide in network.guides if reached & set(guide.nodes) for node in guide.nodes}
    for number, node in enumerate(network.nodes):
        if node.name not in reached or len(reached) == 1:
            where = "" if node.at_mm is None else f", at {place_text(node.at_mm)}"
            limit = f"is not connected: no guide leads there from {network.nodes[0].name}{where}"
            raise DesignError(f"network.nodes[{number}]", value=node.name, limit=limit, remedy="add a guide")


def _lens(design: Design, number: int, placed: PlacedLens) -> Lens:
    """Return a lens of a network, computed for its emitter, or for ``[emitter]`` if it has none."""
    network = design.network
    before = next((emitter.name for emitter in network.emitters if emitter.lens == placed.name), None)
    own = design if before is None else lit(design, before)
    table = lens_table(design, placed, _half_width_mm(network, number, placed))
    made = own.model_copy(update={"lens": table}).in_folder(design.folder)
    try:
        return lens_of(made, optical(own).index)
    except DesignError as bad:
        what = f"network.lenses[{number}]: {bad.what}"
        raise DesignError(what, value=bad.value, limit=bad.limit, remedy=bad.remedy) from None


def _half_width_mm(network: Network, number: int, placed: PlacedLens) -> float | None:
    """Return half the width of the guide that ends in a lens; None for a lens on a side."""
    if placed.node is None:
        return None
    guides = [guide for guide in network.guides if placed.node in guide.nodes]
    if len(guides) != 1:
        limit = f"a lens must be at the end of one guide, but {len(guides)} meet there"
        raise DesignError(f"network.lenses[{number}].node", value=placed.node, limit=limit)
    (guide,) = guides
    if guide.nodes[0] == placed.node or len(guide.widths) == 1:
        return 0.5 * guide.widths[0]
    if guide.length_mm is not None:
        return 0.5 * float(polynomial.polyval(guide.length_mm, guide.widths))
    return None


def _origin(network: Network, lenses: dict[str, Lens], node: str) -> Point:
    """Return the position of the first node: the origin, or the position that puts its lens vertex at the origin."""
    lens = next((lenses[placed.name] for placed in network.lenses if placed.node == node), None)
    guide = next(guide for guide in network.guides if node in guide.nodes)
    if lens is None or guide.direction_deg is None or guide.nodes[0] != node:
        return (0.0, 0.0)
    start = Spine.towards((0.0, 0.0), guide.direction_deg, 1.0, 0.0)
    return along((0.0, 0.0), start.direction, lens.depth_mm)


def _placed(guide: Guide, network: Network, places: dict[str, Point], paths: dict[str, GuidePath]) -> GuidePath | None:
    """Return a guide with its line; None while the line is unknown."""
    start, end = (places.get(node) for node in guide.nodes)
    half = tuple(0.5 * width for width in guide.widths)
    both = (half, tuple(-width for width in half))
    if guide.flush is not None:
        return _flush(guide, network, paths)
    if guide.direction_deg is not None and guide.length_mm is not None:
        if start is None and end is None:
            return None
        spine = Spine.towards(start or (0.0, 0.0), guide.direction_deg, guide.length_mm, guide.turn_deg)
        if start is None and end is not None:
            spine = replace(spine, start=minus(end, spine.end))
        return GuidePath(guide, spine, *both)
    if start is None or end is None:
        return None
    if math.dist(start, end) <= MEETS_MM:
        number = network.guides.index(guide)
        limit = f"has no length: both its nodes are at {place_text(start)}"
        raise DesignError(f"network.guides[{number}]", value=guide.name, limit=limit)
    return GuidePath(guide, Spine.between(start, end, guide.turn_deg, guide.through_mm), *both)


def _flush(guide: Guide, network: Network, paths: dict[str, GuidePath]) -> GuidePath | None:
    """Return a guide whose side continues the side of the guide leading to its first node."""
    leading = [one for one in network.guides if one.nodes[1] == guide.nodes[0]]
    if len(leading) != 1:
        number = network.guides.index(guide)
        limit = f"requires exactly one guide that leads to {guide.nodes[0]}, but there are {len(leading)}"
        raise DesignError(f"network.guides[{number}].flush", value=guide.flush, limit=limit)
    if leading[0].name not in paths or guide.length_mm is None or guide.flush is None:
        return None
    host, side = paths[leading[0].name], 1.0 if guide.flush == "right" else -1.0
    heading_deg = guide.direction_deg
    if heading_deg is None:
        slope = float(polynomial.polyval(host.spine.length_mm, polynomial.polyder(getattr(host, guide.flush))))
        x, z = host.spine.end_direction
        heading_deg = math.degrees(math.atan2(-x, z)) - math.degrees(math.atan(slope))
    spine = Spine.towards(host.walls[guide.flush].end, heading_deg, guide.length_mm, guide.turn_deg)
    far = tuple(-side * width for width in guide.widths)
    return GuidePath(guide, spine, (0.0,), far) if guide.flush == "right" else GuidePath(guide, spine, far, (0.0,))


def _settle(path: GuidePath, places: dict[str, Point], number: int) -> None:
    """Assign positions to the nodes of a guide; raises `DesignError` if they contradict known positions."""
    if path.guide.flush is not None:
        found = {path.guide.nodes[1]: path.middle(path.guide.nodes[1])}
    else:
        found = dict(zip(path.guide.nodes, (path.spine.start, path.spine.end), strict=True))
    for node, place in found.items():
        off_mm = math.dist(places.setdefault(node, place), place)
        if off_mm > MEETS_MM:
            limit = f"ends {off_mm:.3g} mm from {node}, which is at {place_text(places[node])}"
            remedy = "omit direction_deg and length_mm, or at_mm of the node"
            raise DesignError(f"network.guides[{number}]", value=path.guide.name, limit=limit, remedy=remedy)


def _in_motion(rest: Plan, motions: tuple[NamedMotion, ...]) -> Plan:
    """Return a plan with its motions at their angles."""
    moving = {motion.part: motion for motion in motions if motion.at_deg != 0.0 and motion.part in rest.paths}
    if not moving:
        return rest
    fixed = rest.network.fixed or rest.network.nodes[0].name
    carried: dict[str, Rigid] = {fixed: Rigid()}
    paths: dict[str, GuidePath] = {}
    for path, node in _outwards(rest, fixed):
        moved, beyond = _driven(path, node, moving.get(path.guide.name))
        paths[path.guide.name] = moved.moved(carried[node])
        (other,) = set(path.guide.nodes) - {node}
        motion = composed(beyond, carried[node])
        known = carried.setdefault(other, motion)
        off_mm = math.dist(known.point(rest.places[other]), motion.point(rest.places[other]))
        if off_mm > MEETS_MM or abs(known.angle_deg - motion.angle_deg) > MEETS_MM:
            name = ", ".join(one.name for one in moving.values())
            limit = (
                f"would tear {path.guide.name} from {other}, at {place_text(rest.places[other])}, by {off_mm:.3g} mm"
            )
            remedy = "a guide that bends or rotates must not be part of a loop"
            raise DesignError("network.motion", value=name, limit=limit, remedy=remedy)
    order = {name: paths[name] for name in rest.paths}
    places = {node: carried[node].point(place) for node, place in rest.places.items()}
    return replace(rest, paths=order, places=places, carried=carried)


def _outwards(plan: Plan, fixed: str) -> Iterator[tuple[GuidePath, str]]:
    """Return guides with their nearer nodes, ordered outwards from the fixed node."""
    reached, left = [fixed], list(plan.paths.values())
    for node in reached:
        for path in [path for path in left if node in path.guide.nodes]:
            left.remove(path)
            yield path, node
            reached += [other for other in path.guide.nodes if other not in reached]


def _driven(path: GuidePath, node: str, motion: NamedMotion | None) -> tuple[GuidePath, Rigid]:
    """Return a guide bent or rotated about its nearer node, and the motion of its other end."""
    if motion is None:
        return path, Rigid()
    from_end = node == path.guide.nodes[1]
    if motion.kind == "rotation":
        near = path.spine.end if from_end else path.spine.start
        turn = Rigid.about(near if not isinstance(motion.pivot, tuple) else motion.pivot, motion.at_deg)
        _check_tear(path, near, turn, motion)
        return path.moved(turn), turn
    spine, beyond = path.spine.bent(motion.at_deg, from_end=from_end)
    return replace(path, spine=spine), beyond


def _check_tear(path: GuidePath, near: Point, turn: Rigid, motion: NamedMotion) -> None:
    """Raise `DesignError` if a rotation moves a guide away from its node by more than half its width there."""
    off_mm = math.dist(turn.point(near), near)
    half_mm = 0.5 * min(path.guide.widths[0], float(polynomial.polyval(path.spine.length_mm, path.guide.widths)))
    if off_mm > half_mm:
        limit = (
            f"would tear {path.guide.name} from {place_text(near)} by {off_mm:.3g} mm; the limit "
            f"there is {half_mm:.3g} mm"
        )
        remedy = "reduce the rotation angle, or use a nearer pivot"
        raise DesignError(f"network.motion {motion.name}", value=motion.at_deg, limit=limit, remedy=remedy)


def composed(first: Rigid, then: Rigid) -> Rigid:
    """Return the motion ``first`` followed by another."""
    if then == Rigid():
        return first
    cos, sin = then.vector((first.cos, first.sin))
    return Rigid(cos, sin, then.point(first.shift))
