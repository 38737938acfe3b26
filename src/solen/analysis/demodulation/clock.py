"""Recovery of the emitter clock from a waveform that was sampled while the emitters switched.

The sum of all channels rises and falls with the emitters. Its phase at the switching frequency is determined block by
block, and so follows a drift between the emitter and recorder clocks. Folding the samples at that phase gives the shape
of one period; the edges are where this shape crosses half its height. The time of a sample then determines whether the
emitters are on or off or the sample is too close to an edge, regardless of its noise.

If several emitters are switched in sequence, each on and off once, the detected clock is that of the slots. An emitter
is then identified by its position in the sequence, counted from the first "on" slot in the recording.

Public names: `find_clock`, `find_switching` and `Clock`.
"""

from dataclasses import field
from typing import Literal

import numpy as np

from solen.analysis.demodulation.slots import DROPPED, OFF
from solen.arrays import FloatArray, IntArray
from solen.errors import DataError
from solen.results import HIDDEN, Result

On = Literal["low", "high"]

MIN_PERIODS, BLOCK_PERIODS = 8, 32
AT_EDGE = 0.45
"""Distance from an edge, in sample intervals, within which a sample may be on either side of the edge."""
MIN_SAMPLES = 6
"""Smallest number of samples in a period: an edge, a settled and a spare sample in each phase."""
SEARCHED_SHARE, SEARCHED_S = 0.05, 10.0
"""Half-width of the search range relative to the specified rate, and length of the part of the recording that is
searched.
"""
BINS = 200
CLEAR, CERTAIN = 6.0, 20.0
"""Ratio of modulation to noise above which a clock is detected, and ratio above which the clock is certain."""
SMOOTH = 0.2
"""Transition time, as a fraction of a period, above which the modulation looks like flicker rather than a switch."""
MIN_HZ, TRIED = 15.0, 4
"""Lowest rate searched if none is specified, faster than any motion, and the number of spectral lines tried."""


class Clock(Result):
    """Emitter clock, with the phases of N samples.

    Attributes
    ----------
    phase
        Switching periods since the first switch-on edge, (N,); whole numbers are at these edges.
    rate_hz, u_rate_hz
        Mean switching frequency on the recording's clock, and its standard uncertainty.
    wander_us
        Largest deviation of an edge from its position on a clock with a constant rate.
    jitter_us
        Standard uncertainty of an edge position.
    on_share
        Fraction of a period for which an emitter is on.
    depth
        Modulation depth in the sum of the channels, in their unit.
    clearness
        Ratio of the modulation to its noise.
    between_share
        Fraction of a period between a quarter and three quarters of the height: small for a switch, 1/3 for a sine.
    """

    phase: FloatArray = field(metadata=HIDDEN)
    rate_hz: float
    u_rate_hz: float
    wander_us: float
    jitter_us: float
    on_share: float
    depth: float
    clearness: float
    between_share: float = 0.0

    def states(self, settle_s: float, emitters: int = 1) -> IntArray:
        """Return the state of each sample, (N,); samples that are settling or at an edge are dropped.

        Edge positions lie between two samples and have a jitter, of which three standard uncertainties are excluded. If
        the recorder and the emitters share a clock, the sample at an edge may be on either side of the edge.
        """
        turns = np.floor(self.phase).astype(np.int64)
        inside = self.phase - turns
        is_on = inside < self.on_share
        since = np.where(is_on, inside, inside - self.on_share) / self.rate_hz
        until = np.where(is_on, self.on_share - inside, 1.0 - inside) / self.rate_hz
        whole = turns - turns.min() if turns.size else turns
        state = np.where(is_on, whole % emitters + 1, OFF)
        guard = 3e-6 * self.jitter_us
        apart = AT_EDGE * (self.phase[-1] - self.phase[0]) / max(len(self.phase) - 1, 1) / self.rate_hz
        edge = (since < guard + max(settle_s, apart)) | (until < guard + apart)
        return np.asarray(np.where(edge, DROPPED, state), dtype=np.int64)

    @property
    def shorter_s(self) -> float:
        """Duration of the shorter of the two phases; a gap shorter than this cannot hide a change of state."""
        return min(self.on_share, 1.0 - self.on_share) / self.rate_hz


