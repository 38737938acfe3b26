"""The emitter that is on in each sample of a DAQ device, from its own counters, a recorded sync, or the signal.

Emitters alternate, each on for the same fraction of its slot, emitter 1 first. The device's own counters follow the
sampling clock; the state of a sample then follows from its number. A sync that is high while emitter 1 is on shows
where each period begins; its edges are known to within one sample, and more accurately if their times lie on a straight
line. Without either, the clock of a single emitter is found in the signal (`solen.analysis.demodulation.find_clock`).
The inputs are converted one after the other: `states` gives the state of a sample at the time of its own conversion.

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
"""Upper limit in µs of the delay between an edge of a counter and one of the sampling clock; a sample at an edge is
omitted.
"""
MIN_SYNC_V = 0.5
FITTED_EDGE_SAMPLES, SINGLE_EDGE_SAMPLES = 0.15, 0.55
"""Uncertainty in samples of an edge on a fitted line, and of a single edge, in addition to the samples that
`Clock.states` omits.
"""
MAX_LINE_SAMPLES = 0.75
"""Largest distance in samples of edges from a straight line through them; each is known only to within one sample."""


def clock_channels(setup: Setup, inputs: Iterable[int]) -> tuple[list[int], float]:
    """Return the channels from which the clock of the emitters is determined, and their position in the scan.

    The channels are the sync input if there is one, otherwise the given inputs. The times of the clock refer to the
    position: with external switching, the mean index of the channels, which may be fractional; otherwise 0.
    """
    channels = [setup.inputs] if setup.synced else list(inputs)
    return channels, float(np.mean(channels)) if setup.switching == "external" else 0.0


def clock_of(time_s: FloatArray, volts: FloatArray, setup: Setup, switch_hz: float) -> Clock:
    """Determine the clock of the slots in a window of samples.

    Parameters
    ----------
    time_s
        Time of each sample of the first channel, by the device's clock since its start, (N,).
    volts
        Samples of the channels from `clock_channels`, (N, channels).
    setup, switch_hz
        The settings, and the frequency of the device's counters.

    Returns
    -------
    Clock
        Its phase is in slots; emitter 1 switches on at multiples of the number of emitters.

    Raises
    ------
    DataError
        If the window shows no switching.
    """
    slots_hz = switch_hz * setup.emitters
    if setup.switching != "external":
        return _known_clock(time_s * slots_hz, slots_hz, 0.5, COUNTER_JITTER_US)
    if setup.synced:
        return _sync_clock(time_s, volts[:, -1], setup)
    clock = find_clock(time_s, volts, setup.switch_hz)
    return replace(clock, jitter_us=max(clock.jitter_us, FITTED_EDGE_SAMPLES / 3.0 * 1e6 / setup.rate_hz))


def states(clock: Clock, delay_s: float, settle_s: float, emitters: int) -> IntArray:
    """Return the state of each sample of a channel that is sampled a delay after the one to which the clock refers.

    The state is 0 for off, the number of the emitter that is on, or -1 for samples that are not used.
    """
    delayed = replace(clock, phase=clock.phase + delay_s * clock.rate_hz)
    first = int(np.floor(delayed.phase).min()) if len(delayed.phase) else 0
    state = delayed.states(settle_s, emitters)
    return np.asarray(np.where(state > 0, (state - 1 + first) % emitters + 1, state))


def _known_clock(phase: FloatArray, rate_hz: float, on_share: float, jitter_us: float) -> Clock:
    """Return a clock that was not determined from the signal."""
    certain = {"u_rate_hz": 0.0, "wander_us": 0.0, "depth": 0.0, "clearness": np.inf}
    return Clock(phase=phase, rate_hz=rate_hz, on_share=on_share, jitter_us=jitter_us, **certain)


def _sync_clock(time_s: FloatArray, volts: FloatArray, setup: Setup) -> Clock:
    step_s = 1.0 / setup.rate_hz
    rises, falls = _edges(time_s, volts)
    if len(rises) < 2:
        limit = "two are needed in a window of samples"
        raise DataError("rising edges of the sync", value=len(rises), limit=limit, remedy="check the sync wiring")
    usual_s = float(np.median(np.diff(rises)))
    number = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(np.diff(rises) / usual_s), 1.0))])
    line = np.polyfit(number, rises, 1)
    straight = float(np.abs(rises - np.polyval(line, number)).max()) <= MAX_LINE_SAMPLES * step_s
    if straight:
        period_s, phase = float(line[0]), (time_s - line[1]) / line[0]
    else:
        period_s, phase = usual_s, _interpolated_phase(time_s, rises, number, usual_s)
    on_s = _on_s(rises, falls, usual_s)
    emitters = setup.emitters
    jitter_us = 1e6 * step_s * (FITTED_EDGE_SAMPLES if straight else SINGLE_EDGE_SAMPLES) / 3.0
    return _known_clock(phase * emitters, emitters / period_s, on_s / period_s * emitters, jitter_us)


def _edges(time_s: FloatArray, volts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the times of the rising and the falling edges, detected with hysteresis.

    An edge is midway between the last sample in the lower third of the range and the first one in the upper third, or
    the reverse.
    """
    low, high = float(volts.min()), float(volts.max())
    if high - low < MIN_SYNC_V:
        limit = f"changes by only {high - low:.2g} V; {MIN_SYNC_V:g} V are needed to distinguish on and off"
        raise DataError("sync", limit=limit, remedy="check the sync wiring")
    height = (volts - low) / (high - low)
    level = np.where(height > 2.0 / 3.0, 1, np.where(height < 1.0 / 3.0, -1, 0))
    definite = np.flatnonzero(level)
    changes = np.flatnonzero(np.diff(level[definite])) + 1
    edge_s = 0.5 * (time_s[definite[changes]] + time_s[definite[changes - 1]])
    rising = level[definite[changes]] > 0
    return edge_s[rising], edge_s[~rising]


def _on_s(rises: FloatArray, falls: FloatArray, usual_s: float) -> float:
    """Return the mean time from a rising edge to the next falling edge."""
    after = np.searchsorted(falls, rises)
    has_fall = after < len(falls)
    durations = falls[after[has_fall]] - rises[has_fall]
    durations = durations[durations < usual_s]
    if not len(durations):
        limit = "stays high: no falling edge follows a rising edge within a period"
        raise DataError("sync", limit=limit, remedy="check the sync wiring")
    return float(durations.mean())


def _interpolated_phase(time_s: FloatArray, rises: FloatArray, number: FloatArray, usual_s: float) -> FloatArray:
    """Return the phase, interpolated linearly between rising edges and extrapolated at the usual rate."""
    phase = np.interp(time_s, rises, number)
    before, after = time_s < rises[0], time_s > rises[-1]
    phase[before] = number[0] - (rises[0] - time_s[before]) / usual_s
    phase[after] = number[-1] + (time_s[after] - rises[-1]) / usual_s
    return phase
