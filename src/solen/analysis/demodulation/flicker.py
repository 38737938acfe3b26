"""Lamp flicker in a waveform, fitted to the samples while the emitters are off, and subtracted from all samples.

Lamps flicker at twice the mains frequency, and wires pick up the mains frequency itself. In readings at 200 Hz, flicker
of 100 Hz alternates from one reading to the next, so no difference between slots removes it. However, the samples
inside the "off" slots show the ambient light alone. Harmonics of the mains frequency are fitted to these samples in
overlapping windows of a third of a second, which are short enough to follow slow changes of a lamp. The phase change
from window to window gives the frequency. The fit is also subtracted from the samples in the "on" slots. Nothing is
averaged over time, so the motion of a sensor is not smeared.

A harmonic at a multiple of the switching rate looks like the emitter's light, and a window is too short to separate the
two. It is therefore fitted to the entire recording, in which it has a constant amplitude and phase relative to the
lamp's fundamental, which is known. If it hardly drifts relative to the switching, only its shape inside the "off" slots
distinguishes it; the first part of each slot, in which a slow receiver may still be settling, is then not used.

Public names: `find_flicker`, `resolved_orders` and `Flicker`.
"""

from dataclasses import dataclass, field

import numpy as np

from solen.analysis.demodulation.slots import OFF
from solen.arrays import BoolArray, ComplexArray, FloatArray, IntArray, rows_of
from solen.results import HIDDEN, Result

MAINS_HZ = (50.0, 60.0)
ORDERS, LAMP_ORDER = (1, 2, 4), 2
"""Orders of the fitted harmonics of the mains frequency (others alias to these in slots at 200 Hz), and that of the
lamps' fundamental.
"""
WINDOW_S, MIN_SAMPLES_PER_PARAMETER = 0.32, 30
"""Length of a window, and the smallest number of "off" samples per fitted parameter."""
MIN_SIGNIFICANCE, MIN_AMPLITUDE = 8.0, 0.02
"""Smallest ratio of a harmonic's power to its uncertainty, and smallest amplitude relative to the strongest one."""
MIN_DISTANCE_HZ = 6.0
"""Smallest distance of a harmonic from a multiple of the switching rate that a window can resolve."""
MAX_OFFSET_HZ = 1.0
"""Largest deviation of the mains frequency from its nominal value; a fit that deviates more is not of lamps."""
MAX_VARIANCE = 6.0
"""Ratio to the median residual variance above which a window is disturbed, e.g. by a lamp being switched on."""
MIN_DRIFT, SETTLING = 2.0, 0.4
"""Periods by which a harmonic must drift relative to the switching; with less drift, this first fraction of each "off"
slot is not used.
"""


class Flicker(Result):
    """Light of mains-powered lamps in C channels.

    Attributes
    ----------
    mains_hz
        Mains frequency on the recording's clock.
    multiples
        Orders of the harmonics of the mains frequency that were subtracted; 1 is the mains frequency itself.
    amplitude
        Amplitude of the strongest harmonic in each channel, in the channel's unit, (C,).
    values
        Value subtracted from each sample, (N, C).
    """

    mains_hz: float
    multiples: tuple[int, ...]
    amplitude: FloatArray
    values: FloatArray = field(metadata=HIDDEN)


