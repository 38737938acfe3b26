"""The free-form lens: a Cartesian oval and a smooth deviation from it, specified at a few knots.

The deviation along z is a cubic spline in |x| with continuous curvature: even in x, with slope 0 on the axis, and with
zero value and curvature at the edge. Width, depth and the start of the stem are therefore those of the oval, and z is
still measured from the vertex of the oval. A face that light cannot use is rejected: one that reaches the emitter, or
that rays graze. Features that printers may not resolve, narrow bumps and small radii of curvature, cause a warning.

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
from solen.lens.base import DeviatingLens
from solen.lens.optics import OvalLens
from solen.results import HIDDEN, reported_once

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

PLACES = 401
"""Number of points across half the aperture at which incidence and curvature are computed."""
NEAREST = 0.9
"""Largest approach of the face to the emitter, as a fraction of the emitter's distance."""
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
        Deviation along z at N uniformly spaced |x|, the first on the axis; negative values add material. The deviation
        at the edge, which would be the next knot, is 0.
    min_feature_um
        Width of a bump or dimple, and radius of curvature, below which `warnings` report that it may not print.

    Raises
    ------
    DesignError
        If rays from the emitter graze the face, or the face reaches the emitter.
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
        self._check_place()
        self._check_incidence()

    @property
    def plain(self) -> OvalLens:
        """See :attr:`solen.lens.base.DeviatingLens.plain`."""
        return self.oval

    @cached_property
    def front(self) -> Curve:
        """See :attr:`solen.lens.base.Lens.front`: the oval itself if all knots are 0."""
        return super().front if any(self.knots_um) else self.oval.front

    @property
    def breaks_mm(self) -> tuple[float, ...]:
        """See :attr:`solen.lens.base.DeviatingLens.breaks_mm`: the knots; the curve is then as exact as the oval's."""
        at = self.knots_at_mm.tolist()
        return (*(-x for x in reversed(at[1:])), *at)

    @property
    def knots_at_mm(self) -> FloatArray:
        """Lateral positions (N + 1,) of the knots and of the edge."""
        return np.linspace(0.0, self.half_width_mm, len(self.knots_um) + 1)

    def deviation_mm(self, x_mm: FloatArray) -> FloatArray:
        """See :meth:`solen.lens.base.DeviatingLens.deviation_mm`."""
        return np.asarray(self._spline(np.abs(x_mm)))

    def deviation_slope(self, x_mm: FloatArray) -> FloatArray:
        """See :meth:`solen.lens.base.DeviatingLens.deviation_slope`."""
        return np.asarray(np.sign(x_mm) * self._spline(np.abs(x_mm), 1))

    def curvature_per_mm(self, x_mm: FloatArray) -> FloatArray:
        """Return the signed curvature (N,) of the profile: positive where the front is convex to the emitter."""
        oval_bend = self.oval.curvature_per_mm(x_mm) * np.hypot(1.0, self.oval.slope(x_mm)) ** 3
        bend = oval_bend + self._spline(np.abs(x_mm), 2)
        return np.asarray(bend / np.hypot(1.0, self.slope(x_mm)) ** 3)

    @reported_once
    def max_deviation_um(self) -> float:
        """Deviation from the oval along z with the largest magnitude, with its sign."""
        deviation = 1e3 * self.deviation_mm(self._places)
        return float(deviation[np.argmax(np.abs(deviation))])

    @reported_once
    def max_incidence_deg(self) -> float:
        """Largest angle of incidence of the emitter's rays on the face; at 90 they graze it."""
        return math.degrees(math.acos(float(self._cosines.min())))

    @reported_once
    def min_radius_um(self) -> float:
        """Smallest radius of curvature of the face, convex or concave."""
        return 1e3 / float(np.abs(self.curvature_per_mm(self._places)).max())

    @reported_once
    def narrowest_um(self) -> float | None:
        """Width of the narrowest of the `features`, or None if there are none."""
        return min((feature.width_um for feature in self.features), default=None)

    @cached_property
    def features(self) -> tuple[Feature, ...]:
        """Bumps and dimples of the deviation at x >= 0, from the axis outwards, higher than `MIN_HEIGHT_UM`."""
        at = self.knots_at_mm
        bend = self._spline(at, 2)
        at, bend = at[bend != 0.0], bend[bend != 0.0]
        turns = np.flatnonzero(bend[1:] * bend[:-1] < 0.0)
        inner = at[turns] - bend[turns] * (at[turns + 1] - at[turns]) / (bend[turns + 1] - bend[turns])
        ends = [-float(inner[0]) if inner.size else -self.half_width_mm, *inner.tolist(), self.half_width_mm]
        found = (self._feature(low, high) for low, high in pairwise(ends))
        return tuple(feature for feature in found if abs(feature.height_um) >= MIN_HEIGHT_UM)

    @property
    def warnings(self) -> tuple[str, ...]:
        """See :attr:`solen.lens.base.Lens.warnings`."""
        return self.too_fine(self.min_feature_um, "lens.min_feature_um")

    def missed_share(self, least_um: float) -> float:
        """Fraction by which the narrowest feature or smallest radius is below the minimum; 0 if neither is."""
        narrowest = min(self.min_radius_um, self.narrowest_um or math.inf)
        return max(0.0, 1.0 - narrowest / least_um)

    def too_fine(self, least_um: float, limit: str) -> tuple[str, ...]:
        """Return warnings about features narrower or more strongly curved than ``limit``, the name of a minimum."""
        warnings = []
        narrow = min(self.features, key=lambda feature: feature.width_um, default=None)
        if narrow is not None and narrow.width_um < least_um:
            kind = "bump" if narrow.height_um > 0.0 else "dimple"
            warnings.append(
                f"the lens has a {kind} of {abs(narrow.height_um):.2g} µm at x = {narrow.x_mm:.2g} mm that is "
                f"{narrow.width_um:.3g} µm wide, narrower than {limit}, {least_um:.3g} µm: prints round it off"
            )
        if self.min_radius_um < least_um:
            worst = float(self._places[np.argmax(np.abs(self.curvature_per_mm(self._places)))])
            warnings.append(
                f"the lens has a radius of curvature of {self.min_radius_um:.3g} µm at x = {worst:.2g} mm, below "
                f"{limit}, {least_um:.3g} µm: prints round it off"
            )
        return tuple(warnings)

    @cached_property
    def _spline(self) -> "CubicSpline":
        """Deviation in mm as a function of |x| in mm."""
        from scipy.interpolate import CubicSpline

        values_mm = 1e-3 * np.array([*self.knots_um, 0.0])
        return CubicSpline(self.knots_at_mm, values_mm, bc_type=("clamped", "natural"))

    @cached_property
    def _places(self) -> FloatArray:
        return np.linspace(0.0, self.half_width_mm, PLACES)

    @cached_property
    def _cosines(self) -> FloatArray:
        """Cosines of the angles of incidence at the sampled points."""
        x, slope = self._places, self.slope(self._places)
        ahead = self.z_mm(x) + self.distance_mm
        return np.asarray((ahead - x * slope) / (np.hypot(x, ahead) * np.hypot(1.0, slope)))

    def _feature(self, low_mm: float, high_mm: float) -> Feature:
        x = np.linspace(low_mm, high_mm, 33)
        beyond = np.interp(x, x[[0, -1]], self.deviation_mm(x[[0, -1]])) - self.deviation_mm(x)
        height_mm = float(beyond[np.argmax(np.abs(beyond))])
        return Feature(0.5 * (low_mm + high_mm), 1e3 * (high_mm - low_mm), 1e3 * height_mm)

    def _check_place(self) -> None:
        z = self.z_mm(self._places)
        nearest = int(np.argmin(z))
        if z[nearest] <= -NEAREST * self.distance_mm:
            raise DesignError(
                "lens.knots_um",
                value=f"the face reaches z = {z[nearest]:.4g} mm at x = {self._places[nearest]:.3g} mm",
                limit=f"must remain behind z = {-NEAREST * self.distance_mm:.4g} mm, because the emitter is at "
                f"{-self.distance_mm:g} mm",
                remedy="increase the knots there",
            )

    def _check_incidence(self) -> None:
        worst = int(np.argmin(self._cosines))
        if self._cosines[worst] <= 0.0:
            raise DesignError(
                "lens.knots_um",
                value=f"an angle of incidence of {self.max_incidence_deg:.3g} deg at x = {self._places[worst]:.3g} mm",
                limit="must be below 90 deg: rays from the emitter graze the face there, and it hides the face behind",
                remedy="reduce the increase of the knots towards the edge, or narrow lens.half_width_mm",
            )


DesignedLens = OvalLens | SplineLens
"""A lens that is printed with one profile, the same at every height or at mid-height."""
