"""Rays in turns, and weak parts by their number: the rule by which ray-optics follows light, for its scenes.

The plain tracers follow one ray to its end and all its parts to the stated weight. Here, all rays are in one list; in a
round each of them in turn meets the next thing on its way, a detector too, and a part that is split off is added at the
end of the list, where its turn comes in the same round; all orders of a grating are. A part that is split off with no
more than the power ``weak`` is dropped, but where rays follow one another onto one object, the part of every k-th place
of the list goes on with k times its power, k being the least number that makes it more than `WEAK`. So what a monitor
reads keeps its mean, with few rays, and is the same in both programs, ray by ray.

This is slow, plain Python on the reference tracer; what is dropped counts as truncated, and what is added is taken from
that again, so that the ledger is whole.
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
"""Power that makes a part worth following: of k weak parts the one that goes on has more."""
NOTHING = ""
"""What a ray meets that escapes."""


@dataclass(frozen=True)
class Turns:
    """How rays are followed in turns; powers are in the unit of the scene's sources.

    ``weak`` is the power up to which a part split off is dropped, ``weakest`` that up to which a ray ends. ``fresh``
    says of each ray whether it begins anew instead of following the one before it. Interfaces and monitors are one
    object where their names agree up to the first dot.
    """

    weak: float = WEAK
    weakest: float = 0.0
    fresh: Sequence[bool] = ()
    max_hits: int = 10_000

    def __post_init__(self) -> None:
        check_range("turns weak", self.weak, 0.0)
        check_range("turns weakest", self.weakest, 0.0)
        check_count("turns max_hits", self.max_hits, 0)


@dataclass
class _Place:
    """A place of the list: its ray, whether that stands alone, and the objects still to be met on this stretch."""

    ray: Ray
    alone: bool
    ahead: list[str]
    met: int = 0


def trace_in_turns(scene: Scene, turns: Turns, *, legs: bool = False) -> Trace:
    """Trace every ray of every source in turns, in power mode.

    `DesignError` if ``fresh`` is not as long as there are rays.
    """
    if turns.fresh and len(turns.fresh) != scene.rays:
        raise DesignError("turns fresh", value=len(turns.fresh), limit=f"must be one for each of {scene.rays} rays")
    tracer = _InTurns(scene, turns)
    tracer.run()
    return tracer.result(legs)


class _InTurns(Tracer):
    """The reference tracer, one step of one ray at a time."""

    def __init__(self, scene: Scene, turns: Turns) -> None:
        super().__init__(scene, "power", Limits(1e-15, max(turns.max_hits + 1, 1)), 0)
        self.turns = turns
        self.places: list[_Place | None] = []
        self.turn = 0

    def run(self) -> None:
        """Rounds until no ray is left."""
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
        """Take one turn, and say what was met; ``last`` is what the ray before met."""
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
        """Objects of the monitors on a stretch, and the one at its end."""
        interface, length_mm = self._next(ray)
        crossed = sorted(
            (t, _object(monitor.name))
            for monitor in self.scene.monitors
            for t in monitor.segment.hits(ray.origin, ray.direction)
            if t <= length_mm
        )
        return [*(name for _, name in crossed), NOTHING if interface is None else _object(interface.name)]

    def _go_on(self, place: _Place) -> None:
        """Carry a place's ray through the interface ahead; what is split off there gets a place at the end."""
        waiting: list[Ray] = []
        ray = self._step(place.ray, waiting)
        while ray is not None and ray.hits == place.ray.hits and not waiting:  # only past the end of a curve
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
        return curve.normal_met(at, direction) if isinstance(curve, Facets) else curve.normal_at(at)

    def _treated(
        self, surface: Surface, ray: Ray, back: Ray, facing: Point, beyond: str, waiting: list[Ray]
    ) -> Ray | None:
        """As in every tracer, but all orders of a grating are followed; what they take or add is in the ledger."""
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
        """Keep one part in its place; the other one is added, or dropped, or goes on for others that are dropped."""
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
        """How many parts a weak one stands for; 0 where it is dropped."""
        place = self.places[self.turn]
        times = math.floor(WEAK / off.power) + 1
        return times if place is not None and not place.alone and self.turn % times == 0 else 0

    def _numbered(self, part: Ray, kept: Ray) -> Ray:
        self.branches += 1
        return replace(part, branch=self.branches - 1, parent=kept.branch)


def _object(name: str) -> str:
    return name.split(".")[0]


def _stands_alone(part: Ray, place: _Place) -> bool:
    """Whether a part stands alone at first: an order of a grating does, what a splitter lets through does not."""
    behaviour = None if part.last is None else part.last.behaviour
    return behaviour == "grating" or (place.alone and behaviour != "splitter")
