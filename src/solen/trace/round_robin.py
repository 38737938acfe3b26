"""Tracing with the algorithm of ray-optics: rays take turns; only every k-th weak part continues, with k-fold power.

The reference tracers follow one ray to its end, with all its parts down to the minimum weight. Here all rays are in one
list. In each round, each ray in turn meets the next object on its path; detectors are objects, too. A part that is
split off is appended to the list and takes its turn in the same round; a grating appends all its orders. A split-off
part whose power does not exceed ``min_split_power`` is dropped, with an exception: if successive rays meet the same
object, every k-th entry of the list continues with k times the power of its part, where k is the smallest integer for
which this power exceeds `MIN_SPLIT_POWER`. The mean reading of a monitor is therefore preserved with few rays, and
solen and ray-optics agree ray by ray.

This tracer is written in plain Python, is based on the reference tracer, and is slow. Dropped power is added to the
truncated power and added power is subtracted from it, so that the ledger remains complete.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from solen.curve import check_count, check_range
from solen.errors import DesignError
from solen.plane import Point
from solen.scene import Interface, Scene, Surface
from solen.scene.rayoptics import Facets
from solen.trace.reference import Ray, Tracer, launch_rays
from solen.trace.reference_surfaces import Arrival, orders_of
from solen.trace.result import ABSORBED, TRUNCATED, Limits, Trace

MIN_SPLIT_POWER = 0.01
"""Power above which a part is followed; of k weak parts, the one that continues has more than this power."""
NO_OBJECT = ""
"""Name of the object met by a ray that escapes."""


@dataclass(frozen=True)
class RoundRobin:
    """Rules for following rays in turns; powers are in the unit of the scene's sources.

    ``min_split_power`` is the power up to which a split-off part is dropped, ``min_power`` the power up to which a ray
    ends. ``starts_sequence`` specifies for each ray whether it starts a new sequence or continues that of the previous
    ray. Interfaces and monitors whose names agree up to the first dot belong to the same object.
    """

    min_split_power: float = MIN_SPLIT_POWER
    min_power: float = 0.0
    starts_sequence: Sequence[bool] = ()
    max_hits: int = 10_000

    def __post_init__(self) -> None:
        check_range("round-robin min_split_power", self.min_split_power, 0.0)
        check_range("round-robin min_power", self.min_power, 0.0)
        check_count("round-robin max_hits", self.max_hits, 0)


@dataclass
class _Entry:
    """An entry in the list: its ray, and the objects that the ray will meet on this segment.

    ``is_alone`` is True if the ray starts a sequence or has met another object than the previous ray; weak parts of the
    ray are then dropped.
    """

    ray: Ray
    is_alone: bool
    objects_ahead: list[str]
    hits: int = 0


def trace_round_robin(scene: Scene, rules: RoundRobin, *, segments: bool = False) -> Trace:
    """Trace every ray of every source in turns, in power mode.

    Raises
    ------
    DesignError
        If ``starts_sequence`` does not have exactly one entry per ray.
    """
    if rules.starts_sequence and len(rules.starts_sequence) != scene.rays:
        limit = f"must have one entry for each of {scene.rays} rays"
        raise DesignError("round-robin starts_sequence", value=f"{len(rules.starts_sequence)} entries", limit=limit)
    tracer = _RoundRobinTracer(scene, rules)
    tracer.run()
    return tracer.result(segments)


class _RoundRobinTracer(Tracer):
    """The reference tracer, advanced by one step of one ray at a time."""

    def __init__(self, scene: Scene, rules: RoundRobin) -> None:
        super().__init__(scene, "power", Limits(1e-15, max(rules.max_hits + 1, 1)), 0)
        self.rules = rules
        self.entries: list[_Entry | None] = []
        self.turn = 0

    def run(self) -> None:
        """Repeat rounds until no rays remain."""
        starts_sequence = self.rules.starts_sequence or (False,) * self.scene.rays
        rays = zip(launch_rays(self.scene, self.limits), starts_sequence, strict=True)
        self.entries = [_Entry(ray, is_alone, []) for ray, is_alone in rays]
        while any(entry is not None for entry in self.entries):
            previous, self.turn = NO_OBJECT, 0
            while self.turn < len(self.entries):  # the list grows during a round
                entry = self.entries[self.turn]
                if entry is not None:
                    previous = self._take_turn(entry, previous)
                self.turn += 1

    def _take_turn(self, entry: _Entry, previous: str) -> str:
        """Take one turn and return the object met; ``previous`` is the object met by the previous ray."""
        if not entry.objects_ahead:
            entry.objects_ahead = self._objects_ahead(entry.ray)
        met = entry.objects_ahead.pop(0)
        entry.is_alone = entry.is_alone or met != previous
        entry.hits += 1
        if met != NO_OBJECT and entry.hits > self.rules.max_hits:
            self._drop(entry.ray)
        elif not entry.objects_ahead:
            self._advance(entry)
        return met

    def _objects_ahead(self, ray: Ray) -> list[str]:
        """Return the objects of the monitors on a segment, followed by the object at its end."""
        interface, length_mm = self._next(ray)
        crossed = sorted(
            (t, _object(monitor.name))
            for monitor in self.scene.monitors
            for t in monitor.segment.hits(ray.origin, ray.direction)
            if t <= length_mm
        )
        return [*(name for _, name in crossed), NO_OBJECT if interface is None else _object(interface.name)]

    def _advance(self, entry: _Entry) -> None:
        """Advance the ray of an entry through the interface ahead; append the parts that are split off there."""
        waiting: list[Ray] = []
        ray = self._step(entry.ray, waiting)
        while ray is not None and ray.hits == entry.ray.hits and not waiting:  # the ray only passed the end of a curve
            ray = self._step(ray, waiting)
        self.entries += [_Entry(part, _is_alone(part, entry), [], entry.hits) for part in waiting]
        if ray is None:
            self.entries[self.turn] = None
        elif ray.power > self.rules.min_power:
            entry.ray = ray
        else:
            self._drop(ray)

    def _drop(self, ray: Ray) -> None:
        self._truncated(ray.origin)
        self._end(ray, TRUNCATED, None)
        self.entries[self.turn] = None

    def _normal(self, interface: Interface, at: Point, direction: Point) -> Point:
        curve = interface.curve
        return curve.normal_at_hit(at, direction) if isinstance(curve, Facets) else curve.normal_at(at)

    def _treated(
        self, surface: Surface, ray: Ray, back: Ray, facing: Point, beyond: str, waiting: list[Ray]
    ) -> Ray | None:
        """Treat a surface as in the other tracers, but follow all orders of a grating and balance the ledger."""
        interface = back.last
        if surface.grating is None or interface is None:
            return super()._treated(surface, ray, back, facing, beyond, waiting)
        n1, n2 = (self.regions[name].index_at(ray.wavelength_nm) for name in (str(back.region), beyond))
        arrival = Arrival(back.origin, ray.direction, ray.s, ray.p, facing, n1, n2, ray.wavelength_nm, False)
        onwards = back if surface.grating.mirrored else ray.onwards(back.origin, ray.direction, beyond, interface)
        remainder = ray.power
        for part in orders_of(surface.grating, arrival):
            remainder -= part.s + part.p
            if part.s + part.p > self.rules.min_split_power:
                order = replace(onwards, direction=part.direction, s=part.s, p=part.p)
                waiting.append(self._numbered(order, ray))
            else:
                self.sums[TRUNCATED] += part.s + part.p
                self._truncated(back.origin)
        self.sums[ABSORBED if remainder > 0.0 else TRUNCATED] += remainder
        return None

    def _split(self, parts: tuple[Ray, ...], waiting: list[Ray]) -> Ray | None:
        """Keep one part as the entry; append the other, drop it, or let it represent other dropped parts."""
        reflected, transmitted = parts
        is_splitter = reflected.last is not None and reflected.last.behaviour == "splitter"
        kept, other = (reflected, transmitted) if is_splitter else (transmitted, reflected)
        if kept.power <= 0.0:
            kept, other = other, kept
        if other.power > self.rules.min_split_power:
            waiting.append(self._numbered(other, kept))
        elif other.power > 0.0:
            count = 0 if is_splitter else self._represented_parts(other)
            self.sums[TRUNCATED] += (1 - count) * other.power
            self._truncated(other.origin)
            if count:
                waiting.append(self._numbered(replace(other, s=count * other.s, p=count * other.p), kept))
        return kept if kept.power > 0.0 else None

    def _represented_parts(self, part: Ray) -> int:
        """Return the number of parts that a weak part represents, or 0 if it is dropped."""
        entry = self.entries[self.turn]
        count = math.floor(MIN_SPLIT_POWER / part.power) + 1
        return count if entry is not None and not entry.is_alone and self.turn % count == 0 else 0

    def _numbered(self, part: Ray, parent: Ray) -> Ray:
        self.branches += 1
        return replace(part, branch=self.branches - 1, parent=parent.branch)


def _object(name: str) -> str:
    return name.split(".")[0]


def _is_alone(part: Ray, entry: _Entry) -> bool:
    """Return the initial ``is_alone`` of a part: true for a grating order, false for light through a splitter."""
    behaviour = None if part.last is None else part.last.behaviour
    return behaviour == "grating" or (entry.is_alone and behaviour != "splitter")
