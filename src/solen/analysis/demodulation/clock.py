"""Recovery of the emitter clock from a waveform that was sampled while the emitters switched.

The sum of all channels rises and falls with the emitters. Its phase at the switching frequency is determined block by
block, and thus follows a drift between the clocks of emitter and recorder. Folding the samples at this phase gives the
shape of one period, whose edges are at half its height. Whether a sample is on, off or too close to an edge then
depends only on its time, not on its noise.

If several emitters are switched in sequence, each on and off once, the detected clock is that of the "on" slots. An
emitter is then identified by its position in the sequence, counted from the first "on" slot in the recording.

Public names: `find_clock`, `find_switching` and `Clock`.
"""

from dataclasses import field
from typing import Literal

import numpy as np

from solen.analysis.demodulation.slots import DROPPED, OFF
from solen.arrays import ComplexArray, FloatArray, IntArray
from solen.errors import DataError
from solen.results import HIDDEN, Result

On = Literal["low", "high"]

MIN_PERIODS, BLOCK_PERIODS = 8, 32
EDGE_MARGIN = 0.45
"""Distance from an edge, in sample intervals, within which a sample may be on either side of the edge."""
MIN_SAMPLES = 6
"""Smallest number of samples in a period: an edge, a settled and a spare sample in each phase."""
SEARCHED_FRACTION, SEARCHED_S = 0.05, 10.0
"""Half-width of the search range relative to the specified rate, and length of the part of the recording that is
searched.
"""
BINS = 200
MIN_DETECTED, MIN_CERTAIN = 6.0, 20.0
"""Ratio of modulation to noise above which a clock is detected, and above which its edges are certain."""
MAX_TRANSITION = 0.2
"""Transition time, as a fraction of a period, above which the modulation is that of flicker rather than of a switch."""
NOISE_RATIO = 0.7309
"""Frequency at which the noise is measured, relative to that of the line: a switched signal has no harmonic there."""
_REMEDY = "correct the rate, or record the state of the emitters in a column"
MIN_HZ, MAX_LINES = 15.0, 4
"""Lowest rate searched if none is specified, which exceeds that of any motion, and number of spectral lines tried."""


