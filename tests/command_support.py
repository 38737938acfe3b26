"""Commands run in the test's own process, and what they print."""

import json
from typing import Any

import pytest

from solen.cli import _run


def answered(capfd: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    """The one JSON object that a command prints; nothing else may stand on stdout or stderr."""
    capfd.readouterr()
    assert _run([*arguments, "--json"]) == 0, capfd.readouterr().err
    printed = capfd.readouterr()
    assert printed.err == ""
    found = json.loads(printed.out)
    assert isinstance(found, dict)
    return found
