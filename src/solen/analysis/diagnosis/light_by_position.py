"""Light from an emitter as a function of the starting position, at one angle of the motion.

The light from a chip is the mean over its points, so the integral over position applies to chips of any decentre and
width. In the plane this integral is computed from points, each integrated over its emission angles, with more points
where the response is curved. In space the light from a point has two more dimensions, and integration takes as long for
a strip as for a point. The integral is therefore computed from strips, integrated over position and angles with
matching ends; strips are halved where the curve through them bends. The chip height is as in the design.

Public names: `light_by_place` and `Places`.
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
"""Integration tolerance for each point, as a fraction of the emitted power."""
FIRST_MM, FIRST_CHANGE_MM, MIN_MM = 0.05, 0.1, 0.0001
"""Initial spacing of the positions, also for changes in space, and the smallest spacing after halving in the plane."""
BEND_MM = 3e-6
"""Deviation from the line between its neighbours, per unit spacing, above which positions about a point are refined."""
STRIP_MM, MIN_STRIP_MM = 2e-5, 0.002
"""Tolerance of a strip's integral over its positions, for an emitted power of 1, and the minimum strip width."""
STRIP_BEND_MM, CHANGE_BEND_MM = 4e-5, 2e-5
"""Deviation of the integral at a strip's midpoint, or of its change, from the curve, above which the strip and its
neighbours are halved.
"""
NEAR_MM, FAR = 0.35, 4.0
"""Distance from the axis beyond which the tolerance of integrals over positions is increased, and the factor."""
MAX_TOLERANCE = 2e-3
MISSED = 10.0
"""Largest uncertainty of a strip whose integration ended early, as a multiple of the tolerance."""
STRIPS, STRIPS_IN_SPACE = (0.01, 2**11), (0.05, 2**13)
"""Width in mm of the strips that are traced for directional receivers, and number of rays for each strip."""

Curve = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class Places:
    """Integral of both receivers' fractions of the light over the emitter position, at one angle.

    Attributes
    ----------
    place_mm
        Traced positions, or ends of strips, (p,).
    integral_to
        Function that returns the integral (n, 2) up to positions (n,), right and left, in mm.
    """

    place_mm: FloatArray
    integral_to: Curve

    def mirrored(self) -> "Places":
        """Return the integral at the opposite angle of a symmetric sensor, with right and left exchanged."""
        return Places(-self.place_mm[::-1], lambda at: -self.integral_to(-at)[:, ::-1])


def light_by_place(wide: Sensor, angle_deg: float, reach_mm: float, like: Places | None = None) -> Places:
    """Compute the light at one angle, for a chip that covers all positions.

    Parameters
    ----------
    wide
        The sensor, with a chip of width 2 ``reach_mm``.
    angle_deg
        Angle of the motion.
    reach_mm
        Largest distance from the axis.
    like
        Result for a similar sensor; in space, only the difference is then traced, with fewer strips.

    Raises
    ------
    DesignError
        If light is scattered or comes from a ray file, or if a planar emission pattern is used in space.
    """
    scene = wide.scene(angle_deg)
    check_light(scene)
    chip = _Chip(scene, Acceptance.of(wide), reach_mm)
    return chip.in_points() if scene.extrusion is None else chip.in_strips(like)


def check_light(scene: Scene) -> None:
    """Raise `DesignError` if a scene's emitter cannot be resolved by position."""
    if scene.is_random:
        limit = "diagnosis requires light without random scatter"
        raise DesignError("diagnosis", value="scattered light", limit=limit, remedy="omit the scatter")
    if scene.sources[0].emission() is None:
        raise DesignError(
            "emitter", limit="a ray file has no emitter position that can be fitted", remedy="specify a pattern"
        )


