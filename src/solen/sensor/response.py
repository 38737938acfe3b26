"""The response of two receivers over the angles of a motion: powers and contrast, (right − left) / (right + left)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.results import HIDDEN, Result, reported
from solen.trace import Ledger, Mode, Slope, Trace

SATURATION_CONTRAST = 0.95
"""Contrast above which the signal is treated as saturated."""

Reading = tuple[Trace, float]
"""A trace, and the uncertainty of the power at each receiver."""


@dataclass(frozen=True)
class Shift:
    """Largest change of the contrast over the angles, its angle, and its uncertainty there."""

    contrast: float
    angle_deg: float
    u_contrast: float


class Response(Result):
    """Powers at two receivers over N angles, as fractions of the emitted power.

    Attributes
    ----------
    mode
        ``count`` or ``power``.
    angle_deg
        Angles (N,) of the motion.
    right, left
        Power (N,) at each receiver.
    u_power
        Uncertainty (N,) of either power; NaN for a fixed number of rays, which gives no estimate of it.
    traces
        Trace of the scene at each angle.
    """

    mode: Mode
    angle_deg: FloatArray
    right: FloatArray
    left: FloatArray
    u_power: FloatArray
    traces: tuple[Trace, ...] = field(metadata=HIDDEN)

    @classmethod
    def of(cls, mode: Mode, angles_deg: Sequence[float], readings: Sequence[Reading]) -> "Response":
        """Create a response from the reading at each angle."""
        light = [powers(trace) for trace, _ in readings]
        return cls(
            mode=mode,
            angle_deg=np.array(angles_deg),
            right=np.array([received["right"] for received in light]),
            left=np.array([received["left"] for received in light]),
            u_power=np.array([u for _, u in readings]),
            traces=tuple(trace for trace, _ in readings),
        )

    @reported
    def contrast(self) -> FloatArray:
        """Contrast (R − L)/(R + L); NaN without light."""
        return _quotient(self.right - self.left, self.right + self.left)

    @reported
    def u_contrast(self) -> FloatArray:
        """Uncertainty of the contrast, from that of both powers; NaN without light."""
        return _quotient(2.0 * self.u_power, self.right + self.left)

    @reported
    def rays(self) -> IntArray:
        """Number of rays traced at each angle."""
        return np.array([trace.rays for trace in self.traces])

    @reported
    def ledger(self) -> list[Ledger]:
        """Power ledger at each angle."""
        return [trace.ledger for trace in self.traces]

    @property
    def received_share(self) -> float:
        """Power at both receivers together, averaged over the angles."""
        return float((self.right + self.left).mean())

    def contrast_at(self, angle_deg: float) -> float | None:
        """Return the contrast at the angle nearest to ``angle_deg``; None if no light arrives."""
        value = float(self.contrast[self.index_at(angle_deg)])
        return value if math.isfinite(value) else None

    def subset(self, indices: Sequence[int]) -> "Response":
        """Return the response at a subset of the angles, by index."""
        chosen = list(indices)
        arrays = (self.angle_deg[chosen], self.right[chosen], self.left[chosen], self.u_power[chosen])
        return Response(self.mode, *arrays, tuple(self.traces[i] for i in chosen if self.traces))

    def merged(self, other: "Response") -> "Response":
        """Return both responses as one, in ascending order of the angles."""
        merged = Response(
            mode=self.mode,
            angle_deg=np.concatenate([self.angle_deg, other.angle_deg]),
            right=np.concatenate([self.right, other.right]),
            left=np.concatenate([self.left, other.left]),
            u_power=np.concatenate([self.u_power, other.u_power]),
            traces=(*self.traces, *other.traces),
        )
        return merged.subset(np.argsort(merged.angle_deg, kind="stable").tolist())

    def index_at(self, angle_deg: float) -> int:
        """Return the index of the angle nearest to ``angle_deg``."""
        return int(np.argmin(np.abs(self.angle_deg - angle_deg)))

    def null_deg(self) -> float | None:
        """Return the angle nearest to 0 at which the contrast is 0, interpolated linearly; None if there is none."""
        u_contrast = _quotient(2.0 * np.nan_to_num(self.u_power), self.right + self.left)
        zero = (np.abs(self.contrast) <= u_contrast) & (u_contrast < 0.1)  # with little light, any angle may be null
        nulls = [*self.angle_deg[zero].tolist(), *self._crossings_deg(0.0)]
        return min(nulls, key=abs, default=None)

    def saturation_deg(self) -> float | None:
        """Return the smallest distance from the null at which the contrast saturates, interpolated linearly.

        None if there is no null, or the contrast stays below.
        """
        null = self.null_deg()
        if null is None:
            return None
        reached = self.angle_deg[np.abs(self.contrast) >= SATURATION_CONTRAST].tolist()
        reached += [*self._crossings_deg(-SATURATION_CONTRAST), *self._crossings_deg(SATURATION_CONTRAST)]
        return min((abs(angle_deg - null) for angle_deg in reached), default=None)

    def _crossings_deg(self, level: float) -> list[float]:
        """Return the angles, interpolated between neighbours, at which the contrast crosses a level."""
        above = self.contrast - level
        first = np.flatnonzero(above[:-1] * above[1:] < 0.0)
        fraction = above[first] / (above[first] - above[first + 1])
        return [*((1.0 - fraction) * self.angle_deg[first] + fraction * self.angle_deg[first + 1]).tolist()]


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of powers and contrast at an angle with respect to a number of the design.

    Attributes
    ----------
    key, value
        The number and its value.
    right, left
        Derivatives of the powers, as fractions of the emitted power, per unit of the number; NaN if there are none.
    contrast
        Derivative of (R − L)/(R + L), per unit of the number; NaN if there is none, or without light.
    why
        Reason why there is no derivative.
    tolerance
        Tolerance of the number.
    """

    key: str
    value: float
    right: Slope
    left: Slope
    contrast: Slope
    why: str | None = None
    tolerance: float = 0.0

    @reported
    def effect(self) -> float:
        """Absolute change of the contrast if the number deviates by its tolerance; 0 if unknown."""
        effect = abs(self.contrast.value) * self.tolerance
        return effect if math.isfinite(effect) else 0.0

    @property
    def reached(self) -> bool:
        """Whether there are derivatives."""
        return not self.why


