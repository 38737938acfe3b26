"""Commands run in the process of the test, and their output."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from solen.cli import run_command
from solen.cli.design.schema import commands, result_schema


def answered(capfd: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    """Return the JSON object that a command prints, checked against its schema; nothing else may be printed."""
    capfd.readouterr()
    assert run_command([*arguments, "--json"]) == 0, capfd.readouterr().err
    printed = capfd.readouterr()
    assert printed.err == ""
    reply = json.loads(printed.out)
    assert isinstance(reply, dict)
    command = max((name for name in commands() if " ".join(arguments).startswith(f"{name} ")), key=len, default=None)
    if command is not None:
        assert misfits(result_schema(tuple(command.split())), reply) == []
    return reply


def misfits(schema: dict[str, Any], value: Any, where: str = "$") -> list[str]:
    """Deviations of a value from its JSON Schema, for the part of the language that `solen schema` uses."""
    if "anyOf" in schema:
        attempts = [misfits(kind, value, where) for kind in schema["anyOf"]]
        return min(attempts, key=len) if all(attempts) else []
    if "enum" in schema:
        return [] if value in schema["enum"] else [f"{where}: {value!r} is not one of {schema['enum']}"]
    kinds = schema.get("type", [])
    if kinds and not any(_is_a(kind, value) for kind in ([kinds] if isinstance(kinds, str) else kinds)):
        return [f"{where}: {value!r:.60} is not of type {kinds}"]
    misfit_lines = []
    if isinstance(value, dict) and "properties" in schema:
        unknown = sorted(value.keys() - schema["properties"].keys())
        missing = sorted(set(schema.get("required", ())) - value.keys())
        misfit_lines += [f"{where}: {name} is not in the schema" for name in unknown]
        misfit_lines += [f"{where}: {name} is missing" for name in missing]
        for key in value.keys() & schema["properties"].keys():
            misfit_lines += misfits(schema["properties"][key], value[key], f"{where}.{key}")
    if (
        isinstance(value, dict)
        and "additionalProperties" in schema
        and isinstance(schema["additionalProperties"], dict)
    ):
        for key, inner in value.items():
            misfit_lines += misfits(schema["additionalProperties"], inner, f"{where}.{key}")
    if isinstance(value, list) and "items" in schema:
        for index, inner in enumerate(value):
            misfit_lines += misfits(schema["items"], inner, f"{where}[{index}]")
    return misfit_lines


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
    """Output on stderr without progress messages, which depend on the load of the computer."""
    text = stderr if isinstance(stderr, str) else stderr.decode("utf-8", "replace")
    return re.sub(r"^solen [\w -]+: (working|compiling the tracer).*\r?\n", "", text, flags=re.MULTILINE)


def snapshot(folder: Path) -> dict[str, bytes | None]:
    """Contents of a folder and its subfolders, keyed by path: bytes of files, None for folders."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")
    }


def refusal(capture: pytest.CaptureFixture[str], folder: Path, *arguments: str) -> str:
    """The line on stderr of a command that fails; it must print nothing else and leave a folder unchanged."""
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
