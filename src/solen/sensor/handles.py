"""Points of a drawn sensor that a user drags, and the numbers of the design that move them there.

A Y and an outline are turned or bent with a lever. An emitter is dragged in front of its lens, in the position to which
the motion has moved both. A network's nodes, and the parts on its sides, move along the numbers that define their
positions.

Public name: `handles_of`.
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
from solen.geometry.outline import undecentred
from solen.plane import Point, Rigid, along, heading, minus, right_of, unit
from solen.spec import Design, with_values
from solen.spec.network import PlacedLens, PlacedReceiver

if TYPE_CHECKING:
    from solen.sensor.sensor import Sensor

LEVER_MM = 8.0
"""Distance from the pivot of the handle that turns the lens."""
MIN_MM = 1e-3
STEP, ENOUGH, STEPS = 1e-4, 1e-3, 5
"""Parameters for a dragged node: derivative step, change that ends the iteration, and maximum number of iterations."""

Values = dict[str, Any]


@dataclass(frozen=True)
class Handle:
    """A point that a user drags.

    ``values`` returns the values of the design, by dotted keys, that move it to a point. ``angle`` returns the angle,
    or other value driven by the motion, if the point changes that instead.
    """

    point: Point
    values: Callable[[Point], Values] = lambda _: {}
    angle: Callable[[Point], float] | None = None


def handles_of(sensor: "Sensor", body: Body, angle_deg: float) -> dict[str, Handle]:
    """Return the handles of a sensor by name; ``body`` is its body at the angle. Soft bodies have none."""
    kinds = {"y": _of_y, "outline": _of_outline, "network": _of_network}
    kind = sensor.design.body.kind
    return {} if sensor.is_loaded or kind not in kinds else dict(kinds[kind](sensor, body, angle_deg))


def _of_y(sensor: "Sensor", body: Body, angle_deg: float) -> Iterator[tuple[str, Handle]]:
    design, rest = sensor.design, sensor.body(0.0)
    base = rest.marks["stem-base"]
    yield from _moved(design, (0.0, -design.emitter.distance_mm), base, design.body.stem_length_mm, angle_deg)
    if sensor.light.ray_file is None:
        yield "emitter", _emitter(design, body, "emitter")
    for side, sign in (("right", 1), ("left", -1)):
        yield f"arm-{side}", _arm(design, rest.marks[f"fork-{side}"], sign)


def _of_outline(sensor: "Sensor", body: Body, angle_deg: float) -> Iterator[tuple[str, Handle]]:
    design, rest = sensor.design, sensor.body(0.0)
    low, high = design.motion.bend_mm or (0.0, 1.0)
    base = (0.0, low) if design.motion.kind == "bend" else rest.marks["stem-base"]
    yield from _moved(design, undecentred(design, rest.emitter), base, high - low, angle_deg)
    if sensor.light.ray_file is None:
        yield "emitter", _drawn_emitter(design, body, rest)


def _moved(
    design: Design, emitter: Point, base: Point, length_mm: float, angle_deg: float
) -> Iterator[tuple[str, Handle]]:
    """Yield the handles of the motion: a lever, and the pivot of a rotation."""
    motion = design.motion

    def limited(angle: float) -> float:
        return round(min(max(angle, motion.from_deg), motion.to_deg), 2)

    if motion.kind == "bend":

        def lever(angle: float) -> Point:
            bend = bend_of(motion.centre_line, base[1], base[1] + length_mm, angle)
            return bend.section(base[1]).point((base[0], base[1] - LEVER_MM))

        def bent_to(to: Point) -> float:
            from scipy.optimize import minimize_scalar

            found = minimize_scalar(lambda a: math.dist(lever(a), to), bounds=(motion.from_deg, motion.to_deg))
            return limited(float(found.x))

        yield "turn", Handle(lever(angle_deg), angle=bent_to)
        return
    x, z = emitter if motion.pivot == "emitter" else base if motion.pivot == "stem-base" else motion.pivot
    lever_at = Rigid.about((x, z), angle_deg).point((x, z - LEVER_MM))
    yield "turn", Handle(lever_at, angle=lambda to: limited(math.degrees(math.atan2(to[0] - x, z - to[1]))))
    yield "pivot", Handle((x, z), lambda to: {"motion.pivot": [round(to[0], 2), round(to[1], 2)]})


def _parts(body: Body, to: Point) -> tuple[float, float]:
    """Return the displacement from the emitter to a point, as components to the emitter's right and ahead."""
    ahead = heading(body.emitter.axis_deg)
    way = minus(to, body.emitter.point)
    return float(np.dot(way, right_of(ahead))), float(np.dot(way, ahead))


