"""Lamp flicker in a waveform, fitted to the samples while the emitters are off, and subtracted from all samples.

Lamps flicker at twice the mains frequency, and wires pick up the mains itself. In readings at 200 Hz, 100 Hz alternates
from one reading to the next, so no difference between slots can remove it. The samples inside the "off" slots can,
because they show only the ambient light. Sines at multiples of the mains frequency are fitted to these samples in
overlapping windows of a third of a second, short enough to follow slow changes of a lamp. The phase change from window
to window gives the frequency. The fit is also subtracted from the samples in the "on" slots. Nothing is averaged over
time, so the motion of a sensor is not smeared.

A multiple at the switching rate looks like the emitter's light, and a window is too short to separate the two. The
entire recording is long enough: this multiple has a constant amplitude and phase relative to the lamp's fundamental,
which is known. If the two hardly drift relative to each other, only the shape inside the "off" slots shows this
multiple; the first part of each slot, in which a slow receiver may still be settling, is then not used.

Public names: `find_flicker` and `Flicker`.
"""

from dataclasses import dataclass, field

import numpy as np

from solen.analysis.demodulation.slots import OFF
from solen.arrays import BoolArray, FloatArray, IntArray, rows_of
from solen.results import HIDDEN, Result

MAINS_HZ = (50.0, 60.0)
ORDERS, LAMP = (1, 2, 4), 2
"""Fitted multiples of the mains frequency (others alias to these in slots at 200 Hz), and the multiple of a lamp."""
WINDOW_S, MIN_SAMPLES_PER_PARAMETER = 0.32, 30
"""Length of a window, and the smallest number of "off" samples per fitted parameter."""
CLEAR, SHARE = 8.0, 0.02
"""Smallest ratio of a sine's power to its uncertainty, and smallest amplitude relative to the strongest sine."""
NEAR_RATE_HZ = 6.0
"""Smallest distance of a sine from a multiple of the switching rate that a window can resolve."""
DISTURBED = 6.0
"""Ratio to the typical residual variance above which a window is disturbed, e.g. by a lamp being switched on."""
TURNED, SETTLING = 2.0, 0.4
"""Periods by which a multiple must drift relative to the rate; with less drift, this first fraction of each "off"
slot is not used.
"""

_Complex = np.ndarray[tuple[int, ...], np.dtype[np.complex128]]