class _Chip:
    """A chip that covers all positions, at one angle."""

    def __init__(self, scene: Scene, acceptance: Acceptance, reach_mm: float) -> None:
        self.scene, self.acceptance, self.reach_mm = replace(scene, sources=scene.sources[:1]), acceptance, reach_mm
        self.order = [list(scene.receivers).index(side) for side in SIDES]

    @cached_property
    def source(self) -> Chip | Emitter:
        source = self.scene.sources[0]
        if not isinstance(source, Chip | Emitter):
            raise AssertionError("checked before: the chip consists of points")
        return source

    def strip(self, place_mm: float, width_mm: float = 0.0) -> Chip | Emitter:
        """Return the part of the chip at a position; a single point by default."""
        emission = self.source.emission()
        if emission is None:
            raise AssertionError("checked before: the chip consists of points")
        x, z, _ = emission.at(0.5 - 0.5 * place_mm / self.reach_mm)
        return replace(self.source, point=(x, z), width_mm=width_mm)

    def in_points(self) -> Places:
        """Return the integral over the positions, computed from points in the plane."""
        from scipy.interpolate import PchipInterpolator

        points = Points(self.scene, TOLERANCE)

        def shares_at(places_mm: FloatArray) -> FloatArray:
            return np.asarray(points.powers((0.5 - 0.5 * places_mm / self.reach_mm).tolist())[:, self.order])

        places = self._first(FIRST_MM)
        shares, step, suspects = shares_at(places), FIRST_MM, np.arange(places.size - 1)
        while suspects.size and step > MIN_MM:
            step *= 0.5
            middles = 0.5 * (places[suspects] + places[suspects + 1])
            between = shares_at(middles)
            bend = np.abs(between - 0.5 * (shares[suspects] + shares[suspects + 1])).max(axis=1, initial=0.0)
            places, shares = np.insert(places, suspects + 1, middles), np.insert(shares, suspects + 1, between, axis=0)
            suspects = _adjoining(places, middles[bend * step > BEND_MM])
        return Places(places, PchipInterpolator(places, shares * self.directional_factors(places)).antiderivative())

    def in_strips(self, like: Places | None) -> Places:
        """Return the integral over the positions, computed from strips in space."""
        from scipy.interpolate import CubicSpline

        known: Curve = like.integral_to if like is not None else lambda at: np.zeros((at.size, len(SIDES)))

        def curve(places: FloatArray, parts: FloatArray) -> CubicSpline:
            total = np.concatenate([np.zeros((1, len(SIDES))), np.cumsum(parts, axis=0)])
            return CubicSpline(places, total - known(places) + known(places[:1]))

        step, most = (FIRST_MM, STRIP_BEND_MM) if like is None else (FIRST_CHANGE_MM, CHANGE_BEND_MM)
        places = self._first(step)
        parts, suspects = self.parts(places[:-1], places[1:]), np.arange(places.size - 1)
        while suspects.size and step > MIN_STRIP_MM:
            step *= 0.5
            middles = 0.5 * (places[suspects] + places[suspects + 1])
            before, left = curve(places, parts), self.parts(places[suspects], middles)
            moved = known(middles) - known(places[suspects])
            bend = np.abs(before(middles) - before(places[suspects]) + moved - left).max(axis=1, initial=0.0)
            right = parts[suspects] - left
            parts[suspects] = left
            places, parts = np.insert(places, suspects + 1, middles), np.insert(parts, suspects + 1, right, axis=0)
            suspects = _adjoining(places, middles[bend > most * _tolerance_factor(middles)])
        beyond = curve(places, parts)
        return Places(places, lambda at: np.asarray(known(at) + beyond(at)))

    def parts(self, low_mm: FloatArray, high_mm: FloatArray) -> FloatArray:
        """Return the integrals (n, 2) over strips between positions (n,)."""
        middles, widths = 0.5 * (low_mm + high_mm), high_mm - low_mm
        tolerance = np.clip(STRIP_MM * _tolerance_factor(middles) / widths, 0.0, MAX_TOLERANCE)
        rows = zip(middles.tolist(), widths.tolist(), tolerance.tolist(), strict=True)
        shares = np.array([self._share(*row) for row in rows]).reshape(-1, len(SIDES))
        return np.asarray(shares * widths[:, None] * self.directional_factors(middles))

    def _share(self, place_mm: float, width_mm: float, tolerance: float) -> list[float]:
        trace = integrate(replace(self.scene, sources=(self.strip(place_mm, width_mm),)), "power", tolerance)
        if not (trace.reached or 0.0 < trace.u_power <= MISSED * tolerance):
            limit = f"a strip {1e3 * width_mm:.3g} um wide must be integrated to {tolerance:.2g}: {trace.why}"
            remedy = 'set trace.dimension = "2d"'
            raise DesignError("light in space", value=f"{place_mm:.3g} mm from the axis", limit=limit, remedy=remedy)
        return [trace.detectors[side].power for side in SIDES]

    def _first(self, step_mm: float) -> FloatArray:
        count = 2 * math.ceil(self.reach_mm / step_mm)
        return np.linspace(-self.reach_mm, self.reach_mm, count + 1)

    def directional_factors(self, places_mm: FloatArray) -> FloatArray:
        """Return the detection factors of directional receivers for the fractions (p, 2) at positions (p,); 1 for flat windows."""
        if self.acceptance.is_flat:
            return np.ones((places_mm.size, len(SIDES)))
        places, factors = self._factors
        return np.column_stack([np.interp(places_mm, places, one) for one in factors.T])

    @cached_property
    def _factors(self) -> tuple[FloatArray, FloatArray]:
        """Positions (n,), and the fraction of the light from each that directional receivers detect, (n, 2)."""
        step, rays = STRIPS if self.scene.extrusion is None else STRIPS_IN_SPACE
        places = np.linspace(-self.reach_mm, self.reach_mm, 2 * math.ceil(self.reach_mm / step) + 1)
        lights = (self.strip(place, step).with_rays(rays) for place in places.tolist())
        scenes = (replace(self.scene, sources=(light,)) for light in lights)
        return places, np.array([self.acceptance.factors(scene) for scene in scenes])


def _adjoining(places: FloatArray, bent: FloatArray) -> IndexArray:
    """Return the intervals on both sides of positions where the response is curved."""
    at = np.searchsorted(places, bent)
    return np.unique(np.concatenate([at - 1, at])).astype(np.intp)


def _tolerance_factor(places_mm: FloatArray) -> FloatArray:
    """Return the factor by which the tolerance is multiplied at each position."""
    return np.where(np.abs(places_mm) <= NEAR_MM, 1.0, FAR)
