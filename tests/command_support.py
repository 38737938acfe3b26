"""Commands run in the test's own process, and what they print."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from solen.cli import run_command
from solen.cli.design.schema import commands, result_schema


def answered(capfd: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    """The one JSON object that a command prints, fitting its schema; stdout and stderr hold nothing else."""
    capfd.readouterr()
    assert run_command([*arguments, "--json"]) == 0, capfd.readouterr().err
    printed = capfd.readouterr()
    assert printed.err == ""
    found = json.loads(printed.out)
    assert isinstance(found, dict)
    command = max((name for name in commands() if " ".join(arguments).startswith(f"{name} ")), key=len, default=None)
    if command is not None:
        assert misfits(result_schema(tuple(command.split())), found) == []
    return found


def misfits(schema: dict[str, Any], value: Any, where: str = "$") -> list[str]:
    """Where a value is not what its JSON Schema says, as far as `solen schema` uses that language."""
    if "anyOf" in schema:
        tried = [misfits(kind, value, where) for kind in schema["anyOf"]]
        return min(tried, key=len) if all(tried) else []
    if "enum" in schema:
        return [] if value in schema["enum"] else [f"{where}: {value!r} is not one of {schema['enum']}"]
    kinds = schema.get("type", [])
    if kinds and not any(_is_a(kind, value) for kind in ([kinds] if isinstance(kinds, str) else kinds)):
        return [f"{where}: {value!r:.60} is not of type {kinds}"]
    found = []
    if isinstance(value, dict) and "properties" in schema:
        unknown = sorted(value.keys() - schema["properties"].keys())
        missing = sorted(set(schema.get("required", ())) - value.keys())
        found += [f"{where}: {name} is not stated" for name in unknown]
        found += [f"{where}: {name} is missing" for name in missing]
        for key in value.keys() & schema["properties"].keys():
            found += misfits(schema["properties"][key], value[key], f"{where}.{key}")
    if (
        isinstance(value, dict)
        and "additionalProperties" in schema
        and isinstance(schema["additionalProperties"], dict)
    ):
        for key, inner in value.items():
            found += misfits(schema["additionalProperties"], inner, f"{where}.{key}")
    if isinstance(value, list) and "items" in schema:
        for place, inner in enumerate(value):
            found += misfits(schema["items"], inner, f"{where}[{place}]")
    return found


_TYPES: dict[str, type | tuple[type, ...]] = {
    "null": type(None),
    "boolean": bool,
    "integer": int,
    "number": (int, float),
    "string": str,
    "array": list,
    "object": dict,
}


def _is_a(kind: str, value: Any) -> bool:
    return isinstance(value, _TYPES[kind]) and not (isinstance(value, bool) and kind in {"integer", "number"})


def without_waiting(stderr: str | bytes) -> str:
    """What a program wrote on stderr, but for lines about a wait: they depend on how busy the computer is."""
    text = stderr if isinstance(stderr, str) else stderr.decode("utf-8", "replace")
    return re.sub(r"^solen [\w -]+: (working|compiling the tracer).*\r?\n", "", text, flags=re.MULTILINE)


def snapshot(folder: Path) -> dict[str, bytes | None]:
    """What lies in a folder and below it: files with what they hold, folders with None."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")
    }


def refusal(capture: pytest.CaptureFixture[str], folder: Path, *arguments: str) -> str:
    """The one line on stderr of a command that is refused, prints nothing else and leaves a folder as it was."""
    before = snapshot(folder)
    capture.readouterr()
    code = run_command(list(arguments))
    printed = capture.readouterr()
    assert (code, printed.out) == (2, ""), printed.err[:500]
    assert printed.err.startswith("solen: ")
    assert printed.err.endswith("\n")
    assert len(printed.err.splitlines()) == 1, printed.err
    assert len(printed.err) < 400
    assert snapshot(folder) == before
    return printed.err
