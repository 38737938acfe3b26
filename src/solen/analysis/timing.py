"""Contribution of timing errors to the measured hysteresis, and the hysteresis without it from cycles at two speeds.

If a reading was taken slightly before or after its angle, rising and falling curves differ, as with hysteresis. At a
speed v, a delay τ of the voltages causes a difference of −2 v τ f'(θ), where f' is the slope of the response, whereas
hysteresis of the sensor causes the same difference H(θ) at any speed. With a single speed, the two cannot be separated;
the timing uncertainty of the recording then gives an upper limit of the delay. With two speeds, they can be separated:
the difference in each cycle, projected on f', is a straight line over speed with slope −2τ. The delay found in this
way, called lag, may also be due to the material.

Public names: `timing_of` and `Timing`.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from solen.analysis.figures_of_merit import ReceiverResponse, hysteresis_of, line_fit
from solen.analysis.motion import Motion, Ramp
from solen.analysis.response import Passes
from solen.arrays import BoolArray, FloatArray
from solen.results import Result

_MIN_DISTINCT = 1.2  # ratio above which two speeds are distinct
_MIN_INTENDED = 1.5  # ratio above which a second speed is intended, if the cycles at the first have similar speeds
_MAX_SIMILAR = 1.1  # largest ratio of similar speeds
_PARTS = 6  # number of parts of the range with separate lags
_MIN_CYCLES = 3  # with fewer, the scatter about a straight line is undefined

Source = Literal["recording", "log", "angle", "force", "depth"]


class ReceiverTiming(Result):
    """Timing of a receiver; NaN for unknown values.

    Attributes
    ----------
    timing_V, timing_percent
        Largest possible contribution of timing to the receiver's hysteresis, where its response is steepest; also in
        per cent of full scale.
    hysteresis_V, u_hysteresis_V, hysteresis_percent
        Hysteresis without the lag, from two speeds.
    """

    timing_V: float
    timing_percent: float
    hysteresis_V: float
    u_hysteresis_V: float
    hysteresis_percent: float


class Timing(Result):
    """Timing of a sensor's recordings.

    Attributes
    ----------
    bound_s
        Largest time difference between angles and readings, in either direction.
    source
        Source of the bound: the ``recording`` itself, an aligned ``log``, or the interval at which the ``angle``
        changes.
    speeds_deg_per_s
        Distinct speeds of all cycles used for timing.
    timing_deg
        Largest possible contribution of timing to the difference between the directions, at the highest speed.
    lag_s, u_lag_s
        Delay of the voltages relative to their angles, from two speeds; NaN for a single speed.
    receivers
        Timing of each receiver, keyed by name.
    """

    bound_s: float
    source: Source
    speeds_deg_per_s: tuple[float, ...]
    timing_deg: float
    lag_s: float
    u_lag_s: float
    receivers: dict[str, ReceiverTiming]

    @property
    def separated(self) -> bool:
        """Whether two speeds separate lag from hysteresis."""
        return math.isfinite(self.u_lag_s)


def timing_of(
    passes: Passes,
    cycles_deg_per_s: FloatArray,
    bound: tuple[float, Source],
    receivers: Mapping[str, ReceiverResponse],
) -> Timing:
    """Determine the timing of a sensor.

    Parameters
    ----------
    passes
        Half-cycles of the sensor.
    cycles_deg_per_s
        Speed of each cycle, (cycles,).
    bound
        Largest time difference between angles and readings, in s, and its source.
    receivers
        Responses of the receivers, keyed by name, in the order of the passes.
    """
    bound_s, source = bound
    fastest = float(cycles_deg_per_s.max())
    slope = np.gradient(np.column_stack([receiver.mean_V for receiver in receivers.values()]), passes.angle_deg, axis=0)
    volts = np.where(passes.clipped, np.nan, passes.volts)
    difference = volts[:, 0] - volts[:, 1]
    lag_s, u_lag_s = _lag(difference, slope, cycles_deg_per_s)
    timings = {}
    for index, (name, receiver) in enumerate(receivers.items()):
        percent = 100.0 / receiver.range_V if receiver.range_V else math.nan
        steepest = float(np.nanmax(np.abs(slope[:, index]), initial=0.0))
        timing_V = 2.0 * fastest * bound_s * steepest
        remainder = difference[..., index] + 2.0 * lag_s * cycles_deg_per_s[:, None] * slope[:, index]
        value, u = hysteresis_of(passes.angle_deg, remainder)[0]
        u = math.hypot(u, 2.0 * float(cycles_deg_per_s.mean()) * u_lag_s * steepest)
        timings[name] = ReceiverTiming(timing_V, percent * timing_V, value, u, percent * value)
    speeds = tuple(round(float(np.median(group)), 3) for group in _groups(cycles_deg_per_s))
    return Timing(bound_s, source, speeds, 2.0 * fastest * bound_s, lag_s, u_lag_s, timings)


def _groups(speeds: FloatArray) -> list[FloatArray]:
    """Return the speeds in ascending order, split wherever the next speed is more than a fifth higher."""
    ordered = np.sort(speeds)
    return np.split(ordered, np.flatnonzero(ordered[1:] > _MIN_DISTINCT * ordered[:-1]) + 1)


def _lag(difference: FloatArray, slope: FloatArray, speeds: FloatArray) -> tuple[float, float]:
    """Return the lag of the voltages and its uncertainty, from differences projected on the slope; NaN if unknown."""
    if len(_groups(speeds)) < 2 or speeds.size < _MIN_CYCLES:
        return math.nan, math.nan
    scatter = np.sqrt(np.nanmean(np.nanvar(difference, axis=0, ddof=1), axis=0))
    known = np.isfinite(difference).all(axis=0) & np.isfinite(slope)
    slope, difference = np.where(known, slope, 0.0), np.where(known, difference, 0.0)
    weight = slope / np.where(scatter > 0.0, scatter, 1.0) ** 2
    products, squares = weight * difference, weight * slope
    total = float(squares.sum())
    if not total > 0.0:
        return math.nan, math.nan
    line = line_fit(speeds, products.sum(axis=(1, 2)) / total)
    return -0.5 * line.value, 0.5 * max(line.u, _u_of_parts(products, squares, speeds, line.value))


def _u_of_parts(products: FloatArray, squares: FloatArray, speeds: FloatArray, mean_slope: float) -> float:
    """Return the uncertainty of a slope over speed, from the differences between parts of the range.

    Angles interpolated across the corners of a ramp are early at one end and late at the other, in the same way in
    every cycle. This is not a lag, and the scatter of the cycles does not show it.
    """
    rows = [part for part in np.array_split(np.arange(len(squares)), _PARTS) if squares[part].sum() > 0.0]
    if len(rows) < 2:
        return 0.0
    weights = np.array([squares[part].sum() for part in rows])
    slopes = [line_fit(speeds, products[:, part].sum(axis=(1, 2)) / squares[part].sum()).value for part in rows]
    return math.sqrt(float(weights @ (np.array(slopes) - mean_slope) ** 2) / weights.sum() / (len(rows) - 1))


def same_speed(speeds: FloatArray, speed: float) -> BoolArray:
    """Return whether each speed is so close to ``speed`` that it is not an intended second speed."""
    return np.asarray((speeds <= _MIN_INTENDED * speed) & (speed <= _MIN_INTENDED * speeds))


def at_main_speed(speeds: FloatArray) -> BoolArray:
    """Return whether each cycle is at the speed of most cycles, (cycles,); all True without a clear second speed."""
    main = max(_groups(speeds), key=lambda group: (len(group), group[0]))
    low, high = float(main.min()), float(main.max())
    inside = (speeds >= low) & (speeds <= high)
    others = speeds[~inside]
    distinct = bool(((others > _MIN_INTENDED * high) | (_MIN_INTENDED * others < low)).all())
    intended = others.size > 0 and high <= _MAX_SIMILAR * low and distinct
    return inside if intended and 2 * inside.sum() >= speeds.size else np.ones(speeds.size, dtype=bool)


def cycle_speeds(time_s: FloatArray, angle_deg: FloatArray, motion: Motion, used: Sequence[int]) -> FloatArray:
    """Return the median speed of the ramps of each used cycle, (cycles,), or 0 if all samples are at stops."""
    if motion.stopped:
        return np.zeros(len(used))
    speeds = np.array([_speed(time_s, angle_deg, ramp) for ramp in motion.ramps])
    starts = np.array([ramp.start for ramp in motion.ramps])
    medians = []
    for cycle in (motion.cycles[index] for index in used):
        of_cycle = speeds[(starts >= cycle.start - 1) & (starts < cycle.stop)]
        medians.append(float(np.median(of_cycle)) if of_cycle.size else motion.speed_deg_per_s)
    return np.array(medians)


def _speed(time_s: FloatArray, angle_deg: FloatArray, ramp: Ramp) -> float:
    """Return the speed in the central part of a ramp."""
    margin = max(1, (ramp.stop - ramp.start) // 5)
    first = ramp.start + margin
    last = min(max(ramp.stop - 1 - margin, first + 1), time_s.size - 1)
    duration = float(time_s[last] - time_s[first])
    return abs(float(angle_deg[last] - angle_deg[first])) / duration if duration > 0.0 else 0.0


def angle_bound_s(time_s: FloatArray, angle_deg: FloatArray, motion: Motion) -> float:
    """Return the largest delay of a recorded angle: half the interval at which it changes in ramps, plus scatter."""
    moving = np.zeros(time_s.size, dtype=bool)
    for ramp in motion.ramps:
        moving[ramp.start + 1 : ramp.stop - 1] = True
    changed = moving & np.append(True, np.diff(angle_deg) != 0.0)
    ramp_number = np.cumsum(np.diff(moving.astype(np.int8), prepend=0) == 1)[changed]
    intervals = np.diff(time_s[changed])[np.diff(ramp_number) == 0]
    return 0.5 * float(np.median(intervals) + intervals.std()) if intervals.size else 0.0