def find_clock(time_s: FloatArray, values: FloatArray, rate_hz: float, *, on: On = "low", emitters: int = 1) -> Clock:
    """Find the clock in a waveform.

    Parameters
    ----------
    time_s
        Times, ascending and nearly evenly spaced, (N,).
    values
        Channels, (N, C), all of which change in the same direction with the light.
    rate_hz
        Nominal number of readings per second from one emitter; the true rate may differ by up to 5 %.
    on
        Whether light makes the values low, as with a receiver that pulls a load down, or high.
    emitters
        Number of emitters switched in sequence.

    Raises
    ------
    DataError
        If the recording is too short or too slowly sampled, or shows no modulation near that rate.
    """
    stated = rate_hz * emitters
    signal = np.nan_to_num(values - np.nanmean(values, axis=0)).sum(axis=1) * (-1.0 if on == "low" else 1.0)
    _check(time_s, stated)
    start = time_s - time_s[0]
    near = _strongest(start, signal, stated)
    middle, turns, clearness, level = _followed(start, signal, near)
    if clearness < CLEAR:
        limit = (
            f"no clear modulation near this rate: the modulation is {clearness:.1f} times its noise, "
            f"but at least {CLEAR:g} times is needed"
        )
        raise DataError(
            "rate_hz", value=rate_hz, limit=limit, remedy="specify the rate, or record the switch state in a column"
        )
    slope, u_slope, rough = _line(middle, turns)
    phase = near * start + _between(middle, turns, start)
    folded = _folded(phase, level)
    _check_once(folded, rate_hz)
    rise, on_share, depth = _edges(folded)
    phase -= rise
    phase -= np.floor(phase[0] + 1e-9)
    wander = turns - np.polyval(np.polyfit(middle, turns, 1), middle)
    clock = near + slope
    return Clock(
        phase=phase,
        rate_hz=clock,
        u_rate_hz=u_slope,
        wander_us=1e6 * float(np.abs(wander).max()) / clock,
        jitter_us=1e6 * rough / clock,
        on_share=on_share,
        depth=depth,
        clearness=clearness,
        between_share=_between_share(phase, level, emitters),
    )


def find_switching(time_s: FloatArray, values: FloatArray, on: On = "low") -> Clock | None:
    """Find the clock in a waveform from one emitter with an unknown rate; None if the emitter does not switch.

    Times (N,) are ascending, and the values (N, C) change in the same direction with the light. The strongest spectral
    lines are tried in order.
    """
    step = float(np.median(np.diff(time_s)))
    if not step > 0.0 or 1.0 / step < MIN_SAMPLES * MIN_HZ:
        return None
    start = time_s - time_s[0]
    signal = -(values - values.mean(axis=0)).sum(axis=1)
    for rate_hz in _lines(start, signal, 1.0 / step / MIN_SAMPLES):
        try:
            clock = find_clock(time_s, values, rate_hz, on=on)
        except DataError:
            continue
        if clock.clearness >= CERTAIN and clock.between_share <= SMOOTH:
            return clock
    return None


def _lines(start: FloatArray, signal: FloatArray, fastest_hz: float) -> list[float]:
    """Return the frequencies of the strongest spectral lines in the first seconds, in descending order of their amplitude."""
    last = max(int(np.searchsorted(start, SEARCHED_S)), 2)
    frequency = np.fft.rfftfreq(last, float(start[last - 1]) / (last - 1))
    power = np.abs(np.fft.rfft((signal[:last] - signal[:last].mean()) * np.hanning(last)))
    power[(frequency < MIN_HZ) | (frequency > fastest_hz)] = 0.0
    values: list[float] = []
    for _ in range(TRIED):
        place = int(np.argmax(power))
        if not power[place] > 0.0:
            break
        values.append(float(frequency[place]))
        power[np.abs(frequency - frequency[place]) <= SEARCHED_SHARE * frequency[place]] = 0.0
    return values


