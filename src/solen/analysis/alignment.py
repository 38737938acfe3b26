"""Alignment of a stage log with the recorder's clock: offset, rate, and their uncertainties.

The voltage of a receiver is some function f of the angle. If the log is shifted in time relative to the voltages, the
rising and falling ramps give two different curves. The shift is estimated by cross-correlation and then refined by
least squares: a shift δ changes the voltage by f'(θ) θ' δ, which has opposite signs in the two directions, so that f
and δ can be separated. Each cycle gives an independent shift. A straight line fitted to the shifts over time gives the
lag and the rate of the clock; the residuals give their uncertainties.

A log has few entries, and a ramp begins and ends between two of them, where linear interpolation would cut the corner.
The corner is assumed where the line of the ramp meets the level of the hold (`solen.analysis.log_interpolation`); the
times around it are not used to determine the lag.

Errors common to all cycles do not show in the scatter of the cycles. The uncertainty due to the encoder step is
therefore added; and if the lags fitted to parts of the range scatter more than those of the cycles, their scatter is
used instead.

A hysteresis that does not depend on speed has the same effect as a lag: on ramps at a single speed v, a lag δ makes the
two directions differ by 2 f' v δ. The hysteresis of a sensor can therefore not be determined with a log on a different
clock; a warning reports this.

`align` returns an `Alignment`, whose `angle_deg` is the logged angle at the recorder's times.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import BSpline, make_lsq_spline
from scipy.signal import fftconvolve

from solen.analysis.log_interpolation import LoggedAngle, logged_angle
from solen.analysis.motion import Motion, find_motion
from solen.arrays import BoolArray, FloatArray, IntArray
from solen.errors import DataError
from solen.ranks import Caution, warning
from solen.recording.stimulus import ANGLE, Stimulus
from solen.results import HIDDEN, Result

_BINS = 512
_MAX_PIECES, _BINS_PER_PIECE = 32, 2.5  # pieces of a mean curve, each with this many bins sampled in both directions
_SPEED_NOISES, _SPEED_STEPS = 25.0, 5.0  # movement over which a speed is measured, in units of noise and of steps
_TOLERANCE = 0.02  # largest deviation of a level from a multiple of the encoder step, in steps
_MAX_DIVISOR = 12  # largest number of encoder steps in the smallest difference between two levels
_PARTS = 8  # number of parts of the range for which separate lags are fitted
_MAX_ITERATIONS = 12
_MIN_SPEED = 0.15  # smallest speed of a motion, relative to the median speed
_MIN_CORRELATION = 0.3
_MIN_RIVAL = 0.97  # ratio to the highest correlation above which another shift is also possible
_SYNCHRONISED_S = 1.0  # clocks that differ by less were synchronised
_MAX_GRID_POINTS = 1 << 20
_MARGIN = 0.05  # fraction of the range at each end in which the slope of a curve is uncertain


class Alignment(Result):
    """Relation between a log's clock and the recorder's clock.

    Attributes
    ----------
    lag_s, u_lag_s
        Log time minus recorder time at the midpoint of the recording, and its standard uncertainty (NaN for fewer than
        three cycles).
    rate_ppm, u_rate_ppm
        Relative excess of the log clock's rate; 0 if it is not resolved (less than three standard uncertainties).
    angle_deg
        Angle at the recorder's times, NaN outside the log, (n,).
    warnings
        Warnings.
    """

    lag_s: float
    u_lag_s: float
    rate_ppm: float
    u_rate_ppm: float
    angle_deg: FloatArray = field(metadata=HIDDEN)
    warnings: tuple[Caution, ...] = field(metadata=HIDDEN)


def align(
    time_s: FloatArray,
    volts: FloatArray,
    log_s: FloatArray,
    log_deg: FloatArray,
    window_s: float = 0.0,
    stimulus: Stimulus = ANGLE,
) -> Alignment:
    """Determine the lag and the rate of a log's clock relative to the recorder's clock.

    Parameters
    ----------
    time_s, volts
        Times (n,) and voltages (n, m) of the recording.
    log_s, log_deg
        Times and angles of the log, (k,); the times must be non-decreasing.
    window_s
        Averaging time of each voltage.
    stimulus
        The logged quantity.

    Raises
    ------
    DataError
        If the log contains no cycle, or the voltages do not follow the logged angle.
    """
    motion = find_motion(log_s, log_deg, stimulus)
    coarse, rivals = _coarse(time_s, principal(volts), log_s, log_deg)
    overlay = _Overlay(time_s, volts, log_s, logged_angle(log_s, log_deg, motion), motion, window_s)
    lag, rate = coarse, 0.0
    for _ in range(_MAX_ITERATIONS):
        shifts = overlay.shifts(lag, rate)
        if not shifts.time_s.size:
            limit = "covers no complete cycle of the recording"
            raise DataError("angle in the log", limit=limit, remedy="check that both files are from the same test")
        lag += shifts.mean
        if abs(shifts.mean) < 1e-7:
            break
    u_lag, slope, u_slope = shifts.line(overlay.middle_s)
    if math.isfinite(u_slope) and abs(slope) > 3.0 * u_slope:
        rate = slope
        for _ in range(3):
            shifts = overlay.shifts(lag, rate)
            lag += shifts.mean
            rate += shifts.line(overlay.middle_s)[1]
        u_lag, _, u_slope = shifts.line(overlay.middle_s)
    angle_deg = overlay.angle_deg(lag, rate, window_s)
    u_lag = math.hypot(max(u_lag, shifts.u_parts), _u_of_steps(log_s, log_deg, motion))
    per_ms = f"{1e-3 * motion.speed_deg_per_s:.2g}{stimulus.sign}"
    warnings = _warnings(lag, u_lag, rivals, per_ms, angle_deg)
    return Alignment(lag, u_lag, 1e6 * rate, 1e6 * u_slope, angle_deg, warnings)


def principal(volts: FloatArray) -> FloatArray:
    """Return the first principal component of the receiver voltages, each scaled by its standard deviation, (n,)."""
    centred = volts - np.median(volts, axis=0)
    spread = centred.std(axis=0)
    scaled = centred / np.where(spread > 0.0, spread, 1.0)
    _, axes = np.linalg.eigh(scaled.T @ scaled)
    return np.asarray(scaled @ axes[:, -1])


def _coarse(
    time_s: FloatArray, signal: FloatArray, log_s: FloatArray, log_deg: FloatArray
) -> tuple[float, tuple[float, ...]]:
    """Return the shift with the highest cross-correlation, and other shifts with nearly as high a correlation."""
    spans = float(np.ptp(time_s)), float(np.ptp(log_s))
    steps = [float(np.median(np.diff(times))) for times in (time_s, log_s)]
    even_s = max(*steps, max(spans) / _MAX_GRID_POINTS, 1e-6)
    recorded = np.interp(np.arange(time_s[0], time_s[-1], even_s), time_s, signal)
    logged = np.interp(np.arange(log_s[0], log_s[-1], even_s), log_s, log_deg)
    recorded, logged = recorded - recorded.mean(), logged - logged.mean()
    products = fftconvolve(logged, recorded[::-1])
    norm = math.sqrt(float(recorded @ recorded) * float(logged @ logged))
    correlation = np.abs(products) / norm if norm > 0.0 else np.zeros(products.size)
    best = int(np.argmax(correlation))
    if correlation[best] * math.sqrt(max(spans) / min(spans)) < _MIN_CORRELATION:
        limit = f"does not match the voltages (the best correlation is {correlation[best]:.2f})"
        raise DataError("angle in the log", limit=limit, remedy="check that both files are from the same test")
    lags = (np.arange(products.size) - (recorded.size - 1)) * even_s + log_s[0] - time_s[0]
    peaks = np.flatnonzero((correlation[1:-1] > correlation[:-2]) & (correlation[1:-1] >= correlation[2:])) + 1
    others = [int(n) for n in peaks if correlation[n] > _MIN_RIVAL * correlation[best] and abs(n - best) > 2]
    nearest = min([best, *others], key=lambda n: abs(float(lags[n])))
    # synchronised clocks do not differ by complete cycles of a periodic motion
    if abs(float(lags[nearest])) < _SYNCHRONISED_S:
        best, others = nearest, [best, *others]
    rivals = [float(lags[n]) for n in others if n != best]
    return float(lags[best]), tuple(sorted(rivals, key=lambda lag: abs(lag - float(lags[best])))[:1])


@dataclass(frozen=True, eq=False)
class _Shifts:
    """Best-fitting shift for each cycle: times, shifts and weights, each (c,).

    ``u_parts`` is the uncertainty of a common shift, from the differences between shifts fitted to parts of the range.
    """

    time_s: FloatArray
    shift: FloatArray
    weight: FloatArray
    u_parts: float

    @property
    def mean(self) -> float:
        return float(np.average(self.shift, weights=self.weight))

    def line(self, middle_s: float) -> tuple[float, float, float]:
        """Fit a line to the shifts over time; return its uncertainty at ``middle_s``, its slope, and the slope's u."""
        return _line(self.time_s - middle_s, self.shift, self.weight)


