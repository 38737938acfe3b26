"""The front of a sensor as an optical element.

A :class:`Lens` is described in its own frame, with the vertex at the origin and the axis along +z. It is drawn from its
left edge to its right edge, so the material is on its left; the emitter is ``distance_mm`` in front of the vertex. A
:class:`CurvedLens` has a profile z(x), from which its smallest spot is computed; a :class:`DeviatingLens` is another
lens plus a designed or measured deviation along z.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.curve import Curve, fitted_spline
from solen.plane import Point, dot, unit
from solen.results import Result, reported

SPOT_RAYS = 1024
"""Number of rays used to find the smallest spot; with twice as many rays, the spot of an oval changes by less than 2e-5
of its value.
"""
CURVE_TOLERANCE_MM = 1e-6
"""Maximum deviation of the traced curve from a deviating profile: 1 nm."""
MAX_APPROACH = 0.9
"""Largest distance by which a face may extend from the vertex towards the emitter, as a fraction of the emitter's
distance.
"""


class LensSizes:
    """Lengths common to all lenses, specified or computed."""

    distance_mm: float
    half_width_mm: float


class Lens(LensSizes, Result, ABC):
    """The face through which light enters."""

    @property
    @abstractmethod
    def front(self) -> Curve:
        """The face from its left edge to its right edge, with the vertex at the origin and the material on its left."""

    shape_name: ClassVar[str] = ""

    @reported
    def shape(self) -> str:
        """Kind of lens, with the name used in ``lens.shape``."""
        return self.shape_name

    @reported
    @abstractmethod
    def depth_mm(self) -> float:
        """Distance from the vertex to the plane of the edges, where the stem begins."""

    def table(self, tolerance_mm: float = 1e-4) -> str:
        """Return a CSV table of x and z of points whose polyline deviates from the face by at most ``tolerance_mm``."""
        rows = (f"{round(float(x), 14)},{round(float(z), 14)}" for x, z in self.front.flattened(tolerance_mm))
        return "\n".join(["x_mm,z_mm", *rows, ""])

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings that concern the lens's response."""
        return ()

    @reported
    def acceptance_deg(self) -> float:
        """Largest angle from the axis at which the emitter's light is incident on the face."""
        return math.degrees(math.atan2(self.half_width_mm, self.distance_mm + self.depth_mm))


class CurvedSizes(LensSizes):
    """Additional sizes of a curved lens."""

    outside_index: float


@dataclass(frozen=True)
class Spot:
    """Smallest spot of the light accepted by a lens: its position and its RMS half width, in mm."""

    x_mm: float
    z_mm: float
    rms_mm: float


class CurvedLens(CurvedSizes, Lens):
    """A lens with a profile z(x); for a lens that varies with height, this is the profile at mid-height."""

    @abstractmethod
    def z_mm(self, x_mm: ArrayLike) -> FloatArray:
        """Return the profile z(x) at any array of lateral positions within the half width."""

    @abstractmethod
    def slope(self, x_mm: ArrayLike) -> FloatArray:
        """Return dz/dx of the profile, dimensionless."""

    @reported
    def edge_incidence_deg(self) -> float:
        """Angle of incidence on the lens's right edge for the ray from the emitter."""
        edge: Point = (self.half_width_mm, self.depth_mm)
        ray, slope = unit((edge[0], edge[1] + self.distance_mm)), float(self.slope(edge[0]))
        return math.degrees(math.acos(dot(ray, unit((-slope, 1.0)))))

    def best_spot(self, index: float) -> Spot | None:
        """Return the smallest spot of the emitter's light in a material; None if the spot is not behind the vertex.

        Rays start from the emitter at `SPOT_RAYS` angles, uniformly spaced over the acceptance. A ray is x = a + t z,
        so the variance of x is smallest at z = −cov(a, t) / var(t).
        """
        a, t = self._rays(index)
        spread = float(np.var(t)) if t.size > 1 else 0.0
        if spread == 0.0:
            return None
        z = -float(np.mean((a - a.mean()) * (t - t.mean()))) / spread
        x = a + t * z
        return Spot(float(x.mean()), z, float(x.std())) if z > 0.0 else None

    def best_focus_mm(self, index: float) -> float | None:
        """Return the position of the smallest spot of the accepted light in a material of ``index``."""
        spot = self.best_spot(index)
        return None if spot is None else spot.z_mm

    def _rays(self, index: float) -> tuple[FloatArray, FloatArray]:
        """Return the refracted rays in the material, x = a + t z, except those blocked by another part of the face."""
        x = np.linspace(-self.half_width_mm, self.half_width_mm, 2 * SPOT_RAYS + 1)
        visible = np.maximum.accumulate(np.arctan2(x, self.z_mm(x) + self.distance_mm))
        angle = visible[0] + (visible[-1] - visible[0]) * (np.arange(SPOT_RAYS) + 0.5) / SPOT_RAYS
        x = np.interp(angle, visible, x)
        z, tilt = self.z_mm(x), np.arctan(self.slope(x))
        sine = self.outside_index / index * np.sin(np.arctan2(x, z + self.distance_mm) + tilt)
        refracted = np.abs(sine) < 1.0
        t = np.tan(np.arcsin(sine[refracted]) - tilt[refracted])
        return x[refracted] - t * z[refracted], t


