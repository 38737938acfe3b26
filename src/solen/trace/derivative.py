"""Derivatives of the received power with respect to a scene parameter.

The received power is an integral over the launch angle whose integrand jumps where neighbouring rays separate. When the
scene changes, the integrand changes and the jumps move; both contribute. The derivative with respect to a wall's tilt,
for example, comes almost entirely from the jumps, and differentiation along each ray path would miss it. The scene is
therefore integrated once by `solen.trace.integrate`, which locates the pieces between the jumps. In a slightly changed
scene each piece is located again by bisecting its edges to the last digit, and is integrated with nodes at the same
relative positions. By Leibniz' rule the quadrature error then cancels. Two differences, with a step and with half that
step, are extrapolated (Richardson), and their deviation bounds the error.

The power from an extended source is smooth even if the power from each of its points is not. Simple differences of its
integral therefore suffice, with larger steps; their error is that of the integral divided by the step. In space,
neighbouring scenes are integrated over the same cells (`solen.trace.slopes`). Light that passes through a lens whose
profile varies with height, and light that is trapped in space, is sampled instead: both ends of each difference use the
same samples, and the difference is repeated several times.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray
from solen.curve import check_numbers, check_range
from solen.errors import DesignError, SolenError
from solen.results import Result
from solen.scene import Scene
from solen.trace.adaptive import WEIGHT_FRACTION, Lights, is_extended
from solen.trace.cone import Parts
from solen.trace.engine import trace
from solen.trace.nets import with_rays
from solen.trace.result import Limits, Mode, Trace
from solen.trace.slopes import OFFSETS, slopes
from solen.trace.space import LightInSpace

TOLERANCE, EXTENDED_TOLERANCE, SPACE_TOLERANCE = 1e-9, 1e-6, 1e-4
RELATIVE_STEP, EXTENDED_STEP, CHIP_STEP = 2e-4, 1e-2, 2e-2
MAX_HALVINGS = 6
MAX_SEGMENTS, SPACE_SEGMENTS = 400_000, 15_000_000
SEEDS, SAMPLES, MAX_DOUBLINGS = 8, 2**15, 4
"""For sampled light: number of independent differences, number of rays at each end of a difference, and maximum
number of times that the step is doubled.
"""
TRAPPED_SAMPLES, TRAPPED_ERROR, TRAPPED_WEIGHT, TRAPPED_DOUBLINGS = 2**17, 1e-3, 3e-4, 1
"""For trapped light: maximum number of rays at each end of a difference, accepted error as a fraction of the largest
slope, weight below which light is not followed, and maximum number of times that the step is doubled. With steps of
16 % of a refractive index, the true error was four times the reported one.
"""
SAFETY = 1.25
"""Safety factor on the standard error of the differences, because these are few and the step with the smallest error is
chosen.
"""
TRAPPED_TOLERANCE = 1e-2
"""Light in space is treated as trapped if its integral does not immediately reach this tolerance."""


@dataclass(frozen=True)
class Slope:
    """Change of a power per unit of the parameter, with an error estimate."""

    value: float
    u_value: float


class Derivative(Result):
    """Derivatives of the power at each receiver, as fractions of the emitted power per unit of the parameter.

    ``step`` is the larger of the two finite-difference steps. ``reached`` is False if the light paths change at this
    value of the parameter, so that the pieces of the cone cannot be located again; ``why`` gives the reason.
    """

    detectors: dict[str, Slope]
    step: float
    reached: bool
    why: str = ""


def derivative(
    scene_at: Callable[[float], Scene],
    value: float,
    step: float | None = None,
    mode: Mode = "power",
    tolerance: float | None = None,
    limits: Limits | None = None,
) -> Derivative:
    """Differentiate the power at each receiver with respect to one parameter.

    Parameters
    ----------
    scene_at
        Function that returns the scene for a parameter value, as for `solen.trace.integrate`.
    value
        Parameter value at which to differentiate.
    step
        Maximum change of the parameter. The default is a fraction of ``value`` (an absolute step if ``value`` is 0):
        1e-2, but 2e-2 for a chip in space and 2e-4 for a point in the plane. For a point, the step is halved up to six
        times if the light paths change within it. For sampled light, it is doubled up to four times as long as this
        reduces the error.
    mode, tolerance, limits
        As in `solen.trace.integrate`, for integrals in the plane. The default tolerance is 1e-9, or 1e-6 for sources
        that are extended or have several wavelengths.

    Returns
    -------
    Derivative
        One `Slope` per receiver; NaN if it could not be determined.

    Raises
    ------
    DesignError
        As in `solen.trace.integrate`, and if the step is not above 0 or an integral does not reach its tolerance.
    """
    check_numbers("parameter", value)
    scene = scene_at(value)
    point = not is_extended(scene) and scene.extrusion is None
    if step is None:
        chip = is_extended(scene) and scene.extrusion is not None and scene.front is None
        step = (RELATIVE_STEP if point else CHIP_STEP if chip else EXTENDED_STEP) * (abs(value) or 1.0)
    check_range("step", step, above=0.0)
    if scene.front is not None:
        return _of_samples(scene_at, value, step, mode, limits)
    in_space = scene.extrusion is not None
    if tolerance is None:
        tolerance = TOLERANCE if point else SPACE_TOLERANCE if in_space else EXTENDED_TOLERANCE
    exact = limits or Limits(min_weight=WEIGHT_FRACTION * tolerance)

    def lights_at(value: float) -> Lights:
        return Lights.of(scene_at(value), mode, exact)

    if in_space:
        trapped = limits or Limits(min_weight=TRAPPED_WEIGHT)
        return _in_space(lights_at, value, step) or _of_samples(scene_at, value, step, mode, trapped, TRAPPED_SAMPLES)
    return _of_a_point(lights_at, value, step, tolerance) if point else _of_integrals(lights_at, value, step, tolerance)


NOISE = 1e-13
"""Rounding error of an integral that is repeated over the same pieces."""
LightsAt = Callable[[float], Lights]


def _of_a_point(lights_at: LightsAt, value: float, step: float, tolerance: float) -> Derivative:
    """Differentiate for a point source at one wavelength, over pieces that are located again in each changed scene."""
    lights = lights_at(value)
    parts: list[Parts] = []
    base = lights.trace_of([lights.in_plane.cone().integral(tolerance, MAX_SEGMENTS, parts)], tolerance)
    _check_tolerance(base, tolerance)
    names = lights.scene.receivers
    for _ in range(MAX_HALVINGS + 1):
        wide = _difference(lights_at, value, step, parts)
        narrow = _difference(lights_at, value, 0.5 * step, parts) if wide is not None else None
        if wide is not None and narrow is not None:
            return Derivative(_slopes(names, wide, narrow, NOISE / step), step, reached=True)
        step *= 0.5
    unknown = {name: Slope(math.nan, math.nan) for name in names}
    why = f"the light paths change within {step:.1e} of {value:g}"
    return Derivative(unknown, step, reached=False, why=why)


def _check_tolerance(integral: Trace, tolerance: float) -> None:
    if not integral.reached:
        raise DesignError("derivative", limit=f"the integral must reach {tolerance:g}, but {integral.why}")


def _difference(lights_at: LightsAt, value: float, step: float, parts: Sequence[Parts]) -> FloatArray | None:
    """Return the central difference of the powers, or None if a piece cannot be located again."""
    ends = []
    for sign in (1.0, -1.0):
        powers = lights_at(value + sign * step).in_plane.cone().moved(parts)
        if powers is None:
            return None
        ends.append(powers)
    return np.asarray((ends[0] - ends[1]) / (2.0 * step))


def _of_integrals(lights_at: LightsAt, value: float, step: float, tolerance: float) -> Derivative:
    """Differentiate for extended sources and for several wavelengths, with differences of complete integrals."""
    differences, u = [], 0.0
    for offset in (step, 0.5 * step):
        low, high = (lights_at(value + sign * offset).trace(tolerance, MAX_SEGMENTS) for sign in (-1.0, 1.0))
        for end in (low, high):
            _check_tolerance(end, tolerance)
        differences.append((_powers(high) - _powers(low)) / (2.0 * offset))
        u = (low.u_power + high.u_power) / (2.0 * offset)
    return Derivative(_slopes(tuple(low.detectors), differences[0], differences[1], u), step, reached=True)


def _in_space(lights_at: LightsAt, value: float, step: float) -> Derivative | None:
    """Differentiate in space with a polynomial through integrals over the same cells; None if light is trapped."""
    ends = [lights_at(value + step * offset) for offset in OFFSETS]
    names, rules = ends[0].scene.receivers, ends[0].rules
    total, fit_difference, u = np.zeros(len(names)), np.zeros(len(names)), 0.0
    for source, lights in zip(ends[0].scene.sources, zip(*(end.each for end in ends), strict=True), strict=True):
        in_space = [light for light in lights if isinstance(light, LightInSpace)]
        if len(in_space) < len(lights):
            return None
        if in_space[0].integral(TRAPPED_TOLERANCE, rules, MAX_SEGMENTS).u > TRAPPED_TOLERANCE:
            return None
        weight = source.power / ends[0].scene.emitted
        of_source = slopes(in_space, step, len(names), rules, SPACE_SEGMENTS)
        total = total + weight * of_source.value
        fit_difference = fit_difference + weight * of_source.fit_difference
        u = u + weight * of_source.u
    each = {name: Slope(float(total[i]), float(abs(fit_difference[i]) + u)) for i, name in enumerate(names)}
    return Derivative(each, step, reached=True)


def _of_samples(
    scene_at: Callable[[float], Scene],
    value: float,
    step: float,
    mode: Mode,
    limits: Limits | None,
    max_samples: int = 0,
) -> Derivative:
    """Differentiate with differences of samples; their scatter between seeds gives the error.

    Both ends of a difference use the same sample points.

    A larger step has less noise, so the step is doubled as long as the noise exceeds the effect of the function's
    curvature. If ``max_samples`` is specified, light is trapped: further samples, up to that number at each end, are
    taken with the best step. The change of the truncated power contributes to the uncertainty, because all of it might
    have reached a receiver.
    """
    names = scene_at(value).receivers

    def difference(step: float, samples: int) -> FloatArray:
        scenes = [with_rays(scene_at(value + sign * step), samples) for sign in (-1.0, 1.0)]
        low, high = (
            np.array(
                [
                    _powers_and_truncated(trace(scene, mode, limits, sampling="sobol", seed=seed))
                    for seed in range(SEEDS)
                ]
            )
            for scene in scenes
        )
        return np.asarray((high - low) / (2.0 * step))

    best: _Sampled | None = None
    narrow = difference(0.5 * step, SAMPLES)
    for doublings in range((TRAPPED_DOUBLINGS if max_samples else MAX_DOUBLINGS) + 1):
        try:
            wide = difference(step * 2.0**doublings, SAMPLES)
        except SolenError:
            if doublings == 0:
                raise
            break
        sampled = _Sampled.of(step * 2.0**doublings, narrow, wide)
        if best is None or np.max(sampled.u) < np.max(best.u):
            best = sampled
        if np.max(sampled.curvature) > np.max(sampled.noise):
            break
        narrow = wide
    if best is None:
        raise AssertionError("the first step is always evaluated")
    samples = 4 * SAMPLES
    while samples <= max_samples and np.max(best.u) > TRAPPED_ERROR * np.max(np.abs(best.value)):
        best = _Sampled.of(best.step, *(difference(factor * best.step, samples) for factor in (0.5, 1.0)))
        samples *= 4
    truncated = abs(float(best.value[-1]))
    each = {name: Slope(float(best.value[i]), float(best.u[i]) + truncated) for i, name in enumerate(names)}
    return Derivative(each, best.step, reached=True)


class _Sampled(NamedTuple):
    """Derivative from differences over a step and half a step, its standard error, and the effect of curvature."""

    step: float
    value: FloatArray
    noise: FloatArray
    curvature: FloatArray

    @classmethod
    def of(cls, step: float, narrow: FloatArray, wide: FloatArray) -> "_Sampled":
        extrapolated = (4.0 * narrow - wide) / 3.0
        noise = SAFETY * extrapolated.std(axis=0, ddof=1) / math.sqrt(SEEDS)
        return cls(step, extrapolated.mean(axis=0), noise, np.abs(np.mean(wide - narrow, axis=0)) / 3.0)

    @property
    def u(self) -> FloatArray:
        return np.asarray(self.noise + self.curvature)


def _powers(trace: Trace) -> FloatArray:
    """Return the power at each receiver."""
    return np.array([reading.power for reading in trace.detectors.values()])


def _powers_and_truncated(trace: Trace) -> FloatArray:
    """Return the power at each receiver, followed by the truncated power."""
    return np.append(_powers(trace), trace.ledger.truncated)


def _slopes(names: tuple[str, ...], wide: FloatArray, narrow: FloatArray, noise: float) -> dict[str, Slope]:
    """Extrapolate two central differences; their deviation and the noise of the powers bound the error."""
    best, deviation = (4.0 * narrow - wide) / 3.0, np.abs(narrow - wide) / 3.0
    return {name: Slope(float(best[i]), float(deviation[i] + 5.0 / 3.0 * noise)) for i, name in enumerate(names)}
