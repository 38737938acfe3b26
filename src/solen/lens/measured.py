"""A measured lens: the designed oval plus the deviation of a measured profile.

Its width, depth and the start of the stem are those of the design, to which the profile is registered.
Uncertainties come from drawn outlines: the smoothed one plus a random curve of the size of the points' uncertainty,
correlated over `FittedProfile.correlation_mm`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.curve import Spline, fitted
from solen.lens.fitted_profile import FittedProfile
from solen.lens.optics import Lens, OvalLens
from solen.results import HIDDEN, reported

CURVE_TOLERANCE_MM = 1e-6
"""Tolerance of the traced curve against the smoothed profile: 1 nm."""
DRAWN_CURVE_SHARE = 0.05
"""The same for an outline drawn within the uncertainty, as a share of that: it turns the normals by a tenth of what the
uncertainty does at most, and half of the pieces are searched much faster."""
SPOT_RAYS = 512
"""Rays used to find the smallest spot."""
DRAWN_SPOTS = 24
"""Outlines drawn for the uncertainty of the focus, which they determine to a seventh."""


@dataclass(frozen=True)
class Spot:
    """Smallest spot of the light accepted by a lens: its position, and its rms width, in mm."""

    x_mm: float
    z_mm: float
    rms_mm: float


class MeasuredLens(Lens, eq=True):
    """A lens with a profile that was measured, or predicted by a print model.

    ``drawn`` is 0 for the smoothed profile itself, else the number of an outline drawn within its uncertainty; a number
    always gives the same outline.
    """

    shape_name: ClassVar[str] = "measured"

    fit: FittedProfile
    drawn: int = field(default=0, metadata=HIDDEN)

    @reported
    def designed(self) -> OvalLens:
        """The designed oval."""
        return self.fit.designed

    @reported
    def distance_mm(self) -> float:  # type: ignore[override]  # a field there
        """From the emitter to the designed vertex."""
        return self.designed.distance_mm

    @reported
    def half_width_mm(self) -> float:  # type: ignore[override]  # a field there
        """Half the designed width."""
        return self.designed.half_width_mm

    @property
    def depth_mm(self) -> float:
        """From the designed vertex to the plane where the stem begins."""
        return self.designed.depth_mm

    @cached_property
    def front(self) -> Spline:
        """See :attr:`solen.lens.optics.Lens.front`: a spline within `CURVE_TOLERANCE_MM` of the smoothed profile.

        That of a drawn outline is within `DRAWN_CURVE_SHARE` of the profile's uncertainty.
        """

        def place(x: FloatArray) -> FloatArray:
            return np.column_stack([x, self.z_mm(x)])

        def velocity(x: FloatArray) -> FloatArray:
            return np.column_stack([np.ones_like(x), self.slope(x)])

        half_mm = self.half_width_mm
        return fitted(place, velocity, self._curve_mm, (-half_mm, -0.5 * half_mm, 0.0, 0.5 * half_mm, half_mm))

    def z_mm(self, x_mm: ArrayLike) -> FloatArray:
        """Profile z(x) at lateral positions (N,) within the half width."""
        x = np.asarray(x_mm, dtype=float)
        error = self._error(x, 0) if self.drawn else 0.0
        return np.asarray(self.designed.z_mm(x) + self.fit.deviation_mm(x) + error)

    def slope(self, x_mm: ArrayLike) -> FloatArray:
        """dz/dx of the profile, dimensionless."""
        x = np.asarray(x_mm, dtype=float)
        error = self._error(x, 1) if self.drawn else 0.0
        return np.asarray(self.designed.slope(x) + self.fit.deviation_slope(x) + error)

    @property
    def _curve_mm(self) -> float:
        """How far the curve may be from the profile."""
        within_mm = 1e-3 * DRAWN_CURVE_SHARE * self.fit.u_rms_um if self.drawn else 0.0
        return max(within_mm, CURVE_TOLERANCE_MM)

    @property
    def warnings(self) -> tuple[str, ...]:
        """See :attr:`solen.lens.optics.Lens.warnings`."""
        return self.fit.warnings

    def drawn_within(self, number: int) -> "MeasuredLens":
        """Outline of a number above 0, drawn within the uncertainty of the points; 0 is the smoothed profile."""
        return replace(self, drawn=number)

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

    def u_best_focus_mm(self, index: float) -> float | None:
        """Standard uncertainty of `best_focus_mm`: the scatter of `DRAWN_SPOTS` drawn outlines."""
        return _u_best_focus_mm(self, index)

    def _rays(self, index: float) -> tuple[FloatArray, FloatArray]:
        """Rays in the material, x = a + t z, of those that the face lets in; one behind another part is left out."""
        x = np.linspace(-self.half_width_mm, self.half_width_mm, 4 * SPOT_RAYS + 1)
        seen = np.maximum.accumulate(np.arctan2(x, self.z_mm(x) + self.distance_mm))
        angle = seen[0] + (seen[-1] - seen[0]) * (np.arange(SPOT_RAYS) + 0.5) / SPOT_RAYS
        x = np.interp(angle, seen, x)
        z, lean = self.z_mm(x), np.arctan(self.slope(x))
        sine = self.designed.outside_index / index * np.sin(np.arctan2(x, z + self.distance_mm) + lean)
        bent = np.abs(sine) < 1.0
        t = np.tan(np.arcsin(sine[bent]) - lean[bent])
        return x[bent] - t * z[bent], t

    @cached_property
    def _error(self) -> Callable[[FloatArray, int], FloatArray]:
        """Random curve along z of a drawn outline, or its derivative by x: normal, correlated along the oval."""
        from scipy.interpolate import CubicSpline

        track, (nodes, root) = self.fit.track, self.fit.errors
        spline = CubicSpline(nodes, root @ np.random.default_rng(self.drawn).standard_normal(nodes.size))

        def error(x: FloatArray, order: int) -> FloatArray:
            per_x = track.length_per_x(x) if order else 1.0
            return np.asarray(spline(track.length_at(x), order) * per_x)

        return error


@lru_cache(maxsize=16)
def _u_best_focus_mm(lens: MeasuredLens, index: float) -> float | None:
    drawn = [lens.drawn_within(number).best_focus_mm(index) for number in range(1, DRAWN_SPOTS + 1)]
    foci_mm = [focus_mm for focus_mm in drawn if focus_mm is not None]
    return float(np.std(foci_mm, ddof=1)) if len(foci_mm) == DRAWN_SPOTS else None