def _emitter(design: Design, body: Body, table: str, along_side: tuple[str, float, float] | None = None) -> Handle:
    """Return the handle of an emitter; ``along_side`` is its key, position and sense on a guide's side."""
    key, place, sense = along_side or (f"{table}.offset_mm", design.emitter.offset_mm, 1.0)

    def values(to: Point) -> Values:
        right, ahead = _parts(body, to)
        distance = max(round(design.emitter.distance_mm - ahead, 3), MIN_MM)
        return {key: round(place + sense * right, 3), f"{table}.distance_mm": distance}

    return Handle(body.emitter.point, values)


def _drawn_emitter(design: Design, body: Body, rest: Body) -> Handle:
    """Return the handle of an outline's emitter: a position in the design replaces the drawn one."""
    drawn = {"axis_deg": rest.emitter.axis_deg} if design.emitter.axis_deg is None else {}
    if rest.emitter.width_mm and not design.emitter.states("width_mm"):
        drawn["width_mm"] = rest.emitter.width_mm
    taken = {f"emitter.{key}": round(value, 6) for key, value in drawn.items()}

    def values(to: Point) -> Values:
        right, ahead = _parts(body, to)
        at = undecentred(design, rest.emitter)
        x, z = along(along(at, right_of(heading(rest.emitter.axis_deg)), right), heading(rest.emitter.axis_deg), ahead)
        return {"emitter.point_mm": [round(x, 3), round(z, 3)]} | (taken if design.emitter.point_mm is None else {})

    return Handle(body.emitter.point, values)


def _arm(design: Design, fork: Point, side: int) -> Handle:
    """Return the handle at the midpoint of an arm's end."""
    angle, half = math.radians(arm_angle_deg(design)), 0.5 * design.body.arm_width_mm
    shoulder = (fork[0] - side * half * math.cos(angle), fork[1] + half * math.sin(angle))
    end = along(shoulder, (side * math.sin(angle), math.cos(angle)), design.body.arm_length_mm)

    def values(to: Point) -> Values:
        across, up = side * (to[0] - fork[0]), to[1] - fork[1]
        # the distance of the arm's axis from the fork is half its width: a right-angled triangle
        angle = math.atan2(across, up) + math.asin(min(half / max(math.hypot(across, up), half), 1.0))
        length = math.sqrt(max(across**2 + up**2 - half**2, MIN_MM))
        limited = min(max(round(math.degrees(angle), 2), 0.01), 89.0)
        return {"body.arm_angle_deg": limited, "body.arm_length_mm": round(length, 2)}

    return Handle(end, values)


