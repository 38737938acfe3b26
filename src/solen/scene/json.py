"""Scenes as JSON: everything a scene holds, no more; what is written is read back equal.

Each curve and source is an object with its ``kind`` and the fields of its class.
"""

import dataclasses
import json
from pathlib import Path
from typing import Any

from solen import files
from solen.curve import Arc, CartesianOval, Curve, Parabola, Segment
from solen.errors import DataError, SolenError
from solen.scene.model import Beam, Fan, Interface, Monitor, Rays, Region, Scene, Source

SCHEMA = 1
CURVES: dict[str, type[Curve]] = {
    "segment": Segment,
    "arc": Arc,
    "parabola": Parabola,
    "cartesian-oval": CartesianOval,
}
SOURCES: dict[str, type[Source]] = {"fan": Fan, "beam": Beam, "rays": Rays}


def dumps(scene: Scene) -> str:
    """JSON text of a scene."""
    data = {
        "solen_scene": SCHEMA,
        "name": scene.name,
        "regions": [dataclasses.asdict(region) for region in scene.regions],
        "interfaces": [
            {**_fields(interface), "curve": _tagged(interface.curve, CURVES)} for interface in scene.interfaces
        ],
        "sources": [_tagged(source, SOURCES) for source in scene.sources],
        "monitors": [dataclasses.asdict(monitor) for monitor in scene.monitors],
    }
    return json.dumps(data, indent=1, allow_nan=False)


def loads(text: str, where: str = "scene") -> Scene:
    """Scene of a JSON text; `DataError` names the place where it is not one."""
    try:
        data = json.loads(text)
        if data["solen_scene"] != SCHEMA:
            raise DataError(f"{where}: solen_scene", value=data["solen_scene"], limit=f"this solen reads {SCHEMA}")
        return Scene(
            regions=tuple(Region(**region) for region in data["regions"]),
            interfaces=tuple(
                Interface(**{**interface, "curve": _untagged(interface["curve"], CURVES)})
                for interface in data["interfaces"]
            ),
            sources=tuple(_untagged(source, SOURCES) for source in data["sources"]),
            monitors=tuple(Monitor(**_tuples(monitor)) for monitor in data.get("monitors", [])),
            name=data.get("name", "scene"),
        )
    except SolenError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError) as bad:
        raise DataError(where, limit=f"not a scene of solen: {type(bad).__name__} {bad}") from None


def load(path: Path) -> Scene:
    """Scene of a JSON file; `DataError` where it cannot be read."""
    return loads(files.read_text(path, DataError), str(path))


def save(path: Path, scene: Scene) -> Path:
    """Write a scene as JSON."""
    return files.write_text(path, dumps(scene) + "\n")


def _fields(item: Any) -> dict[str, Any]:
    return {field.name: getattr(item, field.name) for field in dataclasses.fields(item)}


def _tagged(item: Any, kinds: dict[str, type[Any]]) -> dict[str, Any]:
    kind = next(name for name, cls in kinds.items() if type(item) is cls)
    return {"kind": kind, **dataclasses.asdict(item)}


def _untagged(data: dict[str, Any], kinds: dict[str, type[Any]]) -> Any:
    fields = dict(data)
    kind = fields.pop("kind")
    if kind not in kinds:
        raise ValueError(f"unknown kind {kind!r}; there are {', '.join(kinds)}")
    return kinds[kind](**_tuples(fields))


def _tuples(data: dict[str, Any]) -> dict[str, Any]:
    """Lists as tuples, as deep as they go: points and lists of points."""
    return {key: _tuple(value) for key, value in data.items()}


def _tuple(value: Any) -> Any:
    return tuple(_tuple(item) for item in value) if isinstance(value, list) else value