def _quotient(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """Return quotients; NaN for a denominator of 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(denominator > 0.0, numerator / denominator, np.nan))


def powers(trace: Trace) -> dict[str, float]:
    """Return the first source's power at each receiver, without ambient light, which is subtracted in a measurement."""
    return {name: (*reading.power_by_source, reading.power)[0] for name, reading in trace.detectors.items()}


def contrast_slope(base: Trace, right: Slope, left: Slope) -> Slope:
    """Return the derivative of (R − L)/(R + L) from those of R and L; NaN without light."""
    light = powers(base)
    total = light["right"] + light["left"]
    if not total > 0.0:
        return Slope(math.nan, math.nan)
    value = 2.0 * (light["left"] * right.value - light["right"] * left.value) / total**2
    u = 2.0 * (light["left"] * right.u_value + light["right"] * left.u_value) / total**2
    u_of_powers = base.u_power * (2.0 * (abs(right.value) + abs(left.value)) / total**2 + 4.0 * abs(value) / total)
    return Slope(value, u + u_of_powers)


def shift(response: Response, other: Response) -> Shift | None:
    """Return the largest difference in contrast between two responses, over their common angles.

    None if no light arrives at any of them.
    """
    common = sorted(set(response.angle_deg.tolist()) & set(other.angle_deg.tolist()))
    first, second = (each.subset([each.index_at(angle) for angle in common]) for each in (response, other))
    change = np.abs(first.contrast - second.contrast)
    if not np.isfinite(change).any():
        return None
    index = int(np.nanargmax(change))
    u = float(first.u_contrast[index] + second.u_contrast[index])
    return Shift(float(change[index]), common[index], u)
