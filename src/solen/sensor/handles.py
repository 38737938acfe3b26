"""Points of a drawn sensor that a user drags, and the numbers of the design that follow.

A lever rotates or bends a Y or an outline. An emitter is dragged in front of its lens, at the current angle of the
motion. A network's nodes, and the parts on its sides, follow if the numbers that define their positions can do so.

Public names: `handles_of` and `Handle`.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from solen.arrays import FloatArray
from solen.geometry import Body, arm_angle_deg
from solen.geometry.bend import bend_of
from solen.geometry.network import plan_of
from solen.geometry.outline import centred_position
from solen.plane import Point, Rigid, along, heading, minus, right_of, unit
from solen.spec import Design, with_values
from solen.spec.network import PlacedLens, PlacedReceiver

if TYPE_CHECKING:
    from solen.sensor.sensor import Sensor

LEVER_MM = 8.0
"""Distance of the lever's handle from the pivot."""
MIN_LENGTH_MM = 1e-3
DIFFERENCE, MAX_CHANGE, MAX_STEPS = 1e-4, 1e-3, 5
"""Gauss-Newton steps of a dragged node: step of the derivatives, largest final change, maximum number of steps."""

Values = dict[str, Any]


@dataclass(frozen=True)
class Handle:
    """A point that a user drags.

    ``values`` returns the values of the design, by dotted key, that move it to a given position. If the point changes
    the motion instead, ``angle`` returns the angle, or other driven value, for a position.
    """

    point: Point
    values: Callable[[Point], Values] = lambda _: {}
    angle: Callable[[Point], float] | None = None


def handles_of(sensor: "Sensor", body: Body, angle_deg: float) -> dict[str, Handle]:
    """Return the handles of a sensor, keyed by name; ``body`` is its body at the angle. Soft bodies have none."""
    kinds = {"y": _y_handles, "outline": _outline_handles, "network": _network_handles}
    kind = sensor.design.body.kind
    return {} if sensor.is_loaded or kind not in kinds else dict(kinds[kind](sensor, body, angle_deg))


def _y_handles(sensor: "Sensor", body: Body, angle_deg: float) -> Iterator[tuple[str, Handle]]:
    design, rest = sensor.design, sensor.body(0.0)
    base = rest.marks["stem-base"]
    yield from _motion_handles(design, (0.0, -design.emitter.distance_mm), base, design.body.stem_length_mm, angle_deg)
    if sensor.light.ray_file is None:
        yield "emitter", _emitter_handle(design, body, "emitter")
    for side, sign in (("right", 1), ("left", -1)):
        yield f"arm-{side}", _arm_handle(design, rest.marks[f"fork-{side}"], sign)


def _outline_handles(sensor: "Sensor", body: Body, angle_deg: float) -> Iterator[tuple[str, Handle]]:
    design, rest = sensor.design, sensor.body(0.0)
    low, high = design.motion.bend_mm or (0.0, 1.0)
    base = (0.0, low) if design.motion.kind == "bend" else rest.marks["stem-base"]
    yield from _motion_handles(design, centred_position(design, rest.emitter), base, high - low, angle_deg)
    if sensor.light.ray_file is None:
        yield "emitter", _drawn_emitter_handle(design, body, rest)


def _motion_handles(
    design: Design, emitter: Point, base: Point, length_mm: float, angle_deg: float
) -> Iterator[tuple[str, Handle]]:
    """Yield the handles of the motion: a lever, and the pivot of a rotation."""
    motion = design.motion

    def limited(angle: float) -> float:
        return round(min(max(angle, motion.from_deg), motion.to_deg), 2)

    if motion.kind == "bend":

        def lever(angle: float) -> Point:
            bend = bend_of(motion.centre_line, base[1], base[1] + length_mm, angle)
            return bend.section_motion(base[1]).point((base[0], base[1] - LEVER_MM))

        def bent_to(to: Point) -> float:
            from scipy.optimize import minimize_scalar

            nearest = minimize_scalar(lambda a: math.dist(lever(a), to), bounds=(motion.from_deg, motion.to_deg))
            return limited(float(nearest.x))

        yield "turn", Handle(lever(angle_deg), angle=bent_to)
        return
    x, z = emitter if motion.pivot == "emitter" else base if motion.pivot == "stem-base" else motion.pivot
    lever_at = Rigid.about((x, z), angle_deg).point((x, z - LEVER_MM))
    yield "turn", Handle(lever_at, angle=lambda to: limited(math.degrees(math.atan2(to[0] - x, z - to[1]))))
    yield "pivot", Handle((x, z), lambda to: {"motion.pivot": [round(to[0], 2), round(to[1], 2)]})


