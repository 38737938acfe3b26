"""`solen schema`: the JSON Schema of the design file, or of what a command prints with ``--json``."""

import json
import typing
from importlib import import_module
from typing import Any

from solen.cli.commands import COMMANDS, GROUPS
from solen.errors import SpecError
from solen.results import Outcome, schema_of
from solen.spec import json_schema
from solen.spec.strict import nearest

DIALECT = "https://json-schema.org/draft/2020-12/schema"
FILES = {
    "type": "object",
    "additionalProperties": {"type": "string"},
    "description": "Files written by the command, by content.",
}


def schema(*command: str) -> None:
    """Print the JSON Schema of the design file, or of the result of a command.

    Parameters
    ----------
    command
        The command whose result to describe, such as bench analyse. Default: the design file.
    """
    print(json.dumps(result_schema(command) if command else json_schema(), indent=1))


def result_schema(command: tuple[str, ...]) -> dict[str, Any]:
    """Return the schema of a command's ``--json`` output; `SpecError` if there is no such command or schema."""
    name = " ".join(command)
    result = result_type(_place(name))
    if result is None:
        raise SpecError("schema", value=name, limit="has no result with a schema", remedy="see docs/commands.md")
    inner = schema_of(result)
    kinds = [_with_files(kind) for kind in inner.get("anyOf", [inner])]
    head = {"$schema": DIALECT, "title": f"solen {name}"}
    return head | ({"anyOf": kinds} if len(kinds) > 1 else kinds[0] | head)


def result_type(place: str) -> Any:
    """Return the result type of the command at ``module:function``; None if it has no typed result."""
    module, _, function = place.partition(":")
    returned = typing.get_type_hints(getattr(import_module(f"solen.cli.{module}"), function)).get("return")
    either = (returned, *typing.get_args(returned))  # None: the command may print something else
    kinds = tuple(typing.get_args(kind)[0] for kind in either if typing.get_origin(kind) is Outcome)
    return typing.Union[kinds] if kinds else None  # noqa: UP007  of as many as there are


def commands() -> dict[str, str]:
    """Return all commands as typed (``bench analyse``), with the module and function of each."""
    return {f"{group} {name}".strip(): place for group, rows in COMMANDS.items() for name, place, _ in rows}


def _place(name: str) -> str:
    known = commands()
    if name in known:
        return known[name]
    inside = [one for one in known if one.startswith(f"{name} ")] if name in GROUPS else []
    near = nearest(name, known)
    remedy = f"name one of {', '.join(inside)}" if inside else f"did you mean {near}?" if near else "see solen --help"
    raise SpecError("schema", value=name, limit="is not a command", remedy=remedy)


def _with_files(schema: dict[str, Any]) -> dict[str, Any]:
    properties = schema.get("properties", {}) | {"files": FILES}
    return schema | {"properties": properties, "required": list(properties)}
