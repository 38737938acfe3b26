"""A stage's log on another clock: how far it is off, how fast it runs off, and how well both are known.

The idea: a receiver's voltage is a function of the angle, whatever that function is. Shifted against each other, the
log and the voltages disagree: rising and falling ways show two curves. The shift is found roughly by cross-correlation,
then by least squares: with f the mean curve, a shift by δ changes the voltage by f'(θ) θ' δ, which has opposite signs
on both ways, so that f and δ are told apart. Each cycle gives its own shift; a line through them over time gives lag
and rate of the clock, its residuals their uncertainties.

A hysteresis that does not depend on speed looks the same: on ways of one speed v, a lag δ shows f' v δ between them. A
log on another clock therefore cannot show a sensor's hysteresis, and whoever uses the result must say so.

The interface: `align` gives an `Alignment`, whose `angle_deg` is the log's angle at the recorder's times.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import fftconvolve

from solen.analysis.motion import Motion, find_motion
from solen.errors import DataError
from solen.recording.model import FloatArray

_CELLS = 64
_ROUNDS = 12
_LEAST_CORRELATION = 0.3
_RIVAL = 0.97  # share of the highest correlation from which on another shift could be meant as well
_AGREE_S = 1.0  # clocks that differ by less were set by one another
_MOST = 1 << 20
_INNER = 0.05  # share of the range at each end where a curve's slope is not known well


@dataclass(frozen=True)
class Alignment:
    """What a log's clock reads beside the recorder's.

    Attributes
    ----------
    lag_s, u_lag_s
        Log's time less the recorder's in the middle of the recording, and its standard uncertainty (NaN for less than
        three cycles).
    rate_ppm, u_rate_ppm
        How much faster the log's clock runs; 0 where it is not resolved (three uncertainties).
    angle_deg
        Angle at the recorder's times, NaN outside the log, (n,).
    warnings
        What cannot be concluded.
    """

    lag_s: float
    u_lag_s: float
    rate_ppm: float
    u_rate_ppm: float
    angle_deg: FloatArray
    warnings: tuple[str, ...]


def align(time_s: FloatArray, volts: FloatArray, log_s: FloatArray, log_deg: FloatArray) -> Alignment:
    """Lag and rate of a log's clock against a recorder's.

    Parameters
    ----------
    time_s, volts
        The recording, (n,) and (n, m).
    log_s, log_deg
        The log, (k,), whose times never fall.

    Raises
    ------
    DataError
        Where the log shows no cycles, or the voltages do not follow it.
    """
    motion = find_motion(log_s, log_deg)
    coarse, rivals = _coarse(time_s, principal(volts), log_s, log_deg)
    middle = 0.5 * float(time_s[0] + time_s[-1])
    lag, rate = coarse, 0.0
    for _ in range(_ROUNDS):
        when, shifts, weights = _shifts(time_s, volts, log_s, log_deg, motion, (lag, rate, middle))
        if not when.size:
            limit = "covers no whole cycle of the recording"
            raise DataError("angle of the log", limit=limit, remedy="check that both are of the same test")
        step = float(np.average(shifts, weights=weights))
        lag += step
        if abs(step) < 1e-7:
            break
    u_lag, slope, u_slope = _line(when - middle, shifts, weights)
    if math.isfinite(u_slope) and abs(slope) > 3.0 * u_slope:
        rate = slope
        for _ in range(3):
            when, shifts, weights = _shifts(time_s, volts, log_s, log_deg, motion, (lag, rate, middle))
            lag += float(np.average(shifts, weights=weights))
            rate += _line(when - middle, shifts, weights)[1]
        u_lag, _, u_slope = _line(when - middle, shifts, weights)
    shown = _at(time_s, log_s, log_deg, (lag, rate, middle))
    words = _words(lag, u_lag, rivals, motion.speed_deg_per_s, time_s, shown)
    return Alignment(lag, u_lag, 1e6 * rate, 1e6 * u_slope, shown, words)


def principal(volts: FloatArray) -> FloatArray:
    """What receivers have most in common, each scaled by its spread, (n,)."""
    centred = volts - np.median(volts, axis=0)
    spread = centred.std(axis=0)
    scaled = centred / np.where(spread > 0.0, spread, 1.0)
    _, axes = np.linalg.eigh(scaled.T @ scaled)
    return np.asarray(scaled @ axes[:, -1])


def _coarse(
    time_s: FloatArray, signal: FloatArray, log_s: FloatArray, log_deg: FloatArray
) -> tuple[float, tuple[float, ...]]:
    """Shift of the highest cross-correlation, and others that are nearly as high."""
    spans = float(np.ptp(time_s)), float(np.ptp(log_s))
    steps = [float(np.median(np.diff(times))) for times in (time_s, log_s)]
    even_s = max(*steps, max(spans) / _MOST, 1e-6)
    ours = np.interp(np.arange(time_s[0], time_s[-1], even_s), time_s, signal)
    theirs = np.interp(np.arange(log_s[0], log_s[-1], even_s), log_s, log_deg)
    ours, theirs = ours - ours.mean(), theirs - theirs.mean()
    found = fftconvolve(theirs, ours[::-1])
    norm = math.sqrt(float(ours @ ours) * float(theirs @ theirs))
    height = np.abs(found) / norm if norm > 0.0 else np.zeros(found.size)
    best = int(np.argmax(height))
    overlap = math.sqrt(max(spans) / min(spans))
    if height[best] * overlap < _LEAST_CORRELATION:
        limit = f"does not go with the voltages (correlation {height[best]:.2f} at best)"
        raise DataError("angle of the log", limit=limit, remedy="check that both are of the same test")
    lags = (np.arange(found.size) - (ours.size - 1)) * even_s + log_s[0] - time_s[0]
    peaks = np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:])) + 1
    others = [int(n) for n in peaks if height[n] > _RIVAL * height[best] and abs(n - best) > 2]
    nearest = min([best, *others], key=lambda n: abs(float(lags[n])))
    if abs(float(lags[nearest])) < _AGREE_S:  # a motion repeats: clocks that nearly agree are no whole cycles apart
        best, others = nearest, [best, *others]
    rivals = [float(lags[n]) for n in others if n != best]
    return float(lags[best]), tuple(sorted(rivals, key=lambda lag: abs(lag - float(lags[best])))[:1])


_Clock = tuple[float, float, float]


def _at(time_s: FloatArray, log_s: FloatArray, log_deg: FloatArray, clock: _Clock) -> FloatArray:
    lag, rate, middle = clock
    times = time_s + lag + rate * (time_s - middle)
    return np.asarray(np.interp(times, log_s, log_deg, left=np.nan, right=np.nan))


def _shifts(
    time_s: FloatArray, volts: FloatArray, log_s: FloatArray, log_deg: FloatArray, motion: Motion, clock: _Clock
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Shift that each cycle asks for beyond a clock's: its time, shift and weight."""
    lag, rate, middle = clock
    angle = _at(time_s, log_s, log_deg, clock)
    speed = np.gradient(angle, time_s) if np.all(np.diff(time_s) > 0.0) else _speed(time_s, angle)
    reach = motion.high_deg - motion.low_deg
    inner = np.abs(angle - 0.5 * (motion.high_deg + motion.low_deg)) < (0.5 - _INNER) * reach
    moving = inner & (np.abs(speed) > 0.3 * motion.speed_deg_per_s)
    rest, change = _linearised(angle, speed, volts, moving, motion)
    edges = np.array([[cycle.start_s, cycle.end_s] for cycle in motion.cycles])
    ours = (edges - lag + rate * middle) / (1.0 + rate)
    found = []
    for start, end in ours:
        first, last = np.searchsorted(time_s, [start, end])
        part = np.flatnonzero(moving[first:last]) + first
        if part.size >= 8:
            r, s = rest[part] - rest[part].mean(axis=0), change[part] - change[part].mean(axis=0)
            weight = float((s * s).sum())
            if weight > 0.0:
                found.append((0.5 * (start + end), float((r * s).sum()) / weight, weight))
    columns = np.array(found).reshape(-1, 3)
    return columns[:, 0], columns[:, 1], columns[:, 2]


