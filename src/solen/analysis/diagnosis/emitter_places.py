"""Light of an emitter by its starting point, at one angle of the motion.

The idea: the light of a chip is the mean over its points, so the integral over position serves chips of any decentre
and width. In the plane it is built from points, each integrated over its angles, denser where the response is curved.
In space a point's light has two more dimensions, and integrating them costs the same for a point and for a strip: so
it is built from strips, whose integrals over position and angles match at their ends, and which are halved where the
curve through them is curved. The height of the chip is the design's.

The interface: `light_by_place` of a `Sensor` with a chip that covers all positions; `Places`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from solen.arrays import FloatArray, IndexArray
from solen.errors import DesignError
from solen.scene import Scene
from solen.scene.sources import Chip, Emitter
from solen.sensor import Sensor
from solen.sensor.acceptance import SIDES, Acceptance
from solen.trace.adaptive import Points, integrate

TOLERANCE = 1e-5
"""Within what fraction of the emitted power each point is integrated."""
FIRST_MM, FIRST_CHANGE_MM, LEAST_MM = 0.05, 0.1, 0.0001
"""Distance of places to begin with, also for changes in space, and the least that it is halved to in the plane."""
BEND_MM = 3e-6
"""Points are refined where they deviate by more from the line between their neighbours, per distance."""
STRIP_MM, LEAST_STRIP_MM = 2e-5, 0.002
"""Within what a strip's integral over its places is known, the emitted power being 1; the least width of a strip."""
STRIP_BEND_MM, CHANGE_BEND_MM = 4e-5, 2e-5
"""Where the integral at a strip's middle, or a change of it, departs from the curve by so much, the strip and its
neighbours are halved."""
NEAR_MM, FAR = 0.35, 4.0
"""Farther than this from the axis, integrals over places are let be off by so many times as much."""
MOST_TOLERANCE = 2e-3
MISSED = 10.0
"""Times the tolerance that a strip's uncertainty may reach where its integration ended early."""
SEEN, SEEN_IN_SPACE = (0.01, 2**11), (0.05, 2**13)
"""Widths of the strips in mm whose light directional receivers are asked for, and rays for each."""

Curve = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class Places:
    """Integral of both receivers' shares over the places of an emitter at one angle.

    Attributes
    ----------
    place_mm
        Traced places, or ends of strips, (p,).
    upto
        The integral (n, 2) up to places (n,), right and left, in mm.
    """

    place_mm: FloatArray
    upto: Curve

    def mirrored(self) -> "Places":
        """The integral for the opposite angle of a symmetric sensor: right and left exchanged."""
        return Places(-self.place_mm[::-1], lambda at: -self.upto(-at)[:, ::-1])


def light_by_place(wide: Sensor, angle_deg: float, reach_mm: float, like: Places | None = None) -> Places:
    """Light at one angle, for a chip that covers all positions.

    Parameters
    ----------
    wide
        The sensor; its chip is twice ``reach_mm`` wide.
    angle_deg
        Angle of the motion.
    reach_mm
        How far from the axis.
    like
        That of a similar sensor: in space only the difference is then traced, by fewer strips.

    Raises
    ------
    DesignError
        If light is scattered, comes from a file of rays, or is to go out in space by a pattern of the plane.
    """
    scene = wide.scene(angle_deg)
    check_light(scene)
    chip = _Chip(scene, Acceptance.of(wide), reach_mm)
    return chip.in_points() if scene.extrusion is None else chip.in_strips(like)


def check_light(scene: Scene) -> None:
    """`DesignError` if a scene's emitter cannot be resolved by position."""
    if scene.is_random:
        limit = "diagnosis needs light without random scatter"
        raise DesignError("diagnosis", value="scattered light", limit=limit, remedy="leave the scatter out")
    if scene.sources[0].emission() is None:
        raise DesignError("emitter", limit="a file of rays has no points to fit", remedy="state a pattern")


