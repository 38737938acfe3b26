"""The reference tracer in plain Python, with which every faster tracer must agree.

It follows one ray at a time, with the curves of `solen.curve` and the physics of `solen.refraction`. In *counting* mode
a ray is refracted or totally reflected, but neither split nor absorbed by a medium. In *power* mode a ray is split
according to Fresnel's equations, with s and p treated separately; both parts are followed down to the minimum weight,
and media absorb. In *roulette* mode, one of the two parts continues with the total power, chosen with probability
proportional to its power.

At a split the weaker part is followed first: it has at most half of the power, so the number of waiting parts never
exceeds the logarithm of the inverse minimum weight. The weaker part gets a new branch number.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from solen.curve import ROUNDING
from solen.plane import Point, Rigid, along, cross, dot, minus
from solen.refraction import fresnel, reflected, refracted
from solen.scene import Interface, Region, Scene, Surface
from solen.trace.kernel.surface import Event, uniform, uniform_of
from solen.trace.kernel.treated import FREE_PATH, PHASE
from solen.trace.reference_surfaces import Arrival, draws, treated
from solen.trace.result import (
    ABSORBED,
    CORNER_MM,
    DETECTED,
    ESCAPED,
    GOES_ON,
    MAX_LOCATIONS,
    SEGMENT_FIELDS,
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
    """A ray: ``last`` is the interface at its origin, ``region`` its medium (None if not yet determined).

    ``min_power`` is the power below which it is truncated, ``optical_mm`` the optical path length to its origin.
    """

    number: int
    branch: int
    origin: Point
    direction: Point
    s: float
    p: float
    min_power: float
    parent: int = -1
    region: str | None = None
    last: Interface | None = None
    hits: int = 0
    source: int = 0
    wavelength_nm: float | None = None
    optical_mm: float = 0.0

    @property
    def power(self) -> float:
        """Total power of both polarisations."""
        return self.s + self.p

    def onwards(self, at: Point, direction: Point, region: str, last: Interface) -> "Ray":
        """Return the ray after an interface."""
        return replace(self, origin=at, direction=direction, region=region, last=last, hits=self.hits + 1)


def trace_reference(
    scene: Scene, mode: Mode = "count", limits: Limits | None = None, *, seed: int = 0, segments: bool = False
) -> Trace:
    """Trace every ray of every source; see `solen.trace.engine.trace` for the parameters."""
    check_mode(mode)
    tracer = Tracer(scene, mode, limits or Limits(), seed)
    for ray in launch_rays(scene, tracer.limits):
        tracer.follow(ray)
    return tracer.result(segments)


def launch_rays(scene: Scene, limits: Limits) -> Iterator[Ray]:
    """Yield the initial rays of all sources, numbered consecutively."""
    number = count()
    for index, source in enumerate(scene.sources):
        launch = source.launch()
        columns = (launch.x_mm, launch.z_mm, launch.dx, launch.dz, launch.power_s, launch.power_p)
        for x, z, dx, dz, s, p, line in zip(*(column.tolist() for column in columns), launch.line, strict=True):
            nm = source.spectrum[line][0] if source.spectrum else None
            min_power = limits.min_weight * (s + p)
            yield Ray(next(number), 0, (x, z), (dx, dz), s, p, min_power, source=index, wavelength_nm=nm)


class Tracer:
    """Tracer for rays through one scene, which adds up their powers by fate."""

    def __init__(self, scene: Scene, mode: Mode, limits: Limits, seed: int) -> None:
        self.scene = scene
        self.seed = seed
        self.mode = mode
        self.limits = limits
        self.regions = {region.name: region for region in scene.regions}
        self.detected = {name: np.zeros(len(scene.sources)) for name in scene.receivers}
        self.arrived = dict.fromkeys(scene.receivers, 0)
        self.optical = dict.fromkeys(scene.receivers, 0.0)
        self.crossed = {m.name: [0.0, 0] for m in scene.monitors}
        self.maps = {m.name: np.zeros(m.bins) for m in scene.monitors}
        self.sums = dict.fromkeys((DETECTED, ESCAPED, ABSORBED, TRUNCATED), 0.0)
        self.hits = 0
        self.undefined = 0
        self.undefined_at: list[Point] = []
        self.truncated = 0
        self.truncated_at: list[Point] = []
        self.segments: list[tuple[float, ...]] = []
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
        """Advance a ray to its next interface and through it; return None if the ray ends."""
        interface, length_mm = self._next(ray)
        if interface is None:
            self._escape(ray)
            return None
        at = along(ray.origin, ray.direction, length_mm)
        normal = self._normal(interface, at, ray.direction)
        from_right = dot(ray.direction, normal) > 0.0
        region, beyond = (interface.right, interface.left) if from_right else (interface.left, interface.right)
        if length_mm <= CORNER_MM and self._is_past_corner(ray, interface, region):
            # far from the origin, a smaller step would be lost to rounding
            step_mm = CORNER_MM + ROUNDING * (abs(ray.origin[0]) + abs(ray.origin[1]))
            return replace(ray, origin=along(ray.origin, ray.direction, step_mm), last=interface)
        self.hits += 1
        if ray.region not in (None, region):
            self._undefined(ray, at, interface, length_mm)
            return None
        free_mm = self._free_path(ray, self.regions[region])
        if free_mm < length_mm:
            return self._scatter(ray, region, free_mm)
        optical_mm = ray.optical_mm + self.regions[region].index_at(ray.wavelength_nm) * length_mm
        arrived = replace(self._attenuated(ray, region, length_mm), optical_mm=optical_mm)
        self._monitor(ray, region, length_mm)
        fate = self._fate(arrived, interface, from_right)
        self._store_segment(ray, fate, interface, length_mm, arrived.power / ray.power)
        if fate != GOES_ON:
            if fate == TRUNCATED:
                self._truncated(at)
            self._end(arrived, fate, interface)
            return None
        facing = (-normal[0], -normal[1]) if from_right else normal
        back = arrived.onwards(at, reflected(arrived.direction, facing), region, interface)
        surface = interface.surface
        if surface is not None and surface.acts_at(ray.wavelength_nm):
            return self._treated(surface, arrived, back, facing, beyond, waiting)
        if interface.behaviour == "mirror" and surface is None:
            return back
        return self._refract(arrived, back, facing, beyond, waiting)

    def _normal(self, interface: Interface, at: Point, direction: Point) -> Point:  # noqa: ARG002  used by a subclass
        """Return the left normal where a ray meets an interface."""
        return interface.curve.normal_at(at)

    def _is_past_corner(self, ray: Ray, interface: Interface, region: str) -> bool:
        """Return whether a ray that starts at a corner meets ``interface`` only on its extension beyond the corner.

        This is the case if the medium on the near side of the interface is not that of the ray, or if the ray moves
        away from the side of its last curve on which the interface lies.
        """
        if ray.last is None:
            return False
        normal = ray.last.curve.normal_at(ray.origin)
        other_side = dot(minus(interface.curve.middle_point, ray.origin), normal) * dot(ray.direction, normal) < 0.0
        other_side = other_side and interface is not ray.last  # a chain of cubics does not extend over its own joints
        return other_side or ray.region not in (None, region)

    def _fate(self, ray: Ray, interface: Interface, from_right: bool) -> int:
        """Return the fate of a ray at an interface; the back of a receiver only absorbs."""
        behaviour = interface.behaviour
        if interface.surface is not None and not interface.surface.acts_at(ray.wavelength_nm):
            behaviour = "refracting"
        if behaviour == "receiver":
            return ABSORBED if from_right else DETECTED
        if behaviour == "absorbing":
            return ABSORBED
        return TRUNCATED if self._is_truncated(ray) else GOES_ON

    def _is_truncated(self, ray: Ray) -> bool:
        return ray.hits + 1 >= self.limits.max_hits or ray.power < ray.min_power

    def _next(self, ray: Ray) -> tuple[Interface | None, float]:
        """Return the nearest interface ahead and its distance."""
        distance, nearest = math.inf, None
        for interface in self.scene.interfaces:
            for t in interface.curve.hits(ray.origin, ray.direction, leaving=interface is ray.last):
                if t < distance:
                    distance, nearest = t, interface
        return nearest, distance

    def _refract(self, ray: Ray, back: Ray, facing: Point, beyond: str, waiting: list[Ray]) -> Ray | None:
        """Refract a ray, reflect it as ``back``, or split it."""
        if back.region is None or back.last is None:
            raise AssertionError("a ray that met an interface has a medium")
        n1, n2 = (self.regions[name].index_at(ray.wavelength_nm) for name in (back.region, beyond))
        direction = refracted(ray.direction, facing, n1, n2)
        if direction is None:
            return back
        transmitted = ray.onwards(back.origin, direction, beyond, back.last)
        if self.mode == "count":
            return transmitted
        reflectance = fresnel(-dot(ray.direction, facing), n1, n2)
        parts = (
            replace(back, s=ray.s * reflectance.s, p=ray.p * reflectance.p),
            replace(transmitted, s=ray.s * (1.0 - reflectance.s), p=ray.p * (1.0 - reflectance.p)),
        )
        return self._drawn(parts) if self.mode == "roulette" else self._split(parts, waiting)

    def _treated(
        self, surface: Surface, ray: Ray, back: Ray, facing: Point, beyond: str, waiting: list[Ray]
    ) -> Ray | None:
        """Transmit a ray at a treated surface, reflect it, or split it."""
        interface = back.last
        if back.region is None or interface is None:
            raise AssertionError("a ray that met an interface has a medium")
        n1, n2 = (self.regions[name].index_at(ray.wavelength_nm) for name in (back.region, beyond))
        from_right = dot(facing, interface.curve.normal_at(back.origin)) < 0.0
        arrival = Arrival(back.origin, ray.direction, ray.s, ray.p, facing, n1, n2, ray.wavelength_nm, from_right)
        draw, counting = draws(self.seed, ray.number, ray.hits), self.mode == "count"
        t, r = treated(interface, surface, arrival, draw, counting)
        parts = (
            replace(back, direction=r.direction, s=r.s, p=r.p),
            replace(ray.onwards(back.origin, t.direction, beyond, interface), s=t.s, p=t.p),
        )
        if counting:
            return max(parts, key=lambda part: part.power)
        self.sums[ABSORBED] += max(ray.s - t.s - r.s + (ray.p - t.p - r.p), 0.0)
        is_split = min(part.power for part in parts) > 0.0
        return self._split((self._drawn(parts),) if self.mode == "roulette" and is_split else parts, waiting)

    def _free_path(self, ray: Ray, region: Region) -> float:
        """Sample the free path of a ray before scattering in a medium, from the exponential distribution."""
        if region.scattering_per_mm == 0.0:
            return math.inf
        uniform_number = uniform_of(Event(self.seed, ray.number, ray.hits), FREE_PATH)
        return -math.log(1.0 - uniform_number) / region.scattering_per_mm

    def _scatter(self, ray: Ray, region: str, length_mm: float) -> Ray | None:
        """Scatter a ray in a medium, by an angle sampled from the Henyey–Greenstein distribution in the plane."""
        at = along(ray.origin, ray.direction, length_mm)
        arrived = self._attenuated(ray, region, length_mm)
        self._monitor(ray, region, length_mm)
        ends = self._is_truncated(arrived)
        self._store_segment(ray, TRUNCATED if ends else GOES_ON, None, length_mm, arrived.power / ray.power)
        if ends:
            self._truncated(at)
            self._end(arrived, TRUNCATED, None)
            return None
        g = self.regions[region].anisotropy
        uniform_number = uniform_of(Event(self.seed, ray.number, ray.hits), PHASE)
        angle = 2.0 * math.atan((1.0 - g) / (1.0 + g) * math.tan(math.pi * (uniform_number - 0.5)))
        direction = Rigid(math.cos(angle), math.sin(angle)).vector(ray.direction)
        optical_mm = ray.optical_mm + self.regions[region].index_at(ray.wavelength_nm) * length_mm
        return replace(
            arrived, origin=at, direction=direction, region=region, last=None, hits=ray.hits + 1, optical_mm=optical_mm
        )

    def _drawn(self, parts: tuple[Ray, Ray]) -> Ray:
        """Choose one of two parts with probability proportional to its power; it carries the total power."""
        back, transmitted = parts
        power = back.power + transmitted.power
        part = back if uniform(self.seed, back.number, back.hits - 1) * power < back.power else transmitted
        return replace(part, s=part.s * power / part.power, p=part.p * power / part.power)

    def _split(self, parts: tuple[Ray, ...], waiting: list[Ray]) -> Ray | None:
        """Drop parts below the minimum weight; of two that remain, the weaker is followed first as a new branch."""
        truncated = math.fsum(part.power for part in parts if part.power < part.min_power)
        if truncated > 0.0:
            self.sums[TRUNCATED] += truncated
            self._truncated(parts[0].origin)
        remaining = sorted((part for part in parts if part.power >= part.min_power), key=lambda part: part.power)
        if len(remaining) < 2:
            return remaining[0] if remaining else None
        waiting.append(remaining[1])
        self.branches += 1
        return replace(remaining[0], branch=self.branches - 1, parent=remaining[0].branch)

    def _attenuated(self, ray: Ray, region: str, length_mm: float) -> Ray:
        """Return a ray after a distance in a medium, and record the power that the medium absorbs."""
        absorption = self.regions[region].absorption_per_mm
        if self.mode == "count" or absorption == 0.0:
            return ray
        transmittance = math.exp(-absorption * length_mm)
        attenuated = replace(ray, s=ray.s * transmittance, p=ray.p * transmittance)
        self.sums[ABSORBED] += ray.power - attenuated.power
        return attenuated

    def _escape(self, ray: Ray) -> None:
        """Let a ray escape to infinity; in an absorbing medium it is absorbed instead."""
        self._monitor(ray, ray.region, math.inf)
        lossy = ray.region is not None and self.regions[ray.region].absorption_per_mm > 0.0
        fate = ABSORBED if self.mode != "count" and lossy else ESCAPED
        self._store_segment(ray, fate, None, math.inf)
        self._end(ray, fate, None)

    def _undefined(self, ray: Ray, at: Point, interface: Interface, length_mm: float) -> None:
        """Count a ray that met an interface from a medium other than its own, and store its location."""
        self.undefined += 1
        if len(self.undefined_at) < MAX_LOCATIONS:
            self.undefined_at.append(at)
        self._store_segment(ray, TRUNCATED, interface, length_mm)
        self._end(ray, TRUNCATED, interface)

    def _truncated(self, at: Point) -> None:
        """Count a truncated ray and store its location."""
        self.truncated += 1
        if len(self.truncated_at) < MAX_LOCATIONS:
            self.truncated_at.append(at)

    def _end(self, ray: Ray, fate: int, interface: Interface | None) -> None:
        self.sums[fate] += ray.power
        if fate == DETECTED and interface is not None and interface.receiver is not None:
            self.detected[interface.receiver][ray.source] += ray.power
            self.arrived[interface.receiver] += 1
            self.optical[interface.receiver] += ray.power * ray.optical_mm

    def _store_segment(
        self, ray: Ray, fate: int, interface: Interface | None, length_mm: float, kept: float = 1.0
    ) -> None:
        index = -1 if interface is None else self.scene.interfaces.index(interface)
        numbers = (ray.number, ray.branch, ray.parent, ray.hits, index, fate)
        self.segments.append((*numbers, *ray.origin, *ray.direction, length_mm, ray.s, ray.p, kept, ray.optical_mm))

    def _monitor(self, ray: Ray, region: str | None, length_mm: float) -> None:
        """Record a ray segment at each monitor that it crosses, with the power remaining there."""
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
                    position = math.dist(monitor.start, at) / math.dist(monitor.start, monitor.end)
                    self.maps[monitor.name][min(int(position * monitor.bins), monitor.bins - 1)] += power

    def result(self, segments: bool) -> Trace:
        """Return the trace, with powers as fractions of the emitted power."""
        emitted = self.scene.emitted
        stored = in_order(np.array(self.segments, dtype=SEGMENT_FIELDS)) if segments else None
        if stored is not None:
            stored["power_s"] /= emitted
            stored["power_p"] /= emitted
        return Trace(
            mode=self.mode,
            method="fan",
            rays=self.scene.rays,
            detectors={name: self._reading(name) for name in self.scene.receivers},
            monitors={
                name: Crossed(power / emitted, math.nan, int(rays), self.maps[name] / emitted)
                for name, (power, rays) in self.crossed.items()
            },
            ledger=Ledger(*(self.sums[fate] / emitted for fate in (DETECTED, ESCAPED, ABSORBED, TRUNCATED))),
            hits=self.hits,
            undefined=self.undefined,
            undefined_at_mm=tuple(self.undefined_at),
            truncated=self.truncated,
            truncated_at_mm=tuple(self.truncated_at),
            segments=stored,
        )

    def _reading(self, name: str) -> Detected:
        by_source, power = self.detected[name] / self.scene.emitted, float(self.detected[name].sum())
        mean_mm = self.optical[name] / power if power > 0.0 else math.nan
        return Detected(power / self.scene.emitted, math.nan, self.arrived[name], tuple(map(float, by_source)), mean_mm)