def find_flicker(
    time_s: FloatArray,
    values: FloatArray,
    state: IntArray,
    rate_hz: float,
    mains_hz: tuple[float, ...] = MAINS_HZ,
    used: BoolArray | None = None,
) -> Flicker | None:
    """Find flicker in samples; None if no harmonic of the mains frequency is significant.

    Parameters
    ----------
    time_s, values, state
        Samples, (N,), (N, C) and (N,).
    rate_hz
        Rate of the "on" slots.
    mains_hz
        Nominal mains frequencies; the one with the most significant harmonic is used.
    used
        Mask of usable samples, i.e. samples that are not at a limit, (N,).
    """
    off = (state == OFF) & np.isfinite(values).all(axis=1)
    if used is not None:
        off &= used
    off_samples = _OffSamples(time_s[off], values[off], _settled(state)[off])
    fits = [fit for nominal in mains_hz if (fit := _fitted(off_samples, nominal, rate_hz)) is not None]
    if not fits:
        return None
    best = max(fits, key=lambda fit: fit.significance)
    flicker, orders = best.at(time_s), best.orders
    for order in ORDERS:
        drift = abs(_distance_hz(order * best.mains_hz, rate_hz)) * float(np.ptp(time_s))
        if order % LAMP_ORDER == 0 and LAMP_ORDER in orders and order not in best.resolved:
            flicker += best.harmonic(time_s, off_samples, order // LAMP_ORDER, drifts=drift > MIN_DRIFT)
            orders = (*orders, order)
    return Flicker(best.mains_hz, tuple(sorted(orders)), best.amplitudes.max(axis=0), flicker)


def resolved_orders(mains_hz: float, rate_hz: float) -> tuple[int, ...]:
    """Return the orders of the harmonics that a window separates from the light of emitters switched at a rate."""
    return tuple(order for order in ORDERS if abs(_distance_hz(order * mains_hz, rate_hz)) > MIN_DISTANCE_HZ)


def _settled(state: IntArray) -> BoolArray:
    """Return a mask of the samples after the first part, i.e. `SETTLING`, of each run with the same state."""
    starts = np.flatnonzero(np.diff(state, prepend=state[0] - 1))
    lengths = np.diff(np.append(starts, state.size))
    since_start = np.arange(state.size) - np.repeat(starts, lengths)
    return np.asarray(since_start >= SETTLING * np.repeat(lengths, lengths))


def _distance_hz(hz: float, rate_hz: float) -> float:
    """Return the signed distance of a frequency from the nearest multiple of a rate."""
    return (hz + 0.5 * rate_hz) % rate_hz - 0.5 * rate_hz


@dataclass(frozen=True, eq=False)
class _OffSamples:
    """Samples with the emitters off, (n,) and (n, C), and a mask of samples that are not at the start of a slot."""

    time_s: FloatArray
    values: FloatArray
    settled: BoolArray

    def windows(self) -> list[tuple[float, slice]]:
        """Return the midpoints and samples of windows that overlap by half."""
        if not self.time_s.size:
            return []
        hop = 0.5 * WINDOW_S
        count = max(1, int((self.time_s[-1] - self.time_s[0]) / hop) - 1)
        starts = self.time_s[0] + hop * np.arange(count)
        ends = np.append(starts[:-1] + WINDOW_S, self.time_s[-1] + 1e-9)
        bounds = np.searchsorted(self.time_s, [starts, ends])
        middles = 0.5 * (starts + ends)
        return [(float(t), slice(int(a), int(b))) for t, a, b in zip(middles, *bounds, strict=True)]

    def without_means(self, values: FloatArray) -> FloatArray:
        """Return the values at the "off" samples (n, k) minus their mean over each half window."""
        half = ((self.time_s - self.time_s[0]) / (0.5 * WINDOW_S)).astype(np.int64)
        count = np.maximum(np.bincount(half), 1)
        return np.column_stack([column - (np.bincount(half, column) / count)[half] for column in values.T])


@dataclass(frozen=True, eq=False)
class _Fit:
    """Harmonics in windows: midpoints (w,), phasors (w, orders, C), and the largest significance of a harmonic.

    ``resolved`` are the orders that a window separates from the switching, ``orders`` the significant ones.
    """

    mains_hz: float
    resolved: tuple[int, ...]
    orders: tuple[int, ...]
    middle_s: FloatArray
    phasors: ComplexArray
    power: FloatArray
    significance: float

    @property
    def amplitudes(self) -> FloatArray:
        """Amplitude of each harmonic in each channel, (orders, C)."""
        return np.asarray(np.sqrt(self.power))

    def wave(self, time_s: FloatArray, order: int) -> ComplexArray:
        """Return a harmonic as a complex wave, (n, C), with phasors interpolated between the window midpoints."""
        phasors = self.phasors[:, self.orders.index(order)]
        carrier = np.exp(2j * np.pi * self.mains_hz * order * time_s)[:, None]
        slow = np.column_stack([np.interp(time_s, self.middle_s, column) for column in phasors.T])
        return np.asarray(slow * carrier)

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return the sum of the harmonics at the specified times, (n, C)."""
        return np.asarray(sum(self.wave(time_s, order).real for order in self.orders))

    def harmonic(self, time_s: FloatArray, off_samples: _OffSamples, order: int, *, drifts: bool) -> FloatArray:
        """Return a harmonic (n, C), fitted to the entire recording, that follows the fundamental of the lamp."""
        if not drifts:
            off_samples = rows_of(off_samples, off_samples.settled)
        residual = off_samples.without_means(off_samples.values - self.at(off_samples.time_s))
        off_wave = _harmonic_of(self.wave(off_samples.time_s, LAMP_ORDER), order)
        wave = _harmonic_of(self.wave(time_s, LAMP_ORDER), order)
        columns = []
        for channel in range(residual.shape[1]):
            basis = off_samples.without_means(_real_columns(off_wave[:, channel]))
            coefficients = np.linalg.lstsq(basis, residual[:, channel], rcond=None)[0]
            columns.append(_real_columns(wave[:, channel]) @ coefficients)
        return np.column_stack(columns)


def _real_columns(wave: ComplexArray) -> FloatArray:
    return np.column_stack([wave.real, wave.imag])


def _harmonic_of(wave: ComplexArray, order: int) -> ComplexArray:
    """Return a wave with the amplitude of another wave, and with ``order`` times its phase."""
    amplitude = np.abs(wave)
    return np.asarray(amplitude * (wave / np.where(amplitude > 0.0, amplitude, 1.0)) ** order)


def _fitted(off_samples: _OffSamples, nominal_hz: float, rate_hz: float) -> _Fit | None:
    """Return the significant harmonics of a nominal mains frequency, or None if there are none."""
    resolved = resolved_orders(nominal_hz, rate_hz)
    harmonics, mains_hz = _harmonics(off_samples, nominal_hz, resolved) if resolved else None, nominal_hz
    if harmonics is None:
        return None
    for _ in range(2):
        strongest = int(np.argmax(harmonics.significance()))
        mains_hz += _drift_hz(harmonics, strongest) / resolved[strongest]
        harmonics = _harmonics(off_samples, mains_hz, resolved) or harmonics
    if abs(mains_hz - nominal_hz) > MAX_OFFSET_HZ:
        return None
    significance, power = harmonics.significance(), harmonics.power()
    kept = (significance > MIN_SIGNIFICANCE) & (power.max(axis=1) > MIN_AMPLITUDE**2 * power.max())
    orders = tuple(np.array(resolved)[kept].tolist())
    if not orders:
        return None
    refined = _harmonics(off_samples, mains_hz, orders) or harmonics
    significance_max = float(significance.max())
    return _Fit(mains_hz, resolved, orders, refined.middle_s, refined.phasors, refined.power(), significance_max)


@dataclass(frozen=True, eq=False)
class _Harmonics:
    """Harmonics in windows: midpoints (w,), phasors (w, k, C), and their variances (w, k, C)."""

    middle_s: FloatArray
    phasors: ComplexArray
    variance: FloatArray

    def power(self) -> FloatArray:
        """Return the mean square amplitude, corrected for noise, (k, C)."""
        return np.asarray(np.maximum((np.abs(self.phasors) ** 2 - self.variance).mean(axis=0), 0.0))

    def significance(self) -> FloatArray:
        """Return the ratio of the power of each harmonic to its uncertainty, the largest of all channels, (k,)."""
        u = self.variance.mean(axis=0) / np.sqrt(max(len(self.middle_s) / 2.0, 1.0))
        return np.asarray((self.power() / np.where(u > 0.0, u, np.inf)).max(axis=1))


def _harmonics(off_samples: _OffSamples, mains_hz: float, orders: tuple[int, ...]) -> _Harmonics | None:
    """Return harmonics fitted in each window with enough samples, or None if there is no such window."""
    parameters = 2 + 2 * len(orders)
    hz = mains_hz * np.array(orders)
    middles, phasors, variances = [], [], []
    for middle, window in off_samples.windows():
        count = window.stop - window.start
        if count < MIN_SAMPLES_PER_PARAMETER * parameters:
            continue
        times, values = off_samples.time_s[window], off_samples.values[window]
        phase = 2.0 * np.pi * hz * times[:, None]
        columns = np.column_stack([np.ones(count), times - middle, np.cos(phase), -np.sin(phase)])
        inverse = np.linalg.inv(columns.T @ columns)
        fit = inverse @ (columns.T @ values)
        noise = ((values - columns @ fit) ** 2).sum(axis=0) / (count - parameters)
        middles.append(middle)
        phasors.append(fit[2 : 2 + hz.size] + 1j * fit[2 + hz.size :])
        variances.append(np.diag(inverse)[2:].reshape(2, -1).sum(axis=0)[:, None] * noise)
    if not middles:
        return None
    variance = np.array(variances)
    median = np.median(variance, axis=0)
    limit = MAX_VARIANCE * np.where(median > 0.0, median, np.inf)
    undisturbed = (variance <= limit).all(axis=(1, 2)) | ~(median > 0.0).any()
    if not undisturbed.any():
        return None
    return _Harmonics(np.array(middles)[undisturbed], np.array(phasors)[undisturbed], variance[undisturbed])


def _drift_hz(harmonics: _Harmonics, index: int) -> float:
    """Return the frequency offset of a harmonic, from its phase change between windows."""
    phasors = harmonics.phasors[:, index]
    steps = np.diff(harmonics.middle_s)
    if not steps.size:
        return 0.0
    change = np.angle((phasors[1:] * phasors[:-1].conj()).sum())
    return float(change / (2.0 * np.pi * np.median(steps)))
