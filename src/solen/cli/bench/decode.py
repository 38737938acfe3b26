"""The commands that make angles of voltages: `solen bench calibrate` and `solen bench decode`."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, show
from solen.cli.bench.recorded import MOVED, RECORDED, Moved, Recorded, columns_of, request_of

_Flag = Annotated[bool, Parameter(negative=())]
_Motion = Annotated[str | None, Parameter(help="What was moved: rotation or bend, where the recording does not say.")]
_Design = Annotated[Path | None, Parameter(help="Design file of the sensor: its motion, pivot, parts and circuit.")]
_Schema = Annotated[bool, Parameter(name="--schema", negative=(), help="Print the JSON Schema of a calibration.")]


def calibrate(
    *recordings: Path,
    moved: Moved = MOVED,
    recorded: Recorded = RECORDED,
    sensor: str | None = None,
    pool: _Flag = False,
    with_controls: _Flag = False,
    design: _Design = None,
    motion: _Motion = None,
    schema: _Schema = False,
    figure: FigureFile = None,
    out: Annotated[Path | None, Parameter(name="--out", help="Write the calibration to this .json.")] = None,
    as_json: Json = False,
) -> None:
    """Calibrate recorded sensors, voltages to angles, with what that is worth.

    (The printer is calibrated by solen print calibrate.)

    Parameters
    ----------
    recordings
        Recordings of known angles, as solen bench analyse reads them. Each sensor's calibration is left beside them.
    sensor
        Calibrate only this one.
    pool
        Make one calibration of all prints with a lens, for a print that was never recorded.
    with_controls
        Calibrate sensors without a lens, too.
    """
    if schema:
        from solen.analysis.calibration.file import json_schema

        print(json.dumps(json_schema(), indent=2))
        return
    from solen.pipeline.bench import calibrate as pipeline

    asked = pipeline.Asked(request_of(recordings, recorded, moved), sensor, pool, with_controls, design, motion)
    found = pipeline.calibrate(asked, out=out, figure=figure)
    show(found, as_json, lambda: list(_told(found)))


def _told(found: dict[str, Any]) -> Iterator[str]:
    """Lines for a reader."""
    for one in found["calibrations"]:
        low, high = one["range_deg"]
        prints = f", {len(one['prints'])} prints" if len(one["prints"]) > 1 else ""
        yield f"{one['sensor']}{prints}: {one['cycles']} cycles, {low:.3g}° to {high:.3g}°"
        yield from (f"  {line}" for line in one["words"])
        yield f"  wrote {one['file']}"
    for warning in found["warnings"]:
        yield f"warning: {warning}"
    if "figure" in found:
        yield f"figure: {found['figure']}"


def decode(
    calibration: Path,
    source: Annotated[str, Parameter(allow_leading_hyphen=True)],
    /,
    *,
    recorded: Recorded = RECORDED,
    sensor: str | None = None,
    follow: _Flag = False,
    design: _Design = None,
    motion: _Motion = None,
    gain_percent: float = 0.0,
    window_ms: float = 50.0,
    out: Annotated[Path | None, Parameter(name="--out", help="Write the angles to this .csv.")] = None,
    as_json: Json = False,
) -> None:
    """Angles of voltages by a calibration: of a recording, of lines as they come, or of a run under way.

    Parameters
    ----------
    calibration
        File of solen bench calibrate.
    source
        A recording, - for lines of CSV on standard input, or the .journal of a run.
    sensor
        Sensor of the source; by default the one that was calibrated.
    follow
        Follow a journal as it grows, until its run ends.
    gain_percent
        Allow a common change of the light of so many per cent (standard deviation), as of an emitter that ages.
    window_ms
        Time over which an angle must rise or fall to be said to.
    """
    import sys

    from solen.pipeline.bench import decode as pipeline
    from solen.pipeline.bench.analyse import Switching
    from solen.pipeline.bench.decode_sources import Wanted

    columns, _ = columns_of(recorded)
    rate = recorded.on_off_hz
    wanted = Wanted(
        columns=columns,
        sensor=sensor,
        names=None if recorded.columns is None else tuple(recorded.columns),
        sheet=recorded.sheet,
        smooth_ms=recorded.smooth_ms,
        switching=None if rate is None else Switching(rate, recorded.emitters),
    )
    asked = pipeline.Asked(
        calibration, source, wanted, follow, design, motion, gain_percent, recorded.rails, 1e-3 * window_ms
    )
    plain = not as_json and out is None
    told = None if as_json else lambda line: print(f"warning: {line}", file=sys.stderr)
    found = pipeline.decode(asked, out=out, lines=sys.stdout if plain else None, say=told)
    if plain:
        print("\n".join(_counted(found)), file=sys.stderr)
    else:
        show(found, as_json, lambda: list(_counted(found)))


def _counted(found: dict[str, Any]) -> Iterator[str]:
    """Lines of a summary; its warnings but for those already told."""
    flags = [f"{found[name]} {name}" for name in ("outside", "ambiguous", "clipped", "missing") if found[name]]
    low, high = found["lowest_deg"], found["highest_deg"]
    ends = "none in the calibrated range" if low is None else f"{low:.4g}° to {high:.4g}°"
    yield f"{found['readings']} readings, {ends}" + "".join(f", {one}" for one in flags)
    against = found["against_angle"]
    if against is not None:
        yield (
            f"against the recording's own angle: rms {against['rms_deg']:.2g}°, mean {against['bias_deg']:+.1g}°, "
            f"{100 * against['within_95']:.0f} % within the bands of 95 %"
        )
    if found["interrupted"]:
        yield "stopped"
    if "out" in found:
        yield f"wrote {found['out']}"
