"""Emission patterns: the intensity as a function of the angle from the emitter's axis.

A pattern is a relative intensity I(θ), power per solid angle, rotationally symmetric about the axis and truncated at
half the cone angle. In space, the angle of a ray is sampled from I(θ) sin θ; in the plane, from I(θ) on both
sides of the axis, which is a section of the pattern. In both cases, the cumulative distribution is inverted. For the
analytic patterns this is done in closed form; for a table, which is linear between its angles, by solving a quadratic
in the plane and by Newton's method in space.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from solen.arrays import FloatArray, IndexArray
from solen.curve import check_numbers, check_range
from solen.errors import DesignError

MAX_EXPONENT = 10_000.0
SAME_ANGLE = 1e-15
"""Newton's method has converged if its step is below this angle in radians."""


class AngleInterval(NamedTuple):
    """Angles (rad) from the axis over which the intensity in the plane is (base + slope · angle) · cos(angle)^power."""

    low: float
    high: float
    base: float
    slope: float
    power: float

    @property
    def max_intensity(self) -> float:
        """Upper bound of the intensity."""
        ends = (self.base + self.slope * self.low, self.base + self.slope * self.high)
        return max(abs(end) for end in ends)


class AngularPattern(ABC):
    """Relative intensity as a function of the angle from the axis; ``half`` is half the cone angle in rad, up to π."""

    @abstractmethod
    def intensity(self, angle: FloatArray) -> FloatArray:
        """Return the relative intensity at angles (N,) in radians, from 0 to π."""

    @abstractmethod
    def in_plane(self, u: FloatArray, half: float) -> FloatArray:
        """Return angles (N,) from −half to half for cumulative power fractions ``u`` (N,) in the plane."""

    @abstractmethod
    def in_space(self, u: FloatArray, half: float) -> FloatArray:
        """Return angles (N,) from 0 to half for cumulative power fractions ``u`` (N,) in space."""

    @abstractmethod
    def intervals(self, half: float) -> tuple[AngleInterval, ...]:
        """Return the section in the plane as intervals over which it is smooth, in order of angle."""

    @abstractmethod
    def solid_angle_sr(self, half: float) -> float:
        """Power in space divided by the intensity on the axis."""

    def space_integral_sr(self, half: float) -> float:
        """Integral of the relative intensity over all directions in space, in sr.

        By default the intensity on the axis is taken as 1.
        """
        return self.solid_angle_sr(half)

    @abstractmethod
    def plane_angle(self, half: float) -> float:
        """Integral of the relative intensity over the section in the plane, in radians."""


@dataclass(frozen=True)
class Isotropic(AngularPattern):
    """The same intensity at all angles."""

    kind: Literal["uniform"] = "uniform"

    def intensity(self, angle: FloatArray) -> FloatArray:
        """See :meth:`AngularPattern.intensity`."""
        return np.ones_like(angle)

    def in_plane(self, u: FloatArray, half: float) -> FloatArray:
        """See :meth:`AngularPattern.in_plane`."""
        return 2.0 * half * (u - 0.5)

    def in_space(self, u: FloatArray, half: float) -> FloatArray:
        """See :meth:`AngularPattern.in_space`; sin²(θ/2) is uniform."""
        return 2.0 * np.arcsin(np.sqrt(u) * math.sin(0.5 * half))

    def intervals(self, half: float) -> tuple[AngleInterval, ...]:
        """See :meth:`AngularPattern.intervals`."""
        return (AngleInterval(-half, half, 1.0, 0.0, 0.0),)

    def solid_angle_sr(self, half: float) -> float:
        """See :meth:`AngularPattern.solid_angle_sr`."""
        return 4.0 * math.pi * math.sin(0.5 * half) ** 2

    def plane_angle(self, half: float) -> float:
        """See :meth:`AngularPattern.plane_angle`."""
        return 2.0 * half


