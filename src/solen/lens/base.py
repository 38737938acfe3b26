"""The front of a sensor as an optical element.

A :class:`Lens` is drawn in its own frame, the vertex at the origin and the axis along +z, from its left edge to its
right one, so that the material lies on its left; the emitter is ``distance_mm`` before the vertex. A
:class:`CurvedLens` has a profile z(x), by which its smallest spot is found; a :class:`DeviatingLens` is another lens
and a deviation along z, as it was designed or measured.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.curve import Curve, fitted
from solen.plane import Point, dot, unit
from solen.results import Result, reported

SPOT_RAYS = 1024
"""Rays by which the smallest spot is found; twice as many move that of an oval by less than 2e-5 of itself."""
CURVE_TOLERANCE_MM = 1e-6
"""Tolerance of the traced curve against a deviating profile: 1 nm."""


class LensSizes:
    """Lengths common to all lenses, stated or computed."""

    distance_mm: float
    half_width_mm: float


class Lens(LensSizes, Result, ABC):
    """The face that light enters through."""

    @property
    @abstractmethod
    def front(self) -> Curve:
        """The face from its left edge to its right one, vertex at the origin, material on its left."""

    shape_name: ClassVar[str] = ""

    @reported
    def shape(self) -> str:
        """Kind of lens, as named by ``lens.shape``."""
        return self.shape_name

    @reported
    @abstractmethod
    def depth_mm(self) -> float:
        """From the vertex to the plane of the edges, where the stem begins."""

    def table(self, tolerance_mm: float = 1e-4) -> str:
        """CSV of x and z of points whose polyline stays within ``tolerance_mm`` of the face."""
        rows = (f"{round(float(x), 14)},{round(float(z), 14)}" for x, z in self.front.flattened(tolerance_mm))
        return "\n".join(["x_mm,z_mm", *rows, ""])

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings that concern the lens's response."""
        return ()

    @reported
    def acceptance_deg(self) -> float:
        """Largest angle from the axis at which the emitter's light hits the face."""
        return math.degrees(math.atan2(self.half_width_mm, self.distance_mm + self.depth_mm))


class CurvedSizes(LensSizes):
    """What a curved lens has besides."""

    outside_index: float


@dataclass(frozen=True)
class Spot:
    """Smallest spot of the light accepted by a lens: its position, and its rms width, in mm."""

    x_mm: float
    z_mm: float
    rms_mm: float


class CurvedLens(CurvedSizes, Lens):
    """A lens with a profile z(x); of one that differs by height it is the middle section."""

    @abstractmethod
    def z_mm(self, x_mm: ArrayLike) -> FloatArray:
        """Profile z(x) at any array of lateral positions within the half width."""

    @abstractmethod
    def slope(self, x_mm: ArrayLike) -> FloatArray:
        """dz/dx of the profile, dimensionless."""

    @reported
    def edge_incidence_deg(self) -> float:
        """Angle of incidence of the emitter's ray on the lens's right edge."""
        edge: Point = (self.half_width_mm, self.depth_mm)
        ray, slope = unit((edge[0], edge[1] + self.distance_mm)), float(self.slope(edge[0]))
        return math.degrees(math.acos(dot(ray, unit((-slope, 1.0)))))

    def best_spot(self, index: float) -> Spot | None:
        """Smallest spot of the emitter's light in a material of ``index``; None if it is not behind the vertex.

        Rays go from the emitter at `SPOT_RAYS` angles, evenly over the acceptance. A ray is x = a + t z, so the
        variance of x is least at z = −cov(a, t) / var(t).
        """
        a, t = self._rays(index)
        spread = float(np.var(t)) if t.size > 1 else 0.0
        if spread == 0.0:
            return None
        z = -float(np.mean((a - a.mean()) * (t - t.mean()))) / spread
        x = a + t * z
        return Spot(float(x.mean()), z, float(x.std())) if z > 0.0 else None

    def best_focus_mm(self, index: float) -> float | None:
        """Position of the smallest spot of the accepted light in a material of ``index``."""
        spot = self.best_spot(index)
        return None if spot is None else spot.z_mm

    def _rays(self, index: float) -> tuple[FloatArray, FloatArray]:
        """Rays in the material, x = a + t z, of those that the face lets in; one behind another part is left out."""
        x = np.linspace(-self.half_width_mm, self.half_width_mm, 2 * SPOT_RAYS + 1)
        seen = np.maximum.accumulate(np.arctan2(x, self.z_mm(x) + self.distance_mm))
        angle = seen[0] + (seen[-1] - seen[0]) * (np.arange(SPOT_RAYS) + 0.5) / SPOT_RAYS
        x = np.interp(angle, seen, x)
        z, lean = self.z_mm(x), np.arctan(self.slope(x))
        sine = self.outside_index / index * np.sin(np.arctan2(x, z + self.distance_mm) + lean)
        bent = np.abs(sine) < 1.0
        t = np.tan(np.arcsin(sine[bent]) - lean[bent])
        return x[bent] - t * z[bent], t


class DeviatingLens(CurvedLens):
    """Another lens and a deviation along z; width, depth and where the stem begins are those of that lens."""

    @property
    @abstractmethod
    def plain(self) -> CurvedLens:
        """The lens without the deviation."""

    @abstractmethod
    def deviation_mm(self, x_mm: FloatArray) -> FloatArray:
        """Deviation (N,) along z at lateral positions within the half width, mm; below 0 is more material."""

    @abstractmethod
    def deviation_slope(self, x_mm: FloatArray) -> FloatArray:
        """Derivative of `deviation_mm` by x."""

    @reported
    def distance_mm(self) -> float:  # type: ignore[override]  # a field there
        """From the emitter to the vertex of the lens without the deviation."""
        return self.plain.distance_mm

    @reported
    def half_width_mm(self) -> float:  # type: ignore[override]  # a field there
        """Half the designed width."""
        return self.plain.half_width_mm

    @property
    def outside_index(self) -> float:  # type: ignore[override]  # a field there
        """Index of what lies before the lens."""
        return self.plain.outside_index

    @property
    def depth_mm(self) -> float:
        """From that vertex to the plane where the stem begins."""
        return self.plain.depth_mm

    @cached_property
    def front(self) -> Curve:
        """See :attr:`Lens.front`: a spline within `curve_within_mm` of the profile."""

        def place(x: FloatArray) -> FloatArray:
            return np.column_stack([x, self.z_mm(x)])

        def velocity(x: FloatArray) -> FloatArray:
            return np.column_stack([np.ones_like(x), self.slope(x)])

        return fitted(place, velocity, self.curve_within_mm, self.breaks_mm)

    @property
    def breaks_mm(self) -> tuple[float, ...]:
        """Lateral positions, ascending, at which pieces of the front's curve end in any case."""
        half_mm = self.half_width_mm
        return (-half_mm, -0.5 * half_mm, 0.0, 0.5 * half_mm, half_mm)

    @property
    def curve_within_mm(self) -> float:
        """Tolerance of the traced curve against the profile."""
        return CURVE_TOLERANCE_MM

    def z_mm(self, x_mm: ArrayLike) -> FloatArray:
        """See :meth:`CurvedLens.z_mm`."""
        x = np.asarray(x_mm, dtype=float)
        return np.asarray(self.plain.z_mm(x) + self.deviation_mm(x))

    def slope(self, x_mm: ArrayLike) -> FloatArray:
        """See :meth:`CurvedLens.slope`."""
        x = np.asarray(x_mm, dtype=float)
        return np.asarray(self.plain.slope(x) + self.deviation_slope(x))
