"""The deviation of a measured profile from the designed lens, smoothed as its uncertainty requires.

The deviation from the design is smoothed, not the profile itself. The vertex of an oval is its most curved point, and
smoothing the profile itself would flatten the vertex first; the deviation from the design is small and varies slowly,
and it is smoothed no more than the uncertainty of the points requires (`solen.lens.smoothing`). A spline through the
points from an image is unsuitable: half a micrometre of noise at points 2 µm apart rotates the normals by about 10
degrees, while a tenth of a degree already moves the focal spot by 10 µm.

If the profile ends before the lens does, as in a cropped image, the design continues with the deviation of the last
points; if more than `MAX_MISSING` of a half width is missing, the profile is rejected. Points beyond the lens belong
to the stem and are omitted.

Public name: `FittedProfile`.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DesignError
from solen.lens.profile import MIN_POINTS, MeasuredProfile, scatter_mm
from solen.lens.smoothing import Smooth, smoothed
from solen.lens.spline import DesignedLens
from solen.lens.track import Track
from solen.results import HIDDEN, Result, reported, reported_once

MAX_MISSING, WARNED_MISSING = 0.25, 0.02
"""Missing fractions of a half width above which a profile is rejected, or causes a warning."""
FARTHEST = 0.5
"""Deviation from the design, as a fraction of the half width, above which a profile is assumed to belong to another
lens.
"""
NEAREST = 0.9
"""Largest approach of a profile to the emitter, as a fraction of the emitter's distance."""
MIN_U_MM = 1e-6
"""Standard uncertainty assumed for exact points: 1 nm."""
ROUGH = 1.3
"""Ratio of scatter to specified uncertainty above which a warning is given."""
MAX_CORRELATION = 0.25
"""Maximum correlation length of random errors, as a fraction of the half width."""
NODES_PER_LENGTH = 3.0
"""Number of random values per correlation length of a random outline."""
EASE_MM = 0.1
"""Length beyond the last point over which the slope of the deviation decreases to 0."""
PLACES = 801
"""Number of points, uniformly spaced along the measured part, at which deviations are computed."""


