"""Files of a compensated drawing: a design with the drawing as its body, and the predicted profile.

The design is for the printer: `solen export` and `solen print layers` accept it. It contains only the outline, the
thickness and the data required to read it, and its name shows that it is not the intended shape.
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

LABEL = "drawn for the printer, not the intended shape"
COMMENT = """\
# Drawn for the printer, not the intended shape: the outline of {name!r}, changed so that the process
# {process!r} prints the intended outline. Do not trace it, and do not compensate it again.
"""


def compensation_files(
    target: Path, sensor: Sensor, compensation: Compensation | None, profile: MeasuredProfile | None, process: str
) -> dict[Path, bytes]:
    """Return the design file, the outline and the predicted profile; empty without a compensation."""
    if compensation is None or profile is None:
        return {}
    target, outline, printed = targets_of(target, "outline").values()
    text = COMMENT.format(name=sensor.design.name, process=process) + dumps(_design(sensor, outline.name))
    contents = (text.encode(), outline_text(sensor, compensation).encode(), profile_text(profile).encode())
    return dict(zip((target, outline, printed), contents, strict=True))


def targets_of(target: Path, drawn: str) -> dict[str, Path]:
    """Return the files of a compensated design keyed by kind: design, drawing, and predicted print."""
    return {"compensated": target} | {
        f"compensated_{suffix}": target.with_name(f"{target.stem}-{suffix}.json") for suffix in (drawn, "printed")
    }


def outline_text(sensor: Sensor, compensation: Compensation) -> str:
    """Return the outline of a drawing as JSON, whose hash identifies it."""
    return json.dumps(_outline(sensor, compensation), indent=1, allow_nan=False) + "\n"


def _design(sensor: Sensor, outline: str) -> Design:
    """Return the design of an outline: name, material, thickness and seats."""
    original = sensor.design
    material = {"index": sensor.material.index}
    body = {"kind": "outline", "file": outline, "thickness_mm": original.body.thickness_mm}
    seats = original.fabricate.model_dump(exclude_defaults=True)
    return Design(name=f"{original.name}, {LABEL}", material=material, body=body, fabricate=seats)


def _outline(sensor: Sensor, compensation: Compensation) -> dict[str, Any]:
    """Return the outline for `solen.geometry.drawing.outline_json`, with the emitter of the designed body."""
    body = sensor.body().prism()
    faces = [
        {"name": face.name, "curve": _curve(curve_of(face))} for outline in compensation.outlines for face in outline
    ]
    emitter = {"point": list(body.emitter.point), "axis_deg": body.emitter.axis_deg}
    points = {"pivot": list(body.marks["stem-base"])} if "stem-base" in body.marks else {}
    return {"solen_outline": 1, "faces": faces, "emitters": [emitter], "points": points}


def _curve(curve: Curve) -> dict[str, Any]:
    kind = next(name for name, cls in CURVES.items() if type(curve) is cls)
    return {"kind": kind, **dataclasses.asdict(curve)}  # type: ignore[call-overload]  # every curve is a dataclass
