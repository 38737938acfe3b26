"""The deviation of a measured profile from the designed lens, smoothed as its uncertainty requires.

The deviation from the design is smoothed, not the profile itself. The vertex of an oval is its most curved point, and
smoothing the profile would flatten it first; the deviation is small and varies slowly, and it is smoothed no more than
the uncertainty of the points requires (`solen.lens.smoothing`). A spline through the points from an image is
unsuitable: half a micrometre of noise at points 2 µm apart rotates the normals by about 10 degrees, while a tenth of a
degree already moves the focal spot by 10 µm.

If the profile ends before the lens does, as in a cropped image, the deviation of the last points continues to the edge;
if more than `MAX_MISSING` of a half width is missing, the profile is rejected. Points outside the lens belong to the
stem and are omitted.

Public name: `FittedProfile`.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DesignError
from solen.lens.base import MAX_APPROACH
from solen.lens.length_table import LengthTable
from solen.lens.profile import MIN_POINTS, MeasuredProfile, scatter_mm
from solen.lens.smoothing import SmoothCurve, smooth_curve
from solen.lens.spline import DesignedLens
from solen.results import HIDDEN, Result, reported, reported_once

MAX_MISSING, WARNED_MISSING = 0.25, 0.02
"""Missing fractions of a half width above which a profile is rejected, or causes a warning."""
MAX_DEVIATION = 0.5
"""Deviation from the design, as a fraction of the half width, above which a profile is assumed to belong to another
lens.
"""
MIN_U_MM = 1e-6
"""Standard uncertainty assumed for exact points: 1 nm."""
MAX_SCATTER = 1.3
"""Ratio of the scatter, or of the residuals, to the uncertainty above which a warning is given."""
MAX_CORRELATION = 0.25
"""Maximum correlation length of random errors, as a fraction of the half width."""
NODES_PER_LENGTH = 3.0
"""Number of random values per correlation length of a random outline."""
EASE_MM = 0.1
"""Length beyond the last point over which the slope of the deviation decreases to 0."""
SAMPLES = 801
"""Number of points, uniformly spaced along the measured part, at which deviations are computed."""


@dataclass(frozen=True)
class Deviation:
    """Deviation of a profile from the designed lens along its normal, in micrometres; positive is more material.

    ``rms_um`` and ``max_um`` describe the deviation without alignment; ``max_um`` is signed and occurs at ``max_x_mm``.
    After a best-fit alignment by a shift ``shift_um`` (x, z) and a rotation ``turn_mrad``, counter-clockwise about the
    vertex, the RMS residual is ``rest_um``.
    """

    rms_um: float
    max_um: float
    max_x_mm: float
    shift_um: tuple[float, float]
    turn_mrad: float
    rest_um: float


class FittedProfile(Result, eq=True):
    """A measured profile compared with the designed lens.

    Raises
    ------
    DesignError
        If too much of the lens is missing from the profile, or the profile belongs to another lens.
    """

    designed: DesignedLens = field(metadata=HIDDEN)
    profile: MeasuredProfile = field(metadata=HIDDEN)

    def __post_init__(self) -> None:
        self._check_coverage()
        self._check_position()

    def deviation_mm(self, x_mm: FloatArray) -> FloatArray:
        """Return the smoothed deviation (N,) along z in mm at lateral positions within the half width.

        Negative values mean more material.
        """
        inside, beyond = self._measured_length(x_mm)
        spline = self.smooth.spline
        eased = EASE_MM * (1.0 - np.exp(-np.abs(beyond) / EASE_MM))
        return np.asarray(spline(inside) + spline(inside, 1) * np.sign(beyond) * eased)

    def deviation_slope(self, x_mm: FloatArray) -> FloatArray:
        """Return the derivative of `deviation_mm` with respect to x."""
        inside, beyond = self._measured_length(x_mm)
        per_length = self.smooth.spline(inside, 1) * np.exp(-np.abs(beyond) / EASE_MM)
        return np.asarray(per_length * self.length_table.length_per_x(x_mm))

    def u_mm(self, x_mm: FloatArray) -> FloatArray:
        """Return the standard uncertainty (N,) of the profile along its normal, in mm.

        Beyond the ends of the profile it increases by the RMS deviation, added in quadrature.
        """
        x = self.profile.x_mm
        beyond = np.maximum(np.maximum(x[0] - x_mm, x_mm - x[-1]), 0.0)
        extra = np.minimum(beyond / EASE_MM, 1.0) * 1e-3 * self.deviation.rms_um
        return np.asarray(np.hypot(np.interp(x_mm, x, self._point_u_mm), extra))

    @reported_once
    def smooth(self) -> SmoothCurve:
        """The smoothed deviation along z, as a function of the length along the designed lens from its left edge."""
        x, deviation = self.points
        u = np.interp(x, self.profile.x_mm, self._point_u_mm) * np.hypot(1.0, self.designed.slope(x))
        return smooth_curve(self.length_table.length_at(x), deviation, u)

    @cached_property
    def points(self) -> tuple[FloatArray, FloatArray]:
        """Lateral positions of the points on the lens, and their deviations along z, mm."""
        x, z = self.profile.x_mm, self.profile.z_mm
        on_lens = np.abs(x) <= self.designed.half_width_mm
        return x[on_lens], z[on_lens] - self.designed.z_mm(x[on_lens])

    @cached_property
    def length_table(self) -> LengthTable:
        """Arc lengths along the designed lens."""
        return LengthTable.of(self.designed)

    @reported_once
    def deviation(self) -> Deviation:
        """Deviation of the measured part from the design."""
        x = self.length_table.x_at(np.linspace(*self._ends, SAMPLES))
        slope, z = self.designed.slope(x), self.designed.z_mm(x)
        length_per_x = np.hypot(1.0, slope)
        added_um = -1e3 * self.deviation_mm(x) / length_per_x
        normal = np.column_stack([slope, -np.ones_like(x)]) / length_per_x[:, None]  # out of the material
        rotation = normal[:, 1] * x - normal[:, 0] * z
        columns = np.column_stack([normal, rotation])
        motion, *_ = np.linalg.lstsq(columns, added_um, rcond=None)
        largest = int(np.argmax(np.abs(added_um)))
        return Deviation(
            rms_um=_rms(added_um),
            max_um=float(added_um[largest]),
            max_x_mm=float(x[largest]),
            shift_um=(float(motion[0]), float(motion[1])),
            turn_mrad=float(motion[2]),
            rest_um=_rms(added_um - columns @ motion),
        )

    @reported
    def correlation_mm(self) -> float:
        """Correlation length of the errors of a random outline: the standard deviation of a Gaussian.

        It is the resolution of the smoothed profile: smoothing removes errors of shorter length, and errors of longer
        length rotate the normals less.
        """
        return min(self.smooth.resolution_mm, MAX_CORRELATION * self.designed.half_width_mm)

    @cached_property
    def errors(self) -> tuple[FloatArray, FloatArray]:
        """Arc lengths (N,), and the matrix (N, N) that converts standard normal numbers to errors along z there in mm.

        The errors have the standard deviation `u_mm` and a Gaussian correlation.
        """
        length_mm, total_mm = self.correlation_mm, self.length_table.total_mm
        nodes = np.linspace(0.0, total_mm, max(8, math.ceil(NODES_PER_LENGTH * total_mm / length_mm) + 1))
        x = self.length_table.x_at(nodes)
        u_z = self.u_mm(x) * np.hypot(1.0, self.designed.slope(x))
        value, vectors = np.linalg.eigh(np.exp(-0.5 * (np.subtract.outer(nodes, nodes) / length_mm) ** 2))
        return nodes, u_z[:, None] * vectors * np.sqrt(np.maximum(value, 0.0))

    @reported
    def u_rms_um(self) -> float:
        """RMS uncertainty of the profile over the lens, µm."""
        half_mm = self.designed.half_width_mm
        return 1e3 * _rms(self.u_mm(np.linspace(-half_mm, half_mm, SAMPLES)))

    @reported
    def u_slope_mrad(self) -> float:
        """Standard uncertainty of the normals' directions: the point uncertainty divided by the correlation length."""
        return self.u_rms_um / self.correlation_mm

    @reported
    def profile_name(self) -> str:
        """Name of the profile."""
        return self.profile.name

    @reported
    def edge(self) -> str:
        """Edge of the part on which the points were measured."""
        return self.profile.edge

    @reported
    def simulated(self) -> bool:
        """Whether the profile was computed rather than measured."""
        return self.profile.simulated

    @reported
    def sources(self) -> tuple[object, ...]:
        """Source files of the profile."""
        return tuple(self.profile.sources)

    @reported
    def points_on_lens(self) -> int:
        """Number of points of the profile that are on the lens."""
        return int(self.points[0].size)

    @reported
    def reach_mm(self) -> tuple[float, float]:
        """Lateral positions of the first and the last point on the lens."""
        x = self.points[0]
        return float(x[0]), float(x[-1])

    @property
    def missing_fraction(self) -> float:
        """Missing fraction of a half width, on the side where more is missing."""
        half_mm, (low, high) = self.designed.half_width_mm, self.reach_mm
        return max(low + half_mm, half_mm - high) / half_mm

    @property
    def unmeasured_acceptance(self) -> float:
        """Fraction of the accepted angles whose rays are not incident on the measured part."""
        x = np.array(self.reach_mm)
        low, high = np.degrees(np.arctan2(x, self.designed.z_mm(x) + self.designed.distance_mm))
        return float(1.0 - (high - low) / (2.0 * self.designed.acceptance_deg))

    @reported_once
    def scatter_um(self) -> float:
        """Standard deviation of the points along the normal, µm."""
        x, deviation = self.points
        return 1e3 * scatter_mm(x, deviation, self.designed.slope(x))

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the profile that concern its response."""
        return (*self.profile.warnings, *filter(None, (self._missing_warning(), self._scatter_warning())))

    def _missing_warning(self) -> str:
        if self.missing_fraction <= WARNED_MISSING:
            return ""
        low, high = self.reach_mm
        return (
            f"the profile covers x from {low:.3f} to {high:.3f} mm of a lens of ±{self.designed.half_width_mm:g} "
            "mm; outside this range, the designed lens with the deviation of the last points is assumed, "
            f"on which rays at {self.unmeasured_acceptance:.0%} of the accepted angles are incident"
        )

    def _scatter_warning(self) -> str:
        profile_u_um = 1e3 * float(np.median(self.profile.u_mm))
        if self.scatter_um > MAX_SCATTER * max(profile_u_um, 1e3 * MIN_U_MM):
            return (
                f"neighbouring points scatter by {self.scatter_um:.2g} µm, more than their specified "
                f"uncertainty of {profile_u_um:.2g} µm; the scatter is used as their uncertainty"
            )
        if self.smooth.residual > MAX_SCATTER:
            return (
                f"the residuals of the smoothed profile are {self.smooth.residual:.2g} times the uncertainty: details "
                f"finer than {self.smooth.resolution_mm:.2g} mm are smoothed away"
            )
        return ""

    @cached_property
    def _point_u_mm(self) -> FloatArray:
        """Uncertainty of each profile point, scaled up if the points scatter more."""
        u_mm = np.maximum(self.profile.u_mm, MIN_U_MM)
        return np.asarray(u_mm * max(1.0, 1e-3 * self.scatter_um / float(np.median(u_mm))))

    @cached_property
    def _ends(self) -> tuple[float, float]:
        """Arc lengths at the first and the last point on the lens."""
        first, last = self.length_table.length_at(np.array(self.reach_mm))
        return float(first), float(last)

    def _measured_length(self, x_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return arc lengths (N,) at lateral positions, limited to the measured part, and the excess beyond it."""
        length = self.length_table.length_at(x_mm)
        inside = np.clip(length, *self._ends)
        return inside, length - inside

    def _check_coverage(self) -> None:
        half_mm = self.designed.half_width_mm
        x, low, high = self.points[0], *self.profile.width_mm
        if x.size < MIN_POINTS or max(low + half_mm, half_mm - high) > MAX_MISSING * half_mm:
            needed_mm = (1.0 - MAX_MISSING) * half_mm
            raise DesignError(
                "lens.profile",
                limit=f"has {x.size} points on the lens, from {low:.4g} to {high:.4g} mm, but must have at least "
                f"{MIN_POINTS}, which cover {-needed_mm:.4g} to {needed_mm:.4g} mm",
                remedy="measure the entire lens, or reduce lens.half_width_mm",
            )

    def _check_position(self) -> None:
        x, deviation = self.points
        remedy = "register the profile to the design, with the vertex at the origin and z into the body"
        largest, limit_mm = int(np.argmax(np.abs(deviation))), MAX_DEVIATION * self.designed.half_width_mm
        if abs(deviation[largest]) > limit_mm:
            limit = (
                f"deviates from the designed lens by {deviation[largest]:+.4g} mm at x = {x[largest]:.4g} mm, "
                f"but must be within {limit_mm:g} mm"
            )
            raise DesignError("lens.profile", limit=limit, remedy=remedy)
        nearest_mm, emitter_mm = float((deviation + self.designed.z_mm(x)).min()), -self.designed.distance_mm
        if nearest_mm <= MAX_APPROACH * emitter_mm:
            limit = (
                f"extends to z = {nearest_mm:.4g} mm, but must be behind z = {MAX_APPROACH * emitter_mm:.4g} mm, "
                f"because the emitter is at z = {emitter_mm:g} mm"
            )
            raise DesignError("lens.profile", limit=limit, remedy=remedy)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
