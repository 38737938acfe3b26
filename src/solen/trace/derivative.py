"""Derivatives of received power with respect to a parameter of the scene.

Received power is an integral over the launch angle whose integrand jumps where neighbouring rays part. When the scene
changes, the integrand changes and the jumps move; both count. The power of a wall's tilt, for one, is nearly all in the
second: to differentiate along each ray's path alone would miss it. So the scene is integrated once by
`solen.trace.integrate`, which finds the pieces between the jumps. In a scene that is changed a little every piece is
found again, its edges bisected to the last digit, and integrated at nodes that keep their share of it: Leibniz' rule,
in which what the quadrature leaves out cancels. Two steps, one half the other, are extrapolated (Richardson), and how
far they are apart bounds the error.

What a source with a size gives is smooth where that of its points is not, so that plain differences of its integral
serve: over larger steps, and to the error of the integral over the step. In space both ends of a difference are
integrated over the same cells, and the cells are halved by what the rules find of the difference. Light through a lens
whose walls are not upright is sampled instead: both ends of a difference with the same samples, several times.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.curve import check_numbers, check_range
from solen.errors import DesignError, SolenError
from solen.results import Result
from solen.scene import Scene
from solen.trace.adaptive import LEAST_SHARE, Lights, is_extended
from solen.trace.cone import Parts
from solen.trace.engine import trace
from solen.trace.nets import with_rays
from solen.trace.result import Limits, Mode, Trace
from solen.trace.space import LightInSpace

TOLERANCE, EXTENDED_TOLERANCE, SPACE_TOLERANCE = 1e-9, 1e-6, 1e-4
RELATIVE_STEP, EXTENDED_STEP, SPACE_STEP, POINT_STEP_IN_SPACE = 2e-4, 1e-2, 5e-3, 1e-3
MOST_HALVINGS = 6
MOST_LEGS, SPACE_LEGS = 400_000, 20_000_000
SEEDS, SAMPLES, MOST_DOUBLINGS = 8, 2**15, 4
"""Independent differences of sampled light, the rays of each end of one, and how often a step is doubled at most."""
CAUTION = 1.25
"""Factor on their standard error: it is of few differences, and the step with the smallest one is taken."""
TRAPPED_TOLERANCE = 3e-4
"""Of integrals of light that is trapped: they are sampled in part, and dear."""
WIDENING, MOST_WIDENINGS, CHANGE, PILOT = 2.0, 5, 0.04, 1e-3
"""Of steps over which trapped light is compared: factor, how many times at most, the change of a power that is wanted,
and the tolerance of what looks for it."""
ROUGH = 1e-2
"""Tolerance that light in space reaches at once, unless it is trapped."""


@dataclass(frozen=True)
class Slope:
    """Change of a power per unit of the parameter, and an estimate of its error."""

    value: float
    u_value: float


class Derivative(Result):
    """Derivatives of every receiver's power, as fractions of the emitted power per unit of the parameter.

    ``step`` is the larger of the steps taken. ``reached`` is False where the pieces could not be followed: at that very
    value of the parameter the light changes its ways; ``why`` says so.
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
    """Derivative of the power at every receiver with respect to one parameter.

    Parameters
    ----------
    scene_at
        The scene for a value of the parameter, as `solen.trace.integrate` takes it.
    value
        Where the derivative is taken.
    step
        Largest change of the parameter; by default 2e-4 of ``value`` or, at 0, 2e-4; for sources with a size or several
        colours 1e-2, in space 5e-3, and for a point there 1e-3. Where light is trapped in space it is widened until
        powers change by some hundredths. For a point source in the plane it is halved, up to six times, where the
        light's ways change within it.
    mode, tolerance, limits
        As in `solen.trace.integrate`, for the integral at ``value``; by default a tolerance of 1e-9, of 1e-6 for
        sources with a size or several colours, and in space of 1e-4, or 3e-4 where light is trapped.

    Returns
    -------
    Derivative
        One `Slope` per receiver; NaN where it could not be found.

    Raises
    ------
    DesignError
        As `solen.trace.integrate`, a step that is not above 0, or an integral that does not reach its tolerance.
    """
    check_numbers("parameter", value)
    scene = scene_at(value)
    point = not is_extended(scene) and scene.extrusion is None
    given = step is not None
    if step is None:
        cylinder = scene.extrusion is not None and scene.front is None
        small = POINT_STEP_IN_SPACE if not is_extended(scene) else SPACE_STEP if cylinder else EXTENDED_STEP
        step = (RELATIVE_STEP if point else small) * (abs(value) or 1.0)
    check_range("step", step, above=0.0)
    trapped = TRAPPED_TOLERANCE if tolerance is None else tolerance
    if tolerance is None:
        tolerance = TOLERANCE if point else EXTENDED_TOLERANCE if scene.extrusion is None else SPACE_TOLERANCE
    if scene.front is not None:
        return _of_samples(scene_at, value, step, mode, limits)
    limits = limits or Limits(min_weight=LEAST_SHARE * tolerance)

    def at(value: float) -> Lights:
        return Lights.of(scene_at(value), mode, limits)

    if scene.extrusion is not None:
        return _in_space(at, value, step, trapped, given)
    return _of_a_point(at, value, step, tolerance) if point else _of_integrals(at, value, step, tolerance)