def _components(body: Body, to: Point) -> tuple[float, float]:
    """Return the components of the vector from the emitter to a point, to the emitter's right and ahead of it."""
    ahead = heading(body.emitter.axis_deg)
    offset = minus(to, body.emitter.point)
    return float(np.dot(offset, right_of(ahead))), float(np.dot(offset, ahead))


def _emitter_handle(
    design: Design, body: Body, table: str, along_side: tuple[str, float, float] | None = None
) -> Handle:
    """Return the handle of an emitter; ``along_side`` is for an emitter on a guide's side: key, position, sense."""
    key, position, sense = along_side or (f"{table}.offset_mm", design.emitter.offset_mm, 1.0)

    def values(to: Point) -> Values:
        right, ahead = _components(body, to)
        distance = max(round(design.emitter.distance_mm - ahead, 3), MIN_LENGTH_MM)
        return {key: round(position + sense * right, 3), f"{table}.distance_mm": distance}

    return Handle(body.emitter.point, values)


def _drawn_emitter_handle(design: Design, body: Body, rest: Body) -> Handle:
    """Return the handle of an outline's emitter, whose position in the design replaces the drawn one."""
    drawn = {"axis_deg": rest.emitter.axis_deg} if design.emitter.axis_deg is None else {}
    if rest.emitter.width_mm and not design.emitter.sets("width_mm"):
        drawn["width_mm"] = rest.emitter.width_mm
    defaults = {f"emitter.{key}": round(value, 6) for key, value in drawn.items()}

    def values(to: Point) -> Values:
        right, ahead = _components(body, to)
        at = centred_position(design, rest.emitter)
        x, z = along(along(at, right_of(heading(rest.emitter.axis_deg)), right), heading(rest.emitter.axis_deg), ahead)
        return {"emitter.point_mm": [round(x, 3), round(z, 3)]} | (defaults if design.emitter.point_mm is None else {})

    return Handle(body.emitter.point, values)


def _arm_handle(design: Design, fork: Point, side: int) -> Handle:
    """Return the handle in the middle of an arm's end."""
    angle, half = math.radians(arm_angle_deg(design)), 0.5 * design.body.arm_width_mm
    shoulder = (fork[0] - side * half * math.cos(angle), fork[1] + half * math.sin(angle))
    end = along(shoulder, (side * math.sin(angle), math.cos(angle)), design.body.arm_length_mm)

    def values(to: Point) -> Values:
        across, up = side * (to[0] - fork[0]), to[1] - fork[1]
        # a right-angled triangle: the arm's axis passes the fork at a distance of half the arm's width
        angle = math.atan2(across, up) + math.asin(min(half / max(math.hypot(across, up), half), 1.0))
        length = math.sqrt(max(across**2 + up**2 - half**2, MIN_LENGTH_MM))
        limited = min(max(round(math.degrees(angle), 2), 0.01), 89.0)
        return {"body.arm_angle_deg": limited, "body.arm_length_mm": round(length, 2)}

    return Handle(end, values)


