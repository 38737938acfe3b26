"""A measured lens: the designed lens plus the deviation of a measured profile.

The width, the depth and the start of the stem are those of the design, to which the profile is registered.
Uncertainties come from random outlines: the smoothed profile plus a random curve with the standard deviation of the
points, correlated over `FittedProfile.correlation_mm`.
"""

from collections.abc import Callable
from dataclasses import field, replace
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np

from solen.arrays import FloatArray
from solen.lens.base import DeviatingLens
from solen.lens.fitted_profile import FittedProfile
from solen.lens.spline import DesignedLens
from solen.results import HIDDEN, reported

OUTLINE_TOLERANCE = 0.05
"""Tolerance of the traced curve of a random outline, as a fraction of the outline's uncertainty. This error of the
curve rotates the normals by at most a tenth as much as the uncertainty does. The curve has half as many pieces as the
curve of the smoothed profile, so a ray's intersection is found much faster.
"""
FOCUS_OUTLINES = 24
"""Number of random outlines for the uncertainty of the focus, which they determine to about 15 %."""


class MeasuredLens(DeviatingLens, eq=True):
    """A lens with a profile that was measured, or predicted by a print model.

    ``outline`` is 0 for the smoothed profile itself, or the number of a random outline within its uncertainty; the same
    number always gives the same outline.
    """

    shape_name: ClassVar[str] = "measured"

    fit: FittedProfile
    outline: int = field(default=0, metadata=HIDDEN)

    @reported
    def designed(self) -> DesignedLens:
        """The designed lens."""
        return self.fit.designed

    @property
    def plain(self) -> DesignedLens:
        """The lens without the deviation."""
        return self.designed

    def deviation_mm(self, x_mm: FloatArray) -> FloatArray:
        """Return the deviation (N,) along z in mm at lateral positions; < 0 adds material."""
        error = self._error(x_mm, 0) if self.outline else 0.0
        return np.asarray(self.fit.deviation_mm(x_mm) + error)

    def deviation_slope(self, x_mm: FloatArray) -> FloatArray:
        """Return the derivative of `deviation_mm` with respect to x."""
        error = self._error(x_mm, 1) if self.outline else 0.0
        return np.asarray(self.fit.deviation_slope(x_mm) + error)

    @property
    def curve_within_mm(self) -> float:
        """Maximum deviation of the traced curve from the profile; `OUTLINE_TOLERANCE` of u for a random outline."""
        within_mm = 1e-3 * OUTLINE_TOLERANCE * self.fit.u_rms_um if self.outline else 0.0
        return max(within_mm, super().curve_within_mm)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings that concern the lens's response."""
        return self.fit.warnings

    def with_outline(self, number: int) -> "MeasuredLens":
        """Return the lens with the random outline of a number above 0, or with the smoothed profile for 0."""
        return replace(self, outline=number)

    def u_best_focus_mm(self, index: float) -> float | None:
        """Return the standard uncertainty of `best_focus_mm`, from `FOCUS_OUTLINES` random outlines."""
        return _u_best_focus_mm(self, index)

    @cached_property
    def _error(self) -> Callable[[FloatArray, int], FloatArray]:
        """Function for the random part of an outline along z in mm, or its derivative with respect to x.

        The random part is normally distributed and correlated along the lens.
        """
        from scipy.interpolate import CubicSpline

        table, (nodes, root) = self.fit.length_table, self.fit.errors
        spline = CubicSpline(nodes, root @ np.random.default_rng(self.outline).standard_normal(nodes.size))

        def error(x: FloatArray, order: int) -> FloatArray:
            per_x = table.length_per_x(x) if order else 1.0
            return np.asarray(spline(table.length_at(x), order) * per_x)

        return error


@lru_cache(maxsize=16)
def _u_best_focus_mm(lens: MeasuredLens, index: float) -> float | None:
    outlines = (lens.with_outline(number) for number in range(1, FOCUS_OUTLINES + 1))
    foci_mm = [focus_mm for outline in outlines if (focus_mm := outline.best_focus_mm(index)) is not None]
    return float(np.std(foci_mm, ddof=1)) if len(foci_mm) == FOCUS_OUTLINES else None