@dataclass(frozen=True, eq=False)
class _Overlay:
    """A recording (times, voltages and averaging time) and the log (times, angles and motion) to align with it."""

    time_s: FloatArray
    volts: FloatArray
    log_s: FloatArray
    log: LoggedAngle
    motion: Motion
    window_s: float

    @property
    def middle_s(self) -> float:
        """Time at the midpoint of the recording."""
        return 0.5 * float(self.time_s[0] + self.time_s[-1])

    def log_times(self, lag: float, rate: float) -> FloatArray:
        """Return the recording times on the log's clock, (n,)."""
        return np.asarray(self.time_s + lag + rate * (self.time_s - self.middle_s))

    def angle_deg(self, lag: float, rate: float, window_s: float = 0.0) -> FloatArray:
        """Return the logged angle at the recording times, (n,)."""
        return self.log.at(self.log_times(lag, rate), window_s)

    def shifts(self, lag: float, rate: float) -> _Shifts:
        """Return the shift of each cycle that remains when the log's clock is corrected by this lag and rate."""
        motion, log_s = self.motion, self.log_times(lag, rate)
        angle, speed = self.log.at(log_s), self._speed(log_s)
        reach = motion.high_deg - motion.low_deg
        inner = np.abs(angle - 0.5 * (motion.high_deg + motion.low_deg)) < (0.5 - _MARGIN) * reach
        moving = inner & (np.abs(speed) > _MIN_SPEED * motion.speed_deg_per_s)
        steady = moving & ~self.log.on_corner(log_s, self.window_s)
        moving = steady if steady.sum() > 0.3 * moving.sum() else moving
        residual, change = _linearised(angle, speed, self.volts, moving, motion)
        used = np.zeros(log_s.size, dtype=bool)
        rows = []
        for cycle in motion.cycles:
            samples = np.flatnonzero(moving & (log_s >= cycle.start_s) & (log_s < cycle.end_s))
            weight = float((change[samples] ** 2).sum())
            if samples.size >= 8 and weight > 0.0:
                used[samples] = True
                shift = float((residual[samples] * change[samples]).sum()) / weight
                rows.append((0.5 * (cycle.start_s + cycle.end_s) - lag, shift, weight))
        columns = np.array(rows).reshape(-1, 3)
        part = np.clip((_PARTS * (angle[used] - motion.low_deg) / reach).astype(int), 0, _PARTS - 1)
        u_parts = _u_of_parts(part, residual[used], change[used])
        return _Shifts(columns[:, 0], columns[:, 1], columns[:, 2], u_parts)

    def _speed(self, log_s: FloatArray) -> FloatArray:
        """Return the speed at log times.

        It is measured over an interval that is long compared with noise and steps, but at most a tenth of a ramp.
        """
        motion = self.motion
        speed = motion.speed_deg_per_s
        distance = max(_SPEED_NOISES * motion.noise_deg, _SPEED_STEPS * motion.step_deg)
        ideal = max(float(np.median(np.diff(self.log_s))), distance / speed)
        half = min(ideal, 0.1 * (motion.high_deg - motion.low_deg) / speed)
        return np.asarray((self.log.at(log_s + half) - self.log.at(log_s - half)) / (2.0 * half))


