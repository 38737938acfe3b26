"""The command that takes ambient light out of a recording."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, short, show, text

Table = Annotated[Path | None, Parameter(name="--out", help="Write the readings to this .csv.")]


def demodulate(
    file: Path,
    /,
    *,
    channel: Annotated[list[str] | None, Parameter(negative=())] = None,
    time: str | None = None,
    state: str | None = None,
    rate_hz: float | None = None,
    emitters: int = 1,
    on: str = "low",
    settle_us: float | None = None,
    kernel: str = "two-sided",
    mains_hz: float | None = None,
    low: float | None = None,
    high: float | None = None,
    sheet: str | None = None,
    out: Table = None,
    figure: FigureFile = None,
    as_json: Json = False,
) -> None:
    """Take ambient light out of a recording whose emitters switch on and off: on less off, with its uncertainty.

    Parameters
    ----------
    file
        A table with a time and a column for each receiver.
    channel
        Column of a receiver; repeatable. By default all columns in V.
    time
        Column of the time; by default the one called time.
    state
        Column that says which emitter is on: 0 or off for none. By default one called state, emitter or led.
    rate_hz
        Readings of one emitter per second; the waveform itself is then searched for its edges.
    emitters
        How many take turns in a waveform, each followed by an off phase.
    on
        Whether light makes the readings low, as at the paper's receivers, or high.
    settle_us
        Time after each switch that is left out; by default 300 in a waveform, 0 with states.
    kernel
        two-sided subtracts by the off phases before and after, one-sided by the one before, for comparison.
    mains_hz
        Take means over whole periods of the mains, 50 or 60; a filter, off by default.
    low, high
        Values at and beyond which a channel is cut off; by default what a channel's extremes tell.
    sheet
        Sheet of a workbook; by default the only one with numbers.
    """
    from solen.pipeline.bench import demodulate as pipeline

    options = pipeline.Options(
        channels=pipeline.named(channel),
        time=time,
        state=state,
        rate_hz=rate_hz,
        emitters=emitters,
        on=on,
        settle_us=settle_us,
        kernel=kernel,
        mains_hz=mains_hz,
        low=low,
        high=high,
    )
    found = pipeline.demodulate(file, options, sheet=sheet, out=out, figure=figure)
    show(found, as_json, lambda: _lines(found))


def _lines(found: dict[str, Any]) -> list[str]:
    counts, rate = found["counts"], found["rate_hz"]
    each = "" if found["readings_averaged"] is None else f", each the mean of {found['readings_averaged']}"
    channels, emitters = (_counted(len(found[f"{what}s"]), what) for what in ("channel", "emitter"))
    lines = [
        f"{found['readings']} readings{each}, of {channels} and {emitters} at {text(rate)} Hz, by {found['method']}, "
        f"{found['samples_per_slot']:g} samples in a slot",
        *_clock(found["clock"]),
        f"missing {sum(counts['missing'].values())}, without off {counts['without_off']}, one-sided "
        f"{counts['one_sided']}, clipped {counts['clipped']}",
    ]
    for name, one in found["by_channel"].items():
        ambient = f"ambient {text(one['ambient_mean'])}, varying by {short(one['ambient_sd'])}"
        for emitter, values in one["by_emitter"].items():
            mean = f"mean {text(values['mean'])}, u of a reading {short(values['u_reading'])}"
            lines.append(f"  {name}, emitter {emitter}: {mean}; {ambient}")
    lines += [_rejected(row) for row in found["rejection"]]
    lines += [f"warning: {warning}" for warning in found["warnings"]]
    return lines + [f"{name}: {found[name]}" for name in ("figure", "out") if name in found]


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _clock(clock: dict[str, Any] | None) -> list[str]:
    if clock is None:
        return []
    return [
        f"switching at {clock['rate_hz']:.6g} Hz ± {short(clock['u_rate_hz'])}, {clock['off_stated_ppm']:+.0f} ppm "
        f"from stated; on for {100 * clock['on_share']:.1f} %; edges wander by {clock['wander_us']:.0f} µs"
    ]


def _rejected(row: dict[str, Any]) -> str:
    mean = f", with the mean {_tenths(row['mean_dB'])} dB" if "mean_dB" in row else ""
    return (
        f"  ambient light of {row['hz']:g} Hz: rejected by {_tenths(row['two_sided_dB'])} dB, one-sided "
        f"{_tenths(row['one_sided_dB'])} dB{mean}"
    )


def _tenths(value: float | None) -> str:
    return "all" if value is None else "over 100" if value > 100.0 else f"{value:.1f}"
