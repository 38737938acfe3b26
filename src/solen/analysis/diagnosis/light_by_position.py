"""Light at the receivers as a function of the position of the emitter, at one angle of the motion.

The light from a chip is the mean over its points, so the integral of the light over position applies to chips of any
decentre and width. In the plane (2-D), this integral is computed from points, each integrated over its emission angles,
with more points where the response is curved. In space (3-D), the light from a point has two more dimensions, and a
strip is integrated as fast as a point. The integral is therefore computed from adjoining strips, each integrated over
position and emission angles; strips are halved where the curve through them bends. The chip height is as in the design.

Public names: `light_by_position` and `PositionIntegral`.
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
FIRST_STEP_MM, FIRST_CHANGE_STEP_MM, MIN_STEP_MM = 0.05, 0.1, 0.0001
"""Initial spacing of the positions, initial spacing for a change in space, and smallest spacing in the plane."""
MAX_BEND_MM = 3e-6
"""Product of spacing and deviation from the line between the neighbours above which intervals at a point are halved."""
STRIP_TOLERANCE_MM, MIN_STRIP_MM = 2e-5, 0.002
"""Tolerance of a strip's integral over its positions, for an emitted power of 1, and smallest strip width."""
MAX_STRIP_BEND_MM, MAX_CHANGE_BEND_MM = 4e-5, 2e-5
"""Deviation of the integral at a strip's midpoint, or of its change, from the curve, above which the strip and its
neighbours are halved.
"""
INNER_MM, OUTER_FACTOR = 0.35, 4.0
"""Distance from the axis outside which the tolerance of integrals over positions is increased, and by which factor."""
MAX_TOLERANCE = 2e-3
MAX_U_RATIO = 10.0
"""Largest uncertainty of a strip whose integration ended early, relative to the tolerance."""
STRIPS, STRIPS_IN_SPACE = (0.01, 2**11), (0.05, 2**13)
"""Width in mm of the strips traced for directional receivers, and rays per strip: in the plane, and in space."""

Curve = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class PositionIntegral:
    """Integral over the emitter position of the fractions of the light that reach both receivers, at one angle.

    Attributes
    ----------
    position_mm
        Traced positions, or ends of strips, (p,).
    integral_to
        Function that returns the integral (n, 2) up to positions (n,), right and left, in mm.
    """

    position_mm: FloatArray
    integral_to: Curve

    def mirrored(self) -> "PositionIntegral":
        """Return the integral at the opposite angle of a symmetric sensor, with right and left exchanged."""
        return PositionIntegral(-self.position_mm[::-1], lambda x_mm: -self.integral_to(-x_mm)[:, ::-1])


