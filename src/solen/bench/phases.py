"""Emitter that is on in each sample of a data acquisition, from its own counters, a recorded sync, or the signal.

Emitters alternate, each on for the same fraction of its slot, emitter 1 first. Counters of the instrument run by the
clock of the samples, and the state of a sample follows from its number. A sync that is high while emitter 1 is on shows
where each period begins; its edges are known to within one sample, and more accurately if they lie on a straight line.
Without either, the clock of a single emitter is found in the signal (`solen.analysis.demodulation.find_clock`). Inputs
are converted one after the other: `states` gives the state of a sample at the time of its own conversion.

Public names: `clock_of` and `states`.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from solen.analysis.demodulation import Clock, find_clock
from solen.arrays import FloatArray, IntArray
from solen.bench.daq import Setup
from solen.errors import DataError

COUNTER_JITTER_US = 5.0
"""Time in µs that exceeds the difference between a counter's edge and a sample's clock edge; a sample at an edge is
omitted."""
MIN_SYNC_V = 0.5
EDGE_SAMPLES, LOOSE_SAMPLES = 0.15, 0.55
"""Uncertainty of an edge in samples, on a fitted line and alone, in addition to the samples that `Clock.states`
omits.
"""
LINE_SAMPLES = 0.75
"""Distance in samples within which edges count as on a straight line; each edge is known only to within one sample."""


def seen_by(setup: Setup, inputs: Iterable[int]) -> tuple[list[int], float]:
    """Return the channels that show the switching: the sync, or some inputs.

    Also return the index of the channel whose conversions the clock refers to.
    """
    seen = [setup.inputs] if setup.synced else list(inputs)
    return seen, float(np.mean(seen)) if setup.switching == "external" else 0.0


def clock_of(time_s: FloatArray, volts: FloatArray, setup: Setup, switch_hz: float) -> Clock:
    """Determine the clock of the slots in a window of samples.

    Parameters
    ----------
    time_s
        Time of each sample of the first channel, by the instrument's clock since its start, shape (N,).
    volts
        Shape (N, channels).
    setup, switch_hz
        The settings, and the frequency of its counters.

    Returns
    -------
    Clock
        Its phase counts slots; emitter 1 switches on at multiples of the number of emitters.

    Raises
    ------
    DataError
        If the window shows no switching.
    """
    slots_hz = switch_hz * setup.emitters
    if setup.switching != "external":
        return _even(time_s * slots_hz, slots_hz, 0.5, COUNTER_JITTER_US)
    if setup.synced:
        return _by_sync(time_s, volts[:, -1], setup)
    clock = find_clock(time_s, volts, setup.switch_hz)
    return replace(clock, jitter_us=max(clock.jitter_us, EDGE_SAMPLES / 3.0 * 1e6 / setup.rate_hz))


def states(clock: Clock, delay_s: float, settle_s: float, emitters: int) -> IntArray:
    """Return the state of samples taken a delay after those of the clock.

    The state is 0 for off, the emitter's number, or -1 for samples that are not used.
    """
    moved = replace(clock, phase=clock.phase + delay_s * clock.rate_hz)
    first = int(np.floor(moved.phase).min()) if len(moved.phase) else 0
    found = moved.states(settle_s, emitters)
    return np.asarray(np.where(found > 0, (found - 1 + first) % emitters + 1, found))


def _even(phase: FloatArray, rate_hz: float, on_share: float, jitter_us: float) -> Clock:
    nothing = {"u_rate_hz": 0.0, "wander_us": 0.0, "depth": 0.0, "clearness": np.inf}
    return Clock(phase=phase, rate_hz=rate_hz, on_share=on_share, jitter_us=jitter_us, **nothing)


def _by_sync(time_s: FloatArray, volts: FloatArray, setup: Setup) -> Clock:
    step_s = 1.0 / setup.rate_hz
    rises, falls = _edges(time_s, volts)
    if len(rises) < 2:
        raise DataError("sync", value=len(rises), limit="rises in a window of samples; two are needed")
    usual_s = float(np.median(np.diff(rises)))
    number = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(np.diff(rises) / usual_s), 1.0))])
    line = np.polyfit(number, rises, 1)
    beside = float(np.abs(rises - np.polyval(line, number)).max())
    straight = beside <= LINE_SAMPLES * step_s
    if straight:
        period_s, phase = float(line[0]), (time_s - line[1]) / line[0]
    else:
        period_s, phase = usual_s, _between(time_s, rises, number, usual_s)
    on_s = _on_s(rises, falls, usual_s)
    emitters = setup.emitters
    jitter_us = 1e6 * step_s * (EDGE_SAMPLES if straight else LOOSE_SAMPLES) / 3.0
    return _even(phase * emitters, emitters / period_s, on_s / period_s * emitters, jitter_us)


def _edges(time_s: FloatArray, volts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the times of rises and falls: half a sample before the first sample beyond a third of the height.

    The detection has a hysteresis.
    """
    low, high = float(volts.min()), float(volts.max())
    if high - low < MIN_SYNC_V:
        limit = f"changes by only {high - low:.2g} V; {MIN_SYNC_V:g} V are needed to distinguish on and off"
        raise DataError("sync", limit=limit, remedy="check its wire")
    height = (volts - low) / (high - low)
    mark = np.where(height > 2.0 / 3.0, 1, np.where(height < 1.0 / 3.0, -1, 0))
    sure = np.flatnonzero(mark)
    turns = np.flatnonzero(np.diff(mark[sure])) + 1
    at = 0.5 * (time_s[sure[turns]] + time_s[sure[turns - 1]])
    up = mark[sure[turns]] > 0
    return at[up], at[~up]


def _on_s(rises: FloatArray, falls: FloatArray, usual_s: float) -> float:
    """Return the mean time from a rise to the next fall."""
    after = np.searchsorted(falls, rises)
    whole = after < len(falls)
    lengths = falls[after[whole]] - rises[whole]
    lengths = lengths[lengths < usual_s]
    if not len(lengths):
        raise DataError("sync", limit="stays high: no fall follows a rise within a period", remedy="check its wire")
    return float(lengths.mean())


def _between(time_s: FloatArray, rises: FloatArray, number: FloatArray, usual_s: float) -> FloatArray:
    """Interpolate the phase linearly between rises, and extrapolate it at the usual rate."""
    found = np.interp(time_s, rises, number)
    before, after = time_s < rises[0], time_s > rises[-1]
    found[before] = number[0] - (rises[0] - time_s[before]) / usual_s
    found[after] = number[-1] + (time_s[after] - rises[-1]) / usual_s
    return found
