"""The table of commands: each row names a function that exists, and says what the function's docstring says."""

import inspect
import json
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, get_type_hints

import pytest

from solen.cli import run_command
from solen.cli.commands import COMMANDS, GROUPS
from solen.cli.design.schema import commands
from solen.spec.strict import Options
from tests.command_support import refusal

ROOT = Path(__file__).resolve().parents[2]
ROWS = [(group, name, place, text) for group, rows in COMMANDS.items() for name, place, text in rows]


@pytest.mark.parametrize(("group", "name", "place", "text"), ROWS, ids=lambda value: str(value)[:30])
def test_a_row_is_a_function_that_describes_itself(group: str, name: str, place: str, text: str) -> None:
    module, _, function = place.partition(":")
    found = getattr(import_module(f"solen.cli.{module}"), function)
    assert inspect.getdoc(found), place
    assert function.rstrip("_") == name
    assert module.startswith(f"{group or 'design'}.")
    assert text.endswith(".")
    assert len(text) < 80, "one line of a help screen"


def test_names_are_not_used_twice_in_a_group() -> None:
    for group, rows in COMMANDS.items():
        names = [name for name, _, _ in rows]
        assert len(set(names)) == len(names)
        assert not set(names) & set(GROUPS) or group


def test_every_command_has_its_section_in_the_docs() -> None:
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    missing = [one for one in commands() if not re.search(rf"^## `solen {re.escape(one)}[ `]", page, re.MULTILINE)]
    assert missing == []


def option_classes(kind: type[Options] = Options) -> Iterator[type[Options]]:
    for derived in kind.__subclasses__():
        if derived.__module__.startswith("solen."):
            yield derived
        yield from option_classes(derived)


def test_the_limits_of_every_option_are_in_its_help() -> None:
    """The limits that its JSON Schema states, at any depth, stand in the description that help shows."""
    for _, _, place, _ in ROWS:
        import_module(f"solen.cli.{place.partition(':')[0]}")
    missing, seen = [], 0
    for options in option_classes():
        for name, field in options.model_json_schema()["properties"].items():
            limits = re.findall(r"'(?:exclusiveM|m)(?:in|ax)imum': ([-+.\w]+)", str(field))
            seen += len(limits)
            words = options.model_fields[name].description or ""
            missing += [f"{options.__name__}.{name}" for limit in limits if f"{float(limit):g}" not in words]
    assert seen > 100
    assert missing == []


def test_help_shows_choices_defaults_and_limits(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["print", "layers", "--help"]) == 0
    text = " ".join(re.sub(r"[^\x20-\x7e]", " ", capsys.readouterr().out).split())
    assert "[choices: flat, upright, on-edge] [default: flat]" in text
    assert "--exposure-s FLOAT" in text
    assert "Above 0, at most 3600. [default: 2.0]" in text
    assert "False" not in text
    assert "()" not in text
    assert "[default: None]" not in text
    assert "[default: ]" not in text


def test_the_schema_alone_is_that_of_the_design(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["schema"]) == 0
    assert "lens" in json.loads(capsys.readouterr().out)["properties"]


def test_the_schema_of_a_command_is_that_of_its_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["schema", "doctor"]) == 0
    schema: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert run_command(["doctor", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert schema["title"] == "solen doctor"
    assert found.keys() == schema["properties"].keys() == set(schema["required"])


@pytest.mark.parametrize(
    ("asked", "named"),
    [(["nonsense"], "nonsense"), (["bench"], "bench analyse"), (["ben", "analyse"], "bench analyse")],
)
def test_no_command_has_no_schema(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, asked: list[str], named: str
) -> None:
    assert named in refusal(capsys, tmp_path, "schema", *asked)


def test_what_prints_no_result_has_no_schema(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert "schema" in refusal(capsys, tmp_path, "schema", "schema")


def test_no_command_has_an_option_twice() -> None:
    """Options of a stage and of a figure stand side by side: one name must be one option."""
    for name, place in commands().items():
        module, _, function = place.partition(":")
        hints = get_type_hints(getattr(import_module(f"solen.cli.{module}"), function))
        fields = [list(getattr(kind, "model_fields", [key])) for key, kind in hints.items() if key != "return"]
        flat = [option for part in fields for option in part]
        assert len(set(flat)) == len(flat), name