@dataclass(frozen=True)
class CosinePower(AngularPattern):
    """Intensity cos^m θ up to 90°, 0 beyond; m = 1 is Lambert's law."""

    exponent: float = 1.0
    kind: Literal["lambertian"] = "lambertian"

    def __post_init__(self) -> None:
        check_range("pattern exponent", self.exponent, 0.0, MAX_EXPONENT)

    def intensity(self, angle: FloatArray) -> FloatArray:
        """See :meth:`AngularPattern.intensity`."""
        within = angle <= 0.5 * math.pi
        return np.where(within, np.maximum(np.cos(angle), 0.0) ** self.exponent, 0.0)

    def in_plane(self, u: FloatArray, half: float) -> FloatArray:
        """See :meth:`AngularPattern.in_plane`; sin²θ has a beta distribution."""
        from scipy.special import betainc, betaincinv  # slow to import, and few sources need it

        signed, max_sine = 2.0 * u - 1.0, math.sin(_up_to_90(half))
        if self.exponent == 1.0:
            return np.asarray(np.arcsin(signed * max_sine))
        a, b = 0.5, 0.5 * (self.exponent + 1.0)
        square = np.asarray(
            betaincinv(a, b, np.abs(signed) * float(betainc(a, b, max_sine * max_sine))), dtype=np.float64
        )
        return np.asarray(np.copysign(np.arcsin(np.sqrt(square)), signed))

    def in_space(self, u: FloatArray, half: float) -> FloatArray:
        """See :meth:`AngularPattern.in_space`; cos^(m + 1) θ is uniform."""
        m = self.exponent + 1.0
        with np.errstate(divide="ignore"):  # at 90° the logarithm of 0, whose exponential is 0
            one_minus_cos: FloatArray = -np.expm1(np.log1p(-u * (1.0 - math.cos(_up_to_90(half)) ** m)) / m)
        return np.asarray(2.0 * np.arcsin(np.sqrt(0.5 * one_minus_cos)))

    def intervals(self, half: float) -> tuple[AngleInterval, ...]:
        """See :meth:`AngularPattern.intervals`."""
        half = _up_to_90(half)
        return (AngleInterval(-half, half, 1.0, 0.0, self.exponent),)

    def solid_angle_sr(self, half: float) -> float:
        """See :meth:`AngularPattern.solid_angle_sr`."""
        m = self.exponent + 1.0
        return 2.0 * math.pi / m * (1.0 - float(math.cos(_up_to_90(half)) ** m))

    def plane_angle(self, half: float) -> float:
        """See :meth:`AngularPattern.plane_angle`."""
        from scipy.special import beta, betainc

        a, b = 0.5, 0.5 * (self.exponent + 1.0)
        return float(beta(a, b) * betainc(a, b, math.sin(_up_to_90(half)) ** 2))


