"""Positions of the guides and parts of a network, at rest and with its motions at their angles.

A node without a specified position is at the end of the guide that leads to it. Motions propagate outwards from the
fixed node: everything beyond a guide that bends or rotates moves with its end.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

from numpy.polynomial import polynomial

from solen.curve import Curve
from solen.errors import DesignError
from solen.geometry.body import point_text
from solen.geometry.network.spine import Offset, Spine
from solen.lens import Lens, lens_of
from solen.material import optical
from solen.plane import Point, Rigid, along, minus
from solen.spec import Design
from solen.spec.network import Guide, NamedMotion, Network, PlacedLens
from solen.spec.placed import lens_table, lit

MAX_MISMATCH_MM = 1e-9
"""Maximum distance between the computed end of a guide and the specified position of the node at that end."""


@dataclass(frozen=True)
class GuidePath:
    """A guide with its centre line, and the offsets of its walls to the right of that line, keyed by side."""

    guide: Guide
    spine: Spine
    offsets: dict[str, Offset]

    @cached_property
    def walls(self) -> dict[str, Curve]:
        """Both walls from the first node of the guide to the second, keyed by side."""
        what = f"guide {self.guide.name}"
        return {side: self.spine.wall(offset, what) for side, offset in self.offsets.items()}

    def middle(self, node: str) -> Point:
        """Return the midpoint between the walls at a node of the guide."""
        (a, b), (c, d) = (self.corner(node, side) for side in self.walls)
        return (0.5 * (a + c), 0.5 * (b + d))

    def corner(self, node: str, side: str) -> Point:
        """Return the end of the wall on one side at a node of the guide."""
        wall = self.walls[side]
        return wall.start if node == self.guide.nodes[0] else wall.end

    def inwards(self, node: str) -> Point:
        """Return the unit direction from a node into the guide."""
        if node == self.guide.nodes[0]:
            return self.spine.direction
        x, z = self.spine.end_direction
        return (-x, -z)

    def moved(self, motion: Rigid) -> "GuidePath":
        """Return the guide after a rigid motion."""
        return self if motion == Rigid() else replace(self, spine=self.spine.moved(motion))


@dataclass(frozen=True)
class Plan:
    """Guides, node positions and lenses, all keyed by name, after the motions.

    ``node_motions`` are the motions of the nodes from rest; empty if no node has moved.
    """

    network: Network
    paths: dict[str, GuidePath]
    positions: dict[str, Point]
    lenses: dict[str, Lens]
    node_motions: dict[str, Rigid] = field(default_factory=dict)
    distance_mm: float = 0.0
    """Distance between an emitter and its lens if the design specifies none."""

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
    """Return the plan of a design's network at rest."""
    resting = tuple(motion.model_copy(update={"at_deg": 0.0}) for motion in design.network.motion)
    network = design.network.model_copy(update={"motion": resting, "lit": None})
    shared = design.shared_emitter
    rest = design.model_copy(update={"network": network, "emitter": shared})
    specified = (frozenset(rest.lens.model_fields_set), frozenset(shared.model_fields_set))
    indices = tuple(optical(lit(rest, emitter.name)).index for emitter in network.emitters)
    return _planned(_CacheKey(rest, (network, rest.lens, shared, rest.material, *specified, indices, str(rest.folder))))


@dataclass(frozen=True)
class _CacheKey:
    """A design as a cache key, equal for all designs with the same network, lenses and material."""

    design: Design = field(compare=False)
    identity: tuple[object, ...]


@lru_cache(maxsize=64)
def _planned(key: _CacheKey) -> Plan:
    design = key.design
    network = design.network
    _check_connected(network)
    lenses = {placed.name: _lens(design, number, placed) for number, placed in enumerate(network.lenses)}
    positions: dict[str, Point] = {node.name: node.at_mm for node in network.nodes if node.at_mm is not None}
    first = network.nodes[0].name
    if first not in positions:
        positions[first] = _origin(network, lenses, first)
    paths: dict[str, GuidePath] = {}
    remaining = list(network.guides)
    while remaining:
        placed = next(
            ((guide, path) for guide in remaining if (path := _path_of(guide, network, positions, paths))), None
        )
        if placed is None:
            number = network.guides.index(remaining[0])
            limit = "has no position: neither of its nodes has one, or its direction is missing"
            remedy = "specify direction_deg and length_mm, or at_mm of its nodes"
            raise DesignError(f"network.guides[{number}]", value=remaining[0].name, limit=limit, remedy=remedy)
        guide, path = placed
        remaining.remove(guide)
        paths[guide.name] = path
        _set_positions(path, positions, network.guides.index(guide))
    order = {guide.name: paths[guide.name] for guide in network.guides}
    return Plan(network, order, positions, lenses)


