"""JSON outlines: ``{"solen_outline": 1, "faces": [{"name": "lens", "curve": {"kind": "arc", …}}, …]}``, in mm.

Curves are encoded as in scene JSON. ``emitters`` are objects with a ``point`` and optionally ``axis_deg`` and
``width_mm``, or with the ends of a line, ``point`` and ``end``; if there are several emitters, each has a ``name``.
``points`` are keyed by name: ``{"pivot": [0, 2]}``.
"""

from pathlib import Path
from typing import Any

from solen.errors import DataError
from solen.files import read_text
from solen.geometry.drawing.model import Drawing, DrawnEmitter, Stroke, face_name
from solen.plane import Point
from solen.spec.objects import CURVES, build, build_kind, check_keys, parse_json, value_of

VERSION = 1


def read_json(path: Path, units: str | None) -> Drawing:
    """Read a drawing from a JSON file, whose lengths are always in mm; raise the errors of `read_drawing`."""
    where = str(path)
    if units not in (None, "mm"):
        raise DataError(
            "body.units", value=units, limit="does not apply: an outline in JSON is in mm", remedy="omit body.units"
        )
    data = parse_json(read_text(path, DataError), where)
    if not isinstance(data, dict) or "solen_outline" not in data:
        raise DataError(where, limit="is not a solen outline: the key solen_outline is missing")
    check_keys(data, {"solen_outline", "faces", "emitters", "points"}, {"faces"}, where)
    if data["solen_outline"] != VERSION:
        raise DataError(
            f"{where}: solen_outline", value=data["solen_outline"], limit=f"must be {VERSION} for this version of solen"
        )
    faces, emitters = (_objects(data, key, where) for key in ("faces", "emitters"))
    points = value_of(dict[str, Point], data.get("points", {}), f"{where}: points")
    return Drawing(
        tuple(_stroke(face, f"{where}: faces[{i}]", i) for i, face in enumerate(faces)),
        tuple(build(DrawnEmitter, emitter, f"{where}: emitters[{i}]") for i, emitter in enumerate(emitters)),
        tuple(points.items()),
    )


def _objects(data: dict[str, Any], key: str, where: str) -> list[dict[str, Any]]:
    items = data.get(key, [])
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise DataError(f"{where}: {key}", limit="must be a list of objects")
    return items


def _stroke(data: dict[str, Any], where: str, number: int) -> Stroke:
    check_keys(data, {"name", "curve"}, {"name", "curve"}, where)
    name = value_of(str, data["name"], f"{where}: name")
    if not isinstance(data["curve"], dict):
        raise DataError(f"{where}: curve", limit="must be an object with the key kind")
    return Stroke(face_name(name), build_kind(data["curve"], CURVES, f"{where}: curve"), f"face {number} ({name})")