def _u_of_parts(part: IntArray, residual: FloatArray, change: FloatArray) -> float:
    """Return the uncertainty of a lag, from the scatter of the lags fitted to parts of each receiver's range."""
    product, weight = (
        np.concatenate([np.bincount(part, column, _PARTS) for column in columns.T])
        for columns in (residual * change, change**2)
    )
    used = weight > 1e-6 * weight.sum()
    product, weight = product[used], weight[used]
    if weight.size < 3:
        return 0.0
    deviation = product / weight - product.sum() / weight.sum()
    return math.sqrt(float(weight @ deviation**2) / (weight.size - 1) / float(weight.sum()))


def _linearised(
    angle: FloatArray, speed: FloatArray, volts: FloatArray, moving: BoolArray, motion: Motion
) -> tuple[FloatArray, FloatArray]:
    """Return the voltages minus the mean curve, and their derivative with respect to a time shift.

    Both are divided by the scatter of each receiver. The curve is a cubic spline fitted by least squares. The part of
    the derivative that a change of the curve can also produce is projected out (Frisch and Waugh).
    """
    residual, change = np.zeros(volts.shape), np.zeros(volts.shape)
    used_deg, used_speed = angle[moving], speed[moving]
    pieces = _pieces(used_deg, used_speed, motion)
    if not pieces:
        return residual, change
    bins = _Bins(used_deg, motion, pieces)
    for receiver in range(volts.shape[1]):
        used_V = volts[moving, receiver]
        curve = bins.curve(used_V)
        deviation = used_V - curve(used_deg)
        derivative = curve.derivative()(used_deg) * used_speed
        scale = float(deviation.std()) or 1.0
        residual[moving, receiver] = deviation / scale
        change[moving, receiver] = (derivative - bins.curve(derivative)(used_deg)) / scale
    return residual, change


