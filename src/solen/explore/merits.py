"""Figures of merit of a response, by which designs are compared, each with its uncertainty.

Between the angles of a motion, the contrast is interpolated by a cubic spline. The interpolation error is estimated
from the spline through every second angle and from kinks of the contrast, and is included in the uncertainty.
docs/explore.md defines each merit.

Public names: `merits_of`, `Merits`, `MERITS` and `unresolved_change`.
"""

import math
from collections.abc import Mapping
from dataclasses import fields

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from solen.arrays import BoolArray, FloatArray, IntArray
from solen.explore.monotone import monotone_deg
from solen.plane import deviation_from_line
from solen.readout import Readings
from solen.readout.advice import slopes_V_per_deg
from solen.results import Result
from solen.sensor.response import Response

MIN_ANGLES, POINTS_PER_STEP = 3, 8
COARSE_FRACTION = 1 / 3
"""Error of the spline through all angles, as a fraction of its difference from the spline through every second
angle.
"""
KINK_SLOPE, KINK_HEIGHT = 0.3, 0.125
"""Standard uncertainties due to a kink: of the slope, as a fraction of the change of slope, since the kink may be on
either side; and of the contrast between two angles, as a fraction of the change of slope times the step.
"""
KINK_NOISE = math.sqrt(28.0)
"""Standard deviation of the estimated change of slope, times the step, per standard deviation of the contrast."""
MAX_BEND, MAX_CHANGE = 0.5, 0.1
"""Largest changes of slope between consecutive steps, relative to the steeper slope and to the range of the
contrast. If both are exceeded, the angles are too coarse to resolve the curve.
"""
MAX_STEP_CHANGE = 0.5
"""Largest accepted change of the contrast within a step if there are too few angles to compare steps."""


class Merits(Result, eq=True):
    """Figures of merit of one response, with their uncertainties; NaN if a merit does not exist.

    Attributes
    ----------
    null_deg, u_null_deg
        Angle nearest to 0 at which the contrast is 0.
    slope_per_deg, u_slope_per_deg
        Slope of the contrast at the null.
    span, u_span
        Absolute difference of the contrast at the last and the first angle.
    linearity_percent, u_linearity_percent
        Largest deviation of the contrast from its minimax straight line, in percent of the span.
    range_deg, u_range_deg
        Length of the range about the null over which the contrast is monotonic: `solen.explore.monotone`.
    light, u_light
        Smallest fraction of the emitted power that reaches both receivers together.
    resolution_deg, u_resolution_deg
        Largest standard deviation of an angle determined from one reading of both receivers; infinite if no reading
        changes with the angle, NaN if the angles are too coarse to resolve the contrast curve.
    """

    null_deg: float
    u_null_deg: float
    slope_per_deg: float
    u_slope_per_deg: float
    span: float
    u_span: float
    linearity_percent: float
    u_linearity_percent: float
    range_deg: float
    u_range_deg: float
    light: float
    u_light: float
    resolution_deg: float = math.nan
    u_resolution_deg: float = math.nan


NAMES = tuple(field.name for field in fields(Merits))
MERITS = tuple(name for name in NAMES if not name.startswith("u_"))
CHANNEL = "light_"
"""Prefix of the merits of single channels of a network."""
_WORSE_IF_SMALL = ("slope", "span", "range", "light")
"""Prefixes of merits for which a smaller absolute value is worse; for all others, a larger value is worse."""


