"""One design under its motion, as plain calls: lens, body, scene, trace, response.

A :class:`Sensor` is a design with what follows from it at once: the material's index at the emitter's wavelength and
the lens cut for it. Everything that depends on the angle is a method. A :class:`Response` is what its receivers see
over the angles of a sweep; a :class:`Study` is all of it, counted and in power, with the lens and without.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from solen.errors import DesignError
from solen.geometry import Body, y_body
from solen.lens import FlatFace, Lens, lens_of
from solen.material import Optical, optical
from solen.scene import Scene, sensor_scene
from solen.spec import Design, with_values
from solen.trace import Integral, Mode, Trace, integrate, trace

TOLERANCE = 1e-6
"""Within what fraction of the emitted power a receiver's power is integrated."""
FAILURES = 2
"""After so many angles of a sweep at which integration failed, it is not tried at the others."""
DENSE_TOLERANCE = 1e-4
FIRST_RAYS, MOST_RAYS = 2**13, 2**18
"""What ever denser fans are driven to where integration fails, and their least and largest number of rays."""
SATURATED = 0.95
"""Contrast from which on a differential signal hardly moves any more."""

SLOPE_DEG = 0.04
"""Angle over which the slope at the balance point is taken: well inside the range where a contrast is straight."""

Progress = Callable[[float], None]


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
    traces: tuple[Trace | Integral, ...]

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
class Sensor:
    """A design and what follows from it; make it with `Sensor.of`."""

    design: Design
    material: Optical
    lens: Lens

    @classmethod
    def of(cls, design: Design) -> "Sensor":
        """Sensor of a design; `DesignError` or `DataError` where its lens or its resin cannot be."""
        material = optical(design)
        return cls(design, material, lens_of(design, material.index))

    @property
    def has_lens(self) -> bool:
        """Whether light enters by a lens rather than by the stem's flat face."""
        return not isinstance(self.lens, FlatFace)

    @cached_property
    def without_lens(self) -> "Sensor":
        """The same sensor with the stem's flat face for a lens."""
        return Sensor.of(with_values(self.design, {"lens.shape": "none"}))

    def body(self, angle_deg: float = 0.0) -> Body:
        """Body with its moving parts turned by ``angle_deg``; `DesignError` where it cannot be."""
        return y_body(self.design, self.lens, angle_deg)

    def check(self) -> None:
        """`DesignError` where the body cannot be built at some angle of the motion."""
        for angle_deg in self.design.motion.angles_deg():
            self.body(angle_deg)

    def scene(self, angle_deg: float = 0.0, rays: int | None = None) -> Scene:
        """Scene at an angle, with ``rays`` rays in place of the design's."""
        return sensor_scene(self.design, self.body(angle_deg), self.material, rays)

    def trace(
        self, angle_deg: float = 0.0, mode: Mode | None = None, rays: int | None = None, *, legs: bool = False
    ) -> Trace:
        """Trace at an angle, in the design's mode and with its rays unless told otherwise."""
        return trace(self.scene(angle_deg, rays), mode or self.design.trace.mode, legs=legs)

    def integrate(self, angle_deg: float = 0.0, mode: Mode = "power", tolerance: float = TOLERANCE) -> Integral:
        """Powers at an angle, integrated over the launch angle to a tolerance; see `solen.trace.integrate`."""
        return integrate(self.scene(angle_deg), mode, tolerance)

    def doubled(self, angle_deg: float = 0.0, tolerance: float = DENSE_TOLERANCE) -> tuple[Trace, float]:
        """Power by fans of twice as many rays until no receiver changes by more than ``tolerance``.

        For light whose ways part too often for `integrate`. Returns the last trace and its uncertainty: the last
        change, or the share of one ray where that is more, because two fans can agree by chance; above ``tolerance``
        where `MOST_RAYS` rays do not reach it.
        """
        rays = FIRST_RAYS
        before = self.trace(angle_deg, "power", rays)
        while True:
            rays *= 2
            after = self.trace(angle_deg, "power", rays)
            changes = [abs(after.detectors[name].power - before.detectors[name].power) for name in after.detectors]
            u = max(*changes, 1.0 / rays)
            if u <= tolerance or rays >= MOST_RAYS:
                return after, u
            before = after

    def slope_per_deg(self, angle_deg: float) -> float | None:
        """Change of the contrast per degree at an angle, in power, over `SLOPE_DEG`; None where no light arrives."""
        ends = (angle_deg - SLOPE_DEG / 2, angle_deg + SLOPE_DEG / 2)
        readings = [self._reading(end)[1] for end in ends]
        low, high = (_contrast(one["right"], one["left"]) for one in readings)
        return None if low is None or high is None else (high - low) / SLOPE_DEG

    def count(self, angles_deg: Sequence[float] | None = None, progress: Progress | None = None) -> Response:
        """Response by counting the design's own number of rays, as the paper does."""

        def at(angle_deg: float) -> tuple[Trace, dict[str, float], float]:
            found = self.trace(angle_deg, "count")
            return found, _powers(found), math.nan

        return self._sweep("count", at, angles_deg, progress)

    def power(self, angles_deg: Sequence[float] | None = None, progress: Progress | None = None) -> Response:
        """Response in power, integrated at every angle; by ever denser fans where that does not reach its tolerance."""
        failed: list[float] = []

        def at(angle_deg: float) -> tuple[Trace | Integral, dict[str, float], float]:
            found = self._reading(angle_deg, integrates=len(failed) < FAILURES)
            if isinstance(found[0], Trace):
                failed.append(angle_deg)
            return found

        return self._sweep("power", at, angles_deg, progress)

    def _reading(
        self, angle_deg: float, *, integrates: bool = True
    ) -> tuple[Trace | Integral, dict[str, float], float]:
        """Powers at an angle with their uncertainty: integrated, or by ever denser fans where that does not reach."""
        found = self.integrate(angle_deg) if integrates else None
        if found is not None and found.reached:
            return found, found.detectors, found.u
        dense, u = self.doubled(angle_deg)
        return dense, _powers(dense), u

    def _sweep(
        self,
        mode: Mode,
        at: Callable[[float], tuple[Trace | Integral, dict[str, float], float]],
        angles_deg: Sequence[float] | None,
        progress: Progress | None,
    ) -> Response:
        angles = self.design.motion.angles_deg() if angles_deg is None else tuple(angles_deg)
        results = []
        for done, angle in enumerate(angles, start=1):
            results.append(at(angle))
            if progress is not None:
                progress(done / len(angles))
        return Response(
            mode=mode,
            angle_deg=np.array(angles),
            right=np.array([powers["right"] for _, powers, _ in results]),
            left=np.array([powers["left"] for _, powers, _ in results]),
            u=np.array([u for _, _, u in results]),
            traces=tuple(found for found, _, _ in results),
        )