NOISE = 1e-13
"""What rounding leaves of an integral over the same pieces."""
At = Callable[[float], Lights]


def _of_a_point(at: At, value: float, step: float, tolerance: float) -> Derivative:
    """Derivative for a point source in one colour, over pieces that are found again."""
    lights = at(value)
    parts: list[Parts] = []
    base = lights.trace_of([lights.in_plane.cone().integral(tolerance, MOST_LEGS, parts)], tolerance)
    if not base.reached:
        raise DesignError("derivative", value=base.why, limit=f"the integral must reach {tolerance:g}")
    names = lights.scene.receivers
    for _ in range(MOST_HALVINGS + 1):
        wide = _difference(at, value, step, parts)
        close = _difference(at, value, 0.5 * step, parts) if wide is not None else None
        if wide is not None and close is not None:
            return Derivative(_slopes(names, wide, close, NOISE / step), step, reached=True)
        step *= 0.5
    nothing = {name: Slope(math.nan, math.nan) for name in names}
    why = f"the paths of light change within {step:.1e} of {value:g}"
    return Derivative(nothing, step, reached=False, why=why)


def _difference(at: At, value: float, step: float, parts: Sequence[Parts]) -> FloatArray | None:
    """Central difference of the powers, None if a piece is not found again."""
    ends = []
    for sign in (1.0, -1.0):
        powers = at(value + sign * step).in_plane.cone().again(parts)
        if powers is None:
            return None
        ends.append(powers)
    return np.asarray((ends[0] - ends[1]) / (2.0 * step))


def _of_integrals(at: At, value: float, step: float, tolerance: float) -> Derivative:
    """Derivative for sources with a size or several colours, by differences of whole integrals."""
    differences, u = [], 0.0
    for half in (step, 0.5 * step):
        low, high = (at(value + sign * half).trace(tolerance, MOST_LEGS) for sign in (-1.0, 1.0))
        for end in (low, high):
            if not end.reached:
                raise DesignError("derivative", value=end.why, limit=f"the integral must reach {tolerance:g}")
        differences.append((_powers(high) - _powers(low)) / (2.0 * half))
        u = (low.u_power + high.u_power) / (2.0 * half)
    return Derivative(_slopes(tuple(low.detectors), differences[0], differences[1], u), step, reached=True)