def _bins(angle: FloatArray, motion: Motion) -> IntArray:
    """Return the index of the narrow bin that contains each angle."""
    fraction = (angle - motion.low_deg) / (motion.high_deg - motion.low_deg)
    return np.asarray(np.clip((fraction * _BINS).astype(int), 0, _BINS - 1))


def _pieces(angle: FloatArray, speed: FloatArray, motion: Motion) -> int:
    """Return the number of pieces of a mean curve that the samples of both directions support; 0 with too few samples.

    If both directions were sampled at only a few angles each, a curve with more pieces could follow both of them.
    """
    index = _bins(angle, motion)
    count = min(np.unique(index[direction]).size for direction in (speed > 0.0, speed < 0.0))
    return 0 if count < 5 else int(np.clip(count / _BINS_PER_PIECE, 2, _MAX_PIECES))


class _Bins:
    """Samples sorted by angle into narrow bins; a curve is fitted to the bin means."""

    def __init__(self, angle: FloatArray, motion: Motion, pieces: int) -> None:
        self._index = _bins(angle, motion)
        count = np.bincount(self._index, minlength=_BINS)
        self._occupied = np.flatnonzero(count)
        self._count = count[self._occupied]
        self._angle = self._means(angle)
        positions = np.linspace(0.0, 1.0, self._occupied.size)
        inside = np.interp(np.linspace(0.0, 1.0, pieces + 1)[1:-1], positions, self._angle)
        first, last = self._angle[[0, -1]]
        self._knots = np.concatenate([np.repeat(first, 4), inside, np.repeat(last, 4)])

    def _means(self, values: FloatArray) -> FloatArray:
        return np.bincount(self._index, values, _BINS)[self._occupied] / self._count

    def curve(self, values: FloatArray) -> BSpline:
        """Return the cubic spline fitted to the bin means by least squares."""
        return make_lsq_spline(self._angle, self._means(values), self._knots, 3, w=np.sqrt(self._count))