@dataclass(frozen=True)
class PatternTable(AngularPattern):
    """Relative intensity at angles in degrees from the axis, ascending from 0; linear in between, 0 beyond."""

    angle_deg: tuple[float, ...]
    relative: tuple[float, ...]
    kind: Literal["table"] = "table"

    def __post_init__(self) -> None:
        check_numbers("pattern angle_deg", *self.angle_deg)
        check_numbers("pattern relative", *self.relative)
        if len(self.angle_deg) != len(self.relative) or len(self.angle_deg) < 2:
            limit = (
                "must have as many intensities as angles, at least 2, but has "
                f"{len(self.relative)} and {len(self.angle_deg)}"
            )
            raise DesignError("pattern", limit=limit)
        if self.angle_deg[0] != 0.0 or self.angle_deg[-1] > 180.0 or any(a >= b for a, b in pairwise(self.angle_deg)):
            raise DesignError(
                "pattern angle_deg", value=self.angle_deg, limit="must be in ascending order from 0 to at most 180"
            )
        if not min(self.relative) >= 0.0 or not max(self.relative) > 0.0:
            limit = "must be at least 0, and above 0 at some angle"
            raise DesignError("pattern relative", value=self.relative, limit=limit)

    def intensity(self, angle: FloatArray) -> FloatArray:
        """See :meth:`AngularPattern.intensity`."""
        return np.interp(angle, np.radians(self.angle_deg), self.relative, right=0.0)

    def in_plane(self, u: FloatArray, half: float) -> FloatArray:
        """See :meth:`AngularPattern.in_plane`."""
        angle, value = self._within(half)
        signed = 2.0 * u - 1.0
        index, rest = _segment(np.abs(signed), 0.5 * (value[1:] + value[:-1]) * np.diff(angle))
        slope = (np.diff(value) / np.diff(angle))[index]
        root = value[index] + np.sqrt(np.maximum(value[index] ** 2 + 2.0 * slope * rest, 0.0))
        step = np.divide(2.0 * rest, root, out=np.zeros_like(rest), where=root > 0.0)
        return np.copysign(np.minimum(angle[index] + step, angle[index + 1]), signed)

    def in_space(self, u: FloatArray, half: float) -> FloatArray:
        """See :meth:`AngularPattern.in_space`."""
        angle, value = self._within(half)
        width, slope = np.diff(angle), np.diff(value) / np.diff(angle)
        index, rest = _segment(u, _band(angle[:-1], value[:-1], slope, width))
        start, first, rise = angle[index], value[index], slope[index]
        low, high = np.zeros_like(u), width[index]
        step = 0.5 * high
        for _ in range(80):
            over = _band(start, first, rise, step) - rest
            low, high = np.where(over < 0.0, step, low), np.where(over < 0.0, high, step)
            steep = (first + rise * step) * np.sin(start + step)
            newton = step - np.divide(over, steep, out=np.full_like(u, np.inf), where=steep > 0.0)
            new = np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
            if np.all(np.abs(new - step) <= SAME_ANGLE):
                break
            step = new
        return start + step

    def intervals(self, half: float) -> tuple[AngleInterval, ...]:
        """See :meth:`AngularPattern.intervals`."""
        angle, value = (column.tolist() for column in self._within(half))
        left: list[AngleInterval] = []
        for (low, first), (high, last) in pairwise(zip(angle, value, strict=True)):
            slope = (last - first) / (high - low)
            left.append(AngleInterval(low, high, first - slope * low, slope, 0.0))
        right = [AngleInterval(-part.high, -part.low, part.base, -part.slope, 0.0) for part in reversed(left)]
        return tuple(part for part in (*right, *left) if part.max_intensity > 0.0)

    def solid_angle_sr(self, half: float) -> float:
        """See :meth:`AngularPattern.solid_angle_sr`."""
        on_axis = self.relative[0]
        return self.space_integral_sr(half) / on_axis if on_axis > 0.0 else math.inf

    def space_integral_sr(self, half: float) -> float:
        """See :meth:`AngularPattern.space_integral_sr`."""
        angle, value = self._within(half)
        slope = np.diff(value) / np.diff(angle)
        return float(2.0 * math.pi * np.sum(_band(angle[:-1], value[:-1], slope, np.diff(angle))))

    def plane_angle(self, half: float) -> float:
        """See :meth:`AngularPattern.plane_angle`."""
        angle, value = self._within(half)
        return float(np.sum((value[1:] + value[:-1]) * np.diff(angle)))

    def _within(self, half: float) -> tuple[FloatArray, FloatArray]:
        """Return angles in radians and intensities within the cone; raise `DesignError` if all of these are 0."""
        angle, value = np.radians(self.angle_deg), np.asarray(self.relative, dtype=float)
        last = min(half, float(angle[-1]))
        inside = angle < last
        angle, value = np.append(angle[inside], last), np.append(value[inside], np.interp(last, angle, value))
        if not (len(value) > 1 and np.any(value > 0.0)):
            raise DesignError(
                "cone_deg", value=2.0 * math.degrees(half), limit="must include angles at which the pattern emits"
            )
        return angle, value


Pattern = Isotropic | CosinePower | PatternTable


def _up_to_90(half: float) -> float:
    return min(half, 0.5 * math.pi)


def _segment(fraction: FloatArray, amounts: FloatArray) -> tuple[IndexArray, FloatArray]:
    """Return the index of the amount at which the running sum reaches a fraction of the total, and the part needed."""
    cumulative = np.concatenate([[0.0], np.cumsum(amounts)])
    target = fraction * cumulative[-1]
    index = np.clip(np.searchsorted(cumulative, target, side="right") - 1, 0, len(amounts) - 1)
    return index, np.clip(target - cumulative[index], 0.0, amounts[index])


def _band(start: FloatArray, first: FloatArray, slope: FloatArray, step: FloatArray) -> FloatArray:
    """Integral of (first + slope t) sin(start + t) over t from 0 to ``step``."""
    end = start + step
    flat = 2.0 * np.sin(start + 0.5 * step) * np.sin(0.5 * step)  # the difference of two cosines
    return np.asarray(first * flat + slope * (np.sin(end) - np.sin(start) - step * np.cos(end)))