def merits_of(response: Response, resolution_deg: tuple[float, float] = (math.nan, math.nan)) -> Merits:
    """Return the merits of a response.

    Parameters
    ----------
    response
        Powers at three or more ascending angles.
    resolution_deg
        Worst resolution of its readings, and its uncertainty.
    """
    angle, contrast, u = response.angle_deg, response.contrast, response.u_contrast
    total = response.right + response.left
    darkest = int(np.argmin(total))
    light = float(total[darkest]), float(2.0 * response.u_power[darkest])
    if not np.isfinite(contrast).all():  # no light
        return Merits(**dict.fromkeys(NAMES, math.nan) | {"light": light[0], "u_light": light[1]})
    null, u_null, slope, u_slope = _null(angle, contrast, u)
    span, u_span = abs(float(contrast[-1] - contrast[0])), float(u[0] + u[-1])
    linearity, u_linearity = _linearity(angle, contrast)
    kinks, steps = _kinks(angle, contrast, u), np.diff(angle)
    u_linearity += KINK_HEIGHT * float((kinks * steps).max())
    unresolved = _unresolved(contrast, u)
    if unresolved.any():
        u_linearity += _largest_change(contrast, unresolved) / (2.0 * math.sqrt(3.0))
        resolution_deg = (math.nan, math.nan)
    monotone, u_monotone = monotone_deg(angle, contrast, u, null)
    return Merits(
        null_deg=null,
        u_null_deg=u_null,
        slope_per_deg=slope,
        u_slope_per_deg=u_slope,
        span=span,
        u_span=u_span,
        linearity_percent=100.0 * linearity / span if span > u_span else math.nan,
        u_linearity_percent=100.0 * (float(u.max()) + u_linearity + linearity * u_span / span) / span
        if span > u_span
        else math.nan,
        range_deg=monotone,
        u_range_deg=u_monotone,
        light=light[0],
        u_light=light[1],
        resolution_deg=resolution_deg[0],
        u_resolution_deg=resolution_deg[1],
    )


def _null(angle: FloatArray, contrast: FloatArray, u: FloatArray) -> tuple[float, float, float, float]:
    """Return the null nearest to 0 and the slope there, each with its uncertainty; NaN without a null."""
    null, slope = _root(angle, contrast)
    if math.isnan(null):
        return math.nan, math.nan, math.nan, math.nan
    second = every_second(angle.size)
    coarse_null, coarse_slope = _root(angle[second], contrast[second])
    nearest = int(np.argmin(np.abs(angle - null)))
    step = float(np.diff(angle).max())
    noise = float(u[max(0, nearest - 1) : nearest + 2].max())
    if math.isnan(coarse_null) or angle.size < 2 * MIN_ANGLES:  # too few angles to compare
        coarse_null, coarse_slope = null + step, 2.0 * slope
    after = min(max(int(np.searchsorted(angle, null)), 1), angle.size - 1)
    kink = float(_kinks(angle, contrast, u)[max(0, after - 2) : after + 1].max())
    fraction = (null - angle[after - 1]) / (angle[after] - angle[after - 1])  # the contrast is known at 0 and 1
    height = KINK_HEIGHT * kink * step * 4.0 * fraction * (1.0 - fraction)
    u_null = (noise + height) / abs(slope) + COARSE_FRACTION * abs(coarse_null - null) if slope else math.inf
    u_slope = 1.5 * noise / step + max(COARSE_FRACTION * abs(coarse_slope - slope), KINK_SLOPE * kink)
    if _unresolved(contrast, u)[after - 1 : after + 1].any():
        if abs(contrast[nearest]) > u[nearest]:  # the contrast may cross 0 anywhere between two angles
            u_null = max(u_null, float(max(null - angle[after - 1], angle[after] - null)) / math.sqrt(3.0))
        u_slope = math.inf
    return null, u_null, slope, u_slope


def _root(angle: FloatArray, contrast: FloatArray) -> tuple[float, float]:
    """Return the root nearest to 0 of the spline through a response, and the slope there; NaN without a root."""
    if angle.size < MIN_ANGLES:
        return math.nan, math.nan
    spline = CubicSpline(angle, contrast)
    roots = np.asarray(spline.roots(extrapolate=False))
    roots = roots[np.isfinite(roots)]
    if not roots.size:
        return math.nan, math.nan
    null = float(roots[np.argmin(np.abs(roots))])
    return null, float(spline(null, 1))


def _linearity(angle: FloatArray, contrast: FloatArray) -> tuple[float, float]:
    """Return the largest deviation from the minimax straight line, and its error due to the step between angles.

    Three angles of an odd response are always on a line: with fewer than five angles, the deviation may be as large as
    half the span.
    """
    dense = np.linspace(angle[0], angle[-1], POINTS_PER_STEP * (angle.size - 1) + 1)
    second = every_second(angle.size)
    fine, coarse = (
        deviation_from_line(dense, PchipInterpolator(angle[part], contrast[part])(dense)) if len(part) > 1 else 0.0
        for part in (np.arange(angle.size), second)
    )
    if second.size < MIN_ANGLES:
        return fine, 0.5 * float(np.ptp(contrast)) / math.sqrt(3.0)
    return fine, COARSE_FRACTION * abs(fine - coarse)


