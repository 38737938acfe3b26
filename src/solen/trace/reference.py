"""The readable tracer: the truth that every faster one is held to.

One ray at a time, in plain Python, with the curves of `solen.curve` and the physics of `solen.interface`. In
*counting* mode a ray is refracted or totally reflected, never split, and nothing is absorbed on the way. In *power*
mode Fresnel's equations split it, s and p apart, both parts are followed down to the stated weight, and media absorb.

At a split the weaker part is followed first: it holds at most half of the power, so that the number of parts waiting
never exceeds the logarithm of the least weight. The stronger part keeps the branch's number.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from solen.interface import fresnel, reflected, refracted
from solen.plane import Point, along, cross, dot, minus
from solen.scene import Interface, Launch, Scene
from solen.trace.result import (
    ABSORBED,
    CORNER_MM,
    DETECTED,
    ESCAPED,
    GOES_ON,
    KEPT_PLACES,
    LEG,
    TRUNCATED,
    Crossed,
    Detected,
    Ledger,
    Limits,
    Mode,
    Trace,
    check_mode,
    in_order,
)


@dataclass(frozen=True)
class Ray:
    """A ray on its way: ``last`` is the interface it stands on, ``region`` its medium (None: not known yet)."""

    number: int
    branch: int
    origin: Point
    direction: Point
    s: float
    p: float
    least: float
    parent: int = -1
    region: str | None = None
    last: Interface | None = None
    hits: int = 0

    @property
    def power(self) -> float:
        """Power in both polarisations."""
        return self.s + self.p

    def onwards(self, at: Point, direction: Point, region: str, last: Interface) -> "Ray":
        """The ray after an interface."""
        return replace(self, origin=at, direction=direction, region=region, last=last, hits=self.hits + 1)


def trace_reference(scene: Scene, mode: Mode = "count", limits: Limits | None = None, *, legs: bool = False) -> Trace:
    """Trace every ray of every source; see `solen.trace.engine.trace` for the parameters."""
    check_mode(mode)
    tracer = _Tracer(scene, mode, limits or Limits())
    number = 0
    for source in scene.sources:
        launch = source.launch()
        for i in range(len(launch)):
            tracer.follow(_ray(launch, i, number, tracer.limits))
            number += 1
    return tracer.result(legs)


def _ray(launch: Launch, i: int, number: int, limits: Limits) -> Ray:
    s, p = float(launch.power_s[i]), float(launch.power_p[i])
    origin = (float(launch.x_mm[i]), float(launch.z_mm[i]))
    direction = (float(launch.dx[i]), float(launch.dz[i]))
    return Ray(number, 0, origin, direction, s, p, limits.min_weight * (s + p))


class _Tracer:
    """Follows rays through one scene and adds up what becomes of them."""

    def __init__(self, scene: Scene, mode: Mode, limits: Limits) -> None:
        self.scene = scene
        self.mode = mode
        self.limits = limits
        self.regions = {region.name: region for region in scene.regions}
        self.detected = {name: [0.0, 0] for name in scene.receivers}
        self.crossed = {m.name: [0.0, 0] for m in scene.monitors}
        self.maps = {m.name: np.zeros(m.bins) for m in scene.monitors}
        self.sums = dict.fromkeys((DETECTED, ESCAPED, ABSORBED, TRUNCATED), 0.0)
        self.hits = 0
        self.undefined = 0
        self.undefined_at: list[Point] = []
        self.legs: list[tuple[float, ...]] = []
        self.branches = 1

    def follow(self, ray: Ray) -> None:
        """Follow a launched ray and all its branches to their ends."""
        self.branches = 1
        waiting = [ray]
        while waiting:
            current: Ray | None = waiting.pop()
            while current is not None:
                current = self._step(current, waiting)

    def _step(self, ray: Ray, waiting: list[Ray]) -> Ray | None:
        """Carry a ray to its next interface and through it; None where it ends."""
        interface, length_mm = self._next(ray)
        if interface is None:
            self._escape(ray)
            return None
        at = along(ray.origin, ray.direction, length_mm)
        normal = interface.curve.normal_at(at)
        from_right = dot(ray.direction, normal) > 0.0
        region, beyond = (interface.right, interface.left) if from_right else (interface.left, interface.right)
        if length_mm <= CORNER_MM and self._only_an_end(ray, interface, region):
            return replace(ray, origin=along(ray.origin, ray.direction, CORNER_MM), last=interface)
        self.hits += 1
        if ray.region not in (None, region):
            self._undefined(ray, at, interface, length_mm)
            return None
        arrived = self._absorbed_on_the_way(ray, region, length_mm)
        self._monitor(ray, region, length_mm)
        fate = self._fate(arrived, interface, from_right)
        self._leg(ray, fate, interface, length_mm, arrived.power / ray.power)
        if fate != GOES_ON:
            self._end(arrived, fate, interface)
            return None
        facing = (-normal[0], -normal[1]) if from_right else normal
        back = arrived.onwards(at, reflected(arrived.direction, facing), region, interface)
        if interface.behaviour == "mirror":
            return back
        return self._refract(arrived, back, facing, beyond, waiting)

    def _only_an_end(self, ray: Ray, interface: Interface, region: str) -> bool:
        """Whether a ray that stands in a corner meets only the end of the other curve, which reaches over the corner.

        It does where that curve shows it the wrong medium, or lies on the other side of the one it stands on.
        """
        if ray.last is None:
            return False
        normal = ray.last.curve.normal_at(ray.origin)
        other_side = dot(minus(interface.curve.middle_point, ray.origin), normal) * dot(ray.direction, normal) < 0.0
        return other_side or ray.region not in (None, region)

    def _fate(self, ray: Ray, interface: Interface, from_right: bool) -> int:
        """What becomes of a ray that has arrived at an interface; the back of a receiver only absorbs."""
        if interface.behaviour == "receiver":
            return ABSORBED if from_right else DETECTED
        if interface.behaviour == "absorbing":
            return ABSORBED
        worn_out = ray.hits + 1 >= self.limits.max_hits or ray.power < ray.least
        return TRUNCATED if worn_out else GOES_ON

    def _next(self, ray: Ray) -> tuple[Interface | None, float]:
        """Nearest interface ahead and its distance."""
        nearest, found = math.inf, None
        for interface in self.scene.interfaces:
            for t in interface.curve.hits(ray.origin, ray.direction, leaving=interface is ray.last):
                if t < nearest:
                    nearest, found = t, interface
        return found, nearest

    def _refract(self, ray: Ray, back: Ray, facing: Point, beyond: str, waiting: list[Ray]) -> Ray | None:
        """Send a ray through, or ``back``, or both ways."""
        if back.region is None or back.last is None:
            raise AssertionError("a ray that met an interface has a medium")
        n1, n2 = self.regions[back.region].index, self.regions[beyond].index
        through = refracted(ray.direction, facing, n1, n2)
        if through is None:
            return back
        onwards = ray.onwards(back.origin, through, beyond, back.last)
        if self.mode == "count":
            return onwards
        share = fresnel(-dot(ray.direction, facing), n1, n2)
        parts = (
            replace(back, s=ray.s * share.s, p=ray.p * share.p),
            replace(onwards, s=ray.s * (1.0 - share.s), p=ray.p * (1.0 - share.p)),
        )
        return self._split(parts, waiting)

    def _split(self, parts: tuple[Ray, Ray], waiting: list[Ray]) -> Ray | None:
        """Cut what is below the least weight; of two parts left the weaker goes first under a new number."""
        self.sums[TRUNCATED] += math.fsum(part.power for part in parts if part.power < part.least)
        left = sorted((part for part in parts if part.power >= part.least), key=lambda part: part.power)
        if len(left) < 2:
            return left[0] if left else None
        waiting.append(left[1])
        self.branches += 1
        return replace(left[0], branch=self.branches - 1, parent=left[0].branch)

    def _absorbed_on_the_way(self, ray: Ray, region: str, length_mm: float) -> Ray:
        absorption = self.regions[region].absorption_per_mm
        if self.mode == "count" or absorption == 0.0:
            return ray
        kept = math.exp(-absorption * length_mm)
        weaker = replace(ray, s=ray.s * kept, p=ray.p * kept)
        self.sums[ABSORBED] += ray.power - weaker.power
        return weaker

    def _escape(self, ray: Ray) -> None:
        """To infinity: whatever a medium that absorbs at all takes in."""
        self._monitor(ray, ray.region, math.inf)
        lossy = ray.region is not None and self.regions[ray.region].absorption_per_mm > 0.0
        fate = ABSORBED if self.mode == "power" and lossy else ESCAPED
        self._leg(ray, fate, None, math.inf)
        self._end(ray, fate, None)

    def _undefined(self, ray: Ray, at: Point, interface: Interface, length_mm: float) -> None:
        """Count and locate a ray that met an interface from a medium it was not in."""
        self.undefined += 1
        if len(self.undefined_at) < KEPT_PLACES:
            self.undefined_at.append(at)
        self._leg(ray, TRUNCATED, interface, length_mm)
        self._end(ray, TRUNCATED, interface)

    def _end(self, ray: Ray, fate: int, interface: Interface | None) -> None:
        self.sums[fate] += ray.power
        if fate == DETECTED and interface is not None and interface.receiver is not None:
            self.detected[interface.receiver][0] += ray.power
            self.detected[interface.receiver][1] += 1

    def _leg(self, ray: Ray, fate: int, interface: Interface | None, length_mm: float, kept: float = 1.0) -> None:
        which = -1 if interface is None else self.scene.interfaces.index(interface)
        numbers = (ray.number, ray.branch, ray.parent, ray.hits, which, fate)
        self.legs.append((*numbers, *ray.origin, *ray.direction, length_mm, ray.s, ray.p, kept))

    def _monitor(self, ray: Ray, region: str | None, length_mm: float) -> None:
        """Count a straight stretch at every monitor it crosses, with the power left there."""
        absorption = 0.0 if region is None or self.mode == "count" else self.regions[region].absorption_per_mm
        for monitor in self.scene.monitors:
            for t in monitor.segment.hits(ray.origin, ray.direction):
                if t > length_mm:
                    continue
                at = along(ray.origin, ray.direction, t)
                line = (monitor.end[0] - monitor.start[0], monitor.end[1] - monitor.start[1])
                power = math.copysign(ray.power * math.exp(-absorption * t), cross(line, ray.direction))
                self.crossed[monitor.name][0] += power
                self.crossed[monitor.name][1] += 1
                if monitor.bins:
                    share = math.dist(monitor.start, at) / math.dist(monitor.start, monitor.end)
                    self.maps[monitor.name][min(int(share * monitor.bins), monitor.bins - 1)] += power

    def result(self, legs: bool) -> Trace:
        """The trace, as fractions of the emitted power."""
        emitted = self.scene.emitted
        kept = in_order(np.array(self.legs, dtype=LEG)) if legs else None
        if kept is not None:
            kept["power_s"] /= emitted
            kept["power_p"] /= emitted
        return Trace(
            mode=self.mode,
            rays=self.scene.rays,
            detectors={name: Detected(power / emitted, int(n)) for name, (power, n) in self.detected.items()},
            monitors={
                name: Crossed(power / emitted, int(n), self.maps[name] / emitted)
                for name, (power, n) in self.crossed.items()
            },
            ledger=Ledger(*(self.sums[fate] / emitted for fate in (DETECTED, ESCAPED, ABSORBED, TRUNCATED))),
            hits=self.hits,
            undefined=self.undefined,
            undefined_at=tuple(self.undefined_at),
            legs=kept,
        )
