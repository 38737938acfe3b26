"""Scenes as JSON, in which fields with default values are omitted; a scene that is read back equals the one written.

Curves and sources are objects with their ``kind`` and the fields of their class; unknown keys are rejected.
"""

import dataclasses
import json
from pathlib import Path
from typing import Any

from solen import files
from solen.curve import Curve
from solen.errors import DataError, DesignError
from solen.material import KINDS, Dispersion
from solen.scene.model import Extrusion, Interface, Monitor, Region, Scene
from solen.scene.sources import Ambient, Beam, Chip, Emitter, Fan, RayFile, Rays, Source
from solen.spec.objects import CURVES, build, build_kind, check_keys, parse_json, value_of
from solen.spec.strict import error_context

SCHEMA = 1
SOURCES: dict[str, type[Source]] = {
    "fan": Fan,
    "chip": Chip,
    "emitter": Emitter,
    "beam": Beam,
    "rays": Rays,
    "ray-file": RayFile,
    "ambient": Ambient,
}
PARTS = ("regions", "interfaces", "sources", "monitors")


def dumps(scene: Scene) -> str:
    """Return a scene as JSON text.

    Raises
    ------
    DesignError
        If the scene contains a curve, a source or a face in space that the format does not support.
    """
    if scene.front is not None:
        limit = "cannot be written as JSON: a face in space can be described only in a design file"
        raise DesignError("scene front", value=scene.front.lens.shape, limit=limit, remedy="keep the design file")
    data: dict[str, Any] = {
        "solen_scene": SCHEMA,
        "name": scene.name,
        "regions": [_region_fields(region) for region in scene.regions],
        "interfaces": [
            {**_fields(interface), "curve": _tagged(interface.curve, CURVES)} for interface in scene.interfaces
        ],
        "sources": [_tagged(source, SOURCES) for source in scene.sources],
    }
    if scene.monitors:
        data["monitors"] = [_fields(monitor) for monitor in scene.monitors]
    if scene.open_media:
        data["open_media"] = True
    if scene.extrusion is not None:
        data["extrusion"] = _fields(scene.extrusion)
    return json.dumps(data, indent=1, allow_nan=False)


def loads(text: str, where: str = "scene") -> Scene:
    """Read a scene from JSON text.

    Raises
    ------
    DataError
        If the text is not a scene; the message gives the position.
    DesignError
        If the scene is invalid.
    """
    data = _parsed(text, where)
    check_keys(
        data,
        {"solen_scene", "name", "open_media", "extrusion", *PARTS},
        {"solen_scene", "regions", "interfaces", "sources"},
        where,
    )
    if data["solen_scene"] != SCHEMA:
        raise DataError(
            f"{where}: solen_scene", value=data["solen_scene"], limit=f"this version of solen reads {SCHEMA}"
        )
    lists = {part: data.get(part, []) for part in PARTS}
    for part, items in lists.items():
        if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
            raise DataError(f"{where}: {part}", limit="must be a list of objects")
    return Scene(
        regions=tuple(_region(item, _at(where, "regions", i)) for i, item in enumerate(lists["regions"])),
        interfaces=tuple(_interface(item, _at(where, "interfaces", i)) for i, item in enumerate(lists["interfaces"])),
        sources=tuple(build_kind(item, SOURCES, _at(where, "sources", i)) for i, item in enumerate(lists["sources"])),
        monitors=tuple(build(Monitor, item, _at(where, "monitors", i)) for i, item in enumerate(lists["monitors"])),
        name=value_of(str, data.get("name", "scene"), f"{where}: name"),
        open_media=value_of(bool, data.get("open_media", False), f"{where}: open_media"),
        extrusion=value_of(Extrusion | None, data.get("extrusion"), f"{where}: extrusion"),
    )


def load(path: Path | str) -> Scene:
    """Read a scene from a JSON file; errors as in `loads`, and `DataError` if the file cannot be read."""
    return loads(files.read_text(Path(path), DataError), str(path))


def save(path: Path | str, scene: Scene) -> Path:
    """Write a scene as JSON."""
    return files.write_text(Path(path), dumps(scene) + "\n")


def _parsed(text: str, where: str) -> dict[str, Any]:
    data = parse_json(text, where)
    if not isinstance(data, dict) or "solen_scene" not in data:
        raise DataError(where, limit="is not a solen scene: it has no key solen_scene")
    return data


def _fields(item: Any) -> dict[str, Any]:
    """Return the fields of an object that differ from their defaults; fields common to all sources come last."""
    ordered = sorted(dataclasses.fields(item), key=lambda field: field.kw_only is True)
    fields = {field.name: (getattr(item, field.name), field.default) for field in ordered}
    return {name: _plain(value) for name, (value, default) in fields.items() if value != default or name == "kind"}


def _plain(value: Any) -> Any:
    """Return a field value for JSON; the callers convert curves and dispersions, whose kinds they know."""
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, Curve):
        return _fields(value)
    return value


def _region_fields(region: Region) -> dict[str, Any]:
    fields = _fields(region)
    if isinstance(region.index, Dispersion):
        kinds = [name for name, cls in KINDS.items() if type(region.index) is cls]
        if not kinds:
            raise DesignError(type(region.index).__name__, limit=f"a scene file supports only {', '.join(KINDS)}")
        fields["index"] = {"kind": kinds[0], **region.index.model_dump(mode="json", exclude_defaults=True)}
    return fields


def _region(data: dict[str, Any], where: str) -> Region:
    """Read a region; its index is a number, or an object that specifies the kind of dispersion."""
    index = data.get("index")
    if not isinstance(index, dict):
        return build(Region, data, where)
    kind = index.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise DataError(f"{where}: index: kind", value=kind, limit=f"must be one of {', '.join(KINDS)}")
    with error_context(f"{where}: index"):
        dispersion = KINDS[kind](**index)
    return build(Region, {**data, "index": dispersion}, where)


def _tagged(item: Any, kinds: dict[str, type[Any]]) -> dict[str, Any]:
    for kind, cls in kinds.items():
        if type(item) is cls:
            return {"kind": kind, **_fields(item)}
    raise DesignError(type(item).__name__, limit=f"a scene file supports only {', '.join(kinds)}")


def _interface(data: dict[str, Any], where: str) -> Interface:
    curve = data.get("curve")
    if not isinstance(curve, dict):
        raise DataError(f"{where}: curve", limit="must be an object with a kind")
    return build(Interface, {**data, "curve": build_kind(curve, CURVES, f"{where}: curve")}, where)


def _at(where: str, part: str, number: int) -> str:
    return f"{where}: {part}[{number}]"
