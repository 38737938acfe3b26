"""Alignment of a stage log with the recorder's clock: offset, rate, and their uncertainties.

The voltage of a receiver is a function of the angle, whatever that function is. If the log is shifted in time against
the voltages, rising and falling ramps give two different curves. The shift is found approximately by cross-correlation
and then refined by least squares: with the mean curve f, a shift by δ changes the voltage by f'(θ) θ' δ, which has
opposite signs in the two directions, so f and δ can be separated. Each cycle gives an independent shift. A straight
line through the shifts over time gives the lag and the rate of the clock; the residuals give their uncertainties.

A log has few entries, and a ramp begins and ends between two entries, where linear interpolation would cut the corner.
The corner is placed where the line of the ramp meets the level of the hold (`solen.analysis.log_interpolation`); the
times around it are not used to determine the lag.

Errors common to all cycles do not show in the scatter of the cycles. The encoder step is therefore added to the
uncertainty; and if lags fitted to parts of the range differ more than those of the cycles, the scatter between the
parts is used instead.

A hysteresis that does not depend on speed has the same effect: on ramps at a single speed v, a lag δ makes the two
directions differ by f' v δ. A log recorded with a different clock therefore cannot show the hysteresis of a sensor; a
warning says so.

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

_CELLS = 512
_PIECES, _BEAR = 32, 2.5  # largest number of pieces of a mean curve, and cells with samples of each direction per piece
_NOISES, _STEPS = 25.0, 5.0  # movement over which a speed is measured, in units of noise and of steps
_ALIKE, _FINER = 0.02, 12  # tolerance of levels, in steps; most steps in the smallest difference of levels
_PARTS = 8  # number of parts of the range for which separate lags are fitted
_ROUNDS = 12
_SLOW = 0.15  # smallest speed of a motion, relative to the usual speed
_MIN_CORRELATION = 0.3
_RIVAL = 0.97  # ratio to the highest correlation above which another shift is also possible
_AGREE_S = 1.0  # clocks that differ by less were synchronised
_MAX_GRID_POINTS = 1 << 20
_INNER = 0.05  # fraction of the range at each end in which the slope of a curve is uncertain


class Alignment(Result):
    """Relation between a log's clock and the recorder's clock.

    Attributes
    ----------
    lag_s, u_lag_s
        Log time minus recorder time at the midpoint of the recording, and its standard uncertainty (NaN for fewer than
        three cycles).
    rate_ppm, u_rate_ppm
        How much faster the log's clock runs; 0 if the difference is not resolved (less than three standard
        uncertainties).
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
    laid = _Laid(time_s, volts, log_s, logged_angle(log_s, log_deg, motion), motion, window_s)
    lag, rate = coarse, 0.0
    for _ in range(_ROUNDS):
        shifts = laid.shifts(lag, rate)
        if not shifts.when.size:
            limit = "covers no complete cycle of the recording"
            raise DataError("angle in the log", limit=limit, remedy="check that both files are of the same test")
        lag += shifts.mean
        if abs(shifts.mean) < 1e-7:
            break
    u_lag, slope, u_slope = shifts.line(laid.middle_s)
    if math.isfinite(u_slope) and abs(slope) > 3.0 * u_slope:
        rate = slope
        for _ in range(3):
            shifts = laid.shifts(lag, rate)
            lag += shifts.mean
            rate += shifts.line(laid.middle_s)[1]
        u_lag, _, u_slope = shifts.line(laid.middle_s)
    shown = laid.angle_deg(lag, rate, window_s)
    u_lag = math.hypot(max(u_lag, shifts.u_parts), _u_of_steps(log_s, log_deg, motion))
    speed = f"{1e-3 * motion.speed_deg_per_s:.2g}{stimulus.sign}"
    words = _warnings(lag, u_lag, rivals, speed, time_s, shown)
    return Alignment(lag, u_lag, 1e6 * rate, 1e6 * u_slope, shown, words)


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
    ours = np.interp(np.arange(time_s[0], time_s[-1], even_s), time_s, signal)
    theirs = np.interp(np.arange(log_s[0], log_s[-1], even_s), log_s, log_deg)
    ours, theirs = ours - ours.mean(), theirs - theirs.mean()
    found = fftconvolve(theirs, ours[::-1])
    norm = math.sqrt(float(ours @ ours) * float(theirs @ theirs))
    height = np.abs(found) / norm if norm > 0.0 else np.zeros(found.size)
    best = int(np.argmax(height))
    overlap = math.sqrt(max(spans) / min(spans))
    if height[best] * overlap < _MIN_CORRELATION:
        limit = f"does not match the voltages (the best correlation is {height[best]:.2f})"
        raise DataError("angle in the log", limit=limit, remedy="check that both files are of the same test")
    lags = (np.arange(found.size) - (ours.size - 1)) * even_s + log_s[0] - time_s[0]
    peaks = np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:])) + 1
    others = [int(n) for n in peaks if height[n] > _RIVAL * height[best] and abs(n - best) > 2]
    nearest = min([best, *others], key=lambda n: abs(float(lags[n])))
    # clocks that nearly agree do not differ by whole cycles of a periodic motion
    if abs(float(lags[nearest])) < _AGREE_S:
        best, others = nearest, [best, *others]
    rivals = [float(lags[n]) for n in others if n != best]
    return float(lags[best]), tuple(sorted(rivals, key=lambda lag: abs(lag - float(lags[best])))[:1])