def _speed(time_s: FloatArray, angle: FloatArray) -> FloatArray:
    """As a gradient, where samples share a time."""
    unique, first = np.unique(time_s, return_index=True)
    return np.asarray(np.interp(time_s, unique, np.gradient(angle[first], unique)))


def _linearised(
    angle: FloatArray, speed: FloatArray, volts: FloatArray, moving: FloatArray, motion: Motion
) -> tuple[FloatArray, FloatArray]:
    """Voltages less the mean curve, and their change by a shift of a second; both by each receiver's scatter."""
    low, reach = motion.low_deg, motion.high_deg - motion.low_deg
    cell = np.clip(((np.nan_to_num(angle) - low) / reach * _CELLS).astype(int), 0, _CELLS - 1)
    count = np.bincount(cell[moving], minlength=_CELLS)
    held = np.flatnonzero(count)
    rest, change = np.zeros(volts.shape), np.zeros(volts.shape)
    if held.size < 4:
        return rest, change
    centre = np.bincount(cell[moving], angle[moving], _CELLS)[held] / count[held]
    for place in range(volts.shape[1]):
        mean = np.bincount(cell[moving], volts[moving, place], _CELLS)[held] / count[held]
        slope = np.gradient(mean, centre)
        apart = volts[moving, place] - np.interp(angle[moving], centre, mean)
        scale = float(apart.std()) or 1.0
        rest[moving, place] = apart / scale
        change[moving, place] = np.interp(angle[moving], centre, slope) * speed[moving] / scale
    return rest, change


def _line(x: FloatArray, y: FloatArray, weights: FloatArray) -> tuple[float, float, float]:
    """Uncertainty of the level at x = 0, slope, and the slope's uncertainty, of a weighted line (n − 2)."""
    if x.size < 3:
        return math.nan, 0.0, math.nan
    w = weights / weights.sum()
    centre = float(w @ x)
    away = x - centre
    spread = float(w @ away**2)
    slope = float(w @ (away * y)) / spread
    rest = y - float(w @ y) - slope * away
    variance = float(w @ rest**2) / (x.size - 2)
    return math.sqrt(variance * (1.0 + centre**2 / spread)), slope, math.sqrt(variance / spread)


def _words(
    lag: float, u_lag: float, rivals: tuple[float, ...], speed: float, time_s: FloatArray, shown: FloatArray
) -> tuple[str, ...]:
    known = "" if math.isnan(u_lag) else f" ± {u_lag:.2g}"
    told = [
        f"the log's clock is {lag:.6g}{known} s ahead, found by the voltages themselves: a hysteresis and a lag look "
        f"alike at one speed (1 ms is {1e-3 * speed:.2g}°), so the hysteresis given is what a lag cannot explain"
    ]
    if rivals:
        told.append(f"a lag of {rivals[0]:.6g} s goes with the voltages nearly as well, as the motion repeats itself")
    missing = int(np.isnan(shown).sum())
    if missing:
        told.append(f"{missing} of {time_s.size} samples lie outside the log and are left out")
    return tuple(told)
