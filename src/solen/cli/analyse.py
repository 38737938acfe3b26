"""The command of recordings: `solen analyse`."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import BENCH, FigureFile, Json, app, show

_Texts = Annotated[list[str] | None, Parameter(negative=(), consume_multiple=True)]
_Files = Annotated[list[Path] | None, Parameter(negative=(), consume_multiple=True)]
_Out = Annotated[Path | None, Parameter(name="--out", help="Write the result to this .json.")]


@app.command(group=BENCH, sort_key=40)
def analyse(
    *files: Path,
    time: str | None = None,
    angle: str | None = None,
    channel: _Texts = None,
    angle_file: _Files = None,
    angle_time: str | None = None,
    amplitude_deg: float | None = None,
    speed_deg_per_s: float = 15.0,
    hold_s: float = 0.8,
    on_off_hz: float | None = None,
    emitters: int = 1,
    time_unit: str | None = None,
    rate_hz: float | None = None,
    zero_deg: float = 0.0,
    flip_angle: Annotated[bool, Parameter(negative=())] = False,
    pattern: str | None = None,
    control: _Texts = None,
    drop: int = 1,
    step_deg: float | None = None,
    rails: Annotated[tuple[float, float] | None, Parameter(negative=())] = None,
    dark_v: float | None = None,
    smooth_ms: float | None = None,
    columns: _Texts = None,
    example: Annotated[Path | None, Parameter(negative=())] = None,
    sheet: str | None = None,
    traces: Path | None = None,
    figure: FigureFile = None,
    out: _Out = None,
    as_json: Json = False,
) -> None:
    """Cycles, response curve and numbers of recorded sensors.

    Parameters
    ----------
    files
        Recordings: tables (CSV, TSV, ;, .xlsx) with a time, an angle and receivers' voltages.
    time
        Column of the time; by default the one that is told to be it.
    angle
        Column of the angle; by default the one that is told to be it.
    channel
        A receiver and its column, NAME=COLUMN, as in --channel left=ai0 right=ai1; S1.left=ai0 names the sensor, too.
        By default every column of volts.
    angle_file
        Log of the stage on a clock of its own, one for all files or one for each; --angle is then its column. How far
        the clocks differ is found by the voltages.
    angle_time
        Column of the time in that log.
    amplitude_deg
        How far the stage was asked to go to both sides, where nothing recorded the angle: the cycles are found in the
        voltages.
    speed_deg_per_s
        How fast, with --amplitude-deg.
    hold_s
        How long it held there.
    on_off_hz
        Of a raw waveform whose emitters switch on and off: how often a second. Ambient light is then subtracted first;
        solen demodulate says more about it.
    emitters
        How many emitters take turns in it, each followed by an off phase; each counts as a sensor of its own.
    time_unit
        Unit of a time whose column states none: s, ms, us, min.
    rate_hz
        Samples in a second, for a recording without times.
    zero_deg
        What the angle reads at rest; it is subtracted.
    flip_angle
        Count the angle the other way.
    pattern
        Form of the files' names, as in "{sensor}_{lens}_{run}.csv".
    control
        Sensors without a lens, by their labels.
    drop
        Cycles at the beginning of each recording that are not used.
    step_deg
        Step of the grid of angles; by default one that fits the range.
    rails
        Lowest and highest voltage of the recorder, such as 0 5: samples there are clipped.
    dark_v
        Voltage of a receiver without light, for cross-talk and contrast of the light itself.
    smooth_ms
        Moving mean over this time before anything else; none by default.
    columns
        Names of the columns of tables without a header, such as time_s angle_deg left_mV right_mV.
    example
        Write the simulated recording that solen ships to this .csv, and analyse it as well.
    sheet
        Sheet of a workbook.
    traces
        Draw voltages over time with the cycles found into this .svg, .png or .pdf.
    """
    from solen.analysis import Settings
    from solen.analysis.unseen import Protocol
    from solen.pipeline import analyse as pipeline
    from solen.pipeline.signals import Columns, named_channels

    more = [Path(text) for text in channel or () if "=" not in text and Path(text).is_file()]
    named = named_channels([text for text in channel or () if Path(text) not in more])
    asked = pipeline.Request(
        files=(*files, *more),
        columns=Columns(time, angle, named, time_unit, rate_hz, zero_deg, flip_angle),
        settings=Settings(drop, step_deg, rails, dark_v),
        pattern=pattern,
        controls=tuple(control or ()),
        smooth_ms=smooth_ms,
        logs=tuple(angle_file or ()),
        log_time=angle_time,
        protocol=None if amplitude_deg is None else Protocol(amplitude_deg, speed_deg_per_s, hold_s),
        switching=None if on_off_hz is None else pipeline.Switching(on_off_hz, emitters),
        names=None if columns is None else tuple(columns),
        sheet=sheet,
    )
    if example is not None:
        asked = pipeline.with_example(asked, example)
    found = pipeline.analyse(asked, out=out, figure=figure, traces=traces)
    show(found, as_json, lambda: list(_told(found)))


def _told(found: dict[str, Any]) -> Iterator[str]:
    """Lines for a reader."""
    for label, sensor in found["sensors"].items():
        lens = {None: "", True: ", lens", False: ", no lens"}[sensor["lens"]]
        low, high = sensor["motion"][0]["lowest_deg"], sensor["motion"][0]["highest_deg"]
        cycles = f"{sensor['cycles_used']} of {len(sensor['cycles'])} cycles"
        yield f"{label}{lens}: {cycles}, {low:.3g}° to {high:.3g}°"
        for name, one in sensor["receivers"].items():
            yield from _of_receiver(name, one)
        if sensor["left_minus_right"] is not None:
            pair = sensor["left_minus_right"]
            yield f"  left and right show one voltage at {_pm(pair, 'balance_deg', '°')}"
    for name, one in (found["lens_beside_none"] or {}).items():
        share = one["without_lens_percent"]
        if share is not None:
            yield f"without a lens {name} swings by {share:.3g} % of what it does with one"
    for warning in found["warnings"]:
        yield f"warning: {warning}"
    for kind in ("out", "figure", "traces"):
        if kind in found:
            yield f"{kind}: {found[kind]}"


def _of_receiver(name: str, one: dict[str, Any]) -> Iterator[str]:
    slope, zero = (_pm(one, f"sensitivity_{which}V_per_deg", " V/°") for which in ("", "near_zero_"))
    yield f"  {name}: range {_pm(one, 'range_V', ' V')}; sensitivity {slope}, near zero {zero}"
    shares = (
        f"{what} {_percent(one[f'{key}_percent_fs'])}"
        for what, key in (
            ("hysteresis", "hysteresis"),
            ("linearity", "independent_linearity"),
            ("repeatability", "repeatability"),
        )
    )
    yield f"    {', '.join(shares)} of full scale; drift {_pm(one, 'drift_V_per_min', ' V/min')}"
    noise = one["noise_V"]
    angle = one["resolution_near_zero_deg"]
    yield f"    noise {1e3 * noise:.3g} mV" + ("" if angle is None else f", that is {angle:.2g}° near zero")


def _pm(values: dict[str, Any], name: str, unit: str) -> str:
    value, u = values[name], values[f"u_{name}"]
    if value is None:
        return "not known"
    if not u:
        return f"{value:.4g}{unit}"
    digits = max(0, 1 - math.floor(math.log10(u)))
    return f"{value:.{digits}f} ± {u:.{digits}f}{unit}" if digits < 9 else f"{value:.9g} ± {u:.1e}{unit}"


def _percent(value: float | None) -> str:
    return "not known" if value is None else f"{value:.2g} %"