@dataclass(frozen=True, eq=False)
class _Shifts:
    """Best-fitting shift for each cycle: times, shifts and weights, each (c,).

    ``u_parts`` is the uncertainty of a common shift, from the differences between shifts fitted to parts of the range.
    """

    when: FloatArray
    shift: FloatArray
    weight: FloatArray
    u_parts: float

    @property
    def mean(self) -> float:
        return float(np.average(self.shift, weights=self.weight))

    def line(self, middle_s: float) -> tuple[float, float, float]:
        """Return the standard uncertainty of the line's level at the midpoint, slope, and standard uncertainty of the slope."""
        return _line(self.when - middle_s, self.shift, self.weight)


@dataclass(frozen=True, eq=False)
class _Laid:
    """A recording aligned with a log: sample times, voltages and averaging times, log times, angles and motion."""

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
        """Return the best-fitting shift of each cycle, in addition to the clock's shift."""
        motion, when = self.motion, self.log_times(lag, rate)
        angle, speed = self.log.at(when), self._speed(when)
        reach = motion.high_deg - motion.low_deg
        inner = np.abs(angle - 0.5 * (motion.high_deg + motion.low_deg)) < (0.5 - _INNER) * reach
        moving = inner & (np.abs(speed) > _SLOW * motion.speed_deg_per_s)
        steady = moving & ~self.log.on_corner(when, self.window_s)
        moving = steady if steady.sum() > 0.3 * moving.sum() else moving
        rest, change = _linearised(angle, speed, self.volts, moving, motion)
        edges = np.array([[cycle.start_s, cycle.end_s] for cycle in motion.cycles])
        used = np.zeros(when.size, dtype=bool)
        found = []
        for start, end in edges:
            part = np.flatnonzero(moving & (when >= start) & (when < end))
            weight = float((change[part] ** 2).sum())
            if part.size >= 8 and weight > 0.0:
                used[part] = True
                found.append((0.5 * (start + end) - lag, float((rest[part] * change[part]).sum()) / weight, weight))
        columns = np.array(found).reshape(-1, 3)
        place = np.clip((_PARTS * (angle[used] - motion.low_deg) / reach).astype(int), 0, _PARTS - 1)
        u_parts = _u_of_parts(place, rest[used], change[used])
        return _Shifts(columns[:, 0], columns[:, 1], columns[:, 2], u_parts)

    def _speed(self, when: FloatArray) -> FloatArray:
        """Return the speed from the log, over an interval long against noise and steps but at most a tenth of a ramp."""
        motion = self.motion
        fastest = motion.speed_deg_per_s
        far = max(_NOISES * motion.noise_deg, _STEPS * motion.step_deg)
        wanted = max(float(np.median(np.diff(self.log_s))), far / fastest)
        half = min(wanted, 0.1 * (motion.high_deg - motion.low_deg) / fastest)
        return np.asarray((self.log.at(when + half) - self.log.at(when - half)) / (2.0 * half))


def _u_of_parts(place: IntArray, rest: FloatArray, change: FloatArray) -> float:
    """Return the uncertainty of a lag, from the scatter of the lags fitted to parts of each receiver's range."""
    top, weight = (
        np.concatenate([np.bincount(place, one, _PARTS) for one in columns.T]) for columns in (rest * change, change**2)
    )
    held = weight > 1e-6 * weight.sum()
    top, weight = top[held], weight[held]
    if weight.size < 3:
        return 0.0
    apart = top / weight - top.sum() / weight.sum()
    return math.sqrt(float(weight @ apart**2) / (weight.size - 1) / float(weight.sum()))


def _linearised(
    angle: FloatArray, speed: FloatArray, volts: FloatArray, moving: BoolArray, motion: Motion
) -> tuple[FloatArray, FloatArray]:
    """Return the voltages minus the mean curve, and their time-shift derivative, orthogonal to changes of that curve.

    Both are divided by the scatter of each receiver. The curve is a cubic spline fitted by least squares. Part of the
    effect of a shift looks like a change of the curve; this part is projected out (Frisch and Waugh).
    """
    rest, change = np.zeros(volts.shape), np.zeros(volts.shape)
    here, fast = angle[moving], speed[moving]
    pieces = _pieces(here, fast, motion)
    if not pieces:
        return rest, change
    cells = _Cells(here, motion, pieces)
    for place in range(volts.shape[1]):
        ours = volts[moving, place]
        curve = cells.curve(ours)
        apart = ours - curve(here)
        turned = curve.derivative()(here) * fast
        scale = float(apart.std()) or 1.0
        rest[moving, place] = apart / scale
        change[moving, place] = (turned - cells.curve(turned)(here)) / scale
    return rest, change


