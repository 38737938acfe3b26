"""Files of a compensated drawing: a design with the drawing as its body, and the predicted profile.

The design is meant for the printer: `solen export` and the slicer accept it. It contains only the outline, the
thickness and the data needed to read it, and its name states that it is not the intended shape.
"""

import dataclasses
import json
from pathlib import Path
from typing import Any

from solen.curve import Curve
from solen.fabricate.process.compensate import Compensation
from solen.fabricate.process.drawing import curve_of
from solen.lens.profile import MeasuredProfile, profile_text
from solen.sensor import Sensor
from solen.spec import Design, dumps
from solen.spec.objects import CURVES

LABEL = "as drawn for the printer, not the intended shape"
COMMENT = """\
# As drawn for the printer, not the intended shape: this is the outline of {name!r}, changed so that the
# process {process!r} prints the intended one. Do not trace it, and do not compensate it again.
"""


def compensation_files(
    target: Path, sensor: Sensor, made: Compensation | None, profile: MeasuredProfile | None, process: str
) -> dict[Path, bytes]:
    """Return the design file, the outline and the predicted profile; empty without a compensation."""
    if made is None or profile is None:
        return {}
    target, outline, printed = targets_of(target, "outline").values()
    text = COMMENT.format(name=sensor.design.name, process=process) + dumps(_design(sensor, outline.name))
    contents = (text.encode(), outline_text(sensor, made).encode(), profile_text(profile).encode())
    return dict(zip((target, outline, printed), contents, strict=True))


def targets_of(target: Path, drawn: str) -> dict[str, Path]:
    """Files of a compensated design by name: design, drawing (outline or drawn layers) and predicted print."""
    return {"compensated": target} | {
        f"compensated_{end}": target.with_name(f"{target.stem}-{end}.json") for end in (drawn, "printed")
    }


def outline_text(sensor: Sensor, made: Compensation) -> str:
    """Return the outline of a drawing as JSON text, whose hash identifies it."""
    return json.dumps(_outline(sensor, made), indent=1, allow_nan=False) + "\n"


def _design(sensor: Sensor, outline: str) -> Design:
    """Return the design for an outline: name, material, thickness and seats."""
    old = sensor.design
    material = {"index": sensor.material.index}
    body = {"kind": "outline", "file": outline, "thickness_mm": old.body.thickness_mm}
    seats = old.fabricate.model_dump(exclude_defaults=True)
    return Design(name=f"{old.name}, {LABEL}", material=material, body=body, fabricate=seats)


def _outline(sensor: Sensor, made: Compensation) -> dict[str, Any]:
    """Return the outline as JSON of `solen.geometry.drawing.outline_json`, with the emitter of the designed body."""
    body = sensor.body().prism()
    faces = [{"name": face.name, "curve": _curve(curve_of(face))} for outline in made.outlines for face in outline]
    emitter = {"point": list(body.emitter.point), "axis_deg": body.emitter.axis_deg}
    points = {"pivot": list(body.marks["stem-base"])} if "stem-base" in body.marks else {}
    return {"solen_outline": 1, "faces": faces, "emitters": [emitter], "points": points}


def _curve(curve: Curve) -> dict[str, Any]:
    kind = next(name for name, cls in CURVES.items() if type(curve) is cls)
    return {"kind": kind, **dataclasses.asdict(curve)}  # type: ignore[call-overload]  # every curve is a dataclass