@dataclass(frozen=True)
class Case:
    """A sensor's response twice over: by counting the design's rays, and in power, integrated.

    ``null_deg`` is the balance point nearest to 0, from the power; ``slope_per_deg`` the contrast's slope there.
    """

    sensor: Sensor
    counted: Response
    power: Response
    null_deg: float | None
    slope_per_deg: float | None


@dataclass(frozen=True)
class Study:
    """A design over the angles of its motion, with its lens and without.

    ``lens`` is None for a design without one. ``flat`` is None where the sensor with a lens cannot be built without it;
    ``flat_refused`` then says why.
    """

    design: Design
    lens: Case | None
    flat: Case | None
    flat_refused: str | None = None

    @property
    def case(self) -> Case:
        """The design's own case."""
        case = self.lens or self.flat
        if case is None:
            raise AssertionError("a study has at least one case")
        return case

    @property
    def cases(self) -> dict[str, Case]:
        """Cases by name: ``lens``, ``no_lens``."""
        both = {"lens": self.lens, "no_lens": self.flat}
        return {name: case for name, case in both.items() if case is not None}


def study(design: Design, progress: Progress | None = None) -> Study:
    """Trace a design over its motion, with its lens and without, counting and in power.

    Every body of the motion is built before the first ray is traced, so that a motion which breaks the body is refused
    at once. ``progress`` is called with the share done, up to 1.
    """
    sensor = Sensor.of(design)
    sensor.check()
    if not sensor.has_lens:
        return Study(design, None, _case(sensor, progress))
    flat, refused = _comparison(sensor)
    if flat is None:
        return Study(design, _case(sensor, progress), None, refused)
    return Study(design, _case(sensor, _part(progress, 0, 2)), _case(flat, _part(progress, 1, 2)))


def _comparison(sensor: Sensor) -> tuple[Sensor | None, str | None]:
    """The sensor without its lens, or why it cannot be built."""
    try:
        sensor.without_lens.check()
    except DesignError as bad:
        return None, str(bad)
    return sensor.without_lens, None


def _case(sensor: Sensor, progress: Progress | None) -> Case:
    counted = sensor.count(progress=_part(progress, 0, 10))
    power = sensor.power(progress=_part(progress, 1, 10, 8))
    null = power.null_deg()
    slope = None if null is None else sensor.slope_per_deg(null)
    if progress is not None:
        progress(1.0)
    return Case(sensor, counted, power, null, slope)


def _part(progress: Progress | None, first: int, parts: int, length: int = 1) -> Progress | None:
    """Progress of ``length`` of so many equal parts, told as the share of the whole."""
    return None if progress is None else lambda done: progress((first + length * done) / parts)


def _powers(found: Trace) -> dict[str, float]:
    """Power by receiver."""
    return {name: reading.power for name, reading in found.detectors.items()}


def _contrast(right: float, left: float) -> float | None:
    """(R − L)/(R + L), None where no light arrives."""
    return (right - left) / (right + left) if right + left > 0.0 else None