class Flicker(Result):
    """Light of mains-powered lamps in C channels.

    Attributes
    ----------
    mains_hz
        Mains frequency on the recording's clock.
    multiples
        Multiples of the mains frequency that were subtracted.
    amplitude
        Amplitude of the strongest multiple in each channel, in the channel's unit, (C,).
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
    """Find flicker in samples; None if no multiple of the mains frequency is significant.

    Parameters
    ----------
    time_s, values, state
        Samples, (N,), (N, C) and (N,).
    rate_hz
        Rate of the "on" slots.
    mains_hz
        Nominal mains frequencies; the frequency with the clearest sines is chosen.
    used
        Mask of usable samples, i.e. samples that are not at a limit, (N,).
    """
    off = (state == OFF) & np.isfinite(values).all(axis=1)
    if used is not None:
        off &= used
    off_samples = _OffSamples(time_s[off], values[off], _late(state)[off])
    found = [_fitted(off_samples, nominal, rate_hz) for nominal in mains_hz]
    best = max((one for one in found if one is not None), key=lambda one: one.clearness, default=None)
    if best is None:
        return None
    flicker, multiples = best.at(time_s), best.orders
    for order in ORDERS:
        drift = abs(_distance_hz(order * best.mains_hz, rate_hz)) * float(np.ptp(time_s))
        if order % LAMP == 0 and LAMP in multiples and order not in best.free:
            more = best.multiple(time_s, off_samples, order // LAMP, drift > TURNED)
            flicker, multiples = flicker + more, (*multiples, order)
    return Flicker(best.mains_hz, tuple(sorted(multiples)), best.heights.max(axis=0), flicker)


def _late(state: IntArray) -> BoolArray:
    """Return the samples that are not in the first part of a run with one state."""
    starts = np.flatnonzero(np.diff(state, prepend=state[0] - 1))
    lengths = np.diff(np.append(starts, state.size))
    inside = np.arange(state.size) - np.repeat(starts, lengths)
    return np.asarray(inside >= SETTLING * np.repeat(lengths, lengths))


def _distance_hz(hz: float, rate_hz: float) -> float:
    """Return the signed distance of a frequency from the nearest multiple of a rate."""
    return (hz + 0.5 * rate_hz) % rate_hz - 0.5 * rate_hz


@dataclass(frozen=True, eq=False)
class _OffSamples:
    """Samples with the emitters off, (n,) and (n, C), and a mask of those not at the beginning of a slot."""

    time_s: FloatArray
    values: FloatArray
    late: BoolArray

    def windows(self) -> list[tuple[float, slice]]:
        """Return the midpoints and samples of windows that overlap by half."""
        if not self.time_s.size:
            return []
        hop = 0.5 * WINDOW_S
        count = max(1, int((self.time_s[-1] - self.time_s[0]) / hop) - 1)
        starts = self.time_s[0] + hop * np.arange(count)
        ends = np.append(starts[:-1] + WINDOW_S, self.time_s[-1] + 1e-9)
        places = np.searchsorted(self.time_s, [starts, ends])
        middles = 0.5 * (starts + ends)
        return [(float(t), slice(int(a), int(b))) for t, a, b in zip(middles, *places, strict=True)]

    def without_means(self, values: FloatArray) -> FloatArray:
        """Return the values at the "off" samples (n, k) minus their mean over each half window."""
        place = ((self.time_s - self.time_s[0]) / (0.5 * WINDOW_S)).astype(np.int64)
        count = np.maximum(np.bincount(place), 1)
        return np.column_stack([one - (np.bincount(place, one) / count)[place] for one in values.T])


@dataclass(frozen=True, eq=False)
class _Fit:
    """Sines in windows: midpoints (w,), complex amplitudes (w, orders, C), and the highest significance of a sine."""

    mains_hz: float
    free: tuple[int, ...]
    orders: tuple[int, ...]
    middle_s: FloatArray
    sines: _Complex
    power: FloatArray
    clearness: float

    @property
    def heights(self) -> FloatArray:
        """Amplitude of each order in each channel, (orders, C)."""
        return np.asarray(np.sqrt(self.power))

    def order(self, time_s: FloatArray, order: int) -> _Complex:
        """Return the complex sine of an order at the specified times, (n, C), interpolated between the window midpoints."""
        own = self.sines[:, self.orders.index(order)]
        turning = np.exp(2j * np.pi * self.mains_hz * order * time_s)[:, None]
        slow = [np.interp(time_s, self.middle_s, part) for one in own.T for part in (one.real, one.imag)]
        return np.asarray(np.column_stack([a + 1j * b for a, b in zip(slow[::2], slow[1::2], strict=True)]) * turning)

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return the sum of all orders at the specified times, (n, C)."""
        return np.asarray(sum(self.order(time_s, order).real for order in self.orders))

    def multiple(self, time_s: FloatArray, off_samples: _OffSamples, times: int, drifts: bool) -> FloatArray:
        """Return the fitted multiple (n, C) of the lamp's phase at the specified times, with the lamp's amplitude variation."""
        if not drifts:
            off_samples = rows_of(off_samples, off_samples.late)
        left = off_samples.without_means(off_samples.values - self.at(off_samples.time_s))
        basis = _powers(self.order(off_samples.time_s, LAMP), times)
        wanted = _powers(self.order(time_s, LAMP), times)
        found = []
        for place in range(left.shape[1]):
            columns = off_samples.without_means(np.column_stack([basis[:, place].real, basis[:, place].imag]))
            numbers = np.linalg.lstsq(columns, left[:, place], rcond=None)[0]
            found.append(np.column_stack([wanted[:, place].real, wanted[:, place].imag]) @ numbers)
        return np.column_stack(found)