def _check_connected(network: Network) -> None:
    """Raise `DesignError` for a node that is not connected to the first by a chain of guides."""
    reached = {network.nodes[0].name} if network.nodes else set[str]()
    for _ in network.guides:
        reached |= {node for guide in network.guides if reached & set(guide.nodes) for node in guide.nodes}
    for number, node in enumerate(network.nodes):
        if node.name not in reached or len(reached) == 1:
            where = "" if node.at_mm is None else f", at {point_text(node.at_mm)}"
            limit = f"is not connected: no guide leads there from {network.nodes[0].name}{where}"
            raise DesignError(f"network.nodes[{number}]", value=node.name, limit=limit, remedy="add a guide")


def _lens(design: Design, number: int, placed: PlacedLens) -> Lens:
    """Return a lens of a network, computed for its emitter, or for ``[emitter]`` if it has none."""
    network = design.network
    emitter_name = next((emitter.name for emitter in network.emitters if emitter.lens == placed.name), None)
    lit_design = design if emitter_name is None else lit(design, emitter_name)
    table = lens_table(design, placed, _half_width_mm(network, number, placed))
    lens_design = lit_design.model_copy(update={"lens": table}).in_folder(design.folder)
    try:
        return lens_of(lens_design, optical(lit_design).index)
    except DesignError as bad:
        what = f"network.lenses[{number}]: {bad.what}"
        raise DesignError(what, value=bad.value, limit=bad.limit, remedy=bad.remedy) from None


def _half_width_mm(network: Network, number: int, placed: PlacedLens) -> float | None:
    """Return half the width of the guide that ends in a lens; None for a lens on a side, or an unknown width."""
    if placed.node is None:
        return None
    guides = [guide for guide in network.guides if placed.node in guide.nodes]
    if len(guides) != 1:
        limit = f"a lens must be at the end of a single guide, but {len(guides)} meet there"
        raise DesignError(f"network.lenses[{number}].node", value=placed.node, limit=limit)
    (guide,) = guides
    if guide.nodes[0] == placed.node or len(guide.widths) == 1:
        return 0.5 * guide.widths[0]
    if guide.length_mm is not None:
        return 0.5 * float(polynomial.polyval(guide.length_mm, guide.widths))
    return None


def _origin(network: Network, lenses: dict[str, Lens], node: str) -> Point:
    """Return the position of the first node: the origin, or such that its lens vertex is the origin."""
    lens = next((lenses[placed.name] for placed in network.lenses if placed.node == node), None)
    guide = next(guide for guide in network.guides if node in guide.nodes)
    if lens is None or guide.direction_deg is None or guide.nodes[0] != node:
        return (0.0, 0.0)
    start = Spine.from_heading((0.0, 0.0), guide.direction_deg, 1.0, 0.0)
    return along((0.0, 0.0), start.direction, lens.depth_mm)


def _path_of(
    guide: Guide, network: Network, positions: dict[str, Point], paths: dict[str, GuidePath]
) -> GuidePath | None:
    """Return a guide with its centre line; None while that line is unknown."""
    start, end = (positions.get(node) for node in guide.nodes)
    half = tuple(0.5 * width for width in guide.widths)
    offsets = {"right": half, "left": tuple(-width for width in half)}
    if guide.flush is not None:
        return _flush_path(guide, network, paths)
    if guide.direction_deg is not None and guide.length_mm is not None:
        if start is None and end is None:
            return None
        spine = Spine.from_heading(start or (0.0, 0.0), guide.direction_deg, guide.length_mm, guide.turn_deg)
        if start is None and end is not None:
            spine = replace(spine, start=minus(end, spine.end))
        return GuidePath(guide, spine, offsets)
    if start is None or end is None:
        return None
    if math.dist(start, end) <= MAX_MISMATCH_MM:
        number = network.guides.index(guide)
        limit = f"has no length: both its nodes are at {point_text(start)}"
        raise DesignError(f"network.guides[{number}]", value=guide.name, limit=limit)
    return GuidePath(guide, Spine.between(start, end, guide.turn_deg, guide.through_mm), offsets)


def _flush_path(guide: Guide, network: Network, paths: dict[str, GuidePath]) -> GuidePath | None:
    """Return a guide whose side continues a side of the guide to its first node; None if that guide is unknown."""
    leading = [other for other in network.guides if other.nodes[1] == guide.nodes[0]]
    if len(leading) != 1:
        number = network.guides.index(guide)
        limit = f"requires exactly one guide that leads to {guide.nodes[0]}, but there are {len(leading)}"
        raise DesignError(f"network.guides[{number}].flush", value=guide.flush, limit=limit)
    if leading[0].name not in paths or guide.length_mm is None or guide.flush is None:
        return None
    host = paths[leading[0].name]
    heading_deg = guide.direction_deg
    if heading_deg is None:
        slope = float(polynomial.polyval(host.spine.length_mm, polynomial.polyder(host.offsets[guide.flush])))
        x, z = host.spine.end_direction
        heading_deg = math.degrees(math.atan2(-x, z)) - math.degrees(math.atan(slope))
    spine = Spine.from_heading(host.walls[guide.flush].end, heading_deg, guide.length_mm, guide.turn_deg)
    if guide.flush == "right":
        return GuidePath(guide, spine, {"right": (0.0,), "left": tuple(-width for width in guide.widths)})
    return GuidePath(guide, spine, {"right": guide.widths, "left": (0.0,)})


