"""Averaging of the forces from a noisy load cell over time, before curves are fitted to them.

Without averaging, the noise of the load cell would narrow the calibrated range, because only forces that every press
reaches are calibrated, and would appear as scatter of the voltages. Most of it is removed by fitting straight lines to
a few samples of a ramp, and by averaging each hold (or fitting a line, if the force drifts). Forces with little noise
are not changed.

Public names: `smoothed` and `EXTENSION`.
"""

import math
from dataclasses import replace

import numpy as np
from scipy.signal import savgol_filter

from solen.analysis.motion import Cycle, Motion, Ramp
from solen.analysis.run import Run
from solen.analysis.sensor_response import SensorResponse
from solen.arrays import FloatArray
from solen.recording.stimulus import FORCE

EXTENSION = 3.0
"""Extension of a calibrated range at each end, in standard uncertainties of the reading at that end."""
_MAX_NOISE = 5e-4  # largest noise that is not averaged, as a fraction of the range
_MAX_WINDOW = 1.0 / 5.0  # fraction of a ramp to which a line is fitted
_MIN_DRIFT = 4.0  # smallest drift in a hold to which a line is fitted, in standard uncertainties
_MIN_DEPARTURE = 3.5  # distance from a level, in units of the noise, at which a ramp is detected


def smoothed(sensor: SensorResponse) -> tuple[SensorResponse, float]:
    """Return the sensor with averaged forces, and the standard uncertainty of a hold.

    If the noise is low, return the sensor unchanged, and 0.
    """
    limits = [_MAX_NOISE * (run.motion.high_deg - run.motion.low_deg) for run in sensor.runs]
    pairs = list(zip(sensor.runs, limits, strict=True))
    if sensor.stimulus is not FORCE or all(run.motion.noise_deg < limit for run, limit in pairs):
        return sensor, 0.0
    runs = [_smoothed_run(run, limit) for run, limit in pairs]
    return replace(sensor, runs=tuple(run for run, _ in runs)), max(u for _, u in runs)


def _smoothed_run(run: Run, max_noise: float) -> tuple[Run, float]:
    noise, force = run.motion.noise_deg, run.signals.angle_deg
    ramps = tuple(_extended(ramp, noise, force.size) for ramp in run.motion.ramps)
    smooth, window = force.copy(), (noise / max_noise) ** 2
    for ramp in ramps:
        part = slice(ramp.start, ramp.stop)
        smooth[part] = _lines(force[part], window)
    starts, stops = [0, *(ramp.stop - 1 for ramp in ramps)], [*(ramp.start + 1 for ramp in ramps), force.size]
    holds = [(start, stop) for start, stop in zip(starts, stops, strict=True) if stop - start > 2]
    for start, stop in holds:
        smooth[start:stop] = _hold(force[start:stop], noise)
    motion: Motion = replace(run.motion, ramps=ramps, cycles=_cycles(run.motion, ramps))
    u = noise / math.sqrt(float(np.median([stop - start for start, stop in holds])) if holds else 1.0)
    return replace(run, motion=motion, signals=replace(run.signals, angle_deg=smooth)), u


def _extended(ramp: Ramp, noise: float, size: int) -> Ramp:
    """Extend a ramp to the levels of the holds, because noise hides its first and last samples."""
    step = abs(ramp.end_deg - ramp.start_deg) / max(ramp.stop - ramp.start - 1, 1)
    count = round(_MIN_DEPARTURE * noise / step) if step else 0
    return replace(ramp, start=max(ramp.start - count, 0), stop=min(ramp.stop + count, size))


def _cycles(motion: Motion, ramps: tuple[Ramp, ...]) -> tuple[Cycle, ...]:
    """Return the cycles, which begin and end with the extended ``ramps``."""
    begins = {old.start: new.start for old, new in zip(motion.ramps, ramps, strict=True)}
    ends = {old.stop: new.stop for old, new in zip(motion.ramps, ramps, strict=True)}
    return tuple(
        replace(cycle, start=begins.get(cycle.start, cycle.start), stop=ends.get(cycle.stop, cycle.stop))
        for cycle in motion.cycles
    )


def _hold(force: FloatArray, noise: float) -> FloatArray:
    """Return the mean force of a hold, or a straight line if the force drifts, as it does on a soft body."""
    index = np.arange(force.size) - 0.5 * (force.size - 1)
    squares = float(index @ index)
    drift = float(index @ force) / squares
    return np.asarray(force.mean() + (drift if abs(drift) > _MIN_DRIFT * noise / math.sqrt(squares) else 0.0) * index)


def _lines(force: FloatArray, window: float) -> FloatArray:
    """Return the forces from straight lines fitted to a window of samples about each sample."""
    count = int(min(window, force.size * _MAX_WINDOW)) | 1
    return force if count < 3 else np.asarray(savgol_filter(force, count, 1, mode="interp"))