def _powers(sine: _Complex, times: int) -> _Complex:
    """Return the sine of a multiple of the phase, with the original sine's amplitude."""
    height = np.abs(sine)
    return np.asarray(height * (sine / np.where(height > 0.0, height, 1.0)) ** times)


def _fitted(off_samples: _OffSamples, nominal: float, rate_hz: float) -> _Fit | None:
    """Return the significant sines at multiples of a nominal mains frequency, or None if there are none."""
    free = tuple(order for order in ORDERS if abs(_distance_hz(order * nominal, rate_hz)) > NEAR_RATE_HZ)
    sines, mains = _sines(off_samples, nominal, free), nominal
    if sines is None:
        return None
    for _ in range(2):
        clear = sines.clear()
        order = free[int(np.argmax(clear))]
        mains += _drift_hz(sines, free.index(order)) / order
        refined = _sines(off_samples, mains, free)
        sines = sines if refined is None else refined
    clear, power = sines.clear(), sines.power()
    strong = power.max(axis=1) > SHARE**2 * power.max()
    orders = tuple(order for order, high, ok in zip(free, clear, strong, strict=True) if high > CLEAR and ok)
    if not orders:
        return None
    last = _sines(off_samples, mains, orders) or sines
    return _Fit(mains, free, orders, last.middle_s, last.heights, last.power(), float(clear.max()))


@dataclass(frozen=True, eq=False)
class _Sines:
    """Sines in windows: midpoints (w,), complex amplitudes at time zero (w, k, C), and their variances (w, k, C)."""

    middle_s: FloatArray
    heights: _Complex
    variance: FloatArray

    def power(self) -> FloatArray:
        """Return the mean square amplitude, corrected for noise, (k, C)."""
        return np.asarray(np.maximum((np.abs(self.heights) ** 2 - self.variance).mean(axis=0), 0.0))

    def clear(self) -> FloatArray:
        """Return the ratio of the power of each order to its uncertainty, for the channel with the largest ratio, (k,)."""
        u = self.variance.mean(axis=0) / np.sqrt(max(len(self.middle_s) / 2.0, 1.0))
        return np.asarray((self.power() / np.where(u > 0.0, u, np.inf)).max(axis=1))


def _sines(off_samples: _OffSamples, mains_hz: float, orders: tuple[int, ...]) -> _Sines | None:
    """Return the sines of the orders in each window with enough samples."""
    numbers = 2 + 2 * len(orders)
    hz = mains_hz * np.array(orders)
    middles, heights, variances = [], [], []
    for middle, part in off_samples.windows():
        samples = part.stop - part.start
        if samples < MIN_SAMPLES_PER_PARAMETER * numbers:
            continue
        times, values = off_samples.time_s[part], off_samples.values[part]
        turn = 2.0 * np.pi * hz * times[:, None]
        columns = np.column_stack([np.ones(samples), times - middle, np.cos(turn), -np.sin(turn)])
        inverse = np.linalg.inv(columns.T @ columns)
        fit = inverse @ (columns.T @ values)
        noise = ((values - columns @ fit) ** 2).sum(axis=0) / (samples - numbers)
        both = np.diag(inverse)[2:].reshape(2, -1).sum(axis=0)
        middles.append(middle)
        heights.append(fit[2 : 2 + hz.size] + 1j * fit[2 + hz.size :])
        variances.append(both[:, None] * noise)
    if not middles:
        return None
    spread = np.array(variances)
    usual = np.median(spread, axis=0)
    calm = (spread <= DISTURBED * np.where(usual > 0.0, usual, np.inf)).all(axis=(1, 2)) | ~(usual > 0.0).any()
    return _Sines(np.array(middles)[calm], np.array(heights)[calm], spread[calm]) if calm.any() else None


def _drift_hz(sines: _Sines, place: int) -> float:
    """Return the frequency offset of an order, from its phase change between windows."""
    own = sines.heights[:, place]
    steps = np.diff(sines.middle_s)
    if not steps.size:
        return 0.0
    turned = np.angle((own[1:] * own[:-1].conj()).sum())
    return float(turned / (2.0 * np.pi * np.median(steps)))
