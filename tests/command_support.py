"""Commands run in the test's own process, and what they print."""

import json
from pathlib import Path
from typing import Any

import pytest

from solen.cli import run_command


def answered(capfd: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    """The one JSON object that a command prints; nothing else may stand on stdout or stderr."""
    capfd.readouterr()
    assert run_command([*arguments, "--json"]) == 0, capfd.readouterr().err
    printed = capfd.readouterr()
    assert printed.err == ""
    found = json.loads(printed.out)
    assert isinstance(found, dict)
    return found


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