class Clock(Result):
    """Emitter clock, with the phases of N samples.

    Attributes
    ----------
    phase
        Switching periods since the first switch-on edge, (N,); integers are at switch-on edges.
    rate_hz, u_rate_hz
        Mean switching frequency on the recording's clock, and its standard uncertainty.
    wander_us
        Largest deviation of an edge from its time on a clock with a constant rate.
    jitter_us
        Standard uncertainty of the time of an edge.
    on_share
        Fraction of a period for which an emitter is on.
    depth
        Modulation depth in the sum of the channels, in their unit.
    clearness
        Ratio of the modulation to its noise.
    between_share
        Fraction of a period in which the signal is between a quarter and three quarters of its height: small for a
        switch, 1/3 for a sine.
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

        Samples within three standard uncertainties of an edge are dropped. If recorder and emitters share a clock, a
        sample may always coincide with an edge; samples closer than about half a sample interval are therefore also
        dropped.
        """
        period = np.floor(self.phase).astype(np.int64)
        within = self.phase - period
        is_on = within < self.on_share
        since_s = np.where(is_on, within, within - self.on_share) / self.rate_hz
        until_s = np.where(is_on, self.on_share - within, 1.0 - within) / self.rate_hz
        number = period - period.min() if period.size else period
        state = np.where(is_on, number % emitters + 1, OFF)
        jitter_s = 3e-6 * self.jitter_us
        margin_s = EDGE_MARGIN * (self.phase[-1] - self.phase[0]) / max(len(self.phase) - 1, 1) / self.rate_hz
        at_edge = (since_s < jitter_s + max(settle_s, margin_s)) | (until_s < jitter_s + margin_s)
        return np.asarray(np.where(at_edge, DROPPED, state), dtype=np.int64)

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
        Whether light makes the values low, as with a receiver that pulls its output down, or high.
    emitters
        Number of emitters switched in sequence.

    Raises
    ------
    DataError
        If the recording is too short or too slowly sampled, or shows no modulation near the specified rate.
    """
    nominal_hz = rate_hz * emitters
    signal = np.nan_to_num(values - np.nanmean(values, axis=0)).sum(axis=1) * (-1.0 if on == "low" else 1.0)
    _check(time_s, nominal_hz)
    elapsed_s = time_s - time_s[0]
    line_hz = _strongest(elapsed_s, signal, nominal_hz)
    middle_s, block_phase, clearness, level = _block_phases(elapsed_s, signal, line_hz)
    if clearness < MIN_DETECTED:
        limit = (
            f"no clear modulation near this rate: the modulation is {clearness:.1f} times its noise, "
            f"but at least {MIN_DETECTED:g} times is needed"
        )
        raise DataError("rate_hz", value=rate_hz, limit=limit, remedy=_REMEDY)
    slope_hz, u_slope_hz, noise = _line(middle_s, block_phase)
    phase = line_hz * elapsed_s + _interpolated(middle_s, block_phase, elapsed_s)
    folded = _folded(phase, level)
    _check_once(folded, rate_hz)
    rise, on_share, depth = _edges(folded)
    phase -= rise
    phase -= np.floor(phase[0] + 1e-9)
    wander = block_phase - np.polyval(np.polyfit(middle_s, block_phase, 1), middle_s)
    clock_hz = line_hz + slope_hz
    return Clock(
        phase=phase,
        rate_hz=clock_hz,
        u_rate_hz=u_slope_hz,
        wander_us=1e6 * float(np.abs(wander).max()) / clock_hz,
        jitter_us=1e6 * noise / clock_hz,
        on_share=on_share,
        depth=depth,
        clearness=clearness,
        between_share=_transition(phase, level, emitters),
    )


def find_switching(time_s: FloatArray, values: FloatArray, on: On = "low") -> Clock | None:
    """Find the clock in a waveform from one emitter with an unknown rate; None if the emitter does not switch.

    Times (N,) are ascending, and the values (N, C) change in the same direction with the light. The strongest spectral
    lines are tried in order.
    """
    step = float(np.median(np.diff(time_s)))
    if not step > 0.0 or 1.0 / step < MIN_SAMPLES * MIN_HZ:
        return None
    signal = -(values - values.mean(axis=0)).sum(axis=1)
    for rate_hz in _lines(time_s - time_s[0], signal, 1.0 / step / MIN_SAMPLES):
        try:
            clock = find_clock(time_s, values, rate_hz, on=on)
        except DataError:
            continue
        if clock.clearness >= MIN_CERTAIN and clock.between_share <= MAX_TRANSITION:
            return clock
    return None


def _lines(elapsed_s: FloatArray, signal: FloatArray, max_hz: float) -> list[float]:
    """Return the frequencies of the strongest spectral lines in the first seconds, the strongest first."""
    frequency, amplitude = _spectrum(elapsed_s, signal)
    amplitude[(frequency < MIN_HZ) | (frequency > max_hz)] = 0.0
    lines: list[float] = []
    while len(lines) < MAX_LINES and amplitude.max() > 0.0:
        line_hz = float(frequency[int(np.argmax(amplitude))])
        lines.append(line_hz)
        amplitude[np.abs(frequency - line_hz) <= SEARCHED_FRACTION * line_hz] = 0.0
    return lines


def _spectrum(elapsed_s: FloatArray, signal: FloatArray, padding: int = 1) -> tuple[FloatArray, FloatArray]:
    """Return the amplitude spectrum of the first seconds, zero-padded to at least ``padding`` times their length."""
    count = max(int(np.searchsorted(elapsed_s, SEARCHED_S)), 2)
    length = count if padding == 1 else 1 << (padding * count - 1).bit_length()
    frequency = np.fft.rfftfreq(length, float(elapsed_s[count - 1]) / (count - 1))
    amplitude = np.abs(np.fft.rfft((signal[:count] - signal[:count].mean()) * np.hanning(count), length))
    return np.asarray(frequency, np.float64), np.asarray(amplitude, np.float64)


def _check(time_s: FloatArray, rate_hz: float) -> None:
    length = float(time_s[-1] - time_s[0]) if len(time_s) > 1 else 0.0
    if length * rate_hz < MIN_PERIODS:
        limit = (
            f"lasts {length:.3g} s, but at least {MIN_PERIODS} periods of {rate_hz:g} Hz are needed to determine the "
            "clock"
        )
        raise DataError("recording", limit=limit, remedy="record for longer, or correct the rate")
    per_period = (len(time_s) - 1) / (length * rate_hz)
    if per_period < MIN_SAMPLES:
        limit = (
            f"has {per_period:.3g} samples in a period of {rate_hz:g} Hz, but at least {MIN_SAMPLES} are needed to "
            "determine the edges"
        )
        raise DataError("recording", limit=limit, remedy="sample faster, or add a state column (--state)")


def _strongest(elapsed_s: FloatArray, signal: FloatArray, rate_hz: float) -> float:
    """Return the frequency of the strongest spectral line near a rate in the first seconds, with zero padding."""
    frequency, amplitude = _spectrum(elapsed_s, signal, padding=4)
    near = np.abs(frequency - rate_hz) <= SEARCHED_FRACTION * rate_hz
    return float(frequency[near][int(np.argmax(amplitude[near]))])


def _block_phases(
    elapsed_s: FloatArray, signal: FloatArray, rate_hz: float
) -> tuple[FloatArray, FloatArray, float, FloatArray]:
    """Return the midpoints and phases of the blocks, the modulation-to-noise ratio, and the signal without drift.

    The phases are in periods, relative to a clock with the specified rate. The signal without drift is the signal minus
    the mean of each block, which removes changes in the room light.
    """
    periods = min(BLOCK_PERIODS, max(2, int(elapsed_s[-1] * rate_hz) // 4))
    block = np.minimum((elapsed_s * rate_hz / periods).astype(np.int64), int(elapsed_s[-1] * rate_hz / periods) - 1)
    count = np.bincount(block)
    level = signal - (np.bincount(block, signal) / count)[block]
    fundamental = _block_amplitudes(elapsed_s, level, rate_hz, block)
    phase = np.unwrap(np.angle(fundamental)) / (2.0 * np.pi)
    noise = float(np.median(np.abs(_block_amplitudes(elapsed_s, level, NOISE_RATIO * rate_hz, block))))
    ratio = float(np.median(np.abs(fundamental))) / noise if noise > 0.0 else np.inf
    return np.bincount(block, elapsed_s) / count, phase, ratio, level


def _block_amplitudes(elapsed_s: FloatArray, level: FloatArray, hz: float, block: IntArray) -> ComplexArray:
    """Return the complex amplitude of each block at a frequency."""
    wave = np.exp(-2j * np.pi * hz * elapsed_s)
    real, imaginary = (np.bincount(block, level * part) for part in (wave.real, wave.imag))
    return np.asarray((real + 1j * imaginary) / np.bincount(block))


def _line(middle_s: FloatArray, phase: FloatArray) -> tuple[float, float, float]:
    """Return the slope of the phase in Hz, its uncertainty, and the noise of the phase of a block in periods."""
    if len(middle_s) < 3:
        slope = (phase[-1] - phase[0]) / (middle_s[-1] - middle_s[0]) if len(middle_s) > 1 else 0.0
        return float(slope), np.inf, 0.0
    deviation = phase[1:-1] - 0.5 * (phase[:-2] + phase[2:])
    noise = float(np.sqrt(np.mean(deviation**2) / 1.5))
    slope = float(np.polyfit(middle_s, phase, 1)[0])
    return slope, noise / float(np.sqrt(np.sum((middle_s - middle_s.mean()) ** 2))), noise


def _interpolated(middle_s: FloatArray, phase: FloatArray, elapsed_s: FloatArray) -> FloatArray:
    """Return the phase at every sample, interpolated between the block midpoints and extrapolated at both ends."""
    if len(middle_s) == 1:
        return np.full_like(elapsed_s, phase[0])
    interpolated = np.interp(elapsed_s, middle_s, phase)
    for end, inner, outside in ((0, 1, elapsed_s < middle_s[0]), (-1, -2, elapsed_s > middle_s[-1])):
        slope = (phase[inner] - phase[end]) / (middle_s[inner] - middle_s[end])
        interpolated[outside] = phase[end] + slope * (elapsed_s[outside] - middle_s[end])
    return interpolated


def _folded(phase: FloatArray, signal: FloatArray, periods: int = 1) -> FloatArray:
    """Return the mean signal over the phase, in bins of one or several periods."""
    bins = periods * BINS
    index = np.floor((phase % periods) * BINS).astype(np.int64) % bins
    count = np.bincount(index, minlength=bins)
    filled = np.flatnonzero(count)
    means = np.bincount(index, signal, minlength=bins)[filled] / count[filled]
    return np.interp(np.arange(bins), filled, means, period=bins)


def _transition(phase: FloatArray, signal: FloatArray, emitters: int) -> float:
    """Return the fraction of a period in which the signal is between 1/4 and 3/4 of an emitter's height."""
    waves = _folded(phase, signal, emitters).reshape(emitters, BINS)
    low, high = np.percentile(waves, [10, 90], axis=1)
    above = waves - 0.5 * (low + high)[:, None]
    return float((np.abs(above) < 0.25 * (high - low)[:, None]).mean())


