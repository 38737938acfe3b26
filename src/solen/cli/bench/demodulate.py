"""The command that subtracts ambient light from a recording: `solen bench demodulate`."""

import math
from collections.abc import Iterator

from solen.analysis.demodulation import Demodulation
from solen.analysis.demodulation.demodulate import Rejection
from solen.cli.app import lines, short, text
from solen.pipeline.bench.demodulate import demodulate as demodulate


@lines.register
def _(result: Demodulation) -> Iterator[str]:
    averaged = "" if result.readings_averaged is None else f", each the mean of {result.readings_averaged}"
    channels = _counted(len(result.channels), "channel")
    emitters = _counted(len(result.readings.emitters), "emitter")
    samples = _counted(result.samples_per_slot, "sample")
    source = "the waveform" if result.clock is not None else "a column"
    yield (
        f"{result.readings_kept} readings{averaged}, of {channels} and {emitters} at {text(result.rate_hz)} Hz; "
        f"emitter states from {source}, {samples} per slot"
    )
    clock = result.clock
    if clock is not None:
        yield (
            f"switching at {clock.rate_hz:.6g} Hz ± {short(clock.u_rate_hz)}, {result.off_stated_ppm:+.0f} ppm from "
            f"the specified rate; on for {100 * clock.on_share:.1f} % of a period; edges deviate by up to "
            f"{clock.wander_us:.0f} µs"
        )
    counts = result.counts
    yield (
        f"readings: missing {sum(counts.missing.values())}, without an off slot {counts.without_off}, one-sided "
        f"{counts.one_sided}, clipped {counts.clipped}"
    )
    if any(result.clipped_samples.values()):
        clipped = ", ".join(f"{name} {count}" for name, count in result.clipped_samples.items())
        yield f"samples at a limit: {clipped} of {len(result.samples.time_s)}"
    if result.flicker is not None:
        amplitude = short(float(result.flicker.amplitude.max()))
        mains = f"{result.flicker.mains_hz:.5g} Hz"
        yield f"flicker of lamps on mains of {mains}, with an amplitude of up to {amplitude}, is subtracted"
    for name, channel in result.channels.items():
        for emitter, values in channel.emitters.items():
            mean = f"mean {text(values.mean)}, u of a reading {short(values.u_reading)}"
            ambient = f"ambient {text(channel.mean_ambient)}, varying by {short(channel.sd_ambient)}"
            yield f"  {name}, emitter {emitter}: {mean}; {ambient}"
    yield from map(_rejection, result.rejection)


def _counted(number: float, noun: str) -> str:
    return f"{number:g} {noun}{'' if number == 1 else 's'}"


def _rejection(row: Rejection) -> str:
    mean = "" if row.with_mean_dB is None else f", after averaging {_dB(row.with_mean_dB)}"
    return (
        f"  rejection of ambient light at {row.frequency_hz:g} Hz: {_dB(row.two_sided_dB)}, one-sided "
        f"{_dB(row.one_sided_dB)}{mean}"
    )


def _dB(value: float) -> str:
    if math.isinf(value):
        return "complete"
    return "over 100 dB" if value > 100.0 else f"{round(value, 1) + 0.0:.1f} dB"
