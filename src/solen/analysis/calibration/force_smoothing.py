"""Averaging of the forces from a noisy load cell over time, before curves are fitted to them.

Load cell noise is not receiver noise. If it were kept, it would narrow the calibrated range to forces at which every
press has a reading, and it would appear as scatter of the voltages. Straight lines over a few samples of a ramp, and
the mean of a hold (or a line, if the hold drifts), remove most of it. Forces with little noise are not changed.

Public names: `smoothed` and `OUT`.
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

OUT = 3.0
"""Extension of a calibrated range at each end, in standard uncertainties of the reading at that end."""
_FINE = 5e-4  # smallest noise that is averaged, as a fraction of the range
_PART = 5  # a line is fitted to at most this part (1/5) of a ramp
_DRIFTS = 4.0  # standard uncertainties
_LATE = 3.5  # distance from a level, in units of the noise, at which a ramp is detected


def smoothed(sensor: SensorResponse) -> tuple[SensorResponse, float]:
    """Return the sensor with averaged forces, and the standard uncertainty of a hold; unchanged and 0 without noise."""
    fine = [_FINE * (run.motion.high_deg - run.motion.low_deg) for run in sensor.runs]
    if sensor.stimulus is not FORCE or all(
        run.motion.noise_deg < limit for run, limit in zip(sensor.runs, fine, strict=True)
    ):
        return sensor, 0.0
    runs = [_run(run, limit) for run, limit in zip(sensor.runs, fine, strict=True)]
    return replace(sensor, runs=tuple(run for run, _ in runs)), max(u for _, u in runs)


def _run(run: Run, fine: float) -> tuple[Run, float]:
    noise, force = run.motion.noise_deg, run.signals.angle_deg
    ramps = tuple(_whole(ramp, noise, force.size) for ramp in run.motion.ramps)
    calm, wanted = force.copy(), (noise / fine) ** 2
    stops, starts = [0, *(ramp.stop - 1 for ramp in ramps)], [*(ramp.start + 1 for ramp in ramps), force.size]
    lengths = []
    for ramp in ramps:
        part = slice(ramp.start, ramp.stop)
        calm[part] = _line(force[part], wanted)
    for begin, end in zip(stops, starts, strict=True):
        if end - begin > 2:
            calm[begin:end] = _held(force[begin:end], noise)
            lengths.append(end - begin)
    motion: Motion = replace(run.motion, ramps=ramps, cycles=_cycles(run.motion, ramps))
    u = noise / math.sqrt(float(np.median(lengths)) if lengths else 1.0)
    return replace(run, motion=motion, signals=replace(run.signals, angle_deg=calm)), u


def _whole(ramp: Ramp, noise: float, size: int) -> Ramp:
    """Extend a ramp from hold level to hold level, because noise hides its first and last samples."""
    each = abs(ramp.end_deg - ramp.start_deg) / max(ramp.stop - ramp.start - 1, 1)
    more = round(_LATE * noise / each) if each else 0
    return replace(ramp, start=max(ramp.start - more, 0), stop=min(ramp.stop + more, size))


def _cycles(motion: Motion, ramps: tuple[Ramp, ...]) -> tuple[Cycle, ...]:
    """Return the cycles that begin and end with the same ramps as before."""
    begins = {old.start: new.start for old, new in zip(motion.ramps, ramps, strict=True)}
    ends = {old.stop: new.stop for old, new in zip(motion.ramps, ramps, strict=True)}
    return tuple(
        replace(cycle, start=begins.get(cycle.start, cycle.start), stop=ends.get(cycle.stop, cycle.stop))
        for cycle in motion.cycles
    )


def _held(force: FloatArray, noise: float) -> FloatArray:
    """Return the mean force of a hold, or a straight line if the force drifts, as it does on a soft body."""
    place = np.arange(force.size) - 0.5 * (force.size - 1)
    drift, u = float(place @ force / (place @ place)), noise / math.sqrt(float(place @ place))
    return np.asarray(force.mean() + (drift * place if abs(drift) > _DRIFTS * u else 0.0 * place))


def _line(force: FloatArray, wanted: float) -> FloatArray:
    """Return the forces from straight lines fitted over as many neighbours as are needed to leave little noise."""
    window = int(min(wanted, force.size / _PART)) | 1
    return force if window < 3 else np.asarray(savgol_filter(force, window, 1, mode="interp"))