def _levels(folded: FloatArray) -> tuple[float, float]:
    return float(np.percentile(folded, 10)), float(np.percentile(folded, 90))


def _check_once(folded: FloatArray, rate_hz: float) -> None:
    """Raise `DataError` if a period contains several "on" phases, because the specified rate is too low."""
    low, high = _levels(folded)
    marks = np.where(folded > low + 0.7 * (high - low), 1, np.where(folded < low + 0.3 * (high - low), -1, 0))
    marks = marks[marks != 0]
    rises = int(np.sum((marks == 1) & (np.roll(marks, 1) == -1)))
    if rises > 1:
        limit = f"a period at this rate contains {rises} on phases"
        remedy = f"specify {rises * rate_hz:g}, or the number of emitters"
        raise DataError("rate_hz", value=rate_hz, limit=limit, remedy=remedy)


def _edges(folded: FloatArray) -> tuple[float, float, float]:
    """Return the phase of the rising edge of a folded signal, the fraction above half height, and the height."""
    low, high = _levels(folded)
    above = folded - 0.5 * (low + high)
    rise, fall = _crossing(above), _crossing(-above)
    return rise, float((fall - rise) % 1.0), high - low


def _crossing(above: FloatArray) -> float:
    """Return the phase of the steepest crossing from below to above zero, interpolated between bins."""
    following = np.roll(above, -1)
    candidates = np.flatnonzero((above < 0.0) & (following >= 0.0))
    if not candidates.size:
        raise DataError("waveform", limit="shows no edge at this rate", remedy=_REMEDY)
    width = 3
    rises = [
        np.roll(above, -index)[: width + 1].mean() - np.roll(above, width - index)[:width].mean()
        for index in candidates
    ]
    index = int(candidates[int(np.argmax(rises))])
    fraction = above[index] / (above[index] - following[index])
    return float((index + 0.5 + fraction) / BINS % 1.0)