def _kinks(angle: FloatArray, contrast: FloatArray, u: FloatArray) -> FloatArray:
    """Return the change of slope (A - 1,) within or at the ends of each step, minus that of a smooth curve and noise.

    The change of a smooth curve is estimated from neighbouring angles; if the curvature varies linearly, the result is
    0. A spline and the comparison with every second angle do not reveal a kink at an angle that both contain.
    """
    if angle.size < 2 * MIN_ANGLES:  # too few to tell a kink from curvature
        return np.zeros(angle.size - 1)
    change = np.pad(np.diff(np.diff(contrast) / np.diff(angle)), 2, mode="edge")
    noise = KINK_NOISE * np.maximum(u[1:], u[:-1]) / np.diff(angle)
    size = np.abs(change[1:-2] + change[2:-1] - change[:-3] - change[3:])
    return np.asarray(np.maximum(size - noise, 0.0))


def _unresolved(contrast: FloatArray, u: FloatArray) -> BoolArray:
    """Return a mask of the steps (A - 1,) in which the angles (A,) do not resolve the change of slope.

    The error of a spline through such angles may be as large as the change, and comparing it with every second angle
    does not reveal this: the contrasts +1, 0, −1 are on a straight line in both.
    """
    change = np.diff(contrast)
    size = np.abs(change)
    bend, noise = np.abs(np.diff(change)), u[:-2] + 2.0 * u[1:-1] + u[2:]
    max_bend = np.maximum(MAX_BEND * np.maximum(size[1:], size[:-1]), MAX_CHANGE * float(np.ptp(contrast)))
    bends = bend > max_bend + noise
    too_few = (contrast.size < 2 * MIN_ANGLES - 1) & (size > MAX_STEP_CHANGE)
    return np.asarray(np.r_[False, bends] | np.r_[bends, False] | too_few)


def _largest_change(contrast: FloatArray, steps: BoolArray) -> float:
    """Return the largest change of the contrast within the selected steps; 0 if there are none."""
    return float(np.abs(np.diff(contrast))[steps].max(initial=0.0))


def unresolved_change(response: Response) -> float:
    """Return the largest change of the contrast within an unresolved step; 0 if all steps are resolved."""
    contrast = response.contrast
    if contrast.size < MIN_ANGLES or not np.isfinite(contrast).all():
        return 0.0
    return _largest_change(contrast, _unresolved(contrast, response.u_contrast))


def every_second(count: int) -> IntArray:
    """Return every second of ``count`` indices, and always the last."""
    return np.unique(np.r_[0:count:2, count - 1])


def worst_index(name: str, values: FloatArray) -> int:
    """Return the index of the worst of the values (C,) of a merit: NaN, otherwise the smallest or largest magnitude."""
    size = np.abs(values)
    return int(np.argmax(np.where(np.isnan(values), np.inf, -size if name.startswith(_WORSE_IF_SMALL) else size)))


def table_merits(merits: Mapping[str, object]) -> list[str]:
    """Return the names of the merits for a table, without those of single channels of a network."""
    worst = {f"worst_{name}" for name in merits}
    return [name for name in merits if not name.startswith(("u_", CHANNEL)) and name not in worst]


def worst_resolution_deg(readings: Readings) -> tuple[float, float]:
    """Return the worst resolution of one reading of all receivers, and its uncertainty; infinite if no reading changes.

    The uncertainty is due to that of the slopes, from the traced power and from the step between angles, over which
    slopes are averaged. It is infinite if it exceeds the resolution itself.
    """
    angle, slope, sd = readings.angle_deg, readings.slope_V_per_deg, readings.sd_V
    worst = np.where(np.isnan(readings.resolution_of_all_deg), np.inf, readings.resolution_of_all_deg)
    k = int(np.argmax(worst))
    if not np.isfinite(worst[k]):
        return math.inf, math.nan
    coarse = slopes_V_per_deg(angle[::2], readings.voltage_V[::2])[k // 2]
    width = angle[min(k + 1, angle.size - 1)] - angle[max(k - 1, 0)]
    u_slope = math.sqrt(2.0) * readings.u_trace_V[k] / width + COARSE_FRACTION * np.abs(coarse - slope[k])
    weight = np.abs(slope[k]) / sd[k] ** 2
    u = float(worst[k] ** 3 * (weight * u_slope).sum())
    return float(worst[k]), u if u < worst[k] else math.inf