def _set_positions(path: GuidePath, positions: dict[str, Point], number: int) -> None:
    """Assign positions to the nodes of a guide; raise `DesignError` if they contradict known positions."""
    if path.guide.flush is not None:
        ends = {path.guide.nodes[1]: path.middle(path.guide.nodes[1])}
    else:
        ends = dict(zip(path.guide.nodes, (path.spine.start, path.spine.end), strict=True))
    for node, position in ends.items():
        mismatch_mm = math.dist(positions.setdefault(node, position), position)
        if mismatch_mm > MAX_MISMATCH_MM:
            limit = f"ends {mismatch_mm:.3g} mm from {node}, which is at {point_text(positions[node])}"
            remedy = "omit direction_deg and length_mm, or at_mm of the node"
            raise DesignError(f"network.guides[{number}]", value=path.guide.name, limit=limit, remedy=remedy)


def _in_motion(rest: Plan, motions: tuple[NamedMotion, ...]) -> Plan:
    """Return a plan with its motions at their angles."""
    moving = {motion.part: motion for motion in motions if motion.at_deg != 0.0 and motion.part in rest.paths}
    if not moving:
        return rest
    fixed = rest.network.fixed or rest.network.nodes[0].name
    node_motions: dict[str, Rigid] = {fixed: Rigid()}
    paths: dict[str, GuidePath] = {}
    for path, node in _outwards(rest, fixed):
        moved, end_motion = _with_motion(path, node, moving.get(path.guide.name))
        paths[path.guide.name] = moved.moved(node_motions[node])
        (other,) = set(path.guide.nodes) - {node}
        motion = composed(end_motion, node_motions[node])
        node_motion = node_motions.setdefault(other, motion)
        mismatch_mm = math.dist(node_motion.point(rest.positions[other]), motion.point(rest.positions[other]))
        if mismatch_mm > MAX_MISMATCH_MM or abs(node_motion.angle_deg - motion.angle_deg) > MAX_MISMATCH_MM:
            name = ", ".join(motion.name for motion in moving.values())
            limit = (
                f"would tear {path.guide.name} from {other}, at {point_text(rest.positions[other])}, by "
                f"{mismatch_mm:.3g} mm: a guide that bends or rotates must not be part of a loop"
            )
            raise DesignError(
                "network.motion", value=name, limit=limit, remedy="move a guide that is not part of a loop"
            )
    order = {name: paths[name] for name in rest.paths}
    positions = {node: node_motions[node].point(position) for node, position in rest.positions.items()}
    return replace(rest, paths=order, positions=positions, node_motions=node_motions)


def _outwards(plan: Plan, fixed: str) -> Iterator[tuple[GuidePath, str]]:
    """Yield guides with their nearer nodes, outwards from the fixed node."""
    reached, remaining = [fixed], list(plan.paths.values())
    for node in reached:
        for path in [path for path in remaining if node in path.guide.nodes]:
            remaining.remove(path)
            yield path, node
            reached += [other for other in path.guide.nodes if other not in reached]


def _with_motion(path: GuidePath, node: str, motion: NamedMotion | None) -> tuple[GuidePath, Rigid]:
    """Return a guide bent or rotated about its nearer node, and the motion of its other end."""
    if motion is None:
        return path, Rigid()
    from_end = node == path.guide.nodes[1]
    if motion.kind == "rotation":
        near_end = path.spine.end if from_end else path.spine.start
        turn = Rigid.about(near_end if not isinstance(motion.pivot, tuple) else motion.pivot, motion.at_deg)
        _check_tear(path, near_end, turn, motion)
        return path.moved(turn), turn
    spine, end_motion = path.spine.bent(motion.at_deg, from_end=from_end)
    return replace(path, spine=spine), end_motion


def _check_tear(path: GuidePath, near_end: Point, rotation: Rigid, motion: NamedMotion) -> None:
    """Raise `DesignError` if a rotation moves a guide away from its node by more than half its width at either end."""
    displacement_mm = math.dist(rotation.point(near_end), near_end)
    half_mm = 0.5 * min(path.guide.widths[0], float(polynomial.polyval(path.spine.length_mm, path.guide.widths)))
    if displacement_mm > half_mm:
        limit = (
            f"would tear {path.guide.name} from {point_text(near_end)} by {displacement_mm:.3g} mm; the limit is "
            f"{half_mm:.3g} mm, half the width of the guide"
        )
        remedy = "reduce the rotation angle, or use a closer pivot"
        raise DesignError(f"network.motion {motion.name}", value=motion.at_deg, limit=limit, remedy=remedy)


def composed(first: Rigid, second: Rigid) -> Rigid:
    """Return the motion ``first`` followed by ``second``."""
    if second == Rigid():
        return first
    cos, sin = second.vector((first.cos, first.sin))
    return Rigid(cos, sin, second.point(first.shift))
