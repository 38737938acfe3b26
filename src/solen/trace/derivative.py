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
walls are not vertical, and light that is trapped in space, is sampled instead: both ends of each difference use the
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
from solen.trace.adaptive import MIN_SHARE, Lights, is_extended
from solen.trace.cone import Parts
from solen.trace.engine import trace
from solen.trace.nets import with_rays
from solen.trace.result import Limits, Mode, Trace
from solen.trace.slopes import OFFSETS, slopes
from solen.trace.space import LightInSpace

TOLERANCE, EXTENDED_TOLERANCE, SPACE_TOLERANCE = 1e-9, 1e-6, 1e-4
RELATIVE_STEP, EXTENDED_STEP, CHIP_STEP = 2e-4, 1e-2, 2e-2
MAX_HALVINGS = 6
MAX_LEGS, SPACE_LEGS = 400_000, 15_000_000
SEEDS, SAMPLES, MAX_DOUBLINGS = 8, 2**15, 4
"""For sampled light: number of independent differences, number of rays at each end of a difference, and maximum
number of times that the step is doubled.
"""
TRAPPED_SAMPLES, TRAPPED_SHARE, TRAPPED_WEIGHT, TRAPPED_DOUBLINGS = 2**17, 1e-3, 3e-4, 1
"""For trapped light: maximum number of rays at each end of a difference, accepted error as a fraction of the largest
slope, weight below which light is not followed, and number of times that the step is doubled. With
steps of 16 % of a refractive index, the true error was four times the reported one.
"""
CAUTION = 1.25
"""Safety factor on the standard error of the differences, because these are few and the step with the smallest error is
chosen.
"""
ROUGH = 1e-2
"""Tolerance that light in space reaches immediately unless it is trapped."""


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
    exact = limits or Limits(min_weight=MIN_SHARE * tolerance)

    def at(value: float) -> Lights:
        return Lights.of(scene_at(value), mode, exact)

    if in_space:
        rest = limits or Limits(min_weight=TRAPPED_WEIGHT)
        return _in_space(at, value, step) or _of_samples(scene_at, value, step, mode, rest, TRAPPED_SAMPLES)
    return _of_a_point(at, value, step, tolerance) if point else _of_integrals(at, value, step, tolerance)


NOISE = 1e-13
"""Rounding error of an integral over the same pieces."""
At = Callable[[float], Lights]


def _of_a_point(at: At, value: float, step: float, tolerance: float) -> Derivative:
    """Differentiate for a point source at one wavelength, over pieces that are located again in each changed scene."""
    lights = at(value)
    parts: list[Parts] = []
    base = lights.trace_of([lights.in_plane.cone().integral(tolerance, MAX_LEGS, parts)], tolerance)
    if not base.reached:
        raise DesignError("derivative", value=base.why, limit=f"the integral must reach {tolerance:g}")
    names = lights.scene.receivers
    for _ in range(MAX_HALVINGS + 1):
        wide = _difference(at, value, step, parts)
        close = _difference(at, value, 0.5 * step, parts) if wide is not None else None
        if wide is not None and close is not None:
            return Derivative(_slopes(names, wide, close, NOISE / step), step, reached=True)
        step *= 0.5
    nothing = {name: Slope(math.nan, math.nan) for name in names}
    why = f"the light paths change within {step:.1e} of {value:g}"
    return Derivative(nothing, step, reached=False, why=why)


def _difference(at: At, value: float, step: float, parts: Sequence[Parts]) -> FloatArray | None:
    """Return the central difference of the powers, or None if a piece cannot be located again."""
    ends = []
    for sign in (1.0, -1.0):
        powers = at(value + sign * step).in_plane.cone().again(parts)
        if powers is None:
            return None
        ends.append(powers)
    return np.asarray((ends[0] - ends[1]) / (2.0 * step))


def _of_integrals(at: At, value: float, step: float, tolerance: float) -> Derivative:
    """Differentiate for extended sources and for several wavelengths, with differences of complete integrals."""
    differences, u = [], 0.0
    for half in (step, 0.5 * step):
        low, high = (at(value + sign * half).trace(tolerance, MAX_LEGS) for sign in (-1.0, 1.0))
        for end in (low, high):
            if not end.reached:
                raise DesignError("derivative", value=end.why, limit=f"the integral must reach {tolerance:g}")
        differences.append((_powers(high) - _powers(low)) / (2.0 * half))
        u = (low.u_power + high.u_power) / (2.0 * half)
    return Derivative(_slopes(tuple(low.detectors), differences[0], differences[1], u), step, reached=True)


