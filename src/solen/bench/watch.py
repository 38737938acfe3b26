"""Live readings of the receivers, repeated until the user stops them.

`watch` calls a function with each `LiveReading`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field

from solen.arrays import FloatArray
from solen.bench.check import clock_for
from solen.bench.interrupts import ended_by_signals
from solen.bench.live import LiveReadings, sampler_of
from solen.bench.rig import Rig, load_rig
from solen.bench.run import MAX_SILENCE_S
from solen.errors import BenchError
from solen.results import Result
from solen.spec.strict import Options

MIN_INTERVAL_S = 0.02


class WatchOptions(Options):
    """Duration and interval of the live readings."""

    seconds: Annotated[float, Field(gt=0)] | None = None
    """Stop after this time in s, but not before the first reading; default: until Ctrl-C."""
    every_s: Annotated[float, Field(ge=MIN_INTERVAL_S, le=10)] = 0.1
    """Interval between readings in s; each shows the mean since the last one."""


@dataclass(frozen=True)
class LiveReading:
    """A live reading: its time in s, and for each sensor the signals and the off levels, keyed by receiver.

    Values are in V, or in the ``unit`` of the receiver signals. Each emitter of a network is treated as a sensor.
    """

    t_s: float
    signal_V: dict[str, dict[str, float]]
    off_V: dict[str, dict[str, float]]
    unit: str = "V"


class WatchSummary(Result):
    """Summary of the live readings.

    Attributes
    ----------
    looks
        Number of readings that were shown.
    duration_s
        Time from the start to the last reading.
    simulated
        Whether the rig is simulated.
    """

    looks: int
    duration_s: float
    simulated: bool


def watch(rig_file: Path, options: WatchOptions, show: Callable[[LiveReading], object]) -> WatchSummary:
    """Show the readings of a rig's receivers until the time is up or Ctrl-C; the emitters are off afterwards."""
    rig = load_rig(rig_file)
    clock, times = clock_for(rig), [0.0]
    with ended_by_signals(), sampler_of(rig, rig_file.parent, clock) as sampler:
        live, begun_s = LiveReadings(sampler, rig), clock.now_s()
        try:
            while (remaining_s := _remaining_s(options, clock.now_s() - begun_s)) > 0.0 or len(times) == 1:
                clock.sleep(min(options.every_s, remaining_s) if remaining_s > 0.0 else MIN_INTERVAL_S)
                if (levels := live.read()) is None:
                    silence_s = clock.now_s() - begun_s - times[-1]
                    if silence_s > MAX_SILENCE_S + options.every_s:
                        limit = f"has sent no data for {silence_s:.1f} s"
                        raise BenchError(sampler.name, limit=limit, remedy="check the cable and the power")
                    continue
                times.append(clock.now_s() - begun_s)
                signal, off = levels.signal.mean(axis=0), levels.off.mean(axis=0)
                show(LiveReading(times[-1], _by_sensor(rig, signal), _by_sensor(rig, off), rig.unit))
        except KeyboardInterrupt:
            pass
    return WatchSummary(len(times) - 1, times[-1], rig.simulated)


def _remaining_s(options: WatchOptions, elapsed_s: float) -> float:
    """Return the remaining time; 0 if it is too short for another reading."""
    remaining_s = math.inf if options.seconds is None else options.seconds - elapsed_s
    return remaining_s if remaining_s >= 0.1 * MIN_INTERVAL_S else 0.0


def _by_sensor(rig: Rig, volts: FloatArray) -> dict[str, dict[str, float]]:
    """Return the values of each sensor, or each emitter of a network, keyed by receiver, from those of all inputs."""
    return {
        ".".join(filter(None, (sensor.name, emitter))): {
            receiver: float(volts[emitter_number - 1, number - 1]) for receiver, number in sensor.input_numbers.items()
        }
        for sensor in rig.sensor
        for emitter, emitter_number in sensor.emitter_numbers.items()
    }
