"""The command that subtracts ambient light from a recording: `solen bench demodulate`."""

import math
from collections.abc import Iterator

from solen.analysis.demodulation import Demodulation
from solen.analysis.demodulation.demodulate import Rejection
from solen.cli.app import lines, short, text
from solen.pipeline.bench.demodulate import demodulate as demodulate


@lines.register
def _(result: Demodulation) -> Iterator[str]:
    counts, each = result.counts, result.readings_averaged
    of = f"{_counted(len(result.channels), 'channel')} and {_counted(len(result.readings.emitters), 'emitter')}"
    yield (
        f"{result.readings_kept} readings{'' if each is None else f', each the mean of {each}'}, of {of} at "
        f"{text(result.rate_hz)} Hz, by {result.method}, {result.samples_per_slot:g} samples per slot"
    )
    clock = result.clock
    if clock is not None:
        yield (
            f"switching at {clock.rate_hz:.6g} Hz ± {short(clock.u_rate_hz)}, {result.off_stated_ppm:+.0f} "
            f"ppm from specified; on for {100 * clock.on_share:.1f} %; edges wander by {clock.wander_us:.0f} "
            "µs"
        )
    yield (
        f"missing {sum(counts.missing.values())}, without off {counts.without_off}, one-sided {counts.one_sided}, "
        f"clipped {counts.clipped}"
    )
    if any(result.clipped_samples.values()):
        at_limit = ", ".join(f"{name} {count}" for name, count in result.clipped_samples.items())
        yield f"samples at a limit: {at_limit} of {len(result.samples.time_s)}"
    if result.flicker is not None:
        amplitude = short(float(result.flicker.amplitude.max()))
        yield f"flicker of lamps at {result.flicker.mains_hz:.5g} Hz, up to {amplitude}, is subtracted"
    for name, channel in result.channels.items():
        for emitter, values in channel.emitters.items():
            mean = f"mean {text(values.mean)}, u of a reading {short(values.u_reading)}"
            ambient = f"ambient {text(channel.mean_ambient)}, varying by {short(channel.sd_ambient)}"
            yield f"  {name}, emitter {emitter}: {mean}; {ambient}"
    yield from map(_rejected, result.rejection)


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _rejected(row: Rejection) -> str:
    mean = "" if row.with_mean_dB is None else f", with the mean {_tenths(row.with_mean_dB)} dB"
    return (
        f"  ambient light of {row.frequency_hz:g} Hz: rejected by {_tenths(row.two_sided_dB)} dB, one-sided "
        f"{_tenths(row.one_sided_dB)} dB{mean}"
    )


def _tenths(value: float) -> str:
    return "all" if math.isinf(value) else "over 100" if value > 100.0 else f"{value:.1f}"
