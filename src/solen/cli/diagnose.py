"""The command of diagnoses: `solen diagnose`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import BENCH, FigureFile, Json, app, progress_bar, show

_Texts = Annotated[list[str] | None, Parameter(negative=(), consume_multiple=True)]
_Out = Annotated[Path | None, Parameter(name="--out", help="Write the result to this .json.")]


@app.command(group=BENCH, sort_key=42)
def diagnose(
    *files: Path,
    design: Path | None = None,
    sensor: _Texts = None,
    spread: _Texts = None,
    zero_u_deg: float = 0.1,
    brighter: str = "lower",
    time: str | None = None,
    angle: str | None = None,
    channel: _Texts = None,
    time_unit: str | None = None,
    rate_hz: float | None = None,
    zero_deg: float = 0.0,
    flip_angle: Annotated[bool, Parameter(negative=())] = False,
    pattern: str | None = None,
    control: _Texts = None,
    drop: int = 1,
    step_deg: float | None = None,
    rails: Annotated[tuple[float, float] | None, Parameter(negative=())] = None,
    figure: FigureFile = None,
    out: _Out = None,
    as_json: Json = False,
) -> None:
    """What a recording says of its sensor: emitter decentre, chip width, loss, gains and offsets, with intervals.

    Parameters
    ----------
    files
        Recordings, as of solen analyse.
    design
        Design of the sensor; by default the one that a recording of solen bench carries.
    sensor
        Sensors to diagnose, by their labels; by default all.
    spread
        What differs from print to print by a standard uncertainty, KEY=U, as in --spread emitter.distance_mm=0.02; by
        default material.index=0.003.
    zero_u_deg
        Standard uncertainty of the angle at which the sensor is straight.
    brighter
        Whether brighter light is a lower or a higher voltage.
    time
        Column of the time; by default the one that is told to be it.
    angle
        Column of the angle; by default the one that is told to be it.
    channel
        A receiver and its column, NAME=COLUMN, as in --channel left=ai0 right=ai1.
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
    """
    from solen.analysis import Settings
    from solen.pipeline import analyse
    from solen.pipeline import diagnose as pipeline
    from solen.pipeline.signals import Columns, named_channels

    request = analyse.Request(
        files=files,
        columns=Columns(time, angle, named_channels(channel or ()), time_unit, rate_hz, zero_deg, flip_angle),
        settings=Settings(drop, step_deg, rails),
        pattern=pattern,
        controls=tuple(control or ()),
    )
    spreads = pipeline.spreads_of(spread or ())
    asked = pipeline.Asked(request, design, tuple(sensor or ()), zero_u_deg, spreads, brighter)
    with progress_bar("tracing the design") as bar:
        found = pipeline.diagnose(asked, out=out, figure=figure, progress=bar)
    show(found, as_json, lambda: list(_told(found)))


def _told(found: dict[str, Any]) -> Iterator[str]:
    """Lines for a reader."""
    said = "; simulated" if found["simulated"] else ""
    for label, one in found["sensors"].items():
        lens = {None: "", True: ", lens", False: ", no lens"}[one["lens"]]
        yield f"{label}{lens}: {one['cycles_used']} cycles, ± is half of an interval of 95 %{said}"
        yield from (f"  {line}" for line in one["words"])
        yield from (f"  advice: {line}" for line in one["advice"])
    for warning in found["warnings"]:
        yield f"note: {warning}"
    for kind in ("out", "figure"):
        if kind in found:
            yield f"wrote {found[kind]}"