def _network_handles(sensor: "Sensor", body: Body, _: float) -> Iterator[tuple[str, Handle]]:
    design, network = sensor.design, sensor.design.network
    if design.outline_file is not None:
        return
    places = plan_of(design).positions
    for number, node in enumerate(network.nodes):
        free = _free_numbers(design, number)
        if free is not None:
            yield f"node-{node.name}", Handle(places[node.name], _node_values(design, node.name, *free))
    at_rest = all(motion.at_deg == 0.0 for motion in network.motion)
    for number, guide in enumerate(network.guides):
        for k, point in enumerate(guide.through_mm if at_rest else ()):
            yield f"through-{guide.name}-{k + 1}", _through_handle(f"network.guides[{number}].through_mm[{k}]", point)
    for key, kind in (("lenses", "lens"), ("receivers", "receiver")):
        for number, part in enumerate(getattr(network, key)):
            if part.guide is not None:
                yield f"{kind}-{part.name}", _side_handle(body, part, f"network.{key}[{number}]")
    for number, emitter in enumerate(network.emitters):
        if emitter.name == network.lit:
            table = f"network.emitters[{number}]"
            sense = 1.0 if emitter.side == "right" else -1.0
            side = None if emitter.at_mm is None else (f"{table}.at_mm", emitter.at_mm, sense)
            yield f"emitter-{emitter.name}", _emitter_handle(design, body, table, side)


FreeNumbers = tuple[list[float], Callable[[list[float]], Values]]


def _free_numbers(design: Design, number: int) -> FreeNumbers | None:
    """Return the numbers that define the position of a node, and a function from them to values of the design.

    None if no number defines the position.
    """
    network = design.network
    node = network.nodes[number]
    if node.at_mm is not None:
        return list(node.at_mm), lambda numbers: {f"network.nodes[{number}].at_mm": numbers}
    for k, guide in enumerate(network.guides):
        if guide.length_mm is not None and guide.nodes[1] == node.name:
            numbers = {"length_mm": guide.length_mm, "direction_deg": guide.direction_deg}
            keys = {f"network.guides[{k}].{key}": value for key, value in numbers.items() if value is not None}
            return list(keys.values()), partial(_named, tuple(keys))
    return None


def _named(keys: tuple[str, ...], numbers: list[float]) -> Values:
    return dict(zip(keys, numbers, strict=True))


def _node_values(
    design: Design, name: str, start: list[float], values: Callable[[list[float]], Values]
) -> Callable[[Point], Values]:
    """Return a function from a point to the values that move a node there, or as near as possible (Gauss-Newton)."""

    def position(numbers: FloatArray) -> FloatArray:
        return np.array(plan_of(with_values(design, values(numbers.tolist()))).positions[name])

    def to_point(to: Point) -> Values:
        numbers = np.array(start)
        for _ in range(MAX_STEPS):
            here = position(numbers)
            slopes = [(position(numbers + DIFFERENCE * row) - here) / DIFFERENCE for row in np.eye(len(start))]
            step = np.linalg.lstsq(np.column_stack(slopes), np.array(to) - here, rcond=None)[0]
            numbers = numbers + step
            if float(np.abs(step).max()) < MAX_CHANGE:
                break
        return values([round(number, 3) for number in numbers.tolist()])

    return to_point


def _through_handle(key: str, point: Point) -> Handle:
    """Return the handle of a point on a guide's centre line."""
    return Handle(point, lambda to: {key: [round(to[0], 3), round(to[1], 3)]})


def _side_handle(body: Body, part: PlacedLens | PlacedReceiver, table: str) -> Handle:
    """Return the handle of a lens or a receiver that moves along a guide's side."""
    kind = "lens" if isinstance(part, PlacedLens) else "receiver"
    curve = body.face(f"{kind}-{part.name}").curve
    direction = unit(minus(curve.end, curve.start))
    middle = (0.5 * (curve.start[0] + curve.end[0]), 0.5 * (curve.start[1] + curve.end[1]))
    sense = 1.0 if part.side == "right" else -1.0  # lengths on a left side are measured from its end
    keys = ("at_mm",) if isinstance(part, PlacedLens) else ("from_mm", "to_mm")
    lengths = [(key, getattr(part, key)) for key in keys]

    def values(to: Point) -> Values:
        shift = max(sense * float(np.dot(minus(to, middle), direction)), -min(length for _, length in lengths))
        return {f"{table}.{key}": round(length + shift, 3) for key, length in lengths}

    return Handle(middle, values)