def _in_space(at: At, value: float, step: float, tolerance: float, given: bool) -> Derivative:
    """Derivative in space: two differences over the same cells; of whole integrals where light is trapped.

    Those have samples in them, so that they are taken over larger steps, unless the step is ``given``, and reach the
    ``tolerance``.
    """
    ends = {sign: at(value + sign * step) for sign in (-1.0, -0.5, 0.5, 1.0)}
    each = list(zip(*(ends[sign].each for sign in ends), strict=True))
    weights = [source.power / ends[1.0].scene.emitted for source in ends[1.0].scene.sources]
    names, rules = ends[1.0].scene.receivers, ends[1.0].rules
    wide, close, u = np.zeros(len(names)), np.zeros(len(names)), 0.0
    for (low, half_low, half_high, high), weight in zip(each, weights, strict=True):
        lights = [light for light in (low, half_low, half_high, high) if isinstance(light, LightInSpace)]
        if len(lights) < 4 or lights[3].integral(ROUGH, rules, MOST_LEGS).u > ROUGH:
            wide_step = step if given else _widened(at, value, WIDENING * step)
            return _of_integrals(at, value, wide_step, tolerance)
        slopes = lights[3].slopes(lights[0], step, rules, SPACE_LEGS)
        wide += weight * slopes.value[: len(names)]
        close += weight * lights[2].slopes_again(lights[1], 0.5 * step, rules, slopes)[: len(names)]
        u += weight * slopes.u
    return Derivative(_slopes(names, wide, close, u), step, reached=True)


def _widened(at: At, value: float, step: float) -> float:
    """A larger step, over which powers change by many times what sampled integrals are off by, as far as can be."""
    for _ in range(MOST_WIDENINGS):
        try:
            low, high = (_powers(at(value + sign * step).trace(PILOT)) for sign in (-1.0, 1.0))
            at(value + WIDENING * step), at(value - WIDENING * step)
        except SolenError:
            return step
        if np.max(np.abs(high - low)) > CHANGE / WIDENING:
            return step
        step *= WIDENING
    return step


def _of_samples(
    scene_at: Callable[[float], Scene], value: float, step: float, mode: Mode, limits: Limits | None
) -> Derivative:
    """Derivative by differences of samples: both ends take the same points, and the spread over seeds is the error.

    A longer step has less noise; it is doubled as long as that is more than what the function bends within it.
    """
    names = scene_at(value).receivers

    def difference(step: float) -> FloatArray:
        scenes = [with_rays(scene_at(value + sign * step), SAMPLES) for sign in (-1.0, 1.0)]
        low, high = (
            np.array([_powers(trace(scene, mode, limits, sampling="sobol", seed=seed)) for seed in range(SEEDS)])
            for scene in scenes
        )
        return np.asarray((high - low) / (2.0 * step))

    best, wide, least = np.zeros(len(names)), step, np.full(len(names), math.inf)
    near = difference(0.5 * step)
    for doubled in range(MOST_DOUBLINGS + 1):
        try:
            far = difference(step * 2.0**doubled)
        except SolenError:
            if doubled == 0:
                raise
            break
        each = (4.0 * near - far) / 3.0
        noise, bent = CAUTION * each.std(axis=0, ddof=1) / math.sqrt(SEEDS), np.abs(np.mean(far - near, axis=0)) / 3.0
        if np.max(noise + bent) < np.max(least):
            best, wide, least = each.mean(axis=0), step * 2.0**doubled, noise + bent
        if np.max(bent) > np.max(noise):
            break
        near = far
    slopes = {name: Slope(float(best[i]), float(least[i])) for i, name in enumerate(names)}
    return Derivative(slopes, wide, reached=True)


def _powers(found: Trace) -> FloatArray:
    """Power of every receiver."""
    return np.array([reading.power for reading in found.detectors.values()])


def _slopes(names: tuple[str, ...], wide: FloatArray, close: FloatArray, noise: float) -> dict[str, Slope]:
    """Two central differences, extrapolated; how far they are apart, and the noise of the numbers, bound the error."""
    best, apart = (4.0 * close - wide) / 3.0, np.abs(close - wide) / 3.0
    return {name: Slope(float(best[i]), float(apart[i] + 5.0 / 3.0 * noise)) for i, name in enumerate(names)}
