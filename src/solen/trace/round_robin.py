"""The rule by which ray-optics follows light: rays take turns, and weak parts are dropped according to their number.

The reference tracers follow one ray to its end, with all its parts down to the minimum weight. Here all rays are in one
list. In each round, each ray in turn meets the next object on its way; detectors count as objects. A part that is split
off is appended to the list and takes its turn in the same round; a grating appends all its orders. A split-off part
whose power does not exceed ``weak`` is dropped, with an exception: among rays that meet one object in succession, the
part at every k-th place of the list continues with k times its power, where k is the smallest integer for which this
exceeds `WEAK`. The mean reading of a monitor is therefore preserved with few rays, and is the same in both programs,
ray by ray.

This tracer is slow, plain Python based on the reference tracer. Dropped power counts as truncated and added power is
subtracted from it, so that the ledger remains complete.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from solen.curve import check_count, check_range
from solen.errors import DesignError
from solen.plane import Point
from solen.scene import Interface, Scene, Surface
from solen.scene.rayoptics import Facets
from solen.trace.reference import Ray, Tracer, launched
from solen.trace.reference_surfaces import Arrival, orders_of
from solen.trace.result import ABSORBED, TRUNCATED, Limits, Trace

WEAK = 0.01
"""Power above which a part is followed; of k weak parts, the one that continues carries more than this."""
NOTHING = ""
"""Name of the object met by a ray that escapes."""


@dataclass(frozen=True)
class RoundRobin:
    """Rules for following rays in turns; powers are in the unit of the scene's sources.

    ``weak`` is the power up to which a split-off part is dropped, ``weakest`` the power up to which a ray ends.
    ``fresh`` indicates for each ray whether it starts a new sequence or continues that of the previous ray. Interfaces
    and monitors whose names agree up to the first dot belong to the same object.
    """

    weak: float = WEAK
    weakest: float = 0.0
    fresh: Sequence[bool] = ()
    max_hits: int = 10_000

    def __post_init__(self) -> None:
        check_range("round-robin weak", self.weak, 0.0)
        check_range("round-robin weakest", self.weakest, 0.0)
        check_count("round-robin max_hits", self.max_hits, 0)


@dataclass
class _Place:
    """An entry in the list: its ray, whether the ray is alone, and the objects still to be met on this segment."""

    ray: Ray
    alone: bool
    ahead: list[str]
    met: int = 0


def trace_round_robin(scene: Scene, turns: RoundRobin, *, legs: bool = False) -> Trace:
    """Trace every ray of every source in turns, in power mode.

    Raises
    ------
    DesignError
        If ``fresh`` does not have exactly one entry per ray.
    """
    if turns.fresh and len(turns.fresh) != scene.rays:
        raise DesignError(
            "round-robin fresh", value=len(turns.fresh), limit=f"must have one entry for each of {scene.rays} rays"
        )
    tracer = _RoundRobinTracer(scene, turns)
    tracer.run()
    return tracer.result(legs)


class _RoundRobinTracer(Tracer):
    """The reference tracer, advanced by one step of one ray at a time."""

    def __init__(self, scene: Scene, turns: RoundRobin) -> None:
        super().__init__(scene, "power", Limits(1e-15, max(turns.max_hits + 1, 1)), 0)
        self.turns = turns
        self.places: list[_Place | None] = []
        self.turn = 0

    def run(self) -> None:
        """Repeat rounds until no rays remain."""
        fresh = self.turns.fresh or (False,) * self.scene.rays
        rays = zip(launched(self.scene, self.limits), fresh, strict=True)
        self.places = [_Place(ray, alone, []) for ray, alone in rays]
        left = True
        while left:
            left, last, self.turn = False, NOTHING, 0
            while self.turn < len(self.places):
                place = self.places[self.turn]
                if place is not None:
                    last = self._meet(place, last)
                    left = left or self.places[self.turn] is not None
                self.turn += 1

    def _meet(self, place: _Place, last: str) -> str:
        """Take one turn and return the object met; ``last`` is the object met by the previous ray."""
        if not place.ahead:
            place.ahead = self._objects_ahead(place.ray)
        met = place.ahead.pop(0)
        place.alone = place.alone or met != last
        place.met += 1
        if met != NOTHING and place.met > self.turns.max_hits:
            self._drop(place.ray)
        elif not place.ahead:
            self._go_on(place)
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
        return [*(name for _, name in crossed), NOTHING if interface is None else _object(interface.name)]

    def _go_on(self, place: _Place) -> None:
        """Advance the ray of an entry through the interface ahead; append the parts that are split off there."""
        waiting: list[Ray] = []
        ray = self._step(place.ray, waiting)
        while ray is not None and ray.hits == place.ray.hits and not waiting:  # the ray only passed the end of a curve
            ray = self._step(ray, waiting)
        self.places += [_Place(part, _stands_alone(part, place), [], place.met) for part in waiting]
        if ray is None:
            self.places[self.turn] = None
        elif ray.power > self.turns.weakest:
            place.ray = ray
        else:
            self._drop(ray)

    def _drop(self, ray: Ray) -> None:
        self._truncated(ray.origin)
        self._end(ray, TRUNCATED, None)
        self.places[self.turn] = None

    def _normal(self, interface: Interface, at: Point, direction: Point) -> Point:
        curve = interface.curve
        return curve.normal_at_hit(at, direction) if isinstance(curve, Facets) else curve.normal_at(at)

    def _treated(
        self, surface: Surface, ray: Ray, back: Ray, facing: Point, beyond: str, waiting: list[Ray]
    ) -> Ray | None:
        """Treat a surface as every tracer does, but follow all orders of a grating and balance the ledger."""
        interface = back.last
        if surface.grating is None or interface is None:
            return super()._treated(surface, ray, back, facing, beyond, waiting)
        n1, n2 = (self.regions[name].index_at(ray.wavelength_nm) for name in (str(back.region), beyond))
        arrival = Arrival(back.origin, ray.direction, ray.s, ray.p, facing, n1, n2, ray.wavelength_nm, False)
        onwards = back if surface.grating.mirrored else ray.onwards(back.origin, ray.direction, beyond, interface)
        left = ray.power
        for part in orders_of(surface.grating, arrival):
            left -= part.s + part.p
            if part.s + part.p > self.turns.weak:
                off = replace(onwards, direction=part.direction, s=part.s, p=part.p)
                waiting.append(self._numbered(off, ray))
            else:
                self.sums[TRUNCATED] += part.s + part.p
                self._truncated(back.origin)
        self.sums[ABSORBED if left > 0.0 else TRUNCATED] += left
        return None

    def _split(self, parts: tuple[Ray, ...], waiting: list[Ray]) -> Ray | None:
        """Keep one part as the entry; append the other, drop it, or let it represent other dropped parts."""
        back, on = parts
        splitter = back.last is not None and back.last.behaviour == "splitter"
        kept, off = (back, on) if splitter else (on, back)
        if kept.power <= 0.0:
            kept, off = off, kept
        if off.power > self.turns.weak:
            waiting.append(self._numbered(off, kept))
        elif off.power > 0.0:
            times = 0 if splitter else self._times(off)
            self.sums[TRUNCATED] += (1 - times) * off.power
            self._truncated(off.origin)
            if times:
                waiting.append(self._numbered(replace(off, s=times * off.s, p=times * off.p), kept))
        return kept if kept.power > 0.0 else None

    def _times(self, off: Ray) -> int:
        """Return the number of parts that a weak part represents, or 0 if it is dropped."""
        place = self.places[self.turn]
        times = math.floor(WEAK / off.power) + 1
        return times if place is not None and not place.alone and self.turn % times == 0 else 0

    def _numbered(self, part: Ray, kept: Ray) -> Ray:
        self.branches += 1
        return replace(part, branch=self.branches - 1, parent=kept.branch)


def _object(name: str) -> str:
    return name.split(".")[0]


def _stands_alone(part: Ray, place: _Place) -> bool:
    """Return whether a part is initially alone: true for a grating order, false for light through a splitter."""
    behaviour = None if part.last is None else part.last.behaviour
    return behaviour == "grating" or (place.alone and behaviour != "splitter")
