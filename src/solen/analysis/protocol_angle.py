"""Angles for a recording without an angle: the commanded protocol, aligned with the cycles of the voltages.

The voltages repeat from cycle to cycle. The period of the cycles maximises their autocorrelation, and each cycle begins
where they correlate best with the protocol: from 0 to +A at constant speed, a hold, back, and the same on the other
side. If a cycle is longer than the protocol, the excess is assumed to be rest, half of it at each return to 0. The
result is the angle that the stage was commanded to take; it was not measured.

A single signal does not show which side is positive. With a left and a right receiver, the convention does: at negative
angles the right receiver is brighter, i.e. its voltage is lower. Otherwise the first excursion is assumed to be
positive.

Public names: `angle_by_protocol`, `Protocol` and `ProtocolAngle`.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.signal import fftconvolve

from solen.analysis.alignment import principal
from solen.arrays import FloatArray, IndexArray
from solen.errors import DataError
from solen.ranks import Caution, note, warning
from solen.recording.column_roles import left_right

_MAX_GRID_POINTS = 1 << 20
_MIN_AUTOCORRELATION = 0.5  # smallest autocorrelation after one cycle
_MIN_CORRELATION = 0.7  # smallest correlation of a cycle with the protocol, relative to that of the best cycle
_BINS = 40
_MEDIAN_OF_SQUARES = 0.4549  # median of the square of a normal variable with variance 1
_MAX_UNEXPLAINED = 0.1  # largest fraction of a signal's variance that the angle may leave unexplained
_SLACK = 0.05  # fraction by which the protocol may be longer than a cycle


@dataclass(frozen=True)
class Protocol:
    """Commanded motion of a stage: to +A and −A at constant speed, with a hold at each end."""

    amplitude_deg: float
    speed_deg_per_s: float = 15.0
    hold_s: float = 0.8

    @property
    def shortest_s(self) -> float:
        """Duration of a cycle without rests."""
        return 4.0 * self.amplitude_deg / self.speed_deg_per_s + 2.0 * self.hold_s

    def corners(self, period_s: float, first: int = 1) -> tuple[FloatArray, FloatArray]:
        """Return the times and angles of a cycle at its corners; ``first`` is the sign of the side visited first."""
        ramp, rest = self.amplitude_deg / self.speed_deg_per_s, max(0.0, 0.5 * (period_s - self.shortest_s))
        durations = (0.0, ramp, self.hold_s, ramp, rest, ramp, self.hold_s, ramp)
        angles = first * self.amplitude_deg * np.array([0.0, 1.0, 1.0, 0.0, 0.0, -1.0, -1.0, 0.0])
        return np.cumsum(durations) * min(1.0, period_s / self.shortest_s), angles


@dataclass(frozen=True, eq=False)
class ProtocolAngle:
    """Protocol angle at each sample (n,), period and start times of the cycles, and warnings."""

    angle_deg: FloatArray
    period_s: float
    starts_s: FloatArray
    warnings: tuple[Caution, ...]


def angle_by_protocol(
    time_s: FloatArray, volts: FloatArray, receivers: tuple[str, ...], protocol: Protocol
) -> ProtocolAngle:
    """Return the protocol angle at the times of the voltages.

    Parameters
    ----------
    time_s, volts
        Times (n,) and voltages (n, m).
    receivers
        Receiver names, which distinguish left and right.
    protocol
        The commanded motion.

    Raises
    ------
    DataError
        If the voltages are not periodic, repeat faster than the protocol allows, or do not match the protocol.
    """
    sides = left_right(receivers)
    signal = principal(volts) if sides is None else volts[:, sides[1]] - volts[:, sides[0]]
    even_s = max(float(np.median(np.diff(time_s))), float(np.ptp(time_s)) / _MAX_GRID_POINTS)
    grid = np.arange(time_s[0], time_s[-1], even_s)
    even = np.interp(grid, time_s, signal)
    even -= np.polyval(np.polyfit(grid - grid[0], even, 1), grid - grid[0])
    period = _period(even, even_s, protocol)
    if sides is None:
        even = even * _first_sign(even)
    firsts = (1,) if sides is None else (1, -1)
    by_sign = {first: _starts(even, even_s, protocol.corners(period, first), period) for first in firsts}
    first = max(by_sign, key=lambda sign: by_sign[sign].size)
    starts = by_sign[first] + grid[0]
    angle = _angle(time_s, starts, protocol.corners(period, first))
    inside = (grid >= starts[0]) & (grid < starts[-1] + period)
    cycle = np.searchsorted(starts, grid[inside], side="right")
    _check_matches(_without_means(even[inside], cycle), np.interp(grid[inside], time_s, angle), protocol)
    return ProtocolAngle(angle, period, starts, tuple(_warnings(period, protocol, named=sides is not None)))


def _warnings(period: float, protocol: Protocol, *, named: bool) -> Iterator[Caution]:
    """Yield warnings about the assumptions; ``named`` is whether the names distinguish left from right."""
    yield warning(
        f"no angle was recorded: cycles of {period:.4g} s were detected in the voltages, and the angle is assumed to "
        f"follow the protocol: ±{protocol.amplitude_deg:g}° at {protocol.speed_deg_per_s:g}°/s with holds of "
        f"{protocol.hold_s:g} s; range, sensitivity and hysteresis are only as good as this assumption"
    )
    rest = period - protocol.shortest_s
    if rest > _SLACK * period:
        yield warning(
            f"a cycle is {rest:.3g} s longer than the protocol; half of this time is assumed to be a rest at each "
            "return to 0"
        )
    if named:
        yield note(
            "the sign of the angle follows the convention (right brighter at negative angles) and was not measured"
        )
    else:
        yield warning(
            "the names do not distinguish a left from a right receiver: the first excursion is assumed to be positive"
        )


def _without_means(signal: FloatArray, cycle: IndexArray) -> FloatArray:
    """Return a signal minus its mean over each cycle, which removes changes from one cycle to the next."""
    return np.asarray(signal - (np.bincount(cycle, signal) / np.maximum(np.bincount(cycle), 1))[cycle])


def _check_matches(signal: FloatArray, angle_deg: FloatArray, protocol: Protocol) -> None:
    """Raise `DataError` if a signal does not follow the protocol angle to within its noise."""
    edges = np.linspace(-1.0, 1.0, _BINS + 1)[1:-1] * protocol.amplitude_deg
    angle_bin = np.digitize(angle_deg, edges)
    count = np.maximum(np.bincount(angle_bin, minlength=_BINS), 1)
    residual = signal - (np.bincount(angle_bin, signal, _BINS) / count)[angle_bin]
    noise = float(np.median(np.diff(signal, 2) ** 2)) / (6.0 * _MEDIAN_OF_SQUARES)
    variance = float(signal.var()) - noise
    unexplained = float(residual @ residual) / signal.size - noise
    if variance > 0.0 and unexplained > _MAX_UNEXPLAINED * variance:
        limit = (
            f"does not match ±{protocol.amplitude_deg:g}° at {protocol.speed_deg_per_s:g}°/s with holds of "
            f"{protocol.hold_s:g} s: this motion leaves {100.0 * unexplained / variance:.0f} % of its variance "
            "unexplained"
        )
        raise DataError("recording", limit=limit, remedy="specify the stage's --speed-deg-per-s and --hold-s")


def _period(even: FloatArray, even_s: float, protocol: Protocol) -> float:
    """Return the time lag, not shorter than the protocol, at which the autocorrelation of a signal is largest."""
    products = fftconvolve(even, even[::-1])[even.size - 1 :]
    lags = np.arange(even.size)
    correlation = products / products[0] * even.size / np.maximum(even.size - lags, 1)
    first = int((1.0 - _SLACK) * protocol.shortest_s / even_s)
    last = even.size * 2 // 3
    if last - first < 4:
        limit = f"lasts {even.size * even_s:.3g} s, less than one and a half cycles of {protocol.shortest_s:.3g} s"
        raise DataError(
            "recording", limit=limit, remedy="record more cycles, or specify --speed-deg-per-s and --hold-s"
        )
    part = correlation[first:last]
    peaks = np.flatnonzero((part[1:-1] > part[:-2]) & (part[1:-1] >= part[2:])) + 1
    strong = peaks[part[peaks] >= 0.9 * part[peaks].max(initial=-1.0)] if peaks.size else peaks
    if not strong.size or part[strong[0]] < _MIN_AUTOCORRELATION:
        limit = f"is not periodic with a period of {protocol.shortest_s:.3g} s or more"
        remedy = "check the receivers, and --amplitude-deg, --speed-deg-per-s and --hold-s"
        raise DataError("recording", limit=limit, remedy=remedy)
    peak = int(strong[0]) + first
    return (peak + _vertex(correlation[peak - 1 : peak + 2])) * even_s


def _vertex(three: FloatArray) -> float:
    """Return the position of the vertex of the parabola through three neighbours, relative to the central one."""
    curvature = float(three[0] - 2.0 * three[1] + three[2])
    return 0.5 * float(three[0] - three[2]) / curvature if curvature else 0.0


def _first_sign(even: FloatArray) -> float:
    """Return the sign of the first large excursion."""
    large = np.flatnonzero(np.abs(even) > 0.7 * np.abs(even).max())
    return float(np.sign(even[large[0]]))


def _starts(even: FloatArray, even_s: float, corners: tuple[FloatArray, FloatArray], period: float) -> FloatArray:
    """Return the start time of each cycle, from its correlation with the protocol."""
    times, angles = corners
    template = np.interp(np.arange(0.0, times[-1], even_s), times, angles)
    correlation = fftconvolve(even, template[::-1])[template.size - 1 : even.size]
    if not correlation.size:
        raise DataError("recording", limit=f"contains no complete cycle of {period:.3g} s", remedy="record more cycles")
    best = int(np.argmax(correlation))
    step = round(period / even_s)
    starts = [best]
    for sign in (-1, 1):
        start = best
        while (neighbour := _nearest(correlation, start + sign * step, step // 8)) is not None:
            if correlation[neighbour] < _MIN_CORRELATION * correlation[best] or neighbour in starts:
                break
            starts.append(neighbour)
            start = neighbour
    last = correlation.size - 1
    refined = [n + (_vertex(correlation[n - 1 : n + 2]) if 1 <= n < last else 0.0) for n in sorted(starts)]
    return np.array(refined) * even_s


def _nearest(correlation: FloatArray, expected: int, reach: int) -> int | None:
    """Return the index of the largest correlation near an expected index, or None too close to an end."""
    low, high = max(0, expected - reach), min(correlation.size, expected + reach + 1)
    return low + int(np.argmax(correlation[low:high])) if high - low > reach else None


def _angle(time_s: FloatArray, starts: FloatArray, corners: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Return the angle over all cycles, with rests between them and at both ends."""
    times, angles = corners
    following = np.append(starts[1:], np.inf)
    corners_s = [np.minimum(start + times, after) for start, after in zip(starts, following, strict=True)]
    return np.asarray(np.interp(time_s, np.concatenate(corners_s), np.tile(angles, starts.size)))
