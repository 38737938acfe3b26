"""The free-form lens: a Cartesian oval and a smooth deviation from it, specified at a few knots.

The deviation along z is a cubic spline in |x| with continuous curvature: even in x, with slope 0 on the axis, and with
zero value and curvature at the edge. Width, depth and the start of the stem are therefore those of the oval, and z is
still measured from the vertex of the oval. A face is rejected if it reaches the emitter, or if a ray from the emitter
is tangent to it. Features that printers may not resolve, narrow bumps and small radii of curvature, cause a warning.

Public names: `SplineLens` and `DesignedLens`.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Curve, check_numbers
from solen.errors import DesignError
from solen.lens.base import MAX_APPROACH, DeviatingLens
from solen.lens.optics import OvalLens
from solen.results import HIDDEN, reported_once

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

SAMPLES = 401
"""Number of points across half the aperture at which incidence and curvature are computed."""
MIN_HEIGHT_UM = 0.1
"""Height below which bumps and dimples are ignored."""
DEFAULT_MIN_FEATURE_UM = 130.0
"""Smallest width that prints well: an edge blur of 19 µm preserves 90 % of a wave with twice that period."""


@dataclass(frozen=True)
class Feature:
    """Bump (positive) or dimple of a deviation, between two points where the sign of its curvature changes."""

    x_mm: float
    width_um: float
    height_um: float


class SplineLens(DeviatingLens, eq=True):
    """A Cartesian oval with a deviation along z, specified at knots.

    Parameters
    ----------
    oval
        The lens without the deviation.
    knots_um
        Deviation along z at N uniformly spaced |x|, the first on the axis; negative values add material. At the edge,
        where the next knot would be, the deviation is 0.
    min_feature_um
        Width of a bump or dimple, and radius of curvature, below which `warnings` report that it may not print.

    Raises
    ------
    DesignError
        If a ray from the emitter is tangent to the face, or the face reaches the emitter.
    """

    shape_name: ClassVar[str] = "spline"

    oval: OvalLens
    knots_um: tuple[float, ...]
    min_feature_um: float = field(default=DEFAULT_MIN_FEATURE_UM, metadata=HIDDEN)

    def __post_init__(self) -> None:
        check_numbers("lens.knots_um", *self.knots_um)
        if not self.knots_um:
            raise DesignError(
                "lens.knots_um", value="[]", limit="requires at least one knot", remedy="add a knot on the axis"
            )
        self._check_position()
        self._check_incidence()

    @property
    def plain(self) -> OvalLens:
        """The lens without the deviation."""
        return self.oval

    @cached_property
    def front(self) -> Curve:
        """The face from its left edge to its right edge; if all knots are 0, it is the oval itself."""
        return super().front if any(self.knots_um) else self.oval.front

    @property
    def breaks_mm(self) -> tuple[float, ...]:
        """Lateral positions of the knots, at which the third derivative jumps and the pieces of the curve must end."""
        knots = self.knots_at_mm.tolist()
        return (*(-x for x in reversed(knots[1:])), *knots)

    @property
    def knots_at_mm(self) -> FloatArray:
        """Lateral positions (N + 1,) of the knots and of the edge."""
        return np.linspace(0.0, self.half_width_mm, len(self.knots_um) + 1)

    def deviation_mm(self, x_mm: FloatArray) -> FloatArray:
        """Return the deviation (N,) along z in mm at lateral positions; < 0 adds material."""
        return np.asarray(self._spline(np.abs(x_mm)))

    def deviation_slope(self, x_mm: FloatArray) -> FloatArray:
        """Return the derivative of `deviation_mm` with respect to x."""
        return np.asarray(np.sign(x_mm) * self._spline(np.abs(x_mm), 1))

    def curvature_per_mm(self, x_mm: FloatArray) -> FloatArray:
        """Return the signed curvature (N,) of the profile: positive where the front is convex to the emitter."""
        oval_bend = self.oval.curvature_per_mm(x_mm) * np.hypot(1.0, self.oval.slope(x_mm)) ** 3
        bend = oval_bend + self._spline(np.abs(x_mm), 2)
        return np.asarray(bend / np.hypot(1.0, self.slope(x_mm)) ** 3)

    @reported_once
    def max_deviation_um(self) -> float:
        """Deviation from the oval along z with the largest magnitude, with its sign."""
        deviation = 1e3 * self.deviation_mm(self._sample_x)
        return float(deviation[np.argmax(np.abs(deviation))])

    @reported_once
    def max_incidence_deg(self) -> float:
        """Largest angle of incidence of the emitter's rays on the face; at 90 a ray is tangent to it."""
        return math.degrees(math.acos(float(self._cosines.min())))

    @reported_once
    def min_radius_um(self) -> float:
        """Smallest radius of curvature of the face, convex or concave."""
        return 1e3 / float(np.abs(self.curvature_per_mm(self._sample_x)).max())

    @reported_once
    def narrowest_um(self) -> float | None:
        """Width of the narrowest of the `features`, or None if there are none."""
        return min((feature.width_um for feature in self.features), default=None)

    @cached_property
    def features(self) -> tuple[Feature, ...]:
        """Bumps and dimples of the deviation at x >= 0, from the axis outwards, higher than `MIN_HEIGHT_UM`."""
        x = self.knots_at_mm
        bend = self._spline(x, 2)
        x, bend = x[bend != 0.0], bend[bend != 0.0]
        i = np.flatnonzero(bend[1:] * bend[:-1] < 0.0)
        inflections = x[i] - bend[i] * (x[i + 1] - x[i]) / (bend[i + 1] - bend[i])
        first = -float(inflections[0]) if inflections.size else -self.half_width_mm
        features = (self._feature(*ends) for ends in pairwise([first, *inflections.tolist(), self.half_width_mm]))
        return tuple(feature for feature in features if abs(feature.height_um) >= MIN_HEIGHT_UM)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings that concern the lens's response."""
        return self.fine_feature_warnings(self.min_feature_um, "lens.min_feature_um")

    def fine_feature_excess(self, least_um: float) -> float:
        """Return the fraction by which the narrowest feature or smallest radius is below a minimum; 0 if neither is."""
        narrowest = min(self.min_radius_um, self.narrowest_um or math.inf)
        return max(0.0, 1.0 - narrowest / least_um)

    def fine_feature_warnings(self, least_um: float, limit: str) -> tuple[str, ...]:
        """Return warnings about widths and radii of curvature below ``least_um``, a minimum that is named ``limit``."""
        warnings = []
        narrow = min(self.features, key=lambda feature: feature.width_um, default=None)
        if narrow is not None and narrow.width_um < least_um:
            kind = "bump" if narrow.height_um > 0.0 else "dimple"
            warnings.append(
                f"the lens has a {kind} of {abs(narrow.height_um):.2g} µm at x = {narrow.x_mm:.2g} mm that is "
                f"{narrow.width_um:.3g} µm wide, narrower than {limit}, {least_um:.3g} µm: printing rounds it off"
            )
        if self.min_radius_um < least_um:
            x_mm = float(self._sample_x[np.argmax(np.abs(self.curvature_per_mm(self._sample_x)))])
            warnings.append(
                f"the lens has a radius of curvature of {self.min_radius_um:.3g} µm at x = {x_mm:.2g} mm, below "
                f"{limit}, {least_um:.3g} µm: printing rounds it off"
            )
        return tuple(warnings)

    @cached_property
    def _spline(self) -> "CubicSpline":
        """Deviation in mm as a function of |x| in mm."""
        from scipy.interpolate import CubicSpline

        values_mm = 1e-3 * np.array([*self.knots_um, 0.0])
        return CubicSpline(self.knots_at_mm, values_mm, bc_type=("clamped", "natural"))

    @cached_property
    def _sample_x(self) -> FloatArray:
        return np.linspace(0.0, self.half_width_mm, SAMPLES)

    @cached_property
    def _cosines(self) -> FloatArray:
        """Cosines of the angles of incidence at the sampled points."""
        x, slope = self._sample_x, self.slope(self._sample_x)
        from_emitter = self.z_mm(x) + self.distance_mm
        return np.asarray((from_emitter - x * slope) / (np.hypot(x, from_emitter) * np.hypot(1.0, slope)))

    def _feature(self, low_mm: float, high_mm: float) -> Feature:
        x = np.linspace(low_mm, high_mm, 33)
        above_chord = np.interp(x, x[[0, -1]], self.deviation_mm(x[[0, -1]])) - self.deviation_mm(x)
        height_mm = float(above_chord[np.argmax(np.abs(above_chord))])
        return Feature(0.5 * (low_mm + high_mm), 1e3 * (high_mm - low_mm), 1e3 * height_mm)

    def _check_position(self) -> None:
        z = self.z_mm(self._sample_x)
        nearest = int(np.argmin(z))
        if z[nearest] <= -MAX_APPROACH * self.distance_mm:
            limit = (
                f"the face is at z = {z[nearest]:.4g} mm at x = {self._sample_x[nearest]:.3g} mm, but must be behind "
                f"z = {-MAX_APPROACH * self.distance_mm:.4g} mm: the emitter is at z = {-self.distance_mm:g} mm"
            )
            remedy = "increase the knots near this position"
            raise DesignError("lens.knots_um", value=self.knots_um, limit=limit, remedy=remedy)

    def _check_incidence(self) -> None:
        steepest = int(np.argmin(self._cosines))
        if self._cosines[steepest] <= 0.0:
            limit = (
                f"the incidence is {self.max_incidence_deg:.3g} deg at x = {self._sample_x[steepest]:.3g} mm, "
                "but must be below 90 deg everywhere: part of the face is hidden from the emitter"
            )
            remedy = "let the knots increase less towards the edge, or reduce lens.half_width_mm"
            raise DesignError("lens.knots_um", value=self.knots_um, limit=limit, remedy=remedy)


DesignedLens = OvalLens | SplineLens
"""A designed lens with one profile: that at every height or, if the lens varies with height, that at mid-height."""