class DeviatingLens(CurvedLens):
    """Another lens with a deviation along z; width, depth and the start of the stem are those of that lens."""

    @property
    @abstractmethod
    def plain(self) -> CurvedLens:
        """The lens without the deviation."""

    @abstractmethod
    def deviation_mm(self, x_mm: FloatArray) -> FloatArray:
        """Return the deviation (N,) along z in mm at lateral positions within the half width; < 0 adds material."""

    @abstractmethod
    def deviation_slope(self, x_mm: FloatArray) -> FloatArray:
        """Return the derivative of `deviation_mm` with respect to x."""

    @reported
    def distance_mm(self) -> float:  # type: ignore[override]  # a field there
        """Distance from the emitter to the vertex of the lens without the deviation."""
        return self.plain.distance_mm

    @reported
    def half_width_mm(self) -> float:  # type: ignore[override]  # a field there
        """Half the designed width."""
        return self.plain.half_width_mm

    @property
    def outside_index(self) -> float:  # type: ignore[override]  # a field there
        """Refractive index in front of the lens."""
        return self.plain.outside_index

    @property
    def depth_mm(self) -> float:
        """Distance from the vertex to the plane where the stem begins."""
        return self.plain.depth_mm

    @cached_property
    def front(self) -> Curve:
        """The face from its left edge to its right edge, as a spline within `curve_within_mm` of the profile."""

        def position(x: FloatArray) -> FloatArray:
            return np.column_stack([x, self.z_mm(x)])

        def velocity(x: FloatArray) -> FloatArray:
            return np.column_stack([np.ones_like(x), self.slope(x)])

        return fitted_spline(position, velocity, self.curve_within_mm, self.breaks_mm)

    @property
    def breaks_mm(self) -> tuple[float, ...]:
        """Lateral positions at which the pieces of the front's curve must end, in ascending order."""
        half_mm = self.half_width_mm
        return (-half_mm, -0.5 * half_mm, 0.0, 0.5 * half_mm, half_mm)

    @property
    def curve_within_mm(self) -> float:
        """Maximum deviation of the traced curve from the profile."""
        return CURVE_TOLERANCE_MM

    def z_mm(self, x_mm: ArrayLike) -> FloatArray:
        """Return the profile z(x) at any array of lateral positions within the half width."""
        x = np.asarray(x_mm, dtype=float)
        return np.asarray(self.plain.z_mm(x) + self.deviation_mm(x))

    def slope(self, x_mm: ArrayLike) -> FloatArray:
        """Return dz/dx of the profile, dimensionless."""
        x = np.asarray(x_mm, dtype=float)
        return np.asarray(self.plain.slope(x) + self.deviation_slope(x))