def _pieces(angle: FloatArray, speed: FloatArray, motion: Motion) -> int:
    """Return the number of mean-curve segments that samples of both directions support, or 0 if there are too few samples.

    With more segments, a curve could follow both directions if these were sampled at a few different angles each.
    """
    low, reach = motion.low_deg, motion.high_deg - motion.low_deg
    cell = np.clip(((angle - low) / reach * _CELLS).astype(int), 0, _CELLS - 1)
    held = min(np.unique(cell[way]).size for way in (speed > 0.0, speed < 0.0))
    return 0 if held < 5 else int(np.clip(held / _BEAR, 2, _PIECES))


class _Cells:
    """Angles sorted into narrow bins; a curve through many samples is fitted to the bin means."""

    def __init__(self, angle: FloatArray, motion: Motion, pieces: int) -> None:
        low, reach = motion.low_deg, motion.high_deg - motion.low_deg
        self._cell = np.clip(((angle - low) / reach * _CELLS).astype(int), 0, _CELLS - 1)
        count = np.bincount(self._cell, minlength=_CELLS)
        self._held = np.flatnonzero(count)
        self._count = count[self._held]
        self._angle = np.bincount(self._cell, angle, _CELLS)[self._held] / self._count
        inside = np.interp(np.linspace(0.0, 1.0, pieces + 1)[1:-1], np.linspace(0.0, 1.0, self._held.size), self._angle)
        ends = self._angle[[0, -1]]
        self._knots = np.concatenate([np.repeat(ends[0], 4), inside, np.repeat(ends[1], 4)])

    def curve(self, values: FloatArray) -> BSpline:
        """Return the cubic spline fitted to the bin means by least squares."""
        means = np.bincount(self._cell, values, _CELLS)[self._held] / self._count
        return make_lsq_spline(self._angle, means, self._knots, 3, w=np.sqrt(self._count))


def _step_of_encoder(log_deg: FloatArray, motion: Motion) -> float:
    """Return the encoder step, of which all levels are multiples, or 0 if there is none.

    If every level in a ramp follows directly after the previous level, a noise-free angle may have been sampled in step
    with its motion. The step is then one unit of the last decimal place, to which the angle may have been rounded.
    """
    step = _common_step(np.unique(log_deg) - log_deg.min())
    if not step:
        return 0.0
    each = [np.abs(np.diff(log_deg[ramp.start + 1 : ramp.stop - 1])) / step for ramp in motion.ramps]
    return step if (np.abs(np.concatenate(each) - 1.0) > _ALIKE).any() else _last_decimal(log_deg)


def _last_decimal(values: FloatArray) -> float:
    """Return the unit of the last decimal place: 0.01 for values with two decimals, and so on, or 0 for more than six decimals."""
    for decimals in range(7):
        if np.abs(values * 10.0**decimals - np.round(values * 10.0**decimals)).max() < _ALIKE * 1e-3:
            return float(10.0**-decimals)
    return 0.0


def _common_step(levels: FloatArray) -> float:
    """Return the largest step of which all levels, ascending from 0, are multiples, or 0 if there is none."""
    steps = np.diff(levels)
    finest = float(np.min(steps[steps > 1e-9 * levels[-1]], initial=levels[-1]))
    for part in range(1, _FINER + 1):
        counted = levels * (part / finest)
        if np.abs(counted - np.round(counted)).max() < _ALIKE:
            return finest / part
    return 0.0


def _u_of_steps(log_s: FloatArray, log_deg: FloatArray, motion: Motion) -> float:
    """Return the uncertainty of a lag due to the encoder steps, which may affect all ramps alike.

    Log entries less than half a step apart sample every step at many positions, and their rounding errors average like
    independent errors. Entries farther apart may all have the same rounding error, with standard uncertainty step/√12.
    """
    step = _step_of_encoder(log_deg, motion)
    if not step:
        return 0.0
    far = motion.speed_deg_per_s * float(np.median(np.diff(log_s)))
    passed = (motion.high_deg - motion.low_deg) / step if far < 0.5 * step else 1.0
    return step / math.sqrt(12.0 * passed) / motion.speed_deg_per_s


def _line(x: FloatArray, y: FloatArray, weights: FloatArray) -> tuple[float, float, float]:
    """Return the uncertainty of the level at x = 0, slope, and uncertainty of the slope of a weighted straight line (n − 2)."""
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


def _warnings(
    lag: float, u_lag: float, rivals: tuple[float, ...], speed: str, time_s: FloatArray, shown: FloatArray
) -> tuple[Caution, ...]:
    known = "" if math.isnan(u_lag) else f" ± {u_lag:.2g}"
    found = (
        f"the log's clock is {lag:.6g}{known} s ahead, as determined from the voltages: at a single "
        f"speed, hysteresis and lag cannot be distinguished (1 ms corresponds to {speed}), so the "
        "reported hysteresis is only the part that no lag explains"
    )
    warnings = [warning(found)]
    if rivals:
        again = f"a lag of {rivals[0]:.6g} s fits the voltages nearly as well, because the motion is periodic"
        warnings.append(warning(again))
    missing = int(np.isnan(shown).sum())
    if missing:
        warnings.append(warning(f"{missing} of {time_s.size} samples are outside the log and are omitted"))
    return tuple(warnings)