def _in_space(at: At, value: float, step: float) -> Derivative | None:
    """Differentiate in space with a polynomial through integrals over the same cells; None if light is trapped."""
    ends = [at(value + step * offset) for offset in OFFSETS]
    names, rules = ends[0].scene.receivers, ends[0].rules
    best, bent, u = np.zeros(len(names)), np.zeros(len(names)), 0.0
    for source, lights in zip(ends[0].scene.sources, zip(*(end.each for end in ends), strict=True), strict=True):
        in_space = [light for light in lights if isinstance(light, LightInSpace)]
        if len(in_space) < len(lights) or in_space[0].integral(ROUGH, rules, MAX_LEGS).u > ROUGH:
            return None
        weight = source.power / ends[0].scene.emitted
        found = slopes(in_space, step, len(names), rules, SPACE_LEGS)
        best, bent, u = best + weight * found.value, bent + weight * found.bent, u + weight * found.u
    each = {name: Slope(float(best[i]), float(abs(bent[i]) + u)) for i, name in enumerate(names)}
    return Derivative(each, step, reached=True)


def _of_samples(
    scene_at: Callable[[float], Scene], value: float, step: float, mode: Mode, limits: Limits | None, most: int = 0
) -> Derivative:
    """Differentiate with differences of samples; their scatter between seeds gives the error.

    Both ends of a difference use the same sample points.

    A larger step has less noise, so the step is doubled as long as the noise exceeds the effect of the function's
    curvature. Further samples are added at the best step, up to ``most`` at each end. The change of the truncated power
    contributes to the uncertainty, because all of it might have reached a receiver.
    """
    names = scene_at(value).receivers

    def difference(step: float, samples: int) -> FloatArray:
        scenes = [with_rays(scene_at(value + sign * step), samples) for sign in (-1.0, 1.0)]
        low, high = (
            np.array([_and_cut_off(trace(scene, mode, limits, sampling="sobol", seed=seed)) for seed in range(SEEDS)])
            for scene in scenes
        )
        return np.asarray((high - low) / (2.0 * step))

    best: _Sampled | None = None
    near = difference(0.5 * step, SAMPLES)
    for doubled in range((TRAPPED_DOUBLINGS if most else MAX_DOUBLINGS) + 1):
        try:
            far = difference(step * 2.0**doubled, SAMPLES)
        except SolenError:
            if doubled == 0:
                raise
            break
        found = _Sampled.of(step * 2.0**doubled, near, far)
        if best is None or np.max(found.u) < np.max(best.u):
            best = found
        if np.max(found.bent) > np.max(found.noise):
            break
        near = far
    if best is None:
        raise AssertionError("the first step is always evaluated")
    samples = 4 * SAMPLES
    while samples <= most and np.max(best.u) > TRAPPED_SHARE * np.max(np.abs(best.value)):
        best = _Sampled.of(best.step, *(difference(share * best.step, samples) for share in (0.5, 1.0)))
        samples *= 4
    cut_off = abs(float(best.value[-1]))
    each = {name: Slope(float(best.value[i]), float(best.u[i]) + cut_off) for i, name in enumerate(names)}
    return Derivative(each, best.step, reached=True)


class _Sampled(NamedTuple):
    """Derivative from differences over a step and half a step, its standard error, and the effect of curvature."""

    step: float
    value: FloatArray
    noise: FloatArray
    bent: FloatArray

    @classmethod
    def of(cls, step: float, near: FloatArray, far: FloatArray) -> "_Sampled":
        each = (4.0 * near - far) / 3.0
        noise, bent = CAUTION * each.std(axis=0, ddof=1) / math.sqrt(SEEDS), np.abs(np.mean(far - near, axis=0)) / 3.0
        return cls(step, each.mean(axis=0), noise, bent)

    @property
    def u(self) -> FloatArray:
        return np.asarray(self.noise + self.bent)


def _powers(found: Trace) -> FloatArray:
    """Return the power at each receiver."""
    return np.array([reading.power for reading in found.detectors.values()])


def _and_cut_off(found: Trace) -> FloatArray:
    """Return the power at each receiver, followed by the truncated power."""
    return np.append(_powers(found), found.ledger.truncated)


def _slopes(names: tuple[str, ...], wide: FloatArray, close: FloatArray, noise: float) -> dict[str, Slope]:
    """Extrapolate two central differences; their deviation and the noise of the powers bound the error."""
    best, apart = (4.0 * close - wide) / 3.0, np.abs(close - wide) / 3.0
    return {name: Slope(float(best[i]), float(apart[i] + 5.0 / 3.0 * noise)) for i, name in enumerate(names)}
