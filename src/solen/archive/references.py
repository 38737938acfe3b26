"""The files that designs and rigs name, and changes of these names."""

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from solen.bench.rig import load_rig
from solen.errors import DataError, SolenError, SpecError
from solen.files import read_text
from solen.spec import load
from solen.spec.edited import edited
from solen.spec.toml import value_at


class Reference(NamedTuple):
    """A file name in a design or rig, and the path of the file."""

    name: str
    path: Path


def references(file: Path) -> dict[str, Reference]:
    """Return the files that a design or rig names, keyed by TOML key; none for any other file."""
    if file.suffix.lower() != ".toml":
        return {}
    try:
        design = load(file)
        return {key: Reference(str(value_at(design, key)), path) for key, path in design.files.items()}
    except SolenError:
        pass
    try:
        rig = load_rig(file)
    except SolenError:
        return {}
    return {
        f"sensor[{i}].design": Reference(sensor.design, file.parent / sensor.design)
        for i, sensor in enumerate(rig.sensor)
    }


def renamed(file: Path, names: Mapping[str, str]) -> str:
    """Return the text of a design or rig with new file ``names``, keyed by TOML key; comments are kept."""
    text = read_text(file, SpecError)
    if not next(iter(names)).startswith("sensor["):
        return edited(text, names, what=str(file), folder=file.parent)
    rig = tomllib.loads(text)
    for key, name in names.items():
        old = rig["sensor"][int(key[7 : key.index("]")])]["design"]
        text = re.sub(rf"""(\bdesign\s*=\s*)(["']){re.escape(old)}\2""", rf"\g<1>\g<2>{name}\g<2>", text)
    after = tomllib.loads(text)
    if any(after["sensor"][int(key[7 : key.index("]")])]["design"] != name for key, name in names.items()):
        limit = "contains the names of its designs in a form that cannot be changed"
        remedy = "pack from the folder of the design"
        raise DataError(str(file), limit=limit, remedy=remedy)
    return text
