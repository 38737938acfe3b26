"""The state of a page as a command line and as a Python script."""

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

SAVE_FIRST = "Save the design first: a command line cannot reset a value to its default."


def same_as(file: Path, changes: Mapping[str, Any]) -> dict[str, str]:
    """Return a command line (``shell``) and a script (``python``) for the response of a design with changed values."""
    if None in changes.values():
        return {"shell": SAVE_FIRST, "python": SAVE_FIRST}
    shell = shlex.join(["solen", "run", str(file), "--out", f"{file.stem}-run", *assigned(changes)])
    changed = f".set({dict(changes)!r})" if changes else ""
    lines = ("import solen", f"sensor = solen.Sensor.of({str(file)!r}){changed}", "print(sensor.power().contrast)")
    return {"shell": shell, "python": "\n".join(lines)}


def assigned(changes: Mapping[str, Any]) -> list[str]:
    """Return the ``--set`` options for changed values."""
    return [part for key, value in changes.items() for part in ("--set", f"{key}={_toml(value)}")]


def _toml(value: Any) -> str:
    """Return a TOML value on one line."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return tomli_w.dumps({"value": value}).removeprefix("value = ").strip()
