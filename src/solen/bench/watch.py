"""Live readings of the receivers, repeated until the user stops them.

`watch` calls a function with each `Seen`.
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
from solen.bench.run import SILENT_S
from solen.errors import BenchError
from solen.results import Result
from solen.spec.strict import Options

MIN_INTERVAL_S = 0.02


class WatchOptions(Options):
    """Duration and interval of the live readings."""

    seconds: Annotated[float, Field(gt=0)] | None = None
    """Stop after this time, but not before the first reading; default: until Ctrl-C."""
    every_s: Annotated[float, Field(ge=MIN_INTERVAL_S, le=10)] = 0.1
    """Interval between two readings in s; each shows the mean since the last."""


@dataclass(frozen=True)
class Seen:
    """A live reading: its time in s, and each sensor's signals and levels with the emitter off, by receiver.

    Values are in V, or in the ``unit`` of the rig's receivers. Each emitter of a network counts as a sensor.
    """

    t_s: float
    signal_V: dict[str, dict[str, float]]
    off_V: dict[str, dict[str, float]]
    unit: str = "V"


class Watched(Result):
    """Summary of the live readings.

    Attributes
    ----------
    looks
        Number of readings that were shown.
    duration_s
        Time from the first to the last.
    simulated
        Whether the rig is simulated.
    """

    looks: int
    duration_s: float
    simulated: bool


def watch(rig_file: Path, options: WatchOptions, show: Callable[[Seen], object]) -> Watched:
    """Show the readings of a rig's receivers until the time is up or Ctrl-C; the emitters are off afterwards."""
    rig = load_rig(rig_file)
    clock, times = clock_for(rig), [0.0]
    with ended_by_signals(), sampler_of(rig, rig_file.parent, clock) as sampler:
        live, begun_s = LiveReadings(sampler, rig), clock.now_s()
        try:
            while (left_s := _left_s(options, clock.now_s() - begun_s)) > 0.0 or len(times) == 1:
                clock.sleep(min(options.every_s, left_s) if left_s > 0.0 else MIN_INTERVAL_S)
                if (levels := live.read()) is None:
                    if clock.now_s() - begun_s - times[-1] > SILENT_S + options.every_s:
                        raise BenchError(sampler.name, limit="says nothing", remedy="check the cable and the power")
                    continue
                times.append(clock.now_s() - begun_s)
                signal, off = levels.signal.mean(axis=0), levels.off.mean(axis=0)
                show(Seen(times[-1], _by_sensor(rig, signal), _by_sensor(rig, off), rig.unit))
        except KeyboardInterrupt:
            pass
    return Watched(len(times) - 1, times[-1], rig.simulated)


def _left_s(options: WatchOptions, since_s: float) -> float:
    """Return the remaining time; 0 if it is too short for another reading."""
    left_s = math.inf if options.seconds is None else options.seconds - since_s
    return left_s if left_s >= 0.1 * MIN_INTERVAL_S else 0.0


def _by_sensor(rig: Rig, volts: FloatArray) -> dict[str, dict[str, float]]:
    """Return the values by receiver for each sensor, or each emitter of a network, from those of all inputs."""
    return {
        ".".join(filter(None, (sensor.name, own))): {
            name: float(volts[emitter - 1, number - 1]) for name, number in sensor.read_on.items()
        }
        for sensor in rig.sensor
        for own, emitter in sensor.lit_by.items()
    }
