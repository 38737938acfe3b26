"""The command of diagnoses: `solen bench diagnose`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, progress_bar, show
from solen.cli.bench.recorded import MOVED, RECORDED, Moved, Recorded, Texts, request_of

_Out = Annotated[Path | None, Parameter(name="--out", help="Write the result to this .json.")]


def diagnose(
    *files: Path,
    design: Path | None = None,
    sensor: Texts = None,
    spread: Texts = None,
    zero_u_deg: float = 0.1,
    brighter: str = "lower",
    moved: Moved = MOVED,
    recorded: Recorded = RECORDED,
    figure: FigureFile = None,
    out: _Out = None,
    as_json: Json = False,
) -> None:
    """What a recording says of its sensor: emitter decentre, chip width, loss, gains and offsets, with intervals.

    Parameters
    ----------
    files
        Recordings, as of solen bench analyse.
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
    """
    from solen.pipeline.bench import diagnose as pipeline

    request = request_of(files, recorded, moved)
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
        yield f"warning: {warning}"
    for kind in ("out", "figure"):
        if kind in found:
            yield f"{kind}: {found[kind]}"
