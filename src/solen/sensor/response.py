"""What two receivers see over the angles of a motion, and how they answer to one number of the design."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solen.trace import Mode, Slope, Trace

SATURATED = 0.95
"""Contrast from which on a differential signal hardly moves any more."""


@dataclass(frozen=True)
class Shift:
    """Largest distance of one contrast over the angles from another, where it is, and what it may be off by there."""

    contrast: float
    angle_deg: float
    u: float


@dataclass(frozen=True)
class Response:
    """Powers at the receivers over N angles, as fractions of the emitted power; ``u`` is their uncertainty.

    ``u`` (N,) estimates the error of both readings; NaN for a sweep of a fixed number of rays, which is a count and not
    an estimate. ``traces`` hold the ledgers and the numbers of rays.
    """

    mode: Mode
    angle_deg: NDArray[np.float64]
    right: NDArray[np.float64]
    left: NDArray[np.float64]
    u: NDArray[np.float64]
    traces: tuple[Trace, ...]

    @property
    def rays(self) -> NDArray[np.int64]:
        """Rays traced at each angle."""
        return np.array([trace.rays for trace in self.traces])

    @property
    def contrast(self) -> NDArray[np.float64]:
        """(R − L)/(R + L), NaN where no light arrives."""
        total = self.right + self.left
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.where(total > 0, (self.right - self.left) / total, np.nan))

    @property
    def u_contrast(self) -> NDArray[np.float64]:
        """Uncertainty of the contrast, from that of both powers; NaN where no light arrives."""
        total = self.right + self.left
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.where(total > 0, 2.0 * self.u / total, np.nan))

    def part(self, places: Sequence[int]) -> "Response":
        """The same at some of the angles, by their places."""
        chosen = list(places)
        arrays = (self.angle_deg[chosen], self.right[chosen], self.left[chosen], self.u[chosen])
        return Response(self.mode, *arrays, tuple(self.traces[i] for i in chosen))

    def joined(self, other: "Response") -> "Response":
        """Both together, in the order of the angles."""
        both = Response(
            mode=self.mode,
            angle_deg=np.concatenate([self.angle_deg, other.angle_deg]),
            right=np.concatenate([self.right, other.right]),
            left=np.concatenate([self.left, other.left]),
            u=np.concatenate([self.u, other.u]),
            traces=(*self.traces, *other.traces),
        )
        return both.part(np.argsort(both.angle_deg, kind="stable").tolist())

    def at(self, angle_deg: float) -> int:
        """Place of the angle nearest to ``angle_deg``."""
        return int(np.argmin(np.abs(self.angle_deg - angle_deg)))

    def null_deg(self) -> float | None:
        """Angle nearest to 0 at which both receivers see the same, by a straight line between angles, or None."""
        contrast = self.contrast
        with np.errstate(invalid="ignore", divide="ignore"):
            u_contrast = 2.0 * np.nan_to_num(self.u) / (self.right + self.left)
        zero = (np.abs(contrast) <= u_contrast) & (u_contrast < 0.1)  # in the dark every angle would be one
        found = [float(angle) for angle in self.angle_deg[zero]]
        for i in np.flatnonzero(contrast[:-1] * contrast[1:] < 0.0):
            share = contrast[i] / (contrast[i] - contrast[i + 1])
            found.append(float((1.0 - share) * self.angle_deg[i] + share * self.angle_deg[i + 1]))
        return min(found, key=abs, default=None)

    def saturation_deg(self) -> float | None:
        """Smallest distance from the null at which the contrast reaches `SATURATED`, by a straight line between angles.

        None where it never does, or without a null.
        """
        null, contrast = self.null_deg(), self.contrast
        if null is None:
            return None
        reached = [float(angle) for angle in self.angle_deg[np.abs(contrast) >= SATURATED]]
        for bound in (-SATURATED, SATURATED):
            above = contrast - bound
            for i in np.flatnonzero(above[:-1] * above[1:] < 0.0):
                share = above[i] / (above[i] - above[i + 1])
                reached.append(float((1.0 - share) * self.angle_deg[i] + share * self.angle_deg[i + 1]))
        return min((abs(angle_deg - null) for angle_deg in reached), default=None)


@dataclass(frozen=True)
class Sensitivity:
    """How the readings at an angle change with a number of the design.

    ``right`` and ``left`` are the derivatives of the powers, as fractions of the emitted power, ``contrast`` that of
    (R − L)/(R + L), each per unit that the key ends in. They are NaN where there is no derivative, and the contrast's
    where no light arrives; ``why`` then says why.
    """

    key: str
    value: float
    right: Slope
    left: Slope
    contrast: Slope
    why: str = ""

    @property
    def reached(self) -> bool:
        """Whether the derivatives were found."""
        return not self.why


def powers(found: Trace) -> dict[str, float]:
    """Power of the emitter by receiver: of several sources the first, as ambient light is told apart and subtracted."""
    return {name: (*reading.power_by_source, reading.power)[0] for name, reading in found.detectors.items()}


def contrast_slope(base: Trace, right: Slope, left: Slope) -> Slope:
    """Derivative of (R − L)/(R + L) from those of R and L; NaN where no light arrives."""
    found = powers(base)
    total = found["right"] + found["left"]
    if not total > 0.0:
        return Slope(math.nan, math.nan)
    value = 2.0 * (found["left"] * right.value - found["right"] * left.value) / total**2
    u = 2.0 * (found["left"] * right.u_value + found["right"] * left.u_value) / total**2
    u_of_powers = base.u_power * (2.0 * (abs(right.value) + abs(left.value)) / total**2 + 4.0 * abs(value) / total)
    return Slope(value, u + u_of_powers)


def steepness(one: Sensitivity) -> float:
    """How much the contrast changes; 0 where that is not known."""
    return abs(one.contrast.value) if math.isfinite(one.contrast.value) else 0.0


def contrast(right: float, left: float) -> float | None:
    """(R − L)/(R + L), None where no light arrives."""
    return (right - left) / (right + left) if right + left > 0.0 else None


def shift(one: Response, other: Response) -> Shift | None:
    """How far the contrast of one response lies from that of another at most, over the angles that both have.

    None where no light arrives at any of them.
    """
    common = sorted(set(one.angle_deg.tolist()) & set(other.angle_deg.tolist()))
    here, there = (each.part([each.at(angle) for angle in common]) for each in (one, other))
    change = np.abs(here.contrast - there.contrast)
    if not np.isfinite(change).any():
        return None
    place = int(np.nanargmax(change))
    u = float(here.u_contrast[place] + there.u_contrast[place])
    return Shift(float(change[place]), common[place], u)
