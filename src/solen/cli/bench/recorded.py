"""Options that say which columns of a recording are what: one group, for every command that reads recordings."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from solen.pipeline.bench.analyse import Request
    from solen.pipeline.bench.signals import Columns

Texts = Annotated[list[str] | None, Parameter(negative=(), consume_multiple=True)]
Files = Annotated[list[Path] | None, Parameter(negative=(), consume_multiple=True)]


@Parameter(name="*")
@dataclass(frozen=True)
class Recorded:
    """Which columns are what.

    Parameters
    ----------
    time
        Column of the time; by default the one that is told to be it.
    channel
        A receiver and its column, NAME=COLUMN, as in --channel left=ai0 right=ai1; S1.left=ai0 names the sensor, too.
        By default every column of volts.
    time_unit
        Unit of a time whose column states none: s, ms, us, min.
    rate_hz
        Samples in a second, for a recording without times.
    on_off_hz
        Of a raw waveform whose emitters switch on and off: how often a second. Ambient light is then subtracted first;
        solen bench demodulate says more about it.
    emitters
        How many emitters take turns in it, each followed by an off phase; each counts as a sensor of its own.
    rails
        Lowest and highest voltage of the recorder, such as 0 5: samples there are clipped.
    smooth_ms
        Moving mean over this time before anything else; none by default.
    columns
        Names of the columns of tables without a header, such as time_s angle_deg left_mV right_mV.
    sheet
        Sheet of a workbook.
    """

    time: str | None = None
    channel: Texts = None
    time_unit: str | None = None
    rate_hz: float | None = None
    on_off_hz: float | None = None
    emitters: int = 1
    rails: Annotated[tuple[float, float] | None, Parameter(negative=())] = None
    smooth_ms: float | None = None
    columns: Texts = None
    sheet: str | None = None


@Parameter(name="*")
@dataclass(frozen=True)
class Moved:
    """Which angle a recording has, and which of its cycles are used.

    Parameters
    ----------
    angle
        Column of the angle; by default the one that is told to be it.
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
    dark_v
        Voltage of a receiver without light, for cross-talk and contrast of the light itself.
    """

    angle: str | None = None
    angle_file: Files = None
    angle_time: str | None = None
    amplitude_deg: float | None = None
    speed_deg_per_s: float = 15.0
    hold_s: float = 0.8
    zero_deg: float = 0.0
    flip_angle: Annotated[bool, Parameter(negative=())] = False
    pattern: str | None = None
    control: Texts = None
    drop: int = 1
    step_deg: float | None = None
    dark_v: float | None = None


MOVED, RECORDED = Moved(), Recorded()
"""Where nothing is asked for."""


def columns_of(recorded: Recorded, moved: Moved | None = None) -> "tuple[Columns, tuple[Path, ...]]":
    """Columns that are asked for, and files that stand after --channel where a receiver was expected."""
    from solen.pipeline.bench.signals import Columns, named_channels

    texts = recorded.channel or ()
    more = [Path(text) for text in texts if "=" not in text and Path(text).is_file()]
    named = named_channels([text for text in texts if Path(text) not in more])
    asked = moved or MOVED
    times = (recorded.time_unit, recorded.rate_hz)
    return Columns(recorded.time, asked.angle, named, *times, asked.zero_deg, asked.flip_angle), tuple(more)


def request_of(files: tuple[Path, ...], recorded: Recorded, moved: Moved) -> "Request":
    """Recordings as they are to be analysed."""
    from solen.analysis import Settings
    from solen.analysis.unseen import Protocol
    from solen.pipeline.bench.analyse import Request, Switching

    columns, more = columns_of(recorded, moved)
    amplitude, rate = moved.amplitude_deg, recorded.on_off_hz
    return Request(
        files=(*files, *more),
        columns=columns,
        settings=Settings(moved.drop, moved.step_deg, recorded.rails, moved.dark_v),
        pattern=moved.pattern,
        controls=tuple(moved.control or ()),
        smooth_ms=recorded.smooth_ms,
        logs=tuple(moved.angle_file or ()),
        log_time=moved.angle_time,
        protocol=None if amplitude is None else Protocol(amplitude, moved.speed_deg_per_s, moved.hold_s),
        switching=None if rate is None else Switching(rate, recorded.emitters),
        names=None if recorded.columns is None else tuple(recorded.columns),
        sheet=recorded.sheet,
    )