def _of_network(sensor: "Sensor", body: Body, _: float) -> Iterator[tuple[str, Handle]]:
    design, network = sensor.design, sensor.design.network
    if design.outline_file is not None:
        return
    places = plan_of(design).places
    for number, node in enumerate(network.nodes):
        free = _free(design, number)
        if free is not None:
            yield f"node-{node.name}", Handle(places[node.name], _to_node(design, node.name, *free))
    still = all(motion.at_deg == 0.0 for motion in network.motion)
    for number, guide in enumerate(network.guides):
        for place, point in enumerate(guide.through_mm if still else ()):
            yield f"through-{guide.name}-{place + 1}", _through(f"network.guides[{number}].through_mm", place, point)
    for key in ("lenses", "receivers"):
        for number, one in enumerate(getattr(network, key)):
            if one.guide is not None:
                yield f"{key[:-1].replace('lense', 'lens')}-{one.name}", _on_side(body, one, f"network.{key}[{number}]")
    for number, lamp in enumerate(network.emitters):
        if lamp.name == network.lit:
            table = f"network.emitters[{number}]"
            sense = 1.0 if lamp.side == "right" else -1.0
            side = None if lamp.at_mm is None else (f"{table}.at_mm", lamp.at_mm, sense)
            yield f"emitter-{lamp.name}", _emitter(design, body, table, side)


Free = tuple[list[float], Callable[[list[float]], Values]]


def _free(design: Design, number: int) -> Free | None:
    """Return the numbers that define the position of a node, and a function that converts them to values of the design.

    None if no number defines the position.
    """
    network = design.network
    node = network.nodes[number]
    if node.at_mm is not None:
        return list(node.at_mm), lambda numbers: {f"network.nodes[{number}].at_mm": numbers}
    for place, guide in enumerate(network.guides):
        if guide.length_mm is not None and guide.nodes[1] == node.name:
            stated = {"length_mm": guide.length_mm, "direction_deg": guide.direction_deg}
            keys = {f"network.guides[{place}].{key}": value for key, value in stated.items() if value is not None}
            return list(keys.values()), partial(_named, tuple(keys))
    return None


def _named(keys: tuple[str, ...], numbers: list[float]) -> Values:
    return dict(zip(keys, numbers, strict=True))


def _to_node(
    design: Design, name: str, start: list[float], values: Callable[[list[float]], Values]
) -> Callable[[Point], Values]:
    """Return a function for the values that move a node to a point, or as near as possible, by Gauss-Newton steps."""

    def place(numbers: FloatArray) -> FloatArray:
        return np.array(plan_of(with_values(design, values(numbers.tolist()))).places[name])

    def to_point(to: Point) -> Values:
        numbers = np.array(start)
        for _ in range(STEPS):
            here = place(numbers)
            slopes = [(place(numbers + STEP * one) - here) / STEP for one in np.eye(len(start))]
            step = np.linalg.lstsq(np.column_stack(slopes), np.array(to) - here, rcond=None)[0]
            numbers = numbers + step
            if float(np.abs(step).max()) < ENOUGH:
                break
        return values([round(one, 3) for one in numbers.tolist()])

    return to_point


def _through(key: str, place: int, point: Point) -> Handle:
    """Return the handle of a point on a guide's centre line."""
    return Handle(point, lambda to: {f"{key}[{place}]": [round(to[0], 3), round(to[1], 3)]})


def _on_side(body: Body, one: PlacedLens | PlacedReceiver, table: str) -> Handle:
    """Return the handle of a lens or a receiver, which moves along a guide's side."""
    word = "lens" if isinstance(one, PlacedLens) else "receiver"
    curve = body.face(f"{word}-{one.name}").curve
    walked = unit(minus(curve.end, curve.start))
    middle = (0.5 * (curve.start[0] + curve.end[0]), 0.5 * (curve.start[1] + curve.end[1]))
    sense = 1.0 if one.side == "right" else -1.0  # lengths on a left side are measured from its end
    keys = ("at_mm",) if isinstance(one, PlacedLens) else ("from_mm", "to_mm")
    stated = [(key, getattr(one, key)) for key in keys]

    def values(to: Point) -> Values:
        by = max(sense * float(np.dot(minus(to, middle), walked)), -min(place for _, place in stated))
        return {f"{table}.{key}": round(place + by, 3) for key, place in stated}

    return Handle(middle, values)
