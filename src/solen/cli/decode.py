"""The commands that make angles of voltages: `solen calibrate` and `solen decode`."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import BENCH, FigureFile, Json, app, show
from solen.cli.recorded import Moved, Recorded, columns_of, request_of

_Flag = Annotated[bool, Parameter(negative=())]
_Motion = Annotated[str | None, Parameter(help="What was moved: rotation or bend, where the recording does not say.")]
_Design = Annotated[Path | None, Parameter(help="Design file of the sensor: its motion, pivot, parts and circuit.")]
_Schema = Annotated[bool, Parameter(name="--schema", negative=(), help="Print the JSON Schema of a calibration.")]


@app.command(group=BENCH, sort_key=50)
def calibrate(
    *recordings: Path,
    moved: Moved = Moved(),
    recorded: Recorded = Recorded(),
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

    (The printer is calibrated by solen calibrate-printer.)

    Parameters
    ----------
    recordings
        Recordings of known angles, as solen analyse reads them. Each sensor's calibration is left beside them.
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
    from solen.pipeline import calibrate as pipeline

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
        yield f"note: {warning}"
    if "figure" in found:
        yield f"wrote {found['figure']}"