def _encoder_step(log_deg: FloatArray, motion: Motion) -> float:
    """Return the encoder step, of which all levels are multiples, or 0 if there is none.

    If all entries in the ramps are exactly one such step apart, a noise-free angle may have been sampled at a constant
    speed without an encoder. The step is then one unit of the last decimal place, to which the angle may be rounded.
    """
    step = _common_step(np.unique(log_deg) - log_deg.min())
    if not step:
        return 0.0
    steps = np.concatenate([np.abs(np.diff(log_deg[ramp.start + 1 : ramp.stop - 1])) for ramp in motion.ramps]) / step
    return step if (np.abs(steps - 1.0) > _TOLERANCE).any() else _last_decimal(log_deg)


def _last_decimal(values: FloatArray) -> float:
    """Return one unit of the last decimal place, e.g. 0.01 for two decimals; 0 for more than six decimals."""
    for decimals in range(7):
        if np.abs(values * 10.0**decimals - np.round(values * 10.0**decimals)).max() < _TOLERANCE * 1e-3:
            return float(10.0**-decimals)
    return 0.0


def _common_step(levels: FloatArray) -> float:
    """Return the largest step of which all levels, ascending from 0, are multiples, or 0 if there is none."""
    steps = np.diff(levels)
    smallest = float(np.min(steps[steps > 1e-9 * levels[-1]], initial=levels[-1]))
    for divisor in range(1, _MAX_DIVISOR + 1):
        multiples = levels * (divisor / smallest)
        if np.abs(multiples - np.round(multiples)).max() < _TOLERANCE:
            return smallest / divisor
    return 0.0


def _u_of_steps(log_s: FloatArray, log_deg: FloatArray, motion: Motion) -> float:
    """Return the uncertainty of a lag due to the encoder steps, which may affect all ramps alike.

    If log entries are less than half a step apart, they sample every step at many positions, and the rounding errors
    of different steps are independent. Otherwise all entries may have the same rounding error, with a standard
    uncertainty of step/√12.
    """
    step = _encoder_step(log_deg, motion)
    if not step:
        return 0.0
    interval_deg = motion.speed_deg_per_s * float(np.median(np.diff(log_s)))
    independent = (motion.high_deg - motion.low_deg) / step if interval_deg < 0.5 * step else 1.0
    return step / math.sqrt(12.0 * independent) / motion.speed_deg_per_s


def _line(x: FloatArray, y: FloatArray, weights: FloatArray) -> tuple[float, float, float]:
    """Fit a weighted line (n − 2 degrees of freedom); return its uncertainty at x = 0, and slope with uncertainty."""
    if x.size < 3:
        return math.nan, 0.0, math.nan
    w = weights / weights.sum()
    centre = float(w @ x)
    centred = x - centre
    spread = float(w @ centred**2)
    slope = float(w @ (centred * y)) / spread
    residual = y - float(w @ y) - slope * centred
    variance = float(w @ residual**2) / (x.size - 2)
    return math.sqrt(variance * (1.0 + centre**2 / spread)), slope, math.sqrt(variance / spread)


def _warnings(
    lag: float, u_lag: float, rivals: tuple[float, ...], per_ms: str, angle_deg: FloatArray
) -> tuple[Caution, ...]:
    u = "" if math.isnan(u_lag) else f" ± {u_lag:.2g}"
    lead = (
        f"the log's clock is {lag:.6g}{u} s ahead, as determined from the voltages: at a single speed, hysteresis and "
        f"lag cannot be distinguished (1 ms corresponds to {per_ms}), so the reported hysteresis is only the part that "
        "no lag explains"
    )
    warnings = [warning(lead)]
    if rivals:
        rival = f"a lag of {rivals[0]:.6g} s fits the voltages nearly as well, because the motion is periodic"
        warnings.append(warning(rival))
    missing = int(np.isnan(angle_deg).sum())
    if missing:
        warnings.append(warning(f"{missing} of {angle_deg.size} samples are outside the log and are omitted"))
    return tuple(warnings)