def _check(time_s: FloatArray, rate_hz: float) -> None:
    length = float(time_s[-1] - time_s[0]) if len(time_s) > 1 else 0.0
    if length * rate_hz < MIN_PERIODS:
        limit = f"must contain at least {MIN_PERIODS} periods of {rate_hz:g} Hz to determine its clock"
        raise DataError("recording", value=f"{length:.3g} s", limit=limit)
    per_period = (len(time_s) - 1) / (length * rate_hz)
    if per_period < MIN_SAMPLES:
        limit = f"samples in a period of {rate_hz:g} Hz, but at least {MIN_SAMPLES} are needed to determine the edges"
        raise DataError("recording", value=round(per_period, 2), limit=limit, remedy="add a state column (--state)")


def _strongest(start: FloatArray, signal: FloatArray, rate_hz: float) -> float:
    """Return the frequency of the strongest spectral line near the specified rate in the first seconds, by zero padding."""
    last = max(int(np.searchsorted(start, SEARCHED_S)), 2)
    values = signal[:last] - signal[:last].mean()
    step = float(start[last - 1]) / (last - 1)
    padded = 1 << (4 * last - 1).bit_length()
    frequency = np.fft.rfftfreq(padded, step)
    power = np.abs(np.fft.rfft(values * np.hanning(last), padded))
    near = np.abs(frequency - rate_hz) <= SEARCHED_SHARE * rate_hz
    return float(frequency[near][int(np.argmax(power[near]))])