@dataclass(frozen=True)
class Deviation:
    """Deviation of a profile from the designed lens along its normal, in micrometres; positive is more material.

    ``rms_um`` and ``max_um`` describe the unaligned deviation; ``max_um`` is signed and occurs at ``max_x_mm``. After
    best-fit alignment by a shift ``shift_um`` (x, z) and a rotation ``turn_mrad``, counter-clockwise about the vertex,
    a residual of ``rest_um`` (rms) remains.
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
        self._check_reach()
        self._check_place()

    def deviation_mm(self, x_mm: FloatArray) -> FloatArray:
        """Return the smoothed deviation (N,) along z at lateral positions within the half width, mm.

        Negative values are more material.
        """
        inside, beyond = self._place(x_mm)
        spline = self.smooth.spline
        eased = EASE_MM * (1.0 - np.exp(-np.abs(beyond) / EASE_MM))
        return np.asarray(spline(inside) + spline(inside, 1) * np.sign(beyond) * eased)

    def deviation_slope(self, x_mm: FloatArray) -> FloatArray:
        """Return the derivative of `deviation_mm` with respect to x."""
        inside, beyond = self._place(x_mm)
        per_length = self.smooth.spline(inside, 1) * np.exp(-np.abs(beyond) / EASE_MM)
        return np.asarray(per_length * self.track.length_per_x(x_mm))

    def u_mm(self, x_mm: FloatArray) -> FloatArray:
        """Return the standard uncertainty (N,) of the profile along its normal, mm.

        Beyond the ends of the profile it grows to the size of the deviation.
        """
        x = self.profile.x_mm
        beyond = np.maximum(np.maximum(x[0] - x_mm, x_mm - x[-1]), 0.0)
        grown = np.minimum(beyond / EASE_MM, 1.0) * 1e-3 * self.deviation.rms_um
        return np.asarray(np.hypot(np.interp(x_mm, x, self._point_u_mm), grown))

    @reported_once
    def smooth(self) -> Smooth:
        """The smoothed deviation along z, as a function of the length along the designed lens from its left edge."""
        x, deviation = self.points
        u = np.interp(x, self.profile.x_mm, self._point_u_mm) * np.hypot(1.0, self.designed.slope(x))
        return smoothed(self.track.length_at(x), deviation, u)

    @cached_property
    def points(self) -> tuple[FloatArray, FloatArray]:
        """Lateral positions of the points on the lens, and their deviations along z, mm."""
        x, z = self.profile.x_mm, self.profile.z_mm
        on = np.abs(x) <= self.designed.half_width_mm
        return x[on], z[on] - self.designed.z_mm(x[on])

    @cached_property
    def track(self) -> Track:
        """Lengths along the designed lens."""
        return Track.along(self.designed)

    @reported_once
    def deviation(self) -> Deviation:
        """Deviation of the measured part from the design."""
        x = self.track.x_at(np.linspace(*self._ends, PLACES))
        slope, z = self.designed.slope(x), self.designed.z_mm(x)
        steep = np.hypot(1.0, slope)
        more = -1e3 * self.deviation_mm(x) / steep
        outwards = np.column_stack([slope, -np.ones_like(x)]) / steep[:, None]
        turning = outwards[:, 1] * x - outwards[:, 0] * z
        columns = np.column_stack([outwards, turning])
        rigid, *_ = np.linalg.lstsq(columns, more, rcond=None)
        worst = int(np.argmax(np.abs(more)))
        return Deviation(
            rms_um=_rms(more),
            max_um=float(more[worst]),
            max_x_mm=float(x[worst]),
            shift_um=(float(rigid[0]), float(rigid[1])),
            turn_mrad=float(rigid[2]),
            rest_um=_rms(more - columns @ rigid),
        )

    @reported
    def correlation_mm(self) -> float:
        """Correlation length of the errors of a random outline: the standard deviation of a Gaussian.

        It is the resolution of the smoothed profile: errors over shorter lengths are removed by smoothing, and errors
        over longer lengths rotate the normals less.
        """
        return min(self.smooth.resolution_mm, MAX_CORRELATION * self.designed.half_width_mm)

    @cached_property
    def errors(self) -> tuple[FloatArray, FloatArray]:
        """Return lengths (N,), and the matrix (N, N) that converts standard normal numbers to errors along z there, mm.

        The errors have the standard deviation `u_mm` and a Gaussian correlation.
        """
        length_mm, total_mm = self.correlation_mm, self.track.total_mm
        nodes = np.linspace(0.0, total_mm, max(8, math.ceil(NODES_PER_LENGTH * total_mm / length_mm) + 1))
        x = self.track.x_at(nodes)
        u_z = self.u_mm(x) * np.hypot(1.0, self.designed.slope(x))
        value, vectors = np.linalg.eigh(np.exp(-0.5 * (np.subtract.outer(nodes, nodes) / length_mm) ** 2))
        return nodes, u_z[:, None] * vectors * np.sqrt(np.maximum(value, 0.0))

    @reported
    def u_rms_um(self) -> float:
        """Root mean square of the profile's uncertainty over the lens, µm."""
        half_mm = self.designed.half_width_mm
        return 1e3 * _rms(self.u_mm(np.linspace(-half_mm, half_mm, PLACES)))

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
        """Lateral positions between which the lens is measured."""
        x = self.points[0]
        return float(x[0]), float(x[-1])

    @property
    def missing(self) -> float:
        """Missing fraction of a half width, on the side where more is missing."""
        half_mm, (low, high) = self.designed.half_width_mm, self.reach_mm
        return max(low + half_mm, half_mm - high) / half_mm

    @property
    def unseen(self) -> float:
        """Fraction of the accepted angles whose rays are not incident on a measured part."""
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
        if self.missing <= WARNED_MISSING:
            return ""
        low, high = self.reach_mm
        return (
            f"the profile covers x from {low:.3f} to {high:.3f} mm of a lens of ±{self.designed.half_width_mm:g} "
            "mm; beyond it, the designed lens with the deviation of the last points is assumed. "
            f"{self.unseen:.0%} of the accepted angles are incident on that part"
        )

    def _scatter_warning(self) -> str:
        stated_um = 1e3 * float(np.median(self.profile.u_mm))
        if self.scatter_um > ROUGH * max(stated_um, 1e3 * MIN_U_MM):
            return (
                f"neighbouring points scatter by {self.scatter_um:.2g} µm, more than their reported "
                f"uncertainty of {stated_um:.2g} µm: the scatter is used as their uncertainty"
            )
        if self.smooth.residual > ROUGH:
            return (
                f"the residuals of the smoothed profile are {self.smooth.residual:.2g} times the uncertainty: details "
                f"finer than {self.smooth.resolution_mm:.2g} mm are smoothed away"
            )
        return ""

    @cached_property
    def _point_u_mm(self) -> FloatArray:
        """Return the uncertainty of each profile point: the specified one, or the scatter if that is larger."""
        stated = np.maximum(self.profile.u_mm, MIN_U_MM)
        return np.asarray(stated * max(1.0, 1e-3 * self.scatter_um / float(np.median(stated))))

    @cached_property
    def _ends(self) -> tuple[float, float]:
        """Return the lengths along the lens at the first and the last point."""
        first, last = self.track.length_at(np.array(self.reach_mm))
        return float(first), float(last)

    def _place(self, x_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the measured length nearest to a lateral position, and how far beyond it that position is."""
        along = self.track.length_at(x_mm)
        inside = np.clip(along, *self._ends)
        return inside, along - inside

    def _check_reach(self) -> None:
        half_mm = self.designed.half_width_mm
        x, low, high = self.points[0], *self.profile.width_mm
        if x.size < MIN_POINTS or max(low + half_mm, half_mm - high) > MAX_MISSING * half_mm:
            need_mm = (1.0 - MAX_MISSING) * half_mm
            raise DesignError(
                "lens.profile",
                value=f"{x.size} points from {low:.4g} to {high:.4g} mm",
                limit=f"a lens of {half_mm:g} mm half width needs at least {MIN_POINTS} points, "
                f"which cover {-need_mm:.4g} to {need_mm:.4g} mm",
                remedy="measure the entire lens, or narrow lens.half_width_mm",
            )

    def _check_place(self) -> None:
        x, deviation = self.points
        worst, limit_mm = int(np.argmax(np.abs(deviation))), FARTHEST * self.designed.half_width_mm
        if abs(deviation[worst]) > limit_mm:
            raise DesignError(
                "lens.profile",
                value=f"{deviation[worst]:+.4g} mm from the design at x = {x[worst]:.4g} mm",
                limit=f"must be within {limit_mm:g} mm of the designed lens",
                remedy="register the profile to the design, with its vertex at the origin and z into the body",
            )
        nearest_mm, emitter_mm = float((deviation + self.designed.z_mm(x)).min()), -self.designed.distance_mm
        if nearest_mm <= NEAREST * emitter_mm:
            raise DesignError(
                "lens.profile",
                value=f"reaches z = {nearest_mm:.4g} mm",
                limit=f"the emitter is at z = {emitter_mm:g} mm",
                remedy="register the profile to the design, with its vertex at the origin and z into the body",
            )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