class _Chip:
    """A chip that covers all positions, at one angle."""

    def __init__(self, scene: Scene, acceptance: Acceptance, reach_mm: float) -> None:
        self.scene, self.acceptance, self.reach_mm = replace(scene, sources=scene.sources[:1]), acceptance, reach_mm
        self.order = [list(scene.receivers).index(side) for side in SIDES]

    @cached_property
    def source(self) -> Chip | Emitter:
        source = self.scene.sources[0]
        if not isinstance(source, Chip | Emitter):
            raise AssertionError("checked before: a chip made of points")
        return source

    def strip(self, place_mm: float, width_mm: float = 0.0) -> Chip | Emitter:
        """A part of the chip."""
        emission = self.source.emission()
        if emission is None:
            raise AssertionError("checked before: a chip made of points")
        x, z, _ = emission.at(0.5 - 0.5 * place_mm / self.reach_mm)
        return replace(self.source, point=(x, z), width_mm=width_mm)

    def in_points(self) -> Places:
        """Integral over the places, by points of the plane."""
        from scipy.interpolate import PchipInterpolator

        points = Points(self.scene, TOLERANCE)

        def shares_at(places_mm: FloatArray) -> FloatArray:
            return np.asarray(points.powers((0.5 - 0.5 * places_mm / self.reach_mm).tolist())[:, self.order])

        places = self._first(FIRST_MM)
        shares, step, suspects = shares_at(places), FIRST_MM, np.arange(places.size - 1)
        while suspects.size and step > LEAST_MM:
            step *= 0.5
            middles = 0.5 * (places[suspects] + places[suspects + 1])
            between = shares_at(middles)
            bend = np.abs(between - 0.5 * (shares[suspects] + shares[suspects + 1])).max(axis=1, initial=0.0)
            places, shares = np.insert(places, suspects + 1, middles), np.insert(shares, suspects + 1, between, axis=0)
            suspects = _beside(places, middles[bend * step > BEND_MM])
        return Places(places, PchipInterpolator(places, shares * self.seen(places)).antiderivative())

    def in_strips(self, like: Places | None) -> Places:
        """Integral over the places, by strips in space."""
        from scipy.interpolate import CubicSpline

        known: Curve = like.upto if like is not None else lambda at: np.zeros((at.size, len(SIDES)))

        def curve(places: FloatArray, parts: FloatArray) -> CubicSpline:
            total = np.concatenate([np.zeros((1, len(SIDES))), np.cumsum(parts, axis=0)])
            return CubicSpline(places, total - known(places) + known(places[:1]))

        step, most = (FIRST_MM, STRIP_BEND_MM) if like is None else (FIRST_CHANGE_MM, CHANGE_BEND_MM)
        places = self._first(step)
        parts, suspects = self.parts(places[:-1], places[1:]), np.arange(places.size - 1)
        while suspects.size and step > LEAST_STRIP_MM:
            step *= 0.5
            middles = 0.5 * (places[suspects] + places[suspects + 1])
            before, left = curve(places, parts), self.parts(places[suspects], middles)
            moved = known(middles) - known(places[suspects])
            bend = np.abs(before(middles) - before(places[suspects]) + moved - left).max(axis=1, initial=0.0)
            right = parts[suspects] - left
            parts[suspects] = left
            places, parts = np.insert(places, suspects + 1, middles), np.insert(parts, suspects + 1, right, axis=0)
            suspects = _beside(places, middles[bend > most * _room(middles)])
        beyond = curve(places, parts)
        return Places(places, lambda at: np.asarray(known(at) + beyond(at)))

    def parts(self, low_mm: FloatArray, high_mm: FloatArray) -> FloatArray:
        """Integrals (n, 2) over strips between places (n,)."""
        middles, widths = 0.5 * (low_mm + high_mm), high_mm - low_mm
        tolerance = np.clip(STRIP_MM * _room(middles) / widths, 0.0, MOST_TOLERANCE)
        rows = zip(middles.tolist(), widths.tolist(), tolerance.tolist(), strict=True)
        shares = np.array([self._share(*row) for row in rows]).reshape(-1, len(SIDES))
        return np.asarray(shares * widths[:, None] * self.seen(middles))

    def _share(self, place_mm: float, width_mm: float, tolerance: float) -> list[float]:
        trace = integrate(replace(self.scene, sources=(self.strip(place_mm, width_mm),)), "power", tolerance)
        if not (trace.reached or 0.0 < trace.u_power <= MISSED * tolerance):
            limit = f"a strip {1e3 * width_mm:.3g} um wide must be integrated to {tolerance:.2g}: {trace.why}"
            remedy = 'set trace.dimension = "2d"'
            raise DesignError("light in space", value=f"{place_mm:.3g} mm off the axis", limit=limit, remedy=remedy)
        return [trace.detectors[side].power for side in SIDES]

    def _first(self, step_mm: float) -> FloatArray:
        count = 2 * math.ceil(self.reach_mm / step_mm)
        return np.linspace(-self.reach_mm, self.reach_mm, count + 1)

    def seen(self, places_mm: FloatArray) -> FloatArray:
        """Factors of directional receivers for the shares (p, 2) at positions (p,); 1 for flat windows."""
        if self.acceptance.is_flat:
            return np.ones((places_mm.size, len(SIDES)))
        places, factors = self._factors
        return np.column_stack([np.interp(places_mm, places, one) for one in factors.T])

    @cached_property
    def _factors(self) -> tuple[FloatArray, FloatArray]:
        """Places (n,) and what is seen of each one's light (n, 2)."""
        step, rays = SEEN if self.scene.extrusion is None else SEEN_IN_SPACE
        places = np.linspace(-self.reach_mm, self.reach_mm, 2 * math.ceil(self.reach_mm / step) + 1)
        lights = (self.strip(place, step).with_rays(rays) for place in places.tolist())
        scenes = (replace(self.scene, sources=(light,)) for light in lights)
        return places, np.array([self.acceptance.factors(scene) for scene in scenes])


def _beside(places: FloatArray, bent: FloatArray) -> IndexArray:
    """The intervals on both sides of bent places."""
    at = np.searchsorted(places, bent)
    return np.unique(np.concatenate([at - 1, at])).astype(np.intp)


def _room(places_mm: FloatArray) -> FloatArray:
    """Factor on tolerances at places."""
    return np.where(np.abs(places_mm) <= NEAR_MM, 1.0, FAR)