def _followed(
    start: FloatArray, signal: FloatArray, rate_hz: float
) -> tuple[FloatArray, FloatArray, float, FloatArray]:
    """Return the midpoint of each block, its phase relative to a clock with that rate, and the modulation-to-noise ratio.

    The phase is in periods. The last returned value is the signal minus the mean of each block, which removes a drift
    of the room light.
    """
    periods = min(BLOCK_PERIODS, max(2, int(start[-1] * rate_hz) // 4))
    block = np.minimum((start * rate_hz / periods).astype(np.int64), int(start[-1] * rate_hz / periods) - 1)
    count = np.bincount(block)
    turning = np.exp(-2j * np.pi * rate_hz * start)
    mean = np.bincount(block, signal) / count
    level = signal - mean[block]
    real, imaginary = (np.bincount(block, level * part) / count for part in (turning.real, turning.imag))
    fundamental = real + 1j * imaginary
    turns = np.unwrap(np.angle(fundamental)) / (2.0 * np.pi)
    line = np.median(np.abs(fundamental))
    beside = _noise(start, level, rate_hz, block, count)
    return np.bincount(block, start) / count, turns, float(line / beside) if beside > 0.0 else np.inf, level


def _noise(start: FloatArray, level: FloatArray, rate_hz: float, block: IntArray, count: IntArray) -> float:
    """Return the noise of the blocks at three quarters of the line frequency, where a switched signal has no harmonic."""
    turning = np.exp(-2j * np.pi * 0.7309 * rate_hz * start)
    real, imaginary = (np.bincount(block, level * part) / count for part in (turning.real, turning.imag))
    return float(np.median(np.hypot(real, imaginary)))


def _line(middle: FloatArray, turns: FloatArray) -> tuple[float, float, float]:
    """Return the slope of the phase in Hz with its uncertainty, and the noise of a block's phase in periods, without drift."""
    if len(middle) < 3:
        return float((turns[-1] - turns[0]) / (middle[-1] - middle[0])) if len(middle) > 1 else 0.0, np.inf, 0.0
    bends = turns[1:-1] - 0.5 * (turns[:-2] + turns[2:])
    rough = float(np.sqrt(np.mean(bends**2) / 1.5))
    slope = float(np.polyfit(middle, turns, 1)[0])
    u_slope = rough / float(np.sqrt(np.sum((middle - middle.mean()) ** 2)))
    return slope, u_slope, rough


def _between(middle: FloatArray, turns: FloatArray, start: FloatArray) -> FloatArray:
    """Return the phase at every sample, interpolated between the block midpoints and extrapolated at both ends."""
    if len(middle) == 1:
        return np.full_like(start, turns[0])
    found = np.interp(start, middle, turns)
    for end, beyond in ((0, start < middle[0]), (-1, start > middle[-1])):
        near = (0, 1) if end == 0 else (-2, -1)
        slope = (turns[near[1]] - turns[near[0]]) / (middle[near[1]] - middle[near[0]])
        found[beyond] = turns[end] + slope * (start[beyond] - middle[end])
    return found


def _folded(phase: FloatArray, signal: FloatArray, turns: int = 1) -> FloatArray:
    """Return the mean signal over the phase, in bins of one or several periods."""
    bins = turns * BINS
    place = np.floor((phase % turns) * BINS).astype(np.int64) % bins
    count = np.bincount(place, minlength=bins)
    filled = np.flatnonzero(count)
    means = np.bincount(place, signal, minlength=bins)[filled] / count[filled]
    return np.interp(np.arange(bins), filled, means, period=bins)


def _between_share(phase: FloatArray, signal: FloatArray, emitters: int) -> float:
    """Return the fraction of a period in which the signal is between a quarter and three quarters of each emitter's height."""
    waves = _folded(phase, signal, emitters).reshape(emitters, BINS)
    low, high = np.percentile(waves, [10, 90], axis=1)
    above = waves - 0.5 * (low + high)[:, None]
    return float((np.abs(above) < 0.25 * (high - low)[:, None]).mean())


def _levels(folded: FloatArray) -> tuple[float, float]:
    return float(np.percentile(folded, 10)), float(np.percentile(folded, 90))


def _check_once(folded: FloatArray, rate_hz: float) -> None:
    """Raise `DataError` if a period contains several "on" phases: the rate is then a fraction of the true rate."""
    low, high = _levels(folded)
    marks = np.where(folded > low + 0.7 * (high - low), 1, np.where(folded < low + 0.3 * (high - low), -1, 0))
    marks = marks[marks != 0]
    rises = int(np.sum((marks == 1) & (np.roll(marks, 1) == -1)))
    if rises > 1:
        limit = f"one period at this rate contains {rises} on phases"
        raise DataError("rate_hz", value=rate_hz, limit=limit, remedy=f"try {rises * rate_hz:g}, or more emitters")


def _edges(folded: FloatArray) -> tuple[float, float, float]:
    """Return the phase of the rising edge in the folded signal, fraction of the signal above half height, and signal height."""
    low, high = _levels(folded)
    above = folded - 0.5 * (low + high)
    rise, fall = _crossing(above), _crossing(-above)
    return rise, float((fall - rise) % 1.0), high - low


def _crossing(above: FloatArray) -> float:
    """Return the phase of the steepest crossing from below to above zero, interpolated between bins."""
    following = np.roll(above, -1)
    candidates = np.flatnonzero((above < 0.0) & (following >= 0.0))
    if not candidates.size:
        raise DataError(
            "waveform",
            limit="shows no edge at that rate",
            remedy="specify the rate, or record the switch state in a column",
        )
    width = 3
    climb = [
        np.roll(above, -place)[: width + 1].mean() - np.roll(above, width - place)[:width].mean()
        for place in candidates
    ]
    place = int(candidates[int(np.argmax(climb))])
    share = above[place] / (above[place] - following[place])
    return float((place + 0.5 + share) / BINS % 1.0)
