"""Contribution of timing to a hysteresis, and the remainder if a motion has two speeds.

If a reading belongs to a slightly earlier or later angle, rising and falling curves differ, as with hysteresis. At a
speed v, a delay τ gives a difference of −2 v τ f'(θ), where f' is the slope of the response; hysteresis of the sensor
gives H(θ) at any speed. A single speed cannot separate the two, and the timing uncertainty of the recording then bounds
the first. Two speeds give two equations for two unknowns: the difference of each cycle, projected on f', is a straight
line over speed with slope −2τ. A term that increases with speed may also be due to the material; it is called lag here.

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

_APART = 1.2  # ratio above which two speeds are distinct
_MEANT = 1.5  # ratio above which a second speed is intended, if the cycles of the first are alike
_ALIKE = 1.1  # largest ratio of speeds that are alike
_PARTS = 6  # number of parts of the range with separate lags
_MIN_CYCLES = 3  # smallest number for which the scatter about a line is defined

Source = Literal["recording", "log", "angle", "force", "depth"]


class ReceiverTiming(Result):
    """Timing of a receiver; NaN for unknown values.

    Attributes
    ----------
    timing_V, timing_percent
        Largest possible contribution of timing to the receiver's hysteresis, where its response is steepest, and in per
        cent of full scale.
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
        Timing of each receiver, by name.
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
        """Whether two speeds separate a lag from a hysteresis."""
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
        Responses of the receivers by name, in the order of the passes.
    """
    bound_s, source = bound
    fastest = float(cycles_deg_per_s.max())
    slope = np.gradient(np.column_stack([receiver.mean_V for receiver in receivers.values()]), passes.angle_deg, axis=0)
    volts = np.where(passes.clipped, np.nan, passes.volts)
    apart = volts[:, 0] - volts[:, 1]
    lag_s, u_lag_s = _lag(apart, slope, cycles_deg_per_s)
    found = {}
    for place, (name, receiver) in enumerate(receivers.items()):
        own, percent = slope[:, place], 100.0 / receiver.range_V if receiver.range_V else math.nan
        steepest = float(np.nanmax(np.abs(own), initial=0.0))
        adds = 2.0 * fastest * bound_s * steepest
        beyond = apart[..., place] + 2.0 * lag_s * cycles_deg_per_s[:, None] * own
        value, u = hysteresis_of(passes.angle_deg, beyond)[0]
        u = math.hypot(u, 2.0 * float(cycles_deg_per_s.mean()) * u_lag_s * steepest)
        found[name] = ReceiverTiming(adds, percent * adds, value, u, percent * value)
    speeds = tuple(round(one, 3) for one in _distinct(cycles_deg_per_s))
    return Timing(bound_s, source, speeds, 2.0 * fastest * bound_s, lag_s, u_lag_s, found)


def _distinct(speeds: FloatArray) -> list[float]:
    """Return the median of each group of speeds; groups differ by more than a fifth."""
    return [float(np.median(group)) for group in _groups(speeds)]


def _groups(speeds: FloatArray) -> list[FloatArray]:
    """Return the speeds in ascending order, grouped: a new group starts where the next speed is more than a fifth higher."""
    ordered = np.sort(speeds)
    return np.split(ordered, np.flatnonzero(ordered[1:] > _APART * ordered[:-1]) + 1)


def _lag(apart: FloatArray, slope: FloatArray, speeds: FloatArray) -> tuple[float, float]:
    """Return the lag of the voltages and its uncertainty, from cycle differences projected on the slope, or NaN if undetermined."""
    if len(_distinct(speeds)) < 2 or speeds.size < _MIN_CYCLES:
        return math.nan, math.nan
    held = np.isfinite(apart).all(axis=0) & np.isfinite(slope)
    scatter = np.sqrt(np.nanmean(np.nanvar(apart, axis=0, ddof=1), axis=0))
    weight = np.where(held, slope, 0.0) / np.where(scatter > 0.0, scatter, 1.0) ** 2
    total = float((weight * np.where(held, slope, 0.0)).sum())
    if not total > 0.0:
        return math.nan, math.nan
    products, squares = weight * np.where(held, apart, 0.0), weight * np.where(held, slope, 0.0)
    line = line_fit(speeds, products.sum(axis=(1, 2)) / total)
    return -0.5 * line.value, 0.5 * max(line.u, _u_of_parts(products, squares, speeds, line.value))


def _u_of_parts(products: FloatArray, squares: FloatArray, speeds: FloatArray, whole: float) -> float:
    """Return the uncertainty of a slope over speed, from the differences between parts of the range.

    Angles interpolated across the corners of a ramp are early at one end and late at the other, in the same way in
    every cycle. This is not a lag, and the scatter of the cycles does not show it.
    """
    places = np.array_split(np.arange(len(squares)), _PARTS)
    weights = np.array([squares[part].sum() for part in places])
    there = weights > 0.0
    if there.sum() < 2:
        return 0.0
    own = [
        line_fit(speeds, products[:, part].sum(axis=(1, 2)) / squares[part].sum()).value
        for part, some in zip(places, there, strict=True)
        if some
    ]
    share = weights[there] / weights.sum()
    return math.sqrt(float(share @ (np.array(own) - whole) ** 2) / (len(own) - 1))


def same_speed(speeds: FloatArray, one: float) -> BoolArray:
    """Return whether each speed belongs to the same group as the specified speed."""
    return np.asarray((speeds <= _MEANT * one) & (one <= _MEANT * speeds))


def at_main_speed(speeds: FloatArray) -> BoolArray:
    """Return whether each cycle is at the speed of most cycles, (cycles,); true for all if there is no clear second speed."""
    main = max(_groups(speeds), key=lambda group: (len(group), group[0]))
    low, high = float(main.min()), float(main.max())
    inside = (speeds >= low) & (speeds <= high)
    others = speeds[~inside]
    meant = others.size and high <= _ALIKE * low and bool(((others > _MEANT * high) | (_MEANT * others < low)).all())
    return inside if meant and 2 * inside.sum() >= speeds.size else np.ones(speeds.size, dtype=bool)


def cycle_speeds(time_s: FloatArray, angle_deg: FloatArray, motion: Motion, used: Sequence[int]) -> FloatArray:
    """Return the median speed of the ramps of each used cycle, (cycles,), or 0 if all samples are at stops."""
    if motion.stopped:
        return np.zeros(len(used))
    speeds = np.array([_speed(time_s, angle_deg, ramp) for ramp in motion.ramps])
    starts = np.array([ramp.start for ramp in motion.ramps])
    found = []
    for number in used:
        cycle = motion.cycles[number]
        own = speeds[(starts >= cycle.start - 1) & (starts < cycle.stop)]
        found.append(float(np.median(own)) if own.size else motion.speed_deg_per_s)
    return np.array(found)


def _speed(time_s: FloatArray, angle_deg: FloatArray, ramp: Ramp) -> float:
    """Return the speed in the central part of a ramp, away from its ends."""
    away = max(1, (ramp.stop - ramp.start) // 5)
    first, last = ramp.start + away, max(ramp.stop - 1 - away, ramp.start + away + 1)
    took = float(time_s[min(last, time_s.size - 1)] - time_s[first])
    return abs(float(angle_deg[min(last, time_s.size - 1)] - angle_deg[first])) / took if took > 0.0 else 0.0


def angle_bound_s(time_s: FloatArray, angle_deg: FloatArray, motion: Motion) -> float:
    """Return the largest delay of an angle in its row: half the time between new values on ramps, plus its scatter."""
    moving = np.zeros(time_s.size, dtype=bool)
    for ramp in motion.ramps:
        moving[ramp.start + 1 : ramp.stop - 1] = True
    fresh = moving & np.append(True, np.diff(angle_deg) != 0.0)
    intervals = np.diff(time_s[fresh])
    near = intervals[_within(moving, fresh)]
    if not near.size:
        return 0.0
    return 0.5 * float(np.median(near) + near.std())


def _within(moving: BoolArray, fresh: BoolArray) -> BoolArray:
    """Return whether each step from a new value to the next new value lies within a single ramp."""
    ramp = np.cumsum(np.diff(moving.astype(np.int8), prepend=0) == 1)[fresh]
    return np.asarray(np.diff(ramp) == 0)