def light_by_position(
    wide: Sensor, angle_deg: float, reach_mm: float, like: PositionIntegral | None = None
) -> PositionIntegral:
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
        limit = "a diagnosis is not possible with random scattering"
        raise DesignError("scattered light", limit=limit, remedy="omit the scattering from the design")
    if scene.sources[0].emission() is None:
        limit = "a ray file has no emitter position that can be fitted"
        raise DesignError("emitter", limit=limit, remedy="specify a pattern")


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

    def strip(self, position_mm: float, width_mm: float = 0.0) -> Chip | Emitter:
        """Return the part of the chip at a position; a single point by default."""
        emission = self.source.emission()
        if emission is None:
            raise AssertionError("checked before: the chip consists of points")
        x, z, _ = emission.at(0.5 - 0.5 * position_mm / self.reach_mm)
        return replace(self.source, point=(x, z), width_mm=width_mm)

    def in_points(self) -> PositionIntegral:
        """Return the integral over the positions, computed from points in the plane."""
        from scipy.interpolate import PchipInterpolator

        points = Points(self.scene, TOLERANCE)

        def fractions_at(positions_mm: FloatArray) -> FloatArray:
            return np.asarray(points.powers((0.5 - 0.5 * positions_mm / self.reach_mm).tolist())[:, self.order])

        x_mm = self._first(FIRST_STEP_MM)
        fractions, step, intervals = fractions_at(x_mm), FIRST_STEP_MM, np.arange(x_mm.size - 1)
        while intervals.size and step > MIN_STEP_MM:
            step *= 0.5
            middles = 0.5 * (x_mm[intervals] + x_mm[intervals + 1])
            inserted = fractions_at(middles)
            line = 0.5 * (fractions[intervals] + fractions[intervals + 1])
            bend = np.abs(inserted - line).max(axis=1, initial=0.0)
            x_mm = np.insert(x_mm, intervals + 1, middles)
            fractions = np.insert(fractions, intervals + 1, inserted, axis=0)
            intervals = _adjoining(x_mm, middles[bend * step > MAX_BEND_MM])
        curve = PchipInterpolator(x_mm, fractions * self.directional_factors(x_mm))
        return PositionIntegral(x_mm, curve.antiderivative())

    def in_strips(self, like: PositionIntegral | None) -> PositionIntegral:
        """Return the integral over the positions, computed from strips in space."""
        from scipy.interpolate import CubicSpline

        similar: Curve = like.integral_to if like is not None else lambda x_mm: np.zeros((x_mm.size, len(SIDES)))

        def difference(x_mm: FloatArray, parts: FloatArray) -> CubicSpline:
            total = np.concatenate([np.zeros((1, len(SIDES))), np.cumsum(parts, axis=0)])
            return CubicSpline(x_mm, total - similar(x_mm) + similar(x_mm[:1]))

        step, max_bend = FIRST_STEP_MM, MAX_STRIP_BEND_MM
        if like is not None:
            step, max_bend = FIRST_CHANGE_STEP_MM, MAX_CHANGE_BEND_MM
        x_mm = self._first(step)
        parts, strips = self.parts(x_mm[:-1], x_mm[1:]), np.arange(x_mm.size - 1)
        while strips.size and step > MIN_STRIP_MM:
            step *= 0.5
            starts, middles = x_mm[strips], 0.5 * (x_mm[strips] + x_mm[strips + 1])
            curve, left = difference(x_mm, parts), self.parts(starts, middles)
            predicted = curve(middles) - curve(starts) + similar(middles) - similar(starts)
            bend = np.abs(predicted - left).max(axis=1, initial=0.0)
            right = parts[strips] - left
            parts[strips] = left
            x_mm, parts = np.insert(x_mm, strips + 1, middles), np.insert(parts, strips + 1, right, axis=0)
            strips = _adjoining(x_mm, middles[bend > max_bend * _tolerance_factor(middles)])
        curve = difference(x_mm, parts)
        return PositionIntegral(x_mm, lambda to_mm: np.asarray(similar(to_mm) + curve(to_mm)))

    def parts(self, low_mm: FloatArray, high_mm: FloatArray) -> FloatArray:
        """Return the integrals (n, 2) over strips between positions (n,)."""
        middles, widths = 0.5 * (low_mm + high_mm), high_mm - low_mm
        tolerance = np.clip(STRIP_TOLERANCE_MM * _tolerance_factor(middles) / widths, 0.0, MAX_TOLERANCE)
        rows = zip(middles.tolist(), widths.tolist(), tolerance.tolist(), strict=True)
        fractions = np.array([self._fractions(*row) for row in rows]).reshape(-1, len(SIDES))
        return np.asarray(fractions * widths[:, None] * self.directional_factors(middles))

    def _fractions(self, position_mm: float, width_mm: float, tolerance: float) -> list[float]:
        trace = integrate(replace(self.scene, sources=(self.strip(position_mm, width_mm),)), "power", tolerance)
        if not (trace.reached or 0.0 < trace.u_power <= MAX_U_RATIO * tolerance):
            limit = (
                f"a strip of the chip {1e3 * width_mm:.3g} µm wide, {position_mm:.3g} mm from the axis, could not be "
                f"integrated to {tolerance:.2g}: {trace.why}"
            )
            raise DesignError("light in space", limit=limit, remedy='set trace.dimension = "2d"')
        return [trace.detectors[side].power for side in SIDES]

    def _first(self, step_mm: float) -> FloatArray:
        count = 2 * math.ceil(self.reach_mm / step_mm)
        return np.linspace(-self.reach_mm, self.reach_mm, count + 1)

    def directional_factors(self, positions_mm: FloatArray) -> FloatArray:
        """Return the factors of the fractions (p, 2) at positions (p,) due to the directionality of the receivers."""
        if self.acceptance.is_flat:
            return np.ones((positions_mm.size, len(SIDES)))
        x_mm, factors = self._factors
        return np.column_stack([np.interp(positions_mm, x_mm, column) for column in factors.T])

    @cached_property
    def _factors(self) -> tuple[FloatArray, FloatArray]:
        """Positions (n,), and the fraction of the light from each that directional receivers detect, (n, 2)."""
        step, rays = STRIPS if self.scene.extrusion is None else STRIPS_IN_SPACE
        positions_mm = self._first(step)
        sources = (self.strip(position, step).with_rays(rays) for position in positions_mm.tolist())
        scenes = (replace(self.scene, sources=(source,)) for source in sources)
        return positions_mm, np.array([self.acceptance.factors(scene) for scene in scenes])


def _adjoining(positions_mm: FloatArray, curved_mm: FloatArray) -> IndexArray:
    """Return the intervals on both sides of positions at which the response is curved."""
    index = np.searchsorted(positions_mm, curved_mm)
    return np.unique(np.concatenate([index - 1, index])).astype(np.intp)


def _tolerance_factor(positions_mm: FloatArray) -> FloatArray:
    """Return the factor by which the tolerance is multiplied at each position."""
    return np.where(np.abs(positions_mm) <= INNER_MM, 1.0, OUTER_FACTOR)
